"""The command ``tdcr-fe run``: solves a scenario, writes tables and pictures."""

from __future__ import annotations

import argparse
import importlib
import json
import math
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tdcr_fe.commands.machine import add_json_option, note
from tdcr_fe.commands.status import FAILURE, INTERRUPTED, SUCCESS, complain, count

if TYPE_CHECKING:
    from tdcr_fe.io.toml import Scenario
    from tdcr_fe.model.results import SequenceResult, StepResult


def add_run_parser(commands: Any) -> None:
    """Add ``tdcr-fe run``."""
    parser = commands.add_parser(
        "run",
        help="solve a scenario; write tables and pictures",
        description="Solve the loading sequence of a scenario.toml; write tables, a summary and pictures.",
    )
    parser.add_argument("scenario", nargs="?", help="path of a scenario.toml")
    parser.add_argument("-o", "--out", metavar="OUT", help="directory for the results")
    parser.add_argument(
        "--schema",
        choices=("robot", "scenario", "model", "sweep"),
        help="print the JSON schema of one of the .toml files, for editors, and do nothing else",
    )
    parser.add_argument(
        "--effects",
        action="append",
        default=[],
        metavar="FILE.py",
        help="effects of your own, classes in a Python file, that [effects] may name; may be repeated",
    )
    add_options(parser)
    parser.set_defaults(handler=run, parser=parser)


def add_options(parser: argparse.ArgumentParser) -> None:
    """Options that `run` and `demo` share."""
    parser.add_argument(
        "--sensitivities",
        nargs="+",
        default=[],
        metavar="PARAMETER",
        help="differentiate the results by parameters such as backbone.youngs_modulus; writes sensitivities.csv",
    )
    parser.add_argument(
        "--compliance",
        action="store_true",
        help="compliance and tendon Jacobians of the tip, and the stiffness seen by the motors, into summary.json",
    )
    parser.add_argument(
        "--no-pictures", action="store_true", help="write tables and summary only, no pictures and no 3D page"
    )
    parser.add_argument("-q", "--quiet", action="store_true", help="print nothing but what went wrong")
    add_json_option(parser)


def run(args: argparse.Namespace) -> int:
    """Solve a scenario and write the results; with ``--schema`` print a schema."""
    if args.schema is not None:
        from tdcr_fe.io.json_schema import json_schema
        from tdcr_fe.sweeps.schema import sweep_schema

        schema = sweep_schema() if args.schema == "sweep" else json_schema(args.schema)
        if args.json:
            note(args, figures={"schema": schema})
        else:
            print(json.dumps(schema, indent=2, ensure_ascii=False))
        return SUCCESS
    missing = [name for name, given in (("scenario", args.scenario), ("-o/--out", args.out)) if given is None]
    if missing:
        args.parser.error(f"the following arguments are required: {', '.join(missing)}")
    from tdcr_fe.io.atomic import check_output_folder
    from tdcr_fe.io.effects import effects_reader
    from tdcr_fe.io.own_effects import read_own_effects
    from tdcr_fe.io.toml import read_scenario

    problems: list[Any] = []
    own = _or_note(problems, lambda: read_own_effects(args.effects)) or ()
    scenario = _or_note(problems, lambda: read_scenario(args.scenario, {"effects": effects_reader(own)}))
    out = _or_note(problems, lambda: check_output_folder(args.out))
    _refuse(problems)
    return solve_and_write(scenario, out, args)


def _or_note(problems: list[Any], read: Callable[[], Any]) -> Any:
    """What ``read`` returns; where the input is wrong, its problems are noted instead."""
    from tdcr_fe.io.problems import InputError

    try:
        return read()
    except InputError as error:
        problems.extend(error.problems)
        return None


def _refuse(problems: list[Any]) -> None:
    from tdcr_fe.io.problems import InputError

    if problems:
        raise InputError(problems)


def solve_and_write(scenario: Scenario, out: Path, args: argparse.Namespace) -> int:
    """Solve a scenario, write its results, and return the exit status."""
    from tdcr_fe.commands.tables import response_tables, sensitivity_table, step_tables
    from tdcr_fe.io.problems import InputError, Problem
    from tdcr_fe.io.tables import write_results
    from tdcr_fe.model.plausibility import plausibility_warnings
    from tdcr_fe.model.results import Interrupted, SequenceResult

    if not args.no_pictures:
        importlib.import_module("tdcr_fe.report.plots")  # slow; an interruption after solving must not hit it
    odd = plausibility_warnings(scenario.robot, scenario.model, scenario.steps)
    note(args, warnings=odd)
    for warning in odd:
        complain(f"warning: {warning}")
    duration = long_run(scenario)
    if duration and not args.quiet:
        complain(duration)
    try:
        result = _solve(scenario, args)
    except Interrupted as stop:  # what was solved is written
        assert isinstance(stop.result, SequenceResult)
        result = stop.result
    except ValueError as error:  # a contradiction that only the solver can detect
        option, named, text = str(error).partition("sensitivities: ")
        problem = Problem("--sensitivities", "", "", text) if named and not option else None
        raise InputError([problem or Problem(str(scenario.path), "", "", str(error))]) from error
    found = [warning for warning in result.warnings if warning not in odd]
    result = replace(result, warnings=(*odd, *found))
    try:
        written = write_results(result, out, scenario.digests, len(scenario.steps), not args.no_pictures)
    except KeyboardInterrupt:  # while drawing, most likely; what was solved is kept
        written = write_results(result, out, scenario.digests, len(scenario.steps), pictures=False)
        note(args, files=written, figures=figures(result, scenario))
        complain(f"interrupted while writing; the tables are in {out}, without pictures")
        return INTERRUPTED
    note(args, files=written, figures=figures(result, scenario), warnings=found, message=result.message)
    if not args.quiet:
        if result.steps:
            for text in (step_tables(result), sensitivity_table(result), response_tables(result)):
                if text:
                    print(text + "\n")
        print(f"{count(len(result.steps), 'step')} in {result.wall_time:.2f} s. Written to {out}:")
        print("    " + ", ".join(p.name for p in written))
    for warning in found:
        complain(f"warning: {warning}")
    if result.converged:
        return SUCCESS
    return _report_failure(result, scenario, out)


def figures(result: SequenceResult, scenario: Scenario) -> dict[str, Any]:
    """Main results for ``--json``; tensions and displacements are those after the last step that was solved."""
    last = result.steps[-1] if result.steps else None
    names = result.robot.tendon_names
    found: dict[str, Any] = {
        "robot": result.robot.name,
        "steps_asked": len(scenario.steps),
        "steps_solved": sum(s.converged for s in result.steps),
        "failed_step": result.failed_step,
        "converged": result.converged,
        "elements": sum(result.elements_per_bay),
        "wall_time": result.wall_time,
    }
    if last is not None:
        errors = [s.discretisation_error for s in result.steps if s.discretisation_error is not None]
        found |= {
            "tip": last.tip,
            "bending_angle_deg": math.degrees(last.bending_angle),
            "tip_offset": last.tip_offset,
            "tensions": dict(zip(names, last.base_tensions.tolist(), strict=True)),
            "displacements": dict(zip(names, last.displacements.tolist(), strict=True)),
            "discretisation_error": max(errors, default=None),
        }
    return found


def _report_failure(result: SequenceResult, scenario: Scenario, out: Path) -> int:
    interrupted = result.message.startswith("interrupted")
    number = result.failed_step
    if number is not None and 1 <= number <= len(scenario.steps):
        label = scenario.steps[number - 1].label
        where = f"step {number} of {len(scenario.steps)}" + (f' ("{label}")' if label else "")
    else:
        where = "the sequence"
    solved = sum(s.converged for s in result.steps)
    what = f"interrupted in {where}" if interrupted else f"{where} did not converge"
    complain(f"{what}; {count(solved, 'step')} solved before it {'is' if solved == 1 else 'are'} in {out}")
    if result.message and not interrupted:
        complain(result.message)
    return INTERRUPTED if interrupted else FAILURE


#: A run that takes longer is announced [s].
LONG_RUN = 60.0


def long_run(scenario: Scenario) -> str:
    """A sentence on how long solving will take, where that is long; else nothing.

    A load step that needs no refinement takes about 6 ms per element for the elements, and three factorisations of
    the dense tangent of ``6 N`` unknowns. Measured with 13, 100 and 300 elements, times lie within a factor of three.
    """
    from tdcr_fe.model.checks import backbone_elements

    elements, steps = backbone_elements(scenario.robot, scenario.model), len(scenario.steps)
    seconds = steps * (6e-3 * elements + 4.0 * (6.0 * elements) ** 3 / 1e10)
    if seconds < LONG_RUN:
        return ""
    time = f"{seconds / 60:.0f} minutes" if seconds < 7200 else f"{seconds / 3600:.0f} hours"
    return f"{count(steps, 'load step')} on {count(elements, 'element')}: about {time}"


def _solve(scenario: Scenario, args: argparse.Namespace) -> SequenceResult:
    """Simulate with a bar on stderr, where that is a terminal."""
    from tqdm import tqdm

    from tdcr_fe.solve.simulate import simulate

    with tqdm(
        total=len(scenario.steps),
        unit="step",
        leave=False,
        file=sys.stderr,
        disable=True if args.quiet else None,
    ) as bar:

        def progress(step: StepResult) -> None:
            bar.set_postfix_str(step.label, refresh=False)
            bar.update(step.step - bar.n)  # refining the mesh begins again with the first step

        return simulate(
            scenario.robot,
            scenario.model,
            scenario.steps,
            scenario.settings,
            progress,
            sensitivities=args.sensitivities,
            responses=args.compliance,
        )

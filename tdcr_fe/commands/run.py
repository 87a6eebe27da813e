"""The commands ``tdcr-fe run`` and ``tdcr-fe demo``: solve a scenario, write tables and pictures."""

from __future__ import annotations

import argparse
import importlib
import math
from dataclasses import replace
from importlib.resources import as_file, files
from pathlib import Path
from shutil import copyfile
from typing import Any

from tdcr_fe.commands.common import (
    FAILURE,
    INTERRUPTED,
    SUCCESS,
    complain,
    count,
    progress_bar,
    refuse,
    warn,
)
from tdcr_fe.commands.tables import response_tables, sensitivity_table, step_tables
from tdcr_fe.io.atomic import check_output_folder, write_folder
from tdcr_fe.io.problems import read_all
from tdcr_fe.io.result_files import write_results
from tdcr_fe.io.toml import Scenario, read_scenario
from tdcr_fe.io.user_effects import read_own_effects
from tdcr_fe.model.checks import backbone_elements
from tdcr_fe.model.plausibility import plausibility_warnings
from tdcr_fe.model.results import Interrupted, SequenceResult, StepResult
from tdcr_fe.solve.simulate import simulate

#: A run that takes longer is announced [s].
LONG_RUN = 60.0


def run(args: argparse.Namespace) -> int:
    """Solve a scenario and write the results."""

    def read() -> Scenario:
        return read_scenario(args.scenario, read_own_effects(args.effects))

    scenario, out = read_all(read, lambda: check_output_folder(args.out))
    return _solve_and_write(scenario, out, args)


def demo(args: argparse.Namespace) -> int:
    """Solve the packaged scenario; leave its input beside the results."""
    out = check_output_folder(args.out)
    with as_file(files("tdcr_fe") / "data" / "demo") as folder:

        def write(place: Path) -> None:
            for name in ("robot.toml", "scenario.toml"):
                copyfile(folder / name, place / name)

        write_folder(out, write)
    scenario = out / "scenario.toml"
    if not args.quiet:
        print(f"The input is {scenario} with {out / 'robot.toml'}; edit it and solve it again with")
        print(f"    tdcr-fe run {scenario} -o {out}\n")
    return _solve_and_write(read_scenario(scenario), out, args)


def _solve_and_write(scenario: Scenario, out: Path, args: argparse.Namespace) -> int:
    """Solve a scenario, write its results, and return the exit status."""
    if not args.no_pictures:
        importlib.import_module("tdcr_fe.report.plots")  # slow; an interruption after solving must not hit it
    odd = plausibility_warnings(scenario.robot, scenario.model, scenario.steps)
    warn(args, odd)
    if not args.quiet and (duration := long_run(scenario)):
        complain(duration)
    asked = len(scenario.steps)
    with progress_bar(args, asked + 1, unit="step") as bar:
        result = _solve(scenario, args, bar)
        found = [warning for warning in result.warnings if warning not in odd]
        result = replace(result, warnings=(*odd, *found))
        args.noted.figures, args.noted.message = figures(result, scenario), result.message
        bar.set_postfix_str("writing" if args.no_pictures else "drawing")
        try:
            written = write_results(result, out, scenario.digests, asked, not args.no_pictures)
        except KeyboardInterrupt:  # while drawing, most likely; what was solved is kept
            args.noted.files += write_results(result, out, scenario.digests, asked, pictures=False)
            complain(f"interrupted while writing; the tables are in {out}, without pictures")
            return INTERRUPTED
    args.noted.files += written
    if not args.quiet:
        _print(result, out, written)
    warn(args, found)
    return SUCCESS if result.converged else _report_failure(result, scenario, out)


def _solve(scenario: Scenario, args: argparse.Namespace, bar: Any) -> SequenceResult:
    """Simulate with a progress bar; an interruption gives what was solved before it.

    Raises
    ------
    InputError
        A contradiction that only the solver can detect.
    """

    def progress(step: StepResult) -> None:
        bar.set_postfix_str(step.label, refresh=False)
        bar.update(step.step - bar.n)  # refining the mesh begins again with the first step

    try:
        return simulate(
            scenario.robot,
            scenario.model,
            scenario.steps,
            scenario.settings,
            progress,
            sensitivities=args.sensitivities,
            responses=args.compliance,
        )
    except Interrupted as stop:
        assert isinstance(stop.result, SequenceResult)
        return stop.result
    except ValueError as error:
        text = str(error).removeprefix("sensitivities: ")
        raise refuse(scenario.path if text == str(error) else "--sensitivities", "", text) from error


def _print(result: SequenceResult, out: Path, written: list[Path]) -> None:

    if result.steps:
        for text in (step_tables(result), sensitivity_table(result), response_tables(result)):
            if text:
                print(text + "\n")
    print(f"{count(len(result.steps), 'step')} in {result.wall_time:.2f} s. Written to {out}:")
    print("    " + ", ".join(p.name for p in written))


def figures(result: SequenceResult, scenario: Scenario) -> dict[str, Any]:
    """Main results for ``--json``; tensions and displacements are those after the last step that was solved."""
    found: dict[str, Any] = {
        "robot": result.robot.name,
        "steps_asked": len(scenario.steps),
        "steps_solved": sum(s.converged for s in result.steps),
        "failed_step": result.failed_step,
        "converged": result.converged,
        "elements": sum(result.elements_per_bay),
        "wall_time": result.wall_time,
    }
    if not result.steps:
        return found
    last, names = result.steps[-1], result.robot.tendon_names
    errors = [s.discretisation_error for s in result.steps if s.discretisation_error is not None]
    return found | {
        "tip": last.tip,
        "bending_angle_deg": math.degrees(last.bending_angle),
        "tip_offset": last.tip_offset,
        "tensions": dict(zip(names, last.base_tensions.tolist(), strict=True)),
        "displacements": dict(zip(names, last.displacements.tolist(), strict=True)),
        "discretisation_error": max(errors, default=None),
    }


def _report_failure(result: SequenceResult, scenario: Scenario, out: Path) -> int:
    interrupted = result.message.startswith("interrupted")
    number, total = result.failed_step, len(scenario.steps)
    where = "the sequence"
    if number is not None and 1 <= number <= total:
        label = scenario.steps[number - 1].label
        where = f"step {number} of {total}" + (f' ("{label}")' if label else "")
    solved = sum(s.converged for s in result.steps)
    what = f"interrupted in {where}" if interrupted else f"{where} did not converge"
    complain(f"{what}; {count(solved, 'step')} solved before it {'is' if solved == 1 else 'are'} in {out}")
    if result.message and not interrupted:
        complain(result.message)
    return INTERRUPTED if interrupted else FAILURE


def long_run(scenario: Scenario) -> str:
    """A sentence on how long solving will take, where that is long; else nothing.

    A load step that needs no refinement takes about 6 ms per element for the elements, and three factorisations of
    the dense tangent of ``6 N`` unknowns. Measured with 13, 100 and 300 elements, times lie within a factor of three.
    """
    elements, steps = backbone_elements(scenario.robot, scenario.model), len(scenario.steps)
    seconds = steps * (6e-3 * elements + 4.0 * (6.0 * elements) ** 3 / 1e10)
    if seconds < LONG_RUN:
        return ""
    time = f"{seconds / 60:.0f} minutes" if seconds < 7200 else f"{seconds / 3600:.0f} hours"
    return f"{count(steps, 'load step')} on {count(elements, 'element')}: about {time}"

"""The commands ``tdcr-fe run`` and ``tdcr-fe demo``: solve a scenario, write tables and pictures."""

from __future__ import annotations

import argparse
import importlib
import math
from collections.abc import Sequence
from dataclasses import replace
from importlib.resources import as_file, files
from pathlib import Path
from shutil import copyfile, copytree
from typing import Any

import numpy as np
import pandas as pd

from tdcr_fe.commands.common import Clock, Exit, complain, print_understood, progress_bar, say, typed
from tdcr_fe.io.files import InputError, Problem, check_output_folder, read_all, refusal, write_folder
from tdcr_fe.io.result_files import write_results
from tdcr_fe.io.toml import Scenario, read_scenario
from tdcr_fe.io.user_effects import read_own_effects
from tdcr_fe.model.messages import PlausibilityRemark, count, shown
from tdcr_fe.model.plausibility import Implausible
from tdcr_fe.model.results import Interrupted, SequenceResult, StepResult
from tdcr_fe.solve.simulate import simulate

#: Columns of a terminal; wider tables are printed in blocks.
WIDTH = 110
#: Longest label that is printed in full [characters].
LONGEST_LABEL = 24


def run(args: argparse.Namespace) -> int:
    """Solve a scenario and write the results."""
    scenario, out = read_all(
        lambda: read_scenario(args.scenario, read_own_effects(args.effects)),
        lambda: check_output_folder(args.out),
    )
    return _solve_and_write(scenario, out, args)


def demo(args: argparse.Namespace) -> int:
    """Solve the packaged scenario; leave its input beside the results."""
    out = check_output_folder(args.out)
    with as_file(files("tdcr_fe") / "data" / "demo") as folder:
        write_folder(out, lambda place: copytree(folder, place, copy_function=copyfile, dirs_exist_ok=True))
    scenario = out / "scenario.toml"
    what = f"The input is {scenario} with {out / 'robot.toml'}; edit it and solve it again with"
    say(args, f"{what}\n    {typed('run', scenario, '-o', out)}\n")
    return _solve_and_write(read_scenario(scenario), out, args)


def _solve_and_write(scenario: Scenario, out: Path, args: argparse.Namespace) -> int:
    """Solve a scenario, write its results, and return the exit status."""
    if not args.no_pictures:
        importlib.import_module("tdcr_fe.report.plots")  # slow; an interruption after solving must not hit it
    asked = len(scenario.steps)
    print_understood(args, scenario.robot, scenario.model, scenario.steps)
    with progress_bar(args, asked + 1, unit="step") as bar:
        result = _solve(scenario, args, bar)
        if len(scenario.ends) < asked:
            text = f"effects divide load steps; those of the file end with steps {shown(scenario.ends)} of the results"
            args.noted.warn(text, PlausibilityRemark)
            result = replace(result, remarks=(*result.remarks, text))
        args.noted.figures, args.noted.message = figures(result, asked), result.message
        bar.set_postfix_str("writing" if args.no_pictures else "drawing")
        try:
            written = write_results(result, out, scenario.digests, asked, not args.no_pictures)
        except KeyboardInterrupt:  # while drawing, most likely; what was solved is kept
            args.noted.files += write_results(result, out, scenario.digests, asked, pictures=False)
            complain(f"interrupted while writing; the tables are in {out}, without pictures")
            return Exit.INTERRUPTED
    args.noted.files += written
    if not args.quiet:
        print_result(result, out, written)
    return Exit.DONE if result.converged else _report_failure(result, scenario, out)


def _solve(scenario: Scenario, args: argparse.Namespace, bar: Any) -> SequenceResult:
    """Simulate with a progress bar; an interruption gives what was solved before it.

    Raises
    ------
    InputError
        A contradiction that only the solver can detect.
    """
    clock = Clock(len(scenario.steps), "load step", args.minutes)

    def progress(step: StepResult) -> None:
        clock.solved = step.step
        bar.set_postfix_str(step.label, refresh=False)
        bar.update(step.step - bar.n)  # refining the mesh begins again with the first step

    asked = (scenario.robot, scenario.model, scenario.steps, scenario.settings)
    derivatives = {"sensitivities": args.sensitivities, "responses": args.compliance}
    try:
        with clock.running():
            return simulate(*asked, progress, **derivatives)
    except Interrupted as stop:
        return replace(stop.result, message=clock.reason)
    except Implausible as error:
        in_scenario = ("steps", "model")
        raise InputError(
            Problem(str(scenario.path if c.key.startswith(in_scenario) else scenario.robot_path), *c)
            for c in error.contradictions
        ) from error
    except ValueError as error:
        text = str(error).removeprefix("sensitivities: ")
        raise refusal(scenario.path if text == str(error) else "--sensitivities", text) from error


def figures(result: SequenceResult, asked: int) -> dict[str, Any]:
    """Main results for ``--json``; tensions and displacements are those after the last step that was solved."""
    main: dict[str, Any] = {
        "robot": result.robot.name,
        "elements": sum(result.elements_per_bay),
        "steps_asked": asked,
        "steps_solved": sum(s.converged for s in result.steps),
        **{n: getattr(result, n) for n in ("failed_step", "converged", "wall_time")},
    }
    if not result.steps:
        return main
    last, tendons = result.steps[-1], result.robot.tendon_names
    errors = [s.discretisation_error for s in result.steps if s.discretisation_error is not None]
    return main | {
        "tip": last.tip,
        "bending_angle_deg": math.degrees(last.bending_angle),
        "tip_offset": last.tip_offset,
        "tensions": dict(zip(tendons, last.base_tensions.tolist(), strict=True)),
        "displacements": dict(zip(tendons, last.displacements.tolist(), strict=True)),
        "discretisation_error": max(errors, default=None),
    }


def _report_failure(result: SequenceResult, scenario: Scenario, out: Path) -> int:
    number, total = result.failed_step, len(scenario.steps)
    where = "the run with a finer mesh"
    if number is not None and 1 <= number <= total:
        label = scenario.steps[number - 1].label
        where = f"step {number} of {total}" + (f' ("{label}")' if label else "")
    solved = sum(s.converged for s in result.steps)
    stopped = result.message if result.message.startswith(("interrupted", "stopped")) else ""
    what = f"{stopped} in {where}" if stopped else f"{where} did not converge"
    complain(f"{what}; {count(solved, 'step')} solved before it {'is' if solved == 1 else 'are'} in {out}")
    if result.message and not stopped:
        complain(result.message)
    return Exit.INTERRUPTED if stopped == "interrupted" else Exit.FAILED


# ------------------------------------------------------------------------- tables, in mm and degrees


def print_result(result: SequenceResult, out: Path, written: Sequence[Path]) -> None:
    """Print the tables of a result and the names of the files."""
    if result.steps:
        print(step_table(result), end="\n\n")
        if result.sensitivities:
            print(derivative_table(result), end="\n\n")
    print(f"{count(len(result.steps), 'step')} in {result.wall_time:.2f} s. Written to {out}:")
    print("    " + ", ".join(p.name for p in written))


def step_table(result: SequenceResult) -> str:
    """One row per load step, with tensions and displacements of the tendons, tip, angle and substeps."""
    frame, names = result.to_frame().set_index("step"), result.robot.tendon_names
    labels = [s.label if len(s.label) <= LONGEST_LABEL else f"{s.label[:21]}..." for s in result.steps]
    width = max(map(len, ["label", *labels]))
    columns: dict[str, Any] = {"label".ljust(width): [text.ljust(width) for text in labels]}
    columns |= {f"{n} [N]": frame[f"tension_{n}"].map("{:.4g}".format) for n in names}
    columns |= {f"{n} [mm]": _fixed(1e3 * frame[f"displacement_{n}"], 3) for n in names}
    tip = {"tip x": "x", "y": "y", "z [mm]": "z"}
    columns |= {title: _fixed(1e3 * frame[f"tip_{axis}"], 2) for title, axis in tip.items()}
    columns["bending [deg]"] = _fixed(frame["bending_angle_deg"], 3)
    columns["substeps"] = [f"{s.substeps}" + " (failed)" * (not s.converged) for s in result.steps]
    return _text(pd.DataFrame(columns, frame.index).rename_axis(index=None, columns="step"))


def derivative_table(result: SequenceResult) -> str:
    """Derivatives of the tip after the last step."""
    rows = {n: [*p.positions[-1, -1], *p.rotations[-1, -1]] for n, p in result.sensitivities.items()}
    head = ["tip x", "y", "z [m]", "rotation x", "y", "z [rad]"]
    return "last step, derivative by\n" + _text(pd.DataFrame(rows, head).T)


def _fixed(values: pd.Series, digits: int) -> pd.Series:
    """Numbers with so many digits, without a negative zero."""
    return (values.round(9) + np.float64(0.0)).map(f"{{:.{digits}f}}".format)


def _text(table: pd.DataFrame) -> str:
    return table.to_string(float_format="{:.4g}".format, line_width=WIDTH)

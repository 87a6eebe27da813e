"""The command ``tdcr-fe follow``: tensions or displacements that take the tip along a path."""

from __future__ import annotations

import argparse
import importlib
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

from tdcr_fe.commands.common import Clock, Exit, complain, print_understood, progress_bar, say, typed
from tdcr_fe.io.files import InputError, Problem, check_output_folder, read_all, refusal
from tdcr_fe.io.result_files import TARGETS, write_follow
from tdcr_fe.io.tables import read_path
from tdcr_fe.io.toml import digest, read_model_file, read_robot
from tdcr_fe.model.messages import count
from tdcr_fe.model.plausibility import Implausible
from tdcr_fe.model.results import Interrupted
from tdcr_fe.model.robot import Robot
from tdcr_fe.model.targets import FollowResult, ReachedTarget, ReachStatus, TensionLimits
from tdcr_fe.solve.inverse_statics.inverse import follow_path


def follow(args: argparse.Namespace) -> int:
    """Find the loading sequence, and write it with what it reaches."""
    robot = read_robot(args.robot)
    targets, (model, settings), limits = read_all(
        lambda: read_path(args.path),
        lambda: read_model_file(args.model, robot),
        lambda: _limits(args, robot),
    )
    out = check_output_folder(args.out)
    if not args.no_pictures:
        importlib.import_module("tdcr_fe.report.plots")  # slow; an interruption after solving must not hit it
    choices: dict[str, Any] = {
        "drive_by": "displacement" if args.displacements else "tension",
        "effort": args.effort,
        "tolerance": args.tolerance,
    }
    print_understood(args, robot, model, ())
    clock = Clock(len(targets), "target", args.minutes)
    with progress_bar(args, len(targets) + 1, unit="target") as bar, clock.running():

        def progress(target: ReachedTarget) -> None:
            if target.result.step == 1:
                bar.reset()  # refining the mesh begins again with the first target
            bar.set_postfix_str(target.target.label, refresh=False)
            bar.update(1)
            clock.solved = target.result.step

        try:
            result = follow_path(robot, model, targets, limits, settings, progress, **choices)
        except Interrupted as stop:
            result = replace(stop.result, simulation=replace(stop.result.simulation, message=clock.reason))
        except Implausible as error:
            files = {"targets": args.path, "largest": "--largest", "model": args.model or "model"}
            raise InputError(
                Problem(files.get(re.split(r"\W", c.key)[0], args.robot), *c) for c in error.contradictions
            ) from error
        except ValueError as error:  # a contradiction between bounds, model and robot
            raise refusal(args.robot, str(error)) from error
    digests = {Path(n).name: digest(n) for n in (args.robot, args.path, args.model) if n}
    options = {**vars(limits), **choices, "tolerance": result.tolerance}
    written = write_follow(result, out, settings, digests, len(targets), options, not args.no_pictures)
    say(args, f"{result!r}\nWritten to {out}: " + ", ".join(str(p.relative_to(out)) for p in written))
    if result.steps:
        say(args, f"To solve it again: {typed('run', out / 'scenario' / 'scenario.toml', '-o', 'OUT')}")
    for status in (ReachStatus.OUT_OF_REACH, ReachStatus.NOT_CONVERGED):
        if numbers := result.numbers(status):
            most = 1e3 * max(result.targets[n - 1].error for n in numbers)
            which = f"{count(len(numbers), 'target')} ({', '.join(map(str, numbers))})"
            complain(f"{status.value}: {which}, at most {most:.3g} mm away; see {out / TARGETS}")
    return _status(result, len(targets))


def _status(result: FollowResult, asked: int) -> int:
    """Exit status; what went wrong is printed."""
    if result.simulation.converged:
        return Exit.FAILED if result.not_converged else Exit.DONE
    done, message = len(result.targets), result.simulation.message
    complain(f"{message}; {done} of {count(asked, 'target')} came before and can be read in {TARGETS}")
    return Exit.INTERRUPTED if message == "interrupted" else Exit.FAILED


def _limits(args: argparse.Namespace, robot: Robot) -> TensionLimits:
    """Bounds of the tensions.

    Raises
    ------
    InputError
        They are no numbers, contradict each other, or name no tendon.
    """
    try:
        limits = TensionLimits(_tensions(args.largest), _tensions(args.pretension))
        limits.bounds(robot.tendon_names)
        return limits
    except ValueError as error:
        raise refusal("--largest, --pretension", str(error).removeprefix("TensionLimits.")) from error


def _tensions(texts: list[str]) -> float | dict[str, float]:
    """One number, or numbers by tendon."""
    try:
        if len(texts) == 1 and "=" not in texts[0]:
            return float(texts[0])
        pairs = [text.rpartition("=") for text in texts]
        tensions = {name: float(value) for name, _, value in pairs}
    except ValueError:
        tensions = {}
    if len(tensions) != len(texts) or "" in tensions:
        raise ValueError(f"{' '.join(texts)!r}: must be one number, or NAME=NUMBER for each tendon [N]")
    return tensions

"""The command ``tdcr-fe identify``: finds the effects that a model of measured data is missing."""

from __future__ import annotations

import argparse
import math
import os
from typing import TYPE_CHECKING, Any

from tdcr_fe.commands import common
from tdcr_fe.commands.common import FAILURE, INTERRUPTED, SUCCESS, complain

if TYPE_CHECKING:
    from tdcr_fe.identify.result import IdentificationResult
    from tdcr_fe.identify.settings import IdentifySettings
    from tdcr_fe.io.measured import MeasuredData

#: Keys of result.json that `--json` prints.
FIGURES = ("verdict", "observations", "held_out_steps", "before", "effects", "after", "law", "ceiling")


def add_identify_parser(commands: Any) -> None:
    """Add ``tdcr-fe identify``."""
    parser = commands.add_parser(
        "identify",
        help="find from measured data which effects a model is missing",
        description="Compare a declared robot with measured data, find which effects its model is missing, add "
        "them, and report the error before and after.",
        epilog="Exit status: 0 done, whatever the verdict; 1 the declared model did not converge; "
        "2 the input is wrong; 130 interrupted (143 by SIGTERM), what was found is written.",
    )
    option = parser.add_argument
    option(
        "folder",
        nargs="+",
        help="contains robot.toml, loading.csv, observations.csv and, optionally, model.toml; several folders of one "
        "robot share the effects",
    )
    option("-o", "--out", metavar="OUT", required=True, help="directory for result.json and report.html")
    option(
        "--processes",
        type=common.at_least_one,
        default=min(2, cores()),
        metavar="N",
        help="worker processes, at most as many as there are cores [%(default)s]",
    )
    option(
        "--hold-out",
        action="append",
        default=[],
        metavar="PATTERN",
        help="hold out the branches of loading.csv that match a shell pattern, such as 'pair*'; may be repeated "
        "[about a third of the branches, chosen automatically]",
    )
    option(
        "--minutes",
        type=_minutes,
        default=15.0,
        help="time limit of the whole identification; the report says what was left out [%(default)s]",
    )
    option(
        "--strict",
        action="store_true",
        help="refuse bad rows (exit status 2) instead of leaving them out by name",
    )
    common.add_options(parser, "--effects", "--json")
    parser.set_defaults(handler=run)


def cores() -> int:
    """Number of cores of this machine that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _processes(args: argparse.Namespace) -> int:
    """Worker processes, at most one per core: more would only take memory and wait for each other."""
    asked, most = args.processes, cores()
    if asked <= most:
        return int(asked)
    text = (
        f"--processes {asked}: this machine has {common.count(most, 'core')}, so one process per core is used"
    )
    args.noted.warnings.append(text)
    complain(text)
    return most


def _minutes(text: str) -> float:
    """A positive number, as a type for `argparse`.

    Raises
    ------
    argparse.ArgumentTypeError
    """
    try:
        number = float(text)
    except ValueError:
        number = 0.0
    if not 0.0 < number < math.inf:
        raise argparse.ArgumentTypeError(f"{text!r}; must be a number of minutes above zero")
    return number


def run(args: argparse.Namespace) -> int:
    """Identify what the model of a folder of measured data is missing."""
    from tdcr_fe.identify.identification import NotSolved
    from tdcr_fe.identify.report import write_result
    from tdcr_fe.identify.settings import GRACE_OF_TABLES, IdentifySettings, clock
    from tdcr_fe.identify.statistics import summary
    from tdcr_fe.io.atomic import check_output_folder
    from tdcr_fe.io.measured import join_measured, read_measured
    from tdcr_fe.io.user_effects import read_own_effects

    begun = clock()
    data = join_measured([read_measured(folder, strict=args.strict) for folder in args.folder])
    out = check_output_folder(args.out)
    settings = IdentifySettings(
        processes=_processes(args),
        time_limit=60.0 * args.minutes,
        hold_out_branches=tuple(args.hold_out),
        own_effects=read_own_effects(args.effects),
    )
    _warn(args, data)
    try:
        result = _identified(args, data, settings)
    except NotSolved as error:
        args.noted.message = str(error)
        complain(str(error))
        return FAILURE
    result, names, interrupted = write_result(
        result, out, begun + (1.0 + GRACE_OF_TABLES) * settings.time_limit
    )
    document = result.to_json()
    args.noted.figures = {name: document[name] for name in FIGURES if name in document}
    args.noted.files += [out / name for name in names]
    if not args.quiet:
        print(summary(result))
        print(f"\nWritten to {out}: {', '.join(names)}")
    if interrupted:
        complain("interrupted; what was found until then is written")
        return INTERRUPTED
    return SUCCESS


def _warn(args: argparse.Namespace, data: MeasuredData) -> None:
    """Report rows that were left out, and declared values that are not plausible."""
    from tdcr_fe.model.plausibility import plausibility_warnings

    left_out = [f"left out: {row}" for row in data.left_out]
    odd = plausibility_warnings(data.robot, data.model, data.steps)
    args.noted.warnings += [*left_out, *odd]
    for text in (*left_out, *(f"warning: {w}" for w in odd)):
        complain(text)


def _identified(
    args: argparse.Namespace, data: MeasuredData, settings: IdentifySettings
) -> IdentificationResult:
    """The identification, with a progress bar.

    Raises
    ------
    NotSolved
    """
    from tdcr_fe.identify.identification import identify

    with common.progress_bar(args, 100, bar_format="{l_bar}{bar}| {elapsed} {postfix}") as bar:

        def progress(text: str, share: float) -> None:
            bar.set_postfix_str(text, refresh=False)
            bar.update(max(0, int(100 * share) - bar.n))
            bar.refresh()

        return identify(data, settings, progress)

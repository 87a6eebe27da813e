"""The command ``tdcr-fe identify``: finds the effects that the model of measured data lacks, and writes the report."""

from __future__ import annotations

import argparse
import math
import os
import sys
from dataclasses import replace
from typing import Any

from tdcr_fe.commands.machine import add_json_option, note
from tdcr_fe.commands.status import FAILURE, INTERRUPTED, SUCCESS, at_least_one, complain


def add_identify_parser(commands: Any) -> None:
    """Add ``tdcr-fe identify``."""
    parser = commands.add_parser(
        "identify",
        help="trace the residual of measured data to what the model lacks",
        description="Find the residual of a declared robot against measured data, trace it to effects that the "
        "model lacks, add them, and report the error before and after.",
        epilog="Exit status: 0 done, whatever the verdict; 1 the declared model did not converge; "
        "2 the input is wrong; 130 interrupted (143 by SIGTERM), what was found is written.",
    )
    parser.add_argument(
        "folder",
        nargs="+",
        help="contains robot.toml, loading.csv, observations.csv and, optionally, model.toml; several folders of one "
        "robot share the effects",
    )
    parser.add_argument(
        "-o", "--out", metavar="OUT", required=True, help="directory for result.json and report.html"
    )
    parser.add_argument("-q", "--quiet", action="store_true", help="print nothing but what went wrong")
    add_json_option(parser)
    parser.add_argument(
        "--processes",
        type=at_least_one,
        default=min(2, os.cpu_count() or 1),
        help="worker processes [%(default)s]",
    )
    parser.add_argument(
        "--hold-out",
        action="append",
        default=[],
        metavar="PATTERN",
        help="hold out the branches of loading.csv that match a shell pattern, such as 'pair*'; may be repeated "
        "[about a third of the branches, chosen automatically]",
    )
    parser.add_argument(
        "--effects",
        action="append",
        default=[],
        metavar="FILE.py",
        help="add an effect of your own, a class in a Python file, to the candidates; may be repeated",
    )
    parser.add_argument(
        "--minutes",
        type=_minutes,
        default=15.0,
        help="time limit of the whole identification: the search ends in time for the final fit to all load steps, and "
        "the report says what was left out [%(default)s]",
    )
    parser.add_argument(
        "--strict",
        action="store_true",
        help="refuse bad rows (exit status 2) instead of leaving them out by name",
    )
    parser.set_defaults(handler=run)


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
    """Identify what the model of a folder of measured data lacks."""
    from tqdm import tqdm

    from tdcr_fe.identify.corrected import corrected_files
    from tdcr_fe.identify.identification import NotSolved, identify
    from tdcr_fe.identify.replay import corrected_motion
    from tdcr_fe.identify.report import write_report
    from tdcr_fe.identify.sentences import summary
    from tdcr_fe.identify.settings import IdentifySettings
    from tdcr_fe.identify.time_limit import GRACE_OF_TABLES, TABLES, OutOfTime, clock
    from tdcr_fe.io.atomic import check_output_folder, write_json, write_text
    from tdcr_fe.io.measured import join_measured, read_measured
    from tdcr_fe.io.own_effects import read_own_effects
    from tdcr_fe.model.plausibility import plausibility_warnings

    begun = clock()
    data = join_measured([read_measured(folder, strict=args.strict) for folder in args.folder])
    out = check_output_folder(args.out)
    settings = IdentifySettings(
        processes=args.processes,
        time_limit=60.0 * args.minutes,
        hold_out_branches=tuple(args.hold_out),
        own_effects=read_own_effects(args.effects),
    )
    odd = plausibility_warnings(data.robot, data.model, data.steps)
    note(args, warnings=[*(f"left out: {row}" for row in data.left_out), *odd])
    for row in data.left_out:
        complain(f"left out: {row}")
    for warning in odd:
        complain(f"warning: {warning}")
    with tqdm(total=100, leave=False, file=sys.stderr, disable=True if args.quiet else None,
              bar_format="{l_bar}{bar}| {elapsed} {postfix}") as bar:  # fmt: skip

        def progress(text: str, share: float) -> None:
            bar.set_postfix_str(text, refresh=False)
            bar.update(max(0, int(100 * share) - bar.n))
            bar.refresh()

        try:
            result = identify(data, settings, progress)
        except NotSolved as error:
            note(args, message=str(error))
            complain(str(error))
            return FAILURE
    out.mkdir(parents=True, exist_ok=True)
    write_json(result.to_json(), out / "result.json")
    for name, text in corrected_files(result).items():
        write_text(text, out / name)
    next_loading = result.next_loading()
    if next_loading is not None:
        (out / "next").mkdir(exist_ok=True)
        write_text(next_loading, out / "next" / "loading.csv")
    motion, interrupted = None, result.interrupted
    try:
        several = bool(data.parts)  # the panel shows one loading sequence
        deadline = begun + (1.0 + GRACE_OF_TABLES) * settings.time_limit
        motion = None if interrupted or several else corrected_motion(result, out, deadline)
    except KeyboardInterrupt:  # the report is written without the 3D panel
        interrupted = True
    except OutOfTime:
        result = replace(result, not_tried=(*result.not_tried, TABLES))
        write_json(result.to_json(), out / "result.json")
    write_report(result, out / "report.html", motion)
    document = result.to_json()
    names = ["result.json", "report.html", *corrected_files(result)]
    names += [] if next_loading is None else ["next/loading.csv"]
    names += [] if motion is None else ["corrected"]
    figures = ("verdict", "observations", "held_out_steps", "before", "effects", "after", "law", "ceiling")
    note(
        args, files=[out / name for name in names], figures={k: document[k] for k in figures if k in document}
    )
    if not args.quiet:
        print(summary(result))
        more = "" if next_loading is None else ", next/loading.csv"
        more += "" if motion is None else ", corrected/"
        print(f"\nWritten to {out}: result.json, report.html, robot.toml, effects.toml{more}")
    if interrupted:
        complain("interrupted; what was found until then is written")
        return INTERRUPTED
    return SUCCESS

"""The command ``tdcr-fe identify``: finds the effects that a model of measured data is missing."""

from __future__ import annotations

import argparse
import os
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from time import monotonic
from typing import Any, TypeVar

from tdcr_fe.commands.common import Exit, complain, complain_of_left_out, print_understood, progress_bar, say
from tdcr_fe.identify.identification import NotSolved, identify
from tdcr_fe.identify.report import write_result
from tdcr_fe.identify.robots import identify_robots
from tdcr_fe.identify.search_state import Progress
from tdcr_fe.identify.sentences import summary
from tdcr_fe.identify.settings import GRACE, IdentifySettings, clock
from tdcr_fe.io.files import check_output_folder, read_all, refusal, write_json
from tdcr_fe.io.measured import MeasuredData, join_measured, read_measured
from tdcr_fe.io.user_effects import read_own_effects
from tdcr_fe.model.messages import warnings_to

#: Keys of result.json that `--json` prints.
FIGURES = ("verdict", "observations", "held_out_steps", "before", "effects", "after", "law", "ceiling")
#: In a log file the state is printed this often [s].
LOG_INTERVAL = 30.0

Found = TypeVar("Found")


def run(args: argparse.Namespace) -> int:
    """Identify what the model of measured data is missing: of one robot, or of several of one design."""
    readers = [partial(read_measured, folder) for folder in args.folder]
    *sets, out, effects = read_all(
        *readers, lambda: check_output_folder(args.out), lambda: read_own_effects(args.effects)
    )
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    settings = IdentifySettings(
        processes=min(args.processes, cores),  # more would wait for each other
        time_limit=60.0 * args.minutes,
        hold_out_branches=tuple(args.hold_out),
        own_effects=effects,
    )
    complain_of_left_out(args, [row for s in sets for row in s.left_out])
    try:
        text, figures, names, interrupted = (_robots if args.robots else _robot)(args, sets, settings)
    except NotSolved as error:
        args.noted.message = str(error)
        complain(str(error))
        return Exit.FAILED
    args.noted.figures = figures
    args.noted.files += [out / name for name in names]
    say(args, f"{text}\n\nWritten to {out}: {', '.join(names)}")
    if interrupted:
        complain("interrupted; what was found until then is written")
        return Exit.INTERRUPTED
    return Exit.DONE


#: Summary, main results, names of the files, and whether the user pressed Ctrl-C.
Outcome = tuple[str, dict[str, Any], list[str], bool]


def _robot(args: argparse.Namespace, sets: Sequence[MeasuredData], settings: IdentifySettings) -> Outcome:
    """Identify one robot and write the result."""
    data, deadline = join_measured(sets), clock() + (1.0 + GRACE) * settings.time_limit
    print_understood(args, data.robot, data.model, data.steps)
    result = _with_progress(args, lambda progress: identify(data, settings, progress))
    with warnings_to():  # the same were issued for the measured data
        result, names, interrupted = write_result(result, Path(args.out), deadline)
    document = result.to_json()
    figures = {name: document[name] for name in FIGURES if name in document}
    return summary(result), figures, names, interrupted


def _robots(args: argparse.Namespace, sets: Sequence[MeasuredData], settings: IdentifySettings) -> Outcome:
    """Identify several robots of one design and write the results."""
    names, out = [s.name for s in sets], Path(args.out)
    if len(set(names)) < max(2, len(names)):
        raise refusal("--robots", "takes two or more folders of different names")
    found = _with_progress(args, lambda progress: identify_robots(sets, settings, progress))
    with warnings_to():
        for name, result in found.results.items():
            write_result(result, out / name)
    write_json(found.to_json(), out / "robots.json")
    return str(found), found.to_json(), ["robots.json", *found.results], found.interrupted


def _with_progress(args: argparse.Namespace, work: Callable[[Progress], Found]) -> Found:
    """The result of long work, with a progress bar; in a log file, with a line now and then.

    Raises
    ------
    NotSolved
    """
    begun = said = monotonic()
    with progress_bar(args, 100, bar_format="{l_bar}{bar}| {elapsed} {postfix}") as bar:

        def progress(text: str, share: float) -> None:
            nonlocal said
            bar.set_postfix_str(text, refresh=False)
            bar.update(max(0, int(100 * share) - bar.n))
            bar.refresh()
            if bar.disable and not args.quiet and monotonic() > said + LOG_INTERVAL:
                said = monotonic()
                complain(f"{100 * share:.0f} % after {said - begun:.0f} s: {text}")

        return work(progress)

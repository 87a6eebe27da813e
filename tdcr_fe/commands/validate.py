"""The command ``tdcr-fe validate``: finite elements against the independent reference, as one report."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tdcr_fe.commands.machine import add_json_option, note
from tdcr_fe.commands.status import FAILURE, INTERRUPTED, SUCCESS, at_least_one, complain

if TYPE_CHECKING:
    from tdcr_fe.validation.crosscheck.cases import Case
    from tdcr_fe.validation.crosscheck.studies import Study


def add_validate_parser(commands: Any) -> None:
    """Add ``tdcr-fe validate``."""
    parser = commands.add_parser(
        "validate",
        help="finite elements against the independent shooting reference; write the report",
        description="Solve the same cases with finite elements and with the independent Cosserat shooting "
        "reference, and write OUT/report.html and OUT/report.json. Finished cases are kept in OUT/cases, so a "
        "run that was interrupted continues where it stopped.",
        epilog="Exit status: 0 all cases and requirements pass, 1 one fails, 2 the input is wrong, 130 interrupted.",
    )
    parser.add_argument("-o", "--out", metavar="OUT", required=True, help="directory for the report")
    parser.add_argument("--full", action="store_true", help="every case; without it a quick set")
    parser.add_argument(
        "--processes", type=at_least_one, metavar="N", help="processes to use [number of cores]"
    )
    parser.add_argument("-q", "--quiet", action="store_true", help="print nothing but what went wrong")
    add_json_option(parser)
    parser.set_defaults(handler=validate)


def validate(args: argparse.Namespace) -> int:
    """Solve the cases, write the report, print the result of every requirement."""
    from tdcr_fe.io.atomic import check_output_folder

    out = check_output_folder(args.out)

    import os
    import time

    from tdcr_fe.validation.crosscheck import report
    from tdcr_fe.validation.crosscheck.cases import all_cases
    from tdcr_fe.validation.crosscheck.studies import all_studies

    begun = time.perf_counter()
    cases = [case for case in all_cases() if args.full or case.quick]
    studies = [study for study in all_studies() if args.full or study.quick]
    processes = args.processes or os.cpu_count() or 1
    folder = out / "cases"
    try:
        records, arbitrations, recalled = _records(cases, studies, folder, processes, args.quiet)
    except KeyboardInterrupt:
        note(args, message="interrupted")
        complain(f"interrupted; finished cases are in {folder}, the same command continues from there")
        return INTERRUPTED
    outcome = report.judge(
        [records[case.id] for case in cases],
        [records[study.id] for study in [*studies, *arbitrations]],
        full=args.full,
        wall_time=time.perf_counter() - begun,
        processes=processes,
        recalled=recalled,
    )
    report.write(outcome, out)
    note(
        args,
        files=[out / "report.html", out / "report.json"],
        figures={k: outcome[k] for k in ("passed", "set", "counts", "requirements", "failures", "time")},
        message="; ".join(outcome["failures"]),
    )
    if not args.quiet:
        print("\n".join(report.headline(outcome)))
        print(f"Written to {out}: report.html, report.json")
    for failure in outcome["failures"]:
        complain(failure)
    return SUCCESS if outcome["passed"] else FAILURE


def _records(
    cases: list[Case], studies: list[Study], folder: Path, processes: int, quiet: bool
) -> tuple[dict[str, dict[str, Any]], list[Study], int]:
    """Records of cases, studies and arbitrations by name, the arbitrations, and how many records were there already."""
    from tqdm import tqdm

    from tdcr_fe.validation.crosscheck import campaign, report
    from tdcr_fe.validation.crosscheck.requirements import ARBITRATIONS

    recalled = 0
    total = len(cases) + len(studies) + ARBITRATIONS
    with tqdm(total=total, unit="case", file=sys.stderr, disable=True if quiet else None) as bar:

        def progress(record: dict[str, Any], known: bool) -> None:
            nonlocal recalled
            recalled += known
            bar.update(1)

        records = campaign.run([*studies, *cases], folder, processes, progress)
        arbitrations = report.arbitrations([records[case.id] for case in cases])
        records |= campaign.run(arbitrations, folder, processes, progress)
    return records, arbitrations, recalled

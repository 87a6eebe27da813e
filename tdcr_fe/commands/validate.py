"""The command ``tdcr-fe validate``: compares as in ``validation/crosscheck/compare.py``; the cases are beside it."""

from __future__ import annotations

import argparse
import os
import time
from typing import Any

from tdcr_fe.commands.common import Exit, complain, progress_bar, say
from tdcr_fe.io.files import check_output_folder
from tdcr_fe.validation.crosscheck import report
from tdcr_fe.validation.crosscheck.cases import all_cases
from tdcr_fe.validation.crosscheck.run import run
from tdcr_fe.validation.crosscheck.studies import all_studies


def validate(args: argparse.Namespace) -> int:
    """Solve the cases, write the report, print the result of every requirement."""
    out = check_output_folder(args.out)
    begun, recalled = time.perf_counter(), 0
    cases = [case for case in all_cases() if args.full or case.quick]
    studies = [study for study in all_studies() if args.full or study.quick]
    processes, file = args.processes or os.cpu_count() or 1, out / "cases.jsonl"
    with progress_bar(args, len(cases) + len(studies) + 1, unit="case") as bar:

        def progress(record: dict[str, Any], known: bool) -> None:
            nonlocal recalled
            recalled += known
            bar.update(1)

        try:
            records = run([*studies, *cases], file, processes, progress)
        except KeyboardInterrupt:
            complain(f"interrupted; finished cases are in {file}, the same command continues from there")
            return Exit.INTERRUPTED
        bar.set_postfix_str("drawing the report")
        solved, studied = ([records[x.id] for x in of_kind] for of_kind in (cases, studies))
        times = {"wall": time.perf_counter() - begun, "processes": processes, "recalled": recalled}
        outcome = report.judge(solved, studied, args.full, times)
        report.write(outcome, out)
    say(args, "\n".join([*report.headline(outcome), f"Written to {out}: report.html, report.json"]))
    for failure in outcome["failures"]:
        complain(failure)
    return Exit.DONE if outcome["passed"] else Exit.FAILED

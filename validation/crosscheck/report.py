"""Evaluate the records of cases and studies against the requirements, and write report.html and report.json."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from tdcr_fe.io.atomic import plain, write_json, write_text
from tdcr_fe.validation.crosscheck import campaign
from tdcr_fe.validation.crosscheck.case import (
    TIP_TOLERANCE,
)
from tdcr_fe.validation.crosscheck.page import to_html
from tdcr_fe.validation.crosscheck.requirements import (
    ARBITRATIONS,
    evaluate,
    largest,
    median_deviation,
    worst_case,
)
from tdcr_fe.validation.crosscheck.studies import Study

Record = dict[str, Any]

#: Kinds of studies, see `tdcr_fe.validation.crosscheck.studies`.
STUDY_KINDS = ("mesh", "disks", "buckling", "literature", "closed", "time", "arbitration")
#: Fields left out of report.json, because only the pictures need them.
_PICTURES_ONLY = (
    "s", "shape_finite_element", "shape_reference", "mobilisation_finite_element", "mobilisation_reference",
    "friction_share_finite_element", "friction_share_reference",
)  # fmt: skip


def arbitrations(cases: Sequence[Record]) -> list[Study]:
    """Studies of the cases that differ most."""
    solved = [c for c in cases if c.get("deviation_percent") is not None and c.get("converged")]
    worst = sorted(solved, key=lambda c: -c["deviation_percent"])[:ARBITRATIONS]
    return [Study(f"arbitration_{c['id']}", "arbitration", (c["id"], c["worst_step"]), True) for c in worst]


def _failed_case(record: Record) -> Record:
    """A record of a case that ended in an error, with all fields of the report."""
    blank: Record = dict.fromkeys(
        ("routing", "tendon_path", "friction", "load", "group", "tip_finite_element", "tip_reference")
    )
    return {**blank, "deviation_percent": None, "tolerance_percent": TIP_TOLERANCE, "converged": False,
            "passed": False, "reasons": [record["error"]], "steps": [], **record}  # fmt: skip


def judge(
    cases: Sequence[Record],
    studies: Sequence[Record],
    *,
    full: bool,
    wall_time: float,
    processes: int,
    recalled: int,
) -> Record:
    """The contents of the report: counts, worst cases, requirements and verdict.

    Parameters
    ----------
    cases, studies
        Records.
    full
        Whether it is the full set.
    wall_time
        Of the whole run [s].
    processes
        Number of worker processes.
    recalled
        How many records were finished before.
    """
    cases = [_failed_case(c) if c.get("error") else c for c in cases]
    solved = [c for c in cases if c["converged"]]
    kinds = _by_kind(studies)
    requirements = evaluate(solved, kinds)
    failures = [
        *(f"study {s['id']}: {s['error']}" for s in studies if s.get("error")),
        *(f"{c['id']}: {'; '.join(c['reasons'])}" for c in cases if not c["passed"]),
        *(
            f"{r['what']}: {r['found']} {r['unit']}, required {r['required']}"
            for r in requirements
            if not r["passed"]
        ),
    ]
    return {
        "passed": not failures,
        "failures": failures,
        "set": "full" if full else "quick",
        "requirements": requirements,
        "counts": _counts(cases, solved),
        "worst": _worst(solved),
        "time": {
            "wall": wall_time,
            "processes": processes,
            "recalled": recalled,
            "finite_element": sum(c["time_finite_element"] for c in solved),
            "reference": sum(c["time_reference"] for c in solved),
        },
        "versions": campaign.versions(),
        "date": datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC"),
        "cases": cases,
        "studies": kinds,
    }


def _by_kind(studies: Sequence[Record]) -> dict[str, list[Record]]:
    """Records of the studies that were completed, by kind."""
    kinds: dict[str, list[Record]] = {kind: [] for kind in STUDY_KINDS}
    for study in studies:
        if not study.get("error"):
            kinds[study["kind"]].append(study)
    return kinds


def _counts(cases: Sequence[Record], solved: Sequence[Record]) -> Record:
    return {
        "cases": len(cases),
        "failing": sum(not c["passed"] for c in cases),
        "steps": sum(len(c["steps"]) for c in solved),
        "holes": sum(c["holes"] for c in solved),
        "holes_differing": sum(c["holes_differing"] for c in solved),
        "holes_differing_off_threshold": sum(c["holes_differing_off_threshold"] for c in solved),
        "histories": sum(c["group"] == "history" for c in cases),
        "other_paths": sum(not c["same_path"] and c["friction"] != "none" for c in solved),
    }


def _worst(solved: Sequence[Record]) -> Record:
    """Largest deviations over all cases; None where no case has one."""
    shape, tip, tension = (
        worst_case(solved, key) for key in ("shape_percent", "deviation_percent", "tension_percent")
    )
    return {
        "tip_percent": None if tip is None else tip["deviation_percent"],
        "tip_case": None if tip is None else tip["id"],
        "median_tip_percent": median_deviation(solved),
        "shape_percent": None if shape is None else shape["shape_percent"],
        "orientation_deg": largest(solved, "orientation_deg"),
        "tension_percent": None if tension is None else tension["tension_percent"],
        "displacement_percent": largest(solved, "displacement_percent"),
        "largest_bending_deg": largest(solved, "largest_bending_deg"),
    }


def headline(outcome: Record) -> list[str]:
    """The outcome in a few lines, for a terminal."""
    counts, time = outcome["counts"], outcome["time"]
    lines = [
        f"{counts['cases'] - counts['failing']} of {counts['cases']} cases pass ({outcome['set']} set, "
        f"{counts['steps']} load steps, {time['wall']:.0f} s)"
    ]
    for r in outcome["requirements"]:
        mark = "pass" if r["passed"] else "FAIL"
        lines.append(f"  {mark}  {r['what']}: {r['found']} {r['unit']} ({r['required']})")
    return lines


# ------------------------------------------------------------------------------------------------- writing


def write(outcome: Record, out: Path) -> None:
    """Write report.json and report.html into a directory."""
    write_json(to_json(outcome), out / "report.json", indent=1)
    write_text(to_html(outcome), out / "report.html")


def to_json(outcome: Record) -> Record:
    """The outcome for scripts: without the fields that only pictures need."""

    def slim(case: Record) -> Record:
        steps = [{k: v for k, v in s.items() if k not in _PICTURES_ONLY} for s in case["steps"]]
        return {**case, "steps": steps}

    result: Record = plain({**outcome, "cases": [slim(c) for c in outcome["cases"]]})
    return result

"""Evaluate the records of cases and studies against the requirements, and write report.html and report.json."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from tdcr_fe.io.atomic import plain, write_json, write_text
from tdcr_fe.report.environment import short
from tdcr_fe.validation.crosscheck import campaign
from tdcr_fe.validation.crosscheck.cases import (
    LEAST_ORDER,
    MEDIAN_TOLERANCE,
    TENSION_TOLERANCE,
    TIP_TOLERANCE,
)
from tdcr_fe.validation.crosscheck.page import INTEGRATION_TOLERANCE, to_html
from tdcr_fe.validation.crosscheck.studies import Study

Record = dict[str, Any]

#: Number of cases, those with the largest deviations, that are arbitrated by an independent integration.
ARBITRATIONS = 5
#: Deviations that the reference may have: from closed forms, from the results of other codes (they agree with
#: each other to 1e-8 and are quoted to 1e-9 m) [% of the length].
CLOSED_TOLERANCE, LITERATURE_TOLERANCE = 1e-6, 2e-6
#: How far a tension may be outside its Capstan bounds, relative to itself [1].
BOUND_TOLERANCE = 1e-8
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
    kinds: dict[str, list[Record]] = {
        k: [] for k in ("mesh", "disks", "buckling", "literature", "closed", "time", "arbitration")
    }
    broken = [f"study {s['id']}: {s['error']}" for s in studies if s.get("error")]
    for study in studies:
        if not study.get("error"):
            kinds[study["kind"]].append(study)

    def worst(key: str) -> Record | None:
        return max((c for c in solved if c.get(key) is not None), key=lambda c: c[key], default=None)

    def most(rows: Sequence[Record], key: str) -> float:
        return max((float(r[key]) for r in rows if r.get(key) is not None), default=float("nan"))

    failing = [c for c in cases if not c["passed"]]
    median = float(np.median([c["deviation_percent"] for c in solved])) if solved else float("nan")
    shape, tip, tension = worst("shape_percent"), worst("deviation_percent"), worst("tension_percent")
    holes = sum(c["holes"] for c in solved)
    differing = sum(c["holes_differing"] for c in solved)
    off = sum(c["holes_differing_off_threshold"] for c in solved)
    orders = [s["order"] for s in kinds["mesh"] if s["order"] is not None]
    outside = max((v for c in solved for k, v in c["bounds"].items() if v is not None), default=float("nan"))
    integrated = most(kinds["arbitration"], "integration_shape_percent")
    requirements = [
        _need("Tip, worst case", tip, "deviation_percent", TIP_TOLERANCE, "% of the length"),
        _row("Tip, median of all cases", median, MEDIAN_TOLERANCE, "% of the length"),
        _need("Tension at a hole, worst", tension, "tension_percent", TENSION_TOLERANCE,
              "% of the tendon's highest"),
        _row("Hole states that differ, not at the stick-slip threshold", float(off), 0.5, f"of {holes}",
             show=f"{off}", need="0"),
        _row("Tensions outside the Capstan bounds", outside, BOUND_TOLERANCE, "of the tension"),
        _row("Reference against closed forms", most(kinds["closed"], "reference_percent"), CLOSED_TOLERANCE,
             "% of the length"),
        _row("Reference against two public codes", most(kinds["literature"], "reference_percent"),
             LITERATURE_TOLERANCE, "% of the length"),
        _row(f"Reference against an independent integration, worst {ARBITRATIONS} cases", integrated,
             INTEGRATION_TOLERANCE, "% of the length"),
    ]  # fmt: skip
    least = min(orders, default=float("nan"))
    requirements.insert(
        4,
        {"what": "Order of mesh convergence, smallest", "found": f"{least:.2f}",
         "required": f"at least {LEAST_ORDER:g}",
         "unit": "", "passed": bool(least >= LEAST_ORDER), "where": ""},
    )  # fmt: skip
    failures = broken + [f"{c['id']}: {'; '.join(c['reasons'])}" for c in failing]
    failures += [
        f"{r['what']}: {r['found']} {r['unit']}, required {r['required']}"
        for r in requirements
        if not r["passed"]
    ]
    return {
        "passed": not failures,
        "failures": failures,
        "set": "full" if full else "quick",
        "requirements": requirements,
        "counts": {
            "cases": len(cases),
            "failing": len(failing),
            "steps": sum(len(c["steps"]) for c in solved),
            "holes": holes,
            "holes_differing": differing,
            "holes_differing_off_threshold": off,
            "histories": sum(c["group"] == "history" for c in cases),
            "other_paths": sum(not c["same_path"] and c["friction"] != "none" for c in solved),
        },
        "worst": {
            "tip_percent": None if tip is None else tip["deviation_percent"],
            "tip_case": None if tip is None else tip["id"],
            "median_tip_percent": median,
            "shape_percent": None if shape is None else shape["shape_percent"],
            "orientation_deg": most(solved, "orientation_deg"),
            "tension_percent": None if tension is None else tension["tension_percent"],
            "displacement_percent": most(solved, "displacement_percent"),
            "largest_bending_deg": most(solved, "largest_bending_deg"),
        },
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


def _row(
    what: str, found: float, limit: float, unit: str, show: str = "", need: str = "", where: str = ""
) -> Record:
    return {
        "what": what,
        "found": show or short(found),
        "required": need or f"below {limit:g}",
        "unit": unit,
        "passed": bool(found < limit),
        "where": where,
    }


def _need(what: str, case: Record | None, key: str, limit: float, unit: str) -> Record:
    if case is None:
        return _row(what, float("nan"), limit, unit)
    return _row(what, float(case[key]), limit, unit, where=case["id"])


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

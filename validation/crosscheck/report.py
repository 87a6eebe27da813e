"""Judge the records of cases and studies by the requirements, and write report.html and report.json."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from tdcr_fe.io.atomic import plain, write_json, write_text
from tdcr_fe.report.environment import short
from tdcr_fe.validation.crosscheck.cases import (
    LEAST_ORDER,
    MEDIAN_TOLERANCE,
    TENSION_TOLERANCE,
    TIP_TOLERANCE,
)
from tdcr_fe.validation.crosscheck.page import to_html
from tdcr_fe.validation.crosscheck.run import versions

Record = dict[str, Any]

#: Deviations that the reference may have: from closed forms, from the results of other codes (they agree with
#: each other to 1e-8 and are quoted to 1e-9 m) [% of the length].
CLOSED_TOLERANCE, LITERATURE_TOLERANCE = 1e-6, 2e-6
#: How far a tension may be outside its Capstan bounds, relative to itself [1].
BOUND_TOLERANCE = 1e-8


def largest(rows: Sequence[Record], key: str) -> float:
    """Largest value of a key over the records that have it; NaN where none has."""
    return max((float(r[key]) for r in rows if r.get(key) is not None), default=float("nan"))


def worst_case(cases: Sequence[Record], key: str) -> Record | None:
    """The case with the largest value of a key; None where none has it."""
    return max((c for c in cases if c.get(key) is not None), key=lambda c: c[key], default=None)


def median_deviation(cases: Sequence[Record]) -> float:
    """Of the tips over the cases [% of the length]; NaN where there are none."""
    return float(np.median([c["deviation_percent"] for c in cases])) if cases else float("nan")


def evaluate(solved: Sequence[Record], studies: Mapping[str, Sequence[Record]]) -> list[Record]:
    """All requirements.

    Parameters
    ----------
    solved
        Records of the cases that both solvers solved.
    studies
        Records of the studies, by kind.

    Returns
    -------
    list of dict
        "what", "found", "required", "unit" as texts, "passed", and "where", the case with the largest value.
    """
    return [
        _of_case("Tip, worst case", solved, "deviation_percent", TIP_TOLERANCE, "% of the length"),
        _below("Tip, median of all cases", median_deviation(solved), MEDIAN_TOLERANCE, "% of the length"),
        _of_case(
            "Tension at a hole, worst",
            solved,
            "tension_percent",
            TENSION_TOLERANCE,
            "% of the tendon's highest",
        ),
        _hole_states(solved),
        _mesh_order(studies["mesh"]),
        _below(
            "Tensions outside the Capstan bounds", _outside_bounds(solved), BOUND_TOLERANCE, "of the tension"
        ),
        _below(
            "Reference against closed forms",
            largest(studies["closed"], "reference_percent"),
            CLOSED_TOLERANCE,
            "% of the length",
        ),
        _below(
            "Reference against two public codes",
            largest(studies["literature"], "reference_percent"),
            LITERATURE_TOLERANCE,
            "% of the length",
        ),
    ]


def _requirement(what: str, found: str, required: str, unit: str, passed: bool, where: str = "") -> Record:
    return {
        "what": what,
        "found": found,
        "required": required,
        "unit": unit,
        "passed": passed,
        "where": where,
    }


def _below(what: str, found: float, limit: float, unit: str, where: str = "") -> Record:
    """A number that must be below a limit; one that was not found (NaN) does not pass."""
    return _requirement(what, short(found), f"below {limit:g}", unit, bool(found < limit), where)


def _of_case(what: str, solved: Sequence[Record], key: str, limit: float, unit: str) -> Record:
    """The largest value of a key over the cases, with the case."""
    case = worst_case(solved, key)
    if case is None:
        return _below(what, float("nan"), limit, unit)
    return _below(what, float(case[key]), limit, unit, case["id"])


def _hole_states(solved: Sequence[Record]) -> Record:
    off = sum(c["holes_differing_off_threshold"] for c in solved)
    holes = sum(c["holes"] for c in solved)
    what = "Hole states that differ (excluding those at the stick-slip threshold)"
    return _requirement(what, f"{off}", "0", f"of {holes}", off == 0)


def _mesh_order(studies: Sequence[Record]) -> Record:
    least = min((s["order"] for s in studies if s["order"] is not None), default=float("nan"))
    what = "Order of mesh convergence, smallest"
    return _requirement(what, f"{least:.2f}", f"at least {LEAST_ORDER:g}", "", bool(least >= LEAST_ORDER))


def _outside_bounds(solved: Sequence[Record]) -> float:
    return max((v for c in solved for v in c["bounds"].values() if v is not None), default=float("nan"))


# --------------------------------------------------------------------------------------------------- report

#: Kinds of studies, see `tdcr_fe.validation.crosscheck.studies`.
STUDY_KINDS = ("mesh", "buckling", "literature", "closed")
#: Fields left out of report.json, because only the pictures need them.
_PICTURES_ONLY = ("s", "shape_finite_element", "shape_reference")


def _failed_case(record: Record) -> Record:
    """A record of a case that ended in an error, with all fields of the report."""
    blank: Record = dict.fromkeys(
        ("routing", "tendon_path", "friction", "load", "group", "tip_finite_element", "tip_reference")
    )
    return {**blank, "deviation_percent": None, "tolerance_percent": TIP_TOLERANCE, "converged": False,
            "passed": False, "reasons": [record["error"]], "steps": [], **record}  # fmt: skip


def judge(cases: Sequence[Record], studies: Sequence[Record], full: bool, time: Record) -> Record:
    """The contents of the report: counts, worst cases, requirements and verdict.

    Parameters
    ----------
    cases, studies
        Records.
    full
        Whether it is the full set.
    time
        "wall" time of the whole run [s], number of worker "processes", and how many records were "recalled".
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
            **time,
            "finite_element": sum(c["time_finite_element"] for c in solved),
            "reference": sum(c["time_reference"] for c in solved),
        },
        "versions": versions(),
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

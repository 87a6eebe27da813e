"""Requirements of the cross-validation: what was found, what is required, and whether it passes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from tdcr_fe.report.environment import short
from tdcr_fe.validation.crosscheck.case import (
    LEAST_ORDER,
    MEDIAN_TOLERANCE,
    TENSION_TOLERANCE,
    TIP_TOLERANCE,
)
from tdcr_fe.validation.crosscheck.page import INTEGRATION_TOLERANCE

Record = dict[str, Any]

#: Number of cases, those with the largest deviations, that are arbitrated by an independent integration.
ARBITRATIONS = 5
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
        _below(
            f"Reference against an independent integration, worst {ARBITRATIONS} cases",
            largest(studies["arbitration"], "integration_shape_percent"),
            INTEGRATION_TOLERANCE,
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

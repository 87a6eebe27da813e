"""The paper's claims and limitations, evaluated by the numbers of a run: verdict, evidence, reason."""

from __future__ import annotations

from collections.abc import Callable

from tdcr_fe.validation.paper.claims import limitations, methods, order, stability, tables
from tdcr_fe.validation.paper.claims.verdict import Verdict
from tdcr_fe.validation.paper.run import PaperRun


def verdicts(run: PaperRun) -> list[Verdict]:
    """Verdicts on all claims for which the run has numbers."""
    found: list[Verdict] = []
    judges: list[tuple[bool, Callable[[PaperRun], list[Verdict]]]] = [
        (bool(run.cases), order.order_of_models),
        (bool(run.tables), tables.accuracy),
        (bool(run.searches), stability.bifurcation),
        (bool(run.cases), stability.stable),
        (bool(run.tables), tables.consistency),
        (bool(run.signs), methods.signs),
        (run.stiffness is not None, methods.stiffness),
        (bool(run.thickness), limitations.thickness),
        (bool(run.friction), limitations.friction),
        (bool(run.dynamics), limitations.dynamics),
    ]
    for there, judge in judges:
        if there:
            found += judge(run)
    return found

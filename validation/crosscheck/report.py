"""Judge the records of cases and studies by the requirements, and write report.html and report.json."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from tdcr_fe.io.files import write_json, write_text
from tdcr_fe.report.environment import significant
from tdcr_fe.validation.crosscheck.compare import LARGEST, TENSION_TOLERANCE, TIP_TOLERANCE
from tdcr_fe.validation.crosscheck.page import to_html
from tdcr_fe.validation.crosscheck.run import versions
from tdcr_fe.validation.records import Record

#: Upper bound of the median over all cases [% of the length].
MEDIAN_TOLERANCE = 0.01
#: Least order of mesh convergence.
LEAST_ORDER = 1.9
#: Deviations that the reference may have: from closed forms, from the results of other codes (they agree with
#: each other to 1e-8 and are quoted to 1e-9 m) [% of the length].
CLOSED_TOLERANCE, LITERATURE_TOLERANCE = 1e-6, 2e-6
#: How far a tension may be outside its Capstan bounds, relative to the highest [1].
BOUND_TOLERANCE = 1e-8
#: Kinds of studies, see `tdcr_fe.validation.crosscheck.studies`.
STUDY_KINDS = ("mesh", "buckling", "closed", "literature")


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
    solved = [c for c in cases if not c["error"]]
    kinds = {k: [s for s in studies if s["kind"] == k and not s["error"]] for k in STUDY_KINDS}
    requirements = _requirements(solved, kinds)
    unmet = [r for r in requirements if not r["passed"]]
    failures = [f"study {s['id']}: {s['error']}" for s in studies if s["error"]]
    failures += [f"{c['id']}: {'; '.join(c['reasons'])}" for c in cases if not c["passed"]]
    failures += [f"{r['what']}: {r['found']} {r['unit']}, required {r['required']}" for r in unmet]
    counts = {"cases": len(cases), "failing": sum(not c["passed"] for c in cases)}
    counts["steps"] = sum(len(c["steps"]) for c in solved)
    summed = ("holes", "holes_differing", "holes_differing_off_threshold")
    counts |= {key: sum(c[key] for c in solved) for key in summed}
    worst = {key: _largest(solved, key)[0] for key in LARGEST} | {"median_percent": _median(solved)}
    verdict = {"passed": not failures, "failures": failures, "set": "full" if full else "quick"}
    date = datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC")
    made = {"time": time, "versions": versions(), "date": date, "cases": list(cases), "studies": kinds}
    return {**verdict, "requirements": requirements, "counts": counts, "worst": worst, **made}


def _largest(records: Sequence[Record], key: str) -> tuple[float, str]:
    """Largest value of a key over the records, and of which record; NaN where there are none."""
    found = max(records, key=lambda r: r[key], default=None)
    return (float("nan"), "") if found is None else (float(found[key]), found["id"])


def _median(solved: Sequence[Record]) -> float:
    return float(np.median([c["deviation_percent"] for c in solved])) if solved else float("nan")


def _requirements(solved: Sequence[Record], studies: Record) -> list[Record]:
    """All requirements: what, found, required, unit as texts, whether passed, and where the largest value is."""

    def requirement(what: str, found: str, required: str, unit: str, passed: bool) -> Record:
        row = {"what": what, "found": found, "required": required, "unit": unit}
        return {**row, "passed": passed, "where": ""}

    def below(what: str, found: tuple[float, str], limit: float, unit: str = "% of the length") -> Record:
        """A number that must be below a limit; one that was not found (NaN) does not pass."""
        value, where = found
        row = requirement(what, significant(value), f"below {limit:g}", unit, bool(value < limit))
        return {**row, "where": where}

    off = sum(c["holes_differing_off_threshold"] for c in solved)
    holes = f"of {sum(c['holes'] for c in solved)}"
    states = "Hole states that differ (excluding those at the stick-slip threshold)"
    order = min((s["order"] for s in studies["mesh"] if s["order"] is not None), default=float("nan"))
    least, converging = f"at least {LEAST_ORDER:g}", bool(order >= LEAST_ORDER)
    tension, bounds = _largest(solved, "tension_percent"), _largest(solved, "outside_bounds")
    closed, codes = (_largest(studies[kind], "reference_percent") for kind in ("closed", "literature"))
    return [
        below("Tip, worst case", _largest(solved, "deviation_percent"), TIP_TOLERANCE),
        below("Tip, median of all cases", (_median(solved), ""), MEDIAN_TOLERANCE),
        below("Tension at a hole, worst", tension, TENSION_TOLERANCE, "% of the tendon's highest"),
        requirement(states, str(off), "0", holes, off == 0),
        requirement("Order of mesh convergence, smallest", f"{order:.2f}", least, "", converging),
        below("Tensions outside the Capstan bounds", bounds, BOUND_TOLERANCE, "of the highest tension"),
        below("Reference against closed forms", closed, CLOSED_TOLERANCE),
        below("Reference against two public codes", codes, LITERATURE_TOLERANCE),
    ]


def headline(outcome: Record) -> list[str]:
    """The outcome in a few lines, for a terminal."""
    counts, time = outcome["counts"], outcome["time"]
    passing = f"{counts['cases'] - counts['failing']} of {counts['cases']} cases pass"
    lines = [f"{passing} ({outcome['set']} set, {counts['steps']} load steps, {time['wall']:.0f} s)"]
    for r in outcome["requirements"]:
        mark = "pass" if r["passed"] else "FAIL"
        lines.append(f"  {mark}  {r['what']}: {r['found']} {r['unit']} ({r['required']})")
    return lines


def write(outcome: Record, out: Path) -> None:
    """Write report.json and report.html into a directory."""
    write_json(outcome, out / "report.json", indent=1)
    write_text(to_html(outcome), out / "report.html")

"""The HTML page of a cross-validation: its first screen, and a section for every kind of evidence."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from tdcr_fe.report.environment import short
from tdcr_fe.report.page import Card, Page, Picture, Section, render
from tdcr_fe.validation.crosscheck import figures
from tdcr_fe.validation.crosscheck.cases import (
    ELEMENTS_PER_BAY,
    LOADS,
    MEDIAN_TOLERANCE,
    MODELS,
    MOST_COMPRESSION,
    MOST_TENSION,
    PRESLIDING,
    ROUTINGS,
    TENSION_TOLERANCE,
    TIP_TOLERANCE,
    all_cases,
)
from tdcr_fe.validation.crosscheck.compare import THRESHOLD_MOBILISATION, THRESHOLD_SLIP
from tdcr_fe.validation.runner import count

Record = dict[str, Any]


def to_html(outcome: Record) -> str:
    """The report as one self-contained HTML file."""
    return render(page(outcome), "tdcr_fe.validation.crosscheck")


def page(outcome: Record) -> Page:
    """What the report shows."""
    counts, time = outcome["counts"], outcome["time"]
    made = ", ".join(f"{name} {number}" for name, number in outcome["versions"].items())
    recalled = f", {time['recalled']} records from an earlier run" if time["recalled"] else ""
    full = " --full" if outcome["set"] == "full" else ""
    if outcome["passed"]:
        verdict = f"All {counts['cases']} cases pass."
    elif counts["failing"]:
        verdict = f"{counts['failing']} of {counts['cases']} cases fail."
    else:
        verdict = f"All {counts['cases']} cases pass; a requirement fails."
    return Page(
        title=f"Cross-validation, {outcome['set']} set, {outcome['date']}",
        verdict=verdict,
        level="good" if outcome["passed"] else "bad",
        sentences=(
            f"Finite elements (Exudyn, {ELEMENTS_PER_BAY} elements per bay) against an independent Cosserat shooting "
            "reference (numpy and scipy): the same robots, loads and histories, "
            f"{counts['steps']} load steps, {counts['holes']} hole states.",
        ),
        cards=_cards(outcome),
        pictures=_deviations(outcome),
        summary=Section(
            "summary",
            "",
            "requirements.html.j2",
            {key: outcome[key] for key in ("requirements", "worst", "failures")},
        ),
        sections=tuple(_sections(outcome)),
        notes=(
            f"{made}. {count(time['processes'], 'process', 'processes')}, {time['wall']:.0f} s{recalled}.",
            f"Repeat with: tdcr-fe validate -o OUT{full}",
        ),
    )


def _cards(outcome: Record) -> tuple[Card, ...]:
    worst, counts = outcome["worst"], outcome["counts"]
    off = counts["holes_differing_off_threshold"]
    return (
        Card(
            f"{short(worst['tip_percent'])} %",
            f"of the length: tip, worst case (must be below {TIP_TOLERANCE:g})",
        ),
        Card(
            f"{short(worst['median_tip_percent'])} %",
            f"of the length: tip, median (must be below {MEDIAN_TOLERANCE:g})",
        ),
        Card(
            f"{short(worst['tension_percent'])} %",
            f"tension at a hole, worst (must be below {TENSION_TOLERANCE:g})",
        ),
        Card(
            f"{off} of {counts['holes']}",
            f"hole states differ; {counts['holes_differing'] - off} more at the stick-slip threshold",
        ),
    )


def _deviations(outcome: Record) -> tuple[Picture, ...]:
    if not any(c["converged"] for c in outcome["cases"]):
        return ()
    drawn = figures.deviations(outcome["cases"], TIP_TOLERANCE, outcome["worst"]["median_tip_percent"])
    return (Picture(drawn, "Deviation of the tip in every case", "One dot for each case; crosses fail."),)


def _sections(outcome: Record) -> list[Section]:
    """A section for every kind of evidence in the outcome."""
    studies = outcome["studies"]
    cases = [c for c in outcome["cases"] if c["converged"]]
    found = [Section("shapes", "Shapes and tensions", "shapes.html.j2", {"groups": _groups(cases)})]
    if studies["mesh"]:
        found.append(Section("mesh", "Mesh convergence", "mesh.html.j2", {"studies": studies["mesh"]}))
    if studies["buckling"]:
        found.append(_buckling(studies["buckling"]))
    return [
        *found,
        _histories(outcome, cases),
        Section("literature", "Closed forms and results of other codes", "literature.html.j2", studies),
        Section("all", "All cases", "cases.html.j2", {"cases": outcome["cases"]}),
        _method(outcome),
    ]


def _buckling(studies: Sequence[Record]) -> Section:
    context = {
        "studies": studies,
        "load": studies[0]["tension"][0] / studies[0]["shares"][0],
        "most_compression": MOST_COMPRESSION,
        "tip_tolerance": TIP_TOLERANCE,
    }
    return Section("buckling", "Bays near buckling", "buckling.html.j2", context)


def _groups(cases: Sequence[Record]) -> list[Record]:
    """One picture for each routing and model: a case of each load, with different numbers of disks."""
    found = []
    for routing in ROUTINGS:
        for path, friction in MODELS:
            of_model = [
                c for c in cases
                if c["group"] == "grid" and (c["routing"], c["tendon_path"], c["friction"]) == (routing, path, friction)
            ]  # fmt: skip
            chosen = []
            for k, load in enumerate(LOADS):
                of_load = sorted((c for c in of_model if c["load"] == load), key=lambda c: c["disks"])
                if of_load:
                    chosen.append(of_load[k % len(of_load)])
            if not chosen:
                continue
            friction_text = "no" if friction == "none" else friction
            model = path if path == "continuous" else f"{path}, {friction_text} friction"
            worst = max(of_model, key=lambda c: c["deviation_percent"])
            found.append(
                {
                    "title": f"{routing}: {model}",
                    "count": len(of_model),
                    "worst": short(worst["deviation_percent"]),
                    "where": f"{worst['load']}, {worst['disks']} disks",
                    "picture": Picture(figures.group(chosen), f"Shapes and tensions, {routing}, {model}"),
                }
            )
    return found


def _histories(outcome: Record, cases: Sequence[Record]) -> Section:
    differing = [
        {**h, "case": c["id"], "step": n + 1}
        for c in outcome["cases"]
        for n, s in enumerate(c["steps"])
        for h in s["holes_differing"]
    ]
    histories = [
        {"case": c, "picture": Picture(figures.history(c), f"Hysteresis of {c['id']}")}
        for c in cases
        if c["group"] == "history" and c["friction"] == "per-hole"
    ]
    context = {
        "histories": histories,
        "differing": differing,
        "holes": outcome["counts"]["holes"],
        "presliding": PRESLIDING,
        "threshold_mobilisation": THRESHOLD_MOBILISATION,
        "threshold_slip": THRESHOLD_SLIP,
    }
    return Section("histories", "Loading, unloading, reloading; hole states", "histories.html.j2", context)


def _method(outcome: Record) -> Section:
    """The method; its numbers come from the cases themselves."""
    large = [
        max(step.tensions.values())
        for case in all_cases()
        if case.group == "large bending"
        for step in case.steps
        if step.tensions
    ]
    context = {
        "presliding": PRESLIDING,
        "most_tension": MOST_TENSION,
        "most_compression": MOST_COMPRESSION,
        "largest_tension": max(large, default=0.0),
        "other_paths": outcome["counts"]["other_paths"],
    }
    return Section("method", "Method", "method.html.j2", context)

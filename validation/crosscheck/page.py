"""The HTML page of a cross-validation: its first screen, and a section for every kind of evidence."""

from __future__ import annotations

from collections.abc import Sequence

from tdcr_fe.model.messages import count
from tdcr_fe.report.environment import short
from tdcr_fe.report.page import Card, Page, Picture, Section, render
from tdcr_fe.validation.crosscheck import figures
from tdcr_fe.validation.crosscheck.cases import (
    ELEMENTS_PER_BAY,
    LARGE_TENSIONS,
    MODELS,
    MOST_COMPRESSION,
    MOST_TENSION,
    ROUTINGS,
)
from tdcr_fe.validation.crosscheck.compare import PRESLIDING, THRESHOLD, TIP_TOLERANCE
from tdcr_fe.validation.records import Record


def to_html(outcome: Record) -> str:
    """The report as one self-contained HTML file."""
    return render(page(outcome), "tdcr_fe.validation.crosscheck")


def page(outcome: Record) -> Page:
    """What the report shows."""
    counts, time, studies = outcome["counts"], outcome["time"], outcome["studies"]
    made = ", ".join(f"{name} {number}" for name, number in outcome["versions"].items())
    recalled = f", {time['recalled']} records from an earlier run" if time["recalled"] else ""
    full = " --full" if outcome["set"] == "full" else ""
    if counts["failing"]:
        verdict = f"{counts['failing']} of {counts['cases']} cases fail."
    else:
        verdict = f"All {counts['cases']} cases pass{'.' if outcome['passed'] else '; a requirement fails.'}"
    solved = [c for c in outcome["cases"] if not c["error"]]
    sections = [Section("shapes", "Shapes and tensions", "shapes.html.j2", {"groups": _groups(solved)})]
    if studies["mesh"]:
        sections.append(Section("mesh", "Mesh convergence", "mesh.html.j2", {"studies": studies["mesh"]}))
    if studies["buckling"]:
        context = {"studies": studies["buckling"], "most": MOST_COMPRESSION, "tolerance": TIP_TOLERANCE}
        sections.append(Section("buckling", "Bays near buckling", "buckling.html.j2", context))
    context = {
        "presliding": PRESLIDING,
        "most_tension": MOST_TENSION,
        "most_compression": MOST_COMPRESSION,
        "largest_tension": max(LARGE_TENSIONS),
    }
    sections += [
        _histories(solved),
        Section("literature", "Closed forms and results of other codes", "literature.html.j2", studies),
        Section("all", "All cases", "cases.html.j2", {"cases": outcome["cases"]}),
        Section("method", "Method", "method.html.j2", context),
    ]
    return Page(
        title=f"Cross-validation, {outcome['set']} set, {outcome['date']}",
        verdict=verdict,
        level="good" if outcome["passed"] else "bad",
        sentences=(
            f"Finite elements (Exudyn, {ELEMENTS_PER_BAY} elements per bay) against an independent Cosserat shooting "
            "reference (numpy and scipy): the same robots, loads and histories, "
            f"{counts['steps']} load steps, {counts['holes']} hole states.",
        ),
        cards=tuple(_card(r) for r in outcome["requirements"][:4]),
        pictures=_deviations(solved, outcome["worst"]["median_percent"]),
        summary=Section("summary", "", "requirements.html.j2", outcome),
        sections=tuple(sections),
        notes=(
            f"{made}. {count(time['processes'], 'process', 'processes')}, {time['wall']:.0f} s{recalled}.",
            f"Repeat with: tdcr-fe validate -o OUT{full}",
        ),
    )


def _card(requirement: Record) -> Card:
    unit = requirement["unit"]
    value = f"{requirement['found']}{' %' if unit.startswith('%') else ''}"
    return Card(
        value, f"{requirement['what']}, {unit.removeprefix('% ')} (required: {requirement['required']})"
    )


def _deviations(solved: Sequence[Record], median: float) -> tuple[Picture, ...]:
    if not solved:
        return ()
    drawn = figures.deviations(solved, TIP_TOLERANCE, median)
    return (Picture(drawn, "Deviation of the tip in every case", "One dot for each case; crosses fail."),)


def _groups(solved: Sequence[Record]) -> list[Record]:
    """One picture for each routing and model: a case of each load, with different numbers of disks."""
    found = []
    for routing in ROUTINGS:
        for path, friction in MODELS:
            key = ("grid", routing, path, friction)
            of_model = [
                c for c in solved if (c["group"], c["routing"], c["tendon_path"], c["friction"]) == key
            ]
            if not of_model:
                continue
            friction_text = "no" if friction == "none" else friction
            title = f"{routing}: {path if path == 'continuous' else f'{path}, {friction_text} friction'}"
            worst = max(of_model, key=lambda c: c["deviation_percent"])
            drawn = figures.shapes_and_tensions([c for c in of_model if c["quick"]] or of_model[:1])
            found.append(
                {
                    "title": title,
                    "count": count(len(of_model), "case"),
                    "worst": short(worst["deviation_percent"]),
                    "where": f"{worst['load']}, {worst['disks']} disks",
                    "picture": Picture(drawn, f"Shapes and tensions, {title}"),
                }
            )
    return found


def _histories(solved: Sequence[Record]) -> Section:
    context = {
        "histories": [
            {"case": c, "picture": Picture(figures.history(c), f"Hysteresis of {c['id']}")}
            for c in solved
            if c["group"] == "history" and c["friction"] == "per-hole"
        ],
        "differing": [
            {**hole, "case": c["id"], "step": n}
            for c in solved
            for n, step in enumerate(c["steps"], start=1)
            for hole in step["holes_differing"]
        ],
        "threshold": THRESHOLD,
    }
    return Section("histories", "Loading, unloading, reloading; hole states", "histories.html.j2", context)

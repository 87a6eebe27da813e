"""The HTML page of a cross-validation: its first screen, and a section for every kind of evidence."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from tdcr_fe.model.messages import count
from tdcr_fe.report.page import Card, Page, Picture, Section, render
from tdcr_fe.report.style import BAD, COLOURS, INK, styled
from tdcr_fe.validation.crosscheck.cases import (
    ELEMENTS_PER_BAY,
    LARGE_TENSIONS,
    MOST_COMPRESSION,
    MOST_TENSION,
    ROUTINGS,
)
from tdcr_fe.validation.crosscheck.compare import PRESLIDING, THRESHOLD, TIP_TOLERANCE
from tdcr_fe.validation.records import Record


def to_html(outcome: Record) -> str:
    """The report as one self-contained HTML file."""
    return render(_page(outcome), "tdcr_fe.validation.crosscheck")


def _page(outcome: Record) -> Page:
    counts, time, studies = outcome["counts"], outcome["time"], outcome["studies"]
    made = ", ".join(f"{name} {number}" for name, number in outcome["versions"].items())
    recalled = f", {time['recalled']} records from an earlier run" if time["recalled"] else ""
    full = " --full" if outcome["set"] == "full" else ""
    if counts["failing"]:
        verdict = f"{counts['failing']} of {counts['cases']} cases fail."
    else:
        verdict = f"All {counts['cases']} cases pass{'.' if outcome['passed'] else '; a requirement fails.'}"
    solved = [c for c in outcome["cases"] if not c["error"]]
    picture = None
    if solved:
        drawn = _deviations(solved, TIP_TOLERANCE, outcome["worst"]["median_percent"])
        picture = Picture(drawn, "Deviation of the tip in every case", "One dot for each case; crosses fail.")
    rows = [(c["id"], n, s["holes_differing"]) for c in solved for n, s in enumerate(c["steps"], start=1)]
    differing = [{**hole, "case": case, "step": n} for case, n, holes in rows for hole in holes]
    context: Record = {"threshold": THRESHOLD, "most": MOST_COMPRESSION, "tolerance": TIP_TOLERANCE}
    context |= {"most_tension": MOST_TENSION, "largest_tension": max(LARGE_TENSIONS)}
    context |= {"presliding": PRESLIDING, "differing": differing}
    sections = []
    if studies["mesh"]:
        sections.append(Section("mesh", "Mesh convergence", "mesh.html.j2", {"studies": studies["mesh"]}))
    if studies["buckling"]:
        found = {**context, "studies": studies["buckling"]}
        sections.append(Section("buckling", "Bays near buckling", "buckling.html.j2", found))
    sections += [
        Section("holes", "Hole states that differ", "holes.html.j2", context),
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
        pictures=() if picture is None else (picture,),
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
    what = f"{requirement['what']}, {unit.removeprefix('% ')}"
    return Card(value, f"{what} (required: {requirement['required']})")


def _deviations(cases: Sequence[Record], tolerance: float, median: float) -> Figure:
    """Every case by its tip deviation, one row per routing, with tolerance and median."""
    with styled():
        figure = Figure(figsize=(4.8, 2.5))
        axes = figure.add_subplot()
        rows = [r for r in ROUTINGS if any(c["routing"] == r for c in cases)]
        rng = np.random.default_rng(0)
        for y, routing in enumerate(rows[::-1]):
            own = [c for c in cases if c["routing"] == routing]
            x = np.maximum([c["deviation_percent"] for c in own], 1e-10)
            height = y + rng.uniform(-0.28, 0.28, len(x))
            good = np.array([c["passed"] for c in own], dtype=bool)
            colour = COLOURS[ROUTINGS.index(routing)]
            axes.scatter(x[good], height[good], s=13, color=colour, alpha=0.6, linewidths=0)
            axes.scatter(x[~good], height[~good], s=26, color=BAD, marker="x", linewidths=1.2)
        axes.axvline(tolerance, color=BAD, lw=1.2)
        axes.axvline(median, color=INK, lw=1.0, ls=(0, (4, 3)))
        top = len(rows) - 0.42
        axes.text(tolerance * 1.12, top, f"tolerance {tolerance:g} %", color=BAD, va="bottom", fontsize=8.5)
        axes.text(median / 1.12, top, f"median {median:.2g} %", va="bottom", ha="right", fontsize=8.5)
        axes.set_xscale("log")
        axes.xaxis.set_major_formatter("{x:g}")
        axes.set_xlim(right=40.0 * tolerance)  # room for its text
        axes.set_yticks(range(len(rows)), rows[::-1])
        axes.set_ylim(-0.6, len(rows) - 0.4)
        axes.tick_params(axis="y", length=0, labelcolor=INK)
        axes.grid(axis="y", visible=False)
        axes.set_xlabel("deviation of the tip, worst step of each case [% of the length]")
    return figure

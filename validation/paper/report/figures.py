"""Drawings of the report on the paper, as SVG text."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from matplotlib import colormaps
from matplotlib.figure import Figure
from numpy.typing import NDArray

from tdcr_fe.model.results import StepResult
from tdcr_fe.report.style import COLOURS, styled, svg
from tdcr_fe.validation.paper.cases import MODEL_NAMES
from tdcr_fe.validation.paper.run import PaperRun
from tdcr_fe.validation.paper.studies.figures import CaseStudy, deformation
from tdcr_fe.validation.paper.studies.table_study import TableStudy

Array = NDArray[np.float64]

COLORS = {"classical": "#777777", "discrete": COLOURS[0], "per-tendon": COLOURS[1], "per-hole": COLOURS[2]}
LINES = {"classical": (0, (1, 1)), "discrete": "-", "per-tendon": (0, (5, 1.5)), "per-hole": "-"}
WIDTHS = {"classical": 2.4, "discrete": 1.3, "per-tendon": 1.8, "per-hole": 1.0}


def _subplots(count: int, width: float, height: float, **options: Any) -> tuple[Figure, Any]:
    """A figure with so many axes beside each other; its size in inches."""
    figure = Figure(figsize=(width, height), layout="constrained")
    return figure, figure.subplots(1, count, **options)


def _dense(step: StepResult) -> Array:
    s = np.linspace(0.0, step.s[-1], 61)
    return 1e3 * step.position_at(s)


def drawings(run: PaperRun) -> dict[str, str]:
    """Every drawing as SVG, by name."""
    found = {name: svg(draw_case(study)) for name, study in run.cases.items()}
    if run.tables:
        found["tables"] = svg(draw_tables(run))
    if run.missing:
        found["missing"] = svg(draw_missing(run))
    if run.searches:
        found["critical"] = svg(draw_searches(run))
    if run.dynamics:
        found["dynamics"] = svg(draw_dynamics(run))
    return found


def draw_case(study: CaseStudy) -> Figure:
    """Three views of every marked state with every model, and how the tip and its stability follow the load."""
    with styled():
        figure, axes = _subplots(4, 13.2, 3.5, width_ratios=(1, 1, 1, 1.25))
        for axis, (name, project, labels) in zip(axes[:3], _views(study), strict=True):
            _draw_shapes(axis, study, project)
            axis.set(title=name, xlabel=labels[0], ylabel=labels[1])
            if name == "isometric":
                axis.set_xticklabels([])
                axis.set_yticklabels([])
        _draw_sequence(axes[3], study)
        figure.legend(*axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=4)
    return figure


#: Takes points, shape (n, 3), to the coordinates of a view.
Projection = Callable[[Array], tuple[Array, Array]]


def _views(study: CaseStudy) -> tuple[tuple[str, Projection, tuple[str, str]], ...]:
    """Title, projection and axis labels of every view."""
    return (
        ("isometric", _isometric, ("", "")),
        ("top", lambda p: (p[:, 0], p[:, 1]), ("x [mm]", "y [mm]")),
        ("side", _side(study), _side_labels(study)),
    )


def _isometric(p: Array) -> tuple[Array, Array]:
    return (p[:, 0] - p[:, 1]) * 0.866, p[:, 2] + 0.5 * (p[:, 0] + p[:, 1]) * -1.0


def _draw_shapes(axis: Any, study: CaseStudy, project: Projection) -> None:
    """Every marked state with every model in one view, later states darker."""
    last = len(study.case.marked) - 1
    for key, run in study.runs.items():
        for k, label in enumerate(study.case.marked):
            step = next((s for s in run.steps if s.label == label), None)
            if step is None:
                continue
            u, v = project(_dense(step))
            axis.plot(
                u,
                v,
                color=COLORS[key],
                ls=LINES[key],
                lw=WIDTHS[key],
                alpha=0.45 + 0.55 * k / max(last, 1),
                label=MODEL_NAMES[key] if k == last else None,
            )
    axis.plot(*project(np.array([[0.0, 0.0, 0.0]])), "ks", ms=4)
    axis.set_aspect("equal", adjustable="datalim")


def _draw_sequence(axis: Any, study: CaseStudy) -> None:
    """Tip displacement and smallest eigenvalue along the loading sequence."""
    length = study.case.robot.backbone.length
    second = axis.twinx()
    second.spines["right"].set_visible(True)
    second.grid(False)
    for key, run in study.runs.items():
        look = {"color": COLORS[key], "ls": LINES[key]}
        x = np.arange(1, len(run.steps) + 1)
        axis.plot(x, [1e3 * deformation(s, length) for s in run.steps], lw=WIDTHS[key], **look)
        eigenvalues = [s.smallest for s in run.stabilities]
        second.plot(x, eigenvalues, lw=0.8, alpha=0.7, marker=".", ms=3, **look)
    steps = study.case.steps
    axis.set_xticks(range(1, len(steps) + 1), [_tick(s.label) for s in steps], rotation=90, fontsize=6.5)
    axis.set(title="along the loading sequence", ylabel="tip displacement [mm]")
    axis.set_ylim(bottom=0.0)
    second.set_ylim(0.0, 1.05)
    second.set_ylabel("smallest eigenvalue (dots)")


def _tick(label: str) -> str:
    return label.replace(" at the tip", "").replace("pull ", "T ").replace(" at disk 7", " (7)")


def _plane(study: CaseStudy) -> int:
    """Which horizontal axis the robot leans along in its last state: 0 for x, 1 for y."""
    step = next(iter(study.runs.values())).steps[-1]
    return int(np.argmax(np.abs(step.tip[:2])))


def _side(study: CaseStudy) -> Projection:
    k = _plane(study)
    return lambda p: (p[:, k], p[:, 2])


def _side_labels(study: CaseStudy) -> tuple[str, str]:
    return f"{'xy'[_plane(study)]} [mm]", "z [mm]"


def draw_tables(run: PaperRun) -> Figure:
    """Chord angles of all tables: measured, as declared, with what was fitted."""
    with styled():
        figure, axes = _subplots(len(run.tables), 13.2, 3.2)
        for axis, study in zip(np.atleast_1d(axes), run.tables.values(), strict=True):
            _draw_table(axis, study)
        handles, labels = np.atleast_1d(axes)[0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=4)
    return figure


def _draw_table(axis: Any, study: TableStudy) -> None:
    marks = {"declared": ("#D55E00", "s"), "stiffness": ("#0072B2", "^"), "dead band": ("#009E73", "v")}
    names = {
        "declared": "model as declared",
        "stiffness": "one stiffness fitted",
        "dead band": "stiffness and dead band fitted",
    }
    place = "tip"
    for name, readings in study.readings.items():
        color, mark = marks[name]
        for loaded in (False, True):
            used = [r for r in readings if r.quantity == "angle" and r.place == place and r.loaded == loaded]
            if used:
                axis.plot(
                    [r.row for r in used],
                    np.rad2deg([r.model for r in used]),
                    mark,
                    color=color,
                    ms=4.5,
                    mfc=color if loaded else "none",
                    label=names[name] if not loaded else None,
                    alpha=0.85,
                )
    for loaded in (False, True):
        used = [
            r
            for r in study.readings["declared"]
            if r.quantity == "angle" and r.place == place and r.loaded == loaded
        ]
        if used:
            axis.plot(
                [r.row for r in used],
                np.rad2deg([r.measured for r in used]),
                "k*",
                ms=8,
                mfc="k" if loaded else "none",
                label="measured (filled: with load)" if not loaded else None,
            )
    bad = study.table.loc[~study.table["geometry_ok"], "row"]
    for row in bad:
        axis.axvspan(row - 0.4, row + 0.4, color="#cc0000", alpha=0.08, lw=0)
    axis.set(title=f"Table {study.number}", xlabel="row", ylabel="chord angle at the tip [deg]")
    axis.set_xticks(study.table["row"])


def draw_missing(run: PaperRun) -> Figure:
    """Chord angles in the data sets of the identification: measured, as declared, and after each stage."""
    looks = (
        ("#D55E00", "s", "as declared"),
        ("#0072B2", "^", "one stiffness"),
        ("#009E73", "v", "with effects"),
    )
    with styled():
        figure, axes = _subplots(len(run.missing), 13.2, 3.2)
        legend: dict[str, Any] = {}
        for axis, study in zip(np.atleast_1d(axes), run.missing.values(), strict=True):
            data = study.table.data
            chosen = [i for i, r in enumerate(data.readings) if r.unit == "rad"]
            rows = [study.table.row(data.readings[i].step) for i in chosen]
            for row in study.held_out_rows:
                axis.axvspan(row - 0.4, row + 0.4, color="#777777", alpha=0.12, lw=0)
            for stage in study.stages:
                known = {x[2]: x for x in looks}
                color, mark, name = known.get(stage.name, looks[2])
                values = np.rad2deg(stage.predicted[chosen])
                (legend[name],) = axis.plot(rows, values, mark, color=color, mfc="none", ms=6.5)
            measured = np.rad2deg([data.readings[i].value for i in chosen])
            (legend["measured"],) = axis.plot(rows, measured, "k*", ms=4.5)
            axis.set(title=study.table.title, xlabel="row", ylabel="chord angle at the tip [deg]")
            axis.set_xticks(sorted(set(rows)))
            axis.set_ylim(0.0, min(1.9 * measured.max(), axis.get_ylim()[1]))
            axis.set_title(study.table.title, fontsize=8)
        figure.legend(
            list(legend.values()),
            list(legend),
            loc="outside lower center",
            ncols=4,
            title="grey: rows held out; values beyond a frame are not drawn",
        )
    return figure


def draw_searches(run: PaperRun) -> Figure:
    """Smallest eigenvalue against load, for every direction and tension searched."""
    with styled():
        directions = list(dict.fromkeys(k[1] for k in run.searches))
        figure, axes = _subplots(len(directions), 13.2, 2.9, sharey=True)
        tensions = sorted({k[0] for k in run.searches})
        colors = colormaps["viridis"](np.linspace(0.0, 0.85, len(tensions)))
        for axis, direction in zip(np.atleast_1d(axes), directions, strict=True):
            for (tension, d, model), search in run.searches.items():
                if d == direction:
                    axis.plot(
                        search.loads,
                        search.eigenvalues,
                        color=colors[tensions.index(tension)],
                        lw=1.4,
                        ls="-" if model == "discrete" else ":",
                        label=f"{tension:g} N" if model == "discrete" else None,
                    )
            axis.axhline(0.0, color="#cc0000", lw=1.0)
            axis.set(title=f"load along {direction}", xlabel="load [N]")
        first = np.atleast_1d(axes)[0]
        first.set_ylabel("smallest eigenvalue")
        first.set_ylim(-0.05, 1.05)
        figure.legend(
            *first.get_legend_handles_labels(),
            loc="outside lower center",
            ncols=len(tensions),
            title="tension of the helical tendon (dotted: with friction per hole)",
        )
    return figure


def draw_dynamics(run: PaperRun) -> Figure:
    """Tip against time."""
    with styled():
        figure, axis = _subplots(1, 6.4, 2.7)
        for d, color in zip(run.dynamics, ("#D55E00", "#0072B2", "#009E73"), strict=False):
            axis.plot(d.times, 1e3 * d.tips[:, 0], color=color, lw=1.2, label=f"ramp of {d.ramp:g} s")
        still = run.cases["fig3"].runs["per-hole"].at("pull 1.5 N").tip[0] if "fig3" in run.cases else None
        if still is not None:
            axis.axhline(1e3 * still, color="k", lw=0.8, ls="--", label="quasi-static")
        axis.set(xlabel="time [s]", ylabel="tip, x [mm]")
        axis.legend(loc="lower right")
    return figure

"""Pictures of the validation report, as SVG text."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator

from tdcr_fe.report.style import BAD, COLOURS, INK, PALE, REFERENCE, SOFT, no_axes, styled, svg
from tdcr_fe.validation.crosscheck.case import (
    LOADS,
    ROUTINGS,
)

Record = dict[str, Any]


_MODEL_NAMES = {
    "continuous": "continuous",
    "none": "straight, no friction",
    "per-tendon": "straight, per-tendon friction",
    "per-hole": "straight, per-hole friction",
}


def _routing_colour(routing: str) -> str:
    return COLOURS[ROUTINGS.index(routing)] if routing in ROUTINGS else SOFT


def deviations(cases: Sequence[Record], tolerance: float, median: float) -> str:
    """Every case by its tip deviation, one row per routing, with tolerance and median."""
    with styled():
        figure = Figure(figsize=(9.2, 2.5))
        axes = figure.add_subplot()
        rows = [r for r in ROUTINGS if any(c["routing"] == r for c in cases)]
        draw = np.random.default_rng(0)
        for y, routing in enumerate(rows[::-1]):
            mine = [c for c in cases if c["routing"] == routing and c.get("deviation_percent") is not None]
            x = np.maximum([c["deviation_percent"] for c in mine], 1e-10)
            height = y + draw.uniform(-0.28, 0.28, len(x))
            good = np.array([c["passed"] for c in mine], dtype=bool)
            axes.scatter(x[good], height[good], s=13, color=_routing_colour(routing), alpha=0.6, linewidths=0)
            axes.scatter(x[~good], height[~good], s=26, color=BAD, marker="x", linewidths=1.2)
        axes.axvline(tolerance, color=BAD, lw=1.2)
        axes.axvline(median, color=INK, lw=1.0, ls=(0, (4, 3)))
        top = len(rows) - 0.42
        axes.text(tolerance * 1.12, top, f"tolerance {tolerance:g} %", color=BAD, va="bottom", fontsize=8.5)
        axes.text(median / 1.12, top, f"median {median:.2g} %", va="bottom", ha="right", fontsize=8.5)
        axes.set_xscale("log")
        axes.set_yticks(range(len(rows)), rows[::-1])
        axes.set_ylim(-0.6, len(rows) - 0.4)
        axes.tick_params(axis="y", length=0, labelcolor=INK)
        axes.grid(axis="y", visible=False)
        axes.set_xlabel("deviation of the tip, worst step of each case [% of the length]")
    return svg(figure)


def _project(points: np.ndarray, azimuth: float = -60.0, elevation: float = 22.0) -> np.ndarray:
    """Parallel projection, upright z; shape (n, 2)."""
    a, e = np.radians(azimuth), np.radians(elevation)
    right = np.array([-np.sin(a), np.cos(a), 0.0])
    up = np.array([-np.sin(e) * np.cos(a), -np.sin(e) * np.sin(a), np.cos(e)])
    return np.stack((points @ right, points @ up), axis=1)


def group(cases: Sequence[Record]) -> str:
    """Shapes of both solvers at every load step, and tensions along the pulled tendons, by load."""
    return svg(draw_group(cases))


def draw_group(cases: Sequence[Record]) -> Figure:
    """The figure of `group`: one column for each case."""
    with styled():
        figure = Figure(figsize=(12.0, 5.0), layout="constrained")
        order = sorted(cases, key=lambda c: LOADS.index(c["load"]) if c["load"] in LOADS else 99)
        for k, case in enumerate(order):
            shape = figure.add_subplot(2, len(order), k + 1)
            tension = figure.add_subplot(2, len(order), len(order) + k + 1)
            _draw_shapes(shape, case, COLOURS[k % 5])
            _draw_tensions(tension, case, COLOURS[k % 5])
            # Two lines: columns are too narrow for one.
            shape.set_title(f"{case['load']}\n{case['disks']} disks")
            if k == 0:
                tension.set_ylabel("tension [N]")
    return figure


def _draw_shapes(axes: Axes, case: Record, colour: str) -> None:
    axes.set_aspect("equal", anchor="S")
    count = len(case["steps"])
    for i, step in enumerate(case["steps"]):
        strength = 0.35 + 0.65 * (i + 1) / count
        line = 1e3 * _project(np.array(step["shape_reference"]))
        nodes = 1e3 * _project(np.array(step["shape_finite_element"]))
        axes.plot(*line.T, color=REFERENCE, lw=0.8, alpha=strength)
        stride = max(1, len(nodes) // 20)
        axes.plot(*nodes[::stride].T, ls="", marker="o", ms=2.6, color=colour, alpha=strength, mew=0)
    no_axes(axes)
    points = 1e3 * np.concatenate([_project(np.array(step["shape_reference"])) for step in case["steps"]])
    (left, bottom), (right, top) = points.min(axis=0), points.max(axis=0)
    right = max(right, left + 60.0)
    axes.set_xlim(left - 8.0, right + 8.0)
    axes.set_ylim(bottom - 34.0, top + 6.0)
    axes.plot([right - 50.0, right], [bottom - 16.0] * 2, color=SOFT, lw=1.2)
    axes.text(right - 25.0, bottom - 20.0, "50 mm", ha="center", va="top", fontsize=7.5, color=SOFT)


def _draw_tensions(axes: Axes, case: Record, colour: str) -> None:
    step = max(case["steps"], key=lambda s: sum(s["base_tensions"]))
    most = max((max(t) for t in step["tensions_reference"]), default=0.0)
    for theirs, mine in zip(step["tensions_reference"], step["tensions_finite_element"], strict=True):
        if not most or max(theirs) < 0.02 * most:
            continue
        segments = np.arange(1, len(theirs) + 1)
        axes.plot(segments, theirs, color=REFERENCE, lw=0.9, drawstyle="steps-mid")
        axes.plot(segments, mine, ls="", marker="o", ms=3.2, color=colour, mew=0)
    axes.set_ylim(0.0, 1.15 * most if most else 1.0)
    axes.set_xlabel("segment from the base")
    axes.xaxis.set_major_locator(MaxNLocator(4, integer=True))


def mesh(studies: Sequence[Record]) -> str:
    """Deviation over elements per bay, one panel per routing."""
    names = {"continuous": "o", "none": "s", "per-tendon": "^", "per-hole": "D"}
    with styled():
        figure = Figure(figsize=(12.0, 2.7))
        rows = [r for r in ROUTINGS if any(s["routing"] == r for s in studies)]
        first = None
        for k, routing in enumerate(rows):
            axes = figure.add_subplot(1, len(rows), k + 1, sharey=first)
            first = first or axes
            for study in (s for s in studies if s["routing"] == routing):
                which = "continuous" if study["tendon_path"] == "continuous" else study["friction"]
                colour = COLOURS[list(names).index(which)]
                axes.plot(
                    study["elements_per_bay"],
                    study["deviation_percent"],
                    marker=names[which],
                    ms=4.5,
                    lw=1.1,
                    color=colour,
                )
            n = np.array([2.0, 16.0])
            level = max(s["deviation_percent"][0] for s in studies if s["routing"] == routing)
            axes.plot(n, 2.0 * level * (n / 2.0) ** -2, color=PALE, lw=1.0, ls=(0, (3, 3)))
            axes.text(16.0, 2.0 * level / 64.0, " order 2", color=SOFT, fontsize=8, ha="right", va="bottom")
            axes.set_xscale("log", base=2)
            axes.set_yscale("log")
            axes.set_xticks([2, 4, 8, 16], ["2", "4", "8", "16"])
            axes.set_title(routing)
            axes.set_xlabel("elements per bay")
            if k == 0:
                axes.set_ylabel("tip deviation [%]")
        handles = [
            Line2D([], [], marker=m, color=c, lw=1.1, ms=4.5, label=_MODEL_NAMES[n])
            for (n, m), c in zip(names.items(), COLOURS, strict=False)
        ]
        figure.legend(handles=handles, loc="upper center", ncols=4, bbox_to_anchor=(0.5, 1.12))
        figure.subplots_adjust(wspace=0.2)
    return svg(figure)


def disks(studies: Sequence[Record]) -> str:
    """Distance between the straight and the classical model over the number of disks."""
    with styled():
        figure = Figure(figsize=(5.6, 3.0))
        axes = figure.add_subplot()
        for study in studies:
            colour = _routing_colour(study["routing"])
            label = f"{study['routing']}, rate {study['rate']:.2f}"
            axes.plot(study["disks"], study["reference_percent"], color=colour, lw=1.1, label=label)
            mine = study["finite_element_percent"]
            axes.plot(study["disks"][: len(mine)], mine, ls="", marker="o", ms=4.5, color=colour, mew=0)
        axes.set_xscale("log")
        axes.set_yscale("log")
        axes.set_xticks([5, 10, 20, 40, 80], ["5", "10", "20", "40", "80"])
        axes.minorticks_off()
        axes.set_xlabel("disks")
        axes.set_ylabel("straight against continuous [%]")
        axes.legend(loc="lower left")
    return svg(figure)


def history(case: Record) -> str:
    """Hysteresis of one tendon, tension over displacement, and the state of every hole at every step."""
    with styled():
        figure = Figure(figsize=(12.0, 2.9))
        grid = figure.add_gridspec(1, 4, width_ratios=(1.1, 1.1, 1.2, 1.2), wspace=0.32)
        steps = case["steps"]
        pulled = np.array([s["base_tensions"] for s in steps])
        i = int(np.argmax(np.ptp(pulled, axis=0)))
        tension = np.concatenate(([0.0], pulled[:, i]))
        left, middle = figure.add_subplot(grid[0]), figure.add_subplot(grid[1])
        for side, style in (("reference", {"color": REFERENCE, "lw": 1.0}), ("finite_element", _DOTS)):
            moved = 1e3 * np.concatenate(([0.0], [s[f"displacements_{side}"][i] for s in steps]))
            tips = np.array([[0.0, 0.0, 0.0], *(s[f"tip_{side}"] for s in steps)])
            offset = 1e3 * np.hypot(tips[:, 0], tips[:, 1])
            left.plot(moved, tension, **style)
            middle.plot(tension, offset, **style)
        left.set_xlabel(f"{case['tendons'][i]} pulled in [mm]")
        left.set_ylabel(f"tension of {case['tendons'][i]} at the base [N]")
        middle.set_xlabel(f"tension of {case['tendons'][i]} at the base [N]")
        middle.set_ylabel("tip from the z axis [mm]")
        image = None
        for k, (side, title) in enumerate(
            (("reference", "reference"), ("finite_element", "finite elements"))
        ):
            axes = figure.add_subplot(grid[2 + k])
            values = np.array([np.concatenate(s[f"mobilisation_{side}"]) for s in steps]).T
            image = axes.imshow(
                values, aspect="auto", cmap=_MOBILISATION, vmin=-1.0, vmax=1.0, origin="lower"
            )
            axes.set_title(f"holes, {title}")
            axes.set_xlabel("load step")
            axes.set_ylabel(
                "hole from the base" if len(case["tendons"]) == 1 else "holes, tendon after tendon"
            )
            every = 1 if len(steps) <= 10 else 2
            axes.set_xticks(range(0, len(steps), every), [str(n + 1) for n in range(0, len(steps), every)])
            axes.set_yticks([])
            axes.grid(visible=False)
        if image is not None:
            bar = figure.colorbar(image, ax=figure.axes[2:], shrink=0.85, pad=0.015, ticks=[-1, 0, 1])
            bar.ax.set_yticklabels(["release", "stick", "pull"])
            bar.outline.set_visible(False)
    return svg(figure)


_DOTS: Any = {"color": COLOURS[1], "ls": "", "marker": "o", "ms": 4.0, "mew": 0}
_MOBILISATION = ListedColormap(
    [
        tuple(float(c) for c in (1 - w) * np.array([0.97, 0.97, 0.96]) + w * np.array(end))
        for w, end in [(w, (0.0, 0.45, 0.70)) for w in np.linspace(1.0, 0.0, 60)]
        + [(w, (0.84, 0.37, 0.0)) for w in np.linspace(0.0, 1.0, 60)]
    ]
)


def times(cases: Sequence[Record]) -> str:
    """Wall time per substep of both solvers over disks."""
    with styled():
        figure = Figure(figsize=(5.6, 3.0))
        axes = figure.add_subplot()
        draw = np.random.default_rng(1)
        for side, colour, shift in (("finite_element", COLOURS[1], -0.25), ("reference", REFERENCE, 0.25)):
            x = np.array([c["disks"] for c in cases]) + shift + draw.uniform(-0.12, 0.12, len(cases))
            y = [1e3 * c[f"time_{side}"] / max(1, c["substeps"]) for c in cases]
            label = "finite elements, 4 per bay" if side == "finite_element" else "reference"
            axes.scatter(x, y, s=9, alpha=0.5, color=colour, linewidths=0, label=label)
        axes.set_yscale("log")
        axes.set_yticks([5, 10, 20, 50, 100, 200, 500], ["5", "10", "20", "50", "100", "200", "500"])
        axes.minorticks_off()
        axes.set_xlabel("disks")
        axes.set_ylabel("time per substep [ms]")
        axes.legend(loc="upper left", markerscale=2)
    return svg(figure)


def bounds(case: Record) -> str:
    """Tension ratio at every hole within its Capstan bounds, around the reversal of a history."""
    with styled():
        figure = Figure(figsize=(12.0, 2.4))
        chosen = [n for n in (2, 3, 4, 5, 7) if n < len(case["steps"])]
        first = None
        for k, n in enumerate(chosen):
            step = case["steps"][n]
            axes = figure.add_subplot(1, len(chosen), k + 1, sharey=first)
            first = first or axes
            for side, style in (("reference", {"color": REFERENCE, "lw": 1.0}), ("finite_element", _DOTS)):
                share = step[f"friction_share_{side}"][0]
                axes.plot(range(1, len(share) + 1), share, **style)
            axes.axhline(1.0, color=BAD, lw=0.9)
            axes.axhline(-1.0, color=BAD, lw=0.9)
            axes.set_ylim(-1.25, 1.25)
            axes.set_title(f"step {n + 1}: {step['base_tensions'][0] + 0.0:.1f} N", fontsize=9)
            axes.set_xlabel("hole from the base")
            axes.xaxis.set_major_locator(MaxNLocator(4, integer=True))
            axes.tick_params(labelleft=k == 0)
            if k == 0:
                axes.set_ylabel(r"$\ln(T_{k+1}/T_k)\,/\,\mu\theta_k$")
        figure.subplots_adjust(wspace=0.12)
    return svg(figure)

"""Pictures of the validation report."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from tdcr_fe.report.style import BAD, COLOURS, INK, REFERENCE, SOFT, no_axes, styled
from tdcr_fe.validation.crosscheck.cases import ROUTINGS
from tdcr_fe.validation.records import Record


def deviations(cases: Sequence[Record], tolerance: float, median: float) -> Figure:
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
        axes.set_xlim(right=40.0 * tolerance)  # room for its text
        axes.set_yticks(range(len(rows)), rows[::-1])
        axes.set_ylim(-0.6, len(rows) - 0.4)
        axes.tick_params(axis="y", length=0, labelcolor=INK)
        axes.grid(axis="y", visible=False)
        axes.set_xlabel("deviation of the tip, worst step of each case [% of the length]")
    return figure


def _project(points: np.ndarray, azimuth: float = -60.0, elevation: float = 22.0) -> np.ndarray:
    """Parallel projection, upright z; shape (n, 2)."""
    a, e = np.radians(azimuth), np.radians(elevation)
    right = np.array([-np.sin(a), np.cos(a), 0.0])
    up = np.array([-np.sin(e) * np.cos(a), -np.sin(e) * np.sin(a), np.cos(e)])
    return np.stack((points @ right, points @ up), axis=1)


def shapes_and_tensions(cases: Sequence[Record]) -> Figure:
    """Shapes of both solvers at every load step, and tensions along the pulled tendons; a column for each case."""
    with styled():
        figure = Figure(figsize=(11.0, 5.0), layout="constrained")
        axes = figure.subplots(2, len(cases), squeeze=False)
        for case, colour, shape, tension in zip(cases, COLOURS, *axes, strict=False):
            _draw_shapes(shape, case, colour)
            _draw_tensions(tension, case, colour)
            # Two lines: columns are too narrow for one.
            shape.set_title(f"{case['load']}\n{case['disks']} disks")
        axes[1, 0].set_ylabel("tension [N]")
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
    step = max(case["steps"], key=lambda s: sum(t[0] for t in s["tensions_reference"]))
    most = max((max(t) for t in step["tensions_reference"]), default=0.0)
    for reference, found in zip(step["tensions_reference"], step["tensions_finite_element"], strict=True):
        if not most or max(reference) < 0.02 * most:
            continue
        segments = np.arange(1, len(reference) + 1)
        axes.plot(segments, reference, color=REFERENCE, lw=0.9, drawstyle="steps-mid")
        axes.plot(segments, found, ls="", marker="o", ms=3.2, color=colour, mew=0)
    axes.set_ylim(0.0, 1.15 * most if most else 1.0)
    axes.set_xlabel("segment from the base")
    axes.xaxis.set_major_locator(MaxNLocator(4, integer=True))


def history(case: Record) -> Figure:
    """Hysteresis of one tendon: tension over displacement, and distance of the tip from the axis over tension."""
    with styled():
        figure = Figure(figsize=(7.0, 2.9), layout="constrained")
        left, right = figure.subplots(1, 2)
        steps = case["steps"]
        pulled = np.array([[t[0] for t in s["tensions_reference"]] for s in steps])
        i = int(np.argmax(np.ptp(pulled, axis=0)))
        tension = np.concatenate(([0.0], pulled[:, i]))
        dots: Any = {"color": COLOURS[1], "ls": "", "marker": "o", "ms": 4.0, "mew": 0}
        for side, look in (("reference", {"color": REFERENCE, "lw": 1.0}), ("finite_element", dots)):
            moved = 1e3 * np.concatenate(([0.0], [s[f"displacements_{side}"][i] for s in steps]))
            tips = np.array([[0.0, 0.0, 0.0], *(s[f"tip_{side}"] for s in steps)])
            left.plot(moved, tension, **look)
            right.plot(tension, 1e3 * np.hypot(tips[:, 0], tips[:, 1]), **look)
        name = case["tendons"][i]
        left.set(xlabel=f"{name} pulled in [mm]", ylabel=f"tension of {name} at the base [N]")
        right.set(xlabel=f"tension of {name} at the base [N]", ylabel="tip from the z axis [mm]")
    return figure

"""Pictures of a simulation: shapes of the backbone, tensions along the tendons, hysteresis of the tip angle.

Functions take a `SequenceResult` and return a matplotlib `Figure`; no window opens, and the settings of
matplotlib are left as they were.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import colormaps, rc_context
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import BoundaryNorm, ListedColormap
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator
from mpl_toolkits.mplot3d.art3d import Line3DCollection, Poly3DCollection  # type: ignore[import-untyped]
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation, Slerp

from tdcr_fe.model.results import SequenceResult, StepResult
from tdcr_fe.model.robot import Tendon

Array = NDArray[np.float64]

#: As many steps are drawn with disks and tendons; the others as a thin backbone.
DETAILED_STEPS = 6
#: As many steps are drawn at most, spread over the sequence, the first and the last among them.
DRAWN_STEPS = 60

_STYLE: Any = {
    "font.size": 9.5,
    "axes.titlesize": 10.5,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.edgecolor": "#555555",
    "axes.grid": True,
    "grid.color": "#e3e3e3",
    "grid.linewidth": 0.7,
    "axes.axisbelow": True,
    "lines.solid_capstyle": "round",
    "legend.frameon": False,
    "legend.fontsize": 8.5,
}
_TENDON_COLOURS = ("#d1495b", "#00798c", "#e08e1b", "#6a4c93", "#3f784c", "#8d6346")
_PLATE = "#3b3b3b"
_PATH = "#888888"
_DASHES = (0, (2, 2))
_MM = 1e3


def _chosen(count: int, at_most: int) -> list[int]:
    """Indices spread evenly over ``count`` steps, first and last among them."""
    return sorted({int(k) for k in np.linspace(0, count - 1, min(count, at_most)).round()})


def _distinct(result: SequenceResult) -> list[int]:
    """Steps whose tips lie apart from each other: the most bent, the last, then always the farthest."""
    tips = result.tips
    chosen = [int(np.argmax(result.bending_angles)), len(tips) - 1]
    gap = np.min(np.linalg.norm(tips[:, None] - tips[chosen], axis=2), axis=1)
    while len(chosen) < min(DETAILED_STEPS, len(tips)):
        chosen.append(int(np.argmax(gap)))
        gap = np.minimum(gap, np.linalg.norm(tips - tips[chosen[-1]], axis=1))
    return sorted(set(chosen))


class _StepColours:
    """A colour for each step, and the bar that explains them; without the map's end that fades on white."""

    def __init__(self, result: SequenceResult, drawn: Sequence[int]) -> None:
        self.numbers = [result.steps[k].step for k in drawn]
        self.colours = colormaps["viridis"](np.linspace(0.0, 0.92, len(drawn)))

    def __call__(self, i: int) -> Any:
        """Colour of the i-th drawn step."""
        return self.colours[i]

    def bar(self, figure: Figure, axes: Any, **where: Any) -> None:
        """Add the bar beside ``axes``; nothing for a single step."""
        count = len(self.numbers)
        if count < 2:
            return
        norm = BoundaryNorm(np.arange(count + 1) - 0.5, count)
        bar = figure.colorbar(ScalarMappable(norm, ListedColormap(self.colours)), ax=axes, **where)
        ticks = _chosen(count, 12)
        bar.set_ticks(ticks, labels=[str(self.numbers[i]) for i in ticks])
        bar.minorticks_off()
        bar.set_label("load step")
        bar.outline.set_visible(False)


# ------------------------------------------------------------------------------------------------- geometry


def _poses(step: StepResult, s: Array) -> tuple[Array, Array]:
    """Positions [m] and rotations of the sections at arc lengths within the backbone."""
    s = np.clip(np.asarray(s, dtype=float), step.s[0], step.s[-1])
    rotations = Slerp(step.s, Rotation.from_matrix(step.rotations))(s).as_matrix()
    return step.position_at(s), rotations


def _backbone(result: SequenceResult, step: StepResult, per_bay: int = 8) -> Array:
    """A smooth curve along the backbone [m], shape (m, 3)."""
    n = max(per_bay * len(result.robot.disks.positions), 60)
    return step.position_at(np.linspace(step.s[0], step.s[-1], n))


def _rings(result: SequenceResult, step: StepResult, points: int = 25) -> Array:
    """Rims of base plate and disks [m], shape (n_disks + 1, points, 3)."""
    position, rotation = _poses(step, np.array([0.0, *result.robot.disks.positions]))
    around = np.linspace(0.0, 2.0 * np.pi, points)
    rim = result.robot.disks.radius * np.stack((np.cos(around), np.sin(around)), axis=-1)
    return np.asarray(position[:, None, :] + np.einsum("nij,pj->npi", rotation[:, :, :2], rim))


def _tendon_line(result: SequenceResult, step: StepResult, tendon: Tendon) -> Array:
    """The tendon from the base plate to its anchor [m], shape (m, 3)."""
    robot = result.robot
    end = robot.end(tendon)
    if result.model.tendon_path == "continuous":
        s = np.linspace(0.0, end, 120)
    else:
        s = robot.hole_arc_lengths(tendon)
    position, rotation = _poses(step, s)
    return position + np.einsum("nij,nj->ni", rotation[:, :, :2], tendon.routing.position(s, end))


# ---------------------------------------------------------------------------------------------------- shapes


def _planar(
    axes: Axes, result: SequenceResult, i: int, j: int, drawn: list[int], colours: _StepColours
) -> None:
    """Project onto the world axes ``i`` and ``j``."""
    detailed = set(_distinct(result))
    for n, k in enumerate(drawn):
        step, colour = result.steps[k], colours(n)
        curve = _backbone(result, step) * _MM
        if k in detailed:
            for ring in _rings(result, step)[1:] * _MM:
                axes.fill(
                    ring[:, i], ring[:, j], fc=(*colour[:3], 0.3), ec=(*colour[:3], 0.8), lw=0.8, zorder=2
                )
            for tendon, tendon_colour in zip(result.robot.tendons, _cycle(result), strict=True):
                line = _tendon_line(result, step, tendon) * _MM
                axes.plot(line[:, i], line[:, j], color=tendon_colour, lw=0.9, alpha=0.85, zorder=3)
        width, alpha = (1.9, 1.0) if k in detailed else (1.0, 0.7)
        axes.plot(curve[:, i], curve[:, j], color=colour, lw=width, alpha=alpha, zorder=4)
    plate = 1.6 * result.robot.disks.radius * _MM
    axes.plot([-plate, plate], [0.0, 0.0], color=_PLATE, lw=4, solid_capstyle="butt", zorder=5)
    if _path_is_drawn(result):
        tips = result.tips * _MM
        axes.plot(tips[:, i], tips[:, j], color=_PATH, lw=0.9, ls=_DASHES, zorder=1)
    axes.set_xlabel(f"{'xyz'[i]} [mm]")
    axes.set_ylabel(f"{'xyz'[j]} [mm]")
    axes.xaxis.set_major_locator(MaxNLocator(5, steps=[1, 2, 2.5, 5, 10]))


def _spatial(axes: Any, result: SequenceResult, drawn: list[int], colours: _StepColours, box: Array) -> None:
    """The shapes in three dimensions, on a 3D axes that spans ``box`` [mm], shape (3, 2)."""
    detailed = set(_distinct(result))
    for n, k in enumerate(drawn):
        step, colour = result.steps[k], colours(n)
        curve = _backbone(result, step) * _MM
        if k in detailed:
            rings = list(_rings(result, step)[1:] * _MM)
            axes.add_collection3d(
                Poly3DCollection(rings, facecolor=(*colour[:3], 0.25), edgecolor=colour, lw=0.6)
            )
            for tendon, tendon_colour in zip(result.robot.tendons, _cycle(result), strict=True):
                line = _tendon_line(result, step, tendon) * _MM
                axes.add_collection3d(Line3DCollection([line], colors=[tendon_colour], lw=0.9, alpha=0.85))
        width, alpha = (1.9, 1.0) if k in detailed else (1.0, 0.7)
        axes.plot(*curve.T, color=colour, lw=width, alpha=alpha)
    plate = _rings(result, result.steps[0])[0] * _MM * [1.6, 1.6, 1.0]
    axes.add_collection3d(Poly3DCollection([plate], facecolor=_PLATE, edgecolor=_PLATE, alpha=0.8))
    if _path_is_drawn(result):
        axes.plot(*(result.tips * _MM).T, color=_PATH, lw=0.9, ls=_DASHES)
    span = box[:, 1] - box[:, 0]
    for name, limits, width in zip("xyz", box, span, strict=True):
        getattr(axes, f"set_{name}lim")(*limits)
        getattr(axes, f"set_{name}label")(f"{name} [mm]", labelpad=6.0)
        getattr(axes, f"{name}axis").set_major_locator(MaxNLocator(4 if width > 0.6 * span.max() else 2))
        getattr(axes, f"{name}axis").pane.set_facecolor("#fafafa")
    axes.tick_params(pad=1.0, labelsize=8.5)
    axes.set_box_aspect(span, zoom=0.95)
    axes.view_init(elev=22.0, azim=-55.0)


def _path_is_drawn(result: SequenceResult) -> bool:
    """Whether the way of the tip from step to step is still readable."""
    return 1 < len(result.steps) <= 40


def _box(result: SequenceResult, drawn: list[int]) -> Array:
    """World box around everything drawn, none of its sides slim [mm], shape (3, 2)."""
    points = np.concatenate([_backbone(result, result.steps[k]) for k in drawn]) * _MM
    around = 2.0 * result.robot.disks.radius * _MM
    low = np.minimum(points.min(axis=0), 0.0) - around
    high = np.maximum(points.max(axis=0), 0.0) + around
    slim = np.maximum(0.45 * (high - low).max() - (high - low), 0.0) / 2.0
    return np.stack((low - slim, high + slim), axis=1)


def _cycle(result: SequenceResult) -> list[str]:
    return [_TENDON_COLOURS[i % len(_TENDON_COLOURS)] for i in range(len(result.robot.tendons))]


def _tendon_legend(figure: Figure, result: SequenceResult, **where: Any) -> None:
    names = result.robot.tendon_names
    if names:
        handles = [
            Line2D([], [], color=c, lw=1.4, label=f"tendon {n}")
            for n, c in zip(names, _cycle(result), strict=True)
        ]
        if _path_is_drawn(result):
            handles.append(Line2D([], [], color=_PATH, lw=0.9, ls=_DASHES, label="path of the tip"))
        figure.legend(handles=handles[:12], **where)


def shapes(result: SequenceResult) -> Figure:
    """Backbone shapes over the load steps, from two sides and in space, with disks and tendons.

    Parameters
    ----------
    result
        With at least one step.

    Returns
    -------
    matplotlib.figure.Figure
    """
    _refuse_empty(result)
    drawn = sorted({*_chosen(len(result.steps), DRAWN_STEPS), *_distinct(result)})
    with rc_context(_STYLE):
        box = _box(result, drawn)
        span = box[:, 1] - box[:, 0]
        ratios = [*(span[:2] / span[2]), max(1.0, 0.85 * float(np.hypot(*span[:2]) / span[2]))]
        figure = Figure(figsize=(min(3.6 * sum(ratios) + 2.6, 16.0), 5.0), layout="constrained")
        grid = figure.add_gridspec(1, 3, width_ratios=ratios)
        colours = _StepColours(result, drawn)
        side = figure.add_subplot(grid[0])
        front = figure.add_subplot(grid[1], sharey=side)
        for axes, i, title in ((side, 0, "Seen along y"), (front, 1, "Seen along x")):
            _planar(axes, result, i, 2, drawn, colours)
            axes.set_xlim(*box[i])
            axes.set_ylim(*box[2])
            axes.set_aspect("equal", adjustable="box")
            axes.set_title(title)
        space = figure.add_subplot(grid[2], projection="3d")
        _spatial(space, result, drawn, colours, box)
        colours.bar(figure, [side, front, space], shrink=0.75, pad=0.02, aspect=28)
        figure.suptitle(f"{result.robot.name}: shapes of the backbone", x=0.01, ha="left", weight="bold")
        _tendon_legend(figure, result, loc="outside lower left", ncols=6)
    return figure


# -------------------------------------------------------------------------------------------------- tensions


def tensions(result: SequenceResult) -> Figure:
    """Tension along every tendon, segment by segment, for steps spread over the sequence.

    Parameters
    ----------
    result
        With at least one step and one tendon.

    Returns
    -------
    matplotlib.figure.Figure
    """
    _refuse_empty(result)
    if not result.robot.tendons:
        raise ValueError("the robot has no tendons whose tension could be drawn")
    drawn = sorted({*_chosen(len(result.steps), 24), *_distinct(result)})
    with rc_context(_STYLE):
        count = len(result.robot.tendons)
        columns = min(count, 3)
        rows = -(-count // columns)
        figure = Figure(figsize=(max(4.4 * columns, 6.8), 3.1 * rows + 1.1), layout="constrained")
        axes = figure.subplots(rows, columns, squeeze=False, sharey=True).ravel()
        colours = _StepColours(result, drawn)
        markers = {"pull": "v", "release": "^", "stick": "o"}
        for j, tendon in enumerate(result.robot.tendons):
            holes = result.robot.hole_arc_lengths(tendon) * _MM
            for n, k in enumerate(drawn):
                values, states = result.steps[k].tensions[j], result.steps[k].hole_states[j]
                axes[j].stairs(values, holes, baseline=None, color=colours(n), lw=1.4)
                for state, marker in markers.items():
                    at = [i for i, x in enumerate(states) if x == state and i + 1 < len(values)]
                    if result.model.friction == "none" or not at:
                        continue
                    between = [(values[i] + values[i + 1]) / 2.0 for i in at]
                    fill = "white" if state == "stick" else colours(n)
                    axes[j].plot(
                        holes[1:][at], between, marker, ms=3.4, mfc=fill, mec=colours(n), mew=0.8, ls="none"
                    )
            axes[j].set_title(f"tendon {tendon.name}")
            axes[j].set_xlabel("arc length s [mm]")
            axes[j].set_xlim(0.0, result.robot.backbone.length * _MM)
            axes[j].set_ylim(bottom=0.0)
        for spare in axes[count:]:
            spare.set_visible(False)
        for left in axes[::columns]:
            left.set_ylabel("tension [N]")
        colours.bar(figure, list(axes[:count]), pad=0.02, aspect=28)
        if result.model.friction != "none":
            names = {"pull": "hole slips, pulled", "release": "hole slips, released", "stick": "hole sticks"}
            handles = [
                Line2D([], [], marker=m, ls="none", ms=4.5, mec="#444444", label=names[s],
                       mfc="white" if s == "stick" else "#444444")
                for s, m in markers.items()
            ]  # fmt: skip
            figure.legend(handles=handles, loc="outside lower left", ncols=3)
        figure.suptitle(f"{result.robot.name}: tension along the tendons", x=0.01, ha="left", weight="bold")
    return figure


# ------------------------------------------------------------------------------------------------ hysteresis


def _driven(result: SequenceResult) -> list[tuple[str, Array, str]]:
    """Tendons whose tension (or, for want of that, displacement) rises and falls: name, values, label."""
    found = []
    for j, name in enumerate(result.robot.tendon_names):
        tension = np.array([s.base_tensions[j] for s in result.steps])
        if _returns(tension):
            found.append((name, tension, f"tension of {name} at the base [N]"))
    return found


def _returns(values: Array) -> bool:
    """Whether values rise and fall by more than a thousandth of their range."""
    changes = np.diff(np.concatenate(([0.0], values)))
    some = 1e-3 * float(np.ptp(np.concatenate(([0.0], values))))
    return bool(np.any(changes > some) and np.any(changes < -some))


def hysteresis(result: SequenceResult) -> Figure | None:
    """Bending angle of the tip over the tension of each tendon that is pulled and released.

    Parameters
    ----------
    result
        With at least one step.

    Returns
    -------
    matplotlib.figure.Figure or None
        None where no tension rises and falls.
    """
    _refuse_empty(result)
    driven = _driven(result)
    if not driven:
        return None
    angle = np.degrees(result.bending_angles)
    with rc_context(_STYLE):
        columns = min(len(driven), 3)
        rows = -(-len(driven) // columns)
        figure = Figure(figsize=(max(4.2 * columns, 6.4), 3.4 * rows + 1.0), layout="constrained")
        axes = figure.subplots(rows, columns, squeeze=False, sharey=True).ravel()
        colours = _StepColours(result, range(len(result.steps)))
        for ax, (name, values, label) in zip(axes, driven, strict=False):
            _branches(ax, values, angle, colours)
            ax.set_title(f"tendon {name}")
            ax.set_xlabel(label)
            ax.set_xlim(left=min(0.0, values.min()))
            ax.set_ylim(bottom=0.0)
        for spare in axes[len(driven) :]:
            spare.set_visible(False)
        for left in axes[::columns]:
            left.set_ylabel("bending angle of the tip [deg]")
        handles = [
            Line2D([], [], color="#444444", lw=1.6, label="pulling"),
            Line2D([], [], color="#444444", lw=1.6, ls=(0, (4, 1.5)), label="releasing"),
            Line2D([], [], color="#444444", lw=1.0, ls=":", label="tension held"),
        ]
        figure.legend(handles=handles, loc="outside lower left", ncols=3)
        colours.bar(figure, list(axes[: len(driven)]), pad=0.02, aspect=28)
        figure.suptitle(f"{result.robot.name}: hysteresis of the tip angle", x=0.01, ha="left", weight="bold")
    return figure


def _branches(axes: Axes, values: Array, angle: Array, colours: _StepColours) -> None:
    """Line from step to step, its style telling pulling, releasing and holding apart."""
    few = len(values) <= 60
    for k in range(1, len(values)):
        change = values[k] - values[k - 1]
        held = abs(change) <= 1e-9 * max(1.0, float(np.abs(values).max()))
        style: Any = ":" if held else "-" if change > 0.0 else (0, (4, 1.5))
        axes.plot(
            values[k - 1 : k + 1], angle[k - 1 : k + 1], color=colours(k), lw=1.0 if held else 1.6, ls=style
        )
        if few and not held:
            middle = (values[k - 1] + values[k]) / 2.0, (angle[k - 1] + angle[k]) / 2.0
            along = 0.51 * values[k - 1] + 0.49 * values[k], 0.51 * angle[k - 1] + 0.49 * angle[k]
            axes.annotate(
                "",
                middle,
                along,
                arrowprops={"arrowstyle": "-|>", "color": colours(k), "lw": 0, "mutation_scale": 11},
            )
    if few:
        axes.scatter(values, angle, s=16, c=[colours(k) for k in range(len(values))], zorder=3, clip_on=False)


# --------------------------------------------------------------------------------------------------- pictures


def _refuse_empty(result: SequenceResult) -> None:
    if not result.steps:
        raise ValueError("no step was solved, so there is nothing to draw")


def _tensions_if_any(result: SequenceResult) -> Figure | None:
    return tensions(result) if result.robot.tendons else None


#: Pictures by file name; None from a function means that it has nothing to show.
PICTURES: dict[str, Callable[[SequenceResult], Figure | None]] = {
    "shapes.png": shapes,
    "tensions.png": _tensions_if_any,
    "hysteresis.png": hysteresis,
}


def save_pictures(result: SequenceResult, out: str | os.PathLike[str], dpi: float = 150.0) -> list[Path]:
    """Draw every picture that the result has something to show in.

    Parameters
    ----------
    result
        Nothing is drawn where it has no steps.
    out
        A directory that exists.
    dpi
        Pixels per inch.

    Returns
    -------
    list of pathlib.Path
        The files.
    """
    written: list[Path] = []
    if not result.steps:
        return written
    for name, draw in PICTURES.items():
        figure = draw(result)
        if figure is not None:
            path = Path(out) / name
            figure.savefig(path, dpi=dpi, facecolor="white")
            written.append(path)
    return written

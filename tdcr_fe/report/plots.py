"""Pictures of a run: shapes of the backbone, tensions along the tendons, hysteresis of the tip angle.

Functions take a `SequenceResult` and return a matplotlib `Figure`; no window opens, and the settings of
matplotlib are left as they were.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import BoundaryNorm, ListedColormap
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator
from mpl_toolkits.mplot3d.art3d import Line3DCollection, Poly3DCollection  # type: ignore[import-untyped]
from numpy.typing import NDArray

from tdcr_fe.model.results import SequenceResult
from tdcr_fe.report.arrows import LoadArrows
from tdcr_fe.report.geometry import (
    DRAWN_STEPS,
    backbone,
    box,
    distinct_steps,
    rims,
    slack,
    spread,
    tendon_line,
)
from tdcr_fe.report.style import styled

Array = NDArray[np.float64]

#: Direction from which the view in space is seen [deg].
_ELEVATION, _AZIMUTH = 22.0, -55.0
_TENDON_COLOURS = (
    "#d1495b", "#00798c", "#e08e1b", "#6a4c93", "#3f784c", "#8d6346",
    "#e377c2", "#2b59c3", "#8fb339", "#17202a", "#35b6c9", "#7f7f7f",
)  # fmt: skip
_PLATE = "#3b3b3b"
_PATH = "#888888"
_DASHES = (0, (2, 2))
_MM = 1e3
#: Heights of a title line and of a row of the legend [inch], and the width of its entries [inch].
_TITLE, _ROW, _ENTRY = 0.32, 0.22, 2.0


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
        ticks = spread(count, 12)
        bar.set_ticks(ticks, labels=[str(self.numbers[i]) for i in ticks])
        bar.minorticks_off()
        bar.set_label("load step")
        bar.outline.set_visible(False)


def _framed(width: float, height: float, title: str, handles: Sequence[Line2D]) -> Figure:
    """A figure with its title above and its legend below the part where axes are laid out [inch]."""
    columns = max(1, min(len(handles), int(width / _ENTRY)))
    rows = -(-len(handles) // columns) if handles else 0
    below = _ROW * rows + (0.12 if rows else 0.0)
    whole = height + _TITLE + below
    figure = Figure(figsize=(width, whole), layout="constrained")
    figure.get_layout_engine().set(rect=(0.0, below / whole, 1.0, height / whole))  # type: ignore[union-attr, call-arg]
    figure.text(0.012, 1.0 - 0.1 / whole, title, ha="left", va="top", weight="bold", size=10.5)
    if handles:
        legend = figure.legend(
            handles=handles, loc="lower left", ncols=columns, bbox_to_anchor=(0.0, 0.0), borderaxespad=0.3
        )
        legend.set_in_layout(False)
    return figure


def _axes_by_tendon(
    count: int, size: tuple[float, float], title: str, label: str, handles: Sequence[Line2D]
) -> tuple[Figure, list[Axes]]:
    """A figure with axes for each of several tendons, three in a row, of least width and height [inch]."""
    columns = min(count, 3)
    rows = -(-count // columns)
    figure = _framed(max(4.0 * columns, size[0]), size[1] * rows + 0.2, title, handles)
    axes = figure.subplots(rows, columns, squeeze=False, sharey=True).ravel()
    for spare in axes[count:]:
        spare.set_visible(False)
    for left in axes[::columns]:
        left.set_ylabel(label)
    return figure, list(axes[:count])


# ---------------------------------------------------------------------------------------------------- shapes


class _Shape(NamedTuple):
    """What is drawn of one load step, in both kinds of views; without disks and tendons only the backbone."""

    curve: Array  # backbone [mm], shape (n, 3)
    rings: list[Array]  # rims of the disks [mm], each of shape (m, 3)
    tendons: list[tuple[Array, str]]  # line [mm], shape (k, 3), and colour of each tendon
    colour: Any  # RGBA of the step
    width: float  # of the backbone's line
    alpha: float


def _drawn_shapes(result: SequenceResult, drawn: list[int], colours: _StepColours) -> Iterator[_Shape]:
    """Shapes of the drawn steps; disks and tendons of a few steps that differ most."""
    detailed = distinct_steps(result)
    for n, k in enumerate(drawn):
        step = result.steps[k]
        curve = backbone(result, step) * _MM
        if k not in detailed:
            yield _Shape(curve, [], [], colours(n), 1.0, 0.7)
            continue
        lines = (tendon_line(result, step, tendon) * _MM for tendon in result.robot.tendons)
        tendons = list(zip(lines, _tendon_colours(result), strict=True))
        yield _Shape(curve, list(rims(result, step)[1:] * _MM), tendons, colours(n), 1.9, 1.0)


class _Shapes:
    """What both kinds of views of a run draw, and the box that they span."""

    def __init__(self, result: SequenceResult, drawn: list[int]) -> None:
        self.result, self.arrows = result, LoadArrows(result)
        self.colours = _StepColours(result, drawn)
        self.shapes = list(_drawn_shapes(result, drawn, self.colours))
        #: The path of the tip from step to step [mm], where it is still readable.
        self.path = result.tips * _MM if 1 < len(result.steps) <= 40 else np.zeros((0, 3))
        #: Box around shapes and load arrows [mm], shape (3, 2).
        self.limits = box(result, drawn) * _MM
        for at, vector, _ in self.arrows.arrows:
            self.limits[:, 0] = np.minimum(self.limits[:, 0], np.minimum(at, at + vector) - 5.0)
            self.limits[:, 1] = np.maximum(self.limits[:, 1], np.maximum(at, at + vector) + 5.0)

    def planar(self, axes: Axes, i: int, j: int) -> None:
        """Project onto the world axes ``i`` and ``j``."""
        for shape in self.shapes:
            fill, edge = ((*shape.colour[:3], alpha) for alpha in (0.3, 0.8))
            for ring in shape.rings:
                axes.fill(ring[:, i], ring[:, j], fc=fill, ec=edge, lw=0.8, zorder=2)
            for line, colour in shape.tendons:
                axes.plot(line[:, i], line[:, j], color=colour, lw=0.9, alpha=0.85, zorder=3)
            curve, look = shape.curve, {"color": shape.colour, "lw": shape.width, "alpha": shape.alpha}
            axes.plot(curve[:, i], curve[:, j], zorder=4, **look)
        plate = 1.6 * self.result.robot.plate_radius * _MM
        axes.plot([-plate, plate], [0.0, 0.0], color=_PLATE, lw=4, solid_capstyle="butt", zorder=5)
        if len(self.path):
            axes.plot(self.path[:, i], self.path[:, j], color=_PATH, lw=0.9, ls=_DASHES, zorder=1)
        axes.set_xlim(*self.limits[i])
        axes.set_ylim(*self.limits[j])
        axes.set_aspect("equal", adjustable="box")
        self.arrows.draw_planar(axes, i, j)
        axes.set_xlabel(f"{'xyz'[i]} [mm]")
        axes.set_ylabel(f"{'xyz'[j]} [mm]")
        axes.xaxis.set_major_locator(MaxNLocator(5, steps=[1, 2, 2.5, 5, 10]))

    def spatial(self, axes: Any) -> None:
        """The shapes in three dimensions, on a 3D axes."""
        for shape in self.shapes:
            if shape.rings:
                face = (*shape.colour[:3], 0.25)
                rings = Poly3DCollection(shape.rings, facecolor=face, edgecolor=shape.colour, lw=0.6)
                axes.add_collection3d(rings)
            for line, colour in shape.tendons:
                axes.add_collection3d(Line3DCollection([line], colors=[colour], lw=0.9, alpha=0.85))
            axes.plot(*shape.curve.T, color=shape.colour, lw=shape.width, alpha=shape.alpha)
        plate = rims(self.result, self.result.steps[0])[0] * _MM * [1.6, 1.6, 1.0]
        axes.add_collection3d(Poly3DCollection([plate], facecolor=_PLATE, edgecolor=_PLATE, alpha=0.8))
        if len(self.path):
            axes.plot(*self.path.T, color=_PATH, lw=0.9, ls=_DASHES)
        self.arrows.draw_spatial(axes, self.free_corner())
        span = self.limits[:, 1] - self.limits[:, 0]
        for name, ends, width in zip("xyz", self.limits, span, strict=True):
            getattr(axes, f"set_{name}lim")(*ends)
            getattr(axes, f"set_{name}label")(f"{name} [mm]", labelpad=6.0)
            getattr(axes, f"{name}axis").set_major_locator(MaxNLocator(4 if width > 0.6 * span.max() else 2))
            getattr(axes, f"{name}axis").pane.set_facecolor("#fafafa")
        axes.tick_params(pad=1.0, labelsize=8.5)
        axes.set_box_aspect(span, zoom=0.95)
        axes.view_init(elev=_ELEVATION, azim=_AZIMUTH)

    def free_corner(self) -> Array:
        """Point near that corner of the box which lies farthest from all backbones where the viewer sees it [mm]."""
        up, turn = np.radians((_ELEVATION, _AZIMUTH))
        right = np.array([-np.sin(turn), np.cos(turn), 0.0])
        above = np.array([-np.sin(up) * np.cos(turn), -np.sin(up) * np.sin(turn), np.cos(up)])
        seen = np.column_stack((right, above))
        ends = self.limits @ [[0.9, 0.1], [0.1, 0.9]]
        corners = np.array(np.meshgrid(*ends, indexing="ij")).reshape(3, -1).T
        points = _MM * np.concatenate([s.positions for s in self.result.steps])
        gaps = np.linalg.norm((points[None] - corners[:, None]) @ seen, axis=2).min(axis=1)
        return np.asarray(corners[int(np.argmax(gaps))])

    def handles(self) -> list[Line2D]:
        """Entries of the legend."""
        names, colours = self.result.robot.tendon_names, _tendon_colours(self.result)
        tendons = list(zip(names, colours, strict=True))[:12]
        handles = [Line2D([], [], color=c, lw=1.4, label=f"tendon {n}") for n, c in tendons]
        if len(self.path):
            handles.append(Line2D([], [], color=_PATH, lw=0.9, ls=_DASHES, label="path of the tip"))
        return [*handles, *self.arrows.legend_handles()]


def _tendon_colours(result: SequenceResult) -> list[str]:
    return [_TENDON_COLOURS[i % len(_TENDON_COLOURS)] for i in range(len(result.robot.tendons))]


def shapes(result: SequenceResult) -> Figure:
    """Backbone shapes over the load steps, from two sides and in space, with disks, tendons, loads and gravity.

    Parameters
    ----------
    result
        With at least one step.

    Returns
    -------
    matplotlib.figure.Figure
    """
    _refuse_empty(result)
    drawn = sorted({*spread(len(result.steps), DRAWN_STEPS), *distinct_steps(result)})
    with styled():
        view = _Shapes(result, drawn)
        span = view.limits[:, 1] - view.limits[:, 0]
        ratios = [*(span[:2] / span[2]), max(1.0, 0.85 * float(np.hypot(*span[:2]) / span[2]))]
        width = min(3.6 * sum(ratios) + 2.6, 16.0)
        figure = _framed(width, 4.5, f"{result.robot.name}: shapes of the backbone", view.handles())
        grid = figure.add_gridspec(1, 3, width_ratios=ratios)
        side = figure.add_subplot(grid[0])
        front = figure.add_subplot(grid[1], sharey=side)
        for axes, i, title in ((side, 0, "Seen along y"), (front, 1, "Seen along x")):
            view.planar(axes, i, 2)
            axes.set_title(title)
        space = figure.add_subplot(grid[2], projection="3d")
        view.spatial(space)
        view.colours.bar(figure, [side, front, space], shrink=0.75, pad=0.02, aspect=28)
    return figure


# -------------------------------------------------------------------------------------------------- tensions

#: Marker of a hole and its legend text, by the state of the hole.
_MARKERS = {
    "pull": ("v", "hole slips, tendon pulled"),
    "release": ("^", "hole slips, tendon released"),
    "stick": ("o", "hole sticks"),
    "slack": ("x", "tendon slack"),
}


def _hole_states(result: SequenceResult, k: int, j: int) -> list[str]:
    """States of the holes of tendon ``j`` in step ``k``; "slack" where no segment at the hole carries tension."""
    step = result.steps[k]
    loose = slack(result, step)[j]
    return [
        "slack" if loose[i] and loose[i + 1] else state
        for i, state in enumerate(step.hole_states[j][: len(loose) - 1])
    ]


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
    drawn = sorted({*spread(len(result.steps), 24), *distinct_steps(result)})
    count = len(result.robot.tendons)
    seen = {
        state
        for k in drawn
        for j in range(count)
        for state in (_hole_states(result, k, j) if result.model.friction != "none" else ())
    }
    handles = [
        Line2D([], [], marker=m, ls="none", ms=4.5, mec="#444444", mfc="white" if s == "stick" else "#444444",
               label=text)
        for s, (m, text) in _MARKERS.items() if s in seen
    ]  # fmt: skip
    with styled():
        title = f"{result.robot.name}: tension along the tendons"
        figure, axes = _axes_by_tendon(count, (6.8, 2.9), title, "tension [N]", handles)
        colours = _StepColours(result, drawn)
        for j in range(count):
            _tension_profile(axes[j], result, j, drawn, colours)
        colours.bar(figure, axes, pad=0.02, aspect=28)
    return figure


def _tension_profile(
    axes: Axes, result: SequenceResult, j: int, drawn: list[int], colours: _StepColours
) -> None:
    """Tension of tendon ``j`` over arc length, with the state of each hole where there is friction."""
    tendon = result.robot.tendons[j]
    holes = result.robot.hole_arc_lengths(tendon) * _MM
    for n, k in enumerate(drawn):
        values = result.steps[k].tensions[j]
        axes.stairs(values, holes, baseline=None, color=colours(n), lw=1.4)
        if result.model.friction == "none":
            continue
        states = _hole_states(result, k, j)
        for state, (marker, _) in _MARKERS.items():
            at = [i for i, x in enumerate(states) if x == state]
            if not at:
                continue
            between = [(values[i] + values[i + 1]) / 2.0 for i in at]
            fill = "white" if state == "stick" else colours(n)
            axes.plot(holes[1:][at], between, marker, ms=3.4, mfc=fill, mec=colours(n), mew=0.8, ls="none",
                  clip_on=False)  # fmt: skip
    if all(slack(result, result.steps[k])[j].all() for k in drawn):
        axes.text(
            0.5, 0.5, "slack in every step drawn", transform=axes.transAxes, ha="center", color="#777777"
        )
    axes.set_title(f"tendon {tendon.name}")
    axes.set_xlabel("arc length s [mm]")
    axes.set_xlim(0.0, result.robot.backbone.length * _MM)
    axes.set_ylim(bottom=0.0)


# ------------------------------------------------------------------------------------------------ hysteresis


def _driven(result: SequenceResult) -> list[tuple[str, Array, str]]:
    """Tendons whose input rises and falls, a displacement [mm] or a tension [N]: name, values, label."""
    found = []
    for j, name in enumerate(result.robot.tendon_names):
        by_displacement = [s.actuation is not None and s.actuation.by_displacement[j] for s in result.steps]
        if any(by_displacement):
            values = np.array([s.displacements[j] for s in result.steps]) * _MM
            label = f"displacement of {name} at the base [mm]"
        else:
            values = np.array([s.base_tensions[j] for s in result.steps])
            label = f"tension of {name} at the base [N]"
        if _returns(values):
            found.append((name, values, label))
    return found


def _returns(values: Array) -> bool:
    """Whether values rise and fall by more than a thousandth of their range."""
    from_zero = np.concatenate(([0.0], values))
    changes, least = np.diff(from_zero), 1e-3 * float(np.ptp(from_zero))
    return bool(np.any(changes > least) and np.any(changes < -least))


def hysteresis(result: SequenceResult) -> Figure | None:
    """Bending angle of the tip over the input (tension or displacement) of each tendon pulled and released.

    Parameters
    ----------
    result
        With at least one step.

    Returns
    -------
    matplotlib.figure.Figure or None
        None where no input rises and falls.
    """
    _refuse_empty(result)
    driven = _driven(result)
    if not driven:
        return None
    angle = np.degrees(result.bending_angles)
    handles = [
        Line2D([], [], color="#444444", lw=1.6, label="pulled"),
        Line2D([], [], color="#444444", lw=1.6, ls=(0, (4, 1.5)), label="released"),
        Line2D([], [], color="#444444", lw=1.0, ls=":", label="input held constant"),
    ]
    with styled():
        title = f"{result.robot.name}: hysteresis of the tip angle"
        figure, axes = _axes_by_tendon(
            len(driven), (6.4, 3.2), title, "bending angle of the tip [deg]", handles
        )
        colours = _StepColours(result, range(len(result.steps)))
        for ax, (name, values, label) in zip(axes, driven, strict=True):
            _branches(ax, values, angle, colours)
            ax.set_title(f"tendon {name}")
            ax.set_xlabel(label)
            low, high = min(0.0, float(values.min())), max(0.0, float(values.max()))
            ax.set_xlim(low - (0.04 * (high - low) if low < 0.0 else 0.0), high + 0.04 * (high - low))
            ax.set_ylim(bottom=0.0)
        colours.bar(figure, axes, pad=0.02, aspect=28)
    return figure


def _branches(axes: Axes, values: Array, angle: Array, colours: _StepColours) -> None:
    """Line from step to step; its style distinguishes pulled, released and held constant."""
    few = len(values) <= 60
    for k in range(1, len(values)):
        change = values[k] - values[k - 1]
        constant = abs(change) <= 1e-9 * max(1.0, float(np.abs(values).max()))
        style: Any = ":" if constant else "-" if change > 0.0 else (0, (4, 1.5))
        axes.plot(
            values[k - 1 : k + 1],
            angle[k - 1 : k + 1],
            color=colours(k),
            lw=1.0 if constant else 1.6,
            ls=style,
        )
        if few and not constant:
            middle = (values[k - 1] + values[k]) / 2.0, (angle[k - 1] + angle[k]) / 2.0
            before = 0.51 * values[k - 1] + 0.49 * values[k], 0.51 * angle[k - 1] + 0.49 * angle[k]
            head = {"arrowstyle": "-|>", "color": colours(k), "lw": 0, "mutation_scale": 11}
            axes.annotate("", middle, before, arrowprops=head)
    if few:
        axes.scatter(values, angle, s=16, c=[colours(k) for k in range(len(values))], zorder=3, clip_on=False)


# --------------------------------------------------------------------------------------------------- pictures


def _refuse_empty(result: SequenceResult) -> None:
    if not result.steps:
        raise ValueError("no step was solved, so there is nothing to draw")


def _tensions_if_any(result: SequenceResult) -> Figure | None:
    return tensions(result) if result.robot.tendons else None


#: Pictures by file name; a function returns None where there is nothing to draw.
PICTURES: dict[str, Callable[[SequenceResult], Figure | None]] = {
    "shapes.png": shapes,
    "tensions.png": _tensions_if_any,
    "hysteresis.png": hysteresis,
}


def save_pictures(result: SequenceResult, out: str | os.PathLike[str], dpi: float = 150.0) -> list[Path]:
    """Draw every picture for which the result has data.

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

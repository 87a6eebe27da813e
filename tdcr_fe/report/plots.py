"""Pictures of a run: shapes of the backbone, tensions along the tendons, hysteresis of the tip angle.

Functions take a `SequenceResult` and return a matplotlib `Figure`; no window opens, and the settings of
matplotlib are left as they were.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

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

from tdcr_fe.elements import Array
from tdcr_fe.model.results import SequenceResult
from tdcr_fe.report.environment import quantity
from tdcr_fe.report.motion import MM, Motion, motion_of, spread
from tdcr_fe.report.style import space, styled
from tdcr_fe.report.viewer import SLACK, STATES, hole_codes

FORCE, MOMENT, GRAVITY = "#b3001b", "#7a1fa2", "#555555"
#: Length of the arrow of the largest load, over the length of the backbone [1].
LONGEST = 0.2
#: An arrow that points at the viewer is drawn as a circle where its projection is below this part of it [1].
END_ON = 0.15


def free_corner(limits: Array, points: Array) -> Array:
    """Point near the corner of a rectangle or box, of limits of shape (d, 2), that is farthest from points (n, d)."""
    ends = limits @ [[0.88, 0.12], [0.12, 0.88]]
    corners = np.stack(np.meshgrid(*ends), axis=-1).reshape(-1, len(ends))
    gaps = np.linalg.norm(points - corners[:, None], axis=2).min(axis=1)
    return np.asarray(corners[int(np.argmax(gaps))])


class LoadArrows:
    """Arrows of the loads of those steps of a motion that are drawn (from 0), and of gravity.

    The largest force and the largest moment of these steps have arrows of equal length.
    """

    def __init__(self, motion: Motion, drawn: Sequence[int]) -> None:
        self.motion, self.gravity = motion, motion.gravity
        #: Largest moment [N m] and force [N]; zero where there is none.
        self.largest = motion.largest_loads(drawn)
        length = LONGEST * motion.length * MM
        #: Where each begins and its vector [mm], and whether it is a moment.
        self.arrows = [
            (place * MM, vector * (length / self.largest[moment]), moment)
            for k in drawn
            for _, place, vector, moment in motion.load_arrows(k)
        ]

    def draw_planar(self, axes: Axes, i: int, j: int) -> None:
        """Draw them in a projection onto the world axes ``i`` and ``j``; a moment has two heads along its axis."""
        plane = [i, j]
        for start, vector, moment in self.arrows:
            heads = (1.0, 0.82) if moment else (1.0,)
            _planar_arrow(axes, plane, start, vector, MOMENT if moment else FORCE, heads)
        if np.any(self.gravity):  # in the corner that is farthest from the robot
            limits, place = np.array([axes.get_xlim(), axes.get_ylim()]), np.zeros(3)
            place[plane] = free_corner(limits, MM * self.motion.positions.reshape(-1, 3)[:, plane])
            direction = 0.09 * np.ptp(limits[1]) * self.gravity / np.linalg.norm(self.gravity)
            _planar_arrow(axes, plane, place - direction / 2.0, direction, GRAVITY)
            text: dict[str, Any] = {"textcoords": "offset points", "color": GRAVITY, "va": "bottom"}
            axes.annotate("g", tuple(place[plane]), xytext=(7, 3), style="italic", **text)

    def draw_spatial(self, axes: Any, corner: Array) -> None:
        """The same in three dimensions; gravity at ``corner`` [mm]."""
        for start, vector, moment in self.arrows:
            axes.quiver(*start, *vector, color=MOMENT if moment else FORCE, lw=1.4, arrow_length_ratio=0.25)
        if np.any(self.gravity):
            length = 0.12 * self.motion.length * MM
            direction = length * self.gravity / np.linalg.norm(self.gravity)
            axes.quiver(*corner, *direction, color=GRAVITY, lw=1.4, arrow_length_ratio=0.3)
            axes.text(*(corner + 0.5 * direction), " g", color=GRAVITY, style="italic", va="bottom")

    def legend_handles(self) -> Iterator[Line2D]:
        """Legend entries of the arrows; the text includes the largest value of each kind."""
        for size, colour, text, unit in (
            (self.largest[False], FORCE, "force (longest arrow: {})", "N"),
            (self.largest[True], MOMENT, "moment (two heads; longest arrow: {})", "N m"),
            (float(np.linalg.norm(self.gravity)), GRAVITY, "gravity {}", "m/s^2"),
        ):
            if size:
                label = text.format(quantity(size, unit))
                yield Line2D([], [], color=colour, marker=">", markevery=[1], ms=5, lw=1.5, label=label)


def _planar_arrow(
    axes: Axes, plane: list[int], start: Array, vector: Array, colour: str, heads: tuple[float, ...] = (1.0,)
) -> None:
    """An arrow [mm] in a projection onto two world axes; a circle where it is seen end on.

    It has heads at parts of its length.
    """
    place, flat = start[plane], vector[plane]
    if np.linalg.norm(flat) < END_ON * np.linalg.norm(vector):
        # The viewer looks along +y where x points right, and along -x where y points right.
        away = (vector[1] if plane[0] == 0 else -vector[0]) > 0.0
        axes.plot(*place, "o", ms=7, mfc="white", mec=colour, mew=1.2, zorder=6)
        axes.plot(*place, "x" if away else ".", ms=4, color=colour, zorder=7)
        return
    look = {"arrowstyle": "-|>", "color": colour, "lw": 1.5, "shrinkA": 0, "shrinkB": 0}
    above: dict[str, Any] = {"arrowprops": {**look, "mutation_scale": 10}, "zorder": 6}
    for reach in heads:
        axes.annotate("", tuple(place + reach * flat), tuple(place), annotation_clip=False, **above)
    axes.update_datalim((place + flat)[None, :])


#: Number of steps whose shape is drawn: more hide each other.
DRAWN_STEPS = 5
_TENDON_COLOURS = (
    "#d1495b", "#00798c", "#e08e1b", "#6a4c93", "#3f784c", "#8d6346",
    "#e377c2", "#2b59c3", "#8fb339", "#17202a", "#35b6c9", "#7f7f7f",
)  # fmt: skip
_PLATE = "#3b3b3b"
_PATH = "#888888"
_DASHES = (0, (2, 2))
#: Heights of a title line and of a row of the legend [inch], and the width of its entries [inch].
_TITLE, _ROW, _ENTRY = 0.32, 0.22, 2.0


class _StepColours:
    """A colour for each step, and the bar that explains them; without the map's end that fades on white."""

    def __init__(self, steps: Sequence[int], drawn: Sequence[int]) -> None:
        self.numbers = [steps[k] for k in drawn]
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
    rows = -(-len(handles) // columns)
    figure = Figure(figsize=(width, height + _TITLE + _ROW * rows), layout="constrained")
    figure.suptitle(title, x=0.012, ha="left", weight="bold", size=10.5)
    if handles:
        figure.legend(handles=handles, ncols=columns, loc="outside lower left")
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


class _Shapes:
    """What all views of a run draw, and the box that they span: the steps that differ most, and the tip's path."""

    def __init__(self, motion: Motion) -> None:
        self.motion, self.drawn = motion, motion.distinct_steps(DRAWN_STEPS)
        self.arrows = LoadArrows(motion, self.drawn)
        self.colours = _StepColours(motion.steps, self.drawn)
        self.tendon_colours = [_TENDON_COLOURS[j % len(_TENDON_COLOURS)] for j in range(len(motion.tendons))]
        #: The path of the tip from step to step [mm], where it is still readable.
        self.path = motion.tips * MM if 1 < len(motion.steps) <= 40 else np.zeros((0, 3))
        self.curves = [motion.curve(k) * MM for k in self.drawn]
        points = np.concatenate([*self.curves, self.path, np.zeros((1, 3))])
        around = 2.0 * motion.disk_radius * MM
        low, high = points.min(axis=0) - around, points.max(axis=0) + around
        # No side is slim.
        wider = np.maximum(0.45 * (high - low).max() - (high - low), 0.0) / 2.0
        low, high = low - wider, high + wider
        for place, vector, _ in self.arrows.arrows:
            low = np.minimum(low, np.minimum(place, place + vector) - 5.0)
            high = np.maximum(high, np.maximum(place, place + vector) + 5.0)
        #: Box around shapes and load arrows [mm], shape (3, 2).
        self.limits = np.stack((low, high), axis=1)

    def tendons(self, k: int) -> Iterator[tuple[Array, str]]:
        """Line [mm] and colour of every tendon in a step (from 0)."""
        for tendon, colour in zip(self.motion.tendons, self.tendon_colours, strict=True):
            yield self.motion.tendon_points(k, tendon) * MM, colour

    def planar(self, axes: Axes, i: int, j: int) -> None:
        """Project onto the world axes ``i`` and ``j``."""
        for n, k in enumerate(self.drawn):
            colour = self.colours(n)
            for ring in self.motion.rims(k) * MM:
                fill, edge = ((*colour[:3], alpha) for alpha in (0.3, 0.8))
                axes.fill(ring[:, i], ring[:, j], fc=fill, ec=edge, lw=0.8, zorder=2)
            for line, tendon in self.tendons(k):
                axes.plot(line[:, i], line[:, j], color=tendon, lw=0.9, alpha=0.85, zorder=3)
            axes.plot(self.curves[n][:, i], self.curves[n][:, j], color=colour, lw=1.9, zorder=4)
        plate = self.motion.plate[:, 0] * MM
        axes.plot([plate.min(), plate.max()], [0.0, 0.0], color=_PLATE, lw=4, solid_capstyle="butt", zorder=5)
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
        space(axes, self.limits, "mm")
        for n, k in enumerate(self.drawn):
            colour = self.colours(n)
            rings = list(self.motion.rims(k) * MM)
            if rings:
                face = (*colour[:3], 0.25)
                axes.add_collection3d(Poly3DCollection(rings, facecolor=face, edgecolor=colour, lw=0.6))
            for line, tendon in self.tendons(k):
                axes.add_collection3d(Line3DCollection([line], colors=[tendon], lw=0.9, alpha=0.85))
            axes.plot(*self.curves[n].T, color=colour, lw=1.9)
        plate = Poly3DCollection([self.motion.plate * MM], facecolor=_PLATE, edgecolor=_PLATE, alpha=0.8)
        axes.add_collection3d(plate)
        if len(self.path):
            axes.plot(*self.path.T, color=_PATH, lw=0.9, ls=_DASHES)
        self.arrows.draw_spatial(axes, free_corner(self.limits, np.concatenate(self.curves)))

    def handles(self) -> list[Line2D]:
        """Entries of the legend."""
        tendons = list(zip(self.motion.tendons, self.tendon_colours, strict=True))[:12]
        handles = [Line2D([], [], color=c, lw=1.4, label=f"tendon {t.name}") for t, c in tendons]
        if len(self.path):
            handles.append(Line2D([], [], color=_PATH, lw=0.9, ls=_DASHES, label="path of the tip"))
        return [*handles, *self.arrows.legend_handles()]


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
    with styled():
        view = _Shapes(motion_of(result))
        span = view.limits[:, 1] - view.limits[:, 0]
        ratios = [max(1.2, 1.1 * float(np.hypot(*span[:2]) / span[2])), *(span[:2] / span[2])]
        width = min(3.6 * sum(ratios) + 2.6, 16.0)
        figure = _framed(width, 4.5, f"{result.robot.name}: shapes of the backbone", view.handles())
        grid = figure.add_gridspec(1, 3, width_ratios=ratios)
        whole = figure.add_subplot(grid[0], projection="3d")
        view.spatial(whole)
        side = figure.add_subplot(grid[1])
        front = figure.add_subplot(grid[2], sharey=side)
        for axes, i, title in ((side, 0, "Seen along y"), (front, 1, "Seen along x")):
            view.planar(axes, i, 2)
            axes.set_title(title)
        view.colours.bar(figure, [whole, side, front], shrink=0.75, pad=0.02, aspect=28)
        whole.set_anchor("C")  # the bar moves it to the right, where its labels lay on those of the next view
    return figure


# -------------------------------------------------------------------------------------------------- tensions

#: Marker of a hole and its legend text, by the state of the hole.
_MARKERS = {
    "pull": ("v", "hole slips, tendon pulled"),
    "release": ("^", "hole slips, tendon released"),
    "stick": ("o", "hole sticks"),
    "slack": ("x", "tendon slack"),
}


def tensions(result: SequenceResult) -> Figure | None:
    """Tension along every tendon, segment by segment, for steps spread over the sequence.

    Parameters
    ----------
    result
        With at least one step.

    Returns
    -------
    matplotlib.figure.Figure or None
        None where there are no tendons.
    """
    motion = motion_of(result)
    if not motion.tendons:
        return None
    drawn = sorted({*spread(len(motion.steps), 24), *motion.distinct_steps(DRAWN_STEPS)})
    # States of the holes between base and anchor, by tendon, of shape (n_steps, n_holes).
    states = [np.array(STATES)[codes[:, :-1]] for codes in hole_codes(motion)]
    seen = {s for by_step in states for s in by_step[drawn].ravel()} if motion.friction else set()
    handles = [
        Line2D([], [], marker=m, ls="none", ms=4.5, mec="#444444", mfc="white" if s == "stick" else "#444444",
               label=text)
        for s, (m, text) in _MARKERS.items() if s in seen
    ]  # fmt: skip
    with styled():
        title = f"{motion.name}: tension along the tendons"
        figure, axes = _axes_by_tendon(len(motion.tendons), (6.8, 2.9), title, "tension [N]", handles)
        colours = _StepColours(motion.steps, drawn)
        for ax, tendon, tensions, by_step in zip(
            axes, result.robot.tendons, motion.tensions, states, strict=True
        ):
            holes = result.robot.hole_arc_lengths(tendon) * MM
            for n, k in enumerate(drawn):
                ax.stairs(tensions[k], holes, baseline=None, color=colours(n), lw=1.4)
                if motion.friction:
                    _mark_holes(ax, holes[1:-1], tensions[k], by_step[k], colours(n))
            if np.all(tensions[drawn] <= SLACK * motion.largest_tension):
                look: Any = {"transform": ax.transAxes, "ha": "center", "color": "#777777"}
                ax.text(0.5, 0.5, "slack in every step drawn", **look)
            ax.set_title(f"tendon {tendon.name}")
            ax.set_xlabel("arc length s [mm]")
            ax.set_xlim(0.0, motion.length * MM)
        axes[0].set_ylim(bottom=0.0)  # of all, when all are drawn: it ends the search for limits
        colours.bar(figure, axes, pad=0.02, aspect=28)
    return figure


def _mark_holes(axes: Axes, holes: Array, tensions: Array, states: NDArray[np.str_], colour: Any) -> None:
    """Markers of the states of a tendon's holes, halfway between the tensions on both sides."""
    between = (tensions[:-1] + tensions[1:]) / 2.0
    for state, (marker, _) in _MARKERS.items():
        marked = states == state
        if marked.any():
            fill = "white" if state == "stick" else colour
            look: dict[str, Any] = {"ms": 3.4, "mfc": fill, "mec": colour, "mew": 0.8, "clip_on": False}
            axes.plot(holes[marked], between[marked], marker, **look)


# ------------------------------------------------------------------------------------------------ hysteresis


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
    motion = motion_of(result)
    driven = [of_tendon for of_tendon in motion.inputs() if _returns(of_tendon[1])]
    if not driven:
        return None
    angle = np.degrees(motion.bending_angles)
    handles = [
        Line2D([], [], color="#444444", lw=1.6, label="pulled"),
        Line2D([], [], color="#444444", lw=1.6, ls=(0, (4, 1.5)), label="released"),
        Line2D([], [], color="#444444", lw=1.0, ls=":", label="input held constant"),
    ]
    with styled():
        title, up = f"{motion.name}: hysteresis of the tip angle", "bending angle of the tip [deg]"
        figure, axes = _axes_by_tendon(len(driven), (6.4, 3.2), title, up, handles)
        colours = _StepColours(motion.steps, range(len(motion.steps)))
        for ax, (name, values, label) in zip(axes, driven, strict=True):
            _branches(ax, values, angle, colours)
            ax.set_title(f"tendon {name}")
            ax.set_xlabel(label)
            low, high = min(0.0, float(values.min())), max(0.0, float(values.max()))
            ax.set_xlim(low - (0.04 * (high - low) if low < 0.0 else 0.0), high + 0.04 * (high - low))
        axes[0].set_ylim(bottom=0.0)
        colours.bar(figure, axes, pad=0.02, aspect=28)
    return figure


def _branches(axes: Axes, values: Array, angle: Array, colours: _StepColours) -> None:
    """Line from step to step; its style distinguishes pulled, released and held constant."""
    few = len(values) <= 60
    for k in range(1, len(values)):
        change = values[k] - values[k - 1]
        constant = abs(change) <= 1e-9 * max(1.0, float(np.abs(values).max()))
        style: Any = ":" if constant else "-" if change > 0.0 else (0, (4, 1.5))
        look = {"color": colours(k), "lw": 1.0 if constant else 1.6, "ls": style}
        axes.plot(values[k - 1 : k + 1], angle[k - 1 : k + 1], **look)
        if few and not constant:
            middle = (values[k - 1] + values[k]) / 2.0, (angle[k - 1] + angle[k]) / 2.0
            before = 0.51 * values[k - 1] + 0.49 * values[k], 0.51 * angle[k - 1] + 0.49 * angle[k]
            head = {"arrowstyle": "-|>", "color": colours(k), "lw": 0, "mutation_scale": 11}
            axes.annotate("", middle, before, arrowprops=head)
    if few:
        axes.scatter(values, angle, s=16, c=[colours(k) for k in range(len(values))], zorder=3, clip_on=False)


# --------------------------------------------------------------------------------------------------- pictures


#: Pictures by file name; a function returns None where there is nothing to draw.
PICTURES: dict[str, Callable[[SequenceResult], Figure | None]] = {
    "shapes.png": shapes,
    "tensions.png": tensions,
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
    for name, draw in PICTURES.items() if result.steps else ():
        if (figure := draw(result)) is not None:
            written.append(Path(out) / name)
            figure.savefig(written[-1], dpi=dpi, facecolor="white")
    return written

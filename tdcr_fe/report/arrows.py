"""Loads and gravity in pictures of a run: arrows to scale, seen from the side and in space."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from numpy.typing import NDArray

from tdcr_fe.model.results import SequenceResult, StepResult
from tdcr_fe.report.environment import quantity
from tdcr_fe.report.geometry import load_vectors

Array = NDArray[np.float64]

FORCE, MOMENT, GRAVITY = "#b3001b", "#7a1fa2", "#555555"
#: Length of the arrow of the largest load, over the length of the backbone [1].
LONGEST = 0.2
#: An arrow that points at the viewer is drawn as a circle where its projection is below this part of it [1].
END_ON = 0.15
_MM = 1e3


@dataclass(frozen=True)
class Scale:
    """Scales of load arrows.

    Attributes
    ----------
    force, moment : float
        Length of an arrow over its size [mm/N, mm/(N m)]; zero where there is no such load.
    largest_force, largest_moment : float
        [N, N m].
    """

    force: float
    moment: float
    largest_force: float
    largest_moment: float


def scale_of(result: SequenceResult, detailed: Sequence[int]) -> Scale:
    """Scale by which the largest force and the largest moment of the steps drawn get arrows of equal length."""
    found = [v for k in detailed for v in load_vectors(result.steps[k])]
    force = max((float(np.linalg.norm(v.vector)) for v in found if not v.moment), default=0.0)
    moment = max((float(np.linalg.norm(v.vector)) for v in found if v.moment), default=0.0)
    length = LONGEST * result.robot.backbone.length * _MM
    return Scale(length / force if force else 0.0, length / moment if moment else 0.0, force, moment)


def ends(step: StepResult, scale: Scale) -> list[tuple[Array, Array]]:
    """Start and end of every load arrow of a step [mm]."""
    factors = {True: scale.moment, False: scale.force}
    return [(v.at * _MM, v.at * _MM + v.vector * factors[v.moment]) for v in load_vectors(step)]


def _arrow(axes: Axes, start: Array, vector: Array, i: int, j: int, colour: str, double: bool) -> None:
    """One arrow in a projection onto the world axes ``i`` and ``j`` [mm]; a circle where it is seen end on."""
    flat = vector[[i, j]]
    if np.linalg.norm(flat) < END_ON * np.linalg.norm(vector):
        # The viewer looks along +y where x points right, and along -x where y points right.
        away = (vector[1] if i == 0 else -vector[0]) > 0.0
        axes.plot(*start[[i, j]], "o", ms=7, mfc="white", mec=colour, mew=1.2, zorder=6)
        axes.plot(*start[[i, j]], "x" if away else ".", ms=4, color=colour, zorder=7)
        return
    end = start[[i, j]] + flat
    for reach in (1.0, 0.82) if double else (1.0,):
        axes.annotate(
            "",
            tuple(start[[i, j]] + reach * flat),
            tuple(start[[i, j]]),
            arrowprops={"arrowstyle": "-|>", "color": colour, "lw": 1.5, "shrinkA": 0, "shrinkB": 0,
                        "mutation_scale": 10},
            zorder=6,
            annotation_clip=False,
        )  # fmt: skip
    axes.update_datalim(end[None, :])


def draw_loads(
    axes: Axes, result: SequenceResult, detailed: Sequence[int], i: int, j: int, scale: Scale
) -> None:
    """Arrows of all loads of the steps drawn in detail; a moment has two heads along its axis."""
    for k in detailed:
        for v in load_vectors(result.steps[k]):
            factor = scale.moment if v.moment else scale.force
            _arrow(axes, v.at * _MM, v.vector * factor, i, j, MOMENT if v.moment else FORCE, v.moment)


def draw_gravity(axes: Axes, result: SequenceResult, i: int, j: int) -> None:
    """An arrow in the emptiest corner that shows the direction of gravity, where there is any."""
    gravity = np.array(result.model.gravity)
    if not np.any(gravity):
        return
    (left, right), (bottom, top) = axes.get_xlim(), axes.get_ylim()
    points = _MM * np.concatenate([s.positions for s in result.steps])[:, [i, j]]
    corners = np.array(
        [(left + x * (right - left), bottom + y * (top - bottom)) for x in (0.13, 0.87) for y in (0.12, 0.88)]
    )
    gaps = np.min(np.linalg.norm(points[None] - corners[:, None], axis=2), axis=1)
    at = np.zeros(3)
    at[[i, j]] = corners[int(np.argmax(gaps))]
    direction = 0.09 * (top - bottom) * gravity / np.linalg.norm(gravity)
    _arrow(axes, at - direction / 2.0, direction, i, j, GRAVITY, double=False)
    axes.annotate(
        "g",
        tuple(at[[i, j]]),
        xytext=(7, 5),
        textcoords="offset points",
        color=GRAVITY,
        va="center",
        style="italic",
    )


def draw_spatial(
    axes: Any, result: SequenceResult, detailed: Sequence[int], scale: Scale, corner: Array
) -> None:
    """The same in three dimensions; gravity at ``corner`` [mm]."""
    for k in detailed:
        for v in load_vectors(result.steps[k]):
            vector = v.vector * (scale.moment if v.moment else scale.force)
            colour = MOMENT if v.moment else FORCE
            axes.quiver(*(v.at * _MM), *vector, color=colour, lw=1.4, arrow_length_ratio=0.25)
    gravity = np.array(result.model.gravity)
    if np.any(gravity):
        direction = 0.12 * result.robot.backbone.length * _MM * gravity / np.linalg.norm(gravity)
        axes.quiver(*corner, *direction, color=GRAVITY, lw=1.4, arrow_length_ratio=0.3)
        axes.text(*(corner + 0.5 * direction), " g", color=GRAVITY, style="italic")


def legend_handles(result: SequenceResult, scale: Scale) -> list[Line2D]:
    """Legend entries of the arrows; the text includes the largest value of each kind."""
    handles = []
    for size, colour, text, unit in (
        (scale.largest_force, FORCE, "force (longest arrow:", "N"),
        (scale.largest_moment, MOMENT, "moment (two heads; longest arrow:", "N m"),
    ):
        if size:
            label = f"{text} {quantity(size, unit)})"
            handles.append(Line2D([], [], color=colour, marker=">", markevery=[1], ms=5, lw=1.5, label=label))
    gravity = float(np.linalg.norm(result.model.gravity))
    if gravity:
        label = f"gravity {quantity(gravity, 'm/s^2')}"
        handles.append(Line2D([], [], color=GRAVITY, marker=">", ms=5, lw=1.5, label=label))
    return handles

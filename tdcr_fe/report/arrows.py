"""Loads and gravity in pictures of a run: arrows to scale, seen from the side and in space."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from tdcr_fe.elements import Array
from tdcr_fe.report.environment import quantity
from tdcr_fe.report.motion import MM, Motion

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
        plane = _Plane(axes, i, j)
        for start, vector, moment in self.arrows:
            plane.arrow(start, vector, MOMENT if moment else FORCE, (1.0, 0.82) if moment else (1.0,))
        if np.any(self.gravity):
            plane.gravity(self.gravity, MM * self.motion.positions.reshape(-1, 3))

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


class _Plane(NamedTuple):
    """A projection onto two world axes."""

    axes: Axes
    i: int
    j: int

    def arrow(self, start: Array, vector: Array, colour: str, heads: tuple[float, ...] = (1.0,)) -> None:
        """One arrow [mm] with heads at parts of its length; a circle where it is seen end on."""
        axes, plane = self.axes, [self.i, self.j]
        place, flat = start[plane], vector[plane]
        if np.linalg.norm(flat) < END_ON * np.linalg.norm(vector):
            # The viewer looks along +y where x points right, and along -x where y points right.
            away = (vector[1] if self.i == 0 else -vector[0]) > 0.0
            axes.plot(*place, "o", ms=7, mfc="white", mec=colour, mew=1.2, zorder=6)
            axes.plot(*place, "x" if away else ".", ms=4, color=colour, zorder=7)
            return
        look = {"arrowstyle": "-|>", "color": colour, "lw": 1.5, "shrinkA": 0, "shrinkB": 0}
        above: dict[str, Any] = {"arrowprops": {**look, "mutation_scale": 10}, "zorder": 6}
        for reach in heads:
            axes.annotate("", tuple(place + reach * flat), tuple(place), annotation_clip=False, **above)
        axes.update_datalim((place + flat)[None, :])

    def gravity(self, gravity: Array, points: Array) -> None:
        """An arrow in the direction of gravity in the corner that is farthest from points of the robot [mm]."""
        limits, plane = np.array([self.axes.get_xlim(), self.axes.get_ylim()]), [self.i, self.j]
        place = np.zeros(3)
        place[plane] = free_corner(limits, points[:, plane])
        direction = 0.09 * np.ptp(limits[1]) * gravity / np.linalg.norm(gravity)
        self.arrow(place - direction / 2.0, direction, GRAVITY)
        text: dict[str, Any] = {"textcoords": "offset points", "color": GRAVITY, "va": "bottom"}
        self.axes.annotate("g", tuple(place[plane]), xytext=(7, 3), style="italic", **text)

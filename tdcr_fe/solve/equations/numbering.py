"""Order of the unknowns: reduced scene, then tensions of tendons with prescribed displacement, then mobilisations."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tdcr_fe.elements.actuation import TendonActuation

Array = NDArray[np.float64]


class RobotUnknowns(NamedTuple):
    """Positions of one robot's unknowns.

    Attributes
    ----------
    robot : int
        Its number.
    nodes : slice
        Body-frame increments of its nodes.
    driven : ndarray of int
        Its tendons whose displacement is prescribed.
    tensions : slice
        Their tensions at the base.
    frictional : ndarray of bool, shape (m, g)
        Which of its mobilisations are unknowns.
    mobilisations : slice
        Where these are.
    adhesive : ndarray of bool, shape (m,)
        Whose holes have adhesion, which may hold them under tension while they are slack at the base.
    """

    robot: int
    nodes: slice
    driven: NDArray[np.int_]
    tensions: slice
    frictional: NDArray[np.bool_]
    mobilisations: slice
    adhesive: NDArray[np.bool_]

    @property
    def has_friction(self) -> bool:
        """Whether friction acts in this robot."""
        return self.mobilisations.stop > self.mobilisations.start

    def may_be_tense(self, base_tension: Array) -> NDArray[np.bool_]:
        """Which tendons are under tension somewhere, or may be, at tensions at the base [N], shape (m,)."""
        return (base_tension > 0.0) | self.adhesive


class Numbering(NamedTuple):
    """Order of all unknowns of a scene.

    Attributes
    ----------
    robots : tuple of RobotUnknowns
    reduced : int
        Unknowns of the reduced scene.
    linear : int
        Unknowns that equilibrium is linear in at fixed friction: the former and the tensions.
    total : int
        All, mobilisations included.
    """

    robots: tuple[RobotUnknowns, ...]
    reduced: int
    linear: int
    total: int

    @classmethod
    def of(cls, robots: Sequence[TendonActuation], nodes: Sequence[slice], reduced: int) -> Numbering:
        """Number the unknowns of a scene.

        Parameters
        ----------
        robots
            All robots.
        nodes
            By robot, its nodes among those of all robots.
        reduced
            Unknowns of the reduced scene.
        """
        driven = [np.flatnonzero(r.by_displacement) for r in robots]
        linear = reduced + sum(d.size for d in driven)
        parts, tension, hole = [], reduced, linear
        for i, (robot, own) in enumerate(zip(robots, nodes, strict=True)):
            frictional = robot.law.frictional
            tensions = slice(tension, tension + driven[i].size)
            holes = slice(hole, hole + (int(np.count_nonzero(frictional)) if robot.law.has_friction else 0))
            inside = slice(6 * own.start, 6 * own.stop)
            adhesive = np.any(robot.law.parameters.adhesion > 0.0, axis=1)
            parts.append(RobotUnknowns(i, inside, driven[i], tensions, frictional, holes, adhesive))
            tension, hole = tensions.stop, holes.stop
        return cls(tuple(parts), reduced, linear, hole)

    def without_friction(self) -> Numbering:
        """The same with no mobilisation among the unknowns."""
        none = slice(self.linear, self.linear)
        robots = tuple([part._replace(mobilisations=none) for part in self.robots])
        return Numbering(robots, self.reduced, self.linear, self.linear)

    @property
    def has_friction(self) -> bool:
        """Whether friction acts anywhere."""
        return self.total > self.linear

    def at_frictional_holes(self, by_robot: Sequence[Array]) -> Array:
        """Values at the holes whose mobilisations are unknowns, of all robots one after the other, shape (k,).

        Parameters
        ----------
        by_robot
            At all holes, shape (m, g).
        """
        parts = [by_robot[p.robot][p.frictional] for p in self.robots if p.has_friction]
        return parts[0] if len(parts) == 1 else np.concatenate(parts)

    def with_frictional_holes(self, by_robot: Sequence[Array], values: Array) -> tuple[Array, ...]:
        """The inverse of `at_frictional_holes`: values at all holes with those at the frictional ones replaced.

        Parameters
        ----------
        by_robot
            At all holes, shape (m, g); unchanged.
        values
            At the frictional ones, of all robots one after the other, shape (k,).
        """
        found, first = list(by_robot), 0
        for part in self.robots:
            if not part.has_friction:
                continue
            last = first + int(np.count_nonzero(part.frictional))
            new = by_robot[part.robot].copy()
            new[part.frictional] = values[first:last]
            found[part.robot], first = new, last
        return tuple(found)

    @property
    def any_driven(self) -> bool:
        """Whether the displacement of any tendon is prescribed."""
        return self.linear > self.reduced

    def same_unknowns(self, other: Numbering) -> bool:
        """Whether another numbering has the same unknowns in the same order."""
        return (self.reduced, self.linear, self.total) == (other.reduced, other.linear, other.total) and all(
            np.array_equal(a.driven, b.driven) for a, b in zip(self.robots, other.robots, strict=True)
        )


def zero_bases(rows: Array, clamped: Sequence[slice]) -> None:
    """Set the rows of clamped bases to zero, in place.

    Parameters
    ----------
    rows
        Shape (n,) or (n, k), beginning with the unknowns of the reduced scene.
    clamped
        Unknowns of clamped bases.
    """
    for base in clamped:
        rows[base] = 0.0

"""Response of one equilibrium to the tensions of segments, each as if it were given, and to a change of the loads.

By their tensions the segments depend on each other only through the robot's stiffness, which changes slowly along a
load step. By mobilisations they would depend on the tensions themselves, and on every hole before them.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tdcr_fe.elements.forces import TendonForces
from tdcr_fe.solve.equations.factors import BorderedFactors
from tdcr_fe.solve.equations.linearization import Linearization

Array = NDArray[np.float64]
#: By robot, numbers of some of its tendons.
Tendons = Sequence[NDArray[np.int_]]


class LoadResponse(NamedTuple):
    """Change of segments and turning angles by a change of the loads at fixed tensions.

    Attributes
    ----------
    nodes : ndarray, shape (reduced,)
        Change of the unknowns of the reduced scene.
    lengths : ndarray, shape (q,)
        [m].
    angles : ndarray, shape (r,)
        [rad].
    """

    nodes: Array
    lengths: Array
    angles: Array

    @classmethod
    def zero(cls, response: TensionResponse) -> LoadResponse:
        """Where no load changes, beside a response to tensions."""
        return cls(*(np.zeros(len(x)) for x in (response.nodes, response.flexibility, response.angles)))

    def times(self, factor: float) -> LoadResponse:
        """The response to a change that is larger by a factor."""
        return LoadResponse(factor * self.nodes, factor * self.lengths, factor * self.angles)


class TensionResponse(NamedTuple):
    """Derivatives by the tensions of q segments; with r turning angles, padded ones included. All others are slack.

    Attributes
    ----------
    tendons : Tendons
        Whose segments and angles these are.
    nodes : ndarray, shape (reduced, q)
        Of the unknowns of the reduced scene.
    flexibility : ndarray, shape (q, q)
        Minus those of the lengths; symmetric [m/N].
    angles : ndarray, shape (r, q)
        Of the turning angles [rad/N].
    by_angle : ndarray, shape (q, r)
        Derivatives of the tensions by the turning angles at fixed mobilisations and tensions at the base [N/rad].
    """

    tendons: Tendons
    nodes: Array
    flexibility: Array
    angles: Array
    by_angle: Array

    @classmethod
    def of(
        cls,
        linear: Linearization,
        forces: Sequence[TendonForces],
        clamped: Sequence[slice],
        tendons: Tendons,
    ) -> TensionResponse:
        """From the tangent, in which tensions change with the turning angles.

        Parameters
        ----------
        linear
            Equilibrium, linearised at fixed mobilisations.
        forces
            By robot.
        clamped
            Unknowns of clamped bases.
        tendons
            By robot, the tendons; all others have no tension.
        """
        lengths, angles, by_angle = _segments(linear, forces, tendons)
        right = np.asfortranarray(lengths.T)
        for base in clamped:
            right[base] = 0.0
        moved = _inner(linear, right)
        turned = angles @ moved
        # A given tension is the sum of one that is put on, and of what the angles add to it.
        put_on = np.linalg.inv(np.eye(len(lengths)) + by_angle @ turned)
        return cls(tendons, moved @ put_on, -(lengths @ moved) @ put_on, turned @ put_on, by_angle)

    def to_load(
        self, linear: Linearization, forces: Sequence[TendonForces], unbalanced: Array
    ) -> LoadResponse:
        """Response to a change of the loads.

        Parameters
        ----------
        linear, forces
            As in `of`.
        unbalanced
            Residual that the change causes, shape (reduced,).
        """
        lengths, angles, _ = _segments(linear, forces, self.tendons)
        moved = _inner(linear, -unbalanced)
        turned = angles @ moved
        added = self.by_angle @ turned
        return LoadResponse(
            moved - self.nodes @ added,
            lengths @ moved + self.flexibility @ added,
            turned - self.angles @ added,
        )


def _inner(linear: Linearization, right: Array) -> Array:
    """Solve at fixed tensions at the base; there may be nothing to solve for."""
    if right.size == 0:
        return right
    factors = linear.factorisation
    return (factors.inner if isinstance(factors, BorderedFactors) else factors).solve(right)


def _segments(
    linear: Linearization, forces: Sequence[TendonForces], tendons: Tendons
) -> tuple[Array, Array, Array]:
    """Derivatives of lengths and angles by the reduced unknowns, and of the tensions by the angles."""
    reduced = linear.numbering.reduced
    tables: tuple[list[Array], list[Array]] = [], []
    blocks = []
    for part, which in zip(linear.numbering.robots, tendons, strict=True):
        own = forces[part.robot]
        shape = own.measured.shape
        for table, rows in zip(tables, (shape.d_lengths, shape.d_angles), strict=True):
            full = np.zeros((len(which) * rows.shape[1], reduced))
            inside = slice(part.nodes.start, part.nodes.stop)
            columns = own.model.columns
            full[:, inside if columns is None else inside.start + columns] = rows[which].reshape(
                len(full), rows.shape[-1]
            )
            table.append(full)
        blocks += list(own.field.d_angle[which])
    lengths, angles = (t[0] if len(t) == 1 else np.concatenate(t) for t in tables)
    by_angle = np.zeros((len(lengths), len(angles)))
    row = column = 0
    for block in blocks:
        by_angle[row : row + block.shape[0], column : column + block.shape[1]] = block
        row, column = row + block.shape[0], column + block.shape[1]
    return lengths, angles, by_angle

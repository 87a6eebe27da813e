"""Tangent of one robot alone as a banded matrix: its factors cost in proportion to the number of disks.

The tension behind a hole depends on all holes before it, so by the nodes alone the tangent of a robot with friction is
full. With the tension of every segment as a further unknown, each equation has unknowns of neighbouring disks only:

    balance of a node:      K x - d_before^T t_before - d_after^T t_after = r ,
    transfer at a hole:     t_after - f t_before - g (turn of the tendon there) = 0 ,
    at the base plate:      t = 0 ,

with the tension changes ``t``, the derivatives ``d`` of the segments' lengths, and the slopes ``f``, ``g`` of
`tdcr_fe.elements.capstan.HoleSlopes`. The unknowns of every node are its six increments, then the tensions of the
segments that begin there.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from math import isfinite
from typing import NamedTuple

import numpy as np
from scipy.linalg.lapack import dgbtrf, dgbtrs

from tdcr_fe.elements import Array, Index
from tdcr_fe.elements.backbone import NodeStiffness
from tdcr_fe.elements.forces import TendonForces
from tdcr_fe.elements.native.actuation import TendonActuation
from tdcr_fe.elements.poses import EYE6

#: A band pays below this fraction of the unknowns of the nodes (measured: 0.15 halves the time of the factors, 0.25
#: lengthens it) [1].
WIDEST = 0.2


class BandParts(NamedTuple):
    """Where the parts of the tangent lie in a band; all are views of `data`."""

    data: Array  # The band, column by column
    # (N, 6, 6) and twice (N-1, 6, 6): Forces on every node by its own motion and by that of the next one, and on the
    # next one by its motion
    nodes: tuple[Array, ...]
    disks: tuple[Array, ...]  # (n+1, 6, 6) and twice (n, 6, 6): The same of the nodes with holes
    pulled: Array  # (n, 2, 6, m): Both ends of every segment by its tension
    tensions: Array  # (N, m): Tensions by themselves
    turned: Array  # (n-1, m, 3, 6): Transfer at the holes by the nodes before, at and behind them
    passed: Array  # (n-1, m): Transfer at the holes by the tension before them


@dataclass(frozen=True)
class BandLayout:
    """Order of the unknowns in the band."""

    nodes: int  # Number of nodes
    tendons: int  # Number of tendons
    segments: int  # Number of segments of the longest tendon
    spacing: int  # Number of nodes from one with holes to the next

    @classmethod
    def of(cls, robot: TendonActuation) -> BandLayout | None:
        """Layout of a robot on which nothing but robots acts; None where a full matrix is needed, or is faster."""
        model = robot.model
        if model.geometry is None or model.section is not None or model.springs is not None:
            return None
        holes = model.cable_nodes
        spacing = np.diff(holes)
        if holes[0] != 0 or np.any(spacing != spacing[0]):
            return None
        m, n = model.law.shape
        found = cls(model.mesh.arc_lengths.size, m, n, int(spacing[0]))
        return found if found.lower <= WIDEST * 6 * found.nodes else None

    @cached_property
    def block(self) -> int:
        """Unknowns of one node."""
        return 6 + self.tendons

    @cached_property
    def lower(self) -> int:
        """Diagonals below the main one: from the last tension at a disk to the disk before."""
        return self.block * self.spacing + 5 + self.tendons

    @cached_property
    def upper(self) -> int:
        """Diagonals above the main one: from a disk to the next."""
        return self.block * self.spacing + 5

    @property
    def leading(self) -> int:
        """Numbers of a column, those that elimination fills included."""
        return 2 * self.lower + self.upper + 1

    @cached_property
    def parts(self) -> BandParts:
        """A band to assemble in."""
        n, m, nodes, size = self.segments, self.tendons, self.nodes, self.block
        disk, origin = size * self.spacing, self.lower + self.upper
        data = np.zeros(size * nodes * self.leading)

        def view(row: int, column: int, shape: tuple[int, ...], *axes: tuple[int, int]) -> Array:
            """Entries from (row, column) on; every axis moves by so many rows and columns.

            In LAPACK's band, one row further is the next number, and one column further is ``leading - 1`` numbers on.
            """
            strides = [8 * (i + j * (self.leading - 1)) for i, j in axes]
            offset = 8 * (origin + row + column * (self.leading - 1))
            return np.ndarray(shape, float, data, offset, strides)

        def neighbours(count: int, spacing: int) -> tuple[Array, ...]:
            places = (0, 0, count), (0, spacing, count - 1), (spacing, 0, count - 1)
            return tuple(view(i, j, (k, 6, 6), (spacing, spacing), (1, 0), (0, 1)) for i, j, k in places)

        return BandParts(
            data,
            neighbours(nodes, size),
            neighbours(n + 1, disk),
            pulled=view(0, 6, (n, 2, 6, m), (disk, disk), (disk, 0), (1, 0), (0, 1)),
            tensions=view(6, 6, (nodes, m), (size, size), (1, 1)),
            turned=view(disk + 6, 0, (n - 1, m, 3, 6), (disk, disk), (1, 0), (0, disk), (0, 1)),
            passed=view(disk + 6, 6, (n - 1, m), (disk, disk), (1, 1)),
        )

    def assemble(self, backbone: NodeStiffness, forces: TendonForces, clamped: bool) -> Array:
        """The tangent in LAPACK's form of a band, shape (2 lower + upper + 1, unknowns).

        Parameters
        ----------
        backbone
            Tangent of the backbone.
        forces
            Forces of the tendons, with derivatives hole by hole.
        clamped
            Whether the base is clamped: its equations become zero increments.
        """
        n, m, to = self.segments, self.tendons, self.parts
        to.data.fill(0.0)
        lines, at_hole = forces.measured.shape.lines, forces.field.hole_slopes
        assert at_hole is not None
        holes = lines.stiffness(forces.field.tension, forces.pulls)
        for views, found in ((to.nodes, backbone), (to.disks, holes)):
            for own, block in zip(views, (*found, found.after.swapaxes(1, 2)), strict=True):
                own += block
        rows = lines.segments[:, :, 3].reshape(n, m, 2, 6)
        np.negative(rows.transpose(0, 2, 3, 1), out=to.pulled)
        to.tensions[...] = 1.0
        if n > 1:
            by_angle = -at_hole.by_angle.T[:, :, None, None]
            np.multiply(by_angle, lines.turns.reshape(n - 1, m, 3, 6), out=to.turned)
            np.negative(at_hole.by_tension.T, out=to.passed)
        if clamped:
            to.nodes[0][0], to.nodes[1][0], to.disks[1][0], to.pulled[0, 0] = EYE6, 0.0, 0.0, 0.0
        return to.data.copy().reshape(len(to.data) // self.leading, self.leading).T


class BandFactors(NamedTuple):
    """LU factors of a banded tangent; as `tdcr_fe.solve.equations.linearization.DenseFactors`."""

    lu: Array
    pivots: Index
    layout: BandLayout

    @classmethod
    def of(cls, band: Array, layout: BandLayout) -> BandFactors:
        """Factorise, overwriting the band.

        Raises
        ------
        numpy.linalg.LinAlgError
            The matrix is singular.
        """
        lu, pivots, info = dgbtrf(band, layout.lower, layout.upper, overwrite_ab=True)
        if info != 0 or not isfinite(lu[layout.lower + layout.upper, -1]):
            raise np.linalg.LinAlgError("singular matrix")
        return cls(lu, pivots, layout)

    def solve(self, right: Array) -> Array:
        """Increments of the nodes for one or several right sides, shape (6 N,) or (6 N, k)."""
        layout, transposed = self.layout, right.T
        # Right sides one after the other, as LAPACK has them, with zeros for the transfer of the tensions.
        both = np.zeros((*transposed.shape[:-1], layout.nodes, layout.block))
        both[..., :6] = transposed.reshape(*both.shape[:-1], 6)
        packed = both.reshape(*transposed.shape[:-1], -1).T
        found, _ = dgbtrs(self.lu, layout.lower, layout.upper, packed, self.pivots, overwrite_b=True)
        return np.asarray(found.T.reshape(both.shape)[..., :6].reshape(transposed.shape).T)

    @property
    def sign(self) -> int:
        """Sign of the determinant of the tangent by the nodes: eliminating the tensions does not change it."""
        diagonal = self.lu[self.layout.lower + self.layout.upper]
        turned = np.count_nonzero((self.pivots != np.arange(len(self.pivots))) ^ (diagonal < 0.0))
        return 1 if turned % 2 == 0 else -1

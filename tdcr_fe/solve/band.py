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

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.lapack import dgbtrf, dgbtrs

from tdcr_fe.elements.actuation import TendonActuation
from tdcr_fe.elements.backbone import NodeStiffness
from tdcr_fe.elements.forces import TendonForces

Array = NDArray[np.float64]
_EYE6 = np.eye(6)
#: A band pays below this fraction of the unknowns of the nodes (measured: 0.15 halves the time of the factors, 0.25
#: lengthens it) [1].
WIDEST = 0.2


class BandLayout(NamedTuple):
    """Order of the unknowns in the band.

    Attributes
    ----------
    nodes, tendons, segments : int
        Numbers of nodes, of tendons, and of segments of the longest tendon.
    spacing : int
        From one node with holes to the next.
    """

    nodes: int
    tendons: int
    segments: int
    spacing: int

    @classmethod
    def of(cls, robots: Sequence[TendonActuation]) -> BandLayout | None:
        """Layout for a scene with nothing but clamped robots; None where a full matrix is needed, or is faster."""
        if len(robots) != 1:
            return None
        model = robots[0].model
        if model.geometry is None or model.section is not None:
            return None
        holes = model.cable_nodes
        spacing = np.diff(holes)
        if holes[0] != 0 or np.any(spacing != spacing[0]):
            return None
        m, n = model.law.shape
        found = cls(model.mesh.arc_lengths.size, m, n, int(spacing[0]))
        return found if found.lower <= WIDEST * 6 * found.nodes else None

    @property
    def block(self) -> int:
        """Unknowns of one node."""
        return 6 + self.tendons

    @property
    def lower(self) -> int:
        """Diagonals below the main one: from the last tension at a disk to the disk before."""
        return self.block * self.spacing + 5 + self.tendons

    @property
    def upper(self) -> int:
        """Diagonals above the main one: from a disk to the next."""
        return self.block * self.spacing + 5

    def assemble(self, backbone: NodeStiffness, forces: TendonForces, clamped: bool) -> Array:
        """The tangent in LAPACK's form of a band, shape (2 lower + upper + 1, unknowns).

        Parameters
        ----------
        backbone
            Tangent of the backbone.
        forces
            Of the tendons; they must have derivatives hole by hole.
        clamped
            Whether the base is clamped: its equations become zero increments.
        """
        n, m, size, disk = self.segments, self.tendons, self.block, self.block * self.spacing
        leading = 2 * self.lower + self.upper + 1
        data = np.zeros(size * self.nodes * leading)
        origin = self.lower + self.upper

        def view(row: int, column: int, shape: tuple[int, ...], *axes: tuple[int, int]) -> Array:
            """Entries from (row, column) on; every axis moves by so many rows and columns.

            In LAPACK's band, one row further is the next number, and one column further is ``leading - 1`` numbers on.
            """
            strides = [8 * (i + j * (leading - 1)) for i, j in axes]
            return np.ndarray(shape, float, data, 8 * (origin + row + column * (leading - 1)), strides)

        entries, along = ((1, 0), (0, 1)), (size, size)
        itself = view(0, 0, (self.nodes, 6, 6), along, *entries)
        after = view(0, size, (self.nodes - 1, 6, 6), along, *entries)
        itself[...] = backbone.itself
        after[...] = backbone.after
        view(size, 0, after.shape, along, *entries)[...] = backbone.after.swapaxes(1, 2)

        holes, along = forces.geometric_stiffness(), (disk, disk)
        next_disk = view(0, disk, (n, 6, 6), along, *entries)
        disks, previous = (view(k, 0, (n + 1 - bool(k), 6, 6), along, *entries) for k in (0, disk))
        disks += holes.itself
        next_disk += holes.after
        previous += holes.after.swapaxes(1, 2)

        lines, at_hole = forces.measured.shape, forces.hole_slopes()
        pulled = view(0, 6, (n, 2, 6, m), along, (disk, 0), *entries)
        np.negative(lines.lines.segments[:, :, 3].reshape(n, m, 2, 6).transpose(0, 2, 3, 1), out=pulled)
        view(6, 6, (self.nodes, m), (size, size), (1, 1))[...] = 1.0
        if n > 1:
            turned = view(disk + 6, 0, (n - 1, m, 3, 6), along, (1, 0), (0, disk), (0, 1))
            np.multiply(
                -at_hole.by_angle.T[:, :, None, None], lines.turns.reshape(n - 1, m, 3, 6), out=turned
            )
            view(disk + 6, 6, (n - 1, m), along, (1, 1))[...] = -at_hole.by_tension.T
        if clamped:
            itself[0], after[0], next_disk[0], pulled[0, 0] = _EYE6, 0.0, 0.0, 0.0
        return data.reshape(-1, leading).T


class BandFactors(NamedTuple):
    """LU factors of a banded tangent; see `tdcr_fe.solve.factors.Factors`.

    Attributes
    ----------
    lu : ndarray
    pivots : ndarray of int
    layout : BandLayout
    """

    lu: Array
    pivots: NDArray[np.int_]
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
        if info != 0 or not np.isfinite(lu[layout.lower + layout.upper, -1]):
            raise np.linalg.LinAlgError("singular matrix")
        return cls(lu, pivots, layout)

    def solve(self, right: Array) -> Array:
        """Increments of the nodes for one or several right sides, shape (6 N,) or (6 N, k)."""
        layout = self.layout
        count = right.shape[1] if right.ndim == 2 else 1
        # Right sides one after the other, as LAPACK has them, with zeros for the transfer of the tensions.
        both = np.zeros((count, layout.nodes, layout.block))
        both[:, :, :6] = right.T.reshape(count, layout.nodes, 6)
        packed = both.reshape(count, -1).T
        found, _ = dgbtrs(self.lu, layout.lower, layout.upper, packed, self.pivots, overwrite_b=True)
        nodes = found.T.reshape(both.shape)[:, :, :6].reshape(count, -1)
        return nodes.T if right.ndim == 2 else nodes[0]

    @property
    def sign(self) -> int:
        """Sign of the determinant of the tangent by the nodes: eliminating the tensions does not change it."""
        diagonal = self.lu[self.layout.lower + self.layout.upper]
        turned = np.count_nonzero((self.pivots != np.arange(len(self.pivots))) ^ (diagonal < 0.0))
        return 1 if turned % 2 == 0 else -1

"""The backbone: its mesh, and the kinematics of its elements in strain space.

Exudyn's beams have their axis along the local x axis, so a node's frame is the section frame of the robot
with the axes renamed: beam (x, y, z) = section (z, x, y).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from tdcr_fe.elements import Array, Index
from tdcr_fe.elements.poses import (
    EYE6,
    adjoint_powers,
    coefficients,
    euler_parameters_near,
    euler_rate_matrix,
    even_inverse_tangent,
    exp_matrix,
    exponential_curvature,
    log_se3,
    pose_matrix,
    skew,
)

#: Rotation from beam axes to section axes: its columns are the beam's axes in the section frame.
BEAM_TO_SECTION = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])

#: ``w @ _PULL`` is, row by row, half of what the force of a wrench adds to a node's own 6 x 6 block as its frame turns.
_PULL: Array = np.zeros((6, 6, 6))
_PULL[:3, :3, 3:] = 0.5 * skew(np.eye(3))
_PULL[:3, 3:, :3] = -0.5 * skew(np.eye(3))
_PULL = _PULL.reshape(6, 36)


_GAUSS = np.polynomial.legendre.leggauss(4)
#: Gauss points on [0, 1] along an element, and their weights.
POINTS: Array = 0.5 * (_GAUSS[0] + 1.0)
WEIGHTS: Array = 0.5 * _GAUSS[1]


def gauss_arc_lengths(nodes: Array) -> Array:
    """Arc lengths of the integration points of every element [m], shape (E, 4)."""
    return nodes[:-1, None] + np.diff(nodes)[:, None] * POINTS


@dataclass(frozen=True)
class BackboneMesh:
    """Nodes and elements along the backbone."""

    arc_lengths: Array  # (N,): Of the nodes, ascending, base first [m]
    # (N-1, 6): Of every element, in beam axes: axial, shear, shear [N], torsion, bending, bending [N m^2].
    # Shear includes the residual flexibility of bending.
    stiffness: Array
    mass_per_length: Array  # (N-1,): Of every element [kg/m]
    rotary_inertia: Array  # (N-1, 3): Per length, about the beam's axes [kg m]
    precurvature: Array  # (N-1, 3): Curvature of every element in the unloaded state, in beam axes [1/m]
    # (N-1,): Change of the radius with arc length, over that in the middle of every element [1/m]
    taper: Array

    @cached_property
    def lengths(self) -> Array:
        """Lengths of the elements [m], shape (N-1,)."""
        return np.diff(self.arc_lengths)

    @cached_property
    def twist_stiffness(self) -> Array:
        """Stiffness by the relative twists of the elements [N/m, N m], shape (N-1, 6)."""
        return self.stiffness / self.lengths[:, None]

    @cached_property
    def reference_twists(self) -> Array:
        """Unloaded relative twist of every element, length times strain, shape (N-1, 6)."""
        twists = np.zeros((len(self.precurvature), 6))
        twists[:, 0] = self.lengths
        twists[:, 3:] = self.lengths[:, None] * self.precurvature
        return twists

    @cached_property
    def flexibility(self) -> float:
        """Rotation of the tip by a unit bending moment all along [rad/(N m)]."""
        return float(np.sum(self.lengths / self.stiffness[:, 5]))

    def gradient(self, twists: Array) -> Array:
        """Gradient of the elastic energy by the twists of the elements, shape (..., E, 6)."""
        return self.twist_stiffness * (twists - self.reference_twists)

    def node_at(self, s: float, tolerance: float = 1e-9) -> int:
        """Number of the node at an arc length [m]; `KeyError` where there is none."""
        k = int(np.argmin(np.abs(self.arc_lengths - s)))
        if abs(self.arc_lengths[k] - s) > tolerance:
            raise KeyError(f"no backbone node at s = {s:g} m; the nearest is at {self.arc_lengths[k]:.9g} m")
        return k


def add_residual_flexibility(stiffness: Array, lengths: Array, share: float = 1.0) -> None:
    """Give the shear of every element the residual flexibility of bending, ``h^2 / (12 EI)``.

    A constant strain cannot follow a moment that changes with the shear force; this makes up for it (R. H. MacNeal, A
    simple quadrilateral shell element, Computers & Structures 8 (1978) 175-183; docs/theory.md, section "The beam
    element").

    Parameters
    ----------
    stiffness
        As in `BackboneMesh`, shape (E, 6); the shear is changed in place.
    lengths
        Lengths of the elements [m], shape (E,).
    share
        Part of that flexibility that is added [1].
    """
    residual = lengths[:, None] ** 2 / (12.0 * stiffness[:, 5:3:-1])
    stiffness[:, 1:3] = 1.0 / (1.0 / stiffness[:, 1:3] + share * residual)


def reference_poses(mesh: BackboneMesh, position: Array, rotation: Array) -> tuple[Array, Array]:
    """World poses of all nodes in the unloaded state.

    Parameters
    ----------
    mesh
        The backbone.
    position, rotation
        Position and rotation of the base, the rotation in beam axes; shapes (3,) and (3, 3).

    Returns
    -------
    positions : ndarray, shape (N, 3)
    rotations : ndarray, shape (N, 3, 3)
    """
    return ElementChain(mesh.reference_twists).poses(pose_matrix(position, rotation))


class NodeStiffness(NamedTuple):
    """Blocks of a symmetric matrix by unknowns of nodes in a row; only neighbours are coupled."""

    itself: Array  # (N, d, d): Of every node, by its six body-frame increments or seven coordinates
    # (N-1, d, d): Of every node by the next one; the transposed block is that of the next one by it
    after: Array

    def add_to(self, k: Array, nodes: Index) -> None:
        """Add the blocks of nodes of these numbers to a matrix that begins with the unknowns of nodes."""
        (row, column), d = k.strides, self.itself.shape[1]
        n = len(k) // d
        blocks: Array = np.ndarray((n, d, n, d), k.dtype, k, 0, (d * row, row, d * column, column))
        near, far = nodes[:-1], nodes[1:]
        blocks[nodes, :, nodes, :] += self.itself
        blocks[near, :, far, :] += self.after
        blocks[far, :, near, :] += self.after.swapaxes(1, 2)


class NodePoses(NamedTuple):
    """Poses of the nodes of one backbone, in beam axes."""

    positions: Array  # (N, 3): [m]
    rotations: Array  # (N, 3, 3)
    parameters: Array  # (N, 4): Euler parameters
    # (N, 7, 6): From body-frame increments of the nodes to their coordinates: position, then Euler parameters
    frames: Array


def node_frames(rotations: Array, parameters: Array) -> Array:
    """`NodePoses.frames` of rotations (N, 3, 3) and their Euler parameters (N, 4)."""
    frames = np.zeros((len(parameters), 7, 6))
    frames[:, :3, :3] = rotations
    frames[:, 3:, 3:] = euler_rate_matrix(parameters)
    return frames


class ElementChain:
    """The elements of one backbone one after the other: their twists, and the poses that follow from them.

    Parameters
    ----------
    twists
        Relative twist of every element, length times strain, shape (E, 6).
    """

    def __init__(self, twists: Array) -> None:
        self.twists = twists
        self._coefficients = coefficients(twists[:, 3:])
        #: Pose of every node in the frame of the one before, shape (E, 4, 4).
        self.steps = exp_matrix(twists, self._coefficients)

    def nodes(self, base: Array, near: Array) -> NodePoses:
        """Poses of the nodes.

        Parameters
        ----------
        base
            Pose of the base, shape (4, 4).
        near
            Euler parameters that have the signs to take, shape (N, 4).
        """
        positions, rotations = self.poses(base)
        parameters = euler_parameters_near(rotations, near)
        return NodePoses(positions, rotations, parameters, node_frames(rotations, parameters))

    def poses(self, base: Array) -> tuple[Array, Array]:
        """Positions (N, 3) and rotations (N, 3, 3) of all nodes, from the pose of the base (4, 4)."""
        poses = np.empty((len(self.steps) + 1, 4, 4))
        poses[0] = base
        each = list(poses)
        for before, step, after in zip(each, self.steps, each[1:], strict=False):
            before.dot(step, after)
        return poses[:, :3, 3].copy(), poses[:, :3, :3].copy()

    def changes(self, increments: Array) -> Array:
        """Linearised change of the twists for body-frame increments of the nodes.

        Parameters
        ----------
        increments
            Twists ``[v, w]`` of the nodes in their own frames, shape (N, 6), or (N, 6, P) for several.

        Returns
        -------
        ndarray, shape (E, 6) or (E, 6, P)
        """
        _, b = self._maps
        both = np.concatenate((increments[:-1], increments[1:]), axis=1)
        return np.asarray((b @ both.reshape(*both.shape[:2], -1)).reshape(len(b), *increments.shape[1:]))

    @staticmethod
    def _distal_sum(wrenches: Array, positions: Array, rotations: Array) -> Array:
        """Sum of the wrenches on each node and all nodes distal to it, in its own frame: (N, 2, 3) to (N, 2, 3)."""
        lever = skew(positions)
        world = wrenches @ rotations.swapaxes(1, 2)
        # Moments are summed about the origin and then referred back to the nodes.
        world[:, 1:] -= world[:, :1] @ lever
        beyond = world[::-1].cumsum(axis=0)[::-1]
        beyond[:, 1:] += beyond[:, :1] @ lever
        return np.asarray(beyond @ rotations)

    def tangent(
        self, wrenches: Array, positions: Array, rotations: Array, mesh: BackboneMesh | None = None
    ) -> NodeStiffness:
        """Geometric terms of unbalanced wrenches in the nodal tangent, and the elastic forces with all of theirs.

        Away from equilibrium the tangent depends on the unknowns it is taken in. With the elements' twists ``xi``,
        whose poses follow by exponentials, the elastic energy is quadratic, so its second derivative is the stiffness;
        everything else that depends on the poses acts through their second derivatives (derivation:
        docs/algorithms.md, section "Newton's method in strain space").

        Parameters
        ----------
        wrenches
            Unbalanced ``[f, m]`` on the nodes, in their own frames, shape (N, 6).
        positions, rotations
            Positions and rotations of the nodes, shapes (N, 3) and (N, 3, 3).
        mesh
            With the stiffness of the elements and their unloaded twists; None leaves out the elastic forces.

        Returns
        -------
        NodeStiffness
            With the sign of Exudyn's Jacobian: minus the stiffness.
        """
        powers, b = self._maps
        beyond = self._distal_sum(wrenches.reshape(-1, 2, 3), positions, rotations)
        others = wrenches.reshape(-1, 6)
        if mesh is not None:
            internal = (mesh.gradient(self.twists)[:, None] @ b)[:, 0]
            # Everything but the elastic wrenches: beyond an element it is what it transmits, and the unbalanced.
            others = others.copy()
            others[:-1] += internal[:, :6]
            others[1:] += internal[:, 6:]
            beyond[1:] += internal[:, 6:].reshape(-1, 2, 3)
        inner = exponential_curvature(self.twists, powers, beyond[1:].reshape(-1, 6))
        if mesh is not None:
            inner -= mesh.twist_stiffness[:, :, None] * EYE6
        return self._pose_terms(others, beyond, b, inner)

    @cached_property
    def _maps(self) -> tuple[Array, Array]:
        """Powers 1 to 4 of ``ad`` of the twists; change of the twists by increments of both nodes.

        Shapes (E, 4, 6, 6) and (E, 6, 12).
        """
        powers = adjoint_powers(self.twists)
        return powers, _strain_matrices(powers, self._coefficients)

    def _pose_terms(self, wrenches: Array, beyond: Array, b: Array, inner: Array) -> NodeStiffness:
        """Wrenches times second derivatives of the poses."""
        half = skew(0.5 * beyond.reshape(-1, 2, 3))
        # Half the coadjoint map, from the change of a twist to that of the wrench beyond it, is [[0, f], [f, m]]; here
        # after the transposed map that takes twists of an element's first node to its second.
        half[1:] = self.steps[:, None, :3, :3] @ half[1:]
        turned = np.zeros((len(half), 6, 6))
        turned[:, :3, 3:] = turned[:, 3:, :3] = half[:, 0]
        turned[:, 3:, 3:] = half[:, 1]
        outer = turned[1:]
        outer[:, 3:, 3:] += skew(self.steps[:, :3, 3]) @ half[1:, 0]
        itself = wrenches.reshape(-1, 6).dot(_PULL).reshape(-1, 6, 6)
        itself[0] += turned[0]
        block = b.swapaxes(1, 2) @ (inner @ b)
        itself[:-1] += block[:, :6, :6]
        itself[1:] += block[:, 6:, 6:]
        return NodeStiffness(itself, block[:, :6, 6:] - outer)


def relative_twists(positions: Array, rotations: Array) -> Array:
    """Relative twist of every element from the poses of its nodes, shape (N-1, 6)."""
    inverse = np.swapaxes(rotations[:-1], 1, 2)
    r = inverse @ rotations[1:]
    p = (inverse @ np.diff(positions, axis=0)[..., None])[..., 0]
    return log_se3(r, p)


def strain_matrices(twists: Array) -> Array:
    """Matrices that take the increments of both nodes to the change of the element's twist, shape (..., 6, 12)."""
    return _strain_matrices(adjoint_powers(twists), coefficients(twists[..., 3:]))


def _strain_matrices(powers: Array, c: Array) -> Array:
    """The same from `adjoint_powers` and `coefficients`.

    The inverse tangent takes the increment of the far node; its mirror, of the opposite twist, that of the near one.
    """
    even, odd = even_inverse_tangent(powers, c), 0.5 * powers[..., 0, :, :]
    b: Array = np.empty((*powers.shape[:-3], 6, 12))
    np.subtract(odd, even, out=b[..., :6])
    np.add(odd, even, out=b[..., 6:])
    return b

"""Residual and Jacobian of the balance of wrenches at the stations: rod, loads, springs, weight, straight tendons."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from tdcr_fe.validation.reference.rod import Flow, hat
from tdcr_fe.validation.reference.settings import Array
from tdcr_fe.validation.reference.tendons import Segments, TendonEquations, Tendons


@dataclass(frozen=True)
class Forces:
    """Concentrated loads summed at the stations.

    Attributes
    ----------
    world, section : ndarray, shape (n + 1, 6)
        Moment and force in world frame and in section frame [N m, N].
    """

    world: Array
    section: Array


@dataclass(frozen=True)
class GroundedSpring:
    """A spring between a station and ground, relaxed in the unloaded state.

    Attributes
    ----------
    station : int
    stiffness : ndarray, shape (3,)
        Along the world axes [N/m].
    rest : ndarray, shape (3,)
        Where it is relaxed [m].
    """

    station: int
    stiffness: Array
    rest: Array


class Poses(NamedTuple):
    """Poses of the stations, and how they change with the unknowns.

    Attributes
    ----------
    rotations, positions : ndarray, shapes (n + 1, 3, 3), (n + 1, 3)
        [m].
    twists : ndarray, shape (n + 1, 6, m)
        Spatial twists by the first m unknowns.
    """

    rotations: Array
    positions: Array
    twists: Array

    @property
    def turns(self) -> Array:
        """Angular part of the twists, shape (n + 1, 3, m)."""
        return self.twists[:, :3]


class Balance:
    """Equations of n intervals with `width` unknowns each, and of the tendons' tensions behind them.

    Parameters
    ----------
    n, width
        Number of intervals, and of unknowns of each: wrench, and with gravity the weight in the interval's frame.
    equations
        Rows: those of the rod and one a tension.
    unknowns
        Columns: one an equation, and further ones that complementarity decides.

    Attributes
    ----------
    residual, jacobian : ndarray, shapes (equations,), (equations, unknowns)
    """

    def __init__(self, n: int, width: int, equations: int, unknowns: int) -> None:
        self._n, self._size = n, n * width
        self.residual = np.zeros(equations)
        self.jacobian = np.zeros((equations, unknowns))
        rows = self.jacobian[: self._size]
        #: Views by interval: residuals, rows of the Jacobian, and its blocks of intervals by intervals.
        self._rod = self.residual[: self._size].reshape(n, width)
        self._rows = rows.reshape(n, width, unknowns)
        self._blocks = rows[:, : self._size].reshape(n, width, n, width)

    def add_continuity(self, flow: Flow, wrenches: Array) -> None:
        """The wrench at the end of each interval is that at the start of the next, shape (n, 6)."""
        each, width = np.arange(self._n), self._rod.shape[1]
        shared = flow.d_wrench.shape[2] - width
        self._rod[:, :6] = flow.wrench
        self._rod[:-1, :6] -= wrenches[1:]
        self._blocks[each, :6, each, :] = flow.d_wrench[:, :, :width]
        self._blocks[each[:-1], :6, each[1:], :6] -= np.eye(6)
        self._rows[:, :6, self._size : self._size + shared] = flow.d_wrench[:, :, width:]

    def add_forces(self, forces: Forces, poses: Poses) -> None:
        """Subtract concentrated loads; derivatives come from the section's rotation."""
        rotations, _, twists = poses
        m, turn = twists.shape[2], poses.turns
        back = np.swapaxes(rotations[1:], 1, 2)
        moment, force = forces.world[1:, :3], forces.world[1:, 3:]
        self._rod[:, :3] -= (back @ moment[:, :, None])[..., 0] + forces.section[1:, :3]
        self._rod[:, 3:6] -= (back @ force[:, :, None])[..., 0] + forces.section[1:, 3:]
        for i in np.flatnonzero(np.any(forces.world[1:] != 0.0, axis=1)):
            self._rows[i, :3, :m] -= back[i] @ hat(moment[i]) @ turn[i + 1]
            self._rows[i, 3:6, :m] -= back[i] @ hat(force[i]) @ turn[i + 1]

    def add_spring(self, spring: GroundedSpring, poses: Poses) -> None:
        """Subtract the force of a spring."""
        at, stiffness, m = spring.station, spring.stiffness, poses.twists.shape[2]
        back, position = poses.rotations[at].T, poses.positions[at]
        pull = stiffness * (spring.rest - position)
        self._rod[at - 1, 3:6] -= back @ pull
        by_twist = np.concatenate((hat(pull) + stiffness[:, None] * hat(position), -np.diag(stiffness)), 1)
        self._rows[at - 1, 3:6, :m] -= back @ by_twist @ poses.twists[at]

    def add_weight(self, weight: Array, in_frames: Array, poses: Poses) -> None:
        """The weights in the frames of the intervals, unknowns (n, 3), are the rotated weights per length (n, 3)."""
        each, m = np.arange(self._n), poses.twists.shape[2]
        forth = np.swapaxes(poses.rotations[:-1], 1, 2)
        self._rod[:, 6:] = in_frames - (forth @ weight[:, :, None])[..., 0]
        self._blocks[each, 6:, each, 6:] += np.eye(3)
        self._rows[:, 6:, :m] -= (forth @ hat(weight)) @ poses.turns[:-1]

    def add_segments(self, tendons: Tendons, segments: Segments, tension: Array, poses: Poses) -> None:
        """Subtract the wrenches of straight segments on the disks (paper, Eqs. 12 and 32)."""
        turn, m = poses.turns, poses.twists.shape[2]
        pulled = tension[:, None] * segments.directions
        d_pulled = tension[:, None, None] * segments.d_directions
        tails, heads = segments.ends
        for at, (hole, d_hole), sign in ((tendons.head, heads, -1.0), (tendons.tail, tails, 1.0)):
            down = np.swapaxes(poses.rotations[at], 1, 2)
            arm = sign * np.concatenate((hat(hole) @ down, down), axis=1)
            local = (arm @ pulled[:, :, None])[..., 0]
            by_rod = arm @ (d_pulled + hat(pulled) @ turn[at])
            if d_hole is not None:
                by_rod[:, :3] -= sign * hat((down @ pulled[:, :, None])[..., 0]) @ d_hole
            by_tension = (arm @ segments.directions[:, :, None])[..., 0]
            for first, last in zip(tendons.first, tendons.last, strict=True):
                # the first tail is the base plate, which is clamped
                k = np.arange(first + (sign > 0.0), last)
                self._rod[at[k] - 1, :6] -= local[k]
                self._rows[at[k] - 1, :6, :m] -= by_rod[k]
                self._rows[at[k] - 1, :6, self._size + k] -= by_tension[k]

    def add_tensions(self, equations: TendonEquations, smooth: int) -> None:
        """The equations of the tensions; the unknowns from `smooth` on are those of the complementarity problem."""
        size, m = self._size, equations.by_rod.shape[1]
        self.residual[size:] = equations.residual
        self.jacobian[size:, :m] += equations.by_rod
        self.jacobian[size:, size:smooth] += equations.by_tension
        self.jacobian[size:, smooth:] = equations.by_choice

    def scale(self, wrench: Array, weight: float | None) -> None:
        """Divide by the scales of a wrench (6,) [N m, N] and, where there is gravity, of the weight [N/m]."""
        self._rod[:, :6] /= wrench
        self._rows[:, :6] /= wrench[:, None]
        if weight is not None:
            self._rod[:, 6:] /= weight
            self._rows[:, 6:] /= weight

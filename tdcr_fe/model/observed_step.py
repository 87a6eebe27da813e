"""What an instrument sees of a solved step: markers, tip, tangent, curvature, and their derivatives by parameters."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from tdcr_fe.elements.poses import inverse_tangent_se3
from tdcr_fe.model.interpolation import (
    ElementChange,
    elements_at,
    interpolate_positions,
    share_change,
    within_elements_change,
)
from tdcr_fe.model.results import StepResult

Array = NDArray[np.float64]

#: An arc length that is this near to a node is at the node [m].
AT_NODE = 2e-6


@dataclass(frozen=True, eq=False)
class ObservedChange:
    """Derivatives of the quantities of an `ObservedStep` by parameters, which are the last axis.

    Attributes
    ----------
    positions : ndarray, shape (n, 3, P)
        Of the nodes in the world.
    rotations : ndarray, shape (n, 3, P)
        Of the sections, as world rotation vectors.
    displacements, distal_tensions : ndarray, shape (n_tendons, P)
    s : ndarray, shape (n, P)
        Of the arc lengths of the nodes, which move along the backbone where disks do.
    """

    positions: Array
    rotations: Array
    displacements: Array
    distal_tensions: Array
    s: Array


@dataclass(frozen=True)
class ObservedStep:
    """The quantities of a solved step from which readings are predicted.

    Attributes
    ----------
    s : ndarray, shape (n,)
        Arc lengths of the nodes [m].
    positions : ndarray, shape (n, 3)
        Of the nodes in the world [m].
    rotations : ndarray, shape (n, 3, 3)
        Of the sections; the third column is the tangent.
    displacements, distal_tensions : ndarray, shape (n_tendons,)
        Pulled in at the base [m]; at the anchor [N].
    tendon_names : tuple of str
    frame : ndarray, shape (3, 3)
        Rotation of what is measured against the world: measured = shift + frame (p + R offset).
    offset : ndarray, shape (3,)
        Markers off the backbone, in their sections [m].
    shift : ndarray, shape (3,)
        The base in the measuring frame [m].
    single : tuple of (float, ndarray)
        Arc length [m] of a marker, and what its offset differs by from the others' [m], shape (3,).
    """

    s: Array
    positions: Array
    rotations: Array
    displacements: Array
    distal_tensions: Array
    tendon_names: tuple[str, ...]
    frame: Array = field(default_factory=lambda: np.eye(3))
    offset: Array = field(default_factory=lambda: np.zeros(3))
    shift: Array = field(default_factory=lambda: np.zeros(3))
    single: tuple[tuple[float, Array], ...] = ()

    @classmethod
    def of(
        cls,
        step: StepResult,
        tendon_names: tuple[str, ...],
        rotation: Sequence[float] = (0.0, 0.0, 0.0),
        offset: Sequence[float] = (0.0, 0.0),
    ) -> ObservedStep:
        """From a solved step, the rotation vector of the measuring frame [rad] and the markers' offset [m]."""
        return cls(
            step.s,
            step.positions,
            step.rotations,
            np.asarray(step.displacements, dtype=float),
            np.array([t[-1] for t in step.tensions], dtype=float),
            tendon_names,
            Rotation.from_rotvec(np.array(rotation, dtype=float)).as_matrix(),
            np.array([*offset, *(0.0,) * (3 - len(offset))]),
        )

    def offsets(self, s: Array) -> Array:
        """Offsets of markers at arc lengths from the backbone, in their sections [m], shape (n_markers, 3)."""
        found = np.tile(self.offset, (len(s), 1))
        for at, own in self.single:
            found[np.abs(s - at) < AT_NODE] += own
        return found

    def levers(self, s: Array) -> Array:
        """The same in the world [m], shape (n_markers, 3)."""
        nodes = np.argmin(np.abs(s[:, None] - self.s), axis=1)
        return np.asarray(np.einsum("nij,nj->ni", self.rotations[nodes], self.offsets(s)))

    def markers(self, s: Array) -> Array:
        """Measured positions of markers at arc lengths [m], shape (n_markers, 3)."""
        nodes = np.argmin(np.abs(s[:, None] - self.s), axis=1)
        if np.max(np.abs(self.s[nodes] - s)) < AT_NODE:
            at = self.positions[nodes]
        else:
            at = interpolate_positions(self.s, self.positions, self.rotations, s)
        return np.asarray((at + self.levers(s)) @ self.frame.T + self.shift)

    def marker_changes(self, change: ObservedChange, s: Array) -> Array:
        """Derivatives of `markers`, shape (n_markers, 3, P)."""
        nodes = np.argmin(np.abs(s[:, None] - self.s), axis=1)
        if np.max(np.abs(self.s[nodes] - s)) < AT_NODE and not np.any(change.s):
            moved = change.positions[nodes]
        else:
            moved = self._between_nodes(change, s)
        turned = np.cross(change.rotations[nodes], self.levers(s)[..., None], axis=1)
        return np.asarray(self.frame @ (moved + turned))

    def _between_nodes(self, change: ObservedChange, s: Array) -> Array:
        """Derivatives of the positions at arc lengths between nodes, (n_markers, 3, P)."""
        k = elements_at(self.s, s)
        length = self.s[k + 1] - self.s[k]
        share = (s - self.s[k]) / length
        by = ElementChange(
            change.positions[k],
            change.rotations[k],
            change.positions[k + 1],
            change.rotations[k + 1],
            share_change(change.s[k], change.s[k + 1], share, length),
        )
        p, r = self.positions, self.rotations
        return within_elements_change(p[k], r[k], p[k + 1], r[k + 1], share, by)

    def tip_change(self, change: ObservedChange) -> Array:
        """Derivatives of `tip`, shape (3, P)."""
        turned = np.cross(change.rotations[-1], self.levers(self.s[-1:])[0][:, None], axis=0)
        return np.asarray(self.frame @ (change.positions[-1] + turned))

    def tangent_change(self, change: ObservedChange) -> Array:
        """Derivatives of `tangent`, shape (3, P)."""
        return np.asarray(self.frame @ np.cross(change.rotations[-1], self.rotations[-1][:, 2, None], axis=0))

    @property
    def tip(self) -> Array:
        """Measured position of the tip [m], shape (3,)."""
        lever = self.levers(self.s[-1:])[0]
        return np.asarray(self.frame @ (self.positions[-1] + lever) + self.shift)

    @property
    def tangent(self) -> Array:
        """Measured direction of the tip, shape (3,)."""
        return np.asarray(self.frame @ self.rotations[-1][:, 2])

    def curvature(self, s: Array) -> Array:
        """Turning rates of the section about its own axes [1/m], shape (n, 3).

        The mean over the element at ``s``, from the relative rotation of its ends; at a node the mean of both
        elements. Exact where the curvature is constant.
        """
        lower, upper = self._elements_at(s)
        used = np.unique(np.concatenate((lower, upper)))
        relative = np.swapaxes(self.rotations[used], 1, 2) @ self.rotations[used + 1]
        rate = Rotation.from_matrix(relative).as_rotvec() / (self.s[used + 1] - self.s[used])[:, None]
        return np.asarray(0.5 * (rate[np.searchsorted(used, lower)] + rate[np.searchsorted(used, upper)]))

    def curvature_change(self, change: ObservedChange, s: Array) -> Array:
        """Derivatives of `curvature`, shape (n, 3, P)."""
        lower, upper = self._elements_at(s)
        used = np.unique(np.concatenate((lower, upper)))
        end = np.swapaxes(self.rotations[used + 1], 1, 2)
        turn = Rotation.from_matrix(np.swapaxes(end @ self.rotations[used], 1, 2)).as_rotvec()
        twist = np.concatenate((np.zeros_like(turn), turn), axis=1)
        own = (
            inverse_tangent_se3(twist)[:, 3:, 3:]
            @ end
            @ (change.rotations[used + 1] - change.rotations[used])
        )
        length = (self.s[used + 1] - self.s[used])[:, None, None]
        own = own / length - turn[:, :, None] * (change.s[used + 1] - change.s[used])[:, None] / length**2
        return np.asarray(0.5 * (own[np.searchsorted(used, lower)] + own[np.searchsorted(used, upper)]))

    def _elements_at(self, s: Array) -> tuple[NDArray[np.int_], NDArray[np.int_]]:
        """Numbers of the elements before and after arc lengths; the same one between nodes."""
        return elements_at(self.s, s - AT_NODE), elements_at(self.s, s + AT_NODE)


def difference_steps(step: ObservedStep, change: ObservedChange) -> Array:
    """Changes of the parameters that move a step by 1e-5 of its length, or turn it by so much, shape (P,)."""
    length, count = float(step.s[-1]), change.positions.shape[-1]

    def largest(values: Array) -> Array:
        return np.asarray(np.max(np.abs(values).reshape(-1, count), axis=0, initial=0.0))

    moved = np.maximum(
        largest(change.positions), np.maximum(largest(change.s), largest(change.displacements))
    )
    size = np.maximum(largest(change.rotations), moved / length)
    return np.where(size > 0.0, 1e-5 / np.where(size > 0.0, size, 1.0), 1e-5)


def moved_step(step: ObservedStep, change: ObservedChange, p: int, h: float) -> ObservedStep:
    """A step with parameter ``p`` changed by ``h``, to first order."""
    turn = Rotation.from_rotvec(h * change.rotations[:, :, p]).as_matrix()
    return replace(
        step,
        s=step.s + h * change.s[:, p],
        positions=step.positions + h * change.positions[:, :, p],
        rotations=turn @ step.rotations,
        displacements=step.displacements + h * change.displacements[:, p],
        distal_tensions=step.distal_tensions + h * change.distal_tensions[:, p],
    )

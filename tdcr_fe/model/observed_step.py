"""What an instrument sees of a solved step: markers, tip, tangent, curvature, and their derivatives by parameters."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from scipy.spatial.transform import Rotation

from tdcr_fe.elements import Array, Index
from tdcr_fe.model.results import StepResult, elements_at, within_elements

#: An arc length that is this near to a node is at the node [m].
AT_NODE = 2e-6


@dataclass(frozen=True)
class Observation:
    """Map from the robot's pose to the measured position: ``measured = shift + Exp(rotation) (p + R offset)``.

    Attributes
    ----------
    rotation : (float, float, float)
        Rotation vector of the measuring frame against the base [rad]. Directions, and so angles from the
        z axis, are turned as well.
    offset : (float, float, float)
        Markers off the backbone, along x and y of their sections, and beyond the arc length that they are assigned to,
        along the tangent there [m].
    shift : (float, float, float)
        The base in the measuring frame [m].
    markers : tuple of float
        Arc lengths that markers are assigned to, ascending [m]; empty where they are not known.
    single : tuple of ((float, float, float), ...)
        For each of ``markers``, what its offset differs by from that of all [m]; empty where they are alike.
    declared : tuple of float
        Arc lengths by which readings name these markers, where the backbone is of another length [m]; else empty.
    """

    rotation: tuple[float, float, float] = (0.0, 0.0, 0.0)
    offset: tuple[float, float, float] = (0.0, 0.0, 0.0)
    shift: tuple[float, float, float] = (0.0, 0.0, 0.0)
    markers: tuple[float, ...] = ()
    single: tuple[tuple[float, float, float], ...] = ()
    declared: tuple[float, ...] = ()

    @cached_property
    def frame(self) -> Array:
        """Rotation from the base to the measuring frame, shape (3, 3)."""
        return np.asarray(Rotation.from_rotvec(np.array(self.rotation)).as_matrix())

    def seen(self, positions: Array) -> Array:
        """Points of the base's frame as the instrument shows them [m], shape (..., 3)."""
        return np.asarray(positions @ self.frame.T + np.array(self.shift))

    def in_base(self, measured: Array) -> Array:
        """Measured points in the base's frame [m], shape (..., 3): the inverse of `seen`."""
        return np.asarray((measured - np.array(self.shift)) @ self.frame)

    def placed(self, s: Array) -> Array:
        """Where the markers are that readings name by arc lengths [m], shape (n_markers,)."""
        return np.interp(s, self.declared, self.markers) if self.declared else s

    def offsets(self, s: Array) -> Array:
        """Offsets of markers at arc lengths from the backbone, in their sections [m], shape (n_markers, 3)."""
        found = np.tile(self.offset, (len(s), 1))
        for at, own in zip(self.markers, self.single, strict=False):
            found[np.abs(s - at) < AT_NODE] += own
        return found


@dataclass(frozen=True, eq=False)
class Observables:
    """The quantities of a solved step, or of several on one mesh, from which readings are predicted.

    Attributes
    ----------
    s : ndarray, shape (..., n)
        Arc lengths of the nodes [m].
    positions : ndarray, shape (..., n, 3)
        Positions of the nodes in the world [m].
    rotations : ndarray, shape (..., n, 3, 3)
        Rotations of the sections; the third column is the tangent.
    displacements, base_tensions, distal_tensions : ndarray, shape (..., n_tendons)
        Pulled in at the base [m]; tensions above the base plate and at the anchor [N].
    curvature_rates : ndarray, shape (..., n - 1, 2, 3), or None
        See `StepResult`.
    """

    s: Array
    positions: Array
    rotations: Array
    displacements: Array
    base_tensions: Array
    distal_tensions: Array
    curvature_rates: Array | None = field(default=None, kw_only=True)

    @property
    def element_curvature(self) -> Array:
        """Turning rates of the elements about the section's axes x, y, z [1/m], shape (..., n - 1, 3)."""
        return turns(self.rotations) / np.diff(self.s)[..., None]


def turns(rotations: Array) -> Array:
    """Rotation vectors from one section to the next, in its own axes [rad], (..., n, 3, 3) to (..., n - 1, 3)."""
    relative = np.swapaxes(rotations[..., :-1, :, :], -1, -2) @ rotations[..., 1:, :, :]
    return Rotation.from_matrix(relative.reshape(-1, 3, 3)).as_rotvec().reshape(relative.shape[:-1])


class ObservedChange(Observables):
    """Derivatives of these quantities by parameters, which are the last axis; of the rotations, world rotation vectors.

    Arc lengths change, too: nodes move along the backbone where disks do.
    """

    def difference_steps(self, step: ObservedStep) -> Array:
        """Changes of the parameters that move a step by 1e-5 of its length, or turn it by so much, shape (P,)."""
        length, count = float(step.s[-1]), self.positions.shape[-1]
        moved = (self.positions / length, self.s / length, self.displacements / length, self.rotations)
        size = np.max([np.max(np.abs(x.reshape(-1, count)), axis=0, initial=0.0) for x in moved], axis=0)
        return np.where(size > 0.0, 1e-5 / np.where(size > 0.0, size, 1.0), 1e-5)


@dataclass(frozen=True, eq=False)
class ObservedStep(Observables):
    """`Observables` as an instrument sees them.

    Attributes
    ----------
    tendon_names : tuple of str
    observation : Observation
    """

    tendon_names: tuple[str, ...]
    observation: Observation = field(default_factory=Observation)

    @classmethod
    def of(cls, step: StepResult, names: tuple[str, ...], observation: Observation) -> ObservedStep:
        """A solved step of a robot with tendons of these names."""
        tensions = step.displacements, step.base_tensions, np.array([t[-1] for t in step.tensions])
        shape, rates = (step.s, step.positions, step.rotations), step.curvature_rates
        return cls(*shape, *tensions, names, observation, curvature_rates=rates)

    @property
    def nodes(self) -> Array:
        """Arc lengths of the nodes in the first step of a stack [m], shape (n,)."""
        return self.s.reshape(-1, self.s.shape[-1])[0]

    def levers(self, s: Array) -> Array:
        """Offsets of markers at arc lengths from the backbone, in the world [m], shape (..., n_markers, 3)."""
        nodes = np.argmin(np.abs(s[:, None] - self.nodes), axis=1)
        turns, offsets = self.rotations[..., nodes, :, :], self.observation.offsets(s)
        return np.asarray(np.einsum("...nij,nj->...ni", turns, offsets))

    def markers(self, s: Array) -> Array:
        """Measured positions of markers at arc lengths [m], shape (..., n_markers, 3)."""
        key = s.tobytes()
        if key not in self._found:  # their three coordinates are channels of their own
            self._found[key] = self._markers(s)
        return self._found[key]

    @cached_property
    def _found(self) -> dict[bytes, Array]:
        """Markers that were asked for before."""
        return {}

    def _markers(self, s: Array) -> Array:
        s = self.observation.placed(s)
        k = elements_at(self.nodes, s)
        share = (s - self.s[..., k]) / (self.s[..., k + 1] - self.s[..., k])
        p, r = self.positions, self.rotations
        if np.all((share == 0.0) | (share == 1.0)):  # at nodes, as most are
            found = np.where(share[..., None] == 0.0, p[..., k, :], p[..., k + 1, :])
        else:
            ends = p[..., k, :], r[..., k, :, :], p[..., k + 1, :], r[..., k + 1, :, :]
            found = within_elements(*ends, share)
        return self.observation.seen(found + self.levers(s))

    @property
    def tip(self) -> Array:
        """Measured position of the tip [m], shape (..., 3)."""
        lever = self.levers(self.nodes[-1:])[..., 0, :]
        return self.observation.seen(self.positions[..., -1, :] + lever)

    @property
    def tangent(self) -> Array:
        """Measured direction of the tip, shape (..., 3)."""
        return np.asarray(self.rotations[..., -1, :, 2] @ self.observation.frame.T)

    def curvature(self, s: Array) -> Array:
        """Turning rates of the section about its own axes [1/m], shape (..., n, 3).

        The mean over the element at ``s``, from the relative rotation of its ends, with the change of the curvature
        along it where that is known; at a node the mean of both sides. Of straight tendons the curvature is largest in
        the middle of a bay.
        """
        rate = self.element_curvature
        before, after = (self._within(rate, elements_at(self.nodes, s + d), s) for d in (-AT_NODE, AT_NODE))
        return 0.5 * (before + after)

    def _within(self, mean: Array, k: Index, s: Array) -> Array:
        """Curvature in elements ``k`` at arc lengths [1/m], shape (..., n, 3), from the mean of every element."""
        if self.curvature_rates is None:
            return np.asarray(mean[..., k, :])
        start, end = self.s[..., k], self.s[..., k + 1]
        along, length = s - 0.5 * (start + end), end - start
        first, second = np.moveaxis(self.curvature_rates[..., k, :, :], -2, 0)
        square = 0.5 * along**2 - length**2 / 24.0  # its mean is zero
        return np.asarray(mean[..., k, :] + first * along[..., None] + second * square[..., None])

    def moved(self, change: ObservedChange, h: Array) -> ObservedStep:
        """1 + 2 P steps: this one, and with each parameter changed by ``h`` and by ``-h``, to first order."""

        def changes(by: Array) -> Array:
            each = np.moveaxis(by * h, -1, 0)
            return np.concatenate((np.zeros((1, *each.shape[1:])), each, -each))

        names = ["s", "positions", "displacements", "base_tensions", "distal_tensions"]
        if self.curvature_rates is not None:
            names.append("curvature_rates")
        moved = {name: getattr(self, name) + changes(getattr(change, name)) for name in names}
        turn = Rotation.from_rotvec(changes(change.rotations).reshape(-1, 3)).as_matrix()
        return replace(self, rotations=turn.reshape(1 + 2 * h.size, -1, 3, 3) @ self.rotations, **moved)

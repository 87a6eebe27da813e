"""Forces inside the sections of the elements, by tendons that follow the backbone and by a nonlinear material.

All are gradients of an energy with respect to the relative twist ``xi`` of an element (length times strain),
so their nodal wrenches are ``-B^T dE/dxi`` with the strain matrix ``B`` of `strain_matrices`. The energy of a tendon of
tension ``T`` is ``T`` times its length, whose variation is the distributed wrench of the paper's Eq. 9 together with
the point wrench where the tendon ends (derivation: docs/theory.md, section "Tendons that follow the backbone").
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from tdcr_fe.elements import Array
from tdcr_fe.elements.backbone import POINTS, WEIGHTS, strain_matrices
from tdcr_fe.elements.material import Material
from tdcr_fe.elements.poses import cross, skew

#: Change for numerical derivatives by central differences: of a strain, of a coordinate of Exudyn [m, 1], or over the
#: size of what is changed [1].
DIFFERENCE = 1e-5
#: Distance from the axis at which a change of curvature by them makes that strain, over the length of the backbone [1].
THINNEST = 0.1


@dataclass(frozen=True)
class ContinuousTendons:
    """Tendons that follow the backbone."""

    offset: Array  # (m, E, 4, 3): Position in the section, in beam axes, at `gauss_arc_lengths` [m]
    slope: Array  # (m, E, 4, 3): Its derivative by the arc length [1]
    weight: Array  # (m, E): One where the tendon runs along the element, zero beyond its end

    def evaluate(self, twists: Array, lengths: Array) -> tuple[Array, Array]:
        """Length of every tendon and its gradient.

        Parameters
        ----------
        twists
            Twists of the elements, shape (..., E, 6).
        lengths
            Lengths of the elements [m], shape (E,).

        Returns
        -------
        length : ndarray, shape (m, ...)
            [m].
        gradient : ndarray, shape (m, ..., E, 6)
            With respect to the twists.
        """
        stretch, by_strain = self.along((twists / lengths[:, None])[..., None, :])
        length = (WEIGHTS * stretch * lengths[:, None]).sum(axis=(-1, -2))
        return length, (WEIGHTS[:, None] * by_strain).sum(axis=-2)

    def along(self, strain: Array) -> tuple[Array, Array]:
        """Length of every tendon by that of the backbone, and its gradient with respect to the strain.

        Shapes (m, ..., E, 4) and (m, ..., E, 4, 6), for strains at the Gauss points (..., E, 4 or 1, 6).
        """
        lead = (slice(None),) + (None,) * (strain.ndim - 3)
        offset, slope, weight = self.offset[lead], self.slope[lead], self.weight[lead][..., None]
        bend = np.broadcast_to(strain[..., 3:], (*strain.shape[:-2], len(POINTS), 3))
        e = strain[..., :3] + cross(bend, offset) + slope
        norm = np.sqrt(np.einsum("...i,...i->...", e, e))
        t = e * (weight / norm)[..., None]
        by_strain = np.concatenate((t, cross(np.broadcast_to(offset, t.shape), t)), axis=-1)
        return weight * norm, by_strain


@dataclass(frozen=True)
class SectionForces:
    """Section forces of one backbone: classical tendons, and a nonlinear material."""

    lengths: Array  # (E,): Of the elements [m]
    tendons: ContinuousTendons | None = None
    material: Material | None = None

    def gradient(self, twists: Array, tensions: Array) -> Array:
        """Gradient of the energy with respect to the twists, shape (..., E, 6), with tensions (m,) or (..., m)."""
        g = np.zeros_like(twists)
        if self.tendons is not None:
            for i, own in enumerate(self.tendons.evaluate(twists, self.lengths)[1]):
                g = g + tensions[..., i, None, None] * own
        if self.material is not None:
            g = g + self.material.gradient(twists, self.lengths)
        return g

    def wrenches(self, twists: Array, tensions: Array) -> Array:
        """Wrench ``[f, m]`` on both nodes of every element, in their own frames, shape (..., E, 12)."""
        g = self.gradient(twists, tensions)
        return -(np.swapaxes(strain_matrices(twists), -1, -2) @ g[..., None])[..., 0]

    def wrench_tangent(self, twists: Array, tensions: Array) -> Array:
        """Derivative of `wrenches` with respect to the twists of both nodes, shape (E, 12, 12).

        By central differences over the six components of the twist; the strain matrix supplies the rest. The
        differences are those of strains, so that they suit elements of any length.
        """
        stretch, bend = DIFFERENCE, DIFFERENCE / (THINNEST * self.lengths.sum())
        step = self.lengths[:, None] * np.repeat((stretch, bend), 3)
        return wrench_tangent(lambda moved: self.wrenches(moved, tensions), twists, step)


def wrench_tangent(wrenches: Callable[[Array], Array], twists: Array, step: Array) -> Array:
    """Derivative of wrenches on both nodes of every element by the motions of both, shape (E, 12, 12).

    Parameters
    ----------
    wrenches
        From twists (..., E, 6) to wrenches (..., E, 12).
    twists, step
        Twists of the elements, and by how much they are changed for the differences, shape (E, 6).
    """
    shifts = np.concatenate((np.eye(6), -np.eye(6)))[:, None, :] * step
    w = wrenches(twists + shifts)
    by_twist = np.moveaxis((w[:6] - w[6:]) / (2.0 * step.T[..., None]), 0, -1)
    return by_twist @ strain_matrices(twists)


def add_element_tangent(k: Array, blocks: Array, wrenches: Array) -> None:
    """Add the tangent of forces between neighbouring nodes, written in the nodes' moving frames, in Exudyn's sign.

    Parameters
    ----------
    k
        Changed in place, shape (6 N, 6 N).
    blocks
        See `wrench_tangent`.
    wrenches
        ``[f, m]`` on the nodes, shape (N, 6).
    """
    for e, block in enumerate(blocks):
        k[6 * e : 6 * e + 12, 6 * e : 6 * e + 12] += block
    for n, (force, moment) in enumerate(zip(skew(wrenches[:, :3]), skew(wrenches[:, 3:]), strict=True)):
        i = 6 * n
        k[i : i + 3, i + 3 : i + 6] -= force
        k[i + 3 : i + 6, i + 3 : i + 6] -= 0.5 * moment


def nodal_sum(element_wrenches: Array) -> Array:
    """Assemble element wrenches at the nodes: (..., E, 12) to (..., E+1, 6)."""
    *stack, count, _ = element_wrenches.shape
    total = np.zeros((*stack, count + 1, 6))
    total[..., :-1, :] += element_wrenches[..., :6]
    total[..., 1:, :] += element_wrenches[..., 6:]
    return total

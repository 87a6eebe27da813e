"""Forces that act inside the backbone's section: classical tendons that follow it, and superelastic softening.

Both are gradients of an energy with respect to the relative twist ``xi`` of an element (length times strain),
so their nodal wrenches are ``-B^T dE/dxi`` with the strain matrix ``B`` of `strain_matrices`. The classical tendon
of tension ``T`` has the energy ``T`` times its length, whose variation is the distributed wrench of the paper's
Eq. 9 together with the point wrench where the tendon ends (derivation in the documentation, page "Theory").
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tdcr_fe.elements.backbone import strain_matrices
from tdcr_fe.elements.poses import cross

Array = NDArray[np.float64]

#: Gauss points on [0, 1] for the length of a tendon along one element.
_POINTS, _WEIGHTS = (
    0.5 * (np.polynomial.legendre.leggauss(4)[0] + 1.0),
    0.5 * np.polynomial.legendre.leggauss(4)[1],
)


def gauss_arc_lengths(nodes: Array) -> Array:
    """Arc lengths of the integration points of every element [m], shape (E, 4)."""
    return nodes[:-1, None] + np.diff(nodes)[:, None] * _POINTS


@dataclass(frozen=True)
class ContinuousTendons:
    """Tendons that follow the backbone.

    Attributes
    ----------
    offset, slope : ndarray, shape (m, E, 4, 3)
        Position and derivative of position along arc length, in beam axes, at `gauss_arc_lengths` [m, 1].
    weight : ndarray, shape (m, E)
        One where the tendon runs along the element, zero beyond its end.
    """

    offset: Array
    slope: Array
    weight: Array

    def evaluate(self, twists: Array, lengths: Array) -> tuple[Array, Array]:
        """Length of every tendon and its gradient.

        Parameters
        ----------
        twists
            Of the elements, shape (..., E, 6).
        lengths
            Of the elements [m], shape (E,).

        Returns
        -------
        length : ndarray, shape (m, ...)
            [m].
        gradient : ndarray, shape (m, ..., E, 6)
            With respect to the twists.
        """
        lead = (slice(None),) + (None,) * (twists.ndim - 2)
        offset, slope = self.offset[lead], self.slope[lead]
        strain = (twists / lengths[:, None])[..., None, :]
        e = (
            strain[..., :3]
            + cross(np.broadcast_to(strain[..., 3:], (*strain.shape[:-2], 4, 3)), offset)
            + slope
        )
        norm = np.sqrt(np.einsum("...i,...i->...", e, e))
        factor = _WEIGHTS * self.weight[lead][..., None]
        total = np.sum(factor * norm * lengths[:, None], axis=(-1, -2))
        t = e * (factor / norm)[..., None]
        gradient = np.concatenate((t, cross(np.broadcast_to(offset, t.shape), t)), axis=-1)
        return total, gradient.sum(axis=-2)


@dataclass(frozen=True)
class SuperelasticSection:
    """Bending moment that softens with curvature.

    ``M(k) = EI [r k + (1 - r) (k - w (softplus((k - kc)/w) - softplus(-kc/w)))]`` with ``w = kc / 40``; the
    slope falls from EI to r EI over about a tenth of ``kc``.

    Attributes
    ----------
    bending_stiffness : ndarray, shape (E,)
        EI of every element [N m^2].
    threshold : float
        Curvature kc where the plateau begins [1/m].
    ratio : float
        Slope beyond it over the slope before it [1].
    precurvature : ndarray, shape (E, 3)
        Of the elements in the unloaded state, in beam axes [1/m].
    """

    bending_stiffness: Array
    threshold: float
    ratio: float
    precurvature: Array

    def gradient(self, twists: Array, lengths: Array) -> Array:
        """Gradient of the energy beyond linear elasticity with respect to the twists, shape (..., E, 6)."""
        bend = twists[..., 4:] / lengths[:, None] - self.precurvature[..., 1:]
        k = np.sqrt(np.einsum("...i,...i->...", bend, bend))
        w = self.threshold / 40.0
        kc = self.threshold
        missing = np.logaddexp(0.0, (k - kc) / w) - np.logaddexp(0.0, -kc / w)
        moment = -(1.0 - self.ratio) * w * missing * self.bending_stiffness
        gradient = np.zeros_like(twists)
        gradient[..., 4:] = bend * (moment / np.where(k > 0.0, k, 1.0))[..., None]
        return gradient


@dataclass(frozen=True)
class SectionForces:
    """Section forces of one backbone: classical tendons and superelastic softening.

    Attributes
    ----------
    lengths : ndarray, shape (E,)
        Of the elements [m].
    tendons : ContinuousTendons or None
    superelastic : SuperelasticSection or None
    """

    lengths: Array
    tendons: ContinuousTendons | None = None
    superelastic: SuperelasticSection | None = None

    def gradient(self, twists: Array, tensions: Array) -> Array:
        """Gradient of the energy with respect to the twists, shape (..., E, 6)."""
        g = np.zeros_like(twists)
        if self.tendons is not None:
            g = g + np.einsum("m,m...->...", tensions, self.tendons.evaluate(twists, self.lengths)[1])
        if self.superelastic is not None:
            g = g + self.superelastic.gradient(twists, self.lengths)
        return g

    def wrenches(self, twists: Array, tensions: Array) -> Array:
        """Wrench ``[f, m]`` on both nodes of every element, in their own frames, shape (..., E, 12)."""
        g = self.gradient(twists, tensions)
        return -(np.swapaxes(strain_matrices(twists), -1, -2) @ g[..., None])[..., 0]

    def wrench_tangent(self, twists: Array, tensions: Array) -> Array:
        """Derivative of `wrenches` with respect to the twists of both nodes, shape (E, 12, 12).

        By central differences over the six components of the twist; the strain matrix supplies the rest.
        """
        step = 1e-6
        shifts = np.concatenate((np.eye(6), -np.eye(6))) * step
        w = self.wrenches(twists + shifts[:, None, :], tensions)
        by_twist = np.moveaxis((w[:6] - w[6:]) / (2.0 * step), 0, -1)
        return by_twist @ strain_matrices(twists)


def nodal_sum(element_wrenches: Array) -> Array:
    """Assemble element wrenches at the nodes: (E, 12) to (E+1, 6)."""
    total = np.zeros((len(element_wrenches) + 1, 6))
    total[:-1] += element_wrenches[:, :6]
    total[1:] += element_wrenches[:, 6:]
    return total

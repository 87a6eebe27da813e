r"""The section law: strain from wrench and its derivative, for a stack of intervals at once.

Strain is :math:`\xi = [\kappa, \gamma]`, wrench :math:`\Lambda = [m, n]`, both in the section frame
(third axis along the tangent); the unloaded strain is :math:`\xi_0 = [p_x, p_y, 0, 0, 0, 1]`.

Linear: :math:`\Lambda = \mathrm{diag}(EI, EI, GJ, GA, GA, EA) (\xi - \xi_0)`, the paper's Eq. 5.

Superelastic: with :math:`k` the magnitude of the bending strain :math:`(\kappa - \kappa_0)_{x,y}`, the
bending moment has its direction and the magnitude

.. math:: M(k) = EI\,[\,r k + (1 - r)(k - w(\mathrm{sp}((k - k_c)/w) - \mathrm{sp}(-k_c/w)))\,],

with :math:`\mathrm{sp}(x) = \log(1 + e^x)`, :math:`k_c` = threshold strain / radius, :math:`w = 0.025 k_c`
and :math:`r` the plateau ratio, so that the slope is :math:`EI (r + (1 - r) / (1 + e^{(k - k_c)/w}))`.

Nonlinear fibres: the stress :math:`E (e + b e^2 + c e^3)` at the strain :math:`e = n + \boldsymbol\kappa \times x` of
each point of the section, integrated over the round section by Gauss's rule in the radius and equal angles.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from tdcr_fe.model.backbone import Backbone, NonlinearMaterial, Superelastic
from tdcr_fe.validation.reference.settings import Array, Index, Mask

Pair = tuple[Array, Array]


def bending_moment(curvature: Array, stiffness: Array, law: Superelastic, radius: Array | float) -> Pair:
    """Superelastic bending moment and its slope.

    Parameters
    ----------
    curvature
        Magnitude of the bending strain, >= 0 [1/m], shape (n,).
    stiffness
        Initial bending stiffness [N m^2], shape (n,).
    law
        Threshold and plateau.
    radius
        Of the backbone [m], shape (n,) or one number.

    Returns
    -------
    tuple of numpy.ndarray
        Moment [N m] and slope [N m^2], each of shape (n,).
    """
    threshold = law.threshold_strain / radius
    width = 0.025 * threshold
    x = (curvature - threshold) / width
    soft = width * (np.logaddexp(0.0, x) - np.logaddexp(0.0, -threshold / width))
    ratio = law.plateau_ratio
    moment = stiffness * (ratio * curvature + (1.0 - ratio) * (curvature - soft))
    slope = stiffness * (ratio + (1.0 - ratio) * 0.5 * (1.0 - np.tanh(0.5 * x)))
    return moment, slope


#: Quadrature over the unit disk, exact for polynomials of degree 5: points (q, 2) and weights (q,) that add up to 1.
_RADII, _RADIAL = np.polynomial.legendre.leggauss(4)
_ANGLES = np.arange(8) * np.pi / 4.0
_DISK = np.stack([np.outer(0.5 * (_RADII + 1.0), f(_ANGLES)).ravel() for f in (np.cos, np.sin)], axis=1)
_DISK_WEIGHTS = np.repeat(_RADIAL * 0.5 * (_RADII + 1.0), len(_ANGLES)) / len(_ANGLES)


@dataclass(frozen=True)
class Fibres:
    """Fibres of a stack of intervals with the stress ``E (e + b e^2 + c e^3)``.

    Attributes
    ----------
    law : NonlinearMaterial
    axial, bending : ndarray, shape (n,)
        EA [N] and EI [N m^2].
    """

    law: NonlinearMaterial
    axial: Array
    bending: Array

    def take(self, index: Index) -> Fibres:
        """Those of some of the intervals."""
        return replace(self, axial=self.axial[index], bending=self.bending[index])

    def excess(self, change: Array) -> tuple[Array, Array]:
        """Wrench beyond the linear one, (n, 6), and its derivative, (n, 6, 6), at a change of strain (n, 6).

        The strain of a fibre at (x, y) is ``gamma_z + kappa_x y - kappa_y x``; the round section has the radius that
        EI and EA give.
        """
        reach = 2.0 * np.sqrt(self.bending / self.axial)
        x, y = reach[:, None] * _DISK[:, 0], reach[:, None] * _DISK[:, 1]
        lever = np.zeros((len(change), len(_DISK), 6))
        lever[..., 0], lever[..., 1], lever[..., 5] = y, -x, 1.0
        e = (lever @ change[:, :, None])[..., 0]
        b, c = self.law.quadratic, self.law.cubic
        weight = self.axial[:, None] * _DISK_WEIGHTS
        wrench = ((weight * (b * e**2 + c * e**3))[:, None, :] @ lever)[:, 0]
        slope = weight * (2.0 * b * e + 3.0 * c * e**2)
        return wrench, np.swapaxes(lever, 1, 2) @ (slope[..., None] * lever)


@dataclass(frozen=True)
class Section:
    """Section law of a stack of intervals.

    Attributes
    ----------
    stiffness : ndarray, shape (n, 6)
        ``EI, EI, GJ, GA, GA, EA`` [N m^2, N].
    rest : ndarray, shape (n, 6)
        Unloaded strain [1/m, 1].
    rigid : ndarray of bool, shape (n,)
        Intervals that keep their unloaded strain.
    superelastic : Superelastic or None
    radius : ndarray, shape (n,)
        Of the backbone [m].
    carried : ndarray, shape (n, 6)
        Wrench carried besides the elastic one [N m, N].
    fibres : Fibres or None
        Nonlinear material.
    """

    stiffness: Array
    rest: Array
    rigid: Mask
    superelastic: Superelastic | None
    radius: Array
    carried: Array
    fibres: Fibres | None = None

    @classmethod
    def of(cls, backbone: Backbone, middles: Array, rigid: Mask) -> Section:
        """The law of intervals with the given middles [m]."""
        bending, torsion = backbone.stiffness_factors(middles)
        one = np.ones_like(middles)
        if backbone.taper:
            ratio = backbone.radius_at(middles) / backbone.radius
            bending, torsion, one = bending * ratio**4, torsion * ratio**4, ratio**2
        one = one * backbone.material_factors(middles)[0]
        bent, sheared = backbone.EI * bending, backbone.GA * one
        stiffness = np.stack((bent, bent, backbone.GJ * torsion, sheared, sheared, backbone.EA * one), axis=1)
        rest = np.tile(np.array([0.0, 0.0, 0.0, 0.0, 0.0, 1.0]), (len(middles), 1))
        rest[:, :2] = backbone.unloaded_curvature(middles)
        carried = np.zeros_like(stiffness)
        radius, fibres = backbone.radius_at(middles), None
        if backbone.nonlinear is not None:
            fibres = Fibres(backbone.nonlinear, stiffness[:, 5], stiffness[:, 0])
        return cls(stiffness, rest, rigid, backbone.superelastic, radius, carried, fibres)

    def take(self, index: Index) -> Section:
        """The law of some of the intervals."""
        fibres = None if self.fibres is None else self.fibres.take(index)
        own = {key: getattr(self, key)[index] for key in ("stiffness", "rest", "rigid", "radius", "carried")}
        return replace(self, **own, fibres=fibres)

    def softened(self, factor: float) -> Section:
        """The law with the compliance in bending and torsion grown by a factor [1]."""
        return replace(self, stiffness=self.stiffness / np.array([factor, factor, factor, 1.0, 1.0, 1.0]))

    def strain(self, wrench: Array) -> tuple[Array, Array]:
        """Strain, shape (n, 6), and its derivative with respect to the wrench, shape (n, 6, 6)."""
        if self.superelastic is not None or self.fibres is not None:
            alone = TendonCourse.none(len(wrench))
            start = self.rest + (wrench - self.carried) / self.stiffness
            return coupled_strain(self, alone, np.zeros((len(wrench), 0)), wrench, start)[:2]
        compliance = np.where(self.rigid[:, None], 0.0, 1.0 / self.stiffness)
        return self.rest + compliance * (wrench - self.carried), compliance[:, :, None] * np.eye(6)

    def wrench(self, strain: Array) -> tuple[Array, Array]:
        """Wrench, (n, 6), and its derivative by the strain, (n, 6, 6); rigidity is ignored."""
        change = strain - self.rest
        wrench = self.stiffness * change + self.carried
        derivative = self.stiffness[:, :, None] * np.eye(6)
        if self.fibres is not None:
            excess, slope = self.fibres.excess(change)
            wrench, derivative = wrench + excess, derivative + slope
        if self.superelastic is not None:
            size = np.hypot(change[:, 0], change[:, 1])
            moment, slope = bending_moment(size, self.stiffness[:, 0], self.superelastic, self.radius)
            zero = size == 0.0
            safe = np.where(zero, 1.0, size)
            direction = change[:, :2] / safe[:, None]
            secant = np.where(zero, self.stiffness[:, 0], moment / safe)
            wrench[:, :2] = secant[:, None] * change[:, :2] + self.carried[:, :2]
            along = direction[:, :, None] * direction[:, None, :]
            bend = secant[:, None, None] * np.eye(2) + (slope - secant)[:, None, None] * along
            derivative[:, :2, :2] = bend
        return wrench, derivative


@dataclass(frozen=True)
class TendonCourse:
    """Continuous tendons at one arc length of every interval.

    Attributes
    ----------
    lever : ndarray, shape (n, n_tendons, 3, 6)
        ``[-r^, 1]``: strain to the derivative of the tendon's position, without the routing's own part.
    slope : ndarray, shape (n, n_tendons, 3)
        Derivative of the routing in the section frame [1].
    square : ndarray, shape (n, n_tendons, 6, 6)
        ``lever.T @ lever``.
    """

    lever: Array
    slope: Array
    square: Array

    @classmethod
    def none(cls, n: int) -> TendonCourse:
        """No tendons in n intervals."""
        return cls(np.zeros((n, 0, 3, 6)), np.zeros((n, 0, 3)), np.zeros((n, 0, 6, 6)))

    def stretch(self, strain: Array) -> tuple[Array, Array]:
        """Length per arc length at strains (n, 6), shape (n, n_tendons), and its derivative, (n, n_tendons, 6)."""
        v = (self.lever @ strain[:, None, :, None])[..., 0] + self.slope
        size = np.sqrt(np.einsum("nti,nti->nt", v, v))
        return size, ((v / size[..., None])[:, :, None, :] @ self.lever)[:, :, 0, :]


def coupled_strain(
    section: Section, course: TendonCourse, tension: Array, wrench: Array, start: Array
) -> tuple[Array, Array, Array, Array]:
    r"""Strain of the rod where rod and continuous tendons together carry a wrench.

    The tendons' distributed forces (paper, Eq. 9) act between rod and tendon, so they are internal to a
    section that cuts both: :math:`\Lambda = H(\xi - \xi_0) + \sum_i T_i [r_i \times t_i, t_i]` with the
    tendon's unit tangent :math:`t_i = v_i / |v_i|`, :math:`v_i = \kappa \times r_i + \gamma + r_i'`.
    Differentiating this balance gives the coupled terms of Eq. 9. The strain minimises a strictly convex
    energy; Newton finds it.

    Parameters
    ----------
    section
        Law of n intervals.
    course
        The tendons there.
    tension
        Of each tendon, zero beyond its end [N], shape (n, n_tendons).
    wrench
        Of rod and tendons together [N m, N], shape (n, 6).
    start
        First guess of the strain, shape (n, 6).

    Returns
    -------
    tuple of numpy.ndarray
        Strain (n, 6); its derivatives with respect to the wrench (n, 6, 6) and to the tensions
        (n, 6, n_tendons); the tendons' stretch |v| per arc length and its derivative with respect to the
        strain stacked as (n, n_tendons, 7).
    """
    strain: Array = np.where(section.rigid[:, None], section.rest, start)
    free = ~section.rigid
    for _ in range(40):
        size, gradient = course.stretch(strain)
        value, matrix = section.wrench(strain)
        value += (tension[:, None, :] @ gradient)[:, 0, :]
        bend = course.square - gradient[..., :, None] * gradient[..., None, :]
        matrix += np.einsum("nt,ntij->nij", tension / size, bend)
        inverse = np.asarray(np.linalg.inv(matrix), dtype=float)
        change = free[:, None] * (inverse @ (wrench - value)[..., None])[..., 0]
        strain = strain + change
        if np.max(np.abs(change), initial=0.0) <= 1e-10 * (1.0 + np.max(np.abs(strain), initial=0.0)):
            break
    inverse *= free[:, None, None]
    along: Array = -inverse @ np.swapaxes(gradient, 1, 2)
    size, gradient = course.stretch(strain)
    return strain, inverse, along, np.concatenate((size[..., None], gradient), axis=-1)

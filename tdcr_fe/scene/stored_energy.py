"""Elastic energy of a robot in one configuration: backbone, tendons, springs to ground."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.special import spence

from tdcr_fe.elements.backbone import relative_twists
from tdcr_fe.elements.forces import TendonForces
from tdcr_fe.elements.native.actuation import TendonActuation
from tdcr_fe.elements.native.condensation import ElasticTendons
from tdcr_fe.elements.section import NonlinearSection, SuperelasticSection
from tdcr_fe.scene.motion import Motion

Array = NDArray[np.float64]

#: Points and weights of a rule on [-1, 1] that is exact up to degree 7.
_GAUSS = np.polynomial.legendre.leggauss(4)


def elastic_energy(
    actuation: TendonActuation, motion: Motion, forces: TendonForces, tendons: ElasticTendons
) -> float:
    """Elastic energy of backbone, tendons and springs to ground [J].

    Parameters
    ----------
    actuation
        Of the robot.
    motion
        The configuration.
    forces, tendons
        In this configuration, and how they are elastic.
    """
    found = backbone_energy(actuation, motion) + tendon_energy(forces, tendons)
    springs = actuation.model.springs
    if springs is not None:
        away = springs.rest - motion.positions[springs.nodes]
        found += 0.5 * float(np.einsum("qi,qij,qj->", away, springs.stiffness, away))
    return found


def backbone_energy(actuation: TendonActuation, motion: Motion) -> float:
    """Elastic energy of the backbone [J]."""
    mesh, section = actuation.mesh, actuation.section
    twists = relative_twists(motion.positions, motion.rotations)
    found = 0.5 * float(np.sum(mesh.twist_stiffness * (twists - mesh.reference_twists) ** 2))
    if section is not None and section.superelastic is not None:
        found += superelastic_energy(section.superelastic, twists, mesh.lengths)
    if section is not None and section.nonlinear is not None:
        found += fibre_energy(section.nonlinear, twists - mesh.reference_twists, twists, mesh.lengths)
    return found


def tendon_energy(forces: TendonForces, tendons: ElasticTendons) -> float:
    """Elastic energy of the tendons between base plate and anchor, ``T^2 l0 / (2 EA)`` [J]."""
    law = tendons.law()
    p = law.parameters
    if not law.elastic:
        return 0.0
    material = p.material - forces.field.released_length
    return 0.5 * float(
        np.sum(np.where(p.mask, p.compliance[:, None] * forces.field.tension**2 * material, 0.0))
    )


def superelastic_energy(law: SuperelasticSection, twists: Array, lengths: Array) -> float:
    """Energy of a superelastic section beyond that of linear elasticity [J]: the integral of its moment."""
    bend = twists[:, 4:] / lengths[:, None] - law.precurvature[:, 1:]
    k = np.sqrt(np.einsum("ei,ei->e", bend, bend))
    w, kc = law.threshold / 40.0, law.threshold
    at_zero = float(np.logaddexp(0.0, -kc / w))
    area = w * (_softplus_integral((k - kc) / w) - _softplus_integral(np.array(-kc / w))) - at_zero * k
    return -float(np.sum((1.0 - law.ratio) * w * law.bending_stiffness * lengths * area))


def fibre_energy(law: NonlinearSection, away: Array, twists: Array, lengths: Array) -> float:
    """Energy of nonlinear fibres beyond that of linear elasticity [J].

    The integral of their forces on the straight way from the unloaded twists, exact because these are cubic on it.

    Parameters
    ----------
    law
        The fibres.
    away, twists
        Twists of the elements less those of the unloaded state, and the twists, shape (E, 6).
    lengths
        Of the elements [m], shape (E,).
    """
    shares = 0.5 * (_GAUSS[0] + 1.0)
    forces = law.gradient(twists - (1.0 - shares)[:, None, None] * away, lengths)
    return 0.5 * float(np.einsum("s,sei,ei->", _GAUSS[1], forces, away))


def _softplus_integral(x: Array) -> Array:
    """Integral of ``log(1 + exp(x))`` from minus infinity: ``-Li2(-exp(x))``."""
    low = -spence(1.0 + np.exp(np.minimum(x, 0.0)))
    high = np.pi**2 / 6.0 + 0.5 * x**2 + spence(1.0 + np.exp(-np.maximum(x, 0.0)))
    return np.where(x > 0.0, high, low)

"""Derivatives of the tensions where coefficients of friction follow laws of normal force or slip rate."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tdcr_fe.elements.coefficients import Linearisation
from tdcr_fe.elements.tension_field import TensionDerivatives

Array = NDArray[np.float64]


def tension_derivatives(
    solved: Linearisation, angles: Array, rate_by_length: Array, hole_incidence: Array
) -> TensionDerivatives:
    """Derivatives of the tensions, the coefficients of friction following their laws.

    Parameters
    ----------
    solved
        Linearisation at the coefficients that satisfy the laws.
    angles
        Turning angles [rad], shape (m, n-1).
    rate_by_length
        Of the slip rates at the holes by the segments' lengths at kept tensions [1/s], shape (m, n-1, n).
    hole_incidence
        From the mobilisations to the holes, shape (n-1, g).
    """
    tension = solved.tension
    n, h, g = tension.shape[1], angles.shape[1], hole_incidence.shape[1]
    # Implicit function theorem: dT = E + B dmu, (I - G B) dmu = G E + ..., with E the change at kept coefficients.
    at_hole = solved.slopes()
    chain = at_hole.chain()
    beyond = chain[:, :, 1:]
    by_mobilisation = (beyond * at_hole.by_mobilisation[:, None, :]) @ hole_incidence
    by_angle = beyond * at_hole.by_angle[:, None, :]
    kept = np.concatenate((by_angle, by_mobilisation, chain[:, :, :1]), axis=2)
    change = solved.by_tension @ kept
    hole = np.arange(h)
    force_by_angle = 0.5 * (tension[:, :-1] + tension[:, 1:]) * np.cos(0.5 * angles)
    change[:, hole, hole] += solved.law.by_normal * force_by_angle
    by_length = solved.law.by_rate[:, :, None] * rate_by_length
    total = solved.by_coefficient @ np.linalg.solve(
        solved.matrix, np.concatenate((by_length, change), axis=2)
    )
    total[:, :, n:] += kept
    d_length, d_angle, by_mobilisation, d_base = np.split(total, (n, n + h, n + h + g), axis=2)
    return TensionDerivatives(d_length, d_angle, d_base[:, :, 0], by_mobilisation)

"""Exact solutions of rods, from which the error of the reference itself is computed."""

from __future__ import annotations

import numpy as np
from scipy.linalg import expm
from scipy.optimize import brentq
from scipy.special import ellipe, ellipeinc, ellipk, ellipkinc

from tdcr_fe.validation.reference.rod import hat
from tdcr_fe.validation.reference.settings import Array


def constant_strain(strain: Array, length: float) -> tuple[Array, Array]:
    """End of a rod of constant strain: a circular arc or a helix.

    Parameters
    ----------
    strain
        Curvatures [1/m] and stretches [1], section frame, shape (6,).
    length
        Unstretched length [m].

    Returns
    -------
    tuple of numpy.ndarray
        Rotation (3, 3) and position [m] (3,) of the end in the frame of the start.
    """
    twist = np.zeros((4, 4))
    twist[:3, :3], twist[:3, 3] = hat(strain[:3]), strain[3:]
    end = expm(length * twist)
    return end[:3, :3], end[:3, 3]


def helix_wrench(turn: float, twist: float, bending: float, torsional: float) -> Array:
    """Wrench at the end, section frame, that bends a straight rod to a helix of constant strain.

    The curvature is ``turn`` about y and ``twist`` about z; the force lies along the helix's axis. Shear and
    axial stiffness must be equal.

    Parameters
    ----------
    turn, twist
        [1/m].
    bending, torsional
        Stiffness [N m^2].

    Returns
    -------
    numpy.ndarray
        Moment and force [N m, N], shape (6,).
    """
    force = twist * (torsional - bending) * np.array([0.0, turn, twist])
    return np.concatenate(([0.0, bending * turn, torsional * twist], force))


def elastica_tip(length: float, bending: float, force: float) -> tuple[float, float, float]:
    """Tip of an inextensible cantilever under a dead force across its end (Bisshopp and Drucker 1945).

    Parameters
    ----------
    length
        [m].
    bending
        Stiffness [N m^2].
    force
        Across the undeformed rod [N].

    Returns
    -------
    tuple of float
        Displacement along the force [m], distance from the clamp along the undeformed rod [m], and angle of
        the tip's tangent [rad].
    """
    load = force * length**2 / bending

    def parts(modulus: float) -> tuple[float, float]:
        return modulus**2, float(np.arcsin(np.clip(1.0 / (modulus * np.sqrt(2.0)), -1.0, 1.0)))

    def miss(modulus: float) -> float:
        m, start = parts(modulus)
        return float(ellipk(m) - ellipkinc(start, m) - np.sqrt(load))

    modulus = float(brentq(miss, np.sqrt(0.5) * (1.0 + 1e-15), 1.0 - 1e-13, xtol=1e-16, rtol=1e-15))
    m, start = parts(modulus)
    sine = 2.0 * m - 1.0
    across = length * (1.0 - 2.0 / np.sqrt(load) * (ellipe(m) - ellipeinc(start, m)))
    along = length * np.sqrt(2.0 * sine / load)
    return float(across), float(along), float(np.arcsin(sine))

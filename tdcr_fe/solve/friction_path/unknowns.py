"""The unknowns along a friction path: their bounds, their complements and their scales.

The unknowns ``z`` are the mobilisations of holes [1], in [-1, 1], and the tensions at the base of tendons driven by
displacement [N], from 0 on. To each belongs a complement ``w`` [m]: of a hole its plastic slip, which is the slip less
its elastic part (presliding distance times mobilisation); of a tendon minus its slack. Inside the bounds of ``z`` the
complement is constant.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tdcr_fe.compiled import compilable
from tdcr_fe.elements.numbers import largest

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

#: Distance from a bound that is round-off, over the size of the unknown [1].
NEAR_BOUND = 1e-12
#: Upper bound of tensions, beyond all that occur [N].
UNBOUNDED = 1e100
#: Slip rates below this fraction of the presliding distance per substep are zero [1].
RATE_TOLERANCE = 1e-4
#: Smallest tension by which those at the base are scaled to lengths [N].
LEAST_SCALE = 1e-3


class Bounds(NamedTuple):
    """Bounds of the unknowns.

    Attributes
    ----------
    lower, upper : ndarray, shape (n,)
        -1 and 1 of mobilisations [1]; 0 and a number beyond all that occur of tensions [N].
    near_lower, near_upper : ndarray, shape (n,)
        Values beyond which an unknown counts as at its bound: round-off away from it.
    """

    lower: Array
    upper: Array
    near_lower: Array
    near_upper: Array

    @classmethod
    def of(cls, lower: Array, upper: Array, round_off: Array) -> Bounds:
        """Bounds, and the distance from them that counts as none, shape (n,) each."""
        return cls(lower, upper, lower + round_off, upper - round_off)


@compilable
def sides(bounds: Bounds, z: Array) -> Array:
    """1 at the upper bounds, -1 at the lower ones, 0 inside, shape (n,)."""
    at_upper = (z >= bounds.near_upper).astype(np.float64)
    at_upper -= z <= bounds.near_lower
    return at_upper


@compilable
def bounded(bounds: Bounds, z: Array) -> Array:
    """The nearest unknowns within the bounds, shape (n,)."""
    return np.minimum(np.maximum(z, bounds.lower), bounds.upper)


class PathUnknowns(NamedTuple):
    """The unknowns of a path: mobilisations of the holes, then tensions at the base of tendons driven by displacement.

    Attributes
    ----------
    holes : int
        Number of mobilisations.
    presliding : float
        Presliding distance [m].
    tolerance : float
        Rates of slip below it are zero [m].
    bounds : Bounds
    scale : ndarray, shape (n,)
        From the unknowns to lengths [m, m/N].
    """

    holes: int
    presliding: float
    tolerance: float
    bounds: Bounds
    scale: Array

    @classmethod
    def of(cls, presliding: float, holes: int, base_tension: Array, tension: Array) -> PathUnknowns:
        """Those of a substep.

        Parameters
        ----------
        presliding
            Presliding distance [m].
        holes
            Number of frictional holes.
        base_tension
            Unknown tensions at the base at its start [N], shape (c,).
        tension
            Of the segments there [N], shape (q,).
        """
        at_holes, count = np.full(holes, presliding), len(base_tension)
        at_base = np.full(count, presliding / max(LEAST_SCALE, float(tension.max())))
        return cls(
            holes,
            presliding,
            RATE_TOLERANCE * presliding,
            _bounds(holes, base_tension),
            np.append(at_holes, at_base),
        )


@compilable
def fixed_by_slack(unknowns: PathUnknowns, slack: Array) -> Flags:
    """Which unknowns stay at their bounds because their tendon has slack, shape (n,), or (0,) where there are none.

    Parameters
    ----------
    unknowns
        Of the path.
    slack
        Of the tendons driven by displacement [m], shape (c,).
    """
    if not slack.size or largest(slack) <= unknowns.tolerance:
        return np.zeros(0, dtype=np.bool_)
    fixed = np.zeros(len(unknowns.scale), dtype=np.bool_)
    fixed[unknowns.holes :] = slack > unknowns.tolerance
    return fixed


def _bounds(holes: int, base_tension: Array) -> Bounds:
    """Bounds of the mobilisations, then those of the tensions."""
    one, count = np.ones(holes), len(base_tension)
    round_off = np.full(count, NEAR_BOUND * max(1.0, float(base_tension.max(initial=0.0))))
    return Bounds.of(
        np.append(-one, np.zeros(count)),
        np.append(one, np.full(count, UNBOUNDED)),
        np.append(np.full(holes, NEAR_BOUND), round_off),
    )

"""Slips at one load factor, and their derivatives by the unknowns of the friction path."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tdcr_fe.compiled import compilable
from tdcr_fe.solve.friction_path.small_systems import Factors, solved_rows, some_rows

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
Index = NDArray[np.int_]


class SlipDerivatives(NamedTuple):
    """Derivatives of the slips at a load factor; those by an unknown are computed when first used.

    Attributes
    ----------
    by_load : ndarray, shape (n,)
        Derivatives of the slips, and of minus the slack, by the load factor at fixed unknowns [m].
    elastic_slip : ndarray, shape (n,)
        Elastic slip by each unknown: the presliding distance at holes [m], zero for tensions.
    regimes : ndarray of bool, shape (i,)
        Flags that change where the derivatives of the tensions jump; none where they never do.
    tension_by_load : ndarray, shape (q,)
        Derivatives of the tensions of the segments by the load factor [N].
    direct : ndarray, shape (n, q)
        Derivatives of the tensions by the unknowns at fixed turning angles [N, 1].
    by_tension : ndarray, shape (n, q)
        Derivatives of the slips by the tensions of the segments [m/N].
    turning : Factors
        Of the identity less the derivatives of the tensions by themselves through the turning angles.
    missing : ndarray of bool, shape (n,)
        Unknowns whose derivatives were not used yet.
    columns : ndarray, shape (n, n)
        Row by row, minus the derivatives of the complements by one of the unknowns, see `columns_of`.
    tensions : ndarray, shape (n, q)
        Derivatives of the tensions by the unknowns [N, 1].
    """

    by_load: Array
    elastic_slip: Array
    regimes: Flags
    tension_by_load: Array
    direct: Array
    by_tension: Array
    turning: Factors
    missing: Flags
    columns: Array
    tensions: Array


class SlipState(NamedTuple):
    """Slips at a load factor, and their derivatives there or nearby.

    Attributes
    ----------
    tension : ndarray, shape (q,)
        Of the segments [N].
    slip : ndarray, shape (n,)
        At the frictional holes, then minus the slack [m].
    derivatives : SlipDerivatives
    """

    tension: Array
    slip: Array
    derivatives: SlipDerivatives


@compilable
def columns_of(derivatives: SlipDerivatives, which: Index) -> Array:
    """Minus the derivatives of the complements by some of the unknowns, in ascending order, shape (i, n).

    One unknown a row. For a hole presliding distance times identity, minus the derivatives of the slips by its
    mobilisation [m]; for a tendon minus those by its tension [m/N].
    """
    new = which[derivatives.missing[which]]
    if new.size:
        columns, n = derivatives.columns, len(derivatives.missing)
        tensions = solved_rows(derivatives.turning, some_rows(derivatives.direct, new))
        columns[new] = -tensions.dot(derivatives.by_tension.T)
        diagonal = columns.reshape(-1)[:: n + 1]
        diagonal[new] += derivatives.elastic_slip[new]
        derivatives.tensions[new] = tensions
        derivatives.missing[new] = False
    return some_rows(derivatives.columns, which)


@compilable
def tension_columns(derivatives: SlipDerivatives, which: Index) -> Array:
    """Derivatives of the tensions of the segments by some unknowns, which `columns_of` has computed [N, 1], (i, q)."""
    return some_rows(derivatives.tensions, which)


@compilable
def extrapolated(
    state: SlipState, length: float, tension: Array, rate: Array, complement: Array
) -> SlipState:
    """The state a little further on, with the same derivatives.

    Parameters
    ----------
    state
        The state here.
    length
        By how much the load factor is larger [1].
    tension
        Of the segments there [N], shape (q,).
    rate
        Rates of all unknowns [1, N], shape (n,).
    complement
        Rates of their complements [m], shape (n,).
    """
    moved = state.slip + length * (complement + state.derivatives.elastic_slip * rate)
    return SlipState(tension, moved, state.derivatives)


@compilable
def with_changed(state: SlipState, which: Index, columns: Array, change: Array) -> SlipState:
    """The state at the same load factor with some of the unknowns changed a little, with the same derivatives.

    Parameters
    ----------
    state
        The state before.
    which
        Numbers of the unknowns.
    columns
        Their `columns_of`.
    change
        Their changes [1, N], shape (i,).
    """
    by = state.derivatives
    slip = state.slip - change.dot(columns)
    slip[which] += by.elastic_slip[which] * change
    return SlipState(state.tension + change.dot(tension_columns(by, which)), slip, by)


@compilable
def left_regimes(derivatives: SlipDerivatives, regimes: Flags) -> bool:
    """Whether the derivatives jump between where they were evaluated and a state with these regimes."""
    return regimes.size > 0 and bool((derivatives.regimes != regimes).any())

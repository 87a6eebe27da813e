"""Derivatives of a robot's forces and slips by parameters at a fixed state, as differences between neighbouring models.

Poses, tensions at the base and mobilisations are kept. The models at neighbouring values are built once; nothing is
known of what a parameter means.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from tdcr_fe.elements.forces import TendonForces
from tdcr_fe.solve.sensitivities.differences import Neighbours
from tdcr_fe.solve.sensitivities.robot_model import ModelStack, RobotModel, RobotPoint, Values

Array = NDArray[np.float64]


class Inherited(NamedTuple):
    """Derivatives of what an increment inherits, and of its times."""

    slip: Array  # (m, g, P): Of the history [m, m/s]
    slip_rate: Array  # as `slip`
    time: Array  # (P,): Of the time at its end, and of its duration [s]
    elapsed: Array  # as `time`


def with_rates(change: Values, own: TendonForces, rate: Array, inherited: Inherited | None) -> Values:
    """The change of forces where the rates of slip follow, of one where they are kept.

    Rates are slips since the beginning of an increment over its duration. What changes them acts like released
    lengths, whose effect the forces know. Differences would have to be small against the slip at which a law's
    coefficient falls, which no parameter knows.

    Parameters
    ----------
    change
        Of a robot whose nodes, tensions at the base and mobilisations are kept; parameters are the last axis.
    own
        Forces in the present state.
    rate
        Of the slips [m/s], shape (m, g).
    inherited
        Changes of the slips from which the rates are counted, and of the duration; None where there are none.
    """
    field, law = own.field, own.model.law
    if not field.depends_on_length:
        return change
    released = change.released
    if inherited is not None:
        by_slip = np.stack([np.linalg.pinv(law.slip_operator * exists) for exists in law.parameters.mask])
        released = released - by_slip @ (inherited.slip + rate[:, :, None] * inherited.elapsed)
    by_length = field.released_d_length[:, :, None]
    longer = np.zeros_like(change.tension)
    np.divide(released, by_length, out=longer, where=by_length != 0.0)
    moved = field.d_length @ longer
    wrenches = change.wrenches.copy()
    wrenches[own.model.cable_nodes] += own.measured.shape.lines.softening(moved)
    by_tension = field.released_d_tension[:, :, None]
    return Values(wrenches, change.tension + moved, change.released + by_tension * moved)


class ExplicitDerivatives:
    """Derivatives of one robot's forces by its parameters.

    Parameters
    ----------
    present
        Model at the present values.
    neighbours
        Models at neighbouring values, by parameter of the description; inputs of the load steps have none.
    count
        Number of parameters P, inputs included.

    Attributes
    ----------
    law : FrictionModel
        Of the friction in the models; where the present one has none, that of the neighbours.
    arc_lengths : ndarray, shape (N, P)
        Derivatives of the arc lengths of the nodes [m].
    """

    def __init__(self, present: RobotModel, neighbours: Neighbours, count: int) -> None:
        self.present = present
        models, self._owner = [present], np.full(1, -1)
        self._offsets = np.zeros(1)
        for number, each in neighbours.items():
            models += each.models
            self._owner = np.append(self._owner, np.full(len(each.models), number))
            self._offsets = np.append(self._offsets, each.offsets)
        weights = np.concatenate([np.zeros(0), *(each.weights for each in neighbours.values())])
        place = self._owner[1:], np.arange(1, len(models))
        self._weights = sparse.csr_array((weights, place), (count, len(models)))
        self._stack = ModelStack(models)
        self.law = self._stack.tendons.law.law
        self.arc_lengths = self._derivative(np.stack([m.forces.mesh.arc_lengths for m in models]))

    def _derivative(self, values: Array) -> Array:
        """Derivatives from values of all models, (S, ...) to (..., P)."""
        shape, count = values.shape[1:], self._weights.shape[0]
        change = (values - values[0]).reshape(len(values), math.prod(shape))
        return np.ascontiguousarray((self._weights @ change).T).reshape(*shape, count)

    def released_unloaded(self) -> Array:
        """Derivatives of the released lengths in the unloaded shape without tension, shape (m, n, P)."""
        tendons = self._stack.tendons
        shape = (1 + tendons.index.max(), *self.present.forces.law.shape)
        values = tendons.law.released_unloaded().reshape(shape)
        return self._derivative(values[tendons.index])

    def at(
        self,
        own: TendonForces,
        point: RobotPoint,
        rate: Array,
        times: tuple[float, float],
        inherited: Inherited,
    ) -> Values:
        """Derivatives in a state by all parameters, which are the last axis.

        Parameters
        ----------
        own
            Forces there.
        point
            The state.
        rate
            Of the slips [m/s], shape (m, g).
        times
            At the beginning and at the end of the increment [s].
        inherited
            Derivatives of history and times.
        """
        begin, end = times
        if len(self._owner) == 1:  # inputs alone, as in inverse statics
            count = self._weights.shape[0]
            still = np.zeros((*own.field.tension.shape, count))
            none = Values(np.zeros((len(point.positions), 6, count)), still, still)
            return with_rates(none, own, rate, inherited)
        by_parameter = np.append(inherited.time, 0.0)
        rates = np.broadcast_to(rate, (len(self._owner), *rate.shape))
        if end <= begin and rate.shape == inherited.slip_rate.shape[:2]:
            # No time passes: the rates are those of the history.
            by_rate = np.append(inherited.slip_rate, np.zeros((*rate.shape, 1)), axis=2)
            rates = rates + np.moveaxis(by_rate[..., self._owner] * self._offsets, -1, 0)
        values = self._stack.at(point, rates, end + by_parameter[self._owner] * self._offsets)
        return with_rates(Values(*map(self._derivative, values)), own, rate, inherited)

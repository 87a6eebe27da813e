"""Forces of a robot for Exudyn's own solvers, where tendons driven by displacement are elastic."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tdcr_fe.elements.forces import ForceModel, Measurement, TendonForces
from tdcr_fe.elements.friction import TendonLaw
from tdcr_fe.elements.history import RobotHistory

Array = NDArray[np.float64]


class ElasticTendons(NamedTuple):
    """Tendons of a robot, those that are inextensible and driven by displacement with an elasticity.

    In Exudyn's own solvers the tension is not an unknown, so every driven tendon must be elastic.

    Attributes
    ----------
    model : ForceModel
        With the tendons as they are.
    driven : ndarray of bool, shape (m,)
        Which tendons have their displacement prescribed.
    history : RobotHistory
        At the beginning of the step.
    stiffness : float
        EA used for an inextensible tendon [N].
    """

    model: ForceModel
    driven: NDArray[np.bool_]
    history: RobotHistory
    stiffness: float

    def law(self) -> TendonLaw:
        """How tension passes along these tendons."""
        law = self.model.law
        parameters = law.parameters
        inextensible = self.driven & (parameters.compliance == 0.0)
        if not np.any(inextensible):
            return law
        return law.with_parameters(
            compliance=np.where(inextensible, 1.0 / self.stiffness, parameters.compliance),
            lengths=parameters.lengths + np.where(inextensible[:, None], self.history.stretch, 0.0),
        )

    def forces(self, measured: Measurement, values: Array, near: Array, t: float) -> TendonForces:
        """Forces where the tension of tendons driven by displacement follows from their elasticity.

        Parameters
        ----------
        measured
            The configuration.
        values
            Inputs, tensions [N] and displacements [m] at the base, shape (m,).
        near
            Tensions at the base from which those of driven tendons are sought [N], shape (m,).
        t
            Time [s].
        """
        driven, state = self.driven, self.history.friction
        if not np.any(driven):
            return self.model.after(measured, values, state, t)
        soft = self.law()
        tension = np.where(driven, near, values)
        for _ in range(60):
            forces = self.model.after(measured, tension, state, t, soft)
            change = (values - forces.field.base_slip) / forces.base_slip_by_base()
            new = np.where(driven, np.maximum(tension + change, 0.0), tension)
            moved = np.max(np.abs(new - tension))
            tension = new
            if moved <= 1e-12 * (1.0 + np.max(new)):
                break
        forces = self.model.after(measured, tension, state, t, soft)
        pulled = driven & (tension > 0.0)
        slope = np.where(pulled, -1.0 / forces.base_slip_by_base(), 0.0)
        return forces._replace(base_response=slope[:, None] * forces.base_slip_by_holes())

    def at_rest(self, measured: Measurement) -> TendonForces:
        """Forces in a configuration at the tensions and mobilisations of the history."""
        history, friction = self.history, self.history.friction
        model = replace(self.model, law=self.law())
        return model.at_mobilisation(
            measured, history.base_tension, friction.mobilisation, friction, friction.time
        )


def stretch(law: TendonLaw, tension: Array, lengths: Array, stiffness: float) -> Array:
    """Stretch, see `RobotHistory`, with which tendons of their own elasticity take over at these tensions [m], (m, n).

    Parameters
    ----------
    law
        Of the tendons as they are.
    tension, lengths
        Of the segments [N, m], shape (m, n).
    stiffness
        EA used for an inextensible tendon [N].
    """
    relative = tension / stiffness
    stretched = -lengths * relative / (1.0 + relative)
    parameters = law.parameters
    stretched = np.where(parameters.mask, stretched, 0.0)
    return np.where(parameters.compliance[:, None] == 0.0, stretched, 0.0)

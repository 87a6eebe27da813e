"""Tangent of a robot's forces for Exudyn's own solvers: stuck holes and driven tendons are condensed."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from tdcr_fe.elements import Array, Flags, Index
from tdcr_fe.elements.forces import ForceModel, Measurement, SlipEquations, TendonForces
from tdcr_fe.elements.friction import TendonLaw
from tdcr_fe.elements.native.history import RobotHistory

#: EA of an inextensible tendon that Exudyn's own solvers drive by displacement, over EI / L^2 of the backbone [1].
STIFFNESS = 2e6
#: Round-off of lengths that follow from Exudyn's coordinates, of a tendon over its own length, and of an element over
#: that of the backbone [1].
ROUND_OFF = 200.0 * float(np.finfo(float).eps)


@dataclass(frozen=True, eq=False)
class ElasticTendons:
    """Tendons of a robot in a step, those that are inextensible and driven by displacement with an elasticity.

    In Exudyn's own solvers the tension is not an unknown, so every driven tendon must be elastic.
    """

    model: ForceModel  # With the tendons as they are
    driven: Flags  # (m,): Which tendons have their displacement prescribed
    history: RobotHistory  # At the beginning of the step
    values: Array  # (m,): Inputs at the end of the step, tensions [N] and displacements [m] at the base
    time: float  # There [s]

    def same_step(self, other: ElasticTendons) -> bool:
        """Whether these and others are those of the same attempt of a step."""
        same = self.time == other.time and self.driven is other.driven and self.history is other.history
        return same and self.values.tobytes() == other.values.tobytes()

    @cached_property
    def iterated(self) -> bool:
        """Whether tensions follow from angles and mobilisations alone, so that holes may be predicted."""
        return self.model.law.simple and not self.driven.any()

    @cached_property
    def elastic(self) -> ForceModel:
        """The forces of these tendons."""
        law = self.model.law
        parameters = law.parameters
        inextensible = self.driven & parameters.rigid
        if not np.any(inextensible):
            return self.model
        elastic = replace(
            parameters,
            compliance=np.where(inextensible, 1.0 / own_stiffness(self.model), parameters.compliance),
            lengths=parameters.lengths + np.where(inextensible[:, None], self.history.stretch, 0.0),
        )
        return replace(self.model, law=TendonLaw(elastic, law.model, law.hysteresis))

    def forces(self, measured: Measurement, near: Array) -> TendonForces:
        """Forces where the tension of tendons driven by displacement follows from their elasticity.

        Parameters
        ----------
        measured
            The configuration.
        near
            Tensions at the base from which those of driven tendons are sought [N], shape (m,).
        """
        driven, state, values, t = self.driven, self.history.friction, self.values, self.time
        if not np.any(driven):
            return self.model.after(measured, values, state, t)
        elastic = self.elastic
        tension, parameters = np.where(driven, near, values), elastic.law.parameters
        # That of the tension of each: the slope may vanish far from the solution, and is no measure of it.
        length = parameters.lengths.sum(axis=1)
        compliance = length * parameters.compliance + parameters.spring
        round_off = np.divide(ROUND_OFF * length, compliance, np.zeros(len(driven)), where=driven)
        low, high, before = (np.full(len(driven), x) for x in (-np.inf, np.inf, np.inf))
        for _ in range(60):
            forces = elastic.after(measured, tension, state, t)
            slope, gap = forces.base_slip_by_base(), values - forces.field.base_slip
            new = np.maximum(tension + np.divide(gap, slope, np.zeros(len(driven)), where=driven), 0.0)
            moved = np.abs(new - tension) > 1e-12 * (1.0 + np.max(new)) + round_off
            low, high = np.where(gap > 0.0, tension, low), np.where(gap < 0.0, tension, high)
            # Newton's method may go to and fro about a corner of the slip as a function of the tension.
            width = np.where(np.isfinite(high - low), high - low, 0.0)
            halved = moved & (np.abs(gap) > 0.5 * before) & (width > 0.0)
            tension, before = np.where(halved, high - 0.5 * width, new), np.abs(gap)
            if not moved.any():  # ends with nan, too
                break
        return elastic.after(measured, tension, state, t)


def at_rest(model: ForceModel, measured: Measurement, history: RobotHistory) -> TendonForces:
    """Forces of a model in a configuration, at the tensions and mobilisations of a history."""
    friction, tension = history.friction, history.base_tension
    field = model.law.field(tension, measured.shape, friction.mobilisation, friction, friction.time)
    return TendonForces(model, measured, tension, field)


def own_stiffness(model: ForceModel) -> float:
    """EA of its inextensible tendons that Exudyn's own solvers drive by displacement [N]."""
    # Rigid inserts bend by nothing, and do not count.
    return float(STIFFNESS / (model.mesh.arc_lengths[-1] * model.mesh.flexibility))


def stretch(model: ForceModel, tension: Array, lengths: Array) -> Array:
    """Stretch, see `RobotHistory`, with which tendons of their own elasticity take over at these tensions [m], (m, n).

    Parameters
    ----------
    model
        With the tendons as they are.
    tension, lengths
        Tensions and lengths of the segments [N, m], shape (m, n).
    """
    relative = tension / own_stiffness(model)
    stretched = -lengths * relative / (1.0 + relative)
    parameters = model.law.parameters
    return np.where(parameters.mask & parameters.rigid[:, None], stretched, 0.0)


def _slip_equations(forces: TendonForces, driven: Flags, stuck: bool) -> tuple[SlipEquations, Index]:
    """Slips as in `add_condensed`, and the numbers of those that are eliminated, shape (d + k,)."""
    slips, m = forces.slip_equations(holes=stuck), len(driven)
    if stuck:
        resting = np.append(np.zeros(m), forces.resting_flexibility[forces.model.law.frictional])
        slips = slips._replace(matrix=slips.matrix - np.diag(resting))
    return slips, np.append(np.flatnonzero(driven), np.arange(m, len(slips.matrix)))


def forces_by_inputs(forces: TendonForces, winds: Flags, stuck: bool) -> Array:
    """Change of the forces on the nodes with the inputs of the tendons, shape (6 N, m).

    Parameters
    ----------
    forces
        As in `add_condensed`.
    winds
        Which tendons are driven by displacement, shape (m,); the others by tension. A slack one does not act.
    stuck
        As in `add_condensed`.
    """
    taut = winds & (forces.base_tension > 0.0)
    slips, kept = _slip_equations(forces, taut, stuck)
    given = np.where(winds, 0.0, -slips.matrix[kept, : len(taut)])
    given[np.arange(np.count_nonzero(taut)), np.flatnonzero(taut)] = 1.0
    change = np.linalg.solve(slips.matrix[np.ix_(kept, kept)], given)
    return np.where(winds, 0.0, slips.columns[:, : len(taut)]) + slips.columns[:, kept] @ change


def add_condensed(k: Array, forces: TendonForces, driven: Flags, stuck: bool) -> None:
    """Add the change of tensions at the base and of mobilisations with the nodes to a tangent.

    Without it the tangent is that at fixed tensions at the base, the mobilisations being as those of the forces. The
    mobilisation of a hole that sticks follows its slip, ``ds = du / delta``; a tendon that is driven by displacement
    keeps its displacement. Both are linear equations beside those of the nodes, and are eliminated.

    Parameters
    ----------
    k
        By body-frame increments of the nodes, changed in place, shape (6 N, 6 N).
    forces
        Tendons that are driven by displacement are elastic. To let holes stick, at the mobilisations of a solved state.
    driven
        Which tendons are driven by displacement and taut, shape (m,).
    stuck
        Whether every frictional hole sticks; where not, mobilisations stay or follow as in the forces, so that holes at
        those of a solved state slide on in their direction, or are at rest without resistance.
    """
    if stuck or driven.any():
        slips, kept = _slip_equations(forces, driven, stuck)
        k -= slips.columns[:, kept] @ np.linalg.solve(slips.matrix[np.ix_(kept, kept)], slips.rows[kept])

"""Forces of a robot on the coordinates of its nodes, and their tangent, as Exudyn's own solvers ask for them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tdcr_fe.elements.forces import TendonForces
from tdcr_fe.elements.hysteresis import FrictionState
from tdcr_fe.elements.native.condensation import ElasticTendons, add_condensed, forces_by_inputs
from tdcr_fe.elements.native.coordinates import (
    NodeCoordinates,
    generalized_forces,
    generalized_tangent,
    twists_by_coordinates,
)
from tdcr_fe.elements.native.iterated import HoleIterate, HolePrediction, PastStep, predicted_holes
from tdcr_fe.elements.native.motors import Motor, torques, with_motors

Array = NDArray[np.float64]

#: What a linearisation assumes of holes with friction.
Holes = Literal["present", "stuck", "sliding"]

#: Tensions [N] and displacements [m] at the base, shape (m,), as set or over time [s].
Inputs = Array | Callable[[float], Array]


def values_at(inputs: Inputs, t: float) -> Array:
    """Tensions [N] and displacements [m] at the base at time t [s], shape (m,)."""
    return np.asarray(inputs(t) if callable(inputs) else inputs, dtype=float)


class Evaluation(NamedTuple):
    """Forces evaluated in a scene, and for what."""

    coordinates: Array  # (7 N,): Of the nodes, as displacements
    time: float  # [s]
    inputs: Inputs  # As set
    tendons: ElasticTendons  # With the history at the beginning of the step
    values: Array  # (m,): Inputs at that time
    rotations: Array  # Of the nodes, shapes (N, 3, 3) and (N, 4)
    parameters: Array  # as `rotations`
    forces: TendonForces
    holes: HoleIterate | None  # Of which these are the forces, where holes are iterated, see `SceneForces`

    def of_step(self, time: float, inputs: Inputs, tendons: ElasticTendons) -> bool:
        """Whether it belongs to the same attempt of a step."""
        own = self.tendons
        return (
            self.time == time
            and self.inputs is inputs
            and own.driven is tendons.driven
            and own.history is tendons.history
        )


class StepEnd(NamedTuple):
    """What a solved step leaves to the history, and to what is drawn."""

    friction: FrictionState
    values: Array  # (m,): Inputs at the end of the step, and tensions at the base [N]
    base_tension: Array  # as `values`
    tension: Array  # (m, n): Of the segments [N, m]
    lengths: Array  # as `tension`
    base_slip: Array  # (m,): Tendon pulled in at the base plate [m]
    offsets: Array | None  # (m, n+1, 3): Of the tendons in their holes [m]; None where they cannot shift


class SceneForces:
    """Forces of one robot; a step starts from the tensions of the evaluation before.

    Where tensions follow from angles and mobilisations alone, holes are predicted and linearised by secants, see
    `tdcr_fe.elements.native.iterated`.

    Parameters
    ----------
    coordinates
        Of its nodes.
    """

    def __init__(self, coordinates: NodeCoordinates) -> None:
        self._coordinates = coordinates
        self._last: Evaluation | None = None
        self._past: PastStep | None = None
        #: History at the beginning of the step in which the tangent was last evaluated.
        self._linearised: FrictionState | None = None
        #: Whether the last step was solved with the tangent: numerical derivatives need one law in all evaluations.
        self._by_tangent = True

    def forget(self) -> None:
        """Forget the last evaluation, after another `Assemble`."""
        self._last = None

    def at(
        self, coordinates: Array, t: float, inputs: Inputs, tendons: ElasticTendons, *, by_law: bool = True
    ) -> Evaluation:
        """Forces in a configuration: those of the last evaluation if it was for the same.

        Parameters
        ----------
        coordinates
            Of the nodes, without reference values, shape (7 N,).
        t
            Time [s].
        inputs
            Tensions and displacements at the base.
        tendons
            With the history at the beginning of the step.
        by_law
            Whether the last evaluation does not count where it was for holes as predicted.
        """
        last, history, iterated = self._last, tendons.history, tendons.iterated
        same = last if last is not None and last.of_step(t, inputs, tendons) else None
        near: HolePrediction | HoleIterate | None = None
        if same is not None:
            predicted = by_law and same.holes is not None and same.holes.predicted
            if not predicted and np.array_equal(same.coordinates, coordinates):
                return same
            near = same.holes
        elif self._by_tangent and iterated and not (last is not None and last.tendons.history is history):
            # A step that is tried again with another size was not solved with the prediction.
            near = predicted_holes(self._past, history.friction, t)
        positions, rotations, parameters = self._coordinates.poses(coordinates.reshape(-1, 7))
        values, holes = values_at(inputs, t), None
        measured = tendons.model.measure(positions, rotations)
        if iterated:
            law, friction = tendons.model.law, history.friction
            holes = HoleIterate.of(law, values, measured.shape, friction, t, near)
            forces = TendonForces(tendons.model, measured, values, holes.field)
        else:
            warm = last is not None and last.tendons.history is history
            start = last.forces.base_tension if last is not None and warm else history.base_tension
            forces = tendons.forces(measured, values, start, t)
        self._last = Evaluation(coordinates, t, inputs, tendons, values, rotations, parameters, forces, holes)
        return self._last

    def step_end(self, coordinates: Array, t: float, inputs: Inputs, tendons: ElasticTendons) -> StepEnd:
        """What is to be committed where a solved step ends; arguments as in `at`."""
        found, start = self.at(coordinates, t, inputs, tendons), tendons.history.friction
        field, measured = found.forces.field, found.forces.measured
        friction = tendons.model.law.commit(field)
        if found.holes is not None:
            self._past = PastStep.of(start, found.holes.trial, friction, self._past)
        if t > start.time:
            self._by_tangent = self._linearised is start
        return StepEnd(
            friction,
            found.values,
            found.forces.base_tension,
            field.tension,
            measured.shape.lengths,
            field.base_slip,
            measured.offsets,
        )

    # ------------------------------------------------------------------ on the coordinates of the nodes

    def generalized(
        self,
        coordinates: Array,
        t: float,
        inputs: Inputs,
        tendons: ElasticTendons,
        motors: Sequence[Motor] = (),
    ) -> Array:
        """Generalised forces on the coordinates of the nodes, then the torques on motors [N m], shape (7 N + k,).

        Parameters
        ----------
        coordinates, t, inputs, tendons
            As in `at`; the inputs include what motors have wound.
        motors
            Of the robot.
        """
        found = self.at(coordinates, t, inputs, tendons)
        on_nodes = generalized_forces(found.forces.nodal_wrenches(), found.rotations, found.parameters)
        return np.append(on_nodes, torques(motors, found.forces))

    def tangent(
        self,
        coordinates: Array,
        t: float,
        inputs: Inputs,
        tendons: ElasticTendons,
        holes: Holes,
        motors: Sequence[Motor] = (),
    ) -> Array:
        """Derivative of `generalized` by the coordinates of nodes and motors, shape (7 N + k, 7 N + k).

        Parameters
        ----------
        coordinates, t, inputs, tendons, motors
            As in `generalized`.
        holes
            What is assumed of holes with friction: the derivative of the forces, or that all stick or slide on.
        """
        self._linearised = tendons.history.friction
        found = self.at(coordinates, t, inputs, tendons, by_law=False)
        forces = found.forces
        if holes != "present":
            forces = tendons.at_rest(forces.measured)
        n = len(found.rotations)
        k = np.zeros((6 * n, 6 * n))
        forces.add_tangent(k)
        if holes != "present":
            taut = tendons.driven & (forces.base_tension > 0.0)
            add_condensed(k, forces, taut, holes == "stuck")
        to_twist = twists_by_coordinates(found.rotations, found.parameters)
        tangent = generalized_tangent(k, forces.nodal_wrenches()[:, 3:], to_twist)
        if not motors:
            return tangent
        return with_motors(
            motors, tangent, forces, tendons.driven, found.rotations, found.parameters, to_twist
        )

    def by_inputs(self, tendons: ElasticTendons, stuck: bool) -> Array:
        """Change of the generalised forces with the inputs in the scene's current configuration, shape (7 N, m).

        At the tensions and mobilisations of the history: by tension [N] or by displacement [m], as every tendon is
        driven.

        Parameters
        ----------
        tendons
            With the history.
        stuck
            Whether every hole with friction sticks; else every one slides on.
        """
        positions, rotations, parameters = self._coordinates.poses(self._coordinates.displacements())
        forces = tendons.at_rest(tendons.model.measure(positions, rotations))
        columns = forces_by_inputs(forces, tendons.driven, stuck, 6 * len(positions))
        return np.stack(
            [generalized_forces(each.reshape(-1, 6), rotations, parameters) for each in columns.T], axis=1
        )

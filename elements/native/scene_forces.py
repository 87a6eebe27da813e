"""Forces of a robot on the coordinates of its nodes, and their tangent, as Exudyn's own solvers ask for them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tdcr_fe.elements.forces import ForceModel, TendonForces
from tdcr_fe.elements.hysteresis import FrictionState
from tdcr_fe.elements.native.condensation import ElasticTendons, add_condensed, forces_by_inputs
from tdcr_fe.elements.native.coordinates import (
    NodeCoordinates,
    generalized_forces,
    generalized_tangent,
    twists_by_coordinates,
)
from tdcr_fe.elements.native.iterated import IteratedTendons
from tdcr_fe.elements.native.motors import Motor, torques, with_motors
from tdcr_fe.elements.native.straight_tendons import StraightTendons

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

    Parameters
    ----------
    coordinates
        Of its nodes.
    model
        Of its forces.
    """

    def __init__(self, coordinates: NodeCoordinates, model: ForceModel) -> None:
        self._coordinates = coordinates
        self._last: Evaluation | None = None
        straight = StraightTendons.of(model)
        self._straight = None if straight is None else IteratedTendons(straight, coordinates)

    def forget(self) -> None:
        """Forget the last evaluation, after another `Assemble`."""
        self._last = None

    def matching(self, coordinates: Array, t: float, inputs: Inputs, tendons: ElasticTendons) -> Evaluation:
        """The last evaluation if it was for the same state, inputs and time, else a new one; arguments as in `at`."""
        last = self._last
        if (
            last is not None
            and last.time == t
            and last.inputs is inputs
            and last.tendons.driven is tendons.driven
            and last.tendons.history is tendons.history
            and np.array_equal(last.coordinates, coordinates)
        ):
            return last
        return self.at(coordinates, t, inputs, tendons)

    def at(self, coordinates: Array, t: float, inputs: Inputs, tendons: ElasticTendons) -> Evaluation:
        """Forces in a configuration.

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
        """
        positions, rotations, parameters = self._coordinates.poses(coordinates.reshape(-1, 7))
        values, history, last = values_at(inputs, t), tendons.history, self._last
        measured = tendons.model.measure(positions, rotations)
        warm = last is not None and last.tendons.history is history
        near = last.forces.base_tension if last is not None and warm else history.base_tension
        forces = tendons.forces(measured, values, near, t)
        self._last = Evaluation(coordinates, t, inputs, tendons, values, rotations, parameters, forces)
        return self._last

    def step_end(self, coordinates: Array, t: float, inputs: Inputs, tendons: ElasticTendons) -> StepEnd:
        """What is to be committed where a solved step ends; arguments as in `at`."""
        if self._straight is not None and not tendons.driven.any():
            values, state = values_at(inputs, t), tendons.history.friction
            friction, base_slip, pull = self._straight.step_end(coordinates, t, state, values)
            return StepEnd(friction, values, values, pull.tension.T, pull.straight.lengths.T, base_slip, None)
        found = self.matching(coordinates, t, inputs, tendons)
        forces, field = found.forces, found.forces.field
        measured = forces.measured
        return StepEnd(
            tendons.model.law.commit(field),
            found.values,
            forces.base_tension,
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
        if self._straight is not None and not tendons.driven.any() and not motors:
            state = tendons.history.friction
            return self._straight.forces(coordinates, t, state, values_at(inputs, t))
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
        if self._straight is not None and holes == "present" and not tendons.driven.any() and not motors:
            state = tendons.history.friction
            return self._straight.tangent(coordinates, t, state, values_at(inputs, t))
        found = self.matching(coordinates, t, inputs, tendons)
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

"""Forces of a robot on the coordinates of nodes and motors, and their tangent, as Exudyn's own solvers ask for them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Literal, NamedTuple

import numpy as np

from tdcr_fe.elements import Array
from tdcr_fe.elements.forces import TendonForces
from tdcr_fe.elements.hysteresis import FrictionState
from tdcr_fe.elements.native.condensation import ElasticTendons, add_condensed, at_rest
from tdcr_fe.elements.native.coordinates import (
    NodeCoordinates,
    generalized_forces,
    generalized_tangent,
    twists_by_coordinates,
)
from tdcr_fe.elements.native.iterated import HoleIterate


class Motor(NamedTuple):
    """A motor that winds a tendon on a drum."""

    tendon: int  # Number of the tendon
    node: Any  # Exudyn's node of its angle [rad]
    radius: float  # Radius of the drum [m]: a positive angle pulls the tendon in


def wound(motors: Sequence[Motor], values: Array, angles: Array) -> Array:
    """Inputs of the tendons with what the motors have wound, shape (m,).

    Parameters
    ----------
    motors
        Motors of the robot.
    values
        Inputs as set: tensions [N] and displacements [m] at the base, shape (m,).
    angles
        Their angles [rad], shape (k,).
    """
    total = np.array(values)
    for motor, angle in zip(motors, angles, strict=True):
        total[motor.tendon] += motor.radius * angle
    return total


#: How a linearisation takes holes with friction: as they are, as if all of them stuck, or as if all slid on.
Holes = Literal["present", "stuck", "sliding"]


class Evaluation(NamedTuple):
    """Forces evaluated in a scene, and for what."""

    coordinates: Array  # (7 N,): Coordinates of the nodes, as displacements
    tendons: ElasticTendons  # Tendons, with their history at the beginning of the step
    rotations: Array  # (N, 3, 3): Rotation matrices of the nodes
    parameters: Array  # (N, 4): Euler parameters of the nodes
    forces: TendonForces
    # State of the holes to which the forces belong, where holes are iterated, see `SceneForces`
    holes: HoleIterate | None
    linearised: bool  # Whether the tangent was evaluated in a step from this history


class SceneForces:
    """Forces of one robot; a step starts from the tensions of the evaluation before.

    Where tensions follow from angles and mobilisations alone, holes begin a step as they are, and are linearised by
    secants, see `tdcr_fe.elements.native.iterated`.

    Parameters
    ----------
    coordinates
        Coordinates of its nodes.
    """

    def __init__(self, coordinates: NodeCoordinates) -> None:
        self._coordinates = coordinates
        self._last: Evaluation | None = None
        #: Whether the last step was solved with the tangent: differences of forces need one law in all evaluations.
        self._by_tangent = True

    def forget(self) -> None:
        """Forget the last evaluation, after another `Assemble`."""
        self._last = None

    def at(self, coordinates: Array, tendons: ElasticTendons, *, by_law: bool = True) -> Evaluation:
        """Forces in a configuration: those of the last evaluation if it was for the same.

        Parameters
        ----------
        coordinates
            Coordinates of the nodes, without reference values, shape (7 N,).
        tendons
            In the step.
        by_law
            Whether the last evaluation does not count where it was for holes as at the beginning of the step.
        """
        last, history, iterated = self._last, tendons.history, tendons.iterated
        before = last if last is not None and last.tendons.history is history else None
        iterate: HoleIterate | None = None
        if before is not None and before.tendons.same_step(tendons):
            kept = by_law and before.holes is not None and before.holes.kept
            if not kept and before.coordinates.tobytes() == coordinates.tobytes():
                return before
            iterate = before.holes
        positions, rotations, parameters = self._coordinates.poses(coordinates.reshape(-1, 7))
        measured, holes = tendons.model.measure(positions, rotations), None
        if iterated:
            # A step that is tried again with another size was not solved so.
            keep = before is None and self._by_tangent and tendons.time > history.friction.time
            holes = HoleIterate.of(tendons, measured.shape, iterate, keep)
            forces = TendonForces(tendons.model, measured, tendons.values, holes.field)
        else:
            start = history.base_tension
            # Tensions of an iterate that diverged may be nan, from which no iteration returns.
            if before is not None and not np.isnan(before.forces.base_tension).any():
                start = before.forces.base_tension
            forces = tendons.forces(measured, start)
        linearised = before is not None and before.linearised
        self._last = Evaluation(coordinates, tendons, rotations, parameters, forces, holes, linearised)
        return self._last

    def step_end(self, coordinates: Array, tendons: ElasticTendons) -> tuple[FrictionState, TendonForces]:
        """History and forces where a solved step ends; arguments as in `at`."""
        found = self.at(coordinates, tendons)
        self._by_tangent = found.linearised or tendons.time <= tendons.history.friction.time
        return tendons.model.law.commit(found.forces.field), found.forces

    # ------------------------------------------------------------------ on the coordinates of the nodes

    def generalized(self, coordinates: Array, tendons: ElasticTendons, motors: Sequence[Motor] = ()) -> Array:
        """Generalised forces on the coordinates of the nodes, then the torques on motors [N m], shape (7 N + k,).

        Parameters
        ----------
        coordinates, tendons
            As in `at`; the inputs include what motors have wound.
        motors
            Motors of the robot.
        """
        found = self.at(coordinates, tendons)
        on_nodes = generalized_forces(found.forces.nodal_wrenches, found.rotations, found.parameters)
        tension = found.forces.base_tension
        torques = [-motor.radius * tension[motor.tendon] for motor in motors]
        return np.append(on_nodes, torques) if torques else on_nodes

    def tangent(
        self, coordinates: Array, tendons: ElasticTendons, holes: Holes, motors: Sequence[Motor] = ()
    ) -> Array:
        """Derivative of `generalized` by the coordinates of nodes and motors, shape (7 N + k, 7 N + k).

        Parameters
        ----------
        coordinates, tendons, motors
            As in `generalized`.
        holes
            What is assumed of holes with friction: the derivative of the forces, or that all stick or slide on.
        """
        found = self.at(coordinates, tendons, by_law=False)
        self._last = found._replace(linearised=True)
        forces = found.forces
        if holes != "present":
            forces = at_rest(tendons.elastic, forces.measured, tendons.history)
        n = len(found.rotations)
        k = np.zeros((6 * n, 6 * n))
        forces.add_tangent(k)
        taut = tendons.driven & (forces.base_tension > 0.0)
        add_condensed(k, forces, taut, holes == "stuck")
        to_twist = twists_by_coordinates(found.rotations, found.parameters)
        tangent = generalized_tangent(k, forces.nodal_wrenches[:, 3:], to_twist)
        return with_motors(motors, tangent, found, to_twist) if motors else tangent


def with_motors(motors: Sequence[Motor], tangent: Array, found: Evaluation, to_twist: Array) -> Array:
    """Tangent of the forces on nodes and motors by the coordinates of nodes and motors, shape (7 N + k, 7 N + k).

    Parameters
    ----------
    motors
        Motors of the robot; all tendons with motors are driven by displacement.
    tangent
        By the coordinates of the nodes at fixed angles, shape (7 N, 7 N).
    found
        Forces in this configuration.
    to_twist
        See `tdcr_fe.elements.native.coordinates.twists_by_coordinates`.
    """
    size, count, forces = len(tangent), len(motors), found.forces
    both = np.zeros((size + count, size + count))
    both[:size, :size] = tangent
    taut = found.tendons.driven & (forces.base_tension > 0.0)
    # Tension at the base by the displacement there; it is zero where the tendon is slack.
    slope = np.zeros(len(taut))
    slope[taut] = 1.0 / forces.base_slip_by_base()[taut]
    slips, _, by_tension = forces.slip_equations(holes=False)
    for j, motor in enumerate(motors):
        stiffness = motor.radius * slope[motor.tendon]
        pull = by_tension[:, motor.tendon].reshape(-1, 6) * stiffness
        both[:size, size + j] = generalized_forces(pull, found.rotations, found.parameters)
        slip = slips[motor.tendon].reshape(-1, 1, 6) @ to_twist
        both[size + j, :size] = stiffness * slip.reshape(-1)
        both[size + j, size + j] = -motor.radius * stiffness
    return both

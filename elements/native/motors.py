"""Motors that wind tendons: how their angles enter the displacements, and what the tendons do to them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tdcr_fe.elements.forces import TendonForces
from tdcr_fe.elements.native.coordinates import generalized_forces

Array = NDArray[np.float64]


class Motor(NamedTuple):
    """A motor that winds a tendon on a drum."""

    tendon: int  # Number of the tendon
    node: Any  # Exudyn's node of its angle [rad]
    radius: float  # Of the drum [m]: a positive angle pulls the tendon in


def wound(motors: Sequence[Motor], values: Array, angles: Array, driven: NDArray[np.bool_]) -> Array:
    """Inputs of the tendons with what the motors have wound, shape (m,).

    Parameters
    ----------
    motors
        Of the robot.
    values
        Inputs as set: tensions [N] and displacements [m] at the base, shape (m,).
    angles
        Of the motors [rad], shape (k,).
    driven
        Which tendons are driven by displacement, shape (m,); on others motors do not act.
    """
    total = np.array(values)
    for motor, angle in zip(motors, angles, strict=True):
        if driven[motor.tendon]:
            total[motor.tendon] += motor.radius * angle
    return total


def torques(motors: Sequence[Motor], forces: TendonForces) -> Array:
    """Torques of the tendons on the motors [N m], shape (k,): minus the tension at the base times the radius."""
    return np.array([-motor.radius * forces.base_tension[motor.tendon] for motor in motors])


def with_motors(
    motors: Sequence[Motor],
    tangent: Array,
    forces: TendonForces,
    driven: NDArray[np.bool_],
    rotations: Array,
    parameters: Array,
    to_twist: Array,
) -> Array:
    """Tangent of the forces on nodes and motors by the coordinates of nodes and motors, shape (7 N + k, 7 N + k).

    Parameters
    ----------
    motors
        Of the robot.
    tangent
        By the coordinates of the nodes at fixed angles, shape (7 N, 7 N).
    forces
        In this configuration.
    driven
        As in `wound`.
    rotations, parameters, to_twist
        Of the nodes, see `tdcr_fe.elements.native.coordinates.twists_by_coordinates`.
    """
    size, count = len(tangent), len(motors)
    found = np.zeros((size + count, size + count))
    found[:size, :size] = tangent
    taut = driven & (forces.base_tension > 0.0)
    # Tension at the base by the displacement there; it is zero where the tendon is slack.
    slope = np.zeros(len(taut))
    slope[taut] = 1.0 / forces.base_slip_by_base()[taut]
    by_tension, slips = forces.base_tension_columns(), forces.base_slip_rows()
    for j, motor in enumerate(motors):
        stiffness = motor.radius * slope[motor.tendon]
        pull = by_tension[:, motor.tendon].reshape(-1, 6) * stiffness
        found[:size, size + j] = generalized_forces(pull, rotations, parameters)
        slip = slips[motor.tendon].reshape(-1, 1, 6) @ to_twist
        found[size + j, :size] = stiffness * slip.reshape(-1)
        found[size + j, size + j] = -motor.radius * stiffness
    return found

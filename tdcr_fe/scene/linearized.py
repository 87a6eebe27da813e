"""Linearised system of a scene with robots, its inputs the tendons, its outputs sensors: `TDCRLinearized`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import exudyn as exu
import numpy as np
from numpy.typing import NDArray

from tdcr_fe.elements.native.actuation import Holes
from tdcr_fe.scene.modes import checked_hooks, linearized_about_the_present

Array = NDArray[np.float64]

#: Change of a coordinate in the differences of sensors [m, 1].
DIFFERENCE = 1e-6


@dataclass(frozen=True, eq=False)
class LinearSystem:
    """``M x'' + D x' + K x = B u``, ``y = C x``: small motions about a state of a scene.

    Attributes
    ----------
    mass, damping, stiffness : ndarray, shape (n, n)
    inputs : ndarray, shape (n, m)
        ``B``: by the change of every input, tension [N] or displacement [m] as the tendon is driven.
    input_names : tuple of str
        ``robot.tendon`` of every input.
    by_displacement : ndarray of bool, shape (m,)
        Which inputs are displacements.
    outputs : ndarray, shape (p, n)
        ``C``: change of every component of the sensors.
    basis : ndarray, shape (coordinates, n)
        Change of all ODE2 coordinates of the scene: what joints permit, ``basis @ x``.
    """

    mass: Array
    damping: Array
    stiffness: Array
    inputs: Array
    input_names: tuple[str, ...]
    by_displacement: NDArray[np.bool_]
    outputs: Array
    basis: Array

    def state_space(self) -> tuple[Array, Array, Array]:
        """``A``, ``B`` and ``C`` of first order, ``z' = A z + B u`` with ``z = (x, x')``."""
        n = len(self.mass)
        below = np.linalg.solve(self.mass, np.hstack((-self.stiffness, -self.damping, self.inputs)))
        a = np.vstack((np.eye(n, 2 * n, n), below[:, : 2 * n]))
        b = np.vstack((np.zeros_like(self.inputs), below[:, 2 * n :]))
        return a, b, np.hstack((self.outputs, np.zeros_like(self.outputs)))

    def static_gain(self) -> Array:
        """Change of the outputs at rest with the inputs, ``C K^-1 B``, shape (p, m)."""
        found: Array = self.outputs @ np.linalg.solve(self.stiffness, self.inputs)
        return found


def TDCRLinearized(
    mbs: exu.MainSystem, *, holes: Holes = "stuck", sensors: Sequence[Any] = ()
) -> LinearSystem:
    """Linearise a scene about its present state at rest, with the tendons of all robots as inputs.

    Mass, damping and stiffness are those of ``mbs.ComputeLinearizedSystem`` on the coordinates that joints permit; the
    stiffness includes that of the tendons.

    Parameters
    ----------
    mbs
        An assembled system with at least one robot, in a state as `SolveTDCR` leaves it.
    holes
        As in `TDCREigenvalues`: "stuck" for motions so small that no hole slips beyond its presliding, "sliding" on top
        of a motion that goes on.
    sensors
        Numbers of the sensors that are the outputs, as of ``arm.sensors["tip_position"]``; their values follow from
        coordinates.

    Returns
    -------
    LinearSystem

    Raises
    ------
    ValueError
        The system is not assembled or has no robot, or an argument is another.
    """
    hooks = checked_hooks("TDCRLinearized", mbs, holes)
    with linearized_about_the_present(mbs, hooks, holes), hooks.without_post_step():
        mass, stiffness, damping, _, free = mbs.ComputeLinearizedSystem(
            projectIntoConstraintNullspace=True, returnConstraintNullspace=True
        )
    basis = np.asarray(free).T
    columns, names = [], []
    for robot in hooks.actuations:
        forces = np.zeros((len(basis), robot.count))
        forces[robot.coordinates.reshape(-1)] = robot.forces_by_inputs(holes == "stuck")
        columns.append(forces)
        names += [mbs.GetNode(node)["name"].removesuffix(".history") for node in robot.history_nodes.nodes]
    return LinearSystem(
        np.asarray(mass),
        np.asarray(damping),
        np.asarray(stiffness),
        basis.T @ np.hstack(columns),
        tuple(names),
        np.concatenate([robot.by_displacement for robot in hooks.actuations]),
        _outputs(mbs, sensors, basis),
        basis,
    )


def _outputs(mbs: exu.MainSystem, sensors: Sequence[Any], basis: Array) -> Array:
    """Change of the values of sensors with the coordinates, by differences, shape (p, n)."""
    data = mbs.systemData
    rest = np.array(data.GetODE2Coordinates())

    def values(coordinates: Array) -> Array:
        data.SetODE2Coordinates(coordinates)
        return np.concatenate([np.zeros(0), *(np.atleast_1d(mbs.GetSensorValues(s)) for s in sensors)])

    try:
        changes = [
            (values(rest + DIFFERENCE * each) - values(rest - DIFFERENCE * each)) / (2.0 * DIFFERENCE)
            for each in basis.T
        ]
    finally:
        data.SetODE2Coordinates(rest)
    return np.array(changes).T

"""Forces of a robot in the configurations that Exudyn's own solvers ask for, the last of which is kept."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tdcr_fe.elements.elastic_tendons import ElasticTendons
from tdcr_fe.elements.forces import TendonForces
from tdcr_fe.elements.node_coordinates import NodeCoordinates

Array = NDArray[np.float64]

#: Tensions [N] and displacements [m] at the base, shape (m,), as set or over time [s].
Inputs = Array | Callable[[float], Array]


def values_at(inputs: Inputs, t: float) -> Array:
    """Tensions [N] and displacements [m] at the base at time t [s], shape (m,)."""
    return np.asarray(inputs(t) if callable(inputs) else inputs, dtype=float)


class Evaluation(NamedTuple):
    """Forces evaluated in a scene, and for what.

    Attributes
    ----------
    coordinates : ndarray, shape (7 N,)
        Of the nodes, as displacements.
    time : float
        [s].
    inputs : ndarray or callable
        As set.
    tendons : ElasticTendons
        With the history at the beginning of the step.
    values : ndarray, shape (m,)
        Inputs at that time.
    rotations, parameters : ndarray
        Of the nodes, shapes (N, 3, 3) and (N, 4).
    forces : TendonForces
    """

    coordinates: Array
    time: float
    inputs: Inputs
    tendons: ElasticTendons
    values: Array
    rotations: Array
    parameters: Array
    forces: TendonForces


class SceneForces:
    """Forces of one robot; a step starts from the tensions of the evaluation before.

    Parameters
    ----------
    coordinates
        Of its nodes.
    """

    def __init__(self, coordinates: NodeCoordinates) -> None:
        self._coordinates = coordinates
        self._last: Evaluation | None = None

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

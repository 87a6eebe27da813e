"""Unknowns of Exudyn's implicit integrators during a step: twists of the backbone, and slips of the tendons.

A step of Newton's method turns the sections and moves the nodes along tangents, and what then does not fit, of second
order in the rotations, strains the elements along the backbone. Their large axial and shear stiffness makes forces of
it, up to thousands of newtons, which the next iteration removes. But the geometric stiffness of these forces is many
times the bending stiffness, so that it goes astray. Where a force of an element is larger than those at the beginning
of the step by more than what its bending stiffness may balance, the tangent therefore takes the forces from there. What
the iteration converges to does not change (compare D. Magisano, L. Leonetti, G. Garcea, How to improve efficiency and
robustness of the Newton method in geometrically non-linear structural problem discretized via displacement-based
finite elements, Comput. Methods Appl. Mech. Engrg. 313 (2017) 986-1005).
"""

from __future__ import annotations

from typing import NamedTuple

import exudyn as exu
import numpy as np
from numpy.typing import NDArray

from tdcr_fe.elements.backbone import BackboneMesh, relative_twists, strain_matrices
from tdcr_fe.elements.hysteresis import FrictionState
from tdcr_fe.elements.native.coordinates import NodeCoordinates, generalized_tangent, twists_by_coordinates
from tdcr_fe.elements.native.items import SystemReference
from tdcr_fe.elements.native.straight_tendons import HolePrediction, Pull, StraightTendons
from tdcr_fe.elements.section import (
    STRAIN_DIFFERENCE,
    add_element_tangent,
    wrench_tangent,
    wrenches_on_nodes,
)

Array = NDArray[np.float64]


class IteratedBackbone:
    """The elements of one backbone in the iterates of a step.

    Parameters
    ----------
    system
        The system.
    coordinates
        Of the nodes.
    """

    def __init__(self, system: SystemReference, coordinates: NodeCoordinates) -> None:
        self._system, self._coordinates = system, coordinates
        self._limits: Limits | None = None

    def excess_tangent(self, mesh: BackboneMesh, displacements: Array) -> Array | None:
        """Derivative of the generalised forces of the elements by excessive axial and shear forces, at these forces.

        Parameters
        ----------
        mesh
            The backbone.
        displacements
            Coordinates of the nodes in this iterate, without reference values, shape (7 N,).

        Returns
        -------
        ndarray, shape (7 N, 7 N), or None
            None where no element is stretched excessively.
        """
        if self._limits is None or self._limits.mesh is not mesh:
            self._limits = Limits.of(mesh)
        data = self._system.mbs.systemData
        everything: Array = data.GetODE2Coordinates(exu.ConfigurationType.StartOfStep, copy=False)
        before, after = everything[self._coordinates.numbers], displacements.reshape(-1, 7)
        # The lengths of the chords are enough to see it, in a tenth of the time that the twists take.
        nodes = before[:, :3] + self._coordinates.reference[:, :3]
        moved = after[:, :3] - before[:, :3]
        way = moved[1:] - moved[:-1]
        grown = np.abs(np.einsum("ei,ei->e", 2.0 * (nodes[1:] - nodes[:-1]) + way, way))
        if not (grown > self._limits.square).any():
            return None
        positions, rotations, parameters = self._coordinates.poses(after)
        twists = relative_twists(positions, rotations)
        wrenches = mesh.twist_stiffness * (twists - relative_twists(*self._coordinates.poses(before)[:2]))
        wrenches[:, 3:] = 0.0
        wrenches[(np.abs(wrenches) < self._limits.force).all(axis=1)] = 0.0
        return constant_wrench_tangent(wrenches, twists, rotations, parameters)


class Limits(NamedTuple):
    """What is excessive in an iterate."""

    mesh: BackboneMesh  # The backbone
    # Change of an axial or shear force since the beginning of the step whose geometric stiffness is of the
    # order of the bending stiffness: ``EI / h^2``, where ``h`` is the length of an element, or that of a
    # twentieth of the backbone if it is shorter [N]
    force: float
    square: Array  # (E,): Change of the squared length of the elements by such an axial force [m^2]

    @classmethod
    def of(cls, mesh: BackboneMesh) -> Limits:
        """Of a backbone."""
        lengths = np.maximum(mesh.lengths, mesh.arc_lengths[-1] / 20.0)
        force = float(np.min(mesh.stiffness[:, 4:] / lengths[:, None] ** 2))
        return cls(mesh, force, 2.0 * mesh.lengths * force / mesh.twist_stiffness[:, 0])


def constant_wrench_tangent(wrenches: Array, twists: Array, rotations: Array, parameters: Array) -> Array:
    """Derivative of the generalised forces of elements with constant wrenches by the coordinates, shape (7 N, 7 N).

    Parameters
    ----------
    wrenches
        Conjugate to the twists of the elements [N, N m], shape (E, 6).
    twists
        Of the elements, shape (E, 6).
    rotations, parameters
        Of the nodes, shapes (N, 3, 3) and, of Euler parameters, (N, 4).
    """
    blocks = wrench_tangent(
        lambda moved: -(wrenches[:, None] @ strain_matrices(moved))[..., 0, :],
        twists,
        np.full(twists.shape, STRAIN_DIFFERENCE),
    )
    of_nodes = wrenches_on_nodes(wrenches, strain_matrices(twists))
    k = np.zeros((of_nodes.size, of_nodes.size))
    add_element_tangent(k, blocks, of_nodes)
    return generalized_tangent(k, of_nodes[:, 3:], twists_by_coordinates(rotations, parameters))


class IteratedTwists(NamedTuple):
    """An evaluation in an iteration of a solver, and for what."""

    coordinates: Array  # (7 N,): Of the nodes, without reference values
    time: float  # At the end of the step [s]
    state: FrictionState  # History at its beginning
    base_tension: Array  # (m,): [N]
    pull: Pull

    def of_step(self, time: float, state: FrictionState, base_tension: Array) -> bool:
        """Whether it belongs to the same attempt of a step."""
        return (
            self.time == time
            and self.state is state
            and (self.base_tension is base_tension or bool((self.base_tension == base_tension).all()))
        )


class PastStep(NamedTuple):
    """A step that was solved, from which the next one is predicted."""

    end: FrictionState  # History at its end
    rate: Array  # (g, m): Change of the mobilisations per time, unlimited [1/s]
    # (g, m): The same in the step after it: half of the change of the rate since the step before goes on [1/s]
    expected: Array

    @classmethod
    def of(
        cls, start: FrictionState, pull: Pull, end: FrictionState, before: PastStep | None
    ) -> PastStep | None:
        """Of a step from a history to another, and the step before it if known; None where no time has passed."""
        if end.time <= start.time:
            return None
        rate = (pull.trial - start.mobilisation.T) / (end.time - start.time)
        known = before is not None and before.end is start
        return cls(end, rate, 1.5 * rate - 0.5 * before.rate if before is not None and known else rate)


def predicted_holes(past: PastStep | None, state: FrictionState, time: float) -> HolePrediction | None:
    """Holes at the end of a step from a history to a time [s]; None where no time passes.

    They go on as in the past step, or stay as they are where the history is that of another step.
    """
    if time <= state.time:
        return None
    start = state.mobilisation.T
    if past is None or past.end is not state:
        return HolePrediction.of(start, start)
    return HolePrediction.of(start, start + (time - state.time) * past.expected)


class IteratedTendons:
    """Straight tendons in the iterations of a solver, the last two of which are kept for the tangent.

    Parameters
    ----------
    tendons
        Compute the forces.
    nodes
        On which they act.
    """

    def __init__(self, tendons: StraightTendons, nodes: NodeCoordinates) -> None:
        self._tendons, self._nodes = tendons, nodes
        self._last: IteratedTwists | None = None
        self._before: IteratedTwists | None = None
        self._past: PastStep | None = None
        #: History at the beginning of the step in which the tangent was last evaluated.
        self._linearised: FrictionState | None = None
        #: Whether the last step was solved with the tangent: numerical derivatives need one law in all evaluations.
        self._by_tangent = True

    def _at(
        self,
        coordinates: Array,
        time: float,
        state: FrictionState,
        base_tension: Array,
        *,
        by_law: bool,
    ) -> Pull:
        """The last evaluation if it was for the same, else a new one."""
        last = self._last
        same = last if last is not None and last.of_step(time, state, base_tension) else None
        prediction = None
        if same is not None and bool((same.coordinates == coordinates).all()):
            if not (by_law and same.pull.prediction):
                return same.pull
        elif self._by_tangent and not (last is not None and last.state is state):
            # A step that is tried again with another size was not solved with the prediction.
            prediction = predicted_holes(self._past, state, time)
        there = coordinates.reshape(-1, 7) + self._nodes.reference
        pull = self._tendons.pull(there, base_tension, state, prediction)
        self._last, self._before = IteratedTwists(coordinates, time, state, base_tension, pull), same
        return pull

    def forces(self, coordinates: Array, time: float, state: FrictionState, base_tension: Array) -> Array:
        """Generalised forces on the coordinates of all nodes, shape (7 N,).

        The first evaluation of a step is for holes that stick and slide as predicted; see `HolePrediction`.

        Parameters
        ----------
        coordinates
            Of the nodes, without reference values, shape (7 N,).
        time
            At the end of the step [s].
        state
            History of friction at its beginning.
        base_tension
            [N], shape (m,).
        """
        pull = self._at(coordinates, time, state, base_tension, by_law=True)
        return self._tendons.forces(pull)

    def tangent(self, coordinates: Array, time: float, state: FrictionState, base_tension: Array) -> Array:
        """Tangent of `forces` for Newton's method, shape (7 N, 7 N); arguments as there."""
        self._linearised = state
        pull = self._at(coordinates, time, state, base_tension, by_law=False)
        return self._tendons.tangent(pull, None if self._before is None else self._before.pull)

    def step_end(
        self, coordinates: Array, time: float, state: FrictionState, base_tension: Array
    ) -> tuple[FrictionState, Array, Pull]:
        """History of friction where a solved step ends, and tendon pulled in at the base [m]; arguments as there."""
        pull = self._at(coordinates, time, state, base_tension, by_law=True)
        friction = self._tendons.friction(pull, time)
        self._past = PastStep.of(state, pull, friction, self._past)
        if time > state.time:
            self._by_tangent = self._linearised is state
        return friction, self._tendons.base_slip(pull), pull

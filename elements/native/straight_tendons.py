"""Forces of straight, inextensible tendons on the coordinates of Exudyn's nodes, and their tangent.

An implicit step of Exudyn's own solvers evaluates the forces about ten times and their tangent once or twice. For
tendons that are straight from hole to hole, of given tension and with constant coefficients of friction (which most
robots have) this module evaluates both in about half the time of `tdcr_fe.elements.forces`, which is general, and gives
the same numbers. All derivatives are by positions and Euler parameters, with no way over body-frame increments.

The mobilisation of a hole is a function of its slip with two corners, over a presliding distance that is far shorter
than what Newton's method moves in an iteration. With tangents of this function the iteration often jumps between all
holes sliding one way and all sliding the other way. Two things prevent that. The first iterate of a step is computed
for holes that are predicted to stick or to slide (`HolePrediction`). In the others a hole that has saturated since the
iterate before is linearised by the secant between both iterates. Where an iteration converges, this is the tangent.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tdcr_fe.elements.backbone import NodeStiffness
from tdcr_fe.elements.forces import ForceModel
from tdcr_fe.elements.hysteresis import FrictionState
from tdcr_fe.elements.poses import EULER_RATE, EULER_ROTATION, EYE3, EYE9, skew
from tdcr_fe.elements.tendons import Segments, along_nodes

Array = NDArray[np.float64]
#: ``(e e^T) @ _FRAMES + 1`` is the transposed rotation matrix of Euler parameters, row by row.
_FRAMES: Array = np.ascontiguousarray(EULER_ROTATION.reshape(16, 3, 3).swapaxes(1, 2).reshape(16, 9))
#: ``e @ _RATE`` takes moments to forces on Euler parameters; ``m @ _RATE_BY_E`` is the derivative of that by them.
_RATE: Array = 4.0 * EULER_RATE
_RATE_BY_E: Array = np.ascontiguousarray(_RATE.reshape(4, 4, 3).transpose(2, 1, 0).reshape(3, 16))
#: ``p @ _TURNED`` is, row by row, ``p - tr(p) 1``.
_TURNED: Array = np.eye(9) - np.outer(EYE9, EYE9)


class HolePrediction(NamedTuple):
    """Which holes stick and which slide at the end of a step, assumed before it is solved."""

    # (g, m): Friction variables that follow the slip linearly, however far it is; the others are constant
    sticks: NDArray[np.bool_]
    mobilisation: (
        Array  # (g, m): At the beginning of the step where it sticks, else that with which it slides
    )

    @classmethod
    def of(cls, start: Array, reached: Array) -> HolePrediction:
        """From mobilisations at the beginning, and unlimited ones that are expected at the end, shape (g, m)."""
        sticks = np.abs(reached) < 1.0
        return cls(sticks, np.where(sticks, start, np.sign(reached)))


class Pull(NamedTuple):
    """Tendons in one configuration: hole or segment first, then tendon."""

    rate: Array  # (n+1, 4, 3): From moments in the frames of the nodes to forces on their Euler parameters
    frames: Array  # (n+1, 3, 3): Transposed rotations of the nodes
    straight: Segments
    trial: Array  # (g, m): Mobilisations before they are limited to [-1, 1]
    mobilisation: Array  # (n-1, m): Of the holes
    tension: Array  # (n, m): At these mobilisations [N]
    local: Array  # (n+1, m, 3): Forces on the holes in the frames of the nodes [N]
    moments: Array  # (n+1, 3): On the nodes that carry holes, in their own frames [N m]
    forces: Array  # (n+1, 7): Generalised forces on these nodes
    # Where the forces are those of holes that stick and slide as predicted; None where they are those of the
    # law of friction
    prediction: HolePrediction | None = None

    def slopes(self, before: Pull | None) -> Array:
        """Derivative of the mobilisations by their trial values, or secant where they saturate, shape (g, m).

        Parameters
        ----------
        before
            The iterate before; None takes the derivatives.
        """
        if self.prediction is not None:
            return self.prediction.sticks.astype(float)
        found: Array = (np.abs(self.trial) < 1.0).astype(float)
        if before is None:
            return found
        moved = self.trial - before.trial
        limited = np.minimum(np.maximum(self.trial, -1.0), 1.0)
        change = limited - np.minimum(np.maximum(before.trial, -1.0), 1.0)
        saturated = (found == 0.0) & (change != 0.0)
        found[saturated] = change[saturated] / moved[saturated]
        return found


class StraightTendons:
    """Forces of the tendons of one robot; use `of`, which returns None where a robot needs the general evaluation.

    Parameters
    ----------
    model
        Of its forces; its tendons are cables without clearance, their coefficients of friction are constant, without
        adhesion and elasticity, and there are neither section forces nor springs.
    """

    def __init__(self, model: ForceModel) -> None:
        geometry, law = model.geometry, model.law
        assert geometry is not None
        self._nodes, self._size = model.cable_nodes, model.mesh.arc_lengths.size
        self._presliding = law.hysteresis.presliding
        self._offsets: Array = np.ascontiguousarray(geometry.offsets.transpose(1, 0, 2))
        self._levers: Array = np.concatenate(skew(geometry.offsets), axis=-1)
        self._lengths: Array = np.ascontiguousarray(law.parameters.lengths.T)
        self._slip_operator = law.slip_operator
        self._incidence = None if law.each_hole else law.hole_incidence
        self._coefficients: Array = np.ascontiguousarray(-law.coefficients.T)
        mask = geometry.mask.T
        self._exists = None if bool(np.all(mask)) else mask.astype(float)

    @classmethod
    def of(cls, model: ForceModel) -> StraightTendons | None:
        """The forces of a model, or None where it has more than this class computes."""
        geometry, law = model.geometry, model.law
        if geometry is None or geometry.clearance is not None or law.shape[0] == 0:
            return None
        if model.section is not None or model.springs is not None or not law.simple:
            return None
        return cls(model)

    def forces(self, pull: Pull) -> Array:
        """Generalised forces on the coordinates of all nodes, shape (7 N,)."""
        if len(pull.forces) == self._size:
            return pull.forces.reshape(-1)
        found = np.zeros((self._size, 7))
        found[self._nodes] = pull.forces
        return found.reshape(-1)

    def friction(self, pull: Pull, time: float) -> FrictionState:
        """History of friction if a step ends in a configuration at a time [s]."""
        slip = self._slip_operator @ (self._lengths - pull.straight.lengths)
        limited = np.minimum(np.maximum(pull.trial, -1.0), 1.0)
        return FrictionState(slip.T, limited.T, None, time)

    def base_slip(self, pull: Pull) -> Array:
        """Tendon pulled in at the base plate [m], shape (m,)."""
        return np.asarray((self._lengths - pull.straight.lengths).sum(axis=0))

    def tangent(self, pull: Pull, before: Pull | None = None) -> Array:
        """Derivative of `forces` by the coordinates, shape (7 N, 7 N); ``before`` as in `Pull.slopes`."""
        n, m = pull.tension.shape
        segments = self._segments(pull)
        turns = _turns(pull, segments)
        along = np.zeros((m, n, 7 * (n + 1)))
        along_nodes(along, 14, 7)[...] = segments[:, :, 3].swapaxes(0, 1)
        # Change of the logarithm of the tension from hole to hole.
        sliding = (self._coefficients * pull.mobilisation).T[:, :, None]
        change, slopes = np.empty((m, n - 1, along.shape[2])), pull.slopes(before).T[:, :, None]
        if self._incidence is None:
            # The slip operator of holes with their own mobilisations: the sum over all segments behind.
            np.multiply(along[:, :0:-1].cumsum(axis=1)[:, ::-1], slopes, out=change)
        else:
            np.matmul(self._incidence, self._slip_operator @ along * slopes, out=change)
        change *= (self._coefficients * pull.straight.angles / -self._presliding).T[:, :, None]
        along_nodes(change, 21, 7)[...] += sliding * turns.swapaxes(0, 1)
        change = change.cumsum(axis=1)
        change *= pull.tension[1:].T[:, :, None]
        # The first segment has the tension at the base. Each other one pulls on the two nodes at its ends.
        ends = segments[1:, :, 3].swapaxes(1, 2) @ change.swapaxes(0, 1)
        rows = np.zeros((n + 1, 7, 7 * (n + 1)))
        np.negative(ends[:, :7], out=rows[1:-1])
        rows[2:] -= ends[:, 7:]
        tangent = rows.reshape(7 * (n + 1), -1)
        self._geometric(pull, segments).add_to(tangent, np.arange(n + 1))
        if n + 1 == self._size:
            return tangent
        found = np.zeros((self._size, 7, self._size, 7))
        rows = self._nodes
        found[rows[:, None], :, rows] = tangent.reshape(n + 1, 7, n + 1, 7).swapaxes(1, 2)
        return found.reshape(7 * self._size, -1)

    def pull(
        self,
        coordinates: Array,
        base_tension: Array,
        state: FrictionState,
        prediction: HolePrediction | None = None,
    ) -> Pull:
        """Tensions and forces in a configuration.

        Parameters
        ----------
        coordinates
            Positions and Euler parameters of the nodes, shape (N, 7).
        base_tension
            [N], shape (m,).
        state
            History of friction at the beginning of the step.
        prediction
            Holes that stick and slide as predicted, in place of the law of friction. The law is taken nevertheless
            where it agrees, and where the prediction is of no use: tensions below zero, or more than doubled.
        """
        nodes = coordinates[self._nodes]
        e = nodes[:, 3:]
        frames = (e[:, :, None] * e[:, None, :]).reshape(-1, 16).dot(_FRAMES)
        frames += EYE9
        frames = frames.reshape(-1, 3, 3)
        holes = self._offsets @ frames
        holes += nodes[:, None, :3]
        straight = Segments.between(holes, self._exists)
        lengths, directions, angles = straight.lengths, straight.directions, straight.angles
        trial = (self._slip_operator @ (self._lengths - lengths) - state.slip.T) / self._presliding
        trial += state.mobilisation.T
        mobilisation = np.minimum(np.maximum(trial, -1.0), 1.0)
        change, acting = self._coefficients * angles, None
        if prediction is not None:
            prediction, mobilisation, acting = self._predicted(prediction, trial, mobilisation, change)
        if self._incidence is not None:
            mobilisation = self._incidence @ mobilisation
        tension = np.empty_like(lengths)
        tension[0] = base_tension
        np.exp((change * mobilisation).cumsum(axis=0), out=tension[1:])
        tension[1:] *= base_tension

        along = tension[:, :, None] * directions
        if acting is not None:
            along[1:] *= acting[:, :, None]
        force = np.empty_like(holes)
        force[:-1], force[-1] = along, 0.0
        force[1:] -= along
        local = force @ frames.swapaxes(1, 2)
        rate = e.dot(_RATE).reshape(-1, 4, 3)
        moments = self._levers @ local.reshape(len(force), -1, 1)
        found = np.empty((len(force), 7))
        force.sum(axis=1, out=found[:, :3])
        found[:, 3:] = (rate @ moments)[:, :, 0]
        return Pull(
            rate, frames, straight, trial, mobilisation, tension, local, moments[:, :, 0], found, prediction
        )

    def _predicted(
        self, prediction: HolePrediction, trial: Array, limited: Array, change: Array
    ) -> tuple[HolePrediction | None, Array, Array | None]:
        """The prediction, or None where it is not to be used; mobilisations; factors on the tensions."""
        sticks, mobilisation = prediction
        if (np.where(sticks, trial, mobilisation) == limited).all():
            return None, limited, None
        beyond = np.where(sticks, trial - mobilisation, 0.0)
        if self._incidence is not None:
            beyond = self._incidence @ beyond
        factors = 1.0 + (change * beyond).cumsum(axis=0)
        if not (factors.min() >= 0.0 and factors.max() <= 2.0):
            return None, limited, None
        return prediction, mobilisation, factors

    def _segments(self, pull: Pull) -> Array:
        """Motion of the far hole of each segment relative to its near one, by those of both nodes: (n, m, 4, 14).

        By segment and tendon three rows in world axes, and a fourth along the segment: the change of its length.
        """
        n, m = pull.tension.shape
        levers = (pull.rate @ self._levers).reshape(n + 1, 4, m, 3).swapaxes(1, 2)
        holes = (levers @ pull.frames[:, None]).swapaxes(2, 3)
        rows: Array = np.empty((n, m, 4, 14))
        rows[:, :, :3, :3], rows[:, :, :3, 7:10] = -EYE3, EYE3
        np.negative(holes[:-1], out=rows[:, :, :3, 3:7])
        rows[:, :, :3, 10:] = holes[1:]
        np.matmul(pull.straight.directions[:, :, None], rows[:, :, :3], out=rows[:, :, 3:])
        return rows

    def _geometric(self, pull: Pull, segments: Array) -> NodeStiffness:
        """The derivative at fixed tensions, see `tdcr_fe.elements.tendons.CableLines.stiffness`."""
        n, m = pull.tension.shape
        weighted = segments * (pull.tension * pull.straight.inverse)[:, :, None, None]
        np.negative(weighted[:, :, :3], out=weighted[:, :, :3])
        pair = segments.reshape(n, 4 * m, 14).swapaxes(1, 2) @ weighted.reshape(n, 4 * m, 14)
        own: Array = np.zeros((n + 1, 7, 7))
        own[:-1] = pair[:, :7, :7]
        own[1:] += pair[:, 7:, 7:]
        # A hole with offset o turns with its node: o x (R^T f), by a rotation w, changes by (f o^T - (f . o) 1) w.
        outer = pull.local.swapaxes(1, 2) @ self._offsets
        turned = outer.reshape(-1, 9).dot(_TURNED).reshape(-1, 3, 3)
        own[:, 3:, 3:] += pull.rate @ turned @ pull.rate.swapaxes(1, 2)
        own[:, 3:, 3:] += pull.moments.dot(_RATE_BY_E).reshape(n + 1, 4, 4)
        return NodeStiffness(own, pair[:, :7, 7:])


def _turns(pull: Pull, segments: Array) -> Array:
    """Derivatives of the angles by the nodes before, at and behind each hole, shape (n-1, m, 21)."""
    before, after = pull.straight.turns_by_directions()
    turns = np.zeros((*before.shape[:2], 21))
    turns[:, :, :14] = (before[:, :, None] @ segments[:-1, :, :3])[:, :, 0]
    turns[:, :, 7:] += (after[:, :, None] @ segments[1:, :, :3])[:, :, 0]
    return turns

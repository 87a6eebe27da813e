"""Forces of straight, inextensible tendons on the coordinates of Exudyn's nodes, and their tangent.

An implicit step of Exudyn's own solvers evaluates the forces about ten times and their tangent once or twice. For
tendons that are straight from hole to hole, of given tension and with constant coefficients of friction (which most
robots have) this module evaluates both in about half the time of `tdcr_fe.elements.forces`, which is general, and gives
the same numbers. All derivatives are by positions and Euler parameters, with no way over body-frame increments.

The mobilisation of a hole is a function of its slip with two corners, over a presliding distance that is far shorter
than what Newton's method moves in an iteration. With tangents of this function the iteration often jumps between all
holes sliding one way and all sliding the other way. A hole that has saturated since the iterate before, or since the
beginning of the step, is therefore linearised by the secant. Where an iteration converges, this is the tangent.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tdcr_fe.elements.forces import ForceModel
from tdcr_fe.elements.friction import FrictionState
from tdcr_fe.elements.poses import EULER_ROTATION

Array = NDArray[np.float64]
_EYE3, _EYE4 = np.eye(3), np.eye(4)
_ONES, _QUARTERS = np.ones(3), np.full(3, 0.25)


class Pull(NamedTuple):
    """Tendons in one configuration: hole or segment first, then tendon.

    Attributes
    ----------
    parameters : ndarray, shape (n+1, 4)
        Euler parameters of the nodes that carry holes.
    motions : ndarray, shape (n+1, 3 m, 4)
        Change of the positions of the holes with these, which keep their norm [m].
    doubled : ndarray, shape (n+1, 3 m, 1)
        Twice by what the holes are turned away from where they are at zero rotation [m].
    directions : ndarray, shape (n, m, 3)
        Unit vectors of the segments from base to anchor, zero where padded.
    lengths, inverse : ndarray, shape (n, m)
        Of the segments [m], and one over them [1/m]; zero where padded.
    bend, quarter : ndarray, shapes (n-1, m, 3) and (n-1, m)
        Differences of neighbouring directions, and a quarter of their squared lengths.
    half_angles : ndarray, shape (n-1, m)
        Half of the angles by which the tendons turn at the holes [rad].
    trial : ndarray, shape (g, m)
        Mobilisations before they are limited to [-1, 1].
    mobilisation : ndarray, shape (n-1, m)
        Of the holes.
    tension : ndarray, shape (n, m)
        [N].
    on_holes : ndarray, shape (n+1, 1, 3 m)
        Forces on the holes in world axes [N].
    forces : ndarray, shape (n+1, 7)
        Generalised forces on the nodes that carry holes.
    """

    parameters: Array
    motions: Array
    doubled: Array
    directions: Array
    lengths: Array
    inverse: Array
    bend: Array
    quarter: Array
    half_angles: Array
    trial: Array
    mobilisation: Array
    tension: Array
    on_holes: Array
    forces: Array

    def slopes(self, before: Array) -> Array:
        """Derivative of the mobilisations by their trial values, or secant where they saturate, shape (g, m).

        Parameters
        ----------
        before
            Trial mobilisations of the iterate before, or mobilisations at the beginning of the step, shape (g, m).
        """
        found: Array = (np.abs(self.trial) < 1.0).astype(float)
        moved = self.trial - before
        limited = np.minimum(np.maximum(self.trial, -1.0), 1.0)
        change = limited - np.minimum(np.maximum(before, -1.0), 1.0)
        saturated = (found == 0.0) & (change != 0.0)
        found[saturated] = change[saturated] / moved[saturated]
        return found


class StraightTendons:
    """Forces of the tendons of one robot; use `of`, which returns None where a robot needs the general evaluation.

    Holes move with the Euler parameters ``e`` of their node as ``x = p + o + Q(e, e) / 2``, where ``o`` is the offset
    of the hole at zero rotation and ``Q`` is bilinear and constant. With ``H = Q(e, .) - Q(e, e) e^T``, the derivative
    of ``x`` in directions that keep the norm of ``e``, forces ``f`` on the holes are ``H^T f`` on the parameters.

    Parameters
    ----------
    model
        Of its forces; its tendons are cables without clearance, their coefficients of friction are constant, without
        adhesion and elasticity, and there are neither section forces nor springs.
    """

    def __init__(self, model: ForceModel) -> None:
        geometry, law = model.geometry, model.law
        assert geometry is not None
        self._rows, self._nodes, self._size = model.cable_rows, model.cable_nodes, model.mesh.arc_lengths.size
        self._offsets: Array = np.ascontiguousarray(geometry.offsets.transpose(1, 0, 2))
        m, count = len(geometry.offsets), len(self._offsets)
        half = np.einsum("ijxy,kmy->kmxij", EULER_ROTATION.reshape(4, 4, 3, 3), self._offsets)
        turning = (half + half.swapaxes(3, 4)).reshape(count, 3 * m, 4, 4)
        #: ``Q``, so that a product with ``e`` gives ``Q(e, .)``, and one with forces gives the sum over all holes.
        self._by_parameters: Array = turning.reshape(count, 12 * m, 4)
        self._by_forces: Array = turning.reshape(count, 3 * m, 16)
        self._lengths: Array = np.ascontiguousarray(law.parameters.lengths.T)
        self._slip_operator, self._presliding = law.slip_operator, law.presliding
        self._slip_of_segments = law.slip_operator / law.presliding
        self._incidence = None if law.each_hole else law.hole_incidence
        self._doubled_coefficients: Array = np.ascontiguousarray(-2.0 * law.coefficients.T)
        self._before: Array = np.tri(len(self._lengths) - 1)
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
        found[self._rows] = pull.forces
        return found.reshape(-1)

    def friction(self, pull: Pull, time: float) -> FrictionState:
        """History of friction if a step ends in a configuration at a time [s]."""
        slip = self._slip_operator @ (self._lengths - pull.lengths)
        limited = np.minimum(np.maximum(pull.trial, -1.0), 1.0)
        return FrictionState(slip.T, limited.T, None, time)

    def base_slip(self, pull: Pull) -> Array:
        """Tendon pulled in at the base plate [m], shape (m,)."""
        return np.asarray((self._lengths - pull.lengths).sum(axis=0))

    def pull(self, coordinates: Array, base_tension: Array, state: FrictionState) -> Pull:
        """Tensions and forces in a configuration.

        Parameters
        ----------
        coordinates
            Positions and Euler parameters of the nodes, shape (N, 7).
        base_tension
            [N], shape (m,).
        state
            History of friction at the beginning of the step.
        """
        nodes = coordinates[self._rows]
        count, m = self._offsets.shape[:2]
        e = nodes[:, 3:]
        motions = (self._by_parameters @ e[:, :, None]).reshape(count, 3 * m, 4)
        doubled = motions @ e[:, :, None]
        motions -= doubled * e[:, None]
        holes = 0.5 * doubled.reshape(count, m, 3)
        holes += self._offsets
        holes += nodes[:, None, :3]
        directions = holes[1:] - holes[:-1]
        lengths = np.sqrt((directions * directions).dot(_ONES))
        if self._exists is None:
            inverse = 1.0 / lengths
        else:
            inverse = self._exists / (lengths + (1.0 - self._exists))
            lengths *= self._exists
        directions *= inverse[:, :, None]
        # Half the chord between unit vectors is the sine of half the angle: exact down to the smallest turn.
        bend = directions[1:] - directions[:-1]
        quarter = (bend * bend).dot(_QUARTERS)
        if self._exists is not None:
            quarter *= self._exists[1:]
        half_angles = np.arcsin(np.minimum(np.sqrt(quarter), 1.0))
        trial = self._slip_of_segments @ (self._lengths - lengths)
        trial += (state.mobilisation - state.slip / self._presliding).T
        mobilisation = np.minimum(np.maximum(trial, -1.0), 1.0)
        if self._incidence is not None:
            mobilisation = self._incidence @ mobilisation
        tension = np.empty_like(lengths)
        tension[0] = base_tension
        np.exp((self._doubled_coefficients * half_angles * mobilisation).cumsum(axis=0), out=tension[1:])
        tension[1:] *= base_tension

        # Between zeros before the base plate and behind the last hole.
        along = np.zeros((count + 1, m, 3))
        np.multiply(tension[:, :, None], directions, out=along[1:-1])
        force = along[1:] - along[:-1]
        found = np.empty((count, 7))
        force.sum(axis=1, out=found[:, :3])
        on_holes = force.reshape(count, 1, 3 * m)
        np.matmul(on_holes, motions, out=found[:, None, 3:])
        return Pull(
            e, motions, doubled, directions, lengths, inverse, bend, quarter, half_angles, trial, mobilisation,
            tension, on_holes, found,
        )  # fmt: skip

    def tangent(self, pull: Pull, before: Array) -> Array:
        """Derivative of `forces` by the coordinates, shape (7 N, 7 N); ``before`` as in `Pull.slopes`."""
        n, m = pull.tension.shape
        width = 7 * (n + 1)
        segments = self._segments(pull)
        # By the coordinates: the lengths of all segments, then the angles at all holes.
        geometry = np.zeros((m, 2 * n - 1, width))
        _windows(geometry, 0, n, 14)[...] = segments[:, :, 3].swapaxes(0, 1)
        _windows(geometry, n, n - 1, 21)[...] = _turns(pull, segments).swapaxes(0, 1)
        change = self._tension_slopes(pull, before) @ geometry
        # The first segment has the tension at the base.
        behind = geometry[:, 1:n].reshape(-1, width)
        blocks = (behind.T @ change.reshape(behind.shape)).reshape(n + 1, 7, n + 1, 7)
        self._add_geometric(blocks, pull, segments)
        if n + 1 == self._size:
            return blocks.reshape(7 * self._size, -1)
        found = np.zeros((self._size, 7, self._size, 7))
        rows = self._nodes
        found[rows[:, None], :, rows] = blocks.swapaxes(1, 2)
        return found.reshape(7 * self._size, -1)

    def _tension_slopes(self, pull: Pull, before: Array) -> Array:
        """Minus the change of the tensions behind the holes with lengths and angles, shape (m, n-1, 2 n - 1)."""
        n, m = pull.tension.shape
        # Change of the logarithm of the tension at a hole with its own angle, and with the lengths by its mobilisation.
        by_angle = self._doubled_coefficients * pull.mobilisation
        by_mobilisation = self._doubled_coefficients * pull.half_angles
        slipping = self._slip_of_segments * pull.slopes(before).T[:, :, None]
        if self._incidence is not None:
            slipping = self._incidence @ slipping
        found = np.empty((m, n - 1, 2 * n - 1))
        passed_on = -pull.tension[1:].T[:, :, None] * self._before
        np.matmul(passed_on * -by_mobilisation.T[:, None], slipping, out=found[:, :, :n])
        np.multiply(passed_on, 0.5 * by_angle.T[:, None], out=found[:, :, n:])
        return found

    def _segments(self, pull: Pull) -> Array:
        """Motion of the far hole of each segment relative to its near one, by those of both nodes: (n, m, 4, 14).

        By segment and tendon three rows in world axes, and a fourth along the segment: the change of its length.
        """
        n, m = pull.tension.shape
        rows: Array = np.empty((n, m, 4, 14))
        far, near = rows[:, :, :3, 7:], rows[:, :, :3, :7]
        motions = pull.motions.reshape(n + 1, m, 3, 4)
        far[..., :3], far[..., 3:] = _EYE3, motions[1:]
        near[..., :3], near[..., 3:] = -_EYE3, -motions[:-1]
        np.matmul(pull.directions[:, :, None], rows[:, :, :3], out=rows[:, :, 3:])
        return rows

    def _add_geometric(self, blocks: Array, pull: Pull, segments: Array) -> None:
        """Add the derivative at fixed tensions, see `tdcr_fe.elements.tendons.CableLines.stiffness`.

        Parameters
        ----------
        blocks
            Changed in place, shape (n+1, 7, n+1, 7).
        pull
            The configuration.
        segments
            See `_segments`.
        """
        n, m = pull.tension.shape
        weighted = segments * (pull.tension * pull.inverse)[:, :, None, None]
        np.negative(weighted[:, :, :3], out=weighted[:, :, :3])
        pair = segments.reshape(n, 4 * m, 14).swapaxes(1, 2) @ weighted.reshape(n, 4 * m, 14)
        own: Array = np.zeros((n + 1, 7, 7))
        own[:-1] = pair[:, :7, :7]
        own[1:] += pair[:, 7:, 7:]
        # Of H^T f at constant forces f, by Euler parameters that keep their norm.
        turned = own[:, 3:, 3:]
        turned += (pull.on_holes @ self._by_forces).reshape(n + 1, 4, 4)
        turned -= (pull.on_holes @ pull.doubled) * _EYE4
        turned -= (2.0 * pull.parameters)[:, :, None] * pull.forces[:, None, 3:]
        on_diagonal = _diagonal(blocks, 0, 0, n + 1)
        on_diagonal += own
        above = _diagonal(blocks, 0, 1, n)
        above += pair[:, :7, 7:]
        below = _diagonal(blocks, 1, 0, n)
        below += pair[:, 7:, :7]


class Iterate(NamedTuple):
    """An evaluation in an iteration of a solver, and for what.

    Attributes
    ----------
    coordinates : ndarray, shape (7 N,)
        Of the nodes, without reference values.
    time : float
        At the end of the step [s].
    state : FrictionState
        History at its beginning.
    base_tension : ndarray, shape (m,)
        [N].
    pull : Pull
    """

    coordinates: Array
    time: float
    state: FrictionState
    base_tension: Array
    pull: Pull

    def of_step(self, time: float, state: FrictionState, base_tension: Array) -> bool:
        """Whether it belongs to the same attempt of a step."""
        return self.time == time and self.state is state and bool((self.base_tension == base_tension).all())


class IteratedTendons:
    """Straight tendons in the iterations of a solver, of which the last is kept.

    Parameters
    ----------
    tendons
        Compute the forces.
    """

    def __init__(self, tendons: StraightTendons) -> None:
        self._tendons = tendons
        self._last: Iterate | None = None
        #: Trial mobilisations of the iterate before; in the first one the mobilisations at the beginning of the step.
        self._before: Array = np.zeros(0)

    def _at(
        self, coordinates: Array, reference: Array, time: float, state: FrictionState, base_tension: Array
    ) -> Pull:
        last = self._last
        same = last if last is not None and last.of_step(time, state, base_tension) else None
        if same is not None and np.array_equal(same.coordinates, coordinates):
            return same.pull
        there = coordinates.reshape(-1, 7) + reference
        pull = self._tendons.pull(there, base_tension, state)
        self._before = state.mobilisation.T if same is None else same.pull.trial
        self._last = Iterate(coordinates, time, state, base_tension, pull)
        return pull

    def forces(
        self, coordinates: Array, reference: Array, time: float, state: FrictionState, base_tension: Array
    ) -> Array:
        """Generalised forces on the coordinates of all nodes, shape (7 N,).

        Parameters
        ----------
        coordinates
            Of the nodes, without reference values, shape (7 N,).
        reference
            Their reference values, shape (N, 7).
        time
            At the end of the step [s].
        state
            History of friction at its beginning.
        base_tension
            [N], shape (m,).
        """
        return self._tendons.forces(self._at(coordinates, reference, time, state, base_tension))

    def tangent(
        self, coordinates: Array, reference: Array, time: float, state: FrictionState, base_tension: Array
    ) -> Array:
        """Tangent of `forces` for Newton's method, shape (7 N, 7 N); arguments as there."""
        pull = self._at(coordinates, reference, time, state, base_tension)
        return self._tendons.tangent(pull, self._before)

    def step_end(
        self, coordinates: Array, reference: Array, time: float, state: FrictionState, base_tension: Array
    ) -> tuple[FrictionState, Array, Pull]:
        """History of friction where a solved step ends, and tendon pulled in at the base [m]; arguments as there."""
        pull = self._at(coordinates, reference, time, state, base_tension)
        return self._tendons.friction(pull, time), self._tendons.base_slip(pull), pull


def _turns(pull: Pull, segments: Array) -> Array:
    """Derivatives of the angles by the nodes before, at and behind each hole, shape (n-1, m, 21)."""
    chord = 4.0 * pull.quarter
    square = chord * (1.0 - pull.quarter)
    # One over the sine; a straight tendon turns in no defined direction, so its derivative is set to zero.
    weight = np.sqrt(np.abs(square)) / (square + 1e-24)
    versed = (0.5 * chord)[:, :, None]
    before = -(weight * pull.inverse[:-1])[:, :, None] * (pull.bend + versed * pull.directions[:-1])
    after = (weight * pull.inverse[1:])[:, :, None] * (pull.bend - versed * pull.directions[1:])
    turns = np.zeros((*weight.shape, 21))
    turns[:, :, :14] = (before[:, :, None] @ segments[:-1, :, :3])[:, :, 0]
    turns[:, :, 7:] += (after[:, :, None] @ segments[1:, :, :3])[:, :, 0]
    return turns


def _windows(rows: Array, start: int, count: int, width: int) -> Array:
    """View of a contiguous array (m, r, 7 N): of ``count`` rows the ``width`` entries from node 0, 1 ... on.

    Its shape is (m, count, width); ``start`` is the first of the rows.
    """
    per_tendon, per_row, one = rows.strides
    return np.ndarray(
        (len(rows), count, width), rows.dtype, rows, start * per_row, (per_tendon, per_row + 7 * one, one)
    )


def _diagonal(blocks: Array, row: int, column: int, count: int) -> Array:
    """View of a contiguous array (N, 7, N, 7): ``count`` blocks (7, 7) along the diagonal that starts at a block."""
    down, one_down, right, one_right = blocks.strides
    start = row * down + column * right
    return np.ndarray((count, 7, 7), blocks.dtype, blocks, start, (down + right, one_down, one_right))

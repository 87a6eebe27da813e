"""Known states of a substep: their linearisation, their response to tensions and loads, and states between them.

The response is kept by the tensions of the segments: a change of one acts on the others only through the robot's
stiffness, which changes slowly along a load step. By the mobilisations of the holes it would change faster, since what
one of them does depends on the tensions, and on every hole before it.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from tdcr_fe.elements import Array, Index
from tdcr_fe.elements.forces import TendonForces
from tdcr_fe.solve.equations.configuration import SolverState, Target
from tdcr_fe.solve.equations.layout import Numbering
from tdcr_fe.solve.equations.linearization import BorderedFactors, Linearization
from tdcr_fe.solve.equations.system import SceneSystem
from tdcr_fe.solve.friction_path.follow import FrictionPath
from tdcr_fe.solve.friction_path.slips import SlipData, cubic
from tdcr_fe.solve.friction_path.transfer import TendonsInSubstep, block_diagonal
from tdcr_fe.solve.newton.convergence import BALANCED
from tdcr_fe.solve.newton.prediction import moved_elements

#: By robot, numbers of some of its tendons.
Tendons = Sequence[Index]

#: Largest turn of an element since the last linearisation with which that is as good as a new one [rad]. With four
#: times as much, one of twenty random robots ended 1.5e-5 of the length off.
EXACT_TURN = 1e-5


class Equilibrium(NamedTuple):
    """A solved state, linearised in this very state, or so near to it that it makes no difference."""

    state: SolverState
    forces: tuple[TendonForces, ...]  # By robot
    linearization: Linearization
    balanced: bool = True  # Whether forces balance: not where weight acts on a robot that was never loaded

    @classmethod
    def at(cls, system: SceneSystem, state: SolverState, target: Target) -> Equilibrium:
        """Linearise in a solved state under its own target, which is in the scene."""
        numbering = system.numbering()
        residual = system.residual(state, target, numbering)
        linearization = system.linearize(residual, numbering)
        return cls(state, residual.forces, linearization, balanced=residual.size < BALANCED)

    @property
    def numbering(self) -> Numbering:
        """Order of the unknowns."""
        return self.linearization.numbering

    @property
    def slips(self) -> Array:
        """Slips of the frictional holes [m], shape (k,)."""
        return self.numbering.at_frictional_holes([own.field.slip for own in self.forces])

    @property
    def mobilisation(self) -> Array:
        """Mobilisations of the frictional holes [1], shape (k,)."""
        return self.numbering.at_frictional_holes(self.state.mobilisation)

    @property
    def driven_tension(self) -> Array:
        """Tensions at the base of all tendons driven by displacement [N]."""
        return self.numbering.at_driven(self.state.base_tension)


def near_enough(state: SolverState, linearization: Linearization) -> bool:
    """Whether a linearisation is in a state, or so near to it that it makes no difference."""
    pairs = zip(linearization.chains, state.configuration.twists, strict=True)
    return all(float(np.abs(new[:, 3:] - old.twists[:, 3:]).max()) <= EXACT_TURN for old, new in pairs)


class SegmentResponse(NamedTuple):
    """Derivatives by the tensions of q segments, and in the last column by the load factor at fixed tensions.

    With r turning angles, padded ones included. All other tendons are slack.
    """

    nodes: Array  # (reduced, q + 1): Of the unknowns of the reduced scene
    lengths: Array  # (q, q + 1): Of the lengths [m/N, m]
    angles: Array  # (r, q + 1): Of the turning angles [rad/N, rad]

    @classmethod
    def of(cls, at: Equilibrium, tendons: Tendons, load: Array) -> SegmentResponse:
        """From the tangent, in which tensions change with the turning angles.

        A given tension ``t`` is the sum of one that is put on, and of what the angles add to it. With the response
        ``X`` to what is put on, and ``x0`` to the loads, unknowns, lengths and angles are ``x = x0 + X (t - B x)``,
        where ``B`` gives what the angles add. So ``x = X (1 + B X)^-1 (t - B x0) + x0``.

        Parameters
        ----------
        at
            The state.
        tendons
            By robot, the tendons; all others have no tension.
        load
            Derivative of the residual by the load factor, shape (reduced,).
        """
        (lengths, angles, by_angle), factors = _segments(at, tendons), at.linearization.factorisation
        right = np.asfortranarray(np.column_stack((lengths.T, -load)))
        right[at.numbering.clamped] = 0.0
        moved = (factors.inner if isinstance(factors, BorderedFactors) else factors).solve(right)
        turned = angles @ moved
        put_on, added = np.concatenate((moved, lengths @ moved, turned)), by_angle @ turned
        by_tension = put_on[:, :-1] @ np.linalg.inv(np.eye(len(lengths)) + added[:, :-1])
        by_load = put_on[:, -1] - by_tension @ added[:, -1]
        return cls(*np.split(np.column_stack((by_tension, by_load)), np.cumsum((len(moved), len(lengths)))))


def _segments(at: Equilibrium, tendons: Tendons) -> tuple[Array, Array, Array]:
    """Derivatives of lengths and angles by the reduced unknowns, and of the tensions by the angles."""
    reduced = at.numbering.reduced
    tables: tuple[list[Array], list[Array]] = [], []
    blocks = []
    for part, which in zip(at.numbering.robots, tendons, strict=True):
        own = at.forces[part.robot]
        shape = own.measured.shape
        for table, rows in zip(tables, (shape.d_lengths, shape.d_angles), strict=True):
            full = np.zeros((len(which) * rows.shape[1], reduced))
            full[:, part.nodes] = own.to_all_nodes(rows[which].reshape(len(full), rows.shape[-1]))
            table.append(full)
        blocks += list(own.field.d_angle[which])
    lengths, angles = (t[0] if len(t) == 1 else np.concatenate(t) for t in tables)
    return lengths, angles, block_diagonal(blocks)


class TautTendons(NamedTuple):
    """Tendons under tension in any of the known states of a substep.

    All other tendons transmit nothing; their holes are left out of the friction path.
    """

    tendons: tuple[TendonsInSubstep, ...]  # By robot
    holes: Index  # (k,): Numbers of their frictional holes, among those of all tendons
    driven: Index  # (c,): And of those driven by displacement, among all of these

    @classmethod
    def of(cls, states: Sequence[Equilibrium]) -> TautTendons:
        """Tendons under tension in any of some states.

        Parameters
        ----------
        states
            Solved states of a substep, from its start to its end.
        """
        numbering, tendons, taut = states[-1].numbering, [], []
        for part in numbering.robots:
            tense = [point.forces[part.robot].field.tension > 0.0 for point in states]
            taut.append(np.any(tense, axis=(0, 2)))
            which = np.flatnonzero(taut[-1])
            law = states[-1].forces[part.robot].model.law
            tension = np.array([states[i].state.base_tension[part.robot][which] for i in (0, -1)])
            frictional = part.frictional[which]
            driven = np.flatnonzero(np.isin(which, part.driven))
            tendons.append(TendonsInSubstep(law, which, frictional, driven, tension))
        by_hole = [own[:, None] & part.frictional for own, part in zip(taut, numbering.robots, strict=True)]
        holes = np.flatnonzero(numbering.at_frictional_holes(by_hole))
        return cls(tuple(tendons), holes, np.flatnonzero(numbering.at_driven(taut)))

    @property
    def numbers(self) -> Tendons:
        """By robot, numbers of the tendons under tension."""
        return [own.which for own in self.tendons]

    @property
    def presliding(self) -> Array:
        """Presliding distances of their frictional holes [m], shape (k,)."""
        return np.concatenate([np.full(t.holes, t.law.hysteresis.presliding) for t in self.tendons])

    def tensions(self, point: Equilibrium) -> Array:
        """Tensions of their segments in a state [N], shape (q,)."""
        return self._joined([own.field.tension for own in point.forces])

    def slip_data(self, point: InterpolationPoint, targets: tuple[Target, Target]) -> SlipData:
        """Slips and turning angles in a state, and their derivatives, see `SlipData`.

        ``targets``: inputs and loads at both ends of the substep.
        """
        factor, state, response = point
        values, slopes = [], []
        bases: list[tuple[Array, Array]] = []
        segment = 0
        for robot, own in enumerate(self.tendons):
            field, count = state.forces[robot].field, len(own.which)
            here = slice(segment, segment + own.segments)
            both = field.released_d_length[own.which].reshape(-1, 1) * response.lengths[here]
            stretched = field.released_d_tension[own.which].reshape(-1)
            both[np.arange(own.segments), np.arange(here.start, here.stop)] += stretched
            both = both.reshape(count, own.law.shape[1], both.shape[1])
            values.append(field.slip[own.which][own.frictional])
            slopes.append((own.law.slip_operator @ both)[own.frictional])
            driven = own.which[own.driven]
            pulled = -both[own.driven].sum(axis=1)
            first, last = (target.inputs[robot][driven] for target in targets)
            pulled[:, -1] += last - first
            bases.append((first + factor * (last - first) - field.base_slip[driven], pulled))
            segment = here.stop
        angles = self._joined([own.measured.shape.angles for own in state.forces])
        by_tension_and_load = np.concatenate([*slopes, *(b[1] for b in bases), response.angles])
        return SlipData(
            factor,
            self.tensions(state),
            np.concatenate([*values, *(b[0] for b in bases), angles]),
            by_tension_and_load[:, :-1],
            by_tension_and_load[:, -1],
        )

    def _joined(self, by_robot: list[Array]) -> Array:
        """Values of these tendons, of all robots one after the other."""
        return np.concatenate([x[own.which].ravel() for x, own in zip(by_robot, self.tendons, strict=True)])


class InterpolationPoint(NamedTuple):
    """A solved state at an end of a substep or within it, between which slips are interpolated."""

    factor: float  # Load factor within the substep [1]
    state: Equilibrium
    # To the tensions of all tendons under tension at any of the points, and to the change of the loads in the substep
    response: SegmentResponse


class KnownStates(NamedTuple):
    """States of a substep, from its start to its end."""

    span: tuple[float, float]  # Load factors of the load step at its ends [1]
    targets: tuple[Target, Target]  # Inputs and loads there
    taut: TautTendons  # The tendons under tension in any of the states
    points: tuple[InterpolationPoint, ...]  # The states, by load factor

    def load_factor(self, fraction: float) -> float:
        """Load factor of the load step at a fraction of the substep [1]."""
        start, end = self.span
        return start + fraction * (end - start)

    @property
    def start(self) -> Equilibrium:
        """The state at the start of the substep."""
        return self.points[0].state

    @property
    def end(self) -> Equilibrium:
        """The state at its end."""
        return self.points[-1].state


def twists(point: Equilibrium) -> Array:
    """Twists of all elements: translations [m] and rotations [rad], six values each."""
    return np.concatenate([own.reshape(-1) for own in point.state.configuration.twists])


def twist_change(point: InterpolationPoint, tension: Array, load: float) -> Array:
    """Change of the twists of all elements by one of the tensions and of the loads, to first order.

    Parameters
    ----------
    point
        Where it is linearised.
    tension
        Change of the tensions of the segments [N], shape (q,).
    load
        Part of the change of the loads in the substep [1].
    """
    nodes = point.response.nodes @ np.append(tension, load)
    return point.state.linearization.twist_changes(nodes)


def interpolated(
    system: SceneSystem, known: KnownStates, path: FrictionPath, factor: float, max_turn: float
) -> SolverState | None:
    """The state at a load factor within the substep, by interpolation; None where an element turns by too much.

    Twists of the elements by a cubic along the line between the tensions of the states on both sides, beside it linear
    in the tensions: as slips are interpolated (`tdcr_fe.solve.friction_path.slips`). Mobilisations and
    tensions at the base are those of the path.
    """
    (unknowns, tension), points, taut = path.at(factor), known.points, known.taut
    last = next(i for i, point in enumerate(points) if point.factor >= factor)
    first, then = points[last - 1], points[last]
    length = then.factor - first.factor
    x = (factor - first.factor) / length
    ends = [taut.tensions(point.state) for point in (first, then)]
    change, off_line = ends[1] - ends[0], tension - ends[0] - x * (ends[1] - ends[0])
    slopes = [twist_change(point, change, length) for point in (first, then)]
    square, cube = cubic(twists(then.state) - twists(first.state), *slopes)
    step = x * (slopes[0] + x * (square + x * cube))
    step += (1.0 - x) * twist_change(first, off_line, 0.0) + x * twist_change(then, off_line, 0.0)
    state = first.state.state
    configuration = moved_elements(system, state, step, max_turn)
    if configuration is None:
        return None
    return with_path_unknowns(first.state, taut, unknowns)._replace(configuration=configuration)


def with_path_unknowns(point: Equilibrium, taut: TautTendons, unknowns: Array) -> SolverState:
    """A state with other mobilisations, and other tensions at the base of tendons driven by displacement."""
    state, numbering, k = point.state, point.numbering, len(taut.holes)
    mobilised = point.mobilisation.copy()
    mobilised[taut.holes] = unknowns[:k]
    tension = np.zeros(numbering.linear - numbering.reduced)
    tension[taut.driven] = unknowns[k:]
    return state._replace(
        mobilisation=numbering.with_frictional_holes(state.mobilisation, mobilised),
        base_tension=numbering.with_driven(state.base_tension, tension),
    )

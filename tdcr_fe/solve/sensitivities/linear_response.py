"""Linear response of a solved state: motion, tensions and mobilisations under small changes of whatever acts.

Every hole keeps its state: one that slips goes on slipping at full friction, the mobilisation of one that sticks
follows its slip. The linearisation is taken at the state itself. `local_response` is the motion of one node under loads
and inputs.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from tdcr_fe.elements import Array, Flags
from tdcr_fe.elements.forces import TendonForces
from tdcr_fe.elements.hysteresis import ACCEPTED, FrictionState, Hysteresis
from tdcr_fe.elements.poses import skew
from tdcr_fe.elements.section_forces import DIFFERENCE
from tdcr_fe.model.results import LocalResponse
from tdcr_fe.model.schema import check_instance
from tdcr_fe.scene.handle import TDCR
from tdcr_fe.solve.equations.configuration import SolverState, Target
from tdcr_fe.solve.equations.layout import Numbering
from tdcr_fe.solve.equations.linearization import Linearization
from tdcr_fe.solve.equations.system import SceneSystem
from tdcr_fe.solve.newton.steps import FrictionCoupling
from tdcr_fe.solve.sensitivities.robot_model import TendonStack, Values, with_rates
from tdcr_fe.solve.simulation import Simulation, one_thread


class TendonChange(NamedTuple):
    """Change of the tendons of one robot; right sides are the last axis."""

    base_tension: Array  # (m, P): Tensions at the base [N]
    mobilisation: Array  # (m, g, P): Mobilisations [1]
    tension: Array  # (m, n, P): Tensions of the segments [N]
    released: Array  # (m, n, P): Released lengths of the segments [m]
    slip: Array  # (m, g, P): Slips [m]


class Response(NamedTuple):
    """Change of a solved state; right sides are the last axis."""

    # (linear, P): Body-frame increments of the nodes, changes of everything else and of tensions at the base
    # that are unknowns
    unknowns: Array
    tendons: tuple[TendonChange, ...]  # By robot


class Disturbance(NamedTuple):
    """What changes at one robot while its nodes stay where they are; right sides are the last axis."""

    wrenches: Array  # (6 N, P): Wrenches on the nodes, in their own frames [N, N m]
    inputs: Array  # (m, P): Tensions [N] or displacements [m] at the base
    tension: Array  # (m, n, P): Tensions of the segments, at the same tension at the base [N]
    released: Array  # (m, n, P): Released lengths of the segments, at the same tension at the base [m]
    slip: Array  # (m, g, P): Slips at the beginning of the increment [m]
    mobilisation: Array  # (m, g, P): Mobilisations at the beginning of the increment [1]

    def with_inputs(self, change: Array) -> Disturbance:
        """With one more right side: a change of the inputs, shape (m,)."""
        more = Disturbance(*(np.concatenate((x, np.zeros((*x.shape[:-1], 1))), axis=-1) for x in self))
        more.inputs[:, -1] = change
        return more

    @classmethod
    def none(cls, forces: TendonForces, count: int) -> Disturbance:
        """No disturbance, for ``count`` right sides."""
        law = forces.model.law
        (m, n), g = law.shape, law.groups
        nodes = 6 * forces.model.mesh.arc_lengths.size
        return cls(*(np.zeros((*x, count)) for x in ((nodes,), (m,), (m, n), (m, n), (m, g), (m, g))))


@dataclass(frozen=True, eq=False)
class SolvedPoint:
    """A solved state, linearised."""

    numbering: Numbering
    state: SolverState  # With the history at the beginning of its increment
    forces: tuple[TendonForces, ...]  # By robot
    linearization: Linearization
    sticking: tuple[Flags, ...]  # (m, g): By robot, whose mobilisations follow their slips
    # (2, m, g): By robot, slopes of the slips by the mobilisations of holes that stick, at the beginning of the
    # increment and at its end [m]
    flexibility: tuple[Array, ...]

    @classmethod
    def of(
        cls,
        system: SceneSystem,
        state: SolverState,
        target: Target,
        *,
        softening: float = 1.0,
        numbering: Numbering | None = None,
        all_stick: bool = False,
        sticking: tuple[Flags, ...] | None = None,
        linearization: Linearization | None = None,
    ) -> SolvedPoint:
        """Linearise a solved state.

        Parameters
        ----------
        system
            The scene.
        state
            With the history at the beginning of its increment.
        target
            Inputs and time; loads are those already in the scene.
        softening
            Factor on the presliding distance [1].
        numbering
            Numbering of the unknowns; None is that of the scene.
        all_stick
            Let holes that slip stick, as where all motion reverses.
        sticking
            Which holes stick, by robot; None finds out from the history.
        linearization
            Linearization of a state near it; None is that of the state itself, in which the scene is left.
        """
        numbering = system.numbering() if numbering is None else numbering
        if linearization is None:
            residual = system.residual(state, target, numbering)
            forces, linearization = residual.forces, system.linearize(residual, numbering)
        else:
            forces = system.forces(state, target.time)
        by_robot = list(zip(forces, state.mobilisation, state.friction, strict=True))
        if sticking is None:
            sticking = tuple(
                own.model.law.frictional & (all_stick | ~_slips(own, mobilisation, history, softening))
                for own, mobilisation, history in by_robot
            )
        flexibility = tuple(
            _flexibility(own.model.law.hysteresis.softened(softening), s, history, turns=all_stick)
            for own, s, history in by_robot
        )
        return cls(numbering, state, forces, linearization, sticking, flexibility)

    def respond(self, disturbances: tuple[Disturbance, ...], unbalanced: Array | None = None) -> Response:
        """Response to disturbances, one of each robot, and to a residual (reduced,) beside the last of them."""
        response = self._respond_with_holes(disturbances, unbalanced)
        for i, own in enumerate(self.forces):
            if own.model.geometry is not None and own.model.geometry.shifts:
                response = self._with_shifts(response, i)
        return response

    def _with_shifts(self, response: Response, robot: int) -> Response:
        """A response with the shift of a robot's tendons in oversized holes, which the tangent leaves out.

        The shift follows from the motion, and the motion from the shift: one small linear system.
        """
        own = self.forces[robot]
        wrenches, tension, released = _by_shifts(own)
        which = self.numbering.robots[robot].nodes.start + 6 * own.model.cable_nodes[:, None] + np.arange(6)
        which = which.ravel()
        disturbances = [Disturbance.none(x, len(which)) for x in self.forces]
        changes = {"wrenches": wrenches.reshape(-1, len(which)), "tension": tension, "released": released}
        disturbances[robot] = disturbances[robot]._replace(**changes)
        by_motion = self._respond_with_holes(tuple(disturbances))
        coupled = np.eye(len(which)) - by_motion.unknowns[which]
        moved = np.linalg.solve(coupled, response.unknowns[which])
        pairs = zip(response.tendons, by_motion.tendons, strict=True)
        tendons = tuple(TendonChange(*(a + b @ moved for a, b in zip(x, y, strict=True))) for x, y in pairs)
        return Response(response.unknowns + by_motion.unknowns @ moved, tendons)

    def _respond_with_holes(
        self, disturbances: tuple[Disturbance, ...], unbalanced: Array | None = None
    ) -> Response:
        """Response where tendons do not shift inside their holes."""
        numbering, count = self.numbering, disturbances[0].wrenches.shape[1]
        right = np.zeros((numbering.linear, count), order="F")
        if unbalanced is not None:
            right[: numbering.reduced, -1] -= unbalanced
        for part, own, each in zip(numbering.robots, self.forces, disturbances, strict=True):
            known = each.inputs.copy()
            known[part.driven] = 0.0
            right[part.nodes] -= each.wrenches + own.base_tension_columns() @ known
        gap = numbering.at_driven([each.released.sum(axis=1) - each.inputs for each in disturbances])
        gap[self.linearization.slack] = 0.0
        right[numbering.reduced :] = -gap
        right[numbering.clamped] = 0.0
        unknowns = self.linearization.factorisation.solve(right)
        changes = [np.zeros((*x.shape, count)) for x in self.sticking]
        found = self._tendons(unknowns, disturbances, changes)
        if numbering.has_friction and numbering.at_frictional_holes(self.sticking).any():
            unknowns, changes = self._with_sticking(unknowns, found, disturbances)
            found = self._tendons(unknowns, disturbances, changes)
        return Response(unknowns, tuple(found))

    def _tendons(
        self, unknowns: Array, disturbances: tuple[Disturbance, ...], changes: Sequence[Array]
    ) -> list[TendonChange]:
        """Changes of the tendons of all robots with the unknowns and the mobilisations."""
        found = []
        by_robot = zip(self.numbering.robots, self.forces, changes, disturbances, strict=True)
        for part, own, change, disturbance in by_robot:
            base = disturbance.inputs.copy()
            base[part.driven] = unknowns[part.tensions]
            tension, released = own.tendon_change(unknowns[part.nodes], base, change)
            tension, released = tension + disturbance.tension, released + disturbance.released
            slip = own.model.law.slip_operator @ released
            found.append(TendonChange(base, change, tension, released, slip))
        return found

    def _with_sticking(
        self, fixed: Array, tendons: Sequence[TendonChange], disturbances: tuple[Disturbance, ...]
    ) -> tuple[Array, list[Array]]:
        """Unknowns, and mobilisations of all holes, where those that stick follow their slips.

        Without them the unknowns are ``fixed``, and the tendons change as given.
        """
        numbering, pick = self.numbering, self.numbering.at_frictional_holes
        by_robot = zip(tendons, disturbances, self.flexibility, strict=True)
        excess = pick([x.slip - own.slip + a[0, ..., None] * own.mobilisation for x, own, a in by_robot])
        coupling = FrictionCoupling.of(numbering, self.forces, self.linearization.slack)
        which, at_end = np.flatnonzero(pick(self.sticking)), pick([end for _, end in self.flexibility])
        columns, matrix = coupling.response(self.linearization.factorisation.solve, which, at_end)
        change = np.zeros(excess.shape)
        change[which] = np.linalg.solve(matrix[which], excess[which])
        none = [np.zeros(own.mobilisation.shape) for own in disturbances]
        changes = numbering.with_frictional_holes(none, change)
        return fixed + columns @ change[which], list(changes)


def _by_shifts(own: TendonForces) -> Values:
    """Change of the forces as the tendons shift in their holes, by body-frame increments of the nodes with holes.

    Everything else stays as it is. By central differences; the increments are the last axis.
    """
    geometry, law, which = own.model.geometry, own.model.law, own.model.cable_nodes
    assert geometry is not None
    positions, rotations = (x[which] for x in own.measured.poses)
    count, mobilisation = 6 * len(which), own.field.mobilisation
    steps = DIFFERENCE * np.repeat((law.parameters.lengths[law.parameters.mask].min(), 1.0), 3)
    node, component = np.divmod(np.arange(count), 6)
    moved = np.zeros((2, count, len(which), 6))
    moved[0, np.arange(count), node, component] = steps[component]
    moved[1] = -moved[0]
    along = positions + (rotations @ moved[..., :3, None])[..., 0]
    offsets = geometry.shifted(along, rotations + rotations @ skew(moved[..., 3:]))
    rate = np.zeros_like(mobilisation) if own.field.slip_rate is None else own.field.slip_rate
    stack = TendonStack.with_offsets(own.model, offsets.reshape(-1, *offsets.shape[2:]))
    values = stack.at(own, mobilisation, np.tile(rate, (2 * count, 1, 1)))
    width = 2.0 * steps[component]
    pulled, tension, released = (np.moveaxis(x[:count] - x[count:], 0, -1) / width for x in values)
    wrenches = np.zeros((len(own.measured.poses[0]), 6, count))
    wrenches[which] = pulled
    return with_rates(Values(wrenches, tension, released), own, rate, None)


def _flexibility(
    hysteresis: Hysteresis, mobilisation: Array, history: FrictionState, *, turns: bool
) -> Array:
    """Slopes of the slips by the mobilisations at a history and at a mobilisation [m], shape (2, m, g).

    Where nothing has moved, on in its direction, or back where all turns.
    """
    moved = np.sign(mobilisation - history.mobilisation)
    direction = np.where(moved == 0.0, np.sign(-mobilisation if turns else mobilisation), moved)
    return np.array([hysteresis.flexibility(at, direction) for at in (history.mobilisation, mobilisation)])


def _slips(own: TendonForces, mobilisation: Array, history: FrictionState, softening: float) -> Flags:
    """Which holes slip: full friction acts, and so it follows from the slip since the history, shape (m, g)."""
    trial = own.model.law.hysteresis.softened(softening).trial(own.field.slip, history)
    return np.asarray(np.minimum(np.abs(mobilisation), np.abs(trial)) >= 1.0 - ACCEPTED)


def local_response(where: Simulation | TDCR, s: float | None = None, reversal: bool = False) -> LocalResponse:
    """Motion of one node under small changes of loads and tendon inputs.

    The tangent at the solved state is used, with everything else in the scene.

    Parameters
    ----------
    where
        A simulation, or a robot in a scene that `SolveTDCR` has solved.
    s
        Arc length of the node [m]; None is the tip.
    reversal
        Let all holes stick, as where every motion reverses. Else holes that slip go on slipping in their direction.

    Raises
    ------
    KeyError
        There is no node at this arc length.
    TypeError
        It is neither a simulation nor a robot.
    numpy.linalg.LinAlgError
        The tangent is singular.
    """
    hint = "a Simulation, or a robot in a scene, as CreateTDCR returns it"
    check_instance("local_response", "where", where, (Simulation, TDCR), hint)
    with one_thread():
        if isinstance(where, Simulation):
            found = response_at(where.system, where.state, 0, s, reversal)
            where.system.store(where.state)
            return found
        system = SceneSystem(where.mbs)
        number = system.robots.index(where.actuation)
        state = system.current_state(where.mbs.systemData.GetTime())
        try:
            found = response_at(system, state, number, s, reversal)
            system.store(state)
        finally:
            system.connect()
        return found


def response_at(
    system: SceneSystem, state: SolverState, robot: int, s: float | None, reversal: bool
) -> LocalResponse:
    """`local_response` of a robot in a system, by its number; the scene is left in this state."""
    actuation = system.robots[robot]
    mesh, m = actuation.mesh, actuation.law.shape[0]
    node = len(mesh.arc_lengths) - 1 if s is None else mesh.node_at(s, 1e-6)
    numbering = system.numbering(by_tension=robot)
    solved = SolvedPoint.of(system, state, state.target, numbering=numbering, all_stick=reversal)
    disturbances = [Disturbance.none(own, 6 + m) for own in solved.forces]
    rotation = state.configuration.poses[robot][1][node]
    own = disturbances[robot]
    rows = own.wrenches[6 * node : 6 * node + 6]
    rows[:3, :3] = rows[3:, 3:6] = rotation.T
    own.inputs[:, 6:] = np.eye(m)
    response = solved.respond(tuple(disturbances))
    moved = response.unknowns[numbering.robots[robot].nodes][6 * node : 6 * node + 6]
    motion = np.concatenate((rotation @ moved[:3], rotation @ moved[3:]))
    slip = response.tendons[robot].released.sum(axis=1)
    taut = state.base_tension[robot] > 0.0
    driven = np.flatnonzero(actuation.drives.winds & taut)
    compliance = motion[:, :6].copy()
    if driven.size:
        kept = np.linalg.solve(slip[np.ix_(driven, 6 + driven)], slip[driven, :6])
        compliance -= motion[:, 6 + driven] @ kept
    pulled = np.flatnonzero(taut)
    stiffness = np.zeros((m, m))
    stiffness[np.ix_(pulled, pulled)] = np.linalg.inv(slip[np.ix_(pulled, 6 + pulled)])
    at, by_tension = float(mesh.arc_lengths[node]), motion[:, 6:]
    return LocalResponse(at, reversal, compliance, by_tension, by_tension @ stiffness, stiffness)

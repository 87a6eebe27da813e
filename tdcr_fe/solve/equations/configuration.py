"""States of a scene: the configuration of its backbones, the tensions, and the history of friction.

A beam node has seven coordinates (position and Euler parameters) and one norm constraint in Exudyn; here it has the
six components ``[v, w]`` of a twist in its own frame. Everything else in the scene keeps its coordinates.

A `Configuration` is a value; `ConfigurationSpace` builds, moves and compares them and writes them into Exudyn's scene.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from math import acos
from typing import NamedTuple

import exudyn as exu
import numpy as np

from tdcr_fe.elements import Array, Index
from tdcr_fe.elements.backbone import ElementChain, NodePoses, relative_twists
from tdcr_fe.elements.forces import Measurement
from tdcr_fe.elements.hysteresis import FrictionState
from tdcr_fe.elements.native.actuation import TendonActuation
from tdcr_fe.elements.poses import ONES4, coefficients, exp_matrix, pose_matrix

ByRobot = tuple[Array, ...]
_CURRENT, _INITIAL = exu.ConfigurationType.Current, exu.ConfigurationType.Initial


class BodyFrameReduction:
    """Map from Exudyn's unknowns to those of the strain-space solver.

    Parameters
    ----------
    mbs
        An assembled system.
    beam
        ODE2 coordinate numbers of all beam nodes, shape (N, 7).
    dropped
        Numbers of what is neither solved nor kept in equilibrium, multipliers behind all coordinates: the nodes' norm
        constraints and joints of clamped bases, which are satisfied by construction, and what does not change.
    """

    def __init__(self, mbs: exu.MainSystem, beam: Index, dropped: Index) -> None:
        data = mbs.systemData
        self.n2 = data.ODE2Size()
        self.size = self.n2 + data.AEsize()
        self.beam = beam
        self.nodes = len(beam)
        taken = np.zeros(self.size, dtype=bool)
        taken[beam.ravel()] = True
        taken[dropped] = True
        #: Exudyn's numbers of what is not a beam node, coordinates first, multipliers behind them.
        self.other = np.flatnonzero(~taken)
        self.other_coordinates = self.other[self.other < self.n2]
        self.other_multipliers = self.other[self.other >= self.n2] - self.n2
        #: Number of unknowns after the reduction.
        self.count = 6 * self.nodes + len(self.other)

    def residual(self, r: Array, frames: Array) -> Array:
        """Wrenches ``[f, m]`` of the nodes in their own frames, then the rest, shape (count,)."""
        at_nodes = (r.take(self.beam)[:, None, :] @ frames).reshape(-1)
        return np.concatenate((at_nodes, r[self.other])) if self.other.size else at_nodes

    def tangent(self, j: Array, frames: Array) -> Array:
        """Exudyn's Jacobian in the same terms, shape (count, count).

        Parameters
        ----------
        j
            Shape (size, size).
        frames
            See `tdcr_fe.elements.backbone.NodePoses`.
        """
        order = np.concatenate((self.beam.ravel(), self.other))
        rows = j[np.ix_(order, order)]
        for _ in range(2):
            # By node, its seven rows become six; then the same of the columns.
            at_nodes = frames.swapaxes(1, 2) @ rows[: self.beam.size].reshape(self.nodes, 7, -1)
            rows = np.concatenate((at_nodes.reshape(6 * self.nodes, -1), rows[self.beam.size :])).T
        return np.ascontiguousarray(rows)


class Unknowns(NamedTuple):
    """The independent unknowns of a configuration; small, and can be pickled."""

    # Coordinates of the scene, as in Exudyn; for a robot that is solved by itself those of its nodes alone
    coordinates: Array
    multipliers: Array  # Reactions of the joints (Lagrange multipliers), as in Exudyn
    twists: tuple[Array, ...]  # By robot, relative twists of the elements, length times strain, shape (E, 6)
    bases: tuple[Array, ...]  # By robot, pose of the base node, shape (4, 4)


class Configuration(NamedTuple):
    """A configuration of the scene, with the poses that follow from its unknowns. Its arrays are never changed."""

    unknowns: Unknowns
    chains: tuple[ElementChain, ...]  # By robot
    # By robot, positions (N, 3) and rotations (N, 3, 3) of the nodes, the latter in beam axes
    poses: tuple[tuple[Array, Array], ...]
    positions: Array  # (N, 3): Of the nodes of all robots [m]
    parameters: Array  # (N, 4): Euler parameters of the nodes of all robots
    frames: Array  # (N, 7, 6): See `NodePoses`
    measured: tuple[Measurement, ...]  # By robot, lengths and angles of the tendons

    @property
    def twists(self) -> tuple[Array, ...]:
        """By robot, relative twists of the elements, shape (E, 6)."""
        return self.unknowns.twists

    def turn_to(self, other: Configuration) -> float:
        """Largest rotation of any beam node to another configuration [rad]."""
        cosine = np.abs((self.parameters * other.parameters) @ ONES4).min()
        return 2.0 * acos(min(float(cosine), 1.0))


class ConfigurationSpace:
    """All configurations of a scene.

    Parameters
    ----------
    mbs
        An assembled system.
    robots
        All robots in it.
    reduction
        Which of Exudyn's unknowns are beam nodes, and which are kept as they are.
    clamped
        Numbers of the robots with a clamped base.
    joints
        Numbers of the multipliers of these clamps, where nothing but the robots belongs to the configurations.

    Attributes
    ----------
    slices : list of slice
        By robot, its nodes among those of all robots.
    """

    def __init__(
        self,
        mbs: exu.MainSystem,
        robots: Sequence[TendonActuation],
        reduction: BodyFrameReduction,
        clamped: Collection[int],
        joints: Index | None = None,
    ) -> None:
        self.mbs = mbs
        self.robots = robots
        self._reduction = reduction
        self._clamped = frozenset(clamped)
        ends = np.cumsum([len(r.nodes) for r in robots])
        self.slices = [slice(int(e) - len(r.nodes), int(e)) for e, r in zip(ends, robots, strict=True)]
        reference = np.array(mbs.systemData.GetODE2Coordinates(exu.ConfigurationType.Reference))
        self._reference: Array = reference[reduction.beam]
        #: Which coordinates and multipliers of the scene belong to the configurations, and where among them the beam
        #: nodes' coordinates lie.
        self._kept = (slice(None), slice(None)) if joints is None else (reduction.beam.ravel(), joints)
        self._beam = (
            reduction.beam if joints is None else np.arange(reduction.beam.size).reshape(reduction.beam.shape)
        )

    def from_scene(self) -> Configuration:
        """The current configuration of Exudyn's scene; clamped bases have the pose of their clamps."""
        data = self.mbs.systemData
        twists, bases = [], []
        for i, robot in enumerate(self.robots):
            p, r, _ = robot.scene_poses()
            twists.append(relative_twists(p, r))
            clamp = robot.clamp if i in self._clamped else None
            bases.append(pose_matrix(*((p[0], r[0]) if clamp is None else (clamp.position, clamp.rotation))))
        kept, constraints = self._kept
        coordinates = np.array(data.GetODE2Coordinates()[kept])
        multipliers = np.array(data.GetAECoordinates()[constraints])
        return self.build(Unknowns(coordinates, multipliers, tuple(twists), tuple(bases)))

    def build(self, unknowns: Unknowns, near: Array | None = None) -> Configuration:
        """A configuration from its unknowns.

        Parameters
        ----------
        unknowns
            The coordinates of beam nodes among them follow from the twists and bases; of the given ones only the
            signs of the Euler parameters are used.
        near
            Euler parameters that have these signs, shape (N, 4), where they are known.
        """
        if near is None:
            near = (unknowns.coordinates[self._beam] + self._reference)[:, 3:]
        # Both signs of Euler parameters are the same rotation; Exudyn's own solvers continue from the nearer one.
        chains = tuple([ElementChain(twists) for twists in unknowns.twists])
        by_robot = zip(chains, unknowns.bases, self.slices, strict=True)
        every = [chain.nodes(base, near[own]) for chain, base, own in by_robot]
        whole = every[0] if len(every) == 1 else NodePoses(*map(np.concatenate, zip(*every, strict=True)))
        coordinates = unknowns.coordinates.copy()
        moved = np.concatenate((whole.positions, whole.parameters), axis=1)
        coordinates[self._beam] = moved - self._reference
        written = unknowns._replace(coordinates=coordinates)
        poses = tuple([(own.positions, own.rotations) for own in every])
        shaped = zip(self.robots, poses, unknowns.twists, strict=True)
        measured = tuple([robot.model.measure(*pose, twists) for robot, pose, twists in shaped])
        return Configuration(
            written, chains, poses, whole.positions, whole.parameters, whole.frames, measured
        )

    def move(
        self, start: Configuration, step: Array, chains: Sequence[ElementChain], max_turn: float
    ) -> tuple[Configuration, float]:
        """The configuration after a step, or the fraction of it [1] in which no element turns by more than allowed.

        Parameters
        ----------
        start
            Configuration to start from.
        step
            Body-frame increments of the beam nodes, then changes of everything else.
        chains
            The elements in whose frames the increments are.
        max_turn
            Largest change of an element's rotation [rad].
        """
        reduction, old = self._reduction, start.unknowns
        six = 6 * reduction.nodes
        nodes = step[:six].reshape(-1, 6)
        changes = [chain.changes(nodes[own]) for chain, own in zip(chains, self.slices, strict=True)]
        turn = max(float(np.abs(c[:, 3:]).max()) for c in changes)
        fraction = min(1.0, max_turn / turn) if turn > 0.0 else 1.0
        nodes, changes = fraction * nodes, [fraction * c for c in changes]
        twists = tuple([t + change for t, change in zip(old.twists, changes, strict=True)])
        bases = list(old.bases)
        for i, own in enumerate(self.slices):
            if i in self._clamped:
                continue
            first = nodes[own.start]
            if max(map(abs, first.tolist())) > 1e-15:
                bases[i] = bases[i] @ exp_matrix(first, coefficients(first[3:]))
        rest, n2 = fraction * step[six : reduction.count], len(reduction.other_coordinates)
        coordinates, multipliers = old.coordinates.copy(), old.multipliers.copy()
        coordinates[reduction.other_coordinates] += rest[:n2]
        multipliers[reduction.other_multipliers] += rest[n2:]
        moved = Unknowns(coordinates, multipliers, twists, tuple(bases))
        return self.build(moved, start.parameters), fraction

    def write(self, configuration: Configuration, initial: bool = False) -> None:
        """Make this the current configuration of Exudyn's scene; with ``initial`` the initial one, too."""
        kinds = (_CURRENT, _INITIAL) if initial else (_CURRENT,)
        data, unknowns = self.mbs.systemData, configuration.unknowns
        coordinates, multipliers = self._kept
        for kind in kinds:
            # Into Exudyn's memory: a third of the time of its functions that set coordinates.
            data.GetODE2Coordinates(kind, copy=False)[coordinates] = unknowns.coordinates
            if unknowns.multipliers.size:
                data.GetAECoordinates(kind, copy=False)[multipliers] = unknowns.multipliers

    def fits(self, unknowns: Unknowns) -> bool:
        """Whether unknowns fit this scene: the same numbers of coordinates and the same meshes."""
        elements = [len(r.nodes) - 1 for r in self.robots]
        count = self._beam.size + len(self._reduction.other_coordinates)
        return [len(t) for t in unknowns.twists] == elements and len(unknowns.coordinates) == count


class SolverState(NamedTuple):
    """The complete state at the beginning of a step. Its arrays are never changed."""

    configuration: Configuration  # Configuration of the whole scene
    base_tension: ByRobot  # (m,): By robot, tension of every tendon at the base [N]
    # (m, g): By robot, mobilisation of the friction in [-1, 1]; in a solved state that of `friction`
    mobilisation: ByRobot
    friction: tuple[FrictionState, ...]  # By robot, history at the end of the last solved (sub)step
    prescribed: ByRobot  # (m,): By robot, prescribed displacement [m], nan of tendons driven by tension
    # (6,): Concentrated loads that acted, force [N] and moment [N m] in their own frames
    loads: tuple[Array, ...] = ()
    time: float = 0.0  # Time for which it was solved [s]
    # Sign of the determinant of the last tangent, 0 where it is unknown or unrelated to stability
    tangent_sign: int = 0

    @property
    def inputs(self) -> ByRobot:
        """By robot, what every tendon is driven by: displacement [m] where prescribed, else tension [N]."""
        by_robot = zip(self.prescribed, self.base_tension, strict=True)
        return tuple([np.where(np.isnan(given), tension, given) for given, tension in by_robot])

    @property
    def target(self) -> Target:
        """Inputs, loads and time with which it was solved."""
        return Target(self.inputs, self.loads, self.time)

    def stored(self) -> StoredState:
        """The state as its unknowns alone."""
        return StoredState(self.configuration.unknowns, self.base_tension, self.mobilisation)


@dataclass(frozen=True)
class StoredState:
    """A solved state reduced to its unknowns; small, and can be pickled."""

    unknowns: Unknowns  # Unknowns of the configuration
    base_tension: ByRobot  # See `SolverState`
    mobilisation: ByRobot  # See `SolverState`

    def on_mesh(self, before: Array, arc_lengths: Array) -> StoredState:
        """The state of a robot alone in its scene on another mesh, with the same strains.

        Parameters
        ----------
        before, arc_lengths
            Arc lengths of the nodes of its own and of the other mesh [m], shapes (N,) and (N',).
        """
        old = self.unknowns
        # The sum of the twists from the base on is linear in the arc length within each element.
        summed = np.concatenate((np.zeros((1, 6)), old.twists[0].cumsum(axis=0)))
        twists = np.diff(np.stack([np.interp(arc_lengths, before, c) for c in summed.T], axis=1), axis=0)
        # Positions and Euler parameters of the nodes, and a multiplier for each, follow from the twists.
        coordinates = np.zeros(7 * arc_lengths.size)
        multipliers = np.zeros(old.multipliers.size + arc_lengths.size - before.size)
        moved = old._replace(coordinates=coordinates, multipliers=multipliers, twists=(twists,))
        return replace(self, unknowns=moved)


@dataclass(frozen=True, eq=False)
class Target:
    """Inputs, loads and time with which a state has to be in equilibrium."""

    inputs: ByRobot  # (m,): By robot, tension [N] or displacement [m] of every tendon at the base
    # (6,): Concentrated loads, force [N] and moment [N m] in their own frames; they are already in the scene
    loads: tuple[Array, ...] = ()
    time: float = 0.0  # Time that user functions see [s]

    @property
    def load_size(self) -> float:
        """Largest component of a force, for the scale of the residual [N]."""
        return float(np.abs(np.array(self.loads)[:, :3]).max()) if self.loads else 0.0

"""Where a scene is: beams by the twists of their elements and the pose of their base, all else by its coordinates."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import acos

import exudyn as exu
import numpy as np
from numpy.typing import NDArray

from tdcr_fe.elements.actuation import TendonActuation
from tdcr_fe.elements.backbone import ElementChain, relative_twists
from tdcr_fe.elements.poses import coefficients, euler_parameters_near, exp_matrix, pose_matrix
from tdcr_fe.solve.reduction import BodyFrameReduction

Array = NDArray[np.float64]

_ONES4 = np.ones(4)


@dataclass(frozen=True)
class Place:
    """A configuration to go back to.

    Attributes
    ----------
    coordinates, multipliers : ndarray
        Of the whole scene, as in Exudyn.
    twists : list of ndarray
        By robot, of the elements, shape (E, 6).
    roots : list of ndarray
        By robot, pose of the base node, shape (4, 4).
    """

    coordinates: Array
    multipliers: Array
    twists: list[Array]
    roots: list[Array]


class Configuration:
    """The unknowns of a scene, with the poses that follow from them.

    Parameters
    ----------
    mbs
        An assembled system.
    robots
        All robots in it.
    reduction
        Which of Exudyn's unknowns are beam nodes, and which are kept as they are.
    clamped
        Numbers of the robots whose base stays where its clamp holds it.

    Attributes
    ----------
    twists, roots
        As in `Place`; after a change from outside call `rebuild`.
    chains : list of ElementChain
        By robot.
    poses : list of (ndarray, ndarray)
        By robot, positions (N, 3) and rotations (N, 3, 3) of the nodes, in beam axes.
    positions : ndarray, shape (N, 3)
        Of the nodes of all robots [m].
    multipliers : ndarray
        Algebraic unknowns of the whole scene.
    slices : list of slice
        By robot, its nodes among those of all robots.
    """

    def __init__(
        self,
        mbs: exu.MainSystem,
        robots: Sequence[TendonActuation],
        reduction: BodyFrameReduction,
        clamped: Sequence[int],
    ) -> None:
        self.mbs = mbs
        self._reduction = reduction
        self._clamped = frozenset(clamped)
        ends = np.cumsum([len(r.nodes) for r in robots])
        self.slices = [slice(int(e) - len(r.nodes), int(e)) for e, r in zip(ends, robots, strict=True)]
        data = mbs.systemData
        self._beam = reduction.beam
        self._reference = np.array(data.GetODE2Coordinates(exu.ConfigurationType.Reference))[self._beam]
        flat = self._beam.ravel()
        #: Where the beam nodes' coordinates lie, if in one piece and in order.
        self._span = (
            slice(int(flat[0]), int(flat[-1]) + 1)
            if np.array_equal(np.diff(flat), np.ones(len(flat) - 1))
            else None
        )
        self._coordinates = np.array(data.GetODE2Coordinates())
        self.multipliers = np.array(data.GetAECoordinates())
        self._multipliers_written = True
        self._parameters: Array = self._beams(self._coordinates)[:, 3:] + self._reference[:, 3:]
        self.twists: list[Array] = []
        self.roots: list[Array] = []
        for i, robot in enumerate(robots):
            p, r, _ = robot.scene_poses()
            self.twists.append(relative_twists(p, r))
            clamp = robot.clamp if i in clamped else None
            base = (p[0], r[0]) if clamp is None else (clamp.position, clamp.rotation)
            self.roots.append(pose_matrix(*base))
        self.rebuild()

    def _beams(self, coordinates: Array) -> Array:
        """Coordinates of the beam nodes, shape (N, 7); a view where they lie in one piece."""
        return coordinates[self._span].reshape(-1, 7) if self._span else coordinates[self._beam]

    def rebuild(self) -> None:
        """Poses of all beam nodes from base and twists, and their coordinates in Exudyn."""
        self.chains = [ElementChain(twists) for twists in self.twists]
        self.poses = [chain.poses(root) for root, chain in zip(self.roots, self.chains, strict=True)]
        if len(self.poses) == 1:
            positions, rotations = self.poses[0]
        else:
            positions = np.concatenate([p for p, _ in self.poses])
            rotations = np.concatenate([r for _, r in self.poses])
        # Both signs are the same rotation; Exudyn's own solvers go on from the nearer one.
        parameters = euler_parameters_near(rotations, self._parameters)
        self.positions, self._parameters = positions, parameters
        beams = self._beams(self._coordinates)
        np.subtract(positions, self._reference[:, :3], out=beams[:, :3])
        np.subtract(parameters, self._reference[:, 3:], out=beams[:, 3:])
        if not self._span:
            self._coordinates[self._beam] = beams
        self._reduction.set_poses(rotations, parameters)

    def move(self, step: Array, chains: Sequence[ElementChain], most: float) -> tuple[float, float]:
        """Take a step, or the share of it in which no element turns by more than allowed.

        Parameters
        ----------
        step
            Body-frame increments of the beam nodes, then changes of everything else.
        chains
            In whose frames the increments are.
        most
            Largest change of an element's rotation [rad].

        Returns
        -------
        share : float
            That was taken [1].
        turn : float
            Of the element that turns most in the whole step [rad].
        """
        reduction = self._reduction
        six = 6 * reduction.nodes
        nodes = step[:six].reshape(-1, 6)
        changes = [chain.changes(nodes[own]) for chain, own in zip(chains, self.slices, strict=True)]
        turn = max(float(np.abs(c[:, 3:]).max()) for c in changes)
        share = min(1.0, most / turn) if turn > 0.0 else 1.0
        for i, (change, own) in enumerate(zip(changes, self.slices, strict=True)):
            self.twists[i] = self.twists[i] + share * change
            if i in self._clamped:
                continue
            first = share * nodes[own.start]
            if max(map(abs, first.tolist())) > 1e-15:
                self.roots[i] = self.roots[i] @ exp_matrix(first, coefficients(first[3:]))
        if reduction.count > six:
            rest = share * step[six : reduction.count]
            n2 = len(reduction.other_coordinates)
            self._coordinates[reduction.other_coordinates] += rest[:n2]
            self.multipliers[reduction.other_multipliers] += rest[n2:]
            self._multipliers_written = False
        self.rebuild()
        return share, turn

    def write(self) -> None:
        """Bring Exudyn's scene to this configuration."""
        data = self.mbs.systemData
        data.SetODE2Coordinates(self._coordinates)
        if not self._multipliers_written:
            self.write_multipliers()

    def write_multipliers(self) -> None:
        """Bring the algebraic unknowns of Exudyn's scene to these."""
        if self.multipliers.size:
            self.mbs.systemData.SetAECoordinates(self.multipliers)
        self._multipliers_written = True

    def keep(self) -> None:
        """Make this the initial configuration of Exudyn's scene too."""
        data = self.mbs.systemData
        data.SetODE2Coordinates(self._coordinates, exu.ConfigurationType.Initial)
        if self.multipliers.size:
            data.SetAECoordinates(self.multipliers, exu.ConfigurationType.Initial)

    def place(self) -> Place:
        """Where the scene is now, to go back to."""
        return Place(self._coordinates.copy(), self.multipliers.copy(), list(self.twists), list(self.roots))

    def fits(self, place: Place) -> bool:
        """Whether a configuration is one of a scene like this, with the same mesh."""
        return [len(t) for t in place.twists] == [len(t) for t in self.twists] and len(
            place.coordinates
        ) == len(self._coordinates)

    def go(self, place: Place) -> None:
        """Go to a configuration."""
        self._coordinates = place.coordinates.copy()
        self.multipliers = place.multipliers.copy()
        self._multipliers_written = False
        self.twists, self.roots = list(place.twists), list(place.roots)
        self.rebuild()

    def turn_since(self, place: Place) -> float:
        """Largest rotation of any beam node since a configuration [rad]."""
        then = self._beams(place.coordinates)[:, 3:] + self._reference[:, 3:]
        cosine = np.abs((self._parameters * then) @ _ONES4).min()
        return 2.0 * acos(min(float(cosine), 1.0))

"""Layout of the unknowns of a scene: which there are, their order, their scales, and the limits of bays."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import exudyn as exu
import numpy as np
from numpy.typing import NDArray

from tdcr_fe.elements import Array, Flags, Index
from tdcr_fe.elements.forces import TendonForces
from tdcr_fe.elements.native.actuation import TendonActuation
from tdcr_fe.scene.loads import PointLoad
from tdcr_fe.scene.mesh import of_backbone
from tdcr_fe.solve.equations.band import BandLayout
from tdcr_fe.solve.equations.configuration import BodyFrameReduction, ConfigurationSpace


def buckling_shortening(robot: TendonActuation) -> Array:
    """By how much every element is shortened where its bay buckles [m], shape (E,).

    The load is ``pi^2 EI / a^2`` with the smallest bending stiffness EI of the bay and its length a, twice that of a
    last bay without a disk at its end, as in `tdcr_fe.solve.mesh.bay_loads`. Infinite where tendons follow the
    backbone, which do not compress bays.

    Parameters
    ----------
    robot
        Assembled in a scene.
    """
    mesh = robot.mesh
    section = robot.model.section
    if section is not None and section.tendons is not None:
        return np.full(len(mesh.lengths), np.inf)
    ends = robot.model.hole_nodes[1:]
    bays = np.searchsorted(ends, np.arange(len(mesh.lengths)), side="right")
    free = np.bincount(bays, mesh.lengths)
    if ends[-1] < len(mesh.lengths):
        free[-1] *= 2.0
    # An element that stands for the stiffness of the base is no part of a bay.
    bending = np.where(of_backbone(mesh), mesh.stiffness[:, 4:].min(axis=1), np.inf)
    softest = np.full(len(free), np.inf)
    np.minimum.at(softest, bays, bending)
    return np.asarray(mesh.lengths * np.pi**2 * (softest / free**2)[bays] / mesh.stiffness[:, 0])


@dataclass(frozen=True)
class ResidualScales:
    """Scales of the residuals."""

    # Factor of every residual: one of forces, one over a lever (a fiftieth of the length) of moments, one over the
    # length of gaps in joints
    weights: Array
    nodes: int  # Number of beam nodes
    forces: int  # Number of unknowns whose residual is a force or moment; gaps follow
    length: float  # Length of the longest backbone [m]
    # EI / L^2 of the softest robot, the smallest scale of forces [N]; a base that gives way is no part of it
    elastic_force: float

    @classmethod
    def of(cls, robots: Sequence[TendonActuation], reduction: BodyFrameReduction) -> ResidualScales:
        """Scales of a scene."""
        length = max(float(r.mesh.arc_lengths[-1]) for r in robots)
        nodes = np.tile(np.repeat((1.0, 50.0 / length), 3), reduction.nodes)
        other = np.ones(len(reduction.other_coordinates))
        gaps = np.full(len(reduction.other_multipliers), 1.0 / length)
        meshes = [(r.mesh.stiffness[of_backbone(r.mesh), 5], r.mesh.arc_lengths[-1]) for r in robots]
        elastic = min(float(bending.min()) / float(own) ** 2 for bending, own in meshes)
        weights = np.concatenate((nodes, other, gaps))
        return cls(weights, reduction.nodes, len(nodes) + len(other), length, elastic)

    def relative_residual(self, unbalanced: Array, base_tension: Sequence[Array], load_size: float) -> float:
        """Largest unbalanced force, moment or gap over its scale [1].

        Parameters
        ----------
        unbalanced
            Reduced residual.
        base_tension
            By robot [N].
        load_size
            Size of the applied loads [N].
        """
        size = np.abs(unbalanced * self.weights)
        largest = max([max(t.tolist(), default=0.0) for t in base_tension])
        scale = largest + self.elastic_force + load_size
        gap = float(size[self.forces :].max(initial=0.0))
        return max(float(size[: self.forces].max()) / scale, gap)

    def displacement_error(self, forces: TendonForces, displacement: Array, which: Index) -> float:
        """Largest deviation from prescribed tendon displacements over the length [1].

        Taut: the displacement is met. Slack: the base has let out more than the tendon needs.

        Parameters
        ----------
        forces
            Forces of the tendons of the robot.
        displacement
            Displacement of every tendon [m], shape (m,).
        which
            The tendons whose displacement is prescribed.
        """
        gap = (forces.field.base_slip - displacement)[which]
        error = np.where(forces.base_tension[which] > 0.0, np.abs(gap), np.maximum(-gap, 0.0))
        return float(np.max(error)) / self.length

    def step_size(self, step: Array) -> float:
        """Largest displacement over the length, or rotation, of any node in a step [1]."""
        largest = np.abs(step[: 6 * self.nodes].reshape(-1, 6)).max(axis=0).tolist()
        return max(max(largest[:3]) / self.length, *largest[3:])


class RobotUnknowns(NamedTuple):
    """Positions of one robot's unknowns."""

    robot: int  # Number of the robot
    nodes: slice  # Body-frame increments of its nodes
    # Numbers of its tendons whose length wound is prescribed (displacement or motor angle), so that their tension at
    # the base is unknown; `Numbering.at_driven` and its like pick these
    driven: Index
    tensions: slice  # Tensions at the base of these tendons
    frictional: Flags  # (m, g): Which of its mobilisations are unknowns
    mobilisations: slice  # Mobilisations that are unknowns
    clamped: bool  # Whether its base is clamped to ground


class Numbering(NamedTuple):
    """Order of all unknowns of a scene."""

    robots: tuple[RobotUnknowns, ...]
    reduced: int  # Unknowns of the reduced scene
    linear: int  # Unknowns that equilibrium is linear in at fixed friction: the former and the tensions
    total: int  # All, mobilisations included
    clamped: Index  # (c, 6): Unknowns of the clamped bases

    @classmethod
    def of(cls, layout: SceneLayout, winds: Sequence[Flags], with_friction: bool) -> Numbering:
        """Number the unknowns of a scene.

        Parameters
        ----------
        layout
            Layout of the scene.
        winds
            By robot, whose displacement is prescribed, shape (m,).
        with_friction
            Whether mobilisations are among them.
        """
        robots, nodes, reduced = layout.space.robots, layout.space.slices, layout.reduction.count
        driven = [np.flatnonzero(own) for own in winds]
        linear = reduced + sum(d.size for d in driven)
        parts, tension, hole = [], reduced, linear
        for i, (robot, own) in enumerate(zip(robots, nodes, strict=True)):
            frictional = robot.law.frictional & with_friction
            tensions = slice(tension, tension + driven[i].size)
            holes = slice(hole, hole + int(np.count_nonzero(frictional)))
            inside = slice(6 * own.start, 6 * own.stop)
            unknowns = RobotUnknowns(i, inside, driven[i], tensions, frictional, holes, i in layout.clamps)
            parts.append(unknowns)
            tension, hole = tensions.stop, holes.stop
        bases = np.array([part.nodes.start for part in parts if part.clamped], dtype=int)
        return cls(tuple(parts), reduced, linear, hole, bases[:, None] + np.arange(6))

    @property
    def has_friction(self) -> bool:
        """Whether friction acts anywhere."""
        return self.total > self.linear

    def at_frictional_holes(self, by_robot: Sequence[NDArray[Any]]) -> NDArray[Any]:
        """Values at the holes whose mobilisations are unknowns, of all robots one after the other, shape (k,).

        Parameters
        ----------
        by_robot
            At all holes, shape (m, g).
        """
        return _picked(by_robot, [part.frictional for part in self.robots])

    def with_frictional_holes(
        self, by_robot: Sequence[NDArray[Any]], values: NDArray[Any]
    ) -> tuple[NDArray[Any], ...]:
        """The inverse of `at_frictional_holes`: values at all holes with those at the frictional ones replaced.

        Parameters
        ----------
        by_robot
            At all holes, shape (m, g); unchanged.
        values
            At the frictional ones, of all robots one after the other, shape (k,).
        """
        return _replaced(by_robot, [part.frictional for part in self.robots], values)

    def at_driven(self, by_robot: Sequence[Array]) -> Array:
        """Values (m,) of the tendons with prescribed displacement, of all robots one after the other."""
        return _picked(by_robot, [part.driven for part in self.robots])

    def with_driven(self, by_robot: Sequence[Array], values: Array) -> tuple[Array, ...]:
        """The inverse of `at_driven`: values of all tendons with those of the driven ones replaced."""
        return _replaced(by_robot, [part.driven for part in self.robots], values)

    @property
    def any_driven(self) -> bool:
        """Whether the displacement of any tendon is prescribed."""
        return self.linear > self.reduced

    def same_unknowns(self, other: Numbering) -> bool:
        """Whether another numbering has the same unknowns in the same order."""
        return (self.reduced, self.linear, self.total) == (other.reduced, other.linear, other.total) and all(
            np.array_equal(a.driven, b.driven) for a, b in zip(self.robots, other.robots, strict=True)
        )


def _picked(by_robot: Sequence[NDArray[Any]], which: Sequence[NDArray[Any]]) -> NDArray[Any]:
    """Some values of every robot, of all robots one after the other."""
    parts = [own[places] for own, places in zip(by_robot, which, strict=True)]
    return parts[0] if len(parts) == 1 else np.concatenate(parts)


def _replaced(
    by_robot: Sequence[NDArray[Any]], which: Sequence[NDArray[Any]], values: NDArray[Any]
) -> tuple[NDArray[Any], ...]:
    """The inverse of `_picked`: values of every robot with some replaced; those given are unchanged."""
    found, first = tuple([own.copy() for own in by_robot]), 0
    for new, places in zip(found, which, strict=True):
        last = first + len(new[places])
        new[places], first = values[first:last], last
    return found


@dataclass(frozen=True, eq=False)
class SceneLayout:
    """Map from the unknowns of Exudyn's scene to those of the solver."""

    # By robot whose base is clamped to ground, the numbers of the joint's multipliers
    clamps: dict[int, Index]
    reduction: BodyFrameReduction
    space: ConfigurationSpace
    scales: ResidualScales
    # (L, 6): Components of the concentrated loads on robots that change with the pose of their node; and whether any
    # other load does
    turning: Flags
    others_turn: bool
    user_loads: bool  # Whether functions of the user may change loads while a load step is solved
    no_others: bool  # Whether no objects but the robots resist motion
    # By robot, order of the unknowns of a banded tangent, where only robots resist and it is faster than a full one
    bands: tuple[BandLayout | None, ...]
    # (E,): By robot, shortening of every element at which its bay buckles [m]
    buckling: tuple[Array, ...]

    @classmethod
    def of(
        cls, robots: Sequence[TendonActuation], point_loads: Sequence[PointLoad], with_clamps: bool
    ) -> SceneLayout:
        """Layout of an assembled scene; ``with_clamps=False`` treats the joints of clamped bases as any other."""
        mbs = robots[0].mbs
        data = mbs.systemData
        for robot in robots:
            robot.forget_coordinates()
            robot.disconnect()
        norms = [i for robot in robots for node in robot.nodes for i in data.GetNodeLTGAE(node)]
        clamps = _clamps(mbs, robots) if with_clamps else {}
        joints = [i for joint in clamps.values() for i in joint]
        dropped = data.ODE2Size() + np.array([*norms, *joints], dtype=int)
        coordinates = np.concatenate([r.coordinates for r in robots])
        reduction = BodyFrameReduction(mbs, coordinates, dropped)
        space = ConfigurationSpace(mbs, robots, reduction, clamps)
        loads = [mbs.GetLoad(i) for i in range(data.NumberOfLoads())]
        # Forces fixed in the world have no derivative at a node; all other loads may have one.
        turning = {i for i, load in enumerate(loads) if _turns(mbs, load)}
        numbers = [item.numbers for item in point_loads]
        no_others = not len(reduction.other) and _nothing_but_robots(mbs, robots)
        return cls(
            clamps,
            reduction,
            space,
            ResidualScales.of(robots, reduction),
            np.repeat(np.isin(np.reshape(numbers, (-1, 2)), list(turning)), 3, axis=1),
            not turning.issubset(n for pair in numbers for n in pair),
            any(load.get("loadVectorUserFunction") or load.get("loadUserFunction") for load in loads),
            no_others,
            tuple([BandLayout.of(robot) if no_others else None for robot in robots]),
            tuple(buckling_shortening(robot) for robot in robots),
        )

    def only_robots_resist(self, loads: Sequence[Array]) -> bool:
        """Whether only robots resist motion: no other objects do, and no load turns with a body.

        ``loads``: force and moment of every concentrated load, shape (6,) each.
        """
        if not self.no_others or self.others_turn:
            return False
        # A moment of zero does not turn.
        return not self.turning.any() or not np.array(loads)[self.turning].any()

    def alone(self, i: int) -> SceneLayout:
        """The layout of one robot that nothing couples with the others and no load turns with; the rest stays."""
        mbs, robots, joint = self.space.mbs, [self.space.robots[i]], self.clamps[i]
        reduction = BodyFrameReduction(mbs, robots[0].coordinates, np.arange(self.reduction.size))
        return replace(
            self,
            clamps={0: joint},
            reduction=reduction,
            space=ConfigurationSpace(mbs, robots, reduction, {0}, joint),
            scales=ResidualScales.of(robots, reduction),
            turning=np.zeros((0, 6), dtype=bool),
            bands=(self.bands[i],),
            buckling=(self.buckling[i],),
        )


def _clamps(mbs: exu.MainSystem, robots: Sequence[TendonActuation]) -> dict[int, Index]:
    """By robot whose base is clamped to ground, the numbers of the joint's multipliers."""
    found = {}
    for i, robot in enumerate(robots):
        if robot.clamp is None:
            continue
        joint = mbs.GetObject(robot.clamp.joint)
        if joint["activeConnector"] and all(joint["constrainedAxes"]) and not joint["offsetUserFunction"]:
            found[i] = np.array(mbs.systemData.GetObjectLTGAE(robot.clamp.joint), dtype=int)
    return found


def _nothing_but_robots(mbs: exu.MainSystem, robots: Sequence[TendonActuation]) -> bool:
    """Whether no other object has coordinates, and the beams have the stiffness of the robots' meshes."""
    data = mbs.systemData
    own = {i for robot in robots for i in robot.connectors.object_numbers}
    if any(len(data.GetObjectLTGODE2(i)) for i in range(data.NumberOfObjects()) if i not in own):
        return False
    for robot in robots:
        for beam, expected in zip(robot.connectors.beams, robot.mesh.stiffness, strict=True):
            present = mbs.GetObjectParameter(beam, "sectionData").stiffnessMatrix
            if not np.array_equal(present, np.diag(expected)):
                return False
    return True


def _turns(mbs: exu.MainSystem, load: dict[str, Any]) -> bool:
    """Whether a load of Exudyn changes with the configuration of the node or body it acts on."""
    marker = mbs.GetMarker(load["markerNumber"])
    kind, body = "", {}
    if "bodyNumber" in marker:
        body = mbs.GetObject(marker["bodyNumber"])
        kind = body["objectType"]
    if load["loadType"] == "MassProportional":
        return kind.startswith("FFRF") or bool(np.any(body.get("centerOfMass", 0.0)))
    if load["loadType"] != "ForceVector" or load["bodyFixed"]:
        return True
    if not (marker["markerType"].startswith("Node") or kind.startswith(("RigidBody", "MassPoint", "Ground"))):
        return True
    return any((*marker.get("localPosition", ()), *marker.get("localHT", np.eye(4))[:3, 3]))

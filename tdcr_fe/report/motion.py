"""A robot over its load steps as plain arrays: all that pictures, 3D panel, videos and exported geometry draw.

`geometry` gives what a drawing needs of the robot; ``summary.json`` contains it, so that a folder of results can be
drawn without the input files.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation, Slerp

from tdcr_fe.elements import Array, Flags, Index
from tdcr_fe.model.columns import quaternions
from tdcr_fe.model.loading import Load
from tdcr_fe.model.results import SequenceResult, interpolate_positions
from tdcr_fe.model.robot import Robot, Tendon

#: Millimetres in a metre.
MM = 1e3
#: Points per bay of a tendon that follows the backbone, and least of a whole one: without disks there is one bay.
POINTS_PER_BAY, LEAST_POINTS = 6, 36
#: An arc length is that of a node where they differ by less than this part of the backbone [1].
SAME_NODE = 1e-7
#: Points of a backbone drawn as a line, and of the rim of a disk.
CURVE_POINTS, RIM_POINTS = 120, 25
_ARRAYS_BY_STEP = ("positions", "rotations", "base_tensions", "displacements", "driven_by_displacement")
#: Radius of the base plate as it is drawn, over that of a disk [1].
PLATE = 1.6


@dataclass(frozen=True)
class TendonPath:
    """Polygon that a tendon is drawn as."""

    name: str
    #: Indices into `Motion.s`: the sections that the corners belong to, base plate first, anchor last, shape (k,).
    frames: Index
    points: Array  # corners in their section frames [m], shape (k, 3)
    segments: Index  # the tendon segment that each side belongs to, from 0, shape (k - 1,)


@dataclass(frozen=True)
class Markers:
    """Measured positions, in the robot's frame.

    Attributes
    ----------
    s : ndarray, shape (m,)
        Arc lengths [m].
    measured : ndarray, shape (n_steps, m, 3)
        [m]; NaN where nothing was measured.
    declared : ndarray, shape (n_steps, k, 3)
        Backbone that the declared model predicts [m]; empty where there is none.
    """

    s: Array
    measured: Array
    declared: Array


@dataclass(frozen=True)
class Motion:
    """A robot over its load steps.

    Attributes
    ----------
    name : str
    length, disk_radius, disk_thickness : float
        [m].
    steps : tuple of int
        Numbers of the load steps.
    labels : tuple of str
    s : ndarray, shape (n,)
        Arc lengths of the sections: all nodes, and disks and holes that lie between nodes [m].
    radius : ndarray, shape (n,)
        Radius of the backbone [m].
    positions : ndarray, shape (n_steps, n, 3)
        [m].
    rotations : ndarray, shape (n_steps, n, 4)
        Unit quaternions qw, qx, qy, qz of the sections.
    disks : ndarray of int
        Sections of the disks.
    tendons : tuple of TendonPath
    tensions : tuple of ndarray, each of shape (n_steps, n_segments)
        [N].
    hole_states : tuple of ndarray of str, each of shape (n_steps, n_segments)
        State of the hole at the far end of every segment.
    base_tensions, displacements : ndarray, shape (n_steps, n_tendons)
        [N, m].
    driven_by_displacement : ndarray of bool, shape (n_steps, n_tendons)
    loads : tuple of mapping of str to Load
        By step.
    gravity : ndarray, shape (3,)
        [m/s^2].
    friction : bool
        Whether the states of holes mean anything.
    markers : Markers or None
    ellipsoids : tuple of mapping of str to ndarray, shape (3, 3)
        By step and estimated load, semi-axes (rows) of the ellipsoid in which its force lies with 95 % probability [N];
        empty where all loads are known.
    """

    name: str
    length: float
    disk_radius: float
    disk_thickness: float
    steps: tuple[int, ...]
    labels: tuple[str, ...]
    s: Array
    radius: Array
    positions: Array
    rotations: Array
    disks: Index
    tendons: tuple[TendonPath, ...]
    tensions: tuple[Array, ...]
    hole_states: tuple[NDArray[np.str_], ...]
    base_tensions: Array
    displacements: Array
    driven_by_displacement: Flags
    loads: tuple[Mapping[str, Load], ...]
    gravity: Array
    friction: bool
    markers: Markers | None = None
    ellipsoids: tuple[Mapping[str, Array], ...] = ()

    @property
    def tips(self) -> Array:
        """Tip positions [m], shape (n_steps, 3)."""
        return np.asarray(self.positions[:, -1])

    @property
    def bending_angles(self) -> Array:
        """Angle between tip tangent and +z, by step [rad], shape (n_steps,)."""
        w, x, y, z = self.rotations[:, -1].T
        across = np.hypot(2.0 * (x * z + w * y), 2.0 * (y * z - w * x))
        return np.asarray(np.arctan2(across, 1.0 - 2.0 * (x * x + y * y)))

    @property
    def largest_tension(self) -> float:
        """Largest tension of all tendons, segments and steps [N]."""
        return max((float(np.max(t, initial=0.0)) for t in self.tensions), default=0.0)

    @property
    def plate(self) -> Array:
        """Rim of the base plate [m], shape (RIM_POINTS, 3)."""
        angle = np.linspace(0.0, 2.0 * np.pi, RIM_POINTS)
        return PLATE * self.disk_radius * np.stack((np.cos(angle), np.sin(angle), 0.0 * angle), axis=-1)

    def rims(self, step: int) -> Array:
        """Rims of the disks in a step (from 0) [m], shape (n_disks, RIM_POINTS, 3)."""
        turned = np.einsum("nij,pj->npi", self.matrices(step)[self.disks], self.plate / PLATE)
        return np.asarray(self.positions[step, self.disks, None] + turned)

    def curve(self, step: int) -> Array:
        """The backbone in a step (from 0) as a smooth line [m], shape (CURVE_POINTS, 3)."""
        s = np.linspace(self.s[0], self.s[-1], CURVE_POINTS)
        return interpolate_positions(self.s, self.positions[step], self.matrices(step), s)

    def inputs(self) -> Iterator[tuple[str, Array, str]]:
        """What drives each tendon: its name, displacements [mm] or tensions [N] by step, and a label for an axis."""
        for j, tendon in enumerate(self.tendons):
            kind, unit, values = "tension", "N", self.base_tensions[:, j]
            if self.driven_by_displacement[:, j].any():
                kind, unit, values = "displacement", "mm", MM * self.displacements[:, j]
            yield tendon.name, values, f"{kind} of {tendon.name} at the base [{unit}]"

    def label(self, step: int) -> str:
        """Label of a step (from 0); empty where it is only the number."""
        number, label = self.steps[step], self.labels[step]
        return "" if label in (str(number), f"step {number}") else label

    def distinct_steps(self, count: int) -> list[int]:
        """Steps (from 0) whose tips lie apart from each other: the most bent, the last, then always the farthest."""
        tips = self.tips
        chosen = [int(np.argmax(self.bending_angles)), len(tips) - 1]
        gap = np.min(np.linalg.norm(tips[:, None] - tips[chosen], axis=2), axis=1)
        while len(chosen) < min(count, len(tips)):
            chosen.append(int(np.argmax(gap)))
            gap = np.minimum(gap, np.linalg.norm(tips - tips[chosen[-1]], axis=1))
        return sorted(set(chosen))

    def at_steps(self, kept: Sequence[int]) -> Motion:
        """The motion with some of its steps (from 0) alone."""
        found: dict[str, Any] = {name: getattr(self, name)[kept] for name in _ARRAYS_BY_STEP}
        for name in ("steps", "labels", "loads", "ellipsoids"):
            values = getattr(self, name)
            found[name] = tuple(values[k] for k in kept) if values else ()
        for name in ("tensions", "hole_states"):
            found[name] = tuple(of_tendon[kept] for of_tendon in getattr(self, name))
        if self.markers is not None:
            measured, declared = self.markers.measured[kept], self.markers.declared[kept]
            found["markers"] = replace(self.markers, measured=measured, declared=declared)
        return replace(self, **found)

    @property
    def drawn_markers(self) -> Array:
        """Measured markers [m], on the robot along axes on which a step does not read them, shape (n_steps, m, 3)."""
        if self.markers is None:
            return np.zeros((len(self.steps), 0, 3))
        there, measured = self.positions[:, nearest(self.s, self.markers.s)], self.markers.measured
        unseen = np.isnan(measured) & ~np.isnan(measured).all(axis=-1, keepdims=True)
        return np.where(unseen, there, measured)

    def matrices(self, step: int) -> Array:
        """World rotations of all sections in a step (from 0), shape (n, 3, 3)."""
        return Rotation.from_quat(np.roll(self.rotations[step], -1, axis=1)).as_matrix()

    def tendon_points(self, step: int, tendon: TendonPath) -> Array:
        """Corners of a tendon in a step (from 0) [m], shape (k, 3)."""
        turned = np.einsum("nij,nj->ni", self.matrices(step)[tendon.frames], tendon.points)
        return np.asarray(self.positions[step, tendon.frames] + turned)

    def load_arrows(self, step: int) -> list[tuple[str, Array, Array, bool]]:
        """Loads of a step (from 0): name, where [m], vector [N or N m], and whether it is a moment."""
        arrows = []
        for name, load in self.loads[step].items():
            k = int(nearest(self.s, [load.at])[0])
            for value, moment in ((np.array(load.force), False), (np.array(load.moment), True)):
                if np.any(value):
                    vector = self.matrices(step)[k] @ value if load.frame == "section" else value
                    arrows.append((name, self.positions[step, k], vector, moment))
        return arrows

    def largest_loads(self, steps: Iterable[int]) -> dict[bool, float]:
        """Largest force [N] and moment [N m] in some steps (from 0), by whether it is a moment; zero without any."""
        largest = {False: 0.0, True: 0.0}
        for _, _, vector, moment in [arrow for k in steps for arrow in self.load_arrows(k)]:
            largest[moment] = max(largest[moment], float(np.linalg.norm(vector)))
        return largest


def spread(count: int, at_most: int) -> list[int]:
    """Indices spread evenly over ``count`` steps, first and last among them."""
    return sorted({int(k) for k in np.linspace(0, count - 1, min(count, at_most)).round()})


# ------------------------------------------------------------------------------------- what a drawing needs


def _tendon_geometry(robot: Robot, tendon: Tendon, continuous: bool) -> dict[str, Any]:
    """Corners of a tendon as rows of arc length and section coordinates, and the segment of every side."""
    s = robot.hole_arc_lengths(tendon)
    segments, points = np.arange(1, len(s)), robot.hole_points(tendon)
    if continuous:
        count = max(POINTS_PER_BAY, LEAST_POINTS // len(segments))
        share = np.arange(count) / count
        s = np.append((s[:-1, None] + share * np.diff(s)[:, None]).ravel(), s[-1])
        points = np.column_stack((tendon.routing.position(s, robot.end(tendon)), np.zeros_like(s)))
        segments = np.repeat(segments, count)
    return {"name": tendon.name, "path": np.column_stack((s, points)).tolist(), "segments": segments.tolist()}


def geometry(result: SequenceResult) -> dict[str, Any]:
    """Geometry of the robot for drawings, as ``summary.json`` has it.

    Returns
    -------
    dict
        ``length`` [m]; ``backbone_radius``: pairs of arc length and radius [m]; ``disks``: arc lengths ``s``,
        ``radius`` and ``thickness`` [m]; ``tendons``: ``name``, corners ``path`` as rows of arc length and section
        coordinates x, y, z [m], and ``segments``, the number of the tendon segment of every side.
    """
    robot, backbone = result.robot, result.robot.backbone
    continuous = result.model.tendon_path == "continuous"
    radii = backbone.taper or ((0.0, backbone.radius), (backbone.length, backbone.radius))
    return {
        "length": backbone.length,
        "backbone_radius": [list(pair) for pair in radii],
        "disks": {
            "s": list(robot.disks.positions),
            "radius": robot.plate_radius,
            "thickness": robot.disks.thickness,
        },
        "tendons": [_tendon_geometry(robot, tendon, continuous) for tendon in robot.tendons],
    }


# ------------------------------------------------------------------------------------------------ assembling


def nearest(s: Array, wanted: Sequence[float] | Array) -> Index:
    """Indices of the nearest of the ascending numbers ``s`` to each wanted one, of two the one before it."""
    return np.ceil(np.interp(wanted, s, np.arange(len(s))) - 0.5).astype(np.intp)


@dataclass(frozen=True)
class Nodes:
    """Poses of the backbone nodes."""

    s: Array  # arc lengths [m], shape (n,)
    positions: Array  # [m], shape (n_steps, n, 3)
    rotations: Array  # unit quaternions qw, qx, qy, qz, shape (n_steps, n, 4)

    def with_sections(self, further: Array) -> Nodes:
        """The same with sections at further arc lengths.

        Between nodes, poses are those of constant strain, as in the beam element.
        """
        near = SAME_NODE * (self.s[-1] - self.s[0])
        new = np.unique(np.clip(further, self.s[0], self.s[-1]))
        new = new[np.abs(new - self.s[nearest(self.s, new)]) > near]
        new = new[np.diff(new, prepend=-np.inf) > near]
        if not len(new):
            return self
        s = np.concatenate((self.s, new))
        order = np.argsort(s, kind="stable")
        positions, rotations = [], []
        for p, q in zip(self.positions, self.rotations, strict=True):
            turn = Rotation.from_quat(np.roll(q, -1, axis=1))
            between = interpolate_positions(self.s, p, turn.as_matrix(), new)
            turned = quaternions(Slerp(self.s, turn)(new).as_matrix())
            positions.append(np.concatenate((p, between))[order])
            rotations.append(np.concatenate((q, turned))[order])
        return Nodes(s[order], np.array(positions), np.array(rotations))


def assemble(shape: Mapping[str, Any], nodes: Nodes, **rest: Any) -> Motion:
    """A motion from the geometry of `geometry`, the poses of the nodes, and the other fields of `Motion`."""
    disks = [float(x) for x in shape["disks"]["s"]]
    paths = [np.array(t["path"], dtype=float).reshape(-1, 4) for t in shape["tendons"]]
    loaded = [load.at for loads in rest["loads"] for load in loads.values()]
    sections = nodes.with_sections(np.concatenate([np.array([*disks, *loaded]), *(p[:, 0] for p in paths)]))
    radii = np.array(shape["backbone_radius"], dtype=float)
    return Motion(
        length=float(shape["length"]),
        disk_radius=float(shape["disks"]["radius"]),
        disk_thickness=float(shape["disks"]["thickness"]),
        s=sections.s,
        radius=np.interp(sections.s, radii[:, 0], radii[:, 1]),
        positions=sections.positions,
        rotations=sections.rotations,
        disks=nearest(sections.s, disks),
        tendons=tuple(
            TendonPath(
                t["name"], nearest(sections.s, p[:, 0]), p[:, 1:], np.array(t["segments"], dtype=np.intp) - 1
            )
            for t, p in zip(shape["tendons"], paths, strict=True)
        ),
        **rest,
    )


def motion_of(result: SequenceResult, markers: Markers | None = None) -> Motion:
    """The motion of a simulated robot.

    Parameters
    ----------
    result
        With at least one step.
    markers
        Measured positions of the same steps.

    Raises
    ------
    ValueError
        No step was solved.
    """
    steps = result.steps
    if not steps:
        raise ValueError("no step was solved, so there is nothing to draw")
    turns = np.array([quaternions(s.rotations) for s in steps])
    nodes = Nodes(steps[0].s, np.array([s.positions for s in steps]), turns)
    m = len(result.robot.tendons)
    inputs = [s.actuation for s in steps]
    driven = [np.zeros(m, dtype=bool) if a is None else a.by_displacement for a in inputs]
    return assemble(
        geometry(result),
        nodes,
        name=result.robot.name,
        steps=tuple(s.step for s in steps),
        labels=tuple(s.label for s in steps),
        tensions=tuple(np.array([s.tensions[j] for s in steps]) for j in range(m)),
        hole_states=tuple(np.array([s.hole_states[j] for s in steps]) for j in range(m)),
        base_tensions=np.array([s.base_tensions for s in steps]).reshape(len(steps), m),
        displacements=np.array([s.displacements for s in steps]).reshape(len(steps), m),
        driven_by_displacement=np.array(driven, dtype=bool).reshape(len(steps), m),
        loads=tuple({} if a is None else a.loads for a in inputs),
        gravity=np.array(result.model.gravity, dtype=float),
        friction=result.model.friction != "none",
        markers=markers,
    )


def between(motion: Motion, time: float) -> Motion:
    """The motion at one time as a motion of one step.

    Positions and tensions are linear in time, rotations follow the shorter arc; loads, labels and states of holes
    are those of the nearest step.

    Parameters
    ----------
    motion
        What is interpolated.
    time
        In load steps, from 0.
    """
    k = int(np.clip(np.floor(time), 0, len(motion.steps) - 1))
    after, step = min(k + 1, len(motion.steps) - 1), round(time)
    share = time - k

    def mix(values: Array) -> Array:
        return np.asarray((1.0 - share) * values[k : k + 1] + share * values[after : after + 1])

    near, first, second = motion.at_steps([step]), motion.rotations[k], motion.rotations[after]
    sign = np.where(np.sum(first * second, axis=1, keepdims=True) < 0.0, -1.0, 1.0)
    turned = (1.0 - share) * first + share * sign * second
    return replace(
        near,
        positions=mix(motion.positions),
        rotations=(turned / np.linalg.norm(turned, axis=1, keepdims=True))[None],
        tensions=tuple(mix(t) for t in motion.tensions),
        base_tensions=mix(motion.base_tensions),
        displacements=mix(motion.displacements),
        markers=None,
    )

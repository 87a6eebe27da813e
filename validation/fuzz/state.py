"""Forces in a solved state, from its positions, rotations and tensions alone; shares no code with the solver.

The section law and the course of the tendons are those of the reference. Between two nodes the strain is constant, as
the documentation says of the elements ("Theory"): their relative pose is the exponential of length times strain. The
wrench that the material answers with acts on both nodes; it follows from virtual work.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from tdcr_fe.elements import Array, Index
from tdcr_fe.model.friction import ConstantFriction, StribeckFriction
from tdcr_fe.model.loading import Model
from tdcr_fe.model.results import StepResult
from tdcr_fe.model.robot import Robot, Tendon
from tdcr_fe.validation.reference.closed_forms import constant_strain
from tdcr_fe.validation.reference.layout import Layout
from tdcr_fe.validation.reference.rod import ad, tendon_course
from tdcr_fe.validation.reference.section import Section
from tdcr_fe.validation.reference.tendons import Segments, Tendons, straight_segments

#: By what the inside of thick disks is stiffer: bending and torsion, shear and stretch.
RIGID = np.repeat([1e5, 1e2], 3)


def _left(twists: Array) -> Array:
    """Derivative of the exponential of twists ``[turn, shift]``: sum of ``(-ad)^k / (k + 1)!``, shape (n, 6, 6)."""
    step, power, total = -ad(twists), np.eye(6), np.zeros((*twists.shape, 6))
    for k in range(30):
        total += power / math.factorial(k + 1)
        power = power @ step
    return total


def relative_twists(positions: Array, rotations: Array) -> Array:
    """Twists ``[turn, shift]`` whose exponential leads from each node to the next, frame of the first, (n - 1, 6)."""
    first, second = rotations[:-1], rotations[1:]
    turn = Rotation.from_matrix(np.swapaxes(first, 1, 2) @ second).as_rotvec()
    moved = np.swapaxes(first, 1, 2) @ np.diff(positions, axis=0)[..., None]
    by_shift = _left(np.concatenate((-turn, np.zeros_like(turn)), axis=1))[:, :3, :3]
    return np.concatenate((turn, np.linalg.solve(by_shift, moved)[..., 0]), axis=1)


def unloaded_pose(rest: Array, lengths: Array) -> tuple[Array, Array]:
    """Positions and rotations of nodes between which the strain is ``rest``, (n, 6), clamped upright at the origin."""
    positions, rotations = np.zeros((len(rest) + 1, 3)), np.tile(np.eye(3), (len(rest) + 1, 1, 1))
    for k, (strain, length) in enumerate(zip(rest, lengths, strict=True)):
        turn, move = constant_strain(strain, float(length))
        positions[k + 1] = positions[k] + rotations[k] @ move
        rotations[k + 1] = rotations[k] @ turn
    return positions, rotations


def elements(robot: Robot, s: Array, time: float) -> Layout:
    """Section law and masses of elements between arc lengths ``s`` [m]; the backbone has crept for a time [s]."""
    backbone, h, middle = robot.backbone, np.diff(s), 0.5 * (s[1:] + s[:-1])
    rigid = np.any(np.abs(middle[:, None] - robot.disks.positions) < 0.5 * robot.disks.thickness, axis=1)
    section, area = Section.of(backbone, middle, rigid), np.ones_like(middle)
    stiffness, grown = section.stiffness, np.where(rigid, 1.0, backbone.compliance_factor(time))
    if backbone.taper:  # means over the element in place of the values in its middle
        bending, area = backbone.taper_factors(s)
        ratio = backbone.radius_at(middle) / backbone.radius
        stiffness = stiffness * np.repeat([bending / ratio**4, area / ratio**2], 3, axis=0).T
    stiffness = np.where(rigid[:, None], RIGID, 1.0) * stiffness
    if robot.base_stiffness is not None:
        stiffness[0, :2], rigid[0], grown[0] = robot.base_stiffness * h[0], True, 1.0
    stiffness[:, :3] /= grown[:, None]
    fibres = section.fibres
    if fibres is not None:
        fibres = replace(fibres, axial=stiffness[:, 5], bending=stiffness[:, 0])
    # The residual flexibility of bending is in the shear.
    flexible = 1.0 / (1.0 / stiffness[:, 3:5] + h[:, None] ** 2 / (12.0 * stiffness[:, :2]))
    stiffness = np.concatenate((stiffness[:, :3], flexible, stiffness[:, 5:]), axis=1)
    mass = np.zeros(len(s))
    mass[[int(np.abs(s - at).argmin()) for at in robot.disks.positions]] += robot.disks.mass
    mass[-1] += robot.tip_mass
    own = backbone.mass_per_length * area * backbone.material_factors(middle)[1]
    section = replace(section, stiffness=stiffness, rigid=rigid, fibres=fibres)
    return Layout(s, np.arange(len(s)), section, mass, own)


def _bounded(tendon: Tendon) -> Tendon:
    """With the largest friction that its law has, where the reference does not know the law."""
    law = tendon.friction
    if isinstance(law, StribeckFriction) and law.viscous == 0.0:
        return replace(tendon, friction=ConstantFriction(max(law.static, law.kinetic)))
    return tendon


@dataclass(frozen=True)
class State:
    """A solved state and what follows from it.

    Attributes
    ----------
    robot, model, step
        What was solved.
    layout : Layout
        Nodes, section law of the elements, and masses.
    twists : ndarray, shape (k, 6)
        From node to node, ``[turn, shift]`` [rad, m].
    gradient : ndarray, shape (k, 6)
        Of the elastic energy by the twists [N m, N].
    tendons : Tendons
        Of the reference; its lengths at rest are those of the unloaded robot.
    segments : Segments or None
        Straight tendons.
    lengths : ndarray, shape (n_segments,)
        Of all segments of all tendons [m].
    pulls : ndarray, shape (k, n_tendons, 6)
        Derivatives of the lengths of tendons that follow the backbone by the twists.
    tension : ndarray, shape (n_segments,)
        [N].
    """

    robot: Robot
    model: Model
    step: StepResult
    layout: Layout
    twists: Array
    gradient: Array
    tendons: Tendons
    segments: Segments | None
    lengths: Array
    pulls: Array
    tension: Array

    @classmethod
    def of(cls, robot: Robot, model: Model, step: StepResult) -> State:
        """What follows from a step."""
        time = 0.0 if step.actuation is None else step.actuation.time
        layout = elements(robot, step.s, time)
        known = replace(robot, tendons=tuple(map(_bounded, robot.tendons)))
        tendons = Tendons(known, model, layout, ())
        unloaded = unloaded_pose(layout.section.rest, layout.lengths)
        tendons.rest = _courses(known, tendons, step.s, *unloaded)[1]
        segments, lengths, pulls = _courses(known, tendons, step.s, step.positions, step.rotations)
        twists = relative_twists(step.positions, step.rotations)
        strain, section = twists / layout.lengths[:, None], layout.section
        linear = section.stiffness * (strain - section.rest)
        gradient = np.where(section.rigid[:, None], linear, section.wrench(strain)[0])
        counts = tendons.last - tendons.first
        tension = np.concatenate([*(t[:n] for t, n in zip(step.tensions, counts, strict=True)), np.zeros(0)])
        return cls(robot, model, step, layout, twists, gradient, tendons, segments, lengths, pulls, tension)

    @property
    def taken_in(self) -> Array:
        """Tendon that each segment has released since the unloaded robot [m], shape (n_segments,)."""
        return self.tendons.taken_in(self.lengths, self.tension)[0]

    @property
    def mass(self) -> Array:
        """Of the nodes: disks, tip, and half of each neighbouring element [kg]."""
        half = 0.5 * self.layout.mass_per_length * self.layout.lengths
        return self.layout.point_mass + np.append(half, 0.0) + np.append(0.0, half)

    def node(self, s: float) -> int:
        """The node at an arc length [m]."""
        return self.layout.station(s)


Courses = tuple[Segments | None, Array, Array]


def _courses(robot: Robot, tendons: Tendons, s: Array, positions: Array, rotations: Array) -> Courses:
    """Segments, their lengths [m], and the derivatives of those of tendons that follow the backbone by the twists."""
    h, count = np.diff(s), len(robot.tendons)
    if not tendons.continuous:
        segments = straight_segments(tendons, rotations, positions, np.zeros((len(s), 6, 0)))
        return segments, segments.lengths, np.zeros((len(h), count, 6))
    strain = relative_twists(positions, rotations) / h[:, None]
    inside = (0.5 * (s[1:] + s[:-1]))[:, None] < np.array([robot.end(t) for t in robot.tendons])
    lengths, pulls = np.zeros(count), np.zeros((len(h), count, 6))
    for x, weight in zip(*np.polynomial.legendre.leggauss(4), strict=True):
        course = tendon_course(robot, s[:-1] + 0.5 * (1.0 + x) * h)
        size, gradient = course.stretch(strain)
        share = 0.5 * weight * inside
        lengths += h @ (share * size)
        pulls += share[..., None] * gradient
    return None, lengths, pulls


# ------------------------------------------------------------------------------------------------------ balance


@dataclass(frozen=True)
class Balance:
    """What is left of forces and moments on every free body.

    Attributes
    ----------
    force, moment : ndarray, shape (n, 3)
        On each node, all of its forces; world axes, moments about the node [N, N m].
    force_scale, moment_scale : float
        Largest single contribution [N, N m].
    force_round_off, moment_round_off : float
        By the round-off of positions and rotations, in stiff parts [N, N m].
    """

    force: Array
    moment: Array
    force_scale: float
    moment_scale: float
    force_round_off: float
    moment_round_off: float


def _nodal(state: State, gradient: Array) -> tuple[Array, Array]:
    """Forces and moments on the nodes, world axes, each (n, 3), from the gradient of an energy by the twists.

    By virtual work: ``delta X = T (eta_b - Ad^{-1} eta_a)`` with the body-frame motions of both nodes.
    """
    positions, second = state.step.positions, state.step.rotations[1:]
    inverse = np.linalg.inv(_left(state.twists))
    at_second = -(np.swapaxes(inverse, 1, 2) @ gradient[..., None])
    moment_b, force_b = ((second @ at_second[:, part])[..., 0] for part in (slice(3), slice(3, 6)))
    force, moment = np.zeros_like(positions), np.zeros_like(positions)
    force[1:], moment[1:] = force_b, moment_b
    # What the element does to its first node is the opposite, moved there: an element without load is in balance.
    force[:-1] -= force_b
    moment[:-1] -= moment_b + np.cross(np.diff(positions, axis=0), force_b)
    return force, moment


def balance(state: State) -> Balance:
    """Forces and moments on every node: material, tendons, weight, loads and springs."""
    robot, step, layout = state.robot, state.step, state.layout
    p, frames, section = step.positions, step.rotations, layout.section
    force, moment = np.zeros_like(p), np.zeros_like(p)
    # Forces that cancel at a node are on no list; the wrench inside the rod sets the scale, too. An unloaded robot has
    # no forces; a thousandth of what bends it by a radian sets it then.
    bend = 1e-3 * robot.backbone.EI / robot.backbone.length
    inside = np.abs(state.gradient[~section.rigid])
    sizes = [bend / robot.backbone.length, float(inside[:, 3:].max(initial=0.0))]
    moments = [bend, float(inside[:, :3].max(initial=0.0))]
    sizes.append(float(state.tension.max(initial=0.0)))

    def add(nodes: Index, f: Array, m: Array) -> None:
        np.add.at(force, nodes, f)
        np.add.at(moment, nodes, m)
        sizes.append(float(np.abs(f).max(initial=0.0)))
        moments.append(float(np.abs(m).max(initial=0.0)))

    every = np.arange(len(p))
    add(every, *_nodal(state, state.gradient))
    if state.segments is None:
        for k, tension in enumerate(state.tension):
            add(every, *_nodal(state, tension * state.pulls[:, k]))
    else:
        pull = state.tension[:, None] * state.segments.directions
        sides = zip((state.tendons.tail, state.tendons.head), state.segments.ends, (1.0, -1.0), strict=True)
        for nodes, (holes, _), sign in sides:
            arm = (frames[nodes] @ holes[:, :, None])[..., 0]
            add(nodes, sign * pull, np.cross(arm, sign * pull))
    add(every, state.mass[:, None] * np.array(state.model.gravity), np.zeros_like(p))
    for load in step.actuation.loads.values() if step.actuation else ():
        node = np.array([state.node(load.at)])
        turn = frames[node[0]] if load.frame == "section" else np.eye(3)
        add(node, (turn @ load.force)[None], (turn @ load.moment)[None])
    rest = unloaded_pose(section.rest, layout.lengths)[0]
    for spring in robot.springs:
        node = np.array([state.node(spring.at)])
        pull = -spring.stiffness * (p[node] - rest[node]) * np.array([1.0, 1.0, 0.0])
        add(node, pull, np.zeros_like(pull))
    eps, h = 8.0 * float(np.finfo(float).eps), layout.lengths
    size = np.linalg.norm(p, axis=1).max()
    round_off = eps * float((section.stiffness[:, 3:].max(axis=1) * size / h).max())
    turn_off = eps * float((section.stiffness[:, :3].max(axis=1) / h).max()) + round_off * float(h.max())
    return Balance(force, moment, max(sizes), max(moments), round_off, turn_off)

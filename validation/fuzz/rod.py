"""Forces of a rod and its tendons, from positions and rotations alone; shares no code with the solver.

A state is given by nodes: arc lengths, positions, rotations of the sections. Between two nodes the strain is constant,
as the documentation says of the elements ("Theory"): their relative pose is the exponential of length times strain. The
wrench that the material answers with acts on both nodes; it follows from virtual work.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from tdcr_fe.model.backbone import Backbone
from tdcr_fe.model.loading import Model
from tdcr_fe.model.results import StepResult
from tdcr_fe.model.robot import Robot

Array = NDArray[np.float64]

#: By what the inside of thick disks is stiffer: shear and stretch, bending and torsion.
RIGID_TRANSLATION, RIGID_ROTATION = 1e2, 1e5

_GAUSS, _WEIGHTS = np.polynomial.legendre.leggauss(4)
_GAUSS, _WEIGHTS = 0.5 * (_GAUSS + 1.0), 0.5 * _WEIGHTS


def hat(v: Array) -> Array:
    """Matrix of the cross product, shapes (..., 3) to (..., 3, 3)."""
    x, y, z = np.moveaxis(v, -1, 0)
    o = np.zeros_like(x)
    rows = (np.stack((o, -z, y), axis=-1), np.stack((z, o, -x), axis=-1), np.stack((-y, x, o), axis=-1))
    return np.stack(rows, axis=-2)


def bracket(twist: Array) -> Array:
    """Matrix of the bracket of twists ``[v, w]``, shapes (..., 6) to (..., 6, 6)."""
    v, w = hat(twist[..., :3]), hat(twist[..., 3:])
    return np.concatenate(
        (np.concatenate((w, v), axis=-1), np.concatenate((np.zeros_like(w), w), axis=-1)), axis=-2
    )


def _series(twist: Array, alternate: bool) -> Array:
    """Sum of ``(+-1)^k ad^k / (k + 1)!``, shape (..., 6, 6)."""
    step, total = bracket(twist), np.zeros((*twist.shape[:-1], 6, 6))
    power = np.broadcast_to(np.eye(6), total.shape).copy()
    for k in range(30):
        total += power / math.factorial(k + 1) * (-1.0 if alternate and k % 2 else 1.0)
        power = power @ step
    return total


def relative_twists(positions: Array, rotations: Array) -> Array:
    """Twists ``[v, w]`` whose exponential leads from each node to the next, in the frame of the first, (n - 1, 6)."""
    first, second = rotations[:-1], rotations[1:]
    turn = Rotation.from_matrix(np.swapaxes(first, 1, 2) @ second).as_rotvec()
    moved = np.einsum("kji,kj->ki", first, np.diff(positions, axis=0))
    # The translation of the exponential is the left tangent map of the rotation times v.
    zero = np.zeros_like(turn)
    left = _series(np.concatenate((zero, turn), axis=1), alternate=False)[:, :3, :3]
    v = np.linalg.solve(left, moved[..., None])[..., 0]
    return np.concatenate((v, turn), axis=1)


def nodal_wrenches(positions: Array, rotations: Array, gradient: Array, twists: Array) -> tuple[Array, Array]:
    """Forces and moments on the nodes, world axes, each (n, 3), from the gradients of an energy by the twists.

    By virtual work: ``delta X = T (eta_b - Ad^{-1} eta_a)`` with the body-frame motions of both nodes.
    """
    inverse = np.linalg.inv(_series(twists, alternate=True))
    pulled = np.swapaxes(inverse, 1, 2) @ gradient[..., None]
    at_second = -pulled[..., 0]
    second = rotations[1:]
    force_b = np.einsum("kij,kj->ki", second, at_second[:, :3])
    moment_b = np.einsum("kij,kj->ki", second, at_second[:, 3:])
    # What the element does to its first node is the opposite, moved there: an element without load is in balance.
    moment_a = -moment_b - np.cross(np.diff(positions, axis=0), force_b)
    force, moment = np.zeros_like(positions), np.zeros_like(positions)
    force[1:], moment[1:] = force_b, moment_b
    force[:-1] -= force_b
    moment[:-1] += moment_a
    return force, moment


@dataclass(frozen=True)
class Elements:
    """Material of the rod between neighbouring nodes, in section axes.

    Attributes
    ----------
    lengths : ndarray, shape (k,)
        [m].
    stiffness : ndarray, shape (k, 6)
        ``GA, GA, EA, EI, EI, GJ``, with the residual flexibility of bending in the shear.
    unloaded : ndarray, shape (k, 6)
        Strain of the unloaded rod.
    bending : ndarray, shape (k, 3)
        EA and EI of the material, and compliance factor by creep; zero stiffness in rigid parts.
    mass : ndarray, shape (k,)
        [kg].
    rigid : ndarray of bool, shape (k,)
    backbone : Backbone
    """

    lengths: Array
    stiffness: Array
    unloaded: Array
    bending: Array
    mass: Array
    rigid: NDArray[np.bool_]
    middle: Array
    backbone: Backbone

    @classmethod
    def of(cls, robot: Robot, s: Array, time: float) -> Elements:
        """The material between nodes at arc lengths ``s`` [m], at a time [s] by which the backbone has crept."""
        b, h, middle = robot.backbone, np.diff(s), 0.5 * (s[1:] + s[:-1])
        hinge = robot.base_stiffness is not None
        bending, torsion = b.stiffness_factors(middle)
        modulus, density = b.material_factors(middle)
        area = np.ones_like(middle)
        if b.taper:
            thick, area = b.taper_factors(s)
            bending, torsion = bending * thick, torsion * thick
        ga, ea, ei, gj = b.GA * area * modulus, b.EA * area * modulus, b.EI * bending, b.GJ * torsion
        rigid = np.zeros(len(h), dtype=bool)
        for disk in robot.disks.positions:
            rigid |= np.abs(middle - disk) < 0.5 * robot.disks.thickness
        grown = np.where(rigid, 1.0, b.compliance_factor(time))
        ga, ea = np.where(rigid, RIGID_TRANSLATION, 1.0) * ga, np.where(rigid, RIGID_TRANSLATION, 1.0) * ea
        ei, gj = np.where(rigid, RIGID_ROTATION, 1.0) * ei, np.where(rigid, RIGID_ROTATION, 1.0) * gj
        if hinge:
            ei[0] = (robot.base_stiffness or 0.0) * h[0]
            rigid[0], grown[0] = True, 1.0
        ei, gj = ei / grown, gj / grown
        shear = 1.0 / (1.0 / ga + h**2 / (12.0 * ei))
        unloaded = np.zeros((len(h), 6))
        unloaded[:, 2] = 1.0
        unloaded[:, 3:5] = b.unloaded_curvature(middle)
        laws = np.column_stack((np.where(rigid, 0.0, ea), np.where(rigid, 0.0, ei), grown))
        mass = b.mass_per_length * area * density * h
        return cls(
            h, np.stack((shear, shear, ea, ei, ei, gj), axis=1), unloaded, laws, mass, rigid, middle, b
        )

    def gradient(self, twists: Array) -> Array:
        """Derivative of the elastic energy by the twists, shape (k, 6) [N, N m]."""
        strain = twists / self.lengths[:, None]
        change = strain - self.unloaded
        g = self.stiffness * change
        if self.backbone.superelastic is not None:
            g[:, 3:5] += self._softening(change[:, 3:5])
        if self.backbone.nonlinear is not None:
            g += self._fibres(change)
        return np.asarray(g)

    def _softening(self, bend: Array) -> Array:
        """Moment that a superelastic section lacks, beyond the threshold."""
        law = self.backbone.superelastic
        assert law is not None
        k = np.linalg.norm(bend, axis=1)
        kc = law.threshold_strain / self.backbone.radius_at(self.middle)
        w = kc / 40.0
        lost = np.logaddexp(0.0, (k - kc) / w) - np.logaddexp(0.0, -kc / w)
        size = -(1.0 - law.plateau_ratio) * self.bending[:, 1] * w * lost
        return np.asarray(bend * (size / np.where(k > 0.0, k, 1.0))[:, None])

    def _fibres(self, change: Array) -> Array:
        """Wrench of fibres beyond linear elasticity, integrated over the round section that EA and EI give."""
        law = self.backbone.nonlinear
        assert law is not None
        ea, ei = self.bending[:, 0], self.bending[:, 1]
        reach = 2.0 * np.sqrt(ei / np.where(ea > 0.0, ea, 1.0))
        nodes, weights = np.polynomial.legendre.leggauss(6)
        radii, angles = np.sqrt(0.5 * (nodes + 1.0)), np.arange(12) * np.pi / 6.0
        found = np.zeros((len(change), 6))
        for r, weight in zip(radii, 0.5 * weights, strict=True):
            for angle in angles:
                x, y = r * reach * np.cos(angle), r * reach * np.sin(angle)
                e = change[:, 2] + change[:, 3] * y - change[:, 4] * x
                stress = ea * weight / len(angles) * (law.quadratic * e**2 + law.cubic * e**3)
                found[:, 2] += stress
                found[:, 3] += stress * y
                found[:, 4] -= stress * x
        return found


# ----------------------------------------------------------------------------------------------------- tendons

#: Turn of a tendon at which it has shifted by 0.7 of its clearance [rad].
CLEARANCE_ANGLE = 0.01


@dataclass(frozen=True)
class Course:
    """One straight tendon in one configuration.

    Attributes
    ----------
    nodes : ndarray of int, shape (n + 1,)
        Of the backbone, at its holes.
    holes : ndarray, shape (n + 1, 3)
        Where it passes them, world axes [m].
    lengths : ndarray, shape (n,)
        Of its segments [m].
    directions : ndarray, shape (n, 3)
        From the base to the anchor.
    angles : ndarray, shape (n - 1,)
        By which it turns at its holes [rad].
    """

    nodes: NDArray[np.intp]
    holes: Array
    lengths: Array
    directions: Array
    angles: Array


def courses(robot: Robot, s: Array, positions: Array, rotations: Array) -> list[Course]:
    """The straight tendons of a robot."""
    found = []
    for tendon in robot.tendons:
        at = robot.hole_arc_lengths(tendon)
        nodes = np.abs(s[:, None] - at).argmin(axis=0)
        if np.abs(s[nodes] - at).max() > 1e-8:
            raise ValueError("a hole lies at no node")
        frames, points = rotations[nodes], robot.hole_points(tendon)
        holes = positions[nodes] + np.einsum("kij,kj->ki", frames, points)
        if tendon.clearance > 0.0:
            d = np.diff(holes, axis=0)
            d = d / np.linalg.norm(d, axis=1)[:, None]
            pull = np.zeros_like(holes)
            pull[:-1] += d
            pull[1:] -= d
            pull[0] -= frames[0, :, 2]
            local = np.einsum("kji,kj->ki", frames, pull)
            local[:, 2] = 0.0
            size = np.sqrt((local**2).sum(axis=1) + CLEARANCE_ANGLE**2)
            shift = tendon.clearance * local / size[:, None]
            shift[-1] = 0.0
            holes = holes + np.einsum("kij,kj->ki", frames, shift)
        d = np.diff(holes, axis=0)
        lengths = np.linalg.norm(d, axis=1)
        e = d / lengths[:, None]
        sine = np.linalg.norm(np.cross(e[:-1], e[1:]), axis=1)
        found.append(Course(nodes, holes, lengths, e, np.arctan2(sine, (e[:-1] * e[1:]).sum(axis=1))))
    return found


@dataclass(frozen=True)
class Following:
    """One tendon that follows the backbone.

    Attributes
    ----------
    length : float
        [m].
    gradient : ndarray, shape (k, 6)
        Of the length by the twists of the elements.
    """

    length: float
    gradient: Array


def following(robot: Robot, s: Array, twists: Array) -> list[Following]:
    """The tendons of a robot that follow its backbone; the course is integrated at four Gauss points an element."""
    h = np.diff(s)
    at = (s[:-1, None] + h[:, None] * _GAUSS).ravel()
    found = []
    for tendon in robot.tendons:
        end = robot.end(tendon)
        inside = np.repeat(0.5 * (s[1:] + s[:-1]) < end, len(_GAUSS))
        r, slope = np.zeros((len(at), 3)), np.zeros((len(at), 3))
        r[:, :2] = tendon.routing.position(np.minimum(at, end), end)
        slope[:, :2] = tendon.routing.position(np.minimum(at, end), end, 1)
        strain = np.repeat(twists / h[:, None], len(_GAUSS), axis=0)
        a = strain[:, :3] + np.cross(strain[:, 3:], r) + slope
        size = np.linalg.norm(a, axis=1)
        weight = np.tile(_WEIGHTS, len(h)) * inside
        t = a / size[:, None] * weight[:, None]
        gradient = np.concatenate((t, np.cross(r, t)), axis=1).reshape(len(h), len(_GAUSS), 6).sum(axis=1)
        found.append(Following(float((size * weight * np.repeat(h, len(_GAUSS))).sum()), gradient))
    return found


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


def unloaded_pose(elements: Elements, s: Array) -> tuple[Array, Array]:
    """Positions and rotations of the nodes of the unloaded robot, clamped upright at the origin."""
    positions, rotations = np.zeros((len(s), 3)), np.zeros((len(s), 3, 3))
    rotations[0] = np.eye(3)
    twists = elements.unloaded * elements.lengths[:, None]
    turns = Rotation.from_rotvec(twists[:, 3:]).as_matrix()
    zero = np.zeros((len(twists), 3))
    left = _series(np.concatenate((zero, twists[:, 3:]), axis=1), alternate=False)[:, :3, :3]
    moved = (left @ twists[:, :3, None])[..., 0]
    for k, (turn, move) in enumerate(zip(turns, moved, strict=True)):
        positions[k + 1] = positions[k] + rotations[k] @ move
        rotations[k + 1] = rotations[k] @ turn
    return positions, rotations


def balance(robot: Robot, model: Model, step: StepResult) -> Balance:
    """Forces and moments on every node: material, tendons, weight, loads and springs."""
    actuation = step.actuation
    if actuation is None:
        raise ValueError("the step does not say what acts on the robot")
    s, p, frames = step.s, step.positions, step.rotations
    elements = Elements.of(robot, s, actuation.time)
    twists = relative_twists(p, frames)
    force, moment = np.zeros_like(p), np.zeros_like(p)
    # An unloaded robot has no forces; a thousandth of what bends it by a radian sets the scale then.
    bend = 1e-3 * robot.backbone.EI / robot.backbone.length
    sizes, moments = [bend / robot.backbone.length], [bend]

    def add(nodes: NDArray[np.intp], f: Array, m: Array) -> None:
        np.add.at(force, nodes, f)
        np.add.at(moment, nodes, m)
        sizes.append(float(np.abs(f).max(initial=0.0)))
        moments.append(float(np.abs(m).max(initial=0.0)))

    every = np.arange(len(s))
    add(every, *nodal_wrenches(p, frames, elements.gradient(twists), twists))
    # Forces that cancel at a node are on no list; the wrench inside the rod sets the scale, too.
    inside = elements.gradient(twists)[~elements.rigid]
    sizes.append(float(np.abs(inside[:, :3]).max(initial=0.0)))
    moments.append(float(np.abs(inside[:, 3:]).max(initial=0.0)))
    if model.tendon_path == "straight":
        for course, tension in zip(courses(robot, s, p, frames), step.tensions, strict=True):
            pull = np.zeros_like(course.holes)
            pull[:-1] += tension[:, None] * course.directions
            pull[1:] -= tension[:, None] * course.directions
            add(course.nodes, pull, np.cross(course.holes - p[course.nodes], pull))
            sizes.append(float(tension.max(initial=0.0)))
    else:
        for tendon, tension in zip(following(robot, s, twists), step.tensions, strict=True):
            add(every, *nodal_wrenches(p, frames, tension[0] * tendon.gradient, twists))
            sizes.append(float(tension.max(initial=0.0)))
    mass = np.zeros(len(s))
    mass[:-1] += 0.5 * elements.mass
    mass[1:] += 0.5 * elements.mass
    for disk in robot.disks.positions:
        mass[np.abs(s - disk).argmin()] += robot.disks.mass
    mass[-1] += robot.tip_mass
    add(every, mass[:, None] * np.array(model.gravity), np.zeros_like(p))
    for load in actuation.loads.values():
        node = np.array([np.abs(s - load.at).argmin()])
        turn = frames[node[0]] if load.frame == "section" else np.eye(3)
        add(node, (turn @ np.array(load.force))[None], (turn @ np.array(load.moment))[None])
    rest = unloaded_pose(Elements.of(robot, s, 0.0), s)[0]
    for spring in robot.springs:
        node = np.array([np.abs(s - spring.at).argmin()])
        pull = -spring.stiffness * (p[node] - rest[node]) * np.array([1.0, 1.0, 0.0])
        add(node, pull, np.zeros_like(pull))
    eps = 8.0 * float(np.finfo(float).eps)
    size = np.linalg.norm(p, axis=1).max()
    round_off = eps * float((elements.stiffness[:, :3].max(axis=1) * size / elements.lengths).max())
    turn = eps * float((elements.stiffness[:, 3:].max(axis=1) / elements.lengths).max())
    turn += round_off * float(elements.lengths.max())
    return Balance(force, moment, max(sizes), max(moments), round_off, turn)

"""One equilibrium: unknowns, kinematics and equations of the multiple shooting."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from tdcr_fe.model.loading import Load, Model
from tdcr_fe.model.robot import Robot
from tdcr_fe.validation.reference.balance import Balance, Forces, GroundedSpring, Poses
from tdcr_fe.validation.reference.layout import Layout, lay_out
from tdcr_fe.validation.reference.rod import Flow, Rod, adjoint
from tdcr_fe.validation.reference.settings import Array, BackboneState, Extras, ReferenceSettings
from tdcr_fe.validation.reference.tendons import Driver, Lengths, TendonEquations, Tendons, straight_segments


@dataclass(frozen=True)
class State:
    """A configuration with its unknowns.

    Attributes
    ----------
    unknowns : ndarray
        Starting wrenches (and weights) of the intervals, tensions, mobilisations.
    rotations, positions : ndarray, shapes (n + 1, 3, 3), (n + 1, 3)
        Of the stations [m].
    wrenches : ndarray, shape (n, 6)
        At the starts of the intervals, section frames [N m, N].
    tensions : ndarray, shape (n_segments,)
        [N].
    mobilisation : ndarray, shape (n_friction,)
        [1].
    lengths, angles : ndarray, shapes (n_segments,), (n_holes,)
        Of the tendons' segments [m], and at their holes [rad].
    residual : float
        Largest scaled residual [1].
    """

    unknowns: Array
    rotations: Array
    positions: Array
    wrenches: Array
    tensions: Array
    mobilisation: Array
    lengths: Array
    angles: Array
    residual: float


def _check(robot: Robot, model: Model, extras: Extras) -> None:
    """Refuse combinations that the reference does not solve."""
    continuous = model.tendon_path == "continuous"
    if continuous and any(t.clearance > 0.0 for t in robot.tendons):
        raise ValueError("clearance of holes with tendon_path 'continuous'; only 'straight' goes with it")
    if continuous and extras.bending is not None:
        raise ValueError("a law of bending with tendon_path 'continuous'; only 'straight' goes with it")
    if robot.base_stiffness is not None and (
        robot.backbone.superelastic is not None
        or robot.backbone.nonlinear is not None
        or robot.backbone.creep_rate > 0.0
    ):
        raise ValueError("base_stiffness with a backbone that creeps or is not linear; not in the reference")
    special = extras.holes or any(t.tight_holes for t in robot.tendons)
    if special and (continuous or model.friction != "per-hole"):
        raise ValueError("holes that differ need tendon_path 'straight' and friction 'per-hole'")


#: Changes that end the iteration for laws of the state: of friction coefficients [1], and of moments and forces over
#: EI/L and EI/L^2 [1].
_COEFFICIENT_TOLERANCE, _LAW_TOLERANCE = 1e-10, 1e-7


class Statics:
    """Equilibrium of a robot.

    Unknown are the wrench at the start of every interval in its section frame, with gravity the weight per
    length in that frame, the tension of every tendon segment, and the mobilisation of friction. Poses follow
    from the base by integrating interval after interval, so the kinematics are always exact; what is
    solved for is the balance of wrenches at the stations and the tendons' equations.

    Parameters
    ----------
    robot, model
        What is modelled.
    loaded
        Arc lengths where concentrated loads will act [m].
    settings
        Numerical settings.
    extras
        Properties beyond the robot description.
    """

    def __init__(
        self, robot: Robot, model: Model, loaded: list[float], settings: ReferenceSettings, extras: Extras
    ) -> None:
        _check(robot, model, extras)
        self.robot, self.model, self.settings = robot, model, settings
        points = [*loaded, *(s.at for s in robot.springs), *(f.at for f in extras.forces)]
        self.layout: Layout = lay_out(robot, points, settings.max_interval)
        self.extras = extras
        #: Forces at the stations that depend on displacements [N].
        self.by_displacement = np.zeros((len(self.layout.s), 3))
        backbone = robot.backbone
        self.gravity = np.asarray(model.gravity, dtype=float)
        self.weight = self.layout.mass_per_length[:, None] * self.gravity
        self.heavy = bool(np.any(self.weight != 0.0))
        self.continuous = model.tendon_path == "continuous"
        self.max_step = settings.max_step * backbone.length * (2.0 if self.continuous else 1.0)
        #: Law of the intervals now, creep included.
        self.section = self.layout.section
        starts, routed = self.layout.s[:-1], robot if self.continuous else None
        self.rod = Rod(self.section, starts, self.layout.lengths, self.max_step, self.heavy, routed)
        self.tendons = Tendons(robot, model, self.layout, extras.holes)
        self.springs: list[GroundedSpring] = []
        n = len(self.layout.lengths)
        self.n, self.width = n, 9 if self.heavy else 6
        self.rod_size = n * self.width
        #: Unknowns without and with the mobilisations.
        self.smooth = self.rod_size + self.tendons.size
        self.size = self.smooth + self.tendons.n_friction
        self.force_scale = backbone.EI / backbone.length**2
        self.length_scale = 0.01 * backbone.length
        self._wrench_scale = np.repeat([self.force_scale * backbone.length, self.force_scale], 3)
        self._before = np.tri(n + 1, n, -1, dtype=bool)[:, None, :, None]
        rest = self.evaluate(np.zeros(self.size), self.no_forces(), None)[0]
        self.tendons.rest = rest.lengths
        for spring in robot.springs:
            at, sideways = self.layout.station(spring.at), spring.stiffness * np.array([1.0, 1.0, 0.0])
            self.springs.append(GroundedSpring(at, sideways, rest.positions[at].copy()))
        #: The unloaded state, without weight; its unknowns are a start with weight.
        self.rest = replace(rest, unknowns=self._weights(), residual=0.0)

    def _weights(self) -> Array:
        """Unknowns of the unloaded state, but for the weights in the frames of the intervals."""
        x = np.zeros(self.size)
        if self.heavy:
            x[: self.rod_size].reshape(self.n, 9)[:, 6:] = self.weight
        return x

    def set_compliance_factor(self, factor: float) -> None:
        """Make the backbone softer in bending and torsion by a factor on its compliance [1]."""
        self.section = replace(self.layout.section.softened(factor), carried=self.section.carried)
        self.rod.section = self.section

    def follow_laws(self, state: State, direction: Array, time: float) -> bool:
        """Set what depends on the state by laws of friction and of the extras; whether it is as it was."""
        tendons = self.tendons
        mu = tendons.coefficients(state.tensions, state.angles)
        settled = bool(np.max(np.abs(mu - tendons.mu), initial=0.0) <= _COEFFICIENT_TOLERANCE)
        tendons.mu = mu
        if self.extras.bending is not None:
            carried = np.zeros((self.n, 6))
            here = self._backbone_state(state, direction, time)
            carried[:, :2] = self._next_bending(self.extras.bending, here)
            change = np.max(np.abs(carried - self.section.carried)) / self._wrench_scale[0]
            settled = settled and bool(change <= _LAW_TOLERANCE)
            self.section = replace(self.section, carried=carried)
            self.rod.section = self.section
        forces = np.zeros((self.n + 1, 3))
        for each in self.extras.forces:
            at = self.layout.station(each.at)
            forces[at] += each.force(state.positions[at] - self.rest.positions[at])
        change = np.max(np.abs(forces - self.by_displacement)) / self.force_scale
        self.by_displacement = forces
        return settled and bool(change <= _LAW_TOLERANCE)

    def _next_bending(self, law: Callable[[BackboneState], Array], here: BackboneState) -> Array:
        """Moments of the next iteration: Newton's method, with the curvature that a change leaves at equal wrench."""
        value, h = law(here), 1e-6 / self.robot.backbone.length
        slope = np.zeros((self.n, 2, 2))
        for k in range(2):
            moved = here.strain.copy()
            moved[:, k] += h
            slope[:, :, k] = (law(replace(here, strain=moved)) - value) / h
        matrix = np.eye(2) + slope / self.section.stiffness[:, :1, None]
        gap = value - self.section.carried[:, :2]
        return self.section.carried[:, :2] + np.linalg.solve(matrix, gap[..., None])[..., 0]

    def _backbone_state(self, state: State, direction: Array, time: float) -> BackboneState:
        """What a law of bending may depend on."""
        lengths, tendons = self.layout.lengths, self.tendons
        relative = np.swapaxes(state.rotations[:-1], 1, 2) @ state.rotations[1:]
        strain = Rotation.from_matrix(relative).as_rotvec() / lengths[:, None]
        tension = np.zeros((self.n, tendons.count))
        for i in range(tendons.count):
            for j in range(tendons.first[i], tendons.last[i]):
                tension[tendons.tail[j] : tendons.head[j], i] = state.tensions[j]
        middles = self.layout.s[:-1] + 0.5 * lengths
        return BackboneState(middles, strain, tension, direction, time)

    def no_forces(self) -> Forces:
        """No concentrated loads, and no weight of the disks."""
        return Forces(np.zeros((self.n + 1, 6)), np.zeros((self.n + 1, 6)))

    def forces(self, loads: list[tuple[float, Load]]) -> Forces:
        """Factors and loads, with the weight of disks and tip mass."""
        result = self.no_forces()
        result.world[:, 3:] = self.layout.point_mass[:, None] * self.gravity + self.by_displacement
        for factor, load in loads:
            target = result.world if load.frame == "world" else result.section
            target[self.layout.station(load.at)] += factor * np.array([*load.moment, *load.force])
        return result

    def evaluate(
        self, x: Array, forces: Forces, driver: Driver | None
    ) -> tuple[State, Array, Array, TendonEquations | None]:
        """State, scaled residual, its Jacobian and the tendons' equations at given unknowns.

        Residual and Jacobian have a row for every unknown of rod and tensions; the Jacobian has further
        columns for what complementarity decides (see `TendonEquations`).
        """
        n, tendons = self.n, self.tendons
        z = x[: self.rod_size].reshape(n, self.width)
        tension, mobilisation = x[self.rod_size : self.smooth], x[self.smooth :]
        weight, pull = z[:, 6:] if self.heavy else None, tension if self.continuous else None
        flow = self.rod.integrate(z[:, :6], weight, pull)
        poses = self._poses(flow)
        driven = 0 if driver is None else int(np.count_nonzero(driver.by_displacement))
        balance = Balance(n, self.width, self.smooth, self.smooth + tendons.n_friction + driven)
        balance.add_continuity(flow, z[:, :6])
        balance.add_forces(forces, poses)
        for spring in self.springs:
            balance.add_spring(spring, poses)
        if self.heavy:
            balance.add_weight(self.weight, z[:, 6:], poses)
        if self.continuous:
            known = self._courses(flow)
        else:
            known = segments = straight_segments(tendons, *poses)
            balance.add_segments(tendons, segments, tension, poses)
        balance.scale(self._wrench_scale, float(np.max(np.abs(self.weight))) if self.heavy else None)
        equations = None
        if driver is not None and tendons.size:
            equations = tendons.equations(known, tension, mobilisation, driver, self.force_scale)
            balance.add_tensions(equations, self.smooth)
        state = State(
            unknowns=x,
            rotations=poses.rotations,
            positions=poses.positions,
            wrenches=z[:, :6],
            tensions=tension,
            mobilisation=mobilisation,
            lengths=known.lengths,
            angles=known.angles,
            residual=float(np.max(np.abs(balance.residual), initial=0.0)),
        )
        return state, balance.residual, balance.jacobian, equations

    def _poses(self, flow: Flow) -> Poses:
        """Poses of the stations, one interval after another from the base."""
        n = self.n
        rotations, positions = np.empty((n + 1, 3, 3)), np.zeros((n + 1, 3))
        rotations[0] = np.eye(3)
        for k in range(n):
            positions[k + 1] = positions[k] + rotations[k] @ flow.position[k]
            rotations[k + 1] = rotations[k] @ flow.rotation[k]
        spatial = adjoint(rotations[1:], positions[1:]) @ flow.d_pose
        return Poses(rotations, positions, self._twists(spatial))

    def _twists(self, spatial: Array) -> Array:
        """Spatial twists of the stations by the unknowns of the rod, and by tensions along the rod."""
        n, width = self.n, self.width
        own = spatial[:, :, :width].transpose(1, 0, 2)
        twists = np.where(self._before, own[None], 0.0).reshape(n + 1, 6, self.rod_size)
        if spatial.shape[2] == width:
            return twists
        shared = np.zeros((n + 1, 6, spatial.shape[2] - width))
        np.cumsum(spatial[:, :, width:], axis=0, out=shared[1:])
        return np.concatenate((twists, shared), axis=2)

    def _courses(self, flow: Flow) -> Lengths:
        """Continuous tendons, which have no holes; derivatives by the unknowns of the rod and by the tensions."""
        own = flow.d_length[:, :, : self.width].transpose(1, 0, 2).reshape(self.tendons.size, self.rod_size)
        d_lengths = np.concatenate((own, flow.d_length[:, :, self.width :].sum(axis=0)), axis=1)
        lengths, no_angles = flow.tendon_length.sum(axis=0), np.zeros((0, d_lengths.shape[1]))
        return Lengths(lengths, np.zeros(0), d_lengths, no_angles)

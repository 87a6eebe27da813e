"""One equilibrium: the equations of the multiple shooting and Newton's method for them."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tdcr_fe.model.loading import Load, Model
from tdcr_fe.model.robot import Robot
from tdcr_fe.validation.reference.complementarity import natural_residual, solve_box
from tdcr_fe.validation.reference.extras import Extras
from tdcr_fe.validation.reference.layout import Layout, lay_out
from tdcr_fe.validation.reference.lie import adjoint, hat
from tdcr_fe.validation.reference.rod import Flow, Rod
from tdcr_fe.validation.reference.settings import ReferenceSettings
from tdcr_fe.validation.reference.tendons import (
    Driver,
    History,
    Segments,
    TendonEquations,
    Tendons,
    straight_segments,
)

Array = NDArray[np.float64]

#: Number of Newton steps over which the merit function must decrease.
_MEMORY = 3


@dataclass(frozen=True)
class Forces:
    """Concentrated loads summed at the stations.

    Attributes
    ----------
    world, section : ndarray, shape (n + 1, 6)
        Moment and force in world frame and in section frame [N m, N].
    """

    world: Array
    section: Array


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


@dataclass(frozen=True)
class Attempt:
    """Outcome of one run of Newton's method."""

    state: State
    converged: bool
    iterations: int


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
    load_points
        Arc lengths where concentrated loads will act [m].
    settings
        Numerical settings.
    extras
        Properties beyond the robot description.
    """

    def __init__(
        self,
        robot: Robot,
        model: Model,
        load_points: list[float],
        settings: ReferenceSettings,
        extras: Extras | None = None,
    ) -> None:
        extras = extras or Extras()
        if model.tendon_path == "continuous" and model.friction != "none":
            raise ValueError(
                f"friction {model.friction!r} with tendon_path 'continuous'; only 'none' goes with it"
            )
        if model.tendon_path == "continuous" and any(t.clearance > 0.0 for t in robot.tendons):
            raise ValueError("clearance of holes with tendon_path 'continuous'; only 'straight' goes with it")
        if extras.holes and (model.tendon_path == "continuous" or model.friction != "per-hole"):
            raise ValueError("holes that differ need tendon_path 'straight' and friction 'per-hole'")
        self.robot, self.model, self.settings = robot, model, settings
        self.layout: Layout = lay_out(
            robot, [*load_points, *(s.at for s in extras.springs)], settings.max_interval
        )
        backbone = robot.backbone
        self.gravity = np.asarray(model.gravity, dtype=float)
        self.weight = self.layout.mass_per_length * self.gravity
        self.heavy = bool(np.any(self.weight != 0.0))
        self.continuous = model.tendon_path == "continuous"
        self.max_step = settings.max_step * backbone.length * (2.0 if self.continuous else 1.0)
        self.rod = Rod(
            self.layout.section,
            self.layout.s[:-1],
            self.layout.lengths,
            self.max_step,
            self.heavy,
            robot if self.continuous else None,
        )
        #: Law of the intervals now, creep included.
        self.section = self.layout.section
        self.tendons = Tendons(robot, model, self.layout, extras.holes)
        self.springs: list[tuple[int, Array, Array]] = []
        n = len(self.layout.lengths)
        self.n, self.width = n, 9 if self.heavy else 6
        self.rod_size = n * self.width
        #: Unknowns without and with the mobilisations.
        self.smooth = self.rod_size + self.tendons.size
        self.size = self.smooth + self.tendons.n_friction
        self.force_scale = backbone.EI / backbone.length**2
        self.moment_scale = backbone.EI / backbone.length
        self.length_scale = 0.01 * backbone.length
        self._wrench_scale = np.repeat([self.moment_scale, self.force_scale], 3)
        self._before = np.tri(n + 1, n, -1, dtype=bool)[:, None, :, None]
        rest = self.evaluate(np.zeros(self.size), self.no_forces(), None)[0]
        self.tendons.rest = rest.lengths
        for spring in extras.springs:
            at = self.layout.station(spring.at)
            if at == 0:
                raise ValueError(f"a spring at {spring.at:g} m; the base does not move")
            self.springs.append((at, np.array(spring.stiffness), rest.positions[at].copy()))
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
        self.section = self.layout.section.softened(factor)
        self.rod.section = self.section

    def no_forces(self) -> Forces:
        """No concentrated loads, and no weight of the disks."""
        return Forces(np.zeros((self.n + 1, 6)), np.zeros((self.n + 1, 6)))

    def forces(self, loads: list[tuple[float, Load]]) -> Forces:
        """Factors and loads, with the weight of disks and tip mass."""
        result = self.no_forces()
        result.world[:, 3:] = self.layout.point_mass[:, None] * self.gravity
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
        n, width, tendons = self.n, self.width, self.tendons
        z = x[: self.rod_size].reshape(n, width)
        tension = x[self.rod_size : self.smooth]
        mobilisation = x[self.smooth :]
        flow = self.rod.integrate(
            z[:, :6], z[:, 6:] if self.heavy else None, tension if self.continuous else None
        )
        rotations, positions = np.empty((n + 1, 3, 3)), np.zeros((n + 1, 3))
        rotations[0] = np.eye(3)
        for k in range(n):
            positions[k + 1] = positions[k] + rotations[k] @ flow.position[k]
            rotations[k + 1] = rotations[k] @ flow.rotation[k]
        spatial = adjoint(rotations[1:], positions[1:]) @ flow.d_pose
        twists = self._twists(spatial)
        m = twists.shape[2]

        residual = np.zeros(self.smooth)
        choices = tendons.n_friction + (0 if driver is None else np.count_nonzero(driver.by_displacement))
        size = self.smooth + choices
        jacobian = np.zeros((self.smooth, size))
        rod = residual[: self.rod_size].reshape(n, width)
        rows = jacobian[: self.rod_size].reshape(n, width, size)
        blocks = jacobian[: self.rod_size, : self.rod_size].reshape(n, width, n, width)
        each = np.arange(n)
        rod[:, :6] = flow.wrench
        rod[:-1, :6] -= z[1:, :6]
        blocks[each, :6, each, :] = flow.d_wrench[:, :, :width]
        blocks[each[:-1], :6, each[1:], :6] -= np.eye(6)
        rows[:, :6, self.rod_size : m] = flow.d_wrench[:, :, width:]

        turn = twists[:, :3]
        self._apply_loads(rod, rows, forces, rotations, positions, twists)
        if self.heavy:
            forth = np.swapaxes(rotations[:-1], 1, 2)
            rod[:, 6:] = z[:, 6:] - (forth @ self.weight[:, None])[..., 0]
            blocks[each, 6:, each, 6:] += np.eye(3)
            rows[:, 6:, :m] -= (forth @ hat(self.weight)) @ turn[:-1]

        if self.continuous:
            lengths, angles = flow.tendon_length.sum(axis=0), np.zeros(0)
            d_lengths, d_angles = self._tendon_columns(flow), np.zeros((0, m))
        else:
            segments = straight_segments(tendons, rotations, positions, twists)
            lengths, angles = segments.lengths, segments.angles
            d_lengths, d_angles = segments.d_lengths, segments.d_angles
            self._pull(rod, rows, segments, tension, rotations, turn)

        rod[:, :6] /= self._wrench_scale
        rows[:, :6] /= self._wrench_scale[:, None]
        if self.heavy:
            scale = np.max(np.abs(self.weight))
            rod[:, 6:] /= scale
            rows[:, 6:] /= scale
        equations = None
        if driver is not None and tendons.size:
            equations = tendons.equations(
                lengths,
                angles,
                d_lengths,
                d_angles,
                tension,
                mobilisation,
                driver,
                self.force_scale,
            )
            residual[self.rod_size :] = equations.residual
            jacobian[self.rod_size :, :m] += equations.by_rod
            jacobian[self.rod_size :, self.rod_size : self.smooth] += equations.by_tension
            jacobian[self.rod_size :, self.smooth :] = equations.by_choice
        state = State(
            unknowns=x,
            rotations=rotations,
            positions=positions,
            wrenches=z[:, :6],
            tensions=tension,
            mobilisation=mobilisation,
            lengths=lengths,
            angles=angles,
            residual=float(np.max(np.abs(residual), initial=0.0)),
        )
        return state, residual, jacobian, equations

    def _apply_loads(
        self, rod: Array, rows: Array, forces: Forces, rotations: Array, positions: Array, twists: Array
    ) -> None:
        """Subtract concentrated loads and springs from the balance; derivatives come from the section's rotation."""
        m, turn = twists.shape[2], twists[:, :3]
        back = np.swapaxes(rotations[1:], 1, 2)
        moment, force = forces.world[1:, :3], forces.world[1:, 3:]
        rod[:, :3] -= (back @ moment[:, :, None])[..., 0] + forces.section[1:, :3]
        rod[:, 3:6] -= (back @ force[:, :, None])[..., 0] + forces.section[1:, 3:]
        for i in np.flatnonzero(np.any(forces.world[1:] != 0.0, axis=1)):
            rows[i, :3, :m] -= back[i] @ hat(moment[i]) @ turn[i + 1]
            rows[i, 3:6, :m] -= back[i] @ hat(force[i]) @ turn[i + 1]
        for at, stiffness, home in self.springs:
            pull = stiffness * (home - positions[at])
            rod[at - 1, 3:6] -= back[at - 1] @ pull
            by_twist = np.concatenate(
                (hat(pull) + stiffness[:, None] * hat(positions[at]), -np.diag(stiffness)), 1
            )
            rows[at - 1, 3:6, :m] -= back[at - 1] @ by_twist @ twists[at]

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

    def _tendon_columns(self, flow: Flow) -> Array:
        """Derivative of the lengths of continuous tendons by the unknowns of the rod and by the tensions."""
        own = flow.d_length[:, :, : self.width].transpose(1, 0, 2).reshape(self.tendons.size, self.rod_size)
        return np.concatenate((own, flow.d_length[:, :, self.width :].sum(axis=0)), axis=1)

    def _pull(
        self, rod: Array, rows: Array, segments: Segments, tension: Array, rotations: Array, turn: Array
    ) -> None:
        """Subtract the wrenches of straight segments on the disks from the balance (paper, Eqs. 12 and 32)."""
        tendons, m = self.tendons, turn.shape[2]
        pulled = tension[:, None] * segments.directions
        d_pulled = tension[:, None, None] * segments.d_directions
        tails, heads = segments.ends
        for at, (hole, d_hole), sign in ((tendons.head, heads, -1.0), (tendons.tail, tails, 1.0)):
            down = np.swapaxes(rotations[at], 1, 2)
            arm = sign * np.concatenate((hat(hole) @ down, down), axis=1)
            local = (arm @ pulled[:, :, None])[..., 0]
            by_rod = arm @ (d_pulled + hat(pulled) @ turn[at])
            if d_hole is not None:
                by_rod[:, :3] -= sign * hat((down @ pulled[:, :, None])[..., 0]) @ d_hole
            by_tension = (arm @ segments.directions[:, :, None])[..., 0]
            for first, last in zip(tendons.first, tendons.last, strict=True):
                # the first tail is the base plate, which is clamped
                k = np.arange(first + (sign > 0.0), last)
                rod[at[k] - 1, :6] -= local[k]
                rows[at[k] - 1, :6, :m] -= by_rod[k]
                rows[at[k] - 1, :6, self.rod_size + k] -= by_tension[k]

    def _longest_share(self, step: Array) -> float:
        """Fraction of a Newton step that turns no interval by more than a radian, so that integration stays stable."""
        change = step[: self.rod_size].reshape(self.n, self.width)[:, :3] / self.section.stiffness[:, :3]
        turn = np.linalg.norm(change, axis=1) * self.layout.lengths * ~self.layout.section.rigid
        return min(1.0, 1.0 / max(float(np.max(turn)), 1e-12))

    def solve(
        self, start: Array, forces: Forces, driver: Driver, history: History, presliding: float
    ) -> Attempt:
        """Newton's method from given unknowns, with a line search.

        The equations of rod and tensions are linearised; stick and slip are not: in every iteration they are
        a complementarity problem on the linearised robot, solved exactly.

        Parameters
        ----------
        start
            Unknowns to start from.
        forces, driver, history
            Loads, prescribed inputs, and friction history.
        presliding
            Slip from rest to full friction [m].
        """
        x = start.copy()
        friction, driven = self.tendons.n_friction, np.flatnonzero(driver.by_displacement)
        scale = np.repeat([1.0, self.force_scale], [friction, len(driven)])
        lower = np.repeat([-1.0, 0.0], [friction, len(driven)])
        upper = np.repeat([1.0, np.inf], [friction, len(driven)])
        size = np.repeat([max(presliding, self.length_scale), self.length_scale], [friction, len(driven)])
        rest = np.concatenate((history.passed, driver.values[driven]))

        def look(unknowns: Array) -> _Evaluation:
            # a trial may diverge; its merit is then not finite, and it is rejected
            with np.errstate(over="ignore", invalid="ignore"):
                state, residual, jacobian, equations = self.evaluate(unknowns, forces, driver)
            choice = gap = np.zeros(0)
            if equations is not None and len(rest):
                creep = presliding * (state.mobilisation - history.mobilisation)
                gap = np.concatenate((creep, np.zeros(len(driven)))) - (equations.passed - rest)
                gap[friction:] *= -1.0
                choice = np.concatenate((state.mobilisation, state.tensions[self.tendons.first[driven]]))
                natural = natural_residual(gap / size, choice / scale, lower / scale, upper / scale)
                every = np.concatenate((residual, natural))
            else:
                every = residual
            worst = float(np.max(np.abs(every), initial=0.0))
            return _Evaluation(
                replace(state, residual=worst),
                residual,
                jacobian,
                equations,
                gap,
                choice,
                float(np.linalg.norm(every)),
            )

        now = look(x)
        merits = [now.merit]
        for iteration in range(1, self.settings.max_iterations + 1):
            step = self._newton_step(now, presliding, lower, upper)
            if step is None:
                return Attempt(now.state, False, iteration)
            share = self._longest_share(step)
            for _ in range(8):
                trial = x + share * step
                new = look(trial)
                if np.isfinite(new.merit) and (
                    new.merit <= (1.0 - 1e-3 * share) * max(merits[-_MEMORY:])
                    or new.state.residual <= self.settings.tolerance
                ):
                    break
                share *= 0.5
            else:
                return Attempt(now.state, now.state.residual <= self.settings.tolerance, iteration)
            x, now = trial, new
            merits.append(now.merit)
            if now.state.residual <= self.settings.tolerance:
                return Attempt(now.state, True, iteration)
        return Attempt(now.state, False, self.settings.max_iterations)

    def _newton_step(self, now: _Evaluation, presliding: float, lower: Array, upper: Array) -> Array | None:
        """Change of all unknowns; None where the equations are singular."""
        smooth = self.smooth
        columns = np.concatenate((-now.residual[:, None], -now.jacobian[:, smooth:]), axis=1)
        try:
            solved = np.asarray(np.linalg.solve(now.jacobian[:, :smooth], columns), dtype=float)
        except np.linalg.LinAlgError:
            return None
        if not np.all(np.isfinite(solved)):
            return None
        if now.equations is None or not len(now.gap):
            return solved[:, 0]
        e, m, friction = now.equations, now.equations.passed_by_rod.shape[1], self.tendons.n_friction
        moved = -(e.passed_by_rod @ solved[:m] + e.passed_by_tension @ solved[self.rod_size :])
        moved[friction:] *= -1.0
        matrix = moved[:, 1:]
        matrix[np.arange(friction), np.arange(friction)] += presliding
        offset = now.gap + moved[:, 0] - matrix @ now.choice
        change = solve_box(matrix, offset, now.choice, lower, upper) - now.choice
        return np.concatenate((solved[:, 0] + solved[:, 1:] @ change, change[:friction]))


@dataclass(frozen=True)
class _Evaluation:
    """Equations, derivatives and residual at one set of unknowns."""

    state: State
    residual: Array
    jacobian: Array
    equations: TendonEquations | None
    gap: Array
    choice: Array
    merit: float

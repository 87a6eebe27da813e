"""Quasi-static solver: Newton in strain space over Exudyn's residual and Jacobian.

Residual and Jacobian of the whole scene come from Exudyn. Every beam node is taken in body-frame increments; an
increment of the nodes becomes an increment of the elements' strains, and the poses are rebuilt from the base by
exact exponentials. Everything else in the scene keeps its ordinary additive update. Derivation and figures:
documentation, page "Theory".
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import exudyn as exu
import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag

from tdcr_fe.elements.actuation import TendonActuation
from tdcr_fe.elements.backbone import chain_poses, relative_twists, twist_increments
from tdcr_fe.elements.complementarity import solve_box
from tdcr_fe.elements.friction import FrictionState
from tdcr_fe.elements.hooks import SceneHooks
from tdcr_fe.elements.poses import euler_parameters_of_rotation, euler_rate_matrix, exp_se3

Array = NDArray[np.float64]


@dataclass(frozen=True)
class SolverSettings:
    """Numerics of the quasi-static solver; physics has no place here.

    Attributes
    ----------
    tolerance : float
        Largest unbalanced force or moment over the scale of the forces at work [1].
    step_tolerance : float
        A Newton step that moves no node by more than this share of the length, and turns none by more than
        this angle, ends the iteration too [1, rad].
    max_iterations : int
        Newton iterations of one attempt.
    max_turn : float
        Largest change of an element's rotation in one iteration [rad].
    path_tolerance : float
        With friction the answer depends on the path; substeps are halved until halving changes no node by
        more than this share of the backbone's length [1].
    min_substep : float
        Smallest substep tried, as a share of the load step [1].
    presliding : float
        Distance that a tendon creeps through a hole from rest to full friction [m].
    """

    tolerance: float = 1e-8
    step_tolerance: float = 1e-10
    max_iterations: int = 20
    max_turn: float = 0.5
    path_tolerance: float = 2e-5
    min_substep: float = 1.0 / 1024.0
    presliding: float = 1e-6


class NotConverged(Exception):
    """Newton did not converge; says the residual reached and what to try."""

    def __init__(self, reason: str, residual: float, iterations: int) -> None:
        super().__init__(reason)
        self.residual = residual
        self.iterations = iterations


@dataclass
class Snapshot:
    """A state that the solver can go back to."""

    coordinates: Array
    multipliers: Array
    twists: list[Array]
    roots: list[tuple[Array, Array]]
    tensions: list[Array]
    histories: list[FrictionState]
    mobilisations: list[Array]


@dataclass(frozen=True)
class NewtonReport:
    """How one Newton solve went.

    Attributes
    ----------
    iterations : int
        Linear solves.
    residual : float
        Largest unbalanced force over its scale at the end [1].
    residuals : tuple of float
        Before each iteration, and at the end.
    """

    iterations: int
    residual: float
    residuals: tuple[float, ...] = ()


def _turns(load: dict[str, Any]) -> bool:
    """Whether a load of Exudyn changes with the configuration of the node it acts on."""
    return load["loadType"] != "MassProportional" and not (
        load["loadType"] == "ForceVector" and not load["bodyFixed"]
    )


class StrainSpaceSolver:
    """Newton in strain space for all robots in one system.

    Parameters
    ----------
    mbs
        An assembled system.
    settings
        Numerics.
    """

    def __init__(self, mbs: exu.MainSystem, settings: SolverSettings | None = None) -> None:
        self.mbs = mbs
        self.settings = settings or SolverSettings()
        self.hooks = SceneHooks.of(mbs)
        self.hooks.adopt()
        self.robots: list[TendonActuation] = self.hooks.actuations
        if not self.robots:
            raise ValueError("no robot in this system; add one with CreateTDCR before solving")
        if not mbs.systemIsConsistent:
            raise ValueError("the system is not assembled; call mbs.Assemble() before solving")
        exudyn_settings = exu.SimulationSettings()
        exudyn_settings.solution.file.write = False
        exudyn_settings.solution.sensors.active = False
        exudyn_settings.staticSolver.verboseMode = 0
        self._exudyn_settings = exudyn_settings
        self._kernel = exu.MainSolverStatic()
        data = mbs.systemData
        start = np.array(data.GetODE2Coordinates())
        multipliers = np.array(data.GetAECoordinates())
        post = mbs.GetPostStepUserFunction()
        mbs.SetPostStepUserFunction(0)
        if not self._kernel.InitializeSolver(mbs, exudyn_settings):
            raise RuntimeError("Exudyn could not initialise its static solver for this system")
        mbs.SetPostStepUserFunction(self.hooks._own["PostStep"] if post else 0)
        self.hooks.adopt()
        data.SetODE2Coordinates(start)
        if multipliers.size:
            data.SetAECoordinates(multipliers)
        self._number_unknowns()
        self.read_scene()

    # ------------------------------------------------------------------ unknowns

    def _number_unknowns(self) -> None:
        """Sort Exudyn's unknowns: beam nodes, their norm constraints (which drop out), everything else."""
        data, kernel = self.mbs.systemData, self._kernel
        n2, n1, na = kernel.GetODE2size(), kernel.GetODE1size(), kernel.GetAEsize()
        if n1:
            raise ValueError(
                "the scene has first-order (ODE1) states, which the quasi-static solver does not solve; "
                "use mbs.SolveDynamic, or leave these items out"
            )
        self._n2, self._na = n2, na
        for robot in self.robots:
            robot.forget_coordinates()
        self._beam = np.concatenate([r.coordinates for r in self.robots])
        norms = []
        for robot in self.robots:
            for node in robot.nodes:
                norms += [n2 + i for i in data.GetNodeLTGAE(node)]
        taken = np.zeros(n2 + na, dtype=bool)
        taken[self._beam.ravel()] = True
        taken[norms] = True
        self._other = np.flatnonzero(~taken)
        self._other2 = self._other[self._other < n2]
        self._other_multipliers = self._other[self._other >= n2] - n2
        self._order = np.concatenate((self._beam.ravel(), self._other))
        self._nodes = len(self._beam)
        ends = np.cumsum([len(r.nodes) for r in self.robots])
        self._slices = [slice(int(e) - len(r.nodes), int(e)) for e, r in zip(ends, self.robots, strict=True)]
        self._reference = np.array(data.GetODE2Coordinates(exu.ConfigurationType.Reference))
        self._scale_length = max(float(r.mesh.arc_lengths[-1]) for r in self.robots)
        self._floor_force = min(
            float(np.min(r.mesh.stiffness[:, 5])) / float(r.mesh.arc_lengths[-1]) ** 2 for r in self.robots
        )
        # Forces fixed in the world have no derivative at a node; all other loads may have one.
        self._loads_jacobian = any(_turns(self.mbs.GetLoad(i)) for i in range(data.NumberOfLoads()))

    def read_scene(self) -> None:
        """Take the configuration that the scene is in now."""
        self.twists: list[Array] = []
        self.roots: list[tuple[Array, Array]] = []
        data = self.mbs.systemData
        self._coordinates = np.array(data.GetODE2Coordinates())
        self._multipliers = np.array(data.GetAECoordinates())
        for robot in self.robots:
            p, r, _ = robot.scene_poses()
            self.twists.append(relative_twists(p, r))
            self.roots.append((p[0], r[0]))
        self._tension = [r.base_tension.copy() for r in self.robots]
        self._mobilisation = [r.state.mobilisation.copy() for r in self.robots]
        self._start: list[Array] | None = None
        self._iteration = 0
        self._rebuild()

    @property
    def length(self) -> float:
        """Length of the longest backbone [m]."""
        return self._scale_length

    def positions(self, robot: int | None = None) -> Array:
        """Positions of the nodes of one robot, or of all [m], shape (N, 3)."""
        return self._positions if robot is None else self._poses[robot][0]

    def rotations(self, robot: int) -> Array:
        """Rotations of the nodes of one robot, in beam axes, shape (N, 3, 3)."""
        return self._poses[robot][1]

    def _rebuild(self) -> None:
        """Poses of all beam nodes from base and strains, and their coordinates in Exudyn."""
        self._poses = [
            chain_poses(p, r, twists) for (p, r), twists in zip(self.roots, self.twists, strict=True)
        ]
        positions = np.concatenate([p for p, _ in self._poses])
        rotations = np.concatenate([r for _, r in self._poses])
        parameters = euler_parameters_of_rotation(rotations)
        before = self._coordinates[self._beam[:, 3:]] + self._reference[self._beam[:, 3:]]
        parameters *= np.where(np.einsum("ni,ni->n", before, parameters) < 0.0, -1.0, 1.0)[:, None]
        self._positions, self._rotations, self._parameters = positions, rotations, parameters
        total = np.concatenate((positions, parameters), axis=1)
        self._coordinates[self._beam] = total - self._reference[self._beam]

    def _write_scene(self) -> None:
        self.mbs.systemData.SetODE2Coordinates(self._coordinates)
        if self._na:
            self.mbs.systemData.SetAECoordinates(self._multipliers)

    # ------------------------------------------------------------------ states

    def snapshot(self) -> Snapshot:
        """The present state, history included."""
        return Snapshot(
            self._coordinates.copy(),
            self._multipliers.copy(),
            list(self.twists),
            list(self.roots),
            [r.base_tension.copy() for r in self.robots],
            [r.state for r in self.robots],
            [x.copy() for x in self._mobilisation],
        )

    def restore(self, snapshot: Snapshot) -> None:
        """Go back to a state."""
        self._coordinates = snapshot.coordinates.copy()
        self._multipliers = snapshot.multipliers.copy()
        self.twists, self.roots = list(snapshot.twists), list(snapshot.roots)
        for robot, tension, state in zip(self.robots, snapshot.tensions, snapshot.histories, strict=True):
            robot.base_tension, robot.state = tension.copy(), state
        self._tension = [x.copy() for x in snapshot.tensions]
        self._mobilisation = [x.copy() for x in snapshot.mobilisations]
        self._rebuild()

    def guess(self, snapshot: Snapshot) -> None:
        """Take the unknowns of another run as the start of the next solve, keeping the present history.

        Does nothing where that run had another mesh.
        """
        if [len(t) for t in snapshot.twists] != [len(t) for t in self.twists]:
            return
        if len(snapshot.coordinates) != len(self._coordinates):
            return
        self._coordinates = snapshot.coordinates.copy()
        self._multipliers = snapshot.multipliers.copy()
        self.twists, self.roots = list(snapshot.twists), list(snapshot.roots)
        for robot, tension in zip(self.robots, snapshot.tensions, strict=True):
            robot.base_tension = tension.copy()
        self._start = [x.copy() for x in snapshot.mobilisations]
        self._rebuild()

    def refresh(self) -> None:
        """Bring forces and fields to a restored state without solving."""
        self._update_forces()

    def finish(self) -> None:
        """Leave the solved state in the scene, as current and as initial configuration."""
        self._update_forces()
        data = self.mbs.systemData
        data.SetODE2Coordinates(self._coordinates, exu.ConfigurationType.Initial)
        if self._na:
            data.SetAECoordinates(self._multipliers, exu.ConfigurationType.Initial)

    # ------------------------------------------------------------------ Newton

    def _update_forces(self, t: float = 0.0) -> None:
        """Bring the scene and all its forces to the present unknowns."""
        self._write_scene()
        user = self.hooks.user_function("PreNewtonResidual")
        if user is not None:
            user(self.mbs, t, self._iteration, 0)
        for i, (robot, (p, r), twists, tension) in enumerate(
            zip(self.robots, self._poses, self.twists, self._tension, strict=True)
        ):
            robot.update_mixed(p, r, tension, self._mobilisation[i], twists)
            robot.apply()

    def _residual(self) -> Array:
        """Exudyn's residual with the beam nodes in body-frame wrenches."""
        self._kernel.ComputeNewtonResidual(self.mbs, self._exudyn_settings)
        r = self._kernel.GetSystemResidual()
        self._maps = euler_rate_matrix(self._parameters)
        at_nodes = r[self._beam]
        force = (at_nodes[:, None, :3] @ self._rotations)[:, 0]
        moment = (at_nodes[:, None, 3:] @ self._maps)[:, 0]
        return np.concatenate((np.concatenate((force, moment), axis=1).ravel(), r[self._other]))

    def _jacobian(self, t: float) -> Array:
        """Exudyn's Jacobian in the same terms, with what the tendons add."""
        kernel, mbs = self._kernel, self.mbs
        kernel.ComputeJacobianODE2RHS(mbs, computeLoadsJacobian=int(self._loads_jacobian))
        if self._na:
            kernel.ComputeJacobianAE(mbs)
        j = kernel.GetSystemJacobian()
        extra = self.hooks.user_jacobian(t)
        if extra is not None:
            j[: extra.shape[0], : extra.shape[1]] += extra
        j = j[self._order[:, None], self._order]
        n, size = self._nodes, len(self._order)
        turn = self._rotations
        wide = j[: 7 * n].reshape(n, 7, size)
        rows = np.concatenate(
            (np.swapaxes(turn, 1, 2) @ wide[:, :3], np.swapaxes(self._maps, 1, 2) @ wide[:, 3:]), axis=1
        )
        tall = np.concatenate((rows.reshape(6 * n, size), j[7 * n :]))
        count = len(tall)
        cols = tall[:, : 7 * n].reshape(count, n, 7).transpose(1, 0, 2)
        both = np.concatenate((cols[:, :, :3] @ turn, cols[:, :, 3:] @ self._maps), axis=2)
        k = np.concatenate((both.transpose(1, 0, 2).reshape(count, 6 * n), tall[:, 7 * n :]), axis=1)
        for robot, part in zip(self.robots, self._slices, strict=True):
            i = slice(6 * part.start, 6 * part.stop)
            k[i, i] += robot.tangent(self._loads_jacobian)
        return k

    def _newton_step(self, t: float, r: Array) -> Array:
        """Change of all unknowns: scene, then driven tensions, then mobilisations of the holes.

        Equilibrium is linear in the step, the holes are not: each sticks or slips. Their conditions, with
        everything else eliminated, are a small complementarity problem.
        """
        k = self._jacobian(t)
        count = len(k)
        columns, rows, corner, right = [], [], [], []
        mixed = [robot.law.has_friction for robot in self.robots]
        hole_columns, base_by_hole = [], []
        for robot, part, goal, friction in zip(self.robots, self._slices, self._goal, mixed, strict=True):
            place = slice(6 * part.start, 6 * part.stop)
            driven = np.flatnonzero(robot.by_displacement)
            if driven.size:
                column, row = np.zeros((count, driven.size)), np.zeros((driven.size, count))
                column[place] = robot.base_tension_columns()[:, driven]
                row[:, place] = robot.base_slip_rows()[driven]
                gap = robot.field.base_slip[driven] - goal[driven]
                # A tendon is taut where its tension, or else the pull it lacks, is positive.
                slack = robot.base_tension[driven] - gap * self._slack_stiffness <= 0.0
                row[slack] = 0.0
                columns.append(column)
                rows.append(row)
                corner.append(np.where(slack, 1.0, robot.base_slip_by_base()[driven]))
                right.append(np.where(slack, robot.base_tension[driven], gap))
            else:
                slack = np.zeros(0, dtype=bool)
            if friction:
                column = np.zeros((count, int(np.count_nonzero(robot.law.holding))))
                column[place] = robot.mobilisation_columns()
                hole_columns.append(column)
                by_hole = robot.base_slip_by_mobilisation()[driven]
                by_hole[slack] = 0.0
                base_by_hole.append(by_hole)
        if columns:
            column, row = np.concatenate(columns, axis=1), np.concatenate(rows)
            k = np.block([[k, column], [row, np.diag(np.concatenate(corner))]])
            r = np.concatenate((r, *right))
        if not any(mixed):
            return np.linalg.solve(k, -r)
        holes = np.concatenate(hole_columns, axis=1)
        if columns:
            holes = np.concatenate((holes, block_diag(*base_by_hole)))
        solved = np.linalg.solve(k, -np.concatenate((r[:, None], holes), axis=1))
        return self._with_holes(solved[:, 0], solved[:, 1:], mixed)

    def _with_holes(self, alone: Array, by_hole: Array, mixed: list[bool]) -> Array:
        """The step where the holes are solved too; ``alone`` is the step with all mobilisations kept."""
        missing, slip_by_step, own, before = [], [], [], []
        at = 6 * self._nodes + len(self._other)
        delta = self.settings.presliding
        for i, (robot, part) in enumerate(zip(self.robots, self._slices, strict=True)):
            driven = np.flatnonzero(robot.by_displacement)
            place = slice(at, at + driven.size)
            at += driven.size
            if not mixed[i]:
                continue
            keep, state, s = robot.law.holding, robot.state, self._mobilisation[i]
            by_nodes, by_base, block = robot.slip_rows()
            row = np.zeros((len(by_nodes), len(alone)))
            row[:, 6 * part.start : 6 * part.stop] = by_nodes
            row[:, place] = by_base[:, driven]
            slip_by_step.append(row)
            own.append(block)
            missing.append((robot.field.slip - state.slip - delta * (s - state.mobilisation))[keep])
            before.append(s[keep])
        rows, s = np.concatenate(slip_by_step), np.concatenate(before)
        matrix = delta * np.eye(len(s)) - rows @ by_hole - block_diag(*own)
        right = np.concatenate(missing) + rows @ alone + matrix @ s
        new, self._pivoted = solve_box(matrix, right, s)
        return np.concatenate((alone + by_hole @ (new - s), new - s))

    def _hole_error(self) -> float:
        """Largest distance of any mobilisation from what its slip leads to [1]."""
        worst = 0.0
        for robot, s in zip(self.robots, self._mobilisation, strict=True):
            if robot.law.has_friction:
                trial = robot.law.follow(robot.field.slip, robot.state, self.settings.presliding)
                miss = np.where(robot.law.holding, np.clip(trial, -1.0, 1.0) - s, 0.0)
                worst = max(worst, float(np.max(np.abs(miss))))
        return worst

    def _force_scale(self) -> float:
        largest = max((float(np.max(t, initial=0.0)) for t in self._tension), default=0.0)
        return largest + self._floor_force + self._load_scale

    def _measure(self, r: Array) -> float:
        """Largest unbalanced force or moment over its scale."""
        nodes = r[: 6 * self._nodes].reshape(-1, 6)
        force = self._force_scale()
        worst = max(
            float(np.max(np.abs(nodes[:, :3]))) / force,
            float(np.max(np.abs(nodes[:, 3:]))) / (force * 0.02 * self._scale_length),
        )
        rest = r[6 * self._nodes :]
        if rest.size:
            forces, gaps = rest[: len(self._other2)], rest[len(self._other2) :]
            worst = max(
                worst,
                float(np.max(np.abs(forces), initial=0.0)) / force,
                float(np.max(np.abs(gaps), initial=0.0)) / self._scale_length,
            )
        for robot, goal in zip(self.robots, self._goal, strict=True):
            driven = robot.by_displacement
            if np.any(driven):
                gap = robot.field.base_slip - goal
                tension = robot.base_tension
                # Taut: the displacement is met. Slack: the base has let out more than the tendon needs.
                missed = np.where(tension > 0.0, np.abs(gap), np.maximum(-gap, 0.0))
                worst = max(worst, float(np.max(missed[driven])) / self._scale_length)
        return worst

    def newton(self, goal: Sequence[Array], t: float = 0.0, load_scale: float = 0.0) -> NewtonReport:
        """Solve for equilibrium at given tensions and displacements, from the present state.

        History is not committed. The present unknowns are changed even where this fails; take a `snapshot`
        before.

        Parameters
        ----------
        goal
            By robot, tensions [N] and displacements [m] at the base, shape (m,).
        t
            Time that user functions are given [s].
        load_scale
            Size of the applied loads, for the scale of the residual [N].

        Raises
        ------
        NotConverged
        """
        s = self.settings
        self._goal = list(goal)
        self._load_scale = load_scale
        self._slack_stiffness = 10.0 * self._floor_force / self._scale_length
        self._tension = [
            np.where(r.by_displacement, r.base_tension, g) for r, g in zip(self.robots, goal, strict=True)
        ]
        self._mobilisation = self._start or [r.state.mobilisation for r in self.robots]
        self._start = None
        history: list[float] = []
        for iteration in range(s.max_iterations + 1):
            self._iteration = iteration
            self._update_forces(t)
            r = self._residual()
            size = self._measure(r)
            history.append(size)
            if not np.isfinite(size):
                raise NotConverged("the residual is not a number", size, iteration)
            if size <= s.tolerance and self._hole_error() <= 1e-4:
                return NewtonReport(iteration, size, tuple(history))
            if iteration == s.max_iterations:
                break
            try:
                step = self._newton_step(t, r)
            except np.linalg.LinAlgError:
                raise NotConverged(
                    "the tangent is singular: something in the scene moves freely", size, iteration
                ) from None
            moved = self._step_size(step)
            self._advance(step)
            if moved <= s.step_tolerance and self._hole_error() <= 1e-4:
                # Nothing moves any more: what is left of the residual is round-off of very stiff parts.
                self._update_forces(t)
                size = self._measure(self._residual())
                return NewtonReport(iteration + 1, size, (*history, size))
        raise NotConverged(
            f"no equilibrium after {s.max_iterations} iterations, residual {size:.1e}", size, s.max_iterations
        )

    def _step_size(self, step: Array) -> float:
        """Largest displacement over the backbone's length, or rotation, of any node in a step [1]."""
        nodes = np.abs(step[: 6 * self._nodes].reshape(-1, 6))
        return max(float(np.max(nodes[:, :3])) / self._scale_length, float(np.max(nodes[:, 3:])))

    def _advance(self, step: Array) -> None:
        """Move all unknowns by a Newton step, no element turning more than allowed."""
        n = self._nodes
        nodes = step[: 6 * n].reshape(n, 6)
        changes = [twist_increments(t, nodes[p]) for t, p in zip(self.twists, self._slices, strict=True)]
        turn = max(float(np.max(np.abs(c[:, 3:]))) for c in changes)
        factor = min(1.0, self.settings.max_turn / turn) if turn > 0.0 else 1.0
        for i, (change, part) in enumerate(zip(changes, self._slices, strict=True)):
            self.twists[i] = self.twists[i] + factor * change
            first = factor * nodes[part.start]
            if np.any(first):
                p, r = self.roots[i]
                dr, dp = exp_se3(first)
                self.roots[i] = (p + r @ dp, r @ dr)
        rest = factor * step[6 * n : 6 * n + len(self._other)]
        n2 = len(self._other2)
        self._coordinates[self._other2] += rest[:n2]
        self._multipliers[self._other_multipliers] += rest[n2:]
        at = 6 * n + len(self._other)
        for i, robot in enumerate(self.robots):
            driven = np.flatnonzero(robot.by_displacement)
            if driven.size:
                tension = self._tension[i].copy()
                tension[driven] = np.maximum(tension[driven] + factor * step[at : at + driven.size], 0.0)
                at += driven.size
                self._tension[i] = tension
        for i, robot in enumerate(self.robots):
            law = robot.law
            if not law.has_friction:
                continue
            s = self._mobilisation[i].copy()
            count = int(np.count_nonzero(law.holding))
            s[law.holding] = np.clip(s[law.holding] + factor * step[at : at + count], -1.0, 1.0)
            at += count
            self._mobilisation[i] = s
        self._rebuild()

    def commit(self) -> None:
        """Take the present holes' states as history."""
        for robot in self.robots:
            robot.commit()

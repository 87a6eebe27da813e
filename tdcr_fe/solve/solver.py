"""Quasi-static solver: Newton in strain space over Exudyn's residual and Jacobian.

Residual and Jacobian of the whole scene come from Exudyn. Every beam node is taken in body-frame increments; an
increment of the nodes becomes an increment of the elements' strains, and the poses are rebuilt from the base by
exact exponentials. Everything else in the scene keeps its ordinary additive update. Derivation and figures:
documentation, page "Theory".
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import isfinite
from typing import Any

import exudyn as exu
import numpy as np
from numpy.typing import NDArray
from scipy.linalg.lapack import dgetrf, dgetrs

from tdcr_fe.elements.actuation import TendonActuation
from tdcr_fe.elements.backbone import ElementChain, NodeBlocks
from tdcr_fe.elements.complementarity import solve_box
from tdcr_fe.elements.friction import FrictionState
from tdcr_fe.elements.hooks import SceneHooks
from tdcr_fe.model.settings import SolverSettings
from tdcr_fe.solve.configuration import Configuration, Place
from tdcr_fe.solve.reduction import BodyFrameReduction

Array = NDArray[np.float64]
_NONE = np.zeros(0, dtype=bool)
_EYE6 = np.eye(6)

#: A step with the tangent of the iteration before leaves about this times the residual, per turn of the elements that
#: the tangent has seen since [1/rad]; a prediction that met the tolerance in all of 216 steps of three routings.
_SPOILT = 3.0


class NotConverged(Exception):
    """Newton did not converge; says the residual reached and what to try."""

    def __init__(self, reason: str, residual: float, iterations: int) -> None:
        super().__init__(reason)
        self.residual = residual
        self.iterations = iterations


@dataclass
class Snapshot:
    """A state that the solver can go back to."""

    place: Place
    tensions: list[Array]
    histories: list[FrictionState]
    mobilisations: list[Array]
    prescribed: list[Array]


@dataclass(frozen=True)
class _Part:
    """Where one robot stands among the unknowns: its nodes, its driven tensions, its mobilisations."""

    index: int
    robot: TendonActuation
    driven: NDArray[np.int_]
    nodes: slice
    tensions: slice
    holes: slice

    @property
    def holds(self) -> bool:
        """Whether friction acts in this robot."""
        return self.robot.law.has_friction


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
        #: Whether bases clamped to ground are treated as any other joint.
        self._released = False
        data = mbs.systemData
        start = np.array(data.GetODE2Coordinates())
        multipliers = np.array(data.GetAECoordinates())
        post = mbs.GetPostStepUserFunction()
        mbs.SetPostStepUserFunction(0)
        # Exudyn's advice on large systems is about its own solvers.
        spoken = exu.config.suppressWarnings
        exu.config.suppressWarnings = True
        try:
            if not self._kernel.InitializeSolver(mbs, exudyn_settings):
                raise RuntimeError("Exudyn could not initialise its static solver for this system")
        finally:
            exu.config.suppressWarnings = spoken
        mbs.SetPostStepUserFunction(self.hooks._own["PostStep"] if post else 0)
        self.hooks.adopt()
        data.SetODE2Coordinates(start)
        if multipliers.size:
            data.SetAECoordinates(multipliers)
        self._tension = [r.base_tension.copy() for r in self.robots]
        self._mobilisation = [r.state.mobilisation.copy() for r in self.robots]
        self._goal: list[Array] = [r.prescribed for r in self.robots]
        self._start: list[Array] | None = None
        self._iteration = 0
        self._presliding, self._damping = self.settings.presliding, 0.0
        self._factors: tuple[Array, Array] | None = None
        self._sign = 0
        self._turn = 0.0
        #: Sign of the tangent where the robot is stable, as far as known.
        self.stable_sign = 0
        self._number_unknowns()

    # ------------------------------------------------------------------ unknowns

    def _number_unknowns(self) -> None:
        """Sort Exudyn's unknowns: beam nodes, their norm constraints (which drop out), everything else."""
        data, kernel = self.mbs.systemData, self._kernel
        if kernel.GetODE1size():
            raise ValueError(
                "the scene has first-order (ODE1) states, which the quasi-static solver does not solve; "
                "use mbs.SolveDynamic, or leave these items out"
            )
        for robot in self.robots:
            robot.forget_coordinates()
        norms = [i for robot in self.robots for node in robot.nodes for i in data.GetNodeLTGAE(node)]
        self._clamps = {} if self._released else self._find_clamps()
        dropped = [*norms, *(i for joint in self._clamps.values() for i in joint)]
        self._reduction = BodyFrameReduction(
            self.mbs, np.concatenate([r.coordinates for r in self.robots]), dropped
        )
        self._blocks_of: Array | None = None
        self._numbered: tuple[Any, ...] = ()
        #: Where the scene is.
        self.now = Configuration(self.mbs, self.robots, self._reduction, list(self._clamps))
        starts = [6 * self.now.slices[i].start for i in self._clamps]
        self._bases = [slice(k, k + 6) for k in starts]
        self._current = False
        self._scale_length = max(float(r.mesh.arc_lengths[-1]) for r in self.robots)
        # Moments count by a lever of a fiftieth of the length, gaps in joints by the length.
        nodes = np.tile(np.repeat((1.0, 50.0 / self._scale_length), 3), self._reduction.nodes)
        other = np.ones(len(self._reduction.other_coordinates))
        gaps = np.full(len(self._reduction.other_multipliers), 1.0 / self._scale_length)
        self._weights = np.concatenate((nodes, other, gaps))
        self._forces = len(nodes) + len(other)
        self._floor_force = min(
            float(np.min(r.mesh.stiffness[:, 5])) / float(r.mesh.arc_lengths[-1]) ** 2 for r in self.robots
        )
        #: By clamped robot, from the wrench on its base to the joint's multipliers that cause it, shape (6, 6).
        self._reactions: dict[int, Array] = {}
        self._contact, self._checked = self.mbs.NumberOfGeneralContacts() > 0, False
        # Forces fixed in the world have no derivative at a node; all other loads may have one.
        self._loads_jacobian = any(_turns(self.mbs.GetLoad(i)) for i in range(data.NumberOfLoads()))

    def _find_clamps(self) -> dict[int, NDArray[np.int_]]:
        """By robot whose base is clamped to ground, the numbers of the joint's multipliers."""
        found = {}
        for i, robot in enumerate(self.robots):
            if robot.clamp is None:
                continue
            joint = self.mbs.GetObject(robot.clamp.joint)
            if joint["activeConnector"] and all(joint["constrainedAxes"]) and not joint["offsetUserFunction"]:
                found[i] = np.array(self.mbs.systemData.GetObjectLTGAE(robot.clamp.joint), dtype=int)
        return found

    @property
    def length(self) -> float:
        """Length of the longest backbone [m]."""
        return self._scale_length

    def positions(self, robot: int | None = None) -> Array:
        """Positions of the nodes of one robot, or of all [m], shape (N, 3)."""
        return self.now.positions if robot is None else self.now.poses[robot][0]

    def rotations(self, robot: int) -> Array:
        """Rotations of the nodes of one robot, in beam axes, shape (N, 3, 3)."""
        return self.now.poses[robot][1]

    # ------------------------------------------------------------------ states

    def snapshot(self) -> Snapshot:
        """The present state, history included."""
        return Snapshot(
            self.now.place(),
            [r.base_tension.copy() for r in self.robots],
            [r.state for r in self.robots],
            [x.copy() for x in self._mobilisation],
            [r.prescribed for r in self.robots],
        )

    def restore(self, snapshot: Snapshot) -> None:
        """Go back to a state."""
        self.now.go(snapshot.place)
        self._current = False
        for robot, tension, state, prescribed in zip(
            self.robots, snapshot.tensions, snapshot.histories, snapshot.prescribed, strict=True
        ):
            robot.base_tension, robot.state, robot.prescribed = tension.copy(), state, prescribed
        self._tension = [x.copy() for x in snapshot.tensions]
        self._mobilisation = [x.copy() for x in snapshot.mobilisations]

    def guess(self, snapshot: Snapshot) -> None:
        """Take the unknowns of another run as the start of the next solve, keeping the present history.

        Does nothing where that run had another mesh.
        """
        if not self.now.fits(snapshot.place):
            return
        self.now.go(snapshot.place)
        self._current = False
        for robot, tension in zip(self.robots, snapshot.tensions, strict=True):
            robot.base_tension = tension.copy()
        self._start = [x.copy() for x in snapshot.mobilisations]

    def turn_since(self, snapshot: Snapshot) -> float:
        """Largest rotation of any node since a state [rad]."""
        return self.now.turn_since(snapshot.place)

    def refresh(self) -> None:
        """Bring forces and fields to a restored state without solving."""
        self._update_forces()

    def finish(self) -> None:
        """Leave the solved state in the scene, as current and as initial configuration."""
        if not self._current:
            self._update_forces()
        self.now.keep()

    # ------------------------------------------------------------------ Newton

    def _update_forces(self, t: float = 0.0) -> None:
        """Bring the scene and all its forces to the present unknowns."""
        self.now.write()
        user = self.hooks.user_function("PreNewtonResidual")
        if user is not None:
            user(self.mbs, t, self._iteration, 0)
        for i, (robot, (p, r), twists, tension) in enumerate(
            zip(self.robots, self.now.poses, self.now.twists, self._tension, strict=True)
        ):
            robot.update_mixed(p, r, tension, self._mobilisation[i], twists, t)
            robot.apply()
        self._current = True

    def _residual(self) -> Array:
        """Exudyn's residual with the beam nodes in body-frame wrenches."""
        self._kernel.ComputeNewtonResidual(self.mbs, self._exudyn_settings)
        self._raw = self._kernel.GetSystemResidual()
        return self._reduction.residual(self._raw)

    def _unbalanced(self, t: float) -> Array:
        """What is not in equilibrium at the present unknowns."""
        self._update_forces(t)
        r = self._residual()
        # What acts on clamped bases their joints bear, whatever it is.
        self._on_bases = []
        for base in self._bases:
            self._on_bases.append(r[base].copy())
            r[base] = 0.0
        return r

    def _clamps_hold(self) -> bool:
        """Whether the joints of clamped bases are closed where the bases are kept."""
        n2 = self._reduction.n2
        gaps = [np.abs(self._raw[n2 + joint]).max() for joint in self._clamps.values()]
        return max(gaps, default=0.0) <= 1e-9 * self._scale_length

    def _release(self) -> None:
        """Treat clamped bases as any other joint from now on: somebody has moved what they sit on."""
        self._released = True
        self._number_unknowns()

    def _react(self, t: float) -> None:
        """Give the joints of clamped bases the forces that keep them, after everything else is in equilibrium."""
        if not self._clamps:
            return
        if not self._reactions:
            self._jacobian(t)
        for (i, joint), acting in zip(self._clamps.items(), self._on_bases, strict=True):
            self.now.multipliers[joint] -= self._reactions[i] @ acting
        self.now.write_multipliers()

    def _jacobian(self, t: float) -> Array:
        """Exudyn's Jacobian in the same terms, with what the tendons add."""
        kernel, mbs = self._kernel, self.mbs
        kernel.ComputeJacobianODE2RHS(mbs, computeLoadsJacobian=int(self._loads_jacobian))
        unknown = len(self._reactions) < len(self._clamps)
        if len(self._reduction.other_multipliers) or unknown:
            kernel.ComputeJacobianAE(mbs)
        j = kernel.GetSystemJacobian()
        extra = self.hooks.user_jacobian(t)
        if extra is not None:
            j[: extra.shape[0], : extra.shape[1]] += extra
        if unknown:
            for number, joint in self._clamps.items():
                by_joint = self._reduction.node_rows(j, self.now.slices[number].start, joint)
                self._reactions[number] = np.asarray(np.linalg.inv(by_joint), dtype=float)
        # Contact, and what the user adds, may couple nodes at any time; all else does from the beginning.
        changing = self._contact or extra is not None
        k = self._reduction.jacobian(j, check=not self._checked or (changing and self._iteration == 0))
        self._checked = True
        for robot, part in zip(self.robots, self.now.slices, strict=True):
            i = slice(6 * part.start, 6 * part.stop)
            if robot.count or robot.section is not None:
                robot.add_tangent(k[i, i], self._loads_jacobian)
        return k

    def _number_parts(self) -> None:
        """Sort the unknowns: reduced scene, then tensions of driven tendons, then mobilisations."""
        which = (self._reduction.count, *(r.by_displacement.tobytes() for r in self.robots))
        if which == self._numbered:
            return
        self._numbered = which
        at = self._reduction.count
        driven = [np.flatnonzero(r.by_displacement) for r in self.robots]
        held = [int(np.count_nonzero(r.law.frictional)) for r in self.robots]
        hole = at + sum(d.size for d in driven)
        #: Number of unknowns that equilibrium is linear in.
        self._linear = hole
        self._parts: list[_Part] = []
        for i, (robot, nodes) in enumerate(zip(self.robots, self.now.slices, strict=True)):
            self._parts.append(
                _Part(
                    i,
                    robot,
                    driven[i],
                    slice(6 * nodes.start, 6 * nodes.stop),
                    slice(at, at + driven[i].size),
                    slice(hole, hole + held[i]),
                )
            )
            at += driven[i].size
            hole += held[i]
        self._mixed = hole > self._linear
        #: Whether any tendon is driven by displacement.
        self.any_driven = any(d.size for d in driven)
        self._unknowns = hole

    def _factorise(self, t: float, r: Array) -> None:
        """Factorise the tangent at a residual, with the tensions of driven tendons as further unknowns."""
        k = self._jacobian(t)
        if k is not self._blocks_of:
            self._blocks_of = k
            inside = [slice(6 * own.start, 6 * own.stop) for own in self.now.slices]
            self._blocks = [NodeBlocks(k[i, i]) for i in inside]
        for own, blocks, chain, pose in zip(
            self.now.slices, self._blocks, self.now.chains, self.now.poses, strict=True
        ):
            chain.add_unbalanced(blocks, r[6 * own.start : 6 * own.stop], *pose)
        if self._linear > len(k):
            extra = self._linear - len(k)
            k = np.pad(k, ((0, extra), (0, extra)))
        self._slack: list[NDArray[np.bool_]] = []
        for part in self._parts:
            robot, which = part.robot, part.driven
            if not which.size:
                self._slack.append(_NONE)
                continue
            gap = robot.field.base_slip[which] - self._goal[part.index][which]
            # A tendon is taut where its tension, or else the pull it lacks, is positive.
            slack = robot.base_tension[which] - gap * self._slack_stiffness <= 0.0
            self._slack.append(slack)
            k[part.nodes, part.tensions] = robot.base_tension_columns()[:, which]
            rows = robot.base_slip_rows()[which]
            rows[slack] = 0.0
            k[part.tensions, part.nodes] = rows
            k[part.tensions, part.tensions] = np.diag(np.where(slack, 1.0, robot.base_slip_by_base()[which]))
        if self._damping > 0.0:
            nodes = np.arange(6 * self._reduction.nodes)
            weight = np.tile(np.repeat((1.0 / self._scale_length**2, 1.0), 3), self._reduction.nodes)
            # Exudyn's Jacobian is that of the right-hand side: minus the stiffness.
            k[nodes, nodes] -= self._damping * weight
        for base in self._bases:
            rows = k[base]
            rows.fill(0.0)
            rows[:, base] = _EYE6
        lu, pivots, info = dgetrf(k.T, overwrite_a=True)
        if info != 0 or not isfinite(lu[-1, -1]):
            raise np.linalg.LinAlgError
        self._factors, self._sign = (lu, pivots), 0
        self._then = self.now.chains

    @property
    def tangent_sign(self) -> int:
        """Sign of the last tangent's determinant; it changes where an equilibrium loses its stability."""
        if self._factors is None:
            return 0
        if self._sign == 0:
            lu, pivots = self._factors
            # Rows that changed places, and negative pivots; both at once change nothing.
            turned = np.count_nonzero((pivots != np.arange(len(pivots))) ^ (lu.diagonal() < 0.0))
            self._sign = 1 if turned % 2 == 0 else -1
        return self._sign

    @property
    def clamped(self) -> list[int]:
        """Numbers of the robots whose base is clamped to ground."""
        return list(self._clamps)

    def factorised(self) -> tuple[tuple[Array, Array], Sequence[ElementChain]]:
        """Factors of the tangent used last, and the elements in whose frames it is; formed where there is none."""
        if self._factors is None or len(self._factors[0]) != self._linear:
            self._load_scale = 0.0
            self._factorise(0.0, self._unbalanced(0.0))
        assert self._factors is not None
        return self._factors, self._then

    def _solve_linear(self, right: Array) -> Array:
        assert self._factors is not None
        solution, _ = dgetrs(*self._factors, right, trans=1)
        return solution

    def _newton_step(self, t: float, r: Array) -> Array:
        """Change of all unknowns: scene, then driven tensions, then mobilisations of the holes.

        Equilibrium is linear in the step, the holes are not: each sticks or slips. Their conditions, with
        everything else eliminated, are a small complementarity problem. Where every hole keeps its state, which
        is the rule while loading, there is nothing to solve.

        Parameters
        ----------
        t
            Time [s].
        r
            Reduced residual.
        """
        self._factorise(t, r)
        alone = self._solve_linear(self._right_side(r))
        self._settled = True
        if not self._mixed:
            return alone
        missing, before = self._slip_missing(alone)
        settled = (np.abs(before) >= 1.0) & (before * missing >= 0.0)
        if settled.all():
            step = np.zeros(len(alone) + len(before))
            step[: len(alone)] = alone
            return step
        self._settled = False
        return self._with_holes(alone, missing, before)

    def _right_side(self, r: Array) -> Array:
        """What a step has to undo: a residual, and the gaps of driven tendons."""
        right = np.zeros(self._linear)
        np.negative(r, out=right[: len(r)])
        for part in self._parts:
            if part.driven.size:
                gap = part.robot.field.base_slip - self._goal[part.index]
                tension = part.robot.base_tension[part.driven]
                right[part.tensions] = -np.where(self._slack[part.index], tension, gap[part.driven])
        return right

    def _repeated_step(self, r: Array) -> Array:
        """A step with the tangent of the iteration before, in the frames of that; the holes keep their states."""
        step = np.zeros(self._unknowns)
        step[: self._linear] = self._solve_linear(self._right_side(r))
        return step

    def _slip_missing(self, step: Array) -> tuple[Array, Array]:
        """By how much the holes' slip would run ahead of their mobilisation [m], and the latter, shape (k,)."""
        missing, before = [], []
        for part in self._parts:
            if not part.holds:
                continue
            robot = part.robot
            base = None
            if part.driven.size:
                base = np.zeros(robot.count)
                base[part.driven] = step[part.tensions]
            keep, state, s = robot.law.frictional, robot.state, self._mobilisation[part.index]
            slip = robot.field.slip + robot.slip_change(step[part.nodes], base)
            missing.append((slip - state.slip - self._presliding * (s - state.mobilisation))[keep])
            before.append(s[keep])
        return (
            (missing[0], before[0])
            if len(missing) == 1
            else (np.concatenate(missing), np.concatenate(before))
        )

    def _with_holes(self, alone: Array, missing: Array, before: Array) -> Array:
        """The step where the holes are solved too; ``alone`` is the step with all mobilisations kept."""
        columns = np.zeros((len(alone), len(before)), order="F")
        rows = np.zeros((len(before), len(alone)))
        own = np.zeros((len(before), len(before)))
        for part in self._parts:
            if not part.holds:
                continue
            robot = part.robot
            here = slice(part.holes.start - self._linear, part.holes.stop - self._linear)
            columns[part.nodes, here] = robot.mobilisation_columns()
            by_nodes, by_tension, own[here, here] = robot.slip_rows()
            rows[here, part.nodes] = by_nodes
            if part.driven.size:
                by_base = robot.base_slip_by_mobilisation()[part.driven]
                by_base[self._slack[part.index]] = 0.0
                columns[part.tensions, here] = by_base
                rows[here, part.tensions] = by_tension[:, part.driven]
        for base in self._bases:
            columns[base] = 0.0
        by_hole = -self._solve_linear(columns)
        matrix = self._presliding * np.eye(len(before)) - rows @ by_hole - own
        new, _ = solve_box(matrix, missing + matrix @ before, before)
        return np.concatenate((alone + by_hole @ (new - before), new - before))

    def _hole_error(self) -> float:
        """Largest distance of any mobilisation from what its slip leads to [1]."""
        worst = 0.0
        for robot, s in zip(self.robots, self._mobilisation, strict=True):
            if robot.law.has_friction:
                trial = robot.law.trial_mobilisation(robot.field.slip, robot.state, self._presliding)
                miss = np.abs(trial.clip(-1.0, 1.0) - s) * robot.law.frictional
                worst = max(worst, float(miss.max()))
        return worst

    def _force_scale(self) -> float:
        largest = max((max(t.tolist(), default=0.0) for t in self._tension), default=0.0)
        return largest + self._floor_force + self._load_scale

    def _measure(self, r: Array) -> float:
        """Largest unbalanced force or moment over its scale."""
        size = np.abs(r * self._weights)
        if size.size == self._forces:
            worst = float(size.max()) / self._force_scale()
        else:
            forces, gaps = size[: self._forces], size[self._forces :]
            worst = max(float(forces.max()) / self._force_scale(), float(gaps.max()))
        for part in self._parts:
            if part.driven.size:
                gap = (part.robot.field.base_slip - self._goal[part.index])[part.driven]
                tension = part.robot.base_tension[part.driven]
                # Taut: the displacement is met. Slack: the base has let out more than the tendon needs.
                missed = np.where(tension > 0.0, np.abs(gap), np.maximum(-gap, 0.0))
                worst = max(worst, float(np.max(missed)) / self._scale_length)
        return worst

    def newton(
        self,
        goal: Sequence[Array],
        t: float = 0.0,
        load_scale: float = 0.0,
        *,
        relax: bool = False,
        presliding: float | None = None,
    ) -> NewtonReport:
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
        relax
            Follow the motion of a heavily damped robot instead of Newton's straight way: slower, and it finds
            the equilibrium that a robot falls into where it snaps through (pseudo-transient continuation; C. T.
            Kelley, D. E. Keyes, SIAM J. Numer. Anal. 35 (1998) 508-523).
        presliding
            Another presliding distance than that of the settings [m].

        Raises
        ------
        NotConverged
        """
        s = self.settings
        self._presliding = s.presliding if presliding is None else presliding
        limit = 10 * s.max_iterations if relax else s.max_iterations
        self._damping = self._floor_force * self._scale_length if relax else 0.0
        self._goal = list(goal)
        self._load_scale = load_scale
        self._slack_stiffness = 10.0 * self._floor_force / self._scale_length
        self._tension = [
            np.where(r.by_displacement, r.base_tension, g) for r, g in zip(self.robots, goal, strict=True)
        ]
        self._mobilisation = self._start or [r.state.mobilisation for r in self.robots]
        self._start = None
        self._number_parts()
        history: list[float] = []
        again = self._settled = False
        for iteration in range(limit + 1):
            self._iteration = iteration
            r = self._unbalanced(t)
            if iteration == 0 and not self._clamps_hold():
                self._release()
                self._number_parts()
                r = self._unbalanced(t)
            size = self._measure(r)
            history.append(size)
            if not isfinite(size):
                raise NotConverged("the residual is not a number", size, iteration)
            if size <= s.tolerance and self._hole_error() <= 1e-4:
                self._react(t)
                return NewtonReport(iteration, size, tuple(history))
            if iteration == limit:
                break
            # Where little is left to do, the tangent at hand does it; should it not, the next step has its own.
            again = self._settled and not (again or relax) and size * _SPOILT * self._turn < s.tolerance
            try:
                if again:
                    step = self._repeated_step(r)
                elif relax:
                    step = self._damped_step(t, r)
                else:
                    step = self._newton_step(t, r)
            except np.linalg.LinAlgError:
                raise NotConverged(
                    "the tangent is singular: something in the scene moves freely", size, iteration
                ) from None
            still = size < 1e-3 and self._step_size(step) <= s.step_tolerance
            self._advance(step, self._then if again else self.now.chains)
            if still:
                # Nothing moves any more: what is left of the residual is round-off of very stiff parts.
                size = self._measure(self._unbalanced(t))
                if self._hole_error() <= 1e-4:
                    self._react(t)
                    return NewtonReport(iteration + 1, size, (*history, size))
        raise NotConverged(f"no equilibrium after {limit} iterations, residual {size:.1e}", size, limit)

    def _damped_step(self, t: float, r: Array) -> Array:
        """A step of the damped motion: as long as it turns no section far, and never up to a saddle."""
        for _ in range(20):
            step = self._newton_step(t, r)
            turn = float(np.max(np.abs(step[: 6 * self._reduction.nodes].reshape(-1, 6)[:, 3:])))
            climbs = self.tangent_sign * self.stable_sign < 0
            if turn <= 0.5 and not climbs:
                break
            self._damping = max(4.0 * self._damping, 1e-6 * self._floor_force * self._scale_length)
        if turn < 0.1:
            self._damping *= 0.2
        return step

    def _step_size(self, step: Array) -> float:
        """Largest displacement over the backbone's length, or rotation, of any node in a step [1]."""
        largest = np.abs(step[: 6 * self._reduction.nodes].reshape(-1, 6)).max(axis=0).tolist()
        return max(max(largest[:3]) / self._scale_length, *largest[3:])

    def _advance(self, step: Array, chains: Sequence[ElementChain]) -> None:
        """Move all unknowns by a Newton step, no element turning more than allowed.

        Parameters
        ----------
        step
            Change of all unknowns.
        chains
            In whose frames it is.
        """
        factor, self._turn = self.now.move(step, chains, self.settings.max_turn)
        self._current = False
        for part in self._parts:
            i = part.index
            if part.driven.size:
                tension = self._tension[i].copy()
                tension[part.driven] = np.maximum(tension[part.driven] + factor * step[part.tensions], 0.0)
                self._tension[i] = tension
            change = step[part.holes]
            if change.any():
                s, keep = self._mobilisation[i].copy(), part.robot.law.frictional
                s[keep] = np.clip(s[keep] + factor * change, -1.0, 1.0)
                self._mobilisation[i] = s

    def commit(self) -> None:
        """Take the present holes' states as history."""
        for robot, goal in zip(self.robots, self._goal, strict=True):
            robot.commit()
            robot.set_prescribed(goal)

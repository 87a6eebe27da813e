"""What Exudyn computes: residual and Jacobian without tendons and section forces, and the reactions of clamps."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import cached_property, wraps
from typing import Any, NamedTuple

import exudyn as exu
import numpy as np

from tdcr_fe.elements import Array, Index
from tdcr_fe.elements.backbone import node_frames
from tdcr_fe.elements.forces import TendonForces
from tdcr_fe.elements.native.actuation import TendonActuation
from tdcr_fe.elements.native.hooks import SceneHooks
from tdcr_fe.elements.section_forces import DIFFERENCE
from tdcr_fe.solve.equations.configuration import Configuration, SolverState, Target
from tdcr_fe.solve.equations.contact import ContactStates, TriangleContact
from tdcr_fe.solve.equations.layout import SceneLayout


def _interruptions_kept(call: Callable[..., Array]) -> Callable[..., Array]:
    """Raise an interruption again, of which Exudyn makes a ModelError where it arrives in a callback."""

    @wraps(call)
    def kept(*given: Any, **named: Any) -> Array:
        try:
            return call(*given, **named)
        except ValueError as error:
            if isinstance(error.__cause__, KeyboardInterrupt):
                raise error.__cause__ from None
            raise

    return kept


class StaticKernel:
    """Exudyn's static solver, evaluated one residual or Jacobian at a time; the scene stays as it is.

    Parameters
    ----------
    mbs
        An assembled system.
    hooks
        Hooks of the system.

    Attributes
    ----------
    contact : ContactStates
    triangles : TriangleContact

    Raises
    ------
    RuntimeError
        Exudyn cannot initialise its solver.
    """

    def __init__(self, mbs: exu.MainSystem, hooks: SceneHooks) -> None:
        settings = exu.SimulationSettings()
        settings.solution.file.write = False
        settings.solution.sensors.active = False
        settings.staticSolver.verboseMode = settings.timeIntegration.verboseMode = 0
        settings.timeIntegration.generalizedAlpha.computeInitialAccelerations = False
        self._mbs = mbs
        self._settings = settings
        own = [i for robot in hooks.robots for i in robot.history_nodes.coordinate_numbers()]
        self.contact = ContactStates(mbs, own, settings)
        self.triangles = TriangleContact(mbs)
        self._kernel = self._initialised(hooks)

    def _initialised(self, hooks: SceneHooks) -> Any:
        """Exudyn's static solver, ready to evaluate residual and Jacobian; the scene stays as it is."""
        kernel, data = exu.MainSolverStatic(), self._mbs.systemData
        # Without velocities: after a motion dampers would act on the state at rest.
        start = np.array(data.GetODE2Coordinates())
        multipliers = np.array(data.GetAECoordinates())
        states = np.array(data.GetDataCoordinates())
        # Exudyn's advice on large systems is about its own solvers.
        warned = exu.config.suppressWarnings
        exu.config.suppressWarnings = True
        try:
            with hooks.without_post_step():
                self.contact.initialise()
                ready = kernel.InitializeSolver(self._mbs, self._settings)
        finally:
            exu.config.suppressWarnings = warned
        if not ready:
            raise RuntimeError("Exudyn could not initialise its static solver for this system")
        data.SetODE2Coordinates(start)
        if multipliers.size:
            data.SetAECoordinates(multipliers)
        if states.size:
            data.SetDataCoordinates(states)
        return kernel

    @cached_property
    def _joints(self) -> list[exu.ObjectIndex]:
        """Numbers of all joints."""
        objects = [exu.ObjectIndex(i) for i in range(self._mbs.systemData.NumberOfObjects())]
        return [i for i in objects if exu.ComputeItemType.ReactionForces in self._mbs.ComputeItem(i)]

    @_interruptions_kept
    def residual(self) -> Array:
        """Residual of all equations: forces on the coordinates, then constraints, shape (size,)."""
        self._kernel.ComputeNewtonResidual(self._mbs, self._settings)
        return self._kernel.GetSystemResidual()

    def jacobian(self, *, loads: bool = False, constraints: bool = True) -> Array:
        """Derivative of the residual, shape (size, size).

        Parameters
        ----------
        loads
            Whether that of loads is included.
        constraints
            Whether that of constraints is computed anew.
        """
        n2 = self._mbs.systemData.ODE2Size()
        if self.triangles.touching:
            with self.triangles.all_with("isActive", False):
                found = self.exudyns_jacobian(loads, constraints)
            found[:n2, :n2] += self.triangles.derivative(self.residual)
        else:
            found = self.exudyns_jacobian(loads, constraints)
        if constraints and self._joints:
            found[:n2, :n2] += _joint_stiffness(self._mbs, self._joints)
        return found

    @_interruptions_kept
    def exudyns_jacobian(self, loads: bool = False, constraints: bool = True) -> Array:
        """As `jacobian`, without the forces of joints, and with what Exudyn has for contact with triangles."""
        self._kernel.ComputeJacobianODE2RHS(self._mbs, computeLoadsJacobian=int(loads))
        if constraints:
            self._kernel.ComputeJacobianAE(self._mbs)
        return self._kernel.GetSystemJacobian()


class LoneRobot:
    """Exudyn's residual where one robot alone moves: of its beams and its base joint, beside what stays as it is.

    Parameters
    ----------
    kernel
        Kernel of the scene.
    mbs
        The scene.
    robot
        Clamped to ground; nothing else resists its motion, and no load turns with it.
    """

    def __init__(self, kernel: StaticKernel, mbs: exu.MainSystem, robot: TendonActuation) -> None:
        self._kernel, self._mbs, self._robot = kernel, mbs, robot
        self._rest: tuple[Target | None, Array] = None, np.zeros(0)

    def residual(self, target: Target) -> Array:
        """As `StaticKernel.residual`; the whole scene is evaluated once under each target."""
        before, rest = self._rest
        if before is target:
            return rest + self._own(rest.size)
        found = self._kernel.residual()
        self._rest = target, found - self._own(found.size)
        return found

    def _own(self, size: int) -> Array:
        """Forces of its beams and its base joint, shape (size,)."""
        robot, kinds, found = self._robot, exu.ComputeItemType, np.zeros(size)
        assert robot.clamp is not None
        beams = np.array([self._mbs.ComputeItem(i, kinds.ODE2LHS) for i in robot.connectors.beams])
        found[robot.coordinates[0]] = self._mbs.ComputeItem(robot.clamp.joint, kinds.ReactionForces)
        found[robot.coordinates[:-1]] -= beams[:, :7]
        found[robot.coordinates[1:]] -= beams[:, 7:]
        return found


def _joint_stiffness(mbs: exu.MainSystem, joints: Sequence[exu.ObjectIndex]) -> Array:
    """Derivative of the forces of joints at the present multipliers by the ODE2 coordinates, shape (n2, n2).

    Exudyn's Jacobian leaves it out. A joint that moves with its bodies turns its force, or the lever of it: this is
    what holds a pendulum upright.
    """
    data = mbs.systemData
    current: Array = data.GetODE2Coordinates(exu.ConfigurationType.Current, copy=False)
    found = np.zeros((len(current), len(current)))
    for joint in joints:
        moving = data.GetObjectLTGODE2(joint)
        for k in moving:
            start = current[k]
            for step in (DIFFERENCE, -DIFFERENCE):
                current[k] = start + step
                found[moving, k] += mbs.ComputeItem(joint, exu.ComputeItemType.ReactionForces) / (2.0 * step)
            current[k] = start
    return found


class Residual(NamedTuple):
    """Residual of a state under a target."""

    state: SolverState
    target: Target
    forces: tuple[TendonForces, ...]  # By robot
    unbalanced: Array  # Reduced residual; zero at clamped bases, whose joints provide the reactions
    on_bases: Array  # (c, 6): By clamped robot, the wrench on its base
    raw: Array  # Exudyn's residual
    size: float  # Largest residual over its scale, prescribed displacements included [1]


class ClampReactions(NamedTuple):
    """Multipliers of the joints of clamped bases that balance the wrenches on these bases."""

    # By clamped robot, the numbers of its joint's multipliers among those of a configuration
    joints: Mapping[int, Index]
    # By clamped robot, from the wrench on its base to the joint's multipliers that cause it, shape (6, 6)
    influence: Mapping[int, Array]

    @classmethod
    def of(cls, mbs: exu.MainSystem, layout: SceneLayout) -> ClampReactions:
        """Reactions in the current configuration, from the forces that each multiplier of a joint alone causes."""
        influence: dict[int, Array] = {}
        multipliers: Array = mbs.systemData.GetAECoordinates(exu.ConfigurationType.Current, copy=False)
        kept = multipliers.copy()
        for i, joint in layout.clamps.items():
            robot, forces = layout.space.robots[i], []
            assert robot.clamp is not None
            for k in joint:
                multipliers[:] = 0.0
                multipliers[k] = 1.0
                forces.append(mbs.ComputeItem(robot.clamp.joint, exu.ComputeItemType.ReactionForces))
            _, rotations, parameters = robot.scene_poses()
            frame = node_frames(rotations[:1], parameters[:1])[0]
            influence[i] = np.linalg.inv(frame.T @ np.transpose(forces))
        multipliers[:] = kept
        return cls(layout.clamps, influence)

    def alone(self, i: int) -> ClampReactions:
        """Reactions of one robot by itself."""
        return ClampReactions({0: np.arange(6)}, {0: self.influence[i]})

    def balance(self, residual: Residual) -> Configuration:
        """The configuration of a state in equilibrium with the reactions of its clamps."""
        configuration = residual.state.configuration
        if not self.joints:
            return configuration
        old = configuration.unknowns
        multipliers = old.multipliers.copy()
        for (i, joint), acting in zip(self.joints.items(), residual.on_bases, strict=True):
            multipliers[joint] -= self.influence[i] @ acting
        return configuration._replace(unknowns=old._replace(multipliers=multipliers))

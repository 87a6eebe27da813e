"""What all robots of a system share: their registry, the commit after every step, and the user's own functions.

The forces act through items of their own (`tdcr_fe.elements.native.actuation`), so only one of Exudyn's system-wide
functions is occupied, ``PostStep``. A function of the user that is set there, before or after the robots, is called
from it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from typing import Any

import exudyn as exu
import numpy as np

from tdcr_fe.elements.backbone import BackboneMesh
from tdcr_fe.elements.native.actuation import TendonActuation
from tdcr_fe.elements.native.condensation import ROUND_OFF
from tdcr_fe.elements.native.items import SystemReference, item_counts, item_names, removed, unchanged

#: A step is tiny where it is shorter than this part of the one that was asked for [1].
TINY = 0.01
#: So many tiny steps in a row end a run. From Exudyn's smallest step, 1e-8 s of 1 ms, and with its default recovery of
#: ten steps, 100 of them bring the step back.
MOST = 200
#: Beyond this spectral radius of the generalized-alpha method constraint forces are hardly damped [1].
LARGEST_RADIUS = 0.99
#: Key of the hooks in ``mbs.variables``.
KEY = "tdcr_fe.hooks"


def round_off(mesh: BackboneMesh) -> float:
    """Round-off of the generalised forces in the stiffest element of a backbone [N]."""
    return ROUND_OFF * float(mesh.arc_lengths[-1]) * float(np.max(mesh.stiffness[:, 0] / mesh.lengths))


class StepSizes:
    """Sizes of the steps of the run under way."""

    def __init__(self) -> None:
        self._last = 0.0
        self._tiny = 0

    def check(self, mbs: exu.MainSystem, t: float, meshes: Sequence[BackboneMesh]) -> None:
        """See a step that ended at a time [s].

        Parameters
        ----------
        mbs
            The system.
        t
            [s].
        meshes
            The backbones of its robots.

        Raises
        ------
        RuntimeError
            One of many tiny steps in a row; says why, as far as the settings show it.
        """
        tiny, self._last = self._is_tiny(mbs, t), t
        self._tiny = self._tiny + 1 if tiny and meshes else 0
        if self._tiny < MOST:
            return
        self._tiny = 0
        integration, limit = mbs.sys["simulationSettings"].timeIntegration, max(map(round_off, meshes))
        newton, rho = integration.newton, integration.generalizedAlpha.spectralRadius
        why = "forces jump: take smooth inputs and laws of friction"
        if rho > LARGEST_RADIUS:
            why = f"with spectralRadius = {rho:g} the forces in joints grow from step to step: take 0.9"
        elif newton.absoluteTolerance < limit:
            why = (
                f"Newton's tolerances (relative {newton.relativeTolerance:g}, absolute {newton.absoluteTolerance:g}) "
                f"lie below the round-off of the backbone's forces ({limit:.1g} N): take those of "
                "arm.recommended_settings(end_time, step_size)"
            )
        raise RuntimeError(
            f"up to {t:g} s {MOST} steps in a row were shorter than a hundredth of the step that was asked for. "
            f"Probably {why}"
        )

    def check_tensions(self, mbs: exu.MainSystem, t: float, actuation: TendonActuation) -> None:
        """Refuse tensions that are no numbers in a tiny step up to a time [s], where shorter ones do not help."""
        if self._is_tiny(mbs, t):
            raise RuntimeError(
                f"robot {actuation.name!r}: at {t:g} s no tensions satisfy the law of friction. A tendon has no "
                "inertia: where its friction falls with the slip rate it jumps, and shorter steps do not help. Take a "
                "law that falls less, or steps longer than the bound in docs/theory.md"
            )

    def _is_tiny(self, mbs: exu.MainSystem, t: float) -> bool:
        """Whether a step of the dynamic solver up to a time [s] is a tiny one."""
        solver, settings = mbs.sys.get("dynamicSolver"), mbs.sys.get("simulationSettings")
        # Of a solver that ran before, as beside a static one, the time is another.
        if solver is None or settings is None or solver.it.currentTime != t:
            return False
        asked = settings.timeIntegration
        size = (asked.endTime - asked.startTime) / max(1, int(asked.numberOfSteps))
        return 0.0 < t - self._last < TINY * float(size)


class SceneHooks:
    """Robots of one system, and the functions that Exudyn calls for them.

    Parameters
    ----------
    mbs
        The system.

    Attributes
    ----------
    system : SystemReference
        Shared by all items of the robots.
    robots : list of TendonActuation
    """

    def __init__(self, mbs: exu.MainSystem) -> None:
        self.system = SystemReference(mbs)
        self.robots: list[TendonActuation] = []
        #: How many items there were when their numbers were last checked.
        self._counts = item_counts(mbs)
        self._step_sizes = StepSizes()
        self._users_post_step: Callable[..., Any] | None = None
        # One bound method: each access to the attribute makes another.
        self._own_post_step = self._after_step

    @classmethod
    def of(cls, mbs: exu.MainSystem) -> SceneHooks:
        """The hooks of a system, created at the first call."""
        if KEY not in mbs.variables:
            mbs.variables[KEY] = cls(mbs)
        hooks = mbs.variables[KEY]
        assert isinstance(hooks, cls)
        hooks.system.bind(mbs)
        hooks._check_items()
        hooks.adopt(mbs)
        return hooks

    @property
    def point_loads(self) -> list[Any]:
        """The concentrated loads on all robots."""
        return [load for robot in self.robots for load in robot.point_loads]

    @staticmethod
    def has(mbs: exu.MainSystem, actuation: TendonActuation) -> bool:
        """Whether a robot is known to a system; installs nothing."""
        hooks = mbs.variables.get(KEY)
        if not isinstance(hooks, SceneHooks):
            return False
        hooks._check_counts()
        return actuation in hooks.robots

    def _check_counts(self) -> None:
        """`_check_items` where items were added or deleted since."""
        if item_counts(self.system.mbs) != self._counts:
            self._check_items()

    def _check_items(self) -> None:
        """Forget robots whose items were deleted, or removed by ``mbs.Reset()``, which leaves ``mbs.variables``."""
        mbs = self.system.mbs
        changed = [robot for robot in self.robots if not unchanged(robot.items, mbs)]
        present = [robot for robot in changed if not removed(robot.items, mbs)]
        if present:
            raise ValueError(
                f"robot {present[0].name!r}: its items have other numbers in the system than when it was "
                "made, because items were deleted; delete items before CreateTDCR, or build the system again"
            )
        self.robots = [robot for robot in self.robots if robot not in changed]
        if item_counts(mbs)["Sensor"] != self._counts["Sensor"]:
            drawn = [spring for each in self.robots for spring in each.connectors.drawn]
            _refuse_force_sensors(mbs, drawn)
        self._counts = item_counts(mbs)

    def add(self, actuation: TendonActuation) -> None:
        """Add a robot, and give its force items the functions that Exudyn calls.

        An iteration that diverges may overflow or find no tensions, without a warning: the solver sees forces that are
        no numbers, and takes a smaller step.

        Parameters
        ----------
        actuation
            Tendons, friction and section forces of the robot.
        """

        def forces(mbs: exu.MainSystem, t: float, item: int, q: Sequence[float], q_t: Sequence[float]) -> Any:
            self._check_counts()
            self.adopt(self.system.mbs)
            found: Any = [np.nan] * len(q)
            with np.errstate(all="ignore"), suppress(np.linalg.LinAlgError):
                found = actuation.forces_on_coordinates(q, t)
            if actuation.law.varies and np.isnan(found[0]):
                self._step_sizes.check_tensions(self.system.mbs, t, actuation)
            return found

        def jacobian(mbs: Any, t: float, item: int, q: Any, q_t: Any, *factors: float) -> Any:
            with np.errstate(all="ignore"):
                return actuation.jacobian_on_coordinates(q, t, *factors)

        actuation.attach(forces, jacobian)
        nodes = (actuation.nodes[0], actuation.nodes[-1], *actuation.history_nodes.nodes[-1:])
        actuation.items |= item_names(self.system.mbs, Object=[actuation.connectors.forces], Node=nodes)
        self.robots.append(actuation)

    def adopt(self, mbs: exu.MainSystem) -> None:
        """Install the function after every step; one that the user has set since is called from it."""
        present = _function(mbs.GetPostStepUserFunction())
        if present is self._own_post_step:
            return
        # None is there before the first call, and where the user has taken all functions away.
        self._users_post_step = present
        # A run that ended within a step may have been the last one, unseen.
        for actuation in self.robots:
            actuation.attempt = None
        mbs.SetPostStepUserFunction(self._own_post_step)

    def user_function(self, kind: str) -> Callable[..., Any] | None:
        """The user's own function of a kind ("PreStep", "PreNewtonResidual", "SystemJacobian"), or None."""
        return _function(getattr(self.system.mbs, f"Get{kind}UserFunction")())

    @contextmanager
    def without_post_step(self) -> Iterator[None]:
        """Disable the function after every step: Exudyn's solvers call it when they are initialised."""
        mbs = self.system.mbs
        self.adopt(mbs)
        mbs.SetPostStepUserFunction(0)
        try:
            yield
        finally:
            mbs.SetPostStepUserFunction(self._own_post_step)

    def refuse_motors(self, function: str) -> None:
        """Refuse a scene with motors, which only Exudyn's own solvers turn.

        Raises
        ------
        ValueError
            Names the function and the robot.
        """
        for actuation in self.robots:
            if actuation.motors:
                raise ValueError(
                    f"{function}: a tendon of robot {actuation.name!r} is wound by a motor (add_motor); "
                    "mbs.SolveDynamic solves such scenes"
                )

    def _after_step(self, mbs: exu.MainSystem, t: float) -> bool:
        self._check_counts()
        self._step_sizes.check(mbs, t, [robot.mesh for robot in self.robots])
        for robot in self.robots:
            robot.refuse_apart(mbs, t)
            for observe in robot.observers:
                observe(t)
            robot.commit_scene(t)
            for load in robot.point_loads:
                load.applied = load.value
        return True if self._users_post_step is None else bool(self._users_post_step(mbs, t))


def _refuse_force_sensors(mbs: exu.MainSystem, drawn: Sequence[int]) -> None:
    """Refuse sensors of the force of objects that are only drawn."""
    forces = (exu.OutputVariableType.Force, exu.OutputVariableType.ForceLocal)
    for k in range(mbs.systemData.NumberOfSensors()):
        sensor = mbs.GetSensor(k)
        if int(sensor.get("objectNumber", -1)) in drawn and sensor["outputVariableType"] in forces:
            raise ValueError(
                f"sensor {sensor['name']!r}: segments in oTendons are only drawn, their force is zero; "
                "arm.add_sensors() adds sensors of the tensions (tension_NAME, tensions_NAME)"
            )


def _function(present: Any) -> Callable[..., Any] | None:
    """The return value of one of Exudyn's getters, as a Python function or None."""
    if isinstance(present, dict):
        present = present.get("function")
    return present if callable(present) else None

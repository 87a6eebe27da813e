"""One robot alone on ground, taken through load steps one by one."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager, nullcontext
from functools import lru_cache

import exudyn as exu
import numpy as np
from threadpoolctl import ThreadpoolController

from tdcr_fe.elements import Array
from tdcr_fe.elements.backbone import BEAM_TO_SECTION
from tdcr_fe.model.loading import Actuation, Load, Model, SolverSettings
from tdcr_fe.model.results import StepResult
from tdcr_fe.model.robot import Robot
from tdcr_fe.scene import TDCR, CreateTDCR, PointLoad
from tdcr_fe.solve.equations.configuration import SolverState
from tdcr_fe.solve.equations.linearization import Linearization
from tdcr_fe.solve.equations.system import SceneSystem
from tdcr_fe.solve.friction_path.response import Equilibrium
from tdcr_fe.solve.load_steps.load_path import Increment, LoadStepReport, Position, Ramp, StepFailed
from tdcr_fe.solve.load_steps.stepping import SolvedLoadStep, solve_load_step
from tdcr_fe.solve.load_steps.substep import SubstepSolver

LoadKey = tuple[str, float, str]


@lru_cache(maxsize=1)
def _controller() -> ThreadpoolController:
    """The linear algebra libraries of this process, found once."""
    return ThreadpoolController()


def one_thread() -> AbstractContextManager[object]:
    """Limit BLAS to one thread inside a ``with`` block; nothing is done where it has no more than one."""
    libraries = _controller().lib_controllers
    if all(library.get_num_threads() == 1 for library in libraries if library.user_api == "blas"):
        return nullcontext()
    return _controller().limit(limits=1, user_api="blas")


class Simulation:
    """One robot alone on ground, taken through load steps.

    Parameters
    ----------
    robot, model
        Description.
    steps
        The loading sequence, resolved with `tdcr_fe.model.loading.resolve`; determines the nodes needed for loads.
    settings
        Numerics.

    Attributes
    ----------
    handle : TDCR
        The robot in its scene.
    system : SceneSystem
        Its equations.
    state : SolverState
        Last solved state, see `tdcr_fe.solve.stability.scaled_tangent` for its tangent; the twists of the elements
        are ``state.configuration.twists[0]``.
    """

    def __init__(
        self, robot: Robot, model: Model, steps: Sequence[Actuation], settings: SolverSettings | None = None
    ) -> None:
        self.settings = settings or SolverSettings()
        keys = {self.load_key(name, load) for step in steps for name, load in step.loads.items()}
        loaded = sorted({at for _, at, _ in keys})
        # Exudyn's system container owns the system, so a reference to it is kept.
        self.container = exu.SystemContainer()
        mbs = self.container.AddSystem()
        self.handle: TDCR = CreateTDCR(
            mbs, robot, model, loadPositions=loaded, presliding=self.settings.presliding
        )
        self.loads: dict[LoadKey, PointLoad] = {
            key: self.handle.add_load(f"{key[0]}@{key[1]:g}.{key[2]}", key[1], key[2])  # type: ignore[arg-type]
            for key in sorted(keys)
        }
        mbs.Assemble()
        self.system = SceneSystem(mbs)
        #: Where the simulation is, see `return_to`.
        self.position = Position(self.system.current_state())

    @property
    def state(self) -> SolverState:
        """Last solved state."""
        return self.position.state

    @staticmethod
    def load_key(name: str, load: Load) -> LoadKey:
        """Key of a load in `loads`."""
        return name, float(load.at), load.frame

    def advance(
        self,
        target: Actuation,
        substeps: int | None = None,
        near: Sequence[Increment] = (),
        follow: Callable[[SolvedLoadStep], None] | None = None,
        deadline: float = math.inf,
    ) -> LoadStepReport:
        """Solve one load step.

        Parameters
        ----------
        target
            Inputs and loads at the end of the step.
        substeps
            Fixed number; None chooses by refinement.
        near
            The substeps of a similar run, see `tdcr_fe.solve.load_steps.stepping.solve_load_step`.
        follow
            Called with the solved load step; leaves the scene as it is.
        deadline
            Time after which no further substep begins, of `time.perf_counter` [s].

        Raises
        ------
        ValueError
            A load is none of those that were named.
        StepFailed
            The state is then that of the last substep that converged.
        """
        robot = self.handle.actuation
        acting = {self.load_key(name, load): (load.force, load.moment) for name, load in target.loads.items()}
        if unknown := acting.keys() - self.loads:
            name, at, frame = min(unknown)
            raise ValueError(
                f"load {name!r} at {at!r} m ({frame}): must be named by the steps given to Simulation"
            )
        for key, item in self.loads.items():
            item.set(*acting.get(key, (np.zeros(3), np.zeros(3))))
        robot.inputs, robot.drives = target.values, target.drives
        creeps = self.handle.robot.backbone.creep_rate != 0.0
        ramp = Ramp.of(self.system, self.state, target.time, self._set_creep if creeps else None)
        solver = SubstepSolver(self.system, ramp, self.settings, deadline)
        try:
            with one_thread():
                solved = solve_load_step(solver, self.position, substeps, near)
        except StepFailed as failure:
            self.position = Position(failure.state)
            raise
        path = solved.path
        self.position = Position(path.state, path.linearization, path.end)
        if follow is not None:
            with one_thread():
                follow(solved)
        return LoadStepReport.of(path)

    def linearization(self) -> Linearization:
        """Equilibrium at fixed friction, linearised in the last solved state or at most an iteration before."""
        found = self.position.linearization
        if found is None:
            found = Equilibrium.at(self.system, self.state, self.state.target).linearization
            self.position = self.position._replace(linearization=found)
        return found

    def _set_creep(self, moment: float) -> None:
        """Set the compliance of the backbone to that at a time [s]."""
        self.handle.set_compliance_factor(self.handle.robot.backbone.compliance_factor(moment))

    def return_to(self, position: Position) -> None:
        """Return to where the simulation was before, with the loads that acted there."""
        self.system.store(position.state)
        self.position = position

    def begin_from(self, state: SolverState) -> None:
        """Begin the next load step from a state that was solved before; until then the scene stays as it is."""
        self.position = Position(state)

    @property
    def displacement(self) -> Array:
        """Tendons pulled in at the base [m], shape (n_tendons,)."""
        return self.handle.actuation.displacements

    def result(
        self, number: int, label: str, report: LoadStepReport, target: Actuation | None = None
    ) -> StepResult:
        """The present state as a result."""
        handle = self.handle
        states, tensions = handle.hole_states(), handle.tensions()
        configuration, model = self.state.configuration, handle.actuation.model
        positions, rotations = configuration.poses[0]
        strained = model.strain_state(configuration.twists[0], handle.actuation.base_tension)
        details = dict(vars(report))
        return StepResult(
            step=number,
            label=label,
            converged=True,
            iterations=details.pop("iterations"),
            substeps=details.pop("substeps"),
            residual=details.pop("residual"),
            s=handle.arc_lengths.copy(),
            positions=positions.copy(),
            rotations=rotations @ BEAM_TO_SECTION.T,
            base_tensions=handle.actuation.base_tension.copy(),
            displacements=self.displacement,
            tensions=tuple(tensions[n] for n in handle.robot.tendon_names),
            hole_states=tuple(states[n] for n in handle.robot.tendon_names),
            actuation=target,
            curvature_rates=strained.curvature_rates() @ BEAM_TO_SECTION.T,
            details=details,
        )


def step_warnings(number: int, report: LoadStepReport) -> list[str]:
    """Warnings on a solved load step."""
    found = []
    if report.snapped:
        found.append(
            f"step {number}: No equilibrium followed the path. The robot snapped through to another one, found "
            "by damped relaxation."
        )
    if report.presliding_factor > 1.0:
        found.append(
            f"step {number}: The stick-slip iteration did not converge; one substep used "
            f"{report.presliding_factor:g} times the presliding distance. Use smaller load steps."
        )
    if report.refinement_error > 0.0:
        found.append(
            f"step {number}: Friction path not resolved: the remaining uncertainty may move a node by "
            f"{100.0 * report.refinement_error:.2g} % of the length. Use smaller load steps."
        )
    return found

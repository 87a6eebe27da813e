"""Trial load steps from one state: the tip that inputs lead to, and its exact derivative by them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tdcr_fe.effects import Experiment
from tdcr_fe.elements.backbone import BEAM_TO_SECTION
from tdcr_fe.elements.drives import TendonDrives
from tdcr_fe.model.loading import Actuation, LoadStep
from tdcr_fe.solve.equations.configuration import SolverState
from tdcr_fe.solve.load_steps.load_path import LoadStepReport, StepFailed
from tdcr_fe.solve.sensitivities.parameters import parameters
from tdcr_fe.solve.sensitivities.sensitivity import SensitivityHistory
from tdcr_fe.solve.simulation import Simulation

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Trial:
    """A solved trial step."""

    step: LoadStep  # With all inputs
    actuation: Actuation  # The same, resolved
    report: LoadStepReport
    state: SolverState  # At its end
    tip: Array  # (3,): Position [m] and unit tangent of the tip
    tangent: Array  # as `tip`
    tensions: Array  # (m,): At the base [N, m]
    displacements: Array  # as `tensions`
    # (6, m): Derivatives of the tip (position and world rotation vector) by the tension of each tendon [m/N, rad/N]
    motion: Array
    inputs_by_tension: Array  # (m, m): Derivatives of the inputs

    @property
    def inputs(self) -> Array:
        """Tensions [N] or displacements [m] that drive the tendons, shape (m,)."""
        return self.actuation.values


class TrialSteps:
    """Load steps of one robot, each tried any number of times from the same state.

    Parameters
    ----------
    simulation
        Of the robot; it need not be at its beginning.
    experiment
        What it is a simulation of, with all loads.

    Attributes
    ----------
    simulation : Simulation
    """

    def __init__(self, simulation: Simulation, experiment: Experiment) -> None:
        self.robot, self.simulation = experiment.robot, simulation
        robot = self.robot
        chosen = parameters(experiment, [f"inputs.{name}" for name in robot.tendon_names])
        self._history = SensitivityHistory.of(simulation, experiment, chosen)
        count = len(robot.tendons)
        self._last = Actuation(TendonDrives.by_tension(count), np.zeros(count))

    def begin(self, actuation: Actuation) -> None:
        """Take the inputs, loads and time of the last step that was kept."""
        self._last = actuation

    def step(
        self,
        inputs: Array,
        by_displacement: bool,
        label: str = "",
        time: float | None = None,
        substeps: int | None = None,
    ) -> LoadStep:
        """A load step with these inputs for all tendons."""
        named = {n: float(x) for n, x in zip(self.robot.tendon_names, inputs, strict=True)}
        if by_displacement:
            return LoadStep(label, displacements=named, substeps=substeps, time=time)
        return LoadStep(label, tensions=named, substeps=substeps, time=time)

    def solve(self, start: SolverState, step: LoadStep) -> Trial | None:
        """Solve a step from a state, and differentiate; None where it has no solution."""
        simulation = self.simulation
        target = self._actuation(step)
        simulation.begin_from(start)
        self._history.steps.clear()
        try:
            report = simulation.advance(target, step.substeps, follow=self._history.advance)
        except (StepFailed, np.linalg.LinAlgError):  # the latter from a singular tangent
            return None
        positions, rotations = simulation.state.configuration.poses[0]
        return Trial(
            step,
            target,
            report,
            simulation.state,
            positions[-1].copy(),
            rotations[-1] @ BEAM_TO_SECTION.T[:, 2],
            simulation.state.base_tension[0].copy(),
            simulation.displacement,
            *self._derivatives(bool(step.displacements)),
        )

    def _actuation(self, step: LoadStep) -> Actuation:
        """What a trial step prescribes; loads act on."""
        drive, inputs = next((drive, given) for drive, given in step.inputs() if given)
        return Actuation(
            TendonDrives.of([drive] * len(inputs), self.robot.tendons),
            np.array([inputs[n] for n in self.robot.tendon_names]),
            self._last.loads,
            self._last.time if step.time is None else step.time,
        )

    def _derivatives(self, by_displacement: bool) -> tuple[Array, Array]:
        """Derivatives of the tip and of the inputs by the tensions, at the end of the trial."""
        found = self._history.result()
        by = [found[f"inputs.{n}"] for n in self.robot.tendon_names]
        motion = np.array([(*x.positions[-1, -1], *x.rotations[-1, -1]) for x in by]).T
        if not by_displacement:
            return motion, np.eye(len(by))
        inputs_by_tension = np.linalg.pinv(np.array([x.base_tensions[-1] for x in by]).T, rcond=1e-12)
        return motion @ inputs_by_tension, inputs_by_tension

"""Search for the tensions that take the tip to one target, from one state: Gauss-Newton in a trust region.

Every trial is a load step from that state, solved with its exact derivatives. The distance from the target plus a price
of the tensions is made smallest, within bounds. The price keeps tensions small that would gain less than the tolerance.
Derivation: docs/algorithms.md, section "Derivatives along the history".
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import lsq_linear

from tdcr_fe.effects import Experiment
from tdcr_fe.elements import Array
from tdcr_fe.elements.backbone import BEAM_TO_SECTION
from tdcr_fe.model.loading import Actuation, LoadStep, resolve
from tdcr_fe.model.targets import TipTarget
from tdcr_fe.solve.equations.configuration import SolverState
from tdcr_fe.solve.load_steps.load_path import LoadStepReport, StepFailed
from tdcr_fe.solve.sensitivities.parameters import parameters
from tdcr_fe.solve.sensitivities.sensitivity import SensitivityHistory
from tdcr_fe.solve.simulation import Simulation

#: A search ends where the linearised robot could lower the objective by less than this share of the tolerance [1].
PRECISION = 1e-4
#: First radius of the trust region, in units of the scale of the tensions [1].
FIRST_RADIUS = 0.5
#: Trial steps of one search.
MOST_TRIALS = 40
#: Share of the tolerance that is of no account [1]: a tension of the scale costs it, the distance is rounded off to it
#: near zero, and a point may be farther away by it than the nearest one, that of another search, or what the linearised
#: robot could still gain.
AGREEMENT = 0.1


@dataclass(frozen=True, eq=False)
class Trial:
    """A solved trial step."""

    step: LoadStep  # The load step, with all inputs
    actuation: Actuation  # The same, resolved: its values are tensions [N] or displacements [m]
    report: LoadStepReport
    state: SolverState  # State at its end
    tip: Array  # (3,): Position of the tip [m]
    tangent: Array  # (3,): Unit tangent at the tip
    tensions: Array  # (m,): Tensions at the base [N]
    displacements: Array  # (m,): Lengths of the tendons pulled in at the base [m]
    # (6, m): Derivatives of the tip (position and world rotation vector) by the tension of each tendon [m/N, rad/N]
    motion: Array
    inputs_by_tension: Array  # (m, m): Derivatives of the inputs by the tensions


class TrialSteps:
    """Load steps of one robot, each tried any number of times from the same state.

    Parameters
    ----------
    simulation
        Simulation of the robot; it need not be at its beginning.
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
        self._history = replace(SensitivityHistory.of(simulation, experiment, chosen), curvatures=False)
        self._last: Actuation | None = None

    def begin(self, actuation: Actuation) -> None:
        """Take the inputs, loads and time of the last step that was kept."""
        self._last = actuation

    def solve(self, start: SolverState, step: LoadStep) -> Trial | None:
        """Solve a step from a state, and differentiate; None where it has no solution."""
        simulation = self.simulation
        (target,) = resolve(self.robot, [step], self._last)
        simulation.begin_from(start)
        self._history.steps.clear()
        try:
            report = simulation.advance(target, step.substeps, follow=self._history.advance)
        except (StepFailed, np.linalg.LinAlgError):  # the latter from a singular tangent
            return None
        state, derivatives = simulation.state, self._derivatives(bool(step.displacements))
        positions, rotations = state.configuration.poses[0]
        tip = positions[-1].copy(), rotations[-1] @ BEAM_TO_SECTION.T[:, 2]
        at_base = state.base_tension[0].copy(), simulation.displacement
        return Trial(step, target, report, state, *tip, *at_base, *derivatives)

    def _derivatives(self, by_displacement: bool) -> tuple[Array, Array]:
        """Derivatives of the tip and of the inputs by the tensions, at the end of the trial."""
        found = self._history.result()
        by = [found[f"inputs.{n}"] for n in self.robot.tendon_names]
        motion = np.array([(*x.positions[-1, -1], *x.rotations[-1, -1]) for x in by]).T
        if not by_displacement:
            return motion, np.eye(len(by))
        inputs_by_tension = np.linalg.pinv(np.array([x.base_tensions[-1] for x in by]).T, rcond=1e-12)
        return motion @ inputs_by_tension, inputs_by_tension


@dataclass(frozen=True, eq=False)
class Objective:
    """Distance from a target plus the price of the tensions, and the bounds of these."""

    target: TipTarget
    length: float  # Length of the robot [m]
    tolerance: float  # Tolerance of the distance, over the length [1]
    lower: Array  # (m,): Lowest tensions [N]
    upper: Array  # (m,): Largest tensions [N]
    reference: Array  # (m,): Tensions without a price: zero, or those at the beginning of the step [N]
    scale: float  # Scale of the tensions [N]

    def residual(self, trial: Trial) -> Array:
        """Error of the given coordinates over the length, and of the unit tangent where its direction matters."""
        given = self.target.given
        position = (trial.tip - np.array(self.target.position, dtype=float))[given] / self.length
        direction = self.target.unit_direction
        return position if direction is None else np.concatenate((position, trial.tangent - direction))

    def jacobian(self, trial: Trial) -> Array:
        """Derivative of the residual by the tensions [1/N]."""
        position = trial.motion[:3][self.target.given] / self.length
        if self.target.direction is None:
            return position
        return np.vstack((position, np.cross(trial.motion[3:].T, trial.tangent).T))

    def size(self, trial: Trial) -> float:
        """Norm of the residual [1]."""
        return float(np.linalg.norm(self.residual(trial)))

    def errors(self, trial: Trial) -> tuple[float, float | None]:
        """Distance [m], and angle [rad] where the direction matters."""
        distance = self.length * float(np.linalg.norm(self.residual(trial)[: self.target.given.sum()]))
        direction = self.target.unit_direction
        if direction is None:
            return distance, None
        sine = np.linalg.norm(np.cross(trial.tangent, direction))
        return distance, float(np.arctan2(sine, trial.tangent @ direction))

    def at(self, trial: Trial) -> float:
        """Its value at a trial, over the length [1]."""
        return self._of(self.residual(trial), trial.tensions)

    def _of(self, residual: Array, tensions: Array) -> float:
        effort = float(np.sum(((tensions - self.reference) / self.scale) ** 2))
        # Prescribed displacements lead to tensions that may be out of bounds.
        outside = float(np.abs(np.clip(tensions, self.lower, self.upper) - tensions).max()) / self.scale
        price = AGREEMENT * self.tolerance
        return float(np.hypot(np.linalg.norm(residual), price)) + price * effort + outside

    def step(self, trial: Trial, radius: float) -> tuple[Array, float]:
        """Change of the tensions that minimises it for the robot linearised at a trial [N], and by how much [1].

        The norm is replaced by a parabola that touches it at its present value (iteratively reweighted least squares).
        No tension changes by more than the radius [N].
        """
        tensions, residual, jacobian = trial.tensions, self.residual(trial), self.jacobian(trial)
        low = np.clip(self.lower - tensions, -radius, radius) / self.scale
        high = np.clip(self.upper - tensions, -radius, radius) / self.scale
        price = AGREEMENT * self.tolerance
        weight = np.sqrt(2.0 * price * np.hypot(np.linalg.norm(residual), price))
        # The stacked system keeps the condition number of the derivatives; its normal equations would square it.
        matrix = np.vstack((jacobian * self.scale / weight, np.eye(tensions.size)))
        right = np.concatenate((-residual / weight, (self.reference - tensions) / self.scale))
        bounds = low - 1e-12, high + 1e-12
        found = lsq_linear(matrix, right, bounds, method="bvls", max_iter=100 * tensions.size)
        step = self.scale * np.clip(found.x, low, high)
        return step, self.at(trial) - self._of(residual + jacobian @ step, tensions + step)


@dataclass(frozen=True, eq=False)
class SearchResult:
    """End of a search."""

    trial: Trial
    value: float  # Value of the objective [1]
    possible_gain: float  # By how much the linearised robot could lower it in the first trust region [1]


@dataclass(eq=False)
class TargetSearch:
    """Searches for one target."""

    trials: TrialSteps  # Solves trial steps
    start: SolverState  # State from which every trial begins
    objective: Objective  # What is to be smallest
    label: str = ""  # Label of the load step
    deadline: float = math.inf  # Reading of `time.perf_counter` after which no further trial begins [s]
    count: int = 0  # Trial steps so far

    def best(self, starts: Iterable[Array], friction: bool) -> tuple[SearchResult | None, int]:
        """The best of the searches from several tensions [N], and their number.

        With friction every search begins among load steps solved whole. That leaves the path of the friction within a
        step out of account, costs a fraction, and is exact where no slip reverses in it. Where it ends there no nearer
        to the target than another one, it is not taken up with the path.
        """
        objective = self.objective
        ended: list[SearchResult] = []
        values: list[float] = []
        count = 0
        for start in starts:
            count += 1
            found = self.run(start, substeps=1 if friction else None)
            if found is None:
                continue
            values.append(found.value)
            if friction:
                found = self.run(found.trial.tensions) if found.value <= min(values) else None
            if found is not None:
                ended.append(found)
                if objective.size(found.trial) <= objective.tolerance:
                    break
            if ended and sum(x <= min(values) + AGREEMENT * objective.tolerance for x in values) > 1:
                break
        return min(ended, key=lambda x: x.value, default=None), count

    def run(
        self, inputs: Array, *, by_displacement: bool = False, substeps: int | None = None
    ) -> SearchResult | None:
        """Search from tensions [N] or displacements [m]; None where the first trial has no solution."""
        objective = self.objective
        best = self._solve(inputs, by_displacement, substeps)
        if best is None:
            return None
        radius, end = FIRST_RADIUS * objective.scale, self.count + MOST_TRIALS
        while True:
            step, gain = objective.step(best, radius)
            length = float(np.abs(step).max())
            late = time.perf_counter() > self.deadline
            if late or gain <= PRECISION * objective.tolerance or self.count >= end:
                break
            trial = self._moved(best, step)
            if trial is not None and objective.at(trial) >= objective.at(best) - 0.1 * gain:
                # A step along the tensions that keep the tip leaves the target to second order; the next one returns.
                trial = self._moved(trial, objective.step(trial, radius)[0])
            lowered = -np.inf if trial is None else objective.at(best) - objective.at(trial)
            if trial is None or lowered < 0.1 * gain:
                radius = 0.25 * length
                continue
            best = trial
            if lowered > 0.7 * gain and length >= 0.999 * radius:
                radius *= 2.5
        gain = objective.step(best, FIRST_RADIUS * objective.scale)[1]
        return SearchResult(best, objective.at(best), max(gain, 0.0))

    def _solve(self, inputs: Array, by_displacement: bool, substeps: int | None) -> Trial | None:
        self.count += 1
        named = {n: float(x) for n, x in zip(self.trials.robot.tendon_names, inputs, strict=True)}
        step = LoadStep(self.label, substeps=substeps, time=self.objective.target.time)
        step = replace(step, displacements=named) if by_displacement else replace(step, tensions=named)
        return self.trials.solve(self.start, step)

    def _moved(self, trial: Trial, step: Array) -> Trial | None:
        """The trial with tensions changed by a step, to first order."""
        if trial.step.displacements:
            inputs = trial.actuation.values + trial.inputs_by_tension @ step
            return self._solve(inputs, True, trial.step.substeps)
        tensions = np.clip(trial.actuation.values + step, self.objective.lower, self.objective.upper)
        return self._solve(tensions, False, trial.step.substeps)

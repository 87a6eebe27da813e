"""Search for the tensions that take the tip to one target, from one state: Gauss-Newton in a trust region.

First the error is reduced; at the target, the effort is. A step of less effort leaves the target to second order, and
is kept where the way back to the target costs less than it has gained.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import lsq_linear

from tdcr_fe.model.targets import TipTarget
from tdcr_fe.solve.equations.configuration import SolverState
from tdcr_fe.solve.inverse_statics.trials import Trial, TrialSteps

Array = NDArray[np.float64]

#: Error at which iterations on the target end [fraction of the length, rad].
CONVERGED = 1e-8
#: Smallest weight of the effort against the error [1], its largest one, and the ratio of weight to error between them.
SMALLEST_WEIGHT, LARGEST_WEIGHT, WEIGHT_RATIO = 1e-8, 1e-3, 0.03
#: Relative gain, predicted by the linearised robot, below which error and effort are smallest.
ERROR_GAIN, EFFORT_GAIN = 1e-4, 1e-3
#: First radius of the trust region, in units of the scale of the tensions [1].
FIRST_RADIUS = 0.5
#: Trial steps on the way to a target, and refused ones in succession; steps of less effort, and refused ones.
MOST_TRIALS, MOST_REFUSALS, MOST_ROUNDS, MOST_REFUSED_ROUNDS = 40, 8, 8, 2
#: Trial steps on the way back to the target after a step of less effort.
MOST_TRIALS_BACK = 5
#: Distance to which linearisations of refused trials count, in radii of the trust region [1].
NEIGHBOURHOOD = 4.0


@dataclass(frozen=True, eq=False)
class Effort:
    """Which tensions are preferred among those that reach a target."""

    lower: Array  # (m,): Bounds [N]
    upper: Array  # as `lower`
    reference: Array  # (m,): Tensions of no effort: zero, or those at the beginning of the step [N]
    scale: float  # Tension of effort 1 [N]

    def of(self, tensions: Array) -> float:
        """Sum of the squares of the tensions from the reference, in units of the scale [1]."""
        return float(np.sum(((tensions - self.reference) / self.scale) ** 2))

    def around(self, tensions: Array) -> Effort:
        """The same with other tensions of no effort [N]: the smallest change from them is preferred."""
        return replace(self, reference=tensions)

    def step(self, tensions: Array, residual: Array, jacobian: Array, weight: float, radius: float) -> Array:
        """Change of the tensions that minimises ``|r + J dT|^2 + weight^2 effort(T + dT)`` within bounds.

        Parameters
        ----------
        tensions
            T [N], shape (m,).
        residual
            r, over the length of the robot [1], shape (k,).
        jacobian
            J, shape (k, m) [1/N].
        weight
            Of the effort [1].
        radius
            Largest change of a tension [N].
        """
        low = np.clip(self.lower - tensions, -radius, radius) / self.scale
        high = np.clip(self.upper - tensions, -radius, radius) / self.scale
        step = 0.5 * (low + high)
        free = np.flatnonzero(high - low > 1e-12)
        if free.size == 0:
            return self.scale * step
        # The stacked system keeps the condition number of J; its normal equations would square it.
        fixed = np.where(high - low > 1e-12, 0.0, step)
        columns = jacobian * self.scale
        matrix = np.vstack((columns[:, free] / weight, np.eye(free.size)))
        right = np.concatenate(
            (-(residual + columns @ fixed) / weight, ((self.reference - tensions) / self.scale)[free])
        )
        found = lsq_linear(matrix, right, (low[free], high[free]), method="bvls", max_iter=100 * free.size)
        step[free] = np.clip(found.x, low[free], high[free])
        return self.scale * step


@dataclass(frozen=True, eq=False)
class Aim:
    """A target as residuals over the length of the robot."""

    position: Array  # (3,): [m]
    direction: Array | None  # (3,): Unit vector
    length: float  # Of the robot [m]

    @classmethod
    def of(cls, target: TipTarget, length: float) -> Aim:
        """From a target, for a robot of a length [m]."""
        return cls(np.array(target.position), target.unit_direction, length)

    def residual(self, tip: Array, tangent: Array) -> Array:
        """Error of position over the length, and of the unit tangent where its direction matters."""
        position = (tip - self.position) / self.length
        return position if self.direction is None else np.concatenate((position, tangent - self.direction))

    def size(self, tip: Array, tangent: Array) -> float:
        """Norm of the residual [1]."""
        return float(np.linalg.norm(self.residual(tip, tangent)))

    def jacobian(self, trial: Trial) -> Array:
        """Derivative of the residual by the tensions [1/N]."""
        position = trial.motion[:3] / self.length
        if self.direction is None:
            return position
        return np.vstack((position, np.cross(trial.motion[3:].T, trial.tangent).T))

    def errors(self, trial: Trial) -> tuple[float, float | None]:
        """Distance [m], and angle [rad] where the direction matters."""
        distance = float(np.linalg.norm(trial.tip - self.position))
        if self.direction is None:
            return distance, None
        sine = np.linalg.norm(np.cross(trial.tangent, self.direction))
        return distance, float(np.arctan2(sine, trial.tangent @ self.direction))


@dataclass(frozen=True, eq=False)
class SearchResult:
    """End of a search."""

    trial: Trial
    size: float  # Norm of the residual [1]
    possible_gain: float  # By how much the linearised robot could reduce it within the bounds [1]
    stationary: bool  # Whether that is nothing
    effort: float  # [1]

    def better_than(self, other: SearchResult) -> bool:
        """Nearer to the target, or as near and stationary."""
        if abs(self.size - other.size) <= 1e-9 + 1e-6 * other.size:
            return self.stationary and not other.stationary
        return self.size < other.size


class TargetSearch:
    """Searches for one target.

    Parameters
    ----------
    trials
        Solves trial steps.
    start
        State from which every trial begins.
    aim
        The target.
    effort
        Bounds of the tensions, and which are preferred.
    label, time
        Of the load step.
    """

    def __init__(
        self, trials: TrialSteps, start: SolverState, aim: Aim, effort: Effort, label: str, time: float | None
    ) -> None:
        self._trials, self._start, self._aim, self._effort = trials, start, aim, effort
        self._label, self._time = label, time
        self.count = 0

    def whole(self, tensions: Array) -> SearchResult | None:
        """Search from tensions [N] among load steps solved whole; None where no trial has a solution.

        The path of the friction within a step is left out of account: that costs a fraction, and is exact where no slip
        reverses in it.
        """
        first = self._solve(tensions, False, 1)
        return None if first is None else self._approach(first, self._effort)

    def run(self, tensions: Array) -> SearchResult | None:
        """Search from tensions [N]; None where no trial has a solution."""
        return self._search(tensions, by_displacement=False)

    def by_displacement(self, solved: SearchResult) -> SearchResult | None:
        """The same target with prescribed displacements, from the solution with tensions."""
        return self._search(solved.trial.displacements, by_displacement=True)

    def _search(self, inputs: Array, by_displacement: bool) -> SearchResult | None:
        """Search from inputs: first among equal substeps, then with the friction's path; None without any solution.

        A search that fails near the target goes on with the substeps of its last trial: their number changes with the
        inputs, and the tip then moves by up to the tolerance of the path.
        """
        first = self._solve(inputs, by_displacement, None)
        most_refused = MOST_REFUSED_ROUNDS
        if first is not None and not first.exact:
            equal, most_refused = self._equal_substeps(first), 1
            first = first if equal is None else self._solve(equal.trial.inputs, by_displacement, None)
        if first is None:
            return None
        found = self._approach(first, self._effort.around(first.tensions))
        if not found.stationary and found.size > CONVERGED:
            found = self._better(found, self._approach(found.trial, self._effort))
        if not found.stationary and found.size > CONVERGED:
            equal = self._equal_substeps(found.trial)
            found = found if equal is None else self._better(found, equal)
        return self._with_least_effort(found, most_refused) if found.size <= CONVERGED else found

    def _equal_substeps(self, trial: Trial) -> SearchResult | None:
        """Search from the inputs of a trial, with as many equal substeps as it has; None without a solution.

        They cost a fraction of the path on which reversals are located, have exact derivatives, and end near it.
        """
        first = self._solve(trial.inputs, bool(trial.step.displacements), trial.report.substeps)
        if first is None:
            return None
        found = self._approach(first, self._effort)
        return self._with_least_effort(found) if found.size <= CONVERGED else found

    @staticmethod
    def _better(a: SearchResult, b: SearchResult) -> SearchResult:
        return b if b.better_than(a) else a

    def _solve(self, inputs: Array, by_displacement: bool, substeps: int | None) -> Trial | None:
        self.count += 1
        step = self._trials.step(inputs, by_displacement, self._label, self._time, substeps)
        return self._trials.solve(self._start, step)

    def _exact(self, trial: Trial) -> Trial:
        """The trial with exact derivatives; as it is where these cannot be had."""
        return trial if trial.exact else self._trials.solve(self._start, trial.step, exact=True) or trial

    def _moved(self, trial: Trial, step: Array) -> Trial | None:
        """The trial with tensions changed by a step, to first order."""
        if trial.step.displacements:
            return self._solve(trial.inputs + trial.inputs_by_tension @ step, True, trial.step.substeps)
        tensions = np.clip(trial.inputs + step, self._effort.lower, self._effort.upper)
        return self._solve(tensions, False, trial.step.substeps)

    def _found(self, trial: Trial, gain: float, stationary: bool) -> SearchResult:
        size = self._aim.size(trial.tip, trial.tangent)
        return SearchResult(trial, size, max(gain, 0.0), stationary, self._effort.of(trial.tensions))

    def _approach(self, current: Trial, effort: Effort, most_trials: int = MOST_TRIALS) -> SearchResult:
        """Reduce the error by Gauss-Newton steps; of those that do, prefer tensions of little effort.

        Where a hole changes its state, the derivative is another one on both sides. A refused trial is likely to be
        on the other side; its linearisation is then met together with the present one, which leads along the edge.
        """
        aim, scale = self._aim, effort.scale
        radius, ratio, gain = FIRST_RADIUS, WEIGHT_RATIO, np.inf
        refused, verified, end = 0, False, self.count + most_trials
        beside: list[Trial] = []
        while self.count < end and refused < MOST_REFUSALS:
            size = aim.size(current.tip, current.tangent)
            weight = float(np.clip(ratio * size, SMALLEST_WEIGHT, LARGEST_WEIGHT))
            # Where the state of the friction changes, the least effort may be far off: the smallest change instead.
            prefer = effort if refused == 0 else effort.around(current.tensions)
            beside = [x for x in beside if _distance(x, current) <= NEIGHBOURHOOD * radius * scale]
            step, gain = self._step(current, beside, prefer, weight, radius)
            moved = float(np.max(np.abs(step))) / scale
            limited = moved >= 0.999 * radius
            if size <= CONVERGED:
                return self._found(current, gain, True)
            if gain <= ERROR_GAIN * size and beside:
                beside = []
                continue
            if gain <= ERROR_GAIN * size and refused == 0:
                if limited and radius < 1e3:
                    radius *= 4.0
                elif weight > SMALLEST_WEIGHT:
                    ratio *= 0.01
                elif verified or current.exact:
                    return self._found(current, gain, True)
                else:
                    current, verified = self._exact(current), True
                continue
            trial = self._moved(current, step)
            if trial is None:
                radius, refused = 0.25 * moved, refused + 1
                continue
            nearer = size - aim.size(trial.tip, trial.tangent)
            if nearer < 0.1 * gain or gain <= 0.0:
                radius, refused = 0.5 * moved, refused + 1
                beside.append(trial)
                continue
            if nearer > 0.7 * gain and limited:
                radius *= 2.5
            if nearer < 0.5 * gain:
                beside.append(current)
            refused, current, verified = 0, trial, False
        return self._found(current, gain, False)

    def _step(
        self, current: Trial, beside: list[Trial], effort: Effort, weight: float, radius: float
    ) -> tuple[Array, float]:
        """A step that several linearisations expect to reduce the error [N], and the least gain that one expects."""
        aim = self._aim
        residuals = [aim.residual(current.tip, current.tangent)]
        jacobians = [aim.jacobian(current)]
        for each in beside:
            jacobians.append(aim.jacobian(each))
            back = current.tensions - each.tensions
            residuals.append(aim.residual(each.tip, each.tangent) + jacobians[-1] @ back)
        step = effort.step(
            current.tensions, np.concatenate(residuals), np.vstack(jacobians), weight, radius * effort.scale
        )
        left = max(float(np.linalg.norm(r + j @ step)) for r, j in zip(residuals, jacobians, strict=True))
        return step, float(np.linalg.norm(residuals[0])) - left

    def _with_least_effort(self, best: SearchResult, most_refused: int = MOST_REFUSED_ROUNDS) -> SearchResult:
        """Move along the tensions that reach the target, to those of least effort."""
        effort, aim, radius, refused = self._effort, self._aim, FIRST_RADIUS, 0
        for _ in range(MOST_ROUNDS):
            trial = best.trial
            residual, jacobian = aim.residual(trial.tip, trial.tangent), aim.jacobian(trial)
            step = effort.step(trial.tensions, residual, jacobian, SMALLEST_WEIGHT, radius * effort.scale)
            saved = best.effort - effort.of(trial.tensions + step)
            if saved <= EFFORT_GAIN * best.effort or refused == most_refused:
                break
            moved = self._moved(trial, step)
            if moved is not None:
                found = self._approach(moved, effort.around(moved.tensions), MOST_TRIALS_BACK)
                if found.size <= CONVERGED and best.effort - found.effort >= 0.1 * saved:
                    best, refused = found, 0
                    continue
            radius, refused = 0.25 * float(np.max(np.abs(step))) / effort.scale, refused + 1
        return best


def _distance(a: Trial, b: Trial) -> float:
    """Largest difference of the tensions [N]."""
    return float(np.max(np.abs(a.tensions - b.tensions)))

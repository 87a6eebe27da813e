"""Newton's method for one equilibrium, with stick and slip as a complementarity problem in every iteration.

Each unknown v has bounds and a value F(v): F is zero between the bounds, not negative at the lower bound and
not positive at the upper. For the mobilisation s in -1..1 of friction at a hole
``F = presliding (s - s_before) - slip``: stick between the bounds, pull at +1 (the slip exceeds the presliding
range), release at -1. For the tension T >= 0 of a tendon driven by displacement ``F = take-up - displacement``:
zero where it is taut; where it is slack its path is shorter than the remaining tendon.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from tdcr_fe.validation.reference.balance import Forces
from tdcr_fe.validation.reference.settings import Array
from tdcr_fe.validation.reference.statics import State, Statics
from tdcr_fe.validation.reference.tendons import Driver, History, TendonEquations

#: Scaled values below this do not move an unknown off its bound.
_TOLERANCE = 1e-11


def natural_residual(value: Array, v: Array, lower: Array, upper: Array) -> Array:
    """``v - clip(v - F)``, zero exactly where v solves the problem with the values F, shape (n,)."""
    return v - np.clip(v - value, lower, upper)


def solve_box(matrix: Array, offset: Array, start: Array, lower: Array, upper: Array) -> Array:
    """Solve the complementarity problem for ``F(v) = matrix @ v + offset``.

    Whole active sets are exchanged as long as that makes progress; then one index at a time, the least
    first, which ends for every matrix with positive principal minors (Murty's method).

    Parameters
    ----------
    matrix
        Shape (n, n).
    offset
        Shape (n,).
    start
        First guess of v, shape (n,).
    lower, upper
        Bounds; the upper may be infinite, shape (n,).

    Returns
    -------
    numpy.ndarray
        v, shape (n,); the best found where none solves the problem.
    """
    n = len(offset)
    scale = 1.0 / np.maximum(np.abs(np.diag(matrix)), 1e-30)
    v = np.clip(start, lower, upper)
    trial = v - scale * (matrix @ v + offset)
    bound = np.where(trial > upper, 1, np.where(trial < lower, -1, 0))
    best, least = v, np.inf
    for sweep in range(20 + 40 * n):
        v = np.where(bound > 0, upper, np.where(bound < 0, lower, 0.0))
        free, fixed = np.flatnonzero(bound == 0), np.flatnonzero(bound)
        if len(free):
            rest = offset[free] + matrix[np.ix_(free, fixed)] @ v[fixed]
            try:
                v[free] = np.linalg.solve(matrix[np.ix_(free, free)], -rest)
            except np.linalg.LinAlgError:
                v[free] = np.linalg.lstsq(matrix[np.ix_(free, free)], -rest, rcond=None)[0]
        value = scale * (matrix @ v + offset)
        value[free] = 0.0
        wanted = np.where(bound == 0, np.where(v > upper, 1, np.where(v < lower, -1, 0)), bound)
        wanted = np.where((bound == 1) & (value > _TOLERANCE), 0, wanted)
        wanted = np.where((bound == -1) & (value < -_TOLERANCE), 0, wanted)
        wrong = np.flatnonzero(wanted != bound)
        if not len(wrong):
            return v
        inside = np.clip(v, lower, upper)
        value = scale * (matrix @ inside + offset)
        error = float(np.max(np.abs(natural_residual(value, inside, lower, upper))))
        if error < least:
            best, least = inside, error
        if sweep < 20:
            bound = wanted
        else:
            bound[wrong[0]] = wanted[wrong[0]]
    return best


#: Largest scaled residual of a converged state: moments over EI/L, forces over EI/L^2 [1]; iterations in one attempt.
TOLERANCE, MAX_ITERATIONS = 1e-10, 30
#: Number of Newton steps over which the merit function must decrease.
_MEMORY = 3
#: Decrease of the merit function that a step must bring, relative to its linear prediction [1].
_DECREASE = 1e-3
#: Halvings of a Newton step in the line search, at most.
_HALVINGS = 8


@dataclass(frozen=True)
class Attempt:
    """Outcome of one run of Newton's method."""

    state: State
    converged: bool
    iterations: int


@dataclass(frozen=True)
class _Evaluation:
    """Equations, derivatives and residual at one set of unknowns.

    Attributes
    ----------
    state : State
    residual, jacobian : ndarray
        Of rod and tensions.
    equations : TendonEquations or None
    gap, choice : ndarray, shape (c,)
        Complementary pairs: rate equations of friction and slack [m], and mobilisations [1] and tensions [N].
    merit : float
        Norm of all scaled residuals [1].
    """

    state: State
    residual: Array
    jacobian: Array
    equations: TendonEquations | None
    gap: Array
    choice: Array
    merit: float


class Problem:
    """The equations of one substep.

    Parameters
    ----------
    statics
        The robot.
    forces, driver, history
        Loads, prescribed inputs, and friction history.
    presliding
        Slip from rest to full friction [m].
    """

    def __init__(
        self, statics: Statics, forces: Forces, driver: Driver, history: History, presliding: float
    ) -> None:
        self.statics, self.forces, self.driver = statics, forces, driver
        self.history, self.presliding = history, presliding
        self.friction = statics.tendons.n_friction
        self.driven = np.flatnonzero(driver.by_displacement)
        counts = [self.friction, len(self.driven)]
        #: Bounds of mobilisations and of tensions, and their scales.
        self.lower = np.repeat([-1.0, 0.0], counts)
        self.upper = np.repeat([1.0, np.inf], counts)
        self.choice_scale = np.repeat([1.0, statics.force_scale], counts)
        length = statics.length_scale
        self.gap_scale = np.repeat([max(presliding, length), length], counts)
        #: Slip at the holes before the substep, and prescribed displacements [m].
        self.rest = np.concatenate((history.passed, driver.values[self.driven]))

    def evaluate(self, unknowns: Array) -> _Evaluation:
        """Residuals and derivatives; those of a diverged trial are not finite, which rejects it."""
        with np.errstate(over="ignore", invalid="ignore"):
            state, residual, jacobian, equations = self.statics.evaluate(unknowns, self.forces, self.driver)
        choice = gap = np.zeros(0)
        every = residual
        if equations is not None and len(self.rest):
            creep = self.presliding * (state.mobilisation - self.history.mobilisation)
            gap = np.concatenate((creep, np.zeros(len(self.driven)))) - (equations.passed - self.rest)
            gap[self.friction :] *= -1.0
            base_tensions = state.tensions[self.statics.tendons.first[self.driven]]
            choice = np.concatenate((state.mobilisation, base_tensions))
            parts = (x / self.choice_scale for x in (choice, self.lower, self.upper))
            natural = natural_residual(gap / self.gap_scale, *parts)
            every = np.concatenate((residual, natural))
        worst = float(np.max(np.abs(every), initial=0.0))
        merit = float(np.linalg.norm(every))
        return _Evaluation(replace(state, residual=worst), residual, jacobian, equations, gap, choice, merit)

    def step(self, now: _Evaluation) -> Array | None:
        """Change of all unknowns; None where the equations are singular."""
        smooth = self.statics.smooth
        columns = np.concatenate((-now.residual[:, None], -now.jacobian[:, smooth:]), axis=1)
        try:
            solved = np.asarray(np.linalg.solve(now.jacobian[:, :smooth], columns), dtype=float)
        except np.linalg.LinAlgError:
            return None
        if not np.all(np.isfinite(solved)):
            return None
        if now.equations is None or not len(now.gap):
            return solved[:, 0]
        e, m, friction = now.equations, now.equations.passed_by_rod.shape[1], self.friction
        moved = -(e.passed_by_rod @ solved[:m] + e.passed_by_tension @ solved[self.statics.rod_size :])
        moved[friction:] *= -1.0
        matrix = moved[:, 1:]
        matrix[np.arange(friction), np.arange(friction)] += self.presliding
        offset = now.gap + moved[:, 0] - matrix @ now.choice
        change = solve_box(matrix, offset, now.choice, self.lower, self.upper) - now.choice
        return np.concatenate((solved[:, 0] + solved[:, 1:] @ change, change[:friction]))


def solve(problem: Problem, start: Array) -> Attempt:
    """Newton's method from given unknowns, with a line search.

    The equations of rod and tensions are linearised; stick and slip are not: in every iteration they are
    a complementarity problem on the linearised robot, solved exactly.
    """
    x = start.copy()
    now = problem.evaluate(x)
    merits = [now.merit]
    for iteration in range(1, MAX_ITERATIONS + 1):
        step = problem.step(now)
        if step is None:
            return Attempt(now.state, False, iteration)
        found = _line_search(problem, x, step, max(merits[-_MEMORY:]))
        if found is None:
            return Attempt(now.state, now.state.residual <= TOLERANCE, iteration)
        x, now = found
        merits.append(now.merit)
        if now.state.residual <= TOLERANCE:
            return Attempt(now.state, True, iteration)
    return Attempt(now.state, False, MAX_ITERATIONS)


def _line_search(problem: Problem, x: Array, step: Array, merit: float) -> tuple[Array, _Evaluation] | None:
    """Unknowns after the longest part of a step that decreases the merit function; None where none does."""
    share = _longest_share(problem.statics, step)
    for _ in range(_HALVINGS):
        trial = x + share * step
        new = problem.evaluate(trial)
        lower = new.merit <= (1.0 - _DECREASE * share) * merit
        if np.isfinite(new.merit) and (lower or new.state.residual <= TOLERANCE):
            return trial, new
        share *= 0.5
    return None


def _longest_share(statics: Statics, step: Array) -> float:
    """Fraction of a Newton step that turns no interval by more than a radian, so that integration stays stable."""
    moments = step[: statics.rod_size].reshape(statics.n, statics.width)[:, :3]
    change = moments / statics.section.stiffness[:, :3]
    turn = np.linalg.norm(change, axis=1) * statics.layout.lengths * ~statics.layout.section.rigid
    return min(1.0, 1.0 / max(float(np.max(turn)), 1e-12))

"""When an iteration has converged: the list of tests.

Adding a test takes its function here, its entry in `CONVERGENCE_TESTS`, and what it says in `NewtonStatus`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum
from typing import NamedTuple

import numpy as np

from tdcr_fe.elements import Array
from tdcr_fe.model.loading import SolverSettings
from tdcr_fe.solve.equations.kernel import Residual
from tdcr_fe.solve.equations.layout import ResidualScales

#: Largest allowed difference between a mobilisation and that of its trial state: slips below this fraction of the
#: presliding distance are negligible [1].
FRICTION_TOLERANCE = 1e-4
#: Relative residual below which forces balance but for round-off: an iteration may end because its steps are small [1].
BALANCED = 1e-3


class NewtonStatus(Enum):
    """How a Newton solve ended."""

    CONVERGED = "converged"
    STALLED = "converged: the steps have become so small that the rest of the residual is round-off"
    NO_BALANCE = "the forces do not balance"
    NO_FRICTION_STATE = "the stick-slip iteration did not converge"
    NO_CONTACT_STATE = "contact keeps opening and closing"
    CONTACT_PASSED = "nodes move by more than half the size of a contact, which they might jump over"
    CONTACT_TOO_DEEP = "contact is too soft: the centre of one body is inside another"
    UNSTABLE = "the equilibrium in contact is unstable"
    SINGULAR = "the tangent is singular: something in the scene moves freely"
    NOT_FINITE = "the residual is not a number"

    @property
    def converged(self) -> bool:
        """Whether there is a solution."""
        return self in (NewtonStatus.CONVERGED, NewtonStatus.STALLED)


class Iterate(NamedTuple):
    """What the tests see of an iteration."""

    residual: Residual
    softening: float  # Factor on the presliding distance [1]
    with_friction: bool  # Whether mobilisations are among the unknowns


def friction_error(iterate: Iterate) -> float:
    """Largest distance of any mobilisation from the one that its slip leads to [1]."""
    worst, state = 0.0, iterate.residual.state
    for own, s, before in zip(iterate.residual.forces, state.mobilisation, state.friction, strict=True):
        law = own.model.law
        if law.has_friction and iterate.with_friction:
            trial = law.hysteresis.softened(iterate.softening).trial(own.field.slip, before)
            worst = max(worst, float((np.abs(trial.clip(-1.0, 1.0) - s) * law.frictional).max()))
    return worst


@dataclass(frozen=True)
class ConvergenceTest:
    """One condition that a solution meets."""

    error: Callable[[Iterate], float]  # From an iterate to a number, not negative [1]
    tolerance: Callable[[SolverSettings], float]  # From the settings to the largest error allowed [1]
    status: NewtonStatus  # Of a solve that does not meet it
    measured: str  # What the error is, in words


#: All conditions of a solution, in the order in which they are tested; a test is made where those before it are met.
CONVERGENCE_TESTS: tuple[ConvergenceTest, ...] = (
    ConvergenceTest(
        lambda iterate: iterate.residual.size,
        lambda settings: settings.tolerance,
        NewtonStatus.NO_BALANCE,
        "the relative residual is",
    ),
    ConvergenceTest(
        friction_error,
        lambda settings: FRICTION_TOLERANCE,
        NewtonStatus.NO_FRICTION_STATE,
        "a mobilisation is off by",
    ),
)


class Unmet(NamedTuple):
    """A test that is not met."""

    test: ConvergenceTest
    error: float  # What was found, and what is allowed [1]
    tolerance: float  # as `error`

    @property
    def status(self) -> NewtonStatus:
        """Of a solve that ends here."""
        return self.test.status

    @property
    def text(self) -> str:
        """What is measured, how large it is, and what is allowed."""
        return f"{self.test.measured} {self.error:.1e}, tolerance {self.tolerance:.0e}"


def first_unmet(iterate: Iterate, settings: SolverSettings, *, balance: bool = True) -> Unmet | None:
    """The first test that an iterate does not meet; None where it is a solution.

    Parameters
    ----------
    iterate
        State of the iteration.
    settings
        Of the solver.
    balance
        Whether balance is among the tests; it is not where an iteration has stalled, see `stalled`.
    """
    for test in CONVERGENCE_TESTS:
        if test.status is NewtonStatus.NO_BALANCE and not balance:
            continue
        error, tolerance = test.error(iterate), test.tolerance(settings)
        if not error <= tolerance:
            return Unmet(test, error, tolerance)
    return None


def stalled(
    before: float, after: float, step: Array, scales: ResidualScales, settings: SolverSettings
) -> bool:
    """Whether a step is so small that the rest of the residual is round-off of very stiff parts.

    Parameters
    ----------
    before, after
        Relative residual before and after the step [1].
    step
        Change of the unknowns.
    scales
        Of the scene.
    settings
        Of the solver.
    """
    return max(before, after) < BALANCED and scales.step_size(step) <= settings.step_tolerance

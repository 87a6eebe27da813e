"""When an iteration has converged: the conditions of a solution.

Adding a condition takes its test in `first_unmet`, and what it says in `NewtonStatus`.
"""

from __future__ import annotations

from enum import Enum
from typing import NamedTuple

import numpy as np

from tdcr_fe.model.loading import SolverSettings
from tdcr_fe.solve.equations.kernel import Residual

#: Largest allowed difference between a mobilisation and that of its trial state: slips below this fraction of the
#: presliding distance are negligible [1].
FRICTION_TOLERANCE = 1e-4
#: Relative residual below which forces balance but for round-off: an iteration may end because its steps are small [1].
BALANCED = 1e-3


class NewtonStatus(Enum):
    """How a Newton solve ended."""

    CONVERGED = "converged"
    NO_BALANCE = "the forces do not balance"
    NO_FRICTION_STATE = "the stick-slip iteration did not converge"
    NO_CONTACT_STATE = "contact keeps opening and closing"
    CONTACT_PASSED = "nodes move by more than the size of a contact, which they might jump over"
    CONTACT_TOO_DEEP = "contact is too soft: the centre of one body is inside another"
    UNSTABLE = "the equilibrium is unstable"
    SINGULAR = "the tangent is singular: something in the scene moves freely"
    NOT_FINITE = "the residual is not a number"


class Unmet(NamedTuple):
    """A condition of a solution that is not met."""

    status: NewtonStatus  # Status of a solve that ends here
    measured: str  # What the error is, in words
    error: float  # The error that was found [1]
    tolerance: float  # The largest error that is allowed [1]

    @property
    def text(self) -> str:
        """What is measured, how large it is, and what is allowed."""
        return f"{self.measured} {self.error:.1e}, tolerance {self.tolerance:.0e}"


def first_unmet(
    residual: Residual, softening: float, friction_fixed: bool, settings: SolverSettings, balance: bool = True
) -> Unmet | None:
    """The first condition that an iterate does not meet, each being tested where those before it are met.

    Parameters
    ----------
    residual
        Residual of the iterate.
    softening
        Factor on the presliding distance [1].
    friction_fixed
        Whether mobilisations are given, and not unknowns.
    settings
        Settings of the solver.
    balance
        Whether balance is among the conditions; it is not where an iteration has stalled.

    Returns
    -------
    Unmet or None
        None where the iterate is a solution.
    """
    if balance and not residual.size <= settings.tolerance:
        return Unmet(NewtonStatus.NO_BALANCE, "the relative residual is", residual.size, settings.tolerance)
    error = 0.0 if friction_fixed else _friction_error(residual, softening)
    if not error <= FRICTION_TOLERANCE:
        return Unmet(NewtonStatus.NO_FRICTION_STATE, "a mobilisation is off by", error, FRICTION_TOLERANCE)
    return None


def _friction_error(residual: Residual, softening: float) -> float:
    """Largest distance of any mobilisation from the one that its slip leads to [1]."""
    worst, state = 0.0, residual.state
    for own, s, before in zip(residual.forces, state.mobilisation, state.friction, strict=True):
        law = own.model.law
        if law.has_friction:
            trial = law.hysteresis.softened(softening).trial(own.field.slip, before)
            worst = max(worst, float((np.abs(trial.clip(-1.0, 1.0) - s) * law.frictional).max()))
    return worst

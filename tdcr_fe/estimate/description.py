"""What is estimated, and what is known before: `LoadPrior`, `InputPrior`, `ParameterPrior`; a result: `Estimate`."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Annotated, Literal

import numpy as np

from tdcr_fe.elements import Array
from tdcr_fe.io.keys import InputErrors
from tdcr_fe.model.messages import shown
from tdcr_fe.model.results import StepResult
from tdcr_fe.model.robot import by_tendon
from tdcr_fe.model.schema import Checked, FieldError, Quantity

_PLACE = 'an arc length above zero [m], "tip" or "unknown"'


@dataclass(frozen=True)
class LoadPrior(Checked):
    """The load to be estimated, and what is known of it before any reading; the table ``[load]``.

    Attributes
    ----------
    at : float, "tip" or "unknown"
        Arc length at which it acts [m]; "unknown": somewhere along the body, to be estimated.
    sigma : float
        Standard deviation of each component of the force [N]; its mean is zero.
    sigma_moment : float
        The same of the moment [N m]; 0: there is no moment.
    correlation_time : float
        Correlation time of the Gauss-Markov process that the components follow; 0: nothing is known from the frame
        before [s].
    random_walk : float
        In place of it: growth of the standard deviation in one second, in units of sigma [1].
    """

    at: Annotated[float | Literal["tip", "unknown"], Quantity(unit="m", gt=0.0, allowed=_PLACE)] = "tip"
    sigma: Annotated[float, Quantity(unit="N", gt=0.0)] = 0.05
    sigma_moment: Annotated[float, Quantity(unit="N m", ge=0.0)] = 0.0
    correlation_time: Annotated[float, Quantity(unit="s", ge=0.0)] = 1.0
    random_walk: Annotated[float, Quantity(ge=0.0)] = 0.0

    def check(self, length: float) -> None:
        """Raise a FieldError where it does not fit a backbone of a length [m]."""
        if not isinstance(self.at, str) and self.at > length:
            text = f"must be at most the length of the backbone, {length:g} m"
            raise FieldError("load.at", shown(self.at), text)


@dataclass(frozen=True)
class InputPrior(InputErrors):
    """Errors of the inputs: what acts minus what is commanded or measured; the table ``[inputs]``.

    Attributes
    ----------
    sigma : float or mapping of str to float
        Standard deviation, of every tendon or by name: [N] where the tension is given, [m] where the displacement is,
        [rad] where the angle of the motor is.
    correlation_time : float
        Correlation time of the Gauss-Markov process that the errors follow; 0: nothing is known from the frame before
        [s].
    random_walk : float
        In place of it: growth of the standard deviation in one second, in units of sigma [1].
    """

    correlation_time: Annotated[float, Quantity(unit="s", ge=0.0)] = 1.0
    random_walk: Annotated[float, Quantity(ge=0.0)] = 0.0

    def sigmas(self, names: Sequence[str]) -> Array:
        """Standard deviations of all tendons, shape (n_tendons,); a FieldError where not all of them are named."""
        return by_tendon("inputs.sigma", self.sigma, names)


@dataclass(frozen=True, eq=False)
class ParameterPrior:
    """Effects on the robot whose numbers have constant errors, such as friction that is known to 0.03.

    Attributes
    ----------
    names : tuple of str
        Names of these numbers, ``"EFFECT.PARAMETER"`` with the names of the table ``[effects]``.
    covariance : ndarray, shape (q, q)
        Covariance of their errors; of a number that `identify` fits through its inverse, of the error of that.
    effects : mapping
        Values of effects that the robot has besides its description, by effect and parameter; without one a number has
        its null value.
    """

    names: tuple[str, ...] = ()
    covariance: Array = field(default_factory=lambda: np.zeros((0, 0)))
    effects: Mapping[str, Mapping[str, float]] = field(default_factory=dict)

    @classmethod
    def independent(cls, sigma: Mapping[str, float]) -> ParameterPrior:
        """Numbers with independent errors, from their standard deviations by name."""
        return cls(tuple(sigma), np.diag([x**2 for x in sigma.values()]))


def memory(prior: LoadPrior | InputPrior, elapsed: float) -> tuple[float, float]:
    """Factor from one frame to the next, and growth of the variance in units of sigma squared [1].

    ``elapsed``: time between the frames [s].
    """
    if prior.random_walk > 0.0:
        return 1.0, prior.random_walk**2 * elapsed
    kept = math.exp(-elapsed / prior.correlation_time) if prior.correlation_time > 0.0 else 0.0
    return kept, 1.0 - kept**2


@dataclass(frozen=True, eq=False)
class Passage:
    """What the readings of a frame say about its unknowns, and how these go on; see `smoothed`."""

    kept: Array  # (n,): What is left of the unknowns at the end of the frame before
    covariance: Array  # (n, n): Covariance of the unknowns before the readings
    jacobian: Array  # (n_readings, n): Derivatives of the readings over their noise by the unknowns
    pull: Array  # (n,): The readings have changed the mean by the covariance times this
    carried: Array  # (n, n): From the unknowns to those at the end of the frame
    positions: Array  # (N, 3, n): Derivatives of the positions of the nodes by the unknowns
    rotations: Array  # (N, 3, n): Derivatives of their rotations
    base_tensions: Array  # (m, n): Derivatives of the tensions at the base


@dataclass(frozen=True, eq=False)
class Estimate:
    """The most probable state of a robot in one frame.

    Attributes
    ----------
    result : StepResult
        Shape, tensions and states of the holes.
    time : float
        [s].
    at, sigma_at : float
        Where the load acts and its standard deviation, zero where it is known [m].
    force, moment : ndarray, shape (3,)
        The estimated load [N, N m]; what ``loading.csv`` names acts besides.
    force_covariance, moment_covariance : ndarray, shape (3, 3)
        [N^2, N^2 m^2].
    input_errors : ndarray, shape (n_tendons,)
        Inputs that act less those that were given [N, m or rad].
    parameters, sigma_parameters : ndarray, shape (q,)
        Uncertain numbers of effects, and their standard deviations, in the order of `ParameterPrior.names`.
    tensions, sigma_tensions : ndarray, shape (n_tendons,)
        At the base, and their standard deviations [N].
    tension_covariance : ndarray, shape (n_tendons, n_tendons)
        [N^2].
    position_covariance : ndarray, shape (n, 3, 3)
        Covariance of the positions of the nodes of ``result`` [m^2].
    misfit : float
        Sum of squares of the errors and of the readings that the most probable state leaves, in units of their
        standard deviations [1].
    milliseconds : float
        Time that it took.
    message : str
        Empty, or why the frame was not solved: the state is then that without its readings, or where there is none that
        of the frame before.
    passage : Passage or None
        What `smoothed` needs; None where the state is that of the frame before.
    """

    result: StepResult
    time: float
    at: float
    sigma_at: float
    force: Array
    moment: Array
    force_covariance: Array
    moment_covariance: Array
    input_errors: Array
    parameters: Array
    sigma_parameters: Array
    tensions: Array
    tension_covariance: Array
    position_covariance: Array
    misfit: float
    milliseconds: float
    message: str = ""
    passage: Passage | None = None

    @property
    def sigma_tensions(self) -> Array:
        """Standard deviations of the tensions at the base [N], shape (n_tendons,)."""
        return np.sqrt(np.diagonal(self.tension_covariance))

    @property
    def tip(self) -> Array:
        """Position of the tip [m], shape (3,)."""
        return self.result.positions[-1]

    @property
    def sigma_tip(self) -> Array:
        """Standard deviations of its coordinates [m], shape (3,)."""
        return np.sqrt(np.diagonal(self.position_covariance[-1]))

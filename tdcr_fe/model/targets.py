"""Targets of the tip, limits of the tensions, and what inverse statics found. Imports no solver."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import Enum
from typing import TYPE_CHECKING, Annotated, Literal

import numpy as np
from numpy.typing import ArrayLike

from tdcr_fe.elements import Array, Flags
from tdcr_fe.model.columns import tendon_columns
from tdcr_fe.model.loading import LoadStep, Vector
from tdcr_fe.model.results import SequenceResult, StepResult
from tdcr_fe.model.robot import Robot, by_tendon
from tdcr_fe.model.schema import Checked, FieldError, Quantity

if TYPE_CHECKING:
    import pandas as pd

#: What drives the tendons.
DriveBy = Literal["tension", "displacement"]
#: Whose sum of squares is smallest among all tensions that reach a target.
EffortKind = Literal["tension", "change"]


@dataclass(frozen=True)
class TipTarget(Checked):
    """A position of the tip, and a direction of its tangent where that matters.

    Attributes
    ----------
    position : (float, float, float)
        World frame [m]; None leaves a coordinate open.
    direction : (float, float, float) or None
        Direction of the tangent at the tip, of any length; None leaves it free.
    label : str
        For tables and pictures.
    time : float or None
        At which the target is to be reached [s]; for creep and for friction that depends on the slip rate.
    """

    position: Annotated[tuple[float | None, float | None, float | None], Quantity(unit="m")]
    direction: Vector | None = None
    label: str = ""
    time: Annotated[float | None, Quantity(unit="s")] = None

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.direction is not None and not any(self.direction):
            raise ValueError("TipTarget.direction = (0, 0, 0): must not be zero; None leaves it free")
        if self.direction is None and not self.given.any():
            raise ValueError("TipTarget.position = (None, None, None): must be given in part")

    @property
    def given(self) -> Flags:
        """Which coordinates of the position are given, shape (3,)."""
        return np.array([x is not None for x in self.position])

    @property
    def unit_direction(self) -> Array | None:
        """Direction of length 1, shape (3,)."""
        if self.direction is None:
            return None
        direction = np.array(self.direction)
        return np.asarray(direction / np.linalg.norm(direction))


def tip_targets(targets: ArrayLike | Sequence[TipTarget] | TipTarget) -> tuple[TipTarget, ...]:
    """Targets from a table: three columns for positions [m], six with directions.

    Parameters
    ----------
    targets
        One or several `TipTarget`, or an array of shape (n, 3) or (n, 6); None leaves a coordinate open.

    Raises
    ------
    ValueError
        The array has another shape, or a number is not finite.
    """
    if isinstance(targets, TipTarget):
        return (targets,)
    if isinstance(targets, Sequence) and targets and all(isinstance(x, TipTarget) for x in targets):
        return tuple(x for x in targets if isinstance(x, TipTarget))
    table = np.atleast_2d(np.array(targets, dtype=object))
    if table.ndim != 2 or table.shape[0] == 0 or table.shape[1] not in (3, 6):
        raise ValueError(
            "targets: must be TipTarget objects, or an array of shape (n, 3) for positions [m] or (n, 6) for "
            f"positions and directions; the shape is {table.shape}"
        )
    return tuple(TipTarget(tuple(row[:3]), tuple(row[3:]) if len(row) == 6 else None) for row in table)


_TENSION = Quantity(unit="N", ge=0.0, allowed="a tension [N], zero or more, or a table of tensions by tendon")


@dataclass(frozen=True)
class TensionLimits(Checked):
    """Bounds of the tensions at the base.

    Attributes
    ----------
    largest : float or mapping of str to float
        Largest tension, of all tendons or by tendon [N].
    pretension : float or mapping of str to float
        Smallest tension, of all tendons or by tendon; above zero no tendon becomes slack [N].
    """

    largest: Annotated[float | Mapping[str, float], _TENSION]
    pretension: Annotated[float | Mapping[str, float], _TENSION] = 0.0

    def bounds(self, names: Sequence[str]) -> tuple[Array, Array]:
        """Smallest and largest tension of every tendon [N], each of shape (n_tendons,).

        Raises
        ------
        ValueError
            A tendon is missing or unknown, or the bounds of one exclude each other.
        """
        lower = by_tendon("TensionLimits.pretension", self.pretension, names, 0.0)
        upper = by_tendon("TensionLimits.largest", self.largest, names)
        for name, low, high in zip(names, lower, upper, strict=True):
            if low > high:
                text = f"above the largest tension of {name}, {high:g} N"
                raise FieldError("TensionLimits.pretension", f"{low:g}", text)
        return lower, upper


class ReachStatus(Enum):
    """How the search for one target ended."""

    REACHED = "reached"
    OUT_OF_REACH = "out of reach"
    NOT_CONVERGED = "not converged"


@dataclass(frozen=True)
class ReachedTarget:
    """The tensions found for one target.

    Attributes
    ----------
    target : TipTarget
    status : ReachStatus
        Out of reach: no admissible change of the tensions reduces the distance to first order at a bearable price.
        Not converged: the search ended elsewhere, so that nothing is known.
    error : float
        Distance of the tip from the target, over the given coordinates [m].
    direction_error : float or None
        Angle between the tangent at the tip and the target's direction [rad]; None where that is free.
    tensions : ndarray, shape (n_tendons,)
        At the base [N].
    displacements : ndarray, shape (n_tendons,)
        Pulled in at the base [m].
    at_largest : tuple of str
        Tendons whose tension is at its upper bound.
    possible_gain : float
        By how much the linearised robot could still come closer within the bounds, less the price of the tensions, as a
        fraction of its length [1].
    trials : int
        Load steps that were solved for this target.
    starts : int
        Tensions that the search was started from.
    step : LoadStep
        That takes the robot from the target before to this one.
    result : StepResult
        State of the robot.
    """

    target: TipTarget
    status: ReachStatus
    error: float
    direction_error: float | None
    tensions: Array
    displacements: Array
    at_largest: tuple[str, ...]
    possible_gain: float
    trials: int
    starts: int
    step: LoadStep
    result: StepResult

    @property
    def reached(self) -> bool:
        """Whether the target was reached."""
        return self.status is ReachStatus.REACHED

    @property
    def sentence(self) -> str:
        """The outcome in one sentence."""
        angle = "" if self.direction_error is None else f" and {np.degrees(self.direction_error):.3g} deg"
        how_far = f"{1e3 * self.error:.3g} mm{angle}"
        if self.reached:
            return f"reached, error {how_far}"
        if self.status is ReachStatus.NOT_CONVERGED:
            return f"not converged, {how_far} away; try targets closer together or other bounds"
        at = f"; at the largest tension: {', '.join(self.at_largest)}" if self.at_largest else ""
        return f"out of reach; the nearest point found is {how_far} away{at}"

    def __repr__(self) -> str:
        names = tuple(self.step.tensions) or tuple(self.step.displacements)
        pulled = ", ".join(f"{n} {t:.4g} N" for n, t in zip(names, self.tensions, strict=True))
        return f"{self.target.label or 'target'}: {self.sentence}; {pulled}"


@dataclass(frozen=True)
class FollowResult:
    """Tensions or displacements that take the tip through targets; printed, it is a summary.

    Attributes
    ----------
    targets : tuple of ReachedTarget
        In order; all of them where no load step failed.
    steps : tuple of LoadStep
        The loading sequence, with the steps before the first target; `simulate` with the same model reproduces it.
    simulation : SequenceResult
        The same sequence as solved.
    tolerance : float
        Error with which a target counts as reached [m].
    wall_time : float
        [s].
    """

    targets: tuple[ReachedTarget, ...]
    steps: tuple[LoadStep, ...]
    simulation: SequenceResult
    tolerance: float
    wall_time: float

    @property
    def robot(self) -> Robot:
        """Whose tip follows the path."""
        return self.simulation.robot

    @property
    def out_of_reach(self) -> tuple[int, ...]:
        """Numbers of the targets that are out of reach, from 1."""
        return self.numbers(ReachStatus.OUT_OF_REACH)

    @property
    def not_converged(self) -> tuple[int, ...]:
        """Numbers of the targets at which the search did not converge, from 1."""
        return self.numbers(ReachStatus.NOT_CONVERGED)

    def numbers(self, status: ReachStatus) -> tuple[int, ...]:
        """Numbers of the targets with a status, from 1."""
        return tuple(k for k, x in enumerate(self.targets, start=1) if x.status is status)

    @property
    def errors(self) -> Array:
        """Distances of the tip from the targets [m], shape (n_targets,)."""
        return np.array([x.error for x in self.targets])

    @property
    def tensions(self) -> Array:
        """At the base [N], shape (n_targets, n_tendons)."""
        return np.array([x.tensions for x in self.targets])

    @property
    def displacements(self) -> Array:
        """Pulled in at the base [m], shape (n_targets, n_tendons)."""
        return np.array([x.displacements for x in self.targets])

    def to_frame(self) -> pd.DataFrame:
        """One row per target, with the columns of ``targets.csv``."""
        import pandas as pd

        columns = [
            *("target", "label", "step", "status", "error", "direction_error"),
            *("x", "y", "z", "dx", "dy", "dz"),
            *("tip_x", "tip_y", "tip_z", "tangent_x", "tangent_y", "tangent_z"),
            *tendon_columns(self.robot.tendon_names),
            *("at_largest", "possible_gain", "trials", "starts"),
        ]
        rows = [
            [
                *(number, x.target.label, x.result.step, x.status.value, x.error, x.direction_error),
                *(*x.target.position, *(x.target.direction or (None, None, None))),
                *(*x.result.tip, *x.result.tangent, *x.tensions, *x.displacements),
                *(" ".join(x.at_largest), x.possible_gain, x.trials, x.starts),
            ]
            for number, x in enumerate(self.targets, start=1)
        ]
        return pd.DataFrame(rows, columns=columns)

    def __repr__(self) -> str:
        reached = f"{sum(x.reached for x in self.targets)} reached within {1e3 * self.tolerance:.3g} mm"
        others = {"out of reach": self.out_of_reach, "not converged": self.not_converged}
        outcome = [reached, *(f"{len(numbers)} {what}" for what, numbers in others.items() if numbers)]
        lines = [
            f"robot         {self.robot.name}: {len(self.robot.tendons)} tendons",
            f"targets       {len(self.targets)}: {', '.join(outcome)}",
            f"load steps    {sum(x.trials for x in self.targets)} solved in {self.wall_time:.2f} s",
        ]
        if not self.simulation.converged:
            lines.append(f"stopped       {self.simulation.message}")
        if self.targets:
            lines.append(f"largest error {1e3 * float(self.errors.max()):.3g} mm")
            lines.append(f"tension [N]   {self.tensions.min():.4g} to {self.tensions.max():.4g}")
        return "\n".join(lines)

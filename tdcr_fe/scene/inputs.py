"""Tendon inputs of a robot in a scene: those set by name, and those over time, checked at every call."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tdcr_fe.elements.native.actuation import TendonActuation

Array = NDArray[np.float64]
#: A tension this far below zero is taken as zero: round-off of the user's function [N].
TENSION_ROUND_OFF = 1e-9


@dataclass(frozen=True, eq=False)
class InputsOverTime:
    """Inputs as a function of time, checked whenever a solver asks for them.

    Attributes
    ----------
    robot : str
        Name of the robot, for messages.
    names : tuple of str
        Of its tendons.
    actuation : TendonActuation
        Has which tendons are driven by displacement.
    function : callable
        From time [s] to tension [N] or displacement [m] of every tendon, shape (m,).
    """

    robot: str
    names: tuple[str, ...]
    actuation: TendonActuation
    function: Callable[[float], Sequence[float]]

    def __call__(self, t: float) -> Array:
        """Inputs at a time [s], shape (m,).

        Raises
        ------
        ValueError
            Not one finite number per tendon, or a negative tension.
        """
        where = f"robot {self.robot!r}: the function of set_inputs_over_time, at time {t:g} s"
        try:
            values = np.array(self.function(t), dtype=float)
        except (TypeError, ValueError) as wrong:
            raise ValueError(f"{where}: {wrong}; must return {self._expected}") from wrong
        if values.shape != (len(self.names),):
            raise ValueError(f"{where}, returned {values.tolist()}; must be {self._expected}")
        push = ~self.actuation.by_displacement & (values < 0.0)
        wrong_ones = ~np.isfinite(values) | (push & (values < -TENSION_ROUND_OFF))
        if np.any(wrong_ones):
            k = int(np.argmax(wrong_ones))
            raise ValueError(
                f"{where}, returned {values[k]:g} for tendon {self.names[k]!r}; must be finite, a tension >= 0"
            )
        values[push] = 0.0
        return values

    @property
    def _expected(self) -> str:
        return f"a number for each of {len(self.names)} tendons ({', '.join(self.names)})"


def named_inputs(
    names: Sequence[str], given: Mapping[str, float] | Sequence[float], by_displacement: bool
) -> dict[str, float]:
    """Inputs by tendon, checked.

    Parameters
    ----------
    names
        Of the tendons.
    given
        Tension [N] or displacement [m], by tendon or of every tendon in order.
    by_displacement
        Whether they are displacements.

    Raises
    ------
    ValueError
        Another number of values than tendons, an unknown name, a value that is not finite, or a negative tension.
    """
    if not isinstance(given, Mapping):
        if len(given) != len(names):
            raise ValueError(f"{len(given)} values for {len(names)} tendons ({', '.join(names)})")
        given = dict(zip(names, given, strict=True))
    unknown = sorted(set(given) - set(names))
    if unknown:
        raise ValueError(f"no tendon {unknown[0]!r}; the robot has {', '.join(names) or 'none'}")
    values = {name: float(value) for name, value in given.items()}
    for name, value in values.items():
        if not np.isfinite(value) or (value < 0.0 and not by_displacement):
            raise ValueError(f"tendon {name!r}: {value} is not allowed; must be finite, a tension >= 0")
    return values

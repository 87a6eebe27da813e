"""Experiments at neighbouring values of a parameter, and the difference quotients that they give.

What follows from a parameter by explicit formulas is differentiated by such quotients.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from tdcr_fe.effects import Experiment
from tdcr_fe.model.loading import LoadStep
from tdcr_fe.solve.sensitivities.parameters import ModelParameter, Parameter

#: Difference steps: central, or to one side where the other is impossible; offsets and weights in units of the step.
_RULES = (
    ((1.0, -1.0), (0.5, -0.5), 0.0),
    ((1.0, 2.0), (2.0, -0.5), -1.5),
    ((-1.0, -2.0), (-2.0, 0.5), 1.5),
)
#: Difference step over the size of a parameter [1].
RELATIVE_STEP = 1e-5


class StructureChanged(ValueError):
    """A parameter changes the mesh or the number of load steps, so that results cannot be compared."""


class NoDerivative(ValueError):
    """There is no derivative by a parameter.

    Attributes
    ----------
    parameter, reason : str
    """

    def __init__(self, parameter: Parameter, reason: object) -> None:
        value = f" at {parameter.value:g}" if isinstance(parameter, ModelParameter) else ""
        super().__init__(f"sensitivities: no derivative by {parameter.name}{value}: {reason}")
        self.parameter, self.reason = parameter.name, str(reason)


@dataclass(frozen=True, eq=False)
class Stencil:
    """Experiments at neighbouring values, and the weights with which they give a derivative.

    Attributes
    ----------
    weights : ndarray, shape (k,)
        Of the neighbours.
    base_weight : float
        Of the present experiment.
    experiments : tuple of Experiment
        The neighbours.
    """

    weights: np.ndarray
    base_weight: float
    experiments: tuple[Experiment, ...]


def stencil(
    experiment: Experiment, parameter: ModelParameter, fits: Callable[[Experiment], None] | None = None
) -> Stencil:
    """Neighbours of an experiment by a parameter: on both sides, or on one where the other is impossible.

    Parameters
    ----------
    experiment
        The present one.
    parameter
        What is changed.
    fits
        Raises `StructureChanged` where an experiment cannot be compared with the present one.

    Raises
    ------
    NoDerivative
        There are no such neighbours.
    """
    step = RELATIVE_STEP * parameter.size
    reason: ValueError | None = None
    for offsets, weights, base in _RULES:
        try:
            found = tuple(parameter.apply(experiment, parameter.value + step * x) for x in offsets)
            for each in found:
                if fits is not None:
                    fits(each)
        except ValueError as error:
            if not isinstance(reason, StructureChanged):
                reason = error
            continue
        return Stencil(np.array(weights) / step, base / step, found)
    raise NoDerivative(parameter, reason) from reason


@dataclass(frozen=True, eq=False)
class Tabulated:
    """Neighbours of an experiment that were made beforehand, as `ModelParameter.apply`; can be sent to a process.

    Attributes
    ----------
    value, step : float
        Present value, and the difference step.
    experiments : mapping of int to Experiment
        By offset from the present value, in difference steps.
    refused : str
        Why there are no others.
    """

    value: float
    step: float
    experiments: Mapping[int, Experiment]
    refused: str = ""

    def __call__(self, experiment: Experiment, value: float) -> Experiment:
        """The neighbour with a value; ValueError where it was not made."""
        offset = round((value - self.value) / self.step)
        if offset not in self.experiments:
            raise ValueError(self.refused or f"no neighbour at {value:g}")
        return self.experiments[offset]


def tabulated(parameter: ModelParameter, experiment: Experiment) -> ModelParameter:
    """A parameter whose neighbours are made now: on both sides, or two on the side where that is possible."""
    step = RELATIVE_STEP * parameter.size
    found: dict[int, Experiment] = {}
    refused = ""
    for offset in (1, -1, 2, -2):
        if abs(offset) == 2 and ((-1 in found and 1 in found) or offset // 2 not in found):
            continue
        try:
            found[offset] = parameter.apply(experiment, parameter.value + step * offset)
        except ValueError as error:
            refused = str(error)
    return replace(parameter, apply=Tabulated(parameter.value, step, found, refused))


def same_structure(present: Sequence[LoadStep], other: Sequence[LoadStep]) -> bool:
    """Whether two loading sequences name the same inputs and loads in the same number of steps."""
    return len(present) == len(other) and all(
        set(a.tensions) == set(b.tensions)
        and set(a.displacements) == set(b.displacements)
        and {n: x.frame for n, x in a.loads.items()} == {n: x.frame for n, x in b.loads.items()}
        for a, b in zip(present, other, strict=True)
    )

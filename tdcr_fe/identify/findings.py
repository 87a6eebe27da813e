"""Parts of the result of an identification: effects, candidates, shapes, what remains, and the next experiment."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from tdcr_fe.identify.estimate import Estimate
from tdcr_fe.identify.misfit import Misfit
from tdcr_fe.model.loading import LoadStep

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Shapes:
    """Measured and predicted positions, for pictures; NaN where nothing was measured or solved.

    Attributes
    ----------
    step_ids : tuple of int
        As ``loading.csv`` numbers the steps; the first axis of all arrays.
    branches : tuple of str
        Label of the branch of every step; empty where the file has none.
    held_out : ndarray of bool, shape (n_steps,)
    arc_lengths : ndarray, shape (n_locations,)
        Where positions were measured [m].
    measured, before, after : ndarray, shape (n_steps, n_locations, 3)
        Measured positions, and those predicted by the declared and by the final model, in the measuring frame [m].
    backbone_before, backbone_after : ndarray, shape (n_steps, n_nodes, 3)
        Predicted backbone (without marker offsets) in the measuring frame, base first, tip last [m].
    """

    step_ids: tuple[int, ...]
    branches: tuple[str, ...]
    held_out: NDArray[np.bool_]
    arc_lengths: Array
    measured: Array
    before: Array
    after: Array
    backbone_before: Array
    backbone_after: Array


@dataclass(frozen=True)
class AddedEffect:
    """An effect that was added.

    Attributes
    ----------
    name : str
    parameters : mapping of str to Estimate
        From the final model.
    after_fit, after_held_out : Misfit
        With this effect and all before it; `NOT_EVALUATED` where the time did not suffice for that model.
    evidence : mapping
        Evidence for it; empty where the model with it, or that before it, was not evaluated.
    indistinguishable_from : tuple of str
        Effects that explain these data as well.
    separating_experiment : str
        Experiment that separates them.
    """

    name: str
    parameters: Mapping[str, Estimate]
    after_fit: Misfit
    after_held_out: Misfit
    evidence: Mapping[str, Any]
    indistinguishable_from: tuple[str, ...] = ()
    separating_experiment: str = ""


@dataclass(frozen=True)
class Candidate:
    """Result of one candidate in one round.

    Attributes
    ----------
    round : int
    model : tuple of str
        Effects already in the model.
    name : str
    drop : float
        By how much the misfit would fall to first order, over the misfit per degree of freedom [1].
    fitted : bool
    chi2_fit, chi2_held_out : float or None
        Per reading, after the fit [1].
    note : str
    """

    round: int
    model: tuple[str, ...]
    name: str
    drop: float
    fitted: bool = False
    chi2_fit: float | None = None
    chi2_held_out: float | None = None
    note: str = ""


#: Where the error remains if the data have a fault, or if errors of the inputs account for all of it.
THE_DATA, THE_INPUTS, THE_NOISE = "the data", "the inputs", "the noise"


@dataclass(frozen=True)
class Remainder:
    """What is left.

    Attributes
    ----------
    where, description : str
    moment : ndarray or None
        Missing bending moment about the section's x and y axes, shape (n_steps, n_bays, 2) [N m].
    bays : ndarray or None
        Edges of the bays [m], shape (n_bays + 1,).
    """

    where: str
    description: str
    moment: Array | None = None
    bays: Array | None = None


@dataclass(frozen=True)
class SetErrors:
    """Errors on one of several data sets.

    Attributes
    ----------
    name : str
    first, last : int
        Its steps in the joined numbering.
    before_fit, before_held_out, after_fit, after_held_out : Misfit
    """

    name: str
    first: int
    last: int
    before_fit: Misfit
    before_held_out: Misfit
    after_fit: Misfit
    after_held_out: Misfit

    def to_json(self) -> dict[str, Any]:
        """As in ``result.json``."""
        return {
            "dataset": self.name,
            "steps": [self.first, self.last],
            "before": {"fit": self.before_fit.to_json(), "held_out": self.before_held_out.to_json()},
            "after": {"fit": self.after_fit.to_json(), "held_out": self.after_held_out.to_json()},
        }


#: An experiment helps if it separates explanations by so many sigma, or leaves so much of a standard error at most.
LEAST_SEPARATION, MOST_REMAINING = 2.0, 0.9


@dataclass(frozen=True)
class NextExperiment:
    """A loading sequence, from the unloaded robot, that helps most.

    Attributes
    ----------
    steps : tuple of LoadStep
    purpose : str
        What it shows, with the expected separation or reduction.
    separated : tuple of str
        Explanations that it separates from the result's; empty where it refines a parameter.
    separation : tuple of float
        Expected difference from each, over the noise and the uncertainty of the parameters [sigma].
    parameter : str
        Whose standard error it reduces; empty where it separates explanations.
    remaining_share : float
        Of that standard error [1].
    """

    steps: tuple[LoadStep, ...]
    purpose: str
    separated: tuple[str, ...] = ()
    separation: tuple[float, ...] = ()
    parameter: str = ""
    remaining_share: float = 1.0

    @property
    def helps(self) -> bool:
        """Whether it is worth measuring."""
        if self.separated:
            return min(self.separation) >= LEAST_SEPARATION
        return self.remaining_share <= MOST_REMAINING

    def to_json(self) -> dict[str, Any]:
        """As in ``result.json``."""
        aim: dict[str, Any] = {"purpose": self.purpose, "loading": "next/loading.csv"}
        if self.separated:
            return aim | {"separation": dict(zip(self.separated, self.separation, strict=True))}
        return aim | {"parameter": self.parameter, "remaining_share": self.remaining_share}


#: Squares over sigma squared per reading that count as noise, at most [1].
MOST_NOISE = 2.0

#: In proportion to every input, or alike for all.
ScatterKind = Literal["relative", "absolute"]


@dataclass(frozen=True)
class InputScatter:
    """Scatter of the inputs that would account for a part of the residual.

    Attributes
    ----------
    kind : str
        "relative": in proportion to every input; "absolute": alike for all.
    size : float
        Standard deviation, over the input [1] or in `unit`.
    unit : str
        "1", "N" or "m".
    before, after : Misfit
        Of all readings: the final model's, and with the most likely errors of the inputs.
    """

    kind: ScatterKind
    size: float
    unit: str
    before: Misfit
    after: Misfit

    @property
    def explains_all(self) -> bool:
        """Whether what it leaves is of the size of the noise."""
        return self.after.chi2_per_dof < MOST_NOISE

    def to_json(self) -> dict[str, Any]:
        """As in ``result.json``."""
        own = {"kind": self.kind, "size": self.size, "unit": self.unit}
        return own | {"before": self.before.to_json(), "after": self.after.to_json()}


@dataclass(frozen=True)
class SearchedSteps:
    """Load steps that the search used, where that are not all.

    Attributes
    ----------
    steps : tuple of int
        Numbers of the load steps.
    total : int
        Load steps of the data.
    fitted_to_all : bool
        Whether the final fit and all errors are of all load steps; else they are of these.
    """

    steps: tuple[int, ...]
    total: int
    fitted_to_all: bool

    @property
    def sentence(self) -> str:
        """For the report."""
        count = f"{len(self.steps)} of {self.total} load steps"
        if self.fitted_to_all:
            return f"The search used {count}; the final fit and all errors are of all load steps."
        return f"The search used {count}, and all errors are of these: there is no fit to all load steps."

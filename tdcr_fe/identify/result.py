"""Result of an identification with its parts, and its ``result.json``."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from tdcr_fe.effects import EFFECTS, Effect, Experiment
from tdcr_fe.identify.run import Trajectory
from tdcr_fe.io.atomic import plain
from tdcr_fe.io.loading_table import loading_text
from tdcr_fe.io.measured import MeasuredData
from tdcr_fe.io.summary import versions
from tdcr_fe.model.loading import LoadStep, SolverSettings


@dataclass(frozen=True)
class Estimate:
    """One fitted number.

    Attributes
    ----------
    value : float
    std_error : float or None
        None where the data do not determine it (it keeps its null value) or it sits at a bound.
    unit : str
    note : str
        Such as "at its bound".
    """

    value: float
    std_error: float | None
    unit: str
    note: str = ""


@dataclass(frozen=True)
class Misfit:
    """How far a model is from the readings.

    Attributes
    ----------
    rms_position, max_position : float or None
        Distance between measured and predicted markers in space, over all markers and steps [m]; of a marker of
        which not all three coordinates were measured, those that were. None where there are none.
    rms_coordinate : float or None
        Of single position coordinates, over all markers, axes and steps [m]; `rms_position` over the square root of
        three where all three coordinates were measured.
    rms_angle : float or None
        [rad].
    rms_by_quantity : mapping of str to float
        Root mean square by measured quantity, in the unit of the quantity, such as "position_x" [m].
    chi2_per_dof : float
        Sum of squares in units of sigma over the number of readings less fitted parameters [1].
    count : int
        Readings.
    """

    rms_position: float | None
    rms_angle: float | None
    max_position: float | None
    chi2_per_dof: float
    count: int = 0
    rms_coordinate: float | None = None
    rms_by_quantity: Mapping[str, float] = field(default_factory=dict)

    def to_json(self) -> dict[str, float | None]:
        """As in ``result.json``."""
        return {
            "rms_position": self.rms_position,
            "rms_angle": self.rms_angle,
            "max_position": self.max_position,
            "chi2_per_dof": self.chi2_per_dof,
        }


#: Of a model that was not evaluated, for want of time.
NOT_EVALUATED = Misfit(None, None, None, math.nan)


@dataclass(frozen=True)
class Noise:
    """Noise of the measurement that misfits are compared with; from sigma, given or estimated.

    Attributes
    ----------
    rms_position, rms_coordinate, rms_angle : float or None
        What the noise alone gives for the measures of `Misfit` of the same names [m, m, rad].
    rms_by_quantity : mapping of str to float
        Root mean square of sigma by measured quantity, in its unit.
    estimated : bool
        Whether any sigma was not given, and so estimated.
    """

    rms_position: float | None
    rms_coordinate: float | None
    rms_angle: float | None
    rms_by_quantity: Mapping[str, float]
    estimated: bool


@dataclass(frozen=True)
class Structure:
    """One test of whether a residual is noise.

    Attributes
    ----------
    group : str
        Which readings, or which kind of pattern.
    statistic : float
        In standard deviations of what noise would give [1].
    p_value : float
        Chance of as much from noise alone [1].
    """

    group: str
    statistic: float
    p_value: float


@dataclass(frozen=True)
class LawTerm:
    """One term of a law.

    Attributes
    ----------
    product : str
        Factors and direction, such as ``"|kappa| kappa"``.
    coefficient : Estimate
    where : str
        "all bays", or one bay or disk.
    is_force : bool
        A force on a disk; else a bending moment.
    """

    product: str
    coefficient: Estimate
    where: str
    is_force: bool = False


@dataclass(frozen=True)
class FoundLaw:
    """A law on no list: what acts besides the declared model, as a function of the state.

    Attributes
    ----------
    terms : tuple of LawTerm
        Their sum is the law.
    sentence : str
        The law in words.
    after_fit, after_held_out : Misfit
        With the law.
    alternatives : tuple of str
        Other single terms that explain these data as well.
    steps : tuple of LoadStep
        The simulated loading sequence, with the moments and forces of the law as concentrated loads.
    """

    terms: tuple[LawTerm, ...]
    sentence: str
    after_fit: Misfit
    after_held_out: Misfit
    alternatives: tuple[str, ...]
    steps: tuple[LoadStep, ...]

    @property
    def formula(self) -> str:
        """With numbers, 95 % half-widths and units."""
        parts = []
        for t in self.terms:
            c = t.coefficient
            width = "" if c.std_error is None else f" +- {1.96 * c.std_error:.2g}"
            place = "" if t.where == "all bays" else f" [{t.where}]"
            parts.append(f"({c.value:.4g}{width}) {c.unit} {t.product}{place}")
        return ("F = " if all(t.is_force for t in self.terms) else "m = ") + " + ".join(parts)

    def to_json(self) -> dict[str, Any]:
        """As in ``result.json``."""
        return {
            "formula": self.formula,
            "where": "; ".join(dict.fromkeys(t.where for t in self.terms)),
            "after": {"fit": self.after_fit.to_json(), "held_out": self.after_held_out.to_json()},
            "sentence": self.sentence,
            "terms": [
                {
                    "product": t.product,
                    "coefficient": t.coefficient.value,
                    "std_error": t.coefficient.std_error,
                    "unit": t.coefficient.unit,
                    "where": t.where,
                }
                for t in self.terms
            ],
            "alternatives": list(self.alternatives),
        }


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


Verdict = Literal[
    "explained",
    "explained by a law found",
    "partly explained",
    "unexplained",
    "nothing missing",
    "cannot tell",
    "unfinished",
]


@dataclass(frozen=True)
class IdentificationResult:
    """Everything that an identification found.

    Attributes
    ----------
    data : MeasuredData
    verdict : str
        One of "explained", "explained by a law found", "partly explained", "unexplained", "nothing missing",
        "cannot tell" (too few or too noisy data), "unfinished" (interrupted, or out of time).
    effects : tuple of AddedEffect
        In the order of adding.
    before_fit, before_held_out, after_fit, after_held_out : Misfit
    held_out_steps : tuple of int
    remaining : Remainder
    candidates : tuple of Candidate
    structure : tuple of Structure
        Tests of the residual that is left, most significant first.
    residual_before, residual_after : ndarray
        Reading less model, in the readings' units, in their order.
    sigma : ndarray
        Used for every reading, in its unit.
    sigma_estimated : bool
        Whether any sigma was not given.
    outliers : tuple of (int, float)
        Indices of outliers, and their residual over sigma.
    correlation : ndarray
        Of the fitted parameters, in the order of `parameter_names`.
    parameter_names : tuple of str
    mesh_error : float
        Estimated error of mesh left in the predictions, rms over sigma [1].
    left_out_candidates : mapping of str to str
        Effects that were not tried, with the reason.
    runs : int
        Simulated sequences.
    wall_time : float
        [s].
    not_tried : tuple of str
        Parts of the identification for which the time limit did not suffice.
    interrupted : bool
    history : tuple of str
        What was done, in sentences.
    noise : Noise
        Noise that the misfits are compared with.
    shapes : Shapes
        Measured and predicted positions, for pictures.
    corrected : Experiment
        Robot, model, loading sequence and observation with the effects that were added.
    commanded : Experiment
        What was simulated, without effects: the declared one with the mesh and the divided steps of the fit.
    solver : SolverSettings
        Of the simulations.
    catalogue : tuple of Effect
        The candidates.
    law : FoundLaw or None
        A law on no list that is part of the final model.
    ceiling : Misfit or None
        Held-out misfit that a flexible regression of the residual leaves at best; None where it was not tried.
    next_experiment : NextExperiment or None
        None where nothing is to be separated or refined.
    input_scatter : InputScatter or None
        Errors of the inputs that would account for a part of what is left; None where there are none such.
    jump : str
        The clearest jump of the residual that is left, as a sentence; empty where there is none.
    by_set : tuple of SetErrors
        Of every data set, where several were given.
    searched : SearchedSteps or None
        Load steps that the search used; None for all.
    path : Trajectory or None
        Of the final model's run, which repeats it at a small cost.
    """

    data: MeasuredData
    verdict: Verdict
    effects: tuple[AddedEffect, ...]
    before_fit: Misfit
    before_held_out: Misfit
    after_fit: Misfit
    after_held_out: Misfit
    held_out_steps: tuple[int, ...]
    remaining: Remainder
    candidates: tuple[Candidate, ...]
    structure: tuple[Structure, ...]
    residual_before: Array
    residual_after: Array
    sigma: Array
    sigma_estimated: bool
    outliers: tuple[tuple[int, float], ...]
    correlation: Array
    parameter_names: tuple[str, ...]
    mesh_error: float
    noise: Noise
    shapes: Shapes
    corrected: Experiment
    commanded: Experiment
    solver: SolverSettings
    left_out_candidates: Mapping[str, str] = field(default_factory=dict)
    runs: int = 0
    wall_time: float = 0.0
    interrupted: bool = False
    history: tuple[str, ...] = ()
    catalogue: tuple[Effect, ...] = EFFECTS
    law: FoundLaw | None = None
    ceiling: Misfit | None = None
    next_experiment: NextExperiment | None = None
    input_scatter: InputScatter | None = None
    jump: str = ""
    by_set: tuple[SetErrors, ...] = ()
    searched: SearchedSteps | None = None
    not_tried: tuple[str, ...] = ()
    path: Trajectory | None = None

    def next_loading(self) -> str | None:
        """The next experiment as the text of a ``loading.csv``; None where there is none."""
        if self.next_experiment is None:
            return None
        steps = self.next_experiment.steps
        return loading_text(self.data.robot, range(1, len(steps) + 1), steps, ["next"] * len(steps))

    def __repr__(self) -> str:
        from tdcr_fe.identify.sentences import summary

        return summary(self)

    @property
    def effects_table(self) -> dict[str, dict[str, float]]:
        """Values of the effects that were added, as the ``[effects]`` table of a scenario has them."""
        return {
            e.name: {n: p.value for n, p in e.parameters.items() if math.isfinite(p.value)}
            for e in self.effects
        }

    def to_json(self) -> dict[str, Any]:
        """As ``result.json`` has it; numbers that are not finite become null."""
        readings = self.data.readings
        document = {
            "dataset": self.data.name,
            "observations": len(readings),
            "held_out_steps": list(self.held_out_steps),
            "before": {"fit": self.before_fit.to_json(), "held_out": self.before_held_out.to_json()},
            "effects": [
                {
                    "effect": e.name,
                    "parameters": {
                        n: {"value": p.value, "std_error": p.std_error, "unit": p.unit}
                        | ({"note": p.note} if p.note else {})
                        for n, p in e.parameters.items()
                    },
                    "after": {"fit": e.after_fit.to_json(), "held_out": e.after_held_out.to_json()},
                    "evidence": dict(e.evidence),
                    "indistinguishable_from": list(e.indistinguishable_from),
                }
                | ({"separating_experiment": e.separating_experiment} if e.separating_experiment else {})
                for e in self.effects
            ],
            "after": {"fit": self.after_fit.to_json(), "held_out": self.after_held_out.to_json()},
            "verdict": self.verdict,
            **({"datasets": [s.to_json() for s in self.by_set]} if self.by_set else {}),
            **({} if self.law is None else {"law": self.law.to_json()}),
            **({} if self.ceiling is None else {"ceiling": {"held_out": self.ceiling.to_json()}}),
            **({} if self.next_experiment is None else {"next_experiment": self.next_experiment.to_json()}),
            **({} if self.input_scatter is None else {"input_scatter": self.input_scatter.to_json()}),
            **({"jump": self.jump} if self.jump else {}),
            "remaining": {"where": self.remaining.where, "description": self.remaining.description},
            "left_out": [str(b) for b in self.data.left_out],
            "outliers": [
                {
                    "step": readings[i].step,
                    "quantity": readings[i].quantity,
                    "location": readings[i].location,
                    "value": readings[i].value,
                    "residual_over_sigma": r,
                }
                for i, r in self.outliers
            ],
            "sigma_estimated": self.sigma_estimated,
            "mesh_error_over_sigma": self.mesh_error,
            "parameters": list(self.parameter_names),
            "correlation": self.correlation.tolist(),
            **({} if self.searched is None else {"searched_steps": list(self.searched.steps)}),
            "simulations": self.runs,
            "wall_time": self.wall_time,
            "interrupted": self.interrupted,
            "not_tried": list(self.not_tried),
            "input": dict(self.data.digests or {}),
            "versions": versions(),
        }
        clean: dict[str, Any] = plain(document)
        return clean

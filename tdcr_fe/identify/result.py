"""Result of an identification with its parts, and its ``result.json``."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from tdcr_fe.effects import EFFECTS, Effect, Experiment
from tdcr_fe.identify.run import Trajectory
from tdcr_fe.io.atomic import plain
from tdcr_fe.io.loading_table import loading_text
from tdcr_fe.io.measured import MeasuredData
from tdcr_fe.io.result_files import versions
from tdcr_fe.model.loading import LoadStep, SolverSettings

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Estimate:
    """One fitted number."""

    value: float
    # none where the data do not determine it (it keeps its null value) or it sits at a bound
    std_error: float | None
    unit: str
    note: str = ""  # such as "at its bound"


@dataclass(frozen=True)
class Misfit:
    """How far a model is from the readings."""

    # Distance between measured and predicted markers in space, over all markers and steps [m]; of a marker of
    # which not all three coordinates were measured, those that were. None where there are none
    rms_position: float | None
    rms_angle: float | None  # [rad]
    max_position: float | None
    # sum of squares in units of sigma over the number of readings less fitted parameters [1]
    chi2_per_dof: float
    count: int = 0  # readings
    # of single position coordinates, over all markers, axes and steps [m]; `rms_position` over the square
    # root of three where all three coordinates were measured
    rms_coordinate: float | None = None
    # root mean square by measured quantity, in the unit of the quantity, such as "position_x" [m]
    rms_by_quantity: Mapping[str, float] = field(default_factory=dict)

    def to_json(self) -> dict[str, float | None]:
        """As in ``result.json``."""
        names = ("rms_position", "rms_angle", "max_position", "chi2_per_dof")
        return {name: getattr(self, name) for name in names}


def tip_force(force: Sequence[float]) -> str:
    """A force at the tip, in words."""
    return f"tip force ({', '.join(f'{x:.3g}' for x in force)}) N"


def errors(fit: Misfit, held_out: Misfit) -> dict[str, Any]:
    """Errors on fitted and on held-out steps, as in ``result.json``."""
    return {"fit": fit.to_json(), "held_out": held_out.to_json()}


#: Of a model that was not evaluated, for want of time.
NOT_EVALUATED = Misfit(None, None, None, math.nan)


@dataclass(frozen=True)
class Structure:
    """One test of whether a residual is noise."""

    group: str  # which readings, or which kind of pattern
    statistic: float  # in standard deviations of what noise would give [1]
    p_value: float  # chance of as much from noise alone [1]


@dataclass(frozen=True)
class FoundLaw:
    """What acts besides the declared model and is no listed effect."""

    formula: str  # with numbers, 95 % half-widths and units
    sentence: str  # in words
    where: str
    terms: tuple[str, ...]  # names of the causes
    # With the law
    after_fit: Misfit
    after_held_out: Misfit
    alternatives: tuple[str, ...]  # other causes that explain these data as well
    # the simulated loading sequence, with the loads of the law as concentrated loads
    steps: tuple[LoadStep, ...]

    def to_json(self) -> dict[str, Any]:
        """As in ``result.json``."""
        return {
            "formula": self.formula,
            "where": self.where,
            "after": errors(self.after_fit, self.after_held_out),
            "sentence": self.sentence,
            "terms": list(self.terms),
            "alternatives": list(self.alternatives),
        }


@dataclass(frozen=True)
class Shapes:
    """Measured and predicted positions by step of ``loading.csv``; NaN where nothing was measured or solved."""

    held_out: NDArray[np.bool_]  # shape (n_steps,)
    arc_lengths: Array  # where positions were measured [m], shape (n_locations,)
    # Measured positions, and those predicted by the declared and by the final model, in the measuring frame
    # [m], shape (n_steps, n_locations, 3)
    measured: Array
    before: Array
    after: Array
    # Predicted backbone (without marker offsets) in the measuring frame, base first, tip last [m], shape
    # (n_steps, n_nodes, 3)
    backbone_before: Array
    backbone_after: Array


@dataclass(frozen=True)
class AddedEffect:
    """An effect that was added."""

    name: str
    parameters: Mapping[str, Estimate]  # from the final model
    # With this effect and all before it; `NOT_EVALUATED` where the time did not suffice for that model
    after_fit: Misfit
    after_held_out: Misfit
    # evidence for it; empty where the model with it, or that before it, was not evaluated
    evidence: Mapping[str, Any]
    indistinguishable_from: tuple[str, ...] = ()  # effects that explain these data as well
    separating_experiment: str = ""  # experiment that separates them
    # whether it is found: it has a name, no other explains the data as well, and only noise is left
    found: bool = True
    probability: float = 1.0  # that it acts, among all models that were fitted [1]
    form: str = ""  # name of the form that was fitted; empty: that of the effect


@dataclass(frozen=True)
class FoundCause:
    """What kind of cause acts."""

    name: str  # of the cause of this kind in the final model
    perturbs: str
    depends_on: tuple[str, ...]
    where: str
    probability: float  # that a cause of this kind acts, among all that were fitted [1]

    def to_json(self) -> dict[str, Any]:
        """As in ``result.json``."""
        return {
            "perturbs": self.perturbs,
            "depends_on": list(self.depends_on),
            "where": self.where,
            "probability": self.probability,
            "cause": self.name,
        }


@dataclass(frozen=True)
class Candidate:
    """Result of one candidate in one round."""

    round: int
    model: tuple[str, ...]  # effects already in the model
    name: str
    drop: float  # by how much the misfit would fall to first order, over the misfit per degree of freedom [1]
    fitted: bool = False
    # Per reading, after the fit [1]
    chi2_fit: float | None = None
    chi2_held_out: float | None = None
    note: str = ""


#: Where the error remains if the data have a fault, errors of the inputs account for all of it, the noise is not known,
#: or the data do not suffice.
THE_DATA, THE_INPUTS, THE_NOISE, NOT_KNOWN = "the data", "the inputs", "the noise", "not known"


@dataclass(frozen=True)
class Remainder:
    """What is left."""

    where: str  # the group of readings in which it is largest, or what accounts for it
    description: str


@dataclass(frozen=True)
class SetErrors:
    """Errors on one of several data sets."""

    name: str
    # Its steps in the joined numbering
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
            "before": errors(self.before_fit, self.before_held_out),
            "after": errors(self.after_fit, self.after_held_out),
        }


#: An experiment helps if it separates explanations by so many sigma, or leaves so much of a standard error at most.
LEAST_SEPARATION, MOST_REMAINING = 2.0, 0.9


@dataclass(frozen=True)
class NextExperiment:
    """A loading sequence, from the unloaded robot, that helps most."""

    steps: tuple[LoadStep, ...]
    purpose: str  # what it shows, with the expected separation or reduction
    # explanations that it separates from the result's; empty where it refines a parameter
    separated: tuple[str, ...] = ()
    # expected difference from each, over the noise and the uncertainty of the parameters [sigma]
    separation: tuple[float, ...] = ()
    parameter: str = ""  # whose standard error it reduces; empty where it separates explanations
    remaining_share: float = 1.0  # of that standard error [1]

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


@dataclass(frozen=True)
class InputNoise:
    """Noise of the inputs that would account for a part of the residual."""

    kind: Literal[
        "relative", "absolute"
    ]  # "relative": in proportion to every input; "absolute": alike for all
    size: float  # standard deviation, over the input [1] or in `unit`
    unit: str  # "1", "N" or "m"
    # Of all readings: the final model's, and with the most likely errors of the inputs
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


#: A parameter is not normally distributed where its profile is off by so many standard errors at one of these [1].
NOT_NORMAL = 0.25
#: Half-width of a 95 % interval over the standard error [1].
HALF_WIDTH = 1.96


@dataclass(frozen=True)
class Profile:
    """How the misfit grows as one fitted parameter is moved and the others follow."""

    name: str  # EFFECT.PARAMETER
    values: Array  # of the parameter, ascending, shape (5,); fewer where it meets a bound or is not solved
    # signed root of the growth of the misfit, over that by one standard error in a linear model, shape as `values` [1]
    roots: Array

    @property
    def is_normal(self) -> bool:
        """Whether it is that of a normal distribution."""
        middle = int(np.argmin(np.abs(self.roots)))
        if len(self.roots) < 3 or middle in (0, len(self.roots) - 1):
            return False
        expected = np.arange(len(self.roots)) - middle
        return bool(np.max(np.abs(self.roots - expected)) < NOT_NORMAL)

    @property
    def interval(self) -> tuple[float, float]:
        """Ends of the 95 % interval, in the parameter's unit; the last value computed where the profile stays below."""
        order = np.argsort(self.roots)
        ends = np.interp([-HALF_WIDTH, HALF_WIDTH], self.roots[order], self.values[order])
        return float(min(ends)), float(max(ends))

    def to_json(self) -> dict[str, Any]:
        """As in ``result.json``."""
        return {
            "values": self.values.tolist(),
            "roots": self.roots.tolist(),
            "interval_95": list(self.interval),
            "normal": self.is_normal,
        }


@dataclass(frozen=True)
class Jump:
    """A jump of one coordinate of a marker that the final model leaves."""

    step: int  # the first one after it
    marker: float  # arc length [m]
    axis: str
    size: float  # [m]


@dataclass(frozen=True)
class SearchedSteps:
    """Load steps that the search used, where that are not all."""

    steps: tuple[int, ...]  # numbers of the load steps
    total: int  # load steps of the data
    fitted_to_all: bool  # whether the final fit and all errors are of all load steps; else they are of these


class Verdict(StrEnum):
    """The verdict; `tdcr_fe.identify.sentences.HEADLINES` has the sentence of each."""

    EXPLAINED = "explained"
    LAW_FOUND = "explained by a law found"
    PARTLY_EXPLAINED = "partly explained"
    UNEXPLAINED = "unexplained"
    NOTHING_MISSING = "nothing missing"
    CANNOT_TELL = "cannot tell"
    UNFINISHED = "unfinished"


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
    wall_time : float [s]
    not_tried : tuple of str
        Parts of the identification for which the time limit was too short.
    interrupted : bool
    history : tuple of str
    noise : Misfit
        What the noise alone gives, which the misfits are compared with.
    shapes : Shapes
    corrected : Experiment
        Robot, model, loading sequence and observation with the effects that were added.
    commanded : Experiment
        What was simulated, without effects: the declared one with the mesh and the divided steps of the fit.
    solver : SolverSettings
    catalogue : tuple of Effect
    law : FoundLaw or None
        What is part of the final model and on no list.
    causes : tuple of FoundCause
        Kinds of the causes that act, the listed effects included.
    ceiling : Misfit or None
        Held-out misfit that a flexible regression of the residual leaves at best; None where it was not tried.
    next_experiment : NextExperiment or None
        None where nothing is to be separated or refined.
    input_noise : InputNoise or None
        Errors of the inputs that would account for a part of what is left; None where there are none such.
    profiles : tuple of Profile
        How the misfit grows as one fitted parameter is moved, of those for which the time sufficed.
    jump : Jump or None
        The clearest jump of the residual that is left; None where there is none.
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
    noise: Misfit
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
    causes: tuple[FoundCause, ...] = ()
    ceiling: Misfit | None = None
    next_experiment: NextExperiment | None = None
    input_noise: InputNoise | None = None
    profiles: tuple[Profile, ...] = ()
    jump: Jump | None = None
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
        from tdcr_fe.identify.statistics import summary

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
        from tdcr_fe.identify.sentences import jump_sentence

        readings = self.data.readings
        document = {
            "dataset": self.data.name,
            "observations": len(readings),
            "held_out_steps": list(self.held_out_steps),
            "before": errors(self.before_fit, self.before_held_out),
            "effects": [
                {
                    "effect": e.name,
                    "parameters": {
                        n: {"value": p.value, "std_error": p.std_error, "unit": p.unit}
                        | ({"note": p.note} if p.note else {})
                        for n, p in e.parameters.items()
                    },
                    "after": errors(e.after_fit, e.after_held_out),
                    "evidence": dict(e.evidence),
                    "probability": e.probability,
                    "indistinguishable_from": list(e.indistinguishable_from),
                }
                | ({"separating_experiment": e.separating_experiment} if e.separating_experiment else {})
                for e in self.effects
                if e.found
            ],
            "causes": [c.to_json() for c in self.causes],
            "stand_ins": {e.name: self.effects_table[e.name] for e in self.effects if not e.found},
            "after": errors(self.after_fit, self.after_held_out),
            "verdict": self.verdict,
            **({"datasets": [s.to_json() for s in self.by_set]} if self.by_set else {}),
            **({} if self.law is None else {"law": self.law.to_json()}),
            **({} if self.ceiling is None else {"ceiling": {"held_out": self.ceiling.to_json()}}),
            **({} if self.next_experiment is None else {"next_experiment": self.next_experiment.to_json()}),
            **({} if self.input_noise is None else {"input_scatter": self.input_noise.to_json()}),
            "profiles": {p.name: p.to_json() for p in self.profiles},
            **({} if self.jump is None else {"jump": jump_sentence(self)[0]}),
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

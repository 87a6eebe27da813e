"""Result of an identification with its parts, and its ``result.json``."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any, NamedTuple

import numpy as np

from tdcr_fe.effects import EFFECTS, Effect, Experiment
from tdcr_fe.effects.base import Kind
from tdcr_fe.elements import Array, Flags
from tdcr_fe.identify.rows import RowChoice
from tdcr_fe.identify.run import Trajectory
from tdcr_fe.io.files import plain
from tdcr_fe.io.measured import MeasuredData
from tdcr_fe.io.result_files import versions
from tdcr_fe.io.tables import loading_text
from tdcr_fe.model.loading import LoadStep, SolverSettings
from tdcr_fe.report.environment import SPACE, estimate

#: Half-width of a 95 % interval over the standard error [1].
HALF_WIDTH = 1.96
#: Where a profile is computed, in standard errors from the estimate [1].
PROFILED = np.array([-2.0, 2.0])
#: A parameter is not normally distributed where its profile is off by so many standard errors there [1].
NOT_NORMAL = 0.25
#: An experiment helps if it separates explanations by so many sigma, or leaves so much of a standard error at most.
LEAST_SEPARATION, MOST_REMAINING = 2.0, 0.9
#: An effect is found where it is more probable than this, among all models that were fitted [1].
NAMED = 0.9
#: Squares over sigma squared per reading that count as noise, at most [1].
MOST_NOISE = 2.0


class Verdict(StrEnum):
    """The verdict; ``templates/sentences.txt.j2`` has the sentence of each."""

    EXPLAINED = "explained"
    LAW_FOUND = "explained by a law found"
    PARTLY_EXPLAINED = "partly explained"
    UNEXPLAINED = "unexplained"
    NOTHING_MISSING = "nothing missing"
    CANNOT_TELL = "cannot tell"
    UNFINISHED = "unfinished"


@dataclass(frozen=True)
class Estimate:
    """One fitted number."""

    value: float
    # none where the data do not determine it (it keeps its null value) or it sits at a bound
    std_error: float | None
    unit: str
    note: str = ""  # such as "at its bound"

    @property
    def half_width(self) -> float | None:
        """Half-width of the 95 % interval; None without a standard error."""
        return None if self.std_error is None else HALF_WIDTH * self.std_error

    def to_json(self) -> dict[str, Any]:
        """As in ``result.json``."""
        document = {"value": self.value, "std_error": self.std_error, "unit": self.unit}
        return document | ({"note": self.note} if self.note else {})


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
    # root mean square by measured quantity, in the unit of the quantity, such as "position_x" [m]
    rms_by_quantity: Mapping[str, float] = field(default_factory=dict)

    def to_json(self) -> dict[str, float | None]:
        """As in ``result.json``."""
        names = ("rms_position", "rms_angle", "max_position", "chi2_per_dof")
        return {name: getattr(self, name) for name in names}


class Errors(NamedTuple):
    """Misfits of one model."""

    # On the fitted and on the held-out steps
    fit: Misfit
    held_out: Misfit

    def to_json(self) -> dict[str, Any]:
        """As in ``result.json``."""
        return self._asdict()


#: Of a model that was not evaluated, for want of time.
NOT_EVALUATED = Errors(Misfit(None, None, None, math.nan), Misfit(None, None, None, math.nan))


@dataclass(frozen=True)
class AddedEffect:
    """An effect or an unlisted cause that was added."""

    name: str  # of the listed effect
    parameters: Mapping[str, Estimate]  # from the final model
    after: Errors  # with it and all before it; `NOT_EVALUATED` where the time did not suffice for that model
    # evidence for it; empty where the model with it, or that before it, was not evaluated
    evidence: Mapping[str, Any]
    kind: Kind
    indistinguishable_from: tuple[str, ...] = ()  # effects that explain these data as well
    separating_experiment: str = ""  # experiment that separates them
    found: bool = True  # whether it is a listed effect, and only noise is left
    # That it acts, and that any cause of its kind acts, among all models that were fitted [1]
    probability: float = 1.0
    kind_probability: float = 1.0
    form: str = ""  # name of the form that was fitted; empty: that of the effect
    sentence: str = ""  # what an unlisted cause does; empty for effects

    def to_json(self) -> dict[str, Any]:
        """As in ``result.json``, under ``effects``."""
        document = {
            "effect": self.name,
            "parameters": self.parameters,
            "after": self.after,
            "evidence": self.evidence,
            "probability": self.probability,
            "indistinguishable_from": self.indistinguishable_from,
        }
        if self.separating_experiment:
            document["separating_experiment"] = self.separating_experiment
        return document

    def cause(self) -> dict[str, Any]:
        """As in ``result.json``, under ``causes``."""
        return {**self.kind._asdict(), "probability": self.kind_probability, "cause": self.form or self.name}

    @property
    def formula(self) -> str:
        """Its name with its numbers, 95 % half-widths and units."""
        numbers = [f"{n} = {estimate(p.value, p.half_width, p.unit)}" for n, p in self.parameters.items()]
        return f"{self.name} ({', '.join(numbers).replace(SPACE, ' ')})"


class Law(NamedTuple):
    """The unlisted causes in the final model."""

    causes: tuple[AddedEffect, ...]

    @property
    def formula(self) -> str:
        """With numbers."""
        return " + ".join(c.formula for c in self.causes)

    @property
    def sentence(self) -> str:
        """In words."""

        def said(c: AddedEffect) -> bool:
            return c.kind.where == "everywhere" or c.kind.where in c.sentence

        return "; ".join(c.sentence if said(c) else f"{c.sentence} ({c.kind.where})" for c in self.causes)

    @property
    def alternatives(self) -> tuple[str, ...]:
        """Other causes that explain these data as well."""
        return tuple(dict.fromkeys(n for c in self.causes for n in c.indistinguishable_from))

    def to_json(self) -> dict[str, Any]:
        """As in ``result.json``, but for the errors."""
        return {
            "formula": self.formula,
            "where": "; ".join(dict.fromkeys(c.kind.where for c in self.causes)),
            "sentence": self.sentence,
            "terms": [c.name for c in self.causes],
            "alternatives": self.alternatives,
        }


@dataclass(frozen=True)
class Structure:
    """One test of whether a residual is noise."""

    group: str  # which readings, or which kind of pattern
    statistic: float  # in standard deviations of what noise would give [1]
    p_value: float  # chance of as much from noise alone [1]


@dataclass(frozen=True)
class Shapes:
    """Measured and predicted positions by step of ``loading.csv``; NaN where nothing was measured or solved."""

    held_out: Flags  # shape (n_steps,)
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


class Remainder(NamedTuple):
    """What is left."""

    where: str  # the group of readings in which it is largest, or what accounts for it
    description: str


class SetErrors(NamedTuple):
    """Errors on one of several data sets."""

    name: str
    # Its steps in the joined numbering
    first: int
    last: int
    before: Errors
    after: Errors

    def to_json(self) -> dict[str, Any]:
        """As in ``result.json``."""
        steps = self.first, self.last
        return {"dataset": self.name, "steps": steps, "before": self.before, "after": self.after}


@dataclass(frozen=True)
class NextExperiment:
    """A loading sequence, from the unloaded robot, that helps most."""

    steps: tuple[LoadStep, ...]
    purpose: str  # what it shows, with the expected separation or reduction
    # expected difference from each explanation that it separates from the result's, over the noise and the
    # uncertainty of the parameters [sigma]; empty where it refines a parameter
    separation: Mapping[str, float] = field(default_factory=dict)
    parameter: str = ""  # whose standard error it reduces; empty where it separates explanations
    remaining_share: float = 1.0  # of that standard error [1]

    @property
    def value(self) -> float:
        """How much it helps: the least separation, else the share of the standard error that is left, negative."""
        return min(self.separation.values(), default=-self.remaining_share)

    @property
    def helps(self) -> bool:
        """Whether it is worth measuring."""
        return self.value >= (LEAST_SEPARATION if self.separation else -MOST_REMAINING)

    def to_json(self) -> dict[str, Any]:
        """As in ``result.json``."""
        aim: dict[str, Any] = {"purpose": self.purpose, "loading": "next/loading.csv"}
        if self.separation:
            return aim | {"separation": self.separation}
        return aim | {"parameter": self.parameter, "remaining_share": self.remaining_share}


class Scatter(NamedTuple):
    """What may be different in every step, and would account for a part of the residual."""

    what: str  # "inputs", "positions", which are shifted together, or "force"
    place: str  # where a force acts; empty for others
    size: float  # standard deviation, over the input [1] or in `unit`
    unit: str  # "N" or "m": alike in all steps; "1": in proportion to every input
    # Misfit of all readings: of the final model, and of that with the most likely values in every step
    before: Misfit
    after: Misfit
    steps: tuple[int, ...] = ()  # those in which it is larger than noise, if these are fewer than half

    @property
    def kind(self) -> str:
        """In proportion to every input, or alike for all."""
        return "relative" if self.unit == "1" else "absolute"

    @property
    def explains_all(self) -> bool:
        """Whether what it leaves is of the size of the noise."""
        return self.after.chi2_per_dof < MOST_NOISE

    def to_json(self) -> dict[str, Any]:
        """As in ``result.json``."""
        return {**self._asdict(), "kind": self.kind}


class Profile(NamedTuple):
    """How the misfit grows as one fitted parameter is moved and the others follow."""

    name: str  # EFFECT.PARAMETER
    values: Array  # of the parameter, ascending, shape (3,); fewer where it meets a bound or is not solved
    # signed root of the growth of the misfit, over that by one standard error in a linear model, shape as `values` [1]
    roots: Array

    @property
    def is_normal(self) -> bool:
        """Whether it is that of a normal distribution."""
        if len(self.roots) <= len(PROFILED):
            return False
        return bool(np.max(np.abs(np.sort(self.roots)[[0, -1]] - PROFILED)) < NOT_NORMAL)

    @property
    def interval(self) -> tuple[float, float]:
        """Ends of the 95 % interval, in the parameter's unit; the last value computed where the profile stays below."""
        order = np.argsort(self.roots)
        ends = np.interp([-HALF_WIDTH, HALF_WIDTH], self.roots[order], self.values[order])
        return float(min(ends)), float(max(ends))

    def to_json(self) -> dict[str, Any]:
        """As in ``result.json``."""
        curve = {"values": self.values, "roots": self.roots}
        return {**curve, "interval_95": self.interval, "normal": self.is_normal}


@dataclass(frozen=True)
class Residuals:
    """What the models leave of the readings, in their order."""

    # Reading less model, in the readings' units, shape (n,)
    before: Array
    after: Array
    sigma: Array  # used for every reading, in its unit, shape (n,)
    outliers: tuple[tuple[int, float], ...] = ()  # indices of outliers, and their residual over sigma
    tests: tuple[Structure, ...] = ()  # of what is left, most significant first


@dataclass(frozen=True)
class Parameters:
    """The fitted parameters together."""

    names: tuple[str, ...]  # EFFECT.PARAMETER
    correlation: Array  # shape (p, p)
    profiles: tuple[Profile, ...] = ()  # of those for which the time sufficed
    # of what is fitted: the inverse of numbers whose null value is infinite
    standard_errors: tuple[float, ...] = ()

    def correlated(self, least: float) -> list[tuple[float, str, str]]:
        """Correlations of more than a size, with both names, the largest first."""
        names, found = self.names, self.correlation
        pairs = [(float(found[i, j]), names[i], names[j]) for j in range(len(names)) for i in range(j)]
        return sorted((p for p in pairs if abs(p[0]) > least), key=lambda pair: -abs(pair[0]))


@dataclass(frozen=True)
class SearchLog:
    """What the search did."""

    candidates: tuple[Candidate, ...] = ()
    refused: Mapping[str, str] = field(default_factory=dict)  # effects that were not tried, with the reason
    history: tuple[str, ...] = ()
    runs: int = 0  # simulated sequences
    wall_time: float = 0.0  # [s]
    not_tried: tuple[str, ...] = ()  # parts of the identification for which the time limit was too short
    interrupted: bool = False
    rows: RowChoice | None = None  # load steps that the search used; None for all


@dataclass(frozen=True)
class Simulated:
    """What repeats the run of the final model."""

    # Robot, model with the mesh of the fit, loading sequence and observation: as declared, and with the effects that
    # were added; unlisted causes stand there as the loads that they give
    commanded: Experiment
    corrected: Experiment
    solver: SolverSettings
    catalogue: tuple[Effect, ...] = EFFECTS  # in the order in which several are applied
    path: Trajectory | None = None  # along which the run costs little
    mesh_error: float = 0.0  # estimated error of the mesh left in the predictions, rms over sigma [1]


@dataclass(frozen=True)
class IdentificationResult:
    """Everything that an identification found.

    Attributes
    ----------
    data : MeasuredData
    verdict : Verdict
        One of "explained", "explained by a law found", "partly explained", "unexplained", "nothing missing",
        "cannot tell" (too few or too noisy data), "unfinished" (interrupted, or out of time).
    effects : tuple of AddedEffect
        In the order of adding, unlisted causes among them.
    before, after : Errors
        Errors of the declared and of the final model.
    noise : Misfit
        What the noise alone gives, which the misfits are compared with.
    held_out_steps : tuple of int
    remaining : Remainder
    shapes : Shapes
    residuals : Residuals
    parameters : Parameters
    log : SearchLog
    simulated : Simulated
    ceiling : Misfit or None
        Held-out misfit that a flexible regression of the residual leaves; None where it was not tried.
    next_experiment : NextExperiment or None
        None where nothing is to be separated or refined.
    scatter : Scatter or None
        What may be different in every step and would account for a part of what is left; None where nothing would.
    by_set : tuple of SetErrors
        Errors of every data set, where several were given.
    unknown : float
        Probability of one cause that is not in the dictionary, where several causes together leave noise [1].
    """

    data: MeasuredData
    verdict: Verdict
    effects: tuple[AddedEffect, ...]
    before: Errors
    after: Errors
    noise: Misfit
    held_out_steps: tuple[int, ...]
    remaining: Remainder
    shapes: Shapes
    residuals: Residuals
    parameters: Parameters
    log: SearchLog
    simulated: Simulated
    ceiling: Misfit | None = None
    next_experiment: NextExperiment | None = None
    scatter: Scatter | None = None
    by_set: tuple[SetErrors, ...] = ()
    unknown: float = 0.0

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
    def names_nothing(self) -> bool:
        """Whether one cause that is not in the dictionary may well look like the causes found together."""
        return self.unknown > 1.0 - NAMED

    @property
    def fitted_to_all(self) -> bool:
        """Whether the final fit and all errors are of all load steps, not only of those that the search used."""
        return self.log.rows is None or len(self.data.steps) == self.log.rows.total

    @property
    def predicts(self) -> bool:
        """Whether the final model is as good, about, on readings that it was not fitted to."""
        before, after = self.before.held_out, self.after.held_out
        return after.chi2_per_dof < min(MOST_NOISE, 0.5 * before.chi2_per_dof)

    @property
    def law(self) -> Law | None:
        """The unlisted causes; None where there are none."""
        causes = tuple(e for e in self.effects if e.sentence)
        return Law(causes) if causes else None

    @property
    def effects_table(self) -> dict[str, dict[str, float]]:
        """Values of the effects that were added, as the ``[effects]`` table of a scenario has them."""
        return {
            e.name: {n: p.value for n, p in e.parameters.items() if math.isfinite(p.value)}
            for e in self.effects
        }

    def to_json(self) -> dict[str, Any]:
        """As ``result.json`` has it; numbers that are not finite become null."""
        readings, log, law = self.data.readings, self.log, self.law
        found = self.verdict is Verdict.LAW_FOUND
        document = {
            "dataset": self.data.name,
            "observations": len(readings),
            "held_out_steps": self.held_out_steps,
            "before": self.before,
            "effects": [e for e in self.effects if e.found],
            "causes": [e.cause() for e in self.effects],
            "friction": self.simulated.commanded.model.friction,  # that of the declared model may be disproved
            "stand_ins": {e.name: self.effects_table[e.name] for e in self.effects if not e.found},
            "after": self.after,
            "verdict": self.verdict,
            "profiles": {p.name: p for p in self.parameters.profiles},
            "remaining": self.remaining._asdict(),
            "left_out": self.data.left_out,
            "outliers": [
                {n: getattr(readings[i], n) for n in ("step", "quantity", "location", "value")}
                | {"residual_over_sigma": r}
                for i, r in self.residuals.outliers
            ],
            "sigma_estimated": any(r.sigma is None for r in readings),
            "mesh_error_over_sigma": self.simulated.mesh_error,
            "parameters": self.parameters.names,
            "standard_errors": self.parameters.standard_errors,
            "correlation": self.parameters.correlation,
            "simulations": log.runs,
            "wall_time": log.wall_time,
            "interrupted": log.interrupted,
            "not_tried": log.not_tried,
            "input": self.data.digests or {},
            "versions": versions(),
            # where there are
            "datasets": self.by_set or None,
            "law": law and {**law.to_json(), "after": self.after} if found else None,
            "ceiling": self.ceiling and {"held_out": self.ceiling},
            "next_experiment": self.next_experiment,
            "scatter": self.scatter,
            "searched_steps": log.rows and log.rows.numbers,
        }
        written: dict[str, Any] = plain({n: value for n, value in document.items() if value is not None})
        return written

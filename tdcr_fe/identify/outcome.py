"""Result of an identification, and its ``result.json``."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from tdcr_fe.effects import EFFECTS, Effect, Experiment
from tdcr_fe.identify.findings import (
    AddedEffect,
    Candidate,
    InputScatter,
    NextExperiment,
    Remainder,
    SearchedSteps,
    SetErrors,
    Shapes,
)
from tdcr_fe.identify.found_law import FoundLaw
from tdcr_fe.identify.misfit import Misfit, Noise, Structure
from tdcr_fe.identify.trajectory import Trajectory
from tdcr_fe.io.atomic import plain
from tdcr_fe.io.loading_table import loading_text
from tdcr_fe.io.measured import MeasuredData
from tdcr_fe.io.summary import versions
from tdcr_fe.model.settings import SolverSettings

Array = NDArray[np.float64]
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

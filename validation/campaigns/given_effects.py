"""What each of a list of effects takes away from measured data, fitted in a given order.

Effects are added one after another, with those before them fitted again by `scipy.optimize.least_squares`; the mean
distance of the markers is reported on fitted and on held-out branches.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from scipy.optimize import least_squares

from tdcr_fe.effects import EFFECTS, Effect, Experiment, effect
from tdcr_fe.elements import Array, Flags
from tdcr_fe.identify.forward import Job, run_settings, simulate_experiment
from tdcr_fe.identify.rows import held_out_branches
from tdcr_fe.identify.run import Readings
from tdcr_fe.io.measured import MeasuredData, join_measured, read_measured
from tdcr_fe.validation.runner import Campaign

#: A model: what was added, mean distances [m] (also by branch), values of all parameters.
Stage = dict[str, Any]
Values = Mapping[str, Mapping[str, float]]

#: Path tolerance of the runs, over the length [1], and from how many sigma a residual counts linearly.
PATH_TOLERANCE, ROBUST = 5e-4, 3.0
#: Of the readings, with the mean distances of a stage.
SHARES = ("fitted", "held_out")


@dataclass(frozen=True)
class Outcome:
    """The models of all stages."""

    stages: list[Stage]

    @property
    def passed(self) -> bool:
        """Every model was solved."""
        return all(np.isfinite(s["fitted"]) for s in self.stages)


def chosen_form(name: str, experiment: Experiment) -> Effect:
    """An effect of the list, or a form of one, by its name such as ``"pretension (each)"``.

    Raises
    ------
    ValueError
        Names those that exist.
    """
    if name.split(" (")[0] not in {e.name for e in EFFECTS}:
        raise ValueError(f"no effect {name!r}; there are {', '.join(e.name for e in EFFECTS)}")
    forms = {form.name: form for form in effect(name.split(" (")[0]).forms(experiment)}
    if name not in forms:
        raise ValueError(f"no form {name!r}; there are {', '.join(forms)}")
    return forms[name]


@dataclass(frozen=True)
class _Fit:
    """Measured data, and the readings that are fitted."""

    data: MeasuredData
    fitted: Flags

    def residual(self, effects: Sequence[Effect], values: Values) -> Array:
        """Of all readings over sigma, with effects in the order of the list [1]."""
        order = [e.name for e in EFFECTS]

        def change(experiment: Experiment) -> Experiment:
            for e in sorted(effects, key=lambda e: order.index(e.listed)):
                experiment = e.apply(experiment, values[e.name])
            return experiment

        data, settings = self.data, run_settings(self.data.settings, PATH_TOLERANCE)
        experiment = data.experiment.with_sequences(change)
        reader = Readings.of(data.readings, data.step_ids, data.robot.tendon_names)
        found = reader.read(simulate_experiment(Job(experiment), settings), experiment)
        return np.array([(r.value - x) / r.sigma for r, x in zip(data.readings, found, strict=True)])

    def stage(self, effects: Sequence[Effect], start: Values) -> Stage:
        """All effects fitted together, from these values."""
        declared = self.data.experiment
        parameters = [(e, p) for e in effects for p in e.parameters]
        scales = np.array([p.scale for _, p in parameters])

        def values(x: Array) -> dict[str, dict[str, float]]:
            found: dict[str, dict[str, float]] = {e.name: {} for e in effects}
            for (e, p), coordinate in zip(parameters, x * scales, strict=True):
                found[e.name][p.name] = p.value(float(coordinate))
            return found

        def fitted(x: Array) -> Array:
            return np.nan_to_num(self.residual(effects, values(x))[self.fitted], nan=1e3)

        x = np.zeros(0)
        if effects:
            ranges = [sorted(map(p.coordinate, e.bounds(declared)[p.name])) for e, p in parameters]
            low, high = np.array(ranges).T / scales
            first = [p.coordinate(start[e.name][p.name]) for e, p in parameters] / scales
            x = least_squares(
                fitted, np.clip(first, low, high), bounds=(low, high), diff_step=np.full(len(low), 1e-4),
                x_scale="jac", xtol=1e-6, loss="huber", f_scale=ROBUST,
            ).x  # fmt: skip
        lengths = self.residual(effects, values(x)) * [r.sigma for r in self.data.readings]
        branch = dict(zip(self.data.step_ids, self.data.branches, strict=True))
        every = zip(self.data.readings, self.fitted, lengths, strict=True)
        own = [(r, fit, u) for r, fit, u in every if r.channel.family == "position"]
        rows = [(branch[r.step], fit, r.step, r.location, u**2) for r, fit, u in own]
        table = pd.DataFrame(rows, columns=["branch", "fitted", "step", "marker", "square"])
        off = table.groupby(["branch", "fitted", "step", "marker"])["square"].sum().pow(0.5).reset_index()
        by_share = off.groupby("fitted")["square"].mean()
        return {
            "added": effects[-1].name if effects else "",
            "fitted": float(by_share.get(True, np.nan)),
            "held_out": float(by_share.get(False, np.nan)),
            "values": values(x),
            "by_branch": off.groupby("branch", sort=False)["square"].mean().to_dict(),
        }


def fit_in_order(data: MeasuredData, names: Sequence[str], patterns: Sequence[str]) -> Iterator[Stage]:
    """Fit the declared model with more and more effects.

    Parameters
    ----------
    data
        Measured data; all readings have a sigma.
    names
        Effects or forms of effects, in the order of adding.
    patterns
        Branches that are held out.

    Yields
    ------
    dict
        The declared model, then one with each further effect, see `Outcome`.
    """
    held = {data.step_ids[k] for k in held_out_branches(data, patterns)}
    fit = _Fit(data, np.array([r.step not in held for r in data.readings]))
    effects = [chosen_form(name, data.experiment) for name in names]
    stage = fit.stage((), {})
    yield stage
    for k, e in enumerate(effects, start=1):
        stage = fit.stage(effects[:k], {**stage["values"], e.name: e.null_values(data.experiment)})
        yield stage


class GivenEffects(Campaign):
    """See the text of this module."""

    unit = "case"
    outcome = Outcome

    def add_options(self, parser: argparse.ArgumentParser) -> None:
        """The data, the effects, and how they are fitted."""
        parser.add_argument("folder", nargs="+", help="measured data, as for tdcr-fe identify")
        several: dict[str, Any] = {"nargs": "+", "required": True}
        parser.add_argument("--effects", **several, metavar="NAME", help="in the order of adding")
        parser.add_argument("--hold-out", **several, metavar="PATTERN", help="branches")

    def cases(self, options: argparse.Namespace) -> Mapping[str, Any]:
        """One case: everything depends on what was fitted before."""
        return {"fit": (options.folder, options.effects, options.hold_out)}

    def run(self, case: tuple[list[str], list[str], list[str]], out: Path) -> Outcome:
        """Fit all stages."""
        folders, effects, patterns = case
        data = join_measured(list(map(read_measured, folders)))
        return Outcome(list(fit_in_order(data, effects, patterns)))

    def table(self, outcomes: Sequence[Outcome]) -> pd.DataFrame:
        """Mean distance of the markers by stage [mm]."""
        stages = [s for o in outcomes for s in o.stages]
        rows = [(s["added"] or "declared", *(round(1e3 * s[k], 2) for k in SHARES)) for s in stages]
        return pd.DataFrame(rows, columns=["added", "fitted [mm]", "held out [mm]"])

    def report(self, outcomes: Sequence[Outcome]) -> list[str | pd.DataFrame]:
        """All stages, and the values of the last one."""
        last = outcomes[0].stages[-1]["values"]
        texts = [f"{e}: " + ", ".join(f"{k} = {v:.5g}" for k, v in own.items()) for e, own in last.items()]
        return [self.table(outcomes), *texts]


CAMPAIGN = GivenEffects()

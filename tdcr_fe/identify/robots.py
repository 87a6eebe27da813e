"""Several robots of one design: the effects that they share, common values, and the scatter between the robots.

Each robot is identified by itself. Every model that explains one of them is fitted to all, and the one with the largest
evidence over all robots is taken. Its values differ from robot to robot by their standard errors and by a scatter that
is normally distributed; common value and scatter maximise the restricted likelihood (two-stage estimate; M. Davidian,
D. M. Giltinan, Nonlinear Models for Repeated Measurement Data, 1995, chapter 5).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np

from tdcr_fe.elements import Array
from tdcr_fe.identify import fitting
from tdcr_fe.identify.criteria import bic
from tdcr_fe.identify.dictionary import dictionary
from tdcr_fe.identify.forward import ForwardModel
from tdcr_fe.identify.identification import declared_state, identify, prepare
from tdcr_fe.identify.problem import Point
from tdcr_fe.identify.result import HALF_WIDTH, Estimate, IdentificationResult, Verdict
from tdcr_fe.identify.search_state import Progress
from tdcr_fe.identify.settings import IdentifySettings
from tdcr_fe.identify.verdict import estimates
from tdcr_fe.io.measured import MeasuredData, without_unread_steps
from tdcr_fe.model.messages import warnings_to
from tdcr_fe.report.environment import estimate, quantity, words


class Common(NamedTuple):
    """A parameter over all robots."""

    value: float
    std_error: float
    scatter: float  # standard deviation between the robots
    interval: tuple[float, float]  # of the scatter, 95 %

    @classmethod
    def of(cls, values: Array, errors: Array) -> Common:
        """From values and standard errors of the robots, shape (n,).

        The scatter is searched from zero to ten times the spread of the values.
        """
        smallest, largest = float(np.min(errors)), 10.0 * max(float(np.ptp(values)), float(np.max(errors)))
        scatter = np.concatenate(([0.0], np.geomspace(1e-2 * smallest, largest, 2000)))
        variance = errors**2 + scatter[:, None] ** 2
        weight = 1.0 / variance
        mean = (weight @ values) / weight.sum(axis=1)
        loss = np.sum(np.log(variance), axis=1) + np.log(weight.sum(axis=1))
        loss += np.sum(weight * (values - mean[:, None]) ** 2, axis=1)
        best = int(np.argmin(loss))
        inside = scatter[loss <= loss[best] + HALF_WIDTH**2]  # likelihood ratio, one degree of freedom
        error = float(1.0 / np.sqrt(weight[best].sum()))
        return cls(float(mean[best]), error, float(scatter[best]), (float(inside[0]), float(inside[-1])))


@dataclass(frozen=True)
class RobotsResult:
    """What was found of several robots of one design."""

    results: Mapping[str, IdentificationResult]  # of each robot by itself, by the name of its data
    effects: tuple[str, ...]  # that the robots share; empty where none explains any of them
    # By EFFECT.PARAMETER: the value of each robot, in the order of `results`, and what they have in common
    values: Mapping[str, tuple[Estimate, ...]] = field(default_factory=dict)
    common: Mapping[str, Common] = field(default_factory=dict)
    interrupted: bool = False  # then with the robots up to the one at which that was, and nothing in common

    def to_json(self) -> dict[str, Any]:
        """As ``robots.json`` has it."""
        parameters = {}
        for name, c in self.common.items():
            own = zip(self.results, self.values[name], strict=True)
            parameters[name] = {
                "unit": self.values[name][0].unit,
                "common": {"value": c.value, "std_error": c.std_error},
                "scatter": {"value": c.scatter, "interval_95": list(c.interval)},
                "robots": {robot: {"value": p.value, "std_error": p.std_error} for robot, p in own},
            }
        verdicts = {name: str(r.verdict) for name, r in self.results.items()}
        return {"robots": verdicts, "effects": list(self.effects), "parameters": parameters}

    def __repr__(self) -> str:
        names = " and ".join(map(words, self.effects)) or "no effect"
        lines = [f"{len(self.results)} robots: {names} in common."]
        for name, c in self.common.items():
            unit = self.values[name][0].unit
            low, high = (quantity(x, unit, 2) for x in c.interval)
            value, scatter = estimate(c.value, HALF_WIDTH * c.std_error, unit), quantity(c.scatter, unit, 2)
            between = f"between the robots a standard deviation of {scatter} ({low} to {high}, 95 %)"
            own = zip(self.results, self.values[name], strict=True)
            each = (f"{robot} {estimate(p.value, p.half_width, unit)}" for robot, p in own)
            lines += [f"{words(name)}: {value}, {between}", f"    {', '.join(each)}"]
        return "\n".join(lines)


def identify_robots(
    sets: Sequence[MeasuredData], settings: IdentifySettings | None = None, progress: Progress | None = None
) -> RobotsResult:
    """Identify several robots of one design.

    Parameters
    ----------
    sets
        Data of one robot each, with different names.
    settings
        Settings of the search; the time limit is divided among the robots.
    progress
        See `tdcr_fe.identify`.

    Raises
    ------
    KeyboardInterrupt
        Interrupted before the declared model of the first was solved.
    """
    settings = settings or IdentifySettings()
    settings = replace(settings, time_limit=settings.time_limit / len(sets))
    results: dict[str, IdentificationResult] = {}
    try:
        for number, data in enumerate(sets):

            def of_robot(text: str, share: float, name: str = data.name, number: int = number) -> None:
                if progress is not None:
                    progress(f"{name}: {text}", (number + share) / len(sets))

            results[data.name] = identify(data, settings, of_robot)
            if results[data.name].log.interrupted:
                raise KeyboardInterrupt
        with warnings_to():  # values that a fit tries are not the user's
            return _in_common(sets, settings, results)
    except KeyboardInterrupt:
        if not results:
            raise
        return RobotsResult(results, (), interrupted=True)


def _in_common(
    sets: Sequence[MeasuredData], settings: IdentifySettings, results: Mapping[str, IdentificationResult]
) -> RobotsResult:
    """What robots have in common that are identified, each by itself."""
    models: dict[tuple[str, ...], Point] = {}
    for r in results.values():
        if r.verdict in (Verdict.EXPLAINED, Verdict.LAW_FOUND):
            point = {e.form: {n: p.value for n, p in e.parameters.items()} for e in r.effects}
            models.setdefault(tuple(e.form for e in r.effects), point)
    fitted = [_fitted(data, settings, models) for data in sets]
    evidence = {names: sum(own[names][0] for own in fitted) for names in models}
    best = min(evidence, key=lambda names: evidence[names], default=())
    if not np.isfinite(evidence.get(best, np.inf)):
        return RobotsResult(results, ())
    values, common = dict[str, tuple[Estimate, ...]](), dict[str, Common]()
    for name in fitted[0][best][1]:
        own = tuple(found[best][1][name] for found in fitted)
        if all(p.std_error for p in own):
            errors = np.array([p.std_error for p in own])
            values[name], common[name] = own, Common.of(np.array([p.value for p in own]), errors)
    return RobotsResult(results, best, values, common)


def _fitted(
    data: MeasuredData, settings: IdentifySettings, models: Mapping[tuple[str, ...], Point]
) -> dict[tuple[str, ...], tuple[float, dict[str, Estimate]]]:
    """Criterion and numbers of every model on the data of one robot; infinite where it is not solved there."""
    found: dict[tuple[str, ...], tuple[float, dict[str, Estimate]]] = {}
    with ForwardModel(settings.processes, data.settings) as forward:
        state = declared_state(prepare(without_unread_steps(data), settings, forward))
        problem = state.problem
        known = {e.name: e for e in dictionary(problem, state.declared.run)}
        for names, point in models.items():
            found[names] = np.inf, {}
            if all(name in known for name in names):
                effects = [known[name] for name in names]
                start = {e.name: {p.name: point[e.name][p.name] for p in e.parameters} for e in effects}
                fit = fitting.fit(problem, effects, start)
                deviation = np.sqrt(np.maximum(np.diag(fitting.covariance(problem, fit)), 0.0))
                each = {e.name: estimates(problem, fit, e, deviation) for e in effects}
                numbers = {f"{e}.{n}": p for e, own in each.items() for n, p in own.items()}
                found[names] = bic(problem, fit) if fit.solved else np.inf, numbers
    return found

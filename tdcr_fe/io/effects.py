"""The ``[effects]`` table of `scenario.toml`: effects given by the user, for ``tdcr-fe run``."""

from __future__ import annotations

import difflib
from collections.abc import Callable, Sequence
from typing import Any

from tdcr_fe.effects import EFFECTS, Effect, Experiment, effect, with_effects
from tdcr_fe.io.problems import Report
from tdcr_fe.model.loading import LoadStep, Model
from tdcr_fe.model.robot import Robot


def read_effects(
    table: Any,
    robot: Robot,
    model: Model,
    steps: tuple[LoadStep, ...],
    report: Report,
    catalogue: Sequence[Effect] = EFFECTS,
) -> tuple[Robot, Model, tuple[LoadStep, ...]]:
    """Apply a table such as ``gravity = { g_z = -9.81 }`` to the robot, model and steps of a scenario.

    Parameters
    ----------
    table
        By name of the effect, a table of its parameters; those that are not named keep their null values.
    robot, model, steps
        As the files describe them.
    report
        Takes every mistake: key, value, what is allowed.
    catalogue
        The effects that there are.
    """
    experiment = Experiment(robot, model, steps)
    sound = checked_effects(table, experiment, report, catalogue)
    try:
        changed = with_effects(experiment, sound, catalogue)
    except ValueError as error:  # a robot that cannot be
        report("effects", "", str(error))
        return robot, model, steps
    if changed.observation != experiment.observation:
        names = " and ".join(n for n in sound if n in ("frame_misalignment", "marker_offset"))
        report(
            "effects",
            names,
            "acts on the measurement only; the results of a run are those of the robot itself",
        )
    return changed.robot, changed.model, changed.steps


def checked_effects(
    table: Any, experiment: Experiment, report: Report, catalogue: Sequence[Effect] = EFFECTS
) -> dict[str, dict[str, float]]:
    """Values of a table of effects, by effect and parameter; what is wrong is reported and left out.

    Parameters
    ----------
    table
        By name of the effect, a table of its parameters.
    experiment
        Whose tendons and markers parameters may name.
    report
        Takes every mistake: key, value, what is allowed.
    catalogue
        The effects that there are.
    """
    if not isinstance(table, dict):
        report("effects", str(table), "must be a table of effects by name, each a table of numbers")
        return {}
    sound: dict[str, dict[str, float]] = {}
    for name, values in table.items():
        known = [e.name for e in catalogue]
        if name not in known:
            near = difflib.get_close_matches(name, known, n=1)
            hint = f"; did you mean {near[0]}?" if near else ""
            report(f"effects.{name}", str(values), f"unknown effect{hint}; there are {', '.join(known)}")
            continue
        e = effect(name, catalogue)
        known_parameters = e.parameters_of(experiment)
        allowed = ", ".join(f"{p.name} [{p.unit}]" for p in known_parameters)
        if not isinstance(values, dict):
            report(f"effects.{name}", str(values), f"must be a table with {allowed}")
            continue
        numbers: dict[str, float] = {}
        for key, value in values.items():
            p = next((p for p in known_parameters if p.name == key), None)
            if p is None:
                report(f"effects.{name}.{key}", str(value), f"unknown parameter; there are {allowed}")
            elif (
                isinstance(value, bool)
                or not isinstance(value, int | float)
                or not p.lower <= value <= p.upper
            ):
                report(
                    f"effects.{name}.{key}",
                    str(value),
                    f"must be a number from {p.lower:g} to {p.upper:g} {p.unit}",
                )
            else:
                numbers[key] = float(value)
        sound[name] = numbers
    return sound


def effects_reader(
    own: Sequence[Effect],
) -> Callable[[Any, Robot, Model, tuple[LoadStep, ...], Report], tuple[Robot, Model, tuple[LoadStep, ...]]]:
    """`read_effects` that knows effects of the user's own besides the listed ones."""

    def read(
        table: Any, robot: Robot, model: Model, steps: tuple[LoadStep, ...], report: Report
    ) -> tuple[Robot, Model, tuple[LoadStep, ...]]:
        return read_effects(table, robot, model, steps, report, (*EFFECTS, *own))

    return read

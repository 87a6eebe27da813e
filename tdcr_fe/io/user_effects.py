"""The ``[effects]`` table of `scenario.toml` and `model.toml`, and effects that users write in Python files."""

from __future__ import annotations

import inspect
import math
import os
import runpy
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from tdcr_fe.effects import EFFECTS, Effect, Experiment, Parameter, with_effects
from tdcr_fe.io.problems import InputError, Problem, Report
from tdcr_fe.model.messages import meant
from tdcr_fe.model.units import number_or_none, with_units


def apply_effects(
    table: Any, experiment: Experiment, report: Report, own: Sequence[Effect] = ()
) -> tuple[dict[str, dict[str, float]], Experiment]:
    """Apply a table such as ``gravity = { g_z = -9.81 }``.

    Parameters
    ----------
    table
        By name of the effect, a table of its parameters; those that are not named keep their null values.
    experiment
        As the files describe it.
    report
        Takes every mistake: key, value, what is allowed.
    own
        Effects that there are besides the listed ones.

    Returns
    -------
    values : dict
        Of the effects that are sound, by effect and parameter.
    experiment : Experiment
        With them.
    """
    catalogue = (*EFFECTS, *own)
    sound = _checked(table, experiment, report, catalogue)
    try:
        return sound, with_effects(experiment, sound, catalogue)
    except ValueError as error:  # a robot that cannot be
        report("effects", "", str(error))
        return sound, experiment


def _checked(
    table: Any, experiment: Experiment, report: Report, catalogue: Sequence[Effect]
) -> dict[str, dict[str, float]]:
    """Values of a table of effects, by effect and parameter; what is wrong is reported and left out."""
    if not isinstance(table, dict):
        report("effects", str(table), "must be a table of effects by name, each a table of numbers")
        return {}
    known = {e.name: e for e in catalogue}
    sound: dict[str, dict[str, float]] = {}
    for name, values in table.items():
        if name not in known:
            text = f"unknown effect{meant(name, known)}; there are {', '.join(known)}"
            report(f"effects.{name}", str(values), text)
            continue
        parameters = {p.name: p for p in known[name].parameters_of(experiment)}
        allowed = ", ".join(f"{p.name} [{p.unit}]" for p in parameters.values())
        if not isinstance(values, dict):
            report(f"effects.{name}", str(values), f"must be a table with {allowed}")
            continue
        sound[name] = {}
        for key, value in values.items():
            p = parameters.get(key)
            number = None if p is None else number_or_none(value, p.unit)
            if p is None:
                text = f"unknown parameter{meant(key, parameters)}; there are {allowed}"
                report(f"effects.{name}.{key}", str(value), text)
            elif number is None or not p.lower <= number <= p.upper:
                text = f"must be a number from {p.lower:g} to {p.upper:g} {p.unit}"
                text = with_units(text, value, p.unit) if isinstance(value, str) else text
                report(f"effects.{name}.{key}", str(value), text)
            else:
                sound[name][key] = float(number)
    return sound


#: What a file must contain.
ONE_CLASS = (
    "must define a class derived from tdcr_fe.effects.Effect, with name, description, parameters and apply"
)


def read_own_effects(paths: Iterable[str | os.PathLike[str]]) -> tuple[Effect, ...]:
    """The effects that Python files define, in their order.

    Each file is run. Every class in it that is derived from `tdcr_fe.effects.Effect` is made without arguments.

    Parameters
    ----------
    paths
        Of the files.

    Returns
    -------
    tuple of Effect

    Raises
    ------
    InputError
        A file cannot be read or run, defines no effect, or an effect lacks what it must have; all of it is named.
    """
    problems: list[Problem] = []
    found: list[Effect] = []
    for path in map(Path, paths):
        try:
            made = _effects_of(path)
        except InputError as error:
            problems += error.problems
            continue
        for e in made:
            faults = list(_faults(e, [*EFFECTS, *found]))
            problems += [Problem(str(path), f"{type(e).__name__}.{k}", v, text) for k, v, text in faults]
            found += [] if faults else [e]
    if problems:
        raise InputError(problems)
    return tuple(found)


def check_on(effects: Sequence[Effect], experiment: Experiment) -> None:
    """Apply effects of one's own once, at their null values, so that mistakes show before anything is simulated.

    Raises
    ------
    InputError
        Names the method that fails, and the error in it.
    """
    problems = []
    for e in effects:
        file = inspect.getsourcefile(type(e).apply) or type(e).__module__
        step, value, text = "null_values", "", ""
        try:
            values = e.null_values(experiment)
            step = "bounds"
            e.bounds(experiment)
            step = "apply"
            changed = e.apply(experiment, values)
            if not isinstance(changed, Experiment):
                value = f"a {type(changed).__name__}"
                text = "must return an Experiment, such as experiment.with_robot(...)"
        except Exception as error:  # whatever a user's method raises is a mistake in the user's file
            text = f"fails at null values: {type(error).__name__}: {error}"
        if text:
            problems.append(Problem(file, f"{type(e).__name__}.{step}", value, text))
    if problems:
        raise InputError(problems)


#: Name of the module that a user's file is run as.
_MODULE = "own_effects"


def _effects_of(path: Path) -> list[Effect]:
    """Effects that a file defines."""

    def refused(text: str) -> InputError:
        return InputError([Problem(str(path), "", "", text)])

    if not path.is_file():
        raise refused("no such file; must be a Python file with an effect")
    try:
        names = runpy.run_path(str(path), run_name=_MODULE)
        classes = [c for c in names.values() if inspect.isclass(c) and c.__module__ == _MODULE]
        made = [c() for c in classes if issubclass(c, Effect)]
    except Exception as error:  # whatever a user's file raises is a mistake in it
        raise refused(f"cannot be run: {type(error).__name__}: {error}") from error
    if not made:
        raise refused(ONE_CLASS)
    return made


def _faults(e: Effect, others: Sequence[Effect]) -> Iterable[tuple[str, str, str]]:
    """Attribute, value and what is allowed, of everything that an effect lacks."""
    if not (isinstance(e.name, str) and e.name.isidentifier()):
        yield "name", repr(e.name), "must be a word, such as 'my_effect'; it is the key in [effects]"
    elif e.name in {o.name for o in others}:
        yield "name", repr(e.name), "is the name of another effect"
    if not (isinstance(e.description, str) and e.description):
        yield "description", repr(e.description), "must say in a sentence what it is, for the report"
    if type(e).apply is Effect.apply:
        yield "apply", "", "must be defined: from an experiment and values to another experiment"
    sound = isinstance(e.parameters, tuple) and all(isinstance(p, Parameter) for p in e.parameters)
    if not (sound and e.parameters):
        yield "parameters", repr(e.parameters), "must be a tuple of at least one tdcr_fe.effects.Parameter"
        return
    for p in e.parameters:
        if not p.lower <= p.null_value <= p.upper:
            text = f"must lie within its bounds, {p.lower:g} to {p.upper:g} {p.unit}"
            yield f"parameters.{p.name}.null_value", f"{p.null_value:g}", text
        if not (p.scale > 0.0 and math.isfinite(p.scale)):
            yield f"parameters.{p.name}.scale", f"{p.scale:g}", "must be positive: a noticeable change"

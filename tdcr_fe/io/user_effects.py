"""The ``[effects]`` table of `scenario.toml` and `model.toml`, and effects that users write in Python files."""

from __future__ import annotations

import inspect
import math
import runpy
from collections.abc import Iterable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from tdcr_fe.effects import EFFECTS, Effect, Experiment, Parameter, with_effects
from tdcr_fe.io.files import InputError, Problem, Reporter, StrPath, refusal
from tdcr_fe.io.keys import effect_keys, parameter_keys


def apply_effects(
    table: Any, experiment: Experiment, reporter: Reporter, own: Sequence[Effect] = ()
) -> tuple[dict[str, dict[str, float]], Experiment]:
    """Apply a table such as ``gravity = { g_z = -9.81 }``.

    Parameters
    ----------
    table
        By name of the effect, a table of its parameters; those that are not named keep their null values.
    experiment
        As the files describe it.
    reporter
        Takes every mistake.
    own
        Effects that there are besides the listed ones.

    Returns
    -------
    values : dict
        Values of the effects that are sound, by effect and parameter.
    experiment : Experiment
        With them.
    """
    catalogue = {e.name: e for e in (*EFFECTS, *own)}
    given, _ = effect_keys(tuple(catalogue)).read(table, "effects", reporter)
    sound = {}
    for name in (n for n, values in given.items() if values is not None):
        parameters = parameter_keys(tuple(catalogue[name].parameters_of(experiment)))
        values, _ = parameters.read(given[name], f"effects.{name}", reporter)
        sound[name] = {key: value for key, value in values.items() if value is not None}
    try:
        return sound, with_effects(experiment, sound, tuple(catalogue.values()))
    except ValueError as error:  # a robot that cannot be
        reporter("effects", "", str(error))
        return sound, experiment


def read_own_effects(paths: Iterable[StrPath]) -> tuple[Effect, ...]:
    """The effects that Python files define, in their order.

    Each file is run. Every class in it that is derived from `tdcr_fe.effects.Effect` is made without arguments.

    Parameters
    ----------
    paths
        Paths of the files.

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
        reporter = Reporter(str(path), problems)
        for e in reporter.sound(partial(_effects_of, path)) or ():
            faults = list(_faults(e, [*EFFECTS, *found]))
            for name, value, allowed in faults:
                reporter(f"{type(e).__name__}.{name}", value, allowed)
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
        step, wrong = "null_values", ("", "")
        try:
            values = e.null_values(experiment)
            step = "bounds"
            e.bounds(experiment)
            step = "apply"
            changed = e.apply(experiment, values)
            if not isinstance(changed, Experiment):
                text = "must return an Experiment, such as experiment.with_robot(...)"
                wrong = f"a {type(changed).__name__}", text
        except Exception as error:  # whatever a user's method raises is a mistake in the user's file
            wrong = "", f"fails at null values: {type(error).__name__}: {error}"
        if any(wrong):
            file = inspect.getsourcefile(type(e).apply) or type(e).__module__
            problems.append(Problem(file, f"{type(e).__name__}.{step}", *wrong))
    if problems:
        raise InputError(problems)


#: Name of the module that a user's file is run as.
_MODULE = "own_effects"


def _effects_of(path: Path) -> list[Effect]:
    """Effects that a file defines."""
    if not path.is_file():
        what = "is a directory" if path.is_dir() else "no such file"
        raise refusal(path, f"{what}; must be a Python file with an effect")
    try:
        names = runpy.run_path(str(path), run_name=_MODULE)
        classes = [c for c in names.values() if inspect.isclass(c) and c.__module__ == _MODULE]
        made = [c() for c in classes if issubclass(c, Effect)]
    except Exception as error:  # whatever a user's file raises is a mistake in it
        raise refusal(path, f"cannot be run: {type(error).__name__}: {error}") from error
    if not made:
        text = "must define a class derived from tdcr_fe.effects.Effect, with name, description, "
        raise refusal(path, f"{text}parameters and apply")
    return made


def _faults(e: Effect, others: Sequence[Effect]) -> Iterable[tuple[str, str, str]]:
    """Attribute, value and what is allowed, of everything that an effect lacks."""
    if not (isinstance(e.name, str) and e.name.isidentifier()):
        yield "name", repr(e.name), "must be a word, such as 'my_effect'; it is the key in [effects]"
    elif e.name in {o.name for o in others}:
        yield "name", repr(e.name), "is the name of another effect"
    if not (isinstance(e.description, str) and e.description):
        yield "description", repr(e.description), "must say in a sentence what it is, for the report"
    if type(e).apply is Effect.apply and not e.stands_at:
        yield "apply", "", "must be defined: from an experiment and values to another experiment"
    sound = isinstance(e.parameters, tuple) and all(isinstance(p, Parameter) for p in e.parameters)
    if not (sound and e.parameters):
        yield "parameters", repr(e.parameters), "must be a tuple of at least one tdcr_fe.effects.Parameter"
        return
    for p in e.parameters:
        if not p.lower <= p.null_value <= p.upper or not 0.0 < p.scale < math.inf:
            bounds = f"null_value must lie within its bounds, {p.lower:g} to {p.upper:g} {p.unit}"
            yield f"parameters.{p.name}", f"{p.null_value:g}", f"{bounds}, and scale above zero"

"""Effects of the user's own: classes in a Python file, read for ``--effects FILE.py``."""

from __future__ import annotations

import inspect
import math
import os
import runpy
from collections.abc import Iterable, Sequence
from pathlib import Path

from tdcr_fe.effects import EFFECTS, Effect, Experiment, Parameter
from tdcr_fe.io.problems import InputError, Problem

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
    for path in paths:
        for e in _effects_of(Path(path), problems):
            faults = list(_faults(e, [*EFFECTS, *found]))
            problems += [
                Problem(str(path), f"{type(e).__name__}.{k}", v, allowed) for k, v, allowed in faults
            ]
            if not faults:
                found.append(e)
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
        where = "null_values"
        try:
            values = e.null_values(experiment)
            where = "bounds"
            e.bounds(experiment)
            where = "apply"
            changed = e.apply(experiment, values)
        except Exception as error:  # whatever a user's method raises is a mistake in the user's file
            text = f"{type(error).__name__}: {error}"
            problems.append(Problem(file, f"{type(e).__name__}.{where}", "", f"fails at null values: {text}"))
            continue
        if not isinstance(changed, Experiment):
            allowed = "must return an Experiment, such as experiment.with_robot(...)"
            problems.append(
                Problem(file, f"{type(e).__name__}.apply", f"a {type(changed).__name__}", allowed)
            )
    if problems:
        raise InputError(problems)


#: Name of the module that a user's file is run as.
_MODULE = "own_effects"


def _effects_of(path: Path, problems: list[Problem]) -> list[Effect]:
    """Effects that a file defines; what is wrong with the file goes to ``problems``."""
    if not path.is_file():
        problems.append(Problem(str(path), "", "", "no such file; must be a Python file with an effect"))
        return []
    try:
        names = runpy.run_path(str(path), run_name=_MODULE)
        classes = [
            c
            for c in names.values()
            if inspect.isclass(c) and issubclass(c, Effect) and c.__module__ == _MODULE
        ]
        made = [c() for c in classes]
    except Exception as error:  # whatever a user's file raises is a mistake in it
        problems.append(Problem(str(path), "", "", f"cannot be run: {type(error).__name__}: {error}"))
        return []
    if not made:
        problems.append(Problem(str(path), "", "", ONE_CLASS))
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

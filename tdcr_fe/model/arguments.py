"""Type errors for arguments of public functions, with a hint of what to call."""

from __future__ import annotations

import math
from collections.abc import Sequence
from numbers import Integral, Real
from typing import Any

from tdcr_fe.model.loading import LoadStep, Model, SolverSettings
from tdcr_fe.model.robot import Robot


def wrong_type(function: str, argument: str, value: Any, expected: str, hint: str) -> TypeError:
    """Error that names function, argument, what was given, what is expected and what to call."""
    given = f"{value!r}" if isinstance(value, str) and len(value) < 60 else f"of type {type(value).__name__}"
    return TypeError(f"{function}: {argument} is {given}; expected {expected}. {hint}")


def check_robot(function: str, value: Any) -> None:
    """Refuse anything but a `Robot`."""
    if not isinstance(value, Robot):
        hint = "read_robot(path) reads one from robot.toml; Robot(backbone=..., disks=..., tendons=...) makes one."
        raise wrong_type(function, "robot", value, "a Robot", hint)


def check_model(function: str, value: Any) -> None:
    """Refuse anything but a `Model`."""
    if not isinstance(value, Model):
        hint = "Model(friction='per-hole') makes one; read_scenario(path).model is that of a file."
        raise wrong_type(function, "model", value, "a Model", hint)


def check_steps(function: str, value: Any) -> None:
    """Refuse anything but a sequence of `LoadStep`."""
    hint = "[LoadStep(tensions={'t1': 1.0})] is one; read_scenario(path).steps are those of a file."
    if not isinstance(value, Sequence) or isinstance(value, str):
        raise wrong_type(function, "steps", value, "a sequence of LoadStep", hint)
    for k, step in enumerate(value):
        if not isinstance(step, LoadStep):
            raise wrong_type(function, f"steps[{k}]", step, "a LoadStep", hint)


def check_settings(function: str, value: Any) -> None:
    """Refuse anything but `SolverSettings` or None."""
    hint = "SolverSettings(max_substeps=128) makes them."
    check_instance(function, "settings", value, (SolverSettings, type(None)), "SolverSettings", hint)


def check_instance(
    function: str, argument: str, value: Any, types: type | tuple[type, ...], expected: str, hint: str
) -> None:
    """Refuse a value of another type."""
    if not isinstance(value, types):
        raise wrong_type(function, argument, value, expected, hint)


def check_callable(function: str, argument: str, value: Any, hint: str) -> None:
    """Refuse anything but a function or None."""
    if value is not None and not callable(value):
        raise wrong_type(function, argument, value, "a function", hint)


def check_count(function: str, argument: str, value: Any) -> None:
    """Refuse anything but a whole number of at least 1, or None.

    Raises
    ------
    TypeError, ValueError
    """
    if value is None:
        return
    if not isinstance(value, Integral) or isinstance(value, bool):
        raise wrong_type(function, argument, value, "a whole number", "None lets the solver choose.")
    if value < 1:
        raise ValueError(f"{function}: {argument} = {value}; must be at least 1")


def check_number(function: str, argument: str, value: Any, hint: str, positive: bool = False) -> None:
    """Refuse anything but a finite (and positive) number.

    Raises
    ------
    TypeError, ValueError
    """
    if not isinstance(value, Real) or isinstance(value, bool):
        raise wrong_type(function, argument, value, "a number", hint)
    if not math.isfinite(value) or (positive and value <= 0.0):
        raise ValueError(
            f"{function}: {argument} = {value}; must be {'positive and ' * positive}finite. {hint}"
        )


def check_numbers(function: str, argument: str, value: Any, hint: str, count: int | None = None) -> None:
    """Refuse anything but a sequence of finite numbers (of a certain length)."""
    expected = "a sequence of numbers" if count is None else f"{count} numbers"
    try:
        found = None if isinstance(value, str) else list(value)
    except TypeError:
        found = None
    if found is None or (count is not None and len(found) != count):
        raise wrong_type(function, argument, value, expected, hint)
    for k, x in enumerate(found):
        check_number(function, f"{argument}[{k}]", x, hint)

"""Errors for arguments of public functions that would do harm without one, with a hint of what to call."""

from __future__ import annotations

import math
from numbers import Real
from typing import Any


def check_instance(
    function: str, argument: str, value: Any, types: type | tuple[type, ...], hint: str
) -> None:
    """Refuse a value of another type, by a TypeError that names function, argument and what was given."""
    if not isinstance(value, types):
        given = (
            repr(value) if isinstance(value, str) and len(value) < 60 else f"of type {type(value).__name__}"
        )
        raise TypeError(f"{function}: {argument} is {given}; expected {hint}")


def check_number(function: str, argument: str, value: Any, hint: str, positive: bool = False) -> None:
    """Refuse anything but a finite (and positive) number."""
    if isinstance(value, bool):
        value = str(value)
    check_instance(function, argument, value, Real, f"a number. {hint}")
    if not math.isfinite(value) or (positive and value <= 0.0):
        raise ValueError(
            f"{function}: {argument} = {value}; must be {'positive and ' * positive}finite. {hint}"
        )


def check_numbers(function: str, argument: str, value: Any, hint: str, count: int | None = None) -> None:
    """Refuse anything but a sequence of finite numbers (of a certain length)."""
    expected = "a sequence of numbers" if count is None else f"{count} numbers"
    is_list = hasattr(value, "__len__") and not isinstance(value, str)
    if not is_list or (count is not None and len(value) != count):
        check_instance(function, argument, value, (), f"{expected}. {hint}")
    for k, x in enumerate(value):
        check_number(function, f"{argument}[{k}]", x, hint)

"""Errors for arguments of public functions that would do harm without one, with a hint of what to call."""

from __future__ import annotations

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

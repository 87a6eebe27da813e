"""Type errors for arguments of public functions, with a hint of what to call."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from tdcr_fe.model.loading import LoadStep, Model
from tdcr_fe.model.robot import Robot
from tdcr_fe.model.settings import SolverSettings


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
    if value is not None and not isinstance(value, SolverSettings):
        hint = "SolverSettings(max_substeps=128) makes them."
        raise wrong_type(function, "settings", value, "SolverSettings", hint)

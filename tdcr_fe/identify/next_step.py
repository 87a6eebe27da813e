"""The corrected robot of an identification as a ``scenario.toml`` for ``tdcr-fe run``."""

from __future__ import annotations

import json
import math

from tdcr_fe.effects import Experiment, effect
from tdcr_fe.identify.outcome import IdentificationResult


def observation_effects(result: IdentificationResult) -> list[str]:
    """Effects that act on the measurement only; a scenario cannot have them."""
    data = result.data
    declared = Experiment(data.robot, data.model, data.steps)
    found = []
    for name, values in result.effects_table.items():
        changed = effect(name).apply(declared, {**effect(name).null_values(declared), **values})
        if changed.observation != declared.observation:
            found.append(name)
    return found


def effects_block(result: IdentificationResult) -> str:
    """The ``[effects]`` table of a scenario that corrects the declared robot; empty where nothing was added."""
    skipped = observation_effects(result)
    lines = []
    for name, values in result.effects_table.items():
        table = ", ".join(f"{key} = {_number(value)}" for key, value in values.items())
        comment = "# acts on the measurement only: " if name in skipped else ""
        lines.append(f"{comment}{name} = {{ {table} }}")
    return "\n".join(["[effects]", *lines]) if lines else ""


def scenario_text(result: IdentificationResult) -> str:
    """A whole ``scenario.toml``: declared robot and model, ``[effects]``, and the measured loading sequence."""
    data = result.data
    model = data.model
    lines = [
        'robot = "robot.toml"  # as declared, beside this file',
        "",
        "[model]",
        f"tendon_path = {json.dumps(model.tendon_path)}",
        f"friction = {json.dumps(model.friction)}",
        f"gravity = {_vector(model.gravity)}",
        "",
        effects_block(result),
        "",
    ]
    for number, step in zip(data.step_ids, data.steps, strict=True):
        lines += ["[[steps]]", f'label = "{number}"']
        for key, values in (("tensions", step.tensions), ("displacements", step.displacements)):
            if values:
                table = ", ".join(f"{json.dumps(n)} = {_number(v)}" for n, v in values.items())
                lines.append(f"{key} = {{ {table} }}")
        if step.loads:
            loads = ", ".join(
                f"{json.dumps(n)} = {{ at = {_number(x.at)}, force = {_vector(x.force)}, moment = {_vector(x.moment)}, "
                f"frame = {json.dumps(x.frame)} }}"
                for n, x in step.loads.items()
            )
            lines.append(f"loads = {{ {loads} }}")
        if step.time is not None:
            lines.append(f"time = {_number(step.time)}")
        lines.append("")
    return "\n".join(lines)


def _number(value: float) -> str:
    """A float as TOML has it, to seven digits."""
    text = f"{value:.7g}"
    return text if math.isfinite(value) and any(c in text for c in ".e") else f"{text}.0"


def _vector(values: tuple[float, float, float]) -> str:
    return f"[{', '.join(_number(v) for v in values)}]"

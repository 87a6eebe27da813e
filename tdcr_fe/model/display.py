"""A result as ten lines of text, and as HTML for notebooks."""

from __future__ import annotations

from collections.abc import Iterable
from html import escape
from math import degrees
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from tdcr_fe.model.results import SequenceResult, StepResult

#: Tendons, and load steps of the HTML table, that are shown before "and ... more".
SHOWN_TENDONS, SHOWN_STEPS = 6, 12


def summary_rows(result: SequenceResult) -> list[tuple[str, str]]:
    """Name and text of every line: robot, model, steps, status, last step, tip, angle, tendons, warnings."""
    robot, model = result.robot, result.model
    rows = [
        (
            "robot",
            f"{robot.name}: {_count(len(robot.tendons), 'tendon')}, {_count(len(robot.disks.positions), 'disk')}, "
            f"length {1e3 * robot.backbone.length:g} mm",
        ),
        (
            "model",
            f"tendon path {model.tendon_path}, friction {model.friction}, "
            f"elements per bay {model.elements_per_bay}",
        ),
        ("steps", _steps(result)),
        ("status", result.message or ("all steps converged" if result.converged else "did not converge")),
    ]
    if result.steps:
        rows += _last_step(result, result.steps[-1])
    rows.append(("warnings", _warnings(result.warnings)))
    return rows


def as_text(result: SequenceResult) -> str:
    """The summary, one line for each row."""
    return "\n".join(f"{name:<12}  {text}" for name, text in summary_rows(result))


def as_html(result: SequenceResult) -> str:
    """The summary, and below it the table of load steps."""
    rows = "".join(
        f'<tr><th style="text-align:left">{escape(name)}</th><td style="text-align:left">{escape(text)}</td></tr>'
        for name, text in summary_rows(result)
    )
    table: str = result.to_frame().to_html(
        index=False, max_rows=SHOWN_STEPS, float_format=lambda x: f"{x:.6g}", escape=True
    )
    return f"<table>{rows}</table>\n{table}"


def _steps(result: SequenceResult) -> str:
    iterations = sum(s.iterations for s in result.steps)
    failed = "" if result.failed_step is None else f", step {result.failed_step} not"
    return f"{len(result.steps)} solved{failed}; {iterations} Newton iterations, {result.wall_time:.2f} s"


def _last_step(result: SequenceResult, step: StepResult) -> list[tuple[str, str]]:
    x, y, z = (_millimetres(c) for c in step.tip)
    names = result.robot.tendon_names
    at_base = (f"{n} {t:.4g}" for n, t in zip(names, step.base_tensions, strict=True))
    at_anchor = (f"{n} {t[-1]:.4g}" for n, t in zip(names, step.tensions, strict=True))
    pulled = (f"{n} {_millimetres(d)}" for n, d in zip(names, step.displacements, strict=True))
    return [
        ("last step", f"{step.step}" + (f": {step.label}" if step.label else "")),
        ("tip [mm]", f"({x}, {y}, {z}), bending angle {degrees(step.bending_angle):.3f} deg"),
        ("tension [N]", f"at the base: {_some(at_base)}; at the anchor: {_some(at_anchor)}"),
        ("pulled [mm]", _some(pulled)),
    ]


def _millimetres(metres: float) -> str:
    return f"{round(1e3 * float(metres), 3) + 0.0:.3f}"  # no negative zero


def _some(texts: Iterable[str]) -> str:
    every = list(texts)
    more = len(every) - SHOWN_TENDONS
    return (", ".join(every[:SHOWN_TENDONS]) + (f" and {more} more" if more > 0 else "")) or "no tendons"


def _warnings(warnings: tuple[str, ...]) -> str:
    if not warnings:
        return "none"
    return warnings[0] if len(warnings) == 1 else f"{len(warnings)}, the first: {warnings[0]}"


def _count(n: int, what: str) -> str:
    return f"{n} {what}{'' if n == 1 else 's'}"

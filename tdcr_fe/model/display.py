"""A result as ten lines of text, and as HTML for notebooks."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from html import escape
from math import degrees
from typing import TYPE_CHECKING

from tdcr_fe.model.messages import count

if TYPE_CHECKING:
    from tdcr_fe.model.results import SequenceResult, StepResult

#: Tendons, and load steps of the HTML table, that are shown before "and ... more".
MOST_TENDONS, MOST_STEPS = 6, 12


def summary_rows(result: SequenceResult) -> list[tuple[str, str]]:
    """Name and text of every line: robot, model, steps, status, last step, tip, angle, tendons, warnings."""
    robot, model, warnings = result.robot, result.model, result.warnings
    tendons, disks = count(len(robot.tendons), "tendon"), count(len(robot.disks.positions), "disk")
    path, friction = f"tendon path {model.tendon_path}", f"friction {model.friction}"
    failed = "" if result.failed_step is None else f", step {result.failed_step} not"
    iterations = sum(s.iterations for s in result.steps)
    status = result.message or ("all steps converged" if result.converged else "did not converge")
    first = f"{len(warnings)}, the first: {warnings[0]}" if len(warnings) > 1 else "".join(warnings)
    return [
        ("robot", f"{robot.name}: {tendons}, {disks}, length {1e3 * robot.backbone.length:g} mm"),
        ("model", f"{path}, {friction}, elements per bay {model.elements_per_bay}"),
        (
            "steps",
            f"{len(result.steps)} solved{failed}; {iterations} Newton iterations, {result.wall_time:.2f} s",
        ),
        ("status", status),
        *(_last_step(result.robot.tendon_names, result.steps[-1]) if result.steps else ()),
        ("warnings", first or "none"),
    ]


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
        index=False, max_rows=MOST_STEPS, float_format=lambda x: f"{x:.6g}", escape=True
    )
    return f"<table>{rows}</table>\n{table}"


def _last_step(names: Sequence[str], step: StepResult) -> list[tuple[str, str]]:
    def listed(values: Iterable[str]) -> str:
        every = [f"{name} {value}" for name, value in zip(names, values, strict=True)]
        more = len(every) - MOST_TENDONS
        return (", ".join(every[:MOST_TENDONS]) + (f" and {more} more" if more > 0 else "")) or "no tendons"

    base, anchor = (f"{t:.4g}" for t in step.base_tensions), (f"{t[-1]:.4g}" for t in step.tensions)
    tip = ", ".join(map(_millimetres, step.tip))
    return [
        ("last step", f"{step.step}" + (f": {step.label}" if step.label else "")),
        ("tip [mm]", f"({tip}), bending angle {degrees(step.bending_angle):.3f} deg"),
        ("tension [N]", f"at the base: {listed(base)}; at the anchor: {listed(anchor)}"),
        ("pulled [mm]", listed(map(_millimetres, step.displacements))),
    ]


def _millimetres(metres: float) -> str:
    return f"{round(1e3 * float(metres), 3) + 0.0:.3f}"  # no negative zero

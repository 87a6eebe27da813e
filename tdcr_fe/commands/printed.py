"""Tables of a result that ``tdcr-fe run`` prints, in mm and degrees."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from tdcr_fe.model.messages import count

if TYPE_CHECKING:
    from tdcr_fe.model.results import SequenceResult, StepResult

#: More tendons than this are printed in tables of their own.
MOST_IN_ROW = 3
#: Most tendons in one table.
MOST_IN_TABLE = 9


def print_result(result: SequenceResult, out: Path, written: Sequence[Path]) -> None:
    """Print the tables of a result and the names of the files."""
    if result.steps:
        print(
            "\n\n".join(
                filter(None, [step_tables(result), sensitivity_table(result), *response_tables(result)])
            )
        )
        print()
    print(f"{count(len(result.steps), 'step')} in {result.wall_time:.2f} s. Written to {out}:")
    print("    " + ", ".join(p.name for p in written))


def step_tables(result: SequenceResult) -> str:
    """The steps of a result; tensions and displacements of many tendons are tables of their own below."""
    names = result.robot.tendon_names
    if len(names) <= MOST_IN_ROW:
        head = [*(f"{n} [N]" for n in names), *(f"{n} [mm]" for n in names)]
        return _steps(result, head, lambda s: [*_tensions(s), *_displacements(s)])
    parts = [_steps(result, [], lambda s: [])]
    for title, values in (
        ("tension at the base [N]", _tensions),
        ("pulled in at the base [mm]", _displacements),
    ):
        for some in _groups(names):
            head = ["step", *names[some]]
            rows = [[str(s.step), *values(s)[some]] for s in result.steps]
            parts.append(f"{title}\n{_aligned(head, rows)}")
    return "\n\n".join(parts)


def _tensions(step: StepResult) -> list[str]:
    return [f"{t:.4g}" for t in step.base_tensions]


def _displacements(step: StepResult) -> list[str]:
    return [f"{1e3 * d + 0.0:.3f}" for d in step.displacements.round(9)]


def _steps(result: SequenceResult, head: list[str], tendons: Callable[[StepResult], list[str]]) -> str:
    """One row a step, with columns of the tendons."""
    rows = [
        [
            str(s.step),
            s.label if len(s.label) <= 24 else s.label[:21] + "...",
            *tendons(s),
            *(f"{1e3 * x + 0.0:.2f}" for x in s.tip.round(9)),
            f"{math.degrees(s.bending_angle):.3f}",
            str(s.substeps) if s.converged else f"{s.substeps} (failed)",
        ]
        for s in result.steps
    ]
    tip = ["tip x", "y", "z [mm]", "bending [deg]", "substeps"]
    return _aligned(["step", "label", *head, *tip], rows, left=1)


def sensitivity_table(result: SequenceResult) -> str:
    """Derivatives at the end of the last step; empty where there are none."""
    if not result.sensitivities:
        return ""
    head = ["last step, derivative by", "at", "tip x", "y", "z [m]", "rotation x", "y", "z [rad]"]
    rows = [
        [
            p.parameter,
            "" if math.isnan(p.value) else f"{p.value:.6g}",  # an input has a value of its own in every step
            *(f"{x:.4g}" for x in (*p.positions[-1, -1], *p.rotations[-1, -1])),
        ]
        for p in result.sensitivities.values()
    ]
    return _aligned(head, rows, left=0)


def response_tables(result: SequenceResult) -> Iterator[str]:
    """Compliance of the tip and stiffness of the motors after the last step, where they were computed."""
    names = result.robot.tendon_names
    for each in result.steps[-1].responses:
        holes = "all holes stick (reversal)" if each.reversal else "holes as they are"
        tip = f"tip after the last step, {holes}: displacement by"
        for title, rows, columns, values in (
            (f"{tip} force [mm/N]", "xyz", ("x", "y", "z"), 1e3 * each.compliance[:3, :3]),
            (f"{tip} tension [mm/N]", "xyz", names, 1e3 * each.by_tension[:3]),
            (f"tension by displacement, {holes} [N/mm]", names, names, 1e-3 * each.motor_stiffness),
        ):
            for some in _groups(columns):
                body = [[row, *(f"{x:.4g}" for x in v[some])] for row, v in zip(rows, values, strict=True)]
                yield f"{title}\n{_aligned(['', *columns[some]], body)}"


def _groups(names: Sequence[str]) -> Iterator[slice]:
    """Slices of the tendons that have one table each."""
    for start in range(0, len(names), MOST_IN_TABLE):
        yield slice(start, start + MOST_IN_TABLE)


def _aligned(head: list[str], rows: list[list[str]], left: int | None = None) -> str:
    """A table with all columns but one aligned to the right."""
    widths = [max(map(len, column)) for column in zip(head, *rows, strict=True)]
    return "\n".join(
        "  ".join(
            text.ljust(w) if i == left else text.rjust(w)
            for i, (text, w) in enumerate(zip(row, widths, strict=True))
        )
        for row in [head, ["-" * w for w in widths], *rows]
    )

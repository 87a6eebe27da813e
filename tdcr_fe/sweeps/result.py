"""Result of a sweep: the outcomes of its cases as they come, the table of cases, and what follows from it."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from tdcr_fe.sweeps.cases import ESTIMATES, STATUSES, Outcome, columns_of_steps
from tdcr_fe.sweeps.description import Sweep
from tdcr_fe.sweeps.sampling import Column, Design
from tdcr_fe.sweeps.statistics import SobolIndices, Summary, sobol_indices, summarise, varies

Array = NDArray[np.float64]
_NOT_RUN = STATUSES.index("not run")
_NUMBER = re.compile(r"(?<![A-Za-z_])-?\d+(\.\d+)?(e[+-]?\d+)?")
#: Results that are printed before "and ... more".
MOST_PRINTED = 8


@dataclass
class Message:
    """A reason or a warning that several cases have, up to the numbers in it.

    Attributes
    ----------
    example : str
        The text of the first case.
    case : int
        Number of that case.
    count : int
        Number of cases.
    """

    example: str
    case: int
    count: int = 1


class Collected:
    """Outcomes by case, in memory that hardly grows while cases are solved.

    Parameters
    ----------
    count
        Number of cases.
    """

    def __init__(self, count: int) -> None:
        self._codes = np.full(count, _NOT_RUN, dtype=np.int8)
        self._numbers: dict[str, Array] = {}  # by column, one per case
        self._seconds: Array = np.full(count, np.nan)
        self._reasons: dict[int, str] = {}  # by number of the case
        self._warnings = np.zeros(count, dtype=np.int16)  # their number
        self._messages: dict[tuple[str, str], Message] = {}

    def add(self, outcome: Outcome) -> None:
        """Take the outcome of a case; one that is there already is replaced."""
        k, count = outcome.case - 1, len(self._codes)
        self._codes[k] = STATUSES.index(outcome.status)
        self._seconds[k] = outcome.seconds
        self._warnings[k] = len(outcome.warnings)
        self._reasons.pop(outcome.case, None)
        for column in self._numbers.values():
            column[k] = np.nan
        for name, value in outcome.numbers.items():
            self._numbers.setdefault(name, np.full(count, np.nan))[k] = value
        if outcome.reason:
            self._reasons[outcome.case] = outcome.reason
            self._note(outcome.status, outcome.reason, outcome.case)
        for text in outcome.warnings:
            self._note("warning", text, outcome.case)

    def _note(self, kind: str, text: str, case: int) -> None:
        known = self._messages.setdefault((kind, _NUMBER.sub("#", text)), Message(text, case, 0))
        known.count += 1
        if case < known.case:  # the same text whatever the order of completion
            known.case, known.example = case, text

    @property
    def left(self) -> list[int]:
        """Cases that were not run, counted from 0."""
        return [int(k) for k in np.flatnonzero(self._codes == _NOT_RUN)]

    def result(self, sweep: Sweep, design: Design, wall_time: float, solved_now: int) -> SweepResult:
        """All that was collected, as the result of a sweep."""
        messages: dict[str, list[Message]] = {}
        for (kind, _), message in sorted(self._messages.items(), key=lambda x: (-x[1].count, x[1].case)):
            messages.setdefault(kind, []).append(message)
        seconds = float(np.nansum(self._seconds))
        return SweepResult(
            sweep,
            design,
            self._frame(sweep, design),
            {kind: tuple(found) for kind, found in messages.items()},
            wall_time,
            seconds,
            solved_now,
        )

    def _frame(self, sweep: Sweep, design: Design) -> pd.DataFrame:
        """One row per case, in the order of cases: number, status, reason, values, results."""
        robots = [sweep.tables.robot, *(tables.robot for _, tables in sweep.robots)]
        tendons = dict.fromkeys(str(t["name"]) for robot in robots if robot for t in robot.get("tendons", ()))
        suffixes = [f"_step{k}" for k in sweep.output.steps] or [""]
        order = [f"{name}{suffix}" for suffix in suffixes for name in columns_of_steps(tendons)]
        names = [c for c in order if c in self._numbers]
        names += sorted(set(self._numbers) - set(names))
        return pd.DataFrame(
            {
                "case": np.arange(1, design.count + 1),
                "status": np.array(STATUSES, dtype=object)[self._codes],
                "reason": [self._reasons.get(k, "") for k in range(1, design.count + 1)],
                "warnings": self._warnings,
                **{v.name: _values(c) for v, c in zip(sweep.variations, design.columns, strict=True)},
                **{name: self._numbers[name] for name in names},
            }
        )


def _values(column: Column) -> Any:
    """Values of a variation by case; lists and tables as text."""
    if not column.options:
        return column.numbers
    plain = [x if isinstance(x, int | float | str | bool) else repr(x) for x in column.options]
    return pd.Series(plain).take(column.numbers).to_numpy()


@dataclass(frozen=True)
class SweepResult:
    """All cases of a sweep; printed, it is a summary.

    Attributes
    ----------
    sweep : Sweep
    design : Design
    cases : pandas.DataFrame
        One row per case, in their order: ``case``, ``status``, ``reason``, ``warnings`` (their number), the values of
        the variations, the results.
    messages : mapping of str to tuple of Message
        Reasons of cases that did not converge, by status, and by ``"warning"`` all warnings; the most frequent first.
    wall_time : float
        Of this call [s].
    case_seconds : float
        Sum of the times of all cases [s].
    solved_now : int
        Cases that this call solved; the others were recalled.
    """

    sweep: Sweep
    design: Design
    cases: pd.DataFrame
    messages: Mapping[str, tuple[Message, ...]] = field(default_factory=dict)
    wall_time: float = 0.0
    case_seconds: float = 0.0
    solved_now: int = 0

    @property
    def inputs(self) -> tuple[str, ...]:
        """Columns of the variations."""
        return tuple(v.name for v in self.sweep.variations)

    @property
    def outputs(self) -> tuple[str, ...]:
        """Columns of the results."""
        return tuple(self.cases.columns[4 + len(self.inputs) :])

    @property
    def counts(self) -> dict[str, int]:
        """Number of cases by status; those that occur."""
        found = Counter(self.cases["status"])
        return {name: found[name] for name in STATUSES if found[name]}

    @property
    def failures(self) -> dict[str, tuple[Message, ...]]:
        """By status, the reasons of cases that did not converge."""
        return {s: self.messages[s] for s in STATUSES if s in self.messages}

    @property
    def warnings(self) -> tuple[Message, ...]:
        """Warnings of all cases."""
        return self.messages.get("warning", ())

    @property
    def interrupted(self) -> bool:
        """Whether cases are left that were not run."""
        return "not run" in self.counts

    @property
    def converged(self) -> bool:
        """Whether all cases converged."""
        return self.counts.get("converged", 0) == len(self.cases)

    @property
    def varying_outputs(self) -> tuple[str, ...]:
        """Results that differ between cases."""
        return tuple(name for name in self.outputs if varies(self.column(name)))

    def column(self, name: str) -> Array:
        """A column of numbers."""
        return self.cases[name].to_numpy(dtype=float)

    def statistics(self) -> dict[str, Summary]:
        """Moments and quantiles of every result that varies, over the cases that converged."""
        return {n: summarise(self.column(n)) for n in self.varying_outputs}

    def sobol_indices(self) -> dict[str, SobolIndices]:
        """Sobol indices of every result that varies; empty where the method is not "saltelli"."""
        if not self.design.base_samples:
            return {}
        count, seed = len(self.inputs), self.sweep.sampling.seed
        found = {n: sobol_indices(self.column(n), count, seed) for n in self.varying_outputs}
        return {n: x for n, x in found.items() if x is not None}

    def to_frame(self) -> pd.DataFrame:
        """The table of cases."""
        return self.cases

    def __repr__(self) -> str:
        """Cases by status, mean and range of the results that vary, the tip first, and the time."""
        states = ", ".join(f"{n} {status}" for status, n in self.counts.items())
        inputs = ", ".join(self.inputs)
        lines = [f'sweep of {len(self.cases)} cases by "{self.design.method}" over {inputs}: {states}']
        found, names = self.statistics(), shown_outputs(self)
        for name in names[:MOST_PRINTED]:
            s, how = found[name], shown(name)
            mean, std, least, most = (how.factor * x for x in (s.mean, s.std, s.smallest, s.largest))
            spread = f"standard deviation {std:.3g}, from {least:.6g} to {most:.6g}"
            lines.append(f"  {how.axis}: mean {mean:.6g}, {spread}")
        if len(names) > MOST_PRINTED:
            lines.append(f"  and {len(names) - MOST_PRINTED} more results")
        rate = self.solved_now / self.wall_time if self.wall_time > 0.0 else np.nan
        lines.append(f"  {self.solved_now} cases solved in {self.wall_time:.1f} s, {rate:.3g} per second")
        return "\n".join(lines)


_LENGTH = re.compile(r"(tip_[xyz]|tip_offset|displacement_.*|discretisation_error)(_step\d+)?")
_ANGLE = re.compile(r"(bending|chord)_angle_deg(_step\d+)?")
_BUILT_IN = re.compile(
    "tip_|tangent_|bending_angle|chord_angle|tension_|displacement_|" + "|".join(ESTIMATES)
)
#: Results that are shown first.
_FIRST = ("bending_angle_deg", "tip_x", "tip_y", "tip_z", "tip_offset")


class Shown(NamedTuple):
    """How a column is shown to people."""

    label: str
    unit: str  # empty where it is not known
    factor: float  # from the table to this unit

    @property
    def axis(self) -> str:
        """Label with the unit."""
        return f"{self.label} [{self.unit}]" if self.unit else self.label


def shown(column: str) -> Shown:
    """Label, unit and factor of a column."""
    text = re.sub(r"_step(\d+)$", r", step \1", column).replace("_", " ")
    if _LENGTH.fullmatch(column):
        return Shown(text, "mm", 1e3)
    if _ANGLE.fullmatch(column):
        return Shown(text.replace(" deg", ""), "deg", 1.0)
    return Shown(text, "N" if column.startswith("tension_") else "", 1.0)


def shown_outputs(result: SweepResult) -> list[str]:
    """Results that vary: first those of the user's own function, then angle and tip, then the others.

    Directions and estimates come last; a column that repeats an input, or the size of a result before it, is left out.
    """

    def rank(name: str) -> tuple[int, int]:
        stem = re.sub(r"_step\d+$", "", name)
        if not _BUILT_IN.match(name):
            return 0, 0
        if stem in _FIRST:
            return 1, _FIRST.index(stem)
        return (3 if stem in ESTIMATES or stem.startswith("tangent") else 2), 0

    kept: list[str] = []
    for name in sorted(result.varying_outputs, key=rank):
        if not _repeats(result, name, (*result.inputs, *kept)):
            kept.append(name)
    return kept


def _repeats(result: SweepResult, name: str, others: Sequence[str]) -> bool:
    values = result.column(name)
    sound = np.isfinite(values)
    sizes = (np.abs(result.column(n)[sound]) for n in others if result.cases[n].dtype.kind in "fi")
    return any(np.allclose(np.abs(values[sound]), size, rtol=1e-6, atol=0.0) for size in sizes)

"""Result of a sweep: the outcomes of its cases as they come, the table of cases, and what follows from it."""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from tdcr_fe.model.columns import AFTER_TENDONS, OF_TENDONS
from tdcr_fe.model.messages import count
from tdcr_fe.report.environment import MINUS, fixed
from tdcr_fe.sweeps.cases import ESTIMATES, STATUSES, Outcome, columns_of_steps
from tdcr_fe.sweeps.description import Column, Design, Sweep
from tdcr_fe.sweeps.statistics import SobolIndices, Summary, sobol_indices, summarise, varies

Array = NDArray[np.float64]
_NUMBER = re.compile(r"(?<![A-Za-z_])-?\d+(\.\d+)?(e[+-]?\d+)?")
#: Results that are printed before "and ... more".
MOST_PRINTED = 8
#: Results in pictures where the sweep names none.
MOST_DRAWN = 4


@dataclass(frozen=True)
class Message:
    """A reason or a warning that several cases have, up to the numbers in it."""

    example: str  # the text of the first case
    case: int  # number of that case
    count: int  # of cases


def _messages(texts: Iterable[tuple[int, str]]) -> tuple[Message, ...]:
    """Texts by case, in the order of cases, put together where they differ by numbers only; the most frequent first."""
    found: dict[str, Message] = {}
    for case, text in texts:
        before = found.get(kind := _NUMBER.sub("#", text), Message(text, case, 0))
        found[kind] = replace(before, count=before.count + 1)
    return tuple(sorted(found.values(), key=lambda m: (-m.count, m.case)))


class Collected:
    """Outcomes by case, in memory that hardly grows while cases are solved.

    Parameters
    ----------
    count
        Number of cases.
    """

    def __init__(self, count: int) -> None:
        self._count = count
        self._status = np.full(count, "not run", dtype=object)
        self._reasons = np.full(count, "", dtype=object)
        self._warnings: dict[int, tuple[str, ...]] = {}  # by case, counted from 0
        self._numbers: dict[str, Array] = {}  # by column, one per case
        self._seconds: Array = np.zeros(count)

    def add(self, outcome: Outcome) -> None:
        """Take the outcome of a case; one that is there already is replaced."""
        k = outcome.case - 1
        self._status[k], self._reasons[k] = outcome.status, outcome.reason
        self._seconds[k], self._warnings[k] = outcome.seconds, outcome.warnings
        for column in self._numbers.values():
            column[k] = np.nan
        for name, value in outcome.numbers.items():
            self._numbers.setdefault(name, np.full(self._count, np.nan))[k] = value

    @property
    def left(self) -> list[int]:
        """Cases that were not run, counted from 0."""
        return [int(k) for k in np.flatnonzero(self._status == "not run")]

    def result(self, sweep: Sweep, design: Design, wall_time: float, solved_now: int) -> SweepResult:
        """All that was collected, as the result of a sweep."""
        failed = [k for k in range(self._count) if self._reasons[k]]
        messages: dict[str, tuple[Message, ...]] = {
            status: _messages((k + 1, self._reasons[k]) for k in failed if self._status[k] == status)
            for status in STATUSES
        }
        warned = sorted(self._warnings.items())
        messages["warning"] = _messages((k + 1, text) for k, texts in warned for text in texts)
        seconds, cases = float(self._seconds.sum()), self._frame(sweep, design)
        return SweepResult(sweep, cases, messages, wall_time, seconds, solved_now)

    def _frame(self, sweep: Sweep, design: Design) -> pd.DataFrame:
        """One row per case, in the order of cases: number, status, reason, values, results."""
        robots = [sweep.tables.robot, *(tables.robot for _, tables in sweep.robots)]
        tendons = dict.fromkeys(str(t["name"]) for robot in robots if robot for t in robot.get("tendons", ()))
        suffixes = sweep.output.suffixes(len(sweep.tables.scenario["steps"]))
        order = [f"{name}{suffix}" for suffix in suffixes for name in columns_of_steps(tendons)]
        names = sorted(self._numbers, key=lambda n: (order.index(n) if n in order else len(order), n))
        warnings = [len(self._warnings.get(k, ())) for k in range(self._count)]
        return pd.DataFrame(
            {
                "case": np.arange(1, self._count + 1),
                "status": self._status,
                "reason": self._reasons,
                "warnings": np.array(warnings, dtype=np.int16),
                **{v.column: _values(c) for v, c in zip(sweep.variations, design.columns, strict=True)},
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
    cases: pd.DataFrame
    messages: Mapping[str, tuple[Message, ...]] = field(default_factory=dict)
    wall_time: float = 0.0
    case_seconds: float = 0.0
    solved_now: int = 0

    @cached_property
    def inputs(self) -> dict[str, str]:
        """Columns of the variations, and their labels with the unit."""
        return {v.column: v.label for v in self.sweep.variations}

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
        return {s: m for s, m in self.messages.items() if m and s in STATUSES}

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

    def column(self, name: str) -> Array:
        """A column of numbers."""
        return self.cases[name].to_numpy(dtype=float)

    def statistics(self) -> dict[str, Summary]:
        """Moments and quantiles of every result that varies, over the cases that converged."""
        return {n: summarise(self.column(n)) for n in self.outputs if varies(self.column(n))}

    def sobol_indices(self) -> dict[str, SobolIndices]:
        """Sobol indices of every result that varies; empty where the method is not "saltelli"."""
        if self.sweep.sampling.method != "saltelli":
            return {}
        count, seed = len(self.inputs), self.sweep.sampling.seed
        found = {n: sobol_indices(self.column(n), count, seed) for n in self.outputs}
        return {n: x for n, x in found.items() if x is not None}

    @cached_property
    def shown(self) -> list[str]:
        """Results that vary: first those of the user's own function, then angle and tip, then the others.

        Directions and estimates come last; a column that repeats an input, or the size of a result before it, is left
        out.
        """
        kept: list[str] = []
        for name in sorted(self.statistics(), key=_rank):
            if not self._repeats(name, (*self.inputs, *kept)):
                kept.append(name)
        return kept

    @property
    def drawn(self) -> list[str]:
        """Results in pictures: those that ``quantities`` of the sweep names, or the first few."""
        return self.shown if self.sweep.output.quantities else self.shown[:MOST_DRAWN]

    def _repeats(self, name: str, others: Sequence[str]) -> bool:
        values = self.column(name)
        sound = np.isfinite(values)
        sizes = (np.abs(self.column(n)[sound]) for n in others if self.cases[n].dtype.kind in "fi")
        return any(np.allclose(np.abs(values[sound]), size, rtol=1e-6, atol=0.0) for size in sizes)

    def __repr__(self) -> str:
        """Cases by status, mean and range of the results that vary, the tip first, and the time."""
        states = ", ".join(f"{n} {status}" for status, n in self.counts.items())
        inputs = ", ".join(self.inputs)
        lines = [
            f'sweep of {count(len(self.cases), "case")} by "{self.sweep.sampling.method}" over {inputs}: {states}'
        ]
        found = self.statistics()
        for name in self.shown[:MOST_PRINTED]:
            how, s = shown(name), shown(name).texts(found[name], "-")
            spread = f"standard deviation {s['std']}, from {s['min']} to {s['max']}"
            lines.append(f"  {how.axis}: mean {s['mean']}, {spread}")
        if len(self.shown) > MOST_PRINTED:
            lines.append(f"  and {len(self.shown) - MOST_PRINTED} more results")
        rate = self.solved_now / self.wall_time if self.wall_time > 0.0 else np.nan
        lines.append(
            f"  {count(self.solved_now, 'case')} solved in {self.wall_time:.1f} s, {rate:.3g} per second"
        )
        return "\n".join(lines)


_LENGTH = re.compile(r"(tip_[xyz]|tip_offset|displacement_.*|discretisation_error)(_step\d+)?")
_ANGLE = re.compile(r"(bending|chord)_angle_deg(_step\d+)?")
_BUILT_IN = re.compile("|".join([*(f"{n}_" for n in OF_TENDONS), *AFTER_TENDONS, *ESTIMATES]))
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

    def texts(self, s: Summary, minus: str = MINUS) -> dict[str, str]:
        """Statistics as text, all to the second digit of the standard error of the mean."""
        error = self.factor * s.std / math.sqrt(s.count)
        decimals = max(0, 1 - math.floor(math.log10(error)))
        found = {n: fixed(self.factor * x, decimals).replace(MINUS, minus) for n, x in s.numbers.items()}
        return {**found, "count": str(s.count)}


def shown(column: str) -> Shown:
    """Label, unit and factor of a column."""
    text = re.sub(r"_step(\d+)$", r", step \1", column).replace("_", " ")
    if _LENGTH.fullmatch(column):
        return Shown(text, "mm", 1e3)
    if _ANGLE.fullmatch(column):
        return Shown(text.replace(" deg", ""), "deg", 1.0)
    return Shown(text, "N" if column.startswith("tension_") else "", 1.0)


def _rank(name: str) -> tuple[int, int]:
    """Where a result stands among those that are shown."""
    stem = re.sub(r"_step\d+$", "", name)
    if not _BUILT_IN.match(name):
        return 0, 0
    if stem in _FIRST:
        return 1, _FIRST.index(stem)
    return (3 if stem in ESTIMATES or stem.startswith("tangent") else 2), 0

"""Result of a sweep: the outcomes of its cases as they come, the table of cases, its statistics and Sobol indices."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
import pandas as pd

from tdcr_fe.elements import Array
from tdcr_fe.model.columns import AFTER_TENDONS, OF_TENDONS
from tdcr_fe.model.messages import count
from tdcr_fe.report.environment import fixed
from tdcr_fe.sweeps.cases import ABOUT_CASE, ESTIMATES, STATUSES, Outcome, columns_of_steps
from tdcr_fe.sweeps.description import Design, Sweep

#: Resamples of a bootstrap interval, and its level.
RESAMPLES, LEVEL = 500, 0.95
_QUANTILES = {"2.5%": "quantile_2.5", "50%": "median", "97.5%": "quantile_97.5"}


def summarise(table: pd.DataFrame) -> pd.DataFrame:
    """Statistics of every column over the rows that have a number; the standard deviation is with ``count - 1``."""
    percentiles = [float(name.rstrip("%")) / 100.0 for name in _QUANTILES]
    return table.describe(percentiles=percentiles).rename(_QUANTILES) if len(table.columns) else table


def varies(values: Array, least: float = 1e-12) -> bool:
    """Whether a column has at least two different finite numbers, beyond rounding (a part in 10^9, or ``least``)."""
    values = values[np.isfinite(values)]
    if len(values) < 2:
        return False
    return bool(np.ptp(values) > max(1e-9 * float(np.abs(values).max()), least))


@dataclass(frozen=True)
class SobolIndices:
    """Shares of the variance of a result.

    Attributes
    ----------
    first : ndarray, shape (d,)
        What a variation explains by itself: ``V(E(y | x_i)) / V(y)``.
    total : ndarray, shape (d,)
        What it explains with all its interactions: ``E(V(y | x_others)) / V(y)``.
    first_interval, total_interval : ndarray, shape (d, 2)
        95 % intervals of a bootstrap over the base samples.
    samples : int
        Base samples with all their cases converged.
    """

    first: Array
    total: Array
    first_interval: Array
    total_interval: Array
    samples: int


def sobol_indices(values: Array, dimensions: int, seed: int = 0) -> SobolIndices | None:
    """Sobol indices of the first and the total order, with percentiles of a bootstrap.

    `scipy.stats.sobol_indices` has the same formulas, but takes no sample from which cases that did not converge are
    left out (their number must be a power of two), and its intervals cannot be repeated.

    Parameters
    ----------
    values
        A result, by case of a design of the method "saltelli", shape (n (d + 2),).
    dimensions
        Number d of variations.
    seed
        Seed of the bootstrap.

    Returns
    -------
    SobolIndices or None
        None where the result does not vary, or fewer than two base samples have all cases converged.
    """
    rows = values.reshape(-1, dimensions + 2)
    rows = rows[np.isfinite(rows).all(axis=1)]
    if len(rows) < 2 or not varies(rows[:, :2].ravel()):
        return None
    random = np.random.default_rng(seed)
    resampled = [_indices(rows[random.integers(0, len(rows), len(rows))]) for _ in range(RESAMPLES)]
    tail = 0.5 * (1.0 - LEVEL)
    first, total = np.nanquantile(np.array(resampled), [tail, 1.0 - tail], axis=0).transpose(1, 2, 0)
    return SobolIndices(*_indices(rows), first, total, len(rows))


def _indices(rows: Array) -> tuple[Array, Array]:
    """First and total indices of results A, B, AB_1 ... AB_d, shape (n, d + 2).

    First order by Saltelli et al. (2010, Computer Physics Communications 181, Table 2 b), total order by Jansen (1999;
    ibid. Table 2 f).
    """
    a, b = rows[:, :1], rows[:, 1:2]
    both = np.concatenate((a, b))
    variance = both.var() or np.nan
    change = rows[:, 2:] - a
    return ((b - both.mean()) * change).mean(axis=0) / variance, 0.5 * (change**2).mean(axis=0) / variance


# -------------------------------------------------------------------------------------------------------- statistics

_NUMBER = re.compile(r"(?<![A-Za-z_])-?\d+(\.\d+)?(e[+-]?\d+)?")
#: Results that are printed before "and ... more", and results in pictures where the sweep names none.
MOST_PRINTED, MOST_DRAWN = 8, 4


@dataclass(frozen=True)
class Message:
    """A reason or a warning that several cases have, up to the numbers in it."""

    example: str  # the text of the first case
    case: int  # number of that case
    count: int  # of cases


def _messages(texts: Iterable[tuple[int, str]]) -> tuple[Message, ...]:
    """Texts by case, in the order of cases, put together where they differ by numbers only; the most frequent first."""
    messages: dict[str, Message] = {}
    for case, text in texts:
        before = messages.get(kind := _NUMBER.sub("#", text), Message(text, case, 0))
        messages[kind] = replace(before, count=before.count + 1)
    return tuple(sorted(messages.values(), key=lambda m: (-m.count, m.case)))


class Collected:
    """Outcomes by case, with their numbers as arrays: these take little memory.

    Parameters
    ----------
    number
        Number of cases.
    """

    def __init__(self, number: int) -> None:
        self._outcomes = {case: Outcome(case, "not run") for case in range(1, number + 1)}
        self._numbers: dict[str, Array] = {}  # by column, one per case

    def add(self, outcome: Outcome) -> None:
        """Take the outcome of a case; one that is there already is replaced."""
        self._outcomes[outcome.case] = replace(outcome, numbers={})
        for name in {*self._numbers, *outcome.numbers}:
            column = self._numbers.setdefault(name, np.full(len(self._outcomes), np.nan))
            column[outcome.case - 1] = outcome.numbers.get(name, np.nan)

    @property
    def left(self) -> list[int]:
        """Numbers of the cases that were not run, from 1."""
        return [x.case for x in self._outcomes.values() if x.status == "not run"]

    def result(self, sweep: Sweep, design: Design, wall_time: float, solved_now: int) -> SweepResult:
        """All that was collected, as the result of a sweep: cases in their order."""
        every = self._outcomes.values()
        failures: dict[str, tuple[Message, ...]] = {
            status: found
            for status in STATUSES
            if (found := _messages((x.case, x.reason) for x in every if x.status == status and x.reason))
        }
        warnings = _messages((x.case, text) for x in every for text in x.warnings)
        table = {
            **{name: [getattr(x, name) for x in every] for name in ABOUT_CASE},
            "warnings": [len(x.warnings) for x in every],
            **{name: pd.Series(map(_plain, values)) for name, values in design.items()},
            **{name: self._numbers[name] for name in self._columns(sweep)},
        }
        return SweepResult(sweep, pd.DataFrame(table), failures, warnings, wall_time, solved_now)

    def _columns(self, sweep: Sweep) -> list[str]:
        """Columns of the results: those of the load steps, step by step, then others by name."""
        tendons = [str(t["name"]) for t in (sweep.tables.robot or {}).get("tendons", ())]
        suffixes = sweep.output.suffixes(len(sweep.tables.scenario["steps"]))
        known = [f"{name}{suffix}" for suffix in suffixes for name in columns_of_steps(tendons)]
        return [*(n for n in known if n in self._numbers), *sorted(self._numbers.keys() - set(known))]


def _plain(value: object) -> object:
    """A value of a table; lists and tables as text."""
    return value if isinstance(value, int | float | str | bool) else repr(value)


@dataclass(frozen=True)
class SweepResult:
    """All cases of a sweep; printed, it is a summary.

    Attributes
    ----------
    sweep : Sweep
    cases : pandas.DataFrame
        One row per case, in their order: ``case``, ``status``, ``reason``, ``warnings`` (their number), the values of
        the variations, the results.
    failures : mapping of str to tuple of Message
        By status, the reasons of cases that did not converge; the most frequent first.
    warnings : tuple of Message
        Warnings of all cases; the most frequent first.
    wall_time : float
        Wall time of this call [s].
    solved_now : int
        Cases that this call solved; the others were recalled.
    """

    sweep: Sweep
    cases: pd.DataFrame
    failures: Mapping[str, tuple[Message, ...]] = field(default_factory=dict)
    warnings: tuple[Message, ...] = ()
    wall_time: float = 0.0
    solved_now: int = 0

    @cached_property
    def inputs(self) -> dict[str, str]:
        """Columns of the variations, and their labels with the unit."""
        return {v.column: v.label for v in self.sweep.variations}

    @property
    def outputs(self) -> tuple[str, ...]:
        """Columns of the results."""
        return tuple(self.cases.columns[len(ABOUT_CASE) + len(self.inputs) :])

    @property
    def counts(self) -> dict[str, int]:
        """Number of cases by status; those that occur."""
        numbers = self.cases["status"].value_counts()
        return {name: int(numbers[name]) for name in STATUSES if name in numbers}

    @property
    def interrupted(self) -> bool:
        """Whether cases are left that were not run."""
        return "not run" in self.counts

    @property
    def converged(self) -> bool:
        """Whether all cases converged."""
        return bool((self.cases["status"] == "converged").all())

    def column(self, name: str) -> Array:
        """A column of numbers."""
        return self.cases[name].to_numpy(dtype=float)

    def varies(self, name: str) -> bool:
        """Whether a result varies, by more than the solver resolves: 1e-6 degrees, 1e-9 of the others."""
        resolved = 1e-6 if _ANGLE.fullmatch(name) else 1e-9
        return varies(self.column(name), resolved if _BUILT_IN.match(name) else 1e-12)

    def statistics(self) -> pd.DataFrame:
        """Moments and quantiles over the cases that converged: a column for every result that varies."""
        return summarise(self.cases[[n for n in self.outputs if self.varies(n)]])

    def sobol_indices(self) -> dict[str, SobolIndices]:
        """Sobol indices of every result that varies; empty where the method is not "saltelli"."""
        return dict(self._sobol_indices)

    @cached_property
    def _sobol_indices(self) -> dict[str, SobolIndices]:  # a second of bootstrap for ten results
        if self.sweep.sampling.method != "saltelli":
            return {}
        inputs, seed = len(self.inputs), self.sweep.sampling.seed
        indices = {n: sobol_indices(self.column(n), inputs, seed) for n in self.outputs if self.varies(n)}
        return {n: x for n, x in indices.items() if x is not None}

    @cached_property
    def listed(self) -> list[str]:
        """Results that vary: first those of the user's own function, then angle and tip, then the others.

        Directions and estimates come last; a column that repeats an input, or the size of a result before it, is left
        out.
        """
        kept: list[str] = []
        for name in sorted(map(str, self.statistics()), key=_rank):
            sound = self.cases[name].notna()
            sizes = self.cases[sound][[*self.inputs, *kept]].select_dtypes("number").abs()
            size = self.cases[sound][name].abs().to_numpy()
            if not np.isclose(size[:, None], sizes, rtol=1e-6, atol=0.0).all(axis=0).any():
                kept.append(name)
        return kept

    @property
    def drawn(self) -> list[str]:
        """Results in pictures: those that ``quantities`` of the sweep names, or the first few."""
        return self.listed if self.sweep.output.quantities else self.listed[:MOST_DRAWN]

    def __repr__(self) -> str:
        """Cases by status, mean and range of the results that vary, the tip first, and the time."""
        states = ", ".join(f"{n} {status}" for status, n in self.counts.items())
        cases, method = count(len(self.cases), "case"), self.sweep.sampling.method
        lines = [f'sweep of {cases} by "{method}" over {", ".join(self.inputs)}: {states}']
        table = self.statistics()
        for name in self.listed[:MOST_PRINTED]:
            how, s = display(name), display(name).texts(table[name])
            spread = f"standard deviation {s['std']}, from {s['min']} to {s['max']}"
            lines.append(f"  {how.axis}: mean {s['mean']}, {spread}")
        if len(self.listed) > MOST_PRINTED:
            lines.append(f"  and {len(self.listed) - MOST_PRINTED} more results")
        rate = self.solved_now / self.wall_time if self.wall_time > 0.0 else np.nan
        solved = f"{count(self.solved_now, 'case')} solved in {self.wall_time:.1f} s, {rate:.3g} per second"
        return "\n".join([*lines, f"  {solved}"])


_LENGTH = re.compile(r"(tip_[xyz]|tip_offset|displacement_.*|discretisation_error)(_step\d+)?")
_ANGLE = re.compile(r"(bending|chord)_angle_deg(_step\d+)?")
_BUILT_IN = re.compile("|".join([*(f"{n}_" for n in OF_TENDONS), *AFTER_TENDONS, *ESTIMATES]))
#: Results that are shown first.
_FIRST = ("bending_angle_deg", "tip_x", "tip_y", "tip_z", "tip_offset")


class Display(NamedTuple):
    """How a column is shown to people."""

    label: str
    unit: str  # empty where it is not known
    factor: float  # from the table to this unit

    @property
    def axis(self) -> str:
        """Label with the unit."""
        return f"{self.label} [{self.unit}]" if self.unit else self.label

    def texts(self, statistics: pd.Series) -> dict[str, str]:
        """Statistics as text, all to the second digit of the standard error of the mean."""
        error = self.factor * statistics["std"] / math.sqrt(statistics["count"])
        decimals = max(0, 1 - math.floor(math.log10(error)))
        texts = {str(n): fixed(self.factor * x, decimals) for n, x in statistics.items()}
        return {**texts, "count": f"{statistics['count']:.0f}"}


def display(column: str) -> Display:
    """Label, unit and factor of a column."""
    text = re.sub(r"_step(\d+)$", r", step \1", column).replace("_", " ")
    if _LENGTH.fullmatch(column):
        return Display(text, "mm", 1e3)
    if _ANGLE.fullmatch(column):
        return Display(text.replace(" deg", ""), "deg", 1.0)
    return Display(text, "N" if column.startswith("tension_") else "", 1.0)


def _rank(name: str) -> tuple[int, int]:
    """Where a result stands among those that are shown."""
    stem = re.sub(r"_step\d+$", "", name)
    if not _BUILT_IN.match(name):
        return 0, 0
    if stem in _FIRST:
        return 1, _FIRST.index(stem)
    return (3 if stem in ESTIMATES or stem.startswith("tangent") else 2), 0

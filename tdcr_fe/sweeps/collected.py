"""Outcomes of a sweep by case, in memory that does not grow while cases are solved."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from tdcr_fe.sweeps.cases import STATUSES, Outcome
from tdcr_fe.sweeps.description import Sweep
from tdcr_fe.sweeps.sampling import Design

Array = NDArray[np.float64]
_NOT_RUN = STATUSES.index("not run")
_NUMBER = re.compile(r"(?<![A-Za-z_])-?\d+(\.\d+)?(e[+-]?\d+)?")


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
    """Outcomes by case.

    Parameters
    ----------
    count
        Number of cases.

    Attributes
    ----------
    numbers : dict of str to ndarray
        By column, one number a case; NaN where there is none.
    seconds : ndarray, shape (count,)
        Time of each case; NaN where it was not solved.
    reasons : dict of int to str
        By number of the case, why it did not converge.
    warnings : ndarray of int, shape (count,)
        Number of warnings.
    """

    def __init__(self, count: int) -> None:
        self._codes = np.full(count, _NOT_RUN, dtype=np.int8)
        self.numbers: dict[str, Array] = {}
        self.seconds: Array = np.full(count, np.nan)
        self.reasons: dict[int, str] = {}
        self.warnings = np.zeros(count, dtype=np.int16)
        self._messages: dict[tuple[str, str], Message] = {}

    def add(self, outcome: Outcome) -> None:
        """Take the outcome of a case; one that is there already is replaced."""
        k, count = outcome.case - 1, len(self._codes)
        self._codes[k] = STATUSES.index(outcome.status)
        self.seconds[k] = outcome.seconds
        self.warnings[k] = len(outcome.warnings)
        self.reasons.pop(outcome.case, None)
        for column in self.numbers.values():
            column[k] = np.nan
        for name, value in outcome.numbers.items():
            if name not in self.numbers:
                self.numbers[name] = np.full(count, np.nan)
            self.numbers[name][k] = value
        if outcome.reason:
            self.reasons[outcome.case] = outcome.reason
            self._note(outcome.status, outcome.reason, outcome.case)
        for text in outcome.warnings:
            self._note("warning", text, outcome.case)

    def _note(self, kind: str, text: str, case: int) -> None:
        key = kind, _NUMBER.sub("#", text)
        if key in self._messages:
            known = self._messages[key]
            known.count += 1
            if case < known.case:  # the same text whatever the order of completion
                known.case, known.example = case, text
        else:
            self._messages[key] = Message(text, case)

    def messages(self, kind: str) -> list[Message]:
        """Reasons of a status, or ``"warning"``; the most frequent first."""
        found = [m for (k, _), m in self._messages.items() if k == kind]
        return sorted(found, key=lambda m: (-m.count, m.case))

    @property
    def done(self) -> NDArray[np.bool_]:
        """Whether each case was solved or failed, shape (count,)."""
        return self._codes != _NOT_RUN

    @property
    def converged(self) -> NDArray[np.bool_]:
        """Whether each case converged, shape (count,)."""
        return self._codes == STATUSES.index("converged")

    def counts(self) -> dict[str, int]:
        """Number of cases by status; those that occur."""
        found = Counter(self._codes.tolist())
        return {name: found[i] for i, name in enumerate(STATUSES) if found[i]}

    def frame(self, sweep: Sweep, design: Design, columns: Sequence[str]) -> pd.DataFrame:
        """One row a case, in the order of cases: number, status, reason, values, results.

        Parameters
        ----------
        sweep, design
            Whose cases these are.
        columns
            Results in order; others follow by name.
        """
        names = [c for c in columns if c in self.numbers]
        names += sorted(set(self.numbers) - set(names))
        table: dict[str, Any] = {
            "case": np.arange(1, design.count + 1),
            "status": np.array(STATUSES, dtype=object)[self._codes],
            "reason": [self.reasons.get(k, "") for k in range(1, design.count + 1)],
            "warnings": self.warnings,
        }
        for variation, column in zip(sweep.variations, design.columns, strict=True):
            table[variation.name] = values_of(column.options, column.numbers)
        return pd.DataFrame({**table, **{name: self.numbers[name] for name in names}})


def values_of(options: Sequence[Any], numbers: NDArray[Any]) -> Any:
    """Values of a variation by case; lists and tables as text."""
    if not options:
        return numbers
    plain = [x if isinstance(x, int | float | str | bool) else repr(x) for x in options]
    return pd.Series(plain).take(numbers).to_numpy()

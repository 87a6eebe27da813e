"""The safety net: what the program computes against what is stored, number by number.

Random robots, validation cases, scenes, derivatives by the parameters of all effects, inverse statics, the reference,
and broken files. The report says what moved, by how much, and where; "identical" is bit for bit.
"""

from __future__ import annotations

import argparse
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from tdcr_fe.validation.net.comparison import Difference, differences, report
from tdcr_fe.validation.net.parts import PARTS, Record, solve
from tdcr_fe.validation.net.storage import note, read_part, write_part
from tdcr_fe.validation.runner import Campaign


class Case(NamedTuple):
    """One case of a part, and where it is stored."""

    part: str
    key: str
    stored: Path | None  # None stores it anew


@dataclass(frozen=True)
class Outcome:
    """What is not the stored result of one case, or the result itself where it is to be stored."""

    part: str
    case: str
    moved: list[list[Any]]  # fields of `Difference`
    record: dict[str, Any] | None = None

    @property
    def differences(self) -> list[Difference]:
        """What moved; sizes that are not finite come back from JSON as None."""
        return [Difference(*row)._replace(size=np.inf if row[5] is None else row[5]) for row in self.moved]

    @property
    def passed(self) -> bool:
        """Whether nothing moved beyond its tolerance."""
        return not any(d.beyond for d in self.differences)


@cache
def _stored(part: str, folder: Path) -> dict[str, Record]:
    try:
        return read_part(part, folder)
    except FileNotFoundError as error:
        raise ValueError(
            f"--stored {folder}: the net is not there; run in a checkout of the project"
        ) from error


class Net(Campaign):
    """See the text of this module."""

    unit = "case"
    outcome = Outcome

    def add_options(self, parser: argparse.ArgumentParser) -> None:
        """Which parts and cases, and the folders."""
        every, net = list(PARTS), Path("tests/net")
        parser.add_argument("--parts", nargs="+", choices=every, default=every, help="of it (all)")
        parser.add_argument("--every", type=int, default=1, metavar="N", help="only every N-th case (1)")
        parser.add_argument("--quick", action="store_true", help="a share of every part, within 90 s")
        parser.add_argument("--stored", type=Path, default=net, metavar="FOLDER", help=f"the net ({net})")
        store = "store the parts in OUT instead of comparing them"
        parser.add_argument("--store", action="store_true", help=store)

    def cases(self, options: argparse.Namespace) -> Mapping[str, Any]:
        """Cases of the parts by "part/key"; those of the net, or all where they are to be stored."""
        stored = None if options.store else options.stored
        found: dict[str, Case] = {}
        for part in options.parts:
            keys = list(PARTS[part].keys() if options.store else _stored(part, stored))
            every = PARTS[part].quick if options.quick else options.every
            found |= {f"{part}/{key}": Case(part, key, stored) for key in keys[::every]}
        return found

    def run(self, case: Case, out: Path) -> Outcome:
        """Compute a case and compare it."""
        part, key, folder = case
        record = solve(part, key)
        if folder is None:
            plain = {k: v if isinstance(v, str) else v.tolist() for k, v in record.items()}
            return Outcome(part, key, [], plain)
        moved = differences(part, key, _stored(part, folder)[key], record, PARTS[part].tolerance)
        return Outcome(part, key, [list(d) for d in moved])

    def table(self, outcomes: Sequence[Outcome]) -> pd.DataFrame:
        """One row a quantity that moved."""
        return pd.DataFrame([d for o in outcomes for d in o.differences], columns=Difference._fields)

    def report(self, outcomes: Sequence[Outcome]) -> list[str | pd.DataFrame]:
        """Counts by part, and the largest movements."""
        moved = [d for o in outcomes for d in o.differences]
        return ["\n".join(report(Counter(o.part for o in outcomes), moved))]

    def write(self, outcomes: Sequence[Outcome], out: Path) -> None:
        """The files of the parts that are to be stored."""
        records: dict[str, dict[str, Record]] = {}
        for o in outcomes:
            if o.record is not None:
                own = records.setdefault(o.part, {})[o.case] = {}
                for k, v in o.record.items():
                    own[k] = v if isinstance(v, str) else np.array(v, dtype=float)
        for part, found in records.items():
            write_part(part, found, out)
            note(part, out)


CAMPAIGN = Net()

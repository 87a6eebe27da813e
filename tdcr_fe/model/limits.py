"""The table of physical limits, values beyond them, and the sentences that name them.

Every limit is a row of ``data/limits.toml``, with its source. A sentence names the key as in the files, the value and,
where a factor of a usual unit explains it, the unit that was probably meant.
"""

from __future__ import annotations

import math
import tomllib
from collections.abc import Iterable
from dataclasses import dataclass
from functools import lru_cache
from importlib.resources import files
from typing import NamedTuple

from tdcr_fe.model.checks import Contradiction
from tdcr_fe.model.units import mistaken

REMARK = ".remark"


@dataclass(frozen=True)
class Limit:
    """A row of ``data/limits.toml``."""

    quantity: str
    says: str
    source: str
    low: float = -math.inf
    high: float = math.inf
    remark: bool = False
    by_stiffness: bool = False
    refused_from: float = math.inf
    usual: float = 0.0

    def is_usual(self, ratio: float) -> bool:
        """Whether a value of the quantity is within the limit, and not so small that it has no effect."""
        least = self.low if self.high == math.inf else self.usual or 1e-4 * self.high
        return max(least, self.low) <= ratio <= self.high


@lru_cache(maxsize=1)
def limits() -> dict[str, Limit]:
    """The table of physical limits, by name; the bounds of remarks have the name with ``REMARK`` behind it."""
    text = (files("tdcr_fe") / "data" / "limits.toml").read_text(encoding="utf-8")
    return {name: Limit(**row, remark=name.endswith(REMARK)) for name, row in tomllib.loads(text).items()}


class Value(NamedTuple):
    """A value of a description, and the quantity that a limit bounds; they are in proportion."""

    limit: str
    key: str
    value: float
    unit: str
    ratio: float
    detail: str = ""

    @property
    def row(self) -> Limit:
        """Its limit."""
        return limits()[self.limit]

    @property
    def is_beyond(self) -> bool:
        """Whether it is beyond its limit."""
        return not self.row.low <= self.ratio <= self.row.high

    @property
    def beyond(self) -> Value | None:
        """The value with the limit that it is beyond, that of warnings first; None where there is none."""
        levels = (self._replace(limit=n) for n in (self.limit, self.limit + REMARK) if n in limits())
        return next((v for v in levels if v.is_beyond), None)

    @property
    def given(self) -> str:
        """The value with its unit; empty where there is none."""
        unit = self.unit if self.unit != "turns" else ""
        return "" if math.isnan(self.value) else f"{self.value:g} {unit}".rstrip()

    @property
    def says(self) -> str:
        """What is wrong with it."""
        row = self.row
        numbers = {"ratio": self.ratio, "percent": 100.0 * self.ratio, "low": row.low, "high": row.high}
        return row.says.format(**numbers, detail=self.detail)

    @property
    def hint(self) -> str:
        """The units in which it would be usual, as a question."""
        row = self.row
        units = mistaken(self.unit) if self.given and (row.usual or not row.remark) else {}
        fitting = [u for u, size in units.items() if row.is_usual(self.ratio * size)]
        return f"; was it meant in {' or '.join(fitting)}?" if fitting else ""

    @property
    def sentence(self) -> str:
        """Key, value, what is wrong with it, and the units that may be meant."""
        return f"{self.key}{' = ' * bool(self.given)}{self.given}: {self.says}{self.hint}"

    @property
    def refusal(self) -> Contradiction:
        """The same, with the value up to which there is a solution."""
        most = self.value * self.row.refused_from * self.row.high / self.ratio
        text = f"{self.says}; must be at most {most:.3g} {self.unit}, beyond which a solution means nothing"
        return Contradiction(self.key, self.given, text + self.hint)


def sentences(found: Iterable[Value]) -> list[str]:
    """One sentence for each limit, about the value that is farthest beyond it; a key is named once."""
    by_limit: dict[str, list[Value]] = {}
    named: set[str] = set()
    for value in sorted(found, key=lambda v: v.ratio / (v.row.high or 1.0), reverse=True):
        if value.key not in named:
            by_limit.setdefault(value.limit, []).append(value)
        named.add(value.key)
    return [
        farthest.sentence + (f" (also {', '.join(v.key for v in others[:3])})" if others else "")
        for farthest, *others in by_limit.values()
    ]


# ------------------------------------------------------------------------------------------------- materials

#: Kinds of material by Young's modulus, and where they begin [Pa].
KINDS = {"steel": 1.5e11, "metal": 2e10, "plastic": 1e8, "rubber": 0.0}


@lru_cache(maxsize=1)
def materials() -> dict[str, list[float]]:
    """Materials of backbones, by Young's modulus [GPa] and density [kg/m^3], from and to: ``data/materials.toml``."""
    return tomllib.loads((files("tdcr_fe") / "data" / "materials.toml").read_text(encoding="utf-8"))


def kind_of_material(modulus: float) -> str:
    """Kind in `KINDS` of what a backbone with this modulus is made of [Pa]."""
    return next(name for name, least in KINDS.items() if modulus >= least)


def nearest_material(modulus: float, density: float) -> tuple[str, float]:
    """The material in `materials` that is nearest, and by which factor modulus [Pa] and density [kg/m^3] are off.

    Where none has this modulus and density, the name is that of one with the density, with its moduli.
    """

    def off(value: float, low: float, high: float) -> float:
        return max(low / max(value, 1e-30), value / high, 1.0)

    factors = {n: max(off(modulus / 1e9, *row[:2]), off(density, *row[2:])) for n, row in materials().items()}
    name = min(factors, key=lambda n: factors[n])
    if factors[name] > limits()["material" + REMARK].high:
        dense, row = min(materials().items(), key=lambda x: off(density, *x[1][2:]))
        return f"{dense} has {row[0]:g} to {row[1]:g} GPa", factors[name]
    return name, factors[name]

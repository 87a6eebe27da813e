"""Ranges in which numbers are drawn: `ranges.toml`, and what is drawn of an entry."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from importlib.resources import files
from typing import Literal, NamedTuple

import numpy as np


class Range(NamedTuple):
    """A number between two bounds, times a size of the robot; or its exponential, or its inverse times the size."""

    low: float
    high: float
    size: str = ""  # name of the size; empty for 1
    kind: Literal["plain", "signed", "exponent", "inverse"] = "plain"  # those of exponents have a sign, too

    def draw(self, rng: np.random.Generator, sizes: Mapping[str, float] | None = None) -> float:
        """A value; the sign is drawn first."""
        sign = float(rng.choice([-1.0, 1.0])) if self.kind in ("signed", "exponent") else 1.0
        x = sign * float(rng.uniform(self.low, self.high))
        x = float(np.exp(x)) if self.kind == "exponent" else 1.0 / x if self.kind == "inverse" else x
        return x * sizes[self.size] if sizes and self.size else x


def ranges(table: str) -> dict[str, dict[str, Range]]:
    """By effect and parameter, the ranges in a table of `ranges.toml`."""
    text = files("tdcr_fe.validation").joinpath("ranges.toml").read_text(encoding="utf-8")
    found = tomllib.loads(text)[table]
    return {name: {p: Range(**entry) for p, entry in own.items()} for name, own in found.items()}

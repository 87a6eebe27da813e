"""What random robots, histories and effects are drawn with: numbers in ranges, choices, and the table `ranges.toml`."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from importlib.resources import files
from typing import Any, Literal, NamedTuple

import numpy as np

from tdcr_fe.elements import Array
from tdcr_fe.model.loading import LoadStep, Model
from tdcr_fe.model.robot import Robot


@dataclass(frozen=True)
class RandomCase:
    """One robot and its history, with the effects in all three."""

    number: int  # seed
    robot: Robot
    model: Model
    steps: tuple[LoadStep, ...]
    effects: Mapping[str, Mapping[str, float]] = field(default_factory=dict)  # that were drawn, by name


@dataclass(frozen=True)
class Draw:
    """Random numbers as plain floats."""

    rng: np.random.Generator

    def number(self, low: float, high: float) -> float:
        """A number between two bounds."""
        return float(self.rng.uniform(low, high))

    def numbers(self, low: float, high: float, count: int) -> list[float]:
        """Numbers between two bounds."""
        return [float(x) for x in self.rng.uniform(low, high, count)]

    def magnitude(self, low: float, high: float) -> float:
        """A number whose decimal logarithm is between two bounds."""
        return float(10.0 ** self.rng.uniform(low, high))

    def chance(self, share: float) -> bool:
        """True in so large a share of the cases."""
        return bool(self.rng.random() < share)

    def maybe(self, share: float, low: float, high: float, otherwise: float = 0.0) -> float:
        """A number between two bounds in a share of the cases, else another one."""
        return self.number(low, high) if self.chance(share) else otherwise

    def one(self, options: Sequence[Any], shares: Sequence[float] | None = None) -> Any:
        """One of several, which have these shares."""
        return options[int(self.rng.choice(len(options), p=shares))]

    def shares(self, count: int) -> Array:
        """Numbers that add up to one at most; all are below one."""
        share = self.rng.uniform(0.0, 1.0, count)
        return np.asarray(share / max(1.0, float(share.sum())))


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

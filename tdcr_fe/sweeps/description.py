"""A sweep as data: what is varied, how cases are chosen, and what is kept of each; the tables of `sweep.toml`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any, Literal

import numpy as np

from tdcr_fe.io.toml import ScenarioTables
from tdcr_fe.model.schema import Checked, Quantity
from tdcr_fe.sweeps.keys import Key
from tdcr_fe.sweeps.sampling import (
    SAMPLED,
    Column,
    Design,
    Distribution,
    grid,
    numbers_of,
    together,
    unit_points,
)

#: Most cases of a sweep.
MOST_CASES = 1_000_000

Method = Literal["grid", "list", "latin-hypercube", "sobol", "saltelli"]
#: How a value acts on the one that the files declare.
Mode = Literal["value", "factor", "offset"]
Spacing = Literal["linear", "logarithmic"]


@dataclass(frozen=True)
class Range(Checked):
    """Values at equal distances.

    Attributes
    ----------
    start, stop : float
        First and last value.
    count : int
    spacing : "linear" or "logarithmic"
        Equal distances, or equal ratios.
    """

    start: Annotated[float, Quantity("first value")]
    stop: Annotated[float, Quantity("last value")]
    count: Annotated[int, Quantity("number of values", ge=1, le=MOST_CASES)]
    spacing: Annotated[Spacing, Quantity("equal distances or equal ratios")] = "linear"

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.spacing == "logarithmic" and not self.start * self.stop > 0.0:
            raise ValueError(
                "start and stop must be both positive or both negative for spacing = logarithmic"
            )

    def values(self) -> tuple[float, ...]:
        """The values, as integers where all of them are whole."""
        space = np.linspace if self.spacing == "linear" else np.geomspace
        found = space(self.start, self.stop, self.count).tolist()
        whole = all(float(x).is_integer() for x in found)  # as counts need
        return tuple(int(x) if whole else x for x in found)


@dataclass(frozen=True)
class Sampling(Checked):
    """How cases are chosen.

    Attributes
    ----------
    method : str
        "grid": every combination of the values; "list": the first values of all, then the second ones, and so on;
        "latin-hypercube" and "sobol": points of a sample; "saltelli": the points that Sobol indices are computed from.
    samples : int or None
        Number of points; of "saltelli" the N of N (d + 2).
    seed : int
        Of the random numbers.
    """

    method: Annotated[Method, Quantity("how cases are chosen")] = "grid"
    samples: Annotated[int | None, Quantity("number of points", ge=1, le=MOST_CASES)] = None
    seed: Annotated[int, Quantity("seed of the random numbers", ge=0, le=2**63 - 1)] = 0

    @property
    def is_sample(self) -> bool:
        """Whether values are drawn from distributions."""
        return self.method in SAMPLED


@dataclass(frozen=True)
class Variation:
    """What takes other values from case to case.

    Attributes
    ----------
    name : str
        Of the column in the table of cases.
    keys : tuple of Key
        What gets the value: one key, or several with the same value.
    mode : "value", "factor" or "offset"
        The value replaces, multiplies, or is added to what the files declare.
    options : tuple
        Values of a grid or a list, or equally likely ones of a sample.
    distribution : Distribution or None
        Where it is given, there are no options.
    """

    name: str
    keys: tuple[Key, ...]
    mode: Mode = "value"
    options: tuple[Any, ...] = ()
    distribution: Distribution | None = None

    @property
    def names_robot(self) -> bool:
        """Whether the robot as a whole is exchanged."""
        return any(key.names_robot for key in self.keys)


@dataclass(frozen=True)
class Output:
    """What is kept of each case.

    Attributes
    ----------
    steps : tuple of int
        Numbers of load steps, from 1; empty means the last one.
    quantities : tuple of str
        Columns of `steps.csv`; empty means all that are numbers.
    """

    steps: tuple[int, ...] = ()
    quantities: tuple[str, ...] = ()


@dataclass(frozen=True)
class Sweep:
    """Everything that decides the cases of a sweep.

    Attributes
    ----------
    tables : ScenarioTables
        Scenario and robot that are varied.
    variations : tuple of Variation
    sampling : Sampling
    output : Output
    robots : tuple of (str, ScenarioTables)
        Where robots are varied: their paths, and the tables with each robot.
    workspace : bool
        Whether the tensions are varied to find the workspace.
    digests : tuple of (str, str)
        File names as the user named them, and SHA-256 of the files.
    path : str
        Of the sweep.
    effects : tuple of str
        Python files with effects of the user's own.
    """

    tables: ScenarioTables
    variations: tuple[Variation, ...]
    sampling: Sampling
    output: Output
    robots: tuple[tuple[str, ScenarioTables], ...] = ()
    workspace: bool = False
    digests: tuple[tuple[str, str], ...] = ()
    path: str = ""
    effects: tuple[str, ...] = ()

    def design(self) -> Design:
        """The cases; the same ones for the same sweep."""
        method, samples = self.sampling.method, self.sampling.samples
        if not self.sampling.is_sample:
            combine = grid if method == "grid" else together
            return combine([v.options for v in self.variations])
        assert samples is not None
        points = unit_points(method, samples, len(self.variations), self.sampling.seed)
        columns = [
            Column(v.options, numbers_of(v.options, p))
            if v.distribution is None
            else Column((), v.distribution.quantile(p))
            for v, p in zip(self.variations, points.T, strict=True)
        ]
        return Design(method, tuple(columns), len(points), samples if method == "saltelli" else 0)

"""A sweep as data: distributions, what is varied, how cases are chosen, what is kept; the tables of `sweep.toml`."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Annotated, Any, Literal

import numpy as np
from scipy import stats
from scipy.stats import qmc

from tdcr_fe.elements import Array
from tdcr_fe.io.toml import ScenarioTables
from tdcr_fe.model.messages import quoted
from tdcr_fe.model.schema import Checked, FieldError, Quantity
from tdcr_fe.model.units import has_unit
from tdcr_fe.sweeps.keys import Key, KeyProblem, parse_key, unit_of

#: Probabilities stay this far from zero and one, so that quantiles are finite.
_EDGE = 2.0**-53
#: Least probability between the bounds of a truncated distribution.
_LEAST = 1e-9


class Distribution(Checked):
    """A random number: fields with their meaning, and the distribution of `scipy.stats` that they give."""

    def __post_init__(self) -> None:
        super().__post_init__()
        lower, upper = getattr(self, "lower", None), getattr(self, "upper", None)
        if lower is not None and upper is not None and not lower < upper:
            raise ValueError(f"lower = {lower:g} and upper = {upper:g}; lower must be below upper")
        self.frozen()  # refuses what does not fit together

    def frozen(self) -> Any:
        """The distribution of `scipy.stats`."""
        raise NotImplementedError

    @property
    def numbers(self) -> dict[str, float]:
        """Its numbers, by their keys in the file."""
        return {k: v for k, v in vars(self).items() if v is not None}

    def quantile(self, probability: Array) -> Array:
        """Values below which the number lies with these probabilities, shape ``probability.shape``."""
        return np.asarray(self.frozen().ppf(np.clip(probability, _EDGE, 1.0 - _EDGE)))


@dataclass(frozen=True)
class Uniform(Distribution):
    """Every value between two bounds is equally likely.

    Attributes
    ----------
    lower, upper : float
    """

    lower: Annotated[float, Quantity("smallest value")]
    upper: Annotated[float, Quantity("largest value")]

    def frozen(self) -> Any:
        """See `Distribution.frozen`."""
        return stats.uniform(self.lower, self.upper - self.lower)


@dataclass(frozen=True)
class Normal(Distribution):
    """Gaussian, truncated where bounds are given.

    Attributes
    ----------
    mean, std : float
        Mean and standard deviation of the distribution before truncation.
    lower, upper : float or None
        Values beyond them do not occur.
    """

    mean: Annotated[float, Quantity("mean")]
    std: Annotated[float, Quantity("standard deviation", gt=0.0)]
    lower: Annotated[float | None, Quantity("smallest value")] = None
    upper: Annotated[float | None, Quantity("largest value")] = None

    def frozen(self) -> Any:
        """See `Distribution.frozen`."""
        return _truncated(self.mean, self.std, self.lower, self.upper)


@dataclass(frozen=True)
class LogNormal(Distribution):
    """The logarithm is Gaussian.

    Attributes
    ----------
    median : float
    sigma : float
        Standard deviation of the natural logarithm; about the relative standard deviation where it is small [1].
    lower, upper : float or None
        Values beyond them do not occur.
    """

    median: Annotated[float, Quantity("median", gt=0.0)]
    sigma: Annotated[float, Quantity("standard deviation of the natural logarithm", gt=0.0)]
    lower: Annotated[float | None, Quantity("smallest value", gt=0.0)] = None
    upper: Annotated[float | None, Quantity("largest value", gt=0.0)] = None

    def frozen(self) -> Any:
        """The distribution of the logarithm."""
        lower, upper = (None if x is None else math.log(x) for x in (self.lower, self.upper))
        return _truncated(math.log(self.median), self.sigma, lower, upper)

    def quantile(self, probability: Array) -> Array:
        """See `Distribution.quantile`."""
        return np.exp(super().quantile(probability))


def _truncated(mean: float, std: float, lower: float | None, upper: float | None) -> Any:
    """A Gaussian between bounds.

    Raises
    ------
    ValueError
        Hardly anything lies between them.
    """
    whole = stats.norm(mean, std)
    if lower is None and upper is None:
        return whole
    low, high = (-math.inf if lower is None else lower), (math.inf if upper is None else upper)
    if whole.cdf(high) - whole.cdf(low) < _LEAST:
        raise ValueError("the bounds lower and upper leave out the whole distribution")
    return stats.truncnorm((low - mean) / std, (high - mean) / std, mean, std)


def unit_points(method: str, samples: int, dimensions: int, seed: int) -> Array:
    """Points of the unit cube, shape (n, dimensions).

    Parameters
    ----------
    method
        "latin-hypercube"; "sobol": scrambled Sobol points; "saltelli": for every one of ``samples`` pairs A, B of Sobol
        points the rows A, B, and d copies of A with one coordinate from B, in this order.
    samples
        A power of two for "sobol" and "saltelli".
    seed
        Seed of the random numbers.
    """
    random = np.random.default_rng(seed)
    if method == "latin-hypercube":
        return np.asarray(qmc.LatinHypercube(dimensions, seed=random).random(samples))
    if method == "sobol":
        return np.asarray(qmc.Sobol(dimensions, seed=random).random(samples))
    both = qmc.Sobol(2 * dimensions, seed=random).random(samples)
    a, b = both[:, :dimensions], both[:, dimensions:]
    rows = np.repeat(a[:, None, :], dimensions + 2, axis=1)
    rows[:, 1, :] = b
    for k in range(dimensions):
        rows[:, 2 + k, k] = b[:, k]
    return rows.reshape(-1, dimensions)


# --------------------------------------------------------------------------------------------------------- the sweep

#: Most cases of a sweep.
MOST_CASES = 1_000_000

Method = Literal["grid", "list", "latin-hypercube", "sobol", "saltelli"]
#: Methods that draw values from distributions.
SAMPLED = ("latin-hypercube", "sobol", "saltelli")
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
            text = "must be both positive or both negative for spacing = logarithmic"
            raise ValueError(f"start and stop {text}")

    def values(self) -> tuple[float, ...]:
        """The values, as integers where all of them are whole."""
        space = np.linspace if self.spacing == "linear" else np.geomspace
        values = space(self.start, self.stop, self.count).tolist()
        whole = all(float(x).is_integer() for x in values)  # as counts need
        return tuple(int(x) if whole else x for x in values)


@dataclass(frozen=True)
class Sampling(Checked):
    """How cases are chosen; the table ``[sampling]``.

    Attributes
    ----------
    method : str
        "grid": every combination of the values; "list": the first values of all, then the second ones, and so on;
        "latin-hypercube" and "sobol": points of a sample; "saltelli": the points that Sobol indices are computed from.
    samples : int or None
        Number of points; of "saltelli" the N of N (d + 2).
    seed : int
        Seed of the random numbers.
    """

    method: Annotated[Method, Quantity("how cases are chosen")] = "grid"
    samples: Annotated[int | None, Quantity("number of points", ge=1, le=MOST_CASES)] = None
    seed: Annotated[int, Quantity("seed of the random numbers", ge=0, le=2**63 - 1)] = 0

    def __post_init__(self) -> None:
        super().__post_init__()
        method, samples = quoted(self.method), self.samples
        if self.is_sample and samples is None:
            raise FieldError("samples", "", f"missing; method = {method} needs a number of points")
        if not self.is_sample and samples is not None:
            text = f"only for method = {', '.join(map(quoted, SAMPLED))}; {method} takes all values given"
            raise FieldError("samples", str(samples), text)
        if self.method in ("sobol", "saltelli") and samples and samples.bit_count() != 1:
            text = f"must be a power of two for method = {method}, such as 256, 512 or 1024"
            raise FieldError("samples", str(samples), text)

    @property
    def is_sample(self) -> bool:
        """Whether values are drawn from distributions."""
        return self.method in SAMPLED


#: Keys of ``[[vary]]`` that give its values; exactly one is given.
VALUES = ("values", "range", "uniform", "normal", "lognormal")
_LIST = "a list of values, at least one"


@dataclass(frozen=True)
class Variation(Checked):
    """What takes other values from case to case; a table ``[[vary]]``.

    Attributes
    ----------
    key : str
        Key of what gets the value.
    name : str
        Name of the column in the table of cases; empty: the key.
    mode : "value", "factor" or "offset"
        The value replaces, multiplies, or is added to what the files declare.
    values, range
        Values and range of a grid or a list, or equally likely ones of a sample.
    uniform, normal, lognormal
        A distribution.
    """

    key: Annotated[str, Quantity("what varies", allowed="the key of a value, in quotes")]
    name: Annotated[str, Quantity("name of the column", name=True)] = ""
    mode: Annotated[Mode, Quantity("how the value acts on the declared one")] = "value"
    values: Annotated[tuple[Any, ...], Quantity("values of a list or grid", allowed=_LIST, min_items=1)] = ()
    range: Annotated[Range | None, Quantity("values at equal distances")] = None
    uniform: Uniform | None = None
    normal: Normal | None = None
    lognormal: LogNormal | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        try:
            _ = self.place
        except KeyProblem as error:
            raise FieldError("key", self.key, str(error)) from error
        given = [name for name in VALUES if getattr(self, name)]
        if len(given) != 1:
            text = f"must have exactly one of {', '.join(VALUES)}"
            raise ValueError(text + (f"; it has {' and '.join(given)}" if given else ""))
        numbers = all(isinstance(x, int | float) and not isinstance(x, bool) for x in self.options)
        if self.mode != "value" and not numbers:
            raise FieldError("mode", quoted(self.mode), "only for values that are numbers")

    @property
    def column(self) -> str:
        """Name of its column in the table of cases."""
        return self.name or self.key

    @property
    def label(self) -> str:
        """Its column with the unit of the value, for people."""
        unit = "factor" if self.mode == "factor" else unit_of(self.place)
        text = f"change of {self.column}" if self.mode == "offset" else self.column
        return f"{text} [{unit}]" if has_unit(unit) else text

    @cached_property
    def place(self) -> Key:
        """Where the value stands."""
        return parse_key(self.key)

    @cached_property
    def options(self) -> tuple[Any, ...]:
        """Values to choose from; empty where there is a distribution."""
        return self.range.values() if self.range else self.values

    @property
    def distribution(self) -> Distribution | None:
        """The distribution that values are drawn from; None where there are options."""
        return next((x for name in VALUES[2:] if (x := getattr(self, name))), None)

    def described(self) -> tuple[str, Any]:
        """The key that gives the values, and what stands there."""
        if self.distribution is None:
            return "values", list(self.options)
        return type(self.distribution).__name__.lower(), self.distribution.numbers


_TENSION = "a tension [N], zero or more, or a table of tensions by tendon"
_Tension = float | dict[str, float]


@dataclass(frozen=True)
class Workspace:
    """Tensions of all tendons in the last load step; the table ``[workspace]``.

    Attributes
    ----------
    largest, smallest : float, or mapping of str to float
        Bounds [N], of all tendons or by tendon.
    count : int or None
        Values per tendon, for a grid.
    """

    largest: Annotated[_Tension, Quantity("largest tension", unit="N", ge=0.0, allowed=_TENSION)]
    smallest: Annotated[_Tension, Quantity("smallest tension", unit="N", ge=0.0, allowed=_TENSION)] = 0.0
    count: Annotated[int | None, Quantity("values per tendon", ge=2, le=1000)] = None


_STEPS = 'one of "last", "all", or a list of the numbers of load steps, from 1'
_COLUMNS = "a list of columns of steps.csv, in quotes"
_Steps = Literal["last", "all"] | tuple[int, ...]


@dataclass(frozen=True)
class Output:
    """What is kept of each case; the table ``[output]``.

    Attributes
    ----------
    steps : "last", "all", or tuple of int
        Numbers of load steps, from 1.
    quantities : tuple of str
        Columns of `steps.csv`; empty means all that are numbers.
    """

    steps: Annotated[_Steps, Quantity("load steps whose results are kept", ge=1, allowed=_STEPS)] = "last"
    quantities: Annotated[tuple[str, ...], Quantity("columns", allowed=_COLUMNS)] = ()

    def suffixes(self, count: int) -> dict[str, int]:
        """What the names of columns end in, and the load step [from 1] that they are of, out of ``count`` steps."""
        if self.steps == "last":
            return {"": count}
        numbers = range(1, count + 1) if self.steps == "all" else self.steps
        return {f"_step{k}": k for k in numbers if isinstance(k, int)}


#: The values of all cases, by column.
Design = dict[str, list[Any]]
#: Where a value stands, how it acts on the declared one, and the value.
Change = tuple[Key, Mode, Any]


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
    workspace : bool
        Whether the tensions are varied to find the workspace.
    digests : mapping of str to str
        SHA-256 of the files, by name as the user named them.
    effects : tuple of str
        Python files with effects of the user's own.
    """

    tables: ScenarioTables
    variations: tuple[Variation, ...] = ()
    sampling: Sampling = Sampling()
    output: Output = Output()
    workspace: bool = False
    digests: Mapping[str, str] = field(default_factory=dict)
    effects: tuple[str, ...] = ()

    @property
    def count(self) -> int:
        """Number of cases."""
        sizes = [len(v.options) for v in self.variations]
        if self.sampling.method == "saltelli":
            return (self.sampling.samples or 0) * (len(sizes) + 2)
        return self.sampling.samples or (math.prod(sizes) if self.sampling.method == "grid" else sizes[0])

    def changes(self, design: Design, case: int) -> list[Change]:
        """What changes in a case, counted from 0."""
        return [(v.place, v.mode, design[v.column][case]) for v in self.variations]

    def design(self) -> Design:
        """The cases; the same ones for the same sweep. The last variation of a grid changes fastest."""
        names, how = [v.column for v in self.variations], self.sampling
        if how.samples is not None:
            points = unit_points(how.method, how.samples, len(names), how.seed)
            columns = [_drawn(v, p) for v, p in zip(self.variations, points.T, strict=True)]
        else:
            options = [v.options for v in self.variations]
            rows = itertools.product(*options) if how.method == "grid" else zip(*options, strict=True)
            columns = [list(x) for x in zip(*rows, strict=True)]
        return dict(zip(names, columns, strict=True))


def _drawn(v: Variation, probabilities: Array) -> list[Any]:
    """Values of a variation at probabilities between 0 and 1; options are equally likely."""
    if v.distribution is not None:
        return list(v.distribution.quantile(probabilities).tolist())
    count = len(v.options)
    return [v.options[k] for k in np.minimum((probabilities * count).astype(np.int64), count - 1)]

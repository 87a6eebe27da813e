"""Loads that depend on the solved state: terms of a law, forces on disks and along the backbone, and towards points.

A term is a product of factors that the robot knows in a bay, times a direction, at one place or along all bays.
"""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from itertools import chain, combinations_with_replacement, product
from typing import TYPE_CHECKING

import numpy as np
from scipy.interpolate import CubicSpline

from tdcr_fe.effects import Parameter
from tdcr_fe.effects.base import Kind, Values
from tdcr_fe.elements import Array
from tdcr_fe.identify.bay_state import COMPONENTS, FORCE, MOMENT, BayState, end_of_bay, last_direction, scale
from tdcr_fe.identify.causes import Attraction, Cord, Held, LawLoad, StateLoad, Wall, number, settling_span
from tdcr_fe.identify.criteria import OTHER_GRAVITY, PER_FACTOR, UNLISTED
from tdcr_fe.identify.rows import possible_starts, tip_forces
from tdcr_fe.model.loading import resolve

if TYPE_CHECKING:
    from tdcr_fe.identify.problem import FitProblem

#: Largest size of a moment or force that a typical step of its coefficient gives, over EI/L or EI/L^2, and the largest
#: coefficient in such steps [1].
TYPICAL, FARTHEST = 0.02, 2000.0

#: Loads begin or end with rows on all disks for so many pairs of a part of the rows and a disk at most, else on the tip
#: only: each pair is six columns.
MOST_PAIRS = 1200


#: Values of a factor through which any function of it goes. With six, and lines between them, a stiffness that went up
#: and down by 6 % every 30 of 46 rows left a chi-square of 3.1 on held-out rows, beside two wrong causes.
KNOTS = 8

#: Angle over the whole length below which the direction of the curvature fades [rad].
STRAIGHT = 0.1


@dataclass(frozen=True)
class Factor:
    """A number that the robot knows in every bay."""

    name: str
    unit: str  # such as "N m^-1"
    value: Callable[[BayState], Array]  # from a `BayState` to shape (K, n_bays)
    kind: str  # what a cause with this factor depends on
    choices: int = 1  # among how many of its kind it is chosen
    when: str = ""  # in words, where a load acts with it in some rows only

    @property
    def how(self) -> str:
        """How a load with it acts, in words."""
        if self.when:
            return "in a part of the rows"
        return f"in proportion to {self.name}" if self.name else "constant"


@dataclass(frozen=True, eq=False)
class Direction:
    """What a moment points along."""

    law: str  # what a moment along it changes
    name: str
    size: str  # what it is in proportion to besides its factors; empty where to nothing
    unit: str
    # by name of a coefficient, from a `BayState` to the action of a coefficient of one, shape (K, n_bays, 6)
    values: Mapping[str, Callable[[BayState], Array]]
    perturbs: str = "stiffness"  # what a cause with this direction perturbs
    depends_on: str = ""  # what that depends on by the direction alone; empty where on nothing


def _moment(across: Array) -> Array:
    """Moments about the x and y axis, shape (K, n_bays, 2), as an action."""
    full = np.zeros((*across.shape[:2], COMPONENTS))
    full[..., :2] = across
    return full


def _constant(b: BayState, axis: int) -> Array:
    return _moment(np.broadcast_to(np.eye(2)[axis], (*b.shape, 2)))


def _tendon(b: BayState, weight: Array) -> Array:
    return _moment(np.einsum("kbt,btc->kbc", weight, b.lever))


def _slipping(b: BayState, compare: np.ufunc) -> Array:
    return _tendon(b, b.tension * compare(b.direction, 0)[:, None, :])


def _bending(b: BayState) -> Array:
    return b.curvature[..., :2]


def _size(vectors: Array) -> Array:
    return np.asarray(np.linalg.norm(vectors, axis=2))


def _row(b: BayState) -> Array:
    return _in_all(b, np.arange(1.0, len(b.time) + 1.0)[:, None])


def _in_all(b: BayState, values: Array) -> Array:
    """The same in all bays, or in all rows."""
    return np.broadcast_to(values, b.shape)


def _turned(b: BayState) -> Array:
    """Angle by which tendons turn at the disks below every bay [rad]; none at the base plate."""
    angles = _size(_bending(b)) * np.diff(b.edges)
    return np.asarray(np.cumsum(angles, axis=1) - 0.5 * (angles + angles[:, :1]))


def _last_command(b: BayState) -> Array:
    """Sign of the last change of the sum of all tensions, shape (K, n_bays)."""
    total = b.tension.sum(axis=(1, 2))[:, None]
    return _in_all(b, last_direction(total, 1e-3 * float(np.max(np.abs(total), initial=0.0))))


def _unit_curvature(b: BayState) -> Array:
    """Direction of the curvature, which fades where the backbone turns by less than `STRAIGHT` over its length."""
    size = np.hypot(_size(_bending(b)), STRAIGHT / b.edges[-1])
    return np.asarray(_bending(b) / size[..., None])


CONSTANT = Factor("", "", lambda b: np.ones(b.shape), "")
CURVATURE = Factor("the curvature", "m^-1", lambda b: _size(_bending(b)), "curvature")
POSITION = Factor("the position along the backbone", "m", lambda b: _in_all(b, b.middles), "place")
TENSION = Factor("the sum of the tensions", "N", lambda b: b.tension.sum(axis=-1), "tension")
TIME = Factor("time", "s", lambda b: _in_all(b, b.time[:, None]), "time")
ROW = Factor("the number of the row", "", _row, "row")
LOADING = Factor("the direction of the last command", "", _last_command, "direction of loading")
TURNING = Factor("the turning angle at the disks below", "", _turned, "turning angle")
DISTANCE = Factor("the displacement", "m", lambda b: _size(b.moved), "position")

_CURVATURES = {"coefficient": lambda b: _moment(_bending(b))}
BENDING = Direction("bending stiffness", "along the curvature", "the curvature", "m^-1", _CURVATURES)
UNIT_BENDING = Direction(
    "bending moment of one size along the curvature", "of one size along the curvature", "", "",
    {"coefficient": lambda b: _moment(_unit_curvature(b))}, "stiffness", "curvature",
)  # fmt: skip
_AXES = {axis: partial(_constant, axis=i) for i, axis in enumerate("xy")}
SECTION = Direction("precurvature", "about an axis of the section", "", "", _AXES, "precurvature")
_TENSIONS, _OF = {"coefficient": lambda b: _tendon(b, b.tension)}, "moment of the tendons"
TENDONS = Direction(_OF, f"along the {_OF}", f"the {_OF}", "N m", _TENSIONS, "routing")
TENDON_SIGN = Direction(
    "moment of each tendon by the sign of its last motion",
    "along the moment of each tendon, by the sign of its last motion", "the moment of each tendon", "N m",
    {"coefficient": lambda b: _tendon(b, b.tension * b.direction[:, None, :])},
    "transmission", "direction of loading",
)  # fmt: skip

BY_SLIP = Direction(
    "friction of one size towards the base and another back",
    "along the moment of each tendon, of one size after motion towards the base and of another after motion back",
    "", "N m",
    {"towards": partial(_slipping, compare=np.greater), "back": partial(_slipping, compare=np.less)},
    "transmission", "direction of loading",
)  # fmt: skip

#: Directions with which products of up to two factors are formed.
_DIRECTIONS = (BENDING, SECTION, TENDONS, TENDON_SIGN)

#: Products that a listed effect has: a stiffness, a precurvature, a gain.
_LISTED = {((), BENDING), ((), SECTION), ((), TENDONS)}


def _unit(target: str, given: Iterable[str]) -> str:
    """Unit of a coefficient that takes factors of these units to a target."""
    powers: Counter[str] = Counter()
    for sign, unit in ((1, target), *((-1, x) for x in given)):
        for name, power in re.findall(r"(\w)(?:\^(\S+))?", unit):
            powers[name] += sign * int(power or 1)
    left = [(name, powers[name]) for name in ("N", "m", "s") if powers[name]]
    return " ".join(name if power == 1 else f"{name}^{power}" for name, power in left) or "1"


@dataclass(frozen=True)
class Term:
    """One term of a law, without its coefficients."""

    factors: tuple[Factor, ...]
    direction: Direction
    bays: tuple[int, int] | None = None  # the first and last bay where it acts, from 0; None: all bays

    @property
    def key(self) -> str:
        """What it changes, and where, in a few words."""
        return self.changes if self.bays is None else f"{self.changes} ({_bays(*self.bays)})"

    @property
    def changes(self) -> str:
        """What it changes."""
        of = _product(f.name for f in self.factors)
        return f"{self.direction.law} that changes with {of}" if of else self.direction.law

    @property
    def unit(self) -> str:
        """Unit of its coefficients."""
        return _unit("N m", [self.direction.unit, *(f.unit for f in self.factors)])

    @property
    def actions(self) -> list[tuple[str, str, Callable[[BayState], Array]]]:
        """Name and unit of every coefficient, and the action of a coefficient of one, shape (K, n_bays, 6)."""
        return [(n, self.unit, partial(self._action, value)) for n, value in self.direction.values.items()]

    def _action(self, direction: Callable[[BayState], Array], state: BayState) -> Array:
        value = direction(state)
        for f in self.factors:
            value = value * f.value(state)[..., None]
        if self.bays is not None:
            first, last = self.bays
            number = np.arange(value.shape[1])
            value = value * ((number >= first) & (number <= last))[None, :, None]
        return np.asarray(value)

    @property
    def kind(self) -> tuple[str, tuple[str, ...]]:
        """What it perturbs, and what that depends on."""
        own = (self.direction.depends_on, *(f.kind for f in self.factors))
        depends = tuple(dict.fromkeys(x for x in own if x)) or ("nothing",)
        perturbs = self.direction.perturbs
        if self.direction is TENDONS and not {"place", "curvature"} & set(depends):
            perturbs = "input"  # the same factor on the tension of every tendon, in all bays
        local = self.bays is not None and "place" not in depends
        return perturbs, (*depends, "place") if local else depends


def library(bays: int, clock: Factor) -> list[Term]:
    """Candidate terms: products of up to two factors along every direction in all bays; of one factor in some of them.

    Products that a listed effect has are left out.

    Parameters
    ----------
    bays
        How many there are.
    clock
        `TIME`, or `ROW` where the steps have no times.
    """
    factors = (CURVATURE, POSITION, TENSION, clock, LOADING)
    products = [p for n in (0, 1, 2) for p in combinations_with_replacement(factors, n)]
    pairs = [(p, d) for d in _DIRECTIONS for p in products]
    # the square of a sign is one
    once = [(p, d) for p, d in pairs if p.count(LOADING) + (d is TENDON_SIGN) <= 1]
    terms = [Term(p, d) for p, d in once if (p, d) not in _LISTED]
    terms += [Term((TURNING,), BY_SLIP), Term((TURNING, clock), BY_SLIP)]
    terms += [Term(p, UNIT_BENDING) for p in ((), (TENSION,), (clock,))]
    for some in ranges(bays):
        terms += [Term((f,), BENDING, some) for f in (CURVATURE, TENSION, clock, LOADING)]
        terms += [Term((f,), SECTION, some) for f in (clock, TENSION)]
        terms.append(Term((), UNIT_BENDING, some))
    return terms


def ranges(bays: int) -> list[tuple[int, int]]:
    """The first and last of all neighbouring bays, but for all together."""
    return [some for some in combinations_with_replacement(range(bays), 2) if some != (0, bays - 1)]


def _bays(first: int, last: int) -> str:
    return f"bay {first + 1}" if first == last else f"bays {first + 1} to {last + 1}"


def parts_of_rows(clock: Factor, starts: Mapping[int, float]) -> list[Factor]:
    """One from a row on, and zero before it, or the other way; ``starts``: by row, the value of the clock there."""

    def part(state: BayState, start: float, after: bool) -> Array:
        return ((clock.value(state) >= start) == after).astype(float)

    found = []
    for (n, x), after in product(starts.items(), (True, False)):
        when = f"from row {n} on" if after else f"before row {n}"
        value = partial(part, start=x, after=after)
        name, choices = f"a step in row {n}", 2 * len(starts)
        found.append(Factor(name, "", value, "row", choices, when))
    return found


def tensions_of(names: Sequence[str]) -> Iterator[Factor]:
    """The tension of each of several tendons."""

    def tension(state: BayState, number: int) -> Array:
        return state.tension[..., number]

    choices = len(names)
    for i, n in enumerate(names if choices > 1 else ()):
        yield Factor(f"the tension of tendon {n}", "N", partial(tension, number=i), "tension", choices)


def where(term: Term, edges: Array) -> str:
    """Where a term acts."""
    if term.bays is None:
        return "everywhere"
    first, last = term.bays
    return f"{_bays(first, last)} (s = {edges[first]:.4g} to {edges[last + 1]:.4g} m)"


def _product(names: Iterable[str]) -> str:
    """A product in words."""
    powers = ("", "the square of ", "the third power of ")
    return " times ".join(f"{powers[n - 1]}{name}" for name, n in Counter(names).items())


def definition(term: Term) -> str:
    """What a coefficient of a term multiplies, in words."""
    names = filter(None, (*(f.name for f in term.factors), term.direction.size))
    return f"a bending moment {term.direction.name}, proportional to {_product(names) or 'a constant'}"


# ------------------------------------------------------------------------------------------------------- loads


#: Name and unit of every coefficient, and the action of a coefficient of one, shape (K, n_bays, 6).
_Coefficients = Sequence[tuple[str, str, Callable[[BayState], Array]]]


@dataclass(frozen=True, eq=False)
class _Known:
    """What is known where the causes are made."""

    problem: FitProblem
    state: BayState
    progress: str  # What a drift depends on, "time" or "row"; empty where drifts are left out

    @cached_property
    def size(self) -> Array:
        """See `tdcr_fe.identify.bay_state.scale`."""
        return scale(self.problem.experiment.robot)

    @property
    def bays(self) -> int:
        """Number of bays."""
        return self.state.shape[1]

    @property
    def clock(self) -> Factor:
        """What a drift is in proportion to."""
        return TIME if self.progress == "time" else ROW

    @cached_property
    def settling(self) -> tuple[Parameter, Held]:
        """See `tdcr_fe.identify.causes.settling_span`."""
        return settling_span(self.clock.unit or "1", float(np.ptp(self.clock.value(self.state))))

    @cached_property
    def parts(self) -> list[Factor]:
        """Parts of the rows, see `parts_of_rows`."""
        # In several folders the time begins anew in each, so changes are taken to occur between folders.
        data = self.problem.data
        counts = ROW if data.restarts else self.clock
        rows = data.restarts or (possible_starts(data) if self.progress else ())
        return parts_of_rows(counts, {data.step_ids[k]: float(counts.value(self.state)[k, -1]) for k in rows})

    def load(
        self, name: str, kind: Kind, terms: _Coefficients, text: str, price: float, meaning: str = ""
    ) -> Iterator[StateLoad]:
        """The cause, or none where a term does not act."""
        numbers = []
        for label, unit, term in terms:
            most = float(np.nanmax(np.abs(term(self.state)) / self.size, initial=0.0))
            if most <= 0.0:
                return
            step = TYPICAL / most
            span = -FARTHEST * step, FARTHEST * step
            numbers.append(Parameter(label, unit, *span, 0.0, step, meaning or label))
        if numbers:
            yield StateLoad(name, kind, tuple(numbers), tuple(t for *_, t in terms), text, price)


def state_loads(problem: FitProblem, state: BayState, progress: str) -> Iterator[StateLoad]:
    """Causes that are moments and forces on the backbone which depend on its state.

    ``progress``: what a drift depends on, "time" or "row"; empty where drifts are left out.
    """
    known = _Known(problem, state, progress)
    return chain.from_iterable(family(known) for family in FAMILIES)


def _products(known: _Known) -> Iterator[StateLoad]:
    """Products of factors, and what settles."""
    state, clock = known.state, known.clock
    # only those from a row on: a jump before it differs by a change in all rows, which is a cause of its own
    jumps = [Term((part,), d) for part in known.parts[::2] for d in (BENDING, SECTION)]
    for term in (*library(known.bays, clock), *jumps):
        if not known.progress and ROW in term.factors:
            continue
        perturbs, depends = term.kind
        choices = 1 if term.bays is None else len(ranges(known.bays))
        choices *= math.prod(f.choices for f in term.factors)
        price = math.log(10.0) + PER_FACTOR * len(term.factors) + math.log(choices)
        kind = Kind(perturbs, depends, where(term, state.edges))
        yield from known.load(term.key, kind, term.actions, term.changes, price, definition(term))
        if known.progress and term.factors == (clock,) and ((), term.direction) in _LISTED:
            last = replace(term, factors=())
            lasting = known.load(last.key, kind, last.actions, last.changes, price, definition(last))
            yield from (x.settling(lambda b: clock.value(b)[:, :1, None], *known.settling) for x in lasting)


def _on_disks(known: _Known) -> Iterator[StateLoad]:
    """Forces and moments with three coefficients, on one disk each, constant or in proportion to something.

    Along fixed directions, and on the tip along those that turn with it.
    """
    state, data, parts = known.state, known.problem.data, known.parts
    forces = tip_forces(resolve(data.robot, data.steps))

    def fixed(state: BayState, axis: int) -> Array:
        return np.tile(np.eye(3)[axis], (state.shape[0], 1))

    def turning(state: BayState, axis: int) -> Array:
        return state.tip[:, :, axis]

    def dipole(state: BayState, axis: int) -> Array:
        return np.cross(state.tip[:, :, 2], fixed(state, axis))

    def by_lever(state: BayState, axis: int) -> Array:
        return np.cross(state.tip[:, :, axis], forces)

    force = Factor("the force on it", "N", CONSTANT.value, "")
    often = CONSTANT, known.clock, TENSION, DISTANCE, *tensions_of(data.robot.tendon_names)
    magnet = "of a uniform field on a magnet along the tip"
    many = len(parts) * known.bays > MOST_PAIRS
    for perturbs, text, by, direction, factors in (
        ("force", "of fixed direction", "", fixed, (*often, *parts)),
        ("moment", "of fixed direction", "", fixed, (*often, *parts)),
        ("force", "that turns with the tip", "orientation", turning, often),
        # such a moment that changes with something is hardly another one than a precurvature that does
        ("moment", "that turns with the tip", "orientation", turning, (CONSTANT,)),
        ("moment", magnet, "orientation", dipole, (CONSTANT, known.clock)),
        ("moment", "of a lever at the tip", "", by_lever, (force,)),
    ):
        for factor in factors:
            depends = tuple(filter(None, (by, factor.kind))) or ("nothing",)
            if "row" in depends and not known.progress:
                continue
            what, when = f"{perturbs} {text}, {factor.how}", f", {factor.when}" if factor.when else ""
            unit = _unit("N" if perturbs == "force" else "N m", [factor.unit])
            at_tip = direction is not fixed or (many and factor in parts)
            for bay in range(known.bays - 1 if at_tip else 0, known.bays):
                at, act = end_of_bay(state.edges, bay), partial(_on_disk, factor=factor, bay=bay)
                along = [(a, partial(direction, axis=axis)) for axis, a in enumerate("xyz")]
                terms = [(a, unit, partial(act, along=x, force=perturbs == "force")) for a, x in along]
                price = 1.5 + math.log(state.choices(bay)) + math.log(factor.choices)
                kind, name = Kind(perturbs, depends, at), f"{what} ({at}{when})"
                yield from known.load(name, kind, terms, f"a {what}{when}", price)


def _by_displacement(known: _Known) -> Iterator[StateLoad]:
    """Forces along the displacement of a disk, by its square or third power; and against its velocity."""
    state = known.state
    powers = (1, _product(2 * [DISTANCE.name])), (2, _product(3 * [DISTANCE.name]))
    for bay, (power, of) in product(range(known.bays), powers):
        kind = Kind("force", ("position",), end_of_bay(state.edges, bay))
        own = [("coefficient", _unit("N", ["m"] * (power + 1)), partial(_displaced, bay=bay, power=power))]
        text = f"a force along the displacement across the axis, proportional to {of}"
        price = math.log(10.0) + PER_FACTOR * power + math.log(known.bays)
        yield from known.load(f"force by {of} ({kind.where})", kind, own, text, price)
    for bay in range(known.bays if known.clock is TIME else 0):
        at = end_of_bay(state.edges, bay)
        own = [("coefficient", "N s m^-1", partial(_against_motion, bay=bay))]
        kind, price = Kind("force", ("position", "time"), at), math.log(10.0) + math.log(state.choices(bay))
        yield from known.load(f"viscous drag ({at})", kind, own, "a force against the velocity", price)


def _functions(known: _Known) -> Iterator[StateLoad]:
    """Any function of one factor."""
    of_one = product((CURVATURE, POSITION, TENSION, known.clock), (BENDING, TENDONS, TENDON_SIGN))
    for factor, direction in (*of_one, (POSITION, SECTION)):
        if known.progress or factor is not ROW:
            term = Term((factor,), direction)
            name, price = f"{direction.law} as a function of {factor.name}", math.log(10.0) + PER_FACTOR
            kind = Kind(*term.kind, "everywhere")
            yield from known.load(name, kind, _free(term, known.state), name, price)


def _by_direction(known: _Known) -> Iterator[StateLoad]:
    """Bending stiffnesses that depend on the direction of bending."""
    axes = {"xx": "x", "yy": "y", "xy": "xy", "xz": "xz", "yz": "yz"}
    tensor = [(n, "N m^2", partial(_by_curvature, axes=a)) for n, a in axes.items()]
    signed = product(enumerate("xy"), (("plus", 1.0), ("minus", -1.0)))
    sides = [(f"{a}_{n}", "N m^2", partial(_by_side, axis=i, sign=x)) for (i, a), (n, x) in signed]
    kind = Kind("stiffness", ("direction of bending",), "everywhere")
    text = "a bending stiffness that differs between"
    for name, own, what in (
        ("bending stiffness of another section", tensor[:3], f"{text} the directions"),
        ("bending stiffness by side", sides, f"{text} bending to one side and to the other"),
        ("bending coupled with twist", tensor[3:], "a stiffness by which bending twists the backbone"),
    ):
        yield from known.load(name, kind, own, what, math.log(10.0))


def _lost_tensions(known: _Known) -> Iterator[StateLoad]:
    """A share of the tension of one tendon, which is lost from a disk on."""
    names = known.problem.experiment.robot.tendon_names
    for (i, name), first in product(enumerate(names), range(1, known.bays)):
        at = f"tendon {name}, from s = {known.state.edges[first]:.4g} m on"
        own = [("share", "1", partial(_lost, tendon=i, first=first))]
        text, price = "a share of a tendon's tension is lost", math.log(len(names) * (known.bays - 1))
        yield from known.load(f"lost tension ({at})", Kind("transmission", ("place",), at), own, text, price)


def _remembered(known: _Known) -> Iterator[LawLoad]:
    """A backbone with dry friction, one that yields, and one that relaxes."""
    length, step, price = float(known.state.edges[-1]), TYPICAL * float(known.size[0]), math.log(10.0)
    moment = number("moment", "N m", (-FARTHEST * step, FARTHEST * step), 0.0, step)
    within = number("within", "1/m", (0.0, 10.0 / length), 0.0, 0.01 / length)
    kind = Kind("stiffness", ("direction of loading",))
    held = {"within": [x / length for x in (0.03, 0.1, 0.3)]}
    text = "a moment of dry friction within the backbone, along the last change of its curvature"
    yield LawLoad("dry friction in bending", kind, (moment, within), _held_back, text, price, held)
    largest = float(np.nanmax(_size(_bending(known.state)), initial=0.0))
    if not largest > 0.0:
        return
    most, step = FARTHEST * step / largest, step / largest
    share, limit = number("coefficient", "N m^2", (0.0, most), 0.0, step), (0.0, largest)
    numbers = share, number("limit", "1/m", limit, largest, 0.05 * largest)
    kind, held = Kind("precurvature", ("curvature",)), {"limit": [x * largest for x in (0.5, 0.7, 0.85)]}
    text = "a backbone that yields: what its curvature changes beyond a limit stays in part"
    yield LawLoad("permanent set", kind, numbers, _yielded, text, price, held)
    if not known.progress:
        return
    (last, spans), late = known.settling, number("late", "1", (0.0, 1.0), 0.5, 0.1)
    relaxing, tried = (replace(share, lower=-most), last, late), {**spans, "late": [0.0, 0.5, 1.0]}
    kind = Kind("stiffness", (known.clock.kind,))
    for declared in ("of a fast load", "at rest"):
        acts = partial(_relaxed, clock=known.clock, at_rest=declared == "at rest")
        text = f"a backbone that relaxes; its declared stiffness is that {declared}"
        yield LawLoad(f"relaxation, stiffness {declared}", kind, relaxing, acts, text, price, tried)


def _along_the_backbone(known: _Known) -> Iterator[StateLoad]:
    """A constant force per length."""
    spread = [(a, "N/m", partial(_spread, axis=i)) for i, a in enumerate("xyz")]
    kind = Kind("force", ("nothing",), "along the backbone")
    text = "a constant force along the whole backbone"
    return known.load("force along the backbone", kind, spread, text, 0.5 * OTHER_GRAVITY - UNLISTED)


def _of_surroundings(known: _Known) -> Iterator[StateLoad]:
    """Attractions, cords and walls."""
    force, length = float(known.size[-1]), float(known.state.edges[-1])
    for bay in range(known.bays):
        powers = (2, 1, 3) if bay == known.bays - 1 else (2,)
        yield from (Attraction(bay, known.state, power, TYPICAL * force) for power in powers)
        yield Cord(bay, known.state, TYPICAL * force / length)
        yield Wall(bay, known.state, 3.0 * force / length)


#: Functions that make the causes, each of one family.
FAMILIES = (
    _products,
    _on_disks,
    _by_displacement,
    _functions,
    _by_direction,
    _lost_tensions,
    _remembered,
    _along_the_backbone,
    _of_surroundings,
)


def _free(term: Term, state: BayState) -> list[tuple[str, str, Callable[[BayState], Array]]]:
    """The coefficients of a term of one factor as any function of it: a natural cubic spline through some values.

    It is zero at the smallest: a constant is a cause of its own.
    """
    (factor,) = term.factors
    given = factor.value(state)
    given = given[np.isfinite(given)]
    count = min(KNOTS, len(np.unique(given)))
    at = np.unique(np.quantile(given, np.linspace(0.0, 1.0, count)))

    def share(state: BayState, curve: CubicSpline) -> Array:
        return np.asarray(curve(np.clip(factor.value(state), at[0], at[-1])))

    found = []
    for k, values in enumerate(np.eye(len(at))[1:], 1):
        curve = CubicSpline(at, values, bc_type="natural")
        own = replace(term, factors=(replace(factor, unit="", value=partial(share, curve=curve)),))
        found += [(f"{n}_{k}_at_{at[k]:.3g}", unit, act) for n, unit, act in own.actions]
    return found


def _held_back(state: BayState, values: Values) -> Array:
    """A moment of one size along the last change of the curvature, beyond some change."""
    within = max(values["within"], 1e-6 / float(state.edges[-1]))
    change = (_bending(state) - _before(state)) / within
    return values["moment"] * _moment(_row_by_row(state, lambda last, k: _follows(last, change[k])))


def _yielded(state: BayState, values: Values) -> Array:
    """What changes of the curvature beyond a limit have left in part, as a precurvature does."""
    bent = _bending(state)

    def left(last: Array, k: int) -> Array:
        elastic = bent[k] - last
        size = np.maximum(np.linalg.norm(elastic, axis=-1, keepdims=True), 1e-300)
        return np.asarray(last + np.maximum(1.0 - values["limit"] / size, 0.0) * elastic)

    return values["coefficient"] * _moment(_row_by_row(state, left))


def _relaxed(state: BayState, values: Values, clock: Factor, at_rest: bool) -> Array:
    """A curvature without load that follows the one that it has (a Maxwell element).

    For a share of the time since the row before the robot stays as it was there. ``at_rest``: whether the declared
    stiffness is that in the end.
    """
    passed = clock.value(state)[:, :1, None] / values["span"]
    passed = np.where(state.begins[:, None, None], 0.0, np.diff(passed, axis=0, prepend=0.0))
    left, left_since = np.exp(-passed), np.exp(-(1.0 - values["late"]) * passed)
    gained = (left_since - left) * _before(state) + (1.0 - left_since) * _bending(state)
    relaxed = _row_by_row(state, lambda last, k: left[k] * last + gained[k])
    return values["coefficient"] * _moment(relaxed - at_rest * _bending(state))


def _before(state: BayState) -> Array:
    """Curvature in the row before, zero where a loading sequence begins, shape (K, n_bays, 2)."""
    return np.where(state.begins[:, None, None], 0.0, np.roll(_bending(state), 1, axis=0))


def _row_by_row(state: BayState, left: Callable[[Array, int], Array]) -> Array:
    """What is left in a row, from what was in the row before, zero where a sequence begins; shape (K, n_bays, 2)."""
    found = np.zeros((*state.shape, 2))
    for k, begins in enumerate(state.begins):
        found[k] = left(np.zeros(found.shape[1:]) if begins else found[k - 1], k)
    return found


def _follows(last: Array, change: Array) -> Array:
    """A vector of length one at most that follows a straight way: its point is drawn as by a cord of length one."""
    length = np.linalg.norm(change, axis=-1, keepdims=True)
    along = change / np.maximum(length, 1e-300)
    ahead = np.sum(last * along, axis=-1, keepdims=True)
    across = last - ahead * along
    taut = np.sqrt(np.maximum(1.0 - np.sum(across**2, axis=-1, keepdims=True), 0.0))
    free = np.minimum(length, np.maximum(taut - ahead, 0.0))
    turn, cosine = np.tanh(length - free), ahead + free
    return np.asarray(((cosine + turn) * along + np.sqrt(1.0 - turn**2) * across) / (1.0 + cosine * turn))


def _lost(state: BayState, tendon: int, first: int) -> Array:
    """A moment in all bays from one on against that of a tendon."""
    moment = -state.tension[..., tendon, None] * state.lever[:, tendon]
    moment[:, :first] = 0.0
    return _moment(moment)


def _by_curvature(state: BayState, axes: str) -> Array:
    """A moment in all bays about one axis against the curvature about it; of two axes, about each against the other's.

    That of an added stiffness of one.
    """
    found = np.zeros((*state.shape, COMPONENTS))
    for axis, other in zip(axes, reversed(axes), strict=True):
        found[..., "xyz".index(axis)] = -state.curvature[..., "xyz".index(other)]
    return found


def _by_side(state: BayState, axis: int, sign: float) -> Array:
    """A moment in all bays about an axis against the curvature about it, where that has a sign."""
    found = np.zeros((*state.shape, COMPONENTS))
    found[..., axis] = -sign * np.maximum(sign * state.curvature[..., axis], 0.0)
    return found


def _on_disk(
    state: BayState, factor: Factor, bay: int, along: Callable[[BayState], Array], force: bool
) -> Array:
    """A force on the disk at the end of a bay, or a moment, which passes through all bays below it."""
    found = np.zeros((*state.shape, COMPONENTS))
    vector = factor.value(state)[:, bay, None] * along(state)
    if force:
        found[:, bay, FORCE] = vector
    else:
        found[:, : bay + 1, MOMENT] = np.einsum("kbij,ki->kbj", state.rotation[:, : bay + 1], vector)
    return found


def _displaced(state: BayState, bay: int, power: int) -> Array:
    """A force on the end of a bay along its displacement across the axis, times a power of that."""
    found, across = np.zeros((*state.shape, COMPONENTS)), state.moved[:, bay] * np.array([1.0, 1.0, 0.0])
    found[:, bay, FORCE] = across * np.linalg.norm(across, axis=1, keepdims=True) ** power
    return found


def _against_motion(state: BayState, bay: int) -> Array:
    """A force on the end of a bay against its mean velocity since the row before."""
    found = np.zeros((*state.shape, COMPONENTS))
    passed = np.diff(state.time, prepend=0.0)[:, None]
    moved = np.diff(state.moved[:, bay], axis=0, prepend=0.0)
    moves = (passed > 0.0) & ~state.begins[:, None]
    found[:, bay, FORCE] = -np.divide(moved, passed, out=np.zeros(moved.shape), where=moves)
    return found


def _spread(state: BayState, axis: int) -> Array:
    """A constant force per length along an axis of the world."""
    found = np.zeros((*state.shape, COMPONENTS))
    found[..., FORCE.start + axis] = np.diff(state.edges)
    return found

"""The dictionary of small causes: the listed effects in all their forms and places, and unlisted causes.

Each is a column, or a few, of the derivatives of all readings (`tdcr_fe.identify.screening`). What is perturbed, what
that depends on and where it acts is the kind of a cause (`tdcr_fe.identify.causes`).
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from functools import lru_cache, partial
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from tdcr_fe.effects import Effect, Experiment, Parameter, PlaceEffect
from tdcr_fe.effects.base import Kind, Values
from tdcr_fe.elements import Array
from tdcr_fe.identify.bay_state import BayState
from tdcr_fe.identify.causes import Cause, Change, ChangedDescription, Held, Numbers, ReadingCause, number
from tdcr_fe.identify.input_causes import input_causes
from tdcr_fe.identify.rows import clock_of, possible_starts, progress_along
from tdcr_fe.identify.state_loads import ranges, state_loads
from tdcr_fe.io.measured import MeasuredData
from tdcr_fe.io.readings import Reading
from tdcr_fe.model.backbone import StiffnessPatch
from tdcr_fe.model.checks import ARC_TOLERANCE
from tdcr_fe.model.friction import (
    AngleDependentFriction,
    ForceDependentFriction,
    FrictionCoefficient,
    StribeckFriction,
)
from tdcr_fe.model.loading import Load
from tdcr_fe.model.robot import Robot, Tendon, TightHole
from tdcr_fe.model.routing import MisplacedRouting, PointsRouting
from tdcr_fe.solve.sensitivities.parameters import with_arc_lengths

if TYPE_CHECKING:
    from tdcr_fe.identify.problem import FitProblem
    from tdcr_fe.identify.run import Run


def dictionary(problem: FitProblem, run: Run) -> tuple[Effect, ...]:
    """All candidate causes of a problem.

    Parameters
    ----------
    problem
        With the listed effects in its catalogue.
    run
        That of the declared model.
    """
    experiment, catalogue = problem.experiment, problem.catalogue
    listed = [form for e in catalogue for form in e.forms(experiment)]
    of_places = ((e, e.places(experiment.robot)) for e in catalogue if isinstance(e, PlaceEffect))
    places = [e.at(place, len(every)) for e, every in of_places for place in every]
    assert run.bays is not None
    return (*listed, *places, *unlisted(problem, run.bays))


def unlisted(problem: FitProblem, state: BayState) -> list[Cause]:
    """All unlisted causes."""
    found = [*_along(problem), *_loads_and_base(problem), *_rough_holes(problem)]
    found += [*input_causes(problem, state), *_compressible(problem, state), *_friction_laws(problem, state)]
    found += [*_sensors(problem), *_readings(problem)]
    robot = problem.experiment.robot
    if robot.tendons and not robot.without_disks:
        found += _routings(problem)
        for k in range(len(robot.disks.positions)):
            found += _of_disk(robot, k)
    found += _lengths(robot)
    return [*found, *state_loads(problem, state, clock_of(problem.data))]


# ------------------------------------------------------------------------------------------------ descriptions


class _Profile(NamedTuple):
    """How a quantity may depend on the arc length."""

    name: str  # of a cause with it, after the name of the quantity
    where: str
    numbers: tuple[str, ...]
    value: Callable[[Values, float, Array], Array]  # from the numbers, the null value and arc lengths
    price: float = 0.0  # see `Cause.price`
    # its parts, see `Cause.parts`: of what the bays have, and of what the disks have
    bays: Sequence[_Profile] = ()
    disks: Sequence[_Profile] = ()


def _profiles(robot: Robot) -> Iterator[_Profile]:
    """Linear from the base to the tip, and another value between two disks, in more than one bay but not in all."""
    length, edges = robot.backbone.length, robot.bay_edges.tolist()
    parts = [(i, j + 1) for i, j in ranges(len(edges) - 1) if j > i]

    def linear(numbers: Values, null: float, s: Array) -> Array:
        base, tip = numbers.values()
        return np.asarray(base + (tip - base) * s / length)

    def between(numbers: Values, null: float, s: Array, a: float, b: float) -> Array:
        (there,) = numbers.values()
        return np.where((s > a - ARC_TOLERANCE) & (s < b + ARC_TOLERANCE), there, null)

    def part(a: float, b: float, *parts: Any) -> _Profile:
        where = f"s = {a:.4g} to {b:.4g} m"
        return _Profile(f"({where})", f"from {where}", ("there",), partial(between, a=a, b=b), *parts)

    yield _Profile("along the backbone", "everywhere", ("base", "tip"), linear)
    bays, disks = [part(*bay) for bay in itertools.pairwise(edges)], [part(s, s) for s in edges]
    for i, j in parts:
        yield part(edges[i], edges[j], math.log(len(parts)), bays[i:j], disks[i : j + 1])


#: As `Change`, with a ``profile``.
_Along = Callable[..., Experiment]


def _at(numbers: Iterable[Parameter], places: Sequence[str], at: str = "") -> tuple[Parameter, ...]:
    """Each number at several places; ``at``: what stands before these in its meaning."""
    both = itertools.product(numbers, places)
    return tuple(replace(p, name=f"{p.name}_{x}", meaning=f"{p.meaning} {at}{x}") for p, x in both)


def _along(problem: FitProblem) -> Iterator[Cause]:
    """What depends on the arc length: radius and precurvature of the backbone, and the friction of the holes."""
    robot = problem.experiment.robot
    radius = number("radius", "1", (0.4, 2.5), 1.0, 0.02)
    curvatures = [number(f"kappa_{a}", "1/m", (-20.0, 20.0), 0.0, 0.01 / robot.backbone.length) for a in "xy"]
    friction = _more_friction(robot.tendons)

    def cause(name: str, perturbs: str, profile: _Profile, change: _Along, *each: Parameter) -> Cause:
        numbers, acts = _at(each, profile.numbers), partial(change, profile=profile)
        kind, text = Kind(perturbs, ("place",), profile.where), f"the {perturbs} changes along the backbone"
        found = ChangedDescription(f"{name} {profile.name}", kind, numbers, acts, text, profile.price)
        parts = profile.disks if perturbs == "transmission" else profile.bays
        found.parts = tuple(cause(name, perturbs, part, change, *each) for part in parts)
        return found

    def tapered(experiment: Experiment, values: Values, profile: _Profile) -> Experiment:
        edges = experiment.robot.bay_edges
        # mean of the compliance over each bay, by Gauss's rule
        s = edges[:-1, None] + 0.5 * np.diff(edges)[:, None] * (1.0 + np.array([-1.0, 1.0]) / math.sqrt(3.0))
        factors = 1.0 / np.mean(profile.value(values, 1.0, s) ** -4.0, axis=1)
        each = zip(itertools.pairwise(edges.tolist()), factors.tolist(), strict=True)
        patches = (StiffnessPatch(*bay, factor, factor) for bay, factor in each)
        return experiment.with_backbone(patches=(*experiment.robot.backbone.patches, *patches))

    def bent(experiment: Experiment, values: Values, profile: _Profile) -> Experiment:
        backbone, edges = experiment.robot.backbone, experiment.robot.bay_edges
        middles = 0.5 * (edges[1:] + edges[:-1])
        each = ({n: values[f"kappa_{a}_{n}"] for n in profile.numbers} for a in "xy")
        bends = zip(*(profile.value(numbers, 0.0, middles).tolist() for numbers in each), strict=True)
        bays = itertools.pairwise(edges.tolist())
        patches = (StiffnessPatch(*bay, precurvature=own) for bay, own in zip(bays, bends, strict=True))
        return experiment.with_backbone(patches=(*backbone.patches, *patches))

    def rougher(experiment: Experiment, values: Values, profile: _Profile) -> Experiment:
        holes = [(t, experiment.robot.hole_arc_lengths(t)[1:-1]) for t in experiment.robot.tendons]
        tendons = tuple(_with_friction_at(t, s, profile.value(values, 0.0, s)) for t, s in holes)
        return experiment.with_robot(tendons=tendons)

    for profile in _profiles(robot):
        yield cause("radius", "stiffness", profile, tapered, radius)
        yield cause("precurvature", "precurvature", profile, bent, *curvatures)
        if _has_coefficients(problem):
            yield cause("friction", "transmission", profile, rougher, friction)


def _compressible(problem: FitProblem, state: BayState) -> Iterator[Cause]:
    """A backbone that tendons and weight shorten more than declared, as a coil or a braid does."""
    most = float(np.nanmax(state.tension.sum(axis=-1), initial=0.0))

    def softened(experiment: Experiment, values: Values) -> Experiment:
        more = 1.0 / experiment.robot.backbone.EA + values["compliance"]
        return experiment.with_backbone(axial_stiffness=1.0 / more)

    if most > 0.0:
        span = -0.9 / problem.experiment.robot.backbone.EA, 0.3 / most
        compliance = (number("compliance", "1/N", span, 0.0, 1e-3 / most),)
        text = "the backbone is more, or less, compressible along its axis than declared"
        kind = Kind("stiffness", ("nothing",))
        yield ChangedDescription("axial compliance", kind, compliance, softened, text)


def _has_coefficients(problem: FitProblem) -> bool:
    """Whether there is friction, with constant coefficients."""
    experiment = problem.experiment
    return experiment.model.friction != "none" and not any(t.friction for t in experiment.robot.tendons)


def _more_friction(tendons: Sequence[Tendon]) -> Parameter:
    """A change of friction by which no coefficient falls below zero, where a number would change nothing."""
    largest = max((t.friction_coefficient for t in tendons), default=0.0)
    return number("friction", "1", (-largest, 2.0), 0.0, 0.02)


def _with_friction_at(tendon: Tendon, s: Array, more: Array) -> Tendon:
    """A tendon with coefficients of friction that are larger by so much at holes, shape (n,) both."""
    present = np.full(len(s), tendon.friction_coefficient)
    for hole in tendon.tight_holes:
        if hole.friction_coefficient is not None:
            present[np.abs(s - hole.at) <= ARC_TOLERANCE] = hole.friction_coefficient
    pairs = zip(s.tolist(), np.maximum(present + more, 0.0).tolist(), strict=True)
    return replace(tendon, tight_holes=(*tendon.tight_holes, *(TightHole(x, None, mu) for x, mu in pairs)))


def _rough_holes(problem: FitProblem) -> Iterator[Cause]:
    """Another coefficient of friction at one hole."""
    robot = problem.experiment.robot
    holes = [(t.name, float(s)) for t in robot.tendons for s in robot.hole_arc_lengths(t)[1:-1]]
    friction = _more_friction(robot.tendons)
    for name, s in holes if _has_coefficients(problem) else ():

        def rougher(experiment: Experiment, values: Values, name: str = name, s: float = s) -> Experiment:
            at, more = np.array([s]), np.array([values["friction"]])
            return experiment.with_tendons(lambda t: _with_friction_at(t, at, more) if t.name == name else t)

        where, text, price = f"tendon {name}, s = {s:.4g} m", "one hole is rougher", math.log(len(holes))
        kind = Kind("transmission", ("place",), where)
        yield ChangedDescription(f"friction at a hole ({where})", kind, (friction,), rougher, text, price)


def _friction_laws(problem: FitProblem, state: BayState) -> Iterator[Cause]:
    """A coefficient of friction that changes with the normal force at the hole, as that of an elastic contact.

    Or with the angle by which the tendon turns there; or with the slip rate: towards rest it becomes another one.
    """
    if not _has_coefficients(problem):
        return
    friction = _more_friction(problem.experiment.robot.tendons)
    lengths, curvature = np.diff(state.edges), state.curvature[..., :2]
    bent = np.linalg.norm(curvature, axis=-1) * lengths
    force = 0.5 * float(np.nanmax(state.tension * bent[..., None], initial=0.0))
    if force > 0.0:

        def by_force(mu: float, values: Values) -> FrictionCoefficient:
            return ForceDependentFriction(mu, force, values["exponent"], 0.1 * force)

        exponent = number("exponent", "1", (-1.0, 1.0), 0.0, 0.1)
        yield _friction_law("normal force", "tension", (friction, exponent), by_force, {})

        def by_angle(mu: float, values: Values) -> FrictionCoefficient:
            return AngleDependentFriction(mu, values["slope"])

        slope = number("slope", "1/rad", (-100.0, 100.0), 0.0, 0.02 / float(np.nanmax(bent)))
        yield _friction_law("turning angle", "turning angle", (friction, slope), by_angle, {})
    pulled = np.einsum("b,kbi,bti->kt", lengths, curvature, state.lever)
    pauses = np.diff(state.time, prepend=np.nan)
    pauses[state.begins | ~(pauses > 0.0)] = np.nan
    rates = np.abs(np.diff(pulled, axis=0, prepend=np.nan) / pauses[:, None])
    rates = rates[rates > 0.0]  # NaN is not
    if clock_of(problem.data) == "time" and rates.size:

        def by_rate(mu: float, values: Values) -> FrictionCoefficient:
            return StribeckFriction(max(mu + values["at_rest"], 0.0), mu, values["rate"], 1.0)

        rate = float(np.median(rates))
        span = number("rate", "m/s", (0.01 * rate, 100.0 * rate), rate, 0.2 * rate)
        numbers = friction, replace(friction, name="at_rest", meaning="more at rest"), span
        held = {"rate": [0.2 * rate, rate, 5.0 * rate]}
        yield _friction_law("slip rate", "slip rate", numbers, by_rate, held)


#: The coefficient of friction from the constant one and the values of a cause.
_Law = Callable[[float, Values], FrictionCoefficient]


def _friction_law(what: str, depends: str, numbers: Numbers, law: _Law, held: Held) -> Cause:
    """A law of the coefficient at all holes of all tendons, from the constant one of each."""

    def changed(experiment: Experiment, values: Values) -> Experiment:
        def own(t: Tendon) -> Tendon:
            mu = max(t.friction_coefficient + values["friction"], 0.0)
            return replace(t, friction=law(mu, values), friction_coefficient=0.0)

        return experiment.with_tendons(own)

    kind, text = Kind("transmission", (depends,)), f"the friction changes with the {what}"
    return ChangedDescription(f"friction by {what}", kind, numbers, changed, text, held=held)


def _with_loads(experiment: Experiment, change: Callable[[Sequence[float]], Array]) -> Experiment:
    """With another force and moment of every load in the world frame."""

    def of(load: Load) -> Load:
        if load.frame == "section":
            return load
        (a, b, c), (d, e, f) = (change(x).tolist() for x in (load.force, load.moment))
        return replace(load, force=(a, b, c), moment=(d, e, f))

    steps = tuple(replace(s, loads={n: of(x) for n, x in s.loads.items()}) for s in experiment.steps)
    return replace(experiment, steps=steps)


def _loads_and_base(problem: FitProblem) -> Iterator[Cause]:
    """Loads of another size or direction; a backbone that leaves the base plate at an angle, or a robot that is askew.

    In the frame of the base, gravity and forces then have other directions, and the instrument is turned. Without
    gravity and forces that is a turned frame.
    """
    loads = [x for s in problem.data.steps for x in s.loads.values() if any(x.force) or any(x.moment)]

    def scaled(experiment: Experiment, values: Values) -> Experiment:
        return _with_loads(experiment, lambda x: values["factor"] * np.array(x))

    def redirected(experiment: Experiment, values: Values) -> Experiment:
        return _with_loads(experiment, Rotation.from_rotvec([values[p.name] for p in angles]).apply)

    def askew(experiment: Experiment, values: Values) -> Experiment:
        turn = Rotation.from_rotvec([values["rot_x"], values["rot_y"], 0.0])
        turned = _with_loads(experiment, turn.inv().apply)
        gx, gy, gz = turn.inv().apply(experiment.model.gravity).tolist()
        x, y, z = (Rotation.from_rotvec(experiment.observation.rotation) * turn).as_rotvec().tolist()
        observation = replace(experiment.observation, rotation=(x, y, z))
        return replace(turned, model=replace(experiment.model, gravity=(gx, gy, gz)), observation=observation)

    angles = tuple(number(f"rot_{a}", "rad", (-1.5, 1.5), 0.0, 0.01) for a in "xyz")
    if loads:
        kind, factor = Kind("load", ("nothing",), "all loads"), number("factor", "1", (0.1, 10.0), 1.0, 0.02)
        text = "the loads are off by a factor"
        yield ChangedDescription("gain of the loads", kind, (factor,), scaled, text)
        yield ChangedDescription("loads turned", kind, angles, redirected, "the loads have another direction")
    if loads or any(problem.data.model.gravity):
        kind, text = Kind("base", ("nothing",), "base"), "the backbone leaves the base plate at an angle"
        yield ChangedDescription("base at an angle", kind, angles[:2], askew, text)


# ----------------------------------------------------------------------------------------------------- tendons


#: Where holes are that are elsewhere to another extent at the base plate and at the end of their tendon.
_ENDS = "base", "end"


def _with_holes(
    experiment: Experiment, values: Values, names: Sequence[str], disks: slice = slice(None)
) -> Experiment:
    """With the holes of tendons in some disks elsewhere, the first of which is the base plate."""
    robot, null = experiment.robot, {"factor": 1.0, "angle": 0.0}
    numbers = {
        f"{n}_{end}": values.get(f"{n}_{end}", values.get(n, x)) for n, x in null.items() for end in _ENDS
    }

    def elsewhere(t: Tendon) -> Tendon:
        if t.name not in names:
            return t
        s, holes = robot.hole_arc_lengths(t), robot.holes(t).copy()
        moved = MisplacedRouting(t.routing, **numbers).position(s[disks], float(s[-1]))
        holes[disks] = moved + np.array([values.get("x", 0.0), values.get("y", 0.0)])
        points = tuple((x, y) for x, y in holes.tolist())
        return replace(t, routing=PointsRouting(tuple(s.tolist()), points))

    return experiment.with_tendons(elsewhere)


def _shift(robot: Robot) -> Numbers:
    """A shift of holes in their plane, up to the other side of the backbone: a tendon may be in a wrong hole."""
    offset = max(float(np.max(np.linalg.norm(robot.holes(t), axis=1))) for t in robot.tendons)
    return tuple(number(a, "m", (-2.0 * offset, 2.0 * offset), 0.0, 0.02 * offset) for a in "xy")


def _routings(problem: FitProblem) -> Iterator[Cause]:
    """Holes elsewhere in all disks: of one tendon at another angle and distance, the same along the backbone or not.

    Or of all tendons: at another distance, or off the centre.
    """
    robot = problem.experiment.robot
    numbers = number("factor", "1", (0.3, 3.0), 1.0, 0.02), number("angle", "rad", (-1.5, 1.5), 0.0, 0.02)
    along = _at(numbers, _ENDS, "at the ")
    for name in robot.tendon_names:
        one, text = partial(_with_holes, names=(name,)), f"the holes of tendon {name} are elsewhere"
        for suffix, depends, own in (("", "nothing", numbers), (" along the backbone", "place", along)):
            kind = Kind("routing", (depends,), f"tendon {name}")
            yield ChangedDescription(f"routing of {name}{suffix}", kind, own, one, text)
    if len(robot.tendons) > 1:
        every = partial(_with_holes, names=robot.tendon_names)
        kind = Kind("routing", ("nothing",))
        for label, own, where in (
            ("radius of all holes", numbers[:1], "at another distance"),
            ("disks off their centre", _shift(robot), "off the centre"),
        ):
            text = f"the holes of all tendons are {where}"
            yield ChangedDescription(label, kind, own, every, text)


def _of_disk(robot: Robot, k: int) -> Iterator[Cause]:
    """One hole of a disk, from 0, elsewhere; the disk turned, shifted in its plane, or slipped along the backbone."""
    plane = _shift(robot)
    turn = number("angle", "rad", (-1.5, 1.5), 0.0, 0.02)
    count, edges, s = len(robot.disks.positions), robot.bay_edges, robot.disks.positions[k]
    where = f"disk at s = {s:.4g} m"
    moved = partial(_with_holes, disks=slice(k + 1, k + 2))
    through = [t.name for t in robot.tendons if s <= robot.end(t) + ARC_TOLERANCE]

    def slipped(experiment: Experiment, values: Values) -> Experiment:
        here = experiment.robot.disks.positions[k]
        return _moved_along(experiment, lambda x: x + values["along"] * (abs(x - here) < ARC_TOLERANCE))

    def cause(name: str, numbers: Numbers, change: Change, text: str, choices: int = 1) -> Cause:
        kind, price = Kind("routing", ("place",), where), math.log(choices * count)
        return ChangedDescription(f"{name} ({where})", kind, numbers, change, text, price)

    for name in through:
        one, text = partial(moved, names=(name,)), f"a hole of tendon {name} is elsewhere"
        yield cause(f"hole of {name}", plane, one, text, len(through))
    if len(through) > 1:
        all_holes = partial(moved, names=through)
        yield cause("disk turned", (turn,), all_holes, "a disk is turned about the backbone")
        yield cause("disk off its centre", plane, all_holes, "a disk is off its centre")
    if k < count - 1:
        room = 0.9 * float(min(edges[k + 1] - edges[k], edges[k + 2] - edges[k + 1]))
        # of second order: no small step shows it
        along = (number("along", "m", (-room, room), 0.0, 0.5 * room),)
        slip = cause("disk slipped", along, slipped, "a disk has slipped along the backbone")
        slip.exact_derivatives = False  # the mesh changes
        yield slip


def _moved_along(experiment: Experiment, new: Callable[[float], float]) -> Experiment:
    """With all arc lengths elsewhere, also those of markers."""
    seen = experiment.observation
    markers = tuple(map(new, seen.markers))
    seen = replace(seen, markers=markers, declared=seen.declared or seen.markers)
    return replace(with_arc_lengths(experiment, new), observation=seen)


def _lengths(robot: Robot) -> Iterator[Cause]:
    """A backbone of another length than declared, in all bays or in one; markers are where their disks are."""
    edges, factor = robot.bay_edges, number("factor", "1", (0.5, 2.0), 1.0, 0.01)
    bays = len(edges) - 1

    def stretched(experiment: Experiment, values: Values, ends: tuple[int, int]) -> Experiment:
        start, end = experiment.robot.bay_edges[list(ends)].tolist()
        more = values["factor"] - 1.0
        return _moved_along(experiment, lambda s: s + more * (min(max(s, start), end) - start))

    text = "the backbone is longer, or shorter, than declared, with all its bays"
    acts = partial(stretched, ends=(0, bays))
    yield ChangedDescription("length", Kind("length", ("nothing",)), (factor,), acts, text)
    text = "a bay is longer, or shorter, than declared"
    for ends in itertools.pairwise(range(bays + 1)):
        where = "s = {:.4g} to {:.4g} m".format(*edges[list(ends)])
        kind, acts = Kind("length", ("nothing",), f"from {where}"), partial(stretched, ends=ends)
        yield ChangedDescription(f"length ({where})", kind, (factor,), acts, text, math.log(bays))


# ---------------------------------------------------------------------------------------------------- readings


#: How much of a shift each load step has [1].
Weight = Callable[[MeasuredData], Array]


def _readings(problem: FitProblem) -> Iterator[ReadingCause]:
    """Positions that move along the rows or from some row on, or are seen through a camera."""
    readings, data = problem.readings, problem.data
    if not np.any(readings.is_position):
        return
    length, clock = data.robot.backbone.length, clock_of(data)
    shifts = tuple(number(a, "m", (-length, length), 0.0, 2e-3 * length) for a in "xyz")
    turns = tuple(number(f"rot_{a}", "rad", (-1.0, 1.0), 0.0, 0.01) for a in "xyz")
    markers = sorted({float(data.readings[i].location or 0.0) for i in np.flatnonzero(readings.is_position)})
    groups: dict[float | None, str] = {None: "all markers"}
    if len(markers) > 1:
        groups |= {s: f"the marker at s = {s:.4g} m" for s in markers}

    def after(row: int) -> Weight:
        return lambda d: (np.array(d.step_ids) >= row).astype(float)

    times: list[tuple[str, str, str, Weight, float]] = []
    if clock:
        times.append(("drift", "", clock, lambda d: progress_along(d.steps), 1.0))
    for first in (data.step_ids[k] for k in possible_starts(data)):
        times.append(("jump", f", from row {first} on", "row", after(first), float(len(data.steps))))
    yield from _camera(length)
    for (marker, who), (verb, since, depends, weight, choices) in itertools.product(groups.items(), times):
        kind = Kind("reading", (depends,), f"{who}{since}")
        price = math.log(choices * (1 if marker is None else len(markers)))
        forms = [(verb, f"readings {verb}", shifts, [_shifted])]
        if marker is None:
            both = f"{verb} and turn"
            forms.append((both, f"readings {both}", shifts + turns, [_shifted, _turned]))
        else:
            text = f"a marker {verb}s on its section"
            forms.append((f"{verb} on the section", text, shifts, [_on_section]))
        for name, text, numbers, moves in forms:
            shapes = tuple(partial(m, axis=i, weight=weight, marker=marker) for m in moves for i in range(3))
            yield ReadingCause(f"{name} of {who}{since}", kind, numbers, shapes, text, price)


def _sensors(problem: FitProblem) -> Iterator[ReadingCause]:
    """Sensors other than markers that read too much by a factor, a constant or a drift: all of a kind, or one."""
    clock = clock_of(problem.data)
    of_each: dict[str, list[Reading]] = {}
    for r in problem.data.readings:
        for name in _sensor_names(r):
            of_each.setdefault(name, []).append(r)

    def drifting(problem: FitProblem, run: Run) -> Array:
        return progress_along(problem.data.steps)[problem.readings.step]

    for name, own in of_each.items():
        size = max(1e-300, *(abs(r.value) for r in own))
        scale = number("scale", "1", (-0.5, 0.5), 0.0, 0.01)
        zero = number("offset", own[0].channel.unit, (-size, size), 0.0, 0.02 * size)
        drift, price = replace(zero, name="drift", meaning="drift"), math.log(len(of_each))
        for p, by, depends, change in (
            (scale, "factor", "nothing", lambda problem, run: _predicted(problem, run)[0]),
            (zero, "constant", "nothing", lambda problem, run: np.ones(problem.count)),
            (drift, "drift", clock, drifting),
        ):
            kind, shape = Kind("reading", (depends,), name), partial(_of_sensor, name=name, change=change)
            text = f"{name} is read too large or too small by a {by}"
            if depends:
                yield ReadingCause(f"{p.name} of the readings of {name}", kind, (p,), (shape,), text, price)


def _sensor_names(r: Reading) -> tuple[str, ...]:
    """Names of the kind of a reading's sensor, and of the sensor; none for a marker."""
    if r.channel.family == "position":
        return ()
    at = f"{r.location:.4g} m" if isinstance(r.location, float) else r.location
    return (r.channel.family, f"{r.quantity} at {at}") if at else (r.channel.family,)


def _of_sensor(problem: FitProblem, run: Run, name: str, change: Callable[[FitProblem, Run], Array]) -> Array:
    """A change of the readings of one sensor or of all of a kind, shape (n,)."""
    own = np.array([name in _sensor_names(r) for r in problem.data.readings])
    return np.where(own, change(problem, run), 0.0)


def _camera(length: float) -> Iterator[ReadingCause]:
    """Scale, perspective and distortion of the positions, along every axis; axes that are not at right angles."""
    kind, scale = Kind("reading", ("position",)), number("scale", "1", (-0.5, 0.5), 0.0, 0.01)
    slope = number("slope", "1/m", (-0.5 / length, 0.5 / length), 0.0, 0.01 / length)
    radial = number("radial", "1/m^2", (-2.0 / length**2, 2.0 / length**2), 0.0, 0.01 / length**2)
    text = "positions are read too large or too small by a factor"
    yield ReadingCause("scale of the positions", kind, (scale,), (partial(_scaled, axis=-1),), text)
    for axis, a in enumerate("xyz"):
        across = partial(_scaled, axis=axis)
        shapes = across, partial(across, power=1)
        text = f"a camera looks along {a}: what is nearer is larger"
        yield ReadingCause(f"perspective along {a}", kind, (scale, slope), shapes, text)
        text = f"a camera looks along {a}, and its lens distorts: what is farther from its axis is larger"
        shapes = across, partial(_distorted, axis=axis)
        yield ReadingCause(f"lens distortion along {a}", kind, (scale, radial), shapes, text)
    for (into, a), (of, b) in itertools.product(enumerate("xyz"), repeat=2):
        name, text = f"scale of positions along {a}", f"positions along {a} are off by a factor"
        if a != b:
            name, text = f"share of position {b} in {a}", f"the axes {a} and {b} are not at right angles"
        shape, price = partial(_shared, into=into, of=of), math.log(9.0)
        yield ReadingCause(name, kind, (scale,), (shape,), text, price)


def _shared(problem: FitProblem, run: Run, into: int, of: int) -> Array:
    """Positions along one axis, in the readings of one."""
    r, (_, by_marker) = problem.readings, _predicted(problem, run)
    return np.where(r.is_position & (r.axes == into), by_marker[r.markers, of], 0.0)


def _shifted(problem: FitProblem, run: Run, axis: int, weight: Weight, marker: float | None) -> Array:
    """A shift of all markers, or of one, along an axis of the world."""
    return _weighted(problem, np.eye(3)[axis][problem.readings.axes], weight, marker)


def _turned(problem: FitProblem, run: Run, axis: int, weight: Weight, marker: float | None) -> Array:
    """A turn of all markers about an axis of the world."""
    r, (_, by_marker) = problem.readings, _predicted(problem, run)
    turned = np.cross(np.eye(3)[axis], by_marker[:, :3])
    return _weighted(problem, turned[r.markers, r.axes], weight, marker)


def _on_section(problem: FitProblem, run: Run, axis: int, weight: Weight, marker: float | None) -> Array:
    """A shift of one marker along an axis of its section."""
    assert marker is not None
    turned = run.rotations[:, int(np.argmin(np.abs(run.s - marker))), :, axis]
    return _weighted(problem, turned[problem.readings.step, problem.readings.axes], weight, marker)


def _weighted(problem: FitProblem, shift: Array, weight: Weight, marker: float | None) -> Array:
    """A shift of the positions of all markers, or of one, with its weight in every load step, shape (n,)."""
    own = np.array([marker is None or r.location == marker for r in problem.data.readings])
    shift = shift * weight(problem.data)[problem.readings.step]
    return np.where(own & problem.readings.is_position, shift, 0.0)


@lru_cache(maxsize=1)  # asked for by many causes one after the other
def _predicted(problem: FitProblem, run: Run) -> tuple[Array, Array]:
    """Predicted readings, shape (n,); and positions by marker and axis, shape (n_markers, 4), the rest in the last."""
    readings = problem.readings
    values = readings.read(run, problem.experiment)
    by_marker = np.zeros((int(np.max(readings.markers)) + 1, 4))
    by_marker[readings.markers, readings.axes] = values
    return values, by_marker


def _scaled(problem: FitProblem, run: Run, axis: int, power: int = 0) -> Array:
    """Positions across an axis times a power of that along it; all positions where the axis is -1."""
    r, (values, by_marker) = problem.readings, _predicted(problem, run)
    return np.where(r.is_position & (r.axes != axis), values * by_marker[r.markers, axis] ** power, 0.0)


def _distorted(problem: FitProblem, run: Run, axis: int) -> Array:
    """Positions across an axis times the square of their distance from it."""
    r, (values, by_marker) = problem.readings, _predicted(problem, run)
    square = np.sum(np.delete(by_marker[:, :3], axis, axis=1) ** 2, axis=1)[r.markers]
    return np.where(r.is_position & (r.axes != axis), values * square, 0.0)

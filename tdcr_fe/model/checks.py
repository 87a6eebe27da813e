"""Conditions between the fields of a description, checked for files and for Python objects.

The bounds of a single field are its annotations, see `tdcr_fe.model.schema`.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from functools import lru_cache
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from tdcr_fe.model.messages import join, meant, shown
from tdcr_fe.model.routing import hole_count_text

if TYPE_CHECKING:
    from tdcr_fe.model.backbone import Backbone
    from tdcr_fe.model.loading import LoadStep, Model
    from tdcr_fe.model.robot import Disks, Robot, SideSpring, Tendon

#: Arc lengths are the same within this distance [m].
ARC_TOLERANCE = 1e-6
#: Memory that a model may need [bytes].
MEMORY_LIMIT = 4e9
#: Matrices of the size of the tangent that a run holds at most, and further ones for each tendon; as measured [1].
MATRICES, MATRICES_OF_A_TENDON = 7.0, 2.3
#: Strain up to which the stress of a nonlinear material must grow, in tension and compression [1].
LEAST_NONLINEAR_STRAIN = 0.01


class Contradiction(NamedTuple):
    """Values that do not fit together.

    Attributes
    ----------
    key : str
        Dotted, as in the files.
    value : str
        What was given, as text.
    allowed : str
        What is allowed instead.
    """

    key: str
    value: str
    allowed: str


def backbone_contradictions(backbone: Backbone) -> Iterator[Contradiction]:
    """Tapers and patches off the backbone, and laws that exclude each other."""
    if backbone.taper:
        yield from _taper_contradictions(backbone)
    if (law := backbone.nonlinear) is not None:
        for n in ("superelastic", "creep_rate"):
            if getattr(backbone, n):
                text = f"cannot be combined with {n}; leave one of them out"
                yield Contradiction("backbone.nonlinear", "given", text)
        if law.largest_strain < LEAST_NONLINEAR_STRAIN:
            text = f"the stress must grow up to a strain of {LEAST_NONLINEAR_STRAIN:g}; it falls from "
            given = f"quadratic {law.quadratic:g}, cubic {law.cubic:g}"
            yield Contradiction("backbone.nonlinear", given, f"{text}{law.largest_strain:.3g} on")
    for i, patch in enumerate(backbone.patches):
        key = f"backbone.patches[{i}].end"
        yield from _beyond(key, patch.end, backbone.length)
        if patch.end <= patch.start:
            yield Contradiction(key, f"{patch.end:.9g}", f"must be above start, which is {patch.start:.9g} m")


def _beyond(key: str, at: float, length: float) -> Iterator[Contradiction]:
    """An arc length beyond the tip [m]."""
    if at > length + ARC_TOLERANCE:
        yield Contradiction(key, f"{at:.9g}", f"beyond the tip; at most {length:.9g} m, backbone.length")


def _taper_contradictions(backbone: Backbone) -> Iterator[Contradiction]:
    """A taper that does not lead from the base to the tip."""
    s, radius = np.array(backbone.taper, dtype=float).T
    text = ""
    ascends = len(s) > 1 and s[0] == 0.0 and bool(np.all(np.diff(s) > ARC_TOLERANCE))
    if not ascends or abs(s[-1] - backbone.length) > ARC_TOLERANCE or not np.all(radius > 0.0):
        text = f"from 0 to the length, {backbone.length:g} m, with radii above 0"
        text = f"pairs of arc length and radius [m] must ascend {text}"
    elif radius[0] != backbone.radius:
        text = f"must begin with the radius at the base, {backbone.radius:g} m"
    if text:
        yield Contradiction("backbone.radius", _short([list(pair) for pair in backbone.taper]), text)


def disk_contradictions(disks: Disks, length: float) -> Iterator[Contradiction]:
    """What is wrong with the disks on a backbone of that length [m]."""
    s = np.asarray(disks.positions, dtype=float)
    if not s.size:
        for name in ("mass", "thickness"):
            if (value := getattr(disks, name)) > 0.0:
                yield Contradiction(f"disks.{name}", f"{value:g}", "there are no disks; leave it out")
    elif np.any(np.diff(s) <= ARC_TOLERANCE) or s[0] <= ARC_TOLERANCE:
        text = f"must ascend from above 0 to at most the length, {length:g} m, each apart from the next"
        yield Contradiction("disks.positions", _short(disks.positions), text)
    else:
        yield from _beyond(f"disks.positions[{s.size - 1}]", float(s[-1]), length)
        limit = min([2.0 * s[0], *np.diff(s)])
        if disks.thickness > 0.0 and disks.thickness >= limit:
            text = f"must leave flexible backbone between the disks, so less than {limit:g} m"
            yield Contradiction("disks.thickness", f"{disks.thickness:g}", text)


def spring_contradictions(springs: Sequence[SideSpring], length: float) -> Iterator[Contradiction]:
    """Springs that are not on a backbone of that length [m]."""
    for i, spring in enumerate(springs):
        yield from _beyond(f"springs[{i}].at", spring.at, length)


def name_contradictions(names: Sequence[str]) -> Iterator[Contradiction]:
    """Names of tendons that are used more than once."""
    for name, last in {name: i for i, name in enumerate(names)}.items():
        if (count := names.count(name)) > 1:
            text = f"the name is used {count} times; names must differ"
            yield Contradiction(f"tendons[{last}].name", shown(name), text)


def tendon_contradictions(index: int, tendon: Tendon, disks: Disks, length: float) -> Iterator[Contradiction]:
    """What is wrong with one tendon, given valid disks on a backbone of that length [m]."""
    key = f"tendons[{index}]"
    if tendon.friction is not None and tendon.friction_coefficient != 0.0:
        text = f"must be left out: the friction law {tendon.friction.kind!r} gives the coefficient"
        yield Contradiction(f"{key}.friction_coefficient", f"{tendon.friction_coefficient:g}", text)
    if tendon.pretension > 0.0 and tendon.axial_stiffness is None:
        text = "needs an elastic tendon; give its axial_stiffness [N], or leave pretension out"
        yield Contradiction(f"{key}.pretension", f"{tendon.pretension:g}", text)
    if disks.positions and tendon.clearance >= disks.radius:
        text = f"must be smaller than the disks, which have the radius {disks.radius:g} m"
        yield Contradiction(f"{key}.clearance", f"{tendon.clearance:g}", text)
    beyond = [*end_contradictions(index, tendon.end, disks, length)]
    yield from beyond
    end = length if tendon.end is None else tendon.end
    if not disks.positions:
        yield from _course_contradictions(key, tendon, end)
    elif not beyond:
        yield from _hole_contradictions(key, tendon, disks, end)


def end_contradictions(index: int, end: float | None, disks: Disks, length: float) -> Iterator[Contradiction]:
    """An anchor that is at no disk, or beyond the tip of a robot without disks [m]; None is the tip."""
    key, at = f"tendons[{index}].end", length if end is None else end
    if not disks.positions:
        yield from _beyond(key, at, length)
        return
    near = sorted(disks.positions, key=lambda s: abs(s - at))[:2]
    if abs(near[0] - at) > ARC_TOLERANCE:
        value = f"{at:.9g}" if end is not None else f"not given, so the tip at backbone.length = {at:.9g}"
        nearest = " and ".join(f"{x:.9g}" for x in sorted(near))
        are = "disks are" if len(near) > 1 else "disk is"
        yield Contradiction(key, value, f"no disk is there; the nearest {are} at {nearest} m")


@lru_cache(maxsize=256)  # a search makes many robots with the same tendons
def _hole_contradictions(key: str, tendon: Tendon, disks: Disks, end: float) -> list[Contradiction]:
    """What is wrong with the holes of a tendon that is anchored at a disk."""
    s, arcs = np.asarray(disks.positions), tendon.routing.fixed_arc_lengths
    at = np.concatenate(([0.0], s[s <= end + ARC_TOLERANCE]))
    if arcs is not None and (len(arcs) != len(at) or np.max(np.abs(np.array(arcs) - at)) > ARC_TOLERANCE):
        return [Contradiction(f"{key}.holes", *hole_count_text(len(arcs), len(at)))]
    found = []
    for i, tight in enumerate(tendon.tight_holes):
        if not np.min(np.abs(at[1:-1] - tight.at), initial=math.inf) <= ARC_TOLERANCE:
            text = f"must be at a disk before the anchor: one of {_short(at[1:-1].tolist())} m"
            found.append(Contradiction(f"{key}.tight_holes[{i}].at", f"{tight.at:.9g}", text))
    with np.errstate(all="ignore"):  # a hole at infinity is outside, too
        distance = np.linalg.norm(tendon.routing.position(at, end), axis=1)
    outside = np.flatnonzero(~(distance <= disks.radius * (1.0 + 1e-9)))
    if outside.size:
        k = int(outside[0])
        name, hole = tendon.routing.deciding_field(k), f"disk {k}" if k else "base plate"
        offset = getattr(tendon.routing, name, None)
        given = f"{offset:g}" if offset is not None else f"{distance[k]:g} m from the backbone"
        text = f"the hole in the {hole} must not lie outside the disk of radius {disks.radius:g} m"
        found.append(Contradiction(f"{key}.{name}", given, text))
    return found


def _course_contradictions(key: str, tendon: Tendon, end: float) -> Iterator[Contradiction]:
    """What is wrong with a tendon that follows a backbone without disks to an arc length [m]."""
    arcs = tendon.routing.fixed_arc_lengths
    if arcs is not None and (abs(arcs[0]) > ARC_TOLERANCE or abs(arcs[-1] - end) > ARC_TOLERANCE):
        text = f"points must lead from the base plate to the tendon's end, 0 to {end:.9g} m"
        yield Contradiction(f"{key}.holes", f"{arcs[0]:.9g} to {arcs[-1]:.9g} m", text)
    text = "a robot without disks has no holes; give [disks], which may be massless, or leave it out"
    for name in ("clearance", "tight_holes"):
        if getattr(tendon, name):
            yield Contradiction(f"{key}.{name}", "given", text)


def robot_contradictions(robot: Robot) -> Iterator[Contradiction]:
    """Every contradiction between the parts of a robot."""
    length = robot.backbone.length
    yield from backbone_contradictions(robot.backbone)
    on_disks = [*disk_contradictions(robot.disks, length)]
    yield from on_disks
    yield from name_contradictions(robot.tendon_names)
    yield from spring_contradictions(robot.springs, length)
    if not any(c.key.startswith("disks.positions") for c in on_disks):
        for i, tendon in enumerate(robot.tendons):
            yield from tendon_contradictions(i, tendon, robot.disks, length)


def course_contradictions(robot: Robot, model: Model) -> list[Contradiction]:
    """Tendons that should run straight in a robot without disks, or follow a backbone whose base gives way."""
    follows, text = model.tendon_path == "continuous", ""
    if follows and robot.tendons and robot.base_stiffness is not None:
        text = (
            "tendons that follow the backbone pass no base that gives way (base_stiffness, or the effect "
            'base_compliance); must be "straight", or leave base_stiffness out'
        )
    elif robot.without_disks and robot.tendons and not follows:
        text = (
            'a robot without disks has no holes, its tendons follow the backbone; must be "continuous", with '
            'friction = "none". For friction along the tendons give massless [disks] as guides'
        )
    return [Contradiction("model.tendon_path", shown(model.tendon_path), text)] if text else []


def step_contradictions(
    index: int, step: LoadStep, names: Sequence[str] | None, length: float | None, tendons: Sequence[Tendon]
) -> Iterator[Contradiction]:
    """What is wrong with one load step of a robot.

    Parameters
    ----------
    index, step
        Number of the step, from 0, and the step.
    names
        Tendons of the robot; None where they are not known.
    length
        Length of the backbone [m]; None where it is not known.
    tendons
        Tendons that are known.
    """
    key = f"steps[{index}]"
    given: dict[str, str] = {}
    known = {tendon.name: tendon for tendon in tendons}
    for drive, values in step.inputs():
        for name, value in values.items():
            text = ""
            if names is not None and name not in names:
                there = ", ".join(dict.fromkeys(names)) or "none"
                text = f"unknown tendon{meant(name, names)}; the robot has {there}"
            elif name in given:
                text = f"tendon {name} has a {given[name]} in the same step; exactly one is allowed"
            elif name in known:
                text = drive.obstacle(known[name])
            if text:
                yield Contradiction(join(key, drive.inputs, name), shown(value), text)
            given[name] = drive.label
    for name, load in step.loads.items():
        if length is not None and load.at > length + ARC_TOLERANCE:
            text = f"lies beyond the tip; must be an arc length from 0 to {length:g} m"
            yield Contradiction(join(key, "loads", name, "at"), shown(load.at), text)


def size_contradictions(robot: Robot, model: Model, steps: int = 1) -> list[Contradiction]:
    """A mesh whose dense tangent and its factors, or results of all load steps that exceed `MEMORY_LIMIT`.

    Matrices of ``6 (elements + 1)`` unknowns are counted, `MATRICES` and more for each tendon, and 500 bytes a node and
    step for the results and their tables. Elements are those of the first mesh.

    Parameters
    ----------
    robot, model
        Description.
    steps
        Number of load steps.
    """
    given, disks, memory = model.elements_per_bay, len(robot.bay_ends), f"{MEMORY_LIMIT / 1e9:g} GB"
    if isinstance(given, tuple) and len(given) != disks + 1:
        text = "numbers are needed: one for every bay, and one for the stretch beyond the last disk"
        return [Contradiction("model.elements_per_bay", f"{len(given)} numbers", f"{disks + 1} {text}")]
    elements = sum(given) if isinstance(given, tuple) else disks * (1 if given == "auto" else given)
    matrices = MATRICES + MATRICES_OF_A_TENDON * len(robot.tendons)
    most = int(math.sqrt(MEMORY_LIMIT / (8.0 * matrices)) / 6) - 1
    limit = int(MEMORY_LIMIT / (500 * (elements + 1)))
    if elements > most:
        key, value = ("disks", f"{disks} disks") if disks > most else ("model.elements_per_bay", shown(given))
        text = f"the mesh has at least {elements} elements; at most {most} fit into {memory}"
        return [Contradiction(key, value, text)]
    if steps > limit:
        text = f"at most {limit} steps with {elements + 1} nodes fit into {memory}"
        return [Contradiction("steps", f"{steps} steps", text)]
    return []


def time_contradictions(times: Sequence[float | None]) -> Iterator[Contradiction]:
    """Times of the load steps that run backwards; None where a step has none."""
    last = 0.0
    for i, time in enumerate(times):
        if time is not None and time < last:
            text = f"must not be earlier than in the step before, {last:g} s"
            yield Contradiction(f"steps[{i}].time", shown(time), text)
        last = max(last, time or 0.0)


def _short(values: Sequence[Any], keep: int = 6) -> str:
    """A list as text, its middle left out where it is long."""
    texts = [_short(v) if isinstance(v, list) else f"{v:g}" for v in values]
    if len(texts) > keep:
        texts = [*texts[: keep - 2], "...", texts[-1]]
    return "[" + ", ".join(texts) + "]"

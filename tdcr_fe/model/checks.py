"""Conditions between the fields of a description, checked for files and for Python objects.

The bounds of a single field are its annotations, see `tdcr_fe.model.schema`.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from tdcr_fe.model.messages import join, meant, shown
from tdcr_fe.model.routing import hole_count_text

if TYPE_CHECKING:
    from tdcr_fe.model.backbone import Backbone
    from tdcr_fe.model.loading import Model
    from tdcr_fe.model.robot import Disks, Robot, SideSpring
    from tdcr_fe.model.tendon import Tendon

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


def backbone_contradictions(backbone: Backbone) -> list[Contradiction]:
    """Stiffnesses that overflow or vanish, and patches that do not lie on the backbone."""
    found: list[Contradiction] = []
    overrides = ("bending_stiffness", "torsional_stiffness", "axial_stiffness", "shear_stiffness")
    for name, override in zip(("EI", "GJ", "EA", "GA"), overrides, strict=True):
        source = override if getattr(backbone, override) is not None else "radius"
        try:
            value = float(getattr(backbone, name))
        except OverflowError:
            value = math.inf
        if not 0.0 < value < math.inf and not any(c.key == f"backbone.{source}" for c in found):
            given = f"{getattr(backbone, source):g}"
            sentence = f"must give a stiffness {name} that is positive and finite, not {value:g}"
            found.append(Contradiction(f"backbone.{source}", given, sentence))
    found += _taper_contradictions(backbone)
    found += _material_contradictions(backbone)
    for i, patch in enumerate(backbone.patches):
        key = f"backbone.patches[{i}].end"
        beyond = _beyond(key, patch.end, backbone.length)
        if not beyond and patch.end <= patch.start:
            sentence = f"must be above start, which is {patch.start:.9g} m"
            beyond = [Contradiction(key, f"{patch.end:.9g}", sentence)]
        found += beyond
    return found


def _beyond(key: str, at: float, length: float) -> list[Contradiction]:
    """An arc length beyond the tip [m]."""
    inside = at <= length + ARC_TOLERANCE
    return [] if inside else [Contradiction(key, f"{at:.9g}", f"beyond the tip; at most {length:.9g} m")]


def _taper_contradictions(backbone: Backbone) -> list[Contradiction]:
    """A taper that does not lead from the base to the tip."""
    if not backbone.taper:
        return []
    s, radius = np.array(backbone.taper, dtype=float).T
    shape = _short([list(pair) for pair in backbone.taper])
    sound = len(s) > 1 and s[0] == 0.0 and bool(np.all(np.diff(s) > ARC_TOLERANCE))
    if not sound or abs(s[-1] - backbone.length) > ARC_TOLERANCE or not np.all(radius > 0.0):
        sentence = (
            f"pairs of arc length and radius [m] must ascend from 0 to the length, {backbone.length:g} m, with radii "
            "above 0"
        )
        return [Contradiction("backbone.radius", shape, sentence)]
    if radius[0] != backbone.radius:
        sentence = f"must begin with the radius at the base, {backbone.radius:g} m"
        return [Contradiction("backbone.radius", shape, sentence)]
    return []


def _material_contradictions(backbone: Backbone) -> list[Contradiction]:
    """A nonlinear material beside another law, or one whose stress falls at small strains."""
    law = backbone.nonlinear
    if law is None:
        return []
    others = [n for n in ("superelastic", "creep_rate") if getattr(backbone, n)]
    found = [
        Contradiction("backbone.nonlinear", "given", f"cannot be combined with {n}; leave one of them out")
        for n in others
    ]
    if law.largest_strain < LEAST_NONLINEAR_STRAIN:
        given = f"quadratic {law.quadratic:g}, cubic {law.cubic:g}"
        sentence = (
            f"the stress must grow up to a strain of {LEAST_NONLINEAR_STRAIN:g}; it falls from "
            f"{law.largest_strain:.3g} on"
        )
        found.append(Contradiction("backbone.nonlinear", given, sentence))
    return found


def disk_contradictions(disks: Disks, length: float) -> list[Contradiction]:
    """What is wrong with the disks on a backbone of that length [m]."""
    s = np.asarray(disks.positions, dtype=float)
    if not s.size:
        return [
            Contradiction(f"disks.{name}", f"{getattr(disks, name):g}", "there are no disks; leave it out")
            for name in ("mass", "thickness")
            if getattr(disks, name) > 0.0
        ]
    if np.any(np.diff(s) <= ARC_TOLERANCE) or s[0] <= ARC_TOLERANCE:
        return [
            Contradiction(
                "disks.positions",
                f"{_short(disks.positions)}",
                f"must ascend from above 0 to at most the length, {length:g} m, each apart from the next",
            )
        ]
    found = _beyond(f"disks.positions[{s.size - 1}]", float(s[-1]), length)
    if disks.thickness > 0.0:
        limit = min([2.0 * s[0], *np.diff(s)])
        if disks.thickness >= limit:
            sentence = f"must leave flexible backbone between the disks, so less than {limit:g} m"
            found.append(Contradiction("disks.thickness", f"{disks.thickness:g}", sentence))
    return found


def spring_contradictions(springs: Sequence[SideSpring], length: float) -> list[Contradiction]:
    """Springs that are not on a backbone of that length [m]."""
    return [c for i, spring in enumerate(springs) for c in _beyond(f"springs[{i}].at", spring.at, length)]


def name_contradictions(names: Sequence[str]) -> list[Contradiction]:
    """Names of tendons that are used more than once."""
    return [
        Contradiction(
            f"tendons[{len(names) - 1 - list(reversed(names)).index(name)}].name",
            f"{name!r}",
            f"the name is used {count} times; names must differ",
        )
        for name, count in Counter(names).items()
        if count > 1
    ]


def tendon_contradictions(index: int, tendon: Tendon, disks: Disks, length: float) -> list[Contradiction]:
    """What is wrong with one tendon, given valid disks on a backbone of that length [m]."""
    key = f"tendons[{index}]"
    found = []
    if tendon.friction is not None and tendon.friction_coefficient != 0.0:
        sentence = (
            f"must be left out beside the friction law {tendon.friction.kind!r}, which gives the coefficient"
        )
        value = f"{tendon.friction_coefficient:g}"
        found.append(Contradiction(f"{key}.friction_coefficient", value, sentence))
    if tendon.pretension > 0.0 and tendon.axial_stiffness is None:
        sentence = "needs an elastic tendon; give its axial_stiffness [N], or leave pretension out"
        found.append(Contradiction(f"{key}.pretension", f"{tendon.pretension:g}", sentence))
    if disks.positions and tendon.clearance >= disks.radius:
        sentence = f"must be smaller than the disks, which have the radius {disks.radius:g} m"
        found.append(Contradiction(f"{key}.clearance", f"{tendon.clearance:g}", sentence))
    s = np.asarray(disks.positions, dtype=float)
    end = length if tendon.end is None else tendon.end
    if not s.size:
        return found + _course_contradictions(key, tendon, end, length)
    if not np.min(np.abs(s - end)) <= ARC_TOLERANCE:
        near = np.sort(s[np.argsort(np.abs(s - end))[:2]])
        value = f"{end:.9g}" if tendon.end is not None else f"not given, so the tip at {end:.9g}"
        nearest = " and ".join(f"{x:.9g}" for x in near)
        are = "disks are" if near.size > 1 else "disk is"
        found.append(
            Contradiction(f"{key}.end", value, f"no disk is there; the nearest {are} at {nearest} m")
        )
        end = float(s[np.argmin(np.abs(s - end))])
        if tendon.routing.fixed_arc_lengths is not None:
            return found
    holes_at = np.concatenate(([0.0], s[s <= end + ARC_TOLERANCE]))
    arcs = tendon.routing.fixed_arc_lengths
    if arcs is not None and (
        len(arcs) != len(holes_at) or np.max(np.abs(np.asarray(arcs) - holes_at)) > ARC_TOLERANCE
    ):
        return [*found, Contradiction(f"{key}.holes", *hole_count_text(len(arcs), len(holes_at)))]
    for i, tight in enumerate(tendon.tight_holes):
        if not np.min(np.abs(holes_at[1:-1] - tight.at), initial=math.inf) <= ARC_TOLERANCE:
            inner = f"must be at a disk before the anchor: one of {_short(holes_at[1:-1].tolist())} m"
            found.append(Contradiction(f"{key}.tight_holes[{i}].at", f"{tight.at:.9g}", inner))
    with np.errstate(all="ignore"):  # a hole at infinity is outside, too
        distance = np.linalg.norm(tendon.routing.position(holes_at, end), axis=1)
    outside = np.flatnonzero(~(distance <= disks.radius * (1.0 + 1e-9)))
    if outside.size:
        k = int(outside[0])
        hole = "base plate" if k == 0 else f"disk {k}"
        name = tendon.routing.deciding_field(k)
        offset = getattr(tendon.routing, name, None)
        found.append(
            Contradiction(
                f"{key}.{name}",
                f"{offset:g}" if offset is not None else f"{distance[k]:g} m from the backbone",
                f"the hole in the {hole} must not lie outside the disk of radius {disks.radius:g} m",
            )
        )
    return found


def _course_contradictions(key: str, tendon: Tendon, end: float, length: float) -> list[Contradiction]:
    """What is wrong with a tendon that follows a backbone without disks to an arc length [m]."""
    found = _beyond(f"{key}.end", end, length)
    arcs = tendon.routing.fixed_arc_lengths
    if arcs is not None and (abs(arcs[0]) > ARC_TOLERANCE or abs(arcs[-1] - end) > ARC_TOLERANCE):
        sentence = f"points must lead from the base plate to the tendon's end, 0 to {end:.9g} m"
        found.append(Contradiction(f"{key}.holes", f"{arcs[0]:.9g} to {arcs[-1]:.9g} m", sentence))
    of_holes = {"clearance": tendon.clearance > 0.0, "tight_holes": bool(tendon.tight_holes)}
    sentence = "a robot without disks has no holes; give [disks], which may be massless, or leave it out"
    found += [Contradiction(f"{key}.{name}", "given", sentence) for name, there in of_holes.items() if there]
    return found


def robot_contradictions(robot: Robot) -> list[Contradiction]:
    """Every contradiction between the parts of a robot."""
    found = backbone_contradictions(robot.backbone)
    on_disks = disk_contradictions(robot.disks, robot.backbone.length)
    found += on_disks
    found += name_contradictions(robot.tendon_names)
    found += spring_contradictions(robot.springs, robot.backbone.length)
    if not any(c.key.startswith("disks.positions") for c in on_disks):
        for i, tendon in enumerate(robot.tendons):
            found += tendon_contradictions(i, tendon, robot.disks, robot.backbone.length)
    return found


def model_contradictions(tendon_path: Any, friction: Any) -> list[Contradiction]:
    """The classical model with friction, which it does not have."""
    if tendon_path != "continuous" or friction == "none":
        return []
    sentence = (
        'tendon_path = "continuous" is the classical model, which has no friction; set friction = "none"'
    )
    return [Contradiction("model.friction", shown(friction), sentence)]


def course_contradictions(robot: Robot, model: Model) -> list[Contradiction]:
    """Tendons that should run straight in a robot without disks, or follow a backbone whose base gives way."""
    if model.tendon_path == "continuous" and robot.tendons and robot.base_stiffness is not None:
        sentence = (
            "tendons that follow the backbone pass no base that gives way (base_stiffness, or the effect "
            'base_compliance); must be "straight", or leave base_stiffness out'
        )
        return [Contradiction("model.tendon_path", shown(model.tendon_path), sentence)]
    if not robot.without_disks or not robot.tendons or model.tendon_path == "continuous":
        return []
    sentence = (
        'a robot without disks has no holes, its tendons follow the backbone; must be "continuous", with '
        'friction = "none". For friction along the tendons give massless [disks] as guides'
    )
    return [Contradiction("model.tendon_path", shown(model.tendon_path), sentence)]


def step_contradictions(
    index: int,
    tensions: Mapping[str, Any],
    displacements: Mapping[str, Any],
    loads: Mapping[str, Any],
    names: Sequence[str] | None,
    length: float | None,
) -> list[Contradiction]:
    """What is wrong with one load step of a robot.

    Parameters
    ----------
    index
        Of the step, from 0.
    tensions, displacements
        By tendon.
    loads
        Arc length of each load [m], by its name.
    names
        Tendons of the robot; None where they are not known.
    length
        Of the backbone [m]; None where it is not known.
    """
    key = f"steps[{index}]"
    found = []
    for kind, values in (("tensions", tensions), ("displacements", displacements)):
        for name, value in values.items():
            if names is not None and name not in names:
                there = ", ".join(dict.fromkeys(names)) or "none"
                sentence = f"unknown tendon{meant(name, names)}; the robot has {there}"
                found.append(Contradiction(join(key, kind, name), shown(value), sentence))
    for name in [n for n in tensions if n in displacements]:
        sentence = f"tendon {name} has a tension in the same step; exactly one of the two is allowed"
        found.append(Contradiction(join(key, "displacements", name), shown(displacements[name]), sentence))
    for name, at in loads.items():
        if length is not None and at > length + ARC_TOLERANCE:
            sentence = f"lies beyond the tip; must be an arc length from 0 to {length:g} m"
            found.append(Contradiction(join(key, "loads", name, "at"), shown(at), sentence))
    return found


def backbone_elements(robot: Robot, model: Model) -> int:
    """Beam elements of the first mesh, without those of rigid inserts and load points."""
    if isinstance(model.elements_per_bay, tuple):
        return sum(model.elements_per_bay)
    if model.elements_per_bay == "auto":
        return len(robot.bay_ends)
    return len(robot.bay_ends) * model.starting_elements_per_bay


def size_contradictions(robot: Robot, model: Model, steps: int = 1) -> list[Contradiction]:
    """A mesh whose dense tangent and its factors, or results of all load steps that exceed `MEMORY_LIMIT`.

    Matrices of ``6 (elements + 1)`` unknowns are counted, `MATRICES` and more for each tendon, and 500 bytes a node and
    step for the results and their tables.

    Parameters
    ----------
    robot, model
        Description.
    steps
        Number of load steps.
    """
    given, bays = model.elements_per_bay, len(robot.bay_ends) + 1
    if isinstance(given, tuple) and len(given) != bays:
        sentence = (
            f"{bays} numbers are needed: one for every bay, and one for the stretch beyond the last disk"
        )
        return [Contradiction("model.elements_per_bay", f"{len(given)} numbers", sentence)]
    elements = backbone_elements(robot, model)
    nodes = elements + 1
    matrices = MATRICES + MATRICES_OF_A_TENDON * len(robot.tendons)
    most = int(math.sqrt(MEMORY_LIMIT / (8.0 * matrices)) / 6) - 1
    if elements > most:
        disks, per_bay = len(robot.bay_ends), model.starting_elements_per_bay
        sentence = (
            f"{disks} disks with {per_bay} elements per bay are {elements} elements; at most {most} fit into "
            f"{MEMORY_LIMIT / 1e9:g} GB"
        )
        if disks > most:
            return [Contradiction("disks", f"{disks} disks", sentence)]
        return [Contradiction("model.elements_per_bay", shown(model.elements_per_bay), sentence)]
    limit = int(MEMORY_LIMIT / (500 * nodes))
    if steps > limit:
        sentence = f"at most {limit} steps with {nodes} nodes fit into {MEMORY_LIMIT / 1e9:g} GB"
        return [Contradiction("steps", f"{steps} steps", sentence)]
    return []


def time_contradictions(times: Sequence[float | None]) -> list[Contradiction]:
    """Times of the load steps that run backwards; None where a step has none."""
    found, last = [], 0.0
    for i, time in enumerate(times):
        if time is not None and time < last:
            sentence = f"must not be before the step before, at {last:g} s"
            found.append(Contradiction(f"steps[{i}].time", shown(time), sentence))
        last = last if time is None else max(last, time)
    return found


def _short(values: Sequence[Any], keep: int = 6) -> str:
    """A list as text, its middle left out where it is long."""
    texts = [_short(v) if isinstance(v, list) else f"{v:g}" for v in values]
    if len(texts) > keep:
        texts = [*texts[: keep - 2], "...", texts[-1]]
    return "[" + ", ".join(texts) + "]"

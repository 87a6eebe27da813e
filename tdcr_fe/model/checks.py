"""What a description must satisfy across its parts; used for files and for Python alike."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from tdcr_fe.model.robot import Backbone, Disks, Robot, Tendon

#: A key (dotted, as in the file) and a sentence: the value, and what is allowed.
Problem = tuple[str, str]

_POSITIVE = "must be positive and finite"
_NOT_NEGATIVE = "must be finite, zero or more"


class Contradiction(NamedTuple):
    """One thing that does not fit.

    Attributes
    ----------
    key : str
        Dotted, as in ``robot.toml``.
    value : str
        What was given, as text.
    allowed : str
        What is allowed instead.
    """

    key: str
    value: str
    allowed: str


def backbone_contradictions(backbone: Backbone) -> list[Contradiction]:
    """What is wrong with the numbers of the backbone."""
    found = []
    for name in ("length", "radius", "youngs_modulus"):
        value = getattr(backbone, name)
        if not 0.0 < value < math.inf:
            found.append(Contradiction(f"backbone.{name}", f"{value:g}", _POSITIVE))
    if not -1.0 < backbone.poisson_ratio <= 0.5:
        found.append(
            Contradiction(
                "backbone.poisson_ratio", f"{backbone.poisson_ratio:g}", "must be above -1, up to 0.5"
            )
        )
    if not 0.0 <= backbone.density < math.inf:
        found.append(Contradiction("backbone.density", f"{backbone.density:g}", _NOT_NEGATIVE))
    if found:
        return found
    overrides = {
        "EI": "bending_stiffness",
        "GJ": "torsional_stiffness",
        "EA": "axial_stiffness",
        "GA": "shear_stiffness",
    }
    for name, override in overrides.items():
        source = override if getattr(backbone, override) is not None else "radius"
        try:
            value = float(getattr(backbone, name))
        except OverflowError:
            value = math.inf
        if not 0.0 < value < math.inf and not any(c.key == f"backbone.{source}" for c in found):
            given = f"{getattr(backbone, source):g}"
            sentence = f"must give a stiffness {name} that is positive and finite, not {value:g}"
            found.append(Contradiction(f"backbone.{source}", given, sentence))
    return found


def disk_contradictions(disks: Disks, length: float) -> list[Contradiction]:
    """What is wrong with the disks on a backbone of that length [m]."""
    from tdcr_fe.model.robot import ARC_TOLERANCE

    s = np.asarray(disks.positions, dtype=float)
    if s.size == 0:
        return [Contradiction("disks.positions", "[]", "at least one disk is needed")]
    if not np.all(np.isfinite(s)) or np.any(np.diff(s) <= ARC_TOLERANCE) or s[0] <= ARC_TOLERANCE:
        return [
            Contradiction(
                "disks.positions",
                f"{_short(disks.positions)}",
                f"must ascend from above 0 to at most the length, {length:g} m, each apart from the next",
            )
        ]
    found = []
    if s[-1] > length + ARC_TOLERANCE:
        found.append(
            Contradiction(
                f"disks.positions[{s.size - 1}]", f"{s[-1]:.9g}", f"beyond the tip; at most {length:.9g} m"
            )
        )
    if not 0.0 <= disks.thickness < math.inf:
        found.append(Contradiction("disks.thickness", f"{disks.thickness:g}", _NOT_NEGATIVE))
    elif disks.thickness > 0.0:
        limit = min([2.0 * s[0], *np.diff(s)])
        if disks.thickness >= limit:
            sentence = f"must leave flexible backbone between the disks, so less than {limit:g} m"
            found.append(Contradiction("disks.thickness", f"{disks.thickness:g}", sentence))
    if not 0.0 <= disks.mass < math.inf:
        found.append(Contradiction("disks.mass", f"{disks.mass:g}", _NOT_NEGATIVE))
    if not disks.radius > 0.0:
        found.append(Contradiction("disks.radius", f"{disks.radius:g}", "must be positive"))
    return found


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
    """What is wrong with one tendon among sound disks on a backbone of that length [m]."""
    from tdcr_fe.model.robot import ARC_TOLERANCE

    key = f"tendons[{index}]"
    found = []
    if not 0.0 <= tendon.friction_coefficient < math.inf:
        found.append(
            Contradiction(f"{key}.friction_coefficient", f"{tendon.friction_coefficient:g}", _NOT_NEGATIVE)
        )
    elif tendon.friction is not None and tendon.friction_coefficient != 0.0:
        sentence = (
            f"must be left out beside the friction law {tendon.friction.kind!r}, which gives the coefficient"
        )
        found.append(
            Contradiction(f"{key}.friction_coefficient", f"{tendon.friction_coefficient:g}", sentence)
        )
    if tendon.axial_stiffness is not None and not 0.0 < tendon.axial_stiffness < math.inf:
        found.append(Contradiction(f"{key}.axial_stiffness", f"{tendon.axial_stiffness:g}", _POSITIVE))
    s = np.asarray(disks.positions, dtype=float)
    end = length if tendon.end is None else tendon.end
    if not np.min(np.abs(s - end)) <= ARC_TOLERANCE:
        near = np.sort(s[np.argsort(np.abs(s - end))[:2]])
        value = f"{end:.9g}" if tendon.end is not None else f"not given, so the tip at {end:.9g}"
        nearest = " and ".join(f"{x:.9g}" for x in near)
        are = "disks are" if near.size > 1 else "disk is"
        found.append(
            Contradiction(f"{key}.end", value, f"no disk is there; the nearest {are} at {nearest} m")
        )
        end = float(s[np.argmin(np.abs(s - end))])
        if tendon.routing.kind == "points":
            return found
    holes_at = np.concatenate(([0.0], s[s <= end + ARC_TOLERANCE]))
    arcs = getattr(tendon.routing, "arc_lengths", None)
    if arcs is not None and (
        len(arcs) != len(holes_at) or np.max(np.abs(np.asarray(arcs) - holes_at)) > ARC_TOLERANCE
    ):
        found.append(hole_count_contradiction(index, len(arcs), len(holes_at)))
        return found
    with np.errstate(all="ignore"):  # a hole at infinity is outside, too
        holes = getattr(tendon.routing, "holes", None)
        xy = tendon.routing.position(holes_at, end) if holes is None else np.asarray(holes, dtype=float)
        distance = np.linalg.norm(xy, axis=1)
    outside = np.flatnonzero(~(distance <= disks.radius * (1.0 + 1e-9)))
    if outside.size:
        k = int(outside[0])
        where = "base plate" if k == 0 else f"disk {k}"
        if tendon.routing.kind == "points":
            name = f"holes[{k}]"
        else:
            name = "end_offset" if k > 0 and hasattr(tendon.routing, "end_offset") else "offset"
        offset = getattr(tendon.routing, name, None)
        found.append(
            Contradiction(
                f"{key}.{name}",
                f"{offset:g}" if offset is not None else f"{distance[k]:g} m from the backbone",
                f"the hole in the {where} must not lie outside the disk of radius {disks.radius:g} m",
            )
        )
    return found


def hole_count_contradiction(index: int, count: int, needed: int) -> Contradiction:
    """A free list of ``count`` holes where ``needed`` are."""
    return Contradiction(
        f"tendons[{index}].holes",
        f"{count} hole{'s' * (count != 1)}",
        f"{needed} are needed at their places: the base plate and every disk up to the tendon's end",
    )


def robot_contradictions(robot: Robot) -> list[Contradiction]:
    """Every contradiction between the parts of a robot."""
    found = backbone_contradictions(robot.backbone)
    on_disks = disk_contradictions(robot.disks, robot.backbone.length)
    found += on_disks
    found += name_contradictions(robot.tendon_names)
    if not any(c.key.startswith("disks.positions") for c in on_disks):
        for i, tendon in enumerate(robot.tendons):
            found += tendon_contradictions(i, tendon, robot.disks, robot.backbone.length)
    return found


def robot_problems(robot: Robot) -> list[Problem]:
    """Every contradiction between the parts of a robot, as keys and sentences."""
    return [(c.key, f"{c.value}; {c.allowed}") for c in robot_contradictions(robot)]


def _short(values: Sequence[float], keep: int = 6) -> str:
    """A list as text, its middle left out where it is long."""
    texts = [f"{v:g}" for v in values]
    if len(texts) > keep:
        texts = [*texts[: keep - 2], "...", texts[-1]]
    return "[" + ", ".join(texts) + "]"

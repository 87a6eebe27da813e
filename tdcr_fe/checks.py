"""What a description must satisfy across its parts; used for files and for Python alike."""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from tdcr_fe.robot import Robot

#: A key (dotted, as in the file) and a sentence: the value, and what is allowed.
Problem = tuple[str, str]


def robot_problems(robot: Robot) -> list[Problem]:
    """Every contradiction between the parts of a robot."""
    from tdcr_fe.robot import ARC_TOLERANCE

    problems: list[Problem] = []
    backbone, disks = robot.backbone, robot.disks
    positive = {
        "backbone.length": backbone.length,
        "backbone.radius": backbone.radius,
        "backbone.youngs_modulus": backbone.youngs_modulus,
        "backbone stiffness EI": backbone.EI,
        "backbone stiffness GJ": backbone.GJ,
        "backbone stiffness EA": backbone.EA,
        "backbone stiffness GA": backbone.GA,
    }
    problems += [
        (k, f"{v:g} is not allowed; must be positive") for k, v in positive.items() if not v > 0.0
    ]
    s = np.asarray(disks.positions, dtype=float)
    if s.size == 0:
        problems.append(("disks.positions", "empty; at least one disk is needed"))
        return problems
    if not np.all(np.isfinite(s)) or np.any(np.diff(s) <= ARC_TOLERANCE) or s[0] <= ARC_TOLERANCE:
        problems.append(
            ("disks.positions", f"{list(disks.positions)}; must ascend, all above 0 and apart from each other")
        )
        return problems
    if s[-1] > backbone.length + ARC_TOLERANCE:
        problems.append(("disks.positions", f"{s[-1]:g} lies beyond the tip at {backbone.length:g} m"))
    if disks.thickness < 0.0:
        problems.append(("disks.thickness", f"{disks.thickness:g}; must not be negative"))
    elif disks.thickness > 0.0:
        gaps = np.diff(np.concatenate(([0.0], s)))
        gaps[0] += disks.thickness / 2.0
        if disks.thickness >= gaps.min():
            problems.append(
                ("disks.thickness", f"{disks.thickness:g} leaves no flexible backbone between the disks")
            )
    if disks.mass < 0.0:
        problems.append(("disks.mass", f"{disks.mass:g}; must not be negative"))
    for name, count in Counter(robot.tendon_names).items():
        if count > 1:
            problems.append(("tendons", f"the name {name!r} is used {count} times; names must differ"))
    for i, tendon in enumerate(robot.tendons):
        key = f"tendons[{i}]"
        if tendon.friction_coefficient < 0.0:
            problems.append((f"{key}.friction_coefficient", f"{tendon.friction_coefficient:g}; must be >= 0"))
        if tendon.axial_stiffness is not None and not tendon.axial_stiffness > 0.0:
            problems.append((f"{key}.axial_stiffness", f"{tendon.axial_stiffness:g}; must be positive"))
        end = robot.end(tendon)
        if np.min(np.abs(s - end)) > ARC_TOLERANCE:
            nearest = s[np.argmin(np.abs(s - end))]
            problems.append(
                (f"{key}.end", f"{end:g} m is where no disk is; the nearest disk is at {nearest:.9g} m")
            )
            continue
        holes_at = np.concatenate(([0.0], s[s <= end + ARC_TOLERANCE]))
        arcs = getattr(tendon.routing, "arc_lengths", None)
        if arcs is not None and (
            len(arcs) != len(holes_at) or np.max(np.abs(np.asarray(arcs) - holes_at)) > ARC_TOLERANCE
        ):
            problems.append(
                (f"{key}.holes", f"{len(arcs)} holes; {len(holes_at)} are needed, base plate and disks up to the end")
            )
            continue
        distance = np.linalg.norm(tendon.routing.position(holes_at, end), axis=1)
        outside = np.flatnonzero(distance > disks.radius)
        if outside.size:
            k = int(outside[0])
            where = "base plate" if k == 0 else f"disk {k}"
            problems.append(
                (
                    f"{key}.offset",
                    f"the hole in the {where} lies {distance[k]:g} m from the backbone, outside the disk of "
                    f"radius {disks.radius:g} m",
                )
            )
    return problems

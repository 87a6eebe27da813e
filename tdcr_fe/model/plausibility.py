"""What is implausible about a description, before solving: warnings of values beyond physical limits, and remarks.

Limits are the rows of ``data/limits.toml``. A remark is what a colleague would ask about at a glance, a level below
warnings. What follows from a stiffness is judged where the robot itself is plausible: one mistake is named once.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np

from tdcr_fe.model.backbone import Backbone
from tdcr_fe.model.checks import Contradiction
from tdcr_fe.model.limits import REMARK, Value, kind_of_material, limits, nearest_material, sentences
from tdcr_fe.model.loading import LoadStep, Model
from tdcr_fe.model.messages import PlausibilityRemark, PlausibilityWarning, issue
from tdcr_fe.model.quantities import EARTH, Description, loading_values, masses, robot_values, sag, strain
from tdcr_fe.model.results import StepResult
from tdcr_fe.model.robot import Robot
from tdcr_fe.model.units import mistaken


class Implausible(ValueError):
    """Values so far beyond their limits that a solution would mean nothing.

    Attributes
    ----------
    contradictions : tuple of Contradiction
        Key, value and what is allowed of each.
    """

    def __init__(self, contradictions: Iterable[Contradiction]) -> None:
        self.contradictions = tuple(contradictions)
        super().__init__("\n".join(f"{c.key} = {c.value}: {c.allowed}" for c in self.contradictions))


class Findings(NamedTuple):
    """Sentences about a description; one for each quantity."""

    warnings: list[str]
    remarks: list[str]

    def issued(self) -> Findings:
        """These, which the caller of the function that calls this one gets as warnings, too."""
        issue(self.warnings, PlausibilityWarning, depth=4)
        issue(self.remarks, PlausibilityRemark, depth=4)
        return self


def plausibility(
    robot: Robot,
    model: Model,
    steps: Sequence[LoadStep],
    targets: Iterable[Sequence[float | None]] = (),
    largest: Sequence[float] = (),
) -> Findings:
    """What is unusual about a scenario, or does not fit together, known before solving.

    Parameters
    ----------
    robot, model, steps
        Description.
    targets
        Positions that the tip is to reach [m]; None is an open coordinate.
    largest
        Tensions that the tendons may have on the way there [N].

    Raises
    ------
    Implausible
        A load or a target is so far beyond its limit that a solution would mean nothing.
    """
    d = Description.of(robot, model, steps)
    values = [*robot_values(d), *loading_values(d)]
    for k, target in enumerate(targets):
        far = math.hypot(*(x for x in target if x is not None))
        values.append(Value("target", f"targets[{k}].position", far, "m", far / robot.backbone.length))
    for force, (name, course) in zip(largest, d.courses.items(), strict=False):
        curvature = force * course.offset / robot.backbone.EI
        values.append(strain(d, f"largest tension of {name}", force, curvature))
    beyond = [v for value in values if (v := value.beyond) is not None]
    warnings = _warnings(robot.backbone, [v for v in beyond if not v.row.remark])
    named = " ".join(warnings)
    keys = {v.key: (v.key, re.sub(r"\[\d+\]", "", v.key)) for v in beyond}  # of one, and of all
    remarks = [v for v in beyond if v.row.remark and not any(key in named for key in keys[v.key])]
    plain = [v for v in remarks if not v.row.by_stiffness]
    if warnings or any(v.key.startswith(("backbone.", "disks.", "model.")) for v in plain):
        remarks = plain  # the others may follow from that
    return Findings(warnings, sentences(remarks))


def _warnings(backbone: Backbone, beyond: list[Value]) -> list[str]:
    """Sentences about values beyond the limits of warnings; a common cause is named in their place."""
    single = [v for v in beyond if v.limit != "wound"]
    if any(v.key.startswith("steps") for v in single):
        beyond = single  # one input alone explains it
    found = [v for v in beyond if not v.row.by_stiffness]
    if any(v.key.startswith(("backbone.", "model.gravity")) for v in found):
        beyond = found  # the others may follow from that
    cause = _common_cause(backbone, [v for v in beyond if v.row.by_stiffness])
    if cause is not None:
        beyond = [*found, cause]
    farthest = sorted(beyond, key=lambda v: v.ratio)
    if refused := {v.limit: v for v in farthest if v.ratio > v.row.refused_from * v.row.high}:
        raise Implausible(v.refusal for v in refused.values())
    return sentences(beyond)


def _common_cause(b: Backbone, beyond: Sequence[Value]) -> Value | None:
    """The stiffness of the backbone, where it explains all that is beyond a limit that depends on it."""
    name, factor = nearest_material(b.youngs_modulus, b.density)
    row = limits()["material" + REMARK]
    is_usual = b.density > 0.0 and factor <= row.high and not b.bending_stiffness
    modulus = Value("soft", "backbone.youngs_modulus", b.youngs_modulus, "Pa", b.youngs_modulus)
    soft = modulus._replace(detail=kind_of_material(b.youngs_modulus))
    for size in mistaken("Pa").values():
        meant = [v._replace(ratio=v.ratio / size) for v in beyond]
        explains = any(v.row.is_usual(v.ratio) for v in meant) and not any(v.is_beyond for v in meant)
        if explains and not is_usual and soft.is_beyond and soft.row.is_usual(soft.ratio * size):
            return soft
    if beyond and b.density > 0.0 and factor > row.high and not b.bending_stiffness:
        detail = f"{b.density:g} kg/m^3 ({name})"
        return modulus._replace(limit="material" + REMARK, ratio=factor, detail=detail)
    return None


def understood(robot: Robot, model: Model, steps: Sequence[LoadStep] = ()) -> list[str]:
    """What the description says in other words, in at most three lines: stiffness, weight, and what inputs do.

    Parameters
    ----------
    robot, model, steps
        Description.
    """
    b, d = robot.backbone, Description.of(robot, model, steps)
    name, factor = nearest_material(b.youngs_modulus, b.density)
    like = f", like {name}" if b.density > 0.0 and factor <= limits()["material" + REMARK].high else ""
    lines = [f"bending stiffness {b.EI:.3g} N m^2{like}"]
    weight, sags = EARTH * sum(mass for _, _, mass in masses(robot).values()), sag(robot, EARTH)
    if weight > 0.0:
        is_small = sags < limits()["sag" + REMARK].high
        far = f"{1e3 * sags * b.length:.3g} mm" if is_small else "much of the length"
        lines[0] += f"; weight {weight:.3g} N, {_direction(model)} (held horizontally, the tip sags by {far})"
    pulls = []
    for tendon in robot.tendons:
        asked = max((s.tensions.get(tendon.name, 0.0) for s in steps), default=0.0)
        bend = float(np.linalg.norm(d.courses[tendon.name].by_tension))
        if bend > 0.0:
            pulls.append((asked, tendon.name, 0.5 * math.pi / bend))
    if pulls:
        asked, tendon_name, needed = max(pulls, key=lambda x: (x[0], -x[2]))
        largest = f"; the largest tension is {asked:.4g} N" if asked else ""
        lines.append(f"without friction, {needed:.3g} N in {tendon_name} bend it by 90 degrees{largest}")
    if d.inputs("displacements").any():
        x, y = max(d.bend("displacements"), key=np.linalg.norm)
        angle, towards = math.degrees(math.hypot(x, y)), round(math.degrees(math.atan2(y, x)))
        towards = 180 if towards == -180 else towards
        where = f"towards {towards} degrees from +x"
        lines.append(f"its displacements bend it by about {angle:.3g} degrees, {where}")
    return lines


def _direction(model: Model) -> str:
    """Where gravity pulls, as seen from the base."""
    x, y, z = model.gravity
    if not any(model.gravity):
        return "without gravity"
    if abs(z) < math.hypot(x, y):
        return "sideways"
    return "from tip to base: it stands upright" if z < 0.0 else "from base to tip: it hangs"


def strain_warnings(robot: Robot, steps: Sequence[StepResult]) -> list[str]:
    """Steps in which bending strains the surface of the backbone by more than its material bears.

    Parameters
    ----------
    robot
        Description.
    steps
        Solved steps; the strain is the turn of the tangent between neighbouring nodes over their distance, times the
        radius, beyond that of the precurved backbone.

    Returns
    -------
    list of str
        One sentence for the step with the largest strain, or nothing.
    """
    backbone = robot.backbone
    unloaded = math.hypot(*backbone.precurvature)
    found = [(0.0, 0, 0.0)]  # strain, number of the step, and arc length
    for step in steps:
        tangents, middle = step.rotations[:, :, 2], 0.5 * (step.s[1:] + step.s[:-1])
        turn = np.arccos(np.clip(np.einsum("ij,ij->i", tangents[1:], tangents[:-1]), -1.0, 1.0))
        strain = (turn / np.diff(step.s) - unloaded) * backbone.radius_at(middle)
        if robot.base_stiffness is not None:
            strain[0] = 0.0  # the first element turns with the base that gives way
        k = int(np.argmax(strain))
        found.append((float(strain[k]), step.step, float(middle[k])))
    worst, number, where = max(found, key=lambda x: x[0])
    if backbone.nonlinear is not None:
        most = backbone.nonlinear.largest_strain
        reason = f"the stress of backbone.nonlinear falls from {100 * most:.3g} % on"
    else:
        kind = kind_of_material(backbone.youngs_modulus)
        most = limits()[f"strain_{kind}"].high
        reason = f"no {kind} is elastic beyond {100 * most:g} %"
    if worst <= most:
        return []
    text = f"bending strains the surface of the backbone by {100 * worst:.3g} % at s = {where:.4g} m"
    return [f"step {number}: {text}; {reason}"]

"""Warnings of implausible values: wrong units, missing masses, loads far beyond the elastic range.

Such values are allowed. Each warning names the key as in the files, the value and, where a factor of a usual unit
explains it, the unit that was probably meant.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from tdcr_fe.model.loading import LoadStep, Model
from tdcr_fe.model.results import StepResult
from tdcr_fe.model.robot import Robot

#: Longest robot [m], and range of its length over its radius [1].
LONGEST, SLENDERNESS = 10.0, (5.0, 1e5)
#: Range of Young's modulus [Pa], of silicone to diamond, and of density [kg/m^3], of foam to iridium.
MODULUS, DENSITY = (1e4, 1e12), (10.0, 25_000.0)
#: Largest strain that is not warned of [1].
LARGEST_STRAIN = 0.2
#: Largest load times length squared over bending stiffness [1]: an elastica under 100 is bent nearly straight along it.
LARGEST_LOAD = 100.0

#: Units that a number may have been given in, and their size in SI.
_LENGTHS = {"mm": 1e-3, "cm": 1e-2, "um": 1e-6}
_MODULI = {"GPa": 1e9, "MPa": 1e6, "kPa": 1e3}
_DENSITIES = {"g/cm^3": 1e3}
_FORCES = {"mN": 1e-3, "g": 9.81e-3}


def _meant(value: float, units: Mapping[str, float], low: float, high: float) -> str:
    """A question that names the unit in which the value would be usual, or nothing."""
    fitting = [name for name, size in units.items() if low <= value * size <= high]
    return f"; was it meant in {fitting[0]}?" if fitting else ""


class _Limit(NamedTuple):
    """A range in which a value is usual."""

    key: str
    value: float
    unit: str
    usual: tuple[float, float]
    reason: str  # why a value outside is unusual; empty: the range itself
    units: Mapping[str, float]  # in which it may have been given
    meant: tuple[float, float] | None = None  # where it would be usual then; None: the range

    def warnings(self) -> list[str]:
        """One sentence where the value is outside."""
        low, high = self.usual
        if low <= self.value <= high:
            return []
        side = f"below {low:g}" if self.value < low else f"above {high:g}"
        reason = self.reason or f"{side} {self.unit}"
        hint = _meant(self.value, self.units, *(self.meant or self.usual))
        return [f"{self.key} = {self.value:g} {self.unit}: {reason}{hint}"]


def robot_warnings(robot: Robot) -> list[str]:
    """What is unusual about a robot, by key."""
    b, d, disks = robot.backbone, robot.disks, not robot.without_disks
    thin, thick = b.length / SLENDERNESS[1], b.length / SLENDERNESS[0]
    radii = (thin, min(d.radius, thick) if disks else thick)
    reason = "larger than a fifth of the length; rod theory needs a slender backbone"
    if disks and b.radius >= d.radius:
        reason = f"not thinner than its disks (radius {d.radius:g} m)"
        thick = math.nextafter(d.radius, 0.0)
    elif b.radius < thin:
        reason = f"the length is {b.length / b.radius:.0f} times as large"
    longest, widest = f"longer than {LONGEST:g} m", "larger than half the length"
    density = b.density or DENSITY[0]  # without density: no weight and no inertia
    outside = f"outside {DENSITY[0]:g} to {DENSITY[1]:g} kg/m^3"
    limits = [
        _Limit("backbone.length", b.length, "m", (0.0, LONGEST), longest, _LENGTHS, (0.01, LONGEST)),
        _Limit(
            "backbone.radius",
            b.radius,
            "m",
            (thin, thick),
            reason,
            {} if b.radius < thin else _LENGTHS,
            radii,
        ),
        _Limit("backbone.youngs_modulus", b.youngs_modulus, "Pa", MODULUS, "", _MODULI),
        _Limit("backbone.density", density, "kg/m^3", DENSITY, outside, _DENSITIES),
    ]
    if disks:
        half = 0.5 * b.length
        limits.append(_Limit("disks.radius", d.radius, "m", (0.0, half), widest, _LENGTHS, (b.radius, half)))
    return [text for limit in limits for text in limit.warnings()] + (
        [] if disks else _course_warnings(robot)
    )


def _course_warnings(robot: Robot) -> list[str]:
    """Tendons that follow a backbone without disks outside of its body, or with friction, which has no effect."""
    found = []
    for i, tendon in enumerate(robot.tendons):
        s = np.linspace(0.0, robot.end(tendon), 101)
        offset = np.linalg.norm(tendon.routing.position(s, robot.end(tendon)), axis=1)
        outside = np.flatnonzero(offset > robot.backbone.radius_at(s) * (1.0 + 1e-9))
        if outside.size:
            k = int(outside[0])
            radius = float(robot.backbone.radius_at(s[k : k + 1])[0])
            found.append(
                f"tendons[{i}]: {offset[k]:g} m from the axis at {s[k]:g} m, outside of the backbone of radius "
                f"{radius:g} m" + _meant(float(offset[k]), _LENGTHS, 0.0, radius)
            )
        if tendon.friction_coefficient > 0.0 or tendon.adhesion > 0.0 or tendon.friction is not None:
            name = "friction_coefficient" if tendon.friction_coefficient > 0.0 else "adhesion"
            name = "friction" if tendon.friction is not None else name
            found.append(
                f"tendons[{i}].{name} is given: it has no effect in a robot without disks, whose tendons follow the "
                "backbone without friction; massless [disks] are guides with friction"
            )
    return found


def _gravity_warnings(robot: Robot, model: Model) -> list[str]:
    if not any(model.gravity):
        return []
    found = []
    if robot.backbone.density == 0.0 and robot.disks.mass == 0.0 and robot.tip_mass == 0.0:
        found.append(
            f"model.gravity = {list(model.gravity)}: nothing has mass, so it does nothing; give "
            "backbone.density, disks.mass or tip_mass"
        )
    size = float(np.linalg.norm(model.gravity))
    if size > 100.0:
        found.append(
            f"model.gravity = {list(model.gravity)}: {size:g} m/s^2 is {size / 9.81:.0f} times that of the earth"
        )
    return found


def _largest(pairs: Iterable[tuple[float, int]]) -> tuple[float, int]:
    """The largest value with the step where it is first reached."""
    return max(pairs, key=lambda p: (p[0], -p[1]), default=(0.0, 0))


def loading_warnings(robot: Robot, steps: Sequence[LoadStep]) -> list[str]:
    """What is unusual about a loading sequence for this robot, by key; needs no solution."""
    b = robot.backbone
    found = []
    softness = b.length**2 / b.EI
    for tendon in robot.tendons:
        force, k = _largest((s.tensions.get(tendon.name, 0.0), i) for i, s in enumerate(steps))
        key = f"steps[{k}].tensions.{tendon.name} = {force:g} N"
        soft = f" (backbone.youngs_modulus = {b.youngs_modulus:g} Pa)"
        strains = {"the backbone": (force / b.EA, soft)}
        if tendon.axial_stiffness is not None:
            strains["the tendon"] = force / tendon.axial_stiffness, ""
        for what, (strain, why) in strains.items():
            if strain > LARGEST_STRAIN:
                found.append(f"{key}: by itself it strains {what} by {100 * strain:.3g} %{why}")
        # A parallel tendon bends the backbone to the curvature T a / EI (pure moment).
        offset = float(np.max(np.linalg.norm(robot.holes(tendon), axis=1)))
        bending = force * offset / b.EI * b.radius
        if bending > LARGEST_STRAIN and not any(w.startswith(key) for w in found):
            found.append(
                f"{key}: its moment bends the backbone by a strain of {100 * bending:.3g} % at the surface"
                + _meant(force, _FORCES, 0.0, LARGEST_STRAIN * b.EI / (offset * b.radius))
            )
        far, k = _largest((abs(s.displacements.get(tendon.name, 0.0)), i) for i, s in enumerate(steps))
        if far > robot.end(tendon):
            found.append(
                f"steps[{k}].displacements.{tendon.name} = {far:g} m: more than the tendon's length in the robot, "
                f"{robot.end(tendon):g} m" + _meant(far, _LENGTHS, 0.0, robot.end(tendon))
            )
    for i, step in enumerate(steps):
        for name, load in step.loads.items():
            force, moment = float(np.linalg.norm(load.force)), float(np.linalg.norm(load.moment))
            if force * softness > LARGEST_LOAD:
                found.append(
                    f"steps[{i}].loads.{name}.force: {force:g} N is {force * softness:.3g} EI/L^2, far beyond what the "
                    "backbone can carry elastically" + _meant(force, _FORCES, 0.0, LARGEST_LOAD / softness)
                )
            if moment / b.EI * b.radius > LARGEST_STRAIN:
                strain = 100 * moment / b.EI * b.radius
                found.append(
                    f"steps[{i}].loads.{name}.moment: {moment:g} N m bends the backbone by a strain of {strain:.3g} % "
                    "at the surface"
                )
    return found


def plausibility_warnings(robot: Robot, model: Model, steps: Sequence[LoadStep]) -> list[str]:
    """What is unusual about a scenario, known before solving; one sentence each.

    Parameters
    ----------
    robot, model, steps
        Description.
    """
    return [*robot_warnings(robot), *_gravity_warnings(robot, model), *loading_warnings(robot, steps)]


def strain_warnings(robot: Robot, steps: Sequence[StepResult]) -> list[str]:
    """Steps in which bending strains the surface of the backbone by more than `LARGEST_STRAIN`.

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
    unloaded = math.hypot(*robot.backbone.precurvature)
    backbone = robot.backbone
    worst, number, where = 0.0, 0, 0.0
    for step in steps:
        tangents = step.rotations[:, :, 2]
        turn = np.arccos(np.clip(np.einsum("ij,ij->i", tangents[1:], tangents[:-1]), -1.0, 1.0))
        radius = backbone.radius_at(0.5 * (step.s[1:] + step.s[:-1]))
        strain = (turn / np.diff(step.s) - unloaded) * radius
        if robot.base_stiffness is not None:
            strain[0] = 0.0  # the first element turns with the base that gives way
        k = int(np.argmax(strain))
        if strain[k] > worst:
            worst, number, where = float(strain[k]), step.step, float(0.5 * (step.s[k] + step.s[k + 1]))
    law = backbone.nonlinear
    if law is not None and worst > law.largest_strain:
        return [
            f"step {number}: bending strains the surface of the backbone by {100 * worst:.3g} % at s = {where:.4g} m; "
            f"the stress of backbone.nonlinear falls from {100 * law.largest_strain:.3g} % on"
        ]
    if worst <= LARGEST_STRAIN or law is not None:
        return []
    return [
        f"step {number}: bending strains the surface of the backbone by {100 * worst:.3g} % at s = {where:.4g} m, "
        f"beyond {100 * LARGEST_STRAIN:g} %; no backbone stays elastic there"
    ]

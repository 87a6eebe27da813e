"""Warnings of implausible values: wrong units, missing masses, loads far beyond the elastic range.

What follows from a stiffness is judged where the robot itself is plausible, so that one mistake gives one warning.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tdcr_fe.model.backbone import Backbone
from tdcr_fe.model.checks import ARC_TOLERANCE
from tdcr_fe.model.limits import UNITS, Value, kind_of_material, limits, nearest_material, sentences
from tdcr_fe.model.loading import LoadStep, Model, Vector, with_displacements
from tdcr_fe.model.results import StepResult
from tdcr_fe.model.robot import Robot


class Course(NamedTuple):
    """Holes of a tendon in their sections [m], shape (n + 1, 2), and what follows from them."""

    holes: NDArray[np.float64]
    offset: float  # largest distance of a hole from the axis [m]
    end: float  # arc length of the anchor [m]
    # Angles by which tension and displacement bend the robot, to first order and with their direction, each (2,)
    by_tension: NDArray[np.float64]  # [rad/N]
    by_displacement: NDArray[np.float64]  # [rad/m]


class Description(NamedTuple):
    """A scenario, with the courses of its tendons by name."""

    robot: Robot
    model: Model
    steps: Sequence[LoadStep]
    courses: dict[str, Course]

    @classmethod
    def of(cls, robot: Robot, model: Model, steps: Sequence[LoadStep]) -> Description:
        """Of a scenario."""
        courses = {}
        for tendon in robot.tendons:
            holes, end = robot.holes(tendon), robot.end(tendon)
            distances = np.linalg.norm(holes, axis=1)
            offset = float(np.max(distances))
            direction = holes[0] / max(float(distances[0]), 1e-300)
            disks = robot.disks.thickness * (np.count_nonzero(robot.hole_arc_lengths(tendon)[1:]) - 0.5)
            by_tension = offset * (end - max(float(disks), 0.0)) / robot.backbone.EI * direction
            courses[tendon.name] = Course(holes, offset, end, by_tension, direction / (offset or np.inf))
        return cls(robot, model, with_displacements(robot, steps), courses)

    def bends(self, kind: str) -> NDArray[np.float64]:
        """Angles by which inputs bend the robot, to first order [rad], by step, direction and tendon."""
        factors = [getattr(c, f"by_{kind.removesuffix('s')}") for c in self.courses.values()]
        return self.inputs(kind)[:, None, :] * np.array(factors).reshape(-1, 2).T

    def inputs(self, kind: str) -> NDArray[np.float64]:
        """Tensions [N] or displacements [m] by step and tendon; zero where a step names none."""
        names = self.robot.tendon_names
        found = [[getattr(s, kind).get(n, 0.0) for n in names] for s in self.steps]
        return np.array(found).reshape(len(self.steps), len(names))


# ------------------------------------------------------------------------------------------------- quantities


def _robot_values(d: Description) -> Iterator[Value]:
    """Quantities of backbone, disks and tendons."""
    robot = d.robot
    b, disks = robot.backbone, robot.disks
    yield Value("length", "backbone.length", b.length, "m", b.length)
    thick = robot.without_disks or b.radius < disks.radius
    ratio = b.radius / (b.length if thick else disks.radius)
    detail = f"radius {disks.radius:g} m"
    yield Value("radius" if thick else "radius_of_disks", "backbone.radius", b.radius, "m", ratio, detail)
    yield Value("slenderness", "backbone.radius", b.radius, "m", b.length / b.radius)
    yield Value("modulus", "backbone.youngs_modulus", b.youngs_modulus, "Pa", b.youngs_modulus)
    if b.density > 0.0:  # without: no weight and no inertia
        yield Value("density", "backbone.density", b.density, "kg/m^3", b.density)
    yield from _stiffness_values(b)
    if b.superelastic is not None:
        strain = b.superelastic.threshold_strain
        yield Value("threshold_strain", "backbone.superelastic.threshold_strain", strain, "", strain)
    curved = math.hypot(*b.precurvature)
    yield Value("precurvature", "backbone.precurvature", curved, "1/m", curved * b.length)
    if not robot.without_disks:
        yield Value("disks", "disks.radius", disks.radius, "m", disks.radius / b.length)
    yield from _tendon_values(d)


def _stiffness_values(b: Backbone) -> Iterator[Value]:
    """Stiffnesses that are given by hand, beside those of the round rod."""
    solid = Backbone(b.length, b.radius, b.youngs_modulus, b.poisson_ratio)
    names = {"bending": "EI", "torsional": "GJ", "axial": "EA", "shear": "GA"}
    for name, symbol in names.items():
        key, unit = f"{name}_stiffness", "N m^2" if symbol in ("EI", "GJ") else "N"
        given, computed = getattr(b, key), getattr(solid, symbol)
        if given is not None:
            detail = f"{symbol} = {computed:.3g} {unit}"
            if name == "axial" and 0.1 < given / solid.EI < 10.0:
                detail += f", and EI = {solid.EI:.3g} N m^2: is it the bending_stiffness?"
            # A backbone without stretch and shear is given by high stiffnesses.
            ratio = given / computed if unit == "N m^2" else min(given / computed, 1.0)
            yield Value("stiffness", f"backbone.{key}", given, unit, ratio, detail)


def _tendon_values(d: Description) -> Iterator[Value]:
    """Quantities of the tendons, each alone and two by two."""
    robot = d.robot
    for i, tendon in enumerate(robot.tendons):
        _, offset, end, *_ = d.courses[tendon.name]
        key = f"tendons[{i}]"
        bays = sum(s <= end + ARC_TOLERANCE for s in robot.bay_ends)
        for name, turns in vars(tendon.routing).items():
            if name.startswith("turns"):
                yield Value("turns", f"{key}.{name}", turns, "turns", abs(turns) / max(1, bays))
        mu, law = tendon.friction_coefficient, tendon.friction
        given = {"friction_coefficient": mu, "adhesion": tendon.adhesion}
        given |= {f"friction.{n}": getattr(law, n, 0.0) for n in ("mu", "static", "kinetic")}
        for name, value in given.items():
            if robot.without_disks:
                yield Value("no_holes", f"{key}.{name}", value, "", value)
            elif name != "adhesion":
                yield Value("friction", f"{key}.{name}", value, "", value)
        if (ea := tendon.axial_stiffness) is not None:
            yield Value("tendon_stiffness", f"{key}.axial_stiffness", ea, "N", ea)
        backbone = robot.backbone
        yield Value(
            "adhesion", f"{key}.adhesion", tendon.adhesion, "N", tendon.adhesion * offset * end / backbone.EI
        )
        if offset > 0.0 and backbone.bending_stiffness is None and not robot.without_disks:
            yield Value("hole", f"{key}.offset", offset, "m", offset / backbone.radius)
        if robot.without_disks:
            s = np.linspace(0.0, end, 101)
            offsets = np.linalg.norm(tendon.routing.position(s, end), axis=1)
            radius = backbone.radius_at(s)
            k = int(np.argmax(offsets / radius))
            detail = f"of radius {radius[k]:g} m at s = {s[k]:g} m"
            yield Value("course", f"{key}.offset", offsets[k], "m", offsets[k] / radius[k], detail)
    for (i, one), (k, other) in itertools.combinations(enumerate(robot.tendons), 2):
        a, b = (d.courses[t.name].holes for t in (one, other))
        if a.shape == b.shape:
            apart = float(np.max(np.linalg.norm(a - b, axis=1)))
            yield Value("same_holes", f"tendons[{k}]", math.nan, "m", apart, f"tendons[{i}]")
    angles = [abs(getattr(t.routing, "angle_deg", math.inf)) for t in robot.tendons]
    if len(set(angles)) > 1:
        yield Value("angles", "tendons.angle_deg", max(angles), "deg", max(angles))


def masses(robot: Robot) -> dict[str, tuple[float, str, float]]:
    """By key, a value with its unit, and the mass that follows from it [kg]."""
    b, disks = robot.backbone, robot.disks
    return {
        "backbone.density": (b.density, "kg/m^3", b.mass_per_length * b.length),
        "disks.mass": (disks.mass, "kg", disks.mass * len(disks.positions)),
        "tip_mass": (robot.tip_mass, "kg", robot.tip_mass),
    }


def _gravity_values(d: Description) -> Iterator[Value]:
    """Gravity, and the weights of a robot against the stiffness of its backbone."""
    robot, model = d.robot, d.model
    g = float(np.linalg.norm(model.gravity))
    if g == 0.0:
        return
    b, key = robot.backbone, "model.gravity"
    yield Value("gravity", key, g, "m/s^2", g, f"{g / 9.81:.4g}")
    yield Value("direction", key, g, "m/s^2", abs(g - 1.0))
    yield Value("no_mass", key, g, "m/s^2", sum(mass for _, _, mass in masses(robot).values()))
    for key, (value, unit, mass) in masses(robot).items():
        ratio = mass * _bending(model.gravity) * b.length**2 / b.EI
        yield Value("weight", key, value, unit, ratio, f"{mass * g:.3g} N")


def _bending(vector: Vector) -> float:
    """Size of a force or acceleration, but for what pulls the robot straight: its component from base to tip."""
    x, y, z = vector
    return math.hypot(x, y, min(z, 0.0))


def loading_values(d: Description) -> Iterator[Value]:
    """Quantities of a loading sequence; those of tendons in the step where they are largest."""
    b = d.robot.backbone
    strain, surface = f"strain_{kind_of_material(b.youngs_modulus)}", "at the surface, by bending"
    tensions, moved = d.inputs("tensions"), d.inputs("displacements")
    for i, tendon in enumerate(d.robot.tendons if d.steps else ()):
        _, offset, end, *_ = d.courses[tendon.name]
        k = int(np.argmax(tensions[:, i]))
        force, key = float(tensions[k, i]), f"steps[{k}].tensions.{tendon.name}"
        if tendon.pretension > force:
            force, key = tendon.pretension, f"tendons[{i}].pretension"
        # A parallel tendon bends the backbone to the curvature T a / EI (pure moment).
        strains = (force / b.EA, "along its axis"), (force * offset / b.EI * b.radius, surface)
        yield Value(strain, key, force, "N", *max(strains))
        if (ea := tendon.axial_stiffness or 0.0) >= limits()["tendon_stiffness"].low:
            yield Value("tendon_strain", key, force, "N", force / ea)
        k = int(np.argmax(np.abs(moved[:, i])))
        far, key = float(moved[k, i]), f"steps[{k}].displacements.{tendon.name}"
        yield Value("displacement", key, far, "m", abs(far) / end, f"{end:g} m")
    if not any(d.model.gravity[:2]) and not tensions.any() and not any(s.loads for s in d.steps):
        yield from _let_out(d)
    for k, step in enumerate(d.steps):
        for name, load in step.loads.items():
            key = f"steps[{k}].loads.{name}"
            force, moment = math.hypot(*load.force), math.hypot(*load.moment)
            across = _bending(load.force)
            yield Value("force", f"{key}.force", force, "N", across * load.at**2 / b.EI)
            # A force cannot bend the elastica more than that, however long it is.
            curvature = min(across * load.at / b.EI, math.sqrt(2.0 * across / b.EI))
            strains = (force / b.EA, "along its axis"), (curvature * b.radius, surface)
            yield Value(strain, f"{key}.force", force, "N", *max(strains))
            yield Value(strain, f"{key}.moment", moment, "N m", moment / b.EI * b.radius, surface)


def bends(d: Description) -> Iterator[Value]:
    """The largest angles by which inputs, or loads and weights where there are none, bend the robot, to first order."""
    b = d.robot.backbone
    largest = 0.0
    for kind in ("tensions", "displacements"):
        single = d.bends(kind)
        if single.any():
            together = np.linalg.norm(single.sum(axis=2), axis=1)
            k = int(np.argmax(together))
            yield Value("wound", f"steps[{k}].{kind}", math.nan, "", float(together[k]))
            largest = max(largest, float(np.max(np.linalg.norm(single, axis=1))))
    for tendon, course in zip(d.robot.tendons, d.courses.values(), strict=True):
        largest = max(largest, tendon.pretension * float(np.linalg.norm(course.by_tension)))
    if largest == 0.0:
        for step in d.steps:
            for load in step.loads.values():
                by_load = math.hypot(*load.force) * load.at**2, math.hypot(*load.moment) * load.at
                largest = max(largest, *(x / b.EI for x in by_load))
        largest = max(largest, *(v.ratio for v in _gravity_values(d) if v.limit == "weight"), 0.0)
    if largest > 0.0 and d.steps:
        yield Value("bends", "steps", math.nan, "", largest)


def _let_out(d: Description) -> Iterator[Value]:
    """Displacements of tendons without pretension that nothing but displacements pulls."""
    steps = d.steps
    slack: dict[str, list[float]] = {t.name: [] for t in d.robot.tendons if not t.pretension}
    held: dict[str, float] = {}
    for step in steps:
        held |= step.displacements
        for name in slack:
            if held.get(name, 0.0) < 0.0:
                slack[name].append(held[name] + 1.5 * sum(max(x, 0.0) for x in held.values()))
    for name, values in slack.items():
        if values:
            lowest = min((s.displacements.get(name, 0.0), k) for k, s in enumerate(steps))
            yield Value("slack", f"steps[{lowest[1]}].displacements.{name}", lowest[0], "m", max(values))


# ------------------------------------------------------------------------------------------------- sentences


def plausibility_warnings(
    robot: Robot, model: Model, steps: Sequence[LoadStep], targets: Iterable[Sequence[float | None]] = ()
) -> list[str]:
    """What is unusual about a scenario, known before solving; one sentence for each quantity.

    Parameters
    ----------
    robot, model, steps
        Description.
    targets
        Positions that the tip is to reach [m]; None is an open coordinate.

    Raises
    ------
    ValueError
        A load or a target is so far beyond its limit that a solution would have no meaning.
    """
    d = Description.of(robot, model, steps)
    values = [*_robot_values(d), *_gravity_values(d), *loading_values(d), *bends(d)]
    for k, target in enumerate(targets):
        far = math.hypot(*(x for x in target if x is not None))
        values.append(Value("target", f"targets[{k}].position", far, "m", far / robot.backbone.length))
    beyond = [v for v in values if v.is_beyond]
    single = [v for v in beyond if v.limit != "wound"]
    if any(v.key.startswith("steps") for v in single):
        beyond = single  # one input alone explains it
    found = [v for v in beyond if not v.row.by_stiffness]
    if any(v.key.startswith(("backbone.", "model.gravity")) for v in found):
        beyond = found  # the others may follow from that
    cause = _common_cause(robot.backbone, [v for v in beyond if v.row.by_stiffness])
    if cause is not None:
        beyond = [*found, cause]
    refused = [v for v in beyond if v.ratio > v.row.refused_from * v.row.high]
    if refused:
        raise ValueError("\n".join([*sentences(refused), "Nothing was solved"]))
    return sentences(beyond)


def _common_cause(b: Backbone, beyond: Sequence[Value]) -> Value | None:
    """The stiffness of the backbone, where it explains all that is beyond a limit that depends on it."""
    name, factor = nearest_material(b.youngs_modulus, b.density)
    row = limits()["material"]
    is_usual = b.density > 0.0 and factor <= row.high and not b.bending_stiffness
    modulus = Value("soft", "backbone.youngs_modulus", b.youngs_modulus, "Pa", b.youngs_modulus)
    soft = modulus._replace(detail=kind_of_material(b.youngs_modulus))
    for size in UNITS["Pa"].values():
        meant = [v._replace(ratio=v.ratio / size) for v in beyond]
        explains = any(v.row.is_usual(v.ratio) for v in meant) and not any(v.is_beyond for v in meant)
        if explains and not is_usual and soft.is_beyond and soft.row.is_usual(soft.ratio * size):
            return soft
    if beyond and b.density > 0.0 and factor > row.high and not b.bending_stiffness:
        return modulus._replace(limit="material", ratio=factor, detail=f"{b.density:g} kg/m^3 ({name})")
    parts = {"weight": "weight", "force": "load", "moment": "load"}
    kinds = {parts.get(v.limit, parts.get(v.key.rpartition(".")[2], "tension")) for v in beyond}
    if len(kinds) > 1 and not any(v.limit in ("bends", "hole", "adhesion") for v in beyond):
        key = "bending_stiffness" if b.bending_stiffness else "radius"
        worst = max(v.ratio / v.row.high for v in beyond)
        unit = "N m^2" if b.bending_stiffness else "m"
        return Value("thin", f"backbone.{key}", getattr(b, key), unit, worst, f"EI is {b.EI:.3g} N m^2")
    return None


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

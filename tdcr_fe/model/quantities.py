"""Quantities of a robot and its loading that physical limits bound, each alone and against others.

A quantity is a `Value` of a row of ``data/limits.toml``.
"""

from __future__ import annotations

import itertools
import math
import re
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from tdcr_fe.elements import Array
from tdcr_fe.elements.drives import DISPLACEMENT, TENSION, Drive
from tdcr_fe.model.backbone import Backbone
from tdcr_fe.model.checks import ARC_TOLERANCE
from tdcr_fe.model.limits import REMARK, Value, kind_of_material, limits, nearest_material
from tdcr_fe.model.loading import LoadStep, Model, Vector, in_newtons_and_metres
from tdcr_fe.model.robot import Disks, Robot, Tendon
from tdcr_fe.model.routing import ConvergingRouting

#: Gravity on Earth [m/s^2].
EARTH = 9.81
#: Relative difference up to which values are alike, and part of the others that must be alike.
ALIKE, MOST = 1e-3, 2 / 3


class Course(NamedTuple):
    """Holes of a tendon in their sections [m], shape (n + 1, 2), and what follows from them."""

    holes: Array
    offset: float  # largest distance of a hole from the axis [m]
    end: float  # arc length of the anchor [m]
    # Angles by which tension and displacement bend the robot, to first order and with their direction, each (2,)
    by_tension: Array  # [rad/N]
    by_displacement: Array  # [rad/m]


class Description(NamedTuple):
    """A scenario, its inputs also in newtons and metres, and the courses of its tendons by name."""

    robot: Robot
    model: Model
    asked: Sequence[LoadStep]  # as they were given
    steps: Sequence[LoadStep]
    courses: dict[str, Course]

    @classmethod
    def of(cls, robot: Robot, model: Model, steps: Sequence[LoadStep]) -> Description:
        """The description of a scenario."""
        courses, b = {}, robot.backbone
        for tendon in robot.tendons:
            holes, end = robot.holes(tendon), robot.end(tendon)
            distances = np.linalg.norm(holes, axis=1)
            offset = float(np.max(distances))
            direction = holes[0] / max(float(distances[0]), 1e-300)
            at = robot.hole_arc_lengths(tendon)
            disks = robot.disks.thickness * (np.count_nonzero(at[1:]) - 0.5)
            s = np.linspace(0.0, end, 100, endpoint=False) + 0.005 * end
            lever = np.interp(s, at, distances)
            thinner = b.radius / b.radius_at(s)
            turn = lever * thinner**4 / b.stiffness_factors(s)[0]
            by_tension = np.mean(turn) * (end - max(float(disks), 0.0)) / b.EI * direction
            pressed = thinner**2 / b.material_factors(s)[0] * b.EI / b.EA
            by_displacement = np.sum(turn) / np.sum(turn * lever + pressed) * direction
            courses[tendon.name] = Course(holes, offset, end, by_tension, by_displacement)
        return cls(robot, model, steps, in_newtons_and_metres(robot, steps), courses)

    def bends(self, kind: str) -> Array:
        """Angles by which inputs bend the robot, to first order [rad], by step, direction and tendon."""
        factors = [getattr(c, f"by_{kind.removesuffix('s')}") for c in self.courses.values()]
        return self.inputs(kind)[:, None, :] * np.array(factors).reshape(-1, 2).T

    def bend(self, kind: str) -> Array:
        """Angle by which the inputs of a step together bend the robot, to first order [rad], by step and direction."""
        if kind == "tensions":
            return self.bends(kind).sum(axis=2)
        # A tendon takes in its lever times the bend; least squares where there are more than two.
        factors = np.array([c.by_displacement for c in self.courses.values()]).reshape(-1, 2)
        levers = factors / np.maximum(np.sum(factors**2, axis=1, keepdims=True), 1e-300)
        # Tendons side by side tell nothing of the bend across them.
        found = [np.linalg.lstsq(levers[u != 0.0], u[u != 0.0], rcond=0.2)[0] for u in self.inputs(kind)]
        return np.array(found).reshape(-1, 2)

    def inputs(self, kind: str) -> Array:
        """Tensions [N] or displacements [m] by step and tendon; zero where a step names none."""
        names = self.robot.tendon_names
        found = [[getattr(s, kind).get(n, 0.0) for n in names] for s in self.steps]
        return np.array(found).reshape(len(self.steps), len(names))

    def drive(self, k: int, kind: str, name: str = "") -> Drive:
        """That by which a step gives tensions or displacements to a tendon; without a name, to any."""
        plain = TENSION if kind == "tensions" else DISPLACEMENT
        used = (drive for drive, given in self.asked[k].inputs() if given and name in (*given, ""))
        return next((drive for drive in used if drive.winds == plain.winds), plain)


def robot_values(d: Description) -> Iterator[Value]:
    """Quantities of a robot, and of gravity."""
    yield from _backbone(d.robot)
    yield from _stiffnesses(d.robot)
    if not d.robot.without_disks:
        yield from _disks(d.robot)
    for i, tendon in enumerate(d.robot.tendons):
        yield from _tendon(d, tendon, f"tendons[{i}]")
    yield from _tendons(d)
    yield from _weights(d)


# ------------------------------------------------------------------------------------------------- backbone, disks


def _backbone(robot: Robot) -> Iterator[Value]:
    b, disks = robot.backbone, robot.disks
    yield Value("length", "backbone.length", b.length, "m", b.length)
    inside = _are_guides(robot) and disks.radius in (b.radius, Disks.radius)
    thick = robot.without_disks or b.radius < disks.radius or inside
    ratio = b.radius / (b.length if thick else disks.radius)
    detail = f"radius {disks.radius:g} m"
    yield Value("radius" if thick else "radius_of_disks", "backbone.radius", b.radius, "m", ratio, detail)
    yield Value("slenderness", "backbone.radius", b.radius, "m", b.length / b.radius)
    limit = "modulus_of_body" if robot.without_disks else "modulus"
    yield Value(limit, "backbone.youngs_modulus", b.youngs_modulus, "Pa", b.youngs_modulus)
    if b.density > 0.0:  # without: no weight and no inertia
        yield Value("density", "backbone.density", b.density, "kg/m^3", b.density)
    if b.superelastic is not None:
        strain = b.superelastic.threshold_strain
        yield Value("threshold_strain", "backbone.superelastic.threshold_strain", strain, "", strain)
    if (curved := math.hypot(*b.precurvature)) > 0.0:
        yield Value("precurvature", "backbone.precurvature", curved, "1/m", curved * b.length)


def _are_guides(robot: Robot) -> bool:
    """Whether disks may be guides of channels in the backbone, in place of parts on it: without mass and thickness."""
    b, disks = robot.backbone, robot.disks
    is_body = b.bending_stiffness is not None or kind_of_material(b.youngs_modulus) in ("plastic", "rubber")
    return is_body and not (disks.mass or disks.thickness)


def _stiffnesses(robot: Robot) -> Iterator[Value]:
    """Stiffnesses given by hand beside those of the round rod and each other, base and springs; and the material."""
    b = robot.backbone
    solid = Backbone(b.length, b.radius, b.youngs_modulus, b.poisson_ratio)
    for name, symbol in {"bending": "EI", "torsional": "GJ", "axial": "EA", "shear": "GA"}.items():
        key, unit = f"{name}_stiffness", "N m^2" if symbol in ("EI", "GJ") else "N"
        given, computed = getattr(b, key), getattr(solid, symbol)
        if given is not None:
            detail = f"{symbol} = {computed:.3g} {unit}"
            if name == "axial" and 0.1 < given / solid.EI < 10.0:
                detail += f", and EI = {solid.EI:.3g} N m^2: is it the bending_stiffness?"
            # A backbone without stretch and shear is given by high stiffnesses.
            ratio = given / computed if unit == "N m^2" else min(given / computed, 1.0)
            yield Value("stiffness", f"backbone.{key}", given, unit, ratio, detail)
    by_hand = b.bending_stiffness or b.torsional_stiffness
    if not by_hand and not Value("density", "", b.density, "", b.density).is_beyond:
        name, factor = nearest_material(b.youngs_modulus, b.density)
        detail = f"{b.density:g} kg/m^3 ({name})"
        yield Value("material", "backbone.youngs_modulus", b.youngs_modulus, "Pa", factor, detail)
    if b.axial_stiffness is not None:
        both = f"EI = {b.EI:.3g} N m^2 and EA = {b.EA:.3g} N"
        yield Value("axial", "backbone.axial_stiffness", b.EA, "N", 0.25 * b.EA * b.radius**2 / b.EI, both)
    if robot.base_stiffness is not None:
        ratio = robot.base_stiffness * b.length / b.EI
        yield Value("base_stiffness", "base_stiffness", robot.base_stiffness, "N m/rad", ratio)
    for k, spring in enumerate(robot.springs):
        ratio = spring.stiffness * spring.at**3 / b.EI
        yield Value("side_spring", f"springs[{k}].stiffness", spring.stiffness, "N/m", ratio)


def _disks(robot: Robot) -> Iterator[Value]:
    """Masses against volumes, thickness against distances, and distances against each other."""
    disks, b = robot.disks, robot.backbone
    yield Value("disks", "disks.radius", disks.radius, "m", disks.radius / b.length)
    bays = np.diff([0.0, *disks.positions])
    usual = float(np.median(bays))
    yield Value("thickness", "disks.thickness", disks.thickness, "m", disks.thickness / usual)
    volume = math.pi * (disks.radius**2 - b.radius**2) * (disks.thickness or float(np.min(bays)))
    if disks.mass > 0.0 and volume > 0.0:
        density = disks.mass / volume
        ratio = density if disks.thickness else max(density, limits()["disk_density" + REMARK].low)
        yield Value("disk_density", "disks.mass", disks.mass, "kg", ratio, f"{density:.3g} kg/m^3")
    odd = np.abs(bays[1:-1] / usual - 1.0) > ALIKE
    if len(bays) > 3 and 0 < np.count_nonzero(odd) <= (1.0 - MOST) * len(odd):
        k = 1 + int(np.argmax(odd))
        detail = f"{bays[k]:.4g} m from the disk before it, where most distances are {usual:.4g} m"
        yield Value("one_disk", f"disks.positions[{k}]", disks.positions[k], "m", 2.0, detail)


# ------------------------------------------------------------------------------------------------- tendons


def _tendon(d: Description, tendon: Tendon, key: str) -> Iterator[Value]:
    """Quantities of one tendon."""
    robot, backbone, course = d.robot, d.robot.backbone, d.courses[tendon.name]
    offset, end = course.offset, course.end
    bays = sum(s <= end + ARC_TOLERANCE for s in robot.bay_ends)
    for name, value in vars(tendon.routing).items():
        if name.startswith("turns"):
            yield Value("turns", f"{key}.{name}", value, "turns", abs(value) / max(1, bays))
    law = tendon.friction
    given = {"friction_coefficient": tendon.friction_coefficient}
    given |= {f"friction.{n}": getattr(law, n, 0.0) for n in ("mu", "static", "kinetic")}
    if robot.without_disks:
        given["adhesion"] = tendon.adhesion
    for name, value in given.items():
        limit = "no_holes" if robot.without_disks else "friction"
        yield Value(limit, f"{key}.{name}", value, "", value)
    bend = tendon.adhesion * offset * end / backbone.EI
    yield Value("adhesion", f"{key}.adhesion", tendon.adhesion, "N", bend)
    if (ea := tendon.axial_stiffness) is not None:
        yield Value("tendon_stiffness", f"{key}.axial_stiffness", ea, "N", ea)
    pulled = tendon.pretension * float(np.linalg.norm(course.by_tension))
    yield Value("pretension", f"{key}.pretension", tendon.pretension, "N", pulled)
    if robot.without_disks:
        s = np.linspace(0.0, end, 101)
        offsets = np.linalg.norm(tendon.routing.position(s, end), axis=1)
        radius = backbone.radius_at(s)
        k = int(np.argmax(offsets / radius))
        detail = f"of radius {radius[k]:g} m at s = {s[k]:g} m"
        which = "end_offset" if k and isinstance(tendon.routing, ConvergingRouting) else "offset"
        yield Value("course", f"{key}.{which}", offsets[k], "m", offsets[k] / radius[k], detail)
    elif offset > 0.0 and backbone.bending_stiffness is None and not _are_guides(robot):
        yield Value("hole", f"{key}.offset", offset, "m", offset / backbone.radius)


def _tendons(d: Description) -> Iterator[Value]:
    """Tendons against each other."""
    for (i, one), (j, other) in itertools.combinations(enumerate(d.courses.values()), 2):
        if one.holes.shape == other.holes.shape:
            apart = float(np.max(np.linalg.norm(one.holes - other.holes, axis=1)))
            yield Value("same_holes", f"tendons[{j}]", math.nan, "m", apart, f"tendons[{i}]")
    angles = {getattr(t.routing, "angle_deg", math.inf) for t in d.robot.tendons}
    if len(angles) > 1:
        largest = max(map(abs, angles))
        yield Value("angles", "tendons.angle_deg", largest, "deg", largest)


# ------------------------------------------------------------------------------------------------- weights


def masses(robot: Robot) -> dict[str, tuple[float, str, float]]:
    """By key, a value with its unit, and the mass that follows from it [kg]."""
    b, disks = robot.backbone, robot.disks
    return {
        "backbone.density": (b.density, "kg/m^3", b.mass_per_length * b.length),
        "disks.mass": (disks.mass, "kg", disks.mass * len(disks.positions)),
        "tip_mass": (robot.tip_mass, "kg", robot.tip_mass),
    }


def sag(robot: Robot, across: float) -> float:
    """Sag of the tip under an acceleration across the robot [m/s^2], to first order, over the length [1]."""
    spread = sum(mass for key, (_, _, mass) in masses(robot).items() if key != "tip_mass")
    b = robot.backbone
    return across * (spread / 8.0 + robot.tip_mass / 3.0) * b.length**2 / b.EI


def bending(vector: Vector) -> float:
    """Size of a force or acceleration, but for what pulls the robot straight: its component from base to tip."""
    x, y, z = vector
    return math.hypot(x, y, min(z, 0.0))


def weight_values(d: Description) -> Iterator[Value]:
    """Weights against the stiffness of the backbone, where gravity does not pull from base to tip."""
    b, g = d.robot.backbone, float(np.linalg.norm(d.model.gravity))
    for key, (value, unit, mass) in masses(d.robot).items():
        ratio = mass * bending(d.model.gravity) * b.length**2 / b.EI
        yield Value("weight", key, value, unit, ratio, f"{mass * g:.3g} N")


def _weights(d: Description) -> Iterator[Value]:
    """Gravity, and what the weights do to the unloaded robot."""
    robot, key = d.robot, "model.gravity"
    x, y, z = d.model.gravity
    g, b, given = math.hypot(x, y, z), robot.backbone, masses(robot)
    total = sum(mass for _, _, mass in given.values())
    if g == 0.0:
        yield Value("no_gravity", key, g, "m/s^2", sag(robot, EARTH), f"{EARTH * total:.3g} N")
        return
    yield Value("gravity", key, g, "m/s^2", g, f"{g / EARTH:.4g}")
    yield Value("direction", key, g, "m/s^2", abs(g - 1.0))
    yield Value("no_mass", key, g, "m/s^2", total)
    yield from weight_values(d)
    heaviest = max(given, key=lambda k: given[k][2])
    value, unit, _ = given[heaviest]
    per_weight = b.length**2 / b.EI
    buckling = max(-z, 0.0) * ((total - robot.tip_mass) / 7.84 + robot.tip_mass / 2.467) * per_weight
    yield Value("sag", heaviest, value, unit, sag(robot, math.hypot(x, y)))
    yield Value("upright", heaviest, value, unit, buckling)
    yield Value("hanging", heaviest, value, unit, max(z, 0.0) * total * per_weight)


# ------------------------------------------------------------------------------------------------- loading


def loading_values(d: Description) -> Iterator[Value]:
    """Quantities of a loading sequence."""
    yield from _pulls(d)
    yield from _loads(d)
    yield from _bends(d)


def _pulls(d: Description) -> Iterator[Value]:
    """Strains by tensions and displacements, in the step where they are largest."""
    b = d.robot.backbone
    tensions, moved = d.inputs("tensions"), d.inputs("displacements")
    for i, tendon in enumerate(d.robot.tendons if d.steps else ()):
        course = d.courses[tendon.name]
        k = int(np.argmax(tensions[:, i]))
        drive = d.drive(k, "tensions", tendon.name)
        force, key = float(tensions[k, i]), f"steps[{k}].{drive.inputs}.{tendon.name}"
        if tendon.pretension > force:
            force, key = tendon.pretension, f"tendons[{i}].pretension"
        # A parallel tendon bends the backbone to the curvature T a / EI (pure moment).
        yield strain(d, key, force, force * course.offset / b.EI)
        if (ea := tendon.axial_stiffness or 0.0) >= limits()["tendon_stiffness"].low:
            yield Value("tendon_strain", key, force, "N", force / ea, f"{ea:g} N")
        k = int(np.argmax(np.abs(moved[:, i])))
        drive = d.drive(k, "displacements", tendon.name)
        far, key = moved[k, i] / drive.scale(tendon), f"steps[{k}].{drive.inputs}.{tendon.name}"
        ratio = abs(float(moved[k, i])) / course.end
        yield Value("displacement", key, float(far), drive.unit, ratio, f"{course.end:g} m")
    if not any(d.model.gravity[:2]) and not tensions.any() and not any(s.loads for s in d.steps):
        yield from _let_out(d)


def strain(d: Description, key: str, force: float, curvature: float) -> Value:
    """Larger strain of the backbone by a force [N], along its axis or at the surface by a curvature [1/m]."""
    b = d.robot.backbone
    strains = (force / b.EA, "along its axis"), (curvature * b.radius, "at the surface, by bending")
    return Value(f"strain_{kind_of_material(b.youngs_modulus)}", key, force, "N", *max(strains))


def _let_out(d: Description) -> Iterator[Value]:
    """Displacements of tendons without pretension that nothing but displacements pulls."""
    slack: dict[str, list[float]] = {t.name: [] for t in d.robot.tendons if not t.pretension}
    held: dict[str, float] = {}
    for step in d.steps:
        held |= step.displacements
        for name in slack:
            if held.get(name, 0.0) < 0.0:
                slack[name].append(held[name] + 1.5 * sum(max(x, 0.0) for x in held.values()))
    for name, values in slack.items():
        if values:
            far, k = min((s.displacements.get(name, 0.0), k) for k, s in enumerate(d.steps))
            yield Value("slack", f"steps[{k}].displacements.{name}", far, "m", max(values))


def _loads(d: Description) -> Iterator[Value]:
    """Loads against the stiffness of the backbone, and against their names."""
    b, ends = d.robot.backbone, [course.end for course in d.courses.values()]
    for k, step in enumerate(d.steps):
        for name, load in step.loads.items():
            key = f"steps[{k}].loads.{name}"
            force, moment = math.hypot(*load.force), math.hypot(*load.moment)
            across = bending(load.force)
            yield Value("force", f"{key}.force", force, "N", force * load.at**2 / b.EI)
            # A force cannot bend the elastica more than that, however long it is.
            curvature = min(across * load.at / b.EI, math.sqrt(2.0 * across / b.EI))
            yield strain(d, f"{key}.force", force, curvature)
            by_moment = strain(d, f"{key}.moment", 0.0, moment / b.EI)
            yield by_moment._replace(value=moment, unit="N m")
            yield Value("moment", f"{key}.moment", moment, "N m", moment * load.at / b.EI)
            if "tip" in re.split("[^a-z]+", name.lower()) and load.at not in ends:
                yield Value("not_at_tip", f"{key}.at", load.at, "m", load.at / b.length)
            if (force or moment) and d.robot.base_stiffness is None:
                yield Value("at_base", f"{key}.at", load.at, "m", load.at / b.length)


def _bends(d: Description) -> Iterator[Value]:
    """The largest angles by which inputs, or loads and weights where there are none, bend the robot, to first order."""
    b = d.robot.backbone
    largest = 0.0
    for kind in ("tensions", "displacements"):
        single = d.bends(kind)
        if single.any():
            together = np.linalg.norm(d.bend(kind), axis=1)
            k = int(np.argmax(together))
            yield Value("wound", f"steps[{k}].{d.drive(k, kind).inputs}", math.nan, "", float(together[k]))
            largest = max(largest, float(np.max(np.linalg.norm(single, axis=1))))
    if largest == 0.0:
        for tendon, course in zip(d.robot.tendons, d.courses.values(), strict=True):
            largest = max(largest, tendon.pretension * float(np.linalg.norm(course.by_tension)))
    if largest == 0.0:
        loads = [load for step in d.steps for load in step.loads.values()]
        forces = [math.hypot(*x.force) * x.at**2 / b.EI for x in loads]
        moments = [math.hypot(*x.moment) * x.at / b.EI for x in loads]
        largest = max(*forces, *moments, *(v.ratio for v in weight_values(d)))
    if largest > 0.0 and d.steps:
        yield Value("bends", "steps", math.nan, "", largest)

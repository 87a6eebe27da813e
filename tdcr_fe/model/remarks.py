"""Remarks: what a colleague would ask about at a glance, a level below warnings; and what was understood.

Quantities are compared with each other: modulus with density, masses with volumes, a tendon, disk or step with its
neighbours, tensions and loads with the stiffness of the backbone. Bounds are the rows of ``data/limits.toml`` with
``remark = true``. A key that a warning names gets no remark.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from tdcr_fe.model.checks import ARC_TOLERANCE
from tdcr_fe.model.limits import Value, limits, nearest_material, sentences
from tdcr_fe.model.loading import LoadStep, Model
from tdcr_fe.model.plausibility import Description, bends, loading_values, masses
from tdcr_fe.model.robot import Robot
from tdcr_fe.model.tendon import Tendon

#: Relative difference up to which values are alike, and part of the others that must be alike.
ALIKE, MOST = 1e-3, 2 / 3
#: Tendons that are not alike differ by less than this factor.
SPREAD = 3.0
#: A step of a tendon is expected within this factor of the mean of its neighbours.
NEAR = 1.5
#: ... where these differ by no more than this factor.
SMOOTH = 5.0


def plausibility_remarks(
    robot: Robot, model: Model, steps: Sequence[LoadStep], warned: Sequence[str] = ()
) -> list[str]:
    """What does not fit together in a scenario though every value may be right; one sentence for each kind.

    Parameters
    ----------
    robot, model, steps
        Description.
    warned
        What `plausibility_warnings` says of it.
    """
    d = Description.of(robot, model, steps)
    values = [*_backbone(robot), *_disks(robot), *_tendons(d), *_weights(robot, model)]
    values += [*_bends(d), *_steps(robot, steps)]
    beyond = [v for v in values if v.is_beyond]
    causes = ("backbone.", "disks.", "model.")
    found = [v for v in beyond if not v.row.by_stiffness]
    if warned or any(v.key.startswith(causes) for v in found):
        beyond = found  # the others may follow from that
    return sentences(v for v in beyond if not any(v.key in text for text in warned))


def understood(robot: Robot, model: Model, steps: Sequence[LoadStep] = ()) -> list[str]:
    """What the description says in other words, in at most three lines: stiffness, weight, and what tensions do.

    Parameters
    ----------
    robot, model, steps
        Description.
    """
    b, courses = robot.backbone, Description.of(robot, model, steps).courses
    name, factor = nearest_material(b.youngs_modulus, b.density)
    like = f", like {name}" if b.density > 0.0 and factor <= limits()["material"].high else ""
    lines = [f"bending stiffness {b.EI:.3g} N m^2{like}"]
    spread, tip = (9.81 * m for m in (_spread_mass(robot), robot.tip_mass))
    if spread + tip > 0.0:
        sag = (spread / 8.0 + tip / 3.0) * b.length**2 / b.EI
        far = f"{1e3 * sag * b.length:.3g} mm" if sag < limits()["sag"].high else "much of the length"
        lines[0] += f"; weight {spread + tip:.3g} N, {_direction(model)}"
        lines[0] += f" (held horizontally, the tip sags by {far})"
    pulls = []
    for tendon in robot.tendons:
        asked = max((s.tensions.get(tendon.name, 0.0) for s in steps), default=0.0)
        bend = float(np.linalg.norm(courses[tendon.name].by_tension))
        if bend > 0.0:
            pulls.append((asked, tendon.name, 0.5 * math.pi / bend))
    if pulls:
        asked, tendon_name, needed = max(pulls, key=lambda x: (x[0], -x[2]))
        largest = f"; the largest tension is {asked:.3g} N" if asked else ""
        lines.append(f"without friction, {needed:.3g} N in {tendon_name} bend it by 90 degrees{largest}")
    return lines


def _direction(model: Model) -> str:
    """Where gravity pulls, as seen from the base."""
    x, y, z = model.gravity
    if not any(model.gravity):
        return "without gravity"
    if abs(z) < math.hypot(x, y):
        return "sideways"
    return "from tip to base: it stands upright" if z < 0.0 else "from base to tip: it hangs"


def _spread_mass(robot: Robot) -> float:
    """Mass of backbone and disks [kg]."""
    return sum(mass for key, (_, _, mass) in masses(robot).items() if key != "tip_mass")


# ------------------------------------------------------------------------------------------------- the robot


def _backbone(robot: Robot) -> Iterator[Value]:
    """Material, and stiffnesses that are given by hand, against each other."""
    b = robot.backbone
    solid_EI = b.youngs_modulus * b.second_moment
    given = b.bending_stiffness or b.torsional_stiffness
    if b.density > 0.0 and not given:
        name, factor = nearest_material(b.youngs_modulus, b.density)
        detail = f"{b.density:g} kg/m^3 ({name})"
        yield Value("material", "backbone.youngs_modulus", b.youngs_modulus, "Pa", factor, detail)
    yield Value("poisson", "backbone.poisson_ratio", b.poisson_ratio, "", b.poisson_ratio)
    if given:
        key = "bending" if b.bending_stiffness else "torsional"
        both = f"EI = {b.EI:.3g} and GJ = {b.GJ:.3g} N m^2"
        ratio = b.GJ * (1.0 + b.poisson_ratio) / b.EI
        yield Value("torsion", f"backbone.{key}_stiffness", given, "N m^2", ratio, both)
        detail = f"EI = {solid_EI:.3g} N m^2"
        yield Value("solid", "backbone.bending_stiffness", b.EI, "N m^2", b.EI / solid_EI, detail)
    curved = math.hypot(*b.precurvature)
    if curved > 0.0:
        yield Value("straight", "backbone.precurvature", curved, "1/m", curved * b.length)
    if b.superelastic is not None:
        strain = b.superelastic.threshold_strain
        yield Value("early_plateau", "backbone.superelastic.threshold_strain", strain, "", strain)
    if robot.base_stiffness is not None:
        ratio = robot.base_stiffness * b.length / b.EI
        yield Value("base_stiffness", "base_stiffness", robot.base_stiffness, "N m/rad", ratio)
    for k, spring in enumerate(robot.springs):
        ratio = spring.stiffness * spring.at**3 / b.EI
        yield Value("side_spring", f"springs[{k}].stiffness", spring.stiffness, "N/m", ratio)


def _disks(robot: Robot) -> Iterator[Value]:
    """Masses against volumes, thickness against distances, and distances against each other."""
    disks, b = robot.disks, robot.backbone
    if robot.without_disks:
        return
    bays = np.diff([0.0, *disks.positions])
    yield Value(
        "thickness", "disks.thickness", disks.thickness, "m", disks.thickness / float(np.median(bays))
    )
    thickness = disks.thickness or float(np.min(bays))
    volume = math.pi * (disks.radius**2 - b.radius**2) * thickness
    if disks.mass > 0.0 and volume > 0.0:
        row, density = limits()["disk_density"], disks.mass / volume
        ratio = density if disks.thickness else max(density, row.low)
        yield Value("disk_density", "disks.mass", disks.mass, "kg", ratio, f"{density:.3g} kg/m^3")
    usual = float(np.median(bays))
    odd = np.abs(bays[1:-1] / usual - 1.0) > ALIKE
    if len(bays) > 3 and 0 < np.count_nonzero(odd) <= (1.0 - MOST) * len(odd):
        k = 1 + int(np.argmax(odd))
        detail = f"{bays[k]:.4g} m from the disk before it, where most distances are {usual:.4g} m"
        yield Value("one_disk", f"disks.positions[{k}]", disks.positions[k], "m", 2.0, detail)


def _tendons(d: Description) -> Iterator[Value]:
    """Tendons against each other, against disks and backbone, and their holes against neighbouring holes."""
    robot, tendons = d.robot, d.robot.tendons
    ends, offsets = [d.courses[t.name].end for t in tendons], {n: c.offset for n, c in d.courses.items()}
    keys = {t.name: f"tendons[{i}]" for i, t in enumerate(tendons)}
    fields = {
        ("friction_coefficient", ""): {t.name: t.friction_coefficient for t in tendons},
        ("offset", "m"): offsets,
        ("axial_stiffness", "N"): {t.name: t.axial_stiffness or 0.0 for t in tendons},
        ("pretension", "N"): {t.name: t.pretension for t in tendons},
    }
    for (field, unit), values in fields.items():
        odd = _odd_one(values)
        if odd is not None:
            name, usual = odd
            ratio = max(values[name] / usual, usual / values[name])
            detail = f"{usual:g} {unit}".rstrip()
            yield Value("one_tendon", f"{keys[name]}.{field}", values[name], unit, ratio, detail)
    for end in sorted(set(ends)):
        yield from _angles([t for t, e in zip(tendons, ends, strict=True) if e == end])
    for tendon in tendons:
        key, offset = keys[tendon.name], offsets[tendon.name]
        if not robot.without_disks:
            yield Value("small_offset", f"{key}.offset", offset, "m", offset / robot.disks.radius)
        ea = tendon.axial_stiffness
        if ea is not None:
            ratio = ea * offset**2 / robot.backbone.EI
            yield Value("soft_tendon", f"{key}.axial_stiffness", ea, "N", ratio)
            yield Value("stiff_tendon", f"{key}.axial_stiffness", ea, "N", ea)
        turns = getattr(tendon.routing, "turns", 0.0)
        quarter = abs(turns) / (0.5 * math.pi)
        if round(quarter) > 0:
            off = abs(quarter / round(quarter) - 1.0)
            yield Value("turns_rad", f"{key}.turns", turns, "", off, f"{round(quarter) / 2:g}")
        yield from _holes(key, d.courses[tendon.name].holes)
    for i, one in enumerate(tendons):
        for k in range(i):
            a, b = (d.courses[t.name].holes for t in (one, tendons[k]))
            if a.shape != b.shape and not robot.without_disks:
                n = min(len(a), len(b))
                apart = float(np.min(np.linalg.norm(a[:n] - b[:n], axis=1)))
                yield Value("shared_holes", f"tendons[{i}]", math.nan, "m", apart, f"tendons[{k}]")


def _odd_one(values: Mapping[str, float]) -> tuple[str, float] | None:
    """The one value above zero that differs where all others are alike, or is far from the others; and the others'."""
    names = sorted((n for n in values if values[n] > 0.0), key=lambda n: values[n])
    if len(names) < 2:
        return None
    for rest, name in ((names[1:], names[0]), (names[:-1], names[-1])):
        usual = values[rest[0]]
        if len(rest) > 1 and values[rest[-1]] <= (1.0 + ALIKE) * usual and values[name] != usual:
            return (name, usual) if abs(values[name] / usual - 1.0) > ALIKE else None
    if values[names[-1]] < SPREAD * values[names[0]]:
        return None
    middle = values[names[(len(names) - 1) // 2]]
    low = middle / values[names[0]] > values[names[-1]] / middle
    return (names[0], values[names[-1]]) if low or len(names) == 2 else (names[-1], middle)


def _angles(tendons: Sequence[Tendon]) -> Iterator[Value]:
    """Whether three or more tendons that end together balance each other."""
    angles = [t.routing.angle_deg for t in tendons if hasattr(t.routing, "angle_deg")]
    if len(angles) < 3 or len(angles) < len(tendons):
        return
    resultant = abs(np.mean(np.exp(1j * np.radians(angles))))
    listed = ", ".join(f"{a:g}" for a in angles[:6])
    yield Value("balance", "tendons.angle_deg", math.nan, "deg", float(resultant), listed)


def _holes(key: str, holes: NDArray[np.float64]) -> Iterator[Value]:
    """A hole between its neighbours, against the others of its tendon."""
    if len(holes) < 5:
        return
    off = np.linalg.norm(holes[1:-1] - 0.5 * (holes[:-2] + holes[2:]), axis=1)
    k = int(np.argmax(off))
    ratio = off[k] / (float(np.median(off)) + 0.1 * float(np.max(np.linalg.norm(holes, axis=1))))
    yield Value("one_hole", f"{key}.holes[{k + 1}]", math.nan, "m", float(ratio), f"{1e3 * off[k]:.3g} mm")


def _weights(robot: Robot, model: Model) -> Iterator[Value]:
    """Gravity, and what the weights do to the unloaded robot."""
    g = float(np.linalg.norm(model.gravity))
    b, given = robot.backbone, masses(robot)
    key = max(given, key=lambda k: given[k][2])
    spread, unit = _spread_mass(robot), b.length**2 / b.EI
    if g == 0.0:
        sag = 9.81 * (spread / 8.0 + robot.tip_mass / 3.0) * unit
        yield Value(
            "no_gravity", "model.gravity", g, "m/s^2", sag, f"{9.81 * (spread + robot.tip_mass):.3g} N"
        )
        return
    yield Value("earth", "model.gravity", g, "m/s^2", g)
    x, y, z = model.gravity
    sag = math.hypot(x, y) * (spread / 8.0 + robot.tip_mass / 3.0) * unit
    yield Value("sag", key, *given[key][:2], sag)
    buckling = max(-z, 0.0) * (spread / 7.84 + robot.tip_mass / 2.467) * unit
    yield Value("upright", key, *given[key][:2], buckling)
    yield Value("hanging", key, *given[key][:2], max(z, 0.0) * (spread + robot.tip_mass) * unit)


# ------------------------------------------------------------------------------------------------- loading


def _bends(d: Description) -> Iterator[Value]:
    """What tensions, displacements and loads do to first order, with closer limits than those of the warnings."""
    closer = {"bends": "bends_little", "wound": "full_circle", "force": "large_force"}
    for value in (*bends(d), *loading_values(d)):
        if value.limit in closer:
            yield value._replace(limit=closer[value.limit])


def _steps(robot: Robot, steps: Sequence[LoadStep]) -> Iterator[Value]:
    """Inputs against those of the steps before and after, tendons against each other, loads against their names."""
    for k, step in enumerate(steps):
        for name, load in step.loads.items():
            if "tip" in name.lower():
                ratio = load.at / robot.backbone.length
                yield Value("not_at_tip", f"steps[{k}].loads.{name}.at", load.at, "m", ratio)
    for kind, unit in (("tensions", "N"), ("displacements", "m")):
        for tendon in robot.tendons:
            given = [
                (k, getattr(s, kind)[tendon.name])
                for k, s in enumerate(steps)
                if tendon.name in getattr(s, kind)
            ]
            yield from _slips(tendon.name, kind, unit, given)
    named = {n for s in steps for n in (*s.tensions, *s.displacements)}
    for i, tendon in enumerate(robot.tendons):
        if tendon.pretension and tendon.name not in named and any(s.tensions for s in steps):
            yield Value("held", f"tendons[{i}].pretension", tendon.pretension, "N", 1.0)
    same = sum(
        a.time is None and (a.tensions, a.displacements, a.loads) == (b.tensions, b.displacements, b.loads)
        for a, b in itertools.pairwise(steps)
    )
    yield Value("same_steps", "steps", math.nan, "", same)
    yield from _taken_in(robot, steps)


def _slips(name: str, kind: str, unit: str, given: Sequence[tuple[int, float]]) -> Iterator[Value]:
    """The input of a tendon, step and value, that is ten times as large as its neighbours suggest, or a tenth."""
    found = []
    for (_, before), (k, x), (_, after) in zip(given, given[1:], given[2:], strict=False):
        if min(before * x, x * after) > 0.0 and 1.0 / SMOOTH <= before / after <= SMOOTH:
            for factor in (0.1, 10.0):
                misfit = abs(math.log(2.0 * factor * x / (before + after)))
                detail = f"{before:g} {unit} before it and {after:g} {unit} after it"
                slip = Value("one_step", f"steps[{k}].{kind}.{name}", x, unit, 10.0, detail)
                found += [(misfit, k, slip)] if misfit < math.log(NEAR) else []
    if found and found[-1][1] - found[0][1] <= 1:  # a wrong value may make its neighbour look wrong, too
        yield min(found)[2]


def _taken_in(robot: Robot, steps: Sequence[LoadStep]) -> Iterator[Value]:
    """Displacements of three or more tendons that end together: what some take in the others have to let out."""
    held: dict[str, float] = {}
    groups: dict[int, list[str]] = {}
    for tendon in robot.tendons:
        groups.setdefault(round(robot.end(tendon) / ARC_TOLERANCE), []).append(tendon.name)
    found: dict[str, tuple[float, float]] = {}  # sum, sum of sizes
    for k, step in enumerate(steps):
        held = {n: x for n, x in held.items() if n not in step.tensions} | dict(step.displacements)
        for names in groups.values():
            moved = [held[n] for n in names if n in held]
            if len(names) > 2 and len(moved) == len(names) and max(moved) > max(0.0, min(moved)):
                key = f"steps[{k}].displacements of {', '.join(names)}"
                found[key] = sum(moved), sum(map(abs, moved))
    largest = max((total for _, total in found.values()), default=0.0)
    for key, (together, _) in found.items():
        detail = f"{1e3 * together:.3g} mm"
        yield Value("taken_in", key, math.nan, "m", abs(together) / largest, detail)

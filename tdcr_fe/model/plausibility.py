"""Warnings of implausible values: wrong units, missing masses, loads far beyond the elastic range.

Every limit is a row of ``data/limits.toml``, with its source. A warning names the key as in the files, the value and,
where a factor of a usual unit explains it, the unit that was probably meant. What follows from a stiffness is judged
where the robot itself is plausible, so that one mistake gives one warning.
"""

from __future__ import annotations

import itertools
import math
import tomllib
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from importlib.resources import files
from typing import NamedTuple

import numpy as np

from tdcr_fe.model.backbone import Backbone
from tdcr_fe.model.checks import ARC_TOLERANCE
from tdcr_fe.model.loading import LoadStep, Model, Vector
from tdcr_fe.model.results import StepResult
from tdcr_fe.model.robot import Robot
from tdcr_fe.model.tendon import Tendon

#: Units that a number may have been given in, by the unit of the file, and their size in it.
UNITS = {
    "m": {"mm": 1e-3},
    "N": {"mN": 1e-3, "gf": 9.81e-3, "kN": 1e3},
    "N m": {"N mm": 1e-3},
    "N m^2": {"N mm^2": 1e-6},
    "kg": {"g": 1e-3},
    "Pa": {"GPa": 1e9, "MPa": 1e6, "kPa": 1e3},
    "kg/m^3": {"g/cm^3": 1e3},
    "m/s^2": {"mm/s^2": 1e-3, "cm/s^2": 1e-2, "ft/s^2": 0.3048},
    "deg": {"rad": math.degrees(1.0)},
    "turns": {"degrees": 1.0 / 360.0},
    "": {"per cent": 0.01},
}
#: Materials by Young's modulus, and where they begin [Pa].
MATERIALS = {"steel": 1.5e11, "metal": 2e10, "plastic": 1e8, "rubber": 0.0}


@dataclass(frozen=True)
class Limit:
    """A row of ``data/limits.toml``."""

    quantity: str
    says: str
    source: str
    low: float = -math.inf
    high: float = math.inf
    by_stiffness: bool = False
    refused_from: float = math.inf
    usual: float = 0.0

    def is_usual(self, ratio: float) -> bool:
        """Whether a value of the quantity is within the limit, and not so small that it has no effect."""
        least = self.low if self.high == math.inf else self.usual or 1e-4 * self.high
        return max(least, self.low) <= ratio <= self.high


@lru_cache(maxsize=1)
def limits() -> dict[str, Limit]:
    """The table of physical limits, by name."""
    text = (files("tdcr_fe") / "data" / "limits.toml").read_text(encoding="utf-8")
    return {name: Limit(**row) for name, row in tomllib.loads(text).items()}


class Value(NamedTuple):
    """A value of a description, and the quantity that a limit bounds; they are in proportion."""

    limit: str
    key: str
    value: float
    unit: str
    ratio: float
    detail: str = ""

    @property
    def row(self) -> Limit:
        """Its limit."""
        return limits()[self.limit]

    @property
    def is_beyond(self) -> bool:
        """Whether it is beyond its limit."""
        return not self.row.low <= self.ratio <= self.row.high

    @property
    def sentence(self) -> str:
        """What is wrong with it, with key, value, and the units in which it would be usual."""
        row, unit = self.row, self.unit if self.unit != "turns" else ""
        given = "" if math.isnan(self.value) else f" = {self.value:g} {unit}".rstrip()
        says = row.says.format(
            ratio=self.ratio, percent=100.0 * self.ratio, low=row.low, high=row.high, detail=self.detail
        )
        fitting = [u for u, size in UNITS.get(self.unit, {}).items() if row.is_usual(self.ratio * size)]
        return f"{self.key}{given}: {says}" + (
            f"; was it meant in {' or '.join(fitting)}?" if fitting else ""
        )


# ------------------------------------------------------------------------------------------------- quantities


def _robot_values(robot: Robot) -> Iterator[Value]:
    """Quantities of backbone, disks and tendons."""
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
    yield from _tendon_values(robot)


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


def _tendon_values(robot: Robot) -> Iterator[Value]:
    """Quantities of the tendons, each alone and two by two."""
    for i, tendon in enumerate(robot.tendons):
        key, end = f"tendons[{i}]", robot.end(tendon)
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
        backbone, offset = robot.backbone, _offset(robot, tendon)
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
        a, b = (robot.holes(t) for t in (one, other))
        if a.shape == b.shape:
            apart = float(np.max(np.linalg.norm(a - b, axis=1)))
            yield Value("same_holes", f"tendons[{k}]", math.nan, "m", apart, f"tendons[{i}]")
    angles = [abs(getattr(t.routing, "angle_deg", math.inf)) for t in robot.tendons]
    if len(set(angles)) > 1:
        yield Value("angles", "tendons.angle_deg", max(angles), "deg", max(angles))


def _offset(robot: Robot, tendon: Tendon) -> float:
    """Largest distance of a tendon's holes from the axis [m]."""
    return float(np.max(np.linalg.norm(robot.holes(tendon), axis=1)))


def _gravity_values(robot: Robot, model: Model) -> Iterator[Value]:
    """Gravity, and the weights of a robot against the stiffness of its backbone."""
    g = float(np.linalg.norm(model.gravity))
    if g == 0.0:
        return
    b, key = robot.backbone, "model.gravity"
    masses = {
        "backbone.density": (b.density, "kg/m^3", b.mass_per_length * b.length),
        "disks.mass": (robot.disks.mass, "kg", robot.disks.mass * len(robot.disks.positions)),
        "tip_mass": (robot.tip_mass, "kg", robot.tip_mass),
    }
    yield Value("gravity", key, g, "m/s^2", g, f"{g / 9.81:.3g}")
    yield Value("direction", key, g, "m/s^2", abs(g - 1.0))
    yield Value("no_mass", key, g, "m/s^2", sum(mass for _, _, mass in masses.values()))
    for key, (value, unit, mass) in masses.items():
        ratio = mass * _bending(model.gravity) * b.length**2 / b.EI
        yield Value("weight", key, value, unit, ratio, f"{mass * g:.3g} N")


def _bending(vector: Vector) -> float:
    """Size of a force or acceleration, but for what pulls the robot straight: its component from base to tip."""
    x, y, z = vector
    return math.hypot(x, y, min(z, 0.0))


def _loading_values(robot: Robot, model: Model, steps: Sequence[LoadStep]) -> Iterator[Value]:
    """Quantities of a loading sequence; those of tendons in the step where they are largest."""
    b = robot.backbone
    strain, surface = f"strain_{material(b.youngs_modulus)}", "at the surface, by bending"
    for tendon in robot.tendons:
        tensions = [s.tensions.get(tendon.name, 0.0) for s in steps]
        k = int(np.argmax(tensions)) if tensions else 0
        force, key = max(tensions, default=0.0), f"steps[{k}].tensions.{tendon.name}"
        if tendon.pretension > force:
            force, key = tendon.pretension, f"tendons[{robot.tendons.index(tendon)}].pretension"
        # A parallel tendon bends the backbone to the curvature T a / EI (pure moment).
        offset = _offset(robot, tendon)
        strains = (force / b.EA, "along its axis"), (force * offset / b.EI * b.radius, surface)
        yield Value(strain, key, force, "N", *max(strains))
        if (ea := tendon.axial_stiffness or 0.0) >= limits()["tendon_stiffness"].low:
            yield Value("tendon_strain", key, force, "N", force / ea)
        moved = [s.displacements.get(tendon.name, 0.0) for s in steps]
        k = int(np.argmax(np.abs(moved))) if moved else 0
        far, key = moved[k] if moved else 0.0, f"steps[{k}].displacements.{tendon.name}"
        end = robot.end(tendon)
        yield Value("displacement", key, far, "m", abs(far) / end, f"{end:g} m")
    if not any(model.gravity[:2]) and not any(s.loads or any(s.tensions.values()) for s in steps):
        yield from _let_out(robot, steps)
    for k, step in enumerate(steps):
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


def _bends(robot: Robot, model: Model, steps: Sequence[LoadStep]) -> Iterator[Value]:
    """The largest angles by which inputs, or loads and weights where there are none, bend the robot, to first order."""
    b, inputs, loads = robot.backbone, [0.0], [0.0]
    for k, step in enumerate(steps):
        moment, turn = np.zeros(2), np.zeros(2)
        for tendon in robot.tendons:
            holes = robot.holes(tendon)
            offset, direction = (
                _offset(robot, tendon),
                holes[0] / max(float(np.linalg.norm(holes[0])), 1e-300),
            )
            tension = step.tensions.get(tendon.name, 0.0)
            moved = step.displacements.get(tendon.name, 0.0) / offset if offset > 0.0 else 0.0
            angle = tension * offset * robot.end(tendon) / b.EI
            inputs += [angle, abs(moved), tendon.pretension * offset * robot.end(tendon) / b.EI]
            moment, turn = moment + angle * direction, turn + moved * direction
        yield Value("wound", f"steps[{k}].tensions", math.nan, "", float(np.linalg.norm(moment)))
        yield Value("wound", f"steps[{k}].displacements", math.nan, "", float(np.linalg.norm(turn)))
        for load in step.loads.values():
            loads += [math.hypot(*load.force) * load.at**2 / b.EI, math.hypot(*load.moment) * load.at / b.EI]
    loads += [v.ratio for v in _gravity_values(robot, model) if v.limit == "weight"]
    largest = max(inputs) or max(loads)
    if largest > 0.0:
        yield Value("bends", "steps", math.nan, "", largest)


def _let_out(robot: Robot, steps: Sequence[LoadStep]) -> Iterator[Value]:
    """Displacements of tendons without pretension that nothing but displacements pulls."""
    slack: dict[str, list[float]] = {t.name: [] for t in robot.tendons if not t.pretension}
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
    values = [*_robot_values(robot), *_gravity_values(robot, model), *_loading_values(robot, model, steps)]
    values += _bends(robot, model, steps)
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
    modulus = _modulus_meant(robot.backbone, [v for v in beyond if v.row.by_stiffness])
    if modulus is not None:
        beyond = [*found, modulus]
    refused = [v for v in beyond if v.ratio > v.row.refused_from * v.row.high]
    if refused:
        raise ValueError("\n".join([*_sentences(refused), "Nothing was solved"]))
    return _sentences(beyond)


def _modulus_meant(b: Backbone, beyond: Sequence[Value]) -> Value | None:
    """Young's modulus, where another unit of it explains all that is beyond a limit."""
    soft = Value(
        "soft",
        "backbone.youngs_modulus",
        b.youngs_modulus,
        "Pa",
        b.youngs_modulus,
        material(b.youngs_modulus),
    )
    for size in UNITS["Pa"].values():
        meant = [v._replace(ratio=v.ratio / size) for v in beyond]
        usual = any(v.row.is_usual(v.ratio) for v in meant) and not any(v.is_beyond for v in meant)
        if usual and soft.is_beyond and soft.row.is_usual(soft.ratio * size):
            return soft
    return None


def _sentences(found: Iterable[Value]) -> list[str]:
    """One sentence for each limit, about the value that is farthest beyond it; a key is named once."""
    by_limit: dict[str, list[Value]] = {}
    named: set[str] = set()
    for value in sorted(found, key=lambda v: v.ratio / (v.row.high or 1.0), reverse=True):
        if value.key not in named:
            by_limit.setdefault(value.limit, []).append(value)
        named.add(value.key)
    others = {name: ", ".join(v.key for v in values[1:4]) for name, values in by_limit.items()}
    return [
        values[0].sentence + (f" (also {others[name]})" if others[name] else "")
        for name, values in by_limit.items()
    ]


def material(modulus: float) -> str:
    """Name in `MATERIALS` of what a backbone with this modulus is made of [Pa]."""
    return next(name for name, least in MATERIALS.items() if modulus >= least)


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
        kind = material(backbone.youngs_modulus)
        most = limits()[f"strain_{kind}"].high
        reason = f"no {kind} is elastic beyond {100 * most:g} %"
    if worst <= most:
        return []
    text = f"bending strains the surface of the backbone by {100 * worst:.3g} % at s = {where:.4g} m"
    return [f"step {number}: {text}; {reason}"]

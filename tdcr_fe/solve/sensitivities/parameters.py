"""Parameters by which results can be differentiated, named as in the files.

A parameter takes an `Experiment` (robot, model, steps) to one with another value. Names:
docs/sensitivities.md.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from difflib import get_close_matches
from typing import Any

import numpy as np

from tdcr_fe.effects import EFFECTS, Experiment, effect, with_effects
from tdcr_fe.effects.base import value_at, with_value_at
from tdcr_fe.elements import Array
from tdcr_fe.model.checks import ARC_TOLERANCE
from tdcr_fe.model.robot import Robot, Tendon
from tdcr_fe.model.routing import PointsRouting, Routing, TurnedRouting

#: Components of a load of the current step, in the order of its six values.
LOAD_COMPONENTS = ("force_x", "force_y", "force_z", "moment_x", "moment_y", "moment_z")


def with_arc_lengths(experiment: Experiment, new: Callable[[float], float]) -> Experiment:
    """The experiment with every arc length moved: disks, ends, loads, patches, holes of listed points."""
    robot = experiment.robot

    def routing(old: Routing) -> Routing:
        if isinstance(old, TurnedRouting):
            return replace(old, base=routing(old.base))
        if isinstance(old, PointsRouting):
            return replace(old, arc_lengths=tuple(new(s) for s in old.arc_lengths))
        return old

    backbone = replace(
        robot.backbone,
        length=new(robot.backbone.length),
        taper=tuple((new(s), r) for s, r in robot.backbone.taper),
        patches=tuple(replace(p, start=new(p.start), end=new(p.end)) for p in robot.backbone.patches),
    )
    tendons = tuple(
        replace(
            t,
            routing=routing(t.routing),
            end=None if t.end is None else new(t.end),
            tight_holes=tuple(replace(x, at=new(x.at)) for x in t.tight_holes),
        )
        for t in robot.tendons
    )
    disks = replace(robot.disks, positions=tuple(new(s) for s in robot.disks.positions))
    steps = tuple(
        replace(s, loads={name: replace(load, at=new(load.at)) for name, load in s.loads.items()})
        for s in experiment.steps
    )
    springs = tuple(replace(x, at=new(x.at)) for x in robot.springs)
    moved = replace(robot, backbone=backbone, disks=disks, tendons=tendons, springs=springs)
    return replace(experiment, robot=moved, steps=steps)


def with_length(experiment: Experiment, length: float) -> Experiment:
    """The experiment with a backbone of another length, all arc lengths in proportion."""
    ratio = length / experiment.robot.backbone.length
    return with_arc_lengths(experiment, lambda s: s * ratio)


def shortest_part(robot: Robot) -> float:
    """Shortest distance between disks and ends of patches [m], to which changes of arc lengths are small.

    Stiffness goes with the inverse of an element's length, so that a difference step in proportion to the whole
    backbone has an error that grows with the square of the number of elements.
    """
    patches = [s for patch in robot.backbone.patches for s in (patch.start, patch.end)]
    gaps = np.diff(sorted([0.0, *robot.disks.positions, *patches, robot.backbone.length]))
    return float(gaps[gaps > ARC_TOLERANCE].min())


#: Stiffnesses of the backbone that follow from moduli and radius where they are not declared.
_DERIVED = {
    "bending_stiffness": "EI",
    "torsional_stiffness": "GJ",
    "axial_stiffness": "EA",
    "shear_stiffness": "GA",
}
#: Keys of the files by the size of a change where a number is zero.
_KEYS_BY_SIZE = {
    1e-2: ("mass", "tip_mass", "moment", "creep_rate"),
    0.1: ("adhesion", "drop", "friction_coefficient"),
    1.0: ("force", "tensions", "time", "pretension", "stiffness"),
    10.0: ("gravity",),
    1e3: ("density",),
}
_SIZES = {key: size for size, keys in _KEYS_BY_SIZE.items() for key in keys}


@dataclass(frozen=True, eq=False)
class ModelParameter:
    """A number that the description of robot, model or steps depends on."""

    name: str
    value: float  # Present value, at which `apply` changes nothing
    size: float  # A typical value, in proportion to which difference steps are chosen
    # From an experiment and a value to the experiment with that value. Raises ValueError where it is
    # impossible.
    apply: Callable[[Experiment, float], Experiment]
    # Whether a derivative will do that leaves out in which order inputs change within a load step that only the
    # neighbours divide, as for choosing candidates; with friction there is no other
    approximate: bool = False


@dataclass(frozen=True)
class StepInput:
    """An input at the end of every load step, everything before the step unchanged."""

    name: str
    tendon: int = -1  # Number of a tendon whose tension or displacement is meant, -1 where a load is meant
    load: str = ""  # Name of the load; empty where a tendon is meant
    component: int = 0  # Which of the load's six values is meant


@dataclass(frozen=True, eq=False)
class StepInputs:
    """A number on which the inputs, or concentrated loads, of all load steps depend.

    Derivatives are those at the ends of the steps.
    """

    name: str
    change: Array  # (K, m): Derivatives of tensions [N] and lengths wound [m] by the number
    # By name of the load, derivatives of its forces [N] and moments [N m], shape (K, 6)
    loads: Mapping[str, Array] = field(default_factory=dict)


Parameter = ModelParameter | StepInput | StepInputs


def parameters(experiment: Experiment, names: Sequence[str | Parameter]) -> tuple[Parameter, ...]:
    """Parameters from their names; those already made stay as they are.

    Parameters
    ----------
    experiment
        Robot, model and steps.
    names
        Such as ``"backbone.youngs_modulus"``, ``"tendons.t1.offset"``, ``"effects.gravity.g_z"``, ``"inputs.t1"``.

    Raises
    ------
    TypeError
        Anything else than a list of names.
    ValueError
        An unknown or repeated name, or a field that is not a number.
    """
    if isinstance(names, str) or not isinstance(names, Sequence):
        raise TypeError(f"sensitivities = {names!r}: must be a list of names, such as ['backbone.length']")
    found = tuple(x if isinstance(x, Parameter) else _named(experiment, str(x)) for x in names)
    repeated = sorted(name for name, count in Counter(p.name for p in found).items() if count > 1)
    if repeated:
        raise ValueError(f"sensitivities: {repeated[0]!r} is named twice")
    return found


def effect_parameter(
    experiment: Experiment, name: str, parameter: str, values: Mapping[str, Mapping[str, float]] | None = None
) -> ModelParameter:
    """Parameter of an effect, at the values that several effects have now.

    Parameters
    ----------
    experiment
        Without these effects.
    name, parameter
        Names of the effect and of its parameter.
    values
        By effect, the values with which the simulated experiment was made by `with_effects`; None where it is the
        experiment itself.

    Returns
    -------
    ModelParameter
        Its `apply` ignores the experiment it is given and starts from the one given here. Parameters that are fitted
        through their inverse (``axial_stiffness``) are differentiated by the inverse.

    Raises
    ------
    ValueError
        The effect acts on the measurement only, or has no such parameter.
    """
    chosen, order = effect(name), [e.name for e in EFFECTS].index
    known = {p.name: p for p in chosen.parameters_of(experiment)}
    if parameter not in known:
        raise ValueError(f"effect {name}: no parameter {parameter!r}; it has {', '.join(known)}")
    if chosen.is_of_reading:
        raise ValueError(
            f"effects.{name} acts on the measurement only; the robot itself does not depend on it"
        )
    about = known[parameter]
    present = dict(values or {})
    # Null values depend on the effects that are applied before.
    before = {k: v for k, v in present.items() if order(k) < order(name)}
    below = with_effects(experiment, before)
    own = {**chosen.null_values(below), **present.get(name, {})}
    own.setdefault(parameter, chosen.null_value(below, parameter))
    start = about.coordinate(own[parameter])
    lower, upper = sorted((about.coordinate(about.lower), about.coordinate(about.upper)))

    def apply(_: Experiment, value: float) -> Experiment:
        if value == start:
            return with_effects(experiment, present)
        if not lower <= value <= upper:
            raise ValueError(f"effects.{name}.{parameter} = {value:g}; must be from {lower:g} to {upper:g}")
        return with_effects(experiment, {**present, name: {**own, parameter: about.value(value)}})

    # From zero most are linear, and a longer step has less round-off.
    size = max(abs(start), about.scale) if start != 0.0 else 100.0 * about.scale
    return ModelParameter(f"effects.{name}.{parameter}", start, size, apply)


def _named(experiment: Experiment, name: str) -> Parameter:
    """The parameter of a name."""
    tokens = re.findall(r"[^.\[\]]+", name)
    robot = experiment.robot
    if not tokens:
        raise ValueError(f"sensitivities: {name!r} names no parameter; {_examples(robot, name)}")
    root, rest = tokens[0], tokens[1:]
    try:
        if root == "effects" and len(rest) == 2:
            return effect_parameter(experiment, *rest)
        if root in ("inputs", "loads"):
            return _step_input(experiment, name, root, rest)
        if root == "tendons" and rest:
            return _tendon_parameter(robot, name, rest)
        if (root, rest) == ("backbone", ["length"]):
            return ModelParameter(name, robot.backbone.length, robot.backbone.length, with_length)
        if root == "backbone" and len(rest) == 1 and rest[0] in _DERIVED:
            value = getattr(robot.backbone, _DERIVED[rest[0]])
            return _field(name, ("robot", "backbone", rest[0]), value, value)
        if root == "disks" and len(rest) == 2 and rest[0] == "positions":
            return _disk_position(robot, name, int(rest[1]))
        if root in ("backbone", "disks", "tip_mass", "springs", "base_stiffness"):
            return _number(experiment, name, ("robot", *tokens))
        if root in ("model", "steps") and rest:
            return _number(experiment, name, tuple(tokens))
    except (KeyError, IndexError, AttributeError, TypeError) as error:
        raise ValueError(f"sensitivities: {name!r} names no number; {_examples(robot, name)}") from error
    raise ValueError(f"sensitivities: {name!r} names no parameter; {_examples(robot, name)}")


def _examples(robot: Robot, name: str) -> str:
    """The nearest name, and examples of what there is."""
    tables: dict[str, Any] = {"backbone": robot.backbone, "disks": robot.disks}
    tables |= {f"tendons.{t.name}": t for t in reversed(robot.tendons)}
    known = [f"{table}.{f.name}" for table, x in tables.items() for f in fields(x)]
    last = name.rpartition(".")[2]
    near = get_close_matches(name, known, n=1) or [n for n in known if last and last in n]
    hint = f"did you mean {near[0]}? " if near else ""
    tendon = robot.tendon_names[0] if robot.tendons else "t1"
    return (
        f"{hint}allowed are fields of the files such as backbone.youngs_modulus, disks.mass, tendons.{tendon}.offset, "
        f"tendons.friction_coefficient (all tendons), model.gravity[2], steps[0].tensions.{tendon}, "
        f"effects.gravity.g_z, and inputs.{tendon} or loads.NAME.force_x of every step"
    )


# ---------------------------------------------------------------------- values inside descriptions


def _field(name: str, path: Sequence[str], value: float, size: float) -> ModelParameter:
    return ModelParameter(name, value, size, lambda experiment, new: with_value_at(experiment, path, new))


def _number(experiment: Experiment, name: str, path: Sequence[str]) -> ModelParameter:
    value = value_at(experiment, path)
    if isinstance(value, bool) or not isinstance(value, int | float) or path[-1] == "substeps":
        raise TypeError(name)
    return _field(name, path, float(value), _size(experiment.robot, path, float(value)))


def _size(robot: Robot, path: Sequence[str], value: float) -> float:
    """Size of a typical value of a number: its own, where it is neither zero nor an angle."""
    last = next(t for t in reversed(path) if not t.isdigit())
    if last.endswith("_deg"):
        return 57.0
    if path[0] == "robot" and last in ("start", "end", "at"):
        return shortest_part(robot)
    if value != 0.0:
        return abs(value)
    if last == "precurvature":
        return 1.0 / robot.backbone.length
    return next((_SIZES[t] for t in reversed(path) if t in _SIZES), 1e-2 * robot.backbone.length)


# ---------------------------------------------------------------------- tendons


def _tendon_path(tendon: Tendon, tokens: Sequence[str]) -> tuple[str, ...]:
    """Where a key of a tendon's table lies in the tendon: in itself or in its routing."""
    if tokens[0] in {f.name for f in fields(tendon)} - {"name", "routing", "end"}:
        return tuple(tokens)
    path: tuple[str, ...] = ("routing",)
    routing: Routing = tendon.routing
    while isinstance(routing, TurnedRouting):
        if tokens[0] != "base" and tokens[0] in {f.name for f in fields(routing)}:
            break
        path, routing = (*path, "base"), routing.base
    if tokens[0] not in {f.name for f in fields(routing)}:  # type: ignore[arg-type]
        raise KeyError(tokens[0])
    return (*path, *tokens)


def _tendon_parameter(robot: Robot, name: str, rest: Sequence[str]) -> ModelParameter:
    """A number of one tendon, or of all at once."""
    names = robot.tendon_names
    if rest[0] in names and len(rest) > 1:
        which, tokens = [names.index(rest[0])], rest[1:]
    else:
        without = [i for i, t in enumerate(robot.tendons) if not t.friction]  # a law has the coefficient
        which, tokens = without if rest == ["friction_coefficient"] else list(range(len(names))), rest
    paths = [_tendon_path(robot.tendons[i], tokens) for i in which]
    present = [value_at(robot.tendons[i], path) for i, path in zip(which, paths, strict=True)]
    if any(x is None for x in present) and tokens[-1] == "axial_stiffness":
        raise ValueError(
            f"sensitivities: {name!r}: the tendon is inextensible; effects.tendon_stretch.axial_stiffness gives "
            "the derivative by its compliance"
        )
    if not present or any(isinstance(x, bool) or not isinstance(x, int | float) for x in present):
        raise TypeError(name)
    mean = float(sum(present)) / len(present)

    def apply(experiment: Experiment, value: float) -> Experiment:
        tendons = list(experiment.robot.tendons)
        for i, path, before in zip(which, paths, present, strict=True):
            tendons[i] = with_value_at(tendons[i], path, before + (value - mean))
        return experiment.with_robot(tendons=tuple(tendons))

    size = 0.2 if tokens[-1].startswith("turns") else max(_size(robot, tokens, float(x)) for x in present)
    return ModelParameter(name, mean, size, apply)


# ---------------------------------------------------------------------- disks


def _disk_position(robot: Robot, name: str, k: int) -> ModelParameter:
    """Arc length of a disk; tendons anchored at it and loads on it move with it."""
    present = robot.disks.positions[k]
    if abs(present - robot.backbone.length) < 1e-9:
        raise ValueError(
            f"sensitivities: {name!r}: the disk is at the tip and cannot move beyond it; backbone.length moves the tip"
        )

    def apply(experiment: Experiment, new: float) -> Experiment:
        return with_arc_lengths(experiment, lambda s: new if abs(s - present) < 1e-9 else s)

    return ModelParameter(name, present, shortest_part(robot), apply)


# ---------------------------------------------------------------------- inputs of the current step


def _step_input(experiment: Experiment, name: str, root: str, rest: Sequence[str]) -> StepInput:
    """Input of a tendon or component of a load, at the end of every step."""
    if root == "inputs" and len(rest) == 1 and rest[0] in experiment.robot.tendon_names:
        return StepInput(name, tendon=experiment.robot.tendon_names.index(rest[0]))
    if root == "loads" and len(rest) == 2 and rest[1] in LOAD_COMPONENTS:
        if any(rest[0] in step.loads for step in experiment.steps):
            return StepInput(name, load=rest[0], component=LOAD_COMPONENTS.index(rest[1]))
        raise ValueError(f"sensitivities: {name!r}: no step names the load {rest[0]!r}")
    raise KeyError(name)

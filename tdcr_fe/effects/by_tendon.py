"""Effects with one number of the tendons, for all, a segment or one: stretch, pretension; friction, holes."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any, ClassVar

from tdcr_fe.effects import base
from tdcr_fe.effects.base import Effect, ExcitationRange, Experiment, Form, Kind, Parameter, Values
from tdcr_fe.model.checks import ARC_TOLERANCE
from tdcr_fe.model.robot import Robot, Tendon


def segments(robot: Robot) -> tuple[tuple[str, ...], ...]:
    """Names of the tendons by segment: those that end at the same disk, from the base to the tip."""
    ends = sorted({robot.end(t) for t in robot.tendons})
    first = [s for k, s in enumerate(ends) if k == 0 or s - ends[k - 1] > ARC_TOLERANCE]
    by_segment: list[list[str]] = [[] for _ in first]
    for t in robot.tendons:
        by_segment[sum(s <= robot.end(t) for s in first) - 1].append(t.name)
    return tuple(tuple(names) for names in by_segment)


class SharedNumber(Effect):
    """An effect that gives every tendon one number, ``parameters[0]``, and has others for some of the tendons.

    The names of these begin with that of the number of all. The most particular one that is given counts.
    """

    part_names = ".+"


class TendonNumber(SharedNumber):
    """An effect that gives every tendon one number, ``parameters[0]``.

    Besides that of all tendons, ``NAME_segment_K`` is the number of those that end at the same disk, counted from the
    base, and ``NAME_TENDON`` that of one tendon. The most particular one that is given counts. Where a number is given
    for several tendons that declare different ones, it is their mean.

    Attributes
    ----------
    field : str
        Field of a tendon that has the number.
    """

    field: ClassVar[str]
    #: Whether a search tries the same number for all tendons alone.
    common: ClassVar[bool] = False

    def declared(self, experiment: Experiment, tendon: Tendon) -> float:
        """What a tendon declares; zero where it is friction, and the model has none."""
        without = self.needs_friction and experiment.model.friction == "none"
        return 0.0 if without else float(getattr(tendon, self.field))

    def with_number(self, tendon: Tendon, value: float) -> Tendon:
        """A tendon with another number."""
        changed: dict[str, Any] = {self.field: value}
        return replace(tendon, **changed)

    def applies_to(self, tendon: Tendon) -> bool:
        """Whether a tendon has such a number."""
        return True

    def combined(self, declared: float, null: float, value: float) -> float:
        """A tendon's number when the mean of several changes from ``null``: in proportion, or uniform from zero."""
        return declared * value / null if null > 0.0 else value

    def forms(self, experiment: Experiment) -> tuple[Effect, ...]:
        """The same for all tendons, one for each segment, one for each, and that of a single one."""
        forms = super().forms(experiment)
        if self.common or not forms:
            return forms
        names = experiment.robot.tendon_names
        groups = self._groups(experiment.robot)
        if 1 < len(groups) < len(names):
            forms = (*forms, NumberForm(self, "by segment", tuple(groups), experiment))
        if len(names) > 1:
            forms = (*forms, NumberForm(self, "each", list(self._each(experiment.robot)), experiment))
        return (*forms, *of_single_tendons(self, experiment))

    def parts_of(self, experiment: Experiment) -> dict[str, str]:
        """Each segment where there are several, and each tendon."""
        groups = self._groups(experiment.robot)
        named = (groups if len(groups) > 1 else {}) | self._each(experiment.robot)
        return {name.removeprefix(f"{self._name}_"): ", ".join(names) for name, names in named.items()}

    def null_values(self, experiment: Experiment) -> dict[str, float]:
        """The declared number; where tendons differ, their mean."""
        return {self._name: self.null_value(experiment, self._name)}

    def null_value(self, experiment: Experiment, name: str) -> float:
        """Declared number of a parameter's tendons; where they differ, the mean in the coordinate that is fitted."""
        one, robot = self.parameters[0], experiment.robot
        names = self._parts(robot).get(name, robot.tendon_names)
        meant = [t for t in robot.tendons if t.name in names and self.applies_to(t)]
        declared = [self.declared(experiment, t) for t in meant]
        if not declared:
            return one.null_value
        if len(set(declared)) == 1:
            return declared[0]
        return one.value(sum(map(one.coordinate, declared)) / len(declared))

    def changes(self, experiment: Experiment, values: Values) -> bool:
        """Whether any value differs from what is declared."""
        return any(x != self.null_value(experiment, name) for name, x in values.items())

    def apply(self, experiment: Experiment, values: Values) -> Experiment:
        """See `Effect.apply`; friction is switched on where the model has none and the effect needs it.

        Tendons whose number is not given then stay without.
        """
        if self.needs_friction and not (experiment.robot.tendons and self.changes(experiment, values)):
            return experiment
        # Of the parameters that are given, a tendon takes the most particular one, which is the last.
        given = [(key, names) for key, names in self._parts(experiment.robot).items() if key in values]
        key_of = {t: key for key, names in given for t in names}
        nulls = {key: self.null_value(experiment, key) for key in set(key_of.values())}

        def changed(t: Tendon) -> Tendon:
            if not self.applies_to(t):
                return t
            number, key = self.declared(experiment, t), key_of.get(t.name)
            if key is not None and values[key] != nulls[key]:
                same = number == nulls[key]
                number = values[key] if same else self.combined(number, nulls[key], values[key])
            return self.with_number(t, number)

        found = experiment.with_tendons(changed)
        return found.with_friction() if self.needs_friction else found

    @property
    def _name(self) -> str:
        return self.parameters[0].name

    def _each(self, robot: Robot) -> dict[str, tuple[str, ...]]:
        """Every tendon, by the name of its parameter."""
        return {f"{self._name}_{t}": (t,) for t in robot.tendon_names}

    def _groups(self, robot: Robot) -> dict[str, tuple[str, ...]]:
        """Tendons of every segment, by the name of its parameter; a tendon of such a name hides it."""
        named = {f"{self._name}_segment_{k}": tendons for k, tendons in enumerate(segments(robot), 1)}
        return {k: tendons for k, tendons in named.items() if k not in self._each(robot)}

    def _parts(self, robot: Robot) -> dict[str, tuple[str, ...]]:
        """Tendons by the name of their parameter: all, those of every segment, and every single one."""
        return {self._name: robot.tendon_names} | self._groups(robot) | self._each(robot)


class NumberForm(Form):
    """One number of an effect for each of several parts: segments or tendons of a robot, folders of data."""

    def bounds(self, experiment: Experiment) -> base.Bounds:
        """Bounds of the number of all, for each."""
        (limits,) = self.of.bounds(experiment).values()
        return {p.name: limits for p in self.parameters}

    def typical_steps(self, experiment: Experiment, excitation: ExcitationRange) -> dict[str, float]:
        """Each number by as much as that of all."""
        steps = self.of.typical_steps(experiment, excitation).values()
        return {p.name: step for step in steps for p in self.parameters}


def of_single_tendons(effect: SharedNumber, experiment: Experiment) -> tuple[Effect, ...]:
    """The number of an effect for one tendon, of every tendon of a robot; none where there is only one."""
    name, tendons = effect.parameters[0].name, experiment.robot.tendon_names
    count, several = len(tendons), tendons if len(tendons) > 1 else ()
    forms = ((t, NumberForm(effect, t, (f"{name}_{t}",), experiment)) for t in several)
    return tuple(form.one_of(count, f"tendon {t}") for t, form in forms)


class TendonStretch(TendonNumber):
    """Elastic tendons.

    Tendons stretch, so that part of the displacement at the base is lost as elongation: thin steel rope, nylon,
    aramid.

    Distinguished by: hold the robot straight, pull, and measure displacement over tension.
    """

    name = "tendon_stretch"
    kind = Kind("input", ("tension",))
    parameters = (
        Parameter("axial_stiffness", "N", 1.0, math.inf, math.inf, 1e-3, "EA of the tendons", inverse=True),
    )

    def declared(self, experiment: Experiment, tendon: Tendon) -> float:
        """Its EA; infinite for an inextensible tendon."""
        return math.inf if tendon.axial_stiffness is None else tendon.axial_stiffness

    def with_number(self, tendon: Tendon, value: float) -> Tendon:
        """With another EA."""
        return replace(tendon, axial_stiffness=None if math.isinf(value) else float(value))

    def combined(self, declared: float, null: float, value: float) -> float:
        """Where declared stiffnesses differ, every compliance changes by the same amount."""
        one = self.parameters[0]
        by = one.coordinate(value) - one.coordinate(null)
        return one.value(max(0.0, one.coordinate(declared) + by))

    def typical_steps(self, experiment: Experiment, excitation: ExcitationRange) -> dict[str, float]:
        """Stretch by a tenth of what is pulled in at the largest tension."""
        longest = max((experiment.robot.end(t) for t in experiment.robot.tendons), default=0.0)
        if longest == 0.0:
            return {}
        share = max(0.1 * excitation.displacement, 1e-5 * longest) / longest
        return {"axial_stiffness": share / max(excitation.tension, 1e-6)}


class Pretension(TendonNumber):
    """Tendons pulled in before what is called zero.

    Elastic tendons are tightened before the displacements are counted: they act on each other through the
    backbone, and become slack only when let out by more than their stretch.

    Distinguished by: let one tendon out step by step until it is slack.
    """

    name = field = "pretension"
    kind = Kind("input", ("nothing",))
    after = ("tendon_stretch",)
    parameters = (
        Parameter("tension", "N", 0.0, 1e3, 0.0, 0.05, "of the tendons in the straight, unloaded robot"),
    )

    def applies_to(self, tendon: Tendon) -> bool:
        """Where there are elastic tendons, to those: the tension of one that does not stretch follows from them."""
        return tendon.axial_stiffness is not None

    def apply(self, experiment: Experiment, values: Values) -> Experiment:
        """See `Effect.apply`.

        Raises
        ------
        ValueError
            No tendon is elastic.
        """
        tendons = experiment.robot.tendons
        if tendons and not any(map(self.applies_to, tendons)) and self.changes(experiment, values):
            text = "no tendon is elastic; give their axial_stiffness, or tendon_stretch"
            raise ValueError(f"effect pretension: {text}")
        return super().apply(experiment, values)

    def typical_steps(self, experiment: Experiment, excitation: ExcitationRange) -> dict[str, float]:
        """Half of the largest tension; nothing unless elastic tendons are driven by displacement."""
        robot, steps = experiment.robot, experiment.steps
        elastic = {t.name for t in robot.tendons if t.axial_stiffness is not None}
        shown = steps and elastic and elastic <= set(steps[0].displacements)
        return {"tension": 0.5 * max(excitation.tension, 0.01)} if shown else {}


# ------------------------------------------------------------------------------------------------------------- holes


class HoleFriction(TendonNumber):
    """Hole friction other than declared.

    Tendon and holes rub more or less than declared: another tendon, a burr, wear, oil.

    Distinguished by: measure the tension at the far end of a tendon while pulling and while letting out.
    """

    name = field = "friction_coefficient"
    kind = Kind("transmission", ("turning angle",))
    needs_disks = needs_friction = True
    parameters = (Parameter("mu", "1", 0.0, 3.0, 0.0, 0.03, "coefficient of friction at the holes"),)

    def applies_to(self, tendon: Tendon) -> bool:
        """Laws of the coefficient are kept."""
        return tendon.friction is None


class HoleAdhesion(TendonNumber):
    """A tension drop at every hole that does not grow with the tension.

    Every hole takes a fixed piece of tension: a tight fit, dirt, a sheath that pinches, glue that ran.

    Distinguished by: measure the tension at the far end of a tendon in the straight robot, at several tensions.
    """

    name, field, common = "hole_adhesion", "adhesion", True
    kind = Kind("transmission", ("slip",))
    needs_disks = needs_friction = True
    parameters = (Parameter("drop", "N", 0.0, 10.0, 0.0, 5e-3, "tension that one hole takes"),)

    def typical_steps(self, experiment: Experiment, excitation: ExcitationRange) -> dict[str, float]:
        """All holes together take a fifth of the largest tension."""
        robot = experiment.robot
        holes = max((len(robot.hole_arc_lengths(t)) - 2 for t in robot.tendons), default=0)
        return {"drop": 0.2 * excitation.tension / holes} if holes > 0 else {}


class HoleClearance(TendonNumber):
    """The tendon shifts inside an oversized hole.

    Holes are wider than the tendon, so that where the robot bends the tendon shifts towards the inside of the
    bend, farther from the backbone.

    Distinguished by: repeat the measurement with a thicker tendon, or measure the holes.
    """

    name, field, common = "hole_clearance", "clearance", True
    kind = Kind("routing", ("curvature",))
    needs_disks = True
    parameters = (Parameter("clearance", "m", 0.0, 5e-3, 0.0, 1e-4, "how far the tendon can shift sideways"),)

    def bounds(self, experiment: Experiment) -> base.Bounds:
        """At most half of the smallest offset, or the declared value."""
        robot = experiment.robot
        offsets = [math.hypot(x, y) for t in robot.tendons for x, y in robot.holes(t)]
        upper = min(5e-3, 0.5 * min((x for x in offsets if x > 0.0), default=1e-2))
        return {"clearance": (0.0, max(upper, self.null_values(experiment)["clearance"]))}

    def typical_steps(self, experiment: Experiment, excitation: ExcitationRange) -> dict[str, float]:
        """A twelfth of the smallest offset."""
        upper = self.bounds(experiment)["clearance"][1]
        return {"clearance": 0.16 * (upper - self.null_values(experiment)["clearance"])}

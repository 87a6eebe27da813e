"""Effects of the tendons and their holes: friction, adhesion, twisted routing, clearance, stretch, pretension."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

from tdcr_fe.effects.base import Effect, ExcitationRange, Experiment, Parameter, Values, with_friction
from tdcr_fe.model.robot import Robot, Tendon
from tdcr_fe.model.routing import TwistedRouting


def _mean(declared: Sequence[float]) -> float:
    """Mean of the tendons' declared values; exactly their value where all are the same."""
    return declared[0] if len(set(declared)) == 1 else sum(declared) / max(1, len(declared))


def _shifted(declared: float, null: float, value: float) -> float:
    """A tendon's value when the mean changes from ``null`` to ``value``: in proportion, or uniform from zero."""
    return declared * value / null if null > 0.0 and declared != null else value


class FrictionCoefficient(Effect):
    """Hole friction other than declared."""

    name = "friction_coefficient"
    description = "Tendon and holes rub more or less than declared: another tendon, a burr, wear, oil."
    separating_experiment = (
        "measure the tension at the far end of a tendon while pulling and while letting out"
    )
    parameters = (Parameter("mu", "1", 0.0, 3.0, 0.0, 0.03, "coefficient of friction at the holes"),)

    def null_values(self, experiment: Experiment) -> dict[str, float]:
        """The mean of the tendons' declared coefficients; zero where the model has no friction."""
        tendons = [t for t in experiment.robot.tendons if t.friction is None]
        if experiment.model.friction == "none" or not tendons:
            return {"mu": 0.0}
        return {"mu": sum(t.friction_coefficient for t in tendons) / len(tendons)}

    def apply(self, experiment: Experiment, values: Values) -> Experiment:
        """See `Effect.apply`; coefficients that differ keep their proportions, laws of the coefficient are kept."""
        if not experiment.robot.tendons:
            return experiment
        mu, declared = values["mu"], self.null_values(experiment)["mu"]
        if mu == declared:
            return experiment
        tendons = tuple(
            t
            if t.friction is not None
            else replace(
                t, friction_coefficient=mu * t.friction_coefficient / declared if declared > 0.0 else mu
            )
            for t in experiment.robot.tendons
        )
        return with_friction(experiment.with_robot(tendons=tendons))


class HoleAdhesion(Effect):
    """A tension drop at every hole that does not grow with the tension."""

    name = "hole_adhesion"
    description = (
        "Every hole takes a fixed piece of tension: a tight fit, dirt, a sheath that pinches, glue that ran."
    )
    separating_experiment = (
        "measure the tension at the far end of a tendon in the straight robot, at several tensions"
    )
    parameters = (Parameter("drop", "N", 0.0, 10.0, 0.0, 5e-3, "tension that one hole takes"),)

    def null_values(self, experiment: Experiment) -> dict[str, float]:
        """The mean of the tendons' declared values; zero where the model has no friction."""
        tendons = experiment.robot.tendons
        if experiment.model.friction == "none" or not tendons:
            return {"drop": 0.0}
        return {"drop": _mean([t.adhesion for t in tendons])}

    def probe_points(
        self, experiment: Experiment, excitation: ExcitationRange
    ) -> list[list[dict[str, float]]]:
        """All holes together take a twentieth, or a fifth, of the largest tension."""
        holes = max(
            (len(experiment.robot.hole_arc_lengths(t)) - 2 for t in experiment.robot.tendons), default=0
        )
        if holes < 1:
            return []
        declared = self.null_values(experiment)["drop"]
        return [[{"drop": declared + share * excitation.tension / holes}] for share in (0.05, 0.2)]

    def apply(self, experiment: Experiment, values: Values) -> Experiment:
        """See `Effect.apply`; drops that differ between tendons keep their proportions."""
        drop, null = values["drop"], self.null_values(experiment)["drop"]
        if drop == null:
            return experiment
        tendons = tuple(
            replace(t, adhesion=_shifted(t.adhesion, null, drop)) for t in experiment.robot.tendons
        )
        return with_friction(experiment.with_robot(tendons=tendons))


class RoutingTwist(Effect):
    """Holes rotated about the backbone, growing linearly with arc length."""

    name = "routing_twist"
    description = (
        "Disks were mounted turned against each other, or the backbone was twisted when they were fixed."
    )
    separating_experiment = (
        "look along the straight robot and measure the angle of the tip disk against the base"
    )
    parameters = (Parameter("angle_tip", "rad", -6.3, 6.3, 0.0, 0.03, "rotation of the holes at the tip"),)

    def apply(self, experiment: Experiment, values: Values) -> Experiment:
        """See `Effect.apply`."""
        angle = values["angle_tip"]
        if angle == 0.0:
            return experiment
        rate = angle / experiment.robot.backbone.length
        tendons = tuple(replace(t, routing=TwistedRouting(t.routing, rate)) for t in experiment.robot.tendons)
        return experiment.with_robot(tendons=tendons)


class HoleClearance(Effect):
    """The tendon shifts inside an oversized hole."""

    name = "hole_clearance"
    description = (
        "Holes are wider than the tendon, so that where the robot bends the tendon shifts towards the inside of the "
        "bend, farther from the backbone."
    )
    separating_experiment = "repeat the measurement with a thicker tendon, or measure the holes"
    parameters = (Parameter("clearance", "m", 0.0, 5e-3, 0.0, 1e-4, "how far the tendon can shift sideways"),)

    def null_values(self, experiment: Experiment) -> dict[str, float]:
        """The mean of the tendons' declared values."""
        tendons = experiment.robot.tendons
        return {"clearance": _mean([t.clearance for t in tendons]) if tendons else 0.0}

    def bounds(self, experiment: Experiment) -> dict[str, tuple[float, float]]:
        """At most half of the smallest offset, or the declared value."""
        offsets = [
            math.hypot(x, y)
            for t in experiment.robot.tendons
            for x, y in experiment.robot.holes(t)
            if math.hypot(x, y) > 0.0
        ]
        upper = min(5e-3, 0.5 * min(offsets, default=1e-2))
        return {"clearance": (0.0, max(upper, self.null_values(experiment)["clearance"]))}

    def probe_points(
        self, experiment: Experiment, excitation: ExcitationRange
    ) -> list[list[dict[str, float]]]:
        """A fiftieth and a twelfth of the smallest offset."""
        upper = self.bounds(experiment)["clearance"][1]
        declared = self.null_values(experiment)["clearance"]
        return [[{"clearance": declared + share * (upper - declared)}] for share in (0.04, 0.16)]

    def apply(self, experiment: Experiment, values: Values) -> Experiment:
        """See `Effect.apply`; clearances that differ between tendons keep their proportions."""
        null = self.null_values(experiment)["clearance"]
        tendons = tuple(
            replace(t, clearance=_shifted(t.clearance, null, values["clearance"]))
            for t in experiment.robot.tendons
        )
        return experiment.with_robot(tendons=tendons)


class TendonStretch(Effect):
    """Elastic tendons."""

    name = "tendon_stretch"
    description = (
        "Tendons stretch, so that part of the displacement at the base is lost as elongation: "
        "thin steel rope, nylon, aramid."
    )
    separating_experiment = "hold the robot straight, pull, and measure displacement over tension"
    parameters = (
        Parameter("axial_stiffness", "N", 1.0, math.inf, math.inf, 1e-3, "EA of the tendons", inverse=True),
    )

    def null_values(self, experiment: Experiment) -> dict[str, float]:
        """The declared value; where tendons differ, the stiffness of their mean compliance."""
        tendons = experiment.robot.tendons
        if len({t.axial_stiffness for t in tendons}) == 1:
            declared = tendons[0].axial_stiffness
            return {"axial_stiffness": math.inf if declared is None else declared}
        compliance = _mean([_compliance(t) for t in tendons]) if tendons else 0.0
        return {"axial_stiffness": self.parameters[0].value(compliance)}

    def probe_points(
        self, experiment: Experiment, excitation: ExcitationRange
    ) -> list[list[dict[str, float]]]:
        """Stretch by a tenth of what is pulled in at the largest tension."""
        longest = max((experiment.robot.end(t) for t in experiment.robot.tendons), default=0.0)
        if longest == 0.0:
            return []
        share = max(0.1 * excitation.displacement, 1e-5 * longest) / longest
        compliance = self.parameters[0].coordinate(self.null_values(experiment)["axial_stiffness"])
        return [[{"axial_stiffness": 1.0 / (compliance + share / max(excitation.tension, 1e-6))}]]

    def apply(self, experiment: Experiment, values: Values) -> Experiment:
        """See `Effect.apply`; where declared stiffnesses differ, every compliance changes by the same amount."""
        parameter = self.parameters[0]
        null = parameter.coordinate(self.null_values(experiment)["axial_stiffness"])
        compliance = parameter.coordinate(values["axial_stiffness"])
        alike = len({t.axial_stiffness for t in experiment.robot.tendons}) == 1
        tendons = []
        for t in experiment.robot.tendons:
            ea = values["axial_stiffness"]
            if not alike:
                ea = parameter.value(max(0.0, _compliance(t) + compliance - null))
            tendons.append(replace(t, axial_stiffness=None if math.isinf(ea) else float(ea)))
        return experiment.with_robot(tendons=tuple(tendons))


class Pretension(Effect):
    """Tendons pulled in before what is called zero."""

    name = "pretension"
    description = (
        "Elastic tendons are tightened before the displacements are counted: they act on each other through the "
        "backbone, and become slack only when let out by more than their stretch."
    )
    separating_experiment = "let one tendon out step by step until it is slack"
    after = ("tendon_stretch",)
    parameters: tuple[Parameter, ...] = (
        Parameter("tension", "N", 0.0, 1e3, 0.0, 0.05, "of the tendons in the straight, unloaded robot"),
    )

    def forms(self, robot: Robot) -> tuple[Effect, ...]:
        """The same for all tendons, and one for each."""
        return (self, PretensionOfEach(robot)) if len(robot.tendons) > 1 else (self,)

    def parameters_of(self, robot: Robot) -> tuple[Parameter, ...]:
        """One for all tendons, and ``tension_NAME`` for each."""
        return (
            *self.parameters,
            *(
                replace(self.parameters[0], name=f"tension_{t}", meaning=f"of {t}")
                for t in robot.tendon_names
            ),
        )

    def null_values(self, experiment: Experiment) -> dict[str, float]:
        """The mean of the tendons' declared values."""
        tendons = experiment.robot.tendons
        return {"tension": _mean([t.pretension for t in tendons]) if tendons else 0.0}

    def null_value(self, experiment: Experiment, name: str) -> float:
        """The declared value of one tendon, or their mean."""
        if name == "tension":
            return self.null_values(experiment)[name]
        return experiment.robot.tendon(name.removeprefix("tension_")).pretension

    def probe_points(
        self, experiment: Experiment, excitation: ExcitationRange
    ) -> list[list[dict[str, float]]]:
        """A twentieth and a half of the largest tension; nothing unless elastic tendons are driven by displacement."""
        robot, steps = experiment.robot, experiment.steps
        elastic = {t.name for t in robot.tendons if t.axial_stiffness is not None}
        if not steps or elastic != set(robot.tendon_names) or not elastic <= set(steps[0].displacements):
            return []
        null, largest = self.null_values(experiment)["tension"], max(excitation.tension, 0.01)
        return [[{"tension": null + share * largest}] for share in (0.05, 0.5)]

    def apply(self, experiment: Experiment, values: Values) -> Experiment:
        """See `Effect.apply`; pretensions that differ between tendons keep their proportions."""
        null = Pretension.null_values(self, experiment)["tension"]
        tendons = tuple(
            replace(
                t,
                pretension=values.get(
                    f"tension_{t.name}", _shifted(t.pretension, null, values.get("tension", null))
                ),
            )
            for t in experiment.robot.tendons
        )
        return experiment.with_robot(tendons=tendons)


class PretensionOfEach(Pretension):
    """Pretension with a parameter for each tendon of a robot."""

    name = "pretension (each)"

    def __init__(self, robot: Robot) -> None:
        self.parameters = Pretension().parameters_of(robot)[1:]

    @property
    def listed(self) -> str:
        """See `Effect.listed`."""
        return Pretension.name

    def null_values(self, experiment: Experiment) -> dict[str, float]:
        """The declared values."""
        return {f"tension_{t.name}": t.pretension for t in experiment.robot.tendons}

    def probe_points(
        self, experiment: Experiment, excitation: ExcitationRange
    ) -> list[list[dict[str, float]]]:
        """Each by a twentieth of the largest tension, and each by a half."""
        null = self.null_values(experiment)
        return [
            [{**null, name: null[name] + point["tension"]} for name in null]
            for (point,) in Pretension().probe_points(experiment, excitation)
        ]


def _compliance(tendon: Tendon) -> float:
    """Inverse of EA [1/N], zero for an inextensible tendon."""
    return 0.0 if tendon.axial_stiffness is None else 1.0 / tendon.axial_stiffness

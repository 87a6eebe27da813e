"""Effects of the holes and their places: friction, adhesion, twisted routing, clearance."""

from __future__ import annotations

import math
from dataclasses import replace

from tdcr_fe.effects.base import Effect, ExcitationRange, Experiment, Parameter, Values, with_friction
from tdcr_fe.effects.by_tendon import TendonNumber, mean, shifted
from tdcr_fe.model.routing import TwistedRouting
from tdcr_fe.model.tendon import Tendon


class FrictionCoefficient(TendonNumber):
    """Hole friction other than declared."""

    name = "friction_coefficient"
    needs_disks = needs_friction = True
    description = "Tendon and holes rub more or less than declared: another tendon, a burr, wear, oil."
    separating_experiment = (
        "measure the tension at the far end of a tendon while pulling and while letting out"
    )
    parameters = (Parameter("mu", "1", 0.0, 3.0, 0.0, 0.03, "coefficient of friction at the holes"),)

    def declared(self, experiment: Experiment, tendon: Tendon) -> float:
        """Its coefficient; zero where the model has no friction."""
        return 0.0 if experiment.model.friction == "none" else tendon.friction_coefficient

    def applies_to(self, tendon: Tendon) -> bool:
        """Laws of the coefficient are kept."""
        return tendon.friction is None

    def with_number(self, tendon: Tendon, value: float) -> Tendon:
        """With another coefficient."""
        return replace(tendon, friction_coefficient=value)

    def apply(self, experiment: Experiment, values: Values) -> Experiment:
        """See `Effect.apply`; friction is switched on where the model has none."""
        changed = any(x != self.null_value(experiment, name) for name, x in values.items())
        if not changed or not experiment.robot.tendons:
            return experiment
        if experiment.model.friction == "none":
            without = [
                replace(t, friction_coefficient=0.0) if self.applies_to(t) else t
                for t in experiment.robot.tendons
            ]
            experiment = experiment.with_robot(tendons=tuple(without))
        return with_friction(super().apply(experiment, values))


class HoleAdhesion(Effect):
    """A tension drop at every hole that does not grow with the tension."""

    name = "hole_adhesion"
    needs_disks = needs_friction = True
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
        return {"drop": mean([t.adhesion for t in tendons])}

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
            replace(t, adhesion=shifted(t.adhesion, null, drop)) for t in experiment.robot.tendons
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
    needs_disks = True
    description = (
        "Holes are wider than the tendon, so that where the robot bends the tendon shifts towards the inside of the "
        "bend, farther from the backbone."
    )
    separating_experiment = "repeat the measurement with a thicker tendon, or measure the holes"
    parameters = (Parameter("clearance", "m", 0.0, 5e-3, 0.0, 1e-4, "how far the tendon can shift sideways"),)

    def null_values(self, experiment: Experiment) -> dict[str, float]:
        """The mean of the tendons' declared values."""
        tendons = experiment.robot.tendons
        return {"clearance": mean([t.clearance for t in tendons]) if tendons else 0.0}

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
            replace(t, clearance=shifted(t.clearance, null, values["clearance"]))
            for t in experiment.robot.tendons
        )
        return experiment.with_robot(tendons=tendons)

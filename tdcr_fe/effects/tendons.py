"""Effects of the tendons and their holes: friction, adhesion, twisted routing, clearance, stretch."""

from __future__ import annotations

import math
from dataclasses import replace

from tdcr_fe.effects.base import Effect, Parameter, Reach, Setup, Values
from tdcr_fe.model.routing import TwistedRouting


def _with_friction(setup: Setup) -> Setup:
    """Friction switched on, where the declared model has none and can have it."""
    if setup.model.friction == "none" and setup.model.tendon_path == "straight":
        return replace(setup, model=replace(setup.model, friction="per-hole"))
    return setup


class FrictionCoefficient(Effect):
    """Hole friction other than declared."""

    name = "friction_coefficient"
    sentence = "Tendon and holes rub more or less than declared: another tendon, a burr, wear, oil."
    experiment = "measure the tension at the far end of a tendon while pulling and while letting out"
    parameters = (Parameter("mu", "1", 0.0, 3.0, 0.0, 0.03, "coefficient of friction at the holes"),)

    def absent(self, setup: Setup) -> dict[str, float]:
        """The mean of the tendons' declared coefficients; zero where the model has no friction."""
        tendons = setup.robot.tendons
        if setup.model.friction == "none" or not tendons:
            return {"mu": 0.0}
        return {"mu": sum(t.friction_coefficient for t in tendons) / len(tendons)}

    def apply(self, setup: Setup, values: Values) -> Setup:
        """See `Effect.apply`; coefficients that differ keep their proportions."""
        if not setup.robot.tendons:
            return setup
        mu, declared = values["mu"], self.absent(setup)["mu"]
        if mu == declared:
            return setup
        tendons = tuple(
            replace(t, friction_coefficient=mu * t.friction_coefficient / declared if declared > 0.0 else mu)
            for t in setup.robot.tendons
        )
        return _with_friction(setup.with_robot(tendons=tendons))


class HoleAdhesion(Effect):
    """A tension drop at every hole that does not grow with the tension."""

    name = "hole_adhesion"
    sentence = (
        "Every hole takes a fixed piece of tension: a tight fit, dirt, a sheath that pinches, glue that ran."
    )
    experiment = "measure the tension at the far end of a tendon in the straight robot, at several tensions"
    parameters = (Parameter("drop", "N", 0.0, 10.0, 0.0, 5e-3, "tension that one hole takes"),)

    def starts(self, setup: Setup, reach: Reach) -> list[list[dict[str, float]]]:
        """All holes together take a twentieth, or a fifth, of the largest tension."""
        holes = max((len(setup.robot.hole_arc_lengths(t)) - 2 for t in setup.robot.tendons), default=0)
        if holes < 1:
            return []
        return [[{"drop": share * reach.tension / holes}] for share in (0.05, 0.2)]

    def apply(self, setup: Setup, values: Values) -> Setup:
        """See `Effect.apply`."""
        if values["drop"] == 0.0:
            return setup
        return _with_friction(replace(setup, robot=setup.robot.with_tendons(adhesion=values["drop"])))


class RoutingTwist(Effect):
    """Holes rotated about the backbone, growing linearly with arc length."""

    name = "routing_twist"
    sentence = (
        "Disks were mounted turned against each other, or the backbone was twisted when they were fixed."
    )
    experiment = "look along the straight robot and measure the angle of the tip disk against the base"
    parameters = (Parameter("angle_tip", "rad", -6.3, 6.3, 0.0, 0.03, "rotation of the holes at the tip"),)

    def apply(self, setup: Setup, values: Values) -> Setup:
        """See `Effect.apply`."""
        angle = values["angle_tip"]
        if angle == 0.0:
            return setup
        rate = angle / setup.robot.backbone.length
        tendons = tuple(replace(t, routing=TwistedRouting(t.routing, rate)) for t in setup.robot.tendons)
        return setup.with_robot(tendons=tendons)


class HoleClearance(Effect):
    """The tendon shifts inside an oversized hole."""

    name = "hole_clearance"
    sentence = (
        "Holes are wider than the tendon, so that where the robot bends the tendon shifts towards the inside of the "
        "bend, farther from the backbone."
    )
    experiment = "repeat the measurement with a thicker tendon, or measure the holes"
    parameters = (Parameter("clearance", "m", 0.0, 5e-3, 0.0, 1e-4, "how far the tendon can shift sideways"),)

    def bounds(self, setup: Setup) -> dict[str, tuple[float, float]]:
        """At most half of the smallest offset."""
        offsets = [
            math.hypot(x, y)
            for t in setup.robot.tendons
            for x, y in setup.robot.holes(t)
            if math.hypot(x, y) > 0.0
        ]
        return {"clearance": (0.0, min(5e-3, 0.5 * min(offsets, default=1e-2)))}

    def starts(self, setup: Setup, reach: Reach) -> list[list[dict[str, float]]]:
        """A fiftieth and a twelfth of the smallest offset."""
        upper = self.bounds(setup)["clearance"][1]
        return [[{"clearance": 0.04 * upper}], [{"clearance": 0.16 * upper}]]

    def apply(self, setup: Setup, values: Values) -> Setup:
        """See `Effect.apply`."""
        return replace(setup, robot=setup.robot.with_tendons(clearance=values["clearance"]))


class TendonStretch(Effect):
    """Elastic tendons."""

    name = "tendon_stretch"
    sentence = (
        "Tendons stretch, so that what is pulled in at the base does not all arrive: "
        "thin steel rope, nylon, aramid."
    )
    experiment = "hold the robot straight by hand, pull, and measure displacement over tension"
    parameters = (
        Parameter("axial_stiffness", "N", 1.0, math.inf, math.inf, 1e-3, "EA of the tendons", inverse=True),
    )

    def absent(self, setup: Setup) -> dict[str, float]:
        """What is declared."""
        declared = [t.axial_stiffness for t in setup.robot.tendons if t.axial_stiffness is not None]
        return {"axial_stiffness": declared[0] if declared else math.inf}

    def starts(self, setup: Setup, reach: Reach) -> list[list[dict[str, float]]]:
        """Stretch by a tenth of what is pulled in at the largest tension."""
        longest = max((setup.robot.end(t) for t in setup.robot.tendons), default=0.0)
        if longest == 0.0:
            return []
        share = max(0.1 * reach.displacement, 1e-5 * longest) / longest
        compliance = self.parameters[0].coordinate(self.absent(setup)["axial_stiffness"])
        return [[{"axial_stiffness": 1.0 / (compliance + share / max(reach.tension, 1e-6))}]]

    def apply(self, setup: Setup, values: Values) -> Setup:
        """See `Effect.apply`."""
        ea = values["axial_stiffness"]
        return replace(
            setup, robot=setup.robot.with_tendons(axial_stiffness=None if math.isinf(ea) else float(ea))
        )

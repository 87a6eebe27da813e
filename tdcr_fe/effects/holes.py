"""Effects of holes and what passes through them: friction, adhesion, clearance."""

from __future__ import annotations

import math

from tdcr_fe.effects.base import Bounds, Effect, ExcitationRange, Experiment, Kind, Parameter, Points, Values
from tdcr_fe.effects.by_tendon import TendonNumber
from tdcr_fe.model.tendon import Tendon


class HoleFriction(TendonNumber):
    """Hole friction other than declared.

    Tendon and holes rub more or less than declared: another tendon, a burr, wear, oil.

    Distinguished by: measure the tension at the far end of a tendon while pulling and while letting out.
    """

    name = field = "friction_coefficient"
    kind = Kind("transmission", ("turning angle",))
    needs_disks = needs_friction = True
    parameters = (Parameter("mu", "1", 0.0, 3.0, 0.0, 0.03, "coefficient of friction at the holes"),)

    def declared(self, experiment: Experiment, tendon: Tendon) -> float:
        """Its coefficient; zero where the model has no friction."""
        return 0.0 if experiment.model.friction == "none" else tendon.friction_coefficient

    def applies_to(self, tendon: Tendon) -> bool:
        """Laws of the coefficient are kept."""
        return tendon.friction is None

    def apply(self, experiment: Experiment, values: Values) -> Experiment:
        """See `Effect.apply`; friction is switched on where the model has none."""
        changed = any(x != self.null_value(experiment, name) for name, x in values.items())
        if not changed or not experiment.robot.tendons:
            return experiment
        if experiment.model.friction == "none":
            tendons = experiment.robot.tendons
            without = [self.with_number(t, 0.0) if self.applies_to(t) else t for t in tendons]
            experiment = experiment.with_robot(tendons=tuple(without))
        return super().apply(experiment, values).with_friction()


class HoleAdhesion(TendonNumber):
    """A tension drop at every hole that does not grow with the tension.

    Every hole takes a fixed piece of tension: a tight fit, dirt, a sheath that pinches, glue that ran.

    Distinguished by: measure the tension at the far end of a tendon in the straight robot, at several tensions.
    """

    name, field = "hole_adhesion", "adhesion"
    kind = Kind("transmission", ("slip",))
    needs_disks = needs_friction = True
    parameters = (Parameter("drop", "N", 0.0, 10.0, 0.0, 5e-3, "tension that one hole takes"),)

    def forms(self, experiment: Experiment) -> tuple[Effect, ...]:
        """The same for all tendons."""
        return Effect.forms(self, experiment)

    def declared(self, experiment: Experiment, tendon: Tendon) -> float:
        """Its drop; zero where the model has no friction."""
        return 0.0 if experiment.model.friction == "none" else tendon.adhesion

    def probe_points(self, experiment: Experiment, excitation: ExcitationRange) -> Points:
        """All holes together take a twentieth, or a fifth, of the largest tension."""
        robot = experiment.robot
        holes = max((len(robot.hole_arc_lengths(t)) - 2 for t in robot.tendons), default=0)
        if holes < 1:
            return []
        declared = self.null_values(experiment)["drop"]
        return [[{"drop": declared + share * excitation.tension / holes}] for share in (0.05, 0.2)]

    def apply(self, experiment: Experiment, values: Values) -> Experiment:
        """See `Effect.apply`; friction is switched on where the model has none."""
        if all(x == self.null_value(experiment, name) for name, x in values.items()):
            return experiment
        return super().apply(experiment, values).with_friction()


class HoleClearance(TendonNumber):
    """The tendon shifts inside an oversized hole.

    Holes are wider than the tendon, so that where the robot bends the tendon shifts towards the inside of the
    bend, farther from the backbone.

    Distinguished by: repeat the measurement with a thicker tendon, or measure the holes.
    """

    name, field = "hole_clearance", "clearance"
    kind = Kind("routing", ("curvature",))
    needs_disks = True
    parameters = (Parameter("clearance", "m", 0.0, 5e-3, 0.0, 1e-4, "how far the tendon can shift sideways"),)

    def forms(self, experiment: Experiment) -> tuple[Effect, ...]:
        """The same for all tendons."""
        return Effect.forms(self, experiment)

    def bounds(self, experiment: Experiment) -> Bounds:
        """At most half of the smallest offset, or the declared value."""
        robot = experiment.robot
        offsets = [math.hypot(x, y) for t in robot.tendons for x, y in robot.holes(t)]
        upper = min(5e-3, 0.5 * min((x for x in offsets if x > 0.0), default=1e-2))
        return {"clearance": (0.0, max(upper, self.null_values(experiment)["clearance"]))}

    def probe_points(self, experiment: Experiment, excitation: ExcitationRange) -> Points:
        """A fiftieth and a twelfth of the smallest offset."""
        upper = self.bounds(experiment)["clearance"][1]
        declared = self.null_values(experiment)["clearance"]
        return [[{"clearance": declared + share * (upper - declared)}] for share in (0.04, 0.16)]

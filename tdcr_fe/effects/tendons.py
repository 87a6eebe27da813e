"""Effects of the tendons themselves: stretch and pretension."""

from __future__ import annotations

import math
from dataclasses import replace

from tdcr_fe.effects.base import ExcitationRange, Experiment, Parameter, Values
from tdcr_fe.effects.by_tendon import TendonNumber
from tdcr_fe.model.tendon import Tendon


class TendonStretch(TendonNumber):
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


class Pretension(TendonNumber):
    """Tendons pulled in before what is called zero."""

    name = "pretension"
    description = (
        "Elastic tendons are tightened before the displacements are counted: they act on each other through the "
        "backbone, and become slack only when let out by more than their stretch."
    )
    separating_experiment = "let one tendon out step by step until it is slack"
    after = ("tendon_stretch",)
    parameters = (
        Parameter("tension", "N", 0.0, 1e3, 0.0, 0.05, "of the tendons in the straight, unloaded robot"),
    )

    def declared(self, experiment: Experiment, tendon: Tendon) -> float:
        """Its pretension."""
        return tendon.pretension

    def applies_to(self, tendon: Tendon) -> bool:
        """Where there are elastic tendons, to those: the tension of one that does not stretch follows from them."""
        return tendon.axial_stiffness is not None

    def with_number(self, tendon: Tendon, value: float) -> Tendon:
        """With another pretension."""
        return replace(tendon, pretension=value)

    def apply(self, experiment: Experiment, values: Values) -> Experiment:
        """See `Effect.apply`.

        Raises
        ------
        ValueError
            No tendon is elastic.
        """
        tendons = experiment.robot.tendons
        given = any(x != self.null_value(experiment, name) for name, x in values.items())
        if given and tendons and not any(self.applies_to(t) for t in tendons):
            raise ValueError(
                "effect pretension: no tendon is elastic; give their axial_stiffness, or tendon_stretch"
            )
        return super().apply(experiment, values)

    def probe_points(
        self, experiment: Experiment, excitation: ExcitationRange
    ) -> list[list[dict[str, float]]]:
        """A twentieth and a half of the largest tension; nothing unless elastic tendons are driven by displacement."""
        robot, steps = experiment.robot, experiment.steps
        elastic = {t.name for t in robot.tendons if t.axial_stiffness is not None}
        if not steps or not elastic or not elastic <= set(steps[0].displacements):
            return []
        null, largest = self.null_values(experiment)["tension"], max(excitation.tension, 0.01)
        return [[{"tension": null + share * largest}] for share in (0.05, 0.5)]

"""Effects of the backbone and its disks: stiffness, superelasticity, precurvature, thick disks, creep."""

from __future__ import annotations

import itertools
from dataclasses import replace

from tdcr_fe.effects.base import Effect, Parameter, Reach, Setup, Values
from tdcr_fe.model.robot import Superelastic


class StiffnessScale(Effect):
    """Bending and torsional stiffness other than declared."""

    name = "stiffness_scale"
    sentence = (
        "The backbone is softer or stiffer than declared: a modulus from a data sheet, a diameter at the edge of "
        "its tolerance (stiffness goes with its fourth power), a heat treatment."
    )
    experiment = "bend the bare backbone by a known weight at its tip, no tendon pulled"
    parameters = (
        Parameter("bending", "1", 0.05, 20.0, 1.0, 0.05, "factor on the bending stiffness"),
        Parameter("torsion", "1", 0.05, 20.0, 1.0, 0.1, "factor on the torsional stiffness"),
    )

    def apply(self, setup: Setup, values: Values) -> Setup:
        """See `Effect.apply`."""
        b = setup.robot.backbone
        changed = replace(
            b, bending_stiffness=b.EI * values["bending"], torsional_stiffness=b.GJ * values["torsion"]
        )
        return setup.with_robot(backbone=changed)


class SuperelasticBackbone(Effect):
    """Bending moment that softens with curvature."""

    name = "superelastic"
    sentence = (
        "The bending moment grows less than the curvature beyond a strain of the outer fibre: nickel-titanium "
        "turning to martensite, a plastic near its yield."
    )
    experiment = "bend the bare backbone over mandrels of decreasing radius and measure the moment"
    shapes = ("threshold_strain",)
    parameters = (
        Parameter("threshold_strain", "1", 1e-5, 0.2, 0.2, 1e-3, "strain of the outer fibre where it begins"),
        Parameter("plateau_ratio", "1", 0.01, 1.0, 1.0, 0.1, "slope beyond it over the slope before it"),
    )

    def apply(self, setup: Setup, values: Values) -> Setup:
        """See `Effect.apply`."""
        law = None
        if values["plateau_ratio"] < 1.0:
            law = Superelastic(values["threshold_strain"], values["plateau_ratio"])
        return setup.with_robot(backbone=replace(setup.robot.backbone, superelastic=law))

    def bounds(self, setup: Setup) -> dict[str, tuple[float, float]]:
        """See `Effect.bounds`."""
        return {"threshold_strain": (1e-5, 0.2), "plateau_ratio": (0.01, 1.0)}

    def starts(self, setup: Setup, reach: Reach) -> list[list[dict[str, float]]]:
        """Thresholds at shares of the strain that the data reach."""
        strain = max(reach.curvature * setup.robot.backbone.radius, 2e-5)
        return [
            [{"threshold_strain": min(share * strain, 0.2), "plateau_ratio": 0.7}]
            for share in (0.25, 0.5, 0.75)
        ]


class Precurvature(Effect):
    """The unloaded backbone is bent."""

    name = "precurvature"
    sentence = (
        "The unloaded backbone is bent: wire off a spool, a print that warped, a robot bent once too far."
    )
    experiment = "measure the shape with no tendon pulled, once more with the robot turned about its axis"
    parameters = (
        Parameter("kappa_x", "1/m", -20.0, 20.0, 0.0, 0.05, "turning rate of the section about its x axis"),
        Parameter("kappa_y", "1/m", -20.0, 20.0, 0.0, 0.05, "turning rate of the section about its y axis"),
    )

    def absent(self, setup: Setup) -> dict[str, float]:
        """What is declared."""
        x, y = setup.robot.backbone.precurvature
        return {"kappa_x": x, "kappa_y": y}

    def apply(self, setup: Setup, values: Values) -> Setup:
        """See `Effect.apply`."""
        bent = (values["kappa_x"], values["kappa_y"])
        return setup.with_robot(backbone=replace(setup.robot.backbone, precurvature=bent))


class RigidDisks(Effect):
    """Disks stiffen the length they occupy."""

    name = "rigid_disks"
    sentence = (
        "Glued or clamped disks keep the backbone straight over the length they occupy; less of it bends."
    )
    experiment = "measure positions on both sides of a disk closely, or compare a robot with thinner disks"
    parameters = (
        Parameter("thickness", "m", 0.0, 0.1, 0.0, 1e-3, "length of backbone that each disk makes rigid"),
    )

    def absent(self, setup: Setup) -> dict[str, float]:
        """What is declared."""
        return {"thickness": setup.robot.disks.thickness}

    def bounds(self, setup: Setup) -> dict[str, tuple[float, float]]:
        """Something flexible is left in the shortest bay."""
        s = (0.0, *setup.robot.disks.positions)
        first = 2.0 * s[1]
        return {"thickness": (0.0, 0.95 * min([first, *(b - a for a, b in itertools.pairwise(s))]))}

    def starts(self, setup: Setup, reach: Reach) -> list[list[dict[str, float]]]:
        """A tenth of a bay."""
        upper = self.bounds(setup)["thickness"][1]
        here = self.absent(setup)["thickness"]
        return [[{"thickness": here + 0.1 * (upper - here)}]]

    def apply(self, setup: Setup, values: Values) -> Setup:
        """See `Effect.apply`."""
        return setup.with_robot(disks=replace(setup.robot.disks, thickness=values["thickness"]))


class Creep(Effect):
    """Compliance that grows with time."""

    name = "creep"
    sentence = (
        "The backbone yields slowly under load, so that the same load bends it further later: polymers, glue, "
        "warm joints."
    )
    experiment = "hold one load for the length of the experiment, and repeat the first loads at the end"
    parameters = (
        Parameter(
            "rate", "1/s", 0.0, 10.0, 0.0, 1e-4, "growth of the compliance per second, over the elastic one"
        ),
    )

    def starts(self, setup: Setup, reach: Reach) -> list[list[dict[str, float]]]:
        """A twentieth more compliance at the end."""
        return [[{"rate": 0.05 / reach.duration}]] if reach.duration > 0.0 else []

    def apply(self, setup: Setup, values: Values) -> Setup:
        """See `Effect.apply`."""
        return setup.with_robot(backbone=replace(setup.robot.backbone, creep_rate=values["rate"]))

"""Effects of the backbone, its base and its disks: stiffness, superelasticity, precurvature, thick disks, creep."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace

from tdcr_fe.effects.base import Effect, ExcitationRange, Experiment, Parameter, Values
from tdcr_fe.model.backbone import StiffnessPatch, Superelastic


class StiffnessScale(Effect):
    """Bending and torsional stiffness other than declared."""

    name = "stiffness_scale"
    description = (
        "The backbone is softer or stiffer than declared: a modulus from a data sheet, a diameter at the edge of "
        "its tolerance (stiffness goes with its fourth power), a heat treatment."
    )
    separating_experiment = "bend the bare backbone by a known weight at its tip, no tendon pulled"
    parameters = (
        Parameter("bending", "1", 0.05, 20.0, 1.0, 0.05, "factor on the bending stiffness"),
        Parameter("torsion", "1", 0.05, 20.0, 1.0, 0.1, "factor on the torsional stiffness"),
    )

    def apply(self, experiment: Experiment, values: Values) -> Experiment:
        """See `Effect.apply`."""
        b = experiment.robot.backbone
        changed = replace(
            b, bending_stiffness=b.EI * values["bending"], torsional_stiffness=b.GJ * values["torsion"]
        )
        return experiment.with_robot(backbone=changed)


class SuperelasticBackbone(Effect):
    """Bending moment that softens with curvature."""

    name = "superelastic"
    description = (
        "The bending moment grows less than the curvature beyond a strain of the outer fibre: nickel-titanium "
        "turning to martensite, a plastic near its yield."
    )
    separating_experiment = "bend the bare backbone over mandrels of decreasing radius and measure the moment"
    parameters = (
        Parameter("threshold_strain", "1", 1e-5, 0.2, 0.2, 1e-3, "strain of the outer fibre where it begins"),
        Parameter("plateau_ratio", "1", 0.01, 1.0, 1.0, 0.1, "slope beyond it over the slope before it"),
    )

    def null_values(self, experiment: Experiment) -> dict[str, float]:
        """The declared law; a plateau ratio of one where none is declared."""
        law = experiment.robot.backbone.superelastic
        if law is None:
            return super().null_values(experiment)
        return {"threshold_strain": law.threshold_strain, "plateau_ratio": law.plateau_ratio}

    def unidentifiable_at_null(self, experiment: Experiment) -> tuple[str, ...]:
        """The threshold, where no law is declared."""
        return ("threshold_strain",) if experiment.robot.backbone.superelastic is None else ()

    def apply(self, experiment: Experiment, values: Values) -> Experiment:
        """See `Effect.apply`."""
        law = None
        if values["plateau_ratio"] < 1.0:
            law = Superelastic(values["threshold_strain"], values["plateau_ratio"])
        return experiment.with_robot(backbone=replace(experiment.robot.backbone, superelastic=law))

    def bounds(self, experiment: Experiment) -> dict[str, tuple[float, float]]:
        """See `Effect.bounds`."""
        return {"threshold_strain": (1e-5, 0.2), "plateau_ratio": (0.01, 1.0)}

    def probe_points(
        self, experiment: Experiment, excitation: ExcitationRange
    ) -> list[list[dict[str, float]]]:
        """Thresholds at shares of the largest strain in the data; steps from a declared law."""
        law = experiment.robot.backbone.superelastic
        if law is not None:
            null = self.null_values(experiment)
            softer = max(0.01, law.plateau_ratio - 0.1)
            return [
                [{**null, "threshold_strain": 0.9 * law.threshold_strain}, {**null, "plateau_ratio": softer}]
            ]
        strain = max(excitation.curvature * experiment.robot.backbone.radius, 2e-5)
        return [
            [{"threshold_strain": min(share * strain, 0.2), "plateau_ratio": 0.7}]
            for share in (0.25, 0.5, 0.75)
        ]


class Precurvature(Effect):
    """The unloaded backbone is bent."""

    name = "precurvature"
    description = (
        "The unloaded backbone is bent: wire off a spool, a print that warped, a robot bent once too far."
    )
    separating_experiment = (
        "measure the shape with no tendon pulled, once more with the robot turned about its axis"
    )
    parameters = (
        Parameter("kappa_x", "1/m", -20.0, 20.0, 0.0, 0.05, "turning rate of the section about its x axis"),
        Parameter("kappa_y", "1/m", -20.0, 20.0, 0.0, 0.05, "turning rate of the section about its y axis"),
    )

    def null_values(self, experiment: Experiment) -> dict[str, float]:
        """The declared values."""
        x, y = experiment.robot.backbone.precurvature
        return {"kappa_x": x, "kappa_y": y}

    def apply(self, experiment: Experiment, values: Values) -> Experiment:
        """See `Effect.apply`."""
        bent = (values["kappa_x"], values["kappa_y"])
        return experiment.with_robot(backbone=replace(experiment.robot.backbone, precurvature=bent))


class BaseCompliance(Effect):
    """The base gives way."""

    name = "base_compliance"
    description = (
        "The backbone turns in its clamp, or the clamp on its support: a set screw, a print, a stand."
    )
    separating_experiment = (
        "push the backbone just above the base plate by a known force, and measure its tilt"
    )
    parameters = (
        Parameter(
            "stiffness",
            "N m/rad",
            1e-6,
            math.inf,
            math.inf,
            0.02,
            "rotational stiffness about the x and y axes",
            inverse=True,
        ),
    )

    def null_values(self, experiment: Experiment) -> dict[str, float]:
        """The declared value, infinite where none is declared."""
        declared = experiment.robot.base_stiffness
        return {"stiffness": math.inf if declared is None else declared}

    def probe_points(
        self, experiment: Experiment, excitation: ExcitationRange
    ) -> list[list[dict[str, float]]]:
        """As compliant as a fiftieth of the backbone."""
        parameter, backbone = self.parameters[0], experiment.robot.backbone
        compliance = parameter.coordinate(self.null_values(experiment)["stiffness"])
        return [[{"stiffness": parameter.value(compliance + 0.02 * backbone.length / backbone.EI)}]]

    def apply(self, experiment: Experiment, values: Values) -> Experiment:
        """See `Effect.apply`."""
        stiffness = values["stiffness"]
        return experiment.with_robot(base_stiffness=None if math.isinf(stiffness) else stiffness)


class RigidDisks(Effect):
    """Disks stiffen the length they occupy."""

    name = "rigid_disks"
    needs_disks = True
    description = (
        "Glued or clamped disks keep the backbone straight over the length they occupy; less of it bends."
    )
    separating_experiment = (
        "measure positions on both sides of a disk closely, or compare a robot with thinner disks"
    )
    parameters = (
        Parameter("thickness", "m", 0.0, 0.1, 0.0, 1e-3, "length of backbone that each disk makes rigid"),
    )

    def null_values(self, experiment: Experiment) -> dict[str, float]:
        """The declared values."""
        return {"thickness": experiment.robot.disks.thickness}

    def bounds(self, experiment: Experiment) -> dict[str, tuple[float, float]]:
        """Largest thickness that leaves a flexible part of the shortest bay."""
        s = (0.0, *experiment.robot.disks.positions)
        first = 2.0 * s[1]
        return {"thickness": (0.0, 0.95 * min([first, *(b - a for a, b in itertools.pairwise(s))]))}

    def probe_points(
        self, experiment: Experiment, excitation: ExcitationRange
    ) -> list[list[dict[str, float]]]:
        """A tenth of a bay."""
        upper = self.bounds(experiment)["thickness"][1]
        here = self.null_values(experiment)["thickness"]
        return [[{"thickness": here + 0.1 * (upper - here)}]]

    def near_null(self, experiment: Experiment) -> Effect:
        """See `Effect.near_null`."""
        return ThinDisks() if experiment.robot.disks.thickness == 0.0 else self

    def apply(self, experiment: Experiment, values: Values) -> Experiment:
        """See `Effect.apply`."""
        return experiment.with_robot(disks=replace(experiment.robot.disks, thickness=values["thickness"]))


class ThinDisks(RigidDisks):
    """Disks so thin that they add no element: every bay is stiffer by the share of it that they make rigid.

    At small bends every bay then turns as with `RigidDisks`, to first order in the thickness. Where bays bend by half
    a radian, the derivative is up to twice as large, in nearly the same direction: enough to order candidates.
    """

    def near_null(self, experiment: Experiment) -> Effect:
        """See `Effect.near_null`."""
        return self

    def apply(self, experiment: Experiment, values: Values) -> Experiment:
        """See `Effect.apply`."""
        edges = (0.0, *experiment.robot.disks.positions)
        backbone, thickness = experiment.robot.backbone, values["thickness"]
        bays = []
        for k, (start, end) in enumerate(itertools.pairwise(edges)):
            rigid = (0.5 if k == 0 else 1.0) * thickness
            factor = (end - start) / (end - start - rigid)
            bays.append(StiffnessPatch(start, end, factor, factor))
        return experiment.with_robot(backbone=replace(backbone, patches=(*backbone.patches, *bays)))


class Creep(Effect):
    """Compliance that grows with time."""

    name = "creep"
    description = (
        "The backbone yields slowly under load, so that the same load bends it further later: polymers, glue, "
        "warm joints."
    )
    separating_experiment = (
        "hold one load for the length of the experiment, and repeat the first loads at the end"
    )
    parameters = (
        Parameter(
            "rate", "1/s", 0.0, 10.0, 0.0, 1e-4, "growth of the compliance per second, over the elastic one"
        ),
    )

    def null_values(self, experiment: Experiment) -> dict[str, float]:
        """The declared values."""
        return {"rate": experiment.robot.backbone.creep_rate}

    def probe_points(
        self, experiment: Experiment, excitation: ExcitationRange
    ) -> list[list[dict[str, float]]]:
        """A twentieth more compliance at the end."""
        declared = experiment.robot.backbone.creep_rate
        return [[{"rate": declared + 0.05 / excitation.duration}]] if excitation.duration > 0.0 else []

    def apply(self, experiment: Experiment, values: Values) -> Experiment:
        """See `Effect.apply`."""
        return experiment.with_robot(backbone=replace(experiment.robot.backbone, creep_rate=values["rate"]))

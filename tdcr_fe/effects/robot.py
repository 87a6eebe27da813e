"""Effects of the robot itself: stiffness and material of the backbone, base, weight and payload, disks, channels."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace

from tdcr_fe.effects.base import Bounds, Effect, ExcitationRange, Experiment, Kind, Parameter, Points, Values
from tdcr_fe.model.backbone import NonlinearMaterial, StiffnessPatch, Superelastic
from tdcr_fe.model.robot import Tendon
from tdcr_fe.model.routing import MisplacedRouting, TwistedRouting


class StiffnessScale(Effect):
    """Bending and torsional stiffness other than declared.

    The backbone is softer or stiffer than declared: a modulus from a data sheet, a diameter at the edge of its
    tolerance (stiffness goes with its fourth power), a heat treatment.

    Distinguished by: bend the bare backbone by a known weight at its tip, no tendon pulled.
    """

    name = "stiffness_scale"
    kind = Kind("stiffness", ("nothing",))
    parameters = (
        Parameter("bending", "1", 0.05, 20.0, 1.0, 0.05, "factor on the bending stiffness"),
        Parameter("torsion", "1", 0.05, 20.0, 1.0, 0.1, "factor on the torsional stiffness"),
    )

    def apply(self, experiment: Experiment, values: Values) -> Experiment:
        """See `Effect.apply`."""
        b = experiment.robot.backbone
        bending, torsion = b.EI * values["bending"], b.GJ * values["torsion"]
        return experiment.with_backbone(bending_stiffness=bending, torsional_stiffness=torsion)


class SuperelasticBackbone(Effect):
    """Bending moment that softens with curvature.

    The bending moment grows less than the curvature beyond a strain of the outer fibre: nickel-titanium turning to
    martensite, a plastic near its yield.

    Distinguished by: bend the bare backbone over mandrels of decreasing radius and measure the moment.
    """

    name = "superelastic"
    kind = Kind("stiffness", ("curvature",))
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
        return experiment.with_backbone(superelastic=law)

    def probe_points(self, experiment: Experiment, excitation: ExcitationRange) -> Points:
        """Thresholds at shares of the largest strain in the data; steps from a declared law."""
        law = experiment.robot.backbone.superelastic
        if law is not None:
            null = self.null_values(experiment)
            softer = {**null, "plateau_ratio": max(0.01, law.plateau_ratio - 0.1)}
            return [[{**null, "threshold_strain": 0.9 * law.threshold_strain}, softer]]
        strain = max(excitation.curvature * experiment.robot.backbone.radius, 2e-5)
        thresholds = [min(share * strain, 0.2) for share in (0.25, 0.5, 0.75)]
        return [[{"threshold_strain": threshold, "plateau_ratio": 0.7}] for threshold in thresholds]


class Precurvature(Effect):
    """The unloaded backbone is bent.

    The unloaded backbone is bent: wire off a spool, a print that warped, a robot bent once too far.

    Distinguished by: measure the shape with no tendon pulled, once more with the robot turned about its axis.
    """

    name = "precurvature"
    stands_at = ("robot", "backbone", "precurvature")
    kind = Kind("precurvature", ("nothing",))
    parameters = (
        Parameter("kappa_x", "1/m", -20.0, 20.0, 0.0, 0.05, "turning rate of the section about its x axis"),
        Parameter("kappa_y", "1/m", -20.0, 20.0, 0.0, 0.05, "turning rate of the section about its y axis"),
    )


class BaseCompliance(Effect):
    """The base gives way.

    The backbone turns in its clamp, or the clamp on its support: a set screw, a print, a stand.

    Distinguished by: push the backbone just above the base plate by a known force, and measure its tilt.
    """

    name = "base_compliance"
    stands_at = ("robot", "base_stiffness")
    kind = Kind("base", ("nothing",), "base")
    _meaning = "rotational stiffness about the x and y axes"
    parameters = (Parameter("stiffness", "N m/rad", 1e-6, math.inf, math.inf, 0.02, _meaning, inverse=True),)

    def typical_steps(self, experiment: Experiment, excitation: ExcitationRange) -> dict[str, float]:
        """As compliant as a fiftieth of the backbone."""
        backbone = experiment.robot.backbone
        return {"stiffness": 0.02 * backbone.length / backbone.EI}


class Creep(Effect):
    """Compliance that grows with time.

    The backbone yields slowly under load, so that the same load bends it further later: polymers, glue, warm
    joints.

    Distinguished by: hold one load for the length of the experiment, and repeat the first loads at the end.
    """

    name = "creep"
    stands_at = ("robot", "backbone", "creep_rate")
    kind = Kind("stiffness", ("time",))
    parameters = (
        Parameter(
            "rate", "1/s", 0.0, 10.0, 0.0, 1e-4, "growth of the compliance per second, over the elastic one"
        ),
    )

    def typical_steps(self, experiment: Experiment, excitation: ExcitationRange) -> dict[str, float]:
        """A twentieth more compliance at the end."""
        return {"rate": 0.05 / excitation.duration} if excitation.duration > 0.0 else {}


#: Axial strain by the largest commanded tension, or by the weight, from which a body counts as soft [1].
SOFT_STRAIN = 5e-3


def is_soft(experiment: Experiment) -> bool:
    """Whether the loads stretch or compress the backbone so much that its modulus shows in more than bending."""
    backbone = experiment.robot.backbone
    weight = backbone.mass_per_length * backbone.length * max(map(abs, experiment.model.gravity))
    return max(experiment.largest_tension, weight) > SOFT_STRAIN * backbone.EA


class SoftEffect(Effect):
    """An effect that a search tries only on soft bodies: in others it is a listed effect of bending, or nothing."""

    def forms(self, experiment: Experiment) -> tuple[Effect, ...]:
        """None where the loads hardly stretch the backbone."""
        return super().forms(experiment) if is_soft(experiment) else ()


class ModulusScale(SoftEffect):
    """Young's modulus other than declared.

    The material is softer or stiffer than declared, in bending, torsion, stretching and shear alike: another batch
    or mixture of a silicone, its age, its temperature.

    Distinguished by: hang a weight from a strip of the same casting and measure how far it stretches.
    """

    name = "modulus_scale"
    kind = Kind("stiffness", ("nothing",))
    parameters = (
        Parameter("factor", "1", 0.02, 50.0, 1.0, 0.05, "factor on all stiffnesses of the backbone"),
    )

    def apply(self, experiment: Experiment, values: Values) -> Experiment:
        """See `Effect.apply`; stiffnesses that are declared are scaled as those from the modulus."""
        backbone, factor = experiment.robot.backbone, values["factor"]
        names = ("bending_stiffness", "torsional_stiffness", "axial_stiffness", "shear_stiffness")
        declared = {n: getattr(backbone, n) * factor for n in names if getattr(backbone, n) is not None}
        return experiment.with_backbone(youngs_modulus=backbone.youngs_modulus * factor, **declared)


class DensityScale(SoftEffect):
    """Weight of the body other than declared.

    The body is lighter or heavier than declared: bubbles in the casting, a filler, hollow channels. Only its ratio
    to the modulus and the tensions shows in the shape.

    Distinguished by: weigh the robot.
    """

    name = "density_scale"
    kind = Kind("force", ("nothing",), "along the backbone")
    parameters = (Parameter("factor", "1", 0.02, 50.0, 1.0, 0.05, "factor on the density of the backbone"),)

    def forms(self, experiment: Experiment) -> tuple[Effect, ...]:
        """None where nothing is heavy in the declared model: there `gravity` is the effect."""
        heavy = experiment.robot.backbone.density > 0.0 and any(experiment.model.gravity)
        return super().forms(experiment) if heavy else ()

    def apply(self, experiment: Experiment, values: Values) -> Experiment:
        """See `Effect.apply`."""
        return experiment.with_backbone(density=experiment.robot.backbone.density * values["factor"])


class NonlinearBackbone(SoftEffect):
    """Fibres along the backbone that harden or soften with their strain.

    The stress does not grow in proportion to the strain, E (e + quadratic e^2 + cubic e^3): rubber, foam, soft
    prints. Compressed by its tendons, such a body bends more or less easily.

    Distinguished by: stretch and compress a sample of the material and record the force.
    """

    name = "nonlinear_material"
    kind = Kind("stiffness", ("curvature",))
    parameters = (
        Parameter(
            "quadratic", "1", -20.0, 20.0, 0.0, 0.3, "below zero softer in tension than in compression"
        ),
        Parameter("cubic", "1", -30.0, 400.0, 0.0, 1.0, "hardening, below zero softening"),
    )

    def null_values(self, experiment: Experiment) -> dict[str, float]:
        """The declared law; zero where the material is linear."""
        law = experiment.robot.backbone.nonlinear or NonlinearMaterial()
        return {"quadratic": law.quadratic, "cubic": law.cubic}

    def apply(self, experiment: Experiment, values: Values) -> Experiment:
        """See `Effect.apply`."""
        law = NonlinearMaterial(values["quadratic"], values["cubic"])
        declared = experiment.robot.backbone.nonlinear is not None
        return experiment.with_backbone(nonlinear=law if declared or law != NonlinearMaterial() else None)


class Gravity(Effect):
    """Weight of backbone and disks.

    Backbone, disks and payload have weight, or the robot's orientation differs from the model's.

    Distinguished by: measure the unloaded shape in two orientations of the base.
    """

    name = "gravity"
    stands_at = ("model", "gravity")
    kind = Kind("force", ("nothing",), "along the backbone")
    parameters = tuple(
        Parameter(f"g_{axis}", "m/s^2", -12.0, 12.0, 0.0, 1.0, f"acceleration of gravity along {axis}")
        for axis in "xyz"
    )


class TipPayload(Effect):
    """An undeclared mass at the tip.

    Something sits at the tip that was not declared: a camera, a marker, a screw, the knot of a tendon.

    Distinguished by: weigh what is at the tip, or hang a known weight there and compare.
    """

    name = "tip_payload"
    kind = Kind("force", ("nothing",), "tip")
    parameters = (Parameter("mass", "kg", 0.0, 10.0, 0.0, 5e-4, "mass at the tip besides the declared one"),)

    def apply(self, experiment: Experiment, values: Values) -> Experiment:
        """See `Effect.apply`."""
        return experiment.with_robot(tip_mass=experiment.robot.tip_mass + values["mass"])


# ------------------------------------------------------------------------------------------------ disks and channels


class RigidDisks(Effect):
    """Disks stiffen the length they occupy.

    Glued or clamped disks keep the backbone straight over the length they occupy; less of it bends.

    Distinguished by: measure positions on both sides of a disk closely, or compare a robot with thinner disks.
    """

    name = "rigid_disks"
    stands_at = ("robot", "disks", "thickness")
    kind = Kind("stiffness", ("place",), "disks")
    needs_disks = True
    parameters = (
        Parameter("thickness", "m", 0.0, 0.1, 0.0, 1e-3, "length of backbone that each disk makes rigid"),
    )

    def bounds(self, experiment: Experiment) -> Bounds:
        """Largest thickness that leaves a flexible part of the shortest bay."""
        s = (0.0, *experiment.robot.disks.positions)
        return {"thickness": (0.0, 0.95 * min([2.0 * s[1], *(b - a for a, b in itertools.pairwise(s))]))}

    def typical_steps(self, experiment: Experiment, excitation: ExcitationRange) -> dict[str, float]:
        """A tenth of a bay."""
        upper = self.bounds(experiment)["thickness"][1]
        return {"thickness": 0.1 * (upper - self.null_values(experiment)["thickness"])}

    def near_null(self, experiment: Experiment) -> Effect:
        """See `Effect.near_null`."""
        return ThinDisks() if experiment.robot.disks.thickness == 0.0 else self


class ThinDisks(RigidDisks):
    """Disks so thin that they add no element: every bay is stiffer by the share of it that they make rigid.

    At small bends every bay then turns as with `RigidDisks`, to first order in the thickness. Where bays bend by half
    a radian, the derivative is up to twice as large, in nearly the same direction: enough to order candidates.
    """

    def apply(self, experiment: Experiment, values: Values) -> Experiment:
        """See `Effect.apply`."""
        edges = (0.0, *experiment.robot.disks.positions)
        backbone, thickness = experiment.robot.backbone, values["thickness"]
        bays = []
        for k, (start, end) in enumerate(itertools.pairwise(edges)):
            rigid = (0.5 if k == 0 else 1.0) * thickness
            factor = (end - start) / (end - start - rigid)
            bays.append(StiffnessPatch(start, end, factor, factor))
        return experiment.with_backbone(patches=(*backbone.patches, *bays))


class RoutingTwist(Effect):
    """Holes rotated about the backbone, growing linearly with arc length.

    Disks were mounted turned against each other, or the backbone was twisted when they were fixed.

    Distinguished by: look along the straight robot and measure the angle of the tip disk against the base.
    """

    name = "routing_twist"
    kind = Kind("routing", ("place",))
    parameters = (Parameter("angle_tip", "rad", -6.3, 6.3, 0.0, 0.03, "rotation of the holes at the tip"),)

    def apply(self, experiment: Experiment, values: Values) -> Experiment:
        """See `Effect.apply`."""
        rate = values["angle_tip"] / experiment.robot.backbone.length
        if rate == 0.0:
            return experiment
        return experiment.with_tendons(lambda t: replace(t, routing=TwistedRouting(t.routing, rate)))


#: Numbers of a channel and what they are where it runs as declared; the names are those of `MisplacedRouting`.
AS_DECLARED = {"factor_base": 1.0, "factor_end": 1.0, "angle_base": 0.0, "angle_end": 0.0}


def _parameter(name: str) -> Parameter:
    kind, where = name.split("_")
    at = "at the base plate" if where == "base" else "at the tendon's end"
    if kind == "factor":
        return Parameter(name, "1", 0.1, 5.0, 1.0, 0.02, f"factor on the distance from the axis {at}")
    return Parameter(name, "rad", -1.6, 1.6, 0.0, 0.03, f"angle about the axis {at}")


class MisplacedChannels(Effect):
    """Channels run farther from the axis or nearer to it, or at another angle, linearly from base to end.

    The channels of the tendons run elsewhere in the body than declared: the pins that leave them free bend or
    shift in the mould when it is filled. Or holes of disks are at other angles, as where these were put together by
    hand.

    Distinguished by: cut a casting of the same mould across, or look along the robot, and measure where they are.

    A number holds for all tendons, and ``NAME_TENDON`` for one of them.
    """

    name = "misplaced_channels"
    kind = Kind("routing", ("place",))
    parameters = (_parameter("factor_end"),)
    more = (
        *(_parameter(n) for n in AS_DECLARED if n != "factor_end"),
        Parameter("angle", "rad", -1.6, 1.6, 0.0, 0.03, "angle about the axis, from base to end"),
    )
    part_names = ".+"

    def forms(self, experiment: Experiment) -> tuple[Effect, ...]:
        """The offset at the end, an angle for each tendon, both, or all for each.

        Where disks hold the holes, angles against the first of at least three tendons, the same in all disks.
        """
        tendons = experiment.robot.tendon_names
        if not experiment.robot.without_disks or not tendons:
            others = [f"angle_{t}" for t in tendons[1:]]  # a frame that is turned moves all
            form = self.form("angles", others, experiment)
            form.kind = Kind("routing", ("nothing",))
            return (form,) if len(others) > 1 else ()
        angles = [f"angle_{where}_{t}" for where in ("base", "end") for t in tendons]
        each = [f"factor_end_{t}" for t in tendons]
        return (
            self,
            self.form("angles", angles, experiment),
            self.form("offset and angles", ["factor_end", *angles], experiment),
            self.form("each", [*each, *angles], experiment),
        )

    def parts_of(self, experiment: Experiment) -> dict[str, str]:
        """The tendons."""
        return {t: t for t in experiment.robot.tendon_names}

    def apply(self, experiment: Experiment, values: Values) -> Experiment:
        """See `Effect.apply`."""
        return experiment.with_tendons(lambda t: _moved(t, values))


def _moved(tendon: Tendon, values: Values) -> Tendon:
    """A tendon whose channel runs elsewhere."""
    angle = values.get(f"angle_{tendon.name}", values.get("angle", 0.0))
    given = AS_DECLARED | {"angle_base": angle, "angle_end": angle}
    numbers = {n: values.get(f"{n}_{tendon.name}", values.get(n, x)) for n, x in given.items()}
    if numbers == AS_DECLARED:
        return tendon
    return replace(tendon, routing=MisplacedRouting(tendon.routing, **numbers))

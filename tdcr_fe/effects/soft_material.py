"""Effects of soft bodies: modulus, density, and a material that hardens or softens."""

from __future__ import annotations

from dataclasses import replace

from tdcr_fe.effects.base import Effect, Experiment, Parameter, Values
from tdcr_fe.model.backbone import NonlinearMaterial

#: Axial strain by the largest commanded tension, or by the weight, from which a body counts as soft [1].
SOFT_STRAIN = 5e-3


def is_soft(experiment: Experiment) -> bool:
    """Whether the loads stretch or compress the backbone so much that its modulus shows in more than bending."""
    backbone = experiment.robot.backbone
    tension = max((t for s in experiment.steps for t in s.tensions.values()), default=0.0)
    weight = backbone.mass_per_length * backbone.length * max(map(abs, experiment.model.gravity))
    return max(tension, weight) > SOFT_STRAIN * backbone.EA


class SoftEffect(Effect):
    """An effect that a search tries only on soft bodies: in others it is a listed effect of bending, or nothing."""

    def forms(self, experiment: Experiment) -> tuple[Effect, ...]:
        """None where the loads hardly stretch the backbone."""
        return super().forms(experiment) if is_soft(experiment) else ()


class ModulusScale(SoftEffect):
    """Young's modulus other than declared."""

    name = "modulus_scale"
    description = (
        "The material is softer or stiffer than declared, in bending, torsion, stretching and shear alike: another "
        "batch or mixture of a silicone, its age, its temperature."
    )
    separating_experiment = "hang a weight from a strip of the same casting and measure how far it stretches"
    parameters = (
        Parameter("factor", "1", 0.02, 50.0, 1.0, 0.05, "factor on all stiffnesses of the backbone"),
    )

    def apply(self, experiment: Experiment, values: Values) -> Experiment:
        """See `Effect.apply`; stiffnesses that are declared are scaled as those from the modulus."""
        backbone, factor = experiment.robot.backbone, values["factor"]
        names = ("bending_stiffness", "torsional_stiffness", "axial_stiffness", "shear_stiffness")
        declared = {n: getattr(backbone, n) * factor for n in names if getattr(backbone, n) is not None}
        changed = replace(backbone, youngs_modulus=backbone.youngs_modulus * factor, **declared)
        return experiment.with_robot(backbone=changed)


class DensityScale(SoftEffect):
    """Weight of the body other than declared."""

    name = "density_scale"
    description = (
        "The body is lighter or heavier than declared: bubbles in the casting, a filler, hollow channels. Only its "
        "ratio to the modulus and the tensions shows in the shape."
    )
    separating_experiment = "weigh the robot"
    parameters = (Parameter("factor", "1", 0.02, 50.0, 1.0, 0.05, "factor on the density of the backbone"),)

    def forms(self, experiment: Experiment) -> tuple[Effect, ...]:
        """None where nothing is heavy in the declared model: there `gravity` is the effect."""
        heavy = experiment.robot.backbone.density > 0.0 and any(experiment.model.gravity)
        return super().forms(experiment) if heavy else ()

    def apply(self, experiment: Experiment, values: Values) -> Experiment:
        """See `Effect.apply`."""
        backbone = experiment.robot.backbone
        changed = replace(backbone, density=backbone.density * values["factor"])
        return experiment.with_robot(backbone=changed)


class NonlinearBackbone(SoftEffect):
    """Fibres along the backbone that harden or soften with their strain."""

    name = "nonlinear_material"
    description = (
        "The stress does not grow in proportion to the strain, E (e + quadratic e^2 + cubic e^3): rubber, foam, soft "
        "prints. Compressed by its tendons, such a body bends more or less easily."
    )
    separating_experiment = "stretch and compress a sample of the material and record the force"
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
        backbone = experiment.robot.backbone
        present = law if law != NonlinearMaterial() or backbone.nonlinear is not None else None
        return experiment.with_robot(backbone=replace(backbone, nonlinear=present))

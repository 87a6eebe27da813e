"""Candidate effects: what a model of a real robot may lack, for use in a scenario and by `identify`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from tdcr_fe.effects.actuation import ActuatorBacklash, ActuatorLoss
from tdcr_fe.effects.base import Effect, ExcitationRange, Experiment, Observation, Parameter
from tdcr_fe.effects.channels import MisplacedChannels
from tdcr_fe.effects.command_numbers import ActuatorGain, IdleTension
from tdcr_fe.effects.holes import FrictionCoefficient, HoleAdhesion, HoleClearance, RoutingTwist
from tdcr_fe.effects.loads import Gravity, TipPayload
from tdcr_fe.effects.material import (
    BaseCompliance,
    Creep,
    Precurvature,
    RigidDisks,
    StiffnessScale,
    SuperelasticBackbone,
)
from tdcr_fe.effects.observation import FrameMisalignment, MarkerOffset
from tdcr_fe.effects.places import EffectAtPlace, Kink, PlaceEffect, SoftBay, SpringToGround, StuckHole
from tdcr_fe.effects.soft_material import DensityScale, ModulusScale, NonlinearBackbone
from tdcr_fe.effects.tendons import Pretension, TendonStretch
from tdcr_fe.effects.timing import TimeLag
from tdcr_fe.model.arguments import check_instance

#: Every effect, in the order in which several are applied: the command first, the measurement last.
EFFECTS: tuple[Effect, ...] = (
    TimeLag(),
    ActuatorGain(),
    ActuatorBacklash(),
    ActuatorLoss(),
    IdleTension(),
    Gravity(),
    TipPayload(),
    ModulusScale(),
    DensityScale(),
    StiffnessScale(),
    SuperelasticBackbone(),
    NonlinearBackbone(),
    Precurvature(),
    BaseCompliance(),
    RigidDisks(),
    Creep(),
    FrictionCoefficient(),
    HoleAdhesion(),
    RoutingTwist(),
    MisplacedChannels(),
    HoleClearance(),
    TendonStretch(),
    Pretension(),
    SoftBay(),
    Kink(),
    SpringToGround(),
    StuckHole(),
    MarkerOffset(),
    FrameMisalignment(),
)


def effect(name: str, catalogue: Sequence[Effect] = EFFECTS) -> Effect:
    """The effect of that name; `KeyError` names those that exist."""
    for e in catalogue:
        if e.name == name:
            return e
    raise KeyError(f"no effect {name!r}; there are {', '.join(e.name for e in catalogue)}")


def with_effects(
    experiment: Experiment,
    effects: Mapping[str, Mapping[str, float]],
    catalogue: Sequence[Effect] = EFFECTS,
) -> Experiment:
    """Add several effects to an experiment.

    Parameters
    ----------
    experiment
        Robot, model, steps and observation.
    effects
        By name of the effect, its values; parameters that are not named keep their null values.
    catalogue
        The effects that there are, in the order in which several are applied.

    Raises
    ------
    KeyError, ValueError
        An unknown effect or parameter, or a value out of bounds.
    """
    hint = "Experiment(robot, model, steps) makes one."
    check_instance("with_effects", "experiment", experiment, Experiment, "an Experiment", hint)
    hint = "{'gravity': {'g_z': -9.81}} is one."
    check_instance("with_effects", "effects", effects, Mapping, "a mapping of names to values", hint)
    for name in effects:
        effect(name, catalogue)
    for e in catalogue:
        if e.name in effects:
            e.check(effects[e.name], experiment)
            experiment = e.apply(experiment, {**e.null_values(experiment), **effects[e.name]})
    return experiment


def with_effect(experiment: Experiment, name: str, **values: float) -> Experiment:
    """Add one effect to an experiment: ``with_effect(experiment, "gravity", g_z=-9.81)``."""
    return with_effects(experiment, {name: values})


__all__ = [
    "EFFECTS",
    "Effect",
    "EffectAtPlace",
    "ExcitationRange",
    "Experiment",
    "Observation",
    "Parameter",
    "PlaceEffect",
    "effect",
    "with_effect",
    "with_effects",
]

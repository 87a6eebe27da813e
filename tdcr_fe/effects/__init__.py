"""Candidate effects: what a model of a real robot may lack, each usable by hand and by the closed loop."""

from __future__ import annotations

from collections.abc import Mapping

from tdcr_fe.effects.actuation import ActuatorBacklash, ActuatorGain, ActuatorLoss
from tdcr_fe.effects.base import Effect, Observation, Parameter, Reach, Setup
from tdcr_fe.effects.loads import Gravity, TipPayload
from tdcr_fe.effects.material import (
    Creep,
    Precurvature,
    RigidDisks,
    StiffnessScale,
    SuperelasticBackbone,
)
from tdcr_fe.effects.observation import FrameMisalignment, MarkerOffset
from tdcr_fe.effects.tendons import (
    FrictionCoefficient,
    HoleAdhesion,
    HoleClearance,
    RoutingTwist,
    TendonStretch,
)

#: Every effect, in the order in which several are applied: the command first, the measurement last.
EFFECTS: tuple[Effect, ...] = (
    ActuatorGain(),
    ActuatorBacklash(),
    ActuatorLoss(),
    Gravity(),
    TipPayload(),
    StiffnessScale(),
    SuperelasticBackbone(),
    Precurvature(),
    RigidDisks(),
    Creep(),
    FrictionCoefficient(),
    HoleAdhesion(),
    RoutingTwist(),
    HoleClearance(),
    TendonStretch(),
    MarkerOffset(),
    FrameMisalignment(),
)


def effect(name: str) -> Effect:
    """The effect of that name; `KeyError` names those that exist."""
    for e in EFFECTS:
        if e.name == name:
            return e
    raise KeyError(f"no effect {name!r}; there are {', '.join(e.name for e in EFFECTS)}")


def with_effects(setup: Setup, effects: Mapping[str, Mapping[str, float]]) -> Setup:
    """Add several effects to a setup.

    Parameters
    ----------
    setup
        Robot, model, steps and observation.
    effects
        By name of the effect, its values; parameters that are not named stay absent.

    Raises
    ------
    KeyError, ValueError
        An unknown effect or parameter, or a value out of bounds.
    """
    for name in effects:
        effect(name)
    for e in EFFECTS:
        if e.name in effects:
            e.check(effects[e.name])
            setup = e.apply(setup, {**e.absent(setup), **effects[e.name]})
    return setup


def with_effect(setup: Setup, name: str, **values: float) -> Setup:
    """Add one effect to a setup: ``with_effect(setup, "gravity", g_z=-9.81)``."""
    return with_effects(setup, {name: values})


__all__ = [
    "EFFECTS",
    "Effect",
    "Observation",
    "Parameter",
    "Reach",
    "Setup",
    "effect",
    "with_effect",
    "with_effects",
]

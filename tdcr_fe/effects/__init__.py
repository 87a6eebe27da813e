"""Candidate effects: what a model of a real robot may be missing, for use in a scenario and by `identify`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import fields, replace

from tdcr_fe.effects import actuation, by_tendon, observation, places, robot
from tdcr_fe.effects.base import Effect as Effect
from tdcr_fe.effects.base import ExcitationRange as ExcitationRange
from tdcr_fe.effects.base import Experiment as Experiment
from tdcr_fe.effects.base import Observation as Observation
from tdcr_fe.effects.base import Parameter as Parameter
from tdcr_fe.effects.places import EffectAtPlace as EffectAtPlace
from tdcr_fe.effects.places import PlaceEffect as PlaceEffect
from tdcr_fe.model.loading import in_newtons_and_metres

#: Every effect, in the order in which several are applied: the command first, the measurement last.
EFFECTS: tuple[Effect, ...] = (
    actuation.TimeLag(),
    actuation.ActuatorGain(),
    actuation.ActuatorBacklash(),
    actuation.ActuatorLoss(),
    actuation.IdleTension(),
    robot.Gravity(),
    robot.TipPayload(),
    robot.ModulusScale(),
    robot.DensityScale(),
    robot.StiffnessScale(),
    robot.SuperelasticBackbone(),
    robot.NonlinearBackbone(),
    robot.Precurvature(),
    robot.BaseCompliance(),
    robot.RigidDisks(),
    robot.Creep(),
    by_tendon.HoleFriction(),
    by_tendon.HoleAdhesion(),
    robot.RoutingTwist(),
    robot.MisplacedChannels(),
    by_tendon.HoleClearance(),
    by_tendon.TendonStretch(),
    by_tendon.Pretension(),
    places.SoftBay(),
    places.Kink(),
    places.SideSpringEffect(),
    places.StuckHole(),
    observation.MarkerOffset(),
    observation.FrameMisalignment(),
)


def effect(name: str, catalogue: Sequence[Effect] = EFFECTS) -> Effect:
    """The effect of that name; `KeyError` names those that exist."""
    for e in catalogue:
        if e.name == name:
            return e
    raise KeyError(f"no effect {name!r}; there are {', '.join(e.name for e in catalogue)}")


def with_effects(
    experiment: Experiment, effects: Mapping[str, Mapping[str, float]], catalogue: Sequence[Effect] = EFFECTS
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
    for name in effects:
        effect(name, catalogue)
    if effects:
        experiment = replace(experiment, steps=in_newtons_and_metres(experiment.robot, experiment.steps))
    for e in catalogue:
        if e.name in effects:
            e.check(effects[e.name], experiment)
            experiment = e.apply(experiment, {**e.null_values(experiment), **effects[e.name]})
    return experiment


def changed_by(
    experiment: Experiment, effects: Mapping[str, Mapping[str, float]], catalogue: Sequence[Effect] = EFFECTS
) -> dict[str, set[str]]:
    """By effect, the fields of the experiment that it changes, after those before it; see `with_effects`."""
    found, names = {}, [f.name for f in fields(Experiment)]
    for name in (e.name for e in catalogue if e.name in effects):
        before, experiment = experiment, with_effects(experiment, {name: effects[name]}, catalogue)
        found[name] = {n for n in names if getattr(before, n) != getattr(experiment, n)}
    return found


def with_effect(experiment: Experiment, name: str, **values: float) -> Experiment:
    """Add one effect to an experiment: ``with_effect(experiment, "gravity", g_z=-9.81)``."""
    return with_effects(experiment, {name: values})

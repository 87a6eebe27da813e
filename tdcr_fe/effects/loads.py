"""Effects of weight: gravity and a mass at the tip."""

from __future__ import annotations

from dataclasses import replace

from tdcr_fe.effects.base import Effect, Experiment, Parameter, Values


class Gravity(Effect):
    """Weight of backbone and disks."""

    name = "gravity"
    description = (
        "Backbone, disks and payload have weight, or the robot's orientation differs from the model's."
    )
    separating_experiment = "measure the unloaded shape in two orientations of the base"
    parameters = tuple(
        Parameter(f"g_{axis}", "m/s^2", -12.0, 12.0, 0.0, 1.0, f"acceleration of gravity along {axis}")
        for axis in "xyz"
    )

    def null_values(self, experiment: Experiment) -> dict[str, float]:
        """Declared gravity."""
        return dict(zip(("g_x", "g_y", "g_z"), experiment.model.gravity, strict=True))

    def apply(self, experiment: Experiment, values: Values) -> Experiment:
        """See `Effect.apply`."""
        gravity = (values["g_x"], values["g_y"], values["g_z"])
        return replace(experiment, model=replace(experiment.model, gravity=gravity))


class TipPayload(Effect):
    """An undeclared mass at the tip."""

    name = "tip_payload"
    description = (
        "Something sits at the tip that was not declared: a camera, a marker, a screw, the knot of a tendon."
    )
    separating_experiment = "weigh what is at the tip, or hang a known weight there and compare"
    parameters = (Parameter("mass", "kg", 0.0, 10.0, 0.0, 5e-4, "mass at the tip besides the declared one"),)

    def apply(self, experiment: Experiment, values: Values) -> Experiment:
        """See `Effect.apply`."""
        return experiment.with_robot(tip_mass=experiment.robot.tip_mass + values["mass"])

"""Effects of weight: gravity and a mass at the tip."""

from __future__ import annotations

from dataclasses import replace

from tdcr_fe.effects.base import Effect, Parameter, Setup, Values


class Gravity(Effect):
    """Weight of backbone and disks."""

    name = "gravity"
    sentence = "Backbone, disks and payload have weight, or the robot does not stand as the model says."
    experiment = "measure the unloaded shape in two orientations of the base"
    parameters = tuple(
        Parameter(f"g_{axis}", "m/s^2", -12.0, 12.0, 0.0, 1.0, f"acceleration of gravity along {axis}")
        for axis in "xyz"
    )

    def absent(self, setup: Setup) -> dict[str, float]:
        """What is declared."""
        return dict(zip(("g_x", "g_y", "g_z"), setup.model.gravity, strict=True))

    def apply(self, setup: Setup, values: Values) -> Setup:
        """See `Effect.apply`."""
        gravity = (values["g_x"], values["g_y"], values["g_z"])
        return replace(setup, model=replace(setup.model, gravity=gravity))


class TipPayload(Effect):
    """An undeclared mass at the tip."""

    name = "tip_payload"
    sentence = (
        "Something sits at the tip that was not declared: a camera, a marker, a screw, the knot of a tendon."
    )
    experiment = "weigh what is at the tip, or hang a known weight there and compare"
    parameters = (Parameter("mass", "kg", 0.0, 10.0, 0.0, 5e-4, "mass at the tip besides the declared one"),)

    def apply(self, setup: Setup, values: Values) -> Setup:
        """See `Effect.apply`."""
        return setup.with_robot(tip_mass=setup.robot.tip_mass + values["mass"])

"""Effects of the measurement: a turned measuring frame, markers beside the backbone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from tdcr_fe.effects.base import Effect, Parameter, Setup, Values


class FrameMisalignment(Effect):
    """The measuring frame is rotated against the base."""

    name = "frame_misalignment"
    sentence = "Camera or tracker are turned against the base plate, so that every position is rotated about the base."
    experiment = "measure three points of the base plate itself"
    parameters = tuple(
        Parameter(f"rot_{axis}", "rad", -0.6, 0.6, 0.0, 5e-3, f"rotation vector, component {axis}")
        for axis in "xyz"
    )

    def apply(self, setup: Setup, values: Values) -> Setup:
        """See `Effect.apply`; rotations add up as rotations."""
        own = Rotation.from_rotvec([values["rot_x"], values["rot_y"], values["rot_z"]])
        both = (own * Rotation.from_rotvec(np.array(setup.observation.rotation))).as_rotvec()
        turned = (float(both[0]), float(both[1]), float(both[2]))
        return replace(setup, observation=replace(setup.observation, rotation=turned))


class MarkerOffset(Effect):
    """Markers sit off the backbone."""

    name = "marker_offset"
    sentence = (
        "Markers are glued to the side of the disks, so that what is measured is not the backbone's axis."
    )
    experiment = "measure two markers on opposite sides of one disk"
    parameters = tuple(
        Parameter(f"offset_{axis}", "m", -0.05, 0.05, 0.0, 2e-4, f"along the section's {axis} axis")
        for axis in "xy"
    )

    def apply(self, setup: Setup, values: Values) -> Setup:
        """See `Effect.apply`."""
        x, y = setup.observation.offset
        moved = (x + values["offset_x"], y + values["offset_y"])
        return replace(setup, observation=replace(setup.observation, offset=moved))

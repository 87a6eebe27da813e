"""Effects of the measurement: a turned measuring frame, markers beside the backbone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from tdcr_fe.effects.base import Effect, Experiment, Parameter, Values


class FrameMisalignment(Effect):
    """The measuring frame is rotated against the base."""

    name = "frame_misalignment"
    description = "The camera or tracker is rotated against the base plate, and so is every position."
    separating_experiment = "measure three points of the base plate itself"
    parameters = tuple(
        Parameter(f"rot_{axis}", "rad", -0.6, 0.6, 0.0, 5e-3, f"rotation vector, component {axis}")
        for axis in "xyz"
    )

    def apply(self, experiment: Experiment, values: Values) -> Experiment:
        """See `Effect.apply`; rotations add up as rotations."""
        own = Rotation.from_rotvec([values["rot_x"], values["rot_y"], values["rot_z"]])
        both = (own * Rotation.from_rotvec(np.array(experiment.observation.rotation))).as_rotvec()
        turned = (float(both[0]), float(both[1]), float(both[2]))
        return replace(experiment, observation=replace(experiment.observation, rotation=turned))


class MarkerOffset(Effect):
    """Markers sit off the backbone."""

    name = "marker_offset"
    description = (
        "Markers are glued to the side of the disks, so that what is measured is not the backbone's axis."
    )
    separating_experiment = "measure two markers on opposite sides of one disk"
    parameters = tuple(
        Parameter(f"offset_{axis}", "m", -0.05, 0.05, 0.0, 2e-4, f"along the section's {axis} axis")
        for axis in "xy"
    )

    def apply(self, experiment: Experiment, values: Values) -> Experiment:
        """See `Effect.apply`."""
        x, y = experiment.observation.offset
        moved = (x + values["offset_x"], y + values["offset_y"])
        return replace(experiment, observation=replace(experiment.observation, offset=moved))

"""Effects of the measurement: a turned or moved measuring frame, markers beside the backbone or beyond its end."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from tdcr_fe.effects.base import Effect, Experiment, Kind, Parameter, Values

AXES = "xyz"


class FrameMisalignment(Effect):
    """The measuring frame is rotated against the base, and its origin may be elsewhere.

    The camera or tracker is rotated against the base plate, or its origin is elsewhere, and so is every position.

    Distinguished by: measure three points of the base plate itself.
    """

    name = "frame_misalignment"
    kind = Kind("reading", ("nothing",))
    parameters = tuple(
        Parameter(f"rot_{axis}", "rad", -0.6, 0.6, 0.0, 5e-3, f"rotation vector, component {axis}")
        for axis in AXES
    )
    more = tuple(
        Parameter(f"shift_{axis}", "m", -10.0, 10.0, 0.0, 2e-4, f"{axis} of the base in the measuring frame")
        for axis in AXES
    )

    def forms(self, experiment: Experiment) -> tuple[Effect, ...]:
        """Rotated, rotated and moved, or moved only."""
        turned, moved = [p.name for p in self.parameters], [p.name for p in self.more]
        both = self.form("rotated and moved", [*turned, *moved], experiment)
        return self, both, self.form("moved", moved, experiment)

    def apply(self, experiment: Experiment, values: Values) -> Experiment:
        """See `Effect.apply`; the frame that is there already is moved by the further one."""
        before = experiment.observation
        turn = Rotation.from_rotvec([values.get(p.name, 0.0) for p in self.parameters])
        both = (turn * Rotation.from_rotvec(np.array(before.rotation))).as_rotvec()
        shift = turn.apply(np.array(before.shift)) + [values.get(p.name, 0.0) for p in self.more]
        return replace(experiment, observation=replace(before, rotation=_triple(both), shift=_triple(shift)))


class MarkerOffset(Effect):
    """Markers sit off the backbone.

    Markers are glued to the side of the disks or stand out beyond the tip, so that what is measured is not the
    backbone's axis where it is assumed.

    Distinguished by: measure two markers on opposite sides of one disk.
    """

    name = "marker_offset"
    kind = Kind("reading", ("nothing",))
    parameters = tuple(
        Parameter(f"offset_{axis}", "m", -0.05, 0.05, 0.0, 2e-4, f"along the section's {axis} axis")
        for axis in AXES[:2]
    )
    _meaning = "along the tangent, positive towards and beyond the tip"
    more = (Parameter("offset_z", "m", -0.05, 0.05, 0.0, 2e-4, _meaning),)
    part_names = "marker_[1-9][0-9]*"

    def forms(self, experiment: Experiment) -> tuple[Effect, ...]:
        """Beside the backbone; along it, too; or an offset of each of several markers, or of one of them."""
        common = [p.name for p in (*self.parameters, *self.more)]
        forms: tuple[Effect, ...] = (self, self.form("along the tangent, too", common, experiment))
        if (count := len(markers := experiment.observation.markers)) > 1:
            each = [f"{name}_{part}" for part in self.parts_of(experiment) for name in common]
            forms = (*forms, self.form("each", each, experiment))
            for k, s in enumerate(markers, 1):
                beside = [f"{p.name}_marker_{k}" for p in self.parameters]
                form = self.form(f"marker {k}", beside, experiment)
                forms = (*forms, form.one_of(count, f"the marker at s = {s:.4g} m"))
        return forms

    def parts_of(self, experiment: Experiment) -> dict[str, str]:
        """The markers, counted from the base."""
        return {f"marker_{k}": f"at {s:.6g} m" for k, s in enumerate(experiment.observation.markers, 1)}

    def apply(self, experiment: Experiment, values: Values) -> Experiment:
        """See `Effect.apply`; offsets come on top of those that are there."""
        before = experiment.observation
        single = before.single
        numbers = range(1, len(before.markers) + 1)
        if any(values.get(f"offset_{a}_marker_{k}", 0.0) != 0.0 for k in numbers for a in AXES):
            known = single or ((0.0, 0.0, 0.0),) * len(before.markers)
            single = tuple(
                _triple(np.array(offset) + [values.get(f"offset_{a}_marker_{k}", 0.0) for a in AXES])
                for k, offset in zip(numbers, known, strict=True)
            )
        offset = _triple(np.array(before.offset) + [values.get(f"offset_{a}", 0.0) for a in AXES])
        return replace(experiment, observation=replace(before, offset=offset, single=single))


def _triple(values: np.ndarray) -> tuple[float, float, float]:
    return float(values[0]), float(values[1]), float(values[2])

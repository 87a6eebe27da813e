"""What can be said of measured data before anything is solved: implausible values, impossible places, other units."""

from __future__ import annotations

import re
from collections.abc import Mapping

import numpy as np

from tdcr_fe.identify.data_faults import impossible_place
from tdcr_fe.io.measured import MeasuredData
from tdcr_fe.io.problems import InputError, Problem
from tdcr_fe.model.messages import PlausibilityRemark, PlausibilityWarning, TDCRWarning
from tdcr_fe.model.plausibility import plausibility
from tdcr_fe.model.quantities import Description

#: Inputs that bend the robot more or less than this many times as much as the readings say are in another unit [1].
OTHER_UNIT = 4.0


def first_checks(data: MeasuredData) -> dict[type[TDCRWarning], list[str]]:
    """Warnings and remarks on a data set, by category.

    Raises
    ------
    InputError
        A load is far beyond what the robot can carry.
    """
    described = data.robot, data.model, data.steps
    try:
        warned, remarks = plausibility(*described)
    except ValueError as error:
        raise InputError([Problem(data.name, "", "", _columns(str(error), data))]) from error
    if not warned:
        remarks.append(_other_bend(data))
    found = {PlausibilityWarning: [*warned, impossible_place(data)], PlausibilityRemark: remarks}
    return {category: [_columns(x, data) for x in texts if x] for category, texts in found.items()}


def _columns(text: str, data: MeasuredData) -> str:
    """A sentence with the columns of loading.csv in place of keys of a scenario."""

    def column(found: re.Match[str]) -> str:
        step = data.step_ids[int(found[1])]
        name = found[2].replace("tensions.", "tension_").replace("displacements.", "displacement_")
        return f"loading.csv, step {step}: " + re.sub(r"^loads\.\w+\.", "", name)

    return re.sub(r"steps\[(\d+)\]\.([\w.]+)", column, text)


def _other_bend(data: MeasuredData) -> str:
    """Inputs that bend the robot far more or less than the readings say, as a sentence; of steps without a force."""
    d = Description.of(data.robot, data.model, data.steps)
    free = [not any(any(x.force) for x in step.loads.values()) for step in data.steps]
    read = _bends_read(data)
    measured = max((read.get(i, 0.0) for i, f in zip(data.step_ids, free, strict=True) if f), default=0.0)
    for kind in ("tensions", "displacements"):
        angles = np.linalg.norm(d.bends(kind).sum(axis=2), axis=1)[free]
        largest = float(np.max(angles, initial=0.0))
        if measured and largest and not 1.0 / OTHER_UNIT < largest / measured < OTHER_UNIT:
            return (
                f"loading.csv: its {kind} would bend the robot without friction by up to {largest:.2g} rad, the "
                f"readings say {measured:.2g} rad; check the unit of the {kind}, the modulus and the radius"
            )
    return ""


def _bends_read(data: MeasuredData) -> Mapping[int, float]:
    """Angle between the tangents of base and tip by step, as far as readings tell it [rad]."""
    found = {r.step: abs(r.value) for r in data.readings if r.quantity == "bending_angle"}
    found |= {r.step: 2.0 * abs(r.value) for r in data.readings if r.quantity == "chord_angle"}
    heights = [r for r in data.readings if r.quantity == "position_z" and isinstance(r.location, float)]
    farthest = max((r.location for r in heights if isinstance(r.location, float)), default=0.0)
    for r in heights:
        if r.location == farthest and r.step not in found:
            # An arc of the turn a and length s is s sin(a) / a high.
            found[r.step] = _turn(r.value / farthest) * data.robot.backbone.length / farthest
    return found


def _turn(height: float) -> float:
    """Turn of an arc by its height over its length [rad]."""
    turns = np.linspace(0.0, 4.4, 441)
    return float(np.interp(-height, -np.sinc(turns / np.pi), turns))

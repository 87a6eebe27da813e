"""Checks of measured data before anything is solved: values that no robot has, and inputs or places in another unit."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping

import numpy as np

from tdcr_fe.io.measured import MeasuredData
from tdcr_fe.io.problems import InputError, Problem
from tdcr_fe.model.messages import PlausibilityRemark, PlausibilityWarning, TDCRWarning
from tdcr_fe.model.plausibility import plausibility
from tdcr_fe.model.quantities import Description

#: Inputs that bend the robot more or less than this many times as much as the readings say are in another unit [1].
OTHER_UNIT = 4.0
#: A marker is elsewhere where it is read farther from the base than its arc length by this share of the length [1].
ELSEWHERE = 0.25


def first_checks(data: MeasuredData) -> dict[type[TDCRWarning], list[str]]:
    """Warnings and remarks on a data set, by category.

    Raises
    ------
    InputError
        A load is far beyond what the robot can carry.
    """
    try:
        warned, remarks = plausibility(data.robot, data.model, data.steps)
    except ValueError as error:
        raise InputError([Problem(data.name, "", "", with_columns(str(error), data))]) from error
    warned += [impossible_place(data), large_sigma(data, data.input_sigma, "model.toml")]
    if not any(warned):
        remarks.append(_other_bend(data))
    found = {PlausibilityWarning: warned, PlausibilityRemark: remarks}
    return {category: [with_columns(x, data) for x in texts if x] for category, texts in found.items()}


def large_sigma(data: MeasuredData, sigmas: Iterable[float], file: str) -> str:
    """Standard deviations of inputs that are larger than all inputs, as a sentence."""
    inputs = [abs(x) for step in data.steps for _, given in step.inputs() for x in given.values()]
    largest, sigma = max(inputs, default=0.0), max(sigmas, default=0.0)
    if not 0.0 < largest < sigma:
        return ""
    return f"{file}: inputs.sigma = {sigma:g}: larger than every input; the largest is {largest:g}"


def with_columns(text: str, data: MeasuredData) -> str:
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
    bends = [read.get(i, 0.0) for i, f in zip(data.step_ids, free, strict=True) if f]
    measured = max(bends, default=0.0) - min(bends, default=0.0)  # heights may not count from the base
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
    turns = np.linspace(0.0, 4.4, 441)
    for r in heights:
        if r.location == farthest and r.step not in found:
            # An arc of the turn a and length s is s sin(a) / a high.
            turn = float(np.interp(-r.value / farthest, -np.sinc(turns / np.pi), turns))
            found[r.step] = turn * data.robot.backbone.length / farthest
    return found


def impossible_place(data: MeasuredData) -> str:
    """A marker that most readings place farther from the base than the backbone is long up to it, as a sentence."""
    squares: dict[float, dict[int, float]] = {}
    for r in data.readings:
        if r.channel.family == "position" and isinstance(r.location, float):
            own = squares.setdefault(r.location, {})
            own[r.step] = own.get(r.step, 0.0) + r.value**2
    for s, by_step in sorted(squares.items()):
        far = float(np.sqrt(np.median(list(by_step.values()))))
        if far > s + ELSEWHERE * data.robot.backbone.length:
            return (
                f"the marker at s = {s:g} m is read {far:.4g} m from the base, farther than the backbone reaches up to "
                f"there: it must be at s = {far:.3g} m or beyond"
            )
    return ""

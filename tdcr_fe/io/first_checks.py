"""Checks of measured data before anything is solved: values that no robot has, and places in another unit."""

from __future__ import annotations

import re
from collections.abc import Iterable

import numpy as np

from tdcr_fe.io.measured import MeasuredData
from tdcr_fe.io.problems import InputError, Problem
from tdcr_fe.model.messages import PlausibilityRemark, PlausibilityWarning, TDCRWarning
from tdcr_fe.model.plausibility import plausibility

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

"""Remarks on fitted values: contradicted declared values, and implausible ones."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from tdcr_fe.identify.estimate import Estimate
from tdcr_fe.identify.findings import AddedEffect
from tdcr_fe.identify.outcome import IdentificationResult
from tdcr_fe.model.loading import Model
from tdcr_fe.model.robot import Robot
from tdcr_fe.report.environment import estimate, quantity, significant, words

#: Half-width of a 95 % interval over the standard error [1].
HALF_WIDTH = 1.96
#: Least strain at which a backbone softens: nickel-titanium transforms near 1 %, polymers yield above it [1].
LEAST_THRESHOLD = 3e-3
#: Gravity on earth, and the deviation of a fitted magnitude above which the report warns [m/s^2].
EARTH, EARTH_TOLERANCE = 9.81, 0.15


def _stiffness(robot: Robot, model: Model) -> float | None:
    return _common([t.axial_stiffness for t in robot.tendons])


def _friction(robot: Robot, model: Model) -> float | None:
    return _common([t.friction_coefficient for t in robot.tendons])


def _thickness(robot: Robot, model: Model) -> float | None:
    return robot.disks.thickness or None


def _precurvature(axis: int) -> Callable[[Robot, Model], float | None]:
    return lambda robot, model: (
        robot.backbone.precurvature[axis] if any(robot.backbone.precurvature) else None
    )


def _gravity(axis: int) -> Callable[[Robot, Model], float | None]:
    return lambda robot, model: model.gravity[axis] if any(model.gravity) else None


def _common(values: list[float | None]) -> float | None:
    """The value that all tendons have; None where they differ or one has none."""
    first = values[0] if values else None
    return first if first is not None and all(v == first for v in values) else None


#: Parameters for which the files declare a value: what it is, and where it is declared.
DECLARED: dict[tuple[str, str], tuple[str, Callable[[Robot, Model], float | None]]] = {
    ("tendon_stretch", "axial_stiffness"): ("the axial stiffness of the tendons", _stiffness),
    ("friction_coefficient", "mu"): ("the friction coefficient", _friction),
    ("rigid_disks", "thickness"): ("the thickness of the disks", _thickness),
    ("precurvature", "kappa_x"): ("the precurvature about x", _precurvature(0)),
    ("precurvature", "kappa_y"): ("the precurvature about y", _precurvature(1)),
    ("gravity", "g_x"): ("gravity along x", _gravity(0)),
    ("gravity", "g_y"): ("gravity along y", _gravity(1)),
    ("gravity", "g_z"): ("gravity along z", _gravity(2)),
    ("stiffness_scale", "bending"): (
        "the factor on the declared bending stiffness",
        lambda robot, model: 1.0,
    ),
    ("stiffness_scale", "torsion"): (
        "the factor on the declared torsional stiffness",
        lambda robot, model: 1.0,
    ),
}


def half_width(p: Estimate) -> float | None:
    """Half-width of the 95 % interval of a fitted number; None where it has no standard error."""
    return None if p.std_error is None else HALF_WIDTH * p.std_error


def _contradicts(p: Estimate, declared: float) -> bool:
    """Whether the interval excludes the declared value; a number that the data do not determine contradicts nothing."""
    width = half_width(p)
    return width is not None and abs(p.value - declared) > width


def _contradictions(e: AddedEffect, robot: Robot, model: Model) -> list[str]:
    found = []
    for name, p in e.parameters.items():
        what, declared_of = DECLARED.get((e.name, name), ("", None))
        declared = declared_of(robot, model) if declared_of else None
        if declared is None or not _contradicts(p, declared):
            continue
        if e.name == "stiffness_scale":
            found.append(
                f"The fit contradicts a declared value: {what} is {estimate(p.value, half_width(p), p.unit)}. Check "
                "modulus and diameter."
            )
            continue
        text = (
            f"The fit contradicts a declared value: {what} is fitted as {estimate(p.value, half_width(p), p.unit)}, "
            f"declared as {quantity(declared, p.unit, 4)}."
        )
        others = " or ".join(words(n) for n in e.indistinguishable_from)
        found.append(
            text
            + f" If the declared value is certain, the data have another cause: {others or 'none on the list'}."
        )
    return found


def largest_strain(result: IdentificationResult) -> float | None:
    """Largest bending strain of the outer fibre over all steps of the final model [1]; None without shapes.

    From the turning of the predicted backbone between neighbouring nodes: curvature times radius.
    """
    nodes: NDArray[np.float64] = result.shapes.backbone_after
    if nodes.ndim != 3 or nodes.shape[1] < 3:
        return None
    chord = np.diff(nodes, axis=1)
    length = np.linalg.norm(chord, axis=2)
    with np.errstate(invalid="ignore", divide="ignore"):
        cosine = np.sum(chord[:, 1:] * chord[:, :-1], axis=2) / (length[:, 1:] * length[:, :-1])
        curvature = np.arccos(np.clip(cosine, -1.0, 1.0)) / (0.5 * (length[:, 1:] + length[:, :-1]))
    if not np.isfinite(curvature).any():
        return None
    return float(np.nanmax(curvature)) * result.data.robot.backbone.radius


def _percent(strain: float) -> str:
    return f"{significant(100.0 * strain, 2)} %"


def _implausible(e: AddedEffect, result: IdentificationResult) -> list[str]:
    value = {name: p.value for name, p in e.parameters.items()}
    if e.name == "superelastic" and value["threshold_strain"] < LEAST_THRESHOLD:
        strain = largest_strain(result)
        seen = (
            f", and the largest strain in these data is about {_percent(strain)}"
            if strain is not None
            else ""
        )
        return [
            f"A superelastic backbone is not plausible here: the fitted threshold is a strain of "
            f"{_percent(value['threshold_strain'])}{seen}. Nickel-titanium transforms near 1 %, polymers yield above "
            "it. The effect probably represents another cause that softens the robot."
        ]
    if e.name == "gravity":
        size = math.sqrt(sum(x * x for x in value.values()))
        if abs(size - EARTH) <= EARTH_TOLERANCE:
            return [f"The magnitude of the fitted gravity is {quantity(size, 'm/s^2')}, as on earth."]
        return [
            f"The magnitude of the fitted gravity is {quantity(size, 'm/s^2')}, not {EARTH} m/s²: either "
            "the declared masses are wrong, or the effect represents another cause."
        ]
    # One for all tendons, or for each segment or tendon.
    if e.name == "friction_coefficient" and max(value.values()) > 1.0:
        largest = significant(max(value.values()))
        return [f"A friction coefficient of {largest} is above that of common materials."]
    return []


def remarks(result: IdentificationResult) -> dict[str, list[str]]:
    """Remarks by name of the effect, for effects that have any."""
    data = result.data
    found = {
        e.name: _contradictions(e, data.robot, data.model) + _implausible(e, result) for e in result.effects
    }
    return {name: texts for name, texts in found.items() if texts}

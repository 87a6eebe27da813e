"""What must hold in every state that is called converged, by its positions, rotations and tensions alone.

The checks share no code with the solver: forces are those of `tdcr_fe.validation.fuzz.rod`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tdcr_fe.model.friction import ConstantFriction, ForceDependentFriction, StribeckFriction
from tdcr_fe.model.loading import Model
from tdcr_fe.model.results import StepResult
from tdcr_fe.model.robot import Robot
from tdcr_fe.model.tendon import Tendon
from tdcr_fe.validation.fuzz.rod import (
    Balance,
    Elements,
    balance,
    courses,
    following,
    relative_twists,
    unloaded_pose,
)

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Check:
    """One thing that must hold.

    Attributes
    ----------
    name : str
    tolerance : float
        Largest value that is right, relative to the scale of the quantity [1].
    value : callable
        From robot, model and step to the value [1]; it is at most the tolerance where the state is right.
    """

    name: str
    tolerance: float
    value: Callable[[Robot, Model, StepResult], float]


def _frames(robot: Robot, model: Model, step: StepResult) -> float:
    """Rotations are rotations, the base is clamped, and all numbers are finite."""
    numbers = [step.positions, step.rotations, step.base_tensions, step.displacements, *step.tensions]
    if not all(np.all(np.isfinite(x)) for x in numbers):
        return float("inf")
    product = np.swapaxes(step.rotations, 1, 2) @ step.rotations
    wrong = float(np.abs(product - np.eye(3)).max())
    base = float(np.abs(step.positions[0]).max()) / robot.backbone.length
    return max(wrong, base, float(np.abs(step.rotations[0] - np.eye(3)).max()))


def _unbalanced(robot: Robot, found: Balance, force: Array, moment: Array) -> float:
    """Largest component beyond round-off, over its scale; the clamped node is left out."""
    scale = max(found.moment_scale, 1e-2 * robot.backbone.length * found.force_scale)
    f = max(0.0, float(np.abs(force[1:]).max()) - found.force_round_off) / found.force_scale
    m = max(0.0, float(np.abs(moment[1:]).max()) - found.moment_round_off) / scale
    return max(f, m)


def _nodes(robot: Robot, model: Model, step: StepResult) -> float:
    """Every node but the clamped one: all forces and moments on it add up to zero."""
    found = balance(robot, model, step)
    return _unbalanced(robot, found, found.force, found.moment)


def _free_bodies(robot: Robot, model: Model, step: StepResult) -> float:
    """Every piece of the robot from a node to the tip: all forces and moments on it add up to zero."""
    found = balance(robot, model, step)
    force = np.cumsum(found.force[::-1], axis=0)[::-1]
    about_origin = np.cumsum((found.moment + np.cross(step.positions, found.force))[::-1], axis=0)[::-1]
    return _unbalanced(robot, found, force, about_origin - np.cross(step.positions, force))


def _scale(step: StepResult) -> float:
    """Largest tension, or a thousandth of a newton [N]."""
    return max(1e-3, *(float(t.max(initial=0.0)) for t in step.tensions)) if step.tensions else 1.0


def _no_compression(robot: Robot, model: Model, step: StepResult) -> float:
    """A tendon does not push."""
    return max((-float(t.min()) / _scale(step) for t in step.tensions), default=0.0)


def coefficients(tendon: Tendon, tension: Array, angles: Array) -> tuple[Array, bool]:
    """Largest coefficients of friction at the holes, and whether they are exact rather than bounds."""
    law = tendon.friction
    if law is None or isinstance(law, ConstantFriction):
        mu = tendon.friction_coefficient if law is None else law.mu
        return np.full_like(angles, mu), True
    if isinstance(law, ForceDependentFriction):
        normal = (tension[:-1] + tension[1:]) * np.sin(0.5 * angles)
        square = (normal**2 + law.smallest_force**2) / law.reference_force**2
        return law.mu * square ** (0.5 * law.exponent), True
    if isinstance(law, StribeckFriction) and law.viscous == 0.0:
        return np.full_like(angles, max(law.static, law.kinetic)), False
    raise ValueError(f"no bound is known for the friction law {law.kind!r}")


def adhesions(robot: Robot, tendon: Tendon) -> Array:
    """Tension that each hole between base plate and anchor takes at most, whatever the tension is [N]."""
    at = robot.hole_arc_lengths(tendon)[1:-1]
    found = np.full(len(at), tendon.adhesion)
    for hole in tendon.tight_holes:
        found[np.abs(at - hole.at).argmin()] = hole.drop
    return found


def _holes(
    robot: Robot, model: Model, step: StepResult
) -> Iterator[tuple[Tendon, Array, tuple[str, ...], Array, Array, bool]]:
    """By straight tendon: tensions, states, smallest and largest tension beyond each hole, whether these are exact."""
    if model.tendon_path != "straight":
        return
    found = courses(robot, step.s, step.positions, step.rotations)
    for tendon, course, tension, states in zip(
        robot.tendons, found, step.tensions, step.hole_states, strict=True
    ):
        mu, exact = coefficients(tendon, tension, course.angles)
        a = adhesions(robot, tendon)
        if model.friction == "none":
            mu, a = np.zeros_like(mu), np.zeros_like(a)
        factor = np.exp(-mu * course.angles)
        low = np.maximum(0.0, tension[:-1] * factor - a)
        high = (tension[:-1] + a) / factor
        yield tendon, tension, states, low, high, exact


def _capstan(robot: Robot, model: Model, step: StepResult) -> float:
    """The tension beyond each hole lies within the bounds of the Capstan equation with adhesion."""
    worst = 0.0
    for _, tension, _, low, high, _ in _holes(robot, model, step):
        beyond = np.maximum(low - tension[1:], tension[1:] - high)
        worst = max(worst, float(beyond.max(initial=0.0)) / _scale(step))
    return worst


def _slip_at_bound(robot: Robot, model: Model, step: StepResult) -> float:
    """A hole that is called pull or release has all of its friction in that direction."""
    worst = 0.0
    for _, tension, states, low, high, exact in _holes(robot, model, step):
        if not exact or model.friction == "none":
            continue
        for k, state in enumerate(states[:-1]):
            bound = {"pull": low[k], "release": high[k]}.get(state)
            if bound is not None and tension[0] > 0.0:
                worst = max(worst, abs(float(tension[k + 1] - bound)) / _scale(step))
    return worst


def _same_along(robot: Robot, model: Model, step: StepResult) -> float:
    """Tendons that follow the backbone, and those of a model without friction, have one tension."""
    if model.tendon_path == "straight" and model.friction != "none":
        return 0.0
    return max((float(np.ptp(t)) / _scale(step) for t in step.tensions), default=0.0)


def _released(robot: Robot, model: Model, step: StepResult) -> tuple[Array, float]:
    """Tendon pulled in at the base, from the lengths of all segments [m], and the scale of its round-off [m]."""
    assert step.actuation is not None
    p0, r0 = unloaded_pose(Elements.of(robot, step.s, 0.0), step.s)
    found = np.zeros(len(robot.tendons))

    def lengths(p: Array, r: Array) -> list[Array]:
        if model.tendon_path == "straight":
            return [c.lengths for c in courses(robot, step.s, p, r)]
        return [np.array([f.length]) for f in following(robot, step.s, relative_twists(p, r))]

    pairs = zip(lengths(p0, r0), lengths(step.positions, step.rotations), strict=True)
    for i, (tendon, (before, after)) in enumerate(zip(robot.tendons, pairs, strict=True)):
        compliance = 0.0 if tendon.axial_stiffness is None else 1.0 / tendon.axial_stiffness
        tension = step.tensions[i] if len(after) > 1 or len(step.tensions[i]) == 1 else step.tensions[i][:1]
        held = before / (1.0 + compliance * tendon.pretension)
        found[i] = float((held - after / (1.0 + compliance * tension)).sum())
    return found, robot.backbone.length


def _displacements(robot: Robot, model: Model, step: StepResult) -> float:
    """The displacement in the table is what the lengths of the segments give; that of a slack tendon is the input."""
    assert step.actuation is not None
    found, scale = _released(robot, model, step)
    slack = step.actuation.by_displacement & (step.base_tensions <= 0.0)
    expected = np.where(slack, step.actuation.values, found)
    return float(np.abs(expected - step.displacements).max(initial=0.0)) / scale


def _inputs(robot: Robot, model: Model, step: StepResult) -> float:
    """Each tendon has its tension, or its displacement; one that is slack has been released by at least as much."""
    assert step.actuation is not None
    found, length = _released(robot, model, step)
    worst = 0.0
    pairs = zip(step.actuation.by_displacement, step.actuation.values, strict=True)
    for i, (by_displacement, value) in enumerate(pairs):
        base = float(step.tensions[i][0])
        if not by_displacement:
            worst = max(worst, abs(base - float(value)) / max(_scale(step), abs(float(value))))
        elif base > 0.0:
            worst = max(worst, abs(float(found[i] - value)) / length)
        else:
            worst = max(worst, float(value - found[i]) / length)
    return worst


def _one_mobilisation(robot: Robot, model: Model, step: StepResult) -> float:
    """With friction per tendon, all holes of a tendon have the same part of their friction."""
    if model.friction != "per-tendon" or model.tendon_path != "straight":
        return 0.0
    worst = 0.0
    found = courses(robot, step.s, step.positions, step.rotations)
    for tendon, course, tension in zip(robot.tendons, found, step.tensions, strict=True):
        if (
            tendon.friction is not None
            or tendon.friction_coefficient == 0.0
            or adhesions(robot, tendon).any()
        ):
            continue
        turned = tendon.friction_coefficient * course.angles
        if tension[0] <= 0.0 or not np.any(turned > 1e-6):
            continue
        logs = np.log(tension[:-1] / tension[1:])
        common = float(logs.sum() / turned.sum())
        worst = max(worst, float(np.abs(logs - common * turned).max()))
    return worst


#: Everything that is checked in a state.
CHECKS: tuple[Check, ...] = (
    Check("frames", 1e-9, _frames),
    Check("equilibrium of every node", 1e-5, _nodes),
    Check("equilibrium of every free body", 1e-5, _free_bodies),
    Check("no compression", 1e-9, _no_compression),
    Check("Capstan bounds", 1e-6, _capstan),
    Check("slipping holes at their bound", 1e-6, _slip_at_bound),
    Check("one tension without friction", 1e-9, _same_along),
    Check("one mobilisation per tendon", 1e-6, _one_mobilisation),
    Check("displacements from lengths", 1e-8, _displacements),
    Check("prescribed inputs", 1e-7, _inputs),
)


def check_step(robot: Robot, model: Model, step: StepResult) -> dict[str, float]:
    """Values of all checks of a step, by name."""
    return {check.name: check.value(robot, model, step) for check in CHECKS}


__all__ = ["CHECKS", "Check", "check_step"]

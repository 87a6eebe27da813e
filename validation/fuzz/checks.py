"""What must hold in every state that is called converged, by its positions, rotations and tensions alone.

The checks share no code with the solver: forces are those of `tdcr_fe.validation.fuzz.state`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from tdcr_fe.elements import Array
from tdcr_fe.model.friction import StribeckFriction
from tdcr_fe.model.loading import Actuation, Model
from tdcr_fe.model.results import StepResult
from tdcr_fe.model.robot import Robot
from tdcr_fe.validation.fuzz.state import State, balance
from tdcr_fe.validation.reference.tendons import tension_after


@dataclass(frozen=True)
class Check:
    """One thing that must hold.

    Attributes
    ----------
    name : str
    tolerance : float
        Largest value that is right, relative to the scale of the quantity [1].
    value : callable
        From the state to the value [1]; it is at most the tolerance where the state is right.
    """

    name: str
    tolerance: float
    value: Callable[[State], float]


def _largest(values: Array) -> float:
    return float(np.abs(values).max(initial=0.0))


def _frames(state: State) -> float:
    """Rotations are rotations, the base is clamped, and all numbers are finite."""
    step = state.step
    numbers = [step.positions, step.rotations, step.base_tensions, step.displacements, *step.tensions]
    if not all(np.all(np.isfinite(x)) for x in numbers):
        return float("inf")
    product = np.swapaxes(step.rotations, 1, 2) @ step.rotations
    base = _largest(step.positions[0]) / state.robot.backbone.length
    return max(_largest(product - np.eye(3)), base, _largest(step.rotations[0] - np.eye(3)))


def _free_bodies(state: State) -> float:
    """Every piece of the robot from a node to the tip: all forces and moments on it add up to zero.

    The value is the largest component beyond round-off, over its scale; the clamped node is left out. What
    holds for two neighbouring pieces holds for the node between them.
    """
    found, positions = balance(state), state.step.positions
    force = np.cumsum(found.force[::-1], axis=0)[::-1]
    about_origin = np.cumsum((found.moment + np.cross(positions, found.force))[::-1], axis=0)[::-1]
    moment = about_origin - np.cross(positions, force)
    scale = max(found.moment_scale, 1e-2 * state.robot.backbone.length * found.force_scale)
    f = max(0.0, _largest(force[1:]) - found.force_round_off) / found.force_scale
    m = max(0.0, _largest(moment[1:]) - found.moment_round_off) / scale
    return max(f, m)


def _scale(state: State) -> float:
    """Largest tension, or a thousandth of a newton [N]."""
    return max(1e-3, float(state.tension.max(initial=0.0)))


def _no_compression(state: State) -> float:
    """A tendon does not push."""
    return float((-state.tension).max(initial=0.0)) / _scale(state)


def _bounds(state: State) -> tuple[Array, Array, Array]:
    """Tension beyond the holes of straight tendons, and the least and largest that friction allows, (n_holes,) [N]."""
    if state.segments is None:
        return np.zeros(0), np.zeros(0), np.zeros(0)
    tendons, angles = state.tendons, state.segments.angles
    before, beyond = state.tension[tendons.holes], state.tension[tendons.holes + 1]
    mu, ones = tendons.coefficients(state.tension, angles), np.ones(len(angles))
    low, high = (tension_after(before, s * ones, angles, mu, tendons.adhesion)[0] for s in (1.0, -1.0))
    return beyond, low, high


def _capstan(state: State) -> float:
    """The tension beyond each hole lies within the bounds of the Capstan equation with adhesion."""
    beyond, low, high = _bounds(state)
    return float(np.maximum(low - beyond, beyond - high).max(initial=0.0)) / _scale(state)


def _slip_at_bound(state: State) -> float:
    """A hole that is called pull or release has all of its friction in that direction.

    A Stribeck law has bounds, but no more. Holes of a slack tendon have any state.
    """
    if state.model.friction == "none" or state.segments is None:
        return 0.0
    beyond, low, high = _bounds(state)
    states = np.array([s for holes in state.step.hole_states for s in holes[:-1]], dtype=str)
    exact = np.array([not isinstance(t.friction, StribeckFriction) for t in state.robot.tendons], dtype=bool)
    first, last = state.tendons.first, state.tendons.last
    known = np.repeat(exact & (state.tension[first] > 0.0), last - first - 1)
    pulled, released = (known & (states == name) for name in ("pull", "release"))
    return max(_largest((beyond - low)[pulled]), _largest((beyond - high)[released])) / _scale(state)


def _same_along(state: State) -> float:
    """Tendons that follow the backbone, and those of a model without friction, have one tension."""
    if state.segments is not None and state.model.friction != "none":
        return 0.0
    return max((float(np.ptp(t)) / _scale(state) for t in state.step.tensions), default=0.0)


def _actuation(state: State) -> Actuation:
    if state.step.actuation is None:
        raise ValueError("the step does not say what acts on the robot")
    return state.step.actuation


def _displacements(state: State) -> float:
    """The displacement in the table is what the lengths of the segments give; that of a slack tendon is the input."""
    step, inputs = state.step, _actuation(state)
    slack = inputs.by_displacement & (step.base_tensions <= 0.0)
    expected = np.where(slack, inputs.values, state.tendons.base_sum @ state.taken_in)
    return _largest(expected - step.displacements) / state.robot.backbone.length


def _inputs(state: State) -> float:
    """Each tendon has its tension, or its displacement; one that is slack has been released by at least as much."""
    inputs, base = _actuation(state), state.tension[state.tendons.first]
    off = base - inputs.values
    by_tension = np.abs(off) / np.maximum(_scale(state), np.abs(inputs.values))
    gap = (state.tendons.base_sum @ state.taken_in - inputs.values) / state.robot.backbone.length
    by_displacement = np.where(base > 0.0, np.abs(gap), -gap)
    worst = np.where(inputs.by_displacement, by_displacement, by_tension)
    return float(worst.max(initial=0.0))


def _one_mobilisation(state: State) -> float:
    """With friction per tendon, all holes of a tendon have the same part of their friction."""
    if state.model.friction != "per-tendon" or state.segments is None:
        return 0.0
    worst, tendons = 0.0, state.tendons
    owner = np.repeat(np.arange(tendons.count), tendons.last - tendons.first - 1)
    logs = np.log(np.maximum(state.tension, 1e-300))
    for i, tendon in enumerate(state.robot.tendons):
        own = owner == i
        turned = tendon.friction_coefficient * state.segments.angles[own]
        simple = tendon.friction is None and not tendons.adhesion[own].any()
        if simple and state.tension[tendons.first[i]] > 0.0 and np.any(turned > 1e-6):
            lost = logs[tendons.holes[own]] - logs[tendons.holes[own] + 1]
            worst = max(worst, _largest(lost - float(lost.sum() / turned.sum()) * turned))
    return worst


#: Everything that is checked in a state.
CHECKS: tuple[Check, ...] = (
    Check("frames", 1e-9, _frames),
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
    state = State.of(robot, model, step)
    return {check.name: check.value(state) for check in CHECKS}

"""Prediction of the next solution, where Newton's method then begins.

Where a step goes on in the direction of the last one and every hole goes on slipping in its own, the solutions of both
lie on one smooth curve. Of this curve the ends of the last step are known, and the slopes there by linearisations that
are at hand. Hermite's polynomial through them is as near to the solution as one Newton iteration or nearer, and costs
one solution with known factors (E. L. Allgower, K. Georg, Introduction to Numerical Continuation Methods (2003),
ch. 6).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from tdcr_fe.elements import Array
from tdcr_fe.model.loading import SolverSettings
from tdcr_fe.solve.equations.configuration import Configuration, SolverState, Target
from tdcr_fe.solve.equations.layout import Numbering
from tdcr_fe.solve.equations.linearization import Linearization, SolvedStep, same_loads, unknowns
from tdcr_fe.solve.equations.system import SceneSystem
from tdcr_fe.solve.newton.steps import all_keep_slipping, slip_changes

#: Steps whose inputs change in proportion up to this fraction of the changes have the same direction [1].
SAME_DIRECTION = 1e-5


class Prediction(NamedTuple):
    """A predicted solution."""

    state: SolverState  # The state at the beginning of the step with predicted unknowns
    # Derivative of the unknowns at the beginning of the step, times its length, see `SolvedStep`; where coefficients
    # of friction follow laws, the mean of the step before
    slope: Array
    slips: Array | None  # Derivative of the slips of all frictional holes there, times its length [m]


def predict(
    system: SceneSystem,
    state: SolverState,
    target: Target,
    changes: tuple[Array, ...],
    linear: Linearization,
    settings: SolverSettings,
) -> Prediction | None:
    """Predict the solution of a step.

    Parameters
    ----------
    system
        The scene.
    state
        Solution at the beginning of the step.
    target
        Inputs and loads at its end.
    changes
        By robot, changes of the inputs in it, see `input_changes`.
    linear
        Linearisation at the end of the last step, or near it.
    settings
        Numerics.

    Returns
    -------
    Prediction or None
        None where the last step says nothing about this one, or not enough.
    """
    last = linear.solved
    if last is None or not system.layout.only_robots_resist(target.loads) or not same_loads(state, target):
        return None
    numbering, length = system.numbering(), _length_of(last, np.concatenate(changes))
    if length is None or not linear.numbering.same_unknowns(numbering):
        return None
    if not np.array_equal(unknowns(state, numbering), last.end):
        return None
    step, slips = linear.response(changes), None
    if numbering.has_friction:
        moved = slip_changes(numbering, linear.forces, step, changes)
        slips = numbering.at_frictional_holes(moved)
        if not _all_keep_slipping(state, slips, numbering):
            return None
    if any(own.field.depends_on_length for own in linear.forces):
        # Where slips go on at their rates, friction stays as it is, unlike in a step from the state at the end.
        slope = (last.end - last.start) / length
        change = slope if last.slope is None else 2.0 * slope - last.slope / length
    else:
        slope = np.concatenate((linear.twist_changes(step), step[numbering.reduced :]))
        change = slope + last.curvature(length, slope)
    configuration, tension = moved_elements(system, state, change, settings.max_turn), state.base_tension
    if configuration is None:
        return None
    if numbering.any_driven:
        pulled = numbering.at_driven(tension) + change[numbering.reduced - numbering.linear :]
        tension = numbering.with_driven(tension, np.maximum(pulled, 0.0))
    return Prediction(state._replace(configuration=configuration, base_tension=tension), slope, slips)


def _length_of(last: SolvedStep, loading: Array) -> float | None:
    """Length of the last step over that of this one; None where it has another direction."""
    size = float(loading @ loading)
    if size == 0.0:
        return None
    length = float(last.loading @ loading) / size
    off = np.abs(last.loading - length * loading)
    return length if length > 0.0 and (off <= SAME_DIRECTION * np.abs(last.loading)).all() else None


def _all_keep_slipping(state: SolverState, slips: Array, numbering: Numbering) -> bool:
    """Whether all holes of tendons under tension slip, and continue in the same direction."""
    by_robot = zip(state.base_tension, state.mobilisation, strict=True)
    tension = [np.broadcast_to(t[:, None], s.shape) for t, s in by_robot]
    tense = numbering.at_frictional_holes(tension) > 0.0
    mobilised = numbering.at_frictional_holes(state.mobilisation)
    return not tense.any() or all_keep_slipping(mobilised[tense], slips[tense])


def moved_elements(
    system: SceneSystem, state: SolverState, change: Array, max_turn: float
) -> Configuration | None:
    """The configuration of a state with changed twists; None where an element turns by more than allowed.

    Parameters
    ----------
    system
        The scene.
    state
        To start from.
    change
        Change of the twists of all elements; anything after them is left out.
    max_turn
        Largest change of an element's rotation [rad].
    """
    old, at = state.configuration.unknowns, 0
    twists = []
    for before in old.twists:
        moved = change[at : at + before.size].reshape(before.shape)
        if float(np.abs(moved[:, 3:]).max()) > max_turn:
            return None
        twists.append(before + moved)
        at += before.size
    return system.layout.space.build(old._replace(twists=tuple(twists)), state.configuration.parameters)

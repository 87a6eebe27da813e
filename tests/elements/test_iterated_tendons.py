"""Straight tendons in the iterations of Exudyn's solvers: holes are predicted, the law of friction decides."""

from __future__ import annotations

import numpy as np
import pytest
from robots import LENGTH, distance, scene, three

from tdcr_fe.elements.friction import FrictionState
from tdcr_fe.elements.native.iterated import IteratedTendons, PastStep, predicted_holes
from tdcr_fe.elements.native.straight_tendons import HolePrediction, StraightTendons
from tdcr_fe.native import register
from tdcr_fe.solve.statics import SolveTDCR

register()
STEP = 1e-3
BASE = np.array([1.0, 0.4, 0.2])


@pytest.fixture
def tendons():
    """Tendons of a straight robot, its reference coordinates, and its history."""
    _keep, _mbs, handle = scene(three(0.3))
    actuation = handle.actuation
    straight = StraightTendons.of(actuation.model)
    assert straight is not None
    return straight, actuation._node_coordinates.reference, actuation.law.initial_state()


def bent(reference, size: float) -> np.ndarray:
    """Displacements of the nodes, bent to a parabola by a displacement of the tip [m] and turned with it."""
    along = np.linspace(0.0, 1.0, len(reference))
    moved = np.zeros_like(reference)
    moved[:, 0] = size * along**2
    half = along * size / LENGTH
    w, x, y, z = reference[:, 3:].T
    turned = np.stack((-y, z, w, -x), axis=1)
    moved[:, 3:] = (np.cos(half) - 1.0)[:, None] * reference[:, 3:] + np.sin(half)[:, None] * turned
    return moved.ravel()


def step(iterated, reference, sizes, time, state):
    """The forces at every iterate of a step, the tangent in the first one, and the history at its end."""
    found = []
    for k, size in enumerate(sizes):
        found.append(iterated.forces(bent(reference, size), reference, time, state, BASE))
        if k == 0:
            iterated.tangent(bent(reference, size), reference, time, state, BASE)
    return found, iterated.step_end(bent(reference, sizes[-1]), reference, time, state, BASE)


def test_the_first_iterate_has_predicted_holes_and_all_others_the_law_of_friction(tendons):
    straight, reference, state = tendons
    iterated = IteratedTendons(straight)
    for k in (1, 2):
        _, (state, _, _) = step(iterated, reference, [2.5e-5 * k], STEP * k, state)
    sticks = np.abs(state.mobilisation) < 1.0
    assert sticks.any()
    assert not sticks.all()
    by_law = [
        straight.forces(straight.pull(bent(reference, s).reshape(-1, 7) + reference, BASE, state))
        for s in (-2e-4, 6e-5)
    ]
    first, second = step(iterated, reference, [-2e-4, 6e-5], 3 * STEP, state)[0]
    assert np.abs(first - by_law[0]).max() > 1e-4 * np.abs(first).max()
    assert np.array_equal(second, by_law[1])
    # The same configuration once more, and a step that is tried again with half of its size: the law.
    iterated.forces(bent(reference, -2e-4), reference, 2.5 * STEP, state, BASE)
    assert np.array_equal(
        iterated.forces(bent(reference, -2e-4), reference, 2.5 * STEP, state, BASE), by_law[0]
    )


def test_a_step_that_ends_at_its_first_iterate_is_committed_by_the_law(tendons):
    straight, reference, state = tendons
    iterated = IteratedTendons(straight)
    for k in (1, 2):
        _, (state, _, _) = step(iterated, reference, [2.5e-5 * k], STEP * k, state)
    expected = straight.pull(bent(reference, -2e-4).reshape(-1, 7) + reference, BASE, state)
    _, (_, _, pull) = step(iterated, reference, [-2e-4], 3 * STEP, state)
    assert pull.prediction is None
    assert np.array_equal(pull.tension, expected.tension)


def test_nothing_is_predicted_for_numerical_derivatives_and_where_no_time_passes(tendons):
    """Numerical derivatives never ask for the tangent; initial accelerations are those of the law."""
    straight, reference, state = tendons
    iterated = IteratedTendons(straight)
    for k in (1, 2):
        at = bent(reference, 2.5e-5 * k)
        iterated.forces(at, reference, STEP * k, state, BASE)
        state, _, _ = iterated.step_end(at, reference, STEP * k, state, BASE)
    there = bent(reference, -2e-4)
    by_law = straight.forces(straight.pull(there.reshape(-1, 7) + reference, BASE, state))
    assert np.array_equal(iterated.forces(there, reference, 3 * STEP, state, BASE), by_law)
    _, (state, _, _) = step(iterated, reference, [7.5e-5], 3 * STEP, state)
    by_law = straight.forces(straight.pull(there.reshape(-1, 7) + reference, BASE, state))
    assert np.array_equal(iterated.forces(there, reference, state.time, state, BASE), by_law)


def test_a_prediction_goes_on_as_the_last_two_steps_did(tendons):
    straight, reference, start = tendons
    pull = straight.pull(reference, BASE, start)
    middle, end = (
        FrictionState(start.slip, np.full_like(start.mobilisation, s), None, t)
        for s, t in ((0.2, 1.0), (0.5, 2.0))
    )
    first = PastStep.of(start, pull._replace(trial=np.full_like(pull.trial, 0.2)), middle, None)
    second = PastStep.of(middle, pull._replace(trial=np.full_like(pull.trial, 0.5)), end, first)
    assert second.rate == pytest.approx(np.full_like(pull.trial, 0.3))
    # Half of the change of the rate, 0.1, goes on: 0.5 + 0.35 sticks, 0.5 + 2 * 0.35 slides.
    for duration, sticks, mobilisation in ((1.0, True, 0.5), (2.0, False, 1.0)):
        prediction = predicted_holes(second, end, 2.0 + duration)
        assert (prediction.sticks == sticks).all()
        assert prediction.mobilisation == pytest.approx(np.full_like(pull.trial, mobilisation))
    assert predicted_holes(second, end, 2.0) is None
    # From a history of another step, and in the first step of a run, the holes stay as they are.
    for past in (second, None):
        stays = predicted_holes(past, middle, 3.0)
        assert stays.sticks.all()
        assert stays.mobilisation == pytest.approx(np.full_like(pull.trial, 0.2))
    assert PastStep.of(end, pull, end, second) is None


def test_predicted_forces_are_linear_in_the_slip_of_holes_that_stick(tendons):
    """Beyond full mobilisation, too, where those of the law are constant: the forces double with the deflection."""
    straight, reference, state = tendons
    prediction = HolePrediction.of(state.mobilisation.T, np.zeros_like(state.mobilisation.T))
    assert prediction.sticks.all()
    sizes = (0.0, 5e-5, 1e-4)
    law, linear = (
        [straight.pull(bent(reference, s).reshape(-1, 7) + reference, BASE, state, p) for s in sizes]
        for p in (None, prediction)
    )
    assert np.abs(linear[2].trial).max() > 1.5
    assert (linear[2].slopes(None) == 1.0).all()
    assert not (law[2].slopes(None) == 1.0).all()
    # A tension that the law would more than double is not predicted.
    far = straight.pull(bent(reference, 2e-2).reshape(-1, 7) + reference, BASE, state, prediction)
    assert far.prediction is None


@pytest.mark.parametrize("count", [1, 3])
def test_a_swing_with_friction_takes_few_jacobians(count):
    """With holes that change between stick and slip: 1.3 to 1.6 a step of 1 ms; without the prediction 1.8 to 2.3."""
    _keep, mbs, handle = scene(three(0.3), assemble=False)
    load = handle.add_load("tip", LENGTH)
    mbs.Assemble()
    handle.set_tensions([1.0, *([0.3, 0.2] if count == 3 else [0.0, 0.0])])
    SolveTDCR(mbs)
    load.set([0.0, 0.005, 0.003])
    settings = handle.recommended_settings(0.1, STEP)
    settings.timeIntegration.verboseMode, settings.solution.file.write = 0, False
    assert mbs.SolveDynamic(settings)
    it = mbs.sys["dynamicSolver"].it
    assert 1.0 <= it.newtonJacobiCount / it.currentStepIndex < 1.65
    assert it.newtonStepsCount / it.currentStepIndex < 6.0


def test_numerical_derivatives_give_the_same_motion():
    """In the same steps: of 1 ms, one is divided with numerical derivatives: the tip moves by 7e-5 of the length."""
    tips = []
    for numerical in (False, True):
        _keep, mbs, handle = scene(three(0.3))
        handle.set_inputs_over_time(lambda t: [1.0 - np.cos(30.0 * t), 0.2, 0.1])
        settings = handle.recommended_settings(0.02, 0.5 * STEP)
        settings.timeIntegration.verboseMode, settings.solution.file.write = 0, False
        settings.timeIntegration.newton.numericalDifferentiation.forODE2 = numerical
        settings.timeIntegration.newton.relativeTolerance = 1e-9
        assert mbs.SolveDynamic(settings)
        assert mbs.sys["dynamicSolver"].it.currentStepIndex == 41
        tips.append(handle.tip_position)
    assert distance(*tips) < 1e-7
    assert distance(tips[0], [0.0, 0.0, LENGTH]) > 1e-3

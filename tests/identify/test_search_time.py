"""A search ends in its time, with the best model so far; several processes give what one gives."""

import numpy as np
import pytest
from identify_data import measured

from tdcr_fe.effects import EFFECTS, effect
from tdcr_fe.identify import IdentifySettings, fitting, identify
from tdcr_fe.identify.derivatives import Column, Request, linearize
from tdcr_fe.identify.forward import ForwardModel
from tdcr_fe.identify.problem import FitProblem, evaluate
from tdcr_fe.identify.screening import screen
from tdcr_fe.identify.sentences import headline, sentences

TWO = {"gravity": {"g_x": 3.0, "g_y": -6.0, "g_z": -7.0}, "precurvature": {"kappa_x": 0.9, "kappa_y": -0.7}}


def test_search_without_time_ends_with_the_first_effect_and_says_what_is_not_tried():
    """Two effects are missing; after the first one the time is over. It used to go on for as long as it took."""
    result = identify(measured(TWO), IdentifySettings(candidates=2, search_time=1e-3))
    assert len(result.effects) == 1 and result.verdict == "unfinished" and not result.interrupted
    assert result.not_tried[0] == "further effects" and result.to_json()["not_tried"] == list(
        result.not_tried
    )
    assert headline(result).startswith("Unfinished: the search ran out of time")
    assert any("did not suffice for further effects" in s for s in sentences(result))
    assert result.after_fit.rms_position < result.before_fit.rms_position


def test_a_fit_ends_where_it_is_when_the_time_is_over():
    """A fit in the search of places once ran for minutes on robots that cannot be solved."""
    own = problem(ForwardModel())
    gravity = effect("gravity")
    starts = [{"gravity": {"g_x": g, "g_y": 0.0, "g_z": 0.0}} for g in (1.0, 2.0)]

    def fitted(deadline):
        race = fitting.Race(deadline=deadline)
        now = yield from fitting.begin(own, (gravity,), starts, race)
        return (yield from fitting.descend(own, now, race))

    (ended,) = fitting.run_fits(own, [fitted(0.0)])
    (whole,) = fitting.run_fits(own, [fitted(float("inf"))])
    assert ended.values == starts[0] and ended.solved
    assert whole.cost < 0.5 * ended.cost


def problem(forward):
    data = measured(TWO)
    held_out = np.zeros(len(data.readings), dtype=bool)
    return FitProblem.of(data, np.full(held_out.size, 1e-4), held_out, forward)


@pytest.fixture(scope="module")
def forms():
    """All candidates of the small robot."""
    experiment = problem(ForwardModel()).experiment
    return [form for e in EFFECTS for form in e.forms(experiment)]


def test_two_processes_give_the_scores_and_derivatives_of_one(forms):
    """A model with many columns is divided by columns, several models are linearised in a process each."""
    one = problem(ForwardModel())
    declared = evaluate(one, (), {})
    gravity = effect("gravity")
    columns = tuple(Column(gravity, n, TWO["gravity"], 0.1) for n in TWO["gravity"])
    requests = [
        Request((gravity,), {"gravity": {**TWO["gravity"], "g_x": g}}, columns, declared.run)
        for g in (1.0, 2.0)
    ]
    scores, linear = screen(one, declared, forms), linearize(one, requests)
    with ForwardModel(2) as forward:
        two = problem(forward)
        again, linear_again = screen(two, declared, forms), linearize(two, requests)
        assert forward.runs >= 4
    assert [x.effect.name for x in scores] == [x.effect.name for x in again]
    for a, b in zip(scores, again, strict=True):
        np.testing.assert_allclose(a.signature, b.signature, rtol=1e-9, atol=1e-9)
        assert a.differenced == b.differenced
    for x, y in zip(linear, linear_again, strict=True):
        np.testing.assert_array_equal(x.matrix, y.matrix)
        np.testing.assert_array_equal(x.residual, y.residual)

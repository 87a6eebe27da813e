"""A search ends in its time, with the best model so far; several processes give what one gives."""

import time
from dataclasses import replace

import numpy as np
import pytest
from identify_data import GRAVITY, measured
from searches import problem_of, time_ends_with

from tdcr_fe.effects import EFFECTS, effect
from tdcr_fe.identify import IdentifySettings, fitting, identify, settings
from tdcr_fe.identify.derivatives import Column, Request, linearize
from tdcr_fe.identify.forward import ForwardModel, Job
from tdcr_fe.identify.problem import evaluate
from tdcr_fe.identify.screening import screen
from tdcr_fe.identify.sentences import sentences
from tdcr_fe.identify.settings import Part

TWO = {**GRAVITY, "precurvature": {"kappa_x": 0.9, "kappa_y": -0.7}}


@pytest.mark.integration
def test_search_without_time_ends_with_the_first_effect_and_says_what_is_not_tried(monkeypatch):
    """Two effects are missing; when the first is fitted the time is over. It used to go on for as long as it took."""
    given = IdentifySettings(time_limit=1e6, candidates=2)
    result = identify(measured(TWO), given, lambda text, share: time_ends_with(text, "round 2", monkeypatch))
    assert len(result.effects) == 1 and result.verdict == "unfinished" and not result.log.interrupted
    assert result.log.not_tried[0] == Part.FURTHER_EFFECTS
    assert result.to_json()["not_tried"] == list(result.log.not_tried)
    assert {Part.EXCHANGES, Part.CEILING} < set(result.log.not_tried) and result.ceiling is None
    headline, *further = sentences(result)
    assert headline.startswith("Unfinished: the search ran out of time")
    assert any("too short for further effects" in s for s in further)
    assert result.after.fit.rms_position < result.before.fit.rms_position


def test_a_fit_ends_where_it_is_when_the_time_is_over(monkeypatch):
    """A fit in the search of places once ran for minutes on robots that cannot be solved."""
    own = replace(problem(ForwardModel()), deadline=1e6)
    start = {"gravity": {"g_x": 1.0, "g_y": 0.0, "g_z": 0.0}}

    def fitted(text):
        now = yield from fitting.begin(own, (effect("gravity"),), start)
        time_ends_with(text, "late", monkeypatch)
        return (yield from fitting.descend(own, now, fitting.Race()))

    (whole,) = fitting.run_fits(own, [fitted("")])
    (ended,) = fitting.run_fits(own, [fitted("late")])
    assert ended.values == start and ended.solved
    assert whole.cost < 0.5 * ended.cost


def problem(forward):
    return problem_of(measured(TWO), forward=forward)


@pytest.mark.integration
def test_two_processes_give_the_scores_and_derivatives_of_one():
    """Several models are linearised in a process each."""
    one = problem(ForwardModel())
    declared, gravity = evaluate(one, (), {}), effect("gravity")
    forms = [form for e in EFFECTS for form in e.forms(one.experiment)]
    columns = tuple(Column(gravity, n, TWO["gravity"], 0.1) for n in TWO["gravity"])
    values = [{"gravity": {**TWO["gravity"], "g_x": g}} for g in (1.0, 2.0)]
    requests = [Request((gravity,), x, columns, declared.run) for x in values]
    scores, linear = screen(one, declared, forms)[0], linearize(one, requests)
    with ForwardModel(2) as forward:
        two = problem(forward)
        again, linear_again = screen(two, declared, forms)[0], linearize(two, requests)
        assert forward.runs >= 3
    assert [x.effect.name for x in scores] == [x.effect.name for x in again]
    for a, b in zip(scores, again, strict=True):
        np.testing.assert_allclose(a.signature, b.signature, rtol=1e-9, atol=1e-9)
    for x, y in zip(linear, linear_again, strict=True):
        np.testing.assert_array_equal(x.matrix, y.matrix)
        np.testing.assert_array_equal(x.residual, y.residual)


@pytest.mark.integration
def test_the_clock_counts_the_processor_time_of_all_processes_and_no_pause():
    begun, here = settings.clock(), time.process_time()
    time.sleep(0.3)
    assert settings.clock() - begun < 0.1
    with ForwardModel(2) as forward:
        own = problem(forward)
        own.run([Job(own.experiment)] * 4)
    # that of this process, and as much again as four simulations take
    assert settings.clock() - begun > time.process_time() - here + 0.01

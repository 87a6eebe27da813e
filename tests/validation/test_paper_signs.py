"""The paper's Fig. 2, literally, against the implicit law of one sign per tendon."""

from __future__ import annotations

import numpy as np
import pytest

from tdcr_fe.model.loading import LoadStep
from tdcr_fe.solve.simulate import simulate
from tdcr_fe.validation.paper.cases import MODELS
from tdcr_fe.validation.paper.studies.signs import sign_steps, three_tendon_robot, trial_signs

ROBOT = three_tendon_robot()


@pytest.fixture(scope="module")
def trials():
    return trial_signs(ROBOT, sign_steps(), try_all=True)


@pytest.fixture(scope="module")
def own():
    return simulate(ROBOT, MODELS["per-tendon"], sign_steps()).steps


def test_signs_change_along_the_sequence(trials):
    assert [t.accepted.signs for t in trials[:5]] == [
        (-1, -1, -1),
        (-1, 1, 1),
        (1, -1, 1),
        (1, -1, -1),
        (1, 1, -1),
    ]


def test_every_combination_is_tried_and_one_is_consistent(trials):
    for step in trials[:5]:
        assert len({t.signs for t in step.trials}) == 8
        assert sum(t.consistent for t in step.trials) == 1


def test_the_implicit_law_finds_the_same_without_trying(trials, own):
    for step, result in zip(trials[:5], own, strict=False):
        assert np.linalg.norm(step.accepted.tip - result.tip) < 1e-7
        states = tuple({"pull": -1, "release": 1}[s[0]] for s in result.hole_states)
        assert states == step.accepted.signs


def test_a_small_reversal_has_no_consistent_combination_because_tendons_stick(trials, own):
    reversal = next(t for t in trials if t.label.startswith("t3 back"))
    assert not reversal.solved
    assert len(reversal.trials) == 8
    states = own[trials.index(reversal)].hole_states
    assert "stick" in {s[0] for s in states}


def test_the_search_stops_at_the_first_consistent_combination():
    steps = [LoadStep("", {"t1": 1.0})]
    found = trial_signs(ROBOT, steps)[0]
    assert found.solved and len(found.trials) == 1 and found.accepted.signs == (-1, -1, -1)


def test_slack_tendons_are_not_tried():
    """Two signs to try for one tendon under tension."""
    found = trial_signs(ROBOT, [LoadStep("", {"t1": 1.0})], try_all=True)[0]
    assert len(found.trials) == 2

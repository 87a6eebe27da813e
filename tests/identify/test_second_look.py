"""Candidates are evaluated at their predicted values before some of them are fitted."""

import pytest
from identify_data import FRICTIONAL, ROBOT, measured, problem_of, searching, state_of

from tdcr_fe.identify.candidates import SECOND_LOOK, Round, fit_proposals, propose
from tdcr_fe.identify.places import place_ahead


def test_a_strong_effect_whose_score_is_low_is_fitted_and_found():
    """`hole_adhesion` has the third score, and with two fits a round was not among them: `actuator_loss` came first."""
    data = measured({"hole_adhesion": {"drop": 0.2}}, robot=ROBOT, model=FRICTIONAL)
    problem = problem_of(data)
    state = state_of(problem)
    search = searching(candidates=2)
    state, proposals = propose(search, state, Round(1, 0.0), [state.declared])
    names = [score.effect.name for _, score in proposals]
    assert names.index("hole_adhesion") >= 2 and len(names) == 2 + SECOND_LOOK
    state, fits = fit_proposals(search, state, Round(1, 0.0), proposals)
    assert len(fits) <= 2 and fits[0].names == ("hole_adhesion",)
    assert fits[0].cost < 2.0 * problem.count < 0.1 * state.declared.cost


@pytest.mark.integration
def test_an_effect_whose_prediction_goes_too_far_is_fitted_all_the_same():
    """At its predicted values `superelastic` is worse than the declared model, and was not fitted at all."""
    data = measured({"superelastic": {"threshold_strain": 4e-4, "plateau_ratio": 0.6}}, robot=ROBOT)
    problem = problem_of(data)
    state = state_of(problem)
    search = searching(candidates=1)
    state, proposals = propose(search, state, Round(1, 0.0), [state.declared])
    state, fits = fit_proposals(search, state, Round(1, 0.0), proposals)
    assert [fit.names for fit in fits] == [("superelastic",)]
    assert fits[0].cost < 0.02 * state.declared.cost


def test_scores_are_computed_once_for_a_model():
    """Those beside the declared model were computed twice: before and after single places were looked at."""
    data = measured({"gravity": {"g_x": 3.0, "g_y": 0.0, "g_z": 0.0}}, robot=ROBOT)
    problem = problem_of(data)
    state = state_of(problem)
    search = searching()
    state, located = place_ahead(search, state)
    before = problem.forward.runs
    state, proposals = propose(search, state, Round(1, 0.0), [state.declared])
    assert located is None and proposals and problem.forward.runs == before

"""The next experiment, simulated by the reference and added, parts two explanations."""

import pytest

from tdcr_fe.validation.next_experiment import AMBIGUITIES, run_set
from tdcr_fe.validation.next_experiment.__main__ import main


def test_there_are_more_than_ten_sets_of_two_kinds():
    assert len(AMBIGUITIES) == len({a.seed for a in AMBIGUITIES}) == 12
    assert {(a.truth, a.rival) for a in AMBIGUITIES} == {
        ("stiffness_scale", "actuator_gain"),
        ("actuator_gain", "stiffness_scale"),
    }


def test_command_refuses_a_count_of_zero():
    with pytest.raises(SystemExit):
        main(["-n", "0"])


@pytest.mark.campaign
def test_stiffness_is_separated_from_gain_by_the_experiment_that_was_chosen():
    """Readings without tip forces fit both; with the chosen steps added, the truth is the only explanation."""
    outcome = run_set(AMBIGUITIES[2])
    assert outcome.ambiguous and outcome.separated and outcome.expected > 2.0 and outcome.difference > 6.0

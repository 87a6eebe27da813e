"""The next experiment: within the measured inputs, it parts rivals that the data do not, or refines a parameter."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from identify_data import LENGTH, measured, simulated
from searches import concluded, fitted, problem_of, searching, state_of

from tdcr_fe import Experiment, Reading, effect, with_effects
from tdcr_fe.identify.next_experiment import candidate_sequences, choose_next, leading_rivals
from tdcr_fe.identify.run import Readings
from tdcr_fe.io.tables import read_loading

SEARCH = searching()
#: A stiffer backbone, where the tip forces were applied but nothing was read: a gain below one looks the same.
TRUTH = {"stiffness_scale": {"bending": 1.25, "torsion": 1.0}}


@pytest.fixture(scope="module")
def ambiguous():
    """The search state with a stiffness fitted, and a gain that explains the data as well."""
    data = measured(TRUTH, sigma=3e-4)
    unloaded = {n for n, s in zip(data.step_ids, data.steps, strict=True) if not any(s.loads["tip"].force)}
    data = replace(data, readings=tuple(r for r in data.readings if r.step in unloaded))
    problem = problem_of(data, held=(5,), sigma=3e-4)
    state = state_of(problem)
    for name in ("actuator_gain", "stiffness_scale"):
        fit = fitted(problem, effect(name))
        state = replace(state.with_fit(fit), best=fit)
    return state


def test_an_ambiguity_is_separated_by_the_experiment_that_was_chosen(ambiguous):
    """Gain and stiffness: only a tip force tells; simulated there, the rival's misfit is far above the noise."""
    (rival,) = leading_rivals(ambiguous)
    assert rival.names == ("actuator_gain",)
    planned = choose_next(SEARCH, ambiguous)
    assert set(planned.separation) == {"actuator_gain"} and planned.separation["actuator_gain"] > 5.0
    assert any(planned.steps[1].loads["tip"].force)
    data = ambiguous.problem.data
    ids, places = (1, 2, 3), (0.1, LENGTH)
    readings = [Reading(n, f"position_{a}", s, 0.0, 3e-4) for n in ids for s in places for a in "xyz"]

    def predicted(effects):
        model = replace(data.model, elements_per_bay=2)
        experiment = with_effects(Experiment(data.robot, model, planned.steps), effects)
        return Readings.of(readings, ids, data.robot.tendon_names).read(simulated(experiment), experiment)

    seen = predicted(TRUTH) + np.random.default_rng(3).normal(0.0, 3e-4, len(readings))
    two = [predicted({f.names[0]: f.values[f.names[0]]}) for f in (ambiguous.best, rival)]
    right, wrong = (np.sum(((seen - x) / 3e-4) ** 2) for x in two)
    assert wrong - right > 20.0 and right < 2.0 * len(readings)


def test_every_candidate_stays_within_what_was_measured(ambiguous):
    data = ambiguous.problem.data
    highest = {n: max(s.tensions[n] for s in data.steps) for n in data.robot.tendon_names}
    forces = {s.loads["tip"].force for s in data.steps}
    sequences = candidate_sequences(ambiguous.problem)
    assert len(sequences) > 5
    for steps in sequences:
        for step in steps:
            assert all(0.0 <= step.tensions[n] <= highest[n] for n in highest)
            assert step.loads["tip"].force in forces


def test_without_rivals_the_widest_interval_shrinks(ambiguous):
    """The expected share is that of the covariance; more than a hundredth and less than all of it is left."""
    alone = replace(ambiguous, fits={k: f for k, f in ambiguous.fits.items() if "actuator_gain" not in k})
    planned = choose_next(SEARCH, alone)
    assert not planned.separation and planned.parameter.startswith("stiffness_scale.")
    assert 0.01 < planned.remaining_share < 0.9


def test_the_declared_model_needs_none(ambiguous):
    assert choose_next(SEARCH, replace(ambiguous, best=ambiguous.declared)) is None


def test_the_loading_file_is_read_as_it_was_planned(ambiguous, tmp_path):
    planned = choose_next(SEARCH, ambiguous)
    result = concluded(ambiguous, next_experiment=planned)
    (tmp_path / "loading.csv").write_text(result.next_loading(), encoding="utf-8")
    table = pd.read_csv(tmp_path / "loading.csv", dtype=str)
    ids, steps, branches = read_loading(table, ambiguous.problem.data.robot, "loading.csv")
    assert (ids, branches) == ((1, 2, 3), ("next",) * 3)
    assert [s.tensions for s in steps] == [dict(s.tensions) for s in planned.steps]
    assert [s.loads["tip"].force for s in steps] == [s.loads["tip"].force for s in planned.steps]

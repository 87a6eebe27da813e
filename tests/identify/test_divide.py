"""Parts of commanded steps are joined where no state depends on those before."""

from dataclasses import replace

import numpy as np
import pytest
from identify_data import MODEL, measured, problem_of, simulated

from tdcr_fe.effects import Experiment, effect
from tdcr_fe.identify.load_steps import join_steps


def timed(model):
    """Both tendons, a second between steps."""
    data = measured()
    steps = tuple(replace(s, time=float(k)) for k, s in enumerate(data.steps))
    return replace(data, model=model, steps=steps)


def lagged(model):
    """Experiment of the identification with a lag of a quarter of a second, and the same with its steps in parts."""
    data = timed(model)
    e = effect("time_lag")
    problem = problem_of(data)
    return problem.with_effects((e,), {"time_lag": {"lag": 0.25}}), e.apply(problem.experiment, {"lag": 0.25})


def tips(experiment):
    run = simulated(experiment)
    assert run.solved and len(run.positions) == 11
    return run.positions[:, -1]


def test_a_time_lag_divides_no_step_without_friction_and_the_shapes_are_the_same():
    """Every step was divided where the commands have a kink: 20 solves for 11 steps."""
    joined, parts = lagged(MODEL)
    assert (len(joined.steps), len(parts.steps), joined.ends) == (11, 20, None)
    np.testing.assert_allclose(tips(joined), tips(parts), atol=1e-9)


@pytest.mark.parametrize("friction", ["per-hole", "per-tendon"])
def test_with_friction_the_parts_stay(friction):
    joined, parts = lagged(replace(MODEL, friction=friction))
    assert joined.steps == parts.steps and joined.ends == parts.ends


def test_what_the_last_part_does_not_name_stays_as_the_first_has_left_it():
    data = measured()
    first, second = replace(data.steps[0], tensions={"t1": 0.4}), replace(data.steps[0], tensions={"t2": 0.3})
    experiment = Experiment(data.robot, MODEL, (first, second), ends=((0, 0.5), (0, 1.0)))
    (step,) = join_steps(experiment).steps
    assert step.tensions == {"t1": 0.4, "t2": 0.3}

"""A parameter at its bound is no estimate: a model that is nearly as good, and at no bound, goes before it."""

from dataclasses import replace

import pytest
from identify_data import measured, problem_of

from tdcr_fe.effects import effect
from tdcr_fe.identify.criteria import BOUND_PENALTY, bic, rank
from tdcr_fe.identify.problem import evaluate


@pytest.fixture(scope="module")
def models():
    """A model with a stiffness at its upper bound, and one with a gain inside its bounds."""
    problem = problem_of(measured(), sigma=1.0)
    declared = evaluate(problem, (), {})

    def model(name, parameter, value):
        e = effect(name)
        values = {name: {**e.null_values(problem.experiment), parameter: value}}
        return replace(declared, effects=(e,), values=values, free=((name, parameter),))

    largest = effect("stiffness_scale").bounds(problem.experiment)["bending"][1]
    return problem, model("stiffness_scale", "bending", largest), model("actuator_gain", "gain", 0.8)


@pytest.mark.parametrize(("share", "first"), [(0.8, "inside"), (1.2, "bounded")])
def test_a_model_at_a_bound_yields_to_one_nearly_as_good(models, share, first):
    """By BIC, the model at the bound is first in both cases; on data of a printed robot it was chosen."""
    problem, bounded, inside = models
    bounded = replace(bounded, cost=1000.0, held_cost=500.0)
    inside = replace(inside, cost=1000.0 + share * BOUND_PENALTY * 1500.0, held_cost=500.0)
    assert bic(problem, bounded) < bic(problem, inside)
    assert (rank(problem, inside) < rank(problem, bounded)) == (first == "inside")

"""A run along its own recorded path is the same run, at a fraction of the cost."""

from dataclasses import replace

import numpy as np
from identify_data import MODEL, ROBOT, measured

from tdcr_fe.effects import effect
from tdcr_fe.identify import fitting
from tdcr_fe.identify.forward import ForwardModel
from tdcr_fe.identify.problem import FitProblem, fit_of_run


def test_derivatives_along_the_own_path_are_those_of_the_run_itself():
    """After the mesh was refined, the best model was simulated twice, the second time for its derivatives."""
    truth = {"hole_adhesion": {"drop": 0.05}}
    data = measured(truth, robot=ROBOT, model=replace(MODEL, friction="per-hole"))
    count = len(data.readings)
    problem = FitProblem.of(data, np.full(count, 1e-4), np.zeros(count, dtype=bool), ForwardModel())
    effects, free = (effect("hole_adhesion"),), (("hole_adhesion", "drop"),)
    _, (run,) = problem.residuals(effects, [truth], record=True)
    there = fit_of_run(problem, effects, truth, run)
    fits = [fitting.evaluated(problem, effects, truth, free, along) for along in (None, there)]
    own, along = fitting.run_fits(problem, fits)
    np.testing.assert_allclose(along.residual, own.residual, atol=2e-3)
    np.testing.assert_allclose(
        along.jacobian, own.jacobian, rtol=1e-4, atol=1e-4 * np.abs(own.jacobian).max()
    )

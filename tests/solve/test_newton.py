"""Newton in strain space: rate of convergence, tests of convergence, prediction of the next solution."""

import pickle
from dataclasses import replace

import numpy as np
import pytest
from robots import LENGTH, MODEL, paper, pull, routed, seven, simulation
from scenes import scene

from tdcr_fe import HelicalRouting, Simulation, Superelastic
from tdcr_fe.model.loading import LoadStep, SolverSettings, resolve
from tdcr_fe.solve.equations.configuration import Target
from tdcr_fe.solve.equations.linearization import input_changes
from tdcr_fe.solve.equations.system import SceneSystem
from tdcr_fe.solve.newton.newton import newton
from tdcr_fe.solve.newton.prediction import predict


def target(*tensions):
    return Target((np.array(tensions, dtype=float),))


CASES = {
    "no friction": (paper(), [1.0], {"friction": "none"}),
    "per-tendon": (seven(0.3), [1.0, 0.4, 0.0], {"friction": "per-tendon"}),
    "per-hole": (seven(0.3), [0.5, 0.2, 0.0], {"friction": "per-hole"}),
    "helical": (routed(HelicalRouting(4.5e-3, 1.0), mu=0.3), [1.0], {"friction": "per-hole"}),
    "continuous": (paper(), [1.0], {"friction": "none", "tendon_path": "continuous"}),
    "superelastic": (paper(0.3).with_backbone(superelastic=Superelastic(0.002, 0.5)), [0.8], {}),
}


@pytest.mark.parametrize(("robot", "tensions", "model"), CASES.values(), ids=CASES)
def test_newton_converges_quadratically(robot, tensions, model):
    """The tangent is consistent, away from equilibrium too: each residual is of the order of the last one's square."""
    _keep, mbs, _ = scene(robot, **model)
    system = SceneSystem(mbs)
    start, last = system.current_state(), SolverSettings(tolerance=1e-9, max_iterations=6)
    report = newton(system, start, target(*tensions), last)
    assert report.converged
    ends = (replace(last, max_iterations=k) for k in range(1, report.iterations + 1))
    r = np.array([newton(system, start, target(*tensions), own).residual for own in ends])
    near = np.flatnonzero((r[:-1] < 0.2) & (r[:-1] > 1e-5))
    # Where the backbone bends into an arc, one iteration is enough: equilibrium is linear in the strains.
    assert near.size or (report.iterations <= 2 and model.get("tendon_path") == "continuous")
    assert np.all(r[near + 1] <= np.maximum(10.0 * r[near] ** 2, 1e-8))


def test_a_stored_state_is_small_and_starts_another_run():
    """Pickled, it takes no more than its numbers; a solve that starts from it needs no iteration."""
    _keep, mbs, _ = scene(paper(0.3))
    system = SceneSystem(mbs)
    first = newton(system, system.current_state(), target(1.0), SolverSettings())
    stored = pickle.loads(pickle.dumps(first.state.stored()))
    assert len(pickle.dumps(stored)) < 12_000
    result = newton(system, system.warm_start(system.current_state(), stored), target(1.0), SolverSettings())
    assert result.iterations == 0 and result.converged


# ------------------------------------------------------------ prediction


def predict_from(arm, *inputs):
    """Prediction for further inputs from the state of a simulation."""
    goal = Target((np.array(inputs, dtype=float),), (), arm.state.time)
    changes = input_changes(arm.state, goal)
    return predict(arm.system, arm.state, goal, changes, arm.linearization(), arm.settings)


def test_error_of_a_prediction_falls_with_nearly_the_fourth_power_of_the_step():
    """Pull from 1 N in steps of 0.2, 0.1 and 0.05 N; the fourth solution is predicted from two before it."""
    errors = []
    for size in (0.2, 0.1, 0.05):
        steps = pull(*(1.0 + size * np.arange(3)))
        arm = simulation(paper(0.3), MODEL, steps, SolverSettings(tolerance=1e-9))
        goal = 1.0 + 3.0 * size
        guess = predict_from(arm, goal).state.configuration.twists[0]
        arm.advance(resolve(paper(0.3), pull(goal))[0])
        errors.append(np.abs(guess - arm.state.configuration.twists[0]).max())
    slopes = np.log2(np.array(errors[:-1]) / errors[1:])
    assert np.all(slopes > 3.3), (errors, slopes)
    assert errors[-1] < 1e-6


PULLED = [
    (paper(0.3), "tensions", (2.0,)),
    (paper(0.3), "displacements", (4e-3,)),
    (seven(0.3), "tensions", (2.0, 0.0, 0.0)),
    (seven(0.3, axial_stiffness=3000.0), "tensions", (2.0, 0.0, 0.0)),
    (seven(0.3, axial_stiffness=3000.0), "displacements", (4e-3, -2e-3, -2e-3)),
]


@pytest.mark.parametrize(("robot", "driven", "full"), PULLED)
def test_predictions_do_not_change_results(robot, driven, full):
    """The same history, each step from the state alone, without the step before it."""
    inputs = dict(zip(robot.tendon_names, full, strict=True))
    factors = [0.2, 0.4, 0.6, 0.8, 1.0, 0.9, 0.8, 0.7]
    steps = [LoadStep(**{driven: {name: f * x for name, x in inputs.items()}}) for f in factors]
    settings = SolverSettings(tolerance=1e-11, path_tolerance=1e-9)
    targets = resolve(robot, steps)
    following, alone = (Simulation(robot, MODEL, targets, settings) for _ in range(2))
    made = 0
    for target in targets:
        made += predict_from(following, *target.values) is not None
        following.advance(target)
        alone.begin_from(alone.state)
        alone.advance(target)
        a, b = following.state, alone.state
        assert np.abs(a.configuration.positions - b.configuration.positions).max() < 1e-10 * LENGTH
        assert a.base_tension[0] == pytest.approx(b.base_tension[0], abs=1e-8)
    assert made >= 4

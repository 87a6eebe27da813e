"""Newton in strain space: its tangent against differences, rate of convergence, failure and recovery."""

from __future__ import annotations

import pickle
from dataclasses import replace

import numpy as np
import pytest
from robots import BACKBONE, DISKS, paper, scene, three

from tdcr_fe.model.backbone import Superelastic
from tdcr_fe.model.loading import SolverSettings
from tdcr_fe.model.robot import Robot
from tdcr_fe.model.routing import HelicalRouting
from tdcr_fe.model.tendon import Tendon
from tdcr_fe.solve.equations.configuration import Target
from tdcr_fe.solve.equations.system import SceneSystem
from tdcr_fe.solve.newton import convergence
from tdcr_fe.solve.newton.convergence import CONVERGENCE_TESTS, ConvergenceTest, NewtonStatus
from tdcr_fe.solve.newton.newton import newton

HELIX = Robot(BACKBONE, DISKS, (Tendon("t1", HelicalRouting(4.5e-3, 1.0), 0.3),), name="helix")


def target(*tensions):
    return Target((np.array(tensions, dtype=float),))


def solved(robot, tensions, settings=None, **model):
    """One solve from straight: container, handle, equations and result."""
    keep, mbs, handle = scene(robot, **model)
    system = SceneSystem(mbs)
    result = newton(system, system.current_state(), target(*tensions), settings or SolverSettings())
    assert result.converged, result.reason(settings or SolverSettings())
    return keep, handle, system, result


@pytest.mark.parametrize(
    ("robot", "tensions", "model"),
    [
        pytest.param(paper(), [1.0], {"friction": "none"}, id="no friction"),
        pytest.param(three(0.3), [1.0, 0.4, 0.0], {"friction": "per-tendon"}, id="per-tendon"),
        pytest.param(three(0.3), [0.5, 0.2, 0.0], {"friction": "per-hole"}, id="per-hole"),
        pytest.param(HELIX, [1.0], {"friction": "per-hole"}, id="helical"),
        pytest.param(paper(), [1.0], {"friction": "none", "tendon_path": "continuous"}, id="continuous"),
        pytest.param(
            paper(0.3, backbone=replace(BACKBONE, superelastic=Superelastic(0.002, 0.5))),
            [0.8],
            {},
            id="superelastic",
        ),
    ],
)
def test_newton_converges_quadratically(robot, tensions, model):
    """The tangent is consistent, away from equilibrium too: each residual is of the order of the last one's square."""
    *_, report = solved(robot, tensions, SolverSettings(tolerance=1e-9), **model)
    assert report.iterations <= 6
    r = np.array(report.residuals)
    near = np.flatnonzero((r[:-1] < 0.2) & (r[:-1] > 1e-5))
    # Where the backbone bends into an arc, one iteration is enough: equilibrium is linear in the strains.
    assert near.size or (report.iterations <= 2 and model.get("tendon_path") == "continuous")
    assert np.all(r[near + 1] <= np.maximum(10.0 * r[near] ** 2, 1e-8))


def test_a_stored_state_is_small_and_starts_another_run():
    """Pickled, it takes no more than its numbers; a solve that starts from it needs no iteration."""
    _keep, _, system, first = solved(paper(0.3), [1.0])
    stored = pickle.loads(pickle.dumps(first.state.stored()))
    assert len(pickle.dumps(stored)) < 12_000
    warm = system.warm_start(system.current_state(), stored)
    result = newton(system, warm, target(1.0), SolverSettings())
    assert result.iterations == 0 and result.converged


def test_every_test_of_the_list_decides_on_convergence(monkeypatch):
    """One more, which refuses all iterates: no solve converges, and its text says why."""
    _keep, _, system, solution = solved(paper(0.3), [1.0])
    assert newton(system, solution.state, target(1.0), SolverSettings()).iterations == 0
    test = ConvergenceTest(
        lambda iterate: 2.0, lambda settings: 1.0, NewtonStatus.NO_FRICTION_STATE, "too much:"
    )
    monkeypatch.setattr(convergence, "CONVERGENCE_TESTS", (*CONVERGENCE_TESTS, test))
    settings = SolverSettings(max_iterations=3, step_tolerance=1e-15)
    result = newton(system, solution.state, target(1.0), settings)
    assert result.status is NewtonStatus.NO_FRICTION_STATE and result.iterations == 3
    assert "after 3 iterations: too much: 2.0e+00, tolerance 1e+00" in result.reason(settings)
    monkeypatch.undo()
    assert CONVERGENCE_TESTS is convergence.CONVERGENCE_TESTS
    far = newton(system, solution.state, target(2.5), SolverSettings(max_iterations=1))
    assert far.status is NewtonStatus.NO_BALANCE and "the relative residual is" in far.reason(settings)

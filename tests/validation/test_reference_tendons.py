"""Tendons of the reference: the paper's equations, friction and its history."""

import numpy as np
import pytest

from tdcr_fe.model.backbone import Backbone
from tdcr_fe.model.loading import Load, LoadStep, Model
from tdcr_fe.model.robot import Disks, Robot
from tdcr_fe.model.routing import HelicalRouting, ParallelRouting
from tdcr_fe.model.tendon import Tendon
from tdcr_fe.validation.reference import solve_reference
from tdcr_fe.validation.reference.newton import natural_residual, solve_box

L = 0.25
BACKBONE = Backbone(L, 0.4e-3, 85e9, 0.3, density=5600.0)


def robot(routing=None, disks=13, mu=0.0, **tendon):
    routing = routing or ParallelRouting(4.5e-3, 0.0)
    return Robot(
        BACKBONE,
        Disks.equally_spaced(disks, L, mass=0.17e-3),
        (Tendon("t", routing, friction_coefficient=mu, **tendon),),
    )


def run(robot, steps, path="straight", friction="none", gravity=(0.0, 0.0, 0.0)):
    result = solve_reference(robot, Model(path, friction, gravity=gravity), steps)
    assert result.converged, result.message
    return result


def pulls(*values, name="t", **rest):
    return [LoadStep(tensions={name: v}, **rest) for v in values]


SIDE = {"tip": Load(L, (0.05, 0.0, 0.0))}


@pytest.mark.parametrize(("tension", "angle"), [(0.5, 19.02837), (1.0, 38.39846), (2.5, 98.5664)])
def test_planar_integration_of_the_papers_robot(tension, angle):
    step = run(robot(), pulls(tension)).steps[0]
    assert np.degrees(step.bending_angle) == pytest.approx(angle, abs=6e-5)


def test_friction_of_the_papers_robot():
    step = run(robot(mu=0.3), pulls(2.5), friction="per-hole").steps[0]
    assert np.degrees(step.bending_angle) == pytest.approx(80.2627, abs=1e-4)
    assert step.tensions[0][-1] == pytest.approx(1.69753, abs=1e-5)
    assert step.hole_states[0] == ("pull",) * 12 + ("anchor",)


def test_continuous_model_refuses_friction():
    with pytest.raises(ValueError, match="has no friction"):
        solve_reference(robot(), Model("continuous", "per-hole"), pulls(1.0))


CYCLE = (1.0, 2.5, 1.5, 0.2, 0.0, 1.0, 2.5)


@pytest.mark.parametrize("friction", ["per-hole", "per-tendon"])
def test_no_friction_coefficient_is_no_friction_to_the_last_bit(friction):
    steps = pulls(*CYCLE, loads=SIDE)
    one, other = run(robot(), steps, friction=friction), run(robot(mu=0.3), steps, friction="none")
    np.testing.assert_array_equal(one.tips, other.tips)
    assert set(one.steps[-1].hole_states[0]) == {"stick", "anchor"}


@pytest.mark.integration
@pytest.mark.parametrize("path", ["straight", "continuous"])
def test_turning_robot_and_loads_about_z_turns_the_answer(path):
    friction = "none" if path == "continuous" else "per-hole"
    tips = []
    for angle in (0.0, 77.0):
        c, s = np.cos(np.radians(angle)), np.sin(np.radians(angle))
        turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
        load = {"mid": Load(0.11, tuple(turn @ [0.02, 0.1, 0.05]), tuple(turn @ [1e-3, 0.0, 2e-3]))}
        turned = robot(HelicalRouting(4.5e-3, 1.5, angle), mu=0.3)
        turned = turned.with_backbone(precurvature=tuple((turn @ [1.0, 0.5, 0.0])[:2]))
        result = run(turned, pulls(2.0, 1.0, loads=load), path, friction, tuple(turn @ [3.0, -9.0, 1.0]))
        tips.append(result.tips @ turn)
    np.testing.assert_allclose(tips[0], tips[1], atol=1e-11)


def test_a_displacement_gives_back_the_tension_that_caused_it():
    for path in ("straight", "continuous"):
        for stiffness in (None, 400.0):
            model = robot(HelicalRouting(4.5e-3, 1.0), axial_stiffness=stiffness)
            pulled = run(model, pulls(2.0), path).steps[0]
            step = LoadStep(displacements={"t": float(pulled.displacements[0])})
            driven = run(model, [step], path).steps[0]
            assert driven.base_tensions[0] == pytest.approx(2.0, rel=1e-6)
            np.testing.assert_allclose(driven.tip, pulled.tip, atol=1e-9)


@pytest.mark.integration
def test_more_disks_approach_the_continuous_model():
    routing = HelicalRouting(4.5e-3, 1.0)
    exact = run(robot(routing), pulls(1.5), "continuous").steps[0].tip
    counts = np.array([10, 20, 40])
    errors = [np.linalg.norm(run(robot(routing, int(n)), pulls(1.5)).steps[0].tip - exact) for n in counts]
    assert np.all(np.diff(np.log(errors)) / np.log(2.0) < -0.8)


def test_a_failing_step_is_named_with_a_cure(monkeypatch):
    monkeypatch.setattr("tdcr_fe.validation.reference.newton.MAX_ITERATIONS", 1)
    monkeypatch.setattr("tdcr_fe.validation.reference.path.MAX_BISECTIONS", 0)
    result = solve_reference(robot(), Model("straight", "none"), pulls(0.0, 2.5))
    assert not result.converged
    assert result.failed_step == 2
    assert len(result.steps) == 1
    assert "smaller load steps" in result.message


def test_box_problems_with_positive_minors_are_solved():
    draw = np.random.default_rng(3)
    for _ in range(50):
        n = 12
        root = draw.normal(size=(n, n))
        skew = draw.normal(size=(n, n))
        matrix = root @ root.T + 0.01 * np.eye(n) + skew - skew.T
        offset = 5.0 * draw.normal(size=n)
        lower, upper = -np.ones(n), np.where(np.arange(n) < 6, 1.0, np.inf)
        v = solve_box(matrix, offset, np.zeros(n), lower, upper)
        np.testing.assert_allclose(natural_residual(matrix @ v + offset, v, lower, upper), 0.0, atol=1e-8)

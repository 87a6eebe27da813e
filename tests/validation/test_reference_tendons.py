"""Tendons of the reference: the paper's equations, friction with its laws and its path, and what effects change."""

from dataclasses import replace

import numpy as np
import pytest
from robots import pull, routed

from tdcr_fe import Backbone, Disks, HelicalRouting, Load, LoadStep, Model, Robot, Tendon
from tdcr_fe.model.friction import ConstantFriction, ForceDependentFriction
from tdcr_fe.model.tendon import TightHole
from tdcr_fe.validation.random_robots import draw
from tdcr_fe.validation.reference import path as path_module
from tdcr_fe.validation.reference import sequence, solve_reference


def run(robot, steps, path="straight", friction="none", gravity=(0.0, 0.0, 0.0)):
    result = solve_reference(robot, Model(path, friction, gravity=gravity), steps).raise_if_failed()
    assert max(s.residual for s in result.steps) <= 1e-10
    return result


@pytest.mark.parametrize(("tension", "angle"), [(0.5, 19.02837), (1.0, 38.39846), (2.5, 98.5664)])
def test_planar_integration_of_the_papers_robot(tension, angle):
    step = run(routed(), pull(tension)).steps[0]
    assert np.degrees(step.bending_angle) == pytest.approx(angle, abs=6e-5)


def test_friction_of_the_papers_robot():
    step = run(routed(mu=0.3), pull(2.5), friction="per-hole").steps[0]
    assert np.degrees(step.bending_angle) == pytest.approx(80.2627, abs=1e-4)
    assert step.tensions[0][-1] == pytest.approx(1.69753, abs=1e-5)
    assert step.hole_states[0] == ("pull",) * 12 + ("anchor",)


def test_a_failing_step_is_named_with_a_cure(monkeypatch):
    monkeypatch.setattr("tdcr_fe.validation.reference.newton.MAX_ITERATIONS", 1)
    monkeypatch.setattr("tdcr_fe.validation.reference.path.MAX_BISECTIONS", 0)
    result = solve_reference(routed(), Model("straight", "none"), pull(0.0, 2.5))
    assert not result.converged
    assert result.failed_step == 2
    assert len(result.steps) == 1
    assert "smaller load steps" in result.message


# ------------------------------------------------------------ friction laws


STEPS = pull(1.0, 2.0, 1.2, substeps=4)
PER_HOLE = Model("straight", "per-hole")


@pytest.mark.parametrize("law", [ConstantFriction(0.3), ForceDependentFriction(0.3, 0.1, exponent=0.0)])
@pytest.mark.parametrize("own", [{}, {"drop": 0.05}, {"friction_coefficient": 0.8}], ids=str)
def test_a_law_that_is_constant_is_the_friction_coefficient(law, own):
    """Also beside a hole with friction of its own."""
    robots = routed(friction=law), routed(mu=0.3)
    tight = tuple(TightHole(robots[0].disks.positions[3], **own) for _ in own)
    one, other = (run(r.with_tendons(tight_holes=tight), STEPS, friction="per-hole") for r in robots)
    np.testing.assert_allclose(one.tips, other.tips, atol=1e-12)


# ------------------------------------------------------------ effects


# ------------------------------------------------------------ path


@pytest.mark.integration
def test_slip_that_ends_where_it_began_is_detected():
    """A tip force reverses the slip at a hole between the points of coarse substeps; compared with 256 substeps."""
    length = 0.20196602
    tendon = Tendon("t1", HelicalRouting(3.0499883e-3, -0.14467425, -3.5337219), 0.21520806)
    robot = Robot(Backbone(length, 0.4e-3, 85e9, 0.3), Disks.equally_spaced(7, length), (tendon,))
    side = {"tip": Load(length, (-0.022297616, -5.6509455e-3, -0.0504965))}
    steps = [LoadStep(tensions={"t1": 3.65625}), LoadStep(tensions={"t1": 2.2925072}, loads=side)]
    whole = solve_reference(robot, PER_HOLE, steps)
    cut = [replace(step, substeps=n) for step, n in zip(steps, (8, 256), strict=True)]
    np.testing.assert_allclose(whole.tips, solve_reference(robot, PER_HOLE, cut).tips, atol=2e-5 * length)


@pytest.mark.integration
def test_a_tolerance_that_is_not_met_is_reported_with_the_refinement_error(monkeypatch):
    for module in (path_module, sequence):
        monkeypatch.setattr(module, "PATH_TOLERANCE", 1e-9)
        monkeypatch.setattr(module, "MAX_BISECTIONS", 1)
    case = draw(4)
    result = solve_reference(case.robot, PER_HOLE, case.steps)
    unresolved = [s for s in result.steps if s.details["refinement_error"] > 1e-9]
    assert unresolved
    assert len(result.warnings) == len(unresolved)
    for step, warning in zip(unresolved, result.warnings, strict=True):
        assert f"step {step.step} ({step.label}): path not resolved" in warning
        assert f"{step.details['refinement_error']:.1e} of the length" in warning

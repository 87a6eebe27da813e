"""The reference against exact solutions, its order; tendons: the equations of the paper, laws and path of friction."""

from dataclasses import replace

import numpy as np
import pytest
from robots import BACKBONE, pull, routed
from robots import LENGTH as L

from tdcr_fe import Backbone, Disks, Load, LoadStep, Model, Robot, Superelastic, Tendon
from tdcr_fe.model.friction import ConstantFriction, ForceDependentFriction
from tdcr_fe.model.robot import TightHole
from tdcr_fe.model.routing import HelicalRouting, ParallelRouting
from tdcr_fe.validation.random_robots import draw
from tdcr_fe.validation.reference import ReferenceSettings, sequence, solve_reference
from tdcr_fe.validation.reference import path as path_module
from tdcr_fe.validation.reference.closed_forms import constant_strain
from tdcr_fe.validation.reference.rod import Rod
from tdcr_fe.validation.reference.section import Section, bending_moment

CLOSE = 1e-8 * L


def rod(disks=8, **changes):
    return Robot(BACKBONE, Disks.equally_spaced(disks, L)).with_backbone(**changes)


def run(robot, steps, path="straight", friction="none", gravity=(0.0, 0.0, 0.0)):
    result = solve_reference(robot, Model(path, friction, gravity=gravity), steps).raise_if_failed()
    assert max(s.residual for s in result.steps) <= 1e-10
    return result


def solve(robot, *loads, **model):
    return run(robot, [LoadStep(loads={str(i): load for i, load in enumerate(loads)})], **model).steps[0]


def test_the_base_carries_everything_at_large_bending():
    heavy = Robot(BACKBONE, Disks.equally_spaced(5, L, mass=0.17e-3), tip_mass=2e-3)
    loads = Load(0.11, force=(0.05, 0.0, 0.02)), Load(L, force=(0.0, 0.1, -0.05))
    step = solve(heavy, *loads, gravity=(1.0, -9.81, 3.0))
    assert step.bending_angle > 1.0
    mass = BACKBONE.mass_per_length * L + 5 * 0.17e-3 + 2e-3
    total = mass * np.array([1.0, -9.81, 3.0]) + [0.05, 0.1, -0.03]
    np.testing.assert_allclose(step.details["base_wrench"][3:], total, atol=1e-10)


LAW = Superelastic(threshold_strain=0.003, plateau_ratio=0.15)
(MOMENT,), _ = bending_moment(np.array([15.0]), np.array([BACKBONE.EI]), LAW, BACKBONE.radius)


ARCS = {
    "precurvature": ({"precurvature": (3.0, -2.0), "superelastic": Superelastic(0.001, 0.1)}, 0.0, (3.0, -2.0)),
    "superelastic": ({"superelastic": LAW}, float(MOMENT), (15.0, 0.0)),
}  # fmt: skip


@pytest.mark.parametrize(("changes", "moment", "curvature"), ARCS.values(), ids=ARCS)
def test_precurvature_or_a_moment_gives_the_arc_of_the_law(changes, moment, curvature):
    assert moment < BACKBONE.EI * curvature[0] / 1.3
    step = solve(rod(**changes), Load(L, moment=(moment, 0.0, 0.0)))
    rotation, position = constant_strain(np.array([*curvature, 0.0, 0.0, 0.0, 1.0]), L)
    np.testing.assert_allclose(step.tip, position, atol=CLOSE)
    np.testing.assert_allclose(step.rotations[-1], rotation, atol=1e-8)


def test_integration_is_of_order_eight():
    section = Section.of(BACKBONE, np.array([0.125]), np.array([False]))
    wrench = np.array([[4e-3, 9e-3, 2e-3, 0.08, -0.05, 0.1]])

    def end(steps):
        one = Rod(section, np.array([0.0]), np.array([L]), L / steps, gravity=True)
        return one.integrate(wrench, np.array([[0.3, 0.2, 0.1]])).position[0]

    exact = end(64)
    errors = np.array([np.linalg.norm(end(n) - exact) for n in (3, 6, 12)])
    orders = np.log2(errors[:-1] / errors[1:])
    assert np.all(orders > 7.3), orders


@pytest.mark.integration
def test_default_settings_err_by_less_than_1e_minus_8_of_the_length():
    robot = routed(ParallelRouting(4.5e-3, 20.0), disks=3)
    steps = [LoadStep(tensions={"t1": 3.0}, loads={"tip": Load(L, (0.03, 0.05, 0.0))})]
    for path in ("straight", "continuous"):
        model = Model(path, "none", gravity=(0.0, -9.81, 0.0))
        coarse = solve_reference(robot, model, steps)
        fine = solve_reference(robot, model, steps, settings=ReferenceSettings(max_step=0.01))
        assert coarse.bending_angles[-1] > np.pi / 2.0
        np.testing.assert_allclose(coarse.tips, fine.tips, atol=CLOSE)


# ------------------------------------------------------------ tendons


@pytest.mark.parametrize(("tension", "angle"), [(0.5, 19.02837), (1.0, 38.39846), (2.5, 98.5664)])
def test_planar_integration_of_the_papers_robot(tension, angle):
    assert np.degrees(run(routed(), pull(tension)).bending_angles) == pytest.approx([angle], abs=6e-5)


def test_friction_of_the_papers_robot():
    step = run(routed(mu=0.3), pull(2.5), friction="per-hole").steps[0]
    assert np.degrees(step.bending_angle) == pytest.approx(80.2627, abs=1e-4)
    assert step.tensions[0][-1] == pytest.approx(1.69753, abs=1e-5)
    assert step.hole_states[0] == ("pull",) * 12 + ("anchor",)


def test_a_failing_step_is_named_with_a_cure(monkeypatch):
    monkeypatch.setattr("tdcr_fe.validation.reference.newton.MAX_ITERATIONS", 1)
    monkeypatch.setattr("tdcr_fe.validation.reference.path.MAX_BISECTIONS", 0)
    result = solve_reference(routed(), Model("straight", "none"), pull(0.0, 2.5))
    assert (result.converged, result.failed_step, len(result.steps)) == (False, 2, 1)
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

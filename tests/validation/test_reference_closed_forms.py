"""The reference against exact solutions, and its order of refinement."""

import numpy as np
import pytest
from robots import BACKBONE, routed
from robots import LENGTH as L

from tdcr_fe import Disks, Load, LoadStep, Model, ParallelRouting, Robot, Superelastic
from tdcr_fe.validation.reference import ReferenceSettings, solve_reference
from tdcr_fe.validation.reference.closed_forms import constant_strain
from tdcr_fe.validation.reference.rod import Rod
from tdcr_fe.validation.reference.section import Section, bending_moment

CLOSE = 1e-8 * L


def rod(disks=8, **changes):
    return Robot(BACKBONE, Disks.equally_spaced(disks, L)).with_backbone(**changes)


def solve(robot, *loads, gravity=(0.0, 0.0, 0.0), settings=None):
    step = LoadStep(loads={str(i): load for i, load in enumerate(loads)})
    model = Model(friction="none", gravity=gravity)
    return solve_reference(robot, model, [step], settings=settings).raise_if_failed().steps[0]


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


@pytest.mark.parametrize(
    ("changes", "moment", "curvature"),
    [
        ({"precurvature": (3.0, -2.0), "superelastic": Superelastic(0.001, 0.1)}, 0.0, (3.0, -2.0)),
        ({"superelastic": LAW}, float(MOMENT), (15.0, 0.0)),
    ],
    ids=["precurvature", "superelastic"],
)
def test_precurvature_or_a_moment_gives_the_arc_of_the_law(changes, moment, curvature):
    assert moment < BACKBONE.EI * curvature[0] / 1.3
    step = solve(rod(**changes), Load(L, moment=(moment, 0.0, 0.0)))
    rotation, position = constant_strain(np.array([*curvature, 0.0, 0.0, 0.0, 1.0]), L)
    np.testing.assert_allclose(step.tip, position, atol=CLOSE)
    np.testing.assert_allclose(step.rotations[-1], rotation, atol=1e-8)


def test_integration_is_of_order_eight():
    section = Section.of(BACKBONE, np.array([0.125]), np.array([False]))
    wrench = np.array([[4e-3, 9e-3, 2e-3, 0.08, -0.05, 0.1]])
    weight = np.array([[0.3, 0.2, 0.1]])

    def end(steps):
        one = Rod(section, np.array([0.0]), np.array([L]), L / steps, gravity=True)
        return one.integrate(wrench, weight).position[0]

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

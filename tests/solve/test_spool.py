"""A motor that winds a tendon on a spool, with a series spring: angle in, tension out."""

import numpy as np
import pytest
from inputs import ROBOT, SCENARIO, changed, write
from robots import BACKBONE, LENGTH, Robot, seven
from scenes import scene, solve_by_exudyn
from scipy.optimize import brentq

import tdcr_fe as tdcr
from tdcr_fe import InputError, SolveTDCR, read_scenario

RADIUS, STIFFNESS = 8e-3, 2e3
MODEL = tdcr.Model(elements_per_bay=2)
#: One tendon is wound, the others are let out, and back.
ANGLES = (0.3, 0.6, 0.2, 0.5)


def wound(stiffness: float | None, mu: float = 0.3, **rest) -> Robot:
    """The robot with three tendons on spools."""
    return seven(mu, spool=tdcr.Spool(RADIUS, stiffness), **rest)


def steps(factor: float = 1.0, kind: str = "motor_angles") -> list[tdcr.LoadStep]:
    wound = [factor * angle for angle in ANGLES]
    return [tdcr.LoadStep(**{kind: {"t1": a, "t2": -0.6 * a, "t3": -0.6 * a}}) for a in wound]


def test_the_tension_is_that_of_the_spring():
    """``T = k (r phi - u)``, never negative: the length ``u`` is that of a robot pulled with the same tensions."""
    result = tdcr.simulate(wound(STIFFNESS), MODEL, steps())
    first = result.steps[0]
    tensions = dict(zip(("t1", "t2", "t3"), first.base_tensions, strict=True))
    pulled = tdcr.simulate(seven(0.3), MODEL, [tdcr.LoadStep(tensions=tensions)])
    spring = STIFFNESS * (RADIUS * ANGLES[0] - pulled.steps[0].displacements[0])
    assert first.base_tensions == pytest.approx([spring, 0.0, 0.0], abs=1e-8)
    assert np.abs(first.positions - pulled.steps[0].positions).max() < 1e-10
    assert first.displacements == pytest.approx(RADIUS * ANGLES[0] * np.array([1.0, -0.6, -0.6]))
    assert all((step.base_tensions >= 0.0).all() for step in result.steps)


def test_a_straight_robot_with_elastic_tendons_in_closed_form():
    """Three equal angles: spring, tendon and the shortening of the backbone in series, from a pretension."""
    k, ea, rest, angle = 3e3, 500.0, 0.2, 0.1
    step = tdcr.LoadStep(motor_angles=dict.fromkeys(("t1", "t2", "t3"), angle))
    result = tdcr.simulate(wound(k, axial_stiffness=ea, pretension=rest), MODEL, [step])

    def gap(tension):
        shortened = LENGTH * (1.0 - 3.0 * tension / BACKBONE.EA)
        released = LENGTH / (1.0 + rest / ea) - shortened / (1.0 + tension / ea)
        return released + (tension - rest) / k - RADIUS * angle

    assert result.steps[0].base_tensions == pytest.approx(brentq(gap, 0.0, 10.0), rel=1e-7)


@pytest.mark.parametrize(("stiffness", "tolerance"), [(None, 1e-12), (1e9, 1e-6)])
def test_a_stiff_spring_is_a_displacement(stiffness, tolerance):
    by_angle = tdcr.simulate(wound(stiffness), MODEL, steps())
    by_length = tdcr.simulate(seven(0.3), MODEL, steps(RADIUS, "displacements"))
    for a, b in zip(by_angle.steps, by_length.steps, strict=True):
        assert np.abs(a.positions - b.positions).max() < tolerance * LENGTH


def test_scenes_and_exudyn_follow_the_angles():
    """`SolveTDCR` step by step, then ``mbs.SolveStatic``, against `simulate`."""
    _keep, mbs, arm = scene(wound(STIFFNESS))
    for step in steps()[:2]:
        arm.set_motor_angles(step.motor_angles)
        SolveTDCR(mbs)
    assert arm.displacements()["t1"] == pytest.approx(RADIUS * ANGLES[1])
    solve_by_exudyn(mbs, arm, lambda t: [ANGLES[1] - 0.03 * t, -0.36, -0.36], 0.2)
    more = [*steps()[:2], tdcr.LoadStep(motor_angles={"t1": ANGLES[1] - 0.03})]
    expected = tdcr.simulate(wound(STIFFNESS), tdcr.Model(elements_per_bay=1), more)
    assert np.abs(arm.tip_position - expected.steps[-1].positions[-1]).max() < 1e-6 * LENGTH


def test_files_have_spools_and_angles(tmp_path):
    spool = {"tendons.0.spool": {"radius": "8 mm", "stiffness": 2000.0}}
    wind = changed(SCENARIO, {"steps": [{"motor_angles": {"t1": "90 deg"}}]})
    scenario = read_scenario(write(tmp_path, changed(ROBOT, spool), wind))
    assert scenario.robot.tendons[0].spool == tdcr.Spool(8e-3, 2000.0)
    assert scenario.steps[0].motor_angles == {"t1": pytest.approx(np.radians(90.0))}
    with pytest.raises(InputError, match="no spool for a motor"):
        read_scenario(write(tmp_path, ROBOT, wind))

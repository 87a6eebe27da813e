"""The paper's robot through loading sequences: known values, and robots of every kind."""

import numpy as np
import pytest
from robots import BACKBONE, LENGTH, degrees, distance, paper, pull, solve, three

from tdcr_fe import Disks, Load, LoadStep, Model, ParallelRouting, Robot, SolverSettings, simulate

# ---------------------------------------------------------------- angles


def test_mesh_error_of_the_tip_angle_falls_with_nearly_order_four():
    """Against 98.56642 deg of the planar integration: slope of log error over log elements."""
    n = np.array([1, 2, 4, 8])
    angles = np.array([degrees(solve(paper(), pull(2.5), friction="none", elements_per_bay=k))[0] for k in n])
    # The limit by Richardson's extrapolation agrees with the planar integration, so the error is a mesh error.
    limit = angles[3] + (angles[3] - angles[2]) / 15.0
    assert limit == pytest.approx(98.56642, abs=5e-6)
    slopes = np.diff(np.log(np.abs(angles - limit))) / np.diff(np.log(n))
    assert slopes == pytest.approx([-3.69, -3.78, -4.0], abs=0.05)
    assert angles[2] == pytest.approx(98.56642, abs=3e-4)


@pytest.mark.parametrize("friction", ["per-tendon", "per-hole"])
def test_tip_angle_with_friction(friction):
    """80.24285 deg and 1.69769 N in the tip segment, from an independent prototype; 80.2627 deg of the reference.

    Monotone loading gives the same for both.
    """
    result = solve(paper(0.3), pull(0.5, 1.0, 1.5, 2.0, 2.5), friction=friction)
    assert degrees(result)[-1] == pytest.approx(80.24285, abs=1e-4)
    assert degrees(result)[-1] == pytest.approx(80.2627, rel=5e-4)
    assert result.steps[-1].tensions[0][-1] == pytest.approx(1.69769, abs=1e-5)
    fine = solve(paper(0.3), pull(0.5, 1.0, 1.5, 2.0, 2.5), friction=friction, elements_per_bay=4)
    assert degrees(fine)[-1] == pytest.approx(80.2627, abs=2e-4)


def test_turning_the_robot_turns_the_answer():
    """Tendons and loads rotated about z rotate the whole backbone, through a reversal of the load too."""
    phi = 40.0
    c, s = np.cos(np.radians(phi)), np.sin(np.radians(phi))
    turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])

    def steps(rotation):
        force = tuple(rotation @ [0.0, 0.03, 0.01])
        return [*pull(1.0, 2.0), LoadStep("", loads={"tip": Load(LENGTH, force)}), *pull(0.5)]

    settings = SolverSettings(tolerance=1e-11)
    a = solve(paper(0.3), steps(np.eye(3)), settings)
    b = solve(paper(0.3).with_tendons(routing=ParallelRouting(4.5e-3, phi)), steps(turn), settings)
    for x, y in zip(a.steps, b.steps, strict=True):
        assert distance(x.positions @ turn.T, y.positions) < 1e-9
        assert turn @ x.rotations @ turn.T == pytest.approx(y.rotations, abs=1e-8)


# ---------------------------------------------------------------- robots of every shape


def test_unloaded_robot_stays_as_it_was():
    result = solve(three(), [LoadStep(""), LoadStep("", {"t1": 0.0})])
    assert [s.iterations for s in result.steps] == [0, 0]
    assert distance(result.tips[-1], np.array([0.0, 0.0, LENGTH])) < 1e-14


# ---------------------------------------------------------------- gravity


def test_own_weight_deflects_as_a_uniform_load():
    """Tip of a cantilever under its weight q: q L^4 / (8 EI) (1 + 1 / (3 k^2)) + q L^2 / (2 GA) with k elements.

    J. M. Gere, B. J. Goodno, Mechanics of Materials, App. H, case 1, with the shear deflection of ch. 9. The weight of
    an element stands at its ends; the deflection under forces there is exact, and their sum is the trapezoidal rule
    for the integral of ``q s^2 (3 L - s) / (6 EI)``, which is too large by ``1 / (3 k^2)`` of it.
    """
    g = 0.01
    robot = Robot(BACKBONE, Disks((LENGTH,)), ())
    q = BACKBONE.mass_per_length * g
    for k in (1, 2, 4, 16):
        bent = q * LENGTH**4 / (8.0 * BACKBONE.EI) * (1.0 + 1.0 / (3.0 * k**2))
        tip = solve(robot, [LoadStep("")], gravity=(g, 0, 0), elements_per_bay=k).tips[0]
        assert tip[0] == pytest.approx(bent + q * LENGTH**2 / (2.0 * BACKBONE.GA), rel=2e-9)


# ---------------------------------------------------------------- failure


def test_a_load_that_cannot_be_reached_keeps_what_was_solved_and_names_the_step():
    steps = [*pull(1.0), LoadStep("too much", {"t1": 7e4}), *pull(0.0)]
    result = simulate(paper(0.3), Model(elements_per_bay=1), steps, SolverSettings(min_substep=1.0))
    assert (result.converged, result.failed_step, len(result.steps)) == (False, 2, 1)
    assert degrees(result)[0] == pytest.approx(35.1878, abs=1e-3)
    for word in ("step 2", "too much", "residual", "Check the input first", "steps[1].tensions.t1 = 70000 N"):
        assert word in result.message

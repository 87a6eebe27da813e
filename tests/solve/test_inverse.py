"""Tensions and displacements found for targets of the tip: reached, within bounds, of least effort, and reproduced."""

import numpy as np
import pytest
from robots import BACKBONE, LENGTH, seven, tendon, wire

from tdcr_fe import Disks, Interrupted, Load, LoadStep, Model, Robot, SolverSettings, simulate
from tdcr_fe.model.targets import ReachStatus, TensionLimits, TipTarget
from tdcr_fe.solve.inverse_statics.inverse import TOLERANCE, follow_path, reach

FINE = 1e-6 * LENGTH
LIMITS = TensionLimits(largest=2.5, pretension=0.1)


def two_segments(mu: float) -> Robot:
    """Six tendons; three end in the middle, three at the tip, 60 degrees from the others."""
    near = [tendon(f"p{i}", 120.0 * i, mu, end=0.5 * LENGTH) for i in range(3)]
    far = [tendon(f"d{i}", 60.0 + 120.0 * i, mu) for i in range(3)]
    return Robot(BACKBONE, Disks.equally_spaced(10, LENGTH, radius=5e-3), (*near, *far), "two segments")


CASES = {
    "no friction": (seven(0.0), Model(friction="none", elements_per_bay=1)),
    "friction": (seven(0.2), Model(elements_per_bay=1)),
    "two segments": (two_segments(0.2), Model(elements_per_bay=1)),
}


def random_tips(robot: Robot, model: Model, count: int, seed: int = 0) -> np.ndarray:
    """Tips that random tensions within the limits lead to from the unloaded robot."""
    generator = np.random.default_rng(seed)
    tips = []
    while len(tips) < count:
        tensions = generator.uniform(0.1, 2.5, len(robot.tendons))
        step = LoadStep(tensions=dict(zip(robot.tendon_names, tensions.tolist(), strict=True)))
        found = simulate(robot, model, [step])
        if found.converged:
            tips.append(found.tips[-1])
    return np.array(tips)


@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize("drive_by", ["tension", "displacement"])
def test_tips_of_random_tensions_are_reached_within_the_bounds(case, drive_by):
    robot, model = CASES[case]
    for tip in random_tips(robot, model, 1, seed=4):
        found = reach(robot, model, tip, LIMITS, drive_by=drive_by)
        assert found.status is ReachStatus.REACHED, found
        assert found.error <= TOLERANCE * LENGTH
        assert (found.tensions >= 0.1 - 1e-5).all() and (found.tensions <= 2.5 + 1e-5).all()
        # The step alone, from the unloaded robot, leads there.
        again = simulate(robot, model, [found.step])
        assert np.linalg.norm(again.tips[-1] - tip) == pytest.approx(found.error, abs=FINE)


@pytest.mark.campaign
@pytest.mark.parametrize("tolerance", [None, FINE])
@pytest.mark.parametrize("case", CASES)
def test_99_percent_of_random_reachable_targets_are_reached(case, tolerance):
    """334 targets of each robot, a thousand in all; 99 % reach the tolerance, by default and at 1e-6 of the length."""
    robot, model = CASES[case]
    tips = random_tips(robot, model, 334, seed=11)
    found = [reach(robot, model, tip, LIMITS, tolerance=tolerance) for tip in tips]
    assert sum(x.error <= (tolerance or 1e-3 * LENGTH) for x in found) >= 0.99 * len(found)


@pytest.mark.parametrize("drive_by", ["tension", "displacement"])
def test_the_loading_sequence_solved_again_ends_where_the_path_did(drive_by):
    """With friction every step begins in the state that the last one left; forwards and back, with a load."""
    robot, model = CASES["friction"]
    before = [LoadStep("load", loads={"tip": Load(LENGTH, (0.0, 0.02, 0.0))})]
    pulls = [LoadStep(tensions={"t1": 1.2, "t2": 0.5, "t3": 0.1}), LoadStep("", {"t1": 0.6})]
    ends = simulate(robot, model, [*before, *pulls]).tips[1:]
    path = [ends[0], ends[1], ends[0]]
    found = follow_path(robot, model, path, LIMITS, drive_by=drive_by, before=before, tolerance=FINE)
    assert found.simulation.converged and len(found.steps) == 4
    again = simulate(robot, found.simulation.model, found.steps)
    # Linearisations kept from the step before make a difference far below the tolerance.
    assert np.abs(again.tips - found.simulation.tips).max() <= 0.1 * FINE
    assert np.abs(again.tips[1:] - np.array([x.result.tip for x in found.targets])).max() <= 0.1 * FINE
    assert found.errors == pytest.approx(np.linalg.norm(again.tips[1:] - path, axis=1), abs=0.1 * FINE)
    # The last target is where the first one is, but the friction has another history.
    assert np.abs(found.tensions[2] - found.tensions[0]).max() > 1e-3


@pytest.mark.integration
def test_position_and_direction_are_reached_by_two_segments():
    robot, model = CASES["two segments"]
    tensions = {"p0": 1.0, "p1": 0.3, "p2": 0.2, "d0": 0.2, "d1": 0.6, "d2": 0.3}
    goal = simulate(robot, model, [LoadStep(tensions=tensions)]).steps[-1]
    target = TipTarget(tuple(goal.tip), tuple(3.0 * goal.tangent), "pose")
    found = reach(robot, model, target, LIMITS, tolerance=FINE)
    assert found.status is ReachStatus.REACHED
    assert found.error <= FINE and found.direction_error <= 1e-6
    assert np.sum(found.tensions**2) <= sum(x**2 for x in tensions.values()) * (1.0 + 1e-6)
    # The position alone takes less effort, and leaves another direction.
    alone = reach(robot, model, goal.tip, LIMITS)
    assert alone.direction_error is None
    assert np.sum(alone.tensions**2) < np.sum(found.tensions**2)
    assert np.linalg.norm(alone.result.tangent - goal.tangent) > 1e-2


def test_no_neighbouring_tensions_reach_the_target_with_less_effort():
    """The gradient of the effort has no part along the tensions that keep the tip, tendons at their bounds left out."""
    robot, model = two_segments(0.0), Model(friction="none", elements_per_bay=1)
    (tip,) = random_tips(robot, model, 1, seed=7)
    found = reach(robot, model, tip, LIMITS)
    assert found.reached
    jacobian = simulate(robot, model, [found.step], responses=True).steps[-1].responses[0].by_tension[:3]
    free = np.flatnonzero((found.tensions > 0.1 + 1e-6) & (found.tensions < 2.5 - 1e-6))
    multiplier = np.linalg.lstsq(jacobian[:, free].T, found.tensions[free], rcond=None)[0]
    gradient = found.tensions - jacobian.T @ multiplier
    assert np.abs(gradient[free]).max() < 0.05 * np.abs(found.tensions).max()
    assert (gradient[found.tensions <= 0.1 + 1e-6] >= -0.05 * np.abs(found.tensions).max()).all()


@pytest.mark.integration
def test_out_of_reach_ends_at_the_nearest_point_and_says_so():
    """Above the straight robot the tensions are the smallest ones; elsewhere no random tensions come nearer."""
    robot, model = CASES["no friction"]
    above = reach(robot, model, (0.0, 0.0, 1.1 * LENGTH), LIMITS)
    assert above.status is ReachStatus.OUT_OF_REACH
    assert above.error == pytest.approx(0.1 * LENGTH, rel=1e-3)
    assert above.tensions == pytest.approx(0.1, abs=1e-9)
    assert above.at_largest == ()
    assert "out of reach; the nearest point found is 25 mm away" in repr(above)
    target = np.array([0.12, 0.05, 0.15])
    found = reach(robot, model, target, LIMITS)
    assert found.status is ReachStatus.OUT_OF_REACH and found.possible_gain <= 1e-4
    assert found.error < np.linalg.norm(random_tips(robot, model, 60, seed=2) - target, axis=1).min()


@pytest.mark.integration
@pytest.mark.parametrize("height", [0.191, None])
def test_neighbours_on_a_circle_have_neighbouring_tensions(height):
    """A robot of one segment moves its tip on a surface; 20 N would bring it 0.1 mm nearer to points off it."""
    circle = [(0.05 * np.cos(a), 0.05 * np.sin(a), height) for a in np.radians(np.arange(0, 361, 30))]
    model, limits = Model(friction="none", elements_per_bay=1), TensionLimits(20.0, 0.2)
    found = follow_path(wire(), model, circle, limits)
    # Targets that are turned by 120 degrees, or mirrored, have the same error and the same tensions.
    tensions, third = found.tensions, [1, 2, 0]
    assert found.errors[4:] == pytest.approx(found.errors[:-4], abs=1e-6)
    assert tensions[4:, third] == pytest.approx(tensions[:-4], abs=0.01)
    assert tensions[::-1, [0, 2, 1]] == pytest.approx(tensions, abs=0.01)
    # A bending moment of constant size that turns: 0.5 of the largest tension for 30 degrees is its largest change.
    assert np.abs(np.diff(tensions, axis=0)).max() < 0.55 * tensions.max()
    assert tensions.max() < 6.0
    # From the other side as well: without friction it does not matter where the robot comes from.
    back = follow_path(wire(), model, circle[::-1], limits)
    assert back.tensions[::-1] == pytest.approx(tensions, abs=0.01)
    if height is None:
        assert all(x.reached for x in found.targets) and found.errors.max() < 1e-6
    else:
        assert found.errors.max() < found.errors.min() + 1e-5


def test_ctrl_c_is_raised_again_with_the_targets_before_it():
    def stop(found):
        if found.result.step == 2:
            raise KeyboardInterrupt

    robot, model = CASES["no friction"]
    pulls = [LoadStep("", {"t1": t, "t2": 0.1, "t3": 0.1}) for t in (0.2, 0.4, 0.6)]
    tips = simulate(robot, model, pulls).tips
    with pytest.raises(Interrupted) as stopped:
        follow_path(robot, model, tips, LIMITS, progress=stop)
    result = stopped.value.result
    assert len(result.targets) == 2 and result.simulation.message == "interrupted"


def test_a_step_before_the_targets_without_a_solution_ends_the_path_and_is_named():
    """As in `simulate`; the step that was solved before it is kept. It was raised, without its number."""
    robot, model = CASES["friction"]
    loads = {"a": Load(LENGTH, (0.0, 0.0, -0.9)), "b": Load(0.8 * LENGTH, (0.3, -0.5, -0.8))}
    steps = [LoadStep(tensions={"t1": 1e-6}), LoadStep(tensions={"t1": 5.0}, loads=loads, label="far")]
    settings = SolverSettings(max_iterations=2, min_substep=0.5)
    found = follow_path(robot, model, [[0.0, 0.0, 0.9 * LENGTH]], LIMITS, settings, before=steps)
    assert not found.targets and len(found.simulation.steps) == found.simulation.failed_step - 1 == 1
    assert found.simulation.message.startswith("step 2 (far) did not converge: the forces do not balance")

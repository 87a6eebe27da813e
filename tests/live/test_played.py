"""A played robot: its sequence leads `simulate` to the same shapes, and a pull is in balance with its spring."""

from dataclasses import replace

import numpy as np
import pytest
from robots import three

import tdcr_fe as tdcr
from tdcr_fe.live.played import PlayedRobot


def played() -> PlayedRobot:
    return PlayedRobot(three(), tdcr.Model(elements_per_bay=1))


def pull_until_settled(robot: PlayedRobot, place: int, to: tuple[float, float, float]) -> int:
    """Number of load steps that it takes."""
    for count in range(1, 30):
        if robot.pull(place, to).settled:
            return count
    raise AssertionError("not settled")


def test_simulate_repeats_what_was_played():
    """Tension, pulls at a disk and at the tip, displacement, no loads: the saved sequence has the history."""
    robot = played()
    robot.drive({"t1": 1.5}, {})
    pull_until_settled(robot, 6, (0.05, 0.03, 0.12))
    robot.pull(12, (0.1, 0.05, 0.15))
    robot.drive({}, {"t2": 2e-3})
    robot.let_go()
    robot.drive({"t1": 0.5}, {})
    again = tdcr.simulate(robot.robot, robot.model, robot.steps, robot.settings)
    assert again.converged and len(again.steps) == len(robot.steps)
    last = robot.last.result.steps[-1]
    assert np.max(np.abs(again.steps[-1].positions - last.positions)) < 1e-6 * 0.25
    assert again.steps[-1].hole_states == last.hole_states


def test_the_force_is_that_of_the_spring():
    """In balance the force leads from the disk to the mouse, and the disk has come most of the way."""
    robot, to = played(), np.array([0.06, 0.0, 0.22])
    start = robot.position(12)
    pull_until_settled(robot, 12, tuple(to))
    force, gap = robot.steps[-1].loads["pull_13"].force, to - robot.position(12)
    assert np.dot(force, gap) / np.linalg.norm(force) / np.linalg.norm(gap) > 0.999
    assert np.linalg.norm(gap) < 0.5 * np.linalg.norm(to - start)
    # The same spring holds at another end: the ratio of force and length stays.
    ratio = np.linalg.norm(force) / np.linalg.norm(gap)
    pull_until_settled(robot, 12, (0.03, 0.02, 0.24))
    force, gap = robot.steps[-1].loads["pull_13"].force, np.array([0.03, 0.02, 0.24]) - robot.position(12)
    assert np.linalg.norm(force) / np.linalg.norm(gap) == pytest.approx(ratio, rel=0.05)


def test_friction_is_switched_at_equal_inputs():
    """The shape is that of one load step from the straight robot; switched on again, the history begins anew."""
    robot = played()
    for tension in (2.0, 1.0):
        robot.drive({"t1": tension}, {})
    released = robot.last.result.steps[-1].bending_angle
    for friction in (False, True):
        answer = robot.switch_friction(friction)
        model = replace(robot.model, friction="per-hole" if friction else "none")
        (step,) = tdcr.simulate(robot.robot, model, [tdcr.LoadStep(tensions={"t1": 1.0})]).steps
        assert answer.result.steps[-1].bending_angle == pytest.approx(step.bending_angle, abs=1e-7)
    assert answer.result.steps[-1].bending_angle < 0.9 * released


@pytest.mark.parametrize("why", ["not solved", "its time limit was reached at 0% of the load"])
def test_a_step_that_fails_leaves_the_robot_where_it_was(monkeypatch, why):
    robot = played()
    robot.drive({"t1": 1.0}, {})
    steps, tip = list(robot.steps), robot.last.result.steps[-1].tip
    settings = robot._sequence.simulation.settings
    if why == "not solved":
        robot._sequence.simulation.settings = replace(settings, max_iterations=1, min_substep=1.0)
    else:
        monkeypatch.setattr("tdcr_fe.live.played.LONGEST_STEP", 0.0)
    assert why in robot.drive({"t1": 1.0, "t2": 60.0}, {}).message and robot.steps == steps
    robot._sequence.simulation.settings = settings
    monkeypatch.undo()
    robot.drive({"t1": 1.0}, {})
    assert np.allclose(robot.last.result.steps[-1].tip, tip, atol=1e-7)


def test_the_unloaded_robot_has_the_time_it_needs(monkeypatch):
    """A hundred heavy disks take longer than a load step may; the command ended with a traceback."""
    monkeypatch.setattr("tdcr_fe.live.played.LONGEST_STEP", 0.0)
    robot = PlayedRobot(three(), tdcr.Model(elements_per_bay=1, gravity=(0.0, 9.81, 0.0)))
    assert robot.last.made and [s.label for s in robot.steps] == ["unloaded"]


def test_robots_without_disks_or_tendons_are_pulled_too():
    rod = tdcr.Robot(tdcr.Backbone(0.2, 0.5e-3, 60e9, 0.3))
    robot = PlayedRobot(rod, tdcr.Model.default_for(rod))
    assert len(robot.places) == 10
    force, stiffness = 1e-3, 3.0 * rod.backbone.EI / 0.2**3
    robot.pull(9, (1.25 * force / stiffness, 0.0, 0.2))  # the spring is four times as stiff as the rod
    assert robot.steps[-1].loads["pull_10"].force[0] == pytest.approx(force, rel=1e-2)

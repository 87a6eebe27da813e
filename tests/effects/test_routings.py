"""Effects that are other routings: misplaced channels; and a routing of a user's own, through tilted disks."""

import math
from dataclasses import dataclass, replace

import exudyn as exu
import numpy as np
import pytest
from robots import paper, scene

from tdcr_fe import Backbone, Disks, LoadStep, Model, Robot, Tendon, simulate
from tdcr_fe.effects import Experiment, effect, with_effect
from tdcr_fe.model.routing import ConvergingRouting, HelicalRouting, ParallelRouting, Routing

BODY = Backbone(0.3, 10e-3, 0.4e6, 0.45, density=1100.0)
MODEL = Model("continuous", "none", gravity=(0.0, 0.0, 9.81), elements_per_bay=1)
STEPS = (LoadStep(tensions={"a": 2.0, "b": 0.5}), LoadStep(tensions={"a": 0.4, "b": 1.5}))
CHANNELS = (ParallelRouting(6e-3, 0.0), ParallelRouting(6e-3, 120.0))


def setup(*routings):
    tendons = tuple(Tendon(n, r, end=0.25) for n, r in zip("ab", routings, strict=True))
    return Experiment(Robot(BODY, tendons=tendons), MODEL, STEPS)


def tips(experiment):
    return simulate(experiment.robot, experiment.model, experiment.steps).tips


def moved(**values):
    return tips(with_effect(setup(*CHANNELS), "misplaced_channels", **values))


def test_a_factor_at_the_end_makes_a_converging_channel():
    converging = setup(ConvergingRouting(6e-3, 3e-3, 0.0), ConvergingRouting(6e-3, 3e-3, 120.0))
    assert moved(factor_end=0.5) == pytest.approx(tips(converging), abs=1e-10)


def test_an_angle_at_the_end_makes_a_helix():
    helix = setup(HelicalRouting(6e-3, 0.1, 0.0), CHANNELS[1])
    assert moved(angle_end_a=0.2 * math.pi) == pytest.approx(tips(helix), abs=1e-10)


def test_the_number_of_a_tendon_counts_before_that_of_all():
    one = moved(factor_base_a=1.2, factor_end_a=1.2, factor_base=0.9, factor_end=0.9)
    expected = setup(ParallelRouting(7.2e-3, 0.0), ParallelRouting(5.4e-3, 120.0))
    assert one == pytest.approx(tips(expected), abs=1e-10)


def test_a_search_tries_it_on_bodies_without_disks_alone():
    soft = setup(*CHANNELS)
    forms = effect("misplaced_channels").forms(soft)
    assert [len(f.parameters) for f in forms] == [1, 4, 5, 6]
    disks = replace(soft.robot, disks=Disks.equally_spaced(6, 0.3, radius=9e-3))
    assert effect("misplaced_channels").forms(replace(soft, robot=disks)) == ()


# ------------------------------------------------------------ tilted disks


@dataclass(frozen=True)
class TiltedDisks(Routing):
    """Another routing through disks that are turned about their x and y axes by small angles [rad]."""

    base: Routing
    tilt_x: float
    tilt_y: float

    def position(self, s, end, derivative=0):
        return self.base.position(s, end, derivative)

    def axial(self, s, end):
        x, y = self.base.position(s, end).T
        return np.where(np.asarray(s) > 0.0, self.tilt_x * y - self.tilt_y * x, 0.0)  # not the base plate


def test_holes_of_tilted_disks_lie_in_the_plane_of_the_disk():
    """The normal of a tilted disk is (tilt_y, -tilt_x, 1) to first order; the base plate stays upright."""
    robot = paper(0.3)
    robot = robot.with_tendons(routing=TiltedDisks(ParallelRouting(4.5e-3, 30.0), 0.1, -0.2))
    points = robot.hole_points(robot.tendons[0])
    assert points[1:] @ [-0.2, -0.1, 1.0] == pytest.approx(0.0, abs=1e-15)
    assert points[0, 2] == 0.0 and np.all(np.abs(points[1:, 2]) > 1e-4)
    _keep, mbs, handle = scene(robot)
    markers = [np.array(mbs.GetMarkerOutput(m, exu.OutputVariableType.Position)) for m in handle.mHoles[0]]
    expected = points + np.outer(robot.hole_arc_lengths(robot.tendons[0]), [0.0, 0.0, 1.0])
    assert np.array(markers) == pytest.approx(expected, abs=1e-12)

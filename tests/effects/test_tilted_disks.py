"""Tilted disks as an effect in one file: what a user would write, against geometry and the reference."""

from __future__ import annotations

from dataclasses import dataclass, replace

import exudyn as exu
import numpy as np
import pytest
from robots import paper, scene

from tdcr_fe.effects.base import Effect, Experiment, Parameter
from tdcr_fe.model.loading import LoadStep, Model
from tdcr_fe.model.routing import Routing


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


class DiskTilt(Effect):
    name = "disk_tilt"
    parameters = (
        Parameter("tilt_x", "rad", -0.5, 0.5, 0.0, 0.02, "about the x axis of the section"),
        Parameter("tilt_y", "rad", -0.5, 0.5, 0.0, 0.02, "about the y axis of the section"),
    )

    def apply(self, experiment, values):
        tendons = tuple(
            replace(t, routing=TiltedDisks(t.routing, values["tilt_x"], values["tilt_y"]))
            for t in experiment.robot.tendons
        )
        return experiment.with_robot(tendons=tendons)


STEPS = tuple(LoadStep("", {"t1": x}) for x in (0.5, 1.5, 0.5))


def tilted(tilt_x, tilt_y, model=None):
    given = Experiment(paper(0.3, 30.0), model or Model(friction="per-hole", elements_per_bay=2), STEPS)
    return DiskTilt().apply(given, {"tilt_x": tilt_x, "tilt_y": tilt_y})


def test_holes_of_tilted_disks_lie_in_the_plane_of_the_disk():
    """The normal of a tilted disk is (tilt_y, -tilt_x, 1) to first order; the base plate stays upright."""
    robot = tilted(0.1, -0.2).robot
    points = robot.hole_points(robot.tendons[0])
    assert points[1:] @ [-0.2, -0.1, 1.0] == pytest.approx(0.0, abs=1e-15)
    assert points[0, 2] == 0.0 and np.all(np.abs(points[1:, 2]) > 1e-4)
    _keep, mbs, handle = scene(robot)
    markers = [np.array(mbs.GetMarkerOutput(m, exu.OutputVariableType.Position)) for m in handle.mHoles[0]]
    expected = points + np.outer(robot.hole_arc_lengths(robot.tendons[0]), [0.0, 0.0, 1.0])
    assert np.array(markers) == pytest.approx(expected, abs=1e-12)

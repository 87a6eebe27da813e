"""Sensitivities in a scene: those of `simulate` for a robot alone, and with what carries the robot moving."""

from dataclasses import replace

import numpy as np
import pytest
from robots import LENGTH, hinged_platform, scene_with, seven, tip_load

from tdcr_fe import CreateTDCR, SolveTDCR, simulate, track_sensitivities
from tdcr_fe.model.loading import Load, LoadStep, Model, SolverSettings
from tdcr_fe.model.robot import SideSpring

SETTINGS = SolverSettings(tolerance=1e-11)
NAMES = ["backbone.youngs_modulus", "tendons.friction_coefficient", "inputs.t1", "loads.tip.force_y"]
NAMES += ["backbone.length", "springs[0].stiffness"]


def test_a_robot_alone_has_the_derivatives_of_simulate():
    """Wherever its base is: springs to ground are at rest where the unloaded robot is."""
    robot = replace(seven(0.3), springs=(SideSpring(0.15, 1.5),))
    steps = [LoadStep("", {"t1": 1.0, "t2": 0.3}, loads={"tip": Load(LENGTH)}, substeps=2)]
    steps += [LoadStep("", {"t1": 0.6}, loads={"tip": Load(LENGTH, (0.0, 0.02, 0.0))}, substeps=2)]
    expected = simulate(robot, Model(elements_per_bay=1), steps, SETTINGS, sensitivities=NAMES).sensitivities
    _container, mbs, arm, tip = scene_with(tip_load, robot, referencePosition=[0.1, 0.05, 0.2])
    tracked = track_sensitivities(arm, NAMES)
    for step in steps:
        arm.set_tensions(step.tensions)
        tip.set(step.loads["tip"].force)
        SolveTDCR(mbs, SETTINGS, substeps=2, sensitivities=[tracked])
    result = tracked.result()
    for name in NAMES:
        a, b = result[name], expected[name]
        for kind in ("positions", "tensions"):
            found, known = np.array(getattr(a, kind)), np.array(getattr(b, kind))
            np.testing.assert_allclose(found, known, rtol=0.0, atol=1e-7 * np.abs(known).max())


@pytest.mark.parametrize("field", ["youngs_modulus", "radius"])
def test_the_platform_that_gives_way_is_in_the_derivative(field):
    """Against central differences of whole solutions; the weight of the robot turns the platform."""
    robot = seven(0.2)
    value = getattr(robot.backbone, field)

    def solved(factor: float = 1.0) -> tuple[np.ndarray, np.ndarray]:
        """Shapes after two pulls, and their derivatives."""
        _keep, mbs, platform = hinged_platform(0.5)
        changed = robot.with_backbone(**{field: value * factor})
        model = Model(elements_per_bay=1, gravity=(9.81, 0.0, 0.0))
        arm = CreateTDCR(mbs, changed, model, baseMarker=platform)
        mbs.Assemble()
        tracked, shapes = track_sensitivities(arm, [f"backbone.{field}"]), []
        for tension in (0.8, 0.5):
            arm.set_tensions({"t1": tension})
            SolveTDCR(mbs, SETTINGS, substeps=4, sensitivities=[tracked])
            shapes.append(arm.shape()[0])
        return np.array(shapes), tracked.result()[f"backbone.{field}"].positions

    h = 1e-4
    found, expected = solved()[1], (solved(1.0 + h)[0] - solved(1.0 - h)[0]) / (2.0 * h * value)
    assert np.abs(found - expected).max() < 1e-5 * np.abs(expected).max()

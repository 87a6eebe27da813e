"""Unstable equilibria of a robot under compression are reported, stable ones are not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from robots import BACKBONE, LENGTH, paper

from tdcr_fe.model.backbone import Backbone
from tdcr_fe.model.loading import Load, LoadStep, Model, resolve
from tdcr_fe.model.robot import Disks, Robot
from tdcr_fe.solve.simulate import Simulation, simulate
from tdcr_fe.solve.stability import ExternalCompression

EULER = np.pi**2 * BACKBONE.EI / (4.0 * LENGTH**2)
COLUMN = Robot(BACKBONE, Disks.equally_spaced(13, LENGTH), ())
UP = (0.0, 0.0, -9.81)


def push(fraction: float, sideways: float = 1e-3) -> LoadStep:
    return LoadStep("", loads={"tip": Load(LENGTH, (sideways * EULER, 0.0, -fraction * EULER))})


def unstable(robot: Robot, model: Model, steps: list[LoadStep]) -> bool:
    result = simulate(robot, model, steps)
    assert result.converged
    return any("the equilibrium is unstable" in w for w in result.warnings)


@pytest.mark.parametrize(("fraction", "expected"), [(0.2, False), (0.9, False), (1.02, True), (3.0, True)])
def test_a_column_beyond_eulers_load_is_reported(fraction: float, expected: bool) -> None:
    """Version 0.1.0 returned the column at 1.02 of Euler's load, bent against the sideways force, without a warning."""
    assert unstable(COLUMN, Model(friction="none"), [push(fraction)]) is expected


@pytest.mark.parametrize(("fraction", "expected"), [(0.9, False), (1.1, True)])
def test_a_heavy_tip_on_an_upright_robot_is_reported(fraction: float, expected: bool) -> None:
    robot = replace(paper(), tip_mass=fraction * EULER / 9.81, backbone=replace(BACKBONE, density=0.0))
    robot = replace(robot, disks=replace(robot.disks, mass=0.0))
    assert unstable(robot, Model(friction="none", gravity=UP), [LoadStep()]) is expected


def test_own_weight_and_a_load_at_mid_span_compress_what_is_below() -> None:
    """At the base: the weight of rod, disks and tip, and the load."""
    backbone = Backbone(LENGTH, 4e-4, 85e9, 0.3, 5600.0)
    robot = Robot(backbone, Disks.equally_spaced(13, LENGTH, mass=2e-4), (), tip_mass=1e-3)
    model = Model(friction="none", gravity=UP)
    step = LoadStep("", loads={"middle": Load(0.5 * LENGTH, (0.0, 0.0, -0.01))})
    result = simulate(robot, model, [step])
    weight = 9.81 * (backbone.mass_per_length * LENGTH + 13 * 2e-4 + 1e-3)
    compression = ExternalCompression.of(Simulation(robot, model, resolve(robot, [step])))
    assert compression.ratio(result.steps[0]) == pytest.approx((weight + 0.01) / EULER, rel=1e-9)
    hanging = replace(model, gravity=(0.0, 0.0, 9.81))
    found = simulate(robot, hanging, [LoadStep()])
    compression = ExternalCompression.of(Simulation(robot, hanging, resolve(robot, [LoadStep()])))
    assert compression.ratio(found.steps[0]) == 0.0

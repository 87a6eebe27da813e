"""Stability of solved states, against Euler's column and the potential of the forces."""

from dataclasses import replace

import numpy as np
import pytest
from robots import simulation, three

from tdcr_fe import Load, LoadStep, stability
from tdcr_fe.validation.paper.cases import MODELS, figure

ROBOT = figure("fig3").robot
#: Critical load of the backbone as a column clamped at the base [N].
EULER = np.pi**2 * ROBOT.backbone.EI / (4.0 * ROBOT.backbone.length**2)


def push(share):
    return LoadStep("push", loads={"tip": Load(ROBOT.backbone.length, (0.0, 0.0, -share * EULER))})


def column_eigenvalue(share):
    """Straight cantilever under a share of Euler's load P_E: w with ``1 - w = P/P_E (1 - P/EA + P/((1 - w) GA))``.

    The second variation, ``(1 - w) (EI phi'^2 + GA g^2) - P (1 - P/EA) phi^2 - 2 P g phi`` along the rod, least over
    the shear g; phi goes with ``sin(pi s / (2 L))``.
    """
    b = ROBOT.backbone
    p = share * EULER
    rest = share
    for _ in range(5):
        rest = share * (1.0 - p / b.EA + p / (rest * b.GA))
    return 1.0 - rest


@pytest.mark.parametrize("share", [1e-6, 0.25, 0.5, 0.9])
def test_column_has_the_eigenvalue_one_minus_load_over_eulers_load(share):
    found = stability(simulation(ROBOT, MODELS["discrete"], [push(share)]))
    assert found.smallest == pytest.approx(1.0 - share, abs=3e-6)
    assert found.smallest == pytest.approx(column_eigenvalue(share), abs=2e-7)
    assert found.divergence == pytest.approx(found.smallest, abs=1e-9)
    assert found.stable


@pytest.mark.parametrize("key", ["classical", "discrete"])
def test_tangent_without_friction_is_symmetric_however_far_the_robot_bends(key):
    """The forces have a potential."""
    side = LoadStep("side", loads={"tip": Load(0.25, (0.0, 0.3, 0.0))})
    found = stability(simulation(ROBOT, MODELS[key], [LoadStep("pull", {"t1": 1.5}), side]))
    assert found.asymmetry < 1e-6
    assert 0.5 < found.smallest < 1.0


def test_prescribed_displacements_stiffen_the_robot():
    """Driven by displacement, only changes of shape that keep the lengths of the tendons are free."""
    robot = replace(ROBOT, tendons=three(0.0).tendons)
    steps = [LoadStep("", {"t1": 0.5, "t2": 0.5, "t3": 0.5}), push(0.5)]
    free = simulation(robot, MODELS["discrete"], steps)
    pulled = dict(zip(robot.tendon_names, free.displacement.tolist(), strict=True))
    held = simulation(robot, MODELS["discrete"], [*steps, LoadStep("", displacements=pulled)])
    assert stability(held).smallest > stability(free).smallest + 0.1

"""Scale of forces in the convergence test: that of the backbone."""

from __future__ import annotations

from dataclasses import replace

import pytest
from robots import BACKBONE, LENGTH

from tdcr_fe.model.loading import LoadStep, Model, resolve
from tdcr_fe.model.robot import Disks, Robot
from tdcr_fe.model.routing import ParallelRouting
from tdcr_fe.model.tendon import Tendon
from tdcr_fe.solve.simulate import Simulation

PRECURVED = Robot(
    replace(BACKBONE, precurvature=(-1.8, -2.0)),
    Disks.equally_spaced(13, LENGTH, radius=7e-3, thickness=6e-3),
    (Tendon("t1", ParallelRouting(2e-3, -24.0), friction_coefficient=0.2),),
)
MODEL = Model(elements_per_bay=1)


@pytest.mark.parametrize("base_stiffness", [None, 0.1, 2.0, 100.0])
def test_a_base_that_gives_way_leaves_the_scale_of_forces(base_stiffness: float | None) -> None:
    """It was the bending stiffness of the base's element, a thousandth of that of the backbone."""
    robot = replace(PRECURVED, base_stiffness=base_stiffness)
    simulation = Simulation(robot, MODEL, resolve(robot, [LoadStep()]))
    assert simulation.system.layout.scales.elastic_force == pytest.approx(BACKBONE.EI / LENGTH**2, rel=1e-12)

"""Jumps between branches of equilibria, distinguished from large changes on one branch by the slopes at its ends."""

from __future__ import annotations

import numpy as np
import pytest

from tdcr_fe import Backbone, Disks, Load, LoadStep, Model, Robot, Tendon
from tdcr_fe.model.loading import SolverSettings, resolve
from tdcr_fe.model.routing import ParallelRouting
from tdcr_fe.solve.load_steps.judges import is_continuous
from tdcr_fe.solve.load_steps.load_path import Ramp
from tdcr_fe.solve.load_steps.substep import SubstepSolver
from tdcr_fe.solve.simulation import Simulation

LENGTH = 0.2
ROBOT = Robot(
    Backbone(LENGTH, 0.5e-3, 60e9, 0.3),
    Disks.equally_spaced(4, LENGTH, mass=0.0, radius=6e-3),
    (Tendon("t1", ParallelRouting(4e-3, 0.0), 0.3),),
)
#: Load of a cantilever at which it buckles [N].
EULER = np.pi**2 * ROBOT.backbone.EI / (2.0 * LENGTH) ** 2


def pushed(across: float, along: float, tension: float = 0.01) -> LoadStep:
    """The tip pushed across the rod and along it; forces over the buckling load."""
    force = (0.0, across * EULER, -along * EULER)
    return LoadStep("", {"t1": tension}, loads={"tip": Load(LENGTH, force)})


def continuous_from_rest(*steps: LoadStep) -> bool:
    """Whether the end of some load steps, taken as one from rest, is on the branch of rest."""
    targets = resolve(ROBOT, steps)
    simulation = Simulation(ROBOT, Model(elements_per_bay=2), targets)
    rest = simulation.state
    for target in targets:
        simulation.advance(target)
    ramp = Ramp.of(simulation.system, rest, 0.0, 0.0)
    solver = SubstepSolver(simulation.system, ramp, SolverSettings())
    return is_continuous(solver, rest, 0.0, simulation.state, 1.0)


@pytest.mark.parametrize("across", [0.2, -0.6, 0.9])
def test_bending_far_is_no_jump(across):
    assert continuous_from_rest(pushed(across, 0.0))


def test_the_other_side_of_a_buckled_rod_is_a_jump():
    # Bent to one side by a force across it, the rod stays there when that force is turned to the other side.
    assert not continuous_from_rest(pushed(-0.2, 1.5), pushed(0.02, 1.5))

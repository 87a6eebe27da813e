"""Sudden changes in `mbs.SolveDynamic`: a rod released from a wrench, a tendon cut, a sudden pull."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from robots import BACKBONE, DISKS, LENGTH, Robot, distance, scene, three

from tdcr_fe.model.disks import Disks
from tdcr_fe.native import register
from tdcr_fe.scene import TDCR
from tdcr_fe.solve.statics import SolveTDCR

register()


def settings_of(handle: TDCR, end: float, step: float):
    settings = handle.recommended_settings(end, step)
    settings.timeIntegration.verboseMode = 0
    settings.solution.file.write = False
    return settings


def released_rod(step: float, end: float, elements: int) -> np.ndarray:
    """Tip positions [m] every 10 ms of a rod that was bent by a force and a moment at its tip, shape (n, 3)."""
    backbone = replace(BACKBONE, retardation_time=1e-2)
    rod = Robot(backbone, Disks.equally_spaced(10, LENGTH, radius=1e-3), (), name="rod")
    _keep, mbs, handle = scene(rod, assemble=False, elements_per_bay=elements, gravity=(0.0, 0.0, -9.81))
    load, sensor = handle.add_load("tip", LENGTH), handle.add_sensors()["tip_position"]
    mbs.Assemble()
    load.set([0.05, 0.03, 0.0], [0.0, 2e-3, 1e-3])
    SolveTDCR(mbs)
    assert distance(handle.tip_position, [0.0, 0.0, LENGTH]) > 0.5
    load.set([0.0, 0.0, 0.0])
    settings = settings_of(handle, end, step)
    settings.solution.sensors.writePeriod = 0.01
    assert mbs.SolveDynamic(settings)
    return np.array(mbs.GetSensorStoredData(sensor))[:, 1:]


@pytest.mark.campaign
def test_a_released_rod_moves_as_with_a_finer_step_and_mesh(figure):
    """Two seconds at 1 ms: within 0.1 % of the length of half the step and twice the elements at all times."""
    coarse, fine = released_rod(1e-3, 2.0, 2), released_rod(5e-4, 2.0, 4)
    assert len(coarse) == len(fine) == 201
    figure("rod", distance(coarse, fine))


@pytest.mark.parametrize(
    ("step", "thickness"),
    [(1e-3, 0.0), (5e-3, 0.0), (5e-3, 4e-3), pytest.param(1e-3, 4e-3, marks=pytest.mark.campaign)],
)
@pytest.mark.parametrize("change", ["cut", "pull"])
def test_a_cut_tendon_and_a_sudden_pull_of_two_newton_are_solved(change, step, thickness, figure):
    """With friction and modified Newton, in a tenth of a second: not many more steps than asked for.

    In version 0.1 with Exudyn's default ``adaptInitialResidual`` the run was lost in the first step: after an iteration
    that diverges the next one counts as a solution. With tangents of the friction alone, all holes slid one way in one
    iteration and the other way in the next, and the sudden pull took 8.5 times the steps. With the geometric stiffness
    of whatever axial forces an iterate has, steps of 5 ms took 4.5 times as many, and 9 to 13 times with thick disks.
    """
    disks = replace(DISKS, thickness=thickness)
    _keep, mbs, handle = scene(three(0.3, disks=disks))
    if change == "cut":
        handle.set_tensions([2.0, 0.0, 0.0])
        SolveTDCR(mbs)
    start = handle.tip_position
    handle.set_tensions([0.0 if change == "cut" else 2.0, 0.0, 0.0])
    settings = settings_of(handle, 0.1, step)
    assert settings.timeIntegration.newton.useModifiedNewton
    assert mbs.SolveDynamic(settings)
    taken = mbs.sys["dynamicSolver"].it.currentStepIndex / round(0.1 / step)
    figure("sudden" if step < 5e-3 else "sudden long", taken)
    assert taken <= (2.0 if step < 5e-3 else 3.0)
    assert distance(handle.tip_position, start) > 0.1
    assert np.linalg.norm(handle.tip_position) < 1.001 * LENGTH

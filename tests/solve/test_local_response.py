"""Compliance, tendon Jacobians and the stiffness seen by the motors are those of small further load steps."""

from dataclasses import replace

import numpy as np
import pytest
from differences import rotation_vectors
from robots import BACKBONE, LENGTH, MODEL, simulation, three

from tdcr_fe import Disks, Load, LoadStep, Model, Robot, SolverSettings, local_response, simulate

SETTINGS = SolverSettings(tolerance=1e-12)


FIVE = Disks.equally_spaced(5, LENGTH, mass=2e-4, radius=5e-3)


FREE = Model(friction="none", elements_per_bay=1, gravity=(0.0, 1.0, -9.81))


def motion(made: Robot, model: Model, steps: list[LoadStep], further: LoadStep) -> np.ndarray:
    """Change of the tip's pose in one further step."""
    run = simulate(made, model, [*steps, replace(further, substeps=1)], SETTINGS)
    assert run.converged, run.message
    a, b = run.steps[-2], run.steps[-1]
    turn = rotation_vectors(a.rotations[-1], b.rotations[-1] - a.rotations[-1])
    return np.concatenate((b.tip - a.tip, turn))


NOTHING = {"tip": Load(LENGTH)}
BY_TENSION = [LoadStep("", {"t1": 1.0, "t2": 0.3, "t3": 0.2}, loads=NOTHING, substeps=1)]
BY_DISPLACEMENT = [LoadStep("", {"t1": 1.0, "t2": 0.4, "t3": 0.3}, loads=NOTHING, substeps=1)]
BY_DISPLACEMENT += [LoadStep("", displacements={"t1": 3.2e-3, "t2": -1.0e-3, "t3": -1.0e-3}, substeps=4)]


@pytest.mark.parametrize("steps", [BY_TENSION, BY_DISPLACEMENT], ids=["tension", "displacement"])
def test_compliance_is_the_motion_by_a_small_load(steps: list[LoadStep]) -> None:
    """Six loads; without friction, where all tendons are driven by tension or by displacement."""
    made = three(0.0, disks=FIVE, axial_stiffness=400.0)
    found = local_response(simulation(made, FREE, steps, SETTINGS)).compliance
    for k in range(6):
        size = 1e-5 if k < 3 else 1e-6
        sides = [sign * size * np.eye(6)[k] for sign in (1.0, -1.0)]
        loads = [Load(LENGTH, tuple(x[:3]), tuple(x[3:])) for x in sides]
        ends = [motion(made, FREE, steps, LoadStep("", loads={"tip": load})) for load in loads]
        expected = (ends[0] - ends[1]) / (2.0 * size)
        assert np.allclose(found[:, k], expected, rtol=1e-5, atol=1e-5 * np.abs(found[:, k]).max())
    assert np.allclose(found, found.T, rtol=1e-6, atol=1e-8 * np.abs(found).max()) or steps is BY_DISPLACEMENT


def test_compliance_of_a_cantilever() -> None:
    """A straight rod: ``L^3 / 3EI`` and shear, ``L^2 / 2EI``, ``L / EI``, ``L / GJ``, ``L / EA``; at a disk, too."""
    solved = simulation(three(0.0, disks=FIVE), MODEL, [LoadStep("", loads=NOTHING)], SETTINGS)
    b = BACKBONE
    for s, x in ((None, LENGTH), (0.1, 0.1)):
        c = local_response(solved, s).compliance
        assert c[0, 0] == pytest.approx(x**3 / (3.0 * b.EI) + x / b.GA, rel=1e-9)
        assert c[0, 4] == pytest.approx(x**2 / (2.0 * b.EI), rel=1e-9)
        assert c[1, 3] == pytest.approx(-(x**2) / (2.0 * b.EI), rel=1e-9)
        assert c[3, 3] == pytest.approx(x / b.EI, rel=1e-9)
        assert c[5, 5] == pytest.approx(x / b.GJ, rel=1e-9)
        assert c[2, 2] == pytest.approx(x / b.EA, rel=1e-9)


def test_tension_moves_the_tip_forward_with_slip_and_backward_with_sticking_holes() -> None:
    """Pulling on goes on slipping; releasing by less than presliding leaves every hole stuck."""
    made = three(0.3, disks=FIVE)
    steps = [LoadStep("", {"t1": 0.5}, loads=NOTHING, substeps=1), LoadStep("", {"t1": 1.0}, substeps=1)]
    solved = simulation(made, MODEL, steps, SETTINGS)
    further = {h: LoadStep("", {"t1": 1.0 + h}) for h in (1e-6, -1e-6)}
    forward, backward = (motion(made, MODEL, steps, step) / h for h, step in further.items())
    slipping, sticking = (local_response(solved, reversal=x).by_tension[:, 0] for x in (False, True))
    assert np.allclose(slipping, forward, rtol=1e-4, atol=1e-4 * np.abs(forward).max())
    assert np.allclose(sticking, backward, rtol=1e-3, atol=1e-3 * np.abs(backward).max())
    assert np.linalg.norm(sticking) < 0.9 * np.linalg.norm(slipping)

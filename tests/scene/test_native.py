"""A robot in Exudyn's own solvers, through the hooks: statics, dynamics, prescribed displacements, several robots."""

from __future__ import annotations

from dataclasses import replace

import exudyn as exu
import numpy as np
import pytest
from native_solvers import damped, dynamic_settings, static_settings
from robots import BACKBONE, LENGTH, distance, paper, pull, scene, solve, three

from tdcr_fe.model.disks import Disks
from tdcr_fe.model.loading import LoadStep, Model
from tdcr_fe.model.robot import Robot
from tdcr_fe.native import register
from tdcr_fe.scene.builder import CreateTDCR

register()


def there_and_back(high: float, low: float):
    """Tension over the time of the solver: to ``high`` at one half, to ``low`` at one."""
    return lambda t: [2 * t * high if t < 0.5 else high + (2 * t - 1) * (low - high)]


@pytest.mark.parametrize("friction", ["none", "per-tendon", "per-hole"])
def test_static_solver_of_exudyn_finds_the_same_tip(friction):
    """To 2.5 N, within a millionth of the length."""
    _keep, mbs, handle = scene(paper(0.3), friction=friction)
    handle.set_inputs_over_time(lambda t: [2.5 * t])
    assert mbs.SolveStatic(static_settings())
    expected = solve(paper(0.3), pull(2.5), friction=friction).steps[-1]
    assert distance(handle.tip_position, expected.tip) < 1e-6
    assert handle.tensions()["t1"] == pytest.approx(expected.tensions[0], abs=1e-6)


@pytest.mark.parametrize("friction", ["per-tendon", "per-hole"])
def test_static_solver_of_exudyn_includes_the_friction_history(friction):
    """To 1.2 N and back to 0.6 N: released holes, and the tip of the strain-space solver."""
    _keep, mbs, handle = scene(paper(0.3), friction=friction)
    handle.set_inputs_over_time(there_and_back(1.2, 0.6))
    assert mbs.SolveStatic(static_settings(50))
    expected = solve(paper(0.3), pull(1.2, 0.6), friction=friction).tips
    assert distance(handle.tip_position, expected[-1]) < 5e-4
    assert distance(handle.tip_position, solve(paper(0.3), pull(0.6), friction=friction).tips[-1]) > 0.01


def test_static_solver_with_numerical_differentiation():
    """Fewer and larger steps, at a higher cost per step."""
    _keep, mbs, handle = scene(paper(0.3))
    handle.set_inputs_over_time(lambda t: [1.0 * t])
    settings = static_settings(20)
    settings.staticSolver.newton.numericalDifferentiation.forODE2 = True
    assert mbs.SolveStatic(settings)
    assert distance(handle.tip_position, solve(paper(0.3), pull(1.0)).tips[-1]) < 5e-4


def test_static_solver_with_prescribed_displacements_of_elastic_tendons():
    """3 mm pulled in, with friction; the other tendons are slack."""
    robot = three(0.3, axial_stiffness=400.0)
    _keep, mbs, handle = scene(robot)
    handle.set_displacements([0.0, 0.0, 0.0])
    handle.set_inputs_over_time(lambda t: [3e-3 * t, -6e-3 * t, -6e-3 * t])
    assert mbs.SolveStatic(static_settings())
    step = solve(robot, [LoadStep("", displacements={"t1": 3e-3, "t2": -6e-3, "t3": -6e-3})]).steps[0]
    assert step.base_tensions[0] > 0.1
    assert distance(handle.tip_position, step.tip) < 5e-4
    assert handle.tensions()["t1"] == pytest.approx(step.tensions[0], abs=1e-3)
    assert np.all(handle.tensions()["t2"] == 0.0)
    # Of slack tendons too, what the inputs were at the end.
    assert list(handle.displacements().values()) == pytest.approx([3e-3, -6e-3, -6e-3], abs=1e-12)


def test_static_solver_with_two_robots_and_a_hook_of_the_user():
    calls = []
    keep = exu.SystemContainer()
    mbs = keep.AddSystem()
    mbs.SetPreNewtonResidualUserFunction(lambda mbs_, t, newton, discontinuous: calls.append(t))
    model = Model(friction="per-hole", elements_per_bay=1)
    a = CreateTDCR(mbs, paper(0.3), model, name="a")
    b = CreateTDCR(mbs, paper(0.3, 90.0), model, name="b", basePosition=[0.1, 0.0, 0.0])
    mbs.SetPostStepUserFunction(lambda mbs_, t: calls.append(-1) or True)
    mbs.Assemble()
    a.set_inputs_over_time(lambda t: [1.0 * t])
    b.set_inputs_over_time(lambda t: [0.5 * t])
    assert mbs.SolveStatic(static_settings())
    assert max(calls) == 1.0 and -1 in calls
    assert distance(a.tip_position, solve(paper(0.3), pull(1.0)).tips[-1]) < 1e-6
    other = solve(paper(0.3, 90.0), pull(0.5)).tips[-1]
    assert distance(b.tip_position - [0.1, 0.0, 0.0], other) < 1e-6


@pytest.mark.parametrize("friction", ["none", "per-hole"])
def test_dynamic_solver_of_exudyn_comes_to_rest_at_the_same_tip(friction):
    """A slow pull to 1 N, damped: within 0.2 % of the length."""
    _keep, mbs, handle = damped(paper(0.3), friction=friction)
    handle.set_inputs_over_time(lambda t: [0.5 * (1 - np.cos(np.pi * min(t, 1.0)))])
    assert mbs.SolveDynamic(dynamic_settings(2.0, 1e-2))
    expected = solve(paper(0.3), pull(1.0), friction=friction).tips[-1]
    assert distance(handle.tip_position, expected) < 2e-3


def test_a_slow_pull_ends_where_statics_do(figure):
    """To 1 N in four seconds, held for one, with friction and near critical damping: 1e-5 of the length."""
    _keep, mbs, handle = damped(paper(0.3))
    handle.set_inputs_over_time(lambda t: [0.5 * (1 - np.cos(np.pi * min(t / 4.0, 1.0)))])
    settings = handle.recommended_settings(5.0, 5e-3)
    settings.timeIntegration.verboseMode = 0
    settings.solution.file.write = False
    assert mbs.SolveDynamic(settings)
    figure("slow pull", distance(handle.tip_position, solve(paper(0.3), pull(1.0)).tips[-1]))


def test_dynamic_solver_of_exudyn_includes_the_friction_history():
    """To 1.5 N and back to 0.75 N; after the release the tip differs from that of a pull to the same tension."""
    _keep, mbs, handle = damped(paper(0.3))

    def tension(t):
        if t < 1.0:
            return [0.75 * (1 - np.cos(np.pi * t))]
        return [1.125 + 0.375 * np.cos(np.pi * min(t - 1.0, 1.0))]

    handle.set_inputs_over_time(tension)
    assert mbs.SolveDynamic(dynamic_settings(3.0, 1e-2))
    back, pulled = (solve(paper(0.3), s).tips[-1] for s in (pull(1.5, 0.75), pull(0.75)))
    assert distance(handle.tip_position, back) < 2e-3
    assert distance(handle.tip_position, pulled) > 0.02


def test_a_released_robot_swings_with_the_frequency_of_the_beam():
    """No tendon: first frequency of a cantilever with a tip mass, by Rayleigh's quotient with the static shape.

    ``w^2 = 3 EI / L^3 / (m_tip + 33/140 m_beam)``; W. Weaver, S. P. Timoshenko, D. H. Young, Vibration Problems in
    Engineering, sec. 1.5; good to a few thousandths.
    """

    from native_solvers import dynamic_settings

    mass = 5e-3
    robot = replace(
        Robot(BACKBONE, Disks.equally_spaced(5, LENGTH, radius=1e-3), (), name="beam"), tip_mass=mass
    )
    _keep, mbs, handle = scene(robot, assemble=False)
    load = handle.add_load("tip", LENGTH)
    sensor = handle.add_sensors()["tip_position"]
    mbs.Assemble()
    load.set([2e-3, 0.0, 0.0])
    mbs.SolveTDCR()
    load.set([0.0, 0.0, 0.0])
    w = np.sqrt(3 * BACKBONE.EI / LENGTH**3 / (mass + 33 / 140 * BACKBONE.mass_per_length * LENGTH))
    settings = dynamic_settings(2 * np.pi / w, 2 * np.pi / w / 400)
    settings.timeIntegration.generalizedAlpha.spectralRadius = 0.95
    settings.solution.sensors.writePeriod = settings.timeIntegration.endTime / 400
    assert mbs.SolveDynamic(settings)
    data = mbs.GetSensorStoredData(sensor)
    x = data[:, 1]
    zero = np.flatnonzero(x[:-1] * x[1:] < 0.0)
    cross = data[zero, 0] + (data[zero + 1, 0] - data[zero, 0]) * x[zero] / (x[zero] - x[zero + 1])
    assert cross[1] - cross[0] == pytest.approx(np.pi / w, rel=0.01)

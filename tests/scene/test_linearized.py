"""`TDCRLinearized`: against differences, against `SolveTDCR`, and against a small step in `mbs.SolveDynamic`."""

from __future__ import annotations

import numpy as np
import pytest
from native_solvers import dynamic_settings
from robots import scene, three
from scipy.linalg import eig

from tdcr_fe.model.settings import SolverSettings
from tdcr_fe.native import register
from tdcr_fe.solve.statics import SolveTDCR

register()
#: So large that nothing slips beyond it at a pull of 0.02 N [m].
PRESLIDING = 1e-3


def at_rest(drive: str, mu: float = 0.0, **rest):
    """A bent robot with a sensor at its tip."""
    keep, mbs, handle = scene(three(mu, **rest), assemble=False, presliding=PRESLIDING if mu else 1e-6)
    sensor = handle.add_sensors()["tip_position"]
    mbs.Assemble()
    if mu:
        handle.set_tensions([0.02, 0.005, 0.01])
    elif drive == "tension":
        handle.set_tensions([1.0, 0.3, 0.2])
    else:
        handle.set_displacements([4e-3, -1.5e-3, -1.9e-3])
    SolveTDCR(mbs, SolverSettings(presliding=PRESLIDING if mu else 1e-6))
    return keep, mbs, handle, sensor


@pytest.mark.parametrize(("drive", "size"), [("tension", 1e-5), ("displacement", 1e-9)])
def test_inputs_are_the_derivatives_of_the_forces(drive, size):
    """Against differences of the forces on the coordinates, elastic tendons without friction."""
    _keep, mbs, handle, _ = at_rest(drive, axial_stiffness=400.0)
    robot = handle.actuation
    q = np.array(mbs.systemData.GetODE2Coordinates())[robot.coordinates].reshape(-1)
    found, inputs = robot.forces_by_inputs(True), robot.input_values().copy()
    for k in range(3):
        sides = []
        for sign in (1.0, -1.0):
            robot.inputs = inputs + sign * size * np.eye(3)[k]
            sides.append(robot.forces_on_coordinates(q, 0.0))
        expected = (sides[0] - sides[1]) / (2.0 * size)
        assert found[:, k] == pytest.approx(expected, abs=1e-5 * np.abs(found).max())


@pytest.mark.parametrize("drive", ["tension", "displacement"])
def test_the_static_gain_is_what_statics_give(drive):
    """Change of the tip by a small change of each input, elastic tendons without friction: 1e-4 of the largest."""
    _keep, mbs, handle, sensor = at_rest(drive, axial_stiffness=400.0)
    gain = mbs.TDCRLinearized(sensors=[sensor]).static_gain()
    inputs = handle.actuation.input_values().copy()
    start, size = handle.tip_position, 1e-3 if drive == "tension" else 1e-6
    change = handle.set_tensions if drive == "tension" else handle.set_displacements
    for k in range(3):
        sides = []
        for sign in (1.0, -1.0):
            change((inputs + sign * size * np.eye(3)[k]).tolist())
            SolveTDCR(mbs)
            sides.append(handle.tip_position)
        expected = (sides[0] - sides[1]) / (2.0 * size)
        assert gain[:, k] == pytest.approx(expected, abs=1e-4 * np.abs(expected).max())
    assert start.shape == (3,)


@pytest.mark.parametrize(
    ("drive", "mu", "size"), [("displacement", 0.0, 1e-6), ("tension", 0.0, 1e-3), ("tension", 0.3, 1e-5)]
)
def test_a_small_step_of_an_input_swings_as_in_dynamics(drive, mu, size):
    """The first tendon, 0.2 s at 1 ms; the linear system by the trapezoidal rule at the same step.

    With friction all holes are within their presliding.
    """
    elastic = {"axial_stiffness": 400.0} if drive == "displacement" else {}
    keep, mbs, handle, sensor = at_rest(drive, mu, **elastic)
    linear = mbs.TDCRLinearized(sensors=[sensor])
    step, count = 1e-3, 200
    u = np.array([size, 0.0, 0.0])
    x, v = np.zeros(len(linear.mass)), np.zeros(len(linear.mass))
    a = np.linalg.solve(linear.mass, linear.inputs @ u)
    left = linear.mass + 0.25 * step**2 * linear.stiffness
    swing = [np.zeros(3)]
    for _ in range(count):
        ahead = x + step * v + 0.25 * step**2 * a
        new = np.linalg.solve(left, linear.inputs @ u - linear.stiffness @ ahead)
        x, v, a = ahead + 0.25 * step**2 * new, v + 0.5 * step * (a + new), new
        swing.append(linear.outputs @ x)
    start = handle.tip_position
    inputs = handle.actuation.input_values().copy()
    handle.set_inputs_over_time(lambda t: inputs + u)
    settings = dynamic_settings(count * step, step)
    settings.timeIntegration.generalizedAlpha.spectralRadius = 1.0
    settings.timeIntegration.newton.absoluteTolerance = 1e-9
    settings.solution.sensors.writePeriod = step
    assert mbs.SolveDynamic(settings)
    moved = mbs.GetSensorStoredData(sensor)[:, 1:] - start
    expected = np.array(swing)[: len(moved)]
    assert np.abs(moved - expected).max() < 0.02 * np.abs(expected).max()
    assert keep


def test_modes_and_state_space_agree():
    """Eigenvalues of the first-order system are the frequencies of `TDCREigenvalues`; a mode is shown and hidden."""
    _keep, mbs, handle, sensor = at_rest("tension", 0.3)
    linear = mbs.TDCRLinearized(sensors=[sensor])
    modes = mbs.TDCREigenvalues(numberOfEigenvalues=2)
    squared = eig(linear.stiffness, linear.mass, right=False)
    lowest = np.sqrt(np.sort(np.abs(squared))[:2]) / (2.0 * np.pi)
    assert lowest == pytest.approx(modes.frequencies, rel=1e-6)
    a, b, c = linear.state_space()
    assert a.shape == (2 * len(linear.mass),) * 2 and b.shape[1] == 3 and c.shape[0] == 3
    assert linear.input_names == ("three.t1", "three.t2", "three.t3")
    before = handle.tip_position
    modes.show(mbs, 0, 0.01)
    assert np.linalg.norm(handle.tip_position - before) > 1e-3
    modes.hide(mbs, 0, 0.01)
    assert handle.tip_position == pytest.approx(before, abs=1e-15)
    with pytest.raises(ValueError, match="must be 'stuck' or 'sliding'"):
        mbs.TDCRLinearized(holes="free")

"""Motors, damping by the material, and the energy of robots, in Exudyn's dynamics."""

import exudyn as exu
import exudyn.itemInterface as eii
import numpy as np
import pytest
from robots import LENGTH, routed, seven
from scenes import recommended, scene, scene_with, solve_scene, tip_load

from tdcr_fe import ParallelRouting
from tdcr_fe.elements.material import NonlinearSection, SuperelasticSection
from tdcr_fe.elements.poses import euler_rate_matrix
from tdcr_fe.scene.energy import ENERGY_COLUMNS

EA, INERTIA, RADIUS, TORQUE = 400.0, 1e-4, 0.01, 1e-3


def test_a_motor_swings_on_its_elastic_tendon_as_a_single_oscillator():
    """A straight, stiff backbone: ``omega = r sqrt(EA / (L J))``, 6.37 Hz, about the angle where tension is torque."""
    robot = routed(ParallelRouting(1e-4), disks=4, axial_stiffness=EA).with_backbone(radius=4e-3)
    _keep, mbs, handle = scene(robot, assemble=False, friction="none")
    motor = handle.add_motor("t1", INERTIA, RADIUS)
    marker = mbs.AddMarker(eii.MarkerNodeCoordinate(nodeNumber=motor, coordinate=0))
    load = mbs.AddLoad(eii.LoadCoordinate(markerNumber=marker, load=TORQUE))
    kind = exu.OutputVariableType.Coordinates
    angle = mbs.AddSensor(eii.SensorNode(nodeNumber=motor, outputVariableType=kind, storeInternal=True))
    mbs.Assemble()
    assert mbs.GetLoadParameter(load, "load") == TORQUE
    settings = recommended(handle, 0.4, 1e-3)
    settings.solution.sensors.writePeriod = 1e-3
    mbs.SolveDynamic(settings)
    time, moved = np.array(mbs.GetSensorStoredData(angle)).T
    rest = TORQUE / (RADIUS**2 * EA / LENGTH)
    omega = RADIUS * np.sqrt(EA / (LENGTH * INERTIA))
    assert np.abs(moved - rest * (1.0 - np.cos(omega * time))).max() < 0.005 * rest
    assert handle.tensions()["t1"][0] == pytest.approx(moved[-1] * RADIUS * EA / LENGTH, rel=5e-3)


def test_a_motor_winds_what_it_turns_whatever_tensions_are_set():
    """One set before was taken for metres; where another tendon was set, the motor had wound twice as much."""
    _keep, mbs, handle = scene(seven(0.0), assemble=False)
    handle.set_tensions([1.0, 0.0, 0.0])
    handle.add_motor("t1", INERTIA, RADIUS)
    mbs.Assemble()
    assert handle.actuation.input_values() == pytest.approx([0.0, 0.0, 0.0], abs=0.0)
    mbs.systemData.SetODE2Coordinates([*np.zeros(mbs.systemData.ODE2Size() - 1), 0.3])
    handle.set_tensions({"t2": 0.5})
    assert handle.actuation.input_values() == pytest.approx([0.3 * RADIUS, 0.5, 0.0], abs=0.0)


# ------------------------------------------------------------ material damping


def test_a_rigid_motion_of_a_bent_robot_is_not_damped():
    """Translation and rotation of the whole robot, against a bending of its last element at the same rates."""
    _keep, mbs, handle = scene(seven(0.0).with_backbone(retardation_time=1e-2), elements_per_bay=2)
    solve_scene(mbs, handle, [1.5, 0.2, 0.0])
    positions, rotations, parameters = handle.actuation.scene_poses()
    spin, speed = np.array([3.0, -2.0, 5.0]), np.array([0.3, 0.1, -0.2])
    own_spin = (rotations.swapaxes(1, 2) @ spin[:, None])[:, :, 0]
    velocity = np.zeros((len(positions), 7))
    velocity[:, :3] = speed + np.cross(spin, positions)
    velocity[:, 3:] = (euler_rate_matrix(parameters) @ own_spin[:, :, None])[:, :, 0]
    bending = velocity.copy()
    bending[:-1] = 0.0
    rigid, bent = (wrenches(mbs, handle, v) for v in (velocity, bending))
    assert np.abs(rigid).max() < 1e-3 * np.abs(bent).max()


def wrenches(mbs, handle, velocity):
    """Wrenches of the dampers at velocities of the coordinates, in their middle [N, N m], shape (E, 6)."""
    mbs.systemData.SetODE2Coordinates_t(velocity.ravel())
    kinds = exu.OutputVariableType.ForceLocal, exu.OutputVariableType.TorqueLocal
    found = [[mbs.GetObjectOutput(i, kind) for kind in kinds] for i in handle.damping.dampers]
    return np.array(found).reshape(-1, 6)


# ------------------------------------------------------------ energy sensor


def load_and_sensor(mbs, handle):
    """A load at the tip, and the sensor."""
    return tip_load(mbs, handle), handle.add_energy_sensor()


# ---------------------------------------------------------------- what is stored


CURVED = np.array([[0.0, 1.0, 2.0], [0.0, 0.0, -1.0]])
FIBRES = NonlinearSection(*np.array([[4e4], [2e-3], [4e-4], [-3.0], [20.0]]).repeat(2, 1), CURVED)
SOFTENING = SuperelasticSection(np.array([2e-3, 3e-3]), np.array([5.0, 4.0]), 0.3, CURVED)


@pytest.mark.parametrize("law", [FIBRES, SOFTENING], ids=["fibres", "softening"])
def test_the_force_of_a_section_is_the_derivative_of_its_energy_and_its_stiffness_that_of_the_force(law):
    """By central differences, about random twists of a precurved section; at rest the energy is zero."""
    rng = np.random.default_rng(3)
    lengths = np.array([0.02, 0.03])
    unloaded = np.zeros((2, 6))
    unloaded[:, 0], unloaded[:, 3:] = lengths, lengths[:, None] * CURVED
    assert law.energy(unloaded, lengths) == pytest.approx(0.0, abs=1e-12)
    twists = unloaded + rng.uniform(-1.0, 1.0, (2, 6)) * [1e-4, 1e-4, 1e-4, 0.1, 0.3, 0.3]
    expected, steps = law.gradient(twists, lengths), 1e-7 * np.eye(12).reshape(12, 2, 6)
    found = [law.energy(twists + x, lengths) - law.energy(twists - x, lengths) for x in steps]
    found = np.reshape(found, (2, 6)) / 2e-7
    assert found == pytest.approx(expected, rel=1e-4, abs=1e-5 * np.abs(expected).max())
    assert np.abs(expected).max() > 1e-6
    n, bend = law.strain(twists, lengths)
    for k, h in enumerate(np.diag([1e-6, 1e-4, 1e-4])):
        change = law.wrench(n + h[0], bend + h[1:]) - law.wrench(n - h[0], bend - h[1:])
        slope = law.stiffness(n, bend)[..., k]
        np.testing.assert_allclose(slope, change / (2.0 * h[k]), rtol=1e-5, atol=1e-9)


# ---------------------------------------------------------------- what goes in and out


def random_run(seed: int, end: float, elements: int | str = 1) -> dict[str, np.ndarray]:
    """Columns of the sensor of a random robot under random tensions and a force at the tip, up to a time [s]."""
    rng = np.random.default_rng(seed)
    count, mu = int(rng.integers(1, 4)), float(rng.choice([0.0, rng.uniform(0.05, 0.4)]))
    elastic = {} if rng.random() < 0.6 else {"axial_stiffness": float(rng.uniform(300.0, 3000.0))}
    routings = [ParallelRouting(4.5e-3, angle) for angle in rng.uniform(0.0, 360.0, count)]
    retardation = float(rng.choice([0.0, 10 ** rng.uniform(-4.0, -2.3)]))
    robot = routed(*routings, disks=int(rng.integers(6, 14)), mu=mu, **elastic)
    robot = robot.with_backbone(retardation_time=retardation)
    gravity = tuple((9.81 * rng.uniform(-1.0, 1.0, 3) * (rng.random() < 0.6)).tolist())
    model = {"gravity": gravity, "elements_per_bay": elements}
    _keep, mbs, handle, (load, sensor) = scene_with(load_and_sensor, robot, **model)
    load.set(rng.uniform(-0.02, 0.02, 3))
    high, rates, phases = (rng.uniform(*limits, count) for limits in ((0.3, 2.0), (0.5, 4.0), (0.0, 6.0)))
    rise = rng.uniform(0.05, 0.3)

    def tensions(t):
        share = 0.5 * (1.0 - np.cos(np.pi * min(t / rise, 1.0)))
        return share * high * (1.0 + 0.5 * np.sin(2.0 * np.pi * rates * t + phases))

    handle.set_inputs_over_time(tensions)
    settings = recommended(handle, end, 1e-3)
    settings.timeIntegration.generalizedAlpha.spectralRadius = 1.0
    settings.solution.sensors.writePeriod = 1e-3
    assert mbs.SolveDynamic(settings)
    return dict(zip(("time", *ENERGY_COLUMNS), np.array(mbs.GetSensorStoredData(sensor)).T, strict=True))


def check(found: dict[str, np.ndarray], tolerance: float) -> None:
    """Works less dissipations are what the stored energy grows, but for this part of all works; dissipations grow."""
    work = sum(np.abs(np.diff(found[k])).sum() for k in ("tendon_work", "load_work"))
    assert work > 1e-4
    for kind in ("friction_dissipation", "material_dissipation"):
        assert np.diff(found[kind]).min() > -1e-3 * work
        assert found[kind][-1] >= 0.0
    stored = sum(found[k] for k in ("kinetic", "elastic", "gravity"))
    lost = found["friction_dissipation"] + found["material_dissipation"]
    rest = found["tendon_work"] + found["load_work"] - lost - (stored - stored[0])
    assert np.abs(rest).max() < tolerance * work


def test_the_energy_of_a_random_motion_is_balanced():
    """At all times of a tenth of a second; the rest is the error of the integration in time."""
    check(random_run(2, 0.1), 1e-4)


@pytest.mark.campaign
@pytest.mark.parametrize("seed", range(20))
def test_the_energy_of_random_motions_is_conserved_for_half_a_second(seed):
    """Random robots of 1 to 3 tendons with friction, elasticity, gravity, damping by the material: 1e-4 of the work.

    In steps of 1 ms, on the default mesh; the error of the integration in time is counted as well.
    """
    check(random_run(seed, 0.5, elements="auto"), 2e-4)


def test_loads_and_weight_that_the_static_solver_ramps_do_the_work_of_the_ramp():
    """``mbs.SolveStatic`` multiplies them by a factor from 0 to 1: a load does half its final value times the way.

    A slack tendon driven by displacement does nothing; beside others it brought a warning of a division by zero.
    """
    _keep, mbs, handle, (load, sensor) = scene_with(load_and_sensor, seven(0.0), gravity=(0.5, 0.0, 0.0))
    handle.set_displacements({"t1": 0.0})
    load.set([2e-3, 0.0, 0.0])
    assert mbs.SolveStatic(recommended(handle, 1.0, 0.05))
    found = dict(zip(ENERGY_COLUMNS, mbs.GetSensorValues(sensor), strict=True))
    away = handle.tip_position[0]
    # The ramp holds back half of the work of the weight.
    assert found["load_work"] - 0.5 * found["gravity"] == pytest.approx(0.5 * 2e-3 * away, rel=1e-3)
    assert found["elastic"] == pytest.approx(found["load_work"] - found["gravity"], rel=1e-3)

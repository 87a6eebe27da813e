"""Estimation frame by frame: calibrated, through friction, at unknown places, without readings, and past failures."""

from argparse import Namespace
from dataclasses import replace
from functools import partial
from unittest.mock import patch

import numpy as np
import pytest
from robots import routed
from rod import Truth
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

import tdcr_fe as tdcr
from tdcr_fe.estimate.frame import Frame
from tdcr_fe.estimate.most_probable import posterior_covariance
from tdcr_fe.validation.campaigns.estimate import LENGTH, RATE, model, read, readings_of, rod, run, squared


def estimator(*, robot=None, friction=0.0, load=None, inputs=None, **rest):
    priors = load or tdcr.LoadPrior(sigma=0.05), inputs or tdcr.InputPrior(sigma=0.01)
    return tdcr.Estimator(robot or rod(friction), model(friction), *priors, **rest)


def followed(own, truth, readings, seed=4):
    """Frames of a whole run, with the errors of their forces and what these are by their covariances."""
    rng = np.random.default_rng(seed)
    frames = [own.step(truth.command(k), readings(rng, k)) for k in range(len(truth.nodes))]
    errors = np.array([f.force for f in frames]) - truth.forces
    return frames, errors, squared(errors, np.array([f.force_covariance for f in frames]))


def test_where_the_robot_is_nearly_linear_the_covariance_is_that_of_the_errors():
    """Prior and noise of a fiftieth of the test problem's; errors correlated over 0.1 s, so that the mean tells."""
    scale, memory = 0.02, 0.1
    truth = Truth(160, 3, scale=scale, memory=memory)
    load = tdcr.LoadPrior(sigma=0.05 * scale, correlation_time=memory)
    own = estimator(load=load, inputs=tdcr.InputPrior(sigma=0.01 * scale, correlation_time=memory))
    frames, errors, force = followed(own, truth, lambda *at: truth.positions(*at, sigma=2e-6))
    off = np.array([f.tensions for f in frames]) - truth.tensions
    tensions = squared(off, np.array([f.tension_covariance for f in frames]))
    assert 2.4 < force.mean() < 3.6
    assert 0.9 < np.mean(force < chi2.ppf(0.95, 3)) <= 1.0
    assert 3.2 < tensions.mean() < 4.8
    assert np.sqrt(np.mean(errors**2)) < 0.4 * 0.05 * scale


def test_forces_along_the_rod_are_not_biased_towards_compression_which_makes_it_compliant():
    """Tensions are known to 0.1 N. The least misfit alone has a mean error of -73 mN and 16.6 in place of 3."""
    truth, own = Truth(60, 2, tension_sigma=0.1), estimator(inputs=tdcr.InputPrior(sigma=0.1))
    frames, errors, force = followed(own, truth, truth.positions)
    along = np.array([f.result.rotations[-1][:, 2] for f in frames])
    assert abs(np.mean(np.sum(errors * along, axis=1)[5:])) < 0.02
    assert force[5:].mean() < 5.0


def test_with_friction_in_the_model_the_force_is_found_and_without_it_is_not():
    friction = 0.2
    truth, errors, inside = Truth(40, 1, friction=friction), {}, {}
    for modelled in (friction, 0.0):
        frames, found, force = followed(estimator(friction=modelled), truth, truth.positions)
        errors[modelled] = np.sqrt(np.mean(found**2))
        inside[modelled] = np.mean(force < chi2.ppf(0.95, 3))
        assert not any(f.message for f in frames)
        if modelled:
            assert np.abs(np.array([f.result.positions for f in frames]) - truth.nodes).max() < 5e-3 * LENGTH
    assert errors[friction] < 0.7 * errors[0.0]
    assert inside[friction] > 0.9 > 0.5 > inside[0.0]


@pytest.mark.parametrize("kind", ["curvatures", "angle", "camera"])
def test_readings_that_tell_little_do_not_make_it_too_certain(kind):
    """Curvatures show single holes slip: where each only sticks or only slips, it is 7 with seed 2, and with 3 a frame
    is not solved. An angle, or one camera, shows a force across to second order only: it was 17 and 54,000.
    """
    squares = []
    for seed in (1, 2, 3):
        truth = Truth(25, seed, friction=0.2)
        frames, _, found = followed(estimator(friction=0.2), truth, partial(truth.read_as, kind), 1000 + seed)
        assert not any(f.message for f in frames)
        squares.extend(found[5:])
    assert kind == "camera" or np.mean(squares) < 4.5  # a camera may mistake the side
    assert np.mean(np.array(squares) < chi2.ppf(0.95, 3)) > 0.8


def test_a_moment_at_the_tip_is_found_where_it_is_asked_for():
    """Five millinewton metres about y, without a force; three markers are read."""
    robot, moment = rod(), (0.0, 5e-3, 0.0)
    step = tdcr.LoadStep(tensions=dict.fromkeys(robot.tendon_names, 0.5), time=0.0)
    acting = tdcr.LoadStep(step.label, step.tensions, loads={"m": tdcr.Load(LENGTH, moment=moment)}, time=0.0)
    (solved,) = tdcr.simulate(robot, model(), [acting]).steps
    own = estimator(load=tdcr.LoadPrior("tip", 0.05, sigma_moment=0.01), inputs=tdcr.InputPrior(sigma=1e-3))
    found = own.step(step, readings_of("markers", solved, robot.tendon_names, np.random.default_rng(0)))
    sigmas = np.sqrt(np.diagonal(found.moment_covariance))
    assert sigmas[1] < 2e-3
    assert np.all(np.abs(found.moment - moment) < 3.0 * sigmas)


def test_neither_the_order_of_the_readings_nor_the_direction_of_the_x_axis_changes_a_force():
    """Through the signs of eigenvectors forces were off by 0.9 standard deviations, and by 4 with curvatures."""
    truth, found = Truth(6, 1, friction=0.2), []
    for orders, turn in (([0, 1, 2],), 0.0), (([1, 2, 0], [2, 0, 1]), 0.0), (([0, 1, 2],), 37.0):
        turned, robot = Rotation.from_euler("z", turn, degrees=True).as_matrix(), rod(0.2)
        for t in robot.tendons:
            routing = replace(t.routing, angle_deg=t.routing.angle_deg + turn)
            robot = robot.with_tendons([t.name], routing=routing)
        own = estimator(robot=robot, friction=0.2)
        rng, forces = np.random.default_rng(4), []
        for k in range(6):
            readings = truth.positions(rng, k)
            values = turned @ [r.value for r in readings]
            readings = [replace(r, value=x) for r, x in zip(readings, values, strict=True)]
            force = own.step(truth.command(k), [readings[i] for i in orders[k % len(orders)]]).force
            forces.append(turned.T @ force)
        found.append(forces)
    for other in found[1:]:
        np.testing.assert_allclose(other, found[0], atol=1e-6)


def test_noise_of_the_inputs_does_not_let_holes_reverse():
    """Tendons are pulled steadily, their tensions read with noise larger than their steps: holes keep being pulled."""
    rng, names = np.random.default_rng(2), rod().tendon_names
    own = estimator(friction=0.2, load=tdcr.LoadPrior(sigma=1e-4), inputs=tdcr.InputPrior(0.01, 0.0))
    pulls, wrong = np.full((50, 4), 0.1), []
    pulls[:, 0] = 0.3 + 0.004 * np.arange(50)
    named = (dict(zip(names, p.tolist(), strict=True)) for p in pulls)
    steps = [tdcr.LoadStep(tensions=x, time=k / RATE) for k, x in enumerate(named)]
    for step, tip in zip(steps, tdcr.simulate(rod(0.2), model(0.2), steps).tips, strict=True):
        noisy = {name: x + 0.01 * rng.standard_normal() for name, x in step.tensions.items()}
        frame = own.step(replace(step, tensions=noisy), read(rng, tip))
        wrong.append(np.mean(np.array(frame.result.hole_states[0][:-1]) == "release"))
    assert np.mean(wrong[5:]) < 0.05


@pytest.mark.parametrize(
    ("prior", "kept", "added"),
    [({"correlation_time": 0.5}, np.exp(-1.0), 1.0 - np.exp(-2.0)), ({"random_walk": 2.0}, 1.0, 0.5 * 2.0**2)],
)  # fmt: skip
def test_half_a_second_without_readings_forgets_the_force_or_keeps_it_and_spreads(prior, kept, added):
    truth = Truth(1, 5)
    own = estimator(load=tdcr.LoadPrior(sigma=0.05, **prior))
    first = own.step(truth.command(0), truth.positions(np.random.default_rng(1), 0))
    later = own.step(tdcr.LoadStep(time=0.5))
    np.testing.assert_allclose(later.force, kept * first.force, rtol=1e-12)
    expected = kept**2 * first.force_covariance + added * 0.05**2 * np.eye(3)
    # The first counts its tendons as likely taut.
    np.testing.assert_allclose(later.force_covariance, expected, rtol=1e-6)


def test_a_step_keeps_the_drives_that_it_does_not_name():
    """Tension, displacement and motor, each of another tendon; the second step names the tension alone."""
    robot, exact = rod().with_tendons(spool=tdcr.Spool(0.01)), tdcr.SolverSettings(tolerance=1e-6)
    own = estimator(robot=robot, inputs=tdcr.InputPrior(sigma=1e-5), settings=exact)
    names = robot.tendon_names
    inputs = {"tensions": {names[0]: 0.1, names[3]: 0.2}, "displacements": {names[1]: 1e-3}}
    own.step(tdcr.LoadStep(**inputs, motor_angles={names[2]: 0.1}, time=0.0))
    kept = {"displacements": {names[1]: 1e-3}, "motor_angles": {names[2]: 0.1}}
    for time, changed in enumerate(({"tensions": {names[0]: 1.0}}, {"displacements": {names[0]: 4e-3}}), 1):
        frame = own.step(tdcr.LoadStep(**changed, time=time))
        step = {n: {**kept.get(n, {}), **changed.get(n, {})} for n in (*kept, "tensions")}
        step["tensions"][names[3]] = 0.2
        whole = tdcr.simulate(robot, model(), [tdcr.LoadStep(**step)]).steps[-1]
        np.testing.assert_allclose(frame.result.base_tensions, whole.base_tensions, atol=1e-6)
        np.testing.assert_allclose(frame.tip, whole.tip, atol=1e-7)


def test_an_error_of_a_tension_is_none_of_the_displacement_that_is_given_next():
    """An error of 15 mN became one of 15 mm: the tendon was pulled to 2.7 N."""
    own = estimator(inputs=tdcr.InputPrior(sigma=1e-4))
    names, cell = own.robot.tendon_names, tdcr.Reading(1, "base_tension", "t0", 0.5001, 1e-5)
    held = own.step(tdcr.LoadStep(tensions=dict.fromkeys(names, 0.5), time=0.0), [cell])
    j = names.index("t0")
    assert held.input_errors[j] == pytest.approx(1e-4, rel=0.02)
    wound = own.step(tdcr.LoadStep(displacements={"t0": held.result.displacements[j]}, time=0.01))
    assert wound.input_errors[j] == 0.0
    np.testing.assert_allclose(wound.tensions, held.tensions, atol=1e-4)


def test_what_is_refused_leaves_the_estimator_as_it_was():
    """After one NaN of a sensor, or a load that was not named, all frames were lost."""
    own, other = estimator(), estimator()
    refused = (
        (("position_x", LENGTH, float("nan"), 1e-4), {}),
        (("position_x", LENGTH, 0.0, 0.0), {}),
        (("position_x", "helix", 0.0, 1e-4), {}),
        (("base_tension", LENGTH, 0.3, 1e-2), {}),
        (("position_x", LENGTH, 0.0, 1e-4), {"push": tdcr.Load(LENGTH, (0.01, 0.0, 0.0))}),
    )
    for number, (reading, loads) in enumerate(refused, 1):
        with pytest.raises(ValueError, match=f"step {number}"):
            own.step(tdcr.LoadStep(time=0.0, loads=loads), [tdcr.Reading(1, *reading)])
    good = [tdcr.Reading(1, "position_x", LENGTH, 1e-3, 1e-4)]
    frames = [e.step(tdcr.LoadStep(time=0.0), good) for e in (own, other)]
    assert frames[0].message == "" and np.array_equal(frames[0].force, frames[1].force)


def test_the_force_acts_also_where_round_off_moves_the_node_that_carries_it():
    """Without a word it did not act where a node was an ulp from its arc length, and no frame met its readings."""
    length = 0.20697354820650066  # the last of twelve disks is at 0.20697354820650063
    robot = tdcr.Robot(replace(rod().backbone, length=length), tdcr.Disks.equally_spaced(12, length))
    step = tdcr.LoadStep(loads={"push": tdcr.Load(length, (0.05, 0.0, 0.0))}, time=0.0)
    tip = tdcr.simulate(robot, model(), [step]).steps[-1].tip
    readings = read(np.random.default_rng(1), tip, length, 1e-5)
    frame = estimator(robot=robot).step(tdcr.LoadStep(time=0.0), readings)
    np.testing.assert_allclose(frame.force[:2], [0.05, 0.0], atol=2e-3)


@pytest.mark.parametrize("place", [3, 6, 8])
def test_the_place_of_a_force_is_found_where_markers_show_it(place):
    """A force at a disk; nine markers and tensions known well."""
    at = (place + 1) * LENGTH / 9.0
    truth, rng = Truth(4, 2, at=at, force=(0.02, 0.08, -0.03)), np.random.default_rng(3)
    own = estimator(load=tdcr.LoadPrior(at="unknown", sigma=0.1), inputs=tdcr.InputPrior(sigma=0.002))
    for k in range(4):
        frame = own.step(truth.drawn.step(truth.tensions, k), truth.positions(rng, k, truth.s[1:]))
    assert not frame.message
    assert abs(frame.at - at) < 0.05 * LENGTH
    assert abs(frame.at - at) < 4.0 * frame.sigma_at


@pytest.mark.parametrize("at", ["tip", "unknown"])
def test_a_frame_that_has_no_solution_near_the_last_one_begins_once_more(at, monkeypatch):
    """Where the place was unknown it did not; one after 0.5 s with tendons that are wound was lost."""
    truth, rng = Truth(2, 5, scale=0.2), np.random.default_rng(1)
    own = estimator(load=tdcr.LoadPrior(at, sigma=0.05))
    markers = LENGTH / 3.0 * np.arange(1, 4)
    own.step(truth.command(0), truth.positions(rng, 0, markers))
    solved = Frame.solved

    def not_from_the_last(self, unknowns, near=None):
        of_the_last = near is not None and near.frame.start is not self.start
        return None if of_the_last else solved(self, unknowns, near)

    monkeypatch.setattr(Frame, "solved", not_from_the_last)
    frame = own.step(truth.command(1), truth.positions(rng, 1, markers))
    assert not frame.message and frame.misfit < 40.0
    assert np.linalg.norm(frame.tip - truth.nodes[1, -1]) < 5e-4


def test_a_frame_without_solution_keeps_the_state_and_the_run_goes_on():
    truth = Truth(3, 5, scale=0.2)
    rng, own = np.random.default_rng(1), estimator()
    first = own.step(truth.command(0), truth.positions(rng, 0))
    failure = tdcr.StepFailed("no", 0.0, 1.0, own.simulation.state, 1)
    with patch.object(own.simulation, "advance", side_effect=failure):
        second = own.step(truth.command(1), truth.positions(rng, 1))
    assert second.message and not second.result.converged
    np.testing.assert_array_equal(second.tip, first.tip)
    assert np.all(second.sigma_tip > first.sigma_tip)
    third = own.step(truth.command(2), truth.positions(rng, 2))
    assert not third.message
    assert np.linalg.norm(third.tip - truth.nodes[2, -1]) < 5e-4


def test_a_frame_whose_readings_are_not_met_has_the_state_without_them():
    """It had the state before, with its covariance, and a robot that moved on was lost."""
    truth = Truth(1, 5)
    wrong = [replace(r, value=-2.0 * r.value) for r in truth.positions(np.random.default_rng(1), 0)]
    frame, without = (estimator().step(truth.command(0), readings) for readings in (wrong, []))
    assert "readings are not met" in frame.message and not frame.result.converged
    np.testing.assert_array_equal(frame.tip, without.tip)
    np.testing.assert_array_equal(frame.position_covariance, without.position_covariance)


def test_a_known_load_acts_besides():
    """The estimated force is what the known one does not explain."""
    load = {"weight": tdcr.Load(at=0.5 * LENGTH, force=(0.03, 0.0, 0.0))}
    steps = [tdcr.LoadStep(tensions=dict.fromkeys(rod().tendon_names, 0.5), loads=load, time=0.0)]
    tip = tdcr.simulate(rod(), model(), steps).steps[-1].positions[-1]
    readings = read(np.random.default_rng(1), tip, sigma=1e-5)
    for known in (steps, []):
        own = estimator(load=tdcr.LoadPrior(), inputs=tdcr.InputPrior(sigma=1e-4), steps=known)
        found = own.step(steps[0] if known else tdcr.LoadStep(tensions=steps[0].tensions, time=0.0), readings)
        distance = np.abs(found.force) / np.sqrt(np.diagonal(found.force_covariance))
        assert distance.max() < 3.0 if known else distance[0] > 10.0


def test_tendons_become_slack_and_the_robot_straight_while_its_bending_angle_is_read():
    """The angle has a kink where the robot is straight: slopes of the volume from there led astray for good."""
    routings = (tdcr.ParallelRouting(5e-3, 120.0 * k) for k in range(3))
    robot = routed(*routings, disks=10, mu=0.2).with_backbone(radius=0.45e-3, youngs_modulus=75e9)
    pulls = [(t, j) for j in range(3) for t in (0.5, 1.0, 1.6, 1.0, 0.5, 0.0, 0.0, 0.0)]
    steps = []
    for k, (t, j) in enumerate(pulls):
        load = tdcr.Load(LENGTH, (0.008, -0.014, 0.0) if k % 8 == 6 else (0.0, 0.0, 0.0))
        tensions = {n: t * (i == j) for i, n in enumerate(robot.tendon_names)}
        steps.append(tdcr.LoadStep(tensions=tensions, loads={"known": load}, time=0.5 * k))
    truth = tdcr.simulate(robot, tdcr.Model(elements_per_bay=1), steps).steps
    rng, prior = np.random.default_rng(3), (tdcr.LoadPrior(sigma=0.05), tdcr.InputPrior(sigma=0.05))
    own = tdcr.Estimator(robot, tdcr.Model(elements_per_bay=1), *prior, steps=steps)
    frames = []
    for step, solved in zip(steps, truth, strict=True):
        angle = solved.bending_angle + 2e-3 * rng.standard_normal()
        readings = [r for n in (2, 4, 6, 8, 10) for r in read(rng, solved.positions[n], 0.025 * n)]
        frames.append(own.step(step, [*readings, tdcr.Reading(0, "bending_angle", None, angle, 2e-3)]))
    assert not [f.message for f in frames if f.message]
    misfits = [f.misfit for f in frames]
    assert max(misfits) < 60.0 and np.median(misfits) < 20.0  # of 16 readings
    of_force = squared(np.array([f.force for f in frames]), np.array([f.force_covariance for f in frames]))
    assert np.median(of_force) < 3.0


def of_two(stiffness, angle):
    """The rod with two elastic tendons, the second one at an angle [deg] from the first."""
    routings = {"a": tdcr.ParallelRouting(0.01), "b": tdcr.ParallelRouting(0.01, angle)}
    tendons = (tdcr.Tendon(n, r, axial_stiffness=stiffness) for n, r in routings.items())
    return replace(rod(), tendons=tuple(tendons))


@pytest.mark.parametrize(("kind", "mean", "sigma"), [("tensions", 0.0, 0.01), ("displacements", -2e-5, 2e-5)])
def test_the_tension_of_a_tendon_that_may_be_slack_is_a_normal_one_cut_off_at_zero(kind, mean, sigma):
    """It was known exactly where the tendon was wound, and by 15 % too well where its tension was given."""
    robot = of_two(500.0, 90.0)

    def step(value, **rest):
        named = {"tensions": {"b": 0.3}}
        named[kind] = named.get(kind, {}) | {"a": value}
        return tdcr.LoadStep(**named, **rest)

    prior = {"load": tdcr.LoadPrior(sigma=1e-6), "inputs": tdcr.InputPrior(sigma={"a": sigma, "b": 1e-6})}
    frame = estimator(robot=robot, **prior).step(step(mean, time=0.0))
    z = np.linspace(-6.0, 6.0, 121)
    steps = [step(max(x, 0.0) if kind == "tensions" else x) for x in mean + sigma * z]
    tensions = [solved.base_tensions[0] for solved in tdcr.simulate(robot, model(), steps).steps]
    expected = np.sqrt(np.cov(tensions, aweights=np.exp(-0.5 * z**2), ddof=0))
    assert min(tensions) == 0.0 < expected
    assert abs(frame.sigma_tensions[0] - expected) < 0.02 * expected


def test_a_load_cell_shows_that_a_wound_tendon_taken_to_be_slack_is_taut():
    """Without a slope at zero tension the state stayed slack, far from the reading, and was taken."""
    robot = of_two(1000.0, 120.0)
    acting = tdcr.LoadStep(displacements={"a": 2e-3, "b": -0.2e-3})
    tensions = tdcr.simulate(robot, model(), [acting]).steps[-1].base_tensions
    inputs = tdcr.InputPrior(sigma={"a": 1e-5, "b": 7e-4})
    own = estimator(robot=robot, load=tdcr.LoadPrior(sigma=1e-3), inputs=inputs)
    read_tensions = zip("ab", tensions.tolist(), strict=True)
    readings = [tdcr.Reading(0, "base_tension", n, x, 0.01) for n, x in read_tensions]
    frame = own.step(tdcr.LoadStep(displacements={"a": 2e-3, "b": -1.6e-3}, time=0.0), readings)
    assert tensions[1] > 0.1 and frame.misfit < 20.0
    np.testing.assert_allclose(frame.tensions, tensions, atol=0.03)


def test_stiffness_and_friction_that_are_not_known_exactly_are_found_along_with_the_force():
    """To 5 % and 0.03; where they are taken to be right, 76 % of the forces are outside their 95 % interval."""
    own = {"frames": 60, "elements": True, "readings": "tip", "segments": 1}
    found, wrong = (run(0.2, 0.01, 500, Namespace(**own, parameters=p)) for p in ("estimated", "unknown"))
    assert found.inside > 0.85 > 0.5 > wrong.inside
    assert found.force_nees < 4.5 < 9.0 < wrong.force_nees
    assert not found.not_solved


def test_an_uncertain_number_is_one_of_the_robot_and_leaves_friction_on_or_off():
    refused = {
        "actuator_gain.gain": "number of the robot or the model",
        "friction_coefficient.mu": "there is friction",
    }
    for name, words in refused.items():
        with pytest.raises(ValueError, match=words):
            estimator(uncertain=tdcr.ParameterPrior.independent({name: 0.1}))


def test_a_force_that_stays_is_known_in_all_frames_from_the_readings_of_the_last():
    truth, rng = Truth(6, 3, friction=0.2, force=(0.03, 0.0, 0.0)), np.random.default_rng(0)
    own = estimator(friction=0.2, load=tdcr.LoadPrior(sigma=0.05, correlation_time=1e9))
    frames = [own.step(truth.command(k), truth.positions(rng, k) if k == 5 else []) for k in range(6)]
    last = frames[-1].passage
    last = posterior_covariance(last.covariance, last.jacobian)[:3, :3]
    for frame in tdcr.smoothed(frames)[:-1]:
        np.testing.assert_allclose(frame.force, frames[-1].force, atol=1e-6)
        np.testing.assert_allclose(frame.force_covariance, last, atol=1e-8)

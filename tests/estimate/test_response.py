"""Derivatives of a solved state by inputs, loads and the history of the holes, against differences of load steps."""

import numpy as np
import pytest

import tdcr_fe as tdcr
from tdcr_fe.effects import Experiment
from tdcr_fe.elements.drives import DISPLACEMENT, TENSION, TendonDrives
from tdcr_fe.estimate.response import Response, plastic_slips, with_plastic_slips, within_bounds
from tdcr_fe.estimate.uncertain import UncertainEffects
from tdcr_fe.model.loading import Actuation
from tdcr_fe.validation.campaigns.estimate import LENGTH, model, rod

CLASSICAL = tdcr.Model(elements_per_bay=1, friction="none", tendon_path="continuous")
#: Numbers of any robot.
NUMBERS = ("stiffness_scale.bending", "precurvature.kappa_x", "routing_twist.angle_tip")


def actuation(values, force, by_displacement):
    load = {"tip": tdcr.Load(at=LENGTH, force=tuple(force))}
    drives = TendonDrives(((TENSION, DISPLACEMENT)[by_displacement],) * 4, np.ones(4))
    return Actuation(drives, np.asarray(values, dtype=float), load)


def solved(friction, by_displacement, about=None):
    """A robot pulled, and then loaded and released a little, so that some holes slip and some stick."""
    first = actuation([1.0, 0.5, 0.9, 0.3], [0.01, 0.02, 0.0], False)
    experiment = Experiment(rod(friction), about or model(friction), (tdcr.LoadStep(loads=first.loads),))
    simulation = simulated(experiment, first)
    simulation.advance(first)
    before = simulation.state
    values = np.array([0.99, 0.51, 0.85, 0.3])
    if by_displacement:
        values = simulation.displacement + np.array([0.0, 1e-4, -2e-4, 1e-4])
    return experiment, simulation, before, values, np.array([0.02, 0.01, 0.01])


def simulated(experiment, first):
    settings = tdcr.SolverSettings(tolerance=1e-12, step_tolerance=1e-13)
    return tdcr.Simulation(experiment.robot, experiment.model, [first], settings)


@pytest.mark.parametrize("by_displacement", [False, True])
@pytest.mark.parametrize(("friction", "about"), [(0.0, None), (0.2, None), (0.0, CLASSICAL)])
def test_derivatives_are_those_of_the_load_step(friction, about, by_displacement):
    experiment, simulation, before, values, force = solved(friction, by_displacement, about)

    def end(change, simulation=simulation):
        start = simulation.system.warm_start(before, before.stored())
        simulation.begin_from(with_plastic_slips(simulation, start, change[7:]))
        simulation.advance(actuation(values + change[:4], force + change[4:7], by_displacement), 1)
        state = simulation.state
        positions, distal = state.configuration.poses[0][0], simulation.handle.tensions().values()
        of_tendons = state.base_tension[0], simulation.displacement, [x[-1] for x in distal]
        return np.concatenate((positions.ravel(), *of_tendons, plastic_slips(simulation, state)))

    k = len(plastic_slips(simulation, before))
    end(np.zeros(7 + k))
    sticks = np.abs(simulation.state.mobilisation[0]) < 1.0 - 1e-6
    assert not friction or 3 < sticks.sum() < sticks.size - 3
    tip = len(simulation.handle.arc_lengths) - 1
    names = (*NUMBERS, "friction_coefficient.mu") if friction else NUMBERS
    effects = UncertainEffects(experiment, tdcr.ParameterPrior(names, np.eye(len(names))))
    response = Response.of(simulation, np.array([tip]), effects.derivatives(simulation.handle))
    of_tendons = response.base_tensions, response.displacements, response.distal_tensions
    found = np.concatenate((response.positions.reshape(3 * tip + 3, -1), *of_tendons, response.plastic_slips))
    found = np.delete(found, [7, 8, 9], axis=1)  # moments
    found = np.insert(found, 7 + np.cumsum(response.sticking)[~response.sticking], 0.0, axis=1)
    steps = np.repeat([1e-8 if by_displacement else 1e-6, 1e-6, 1e-10], [4, 3, k])
    for p in [*range(7), *range(7, 7 + k, 5)]:
        change = np.zeros(7 + k)
        change[p] = steps[p]
        expected = (end(change) - end(-change)) / (2.0 * steps[p])
        np.testing.assert_allclose(found[:, p], expected, atol=2e-4 * np.abs(expected).max())
    for p, h in enumerate(1e-6 * np.eye(len(names)), 7 + k):
        moved = (effects.moved(change).experiment for change in (h, -h))
        near = (simulated(x, actuation(values, force, by_displacement)) for x in moved)
        ends = [end(np.zeros(7 + k), simulation) for simulation in near]
        expected = (ends[0] - ends[1]) / 2e-6
        np.testing.assert_allclose(found[:, p], expected, atol=2e-4 * np.abs(expected).max())


def test_a_moment_at_the_tip_turns_it_as_its_compliance_says():
    experiment, simulation, *_ = solved(0.0, False)
    tip = np.array([len(simulation.handle.arc_lengths) - 1])
    none = UncertainEffects(experiment, tdcr.ParameterPrior()).derivatives(simulation.handle)
    response = Response.of(simulation, tip, none)
    compliance = tdcr.local_response(simulation).compliance
    np.testing.assert_allclose(response.positions[-1][:, 4:10], compliance[:3], atol=1e-9)
    np.testing.assert_allclose(response.rotations[-1][:, 4:10], compliance[3:], atol=1e-7)


def test_a_hole_of_which_stick_or_slip_is_uncertain_is_a_line_and_what_it_misses():
    """Of a normal trial, cut off at full friction; by quadrature."""
    trial, spread = np.array([0.0, 0.9, -3.0, 40.0, 0.2]), np.array([2.0, 0.5, 4.0, 1.0, 0.0])
    z = np.linspace(-10.0, 10.0, 200001)
    weight = np.exp(-0.5 * z**2)
    weight /= weight.sum()
    slope, left = within_bounds(trial, spread, -1.0, 1.0)
    for mean, sigma, of_line, missed in zip(trial, spread, slope, left, strict=True):
        cut = (mean + sigma * z).clip(-1.0, 1.0)
        np.testing.assert_allclose(of_line, weight @ (cut * z) / sigma if sigma else 1.0, atol=1e-5)
        line = weight @ cut + of_line * sigma * z
        np.testing.assert_allclose(missed, np.sqrt(weight @ (cut - line) ** 2), atol=1e-5)

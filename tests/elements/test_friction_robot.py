"""Robots whose coefficient of friction depends on slip rate or normal force: load steps with time, and dynamics."""

from dataclasses import replace

import numpy as np
import pytest
from robots import SEVEN, cables, distance, single, solve
from scenes import damped, recommended

from tdcr_fe import LoadStep
from tdcr_fe.elements.coefficients import normal_forces
from tdcr_fe.model.friction import (
    AngleDependentFriction,
    ConstantFriction,
    ForceDependentFriction,
    StribeckFriction,
)
from tdcr_fe.model.robot import TightHole

VISCOUS = StribeckFriction(0.2, 0.2, 1e-3, viscous=100.0)
STRIBECK = StribeckFriction(static=0.3, kinetic=0.15, stribeck_rate=5e-3, viscous=2.0)


def timed(tensions, duration):
    """One load step per tension, each as long [s]; None is without a time."""
    times = [None if duration is None else k * duration for k in range(1, len(tensions) + 1)]
    return [LoadStep("", {"t1": t}, time=time) for t, time in zip(tensions, times, strict=True)]


# ---------------------------------------------------------------- statics


@pytest.mark.parametrize("duration", [None, 1e4, 1e-3], ids=["no time", "slow", "fast"])
@pytest.mark.parametrize("axial_stiffness", [None, 2000.0], ids=["inextensible", "elastic"])
def test_load_steps_have_static_friction_when_slow_and_kinetic_when_fast(duration, axial_stiffness):
    """To 2 N and back to 1 N: the tips of a robot with the constant coefficient of either limit, to 1e-6 of L.

    An elastic tendon in a fast step is pulled only: at a fast reversal its tensions are not unique.
    """
    fast_and_elastic = duration == 1e-3 and axial_stiffness is not None
    steps = timed([1.0, 2.0] if fast_and_elastic else [1.0, 2.0, 1.0], duration)
    tips = solve(single(friction=replace(STRIBECK, viscous=0.0), axial_stiffness=axial_stiffness), steps).tips
    static, kinetic = (solve(single(mu, axial_stiffness=axial_stiffness), steps).tips for mu in (0.3, 0.15))
    assert distance(tips, kinetic if duration == 1e-3 else static) < 1e-6
    assert distance(static, kinetic) > 1e-2


@pytest.mark.parametrize(
    "law",
    [ConstantFriction(0.2), ForceDependentFriction(0.2, 0.5, exponent=0.0), StribeckFriction(0.2, 0.2, 1e-3)],
    ids=lambda law: law.kind,
)
def test_a_law_without_dependence_is_a_coefficient_and_holes_may_have_their_own(law):
    """A tight and a smooth hole, while the tendon is pulled and released."""
    third, fifth = SEVEN.positions[2], SEVEN.positions[4]
    holes = (TightHole(third, friction_coefficient=0.8), TightHole(fifth, 0.1, friction_coefficient=0.0))
    steps = timed([1.0, 2.0, 1.0], 1.0)
    expected = solve(single(0.2, tight_holes=holes), steps)
    found = solve(single(friction=law, tight_holes=holes), steps)
    assert distance(found.tips, expected.tips) < 1e-7
    assert found.steps[-1].tensions[0] == pytest.approx(expected.steps[-1].tensions[0], abs=1e-5)
    assert distance(found.tips, solve(single(friction=law), steps).tips) > 1e-3


@pytest.mark.parametrize("friction", ["per-hole", "per-tendon"])
@pytest.mark.parametrize("tensions", [(1.0, 2.0), (2.0, 1.0)], ids=["pulled", "released"])
def test_a_load_step_has_the_coefficient_of_its_own_slip_rate(friction, tensions):
    """Recovered from the poses and tensions of two steps alone; viscous friction, so that every rate differs."""
    law = StribeckFriction(0.15, 0.15, 1e-3, viscous=20.0)
    robot = single(friction=law)
    steps = [LoadStep("", {"t1": t}, time=k * 0.5, substeps=1) for k, t in enumerate(tensions, start=1)]
    result = solve(robot, steps, friction=friction)
    (first, _), (second, angles) = (cables(robot, s)[0] for s in result.steps)
    tension, released = result.steps[1].tensions[0], first - second
    mu = np.abs(np.log(tension[1:] / tension[:-1])) / angles
    force = normal_forces(tension[None], angles[None])[0]
    rate = np.cumsum(released[::-1])[::-1][1:] / 0.5
    if friction == "per-tendon":
        rate = np.full_like(rate, released.sum() / 0.5)
    assert np.all(rate * (tensions[1] - tensions[0]) > 0.0)
    assert mu == pytest.approx(law.coefficient(force, rate, angles)[0], abs=1e-6)
    assert np.ptp(law.coefficient(force, rate, angles)[0]) > 1e-3 or friction == "per-tendon"


@pytest.mark.parametrize(("friction", "axial_stiffness"), [("per-hole", None), ("per-tendon", 300.0)])
@pytest.mark.parametrize(
    "law",
    [ForceDependentFriction(0.3, 0.2), AngleDependentFriction(0.05, 2.0), VISCOUS, STRIBECK],
    ids=["force-dependent", "angle-dependent", "viscous", "stribeck"],
)
def test_newton_converges_quadratically_with_laws(law, axial_stiffness, friction):
    """A pull to 2.5 N and a release to 0.5 N: at most 4 iterations a step of 1 s (constant coefficient: 3 or 4).

    With a tangent that lacks the slip rates viscous friction takes 18, with slip rows that lack them 5.
    """
    tensions = [0.5, 1.0, 1.5, 2.0, 2.5] if law is STRIBECK else [0.5, 1.0, 1.5, 2.0, 2.5, 2.0, 1.0, 0.5]
    steps = [replace(s, substeps=1) for s in timed(tensions, 1.0)]
    result = solve(single(friction=law, axial_stiffness=axial_stiffness), steps, friction=friction)
    assert max(s.iterations for s in result.steps) <= 4


def test_steep_laws_are_solved_in_any_substep():
    """Friction that rises within 1e-5 m/s: with tangents alone four substeps of a release went to and fro for ever."""
    robot, steps = single(friction=StribeckFriction(0.1, 0.25, 1e-5)), timed([1.5, 2.2, 1.3, 0.4, 0.8], 2.0)
    for substeps in (4, 32):
        result = solve(robot, [replace(s, substeps=substeps) for s in steps])
        assert max(s.details["iterations_total"] for s in result.steps) <= 6 * substeps


def test_the_error_of_slip_rates_falls_with_the_square_of_the_substeps():
    """A pull of 0.5 s with viscous friction: four times the substeps have about 1/16 of the error, here below 1/10."""
    robot, steps = single(friction=StribeckFriction(0.15, 0.15, 1e-3, viscous=50.0)), timed([1.0, 2.0], 0.5)
    few, more, exact = (solve(robot, [replace(s, substeps=n) for s in steps]).tips for n in (4, 16, 64))
    assert 10.0 * distance(more, exact) < distance(few, exact)
    assert distance(few, exact) > 1e-6
    # Without a number of substeps there are as many as it takes.
    assert distance(solve(robot, steps).tips, exact) < 2e-5


# ---------------------------------------------------------------- scenes


@pytest.mark.parametrize(("end", "step", "top"), [(2.0, 2e-2, 0.2), (0.1, 1e-3, 1.0)], ids=["slow", "fast"])
def test_dynamics_have_the_coefficient_of_their_slip_rate(end, step, top):
    """A slow pull in 2 s has nearly the static coefficient, a fast one in 0.1 s reaches the kinetic; all its own."""
    law = StribeckFriction(static=0.3, kinetic=0.15, stribeck_rate=2e-3)
    _keep, mbs, handle = damped(single(friction=law), 0.3)
    handle.set_inputs_over_time(lambda t: [top * (t / end) ** 2])
    found = []

    def sample(mbs, t):
        if t > 0.0:
            now = handle.actuation.current_forces()
            field, angles = now.field, now.measured.shape.angles
            used = np.log(field.tension[0, :-1] / field.tension[0, 1:]) / angles[0]
            force, rate = normal_forces(field.tension, angles)[0], field.slip_rate[0]
            found.append((used, law.coefficient(force, rate, angles[0])[0], rate, field.mobilisation[0]))
        return True

    mbs.SetPostStepUserFunction(sample)
    assert mbs.SolveDynamic(recommended(handle, end, step))
    mu, expected, rate, mobilisation = (np.array(x) for x in zip(*found, strict=True))
    slips = np.all(mobilisation == 1.0, axis=1)
    assert np.count_nonzero(slips) > 20
    assert mu[slips] == pytest.approx(expected[slips], abs=1e-6)
    if top < 0.5:
        assert np.max(np.abs(rate)) < 0.6e-3 and np.min(mu[slips]) > 0.28
    else:
        assert np.max(rate) > 1e-2 and np.min(mu[slips]) < 0.151

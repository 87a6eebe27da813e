"""Laws of what happens at a hole as the tendon slips: closed forms along one hole, whole robots, and scenes."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from robots import LENGTH, distance, paper, pull, routed, solve
from scenes import scene, solve_by_exudyn
from two_tendons import ANGLES, LENGTHS, tendon_law

from tdcr_fe import Backbone, Disks, HelicalRouting, Load, LoadStep, ParallelRouting, Robot, Tendon
from tdcr_fe.elements.friction import FRICTION_MODELS
from tdcr_fe.elements.hysteresis import HYSTERESES, Dahl, FrictionState
from tdcr_fe.elements.native.condensation import ElasticTendons
from tdcr_fe.elements.native.iterated import HoleIterate
from tdcr_fe.elements.tendons import CableShape
from tdcr_fe.model.loading import SolverSettings

LAWS = [law(2e-5) for law in HYSTERESES.values()]
STARTS = np.array([-1.0, -0.7, 0.0, 0.4, 1.0])


@pytest.mark.parametrize("amplitude", [1.0, 4.0])
def test_the_loop_of_dahl_is_its_closed_form(amplitude):
    """Between slips of ``+-A`` friction settles at ``+-tanh(A / delta)``; a loop encloses ``4 (A - delta tanh)``.

    Lengths of the last segment of a tendon are driven, so that material passes one hole after the other. Exudyn's own
    solvers have the same tensions.
    """
    delta, base = 1e-4, np.array([2.0, 1.0])
    law = tendon_law(FRICTION_MODELS["per-hole"], 0.3, presliding=delta, hysteresis=Dahl)
    state, slips, friction = law.initial_state(), [], []
    for turn in np.tile(np.linspace(0.0, 2.0 * np.pi, 4001)[1:], 6):
        lengths = LENGTHS.copy()
        lengths[0, 3] -= amplitude * delta * np.sin(turn)
        state = law.commit(law.evaluate(base, CableShape(lengths, ANGLES), state))
        slips.append(state.slip[0])
        friction.append(state.mobilisation[0])
    slip, s = np.array(slips[-4000:]), np.array(friction[-4000:])
    assert s.max(axis=0) == pytest.approx(np.tanh(amplitude), abs=1e-5)
    assert s.min(axis=0) == pytest.approx(-np.tanh(amplitude), abs=1e-5)
    closed = [np.append(x, x[:1], axis=0) for x in (slip, s)]
    area = np.sum(0.5 * (closed[1][1:] + closed[1][:-1]) * np.diff(closed[0], axis=0), axis=0)
    assert area == pytest.approx(4.0 * delta * (amplitude - np.tanh(amplitude)), rel=1e-5)
    lengths[0, 3] -= amplitude * delta
    robot, history = SimpleNamespace(law=law), SimpleNamespace(friction=state)
    tendons = ElasticTendons(robot, np.zeros(2, dtype=bool), history, base, 0.0)
    iterate = HoleIterate.of(tendons, CableShape(lengths, ANGLES))
    expected = law.evaluate(base, CableShape(lengths, ANGLES), state).tension
    assert iterate.field.tension == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize("law", LAWS, ids=lambda law: law.kind)
def test_a_slip_that_goes_one_way_may_be_divided_anywhere(law):
    """The law is a curve: no more is remembered than the slip and the mobilisation."""
    zero = np.zeros_like(STARTS)
    for whole in (3e-5, -3e-5, 4e-4, -1e-7):
        direct = np.clip(law.trial(zero + whole, FrictionState(zero, STARTS)), -1.0, 1.0)
        begun = np.clip(law.trial(zero + 0.3 * whole, FrictionState(zero, STARTS)), -1.0, 1.0)
        later = law.trial(zero + whole, FrictionState(zero + 0.3 * whole, begun))
        assert np.clip(later, -1.0, 1.0) == pytest.approx(direct, abs=1e-9)


@pytest.mark.parametrize("law", LAWS, ids=lambda law: law.kind)
def test_slip_and_slope_belong_to_the_mobilisation(law):
    """Both follow from a point of the curve, up to full friction."""
    zero, h = np.zeros(3), 1e-9
    before = FrictionState(zero, np.array([-0.7, 0.0, 0.4]))
    for travel in (5e-6, -8e-6):
        s = law.trial(zero + travel, before)
        slip, slope = law.slip_of(s, before), law.flexibility(s, np.sign(zero + travel))
        assert slip == pytest.approx(zero + travel, abs=1e-15)
        ahead, back = (law.trial(zero + travel + x, before) for x in (h, -h))
        assert 1.0 / slope == pytest.approx((ahead - back) / (2.0 * h), rel=1e-5)
    assert np.all(law.trial(zero + 1.0, before) >= 1.0)
    assert np.all(law.trial(zero - 1.0, before) <= -1.0)


# ---------------------------------------------------------------- robots


def test_dahl_tends_to_capstan_as_it_grows_stiffer():
    """Tips against those of the elastic-plastic law, over the length; the stiffness at rest grows a hundredfold."""
    apart, steps = [], pull(0.5, 2.0, 1.5, 0.5, 1.5)
    for delta in (1e-4, 1e-6, 1e-8):
        settings = SolverSettings(presliding=delta, path_tolerance=1e-6)
        apart.append(distance(*(solve(paper(0.3), steps, settings, hysteresis=x).tips for x in HYSTERESES)))
    assert apart[0] > 5e-4
    assert apart[1] < 0.05 * apart[0]
    assert apart[2] < 0.05 * apart[1]


def test_dahl_feels_a_reversal_that_the_elastic_plastic_law_takes_back():
    """After a small release and its return, friction of the latter is what it was; Dahl's tip comes back elsewhere."""
    steps, settings = pull(0.2, 0.19, 0.2), SolverSettings(presliding=1e-3)
    for kind, returns in (("elastic-plastic", True), ("dahl", False)):
        tips = solve(paper(0.3), steps, settings, hysteresis=kind).tips
        assert (distance(tips[0], tips[2]) < 1e-9) == returns


def test_a_step_of_dahl_is_divided_though_its_halves_end_where_the_whole_does():
    """Pulling the second tendon takes holes of the first back and forth: by halves alone the tip was off by 7.6e-4."""
    whole, short = ParallelRouting(6e-3, angle_deg=10.0), ParallelRouting(6e-3, angle_deg=130.0)
    tendons = [Tendon("t1", whole, 0.2), Tendon("t2", short, 0.2, end=0.1)]
    tendons += [Tendon("t3", HelicalRouting(6e-3, turns=0.5, angle_deg=250.0), 0.2)]
    robot = Robot(Backbone(0.2, 0.5e-3, 60e9, 0.3), Disks.equally_spaced(8, 0.2, radius=8e-3), tendons)
    steps = [LoadStep(tensions={"t1": 2.0}), LoadStep(tensions={"t2": 1.5})]
    fine = [replace(step, substeps=256) for step in steps]
    found, expected = (solve(robot, x, hysteresis="dahl").tips for x in (steps, fine))
    assert distance(found, expected) < 5e-5


def test_mobilisations_of_elastic_tendons_are_those_of_their_slips_after_any_reversal():
    """Over 300 random tensions. Newton's method for the mobilisations left an error of 0.04, and of 2 in a robot."""
    law = tendon_law(FRICTION_MODELS["per-hole"], compliance=5e-4, hysteresis=Dahl)
    state, worst = law.initial_state(), 0.0
    for tension in np.random.default_rng(0).uniform(0.2, 3.0, (300, 2)):
        field = law.evaluate(tension, CableShape(LENGTHS, 3.0 * ANGLES), state)
        there = np.clip(law.hysteresis.trial(field.slip, state), -1.0, 1.0)
        worst = max(worst, np.abs(there - field.mobilisation).max())
        state = law.commit(field)
    assert worst < 1e-9


# ---------------------------------------------------------------- scenes


@pytest.mark.integration
def test_what_is_uncertain_of_a_path_of_dahl_is_reported():
    """Solved as a whole it divides itself into 26 substeps, which equal parts up to 16 repeat: 3e-4 off, unseen."""
    tendons = tuple(Tendon(f"t{a}", ParallelRouting(4e-3, a), 0.2) for a in (0, 120, 240))
    arm = Robot(Backbone(0.2, 0.5e-3, 60e9, 0.3), Disks.equally_spaced(5, 0.2), tendons)
    pulled = ({"t0": 5e-3, "t120": -2e-3, "t240": -2.1e-3}, {"t0": 4e-3, "t120": -1e-3, "t240": -1.8e-3})
    load = {"side": Load(0.2, (0.0, 0.03, 0.0), frame="section")}
    steps = [LoadStep(displacements=d, loads=load) for d in pulled]
    divided = [steps[0], replace(steps[1], substeps=256)]
    found, fine = (solve(arm, x, hysteresis="dahl").steps[-1] for x in (steps, divided))
    assert 0.0 < np.linalg.norm(found.tip - fine.tip) / 0.2 <= 1.5 * found.details["refinement_error"]


def test_exudyns_static_solver_has_dahls_history():
    """To 1.2 N and back to 0.6 N, as `simulate`."""
    kind = {"hysteresis": "dahl"}
    expected = solve(paper(0.3), pull(1.2, 0.6), SolverSettings(presliding=2e-5), **kind).tips
    _keep, mbs, handle = scene(paper(0.3), presliding=2e-5, **kind)
    solve_by_exudyn(mbs, handle, lambda t: [2.4 * t if t < 0.5 else 1.2 - (2 * t - 1) * 0.6], 0.02)
    assert distance(handle.tip_position, expected[-1]) < 5e-4


def test_for_a_short_presliding_distance_both_laws_give_the_same():
    """Forces and moments on a robot with helical tendons; with straight lines for Dahl's curves Newton's method cycled.

    Of 24 random robots one had no solution, and all together took 4.5 times as long.
    """
    helical = routed(*(HelicalRouting(4.5e-3, 0.3 * k, 120.0 * k) for k in range(3)), disks=8, mu=0.2)
    bent = helical.with_backbone(radius=0.5e-3, precurvature=(1.0, -2.0)).with_disks(mass=0.3e-3)
    robot = replace(bent, tip_mass=1e-3)
    loads = {
        "middle": Load(0.5 * LENGTH, (0.01, 0.02, 0.0), (0.0, 1e-3, 0.0), "section"),
        "tip": Load(LENGTH, (0.01, 0.0, 0.02), (1e-3, 0.0, 1e-3)),
    }
    rows = ((1.0, 0.3, 0.5), (0.6, 0.5, 0.9), (0.7, 0.2, 0.4))
    steps = [LoadStep("", dict(zip(robot.tendon_names, row, strict=True))) for row in rows]
    steps.append(replace(steps[-1], loads=loads))
    tips = [solve(robot, steps, gravity=(1.0, 2.0, -9.0), hysteresis=kind).tips for kind in HYSTERESES]
    assert distance(tips[1], tips[0]) < 1e-4

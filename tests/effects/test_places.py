"""Effects at one place and at the base: against the reference, closed forms, and loads of equal size."""

from dataclasses import replace

import numpy as np
import pytest
from robots import BACKBONE, LENGTH, distance, solve, three
from scenes import recommended, scene, solve_scene

from tdcr_fe.effects import EFFECTS, Experiment, PlaceEffect, with_effect
from tdcr_fe.model.loading import Load, LoadStep, Model
from tdcr_fe.model.robot import Disks, Robot, SideSpring, TightHole

S = three().disks.positions
PULLED = LoadStep(tensions={"t1": 1.0, "t2": 0.2, "t3": 0.2})
PUSHED = LoadStep(tensions={"t1": 1.6}, loads={"tip": Load(LENGTH, (0.02, 0.03, 0.0))})
STEPS = (PULLED, PUSHED, LoadStep(tensions={"t1": 0.8, "t2": 0.6}))
DECLARED = Experiment(three(0.2), Model(elements_per_bay=2), STEPS)
PLACES = [e for e in EFFECTS if isinstance(e, PlaceEffect)]


def tips(experiment: Experiment) -> np.ndarray:
    """Positions of the tip at the ends of all steps."""
    return solve(experiment.robot, list(experiment.steps), elements_per_bay=2).tips


@pytest.mark.parametrize("named", PLACES, ids=lambda e: e.name)
def test_at_a_place_an_effect_needs_what_it_needs_anywhere(named, monkeypatch):
    """Derivatives of an effect of the user's own, which takes differences, were taken for exact."""
    monkeypatch.setattr(type(named), "exact_derivatives", False)
    there = named.at(named.places(DECLARED.robot)[0])
    for name in ("exact_derivatives", "needs_friction", "after", "description"):
        assert getattr(there, name) == getattr(named, name)


def test_a_spring_deflects_as_a_cantilever_with_a_spring_at_its_tip():
    """Small force F at the tip: F / (3 EI / L^3 + k), and nothing along the backbone."""
    bare, k, force = Experiment(Robot(BACKBONE, Disks.equally_spaced(5, LENGTH)), Model()), 0.3, 1e-5
    held = with_effect(bare, "side_spring", s=LENGTH, stiffness=k).robot
    steps = [LoadStep(loads={"tip": Load(LENGTH, (force, 0.0, 0.0))})]
    found = solve(held, steps, friction="none", elements_per_bay=4)
    assert found.tips[0][0] == pytest.approx(force / (3.0 * BACKBONE.EI / LENGTH**3 + k), rel=1e-4)


def test_a_kink_bends_the_unloaded_backbone_in_its_bay_only():
    a, b = S[3], S[4]
    bent = with_effect(Experiment(three(), Model(), ()), "kink", s=0.5 * (a + b), kappa_x=0.0, kappa_y=4.0)
    found = solve(bent.robot, [LoadStep()], friction="none").steps[0]
    assert found.bending_angle == pytest.approx(4.0 * (b - a), rel=1e-9)
    np.testing.assert_allclose(found.positions[found.s <= a + 1e-9][:, 0], 0.0, atol=1e-12)


def test_a_soft_bay_turns_more_by_its_factor_under_a_tip_moment():
    steps, moment = [LoadStep(loads={"tip": Load(LENGTH, moment=(0.0, 1e-3, 0.0))})], 1e-3
    soft = with_effect(Experiment(three(0.0), Model(), ()), "soft_bay", s=0.5 * (S[3] + S[4]), factor=0.25)
    turned = solve(soft.robot, steps, friction="none").steps[0].bending_angle
    assert turned == pytest.approx(moment / BACKBONE.EI * (LENGTH + 3.0 * (S[4] - S[3])), rel=1e-6)


def test_a_stuck_hole_keeps_the_tension_of_the_base_from_the_tip():
    """As the reference has it: nothing passes hole 4, so the outer part acts as a strut."""
    steps = tuple(LoadStep(tensions={"t1": t}) for t in (0.5, 1.0))
    pulled = Experiment(three(0.0), Model(elements_per_bay=1), steps)
    stuck = with_effect(pulled, "stuck_hole", tendon=1, s=S[3])
    assert stuck.robot.tendons[0].tight_holes == (TightHole(S[3], 4.0),)
    last = solve(stuck.robot, list(stuck.steps)).steps[-1]
    assert last.hole_states[0][3] == "stick"
    assert last.tensions[0][2] == pytest.approx(1.0)
    assert last.tensions[0][4] < 0.05


def test_springs_in_a_rotated_scene_act_sideways_to_the_base():
    """A scene lies on its side: robot and spring are rotated. Exudyn has the same answer by its own solver."""
    robot = replace(three(0.0), springs=(SideSpring(S[6], 2.0),))
    turn = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    found = []
    for pose in (np.eye(3), turn):
        _keep, mbs, arm = scene(robot, friction="none", referenceRotationMatrix=pose)
        solve_scene(mbs, arm, {"t1": 1.0, "t2": 0.2})
        found.append(arm.tip_position)
        mbs.SolveStatic(recommended(arm, 1.0, 0.05), updateInitialValues=True)
        np.testing.assert_allclose(arm.tip_position, found[-1], atol=1e-5)
    np.testing.assert_allclose(turn @ found[0], found[1], atol=1e-9)
    assert np.hypot(*found[0][:2]) > 0.01


def test_places_cover_the_robot():
    robot = three()
    count = len(robot.disks.positions)
    numbers = {e.name: len(e.places(robot)) for e in PLACES}
    assert numbers == {"soft_bay": count, "kink": count, "side_spring": count, "stuck_hole": 3 * (count - 1)}


@pytest.mark.parametrize("e", PLACES, ids=lambda e: e.name)
def test_an_effect_at_a_fixed_place_is_the_listed_one_there(e):
    place = e.places(DECLARED.robot)[4]
    there = e.at(place)
    assert there.listed == e.name and not set(place) & {p.name for p in there.parameters}
    values = e.size_probes(DECLARED, place)[0][0]
    same = with_effect(DECLARED, e.name, **{**there.place, **values})
    assert there.apply(DECLARED, values).robot == same.robot
    assert distance(tips(there.apply(DECLARED, there.null_values(DECLARED))), tips(DECLARED)) < 1e-9
    assert set(e.spread(DECLARED.robot, place)) == set(e.place_names)

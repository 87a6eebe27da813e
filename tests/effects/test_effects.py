"""Effects against exact or independent answers."""

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from inputs import write
from robots import BACKBONE, LENGTH, MODEL, paper, seven, single, three

from tdcr_fe import Disks, InputError, Load, LoadStep, Model, Robot, Tendon, read_scenario, simulate
from tdcr_fe.effects import EFFECTS, Experiment, effect, with_effect, with_effects
from tdcr_fe.io.write_toml import robot_to_toml, scenario_to_toml
from tdcr_fe.model.backbone import Backbone, Superelastic
from tdcr_fe.model.routing import ConvergingRouting, HelicalRouting, ParallelRouting


def pulled(*tensions, **loads):
    acting = {"tip": Load(LENGTH, **loads)} if loads else {}
    return tuple(LoadStep(tensions={"t1": t}, loads=acting) for t in tensions)


def tip(setup):
    return simulate(setup.robot, setup.model, setup.steps).raise_if_failed().tips


def setup(mu=0.0, steps=None, robot=None, **model):
    return Experiment(robot or paper(mu), replace(MODEL, **model), steps or pulled(0.5, 1.0))


# ----------------------------------------------------------------------------------------------- the contract


#: A robot whose builder has declared whatever an effect can say of it.
DECLARED = replace(
    seven(0.1)
    .with_backbone(precurvature=(0.3, -0.2), superelastic=Superelastic(2e-4, 0.6), creep_rate=1e-3)
    .with_disks(thickness=1e-3)
    .with_tendons(adhesion=1e-3, clearance=2e-4),
    tip_mass=1e-3,
)


@pytest.mark.parametrize("e", EFFECTS, ids=lambda e: e.name)
def test_null_values_keep_what_is_declared(e):
    """With the null values the robot is the declared one, whether it declares much or little."""
    for s in (
        setup(robot=DECLARED, steps=(LoadStep(tensions={"t1": 0.2}, time=10.0),), gravity=(0.0, 0.0, -9.81)),
        setup(robot=single(0.2)),
    ):
        changed = e.apply(s, e.null_values(s))
        assert changed.robot.backbone.superelastic == s.robot.backbone.superelastic
        assert changed.robot.backbone.creep_rate == s.robot.backbone.creep_rate
        assert _same(changed, s)
    assert e.description and e.separating_experiment and all(p.unit and p.meaning for p in e.parameters)


def test_tendons_that_declare_different_values_keep_their_differences():
    robot = three(0.1)
    for k, name in enumerate(robot.tendon_names, start=1):
        values = {"adhesion": 0.01 * k, "clearance": 1e-4 * k, "axial_stiffness": 100.0 * k}
        robot = robot.with_tendons([name], **values)
    s = Experiment(robot, MODEL, pulled(0.5))
    for name in ("hole_adhesion", "hole_clearance", "tendon_stretch"):
        e = effect(name)
        assert _same(e.apply(s, e.null_values(s)), s)
    doubled = with_effect(s, "hole_adhesion", drop=0.04).robot.tendons
    assert [t.adhesion for t in doubled] == pytest.approx([0.02, 0.04, 0.06])
    compliances = np.array([1.0 / 100.0, 1.0 / 200.0, 1.0 / 300.0])
    softer = with_effect(s, "tendon_stretch", axial_stiffness=1.0 / (compliances.mean() + 1e-3)).robot.tendons
    assert [1.0 / t.axial_stiffness for t in softer] == pytest.approx(compliances + 1e-3)


def _same(a, b):
    """Whether two experiments are one: equal descriptions, or tips that agree."""
    described = (a.robot, a.model, a.steps) == (b.robot, b.model, b.steps)
    return a.observation == b.observation and (described or np.allclose(tip(a), tip(b), atol=1e-12))


# ------------------------------------------------------------------------------------------- before the base


def arrived(commands, name, **values):
    """Tensions at the base for commanded ones [N], or displacements [m]."""
    kind = "displacements" if name == "actuator_backlash" else "tensions"
    steps = tuple(LoadStep(**{kind: {"t1": x}}) for x in commands)
    return [getattr(s, kind)["t1"] for s in with_effect(setup(steps=steps), name, **values).steps]


def test_friction_before_the_base_in_a_worked_example():
    # Dead band 0.1 N, efficiency 0.8: pulling (T - 0.1) 0.8, releasing T / 0.8 + 0.1, held in between.
    commands = [0.05, 0.6, 1.1, 0.9, 0.5, 0.1, 0.0, 0.2]
    expected = [0.0, 0.4, 0.8, 0.8, 0.725, 0.225, 0.1, 0.1]
    found = arrived(commands, "actuator_loss", dead_band=0.1, efficiency=0.8)
    assert found == pytest.approx(expected, abs=1e-15)


@given(st.lists(st.floats(0.0, 5.0), min_size=1, max_size=30), st.floats(1e-3, 1.0), st.floats(0.3, 1.0))
def test_the_tension_that_arrives_stays_within_its_bounds_and_moves_only_at_them(commands, band, efficiency):
    last = 0.0
    found = arrived(commands, "actuator_loss", dead_band=band, efficiency=efficiency)
    for t, a in zip(commands, found, strict=True):
        low, high = max((t - band) * efficiency, 0.0), t / efficiency + band
        assert low - 1e-12 <= a <= high + 1e-12
        assert a == last or a in (pytest.approx(low), pytest.approx(high))
        last = a


def test_backlash_in_a_worked_example():
    """Lost at the start, whichever way it goes, and at every reversal; from the middle, half of it at the start."""
    commands = np.array([0.5, 2.0, 3.0, 2.5, 1.0, 1.5, 3.0]) * 1e-3
    expected = np.array([0.0, 1.0, 2.0, 2.0, 1.0, 1.0, 2.0]) * 1e-3
    for sign, (name, lost) in itertools.product((1.0, -1.0), {"backlash": 1.0, "from_middle": 0.5}.items()):
        found = arrived((sign * commands).tolist(), "actuator_backlash", **{name: 1e-3})
        moved = sign * np.where(expected > 0.0, expected + (1.0 - lost) * 1e-3, 0.0)
        assert found == pytest.approx(moved, abs=1e-18)


def test_a_step_is_divided_where_one_of_two_tensions_begins_to_move():
    steps = (LoadStep(tensions={"t1": 1.0, "t2": 0.0}), LoadStep(tensions={"t1": 0.5, "t2": 1.0}))
    s = with_effect(Experiment(three(0.1), MODEL, steps), "actuator_loss", dead_band=0.2)
    # t1 falls from 1.0 and lets go at 0.6, after 0.8 of the step; t2 arrives from 0.2 on.
    assert [k for k, _ in s.ends] == [0, 1, 1, 1]
    assert [share for _, share in s.ends] == pytest.approx([1.0, 0.2, 0.8, 1.0])
    arrived = [(x.tensions["t1"], x.tensions["t2"]) for x in s.steps]
    np.testing.assert_allclose(arrived, [(0.8, 0), (0.8, 0), (0.8, 0.6), (0.7, 0.8)], atol=1e-12)


# ------------------------------------------------------------------------------------------ the robot itself


def test_gravity_acts_as_density_times_acceleration():
    heavy = paper(backbone=replace(BACKBONE, density=11200.0)).with_disks(mass=0.34e-3)
    twice = with_effect(setup(), "gravity", g_x=-9.0, g_z=-4.0)
    once = with_effect(setup(robot=heavy), "gravity", g_x=-4.5, g_z=-2.0)
    assert tip(twice) == pytest.approx(tip(once), abs=1e-9)


def test_payload_is_a_weight_at_the_tip():
    light = paper(backbone=replace(BACKBONE, density=0.0)).with_disks(mass=0.0)
    mass = with_effect(setup(robot=light, gravity=(0.0, -9.81, 0.0)), "tip_payload", mass=2e-3)
    force = setup(robot=light, steps=pulled(0.5, 1.0, force=(0.0, -2e-3 * 9.81, 0.0)))
    assert tip(mass) == pytest.approx(tip(force), abs=1e-9)


def test_stiffness_scale_is_another_modulus():
    scaled = with_effect(setup(0.2), "stiffness_scale", bending=0.8, torsion=0.8)
    modulus = setup(robot=paper(0.2, backbone=replace(BACKBONE, youngs_modulus=0.8 * 85e9)))
    assert tip(scaled) == pytest.approx(tip(modulus), abs=5e-6)
    apart = with_effect(setup(0.2), "stiffness_scale", bending=0.9, torsion=1.2).robot.backbone
    assert pytest.approx((0.9 * BACKBONE.EI, 1.2 * BACKBONE.GJ)) == (apart.EI, apart.GJ)


def arc(moment, backbone=BACKBONE):
    robot = Robot(backbone, Disks.equally_spaced(5, LENGTH), ())
    return Experiment(robot, MODEL, (LoadStep(loads={"m": Load(LENGTH, moment=(moment, 0.0, 0.0))}),))


def angle(setup):
    return simulate(setup.robot, setup.model, setup.steps).bending_angles[0]


def test_a_law_of_the_backbone_a_clearance_and_a_compliant_base_are_declared():
    changed = with_effect(setup(), "superelastic", threshold_strain=1e-3, plateau_ratio=0.2).robot
    assert changed == paper().with_backbone(superelastic=Superelastic(1e-3, 0.2))
    changed = with_effect(setup(), "hole_clearance", clearance=0.2e-3).robot
    assert changed == paper().with_tendons(clearance=0.2e-3)
    changed = with_effect(setup(), "base_compliance", stiffness=0.02).robot
    assert changed == replace(paper(), base_stiffness=0.02)


def test_precurvature_adds_to_the_curvature_of_a_moment():
    s = with_effect(arc(0.5 * BACKBONE.EI), "precurvature", kappa_x=0.7)
    assert angle(s) == pytest.approx(1.2 * LENGTH, rel=1e-9)


def test_creep_is_a_softer_backbone_later():
    loads = {"m": Load(LENGTH, moment=(BACKBONE.EI, 0.0, 0.0))}
    s = replace(arc(0.0), steps=(LoadStep(loads=loads, time=0.0), LoadStep(time=500.0)))
    s = with_effect(s, "creep", rate=1e-3)
    angles = simulate(s.robot, s.model, s.steps).bending_angles
    assert angles == pytest.approx([LENGTH, 1.5 * LENGTH], rel=1e-9)


def test_thick_disks_leave_less_to_bend():
    # 5 disks of 10 mm, the last one half on the backbone: 45 of 250 mm are rigid.
    s = with_effect(arc(0.5 * BACKBONE.EI), "rigid_disks", thickness=0.01)
    assert angle(s) == pytest.approx(0.5 * (LENGTH - 0.045), rel=1e-4)


def test_twist_turns_parallel_tendons_into_helical_ones():
    twisted = with_effect(setup(0.2), "routing_twist", angle_tip=math.pi)
    helix = Tendon("t1", HelicalRouting(offset=4.5e-3, angle_deg=0.0, turns=0.5), friction_coefficient=0.2)
    assert tip(twisted) == pytest.approx(tip(setup(robot=replace(paper(), tendons=(helix,)))), abs=1e-12)


# ------------------------------------------------------------------------------------------------ soft bodies

BODY = Backbone(0.3, 10e-3, 0.4e6, 0.45, density=1100.0)
SOFT = Robot(BODY, tendons=(Tendon("a", ParallelRouting(6e-3)),))
SOFT_MODEL = Model("continuous", "none", gravity=(0.0, 0.0, 9.81), elements_per_bay=1)
SOFT_SETUP = Experiment(SOFT, SOFT_MODEL, (LoadStep(tensions={"a": 2.0}),))


@pytest.mark.parametrize("name", ["modulus_scale", "density_scale", "nonlinear_material"])
def test_they_are_tried_on_soft_bodies_alone(name):
    assert effect(name).forms(SOFT_SETUP) == (effect(name),)
    wire = Experiment(paper(0.3), Model(gravity=(0.0, 0.0, -9.81)), (LoadStep(tensions={"t1": 2.5}),))
    assert effect(name).forms(wire) == ()


def test_modulus_density_and_tension_by_one_factor_change_nothing():
    """Static shapes depend on the ratios of stiffness, weight and tension alone."""
    every = with_effect(with_effect(SOFT_SETUP, "modulus_scale", factor=1.3), "density_scale", factor=1.3)
    every = with_effect(every, "actuator_gain", gain=1.3)
    assert tip(every) == pytest.approx(tip(SOFT_SETUP), abs=1e-9)
    assert abs(tip(with_effect(SOFT_SETUP, "modulus_scale", factor=1.3)) - tip(SOFT_SETUP)).max() > 4e-3


def test_declared_stiffnesses_are_scaled_too():
    declared = replace(SOFT_SETUP, robot=SOFT.with_backbone(bending_stiffness=2e-3, axial_stiffness=90.0))
    scaled = with_effect(declared, "modulus_scale", factor=2.0).robot.backbone
    assert pytest.approx((4e-3, 180.0, 2.0 * BODY.GJ)) == (scaled.EI, scaled.EA, scaled.GJ)


CHANNELS = (ParallelRouting(6e-3, 0.0), ParallelRouting(6e-3, 120.0))


def with_channels(*routings):
    """A body with two channels, and pulls of both."""
    tendons = tuple(Tendon(n, r, end=0.25) for n, r in zip("ab", routings, strict=True))
    pulls = ({"a": 2.0, "b": 0.5}, {"a": 0.4, "b": 1.5})
    return Experiment(Robot(BODY, tendons=tendons), SOFT_MODEL, tuple(LoadStep(tensions=x) for x in pulls))


#: Numbers of the effect, and the channels that they lead to.
MISPLACED = {
    "converging": (
        {"factor_end": 0.5}, [ConvergingRouting(6e-3, 3e-3, 0.0), ConvergingRouting(6e-3, 3e-3, 120.0)]),
    "helix": ({"angle_end_a": 0.2 * math.pi}, [HelicalRouting(6e-3, 0.1, 0.0), CHANNELS[1]]),
    # The number of a tendon counts before that of all.
    "one before all": (
        {"factor_base_a": 1.2, "factor_end_a": 1.2, "factor_base": 0.9, "factor_end": 0.9},
        [ParallelRouting(7.2e-3, 0.0), ParallelRouting(5.4e-3, 120.0)]),
}  # fmt: skip


@pytest.mark.parametrize(("values", "channels"), MISPLACED.values(), ids=MISPLACED)
def test_misplaced_channels_are_other_routings(values, channels):
    moved = with_effect(with_channels(*CHANNELS), "misplaced_channels", **values)
    assert tip(moved) == pytest.approx(tip(with_channels(*channels)), abs=1e-10)


def test_a_search_tries_misplaced_channels_on_bodies_without_disks_and_else_angles_of_three_tendons():
    """On a measured robot, eight angles of up to 6 degrees leave half a millimetre less; one alone, hardly any."""
    soft = with_channels(*CHANNELS)
    assert [len(f.parameters) for f in effect("misplaced_channels").forms(soft)] == [1, 4, 5, 6]
    two = replace(soft.robot, disks=Disks.equally_spaced(6, 0.3, radius=9e-3))
    assert effect("misplaced_channels").forms(replace(soft, robot=two)) == ()
    own = soft.with_robot(disks=two.disks, tendons=(*two.tendons, replace(two.tendons[0], name="c")))
    (angles,) = effect("misplaced_channels").forms(own)
    turned = angles.apply(own, {"angle_b": math.radians(10.0), "angle_c": math.radians(-20.0)}).robot
    there = [turned.holes(t) @ [1.0, 1.0j] for t in turned.tendons]
    np.testing.assert_allclose(np.angle(there, deg=True).T, np.tile([0.0, 130.0, -20.0], (6, 1)), atol=1e-12)


# ------------------------------------------------------------------------------------------------ from files


def test_effects_in_a_scenario_file_are_those_of_python(tmp_path):
    """Also where they are written from Python, which `read_scenario` refused in 0.1."""
    effects = {"gravity": {"g_z": -9.81}, "actuator_loss": {"dead_band": 0.1}}
    effects["kink"] = {"s": 0.1, "kappa_x": 1.0}
    path = write(tmp_path, robot_to_toml(paper(0.2)), scenario_to_toml(MODEL, pulled(1.0), effects=effects))
    s, by_hand = read_scenario(path), with_effects(Experiment(paper(0.2), MODEL, pulled(1.0)), effects)
    assert (s.robot, s.model, s.steps[0].tensions) == (by_hand.robot, by_hand.model, {"t1": 0.9})
    text = scenario_to_toml(MODEL, pulled(1.0))
    path.write_text(text + "\n[effects]\ngravitas = {}\nactuator_gain = { gain = -1.0, gian = 2.0 }\n")
    with pytest.raises(InputError) as caught:
        read_scenario(path)
    wrong = [p.key.removeprefix("effects.") for p in caught.value.problems]
    assert wrong == ["gravitas", "actuator_gain.gain", "actuator_gain.gian"]

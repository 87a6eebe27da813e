"""Forms of effects: a number for each segment or tendon, markers beyond the tip, a measuring frame elsewhere."""

from dataclasses import replace

import numpy as np
import pytest
from identify_data import simulated
from robots import LENGTH, MODEL, tendon, three
from scipy.spatial.transform import Rotation

from tdcr_fe import LoadStep, Reading, simulate
from tdcr_fe.effects import EFFECTS, ExcitationRange, Experiment, Observation, effect, with_effect
from tdcr_fe.effects.by_tendon import segments
from tdcr_fe.identify.run import Readings

#: Two segments of two tendons each; their names are not in the order of their ends.
ELASTIC = {"axial_stiffness": 400.0}
SHORT = {**ELASTIC, "end": three().disks.positions[4]}
TENDONS = [tendon("tip", 0.0, 0.2, **ELASTIC), tendon("near", 90.0, 0.3, **SHORT)]
TENDONS += [tendon("far", 180.0, 0.2, **ELASTIC), tendon("next", 270.0, 0.3, **SHORT)]
TWO = replace(three(), tendons=tuple(TENDONS))
MOVED = {"tip": 2e-3, "near": 1e-3, "far": -2e-3, "next": -1e-3}
STEPS = (LoadStep(displacements=dict.fromkeys(MOVED, 0.0)), LoadStep(displacements=MOVED))
SETUP = Experiment(TWO, MODEL, STEPS, Observation(markers=(0.125, LENGTH)))


def test_a_segment_is_the_tendons_that_end_at_the_same_disk():
    assert segments(TWO) == (("near", "next"), ("tip", "far"))
    assert segments(three()) == (("t1", "t2", "t3"),)


def test_forms_follow_from_the_robot():
    kinds = [f.name for f in effect("tendon_stretch").forms(SETUP)]
    several = ["", " (by segment)", " (each)"]
    assert kinds == [f"tendon_stretch{k}" for k in (*several, " (tip)", " (near)", " (far)", " (next)")]
    alone = Experiment(replace(TWO, tendons=TWO.tendons[:1]), MODEL)
    assert [f.name for f in effect("tendon_stretch").forms(alone)] == ["tendon_stretch"]
    one_segment = [f.name for f in effect("pretension").forms(Experiment(three(), MODEL))]
    assert one_segment == [f"pretension{k}" for k in ("", " (each)", " (t1)", " (t2)", " (t3)")]
    assert all(f.listed == e.name for e in EFFECTS for f in e.forms(SETUP))
    where = {f.name: f.kind.where for e in EFFECTS for f in e.forms(SETUP)}
    assert (where["pretension (far)"], where["pretension"]) == ("tendon far", "everywhere")


@pytest.mark.parametrize("e", EFFECTS, ids=lambda e: e.name)
def test_null_values_of_every_form_change_nothing(e):
    for form in e.forms(SETUP)[1:]:
        same = form.apply(SETUP, form.null_values(SETUP))
        assert same.robot == SETUP.robot and same.observation == SETUP.observation, form.name


#: Effect, field of a tendon that it declares, and its parameter.
FIELDS = [("tendon_stretch", "axial_stiffness", "axial_stiffness"), ("pretension", "pretension", "tension")]
FIELDS += [("friction_coefficient", "friction_coefficient", "mu")]


@pytest.mark.parametrize(("name", "field", "prefix"), FIELDS)
def test_the_most_particular_number_counts(name, field, prefix):
    declared = {t.name: getattr(t, field) for t in TWO.tendons}
    changed = with_effect(SETUP, name, **{f"{prefix}_segment_1": 2.0, f"{prefix}_next": 3.0}).robot
    assert {t.name: getattr(t, field) for t in changed.tendons} == {**declared, "near": 2.0, "next": 3.0}
    every = with_effect(SETUP, name, **{prefix: 1.5, f"{prefix}_segment_2": 2.5}).robot
    # Coefficients of friction, declared as 0.2 and 0.3, are in proportion to their mean.
    near = 0.3 / 0.25 * 1.5 if name == "friction_coefficient" else 1.5
    expected = {"tip": 2.5, "far": 2.5, "near": near, "next": near}
    assert {t.name: getattr(t, field) for t in every.tendons} == pytest.approx(expected)


def test_a_tendon_named_like_a_segment_is_meant_itself():
    robot = replace(TWO, tendons=(replace(TWO.tendons[0], name="segment_1"), *TWO.tendons[1:]))
    setup = Experiment(robot, MODEL)
    changed = with_effect(setup, "pretension", tension_segment_1=2.0).robot
    assert [t.pretension for t in changed.tendons] == [2.0, 0.0, 0.0, 0.0]
    assert "pretension (by segment)" not in [f.name for f in effect("pretension").forms(setup)]


def test_friction_of_one_tendon_is_that_of_the_robot_that_declares_it():
    """In a model without friction the other tendons stay without."""
    free = replace(SETUP, model=replace(MODEL, friction="none"))
    changed = with_effect(free, "friction_coefficient", mu_near=0.4)
    assert changed.model.friction == "per-hole"
    assert [t.friction_coefficient for t in changed.robot.tendons] == [0.0, 0.4, 0.0, 0.0]


def test_pretension_is_that_of_the_elastic_tendons():
    """A fit may make one segment inextensible while another has pretension; without any elastic tendon it cannot be."""
    stiff = with_effect(SETUP, "tendon_stretch", axial_stiffness_segment_1=np.inf)
    changed = with_effect(stiff, "pretension", tension=1.5).robot
    assert {t.name: t.pretension for t in changed.tendons if t.pretension} == {"tip": 1.5, "far": 1.5}
    assert effect("pretension").probe_points(stiff, ExcitationRange())
    assert effect("pretension").probe_points(Experiment(three(), MODEL, STEPS), ExcitationRange()) == []


def read(setup, readings):
    return Readings.of(readings, [1, 2], setup.robot.tendon_names).read(simulated(setup), setup)


def test_each_marker_has_an_offset_of_its_own():
    """On top of that of all, in the axes of its section, which is bent: also along the tangent, beyond the tip."""
    readings = [Reading(2, f"position_{a}", s, 0.0) for s in (0.125, LENGTH) for a in "xyz"]
    tip = simulate(TWO, MODEL, STEPS).steps[1]
    of_the_second = {"offset_y_marker_2": 2e-3, "offset_z_marker_2": -1e-3}
    own = with_effect(SETUP, "marker_offset", offset_x=1e-3, offset_z=3e-3, **of_the_second)
    moved = read(own, readings) - read(SETUP, readings)
    node = int(np.argmin(np.abs(tip.s - 0.125)))
    np.testing.assert_allclose(moved[:3], tip.rotations[node] @ [1e-3, 0.0, 3e-3], atol=1e-12)
    np.testing.assert_allclose(moved[3:], tip.rotations[-1] @ [1e-3, 2e-3, 2e-3], atol=1e-12)
    with pytest.raises(ValueError, match="no parameter 'offset_x_marker_3'"):
        with_effect(SETUP, "marker_offset", offset_x_marker_3=1e-3)


def test_a_frame_elsewhere_turns_positions_and_directions():
    readings = [Reading(2, f"position_{a}", LENGTH, 0.0) for a in "xyz"]
    readings += [Reading(2, q, None, 0.0) for q in ("tip_offset", "chord_angle", "bending_angle")]
    turn, shift = (0.02, -0.03, 0.1), (3e-3, -2e-3, 1e-3)
    names = [f"{n}_{a}" for n in ("rot", "shift") for a in "xyz"]
    moved = with_effect(SETUP, "frame_misalignment", **dict(zip(names, turn + shift, strict=True)))
    tip = simulate(TWO, MODEL, STEPS).steps[1]
    rotation = Rotation.from_rotvec(turn)
    seen = rotation.apply(tip.tip) + shift
    angle, bending = np.arctan2(np.hypot(*seen[:2]), seen[2]), np.arccos(rotation.apply(tip.tangent)[2])
    expected = [*seen, np.hypot(*seen[:2]), angle, bending]
    np.testing.assert_allclose(read(moved, readings), expected, atol=1e-12)
    points = np.array([tip.tip, tip.positions[3]])
    np.testing.assert_allclose(moved.observation.in_base(moved.observation.seen(points)), points, atol=1e-15)


def test_two_frames_follow_one_another():
    first, second = {"rot_x": 0.1, "shift_y": 2e-3}, {"rot_z": -0.2, "shift_x": 1e-3}
    both = with_effect(with_effect(SETUP, "frame_misalignment", **first), "frame_misalignment", **second)
    point = np.array([[0.01, -0.02, 0.2]])
    step = with_effect(SETUP, "frame_misalignment", **first).observation.seen(point)
    expected = with_effect(SETUP, "frame_misalignment", **second).observation.seen(step)
    np.testing.assert_allclose(both.observation.seen(point), expected, atol=1e-15)

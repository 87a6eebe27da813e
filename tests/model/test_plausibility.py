"""Implausible values, and such that do not fit together, give one warning or remark by name; real robots none."""

import math
import warnings
from dataclasses import replace
from pathlib import Path

import exudyn as exu
import numpy as np
import pytest
from robots import BACKBONE, LENGTH, paper, pull, solve, wire

import tdcr_fe
from tdcr_fe import Backbone, Load, LoadStep, Model, Spool, StribeckFriction, Superelastic, Tendon
from tdcr_fe.io.toml import read_robot, read_scenario
from tdcr_fe.model.limits import kind_of_material, limits, nearest_material
from tdcr_fe.model.messages import PlausibilityRemark, PlausibilityWarning, TDCRWarning, warnings_to
from tdcr_fe.model.plausibility import plausibility, strain_warnings, understood
from tdcr_fe.model.robot import Disks, Robot, SideSpring
from tdcr_fe.model.routing import ConvergingRouting, HelicalRouting, ParallelRouting
from tdcr_fe.validation.crosscheck import cases as crosscheck
from tdcr_fe.validation.paper import cases as paper_cases
from tdcr_fe.validation.random_robots import draw

GRAVITY = Model(gravity=(0.0, 0.0, -9.81))
WIRE = wire()
PULL = pull(3.0)


def at_tip(**load):
    return [*PULL, LoadStep(loads={"tip": Load(0.2, **load)})]


def moved(t1, t2, t3):
    return [LoadStep(displacements={"t1": t1, "t2": t2, "t3": t3})]


def drawn(**displacements):
    return [LoadStep(displacements={n: share * x for n, x in displacements.items()}) for share in (0.5, 1.0)]


def helical(turns):
    return wire(routing=lambda angle: HelicalRouting(6.5e-3, turns, angle))


def backbone(**changes):
    return WIRE.with_backbone(**changes), Model(), PULL


def tendons(**changes):
    return wire(**changes), Model(), PULL


def body(radius=12e-3, modulus=0.4e6, length=0.3, routing=ParallelRouting(9e-3), **tendon):  # noqa: B008
    """A body of silicone with a channel."""
    robot = Robot(Backbone(length, radius, modulus, 0.45), tendons=(Tendon("t1", routing, **tendon),))
    return robot, Model(), []


def soft(modulus):
    return WIRE.with_backbone(youngs_modulus=modulus), GRAVITY, at_tip(force=(0.3, 0.0, 0.0))


#: Robot, model, load steps; how the only warning begins, and how it ends, where it names a unit.
ROWS = {
    # Nothing was said of these.
    "turns in degrees": (helical(360.0), Model(), PULL, "tendons[0].turns = 360: 36 turn(s) per bay", "in deg?"),
    "angles in rad": (wire((0.0, 2.0944, 4.18879)), Model(), PULL, "tendons.angle_deg = 4.18879 deg", "in rad?"),
    "the same hole twice": (wire((0.0, 0.0)), Model(), PULL, "tendons[1]: tendons[0] and this", ""),
    "displacement of the other sign": (
        WIRE, Model(), drawn(t1=-4e-3), "steps[1].displacements.t1 = -0.004 m: it is let out and slack", ""),
    "friction in per cent": (*tendons(friction_coefficient=15.0), "tendons[0].friction_coefficient = 15:", "in %?"),
    "static friction": (
        *tendons(friction_coefficient=0.0, friction=StribeckFriction(40.0, 0.2, 1e-3)),
        "tendons[0].friction.static = 40:", "in %?"),
    "EI in N mm^2": (
        *backbone(bending_stiffness=9817.0),
        "backbone.bending_stiffness = 9817 N m^2: radius, modulus and Poisson's ratio give EI = 0.00982", "in N mm^2?"),
    "plateau in per cent": (
        *backbone(superelastic=Superelastic(1.0, 0.1)), "backbone.superelastic.threshold_strain = 1:", "in %?"),
    "mass of disks in g": (WIRE.with_disks(mass=1.2), GRAVITY, PULL, "disks.mass = 1.2 kg: a weight of 118 N", "in g?"),
    "mass of the tip in g": (replace(WIRE, tip_mass=5.0), GRAVITY, PULL, "tip_mass = 5 kg: a weight of 49", "in g?"),
    "load in gf": (WIRE, Model(), at_tip(force=(20.0, 0.0, 0.0)), "steps[1].loads.tip.force = 20 N", "gf?"),
    "gravity as a direction": (
        WIRE, Model(gravity=(0.0, 0.0, -1.0)), PULL, "model.gravity = 1 m/s^2: a direction", "in multiples of"),
    # These failed after up to 37 s, and another quantity or the size of the load steps was named.
    "E in MPa": (*soft(200e3), "backbone.youngs_modulus = 200000 Pa: as soft as rubber", "in MPa?"),
    "E in GPa": (*soft(200.0), "backbone.youngs_modulus = 200 Pa: outside", "in GPa?"),
    "tension in gf": (WIRE, Model(), pull(500.0), "steps[0].tensions.t1 = 500 N", "gf?"),
    "moment in N mm": (WIRE, Model(), at_tip(moment=(0.0, 2.0, 0.0)), "steps[1].loads.tip.moment = 2 N m", "in N mm?"),
    "radius of curvature": (*backbone(precurvature=(0.0, 500.0)), "backbone.precurvature = 500 1/m", "a radius"),
    "EI as EA": (
        *backbone(axial_stiffness=0.0098), "backbone.axial_stiffness = 0.0098 N", "is it the bending_stiffness?"),
    "E as EA": (*backbone(axial_stiffness=200e9), "backbone.axial_stiffness = 2e+11 N", "EA is 4 EI"),
    "body that is wider than its channels": (
        *body(5e-3, routing=ConvergingRouting(4e-3, 6e-3)),
        "tendons[0].end_offset = 0.006 m: outside of the backbone of radius 0.005 m at s = 0.3 m", ""),
    "E of a body in kPa": (*body(modulus=400.0), "backbone.youngs_modulus = 400 Pa: outside", "or kPa?"),
    # Others.
    "radius in mm": (*backbone(radius=0.5), "backbone.radius = 0.5 m: not thinner", "in mm or cm?"),
    "radius in cm": (*body(0.025, length=0.1), "backbone.radius = 0.025 m: larger than a fifth of the", "in cm?"),
    "radius in m for mm": (*backbone(radius=1.6e-6), "backbone.radius = 1.6e-06 m: the length is 125000", ""),
    "disks wider than long": (
        WIRE.with_disks(radius=0.12), Model(), PULL, "disks.radius = 0.12 m: larger than half the", "in mm or cm?"),
    "all lengths in mm": (
        Robot(replace(BACKBONE, length=200.0, radius=0.4), Disks.equally_spaced(13, 200.0, radius=5.0)), Model(), [],
        "backbone.length = 200 m", "in mm or cm?"),
    "density of water": (WIRE.with_backbone(density=7.8), Model(), [], "backbone.density = 7.8 kg/m^3", "in g/cm^3?"),
    "no mass": (
        WIRE.with_backbone(density=0.0).with_disks(mass=0.0), GRAVITY, PULL, "model.gravity = 9.81 m/s^2: nothing", ""),
    "gravity of no planet": (WIRE, Model(gravity=(0.0, 0.0, -981.0)), PULL, "model.gravity = 981 m/s^2: 100 times", ""),
    "EA of a tendon in kN": (*tendons(axial_stiffness=6.0), "tendons[0].axial_stiffness = 6 N: below 10 N", "in kN?"),
    "strain of a tendon": (
        wire(axial_stiffness=60.0), Model(), pull(30.0), "steps[0].tensions.t1 = 30 N: strains the tendon by 50 %", ""),
    "displacement in mm": (WIRE, Model(), drawn(t1=2.0), "steps[1].displacements.t1 = 2 m", "in mm or cm?"),
    "motor angle in degrees": (
        wire(spool=Spool(8e-3)), Model(), [LoadStep(motor_angles={"t1": 60.0})], "steps[0].motor_angles.t1 = 60 rad",
        "in deg?"),
    "a helix of two disks a turn": (helical(6.28), Model(), PULL, "tendons[0].turns = 6.28:", ""),
    "hole within the backbone": (
        wire(routing=lambda a: ParallelRouting(6.5e-6, a)), Model(), [LoadStep(loads={"tip": Load(0.2, (0.1, 0, 0))})],
        "tendons[0].offset = 6.5e-06 m: inside", ""),
    "pretension in gf": (
        wire(pretension=200.0), Model(), drawn(t1=1e-3), "tendons[0].pretension = 200 N: strains", "gf?"),
    "adhesion in mN": (*tendons(adhesion=10.0), "tendons[0].adhesion = 10 N: one hole", "gf?"),
    "E in GPa for MPa": (
        WIRE.with_backbone(youngs_modulus=4e11), Model(), pull(1e-3),
        "backbone.youngs_modulus = 4e+11 Pa: no usual material has this modulus and a density of 78", "steel"),
    "friction without holes": (
        *body(friction_coefficient=0.2), "tendons[0].friction_coefficient = 0.2: it has no effect", ""),
    "tension ten times too large": (
        soft(2e9)[0].with_backbone(density=1200.0), Model(), [LoadStep(tensions={"t1": 2.0})],
        "steps[0].tensions: together", "circles"),
}  # fmt: skip


@pytest.mark.parametrize("row", ROWS)
def test_a_value_that_no_robot_has_gives_one_warning_that_names_it_and_its_unit(row):
    robot, model, steps, begin, end = ROWS[row]
    (found,) = plausibility(robot, model, steps).warnings
    assert found.startswith(begin) and end in found, found


def test_every_limit_has_a_source_and_a_thin_robot_may_hang_down():
    assert all(row.quantity and row.source and row.says for row in limits().values())
    assert [kind_of_material(x) for x in (200e9, 60e9, 2e9)] == ["steel", "metal", "plastic"]
    assert plausibility(WIRE.with_disks(mass=0.1), Model(gravity=(0.0, 0.0, 9.81)), PULL).warnings == []
    assert len(plausibility(WIRE.with_disks(mass=0.1), GRAVITY, PULL).warnings) == 1


REFUSED = [
    (at_tip(force=(2e5, 0.0, 0.0)), "steps[1].loads.tip.force = 200000 N"),
    (pull(1e6), "steps[0].tensions.t1 = 1e+06 N"),
    (PULL, "model.gravity = 9810 m/s^2: 1000 times that of Earth; must be at most 1.2e+03 m/s^2"),
]


@pytest.mark.parametrize(("steps", "words"), REFUSED)
def test_a_load_far_beyond_the_limit_is_refused_before_solving(steps, words):
    model = Model(gravity=(0.0, 0.0, -9810.0)) if steps is PULL else Model()
    with pytest.raises(ValueError, match="beyond which a solution means nothing") as error:
        tdcr_fe.simulate(WIRE, model, steps)
    assert str(error.value).startswith(words)


def test_a_failure_names_the_implausible_input_and_no_smaller_load_steps():
    robot = replace(WIRE.with_backbone(youngs_modulus=200e3), disks=Disks.equally_spaced(3, 0.2, radius=8e-3))
    with warnings_to():
        settings = tdcr_fe.SolverSettings(max_substeps=1)
        result = tdcr_fe.simulate(robot, Model(elements_per_bay=1), PULL, settings)
    assert not result.converged and "smaller load steps" not in result.message
    assert "Check the input first: backbone.youngs_modulus = 200000 Pa" in result.message


def test_largest_tensions_in_grams_are_warned_of():
    """The search among them took minutes without a word."""
    (found,) = plausibility(WIRE, Model(), [], [], [510.0, 510.0, 510.0]).warnings
    assert found.startswith("largest tension of t1 = 510 N: strains the backbone by") and "gf?" in found
    assert plausibility(WIRE, Model(), [], [], [5.0, 5.0, 5.0]) == ([], [])


def test_warnings_reach_the_caller_in_python():
    """They were in the result only, which a script need not print."""
    robot = wire((0.0, 120.0), friction_coefficient=1.5)
    with pytest.warns(PlausibilityWarning, match="friction_coefficient") as found:
        result = tdcr_fe.simulate(robot, Model(elements_per_bay=1), [LoadStep(tensions={"t1": 2.0})])
    assert [str(w.message) for w in found] == list(result.warnings) and len(found) == 1
    assert found[0].filename == __file__
    with pytest.warns(PlausibilityWarning, match="friction_coefficient") as found:
        tdcr_fe.CreateTDCR(exu.SystemContainer().AddSystem(), robot, Model())
    assert len(found) == 1 and found[0].filename == __file__
    with pytest.warns(TDCRWarning, match="the mesh is too coarse") as found:
        settings = tdcr_fe.SolverSettings(mesh_tolerance=1e-9)
        result = tdcr_fe.simulate(paper(), Model(elements_per_bay=1), PULL, settings)
    assert [str(w.message) for w in found] == list(result.warnings)


def test_warnings_go_where_a_program_wants_them():
    texts = []
    with warnings_to(lambda text, category: texts.append(text)), warnings.catch_warnings():
        warnings.simplefilter("error")
        tdcr_fe.CreateTDCR(exu.SystemContainer().AddSystem(), wire(friction_coefficient=1.5), Model())
    assert len(texts) == 1 and texts[0].startswith("tendons[0].friction_coefficient = 1.5")


@pytest.mark.parametrize("at", [0.06, 0.2])
def test_a_side_spring_in_n_per_mm_is_remarked_on(at):
    """From 0.05 to 50 times the stiffness of the backbone."""
    for times in (0.3, 45.0):
        stiffness = times * WIRE.backbone.EI / at**3
        right, wrong = (replace(WIRE, springs=(SideSpring(at, k),)) for k in (stiffness, 1e-3 * stiffness))
        assert plausibility(right, Model(), pull(5.0)).remarks == []
        (found,) = plausibility(wrong, Model(), pull(5.0)).remarks
        assert found.startswith("springs[0].stiffness") and "in N/mm?" in found


# ------------------------------------------------------------------------------------------------- no false alarms


def test_robots_of_the_demo_the_paper_and_the_validation_give_no_warning():
    """And random ones."""
    folders = Path(tdcr_fe.__file__).parent / "data" / "demo", Path(paper_cases.__file__).parent / "data"
    files = [f for folder in folders for f in sorted(folder.rglob("*.toml"))]
    scenarios = [read_scenario(f) for f in files if f.stem == "scenario"]
    robots = [read_robot(f) for f in files if f.stem == "robot"]
    assert len(scenarios) >= 6 and len(robots) >= 10
    described = [(case.robot, case.model, case.steps) for case in (*scenarios, *crosscheck.all_cases())]
    described += [(case.robot, case.model, case.steps) for case in map(draw, range(40))]
    for case in [*described, *((robot, Model(), []) for robot in robots)]:
        assert plausibility(*case).warnings == [], case


# ------------------------------------------------------------------------------------------- strains of a solution


def test_strain_of_a_solved_arc_is_curvature_times_radius():
    """A moment M at the tip bends the rod to kappa = M / EI; the strain of the surface is kappa r (closed form)."""
    most = limits()[f"strain_{kind_of_material(BACKBONE.youngs_modulus)}"].high
    thick = replace(BACKBONE, radius=4e-3)
    robot = Robot(thick, Disks.equally_spaced(13, LENGTH, radius=5e-3))
    for strain, count in ((0.95 * most, 0), (1.05 * most, 1)):
        moment = strain / thick.radius * thick.EI
        with warnings_to():
            steps = [LoadStep(loads={"m": Load(LENGTH, moment=(0.0, moment, 0.0))})]
            found = strain_warnings(robot, solve(robot, steps, friction="none").steps)
        assert len(found) == count
    assert f"by {100 * strain:.3g} %" in found[0] and found[0].startswith("step 1: bending strains")


def test_the_turn_of_a_base_that_gives_way_is_no_strain_of_the_backbone():
    """It was reported as a strain of 756 % at s = 2.5e-06 m."""
    moment = 0.05 * BACKBONE.EI / BACKBONE.radius
    robot = Robot(BACKBONE, Disks.equally_spaced(13, LENGTH, radius=5e-3), base_stiffness=moment / 0.5)
    result = solve(robot, [LoadStep(loads={"m": Load(LENGTH, moment=(0.0, moment, 0.0))})], friction="none")
    assert strain_warnings(robot, result.steps) == []


# ------------------------------------------------------------ remarks


HELD = Model(gravity=(0.0, -9.81, 0.0))
RISE = pull(2.0, 4.0, 6.0)
SHIFTED = (*WIRE.disks.positions[:4], 0.095, *WIRE.disks.positions[5:])


REMARKS = {
    "exponent of E": (WIRE.with_backbone(youngs_modulus=20e9), HELD, RISE[:2], "backbone.youngs_modulus", "steel"),
    "EI of a diameter": (
        WIRE.with_backbone(bending_stiffness=0.05, torsional_stiffness=0.035), HELD, pull(10.0, 30.0),
        "backbone.bending_stiffness = 0.05 N m^2", "EI = 0.00982"),
    "mass of a pack": (WIRE.with_disks(mass=9e-3, thickness=1e-3), Model(), RISE, "disks.mass = 0.009", "density"),
    "tip mass in N": (replace(WIRE, tip_mass=0.196), HELD, RISE, "tip_mass = 0.196 kg: weight", "sags"),
    "no gravity": (replace(WIRE, tip_mass=0.1), Model(), RISE, "model.gravity = 0 m/s^2", "masses"),
    "a tenth of gravity": (WIRE, Model(gravity=(0.0, 0.0, 0.981)), RISE, "model.gravity = 0.981", "9.81"),
    "a disk elsewhere": (WIRE.with_disks(positions=SHIFTED), HELD, RISE, "disks.positions[4] = 0.095 m", "0.02 m"),
    "upright, not hanging": (replace(WIRE, tip_mass=0.05), GRAVITY, RISE, "tip_mass = 0.05 kg", "along +z"),
    "load in gf": (
        WIRE.with_backbone(youngs_modulus=60e9, density=6450.0), HELD,
        [*RISE, LoadStep(loads={"tip": Load(0.2, (0.0, 0.0, 5.0))})], "steps[3].loads.tip.force", "gf?"),
    "tip at 0.02": (
        WIRE, HELD, [*RISE, LoadStep(loads={"tip": Load(0.02, (0.0, 0.2, 0.0))})], "steps[3].loads.tip.at", "tip"),
    "load at the base": (
        WIRE, HELD, [*RISE, LoadStep(loads={"push": Load(0.0, (0.0, 0.2, 0.0))})], "steps[3].loads.push.at", "base"),
    "pretension": (
        WIRE.with_tendons(pretension=15.0), HELD, moved(2e-3, -1e-3, -1e-3), "tendons[0].pretension = 15", "alone"),
    "force and moment": (
        WIRE, HELD, [*RISE, LoadStep(loads={"tip": Load(0.2, moment=(0.0, 0.1, 0.0))})],
        "steps[3].loads.tip.moment = 0.1 N m", "right angle"),
}  # fmt: skip


@pytest.mark.parametrize("row", REMARKS)
def test_what_does_not_fit_together_gets_one_remark_and_no_warning(row):
    described, model, steps, begin, words = REMARKS[row]
    assert plausibility(described, model, steps).warnings == []
    found = plausibility(described, model, steps).remarks
    assert len(found) == 1 and found[0].startswith(begin) and words in found[0], found


CATHETER = Backbone(0.1, 2.3e-3, 50e6, 0.45, 1050.0)
CHANNELS = tuple(Tendon(f"t{k}", ParallelRouting(1.9e-3, 90.0 * k), 0.1) for k in range(1, 5))
RIGHT = {
    "guides in a body": (Robot(CATHETER, Disks.equally_spaced(40, 0.1), CHANNELS), Model(), RISE),
    "guides as wide as the body": (
        Robot(CATHETER, Disks.equally_spaced(40, 0.1, radius=2.3e-3), CHANNELS), Model(), RISE),
    "a pull between two of a pretension": (WIRE, HELD, pull(0.4, 4.0, 0.4)),
    "released, and pulled again": (WIRE, HELD, pull(0.5, 1.0, 2.0, 0.5, 0.0, 0.1, 1.0, 2.0)),
    "a thick body": (Robot(Backbone(0.1, 0.018, 0.4e6, 0.45, 1070.0)), Model(), []),
    "a thin wire": (Robot(Backbone(0.8, 1e-5, 200e9, 0.3)), Model(), []),
    "wide disks": (WIRE.with_disks(radius=0.08, mass=0.0), Model(), PULL),
    "tips of two segments": (
        WIRE.with_tendons(["t1"], end=0.1), HELD,
        [*RISE, LoadStep(loads={"tip1": Load(0.1, (0.0, 0.2, 0.0)), "multiple": Load(0.1)})]),
    "nylon pulled by tensions": (WIRE.with_tendons(axial_stiffness=80.0), HELD, RISE),
    "a soft robot": (
        Robot(Backbone(0.12, 0.01, 0.2e6, 0.5, 1070.0), tendons=(Tendon("t1", ParallelRouting(6e-3)),)),
        Model("continuous", "none"), pull(2.0)),
    # Of three tendons at 120 degrees, one takes up what the others are pulled in; of two, opposite ones the same.
    "antagonists of three": (WIRE, HELD, drawn(t1=-4e-3, t2=2e-3, t3=2e-3)),
    "antagonists of two": (wire((0.0, 180.0)), HELD, drawn(t1=4e-3, t2=-4e-3)),
    "let out under a weight": (WIRE, Model(gravity=(9.81, 0.0, 0.0)), drawn(t1=-1e-3)),
}  # fmt: skip
for at in ((0.0,), (0.0, 180.0), (0.0, 90.0), (0.0, 120.0, 240.0), (0.0, 90.0, 180.0, 270.0)):
    RIGHT[f"tendons at {at}, pulled"] = (wire(at), HELD, RISE)
    RIGHT[f"tendons at {at}, moved"] = (wire(at), HELD, drawn(t1=3e-3))


@pytest.mark.parametrize("case", RIGHT)
def test_what_some_real_robots_have_gets_no_remark_and_no_warning(case):
    assert plausibility(*RIGHT[case]) == ([], [])


def test_materials_are_known_by_modulus_and_density():
    known = {
        "steel": (207e9, 7850.0), "NiTi": (60e9, 6450.0), "glass fibre": (40e9, 2000.0), "plastic": (2.3e9, 1140.0),
        "carbon fibre": (130e9, 1600.0), "rubber": (0.2e6, 1070.0), "copper or brass": (110e9, 8500.0),
    }  # fmt: skip
    assert {name: nearest_material(*row)[0] for name, row in known.items()} == {name: name for name in known}


def test_a_taper_and_channels_that_converge_are_part_of_what_is_said_to_bend():
    """Inputs of a tapered silicone arm bent it 2.8 times as far as was said."""
    body = Backbone(0.3, 12e-3, 0.4e6, 0.48, taper=((0.0, 12e-3), (0.3, 6e-3)))
    described = Robot(body, tendons=(Tendon("t1", ConvergingRouting(9e-3, 4e-3)),))
    tension = float(understood(described, Model())[1].split()[2])
    pull, let_in = LoadStep(tensions={"t1": tension}), LoadStep(displacements={"t1": 2e-3})
    said = float(understood(described, Model(), [let_in])[-1].split()[6])
    result = solve(described, [pull, let_in], friction="none", tendon_path="continuous")
    assert np.degrees(result.bending_angles) == pytest.approx([90.0, said], rel=5e-3)


def test_displacements_that_are_said_to_bend_do():
    """A bend a towards x takes in r a cos(phi) of a tendon at the angle phi (closed form)."""
    for sign, towards in ((1.0, 0), (-1.0, 180)):
        far = sign * 0.5 * 6.5e-3
        line = understood(WIRE, GRAVITY, drawn(t1=far, t2=-0.5 * far, t3=-0.5 * far))[-1]
        assert f"{math.degrees(0.5):.3g} degrees, towards {towards} degrees" in line


def test_a_weight_that_is_said_to_sag_does():
    """A cantilever under its own weight sags by W L^3 / 8 EI (closed form)."""
    described = replace(WIRE, tendons=()).with_disks(mass=0.0, thickness=0.0)
    (line,) = understood(described, HELD)
    assert "like steel" in line and "sideways" in line
    sag = 1e-3 * float(line.split("sags by ")[1].split()[0])
    result = solve(described, [LoadStep()], friction="none", gravity=HELD.gravity)
    assert -result.steps[0].tip[1] == pytest.approx(sag, rel=1e-2)  # shear and three digits


def test_remarks_reach_the_caller_in_python_by_their_own_category():
    with pytest.warns(PlausibilityRemark, match="most distances are") as found:
        result = tdcr_fe.simulate(WIRE.with_disks(positions=SHIFTED), Model(elements_per_bay=1), RISE[:1])
    assert [str(w.message) for w in found] == list(result.remarks) and result.warnings == ()
    assert found[0].filename == __file__

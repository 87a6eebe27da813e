"""What is refused: every wrong value is named, with what is allowed. Mistakes in files are in tests/io."""

from dataclasses import replace

import exudyn as exu
import exudyn.graphics as graphics
import exudyn.itemInterface as eii
import numpy as np
import pytest
from contacts import QUAD
from robots import BACKBONE, DISKS, paper, three
from scenes import HEAVY, TURN, scene, solve_scene, system

import tdcr_fe as tdcr
from tdcr_fe import Backbone, InputPrior, Load, LoadPrior, LoadStep, Model, Robot, Tendon, TensionLimits
from tdcr_fe.effects import Experiment, with_effect
from tdcr_fe.io.measured import MeasuredData
from tdcr_fe.model.channels import channel
from tdcr_fe.model.robot import SideSpring, TightHole
from tdcr_fe.sweeps.description import Normal, Range
from tdcr_fe.validation.reference import ReferenceSettings, solve_reference

NAN = float("nan")
PARALLEL = tdcr.ParallelRouting(4e-3)
FREE = Model(friction="none")
CONTINUOUS = Model("continuous", "none")
SOFT = Robot(Backbone(0.3, 12e-3, 0.4e6, 0.45), tendons=(Tendon("a", tdcr.ConvergingRouting(9e-3, 3e-3)),))
PULL = [LoadStep(tensions={"t1": 1.0})]
STRIBECK = tdcr.StribeckFriction(0.4, 0.2, 1e-3)
AT_STEP_9 = tdcr.Reading(9, "tip_offset", None, 0.03)


def patched(start, end):
    return Robot(replace(BACKBONE, patches=(tdcr.StiffnessPatch(start, end),)), DISKS)


def changed(name, **values):
    return with_effect(Experiment(three(0.2), Model(), tuple(PULL)), name, **values)


def follow(limits=None, targets=((0.0, 0.0, 0.2),), robot=None, **options):
    return tdcr.follow_path(robot or three(), FREE, targets, limits or TensionLimits(1.0), **options)


def estimator(load=None, inputs=None):
    return tdcr.Estimator(three(), Model(), load or LoadPrior(), inputs or InputPrior(0.01))


def reads(*reading):
    return estimator().step(LoadStep(time=0.0), [tdcr.Reading(1, *reading)])


def differentiated(*names):
    return tdcr.simulate(three(0.2), Model(elements_per_bay=1), PULL, sensitivities=list(names))


def tracked(name, before=0.0, **backbone):
    """Derivatives that begin after a pull [N]; what is refused has moved nothing."""
    _container, mbs, arm = scene(three(0.2).with_backbone(**backbone))
    solve_scene(mbs, arm, {"t1": before})
    arm.set_tensions({"t1": 2.0})
    try:
        mbs.SolveTDCR(sensitivities=[tdcr.track_sensitivities(arm, [name])])
    finally:
        assert arm.tensions()["t1"][0] == before


DESCRIPTIONS = [
    (lambda: replace(BACKBONE, precurvature=(0.0, NAN)), r"Backbone.precurvature\[1\] = .*two finite numbers \[1/m\]"),
    (lambda: Backbone("0.25", 0.4e-3, 85e9, 0.3), r'Backbone.length = "0.25": must be a positive number \[m\]'),
    (lambda: patched(0.1, 0.3), r"patches\[0\].end: 0.3; beyond the tip; at most 0.25 m"),  # accepted in 0.1
    (lambda: patched(0.1, 0.1), r"patches\[0\].end: 0.1; must be above start"),
    (lambda: Robot(BACKBONE, DISKS, ([1],)), r"Robot.tendons\[0\] = \[1\]: must be of type Tendon"),
    (lambda: Robot(BACKBONE, DISKS, Tendon("t", PARALLEL)), r"Robot.tendons = .*: must be a sequence of Tendon"),
    (lambda: Tendon("t", PARALLEL, -0.1, adhesion=-1.0), "friction_coefficient = -0.1.*\n*.*adhesion = -1.0"),
    (lambda: three().with_disks(radius=8e-3).with_tendons(clearance=0.1), r"tendons\[0\].clearance: 0.1; .*0.008 m"),
    (lambda: three().with_tendons(pretension=0.5), r"tendons\[0\].pretension: 0.5; needs an elastic tendon"),
    (lambda: three().with_tendons(tight_holes=(TightHole(0.1, 1.0),)), r"tight_holes\[0\].at: 0.1; must be at a disk"),
    (lambda: replace(three(), springs=(SideSpring(0.3, 1.0),)), "beyond the tip"),
    (lambda: SOFT.with_tendons(["a"], end=0.31), r"tendons\[0\].end: 0.31; beyond the tip"),
    (lambda: SOFT.with_tendons(["a"], clearance=1e-3), r"clearance: given; a robot without disks has no holes"),
    (lambda: Model(elements_per_bay=0), 'elements_per_bay = 0: must be "auto" or a whole number from 1 to 64'),
    (lambda: Model("continuous", "per-tendon"), "has no friction"),
    (lambda: LoadStep(tensions={"t1": NAN}), "LoadStep.tensions.t1 = .*zero or more"),
    (lambda: Normal(0.0, -1.0), "must be a positive number"),
    (lambda: Normal(0.0, 1.0, lower=40.0), "leave out the whole distribution"),
    (lambda: Range(-1.0, 1.0, 3, "logarithmic"), "both positive or both negative"),
    (lambda: ReferenceSettings(substeps=0), "substeps = 0"),
    (lambda: channel("strain"), "curvature_x"),
    (lambda: MeasuredData("x", three(), FREE, (1,), (LoadStep(),), ("",), (AT_STEP_9,)), "step 9"),
]  # fmt: skip
EFFECTS = [
    (lambda: changed("magic", x=1.0), "there are"),
    (lambda: changed("friction_coefficient", nu=1.0), "it has mu"),
    (lambda: changed("actuator_loss", efficiency=2.0), r"from 0\.3 to 1"),
    (lambda: changed("pretension", tension=1.5), "no tendon is elastic"),
    (lambda: changed("soft_bay", s=0.3, factor=0.5), "s = 0.3 m is not on the backbone"),
    (lambda: changed("side_spring", s=0.3, stiffness=1.0), "at most 0.25 m"),
    (lambda: changed("stuck_hole", tendon=1, s=0.1), "no hole there; the nearest is at 0.0961538 m"),
    (lambda: changed("stuck_hole", tendon=7, s=0.1), "the robot has 3"),
]
SOLVES = [
    (lambda: tdcr.simulate(three(), FREE, PULL[0]), "steps is of type LoadStep; expected a list"),
    (lambda: tdcr.simulate(three(), FREE, [{"tensions": {"t1": 1.0}}]), r"steps\[0\] is of type dict; expected"),
    (lambda: tdcr.Disks.equally_spaced(0.2, 10), "count is of type float; expected a whole number"),
    (lambda: tdcr.simulate(three(), FREE, [LoadStep("", {"T1": 1.0})]), r"steps\[0\].tensions.T1 .* unknown .* t1\?"),
    (lambda: tdcr.simulate(three(), Model(), [LoadStep("", {"t1": 1.0}, {"t1": 1e-3})]), "a tension in the same step"),
    (lambda: tdcr.simulate(three(), Model(), [LoadStep(loads={"far": Load(0.3)})]), "0.25 m"),
    (lambda: tdcr.simulate(three(), Model(elements_per_bay=(1, 2)), PULL), "elements_per_bay"),
    (lambda: tdcr.simulate(SOFT, Model(), [LoadStep()]), r'model\.tendon_path = "straight".*follow the backbone'),
    (lambda: tdcr.simulate(replace(three(), base_stiffness=0.5), CONTINUOUS, PULL), "pass no base that gives way"),
    (lambda: solve_reference(three(0.0, friction=STRIBECK), Model(), PULL), "friction law 'stribeck' of tendon 't1'"),
    (lambda: solve_reference(three(0.0, clearance=1e-4), CONTINUOUS, PULL), "clearance"),
    (lambda: tdcr.live("robot.toml"), "read_robot"),
    (lambda: tdcr.Estimator("robot.toml", Model(), LoadPrior(), InputPrior(0.01)), "read_robot"),
    (lambda: differentiated("backbone.raduis"), "names no number; did you mean backbone.radius"),
    (lambda: differentiated("tendons.t1.axial_stiffness"), "inextensible"),
    (lambda: differentiated("effects.rigid_disks.thickness"), "the mesh has other nodes"),
    (lambda: differentiated("effects.frame_misalignment.rot_x"), "measurement only"),
    (lambda: differentiated("disks.positions[12]"), "at the tip"),
    (lambda: differentiated("loads.nowhere.force_x"), "no step names the load"),
    (lambda: differentiated("steps[0].substeps"), "names no number"),
    (lambda: differentiated("backbone.radius", "backbone.radius"), "named twice"),
    (lambda: tdcr.simulate(three(), Model(), PULL, sensitivities="backbone.radius"), "must be a list of names"),
    (lambda: tracked("steps[0].tensions.t1"), "names no number"),
    (lambda: tracked("effects.actuator_gain.gain"), "a scene has no load steps"),
    (lambda: tracked("backbone.radius", creep_rate=0.1), "creeps"),
    (lambda: tracked("backbone.radius", before=1.0), "robot 'three': holes slipped in a SolveTDCR without these"),
    (lambda: follow(TensionLimits(1.0, 2.0)), "above the largest tension"),
    (lambda: follow(TensionLimits({"t1": 1.0})), "tendon t2 is missing"),
    (lambda: follow(TensionLimits(np.inf)), "zero or more"),
    (lambda: follow(3.0), "TensionLimits"),
    (lambda: follow(tolerance=0.0), "above 0, below the length"),
    (lambda: follow(targets=[[1.0, 2.0]]), r"shape \(n, 3\)"),
    (lambda: follow(robot=replace(paper(), tendons=())), "no tendons"),
    (lambda: tdcr.TipTarget((0.0, 0.0, 0.2), (0.0, 0.0, 0.0)), "must not be zero"),
    (lambda: LoadPrior(sigma=0.0), "sigma = 0"),
    (lambda: estimator(load=LoadPrior(at=0.3)), "at most the length"),
    (lambda: estimator(inputs=InputPrior(sigma={"t1": 0.1})), "t2 is missing; tendon t3 is missing; the robot has t1"),
    (lambda: estimator().step(LoadStep(), ()), "time = None: must be given"),
    (lambda: reads("position_x", 0.25, 0.0), "deviation above zero"),
    # A place in mm was taken for the tip; another tendon was "not in tuple".
    (lambda: reads("position_x", 250.0, 0.0, 1e-4), "step 1: reading of position_x: location = 250.0: must be an arc"),
    (lambda: reads("position_x", "t9", 0.0, 1e-4), "step 1: reading of position_x: location = t9: must be an arc"),
]  # fmt: skip


def created(**given):
    """A robot in a scene, to which nothing is added where an argument is wrong."""
    _container, mbs = system()
    try:
        tdcr.CreateTDCR(mbs, three(0.0), **given)
    except (ValueError, TypeError):
        assert mbs.systemData.NumberOfNodes() == 0
        raise


def on_a_body(**given):
    """A robot on a marker that is turned and moved."""
    _container, mbs = system()
    turned = exu.HT(rotation=TURN, translation=[0.5, 0.0, 0.1])
    marker = eii.MarkerBodyRigid(bodyNumber=mbs.CreateGround(), localHT=turned)
    tdcr.CreateTDCR(mbs, three(0.0), baseMarker=mbs.AddMarker(marker), **given)


def used(call, assemble=False):
    """What is done with a robot in a scene."""
    _container, mbs, handle = scene(three(0.0), assemble=assemble)
    call(mbs, handle)


def wound(call):
    return used(lambda mbs, arm: [arm.add_motor("t1", 1.0, 1.0), call(mbs, arm)])


def touched(stiffness=1.0, **given):
    return used(lambda mbs, arm: arm.add_disk_contact(mbs.CreateGround(), stiffness, **given))


def without_robot():
    _container, mbs = system()
    tdcr.SolveTDCR(mbs)


SPHERE = graphics.Sphere(radius=0.1)
BALL = {"sphereRadius": 0.01}
BESIDE = {"sphereRadius": 0.002, "localPosition": [0.1, 0.0, 0.1], "backbone": False}
SCENES = [
    (lambda: created(initialVelocity=[0.1, 0.0, 0.0]), "a base on ground has no velocity"),
    (lambda: created(gravity=HEAVY, model=Model(gravity=tuple(HEAVY))), "by the argument and by the model"),
    (lambda: created(color=[2.0, 0.0, 0.0, 1.0]), "four numbers from 0 to 1"),
    (lambda: created(loadPositions=[0.3]), "0 to 0.25 m"),
    (lambda: created(loadPositions=["1 mm"]), r'loadPositions\[0\] = "1 mm": must be a list of finite numbers, in m'),
    (lambda: created(referenceRotationMatrix=2.0 * np.eye(3)), "must be a rotation"),
    (lambda: created(referenceRotationMatrix=np.diag([1.0, 1.0, -1.0])), "reflection"),
    (lambda: created(graphicsDataList=SPHERE), "graphicsDataList = .*: must be a list of graphics"),
    (lambda: created(graphicsDataList=[0.1]), r"graphicsDataList\[0\] = 0.1: must be a list of graphics"),
    (lambda: created(show="no"), 'show = "no": must be True, or False, which draws nothing'),
    (lambda: created(referencePosition=[0, 1]), r"referencePosition = \[0, 1\]: must be three finite numbers, in m"),
    (lambda: on_a_body(graphicsDataList=[SPHERE]), "graphicsDataList is drawn on the base"),
    (lambda: on_a_body(referencePosition=[0.0, 0.0, 0.0]), "referencePosition .* differs from that of baseMarker"),
    (lambda: on_a_body(referenceRotationMatrix=np.eye(3)), "referenceRotationMatrix .* differs from"),
    (lambda: used(lambda mbs, arm: tdcr.CreateTDCR(mbs, three())), "another name"),
    (without_robot, "CreateTDCR"),
    (lambda: used(lambda mbs, arm: tdcr.SolveTDCR(mbs)), "Assemble"),
    (lambda: used(lambda mbs, arm: arm.tip_position), r"mbs\.Assemble"),
    (lambda: used(lambda mbs, arm: arm.set_tensions({"x": 1.0})), "no tendon 'x'"),
    (lambda: used(lambda mbs, arm: arm.set_tensions([1.0, 2.0])), "2 values for 3 tendons"),
    (lambda: used(lambda mbs, arm: arm.set_tensions({"t1": -1.0})), "tension >= 0"),
    (lambda: used(lambda mbs, arm: arm.set_displacements({"t1": NAN})), "finite"),
    # These were raw errors of Python, or went through: "123" as three tensions.
    (lambda: used(lambda mbs, arm: arm.set_tensions(1.0)), "set_tensions.tensions = 1.0: must be a list of one"),
    (lambda: used(lambda mbs, arm: arm.set_tensions("123")), 'set_tensions.tensions = "123": must be a list'),
    (lambda: used(lambda mbs, arm: arm.recommended_settings("1", 1e-3)), 'end_time = "1": must be a positive number'),
    (lambda: used(lambda mbs, arm: tdcr.track_sensitivities(mbs, ["inputs.t1"])), "arm is of type MainSystem"),
    (lambda: used(lambda mbs, arm: tdcr.track_sensitivities(arm, 5)), "sensitivities = 5: must be a list of names"),
    (lambda: used(lambda mbs, arm: tdcr.track_sensitivities(arm, [5])), "'5' names no parameter"),
    (lambda: used(lambda mbs, arm: tdcr.local_response(mbs)), "where is of type MainSystem; expected a Simulation, or"),
    (lambda: used(lambda mbs, arm: arm.set_compliance_factor("a")), 'factor = "a": must be a positive number'),
    (lambda: used(lambda mbs, arm: mbs.SolveTDCR(sensitivities=arm), True), "sensitivities is of type TDCR; expected"),
    (lambda: used(lambda mbs, arm: mbs.SolveTDCR(endTime=-1), True), "endTime = -1 s; must not be before"),
    (lambda: used(lambda mbs, arm: mbs.TDCRLinearized(sensors=3), True), "sensors is of type int; expected a list"),
    (lambda: used(lambda mbs, arm: arm.set_inputs_over_time([1.0, 0.0, 0.0])), "needs a function of the time"),
    (lambda: used(lambda mbs, arm: arm.recommended_settings(1.0, 2.0)), "recommended_settings"),
    (lambda: used(lambda mbs, arm: arm.recommended_settings(NAN, 1e-3)), "recommended_settings"),
    (lambda: used(lambda mbs, arm: arm.add_load("y", 0.124)), "nearest"),
    (lambda: used(lambda mbs, arm: [arm.add_load("x", 0.25) for _ in range(2)]), "already"),
    # A force that is no number was "singular matrix".
    (lambda: used(lambda mbs, arm: arm.add_load("x", 0.25).set([NAN, 0.0, 0.0])), r"force\[0\] = nan: .*finite number"),
    (lambda: used(lambda mbs, arm: arm.add_motor("t1", 0.0, 1.0)), "inertia = 0.0"),
    (lambda: used(lambda mbs, arm: arm.add_motor("t1", 1.0, -1.0)), "radius = -1.0"),
    (lambda: wound(lambda mbs, arm: arm.add_motor("t1", 1.0, 1.0)), "has a motor already"),
    (lambda: wound(lambda mbs, arm: [mbs.Assemble(), mbs.SolveTDCR()]), "SolveTDCR: .* 'three' is wound by a motor"),
    # It left the motor turning without its tendon.
    (lambda: wound(lambda mbs, arm: arm.set_tensions({"t1": 1.0})), "tendon 't1' is wound by a motor"),
    (lambda: used(lambda mbs, arm: mbs.TDCREigenvalues(holes="free"), True), "must be 'stuck' or 'sliding'"),
    (lambda: used(lambda mbs, arm: arm.add_disk_contact(arm, 1.0), True), r"before mbs.Assemble\(\)"),
    (lambda: used(lambda mbs, arm: arm.add_disk_contact(3, 1.0, **BALL)), "other is of type int"),
    (lambda: used(lambda mbs, arm: arm.add_disk_contact(arm, 1.0, **BALL)), "without sphereRadius"),
    (lambda: touched(-1.0, **BALL), "contactStiffness"),
    (lambda: touched(), "sphereRadius or quadPoints"),
    (lambda: touched(sphereRadius=0.1), "overlap by .* mm"),
    (lambda: touched(**BESIDE), "through the backbone between disk 1 of 'three' and disk 2 of 'three'"),
    (lambda: touched(quadPoints=QUAD[:3]), "four points"),
    (lambda: touched(quadPoints=[*QUAD[:3], [0.1, 0.2, 0.0]]), "not in one plane"),
    (lambda: touched(quadPoints=[QUAD[k] for k in (0, 1, 3, 2)]), "around a convex quadrangle"),
    (lambda: touched(**BALL, localPosition=[0.1, 0, 0], dynamicFriction=-0.1), "dynamicFriction = -0.1"),
]  # fmt: skip


@pytest.mark.parametrize(("call", "words"), [*DESCRIPTIONS, *EFFECTS, *SOLVES, *SCENES])
def test_what_cannot_be_is_refused_with_what_is_allowed(call, words):
    with pytest.raises((ValueError, TypeError, KeyError), match=words):
        call()

"""Derivatives by parameters equal central differences of whole simulations along the same substeps."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from differences import TOLERANCE, check, run
from robots import BACKBONE, LENGTH, tendon

from tdcr_fe import Experiment, SequenceResult, StribeckFriction, simulate, with_effects
from tdcr_fe.model.backbone import StiffnessPatch, Superelastic
from tdcr_fe.model.loading import Load, LoadStep, Model, SolverSettings
from tdcr_fe.model.robot import Disks, Robot, SideSpring, Spool, TightHole
from tdcr_fe.model.routing import ConvergingRouting, HelicalRouting
from tdcr_fe.solve.sensitivities.parameters import ModelParameter, effect_parameter, parameters
from tdcr_fe.solve.sensitivities.sensitivity import _load_factor_change
from tdcr_fe.validation.random_robots import draw

DISKS = Disks.equally_spaced(5, LENGTH, mass=2e-4, radius=5e-3)


def robot(mu: float = 0.25, **rest: object) -> Robot:
    """Three tendons through five disks; one winds, one converges and ends at the fourth disk."""
    tendons = (
        tendon("t1", 0.0, mu, **rest),
        replace(tendon("t2", 0.0, mu, **rest), routing=HelicalRouting(4.5e-3, 0.3, 110.0)),
        replace(tendon("t3", 0.0, mu, **rest), routing=ConvergingRouting(4.5e-3, 2e-3, -130.0), end=0.2),
    )
    return Robot(BACKBONE, DISKS, tendons, "three")


def by_tension(scale: float = 1.0) -> tuple[LoadStep, ...]:
    """Pulled, loaded at the tip, released in part and pulled again, so that holes reverse one after the other."""
    tip = {"tip": Load(LENGTH, (0.01, 0.02, 0.0), (0.0, 5e-4, 3e-4))}
    inside = {"middle": Load(0.07, (0.02, 0.0, 0.01), (0.0, 0.0, 5e-4), "section")}
    return (
        LoadStep("", {"t1": 1.2 * scale, "t2": 0.3 * scale}, substeps=2, time=1.0),
        LoadStep("", {"t1": 0.9 * scale}, loads=tip, substeps=2, time=2.0),
        LoadStep("", {"t1": 0.5 * scale, "t3": 0.6 * scale}, loads=inside, substeps=2, time=3.0),
        LoadStep("", {"t1": 1.0 * scale, "t2": 0.5 * scale}, substeps=2, time=4.0),
    )


def by_displacement(end: float | None = 5.0) -> tuple[LoadStep, ...]:
    """From tensions to displacements and back, with a reversal."""
    return (
        LoadStep("", {"t1": 0.8, "t2": 0.2}, substeps=2, time=1.0),
        LoadStep("", {"t1": 0.9}, displacements={"t2": 1e-3}, substeps=2, time=2.0),
        LoadStep("", displacements={"t1": 3e-3, "t2": 0.5e-3}, substeps=2, time=3.0),
        LoadStep("", displacements={"t1": 2e-3, "t2": 1.1e-3}, substeps=2, time=4.0),
        LoadStep("", {"t1": 0.3}, substeps=2, time=end),
    )


def tightened() -> tuple[LoadStep, ...]:
    """At displacement zero, then one tendon pulled in and the others let out, and back."""
    moved = (0.0, 0.0, 0.0), (2e-3, -6e-4, -5e-4), (1.2e-3, 2e-4)
    given = [dict(zip(("t1", "t2", "t3"), each, strict=False)) for each in moved]
    return tuple(LoadStep("", displacements=x, substeps=2, time=1.0 + k) for k, x in enumerate(given))


def by_motor() -> tuple[LoadStep, ...]:
    """The same displacements as `by_displacement`, wound on spools."""
    wound = [(s, {n: d / 8e-3 for n, d in s.displacements.items()}) for s in by_displacement()]
    return tuple(replace(s, displacements={}, motor_angles=angles) for s, angles in wound)


def coarse(of: Robot, steps: tuple[LoadStep, ...], **model: object) -> Experiment:
    """With one element a bay."""
    return Experiment(of, Model(**{"elements_per_bay": 1, **model}), steps)


SOFTENING = Superelastic(8e-4, 0.4)
ASKEW = (0.5, 1.0, -9.81)
SLIPPING = robot(0.0, friction=StribeckFriction(0.3, 0.2, 1e-3, 2.0, 1.0), axial_stiffness=400.0)
PATCH = StiffnessPatch(0.1, 0.15, 0.5, 1.0, (1.0, -2.0))
AT_PLACES = robot(tight_holes=(TightHole(0.15, 0.1),)).with_backbone(patches=(PATCH,))
EXPERIMENTS = {
    "no friction": coarse(robot(0.0), by_tension(), friction="none", elements_per_bay=2, gravity=ASKEW),
    "per hole": coarse(robot(), by_tension()),
    "per tendon": coarse(robot(), by_tension(), friction="per-tendon"),
    "elastic, adhesion": coarse(robot(axial_stiffness=400.0, adhesion=0.01), by_tension()),
    "displacements": coarse(robot(axial_stiffness=400.0), by_displacement()),
    "pretension": coarse(robot(axial_stiffness=400.0, pretension=0.4), tightened()),
    "places": coarse(replace(AT_PLACES, springs=(SideSpring(0.15, 1.5),), base_stiffness=0.3), by_tension()),
    "taper": coarse(
        robot().with_backbone(taper=((0.0, 4e-4), (0.1, 3.5e-4), (LENGTH, 2.5e-4))), by_tension(0.4), gravity=ASKEW),
    "inextensible, displacements": coarse(robot(), by_displacement()),
    "motors": coarse(robot(spool=Spool(8e-3, 2e3)), by_motor()),
    "clearance": coarse(robot(clearance=2e-4), by_tension()),
    "superelastic, creep": coarse(
        robot().with_backbone(superelastic=SOFTENING, creep_rate=0.02, precurvature=(0.3, -0.4)), by_tension()),
    "continuous": coarse(
        robot(0.0, axial_stiffness=400.0).with_backbone(superelastic=SOFTENING), by_displacement(),
        friction="none", tendon_path="continuous", gravity=(1.0, 0.0, -9.81)),
    "Dahl": coarse(robot(axial_stiffness=2000.0), by_tension(), hysteresis="dahl"),
    "Stribeck": coarse(SLIPPING, by_displacement()),
    # Inserts are 1e5 times stiffer than the backbone; their round-off in the tangent was 1e-4 of the tensions.
    "thick disks": coarse(robot().with_disks(thickness=2e-3), by_tension()),
    # No time passes in the last step, so that the rates of the step before stay.
    "Stribeck, at once": coarse(SLIPPING, by_displacement(4.0)),
    "Stribeck, without a time": coarse(SLIPPING, by_displacement(None)),
}  # fmt: skip

#: A few parameters of each experiment; `test_every_parameter` has the rest, and the campaign `net` those of effects.
FAST = {
    "no friction": ["backbone.length", "disks.positions[2]", "steps[2].loads.middle.moment[2]"],
    "per hole": ["tendons.friction_coefficient", "tendons.t1.offset", "steps[1].loads.tip.force[1]"],
    "per tendon": ["backbone.youngs_modulus"],
    "elastic, adhesion": ["tendons.adhesion"],
    "displacements": ["steps[1].displacements.t2", "tendons.axial_stiffness"],
    "motors": ["tendons.t1.spool.radius", "tendons.t1.spool.stiffness", "steps[1].motor_angles.t2"],
    "pretension": ["tendons.pretension", "effects.pretension.tension_t2"],
    "places": ["springs[0].stiffness", "base_stiffness", "backbone.patches[0].precurvature[1]",
        "tendons.t1.tight_holes[0].drop"],
    "taper": ["backbone.taper[1][1]"],
    "inextensible, displacements": ["tendons.t2.turns"],
    "clearance": ["tendons.clearance"],
    "superelastic, creep": ["backbone.superelastic.threshold_strain"],
    "continuous": ["tendons.t2.angle_deg"],
    "Dahl": ["backbone.youngs_modulus"],
    "Stribeck": ["tendons.friction.kinetic"],
}  # fmt: skip

#: What every experiment has, and further parameters of some.
OF_ALL = ("backbone.youngs_modulus", "backbone.length", "tendons.t1.offset")
SLOW = {
    "no friction": [
        "backbone.radius", "backbone.poisson_ratio", "backbone.density", "backbone.bending_stiffness",
        "backbone.torsional_stiffness", "backbone.axial_stiffness", "backbone.shear_stiffness",
        "backbone.precurvature[0]", "disks.mass", "tip_mass", "model.gravity[2]", "tendons.t3.end_offset"],
    "per hole": ["disks.positions[2]", "steps[0].tensions.t1", "steps[2].tensions.t3"],
    "per tendon": ["tendons.friction_coefficient"],
    "elastic, adhesion": ["tendons.axial_stiffness", "tendons.friction_coefficient"],
    "displacements": ["tendons.friction_coefficient", "steps[0].tensions.t1", "steps[2].displacements.t1"],
    "pretension": ["tendons.axial_stiffness", "tendons.friction_coefficient", "steps[1].displacements.t2"],
    "taper": ["backbone.density", "backbone.taper[2][1]"],
    "places": ["backbone.patches[0].bending"],
    "superelastic, creep": [
        "backbone.superelastic.plateau_ratio", "backbone.creep_rate", "backbone.radius", "steps[1].time",
        "backbone.precurvature[0]", "tendons.friction_coefficient"],
    "continuous": ["tendons.axial_stiffness", "backbone.superelastic.plateau_ratio", "steps[1].displacements.t2"],
    "Stribeck": [
        "tendons.friction.static", "tendons.friction.stribeck_rate", "tendons.friction.exponent",
        "tendons.friction.viscous", "steps[2].time"],
    "thick disks": ["disks.thickness"],
    "Stribeck, at once": ["tendons.friction.viscous", "steps[1].tensions.t1"],
    "Stribeck, without a time": ["tendons.friction.viscous", "steps[1].tensions.t1"],
}  # fmt: skip


@pytest.mark.parametrize(("name", "parameter"), [(n, p) for n, own in FAST.items() for p in own])
def test_derivatives_are_those_of_whole_simulations(name: str, parameter: str) -> None:
    """Nodes, rotations, tensions, displacements and slips, at every step of histories with reversals."""
    check(EXPERIMENTS[name], parameter)


EVERY = [(n, p) for n in EXPERIMENTS for p in (*OF_ALL, *SLOW.get(n, ()))]


@pytest.mark.campaign
@pytest.mark.parametrize(("name", "parameter"), EVERY)
def test_every_parameter(name: str, parameter: str) -> None:
    """The same for all kinds of parameters."""
    check(EXPERIMENTS[name], parameter, (1e-4, 1e-3, 1e-5, 1e-2))


def reversal_errors(experiment: Experiment, name: str, path_tolerance: float) -> float:
    """Largest relative error against central differences of whole simulations, each along its own path."""
    settings = SolverSettings(path_tolerance=path_tolerance, tolerance=1e-11, max_substeps=1024)

    def solved(each: Experiment, chosen: list[str]) -> SequenceResult:
        return simulate(each.robot, each.model, each.steps, settings, sensitivities=chosen)

    (parameter,) = parameters(experiment, [name])
    step = 5e-4 * parameter.size
    near = [solved(parameter.apply(experiment, parameter.value + x), []) for x in (step, -step)]
    after, before = (np.array([s.positions for s in each.steps]) for each in near)
    expected = (after - before) / (2.0 * step)
    found = solved(experiment, [name]).sensitivities[name].positions
    return float(np.abs(found - expected).max() / np.abs(expected).max())


def whole_steps(name: str) -> Experiment:
    """An experiment whose load steps the solver divides as it likes; reversals are located within substeps."""
    declared = EXPERIMENTS[name]
    return replace(declared, steps=tuple(replace(s, substeps=None) for s in declared.steps))


def test_reversals_within_a_step_move_with_the_parameters() -> None:
    """Where rates jump, the load factor of a reversal moves, too; kept, it leaves an error of 0.03.

    The errors fall with the tolerance of the path; the campaign below has a finer one.
    """
    experiment = whole_steps("per hole")
    first = replace(experiment, steps=experiment.steps[:3])
    assert reversal_errors(first, "tendons.friction_coefficient", 1e-7) < 1e-4


@pytest.mark.campaign
@pytest.mark.parametrize("name", ["backbone.youngs_modulus", "tendons.t1.offset", "steps[2].tensions.t3"])
def test_reversals_move_with_every_kind_of_parameter(name: str) -> None:
    assert reversal_errors(whole_steps("per hole"), name, 1e-8) < TOLERANCE


@pytest.mark.campaign
@pytest.mark.parametrize("seed", [1, 7])
def test_reversals_of_random_robots_move_with_friction(seed: int) -> None:
    case = draw(seed)
    experiment = Experiment(case.robot, replace(case.model, elements_per_bay=1), case.steps)
    assert reversal_errors(experiment, "tendons.friction_coefficient", 1e-8) < TOLERANCE


def test_backlash_is_lost_displacement() -> None:
    """By the derivative of every commanded displacement, with the sign of the travel that was lost."""
    declared = EXPERIMENTS["displacements"]
    values = {"actuator_backlash": {"backlash": 2e-4}}
    check(with_effects(declared, values), effect_parameter(declared, "actuator_backlash", "backlash", values))


@pytest.mark.parametrize("name", ["effects.friction_coefficient.mu", "effects.hole_adhesion.drop"])
def test_friction_that_the_model_lacks_acts_with_the_mobilisation_it_would_have(name: str) -> None:
    """Without friction in the model, and with friction of zero: the same derivative, that of small coefficients."""
    none, zero = (coarse(robot(0.0), by_tension(), friction=friction) for friction in ("none", "per-hole"))
    first, second = run(none, [name])[1][name], run(zero, [name])[1][name]
    assert np.allclose(first.positions, second.positions, rtol=0.0, atol=1e-7 * np.abs(first.positions).max())
    parameter = parameters(none, [name])[0]
    small = 1e-5
    with_friction = run(parameter.apply(none, small))[0]["positions"]  # type: ignore[union-attr]
    expected = (with_friction - run(none)[0]["positions"]) / small
    assert np.abs(first.positions - expected).max() < 1e-3 * np.abs(expected).max()
    assert np.abs(expected).max() > 1e-4


def test_a_tension_of_zero_rises_with_what_is_added_to_it_and_does_not_fall() -> None:
    """By a motor that pulls with more than was commanded: half of the derivative was given."""

    def pulled(e: Experiment, more: float) -> Experiment:
        tensions = [{**s.tensions, "t3": max(s.tensions.get("t3", 0.0) + more, 0.0)} for s in e.steps]
        return replace(e, steps=tuple(replace(s, tensions=x) for s, x in zip(e.steps, tensions, strict=True)))

    experiment, small = pulled(EXPERIMENTS["per hole"], 0.0), 1e-4
    found = run(experiment, [ModelParameter("more", 0.0, 1.0, pulled)])[1]["more"]
    expected = (run(pulled(experiment, small))[0]["positions"] - run(experiment)[0]["positions"]) / small
    assert np.abs(found.positions - expected).max() < 2e-3 * np.abs(expected).max()


def test_play_at_its_null_value_has_no_derivative_where_friction_depends_on_the_order() -> None:
    """The derivative that was given was off by its own size: one input is held back while loads and others move."""
    name = "effects.actuator_loss.efficiency"
    with pytest.raises(ValueError, match="friction depends on the order of the inputs"):
        run(EXPERIMENTS["per hole"], [name])
    check(EXPERIMENTS["no friction"], name)
    values = {"actuator_loss": {"dead_band": 0.0, "efficiency": 0.99}}
    chosen = effect_parameter(EXPERIMENTS["per hole"], "actuator_loss", "efficiency", values)
    check(with_effects(EXPERIMENTS["per hole"], values), chosen)


def test_inputs_of_the_step_keep_what_was_before() -> None:
    """The derivative by an input of a step is that of the step alone: the history stays."""
    names = ["inputs.t1", "loads.tip.force_y", "steps[3].tensions.t1", "steps[1].loads.tip.force[1]"]
    found = run(EXPERIMENTS["per hole"], names)[1]
    # In the step that names it, and before any later step is touched, both are the same.
    a, b = found["inputs.t1"], found["steps[3].tensions.t1"]
    assert np.allclose(a.positions[3], b.positions[3], rtol=1e-6, atol=1e-9)
    a, b = found["loads.tip.force_y"], found["steps[1].loads.tip.force[1]"]
    assert np.allclose(a.positions[1], b.positions[1], rtol=1e-6, atol=1e-9)
    assert np.all(found["steps[3].tensions.t1"].positions[:3] == 0.0)


def test_deflection_of_a_rod_without_tendons_falls_with_the_fourth_power_of_its_radius() -> None:
    """F L^3 / (3 EI), in small bending; such a robot had no derivatives."""
    rod, model = Robot(BACKBONE, DISKS, ()), Model(elements_per_bay=1)
    steps = (LoadStep("", loads={"tip": Load(LENGTH, (1e-4, 0.0, 0.0))}),)
    found = simulate(rod, model, steps, sensitivities=["backbone.radius"])
    expected = -4.0 * found.tips[0, 0] / BACKBONE.radius
    assert found.sensitivities["backbone.radius"].positions[0, -1, 0] == pytest.approx(expected, rel=1e-3)


def test_curvature_rates_are_not_differentiated_where_they_are_not_needed() -> None:
    """They took a twentieth of the time of an identification that reads none."""
    name, given = "backbone.radius", (robot(), Model(friction="per-hole"), by_tension())
    with_them = simulate(*given, sensitivities=[name]).sensitivities[name]
    without = simulate(*given, sensitivities=[name], curvatures=False).sensitivities[name]
    assert with_them.curvature_rates.any() and not without.curvature_rates.any()
    assert np.array_equal(with_them.positions, without.positions)


def test_the_coefficient_of_all_tendons_is_that_of_those_without_a_law() -> None:
    """It was refused where one tendon has a law."""
    mixed = Experiment(replace(robot(), tendons=(SLIPPING.tendons[0], *robot().tendons[1:])), Model())
    (mu,) = parameters(mixed, ["tendons.friction_coefficient"])
    found = [t.friction_coefficient for t in mu.apply(mixed, 0.35).robot.tendons]
    assert found == pytest.approx([0.0, 0.35, 0.35])


def test_what_touches_its_bound_at_rest_has_no_load_factor():
    """In a measured robot with backlash: a division by zero, and no derivative from there on."""
    tendons = [SimpleNamespace(mobilisation=np.array([[0.3, 0.0]]))]
    point, numbering = SimpleNamespace(slipping=np.array([True]), pulling=None), SimpleNamespace()
    numbering.at_frictional_holes = np.concatenate
    given = point, SimpleNamespace(numbering=numbering), SimpleNamespace(tendons=tendons), ()
    assert _load_factor_change(*given) == 0.0

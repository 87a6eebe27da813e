"""Derivatives of readings by parameters of effects equal central differences, along histories with reversals."""

from dataclasses import replace

import numpy as np
import pytest
from identify_data import data_of
from robots import BACKBONE, LENGTH, tendon
from searches import causes_of, problem_of

from tdcr_fe import Disks, HelicalRouting, Load, LoadStep, Model, Reading, Robot, SolverSettings
from tdcr_fe.effects import EFFECTS, Effect, Experiment, PlaceEffect, effect
from tdcr_fe.identify.derivatives import Column, Request, linearize
from tdcr_fe.identify.dictionary import _along
from tdcr_fe.identify.forward import ForwardModel, Job
from tdcr_fe.identify.problem import FitProblem, evaluate
from tdcr_fe.identify.screening import screen
from tdcr_fe.model.channels import CHANNELS

#: Relative error that derivatives must meet.
TOLERANCE = 1e-5
STRAIGHT = tendon("t1", 0.0, 0.25, axial_stiffness=400.0)
WINDING = replace(STRAIGHT, name="t2", routing=HelicalRouting(4.5e-3, 0.3, 110.0))
ROBOT = Robot(BACKBONE, Disks.equally_spaced(5, LENGTH, mass=2e-4, radius=5e-3), (STRAIGHT, WINDING))
TIP = {"tip": Load(LENGTH, (0.01, 0.02, 0.0))}
STEPS = {
    "tension": (
        LoadStep("", {"t1": 1.2, "t2": 0.3}, substeps=3, time=1.0),
        LoadStep("", {"t1": 0.9}, loads=TIP, substeps=3, time=2.0),
        LoadStep("", {"t1": 0.5, "t2": 0.6}, substeps=3, time=3.0),
        LoadStep("", {"t1": 1.0, "t2": 0.5}, substeps=3, time=4.0),
    ),
    "displacement": (
        LoadStep("", displacements={"t1": 3e-3, "t2": 0.5e-3}, substeps=3, time=1.0),
        LoadStep("", displacements={"t1": 1.5e-3}, loads=TIP, substeps=3, time=2.0),
        LoadStep("", displacements={"t1": 2.5e-3, "t2": 1.1e-3}, substeps=3, time=3.0),
    ),
}

ROTATED, MOVED = dict(rot_x=0.05, rot_y=-0.1, rot_z=0.2), dict(shift_x=2e-3, shift_y=-1e-3, shift_z=3e-3)
AXES = list(enumerate("xyz"))
#: Effects at values of their own, those that act together.
TOGETHER = [
    ("tension", {"actuator_loss": dict(dead_band=0.05, efficiency=0.9), "creep": dict(rate=0.02)}),
    ("tension", {"actuator_gain (each tendon)": dict(gain_t1=1.03, gain_t2=0.96), "idle_tension": dict(tension=0.7)}),
    ("tension", {"idle_tension (each tendon)": dict(tension_t1=0.6, tension_t2=0.4)}),
    ("tension", {"gravity": dict(g_x=3.0, g_y=1.0, g_z=-9.0), "tip_payload": dict(mass=2e-3)}),
    ("tension", {"actuator_gain": dict(gain=1.03), "precurvature": dict(kappa_x=0.4, kappa_y=-0.3)}),
    ("tension", {
        "stiffness_scale": dict(bending=0.9, torsion=1.2),
        "superelastic": dict(threshold_strain=8e-4, plateau_ratio=0.4)}),
    ("tension", {"modulus_scale": dict(factor=0.9), "nonlinear_material": dict(quadratic=3.0, cubic=300.0)}),
    ("tension", {"density_scale": dict(factor=0.8), "gravity": dict(g_x=3.0, g_y=1.0, g_z=-9.0)}),
    ("tension", {"friction_coefficient": dict(mu=0.2), "hole_adhesion": dict(drop=0.01)}),
    ("tension", {"routing_twist": dict(angle_tip=0.2), "hole_clearance": dict(clearance=2e-4)}),
    ("tension", {"misplaced_channels": dict(factor_end=0.8)}),
    ("tension", {"rigid_disks": dict(thickness=2e-3)}),
    ("tension", {
        "frame_misalignment": ROTATED,
        "marker_offset": dict(offset_x=1e-3, offset_y=-2e-3)}),
    ("displacement", {"actuator_backlash": dict(backlash=2e-4), "actuator_gain": dict(gain=1.03)}),
    ("displacement", {"tendon_stretch": dict(axial_stiffness=500.0), "gravity": dict(g_x=3.0)}),
    ("displacement", {"actuator_backlash (from the middle)": dict(from_middle=2e-4), "pretension": dict(tension=0.3)}),
    ("displacement", {
        "tendon_stretch (each)": dict(axial_stiffness_t1=400.0, axial_stiffness_t2=700.0),
        "pretension (each)": dict(tension_t1=0.3, tension_t2=0.5),
        "friction_coefficient (each)": dict(mu_t1=0.3, mu_t2=0.1)}),
    ("tension", {
        "frame_misalignment (rotated and moved)": {**ROTATED, **MOVED},
        "marker_offset (along the tangent, too)": dict(offset_x=1e-3, offset_y=-2e-3, offset_z=4e-3),
        "gravity": dict(g_x=3.0, g_y=1.0, g_z=-9.0)}),
    ("displacement", {
        "frame_misalignment (moved)": MOVED,
        "marker_offset (each)": {f"offset_{a}_marker_{k}": 0.001 * k - 0.003 * i for k in (1, 2) for i, a in AXES},
        "tendon_stretch": dict(axial_stiffness=500.0)}),
    ("tension", {"base_compliance": dict(stiffness=0.05), "gravity": dict(g_y=3.0)}),
    ("tension", {"time_lag": dict(lag=0.1)}),
    ("displacement", {"frame_misalignment": ROTATED}),
]  # fmt: skip

WITHOUT_NAME = [
    ("tension", {"base at an angle": dict(rot_x=0.05, rot_y=-0.1), "gravity": dict(g_y=9.0)}),
    ("tension", {"gain of the loads": dict(factor=1.2), "limit of the inputs": dict(share=0.5, limit=0.55)}),
    ("tension", {"dead zone of the inputs": dict(share=0.5, limit=0.25)}),
    ("tension", {"input gain while falling (each)": dict(t1=0.1, t2=-0.05)}),
    ("displacement", {
        "wave of the input (tendon t1)": dict(size=1e-4, period=8e-3, phase=0.6),
        "input gain over the time so far (all)": dict(all=-0.1)}),
    ("displacement", {"input stretch by the square (t1)": dict(t1=2e-4)}),
    ("tension", {"friction by normal force": dict(friction=0.1, exponent=-0.3)}),
    ("tension", {"friction by turning angle": dict(friction=0.05, slope=0.8)}),
    ("tension", {"friction by slip rate": dict(friction=0.1, at_rest=-0.05, rate=1e-3)}),
    ("tension", {"length": dict(factor=1.05), "marker_offset": dict(offset_x=1e-3, offset_y=-2e-3)}),
    ("displacement", {f"length (s = 0 to {LENGTH / 5:.4g} m)": dict(factor=0.9), "gravity": dict(g_x=3.0)}),
]  # fmt: skip


def known(about: FitProblem, name: str) -> Effect:
    """A listed effect, a form of one, or an unlisted cause."""
    listed = name.split(" (")[0]
    if listed not in {e.name for e in EFFECTS}:
        return causes_of(about)[1][name]
    return next(f for f in (effect(listed), *effect(listed).forms(about.experiment)) if f.name == name)


def problem(kind: str, disk: float = 0.1) -> FitProblem:
    """Readings of all channels in all steps, at a disk and between disks."""
    steps = STEPS[kind]
    places = {"arc length": (disk, 0.2173), "tendon": ROBOT.tendon_names, "": (None,)}
    read = [(c.quantity, where) for c in CHANNELS for where in places[c.location]]
    readings = [Reading(n, *what, 0.0, 1.0) for n in range(1, len(steps) + 1) for what in read]
    data = data_of(steps, tuple(readings), ROBOT, Model())
    return problem_of(data, sigma=1.0, forward=ForwardModel(settings=SolverSettings(tolerance=1e-11)))


def relative_error(about: FitProblem, found: np.ndarray, expected: np.ndarray, size: float) -> float:
    """The largest of all families of channels; what differs by no more than round-off counts as zero."""
    families, off = np.array([r.channel.family for r in about.data.readings]), np.abs(found - expected)
    own = [families == q for q in set(families)]
    return max(np.max(off[x]) / max(np.max(np.abs(expected[x])), 1e-7 / size) for x in own)


def residual_along(about: FitProblem, experiment: Experiment, path) -> np.ndarray:
    """Reading less prediction over sigma of an experiment along the path of another run."""
    (run,) = about.run([Job(experiment, path)])
    return about.residual(experiment, run)


def difference(about: FitProblem, effects: tuple, values: dict, name: tuple, run, h: float) -> np.ndarray:
    """Central difference of the predictions by a coordinate, along the substeps of a run."""
    found = []
    for x in (h, -h):
        moved = about.with_effects(effects, about.moved(effects, values, [name], np.array([x])))
        # The same substeps of divided steps.
        found.append(residual_along(about, moved, replace(run.trajectories, ends=moved.ends)))
    return (found[1] - found[0]) / (2.0 * h)


#: Several seconds each: the others show the same mechanisms.
SLOW = {"frame_misalignment (rotated and moved)", "frame_misalignment (moved)"}
SLOW |= {"superelastic", "friction_coefficient (each)"}


CASES = [
    pytest.param(k, v, marks=[pytest.mark.integration] * bool(SLOW & v.keys()), id=f"{k}-{'+'.join(v)}")
    for k, v in (*TOGETHER, *WITHOUT_NAME)
]


@pytest.mark.parametrize(("kind", "values"), CASES)
def test_derivatives_of_all_channels_are_those_of_whole_simulations(kind: str, values: dict) -> None:
    """By every parameter of every effect, of positions, angles, offsets, displacements, tensions and curvatures."""
    # where bays become longer, the strain that jumps at a disk makes its derivative one to one side
    about = problem(kind, 0.13 if any(n.startswith("length") for n in values) else 0.1)
    effects = tuple(known(about, n) for n in values)
    full = {e.name: {**e.null_values(about.experiment), **values[e.name]} for e in effects}
    columns = tuple(Column(e, p, full[e.name], 1e-3) for e in effects for p in values[e.name])
    (found,) = linearize(about, [Request(effects, full, columns)])
    assert not found.differenced
    for column, derivative in zip(columns, found.matrix.T, strict=True):
        size = max(abs(column.coordinate), 0.1 * column.about.scale)
        key = column.effect.name, column.parameter
        sides = [difference(about, effects, full, key, found.run, h * size) for h in (1e-2, 1e-3, 1e-4)]
        errors = [relative_error(about, derivative, x, size) for x in sides]
        # The axial strain of short elements is a small difference of what changes with the length of rigid disks.
        allowed = 10.0 * TOLERANCE if column.about.name == "thickness" else TOLERANCE
        assert min(errors) < allowed, (key, errors)


def test_every_effect_is_among_them() -> None:
    """A new effect needs an entry in TOGETHER."""
    along = {e.name for e in EFFECTS if not isinstance(e, PlaceEffect)}
    assert along == {n for _, values in TOGETHER for n in values if " (" not in n}


def test_every_form_is_among_them() -> None:
    """Forms by segment are those of each tendon, added up; those of single tendons and markers are parts of them."""
    every = [f for e in EFFECTS for f in e.forms(problem("tension").experiment) if f.name != e.name]
    forms = {f.name for f in every if f.among == 1}
    assert forms == {n for _, values in TOGETHER for n in values if " (" in n}


def at_places(about):
    """Effects at every place, by kind."""
    robot = about.experiment.robot
    return [[e.at(x) for x in e.places(robot)] for e in EFFECTS if isinstance(e, PlaceEffect)]


def test_all_candidates_are_screened_in_one_run() -> None:
    """Version 0.1 simulated the history once for every parameter and place. A compliant base takes another run."""
    about = problem("tension")
    about = replace(about, sigma=np.full(about.count, 1e-4))
    fit = evaluate(about, (), {})
    places = [e for family in at_places(about) for e in family]
    before = about.forward.runs
    scores, _ = screen(about, fit, [*EFFECTS, *places])
    assert about.forward.runs == before + 2
    signatures = {x.effect.name for x in scores if x.signature.size}
    assert {"gravity", "superelastic", "rigid_disks", "frame_misalignment", "actuator_loss"} <= signatures
    assert {e.name for e in places} <= {x.effect.name for x in scores} and len(places) > 12


def test_causes_between_two_disks_add_up_from_their_parts() -> None:
    """What each of them would be alone: radius and precurvature by bays, friction by disks."""
    about = problem("tension")
    fit, whole = evaluate(about, (), {}), [e for e in _along(about) if e.parts]
    assert len({part.name for e in whole for part in e.parts}) < len(whole)
    for score in screen(about, fit, whole)[0]:
        e, null = score.effect, score.effect.null_values(about.experiment)
        columns = tuple(Column(e, p.name, null, p.scale) for p in e.parameters)
        (alone,) = linearize(about, [Request((), {}, columns, fit.run)])
        expected = alone.matrix * [p.scale for p in e.parameters]
        assert np.abs(score.signature - expected).max() < 1e-6 * np.abs(expected).max(), e.name


@pytest.mark.parametrize("name", ["soft_bay", "kink", "side_spring", "stuck_hole"])
def test_derivatives_at_null_of_effects_at_places_are_those_of_whole_simulations(name: str) -> None:
    """One-sided where the null value is a bound."""
    about = problem("tension")
    fit = evaluate(about, (), {})
    families = [f for f in at_places(about) if f[0].listed == name]
    e = families[0][len(families[0]) // 2]
    null = e.null_values(about.experiment)
    for p in e.parameters:
        (found,) = linearize(about, [Request((), {}, (Column(e, p.name, null, 1e-3),), fit.run)])
        assert not found.differenced
        errors = []
        for h in (1e-2 * p.scale, 1e-3 * p.scale):
            moved = [{e.name: {**null, p.name: p.value(p.coordinate(null[p.name]) + k * h)}} for k in (1, 2)]
            near = [about.with_effects((e,), x) for x in moved]
            first, second = (residual_along(about, x, fit.run.trajectories) for x in near)
            expected = (1.5 * found.residual - 2.0 * first + 0.5 * second) / h
            errors.append(relative_error(about, found.matrix[:, 0], expected, p.scale))
        assert min(errors) < 1e-4, (e.name, p.name, errors)


@pytest.mark.parametrize(("load", "error"), [(0.05, 0.04), (1.0, 0.6)])
def test_thin_disks_turn_every_bay_as_rigid_disks_do(load: float, error: float) -> None:
    """The stand-in on the mesh without inserts, against a difference of two runs, at small and at large bends."""
    about, disks = problem("tension"), effect("rigid_disks")
    tensions = [{n: load * t for n, t in s.tensions.items()} for s in STEPS["tension"]]
    steps = tuple(LoadStep("", x, substeps=3) for x in tensions)
    at = replace(about.experiment, model=Model(elements_per_bay=4), steps=steps)
    about = replace(about, experiment=at)
    columns = [Column(e, "thickness", disks.null_values(at), 1e-3) for e in (disks, disks.near_null(at))]
    found, thin = (linearize(about, [Request((), {}, (column,))])[0] for column in columns)
    assert found.differenced == {0: "the mesh has other nodes there"} and not thin.differenced
    families = np.array([r.channel.family for r in about.data.readings])
    angle, where = (families == f for f in ("bending_angle", "position"))
    ours, theirs = thin.matrix[:, 0], found.matrix[:, 0]
    assert np.linalg.norm((ours - theirs)[angle]) < error * np.linalg.norm(theirs[angle])
    assert ours[where] @ theirs[where] > 0.99 * np.linalg.norm(ours[where]) * np.linalg.norm(theirs[where])


class Own(type(effect("actuator_gain"))):  # type: ignore[misc]
    """An effect that declares no exact derivatives."""

    exact_derivatives = False


def test_an_effect_without_exact_derivatives_is_differenced_and_named() -> None:
    values, gains = {"actuator_gain": {"gain": 1.0}}, (effect("actuator_gain"), Own())
    requests = [Request((e,), values, (Column(e, "gain", {"gain": 1.0}, 1e-4),)) for e in gains]
    exact, found = linearize(problem("tension"), requests)
    assert found.differenced == {0: "it declares no exact derivatives"}
    assert np.allclose(found.matrix, exact.matrix, rtol=0.0, atol=1e-2 * np.max(np.abs(exact.matrix)))

"""Loads that depend on the solved state: exact response, balance with the state, and what a search makes of them."""

import json
from dataclasses import replace
from itertools import zip_longest

import numpy as np
import pytest
from identify_data import BY_ROW, FRICTIONAL, LENGTH, ROBOT, data_of, measured, positions
from searches import causes_of, check_run, declared, problem_of, read_as_predicted

from tdcr_fe import Disks, Experiment, Load, LoadStep, Reading, Robot
from tdcr_fe.effects import Parameter, effect
from tdcr_fe.effects.base import Kind
from tdcr_fe.identify import derivatives, identify, state_loads
from tdcr_fe.identify.bay_state import FORCE, Action, last_direction, with_action
from tdcr_fe.identify.causes import Attraction, Cord, StateLoad, Wall
from tdcr_fe.identify.derivatives import Agreement, Column, Request, linearize
from tdcr_fe.identify.dictionary import dictionary
from tdcr_fe.identify.forward import Job
from tdcr_fe.identify.problem import evaluate, with_elements
from tdcr_fe.identify.report import render
from tdcr_fe.identify.screening import screen
from tdcr_fe.identify.sentences import sentences, summary
from tdcr_fe.identify.state_loads import ROW, TIME, library

TERMS = {t.key: t for t in library(4, TIME)}
HARDENING = TERMS["bending stiffness that changes with the curvature"]
TOWARDS_A_POINT = pytest.mark.parametrize(
    ("kind", "law", "own"),
    [
        (Attraction, (2, 1e-3), {"k": 5e-5}),
        (Cord, (0.01,), {"k": 0.2, "slack": 0.19}),
        (Wall, (0.5,), {"x": 0.04, "y": 0.01, "z": 0.01, "share": 0.15}),
    ],
    ids=["attraction", "cord", "wall"],
)


def twice_over(bays):
    """The states of two loading sequences that are the same."""
    by_step = ("curvature", "rotation", "moved", "tension", "direction", "time", "begins")
    return replace(bays, **{n: np.concatenate([getattr(bays, n)] * 2) for n in by_step})


def load_of(term, most=1.0):
    """A cause of one term."""
    numbers = tuple(Parameter(n, unit, -most, most, 0.0, 1e-3 * most, "") for n, unit, _ in term.actions)
    return StateLoad(term.key, Kind(*term.kind), numbers, tuple(a for *_, a in term.actions), "")


def under(problem, load, values):
    """The run with a load that depends on the state, in balance with it."""
    return linearize(problem, [Request((load,), {load.name: values}, ())])[0].run


@pytest.mark.parametrize("when", ["from row 7 on", "before row 7"])
def test_loads_begin_and_end_with_a_row(when):
    problem, run, causes = declared()
    rows, values = np.array(problem.data.step_ids) < 7, {"x": 0.0, "y": 2.0, "z": 0.0}
    rows = rows if when == "before row 7" else ~rows
    force = causes[f"force of fixed direction, in a part of the rows (tip, {when})"].action(run.bays, values)
    expected = np.zeros_like(force)
    expected[rows, -1, FORCE] = (0.0, 2.0, 0.0)
    np.testing.assert_array_equal(force, expected)
    # A moment on the first disk passes through the first bay only.
    law = "moment of fixed direction, in a part of the rows (disk"
    name = next(n for n in causes if n.startswith(law) and n.endswith(f"{when})"))
    moment = Action(causes[name].action(run.bays, values), run.bays.rotation).moments
    expected = np.zeros_like(moment)
    expected[rows, 0] = (0.0, 2.0, 0.0)
    np.testing.assert_allclose(moment, expected, atol=1e-15)


def test_a_load_may_follow_the_tension_of_one_tendon():
    _, run, causes = declared()
    force = causes["force of fixed direction, in proportion to the tension of tendon t2 (tip)"]
    expected = np.zeros((*run.bays.shape, 6))
    expected[:, -1, 4] = 3.0 * run.bays.tension[:, -1, 1]
    np.testing.assert_array_equal(force.action(run.bays, {"x": 0.0, "y": 3.0, "z": 0.0}), expected)
    assert force.kind == ("force", ("tension",), "tip")


def test_friction_takes_tension_by_the_turning_angle_at_the_disks_below():
    """0.12 towards the base and 0.3 back were a routing that depends on place and curvature (1.0)."""
    steps = (LoadStep(), LoadStep(tensions={"t1": 1.0}))
    robot = ROBOT.with_tendons(friction_coefficient=0.2)
    problem = problem_of(data_of(steps, positions(Experiment(robot, FRICTIONAL, steps)), robot, FRICTIONAL))
    bays = causes_of(problem)[0].bays
    term = next(t for n, t in TERMS.items() if n.startswith("friction of one size towards the base"))
    angle = term.factors[0].value(bays)[1]
    np.testing.assert_allclose(bays.tension[1, :, 0], np.exp(-0.2 * angle), rtol=1e-3)
    assert term.kind == ("transmission", ("direction of loading", "turning angle"))
    assert angle[0] == 0.0 and angle[-1] > 0.3
    towards, back = (action(bays) for _, _, action in term.actions)
    assert np.all(towards[1, 1:, :2].any(axis=-1)) and not back.any()


def test_stiffness_and_precurvature_from_a_row_on_act_in_these_rows():
    problem, run, causes = declared()
    later, own = np.array(problem.data.step_ids) >= 5, "that changes with a step in row 5"
    bend = causes[f"bending stiffness {own}"]
    expected = np.where(later[:, None, None], run.bays.curvature[..., :2], 0.0)
    np.testing.assert_array_equal(bend.action(run.bays, {"coefficient": 2.0})[..., :2], 2.0 * expected)
    for name, perturbs in (("bending stiffness", "stiffness"), ("precurvature", "precurvature")):
        assert causes[f"{name} {own}"].kind == (perturbs, ("row",), "everywhere")


def test_the_response_to_an_action_is_exact():
    """Against central differences of whole runs: readings, curvatures and displacements."""
    problem = declared()[0]
    column = Column(load_of(HARDENING), "coefficient", {"coefficient": 0.0}, 1.0)
    run = linearize(problem, [Request((), {}, (column,))])[0].run
    rng = np.random.default_rng(0)
    step = rng.normal(size=run.acted.action.values.shape) * np.array([1e-5] * 3 + [1e-4] * 3)
    # The response is that of one step: only step 4 gets the action.
    step[np.arange(len(step)) != 3] = 0.0
    acted = [with_action(problem.experiment, Action(x * step, run.bays.rotation)) for x in (1.0, -1.0)]
    ends = problem.run([Job(e, run.trajectories) for e in acted])
    residuals = [problem.residual(e, r) for e, r in zip(acted, ends, strict=True)]
    mine = problem.readings.step == 3
    predicted = run.acted.readings[mine] @ step[3].ravel()
    change = -(residuals[0] - residuals[1])[mine] / 2.0
    np.testing.assert_allclose(change, predicted, atol=2e-4 * np.abs(predicted).max())
    bays = run.acted.state[3] @ step[3].ravel()
    a, b = (r.bays for r in ends)
    moved = np.concatenate((a.curvature[3] - b.curvature[3], a.moved[3] - b.moved[3]), axis=1) / 2.0
    np.testing.assert_allclose(moved.ravel(), bays, atol=2e-3 * np.abs(bays).max())


def test_a_load_is_derived_with_what_friction_remembers_of_it():
    """Against central differences of whole runs; the response of each load step alone is far from them."""
    problem = problem_of(measured(robot=ROBOT.with_tendons(friction_coefficient=3.0), model=FRICTIONAL))
    load = load_of(TERMS["bending stiffness that changes with the sum of the tensions"])
    none = {"coefficient": 0.0}
    request = Request((), {}, (Column(load, "coefficient", none, 1.0),))
    found, by_step = (linearize(problem, [request._replace(history=x)])[0] for x in (True, False))
    state, h = found.run.bays, 1e-6
    change = load.by_value(state, none, "coefficient")
    acted = [with_action(problem.experiment, Action(x * h * change, state.rotation)) for x in (1.0, -1.0)]
    runs = problem.run([Job(e, found.run.trajectories) for e in acted])
    ahead, back = (problem.residual(e, r) for e, r in zip(acted, runs, strict=True))
    expected = (back - ahead) / (2.0 * h)
    size = np.abs(expected).max()
    np.testing.assert_allclose(found.matrix[:, 0], expected, atol=1e-3 * size)
    assert np.abs(by_step.matrix[:, 0] - expected).max() > 0.05 * size
    (candidate,), _ = screen(problem, evaluate(problem, (), {}), (load,))
    np.testing.assert_allclose(candidate.signature[:, 0] / 1e-3, expected, atol=1e-3 * size)


def bent_by(moments, *times):
    """A rod without tendons with moments at its tip, and readings there."""
    rod, rows = Robot(ROBOT.backbone, ROBOT.disks, ()), zip_longest(moments, times)
    steps = tuple(LoadStep(loads={"tip": Load(LENGTH, moment=(0.0, m, 0.0))}, time=t) for m, t in rows)
    readings = (Reading(k, "position_x", LENGTH, 0.0, 1e-4) for k in range(1, len(steps) + 1))
    return rod, problem_of(data_of(steps, tuple(readings), rod))


def test_loads_from_a_row_on_act_on_all_disks_of_short_sequences(monkeypatch):
    """Of long ones on the tip alone: their columns would take too much memory."""
    problem, _, _ = declared()
    for most, at_tip in ((1200, False), (1, True)):
        monkeypatch.setattr(state_loads, "MOST_PAIRS", most)
        names = [n for n in causes_of(problem)[1] if n.startswith("force") and "in a part of the rows (" in n]
        assert names and all("rows (tip" in n for n in names) == at_tip


def test_a_load_that_hardly_comes_nearer_to_balance_is_given_up(monkeypatch):
    """80 runs of a soft robot left 0.694 each."""
    missing = iter((1.0, 0.9))

    def hardly(loads, values, run, robot):
        unchanged = np.zeros((len(run.bays.rotation), 24, 1))
        return Agreement(run.acted.action, unchanged, run.bays, next(missing))

    monkeypatch.setattr(derivatives, "agreed", hardly)
    assert not under(declared()[0], load_of(HARDENING), {"coefficient": 1e-3}).solved


def test_dry_friction_holds_the_arc_back_by_one_moment():
    """EI kappa + m = M, where m is within the friction, and follows a change of the curvature up to it."""
    EI = ROBOT.backbone.EI
    friction, within = 0.2 * EI, 0.5
    moments = np.array([2.0, 4.0, 3.9, 1.0]) * EI
    _, problem = bent_by(moments)
    load = causes_of(problem)[1]["dry friction in bending"]
    values = {"moment": -friction, "within": within}
    run = under(problem, load, values)
    slid = (moments + friction * np.array([-1.0, -1.0, 0.0, 1.0])) / EI
    slid[2] = slid[1] + (moments[2] - moments[1]) / (EI + friction / within)
    for bay in run.bays.curvature[..., 1].T:
        np.testing.assert_allclose(bay, slid, rtol=1e-4)
    # after a change across the last one it turns as a cord of that length draws: tan(angle/2) = exp(-change)
    turned = np.zeros((2, *run.bays.curvature.shape[1:]))
    turned[:, :, 0], turned[1, :, 1] = 2.0 * within, 3.0 * within
    corner = replace(run.bays, curvature=turned, begins=np.array([True, False]))
    x, y = load.action(corner, {**values, "moment": 1.0})[1, 0, :2]
    assert np.arctan2(x, y) == pytest.approx(2.0 * np.arctan(np.exp(-3.0)), rel=1e-9)
    # the friction of one sequence is not that of the next
    twice = load.action(twice_over(run.bays), values)
    np.testing.assert_array_equal(twice, np.tile(load.action(run.bays, values), (2, 1, 1)))


def test_what_yields_keeps_a_share_of_its_curvature():
    """EI kappa - c left = M, where what is left follows the curvature at the limit."""
    EI, limit = ROBOT.backbone.EI, 2.0
    moments, c = np.array([1.0, 4.0, 0.0, -1.0, 3.0]) * EI, 0.2 * EI
    _, problem = bent_by(moments)
    load = causes_of(problem)[1]["permanent set"]
    values = {"coefficient": c, "limit": limit}
    run = under(problem, load, values)
    farthest = (moments[1] - c * limit) / (EI - c)
    back = (moments[3] + c * limit) / (EI - c)
    left = np.array([0.0, farthest - limit, farthest - limit, back + limit, back + limit])
    for bay in run.bays.curvature[..., 1].T:
        np.testing.assert_allclose(bay, (moments + c * left) / EI, rtol=1e-4)
    twice = load.action(twice_over(run.bays), values)
    np.testing.assert_array_equal(twice, np.tile(load.action(run.bays, values), (2, 1, 1)))


def test_what_relaxes_follows_its_curvature_with_time():
    """Closed form of the way by steps, each in a part of the time between rows; in the end EI kappa - c kappa = M."""
    EI, span, late = ROBOT.backbone.EI, 3.0, 0.3
    _, problem = bent_by((2.0 * EI, 2.0 * EI), 1.0, 100.0)
    run, causes = causes_of(problem)
    load, values = (
        causes["relaxation, stiffness of a fast load"],
        {"coefficient": 0.2 * EI, "span": span, "late": late},
    )
    assert load.kind == ("stiffness", ("time",), "everywhere")
    time, size = np.array([5.0, 6.0, 8.5, 9.0, 15.0]), np.array([0.0, 0.4, 1.4, 1.4, 1.4])
    bent = np.zeros((len(time), *run.bays.curvature.shape[1:]))
    bent[..., 1] = size[:, None]
    begun = time[:-1] + late * np.diff(time)  # of every step
    followed = -np.expm1(-np.maximum(time[:, None] - begun, 0.0) / span) @ np.diff(size)
    path = replace(run.bays, curvature=bent, time=time, begins=np.arange(len(time)) == 0)
    path = twice_over(path)  # one sequence does not know of another
    for bay in load.action(path, values)[..., 1].T:
        np.testing.assert_allclose(bay, 0.2 * EI * np.tile(followed, 2), rtol=1e-12, atol=1e-12)
    softer = load.action(path, values) - causes["relaxation, stiffness at rest"].action(path, values)
    np.testing.assert_allclose(softer[..., :3], 0.2 * EI * path.curvature, atol=1e-15)
    last = under(problem, load, values).bays.curvature[1, :, 1]
    np.testing.assert_allclose(last, 2.0 / (1.0 - 0.2), rtol=2e-3)


def test_bending_that_is_coupled_with_twist_winds_the_rod():
    """EI kappa + c tau = M and GJ tau + c kappa = 0, where the rod turns by little."""
    backbone = ROBOT.backbone
    c, moment = 0.4 * backbone.GJ, 1e-3 * backbone.EI
    _, problem = bent_by((moment,))
    run = under(problem, causes_of(problem)[1]["bending coupled with twist"], {"xz": 0.0, "yz": c})
    kappa = moment / (backbone.EI - c**2 / backbone.GJ)
    for bay in run.bays.curvature[0]:
        np.testing.assert_allclose(bay, (0.0, kappa, -c / backbone.GJ * kappa), rtol=1e-3, atol=1e-3 * kappa)


def test_viscous_drag_holds_the_tip_back_by_its_velocity():
    """Of a tip with compliance C: (1 + c C / dt) x = C F + c C / dt x_before, however large the drag."""
    force, times = 1e-5, 1.7e9 + np.array([0.0, 1.0, 3.0, 4.0])
    pushes = [Load(LENGTH, (force * (t > times[0]), 0.0, 0.0)) for t in times]
    steps = tuple(LoadStep(loads={"tip": p}, time=t) for p, t in zip(pushes, times, strict=True))
    readings = tuple(Reading(k, "position_x", LENGTH, 0.0, 1e-4) for k in range(1, len(steps) + 1))
    problem = problem_of(data_of(steps, readings, Robot(ROBOT.backbone, Disks.equally_spaced(1, LENGTH), ())))
    free, causes = causes_of(problem)
    assert all(len({p.name for p in e.parameters}) == len(e.parameters) > 0 for e in causes.values())
    load, still = causes["viscous drag (tip)"], free.bays.moved[1, -1, 0]
    run = under(problem, load, {"coefficient": 20.0 * force / still})
    expected = [0.0]
    for passed in np.diff(times):
        expected.append((still + 20.0 / passed * expected[-1]) / (1.0 + 20.0 / passed))
    np.testing.assert_allclose(run.bays.moved[:, -1, 0], expected, rtol=1e-3, atol=1e-9)


def test_any_function_of_a_quantity_is_a_cause():
    """A line is one: with its values at the knots the cause is a stiffness in proportion, zero at first."""
    _, run, causes = declared()
    load = causes["bending stiffness as a function of the number of the row"]
    values = {p.name: float(p.name.rpartition("_")[2]) - 1.0 for p in load.parameters}
    assert len(values) == state_loads.KNOTS - 1 and load.kind == ("stiffness", ("row",), "everywhere")
    added = np.arange(len(run.bays.time))[:, None, None] * run.bays.curvature[..., :2]
    np.testing.assert_allclose(load.action(run.bays, values)[..., :2], added, rtol=2e-3, atol=1e-2)


def test_a_tendon_that_loses_all_its_tension_ends_there():
    """But for its course in a bay, which is straight from hole to hole."""
    problem, run, causes = declared()
    at = float(run.bays.edges[2])
    lost = under(problem, causes[f"lost tension (tendon t1, from s = {at:.4g} m on)"], {"share": 1.0})
    robot = replace(ROBOT, tendons=(replace(ROBOT.tendons[0], end=at), *ROBOT.tendons[1:]))
    (shorter,) = problem.run([Job(replace(problem.experiment, robot=robot))])
    off, all_of_it = (np.abs(x.positions - shorter.positions).max() for x in (lost, run))
    assert off < 0.1 * all_of_it


def test_a_force_beside_the_tip_turns_it_by_its_lever():
    """The lever turns with the section; the moment passes through all bays."""
    problem, run, causes = declared()
    beside = causes["moment of a lever at the tip, in proportion to the force on it (tip)"]
    values, turned = {"x": 4e-3, "y": -2e-3, "z": 1e-3}, run.bays.tip @ (4e-3, -2e-3, 1e-3)
    forces = [s.loads["tip"].force if s.loads else (0.0, 0.0, 0.0) for s in problem.experiment.steps]
    expected = np.cross(turned, forces)
    assert np.any(expected) and beside.parameters[0].unit == "m"
    for bay in np.moveaxis(Action(beside.action(run.bays, values), run.bays.rotation).moments, 1, 0):
        np.testing.assert_allclose(bay, expected, atol=1e-15)


def test_a_hardening_law_holds_in_the_arc_that_a_moment_gives():
    """EI kappa + c kappa^2 = M in every bay: the closed form of the quadratic equation."""
    moment = 4.0 * ROBOT.backbone.EI
    rod, problem = bent_by((0.5 * moment, moment))
    load, c = load_of(HARDENING), 0.25 * rod.backbone.EI / 4.0
    run = under(problem, load, {"coefficient": -c})
    gap = load.action(run.bays, {"coefficient": -c}) - run.acted.action.values
    assert np.abs(gap).max() <= 1e-5 * rod.backbone.EI / LENGTH
    for k, share in enumerate((0.5, 1.0)):
        kappa = (-rod.backbone.EI + np.sqrt(rod.backbone.EI**2 + 4.0 * c * share * moment)) / (2.0 * c)
        np.testing.assert_allclose(run.bays.curvature[k, :, 1], kappa, rtol=1e-4)


@TOWARDS_A_POINT
def test_derivatives_with_a_load_that_depends_on_the_state_are_those_of_differences(kind, law, own):
    """A pull of the tip towards a point, and the stiffness of the backbone beside it."""
    problem, run, _ = declared()
    pull, stiffness = kind(run.bays.shape[1] - 1, run.bays, *law), effect("stiffness_scale")
    values = {pull.name: {"x": -0.15, "y": -0.1, "z": 0.2, **own}}
    values[stiffness.name] = {"bending": 1.0, "torsion": 1.0}
    free = [(pull, pull.strength, 1e-6), (pull, "x", 2e-4), (stiffness, "bending", 1e-3)]
    assert np.count_nonzero(pull.action(run.bays, values[pull.name]))

    def at(changed=None, by=0.0):
        own = {n: dict(v) for n, v in values.items()}
        if changed:
            own[changed[0].name][changed[1]] += by
        columns = tuple(Column(e, n, own[e.name], h) for e, n, h in free)
        return linearize(problem, [Request((pull, stiffness), own, columns)])[0]

    matrix = at().matrix
    for j, (e, name, h) in enumerate(free):
        difference = (at((e, name), -h).residual - at((e, name), h).residual) / (2.0 * h)
        np.testing.assert_allclose(matrix[:, j], difference, atol=2e-3 * np.abs(difference).max())


@TOWARDS_A_POINT
def test_a_force_towards_a_point_is_proposed_where_it_acts(kind, law, own):
    """From the declared model alone, where it explains all; at another disk it explains less."""
    problem, run, _ = declared()
    tip = run.bays.shape[1] - 1
    pull, other = kind(tip, run.bays, *law), kind(tip - 1, run.bays, *law)
    values = {"x": -0.15, "y": -0.1, "z": 0.2, **own}
    (true,) = linearize(problem, [Request((pull,), {pull.name: values}, ())])
    problem = problem_of(read_as_predicted(problem, true.residual))
    nothing = evaluate(problem, (), {})
    (at_tip, at_disk), _ = screen(problem, nothing, (pull, other))
    assert at_tip.effect is pull
    assert np.sum(at_tip.start.predicted**2) < 2e-3 * np.sum(nothing.residual**2)
    assert at_tip.drop > at_disk.drop


def test_products_that_a_listed_effect_has_are_no_terms():
    keys = {t.key for t in library(4, ROW)}
    assert not keys & {"bending stiffness", "precurvature", "moment of the tendons"}
    assert {HARDENING.key, BY_ROW} <= keys


def test_causes_have_names_in_words():
    """A headline said "|u| u (bay 2)", another one "kappa/|kappa|"."""
    assert not [n for n in (*TERMS, *declared()[2]) if set("|/^") & set(n) or "kappa" in n]


def test_the_sign_of_the_last_command_stays_while_a_tendon_rests():
    commands = np.array([[0.0, 1.0], [1.0, 1.0], [1.0, 0.5], [0.2, 0.5]])
    assert last_direction(commands).tolist() == [[0, 1], [1, 1], [1, -1], [-1, -1]]


# ----------------------------------------------------------------------------------------------- identification


def test_a_moment_that_grows_with_time_is_found_reported_and_written_as_loads(tmp_path):
    """About an axis of the sections; no listed effect has it."""
    data = measured(sigma=1e-9)
    steps = tuple(replace(s, time=float(k)) for k, s in enumerate(data.steps, 1))
    true = problem_of(replace(data, steps=steps))
    true = replace(true, experiment=with_elements(true.experiment, 4))
    load, drift = load_of(TERMS["precurvature that changes with time"]), 0.01 * ROBOT.backbone.EI / LENGTH
    (linear,) = linearize(true, [Request((load,), {load.name: {"x": drift, "y": -0.5 * drift}}, ())])
    noise = np.random.default_rng(0).normal(size=true.count)
    result = identify(read_as_predicted(true, linear.residual - noise, 1e-4))
    assert result.verdict == "explained by a law found"
    (cause,) = result.effects
    assert (cause.form, *cause.kind[:2]) == (load.name, "precurvature", ("time",))
    assert cause.kind_probability > 0.9
    assert [p.value for p in cause.parameters.values()] == pytest.approx([drift, -0.5 * drift], rel=0.05)
    assert result.after.held_out.chi2_per_dof < 1.5 < 0.1 * result.before.held_out.chi2_per_dof
    document = json.loads(json.dumps(result.to_json()))
    assert document["effects"] == [] and document["causes"][0]["perturbs"] == "precurvature"
    assert document["law"]["formula"].startswith(f"{load.name} (x = ")
    assert "law" not in replace(result, verdict="partly explained").to_json()
    assert sentences(result)[0] == f"Explained by an unlisted cause: {result.law.sentence}."
    assert result.law.sentence in summary(result) and result.law.formula in render(result)
    check_run(result, tmp_path, 1e-6)


def test_angles_are_read_with_a_load_that_depends_on_the_state():
    """Without a column of the description beside it, the derivatives of an angle ended in a ValueError."""
    data = measured()
    tips = tuple(Reading(r.step, "bending_angle", None, 0.5, 1e-3) for r in data.readings[::6])
    problem, load = problem_of(replace(data, readings=(*data.readings, *tips))), load_of(HARDENING)
    values = {load.name: {"coefficient": -1e-6}}
    column = Column(load, "coefficient", values[load.name], 1.0)
    (linear,) = linearize(problem, [Request((load,), values, (column,))])
    assert np.isfinite(linear.residual).all() and np.all(linear.matrix[-len(tips) + 1 :] != 0.0)


def test_a_stiffness_that_differs_between_directions_is_a_symmetric_tensor_of_the_curvature():
    """The moment is against the tensor times the curvature; where both are equal, the backbone is as much stiffer."""
    problem, run, causes = declared()
    section = causes["bending stiffness of another section"]
    moment = section.action(run.bays, {"xx": 2.0, "yy": -1.0, "xy": 0.5})[..., :2]
    np.testing.assert_allclose(moment, -run.bays.curvature[..., :2] @ np.array([[2.0, 0.5], [0.5, -1.0]]).T)
    null = dict.fromkeys(("xx", "yy", "xy"), 0.0)
    scaled = Column(effect("stiffness_scale"), "bending", {"bending": 1.0, "torsion": 1.0}, 1e-3)
    columns = (*(Column(section, n, null, 1.0) for n in ("xx", "yy")), scaled)
    (linear,) = linearize(problem, [Request((), {}, columns)])
    x, y, both = linear.matrix.T
    np.testing.assert_allclose((x + y) * problem.data.robot.backbone.EI, both, atol=0.01 * np.abs(both).max())


def test_a_stiffness_that_differs_by_side_acts_where_the_curvature_has_the_sign():
    problem, run, _ = declared()
    kappa = np.linspace(-2.0, 3.0, run.bays.curvature.size).reshape(run.bays.curvature.shape)
    bent = replace(run.bays, curvature=kappa)  # bent to all sides
    every = {e.name: e for e in dictionary(problem, replace(run, bays=bent))}
    sides = every["bending stiffness by side"]
    x, y = kappa[..., 0], kappa[..., 1]
    action = sides.action(bent, {"x_plus": 2.0, "x_minus": -1.0, "y_plus": 0.0, "y_minus": 3.0})
    np.testing.assert_allclose(action[..., 0], np.where(x > 0.0, -2.0, 1.0) * x)
    np.testing.assert_allclose(action[..., 1], np.where(y > 0.0, 0.0, -3.0) * y)
    assert not np.any(action[..., 2:])


def test_a_stiffness_that_settles_falls_exponentially_with_the_rows():
    """It begins with the first row; the derivative by their number is that of differences."""
    _, run, causes = declared()
    cause = causes["bending stiffness, settling"]
    assert cause.kind == ("stiffness", ("row",), "everywhere")
    values, rows = {"coefficient": 2.0, "span": 3.0}, np.arange(len(run.positions))
    bent = np.pad(run.bays.curvature[..., :2], ((0, 0), (0, 0), (0, 4)))
    grown = (1.0 - np.exp(-rows / 3.0))[:, None, None]
    np.testing.assert_allclose(cause.action(run.bays, values), 2.0 * grown * bent, rtol=1e-12)
    np.testing.assert_allclose(cause.by_value(run.bays, values, "coefficient"), grown * bent, rtol=1e-7)
    later, before = (cause.action(run.bays, {**values, "span": 3.0 + h}) for h in (1e-5, -1e-5))
    slope = cause.by_value(run.bays, values, "span")
    np.testing.assert_allclose(slope, (later - before) / 2e-5, atol=1e-7 * np.abs(slope).max())


def test_moments_of_fixed_direction_and_of_a_magnet_are_loads_of_the_tip():
    """A moment passes through all bays below it: what acts on the disks is the moment at the tip alone."""
    problem, run, causes = declared()
    values = {"x": 1e-3, "y": -2e-3, "z": 5e-4}
    given, tip = np.array([*values.values()]), run.rotations[:, -1]
    field, rows = np.cross(tip[:, :, 2], given), np.arange(1.0, len(tip) + 1.0)[:, None]
    for name, moments in {
        "moment of fixed direction, constant (tip)": np.tile(given, (len(tip), 1)),
        "moment that turns with the tip, constant (tip)": tip @ given,
        "moment of a uniform field on a magnet along the tip, constant (tip)": field,
        "moment of a uniform field on a magnet along the tip, in proportion to the number of the row (tip)": field
        * rows,
    }.items():
        action = Action(causes[name].action(run.bays, values), run.bays.rotation)
        steps = with_action(problem.experiment, action).steps
        loads = [[*s.loads.values()][-len(run.bays.edges) + 1 :] for s in steps]
        acting = np.array([[x.moment for x in own] for own in loads])
        np.testing.assert_allclose(acting[:, -1], moments, atol=1e-7)
        np.testing.assert_allclose(acting[:, :-1], 0.0, atol=1e-12)

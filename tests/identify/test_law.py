"""Laws that nobody listed: exact response, laws that hold in the solved state, and the search for them."""

import json
import math
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from identify_data import LENGTH, MODEL, ROBOT, begun, concluded, measured, problem_of, searching, state_of

from tdcr_fe.cli import main
from tdcr_fe.effects import EFFECTS, effect
from tdcr_fe.identify import identification, identify
from tdcr_fe.identify.corrected import corrected_files
from tdcr_fe.identify.criteria import robust_threshold
from tdcr_fe.identify.fitting import fit
from tdcr_fe.identify.law_fit import TOLERANCE, Law, LawSearch, balance
from tdcr_fe.identify.law_search import (
    _beside_the_effects,
    _explains_more,
    _without_unnecessary,
    find_law,
    search_law,
    sentence,
)
from tdcr_fe.identify.law_state import COMPONENTS, Action, action_response, last_direction, run_with_action
from tdcr_fe.identify.law_terms import (
    ABOUT_X,
    BENDING,
    CURVATURE,
    DEFLECTION,
    DISPLACED,
    POSITION,
    TENDONS,
    TIME,
    Term,
    library,
)
from tdcr_fe.identify.problem import evaluate
from tdcr_fe.identify.report import render
from tdcr_fe.identify.search import search_effects
from tdcr_fe.identify.search_state import SearchState
from tdcr_fe.identify.sentences import headline
from tdcr_fe.identify.settings import Budget
from tdcr_fe.identify.statistics import summary
from tdcr_fe.io.measured import MeasuredData
from tdcr_fe.io.readings import Reading
from tdcr_fe.model.loading import Load, LoadStep
from tdcr_fe.model.robot import Robot
from tdcr_fe.validation.blind.laws import LAWS, make_law_set

HARDENING = Term((CURVATURE,), BENDING)
DRIFT = Term((TIME,), ABOUT_X)
#: Steps that are held out.
HELD = (4, 5, 9)


def started(problem):
    """The declared model with loads at every disk, and its response."""
    experiment = problem.experiment
    steps, bays = len(experiment.steps), len(ROBOT.disks.positions)
    upright = np.broadcast_to(np.eye(3), (steps, bays, 3, 3))
    run = run_with_action(problem, experiment, Action(np.zeros((steps, bays, COMPONENTS)), upright))
    return experiment, *action_response(problem, experiment, run)


def law_beside(problem, base):
    """The law that a search finds beside a model."""
    return search_law(LawSearch.of(problem, base), searching())[0]


def test_the_response_to_an_action_is_exact():
    """Against central differences of whole runs: readings, curvatures and displacements."""
    problem = problem_of(measured())
    experiment, response, run = started(problem)
    rng = np.random.default_rng(0)
    size = np.array([1e-5, 1e-5, 1e-4, 1e-4, 1e-4])
    step = rng.normal(size=run.action.shape) * size
    # The response is that of one step: only step 4 gets the action.
    step[np.arange(len(step)) != 3] = 0.0
    ends = [run_with_action(problem, experiment, Action(x * step, run.state.rotation)) for x in (1.0, -1.0)]
    mine, rows = response.readings[3]
    change = -(ends[0].residual[mine] - ends[1].residual[mine]) / 2.0
    predicted = rows @ step[3].ravel()
    np.testing.assert_allclose(change, predicted, atol=2e-4 * np.abs(predicted).max())
    bays = response.state[3] @ step[3].ravel()
    moved = np.concatenate((ends[0].state.curvature[3, :, :2] - ends[1].state.curvature[3, :, :2],
                            ends[0].state.moved[3] - ends[1].state.moved[3]), axis=1) / 2.0  # fmt: skip
    np.testing.assert_allclose(moved.ravel(), bays, atol=2e-3 * np.abs(bays).max())


def test_a_hardening_law_holds_in_the_arc_that_a_moment_gives():
    """EI kappa + c kappa^2 = M in every bay: the closed form of the quadratic equation."""
    rod = Robot(ROBOT.backbone, ROBOT.disks, ())
    moment = 4.0 * rod.backbone.EI
    steps = tuple(LoadStep(loads={"tip": Load(LENGTH, moment=(0.0, x * moment, 0.0))}) for x in (0.5, 1.0))
    readings = (Reading(1, "position_x", LENGTH, 0.0, 1e-4), Reading(2, "position_x", LENGTH, 0.0, 1e-4))
    problem = problem_of(MeasuredData("rod", rod, MODEL, (1, 2), steps, ("", ""), readings))
    experiment, response, run = started(problem)
    c = 0.25 * rod.backbone.EI / 4.0
    law = Law([HARDENING], np.array([-c]))
    held = balance(problem, experiment, law, run, response)
    gap = law.action(held) - held.action
    assert np.abs(gap).max() <= TOLERANCE * rod.backbone.EI / LENGTH
    for k, share in enumerate((0.5, 1.0)):
        kappa = (-rod.backbone.EI + np.sqrt(rod.backbone.EI**2 + 4.0 * c * share * moment)) / (2.0 * c)
        np.testing.assert_allclose(held.state.curvature[k, :, 1], kappa, rtol=1e-4)


@pytest.mark.parametrize(
    ("term", "unit", "product"),
    [
        (HARDENING, "N m^3", "|kappa| kappa"),
        (Term((TIME,), BENDING), "N m^2 s^-1", "t kappa"),
        (Term((POSITION,), TENDONS), "m^-1", "s m_T"),
        (Term((DEFLECTION, DEFLECTION), DISPLACED, 2), "N m^-3", "|u|^2 u"),
    ],
)
def test_coefficients_have_the_unit_that_makes_a_moment_or_a_force(term, unit, product):
    assert (term.unit, term.product) == (unit, product)


def test_products_that_a_listed_effect_has_are_no_terms():
    problem = problem_of(measured())
    _, _, run = started(problem)
    keys = {t.key for t in library(run.state)}
    assert not keys & {"kappa", "e_x", "e_y", "m_T"} and "|kappa| kappa" in keys
    assert not any(k.startswith("t ") for k in keys)  # these data have no times


def test_the_sign_of_the_last_command_stays_while_a_tendon_rests():
    commands = np.array([[0.0, 1.0], [1.0, 1.0], [1.0, 0.5], [0.2, 0.5]])
    assert last_direction(commands).tolist() == [[0, 1], [1, 1], [1, -1], [-1, -1]]


def test_a_law_in_words():
    edges = np.array([0.0, 0.1, 0.2])
    text = sentence(HARDENING, -1.0, edges)
    assert text == (
        "In all bays, a bending moment acts against the curvature, proportional to the square of the curvature; the "
        "declared model does not have it."
    )
    spring = sentence(Term((DEFLECTION, DEFLECTION), DISPLACED, 1), -1.0, edges)
    assert "At the disk at s = 0.2 m, a force acts against the displacement" in spring
    assert "the square of the displacement" not in spring and "the third power of the displacement" in spring


def test_noise_gives_no_law():
    problem = problem_of(measured(), held=(4, 5, 9))
    assert law_beside(problem, evaluate(problem, (), {})) is None


def test_what_a_search_may_take_is_counted_in_iterations():
    """Time would let the verdict depend on what else the machine does."""
    problem = problem_of(measured({"gravity": {"g_x": 3.0}}), held=(4, 5, 9))
    base = evaluate(problem, (), {})
    forward = problem.forward
    assert forward.iterations == base.run.iterations > len(problem.data.steps)
    assert LawSearch.of(problem, base, most_iterations=base.run.iterations - 1) is None
    assert forward.iterations == 2 * base.run.iterations
    spent = [Budget(forward, forward.runs + 1, forward.iterations + n, math.inf).spent for n in (0, 1)]
    assert spent == [True, False]


# ------------------------------------------------------------------------------------- laws and listed effects


@pytest.fixture(scope="module")
def drifting():
    """A robot with a moment about x that grows with time: the problem, its declared model, and the law beside it."""
    data = measured(sigma=1e-9)
    data = replace(data, steps=tuple(replace(s, time=float(k)) for k, s in enumerate(data.steps, 1)))
    true = problem_of(data, HELD)
    experiment, response, run = started(true)
    drift = 0.01 * ROBOT.backbone.EI / LENGTH
    acted = balance(true, experiment, Law([DRIFT], np.array([drift])), run, response)
    values = true.readings.values - acted.residual * true.sigma
    values = values + np.random.default_rng(0).normal(0.0, 1e-4, values.size)
    read = tuple(replace(r, value=float(v), sigma=1e-4) for r, v in zip(data.readings, values, strict=True))
    problem = problem_of(replace(data, readings=read), HELD)
    problem = replace(problem, robust_threshold=robust_threshold(evaluate(problem, (), {}).residual))
    declared = evaluate(problem, (), {})
    law = law_beside(problem, declared)
    assert [t.key for t in law.terms] == ["t e_x"]
    assert law.coefficients[0] == pytest.approx(drift, rel=0.05)
    return problem, declared, law


@pytest.fixture(scope="module")
def found(drifting):
    """What a search without listed effects ends with."""
    problem, declared, _ = drifting
    law, state = find_law(searching(), SearchState.start(problem, declared))
    return concluded(state, law=law)


def test_result_and_report_have_the_law(found):
    assert found.verdict == "explained by a law found" and found.effects == ()
    (term,) = found.law.terms
    assert (term.product, term.where, term.coefficient.unit) == ("t e_x", "all bays", "N m s^-1")
    assert found.after_held_out.chi2_per_dof < 1.5 < 0.1 * found.before_held_out.chi2_per_dof
    law = json.loads(json.dumps(found.to_json()))["law"]
    assert law["formula"].startswith("m = (") and law["formula"].endswith("N m s^-1 t e_x")
    assert law["where"] == "all bays" and law["after"]["held_out"]["chi2_per_dof"] < 1.5
    assert headline(found) == "Explained by a discovered law."
    assert found.law.sentence in summary(found) and found.law.formula in render(found)


def test_a_run_of_the_corrected_robot_has_the_law_as_loads(found, tmp_path):
    for name, text in corrected_files(found).items():
        (tmp_path / name).write_text(text, encoding="utf-8")
    command = ["run", str(tmp_path / "effects.toml"), "-o", str(tmp_path / "out"), "--no-pictures", "-q"]
    assert main(command) == 0
    table = pd.read_csv(tmp_path / "out" / "steps.csv", dtype={"label": str}).set_index("label")
    tips = table.loc[[str(n) for n in found.data.step_ids], ["tip_x", "tip_y", "tip_z"]].to_numpy()
    np.testing.assert_allclose(tips, found.shapes.backbone_after[:, -1], rtol=0.0, atol=1e-9)


@pytest.fixture(scope="module")
def blind():
    """A blind set with a moment about x that grows with time, simulated by the reference."""
    return make_law_set(next(r for r in LAWS if r.name == "drift")).data


@pytest.mark.integration
def test_the_law_of_a_blind_set_is_found_by_its_formula(blind, monkeypatch):
    """Without the search among the listed effects."""

    def nothing(search, state):
        yield state
        return state

    monkeypatch.setattr(identification, "search_effects", nothing)
    found = identify(blind)
    (term,) = found.law.terms
    assert (found.verdict, term.product, term.where) == ("explained by a law found", "t e_x", "all bays")
    assert found.after_held_out.rms_position < 0.1 * found.before_held_out.rms_position
    assert found.after_held_out.chi2_per_dof < 1.3
    assert not {e.name for e in EFFECTS} & set(found.law.formula.split())


def test_beside_a_model_that_leaves_noise_no_law_is_sought():
    state = state_of(problem_of(measured(), HELD))
    assert find_law(searching(), state) == (None, state)


@pytest.mark.integration
def test_a_law_that_leaves_noise_ends_the_search_among_listed_effects(blind):
    """The best single effect takes off a part; effects by twos, threes and fours followed, and the law came last."""
    state = begun(blind)
    catalogue = (effect("precurvature"), effect("gravity"))
    state = replace(state, problem=replace(state.problem, catalogue=catalogue))
    for latest in search_effects(searching(laws=True), state):
        state = latest
    assert [t.key for t in state.law_ahead.fit.terms] == ["t e_x"]
    assert len(state.best.effects) == 1 and state.best.cost > 10.0 * state.law_ahead.fit.cost
    law, state = find_law(searching(laws=True), state)
    assert law.formula.endswith("t e_x") and state.best.effects == ()


def rival(law, cost=0.0, held=0.0):
    """Listed effects with as many parameters as the law has, that leave what the law leaves and so much more."""
    as_fit = law.as_fit()
    free = (("gravity", "g_x"),) * law.count
    return replace(as_fit, effects=(effect("gravity"),), free=free, cost=as_fit.cost + cost,
                   held_cost=as_fit.held_cost + held)  # fmt: skip


def test_effects_that_leave_noise_yield_to_a_law_only_beyond_chance(drifting):
    problem, declared, law = drifting
    state = SearchState.start(problem, declared)
    assert not _explains_more(searching(), state, law, rival(law))
    assert not _explains_more(searching(), state, law, rival(law, cost=40.0, held=2.0))
    assert _explains_more(searching(), state, law, rival(law, cost=20.0, held=10.0))


def test_where_a_law_explains_as_much_as_the_effects_both_are_named(drifting):
    problem, declared, law = drifting
    state = SearchState.start(problem, declared)
    alike = _beside_the_effects(searching(), state, law, rival(law))
    assert alike.rivals == {"gravity": ("an unlisted law (t e_x)",)}
    assert _beside_the_effects(searching(), state, law, rival(law, cost=-60.0)).rivals == {}
    assert _beside_the_effects(searching(), state, law, declared).rivals == {}


def test_an_effect_beside_a_law_must_improve_the_held_out_steps(drifting):
    """Gravity takes off a part of the drift alone, and nothing beside the law of the drift."""
    problem, declared, law = drifting
    gravity = effect("gravity")
    base = fit(problem, (gravity,), [{"gravity": gravity.null_values(problem.experiment)}])
    beside = law_beside(problem, base)
    assert beside.base.effects == (gravity,)
    state = SearchState.start(problem, declared).with_fit(base)
    smaller = _without_unnecessary(searching(), state, beside)
    assert smaller.base.effects == () and smaller.coefficients == pytest.approx(law.coefficients, rel=1e-3)

"""The search: causes at a place, that saturate, in pairs; exchanges; candidates that are not solved; and its end."""

from dataclasses import replace

import numpy as np
import pytest
from identify_data import BY_ROW, FRICTIONAL, MODEL, ROBOT, data_of, measured, positions, sequence
from scipy.signal import lfilter
from searches import causes_of, declared, problem_of, read_as_predicted, searching, starting, state_of

from tdcr_fe import LoadStep, NonlinearMaterial, ParallelRouting, StribeckFriction, Tendon, effect, simulate
from tdcr_fe.effects import Experiment
from tdcr_fe.identify import fitting, identify, search
from tdcr_fe.identify.bay_state import last_direction
from tdcr_fe.identify.causes import PointForce, is_named
from tdcr_fe.identify.criteria import BIC_DIFFERENCE, UNLISTED, price, rank
from tdcr_fe.identify.derivatives import Request, linearize
from tdcr_fe.identify.forward import Job
from tdcr_fe.identify.problem import Fit, evaluate
from tdcr_fe.identify.screening import Score, screen
from tdcr_fe.identify.search import Proposal, backward_selection, exchange, scores_beside, search_causes
from tdcr_fe.io.readings import Reading
from tdcr_fe.model.routing import MisplacedRouting

#: What a cause may perturb, in the words of `result.json`.
PERTURBED = {"force", "moment", "stiffness", "precurvature", "routing"}
PERTURBED |= {"transmission", "input", "base", "reading", "load"}


def test_listed_effects_have_a_kind_and_causes_change_nothing_at_their_null_values():
    problem, _, causes = declared()
    assert len(causes) > 100
    assert {e.kind.perturbs for e in problem.catalogue} <= PERTURBED
    assert effect("soft_bay").at({"s": 0.025}).kind.where == "s = 0.025 m"
    for e in (x for x in causes.values() if not is_named(x)):
        plain = problem.experiment
        same = problem.with_effects((e,), {e.name: e.null_values(plain)})
        for part in ("robot", "model", "observation"):
            assert getattr(same, part) == getattr(plain, part), (e.name, part)


def test_a_cause_at_a_place_and_one_without_a_name_have_a_price():
    bay, taper = effect("soft_bay").at({"s": 0.025}, 4), declared()[2]["radius along the backbone"]
    one = price((effect("gravity"),))
    assert price((effect("gravity"), effect("creep"))) == pytest.approx(2.0 * one)
    assert price((bay,)) - one == pytest.approx(2.0 * np.log(4))
    assert price((taper,)) - one == pytest.approx(2.0 * UNLISTED)


@pytest.mark.integration
def test_a_hole_that_holds_fast_is_found_although_its_derivative_is_that_of_a_small_drop():
    """A blind set with a stuck hole, 170 sigma from the declared robot, ended with `gravity`, partly explained."""
    own = problem_of(measured({"stuck_hole": {"tendon": 2.0, "s": 0.05}}, robot=ROBOT, model=FRICTIONAL))
    state = search_causes(searching(), state_of(own))
    assert state.best.names == ("stuck_hole (tendon = 2, s = 0.05)",)
    assert state.log.history[0].startswith("round 1: stuck_hole")
    assert state.best.cost < 2.0 * own.count < 0.1 * state.declared.cost


def test_causes_that_an_exchange_makes_unnecessary_are_dropped():
    """A blind set (precurvature and stiffness) ended with five effects, three of them of no size."""
    own = problem_of(measured({"precurvature": {"kappa_x": 0.8, "kappa_y": -0.5}}), held=(3, 7, 9))
    named = tuple(filter(is_named, causes_of(own)[1].values()))
    state = starting(own, named, effect("gravity"), effect("marker_offset"))
    last = exchange(searching(), exchange(searching(), state))
    assert last.best.names == ("precurvature",)
    done = own.forward.runs
    assert exchange(searching(), last).best is last.best
    assert own.forward.runs == done  # nothing is tried again


@pytest.mark.parametrize("hidden", [{"gain": 1.1}, {"gain_t2": 1.1}, {"gain_t1": 1.1, "gain_t2": 0.93}])
@pytest.mark.parametrize("number", ["gain_t2", None])
def test_a_cause_has_as_many_numbers_as_the_data_support(hidden, number):
    """Whichever form it was found in: a gain of one tendon beside friction lost to a routing, which has two numbers."""
    sigma = 5e-4  # above the error of the mesh
    own = problem_of(measured({"actuator_gain": hidden}, sigma=sigma), sigma=sigma)
    whole, *_, each, first, second = effect("actuator_gain").forms(own.experiment)
    state = starting(own, (whole, each, first, second), second if number else each)
    last = backward_selection(searching(), state)
    (found,) = last.best.effects
    assert found is {("gain",): whole, ("gain_t2",): second}.get(tuple(hidden), each)
    for name, value in hidden.items():
        assert last.best.values[found.name][name] == pytest.approx(value, abs=0.03)


@pytest.mark.parametrize(("declared", "hidden"), [(0.0, 0.2), (0.2, 0.0)])
def test_a_listed_effect_in_another_form_is_preferred_to_a_cause_without_a_name(declared, hidden):
    """A blind set ended with friction by the normal force, exponent 0.001, which beat a coefficient of each tendon.

    Another one without friction did so, since zero is a bound of the coefficient.
    """
    robot = ROBOT.with_tendons(friction_coefficient=declared)
    data = measured({"friction_coefficient": {"mu": hidden}}, robot=robot, model=FRICTIONAL)
    own = problem_of(data, held=(3, 7, 9))
    whole, *_ = forms = effect("friction_coefficient").forms(own.experiment)
    each = next(e for e in forms if len(e.parameters) > 1)
    law = causes_of(own)[1]["friction by normal force"]
    state = state_of(own)
    everywhere = {p.name: hidden for p in each.parameters}
    for e, values in ((each, everywhere), (law, {"friction": 0.7 * (hidden - declared), "exponent": 0.0})):
        state = state.with_fit(fitting.fit(own, (e,), {e.name: values}))
    unlisted = state.fits[frozenset({law.name})]
    last = backward_selection(searching(), replace(state, best=unlisted, dictionary=(law, *forms)))
    assert last.best.names == (whole.name,)


@pytest.mark.parametrize("number", [1, 2])
def test_a_marker_that_is_glued_askew_is_one_of_the_explanations(number):
    """With nine numbers for three markers it lost to a kink below the tip, which alone was found, as certain."""
    hidden = {f"offset_x_marker_{number}": 9e-4, f"offset_y_marker_{number}": -5e-4}
    own = problem_of(measured({"marker_offset": hidden}), held=(3, 7, 9))
    forms = effect("marker_offset").forms(own.experiment)
    kinks = [e for n, e in causes_of(own)[1].items() if n.startswith("kink")]
    found = search.grow(searching(), replace(state_of(own), dictionary=(*kinks, *forms)))
    fit = found.fits[frozenset({f"marker_offset (marker {number})"})]
    assert fit.effects[0].among == len(own.experiment.observation.markers) == 2
    assert rank(own, fit) < rank(own, found.best) + BIC_DIFFERENCE
    for name, value in hidden.items():
        assert fit.values[fit.names[0]][name] == pytest.approx(value, abs=1.5e-4)


def test_another_friction_at_one_hole_is_one_of_the_explanations():
    """It promised as much as a coefficient of its tendon, but less than that had reached: it was not even tried."""
    own = problem_of(measured(robot=ROBOT.with_tendons(friction_coefficient=0.1), model=FRICTIONAL))
    holes = {n: e for n, e in causes_of(own)[1].items() if n.startswith("friction at a hole (tendon t1")}
    hole = "friction at a hole (tendon t1, s = 0.05 m)"
    true = evaluate(own, (holes[hole],), {hole: {"friction": 0.6}})
    own = problem_of(read_as_predicted(own, true.residual, 1.5e-4), sigma=1.5e-4)
    forms = effect("friction_coefficient").forms(own.experiment)
    found = search.grow(searching(), replace(state_of(own), dictionary=(*holes.values(), *forms)))
    assert found.fits[frozenset({hole})].values[hole]["friction"] == pytest.approx(0.6, abs=0.02)


def test_a_cause_that_was_found_in_some_bays_acts_everywhere_where_the_data_say_so():
    """A stiffness that rose with time was found in ten of fifteen bays, and the search did not end in 9 minutes."""
    problem, _, causes = declared()
    whole, part = causes[BY_ROW], causes[f"{BY_ROW} (bays 1 to 2)"]
    values = {whole.name: {"coefficient": 10.0 * whole.parameters[0].scale}}
    (true,) = linearize(problem, [Request((whole,), values, ())])
    own = problem_of(read_as_predicted(problem, true.residual))
    last = backward_selection(searching(), starting(own, (whole, part), part))
    assert last.best.names == (BY_ROW,)
    assert last.best.values == {whole.name: pytest.approx(values[whole.name], rel=1e-2)}


def test_a_cause_moves_to_the_place_where_it_explains_more():
    """A cord at the tip was taken to act on the disk below, where the fifth of five places was not fitted."""
    bays = tuple(effect("soft_bay").at({"s": s}) for s in (0.025, 0.075, 0.125, 0.175))
    own = problem_of(measured({"soft_bay": {"s": 0.125, "factor": 0.5}}))
    assert backward_selection(searching(), starting(own, bays, bays[0])).best.names == (bays[2].name,)


def test_one_hole_of_one_tendon_may_be_rougher():
    own = problem_of(measured(model=FRICTIONAL), sigma=1e-4)
    causes = [e for n, e in causes_of(own)[1].items() if n.startswith("friction at a hole")]
    assert len(causes) == sum(len(own.experiment.robot.hole_arc_lengths(t)) - 2 for t in ROBOT.tendons)
    first, second = causes[0].apply(own.experiment, {"friction": 0.2}).robot.tendons
    (hole,) = first.tight_holes
    assert hole.friction_coefficient == pytest.approx(first.friction_coefficient + 0.2)
    assert not second.tight_holes
    # Another law of the friction at the same hole adds to it.
    twice = causes[0].apply(own.experiment.with_robot(tendons=(first, second)), {"friction": 0.1}).robot
    more = twice.tendons[0].tight_holes[-1].friction_coefficient - hole.friction_coefficient
    assert more == pytest.approx(0.1)


def test_friction_that_depends_on_the_slip_rate_is_told_from_other_friction():
    """At rows 1 and 30 s apart; data of another simulator with such friction ended as "cannot tell"."""
    timed = zip(sequence(), np.cumsum(np.tile([1.0, 30.0], 6)).tolist(), strict=False)
    steps, law = tuple(replace(s, time=t) for s, t in timed), StribeckFriction(0.3, 0.1, 2e-4, 1.0)
    robot = ROBOT.with_tendons(friction_coefficient=0.1)
    true = ROBOT.with_tendons(friction_coefficient=0.0, friction=law)
    read = positions(Experiment(true, replace(FRICTIONAL, elements_per_bay=4), steps), sigma=5e-5)
    own = problem_of(data_of(steps, read, robot, FRICTIONAL), sigma=5e-5)
    first, *_ = screen(own, state_of(own).declared, tuple(causes_of(own)[1].values()))[0]
    assert first.effect.name == "friction by slip rate" and first.effect.kind.depends_on == ("slip rate",)
    values = fitting.fit(own, (first.effect,), first.start.point).values[first.effect.name]
    assert [values["at_rest"], values["rate"]] == [pytest.approx(0.2, abs=0.03), pytest.approx(2e-4, rel=0.1)]


def test_other_forms_of_an_effect_are_evaluated_where_its_first_comes_near(monkeypatch):
    """A right effect was the fourth, after three that lagged behind."""
    own = state_of(problem_of(measured()))
    names = ["gravity", "gravity", "precurvature", "creep", "creep"]
    costs = [1e3, 90, 1e3, 200, 100]
    scores = [Score.refused(effect(name), own.best, "") for name in names]
    proposals = [Proposal(own.best, score, k) for k, score in enumerate(scores)]

    def begun(_, x):
        yield from ()
        cost = costs[x.criterion]
        return search._Evaluated(x, replace(own.best, free=(), cost=cost), cost, cost)

    monkeypatch.setattr(search, "_begun", begun)
    own = replace(own, fits={frozenset(): replace(own.best, cost=1e4)})
    found = search._evaluated(own, proposals)
    assert [f.proposal.criterion for f in found] == [0, 2, 3, 4]
    # One that was fitted before counts as well: the force was at the tip, and two other disks came first.
    own = own.with_fit(replace(own.best, effects=(effect("gravity"),), cost=90.0))
    assert [f.proposal.criterion for f in search._evaluated(own, proposals)] == [0, 2, 3, 1]


def test_places_of_one_law_do_not_take_the_turns_of_others(monkeypatch):
    """A stiffness that changed with time in all bays came after five that did so in some, which alone were tried."""
    own, _, causes = declared()
    state = state_of(own)
    places = [e for n, e in causes.items() if e.law == f"{BY_ROW} somewhere"]
    every = [*places, causes[BY_ROW], causes["bending stiffness that changes with the curvature"]]
    assert len(places) > 5
    pool = [Proposal(state.best, Score.refused(e, state.best, ""), -1e9 + k) for k, e in enumerate(every)]
    tried = []
    monkeypatch.setattr(search, "_evaluated", lambda _, found: tried.append(found) or [])
    search.fit_proposals(searching(), state, pool)
    (first,), _, others = tried
    assert [first, *others] == [*pool[:4], *pool[-2:]]


@pytest.mark.parametrize(("first", "count"), [(4e3, 4), (1e2, 3)])
def test_candidates_are_fitted_until_one_improves_held_out_steps(monkeypatch, first, count):
    """Of a measured robot three fitted better and predicted worse; the fourth, a compliant base, improved both."""
    state, fitted = state_of(problem_of(measured(), held=(2, 4, 6))), list[str]()
    declared = replace(state.best, cost=3e3, held_cost=3e3)
    state = replace(state, declared=declared, best=declared, fits={frozenset(): declared})
    names = ["gravity", "precurvature", "routing_twist", "base_compliance", "marker_offset"]
    held = dict(zip(names, [first, 4e3, 4e3, 1e2, 1e2], strict=True))
    pool = [Proposal(state.best, Score.refused(effect(n), state.best, ""), k) for k, n in enumerate(names)]

    def evaluated(_, found):
        other = state.best.residual + 3.0
        now = [replace(state.best, effects=x.effects, cost=1e3 + x.criterion, residual=other) for x in found]
        return [search._Evaluated(x, f, f.cost, f.cost) for x, f in zip(found, now, strict=True)]

    def fit_of(problem, now, race, predicted):
        fitted.append(now.names[0])
        yield from ()
        return replace(now, held_cost=held[now.names[0]])

    monkeypatch.setattr(search, "_evaluated", evaluated)
    monkeypatch.setattr(fitting, "fitted", fit_of)
    search.fit_proposals(searching(), state, pool)
    assert fitted == names[:count]


def test_causes_that_take_a_run_each_leave_the_response_that_forces_towards_points_need():
    """An exchange ended in an assertion, after slipped disks had been tried beside the best model."""
    own, _, causes = declared()
    every = causes.values()
    slip = next(e for e in every if not (is_named(e) or e.exact_derivatives))
    state = replace(state_of(own), dictionary=(slip, next(e for e in every if isinstance(e, PointForce))))
    for costly, count in ((False, 1), (True, 2)):
        state, scores, reference = scores_beside(state, state.best, costly)
        assert len(scores) == count and reference.run.acted is not None


@pytest.mark.integration
def test_a_misplaced_tendon_is_told_by_its_kind_and_place():
    """On no list: gravity and a tilted frame were named."""
    first, *others = ROBOT.tendons
    moved = replace(first, routing=MisplacedRouting(first.routing, angle_base=0.1, angle_end=0.1))
    result = identify(measured(robot=replace(ROBOT, tendons=(moved, *others))))
    (cause,) = result.effects
    assert cause.kind == ("routing", ("nothing",), "tendon t1")
    assert result.effects[0].parameters["angle"].value == pytest.approx(0.1, abs=0.02)
    assert not [e for e in result.effects if e.found]


def test_a_cause_found_on_some_of_the_rows_is_the_same_on_all():
    """Long data are searched on chosen rows; a jump from a row on then holds for the rows of that number."""
    whole = problem_of(measured())
    few = [n for n in whole.data.step_ids if n not in (2, 5)]
    data = replace(whole.data, step_ids=tuple(few), steps=tuple(whole.data.steps[n - 1] for n in few),
                   branches=tuple(whole.data.branches[n - 1] for n in few),
                   readings=tuple(r for r in whole.data.readings if r.step in few))  # fmt: skip
    part = problem_of(data)
    _, causes = causes_of(part)
    assert not any("row " in name and not name.startswith("jump") for name in causes)
    everyone, one = "all markers, from row 7 on", "the marker at s = 0.1 m, from row 7 on"
    jump, turns = causes[f"jump of {everyone}"], causes[f"jump and turn of {everyone}"]
    jumps, slips = causes[f"jump of {one}"], causes[f"jump on the section of {one}"]
    for problem in (part, whole):
        (run,) = problem.run([Job(problem.experiment)])
        steps = np.array([r.step for r in problem.data.readings])
        expected = np.where((steps >= 7) & (problem.readings.axes == 0), 1e-3, 0.0)
        own = np.array([r.location == 0.1 for r in problem.data.readings])
        values = {"x": 1e-3, "y": 0.0, "z": 0.0}
        np.testing.assert_array_equal(jump.shift(problem, run, values), expected)
        np.testing.assert_array_equal(jumps.shift(problem, run, values), expected * own)
        # one that slips on the backbone stays at its distance from the point where it was
        moved = slips.shift(problem, run, values)
        slip = moved[own & (steps >= 7)].reshape(-1, 3)
        np.testing.assert_allclose(np.linalg.norm(slip, axis=1), 1e-3)
        assert np.ptp(slip[:, 2]) > 1e-5 and not np.any(moved[~own | (steps < 7)])
        # turned about z, markers of which all coordinates are read move across their distance from the axis
        read = problem.readings.read(run, problem.experiment)
        unturned = dict.fromkeys(turns.null_values(problem.experiment), 0.0)
        turned = turns.shift(problem, run, {**unturned, "rot_z": 0.1})
        x, y, z = (problem.readings.is_position & (problem.readings.axes == i) for i in range(3))
        np.testing.assert_allclose(turned[x], -0.1 * read[y] * (steps[x] >= 7), atol=1e-15)
        np.testing.assert_allclose(turned[y], 0.1 * read[x] * (steps[x] >= 7), atol=1e-15)
        assert not np.any(turned[z])


def test_at_an_angle_the_base_has_other_loads_that_are_the_same_in_the_world():
    model = replace(MODEL, gravity=(0.0, -3.0, -9.0))
    problem = problem_of(measured(model=model, robot=ROBOT))
    cause = causes_of(problem)[1]["base at an angle"]
    turned = cause.apply(problem.experiment, {"rot_x": 0.2, "rot_y": -0.1})
    frame = turned.observation.frame
    np.testing.assert_allclose(frame @ turned.model.gravity, model.gravity, atol=1e-12)
    pushed = [k for k, s in enumerate(problem.experiment.steps) if s.loads and any(s.loads["tip"].force)]
    for k in pushed:
        before, after = (e.steps[k].loads["tip"].force for e in (problem.experiment, turned))
        np.testing.assert_allclose(frame @ after, before, atol=1e-12)
    assert pushed and np.linalg.norm(np.subtract(frame, np.eye(3))) > 0.2


def test_inputs_jump_at_a_row_share_are_limited_have_a_dead_zone_and_stay_behind():
    problem, _, causes = declared()

    def tensions(experiment):
        return np.array([[s.tensions["t1"], s.tensions["t2"]] for s in experiment.steps])

    given, later = tensions(problem.experiment), np.array(problem.data.step_ids)[:, None] >= 7
    behind = lfilter([0.8], [1.0, -0.2], given, axis=0, zi=0.2 * given[:1])[0]
    for name, values, expected in (
        ("jump of the input (tendon t1, from row 7 on)", {"t1": 0.1}, given + 0.1 * later * [1, 0]),
        ("jump of the gain (from row 7 on)", {"all": 0.1}, given * (1.0 + 0.1 * later)),
        ("jump of the gain (tendon t2, from row 7 on)", {"t2": 0.1}, given * (1.0 + 0.1 * later * [0, 1])),
        ("crosstalk from t1 to t2", {"t2": 0.1}, given + 0.1 * given[:, :1] * [0, 1]),
        ("limit of the inputs", {"share": 1.0, "limit": 0.5}, np.minimum(given, 0.5)),
        ("limit of the input (tendon t2)", {"share": 1.0, "limit": 0.2}, np.minimum(given, [np.inf, 0.2])),
        ("dead zone of the inputs", {"share": 1.0, "limit": 0.2}, np.maximum(given - 0.2, 0.0)),
        ("lag of the inputs", {"share": 0.2}, behind),
        ("input gain by the largest so far (all)", {"all": -0.1},
            np.maximum(given - 0.1 * np.maximum.accumulate(given), 0.0)),
        ("input gain while rising (t1)", {"t1": -0.1}, given * (1.0 - 0.1 * (last_direction(given) > 0.0) * [1, 0])),
        ("input gain while falling (all)", {"all": 0.1}, given * (1.0 + 0.1 * (last_direction(given) < 0.0))),
    ):  # fmt: skip
        acted = tensions(causes[name].apply(problem.experiment, values))
        np.testing.assert_allclose(acted, expected, atol=1e-12, err_msg=name)


def test_displacements_are_off_by_a_wave_of_a_spool_or_by_what_tendons_have_given_way():
    """A spool that ran out of true was a limit of the input beside a dead zone."""
    given = np.array([[0.0, 1e-3], [2e-3, 3e-3], [4e-3, 2e-3], [1e-3, 0.0]])
    rows = zip(given.tolist(), (1.0, 2.0, 4.0, 5.0), strict=True)
    steps = tuple(LoadStep(displacements={"t1": a, "t2": b}, time=t) for (a, b), t in rows)
    problem = problem_of(data_of(steps, positions(Experiment(ROBOT, FRICTIONAL, steps)), ROBOT, FRICTIONAL))
    causes = causes_of(problem)[1]
    wave = np.sin(2.0 * np.pi * given[:, 1] / 8e-3 + 0.6) - np.sin(0.6)
    integral = np.array([0.0, 1e-3, 7e-3, 9.5e-3]) / 5.0  # of the first input, over the time of the last row
    spool = {"size": 1e-4, "period": 8e-3, "phase": 0.6}
    moved = causes["wave of the input (tendon t2)"].apply(problem.experiment, spool)
    moved = causes["input gain over the time so far (t1)"].apply(moved, {"t1": -0.5})
    acted = [[s.displacements[n] for n in ROBOT.tendon_names] for s in moved.steps]
    np.testing.assert_allclose(acted, given + np.column_stack((-0.5 * integral, 1e-4 * wave)), atol=1e-12)


def test_an_unlisted_cause_of_all_tendons_is_tried_for_each():
    problem, _, causes = declared()
    one, each = (causes[f"input gain that grows ({x})"] for x in ("all", "each"))
    best = evaluate(problem, (one,), {one.name: {"all": 0.1}})
    state = replace(state_of(problem), best=best, dictionary=(one, each))
    assert search.other_forms(state) == [(each,)]
    assert search.refitted(state, [(each,)])[1][0].values[each.name].keys() == {"t1", "t2"}


def test_late_inputs_are_those_on_the_way_to_the_command_a_time_before():
    """A blind set of motors that began 2 s late, with pauses of 8 to 50 s, ended with a lag and without a verdict."""
    data = measured()
    times = np.cumsum([8.0, 12.0, 9.0, 50.0, *([10.0] * (len(data.steps) - 4))])
    steps = tuple(replace(s, time=float(t)) for s, t in zip(data.steps, times, strict=True))
    problem = problem_of(replace(data, steps=steps))
    late = causes_of(problem)[1]["late inputs"].apply(problem.experiment, {"late": 2.0})
    for name in ROBOT.tendon_names:
        given, acted = ([s.tensions[name] for s in e.steps] for e in (problem.experiment, late))
        np.testing.assert_allclose(acted, np.interp(times - 2.0, times, given), atol=1e-12)
    assert [s.loads for s in late.steps] == [s.loads for s in problem.experiment.steps]


def test_loads_are_scaled_and_turned_and_a_camera_enlarges_and_distorts():
    problem, run, causes = declared()
    before = [s.loads["tip"].force for s in problem.experiment.steps if "tip" in s.loads]
    quarter = {"rot_x": 0.0, "rot_y": 0.0, "rot_z": np.pi / 2}
    for name, values, matrix in (
        ("gain of the loads", {"factor": 1.3}, 1.3 * np.eye(3)),
        ("loads turned", quarter, [[0, -1, 0], [1, 0, 0], [0, 0, 1]]),
    ):
        moved = causes[name].apply(problem.experiment, values)
        after = [s.loads["tip"].force for s in moved.steps if "tip" in s.loads]
        np.testing.assert_allclose(after, np.array(before) @ np.transpose(matrix), atol=1e-12)
    assert np.any(before)
    shift = causes["perspective along z"].shift(problem, run, {"scale": -0.1, "slope": 2.0})
    read = problem.readings.read(run, problem.experiment).reshape(-1, 3)  # x, y and z of each marker
    np.testing.assert_allclose(shift.reshape(-1, 3), read * (2.0 * read[:, 2:] - 0.1) * [1, 1, 0], atol=1e-12)
    shift = causes["lens distortion along z"].shift(problem, run, {"scale": 0.02, "radial": 3.0})
    square = np.sum(read[:, :2] ** 2, axis=1, keepdims=True)
    np.testing.assert_allclose(shift.reshape(-1, 3), read * (3.0 * square + 0.02) * [1, 1, 0], atol=1e-12)
    shift = causes["share of position z in x"].shift(problem, run, {"scale": 0.03})
    np.testing.assert_allclose(shift.reshape(-1, 3), 0.03 * read[:, 2:] * [1, 0, 0], atol=1e-12)
    shift = causes["scale of positions along y"].shift(problem, run, {"scale": 0.03})
    np.testing.assert_allclose(shift.reshape(-1, 3), 0.03 * read * [0, 1, 0], atol=1e-12)


def test_sensors_read_too_much_by_a_factor_a_constant_or_a_drift():
    """A gain of curvature sensors of 1.06 was a stiff bay beside a stiffness at a probability of 0.97."""
    data, at = measured(), (("curvature_y", 0.05), ("base_tension", "t1"), ("base_tension", "t2"))
    readings = tuple(Reading(n, quantity, place, 1.0, 0.1) for n in data.step_ids for quantity, place in at)
    problem = problem_of(replace(data, readings=readings))
    run, causes = causes_of(problem)
    read = problem.readings.read(run, problem.experiment).reshape(-1, 3)
    share = np.arange(1.0, 12.0)[:, None] / 11.0
    for name, values, expected in (
        ("scale of the readings of curvature", {"scale": 0.06}, 0.06 * read * [1, 0, 0]),
        ("scale of the readings of base_tension", {"scale": 0.1}, 0.1 * read * [0, 1, 1]),
        ("scale of the readings of base_tension at t2", {"scale": 0.1}, 0.1 * read * [0, 0, 1]),
        ("offset of the readings of curvature_y at 0.05 m", {"offset": 0.2}, [0.2, 0, 0]),
        ("drift of the readings of base_tension", {"drift": 0.1}, 0.1 * share * [0, 1, 1]),
    ):
        shift = causes[name].shift(problem, run, values).reshape(-1, 3)
        np.testing.assert_allclose(shift, np.broadcast_to(expected, shift.shape), atol=1e-12)


@pytest.mark.parametrize(("first", "last"), [(0, 2), (1, 3), (2, len(ROBOT.bay_edges) - 1)])
def test_a_part_of_the_backbone_has_another_radius_or_precurvature(first, last):
    """Between two disks; stiffness goes with the fourth power of the radius."""
    (problem, _, causes), edges = declared(), ROBOT.bay_edges
    part = f"(s = {edges[first]:.4g} to {edges[last]:.4g} m)"
    inside = np.zeros(len(edges) - 1, dtype=bool)
    inside[first:last] = True

    def changed(name, values):
        return causes[f"{name} {part}"].apply(problem.experiment, values).robot

    patches = changed("radius", {"radius_there": 1.1}).backbone.patches[-inside.size :]
    np.testing.assert_allclose([p.bending for p in patches], np.where(inside, 1.1**4, 1.0), rtol=1e-12)
    patches = changed("precurvature", {"kappa_x_there": 2.0, "kappa_y_there": -3.0}).backbone.patches
    for patch, bent in zip(patches[-inside.size :], inside, strict=True):
        assert tuple(patch.precurvature) == ((2.0, -3.0) if bent else (0.0, 0.0))


def test_a_compressible_backbone_is_shortened_by_its_tension_times_its_compliance():
    """A coil with EA = 300 N was a scale of the positions, and a shift of the camera in four of 39 steps."""
    tendons = tuple(Tendon(f"t{i + 1}", ParallelRouting(4.5e-3, 180.0 * i)) for i in range(2))
    steps = (LoadStep(tensions={"t1": 1.0, "t2": 1.0}),)
    straight = Experiment(replace(ROBOT, tendons=tendons), MODEL, steps)
    soft = declared()[2]["axial compliance"].apply(straight, {"compliance": 1e-3})
    tip = simulate(soft.robot, soft.model, soft.steps).steps[-1].tip
    assert tip[2] == pytest.approx(0.2 * (1.0 - 2.0 * (1e-3 + 1.0 / ROBOT.backbone.EA)), rel=1e-6)


def test_one_hole_or_one_disk_is_moved_and_no_other_or_all_of_them():
    """A disk turns with its holes, or has one hole elsewhere."""
    problem, _, causes = declared()
    at = f" (disk at s = {ROBOT.disks.positions[1]:.4g} m)"

    def changed(name, at=at, **values):
        """Holes less those of the declared robot, by tendon."""
        cause = causes[name + at]
        robot = cause.apply(problem.experiment, {**cause.null_values(problem.experiment), **values}).robot
        return [robot.holes(a) - ROBOT.holes(b) for a, b in zip(robot.tendons, ROBOT.tendons, strict=True)]

    # as far as to the opposite hole
    first, second = changed("hole of t1", x=causes["hole of t1" + at].parameters[0].lower)
    np.testing.assert_allclose(first[2], (-9e-3, 0.0), atol=1e-12)
    assert not np.any(np.abs(np.delete(first, 2, axis=0)) > 1e-12) and not np.any(second)
    for m, t in zip(changed("disk turned", angle=0.1), ROBOT.tendons, strict=True):
        before = ROBOT.holes(t)[2]
        assert np.linalg.norm(before + m[2]) == pytest.approx(np.linalg.norm(before))
        assert np.linalg.norm(m[2]) > 1e-4 and not np.any(np.abs(np.delete(m, 2, axis=0)) > 1e-12)
    off = changed("disks off their centre", "", x=1e-4)
    np.testing.assert_allclose(off, np.full(np.shape(off), (1e-4, 0.0)), atol=1e-12)
    nearer = changed("radius of all holes", "", factor=0.9)
    np.testing.assert_allclose(nearer, [-0.1 * ROBOT.holes(t) for t in ROBOT.tendons], atol=1e-12)


def test_a_disk_slips_and_a_longer_bay_takes_all_beyond_it_along_with_the_markers():
    """A robot 1 % longer than declared was a gain of inputs, one of loads and a scale of positions, none certain."""
    (problem, _, causes), edges, k = declared(), ROBOT.bay_edges, len(ROBOT.bay_edges) - 2
    bay = "length (s = {:.4g} to {:.4g} m)".format(*edges[k : k + 2])
    for name, values, along in (
        (f"disk slipped (disk at s = {edges[k]:.4g} m)", {"along": 2e-3}, 2e-3 * np.eye(len(edges))[k]),
        (bay, {"factor": 2.0}, np.clip(edges - edges[k], 0.0, edges[k + 1] - edges[k])),
    ):
        moved = causes[name].apply(problem.experiment, values)
        np.testing.assert_allclose(moved.robot.bay_edges, edges + along, atol=1e-12)
        seen, markers = moved.observation, problem.experiment.observation.markers
        assert seen.declared == markers
        assert seen.markers == pytest.approx(np.interp(markers, edges, edges + along))
    with np.errstate(divide="raise"):  # no element is predicted without length
        assert problem.run([Job(moved, evaluate(problem, (), {}).run.trajectories)])[0].solved


# ------------------------------------------------------------ not solved, or impossible


def test_a_candidate_that_is_not_solved_is_not_improved():
    """A search among places of a soft robot ended in a LinAlgError of the least squares."""
    values, lost = {"gravity": {"g_x": 0.0, "g_y": 0.0, "g_z": 0.0}}, np.full(6, np.nan)
    free = (("gravity", "g_x"),)
    unsolved = Fit((effect("gravity"),), values, lost, np.inf, np.inf, np.ones((6, 1)), free, None, lost)
    with pytest.raises(StopIteration) as done:
        next(fitting.descend(None, unsolved, fitting.Race()))
    assert done.value.value is unsolved


def test_laws_of_the_material_that_exclude_each_other_are_not_tried_together_and_not_solved():
    """A search on a soft robot ended with "backbone.nonlinear: cannot be combined with superelastic"."""
    robot = ROBOT.with_backbone(nonlinear=NonlinearMaterial(cubic=5.0))
    problem = problem_of(measured(robot=robot, model=replace(MODEL, gravity=(0.0, 0.0, -9.81))))
    declared = evaluate(problem, (), {})
    assert declared.solved
    both = (effect("superelastic"), effect("actuator_gain"))
    scores = {s.effect.name: s for s in screen(problem, declared, both)[0]}
    assert scores["superelastic"].note == "the robot cannot be combined with it"
    assert scores["actuator_gain"].note == "" and scores["actuator_gain"].start.point
    start = {"superelastic": {"threshold_strain": 0.01, "plateau_ratio": 0.2}, "actuator_gain": {"gain": 1.0}}
    fit = fitting.fit(problem, both, start)
    assert not fit.solved
    assert "backbone.nonlinear: given; cannot be combined with superelastic" in fit.run.message

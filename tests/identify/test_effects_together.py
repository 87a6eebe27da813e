"""Effects that data show only together, and searches with many effects."""

from dataclasses import replace

import numpy as np
import pytest
from identify_data import MODEL, ROBOT, data_of, measured, positions
from identify_search import problem_of, searching, state_of

from tdcr_fe import LoadStep, ParallelRouting, Tendon
from tdcr_fe.effects import EFFECTS, Experiment, effect, with_effects
from tdcr_fe.identify import identify
from tdcr_fe.identify.search import _hidden, _worthwhile, fit_proposals, grow, pairs, scores_beside

SIGMA = 1e-4
#: Two tendons on opposite sides, elastic and tight in truth; the same stretch without pretension leaves one slack.
OPPOSITE = (Tendon(name, ParallelRouting(4.5e-3, angle)) for name, angle in (("t1", 0.0), ("t2", 180.0)))
OPPOSED = replace(ROBOT, tendons=tuple(OPPOSITE))
TRUTH = {"tendon_stretch": {"axial_stiffness": 300.0}, "pretension": {"tension_t1": 1.5, "tension_t2": 0.9}}


@pytest.fixture(scope="module")
def opposed():
    """One tendon pulled in by as much as the other one is let out, and single ones; readings with noise."""
    steps, names = [], []
    for k, (a, b) in enumerate([(1, -1), (-1, 1), (1, 0), (0, 1), (1, -0.3), (-0.3, 1)]):
        for x in (0.3, 0.65, 1.0, 0.5, 0.0):
            steps.append(LoadStep(displacements={"t1": 4e-3 * a * x, "t2": 4e-3 * b * x}))
            names.append(f"branch {k}")
    true = with_effects(Experiment(OPPOSED, replace(MODEL, elements_per_bay=3), tuple(steps)), TRUTH)
    return data_of(steps, positions(true, SIGMA, 2, 1e-4), OPPOSED, branches=names)


def opposed_search(data):
    """A search for the two effects and two others before its first step, and their names."""
    problem = problem_of(data, held=range(21, 31), sigma=SIGMA)
    names = ("stiffness_scale", "tendon_stretch", "pretension", "frame_misalignment")
    problem = replace(problem, catalogue=tuple(e for e in EFFECTS if e.name in names))
    forms = tuple(form for e in problem.catalogue for form in e.forms(problem.experiment))
    return replace(state_of(problem), dictionary=forms), {*TRUTH}


def leaves_noise(state, fit):
    count = np.count_nonzero(state.problem.held_out)
    return fit.held_cost < 1.3 * count < 0.1 * state.declared.held_cost


@pytest.mark.integration
def test_stretch_and_pretension_are_found_together(opposed):
    """Stretch alone leaves one tendon slack; pretension acts on elastic tendons only. As one step they leave noise."""
    (state, pair), search = opposed_search(opposed), searching(candidates=1)
    state = replace(state, dictionary=(effect("tendon_stretch"),))
    assert (pairs, state.best) in _hidden(search, state)
    state, found = pairs(search, state, state.declared)
    assert {e.listed for x in found for e in x.effects} == pair
    each = [x for x in found if x.score.effect.name == "pretension (each)"]
    state, (fit,) = fit_proposals(search, state, each)
    assert leaves_noise(state, fit)


@pytest.mark.campaign
@pytest.mark.parametrize("declared", [None, 20_000.0])
def test_search_finds_stretch_and_pretension(opposed, declared):
    """Beside tendons that are declared stiff, pretension hardly acts either: a clearance was found in its place."""
    robot = opposed.robot.with_tendons(axial_stiffness=declared)
    state, pair = opposed_search(replace(opposed, robot=robot))
    state = grow(searching(candidates=3), state)
    assert {e.listed for e in state.best.effects} >= pair
    assert leaves_noise(state, state.best)


def test_no_pair_is_simulated_whose_second_effect_cannot_show():
    """Pretension does nothing where tendons are driven by tension; it was simulated beside nine models."""
    state = state_of(problem_of(measured()))
    both = (effect("tendon_stretch"), effect("pretension"))
    state, scores, _ = scores_beside(replace(state, dictionary=both), state.declared)
    # round-off may show the stretch
    scales = [{(x.effect.name, p.name): 1e-3 for p in x.effect.parameters} for x in scores]
    scores = [replace(x, note="", scales=s) for x, s in zip(scores, scales, strict=True)]
    state = replace(state, scores={frozenset(): (scores, state.declared)})
    runs = state.problem.forward.runs
    _, found = pairs(searching(), state, state.declared)
    assert not found and state.problem.forward.runs == runs


@pytest.mark.parametrize(("share", "worthwhile"), [(0.85, True), (0.95, False)])
def test_many_effects_must_each_remove_a_tenth_on_held_out_steps(share, worthwhile):
    state = state_of(problem_of(measured(), held=(2, 4, 6)))
    gravity, costs = (effect("gravity"),), ((100.0, 4), (100.0 * share, 5))
    fits = [replace(state.declared, held_cost=x, effects=gravity * n) for x, n in costs]
    state = replace(state, best=fits[0])
    assert _worthwhile(state, fits[1]) is worthwhile
    assert _worthwhile(state, replace(fits[1], effects=fits[1].effects[:4]))


@pytest.mark.integration
def test_where_held_out_steps_cannot_decide_the_fitted_ones_do():
    """Gravity and a backbone 5 % softer: gravity alone was named, at -5.3 m/s^2 along the axis, where there is none."""
    truth = {"gravity": {"g_x": 9.81}, "stiffness_scale": {"bending": 0.95, "torsion": 0.95}}
    result = identify(measured(truth))
    assert (result.verdict, {e.name for e in result.effects}) == ("explained", set(truth))
    for e in result.effects:
        for name in {"gravity": ("g_x", "g_y", "g_z"), "stiffness_scale": ("bending",)}[e.name]:
            found = e.parameters[name]
            assert abs(found.value - truth[e.name].get(name, 0.0)) < 3.0 * found.std_error

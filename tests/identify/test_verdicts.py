"""Verdicts on insufficient data, interruptions of the command, and the end of its workers."""

from dataclasses import replace

import numpy as np
import pytest
from identify_data import GRAVITY, data_of, measured, positions
from searches import begun, concluded, declared, identified, problem_of, state_of, with_model

from tdcr_fe.commands import identify as command
from tdcr_fe.effects import EFFECTS, Experiment, effect
from tdcr_fe.identify import identify
from tdcr_fe.identify.causes import Cause
from tdcr_fe.identify.criteria import mostly_estimated_noise, unknown_noise, unusable_data
from tdcr_fe.identify.identification import NotSolved
from tdcr_fe.identify.problem import evaluate
from tdcr_fe.identify.report import render
from tdcr_fe.identify.screening import screen
from tdcr_fe.identify.search import worth_fitting
from tdcr_fe.identify.sentences import sentences
from tdcr_fe.identify.verdict import separating_experiments


@pytest.fixture(scope="module")
def bent():
    """Readings of a robot with gravity that is not declared."""
    return measured(GRAVITY)


def some(data, chosen, **changes):
    """Some of the readings, changed."""
    return replace(data, readings=tuple(replace(r, **changes) for r in data.readings if chosen(r)))


HIDDEN = [
    (1e-3, "explained by a law found", "unlisted cause: the backbone is"),
    (1e-6, "explained", "(not certain)"),
]


@pytest.mark.parametrize(("hidden", "verdict", "words"), HIDDEN)
def test_a_law_is_found_where_it_is_more_probable_than_all_else(hidden, verdict, words):
    """One that was as good as seven others was found, at a probability of 0.18."""
    problem, _, causes = declared()
    law = causes["axial compliance"]
    true = law.apply(problem.experiment, {"compliance": hidden})
    state = state_of(problem_of(data_of(problem.data.steps, positions(true))))
    best = evaluate(state.problem, (law,), {law.name: {"compliance": hidden}})
    result = concluded(state.with_fit(best), best=best)
    assert result.verdict == verdict and words in sentences(result)[0]


UNUSABLE = {
    "one reading": (lambda bent: replace(bent, readings=bent.readings[3:4]), "1 reading: at least 4 are needed"),
    "two steps": (lambda bent: some(bent, lambda r: r.step <= 2, sigma=None), "no sigma is given for position"),
    "noise": (lambda bent: measured(sigma=0.09), "the noise is larger than the motion of the robot"),
}  # fmt: skip


@pytest.mark.parametrize(("data", "reason"), UNUSABLE.values(), ids=UNUSABLE)
def test_unusable_data_give_no_verdict(bent, data, reason):
    """e3bbe5d: "nothing missing", with the residual itself taken for the noise."""
    state = begun(data(bent))
    assert unusable_data(state.problem, state.declared).startswith(reason)
    result = concluded(state)
    headline, why, *_ = sentences(result)
    assert result.verdict == "cannot tell" and headline.startswith("Inconclusive")
    assert why.lower().startswith(reason.lower())


def test_without_sigma_a_model_that_leaves_noise_proves_nothing():
    """The noise is estimated from what the model leaves, so that it cannot speak for the model."""
    data = measured(given=False)
    result = concluded(begun(data))
    assert (result.verdict, result.remaining.where) == ("cannot tell", "the noise")
    text = render(result)
    assert "the noise of the sensors is not known" in text
    assert "No sigma is given for position: the noise is estimated" in text
    assert unknown_noise(data) == []


def test_readings_without_sigma_beside_more_that_have_one_prove_nothing_missing():
    data = measured()
    few = tuple(replace(r, sigma=None) if r.step <= 4 else r for r in data.readings)
    assert mostly_estimated_noise(replace(data, readings=few)) == ""
    assert mostly_estimated_noise(measured(given=False)).startswith("no sigma is given for position")


def test_without_sigma_an_effect_is_named_all_the_same():
    truth = {"gravity": {"g_x": 3.0, "g_y": 0.0, "g_z": 0.0}}
    assert concluded(with_model(begun(measured(truth, given=False)), truth)).verdict == "explained"


@pytest.fixture
def few(bent):
    """Nine readings of three steps: none can be held out."""
    return some(bent, lambda r: r.step in (2, 7, 10) and r.location == 0.2)


def test_few_readings_that_an_effect_follows_prove_nothing(few):
    result = concluded(with_model(begun(few), GRAVITY))
    assert len(few.readings) == 9 and result.held_out_steps == ()
    assert result.verdict == "cannot tell" and "too few" in result.remaining.description


@pytest.mark.integration
def test_few_readings_get_one_effect_with_fewer_parameters_than_readings_at_most(few):
    result = identify(few)
    assert result.verdict in ("cannot tell", "partly explained", "unexplained") and len(result.effects) <= 1
    # Steps after the last reading, several effects and local causes are not simulated.
    assert len(result.data.steps) == 10 and result.log.runs < 150
    declared = Experiment(few.robot, few.model, few.steps)
    sizes = {form.name: len(form.parameters) for e in EFFECTS for form in (e, *e.forms(declared))}
    assert any(c.fitted for c in result.log.candidates)
    named = [n for c in result.log.candidates if c.fitted for n in c.name.split(" + ") if n in sizes]
    assert named and all(sizes[n] < len(few.readings) for n in named)


def test_candidates_with_more_parameters_than_readings_are_not_fitted(bent):
    state = begun(replace(bent, readings=bent.readings[:4]))
    problem = replace(state.problem, held_out=np.array([False, False, True, True]))
    scores, _ = screen(problem, state.declared, [effect("gravity"), effect("actuator_gain")])
    fitted = worth_fitting(problem, state.declared, [replace(s, drop=1e9) for s in scores])
    assert [x.score.effect.name for x in fitted] == ["actuator_gain"]


def test_several_causes_that_leave_noise_together_are_stated_but_not_named():
    weight, bent = {"g_x": 9.81, "g_y": 0.0, "g_z": 0.0}, {"kappa_x": 1.0, "kappa_y": 0.0}
    truth = {"gravity": weight, "precurvature": bent, "actuator_gain": {"gain": 1.1}}
    result = concluded(with_model(begun(measured(truth)), truth))
    assert result.verdict == "explained" and not any(e.found for e in result.effects)
    assert sentences(result)[0] == (
        "Explained, but none of it is certain: gravity, precurvature and actuator gain together leave only noise. One "
        "cause that is not in the dictionary would look the same."
    )
    document = result.to_json()
    assert document["effects"] == [] and list(document["stand_ins"]) == list(truth)
    assert all(cause["probability"] < 0.6 for cause in document["causes"])
    assert "none of it is certain" in render(result)


def test_forms_of_one_effect_are_separated_by_one_experiment():
    """``pretension`` for all tendons beside the same for each: the sentence on it stood there twice."""
    own, other = effect("pretension"), effect("gravity")
    text = separating_experiments(own, ("pretension (each)", "gravity"), EFFECTS)
    of_gravity = f"for gravity: {other.separating_experiment}"
    assert text == f"for pretension: {own.separating_experiment}; {of_gravity}"
    assert separating_experiments(own, ("pretension (each)",), EFFECTS).count(own.separating_experiment) == 1
    jump = Cause("jump (from row 30 on)", own.kind, (), (), "")  # of no name, it has none: "for jump: ."
    assert separating_experiments(jump, ("jump (from row 29 on)",), EFFECTS) == ""
    assert separating_experiments(jump, ("gravity",), EFFECTS) == of_gravity


# ------------------------------------------------------------ the command


def test_implausible_declared_values_are_warned_of(tmp_path, capsys):
    """As ``tdcr-fe run`` does; before, tensions in grams only gave "did not converge"."""
    data = measured()
    thin = replace(data, robot=data.robot.with_backbone(density=5.6), readings=data.readings[:1])
    assert identified(tmp_path, thin, "-q", "--processes", "1") == 0
    assert "warning: backbone.density = 5.6 kg/m^3: outside" in capsys.readouterr().err


def test_there_is_one_process_for_each_core_at_most(tmp_path, monkeypatch):
    """``--processes 99`` was taken as it was, on a machine with two cores."""
    asked = []

    def ask(data, settings, progress):
        asked.append(settings.processes)
        raise NotSolved("enough")

    monkeypatch.setattr(command, "identify", ask)
    monkeypatch.setattr(command.os, "sched_getaffinity", lambda process: {0, 1}, raising=False)
    for number in ("99", "2", "1"):
        identified(tmp_path, measured(), "-q", "--processes", number)
    assert asked == [2, 2, 1]

"""What is different in every step: errors of inputs, shifts and forces, found with their size, and nowhere else."""

from dataclasses import replace

import numpy as np
import pytest
from identify_data import GRAVITY, LENGTH, MODEL, ROBOT, data_of, positions
from searches import begun, concluded, problem_of, state_of

from tdcr_fe import Experiment, InputError, Load, LoadStep, Reading, effect, simulate, with_effects
from tdcr_fe.identify import identify
from tdcr_fe.identify.criteria import residual_is_noise
from tdcr_fe.identify.problem import evaluate, with_elements
from tdcr_fe.identify.scatter import errors_of_inputs, find_scatter
from tdcr_fe.identify.search import with_scatter
from tdcr_fe.io.measured import read_measured
from tdcr_fe.validation.measured_folder import write_measured

SIGMA, FINE = 1e-4, replace(MODEL, elements_per_bay=4)
PULLS = [(a, b) for a in (0.0, 0.3, 0.6, 0.9, 1.2) for b in (0.0, 0.3, 0.6, 0.9, 1.2) if a or b]
#: Displacements are pulled one tendon at a time: the other one is slack.
PATHS = [(x, 0.0) for x in np.linspace(5e-4, 6e-3, 12)] + [(0.0, x) for x in np.linspace(5e-4, 6e-3, 12)]


def pulled(values, by="tensions"):
    """Load steps of the two tendons."""
    return tuple(LoadStep(**{by: {"t1": float(a), "t2": float(b)}}) for a, b in values)


def data(factors, added, by="tensions", pulls=PULLS, truth=None):
    """Readings of a robot whose inputs are the commanded ones times factors plus what is added, with noise."""
    actual = np.array(pulls) * factors + added * (np.array(pulls) > 0.0)
    true = with_effects(Experiment(ROBOT, FINE, pulled(actual, by)), truth or {})
    return data_of(pulled(pulls, by), positions(true, SIGMA, 1))


def searched(measured):
    """The declared model with three elements a bay, and what is different in every step and explains all beside it."""
    problem = problem_of(measured, sigma=SIGMA)
    state = state_of(replace(problem, experiment=with_elements(problem.experiment, 3)))
    return state, find_scatter(state.problem, state.best)


def scatter(measured):
    """Errors of the inputs, or what explains all, beside the declared model."""
    state, found = searched(measured)
    return found or errors_of_inputs(state.problem, state.best)


def errors(size, count, seed=0):
    return np.random.default_rng(seed).normal(0.0, size, (count, 2))


def test_relative_errors_of_tensions_are_found_with_their_size_and_reported():
    own = errors(0.04, len(PULLS))
    state, found = searched(data(1.0 + own, 0.0))
    assert found.kind == "relative"
    assert found.size == pytest.approx(np.std(own[np.array(PULLS) > 0.0]), rel=0.1)
    assert found.before.chi2_per_dof > 50.0
    # one or two of six readings of a step go into its errors
    share = np.count_nonzero(PULLS) / (6 * len(PULLS))
    assert found.after.chi2_per_dof == pytest.approx(1.0 - share, rel=0.25)
    result = concluded(replace(state, scatter=found))
    assert (result.verdict, result.remaining.where) == ("cannot tell", "the inputs")
    assert result.to_json()["scatter"]["kind"] == "relative"
    assert "% of their values, different in every step" in str(result)


def test_absolute_errors_of_displacements_are_found_with_their_size_and_unit():
    own = errors(2e-4, len(PATHS))
    found = scatter(data(1.0, own, "displacements", PATHS))
    assert (found.kind, found.unit) == ("absolute", "m")
    assert found.size == pytest.approx(np.std(own[np.array(PATHS) > 0.0]), rel=0.15)


def test_a_force_that_is_another_one_in_every_step_is_found_with_its_place_and_size():
    forces = np.random.default_rng(3).normal(0.0, 0.02, (len(PULLS), 3))
    loads = [{"hand": Load(ROBOT.bay_edges[3], tuple(f))} for f in forces.tolist()]
    steps = tuple(replace(step, loads=x) for step, x in zip(pulled(PULLS), loads, strict=True))
    state, found = searched(data_of(pulled(PULLS), positions(Experiment(ROBOT, FINE, steps), SIGMA, 1)))
    assert (found.what, found.place) == ("force", f"disk at s = {ROBOT.bay_edges[3]:.4g} m")
    assert found.size == pytest.approx(0.02, rel=0.2)

    result = concluded(replace(state, scatter=found))
    assert result.verdict == "unexplained"
    assert f"A force on the {found.place} with a standard deviation of" in str(result)


def test_positions_that_are_shifted_together_in_every_step_are_no_cause_in_the_robot():
    measured = data(1.0, 0.0)
    shifts = np.random.default_rng(3).normal(0.0, 1e-3, (len(PULLS), 3))
    values = [r.value + shifts[r.step - 1, "xyz".index(r.quantity[-1])] for r in measured.readings]
    moved = tuple(replace(r, value=v) for r, v in zip(measured.readings, values, strict=True))
    state, found = searched(replace(measured, readings=moved))
    assert (found.what, found.unit) == ("positions", "m")
    assert found.size == pytest.approx(1e-3, rel=0.2)
    assert concluded(replace(state, scatter=found)).remaining.where == "the data"

    # a cause that explains a part of them is no reason to keep it
    cause = effect("frame_misalignment")
    values = {cause.name: {**cause.null_values(state.problem.experiment), "rot_x": 0.05}}
    best = evaluate(state.problem, (cause,), values)
    found_beside = with_scatter(replace(state, best=best))
    assert (found_beside.best, found_beside.scatter) == (state.declared, found)
    # but one that explains most of them is
    best = replace(best, cost=0.02 * state.declared.cost)
    assert with_scatter(replace(state, best=best)).best is best


def test_readings_without_positions_have_no_shift():
    measured = data(1.0, 0.0)
    read = [(f"curvature_{axis}", s) for axis in "xy" for s in (0.05, 0.1, 0.15)]
    curved = [Reading(step, *what, 0.0, 0.1) for step in measured.step_ids for what in read]
    assert scatter(replace(measured, readings=tuple(curved))) is None


@pytest.mark.parametrize(
    ("factors", "truth"),
    [(1.0, None), (1.1, None), (1.0, {"precurvature": {"kappa_x": 0.8, "kappa_y": 0.0}})],
    ids=["noise", "gain", "precurvature"],
)
def test_noise_and_systematic_causes_are_no_scatter(factors, truth):
    assert scatter(data(factors, 0.0, truth=truth)) is None


def test_errors_that_change_slowly_from_row_to_row_are_no_scatter():
    """They follow the row before: a stiffness that fell with time was 'errors of the inputs'."""
    slow = np.sin(0.5 * np.arange(len(PULLS)))[:, None] * np.ones((1, 2))
    assert searched(data(1.0 + 0.05 * slow, 0.0))[1] is None


def test_errors_of_displacements_that_follow_the_tension_are_no_scatter():
    """Tendons that stiffen as they are pulled were 'errors of the inputs', which no effect predicts."""
    rng = np.random.default_rng(5)
    wound = rng.uniform(1e-3, 6e-3, 30)[:, None] * np.tile(np.eye(2), (15, 1))
    forces = rng.normal(0.0, 0.05, (30, 3)) * (1.0, 1.0, 0.0)
    loads = [{"tip": Load(LENGTH, tuple(f))} for f in forces.tolist()]

    def experiment(inputs):
        each = zip(pulled(inputs, "displacements"), loads, strict=True)
        return Experiment(ROBOT, FINE, tuple(replace(step, loads=x) for step, x in each))

    declared = experiment(wound)
    tension = np.array([s.base_tensions for s in simulate(ROBOT, declared.model, declared.steps).steps])
    lost = 2e-4 * (1.0 - np.exp(-tension / np.median(tension[wound > 0.0])))
    lost -= np.mean(lost[wound > 0.0])  # a mean would be an offset
    true = experiment(wound - lost * (wound > 0.0))
    assert scatter(data_of(declared.steps, positions(true, SIGMA, 1))) is None


def test_large_errors_of_a_few_steps_are_found_there_and_are_no_noise_of_the_inputs():
    own = errors(0.04, len(PULLS))
    own[np.arange(len(PULLS)) % 8 != 3] = 0.0
    state, found = searched(data(1.0 + 4.0 * own, 0.0))
    assert (found.what, found.steps) == ("inputs", (4, 12, 20))
    assert "in steps 4, 12 and 20 alone" in str(concluded(replace(state, scatter=found)))
    assert errors_of_inputs(state.problem, state.best) is None


def test_declared_errors_of_the_inputs_make_their_scatter_noise():
    """Without them the same data are no noise; the residual then has a variance of one, step by step."""
    scattered = data(1.0, errors(0.02, len(PULLS), seed=4))
    for measured, noise in ((scattered, False), (replace(scattered, input_sigma=(0.02, 0.02)), True)):
        state = begun(measured)
        assert residual_is_noise(state.problem, state.declared) == noise
    r = state.declared.residual
    assert np.mean(r**2) == pytest.approx(1.0, abs=0.25)
    problem = state.problem
    np.testing.assert_allclose(problem.lengths(problem.whitened(r)), problem.sigma * r, atol=1e-12)
    assert np.all(state.problem.whole_sigma >= SIGMA)


def test_errors_of_the_inputs_are_read_and_written(tmp_path):
    for text, sigma in (("0.03", (0.03, 0.03)), ("{ t1 = 0.02, t2 = 0.01 }", (0.02, 0.01))):
        write_measured(data(1.0, 0.0), tmp_path / "set")
        with (tmp_path / "set" / "model.toml").open("a") as file:
            file.write(f"\n[inputs]\nsigma = {text}\n")
        found = read_measured(tmp_path / "set")
        assert found.input_sigma == sigma
        write_measured(found, tmp_path / "again")
        assert read_measured(tmp_path / "again").input_sigma == sigma
    with (tmp_path / "set" / "model.toml").open("a") as file:
        file.write("sigma_of = 1.0\n")
    with pytest.raises(InputError, match=r"model\.toml: inputs\.sigma_of = 1\.0: .* did you mean sigma"):
        read_measured(tmp_path / "set")


@pytest.mark.integration
def test_an_effect_is_found_beside_declared_errors_of_the_inputs():
    """They move a robot with its weight in another way than without: more than noise was left."""
    scattered = data(1.0, errors(0.02, len(PULLS), seed=4), truth=GRAVITY)
    found = identify(replace(scattered, input_sigma=(0.02, 0.02)))
    assert (found.verdict, [e.name for e in found.effects]) == ("explained", ["gravity"])
    for name, value in GRAVITY["gravity"].items():
        estimate = found.effects[0].parameters[name]
        assert abs(estimate.value - value) < 3.0 * estimate.std_error

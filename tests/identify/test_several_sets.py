"""Several data sets of one robot: each begins unloaded, effects are shared, errors are given for each."""

import json
from dataclasses import replace

import numpy as np
import pytest
from identify_data import FRICTIONAL, GRAVITY, LENGTH, MODEL, ROBOT, measured, positions, sequence, simulated
from searches import causes_of, fitted, problem_of, tips_of_run

from tdcr_fe import Experiment, InputError, Load, LoadStep, SolverSettings, effect, with_effects
from tdcr_fe.cli import main
from tdcr_fe.identify.fitting import fit
from tdcr_fe.identify.forward import Job, run_settings, simulate_experiment
from tdcr_fe.identify.rows import blocks, held_out_branches
from tdcr_fe.io.measured import join_measured
from tdcr_fe.solve.sensitivities.differences import tabulated
from tdcr_fe.solve.sensitivities.parameters import ModelParameter
from tdcr_fe.validation.measured_folder import write_measured

ROUGH = ROBOT.with_tendons(friction_coefficient=0.3)


def pulls(*values):
    return tuple(LoadStep(tensions={"t1": a, "t2": b}) for a, b in values)


FIRST, SECOND = pulls((1.0, 0.0), (0.4, 0.0), (0.4, 0.6)), pulls((0.3, 0.9), (0.6, 0.2))


def both():
    return Experiment(ROUGH, FRICTIONAL, FIRST + SECOND, restarts=(len(FIRST),))


def test_every_sequence_begins_with_the_unloaded_robot():
    """The same positions as in runs of their own, with friction, whose history would show otherwise."""
    joined = simulated(both(), record=True)
    own = [simulated(Experiment(ROUGH, FRICTIONAL, s)) for s in (FIRST, SECOND)]
    np.testing.assert_array_equal(joined.positions, np.concatenate([r.positions for r in own]))
    np.testing.assert_array_equal(joined.base_tensions, np.concatenate([r.base_tensions for r in own]))
    through = simulated(Experiment(ROUGH, FRICTIONAL, FIRST + SECOND))
    assert np.abs(through.positions[3:] - joined.positions[3:]).max() > 1e-5
    # A neighbour that follows the recorded path agrees with one that does not.
    other = replace(both(), model=replace(FRICTIONAL, gravity=(0.0, 0.5, 0.0)))
    along = simulated(other, along=joined.trajectories)
    np.testing.assert_allclose(along.positions, simulated(other).positions, atol=1e-6 * LENGTH)


def test_effects_with_a_history_begin_anew_with_every_sequence():
    loss = {"actuator_loss": {"dead_band": 0.05, "efficiency": 0.9}}
    alone = [with_effects(Experiment(ROUGH, FRICTIONAL, s), loss) for s in (FIRST, SECOND)]
    joined = both().with_sequences(lambda e: with_effects(e, loss))
    assert joined.steps == alone[0].steps + alone[1].steps and joined.restarts == (3,)
    assert [e.steps for e in joined.sequences] == [e.steps for e in alone]


def test_where_a_sequence_is_not_solved_the_run_is_not():
    bad = replace(both(), steps=(FIRST[0], LoadStep(tensions={"t1": 5e4}), *FIRST[2:], *SECOND))
    settings = replace(run_settings(SolverSettings(), 2e-5), max_iterations=3, min_substep=1.0)
    run = simulate_experiment(Job(bad), settings)
    assert not run.solved and "step 2" in run.message


def sets():
    """The same loading twice, the second time only its first eight steps, with other noise; an offset is declared."""
    known = {"marker_offset": {"offset_z_marker_2": 0.0}}
    a, b = (replace(measured(GRAVITY, seed=n), name=x, effects=known) for x, n in (("A", 0), ("B", 5)))
    return a, replace(b, readings=tuple(r for r in b.readings if r.step <= 8))


def test_joined_sets_keep_their_readings_branches_and_begin_anew():
    a, b = sets()
    joined = join_measured([a, b])
    assert (joined.name, joined.restarts, len(joined.steps)) == ("A + B", (11,), 19)
    assert len(joined.readings) == len(a.readings) + len(b.readings)
    assert joined.readings[len(a.readings)].step == 12
    parts = blocks(joined)
    assert len(parts) > 4 and not any(k < 11 <= m for p in parts for k in p for m in p)
    assert held_out_branches(joined, ["B/*"]) == tuple(range(11, 19))
    assert problem_of(joined).experiment.restarts == (11,)
    assert join_measured([a]) is a
    declared = [replace(x, effects={"marker_offset": {"offset_z": 8e-3}}) for x in (a, b)]
    assert join_measured(declared).experiment.observation.offset == (0.0, 0.0, 8e-3)


DIFFERENT = [
    (lambda b: replace(b, robot=replace(b.robot, tip_mass=0.01)), "robot = another tip_mass"),
    (lambda b: replace(b, model=replace(b.model, gravity=(0.0, 0.0, -9.81))), "model = another gravity"),
    (lambda b: replace(b, effects={"marker_offset": {"offset_z": 9e-3}}), "effects"),
    (lambda b: replace(b, name="A"), "two folders have this name"),
]


@pytest.mark.parametrize(("change", "text"), DIFFERENT)
def test_sets_of_different_robots_are_refused_by_what_differs(change, text):
    a, b = sets()
    with pytest.raises(InputError, match=text):
        join_measured([a, change(b)])


@pytest.mark.integration
def test_the_command_finds_shared_effects_and_gives_the_errors_of_each(tmp_path):
    for data in sets():
        write_measured(data, tmp_path / data.name)
    out, folders = tmp_path / "out", [str(tmp_path / n) for n in "AB"]
    assert main(["identify", *folders, "-o", str(out), "-q", "--processes", "1"]) == 0
    document = json.loads((out / "result.json").read_text())
    assert document["verdict"] == "explained" and document["dataset"] == "A + B"
    assert [e["effect"] for e in document["effects"]] == ["gravity"]
    a, b = document["datasets"]
    assert (a["dataset"], b["dataset"], b["steps"]) == ("A", "B", [12, 19])
    assert all(s["after"]["fit"]["chi2_per_dof"] < 2.0 for s in (a, b))
    report = (out / "report.html").read_text(encoding="utf-8")
    assert "B (steps 12 to 19)" in report
    for name in ("effects_A.toml", "effects_B.toml"):
        assert f"<code>{name}</code>" in report and (out / name).exists()
    assert "<code>effects.toml" not in report and "run effects.toml" not in report
    # Each scenario repeats the fit of its own sequence.
    rms = []
    for name, data in zip("AB", sets(), strict=True):
        run = tips_of_run(out / f"effects_{name}.toml", tmp_path / name / "run")
        tips = [r for r in data.readings if r.location == LENGTH and r.quantity == "position_y"]
        rms.append(np.sqrt(np.mean([(run.loc[str(r.step), "tip_y"] - r.value) ** 2 for r in tips])))
    assert max(rms) < 3e-4


def test_derivatives_of_joined_sets_are_those_of_each():
    """Gravity and friction, in one run of both sequences and in runs of each."""
    experiment = both()

    def parameter(name, value, apply):
        return lambda e: tabulated(ModelParameter(name, value, 1.0, apply), e)

    made = [
        parameter("g", 0.0, lambda e, v: replace(e, model=replace(e.model, gravity=(0.0, v, 0.0)))),
        parameter("mu", 0.3, lambda e, v: replace(e, robot=e.robot.with_tendons(friction_coefficient=v))),
    ]
    joined = simulated(experiment, parameters=tuple(p(experiment) for p in made))
    own = [simulated(e, parameters=tuple(p(e) for p in made)) for e in experiment.sequences]
    assert joined.derivatives.names == ("g", "mu")
    for field in ("positions", "rotations", "displacements", "base_tensions", "distal_tensions"):
        parts = np.concatenate([getattr(r.derivatives, field) for r in own])
        np.testing.assert_allclose(getattr(joined.derivatives, field), parts, rtol=1e-9, atol=1e-12)
    assert np.abs(joined.derivatives.positions[..., 1]).max() > 1e-4


def test_a_gain_of_the_second_folder_is_fitted_beside_a_shared_effect():
    """Tendons tied anew between two series: 1.06 and 0.96 times the commands, in the second one only."""
    first = replace(measured(GRAVITY), name="A")
    again = {"actuator_gain": {"gain_t1": 1.06, "gain_t2": 0.96}}
    problem = problem_of(join_measured([first, replace(measured({**GRAVITY, **again}, seed=5), name="B")]))
    forms = {f.name: f for f in effect("actuator_gain").forms(problem.experiment)}
    gain = forms["actuator_gain (each tendon, each later folder)"]
    start = {**GRAVITY, gain.name: gain.null_values(problem.experiment)}
    found = fit(problem, [effect("gravity"), gain], start)
    true = {"gain_t1_folder_2": 1.06, "gain_t2_folder_2": 0.96}
    assert found.values[gain.name] == pytest.approx(true, abs=5e-3)
    assert found.cost < 1.3 * problem.count


def test_a_force_in_the_second_folder_alone_is_a_cause():
    """A weight that was hung on between two series; the loading says nothing of it."""
    weight = {"weight": Load(LENGTH, (0.0, -0.02, 0.0))}
    loaded = tuple(replace(s, loads={**s.loads, **weight}) for s in sequence())
    true = positions(Experiment(ROBOT, replace(MODEL, elements_per_bay=4), loaded), seed=5)
    joined = join_measured([replace(measured(), name="A"), replace(measured(), name="B", readings=true)])
    problem = problem_of(joined)
    cause = causes_of(problem)[1]["force of fixed direction, in a part of the rows (tip, from row 12 on)"]
    found = fitted(problem, cause)
    assert found.values[cause.name] == pytest.approx({"x": 0.0, "y": -0.02, "z": 0.0}, abs=5e-4)
    assert found.cost < 1.3 * problem.count

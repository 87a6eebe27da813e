"""Gains, idle tensions and lags: for all commands, for each tendon, for each folder of measured data."""

from dataclasses import replace
from itertools import compress

import numpy as np
import pytest
from robots import LENGTH, three

from tdcr_fe.effects import ExcitationRange, Experiment, effect, with_effect, with_effects
from tdcr_fe.model.loading import Load, LoadStep, Model, resolve

PULLS = ({"t1": 1.0}, {"t1": 0.5, "t2": 0.4}, {"t1": 0.0}, {"t2": 0.8})
ALONE = Experiment(three(), Model(elements_per_bay=1), tuple(LoadStep(tensions=x) for x in PULLS))
DRIVEN = replace(ALONE, steps=(LoadStep(tensions={"t1": 1.0}, displacements={"t2": 1e-3}),))
#: The first three steps and the last one, of two folders.
BOTH = replace(ALONE, restarts=(3,))


def tensions(experiment):
    return [dict(s.tensions) for s in experiment.steps]


def test_the_most_particular_gain_counts():
    gain = {"gain": 2.0, "gain_t2": 3.0, "gain_folder_2": 5.0, "gain_t1_folder_1": 7.0}
    found = BOTH.with_sequences(lambda e: with_effects(e, {"actuator_gain": gain}))
    assert tensions(found) == [{"t1": 7.0}, {"t1": 3.5, "t2": pytest.approx(1.2)}, {"t1": 0.0}, {"t2": 4.0}]
    assert found.restarts == (3,) and (found.folder, found.folders) == (1, 1)
    (step,) = with_effects(DRIVEN, {"actuator_gain": {"gain": 2.0, "gain_t2": 3.0}}).steps
    assert step.tensions == {"t1": 2.0} and step.displacements == {"t2": pytest.approx(3e-3)}
    with pytest.raises(ValueError, match="gain_folder_2"):
        with_effects(ALONE, {"actuator_gain": {"gain_folder_2": 1.1}})


def test_a_tendon_is_never_pulled_by_less_than_the_idle_tension():
    """Also one that no step has named yet; those driven by displacement are left alone."""
    found = with_effects(ALONE, {"idle_tension": {"tension": 0.45, "tension_t3": 0.1}})
    first = {"t1": 1.0, "t2": 0.45, "t3": 0.1}
    assert tensions(found) == [first, {"t1": 0.5, "t2": 0.45}, {"t1": 0.45}, {"t2": 0.8}]
    (step,) = with_effects(DRIVEN, {"idle_tension": {"tension": 0.2}}).steps
    assert step.tensions == {"t1": 1.0, "t3": 0.2} and step.displacements == {"t2": 1e-3}


def test_forms_are_for_tendons_and_with_several_folders_for_folders():
    gain = effect("actuator_gain")
    single = [f"actuator_gain (t{k})" for k in (1, 2, 3)]
    assert [f.name for f in gain.forms(ALONE)] == ["actuator_gain", "actuator_gain (each tendon)", *single]
    kinds = {f.name.partition(" (")[2][:-1]: [p.name for p in f.parameters] for f in gain.forms(BOTH)}
    assert list(kinds) == [
        "", "each tendon", "each later folder", "each tendon, each later folder", "each folder",
        "each tendon, each folder", "t1", "t2", "t3",
    ]  # fmt: skip
    assert kinds["each tendon, each later folder"] == [f"gain_t{k}_folder_2" for k in (1, 2, 3)]
    assert kinds["each folder"] == ["gain_folder_1", "gain_folder_2"]
    assert len(gain.forms(replace(BOTH, robot=replace(BOTH.robot, tendons=BOTH.robot.tendons[:1])))) == 3
    for form in gain.forms(BOTH):
        assert form.apply(BOTH, form.null_values(BOTH)).steps == BOTH.steps


@pytest.mark.parametrize("name", ["actuator_gain", "idle_tension"])
def test_a_folder_alone_with_its_own_values_is_that_folder_among_several(name):
    one = effect(name).parameters[0].name
    values = {one: 1.1, f"{one}_t1_folder_1": 0.7, f"{one}_folder_2": 0.9}
    for part in BOTH.sequences:
        own = effect(name).alone(values, part)
        single = replace(part, folder=1, folders=1)
        assert effect(name).apply(single, own).steps == effect(name).apply(part, values).steps
        effect(name).check(own, single)


# ------------------------------------------------------------ time lag


def timed(*values: float) -> Experiment:
    """Displacements of two tendons [m], a second apart; the second moves by a fifth of the first."""
    moved = ({"t1": v, "t2": 0.2 * v, "t3": 0.0} for v in values)
    steps = (LoadStep(displacements=x, time=float(t)) for t, x in enumerate(moved, start=1))
    return Experiment(three(), Model(), tuple(steps))


def read_at(lagged: Experiment) -> list[tuple[float, float]]:
    """Time and displacement of the first tendon where the readings belong to."""
    actions = resolve(lagged.robot, lagged.steps)
    whole = [share == 1.0 for _, share in lagged.ends]
    return [(a.time, float(a.values[0])) for a in compress(actions, whole)]


@pytest.mark.parametrize("lag", [0.25, 1.0, 1.6])
def test_every_reading_sees_the_commands_of_an_earlier_time(lag):
    values = np.array([0.0, 1e-3, 3e-3, 2e-3, -1e-3, 0.0])
    lagged = with_effect(timed(*values), "time_lag", lag=lag)
    expected = [(max(t - lag, 1.0), np.interp(t - lag, np.arange(1, 7), values)) for t in range(1, 7)]
    np.testing.assert_allclose(read_at(lagged), expected, atol=1e-12)


@pytest.mark.parametrize("lag", [0.05, 0.25, 1.6])
def test_a_lag_beside_play_that_divides_steps_is_one_of_the_same_times(lag):
    """The first reading was that of the first part of its step, before anything had moved."""
    setup = with_effect(timed(4e-3, 6e-3), "actuator_backlash", backlash=5e-4)
    assert len(setup.steps) > 2
    actions, lagged = resolve(setup.robot, setup.steps), with_effect(setup, "time_lag", lag=lag)
    moved = np.interp(2.0 - lag, [a.time for a in actions], [a.values[0] for a in actions])
    expected = [read_at(setup)[0], (2.0 - lag, moved) if lag < 1.0 else read_at(setup)[0]]
    np.testing.assert_allclose(read_at(lagged), expected, atol=1e-12)
    assert effect("time_lag").bounds(setup)["lag"] == (0.0, 4.0)


def test_the_robot_passes_every_commanded_turning_point():
    """The peak at 2 s lies between two readings, and is a step of its own."""
    lagged = with_effect(timed(0.0, 2e-3, 0.0), "time_lag", lag=0.25)
    found = [(s.time, s.displacements["t1"]) for s in lagged.steps]
    np.testing.assert_allclose(found, [(1.0, 0.0), (1.75, 1.5e-3), (2.0, 2e-3), (2.75, 5e-4)])
    assert lagged.ends == ((0, 1.0), (1, 1.0), (2, 0.25), (2, 1.0))


def test_loads_are_interpolated_as_commands_are():
    before = LoadStep("", {"t1": 0.0}, loads={"tip": Load(LENGTH)}, time=1.0)
    after = LoadStep("", {"t1": 0.4}, loads={"tip": Load(LENGTH, (0.4, 0.0, 0.0))}, time=2.0)
    lagged = with_effect(Experiment(three(), Model(), (before, after)), "time_lag", lag=0.25)
    assert lagged.steps[-1].loads["tip"].force[0] == pytest.approx(0.3)
    assert lagged.steps[-1].tensions["t1"] == pytest.approx(0.3)


def test_without_lag_or_without_times():
    setup = timed(0.0, 1e-3)
    assert with_effect(setup, "time_lag", lag=0.0) == setup
    untimed = Experiment(three(), Model(), (LoadStep(tensions={"t1": 1.0}),))
    assert effect("time_lag").probe_points(untimed, ExcitationRange(duration=1.0)) == []

"""Gains and idle tensions: for all commands, for each tendon, for each folder of measured data."""

from dataclasses import replace

import pytest
from robots import three

from tdcr_fe.effects import ExcitationRange, Experiment, effect, with_effects
from tdcr_fe.model.loading import LoadStep, Model

MODEL = Model(elements_per_bay=1)
STEPS = (
    LoadStep(tensions={"t1": 1.0}),
    LoadStep(tensions={"t1": 0.5, "t2": 0.4}),
    LoadStep(tensions={"t1": 0.0}),
    LoadStep(tensions={"t2": 0.8}),
)
ALONE = Experiment(three(), MODEL, STEPS)
#: The first three steps and the last one, of two folders.
BOTH = replace(ALONE, restarts=(3,))


def tensions(experiment):
    return [dict(s.tensions) for s in experiment.steps]


def test_the_most_particular_gain_counts():
    gain = {"gain": 2.0, "gain_t2": 3.0, "gain_folder_2": 5.0, "gain_t1_folder_1": 7.0}
    found = BOTH.with_sequences(lambda e: with_effects(e, {"actuator_gain": gain}))
    assert tensions(found) == [{"t1": 7.0}, {"t1": 3.5, "t2": pytest.approx(1.2)}, {"t1": 0.0}, {"t2": 4.0}]
    assert found.restarts == (3,) and (found.folder, found.folders) == (1, 1)
    assert tensions(with_effects(ALONE, {"actuator_gain": {"gain": 2.0, "gain_t2": 3.0}}))[1] == {
        "t1": 1.0,
        "t2": pytest.approx(1.2),
    }
    with pytest.raises(ValueError, match="gain_folder_2"):
        with_effects(ALONE, {"actuator_gain": {"gain_folder_2": 1.1}})


def test_a_tendon_is_never_pulled_by_less_than_the_idle_tension():
    """Also one that no step has named yet; those driven by displacement are left alone."""
    found = with_effects(ALONE, {"idle_tension": {"tension": 0.45, "tension_t3": 0.1}})
    assert tensions(found) == [
        {"t1": 1.0, "t2": 0.45, "t3": 0.1},
        {"t1": 0.5, "t2": 0.45},
        {"t1": 0.45},
        {"t2": 0.8},
    ]
    driven = replace(ALONE, steps=(LoadStep(tensions={"t1": 1.0}, displacements={"t2": 1e-3}),))
    (step,) = with_effects(driven, {"idle_tension": {"tension": 0.2}}).steps
    assert step.tensions == {"t1": 1.0, "t3": 0.2} and step.displacements == {"t2": 1e-3}


def test_idle_tensions_are_tried_where_commands_are_smaller():
    idle, excitation = effect("idle_tension"), ExcitationRange(tension=1.0)
    assert idle.probe_points(ALONE, excitation) == [[{"tension": 0.02}]]
    taut = replace(ALONE, steps=(LoadStep(tensions={"t1": 0.5, "t2": 0.4, "t3": 0.3}),))
    travel = replace(ALONE, steps=(LoadStep(displacements={"t1": 1e-3}),))
    assert idle.probe_points(taut, excitation) == idle.probe_points(travel, excitation) == []


def test_forms_are_for_tendons_and_with_several_folders_for_folders():
    gain = effect("actuator_gain")
    assert [f.name for f in gain.forms(ALONE)] == ["actuator_gain", "actuator_gain (each tendon)"]
    kinds = {f.name.partition(" (")[2][:-1]: [p.name for p in f.parameters] for f in gain.forms(BOTH)}
    assert list(kinds) == [
        "", "each tendon", "each later folder", "each tendon, each later folder", "each folder",
        "each tendon, each folder",
    ]  # fmt: skip
    assert kinds["each tendon, each later folder"] == [f"gain_t{k}_folder_2" for k in (1, 2, 3)]
    assert kinds["each folder"] == ["gain_folder_1", "gain_folder_2"]
    one = replace(BOTH, robot=replace(BOTH.robot, tendons=BOTH.robot.tendons[:1]))
    assert len(gain.forms(one)) == 3
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

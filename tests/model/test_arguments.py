"""Public functions refuse arguments of another type by name, and name the function to call."""

import exudyn as exu
import numpy as np
import pytest
from arcs import paper_robot
from identify_data import measured

from tdcr_fe.effects import Experiment, with_effects
from tdcr_fe.identify import identify
from tdcr_fe.io.tables import write_results
from tdcr_fe.io.write_toml import model_to_toml, robot_to_toml, scenario_to_toml
from tdcr_fe.model.loading import LoadStep, Model, SolverSettings
from tdcr_fe.scene.builder import CreateTDCR
from tdcr_fe.solve.simulate import simulate
from tdcr_fe.solve.simulation import Simulation
from tdcr_fe.solve.stability import stability
from tdcr_fe.solve.statics import SolveTDCR

STEPS = [LoadStep(tensions={"t1": 1.0})]


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"robot": "robot.toml"}, r"robot is 'robot.toml'; expected a Robot. read_robot\(path\)"),
        ({"robot": None}, r"robot is of type NoneType; expected a Robot"),
        ({"model": "per-hole"}, r"model is 'per-hole'; expected a Model. Model\(friction='per-hole'\)"),
        ({"model": STEPS}, r"model is of type list; expected a Model"),
        ({"steps": STEPS[0]}, r"steps is of type LoadStep; expected a sequence of LoadStep"),
        ({"steps": "scenario.toml"}, r"steps is 'scenario.toml'; expected a sequence of LoadStep"),
        ({"steps": [*STEPS, {"t1": 2.0}]}, r"steps\[1\] is of type dict; expected a LoadStep"),
        ({"settings": {"tolerance": 1e-9}}, r"settings is of type dict; expected SolverSettings"),
    ],
)
def test_simulate_names_the_argument_and_what_to_call(given, message):
    """No AttributeError from inside the function."""
    arguments = {"robot": paper_robot(), "model": Model(), "steps": STEPS, **given}
    with pytest.raises(TypeError, match=f"simulate: {message}"):
        simulate(**arguments)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("scene", paper_robot()), r"mbs is 'scene'; expected an exudyn.MainSystem. .*AddSystem"),
        ((None, "robot.toml"), r"robot is 'robot.toml'; expected a Robot. read_robot"),
        ((None, paper_robot(), "per-hole"), r"model is 'per-hole'; expected a Model"),
    ],
)
def test_create_tdcr_names_the_argument_and_what_to_call(arguments, message):
    container = exu.SystemContainer()
    mbs, *rest = arguments
    system = container.AddSystem() if mbs is None else mbs
    with pytest.raises(TypeError, match=f"CreateTDCR: {message}"):
        CreateTDCR(system, *rest)
    assert mbs is not None or system.systemData.NumberOfNodes() == 0


@pytest.mark.parametrize(
    ("options", "error", "message"),
    [
        ({"name": 3}, TypeError, "name is of type int; expected a text"),
        ({"basePosition": "origin"}, TypeError, "basePosition is 'origin'; expected 3 numbers"),
        ({"basePosition": [0.0, 0.0]}, TypeError, "basePosition is of type list; expected 3 numbers"),
        ({"loadPositions": 0.1}, TypeError, "loadPositions is of type float; expected a sequence of numbers"),
        ({"loadPositions": ["tip"]}, TypeError, r"loadPositions\[0\] is 'tip'; expected a number"),
        ({"presliding": "1e-6"}, TypeError, "presliding is '1e-6'; expected a number"),
        ({"presliding": 0.0}, ValueError, "presliding = 0.0; must be positive and finite"),
    ],
)
def test_create_tdcr_refuses_options_by_name(options, error, message):
    """The message names the function, the argument, its value and what is expected; the system stays empty."""
    container = exu.SystemContainer()
    system = container.AddSystem()
    with pytest.raises(error, match=f"CreateTDCR: {message}"):
        CreateTDCR(system, paper_robot(), **options)
    assert system.systemData.NumberOfNodes() == 0


@pytest.mark.parametrize(
    ("arguments", "error", "message"),
    [
        ({"mbs": "x"}, TypeError, "mbs is 'x'; expected an exudyn.MainSystem. .*AddSystem"),
        ({"settings": {"tolerance": 1e-9}}, TypeError, "settings is of type dict; expected SolverSettings"),
        ({"settings": exu.SimulationSettings()}, TypeError, "settings is of type SimulationSettings"),
        ({"substeps": "4"}, TypeError, "substeps is '4'; expected a whole number"),
        ({"substeps": 2.5}, TypeError, "substeps is of type float; expected a whole number"),
        ({"substeps": 0}, ValueError, "substeps = 0; must be at least 1"),
        ({"endTime": "1"}, TypeError, "endTime is '1'; expected a number"),
        ({"startTime": float("nan")}, ValueError, "startTime = nan; must be finite"),
    ],
)
def test_solve_tdcr_names_the_argument_and_what_to_call(arguments, error, message):
    """The message names the function, the argument, its value and what is expected."""
    container = exu.SystemContainer()
    system = container.AddSystem()
    CreateTDCR(system, paper_robot())
    system.Assemble()
    with pytest.raises(error, match=f"SolveTDCR: {message}"):
        SolveTDCR(**{"mbs": system, **arguments})


def test_solve_tdcr_takes_whole_numbers_of_numpy():
    container = exu.SystemContainer()
    system = container.AddSystem()
    handle = CreateTDCR(system, paper_robot(), presliding=np.float64(1e-6), loadPositions=np.array([0.1]))
    system.Assemble()
    handle.set_tensions([1.0])
    assert SolveTDCR(system, substeps=np.int64(2))["substeps"] == 2


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: simulate(paper_robot(), Model(), STEPS, None, "bar"), "simulate: progress is 'bar'"),
        (
            lambda: simulate(paper_robot(), Model(), STEPS, record_path={}),
            "simulate: record_path is of type dict; expected a list",
        ),
        (lambda: identify(measured(), {}), "identify: settings is of type dict; expected IdentifySettings"),
        (lambda: identify(measured(), SolverSettings()), "identify: settings is of type SolverSettings"),
        (lambda: identify(measured(), None, "bar"), "identify: progress is 'bar'; expected a function"),
        (lambda: robot_to_toml("x"), "robot_to_toml: robot is 'x'; expected a Robot"),
        (lambda: model_to_toml(paper_robot()), "model_to_toml: model is of type Robot; expected a Model"),
        (lambda: scenario_to_toml(paper_robot(), STEPS), "scenario_to_toml: model is of type Robot"),
        (lambda: write_results(paper_robot(), "out"), "write_results: result is of type Robot"),
        (lambda: with_effects(paper_robot(), {}), "with_effects: experiment is of type Robot"),
        (
            lambda: with_effects(Experiment(paper_robot(), Model()), ["gravity"]),
            "with_effects: effects is of type list; expected a mapping",
        ),
        (lambda: stability(paper_robot()), "stability: simulation is of type Robot; expected a Simulation"),
        (lambda: Simulation(paper_robot(), Model(), STEPS), r"Simulation: steps\[0\] is of type LoadStep"),
    ],
)
def test_public_functions_name_the_argument_and_what_is_expected(call, message):
    """No AttributeError from inside the function."""
    with pytest.raises(TypeError, match=message):
        call()


def test_identify_names_the_argument_and_what_to_call():
    with pytest.raises(
        TypeError, match=r"identify: data is 'my_robot'; expected MeasuredData. read_measured\(folder\)"
    ):
        identify("my_robot")

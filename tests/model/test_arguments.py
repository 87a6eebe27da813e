"""Public functions refuse arguments of another type by name, and name the function to call."""

import exudyn as exu
import pytest
from arcs import paper_robot

from tdcr_fe.identify import identify
from tdcr_fe.model.loading import LoadStep, Model
from tdcr_fe.scene.builder import CreateTDCR
from tdcr_fe.solve.simulate import simulate

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
    """In 0.1: "AttributeError: 'str' object has no attribute 'tendon_names'"."""
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


def test_identify_names_the_argument_and_what_to_call():
    with pytest.raises(
        TypeError, match=r"identify: data is 'my_robot'; expected MeasuredData. read_measured\(folder\)"
    ):
        identify("my_robot")

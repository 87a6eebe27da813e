"""Files of robots without disks."""

import pytest

from tdcr_fe.cli import main
from tdcr_fe.io.problems import InputError
from tdcr_fe.io.toml import read_model, read_robot, read_scenario
from tdcr_fe.model.loading import Model

ROBOT = """
[backbone]
length = 0.3
radius = [[0.0, 12e-3], [0.3, 5e-3]]
youngs_modulus = 0.4e6
poisson_ratio = 0.45
density = 1100.0

[[tendons]]
name = "a"
routing = "converging"
offset = 9e-3
end_offset = 3e-3
end = 0.25
"""
POINTS = ROBOT.split("[[tendons]]")[0] + (
    '[[tendons]]\nname = "a"\nrouting = "points"\nend = 0.2\nholes = [[8e-3, 0.0], [7e-3, 1e-3], [5e-3, 2e-3]]\n'
)
STEPS = "[[steps]]\ntensions = { a = 1.0 }\n"


def write(folder, robot=ROBOT, model=""):
    (folder / "robot.toml").write_text(robot)
    (folder / "scenario.toml").write_text(f'robot = "robot.toml"\n{model}\n{STEPS}')
    return folder / "scenario.toml"


def test_points_of_a_course_are_equally_spaced_up_to_its_end(tmp_path):
    write(tmp_path, POINTS)
    assert read_robot(tmp_path / "robot.toml").tendons[0].routing.fixed_arc_lengths == (0.0, 0.1, 0.2)


def test_its_tendons_follow_the_backbone_by_default(tmp_path):
    assert read_scenario(write(tmp_path)).model == Model("continuous", "none")
    path = tmp_path / "model.toml"
    path.write_text("[model]\ngravity = [0.0, 0.0, 9.81]\n")
    robot = read_robot(tmp_path / "robot.toml")
    assert read_model(path, robot) == Model("continuous", "none", gravity=(0.0, 0.0, 9.81))


@pytest.mark.parametrize(
    ("model", "key"),
    [
        ('[model]\ntendon_path = "straight"', "model.tendon_path"),
        ('[model]\nfriction = "per-hole"', "model.friction"),
    ],
)
def test_a_model_with_holes_is_refused_by_name(tmp_path, model, key):
    with pytest.raises(InputError) as caught:
        read_scenario(write(tmp_path, model=model))
    assert [p.key for p in caught.value.problems] == [key]


def test_the_command_runs_it(tmp_path, capsys):
    """Version 0.1 refused a robot without disks."""
    assert main(["run", str(write(tmp_path)), "-o", str(tmp_path / "out")]) == 0
    lines = (tmp_path / "out" / "tensions.csv").read_text().splitlines()
    assert lines == ["step,tendon,segment,tension,hole_state", "1,a,1,1.0,anchor"]
    assert (tmp_path / "out" / "view.html").exists()

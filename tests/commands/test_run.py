"""``tdcr-fe run`` as users call it: whole tables whatever the robot, and warnings before a long or odd solve."""

from __future__ import annotations

import pandas as pd
import pytest

from tdcr_fe import cli

ROBOT = """
[backbone]
length = 0.25
radius = 0.4e-3
youngs_modulus = 85e9
poisson_ratio = 0.3
density = 5600.0
[disks]
count = 6
mass = 0.17e-3
radius = 5e-3
"""
TENDONS = {
    "parallel": "offset = 4e-3",
    "helical": "offset = 4e-3\nturns = 0.5",
    "converging": "offset = 4e-3\nend_offset = 2e-3",
    "points": "holes = [[4e-3, 0.0], [3e-3, 0.0], [4e-3, 0.0], [3e-3, 1e-3]]",
}
ENDS = {"parallel": 6, "helical": 4, "converging": 5, "points": 3}


def write_robot(folder, tendon_path, friction, end_of_all=False):
    text = ROBOT
    for name, fields in TENDONS.items():
        if end_of_all and name == "points":
            fields = "holes = [" + ", ".join(["[4e-3, 0.0]"] * 7) + "]"
        text += f'[[tendons]]\nname = "{name}"\nrouting = "{name}"\n{fields}\nfriction_coefficient = 0.2\n'
        if not end_of_all:
            text += f"end = {0.25 * ENDS[name] / 6!r}\n"
    (folder / "robot.toml").write_text(text)
    path = folder / "scenario.toml"
    path.write_text(
        f'robot = "robot.toml"\n[model]\ntendon_path = "{tendon_path}"\nfriction = "{friction}"\n'
        "elements_per_bay = 1\n[[steps]]\ntensions = { parallel = 1.0, helical = 0.5 }\n"
        "[[steps]]\ntensions = { converging = 0.6, points = 0.4 }\n"
    )
    return path


@pytest.mark.parametrize("same_end", [True, False], ids=["same end", "different ends"])
@pytest.mark.parametrize(
    ("tendon_path", "friction"), [("straight", "per-hole"), ("straight", "none"), ("continuous", "none")]
)
def test_tension_of_every_segment_is_written_whatever_the_path_and_the_ends(
    tmp_path, tendon_path, friction, same_end
):
    """In 0.1 the continuous path ended in a traceback of `tensions_table`: one hole state for six segments."""
    path = write_robot(tmp_path, tendon_path, friction, same_end)
    assert cli.main(["run", str(path), "-o", str(tmp_path / "out"), "-q"]) == 0
    table = pd.read_csv(tmp_path / "out" / "tensions.csv")
    for step in (1, 2):
        for name, end in ENDS.items():
            rows = table[(table.step == step) & (table.tendon == name)]
            count = 6 if same_end else end
            assert list(rows.segment) == list(range(1, count + 1))
            assert rows.hole_state.iloc[-1] == "anchor" and "anchor" not in set(rows.hole_state.iloc[:-1])
            if friction == "none":
                assert rows.tension.nunique() == 1
    assert (tmp_path / "out" / "tensions.png").exists()

"""A robot and a scenario as files, ways to change them, and what a command says of its input."""

import copy
import tomllib
from pathlib import Path

from tdcr_fe.cli import main
from tdcr_fe.io.write_toml import value_to_toml
from tdcr_fe.model.messages import bare


def document(data: dict) -> str:
    """Any data as TOML, tables inline."""
    return "".join(f"{bare(k)} = {value_to_toml(v)}\n" for k, v in data.items())


ROBOT = document({
    "name": "single-segment",
    "backbone": {"length": 0.25, "radius": 0.4e-3, "youngs_modulus": 85e9, "poisson_ratio": 0.3, "density": 5600.0},
    "disks": {"count": 5, "mass": 0.17e-3, "thickness": 0.0, "radius": 5e-3},
    "tendons": [
        {"name": "t1", "routing": "parallel", "offset": 4.5e-3, "angle_deg": 0.0, "friction_coefficient": 0.3},
        {"name": "t2", "routing": "converging", "offset": 4.5e-3, "end_offset": 0.15e-3, "angle_deg": 120.0,
            "end": 0.15, "axial_stiffness": 400.0},
        {"name": "t3", "routing": "points",
            "holes": [[1e-3, 0], [1e-3, 1e-3], [0, 1e-3], [0, 0], [2e-3, 0], [3e-3, 1e-3]]},
        {"name": "t4", "routing": "helical", "offset": 4.5e-3, "turns": -2},
    ],
})  # fmt: skip

SCENARIO = """
robot = "robot.toml"
model = { tendon_path = "straight", friction = "per-hole", elements_per_bay = 2, gravity = [0.0, 0.0, -9.81] }
[[steps]]
label = "pull"
tensions = { t1 = 1.5, t3 = 1 }
displacements = { t2 = 5e-3 }
loads = { tip = { at = 0.25, force = [0.0, 0.05, 0.0], moment = [0, 0, 0], frame = "world" } }
substeps = 5
[[steps]]
loads = { tip = { at = 0.25 }, middle = { at = 0.1, force = [0.1, 0, 0], frame = "section" } }
"""

REMOVED = object()


def write(folder: Path, robot: str | bytes = ROBOT, scenario: str | bytes = SCENARIO) -> Path:
    for name, text in (("robot.toml", robot), ("scenario.toml", scenario)):
        (folder / name).write_bytes(text if isinstance(text, bytes) else text.encode())
    return folder / "scenario.toml"


def changed(text: str, changes: dict[str, object]) -> str:
    """The file with keys such as ``tendons.0.offset`` set, or removed."""
    data = copy.deepcopy(tomllib.loads(text))
    for key, value in changes.items():
        *parents, last = (int(p) if p.isdigit() else p for p in key.split("."))
        table = data
        for p in parents:
            table = table[p]
        if value is REMOVED:
            del table[last]
        else:
            table[last] = value
    return document(data)


def said(capsys, status: int, *arguments: str | Path) -> str:
    """What a command prints on stderr that ends with this exit status."""
    assert main([*map(str, arguments)]) == status
    return capsys.readouterr().err

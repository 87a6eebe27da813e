"""Good input files and the commands that read them, small enough to be solved in a fraction of a second."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache

_ROBOT = """\
name = "broken-files"   # ümlauts in a comment
tip_mass = 1e-4
base_stiffness = 5.0

[backbone]
length = 0.1
radius = 0.4e-3
youngs_modulus = 85e9
poisson_ratio = 0.3
density = 5600.0
precurvature = [0.0, 1.5]
superelastic = { threshold_strain = 0.01, plateau_ratio = 0.3 }
patches = [ { start = 0.0, end = 0.04, bending = 3.0, torsion = 3.0 } ]
creep_rate = 1e-5

[disks]
positions = [0.03, 0.06, 0.1]
mass = 0.17e-3
thickness = 1e-3
radius = 5e-3

[[springs]]
at = 0.06
stiffness = 1.0

[[tendons]]
name = "tip"
routing = "parallel"
offset = 4.5e-3
angle_deg = 90.0
friction_coefficient = 0.3
adhesion = 1e-3
clearance = 1e-4
tight_holes = [ { at = 0.03, drop = 0.02 } ]

[[tendons]]
name = "middle"
routing = "converging"
offset = 4.5e-3
end_offset = 1.5e-3
angle_deg = -30.0
end = 0.06
axial_stiffness = 400.0
pretension = 0.1

[[tendons]]
name = "winding"
routing = "helical"
offset = 3e-3
turns = 0.5
friction = { kind = "stribeck", static = 0.3, kinetic = 0.2, stribeck_rate = 1e-3 }

[[tendons]]
name = "free"
routing = "points"
end = 0.06
holes = [[2e-3, 0.0], [2e-3, 1e-3], [1e-3, 2e-3]]
"""

_SCENARIO = """\
robot = "robot.toml"

[model]
tendon_path = "straight"
friction = "per-hole"
elements_per_bay = 1
gravity = [0.0, 0.0, -9.81]

[solver]
max_substeps = 8
mesh_tolerance = 1e-2

[effects]
hole_adhesion = { drop = 1e-3 }

[[steps]]
label = "pull, gemäß plan"
tensions = { tip = 0.5, winding = 0.2 }
displacements = { middle = 1e-4 }
time = 10.0

[[steps]]
label = "push"
loads = { tip = { at = 0.1, force = [0.0, 0.01, 0.0], moment = [0, 0, 0], frame = "world" } }
substeps = 2
time = 20.0
"""

_SOFT_ROBOT = """\
[backbone]
length = 0.2
radius = [[0.0, 6e-3], [0.1, 5e-3], [0.2, 3e-3]]
youngs_modulus = 0.5e6
poisson_ratio = 0.48
density = 1070.0
nonlinear = { quadratic = -1.0, cubic = 1.333 }

[[tendons]]
name = "a"
routing = "helical-varying"
offset = 3e-3
turns_base = 0.0
turns_end = 0.4

[[tendons]]
name = "b"
routing = "parallel"
offset = 3e-3
angle_deg = 180
end = 0.15
"""

_SOFT_SCENARIO = """\
robot = "robot.toml"
[model]
elements_per_bay = 1
[[steps]]
tensions = { a = 0.05 }
[[steps]]
tensions = { a = 0.0, b = 0.05 }
"""

_PLAIN_ROBOT = """\
name = "plain"
[backbone]
length = 0.1
radius = 0.4e-3
youngs_modulus = 85e9
poisson_ratio = 0.3
[disks]
count = 3
[[tendons]]
name = "t1"
routing = "parallel"
offset = 4e-3
friction_coefficient = 0.2
[[tendons]]
name = "t2"
routing = "parallel"
offset = 4e-3
angle_deg = 120.0
[[tendons]]
name = "t3"
routing = "parallel"
offset = 4e-3
angle_deg = 240.0
"""

_MODEL = """\
[model]
friction = "per-hole"
elements_per_bay = 1
gravity = [0.0, 0.0, -9.81]
[solver]
max_iterations = 25
"""

_PATH = """\
step,x,y,z,dx,dy,dz,label,time
1,0.004,0.0,0.0995,,,,one,1.0
2,0.006,0.001,0.0995,,,,two,2.0
"""

_LOADING = """\
step,branch,time,tension_t1,tension_t2,tension_t3,force_x,force_y,force_z
1,up,1,0.5,0,0,0,0,0
2,up,2,1.0,0,0,0,0,0
3,down,3,0.5,0,0,0,0.01,0
4,down,4,0,0.5,0,0,0,0
5,across,5,0,0.5,0.5,0,0,0
"""

_OBSERVATIONS = """\
step,quantity,location,value,sigma
1,position_x,0.1,0.0058,0.0002
1,position_y,0.1,0.0001,0.0002
1,tendon_displacement,t1,0.0004,
2,position_x,0.1,0.0115,0.0002
2,position_z,0.1,0.0991,0.0002
2,bending_angle,,0.2301,0.01
3,position_x,0.1,0.0063,0.0002
3,position_y,0.1,0.0036,0.0002
4,position_x,0.1,-0.0028,0.0002
4,position_y,0.1,0.0049,0.0002
5,position_x,0.1,-0.0057,0.0002
5,chord_angle,,0.0601,0.01
"""

_SWEEP = """\
scenario = "scenario.toml"

[sampling]
method = "latin-hypercube"
samples = 4
seed = 1

[[vary]]
key = "backbone.youngs_modulus"
mode = "factor"
normal = { mean = 1.0, std = 0.03 }

[[vary]]
key = "tendons.tip.friction_coefficient"
uniform = { lower = 0.1, upper = 0.3 }

[output]
steps = "last"
quantities = ["tip_x", "tip_z"]
"""

_GRID = """\
robot = "robot.toml"
steps = [ { tensions = { t1 = 0.5 } } ]

[model]
elements_per_bay = 1

[[vary]]
key = "steps[0].tensions.t1"
range = { start = 0.0, stop = 1.0, count = 3 }

[[vary]]
key = "backbone.length"
values = [0.1, 0.12]
"""


@dataclass(frozen=True)
class Inputs:
    """Good files, and the command that reads them.

    Attributes
    ----------
    name : str
    command : tuple of str
        Arguments of ``tdcr-fe``; ``{}`` stands for the folder of the files. ``-o OUT`` is added.
    files : mapping of str to bytes
        Contents by name.
    required : tuple of str
        Files without which the command cannot run.
    weight : int
        How often it is drawn, relative to the others.
    """

    name: str
    command: tuple[str, ...]
    files: Mapping[str, bytes]
    required: tuple[str, ...]
    weight: int = 1


def _texts(**files: str) -> dict[str, bytes]:
    return {name.replace("__", "."): text.encode() for name, text in files.items()}


@cache
def _results() -> dict[str, bytes]:
    """Tables that `tdcr-fe run` writes, for `tdcr-fe view`."""
    from pathlib import Path
    from tempfile import TemporaryDirectory

    from tdcr_fe.io.result_files import write_results
    from tdcr_fe.io.toml import read_scenario
    from tdcr_fe.solve.simulate import simulate

    steps = "[[steps]]\ntensions = { t1 = 0.5 }\n[[steps]]\ntensions = { t2 = 0.5 }\n"
    with TemporaryDirectory() as place:
        folder = Path(place)
        (folder / "robot.toml").write_text(_PLAIN_ROBOT, encoding="utf-8")
        (folder / "scenario.toml").write_text('robot = "robot.toml"\n' + steps, encoding="utf-8")
        given = read_scenario(folder / "scenario.toml")
        result = simulate(given.robot, given.model, given.steps).raise_if_failed()
        return {p.name: p.read_bytes() for p in write_results(result, folder / "out", pictures=False)}


_RUN = ("run", "{}/scenario.toml", "-q", "--no-pictures")

#: All good inputs; those of `view` are solved when they are first needed.
INPUTS: tuple[Inputs, ...] = (
    Inputs(
        "run",
        _RUN,
        _texts(robot__toml=_ROBOT, scenario__toml=_SCENARIO),
        ("robot.toml", "scenario.toml"),
        8,
    ),
    Inputs(
        "run, soft",
        _RUN,
        _texts(robot__toml=_SOFT_ROBOT, scenario__toml=_SOFT_SCENARIO),
        ("robot.toml", "scenario.toml"),
        3,
    ),
    Inputs(
        "follow",
        (
            "follow",
            "{}/robot.toml",
            "{}/path.csv",
            "--largest",
            "2",
            "--model",
            "{}/model.toml",
            "-q",
            "--no-pictures",
        ),
        _texts(robot__toml=_PLAIN_ROBOT, path__csv=_PATH, model__toml=_MODEL),
        ("robot.toml", "path.csv", "model.toml"),
        3,
    ),
    Inputs(
        "identify",
        ("identify", "{}", "-q", "--processes", "1"),
        _texts(
            robot__toml=_PLAIN_ROBOT,
            loading__csv=_LOADING,
            observations__csv=_OBSERVATIONS,
            model__toml=_MODEL,
        ),
        ("robot.toml", "loading.csv", "observations.csv"),
        5,
    ),
    Inputs(
        "sweep",
        ("sweep", "{}/sweep.toml", "--check"),
        _texts(robot__toml=_ROBOT, scenario__toml=_SCENARIO, sweep__toml=_SWEEP),
        ("robot.toml", "scenario.toml", "sweep.toml"),
        3,
    ),
    Inputs(
        "sweep, grid",
        ("sweep", "{}/sweep.toml", "--check"),
        _texts(robot__toml=_PLAIN_ROBOT, sweep__toml=_GRID),
        ("robot.toml", "sweep.toml"),
        2,
    ),
    Inputs("view", ("view", "{}"), {}, ("summary.json", "steps.csv", "shape.csv", "tensions.csv"), 2),
)


def files_of(inputs: Inputs) -> Mapping[str, bytes]:
    """The good files of an input."""
    return inputs.files or _results()

"""Commented input files to start from: every key with its description, unit and default, from the schema."""

from __future__ import annotations

import textwrap
from collections.abc import Iterable, Mapping, Sequence

from tdcr_fe.effects import EFFECTS
from tdcr_fe.io.keys import DISKS, ROBOT, tendon_keys
from tdcr_fe.io.write_toml import value_to_toml
from tdcr_fe.model.backbone import Backbone
from tdcr_fe.model.channels import CHANNELS
from tdcr_fe.model.loading import LoadStep, Model, SolverSettings
from tdcr_fe.model.messages import options, quoted
from tdcr_fe.model.robot import SideSpring
from tdcr_fe.model.routing import ROUTINGS
from tdcr_fe.model.schema import Keys, keys_of

#: Length of the robot that the templates describe [m].
LENGTH = 0.2
#: Values of the robot that the templates describe; a key that is not here is commented out.
_BACKBONE = {
    "length": f"{LENGTH:g}",
    "radius": "0.4e-3",
    "youngs_modulus": "85e9",
    "poisson_ratio": "0.3",
    "density": "5600.0",
}
_DISKS = {"count": "10", "mass": "0.2e-3", "radius": "5e-3"}
_TENDON = {"offset": "4.5e-3", "friction_coefficient": "0.2"}
_MODEL = {"friction": '"per-hole"', "gravity": "[0.0, 0.0, -9.81]"}

#: Keys that describe what only files of their own need; their examples.
_EXAMPLES = {
    "superelastic": "{ threshold_strain = 0.01, plateau_ratio = 0.1 }",
    "nonlinear": "{ quadratic = 0.0, cubic = -20.0 }",
    "patches": "[{ start = 0.05, end = 0.1, bending = 1.2 }]",
    "tight_holes": "[{ at = 0.1, drop = 0.05 }]",
    "friction": '{ kind = "stribeck", static = 0.3, kinetic = 0.2, stribeck_rate = 1e-3 }',
    "positions": "[0.05, 0.1, 0.15, 0.2]",
}

#: What the description of a key leaves open, by the table of the key.
_REMARKS = {
    "[backbone]": {"radius": "or [[0.0, 0.4e-3], [0.2, 0.3e-3]]: arc length and radius, linear in between"},
    "[disks]": {"positions": "in place of count"},
    "[[tendons]]": {"friction": "in place of friction_coefficient", "end": "without it the tip"},
}


def _line(keys: Keys, name: str, value: str | None, remark: str | None = None) -> str:
    """A key with its description and a remark; commented out where no value is given."""
    node, default = keys.json_schema["properties"][name], keys.defaults.get(name)
    note = node["description"] + (f"; {remark}" if remark else "")
    if texts := options(node):
        note += ("; one of " if "enum" in node else "; or ") + ", ".join(map(quoted, texts))
    if value is not None:
        text = f"{name} = {value}"
    elif name in _EXAMPLES and default in (None, ()):
        text = f"# {name} = {_EXAMPLES[name]}"
    else:
        text = f"# {name} = {'...' if default is None else value_to_toml(default)}"
    return f"{text:<33} # {note}"


def _table(header: str, keys: Keys, given: Mapping[str, str]) -> list[str]:
    """A table with the keys that are given first, then the others, commented out."""
    remarks = _REMARKS.get(header, {})
    rest = {name: None for name in keys if name not in given}
    return ["", header, *(_line(keys, n, value, remarks.get(n)) for n, value in {**given, **rest}.items())]


def robot_template(tendons: int = 3) -> str:
    """A `robot.toml` with every key.

    Parameters
    ----------
    tendons
        Number of tendons, at equal angles.
    """
    lines = [
        "# A tendon-driven continuum robot. SI units: m, N, kg, s, Pa, rad; a key in another unit says so in its name.",
        "# Lines that begin with # are optional keys with their defaults (... where there is none).",
        'name = "my-robot"',
        *(_line(ROBOT, name, None) for name in ("tip_mass", "base_stiffness")),
        *_table("[backbone]", keys_of(Backbone), _BACKBONE),
        *_table("[disks]", DISKS, _DISKS),
    ]
    for k in range(tendons):
        given = {
            "name": f'"t{k + 1}"',
            "routing": '"parallel"',
            **_TENDON,
            "angle_deg": f"{360.0 * k / tendons:.6g}",
        }
        fields = tendon_keys("parallel")
        if k:
            lines += ["", "[[tendons]]", *(f"{name} = {value}" for name, value in given.items())]
        else:
            lines += _table("[[tendons]]", fields, given)
    others = [name for name in ROUTINGS if name != "parallel"]
    lines += ["", "# Keys of the other routings, in place of offset and angle_deg:"]
    for name in others:
        keys = ", ".join(keys_of(ROUTINGS[name]))
        lines.append(f'#   routing = "{name}": {keys}')
    springs = keys_of(SideSpring)
    lines += ["", "# A spring from the backbone to ground:", "# [[springs]]"]
    lines += [f"# {_line(springs, n, value)}" for n, value in {"at": "0.1", "stiffness": "1.0"}.items()]
    return "\n".join(lines) + "\n"


def scenario_template(tendons: Sequence[str], length: float) -> str:
    """A `scenario.toml` with every key, for a robot with these tendons and this length [m]."""
    step = keys_of(LoadStep)
    pulled = step.json_schema["properties"]["displacements"]["description"]
    first, *others = tendons
    lines = [
        "# A loading sequence. Solve it: tdcr-fe run scenario.toml -o OUT",
        'robot = "robot.toml"',
        *_model_lines(),
        "",
        '# Effects of a real robot, by name; the page "Effects" of the documentation has their parameters:',
        *textwrap.wrap(", ".join(e.name for e in EFFECTS), 116, initial_indent="# ", subsequent_indent="# "),
        "# [effects]",
        "# creep = { rate = 1e-4 }",
        "",
        "# The loading sequence, one table a step; what a step does not name, loads included, stays as it was.",
        "[[steps]]",
        f'label = "pull {first}"',
        f"tensions = {{ {first} = 1.0 }}",
        *(_line(step, name, None) for name in ("substeps", "time")),
        f"# displacements = {{ {first} = 2e-3 }}   # {pulled}, not tensions",
        "",
        "[[steps]]",
        'label = "load the tip"',
        f"loads = {{ tip = {{ at = {length:g}, force = [0.0, 0.02, 0.0] }} }}",
        "",
        "[[steps]]",
        f'label = "release {first}"',
        f"tensions = {{ {', '.join(f'{n} = 0.0' for n in [first])} }}",
    ]
    if others:
        lines += ["", "[[steps]]", f'label = "pull {others[0]}"', f"tensions = {{ {others[0]} = 1.0 }}"]
    return "\n".join(lines) + "\n"


def _model_lines() -> list[str]:
    return [
        *_table("[model]", keys_of(Model), _MODEL),
        *_table("[solver]", keys_of(SolverSettings), {}),
    ]


def model_template() -> str:
    """A `model.toml` with every key: how the builder believes that the robot behaves."""
    head = [
        "# How the declared robot is modelled; without this file: straight tendons, friction at every hole, no gravity."
    ]
    return "\n".join([*head, *_model_lines()]) + "\n"


def quantities() -> Iterable[str]:
    """Every measured quantity as a line for people."""
    for c in CHANNELS:
        where = f"location: {c.location}" if c.location else "location: empty"
        yield f"- `{c.quantity}` [{c.unit}]: {c.meaning}; {where}"


_NOTES = """# An experiment for `tdcr-fe identify`

`loading.csv` and `observations.csv` hold numbers of a simulation of this `robot.toml`, with random errors of the size
`sigma`: `identify` finds that nothing is missing. They show the form: replace them by what you commanded and measured.

1. `robot.toml`: the robot as you declare it. `model.toml`: how you believe that it behaves.
2. `loading.csv`: one row a load step, in order, from the unloaded robot: `step`, then `tension_NAME` [N] or
   `displacement_NAME` [m pulled in at the base] of every tendon. `force_x`, `force_y`, `force_z` [N] at the tip, `time`
   [s] and `branch` may be there. Pull and release: friction, backlash and creep show only when a load goes up and down.
3. `observations.csv`: one row a reading: `step`, `quantity`, `location`, `value`, and `sigma`, the standard
   uncertainty, which may be empty. SI units: metres and radians, not millimetres and degrees.
4. `tdcr-fe identify FOLDER -o OUT`, then open `OUT/report.html`.

Tables of a spreadsheet program are read as they are: with commas, semicolons or tabs, decimal points or decimal commas
(the same in all columns), or as `loading.xlsx` and `observations.xlsx` (`pip install 'tdcr-fe[xlsx]'`).

Quantities:

"""


def experiment_notes() -> str:
    """What to replace in the folder of an experiment."""
    return _NOTES + "\n".join(quantities()) + "\n"


def sweep_template(first_tendon: str) -> str:
    """A `sweep.toml` beside a `scenario.toml`."""
    return f"""# Many cases of a scenario. Check it: tdcr-fe sweep sweep.toml --check
# Solve it: tdcr-fe sweep sweep.toml -o OUT
scenario = "scenario.toml"

[sampling]
method = "latin-hypercube"        # "grid", "list", "latin-hypercube", "sobol", or "saltelli" for Sobol indices
samples = 100                     # not for "grid" and "list"; a power of two for "sobol" and "saltelli"
seed = 1

# One table a variation: a key of the files, and exactly one of
# values, range, uniform, loguniform, normal, lognormal, triangular.
[[vary]]
key = "backbone.youngs_modulus"
mode = "factor"                   # "value" replaces, "factor" multiplies, "offset" is added to what the files declare
normal = {{ mean = 1.0, std = 0.03 }}

[[vary]]
key = "tendons.friction_coefficient"   # of all tendons; tendons.{first_tendon}.friction_coefficient is that of one
uniform = {{ lower = 0.1, upper = 0.3 }}

# [[vary]]
# key = "steps[0].tensions.{first_tendon}"
# range = {{ start = 0.5, stop = 2.0, count = 4 }}

# [workspace]                     # the tension of every tendon in the last load step
# largest = 2.0                   # N

# [output]
# steps = "all"                   # "last", "all", or numbers of load steps from 1
# quantities = ["tip_x", "tip_y", "tip_z", "bending_angle_deg"]
"""

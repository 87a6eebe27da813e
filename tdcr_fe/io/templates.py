"""Commented input files to start from: every key with its description, unit and default.

The files are the templates of ``tdcr_fe/data/new``; descriptions and defaults come from the keys.
"""

from __future__ import annotations

from collections.abc import Sequence

from tdcr_fe.effects import EFFECTS
from tdcr_fe.io.keys import BACKBONE, DISKS, ROBOT, tendon_keys
from tdcr_fe.io.write_toml import value_to_toml
from tdcr_fe.model.channels import CHANNELS
from tdcr_fe.model.loading import LoadStep, Model, SolverSettings
from tdcr_fe.model.messages import options, quoted
from tdcr_fe.model.robot import SideSpring
from tdcr_fe.model.routing import ROUTINGS
from tdcr_fe.model.schema import keys_of

#: Tables of the files.
_TABLES = {
    "robot": ROBOT,
    "backbone": BACKBONE,
    "disks": DISKS,
    "tendons": tendon_keys("parallel"),
    "springs": keys_of(SideSpring),
    "model": keys_of(Model),
    "solver": keys_of(SolverSettings),
    "steps": keys_of(LoadStep),
}
#: Examples of keys that describe what few robots have.
EXAMPLES = {
    "superelastic": "{ threshold_strain = 0.01, plateau_ratio = 0.1 }",
    "nonlinear": "{ quadratic = 0.0, cubic = -20.0 }",
    "patches": "[{ start = 0.05, end = 0.1, bending = 1.2 }]",
    "tight_holes": "[{ at = 0.1, drop = 0.05 }]",
    "friction": '{ kind = "stribeck", static = 0.3, kinetic = 0.2, stribeck_rate = 1e-3 }',
    "positions": "[0.05, 0.1, 0.15, 0.2]",
}


def _line(table: str, name: str, value: str | None = None) -> str:
    """A key with its description; commented out where no value is given."""
    keys = _TABLES[table]
    node, default = keys.json_schema["properties"][name], keys.defaults.get(name)
    note = node["description"]
    if texts := options(node):
        note += ("; one of " if "enum" in node else "; or ") + ", ".join(map(quoted, texts))
    text = f"{name} = {value}"
    if value is None:
        example = EXAMPLES.get(name, "...") if default in (None, ()) else value_to_toml(default)
        text = f"# {name} = {example}"
    return f"{text:<33} # {note}"


def _table(table: str, **given: str) -> str:
    """The lines of a table: the keys that are given first, then the others, commented out."""
    rest = {name: None for name in _TABLES[table] if name not in given}
    return "\n".join(_line(table, name, value) for name, value in {**given, **rest}.items())


def template(file: str, tendons: Sequence[str]) -> str:
    """An input file with every key.

    Parameters
    ----------
    file
        Name: ``robot.toml``, ``scenario.toml``, ``model.toml``, ``sweep.toml``, or ``NOTES.md`` of an experiment.
    tendons
        Names of the tendons, which are at equal angles.
    """
    import jinja2

    loader = jinja2.PackageLoader("tdcr_fe", "data/new")
    files = jinja2.Environment(
        loader=loader, trim_blocks=True, lstrip_blocks=True, keep_trailing_newline=True
    )
    return files.get_template(f"{file}.j2").render(
        tendons=tendons,
        line=_line,
        table=_table,
        routings={kind: list(keys_of(cls)) for kind, cls in ROUTINGS.items()},
        effects=[e.name for e in EFFECTS],
        channels=CHANNELS,
    )

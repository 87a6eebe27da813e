"""What the package declares about itself agrees with the tree: packages, Pythons, extras."""

from __future__ import annotations

import tomllib
from pathlib import Path

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))


def test_every_package_of_the_tree_is_in_the_wheel_and_nothing_else():
    """A folder that is missing there is missing in every installed copy."""
    folders = {
        "tdcr_fe": ROOT / "tdcr_fe",
        "tdcr_fe.elements": ROOT / "elements",
        "tdcr_fe.validation": ROOT / "validation",
    }
    found = set()
    for name, top in folders.items():
        for init in top.glob("**/__init__.py"):
            found.add(".".join((name, *init.parent.relative_to(top).parts)))
    assert set(PROJECT["tool"]["setuptools"]["packages"]) == found


def test_classifiers_name_the_pythons_that_are_tested():
    prefix = "Programming Language :: Python :: 3."
    named = {c.removeprefix(prefix) for c in PROJECT["project"]["classifiers"] if c.startswith(prefix)}
    tested = (
        (ROOT / ".ci" / "pythons")
        .read_text(encoding="utf-8")
        .split("for version in ")[1]
        .split(";")[0]
        .split()
    )
    assert {f"3.{minor}" for minor in named} == set(tested)
    assert PROJECT["project"]["requires-python"] == f">={min(tested)}"


def test_extras_that_messages_name_exist():
    extras = PROJECT["project"]["optional-dependencies"]
    assert {"xlsx", "dask", "parquet", "completion"} <= set(extras)

"""The floors of the house: nothing imports what lies above it, and numerics neither print nor open files."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
ELEMENTS = sorted((ROOT / "elements").glob("**/*.py"))
MIDDLE = sorted((ROOT / "tdcr_fe").glob("**/*.py"))
VALIDATION = sorted((ROOT / "validation").glob("**/*.py"))
REFERENCE = sorted((ROOT / "validation" / "reference").glob("**/*.py"))

#: Rooms that read, write, draw or talk to people; all others are numerics.
ROOMS_WITH_FILES = {"files", "output", "plots", "cli", "status", "__main__"}
NUMERICS = [*ELEMENTS, *(p for p in MIDDLE if p.stem not in ROOMS_WITH_FILES), *REFERENCE]
#: What the reference shares with the finite elements: data, no solver.
DATA = {"robot", "routing", "loading", "results", "checks", "interpolation"}


def name(path: Path) -> str:
    return str(path.relative_to(ROOT))


def imports(path: Path, lazy: bool = True) -> set[str]:
    """Full names of all modules that a file imports; ``lazy=False`` leaves out those inside functions."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    inside = {
        id(n)
        for f in ast.walk(tree)
        if isinstance(f, ast.FunctionDef | ast.AsyncFunctionDef)
        for n in ast.walk(f)
    }
    checked = {
        id(n)
        for f in ast.walk(tree)
        if isinstance(f, ast.If) and "TYPE_CHECKING" in ast.dump(f.test)
        for n in ast.walk(f)
    }
    found = set()
    for node in ast.walk(tree):
        if id(node) in checked or (not lazy and id(node) in inside):
            continue
        if isinstance(node, ast.Import):
            found |= {a.name for a in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{name(path)} imports relatively"
            found |= {f"{node.module}.{a.name}" for a in node.names}
    return found


@pytest.mark.parametrize("path", ELEMENTS, ids=name)
def test_elements_know_nothing_of_the_project_but_elements(path):
    above = {m for m in imports(path) if m.startswith("tdcr_fe") and not m.startswith("tdcr_fe.elements")}
    assert not above


@pytest.mark.parametrize("path", MIDDLE, ids=name)
def test_the_package_knows_nothing_of_validation(path):
    """The commands may reach it, inside the function that needs it."""
    above = {m for m in imports(path, lazy=path.stem != "cli") if m.startswith("tdcr_fe.validation")}
    assert not above


@pytest.mark.parametrize("path", MIDDLE, ids=name)
def test_only_the_entry_point_imports_the_commands(path):
    if path.stem != "__main__":
        assert not {m for m in imports(path) if m.startswith("tdcr_fe.cli")}


@pytest.mark.parametrize("path", VALIDATION, ids=name)
def test_validation_does_not_import_the_commands(path):
    assert not {m for m in imports(path) if m.startswith("tdcr_fe.cli")}


@pytest.mark.parametrize("path", REFERENCE, ids=name)
def test_the_reference_shares_only_data(path):
    allowed = (*(f"tdcr_fe.{m}" for m in DATA), "tdcr_fe.validation.reference")
    assert not {m for m in imports(path) if m.startswith("exudyn")}
    assert not {m for m in imports(path) if m.startswith("tdcr_fe") and not m.startswith(allowed)}


@pytest.mark.parametrize("path", [p for p in MIDDLE if p.stem in DATA], ids=name)
def test_data_import_no_solver(path):
    """Neither exudyn nor anything that would bring it in."""
    allowed = tuple(f"tdcr_fe.{m}" for m in DATA)
    found = imports(path)
    assert not {m for m in found if m.startswith("exudyn")}
    assert not {m for m in found if m.startswith("tdcr_fe") and not m.startswith(allowed)}


@pytest.mark.parametrize("path", ELEMENTS, ids=name)
def test_elements_read_no_file_format(path):
    assert not {m.split(".")[0] for m in imports(path)} & {
        "tomllib",
        "json",
        "csv",
        "pathlib",
        "pandas",
        "io",
    }


@pytest.mark.parametrize("path", NUMERICS, ids=name)
def test_numerics_neither_print_nor_open_files(path):
    called = {
        n.func.id if isinstance(n.func, ast.Name) else getattr(n.func, "attr", "")
        for n in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(n, ast.Call)
    }
    assert not called & {
        "print",
        "open",
        "read_text",
        "write_text",
        "savetxt",
        "loadtxt",
        "to_csv",
        "read_csv",
    }


def test_the_rooms_are_all_there():
    assert ELEMENTS and MIDDLE and REFERENCE

"""The layers: nothing imports a layer above its own, and numerics neither print nor open files."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
ELEMENTS = sorted((ROOT / "elements").glob("**/*.py"))
PRODUCT = sorted((ROOT / "tdcr_fe").glob("**/*.py"))
VALIDATION = sorted((ROOT / "validation").glob("**/*.py"))
REFERENCE = sorted((ROOT / "validation" / "reference").glob("**/*.py"))
ALL = [*ELEMENTS, *PRODUCT, *VALIDATION]

#: From the lowest layer to the highest; a module imports its own layer and those below it.
LAYERS = (
    "compiled",
    "elements",
    "model",
    "effects",
    "scene",
    "solve",
    "native",
    "report",
    "io",
    "sweeps",
    "identify",
    "validation",
    "commands",
    "cli",
    "__main__",
)

#: Packages and modules that read, write, draw or print; all others are numerics.
WITH_FILES = {"compiled", "io", "report", "commands", "cli", "__main__"}
#: Modules of other packages that do.
MODULES_WITH_FILES = {"report", "journal", "files"}
NUMERICS = [
    *ELEMENTS,
    *(
        p
        for p in PRODUCT
        if p.relative_to(ROOT / "tdcr_fe").parts[0].removesuffix(".py") not in WITH_FILES
        and p.stem not in MODULES_WITH_FILES
    ),
    *REFERENCE,
]


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


def layer(module: str) -> int | None:
    """Number of the layer of a module, from its full name; None where it belongs to none."""
    parts = module.split(".")
    if parts[-1] == "__main__":
        return len(LAYERS) - 1
    return LAYERS.index(parts[1]) if parts[0] == "tdcr_fe" and len(parts) > 1 and parts[1] in LAYERS else None


def module_of(path: Path) -> str:
    parts = path.relative_to(ROOT).with_suffix("").parts
    return ".".join(parts if parts[0] == "tdcr_fe" else ("tdcr_fe", *parts))


@pytest.mark.parametrize("path", ALL, ids=name)
def test_nothing_imports_a_layer_above_it(path):
    own = layer(module_of(path))
    if own is None:  # the package itself gives the public names
        return
    above = {m for m in imports(path) if (layer(m) or 0) > own}
    assert not above


#: Folders of the solver, from the lowest; whatever else it has may import all of them.
SOLVER = ("equations", "newton", "friction_path", "load_steps")


@pytest.mark.parametrize("folder", SOLVER)
def test_folders_of_the_solver_import_those_below(folder):
    allowed = tuple(f"tdcr_fe.solve.{below}." for below in SOLVER[: SOLVER.index(folder) + 1])
    for path in (ROOT / "tdcr_fe" / "solve" / folder).glob("*.py"):
        found = {m for m in imports(path) if m.startswith("tdcr_fe.solve.")}
        assert not {m for m in found if not m.startswith(allowed)}, path.name


@pytest.mark.parametrize("path", REFERENCE, ids=name)
def test_the_reference_shares_only_data(path):
    allowed = ("tdcr_fe.model", "tdcr_fe.validation.reference")
    assert not {m for m in imports(path) if m.startswith("exudyn")}
    assert not {m for m in imports(path) if m.startswith("tdcr_fe") and not m.startswith(allowed)}


@pytest.mark.parametrize(
    "path", [p for p in PRODUCT if layer(module_of(p)) == LAYERS.index("model")], ids=name
)
def test_the_description_imports_no_solver(path):
    """Neither exudyn nor anything that imports it."""
    found = imports(path)
    assert not {m for m in found if m.startswith("exudyn")}
    assert not {m for m in found if m.startswith("tdcr_fe.") and not m.startswith("tdcr_fe.model")}


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


def test_the_folders_are_there():
    assert ELEMENTS and PRODUCT and REFERENCE


def test_modules_of_tests_have_different_names():
    """pytest collects modules without packages by their names alone: one of two with the same name is an error."""
    names = [p.name for p in Path(__file__).parent.rglob("*.py") if p.name != "conftest.py"]
    assert sorted(names) == sorted(set(names))

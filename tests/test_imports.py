"""The layers: nothing imports a layer above its own, and numerics neither print nor open files."""

import ast
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
#: From the lowest layer to the highest; a module imports its own layer and those below it.
LAYERS = (
    *("callable_package", "compiled", "elements", "model", "effects", "scene", "solve", "native", "report"),
    *("io", "sweeps", "identify", "live", "estimate", "validation", "commands", "cli", "__main__"),
)
#: Layers that read, write, draw or print, and modules of the others that do; all others are numerics.
WITH_FILES = {"compiled", "report", "io", "validation", "commands", "cli", "__main__"}
MODULES_WITH_FILES = {"identified", "report", "execution", "limits"}


def module_of(path: Path) -> str:
    parts = path.relative_to(ROOT).with_suffix("").parts
    return ".".join(parts if parts[0] == "tdcr_fe" else ("tdcr_fe", *parts))


def layer(module: str) -> str:
    """The layer of a module of the project, from its full name; the package itself is in none."""
    parts = module.split(".")
    return parts[-1] if parts[-1] == "__main__" else parts[1]


#: Every file by its module.
PATHS = [p for top in ("elements", "tdcr_fe", "validation") for p in sorted((ROOT / top).glob("**/*.py"))]
FILES = {module_of(p): p for p in PATHS}
del FILES["tdcr_fe.__init__"]
IN_LAYER = {name: [m for m in FILES if layer(m) == name] for name in LAYERS}
REFERENCE = [m for m in FILES if m.startswith("tdcr_fe.validation.reference")]
NUMERICS = [m for m in FILES if layer(m) not in WITH_FILES and m.rpartition(".")[2] not in MODULES_WITH_FILES]
NUMERICS += REFERENCE


@cache
def nodes(module: str) -> list[ast.AST]:
    return list(ast.walk(ast.parse(FILES[module].read_text(encoding="utf-8"))))


def imports(module: str) -> set[str]:
    """Full names of all that a module imports, but for type checkers."""
    blocks = [n for n in nodes(module) if isinstance(n, ast.If) and "TYPE_CHECKING" in ast.dump(n.test)]
    unseen = {id(n) for block in blocks for n in ast.walk(block)}
    found = set()
    for node in nodes(module):
        if id(node) not in unseen and isinstance(node, ast.Import):
            found |= {a.name for a in node.names}
        elif id(node) not in unseen and isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{module} imports relatively"
            found |= {f"{node.module}.{a.name}" for a in node.names}
    return found


def own_imports(module: str) -> set[str]:
    """Those of the project."""
    return {m for m in imports(module) if m.startswith("tdcr_fe.") and m != "tdcr_fe.__version__"}


def test_every_module_has_a_layer_and_every_layer_a_module():
    assert {layer(m) for m in FILES} == set(LAYERS)


def test_nothing_imports_a_layer_above_it():
    above = {m: LAYERS[LAYERS.index(layer(m)) + 1 :] for m in FILES}
    assert not [(m, x) for m in FILES for x in own_imports(m) if layer(x) in above[m]]


#: Folders of the solver, from the lowest; whatever else it has may import all of them.
SOLVER = ("equations", "newton", "friction_path", "load_steps")


@pytest.mark.parametrize("folder", SOLVER)
def test_folders_of_the_solver_import_those_below(folder):
    allowed = tuple(f"tdcr_fe.solve.{below}" for below in SOLVER[: SOLVER.index(folder) + 1])
    there = [m for m in FILES if m.startswith(f"tdcr_fe.solve.{folder}")]
    assert there
    for module in there:
        found = {m for m in own_imports(module) if layer(m) == "solve"}
        assert not {m for m in found if not m.startswith(allowed)}, module


def test_description_and_reference_import_no_solver():
    """Neither exudyn nor anything that imports it; the reference shares only data with the finite elements."""
    # Without Exudyn.
    plain = [f"tdcr_fe.elements.{x}" for x in ("Array", "Flags", "Index", "poses", "drives", "hysteresis")]
    for module in (*REFERENCE, *IN_LAYER["model"]):
        allowed = ("tdcr_fe.model", *(("tdcr_fe.validation.reference",) if module in REFERENCE else plain))
        assert not {m for m in own_imports(module) if not m.startswith(allowed)}, module
        assert not {m for m in imports(module) if m.startswith("exudyn")}, module


def test_the_maker_of_blind_sets_solves_with_the_reference_only():
    maker = [m for m in FILES if m.startswith("tdcr_fe.validation.blind.") and not m.endswith(".scoring")]
    assert maker and not [(m, x) for m in maker for x in own_imports(m) if layer(x) in ("solve", "elements")]


def test_elements_read_no_file_format():
    formats = {"tomllib", "json", "csv", "pathlib", "pandas", "io"}
    assert not [(m, x) for m in IN_LAYER["elements"] for x in imports(m) if x.split(".")[0] in formats]


def test_numerics_neither_print_nor_open_files():
    files = {"print", "open", "read_text", "write_text", "savetxt", "loadtxt", "to_csv", "read_csv"}
    calls = [(m, n.func) for m in NUMERICS for n in nodes(m) if isinstance(n, ast.Call)]
    called = [(m, f.id if isinstance(f, ast.Name) else getattr(f, "attr", "")) for m, f in calls]
    assert not [(m, name) for m, name in called if name in files]

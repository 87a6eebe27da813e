"""`import tdcr_fe` gives the public names, fast and without Exudyn, installed or in a clone."""

import ast
import importlib
import os
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

import tdcr_fe as tdcr

ROOT = Path(__file__).parent.parent
#: What the documentation promises.
NEEDED = {
    *("Robot", "Backbone", "Disks", "Tendon"),
    *("ParallelRouting", "HelicalRouting", "ConvergingRouting", "PointsRouting", "TwistedRouting"),
    *("Model", "Load", "LoadStep", "SolverSettings", "SequenceResult", "StepResult"),
    *("simulate", "stability", "identify", "CreateTDCR", "SolveTDCR", "register"),
    *("read_robot", "read_scenario", "read_measured", "robot_to_toml", "scenario_to_toml", "write_results"),
}


def python(code: str, cwd: Path, path: Path | str) -> str:
    """What a fresh interpreter prints."""
    environment = {**os.environ, "PYTHONPATH": str(path), "PYTHONDONTWRITEBYTECODE": "1"}
    environment.pop("PYTHONSAFEPATH", None)
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=cwd, env=environment, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    return done.stdout.strip()


@pytest.mark.parametrize("name", sorted(NEEDED.union(tdcr.__all__)))
def test_every_public_name_is_there_and_documented(name):
    assert name in tdcr.__all__ and name in dir(tdcr)
    found = getattr(tdcr, name)
    assert found is getattr(tdcr, name)
    assert name == "__version__" or found.__doc__


def test_other_names_are_refused():
    with pytest.raises(AttributeError, match="simulat"):
        tdcr.simulat  # noqa: B018


def test_type_checkers_see_the_same_names_at_the_same_places():
    tree = ast.parse((ROOT / "tdcr_fe" / "__init__.py").read_text(encoding="utf-8"))
    (block,) = [n for n in tree.body if isinstance(n, ast.If) and "TYPE_CHECKING" in ast.dump(n.test)]
    declared = {alias.asname: n.module for n in block.body for alias in n.names}
    assert declared == tdcr._MODULE_OF


def test_identify_is_the_function_and_still_a_package():
    """Both in one interpreter, whichever is used first."""
    before = "import tdcr_fe as t; t.identify; import tdcr_fe.identify.settings as o; "
    after = "import tdcr_fe.identify.settings as o; import tdcr_fe as t; "
    show = "print(callable(t.identify), o.IdentifySettings is t.IdentifySettings)"
    for code in (before, after):
        assert python(code + show, ROOT, Path(tdcr.__file__).parents[1]) == "True True"
    with pytest.raises(TypeError):
        tdcr.identify()


def test_importing_the_package_brings_no_other():
    """So that it takes some milliseconds; numpy and Exudyn come with the first name that needs them."""
    packages = ("exudyn", "numpy", "scipy", "pandas", "matplotlib", "pydantic")
    code = f"import sys, tdcr_fe; print('imported', *[m for m in {packages} if m in sys.modules])"
    assert python(code, ROOT, Path(tdcr.__file__).parents[1]).split() == ["imported"]


SOLVE = """
import tdcr_fe, tdcr_fe.elements.friction, tdcr_fe.validation.reference
from tdcr_fe import Backbone, Disks, LoadStep, Model, ParallelRouting, Robot, Tendon, simulate
robot = Robot(
    backbone=Backbone(length=0.25, radius=0.4e-3, youngs_modulus=85e9, poisson_ratio=0.3),
    disks=Disks.equally_spaced(13, 0.25),
    tendons=(Tendon("t1", ParallelRouting(offset=4.5e-3), friction_coefficient=0.3),),
)
result = simulate(robot, Model(elements_per_bay=1), [LoadStep(tensions={"t1": 1.0})])
print(tdcr_fe.__file__, round(float(result.bending_angles[0]), 3))
"""


@pytest.fixture(scope="session")
def wheel(tmp_path_factory):
    """The project built as a wheel from a copy of the tree."""
    tree = tmp_path_factory.mktemp("tree")
    for name in ("tdcr_fe", "elements", "validation"):
        _copy(ROOT / name, tree / name)
    for name in ("pyproject.toml", "README.md", "LICENSE"):
        (tree / name).write_bytes((ROOT / name).read_bytes())
    _copy(ROOT / "tests", tree / "tests")
    _copy(ROOT / "docs", tree / "docs")
    out = tmp_path_factory.mktemp("wheel")
    code = f"from setuptools.build_meta import build_wheel; print(build_wheel({str(out)!r}))"
    subprocess.run([sys.executable, "-W", "ignore", "-c", code], cwd=tree, capture_output=True, check=True)
    (built,) = out.glob("*.whl")
    return built


def _copy(source: Path, target: Path) -> None:
    for path in source.rglob("*"):
        if path.is_file() and "__pycache__" not in path.parts:
            copy = target / path.relative_to(source)
            copy.parent.mkdir(parents=True, exist_ok=True)
            copy.write_bytes(path.read_bytes())


def test_the_wheel_holds_the_package_and_neither_tests_nor_documentation(wheel):
    names = zipfile.ZipFile(wheel).namelist()
    assert {n.split("/")[0] for n in names if ".dist-info/" not in n} == {"tdcr_fe"}
    assert not [
        n for n in names if "/tests/" in n or "/docs/" in n or n.rsplit("/", 1)[-1].startswith("test_")
    ]
    sources = {p.relative_to(ROOT).as_posix() for p in (ROOT / "tdcr_fe").rglob("*") if p.is_file()}
    for folder in ("elements", "validation"):
        sources |= {f"tdcr_fe/{p.relative_to(ROOT).as_posix()}" for p in (ROOT / folder).rglob("*.*")}
    assert {n for n in sources if "__pycache__" not in n} <= set(names)


def test_python_started_in_a_clone_solves_beside_an_installed_copy(wheel, tmp_path):
    """The folder in the clone shadows the installed package, and must be complete: e3bbe5d found no elements there."""
    zipfile.ZipFile(wheel).extractall(tmp_path / "site")
    printed = {}
    for cwd in (ROOT, tmp_path):
        where, printed[cwd] = python(SOLVE, cwd, tmp_path / "site").split()
        assert Path(where).is_relative_to(ROOT if cwd == ROOT else tmp_path / "site")
    assert printed[ROOT] == printed[tmp_path]


def test_registering_twice_changes_nothing():
    exu = importlib.import_module("exudyn")
    tdcr.register()
    once = exu.MainSystem.CreateTDCR, exu.MainSystem.SolveTDCR
    tdcr.register()
    assert (exu.MainSystem.CreateTDCR, exu.MainSystem.SolveTDCR) == once

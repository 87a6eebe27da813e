"""`import tdcr_fe` gives the public names, fast and without Exudyn, in a clone or installed, as pyproject.toml says."""

import importlib
import os
import re
import subprocess
import sys
import tarfile
import tomllib
import zipfile
from pathlib import Path

import pytest

import tdcr_fe as tdcr

ROOT = Path(__file__).parent.parent
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))


def python(code: str, cwd: Path, path: Path | str) -> str:
    """What a fresh interpreter prints."""
    environment = {**os.environ, "PYTHONPATH": str(path), "PYTHONDONTWRITEBYTECODE": "1"}
    environment.pop("PYTHONSAFEPATH", None)
    command = [sys.executable, "-c", code]
    done = subprocess.run(command, cwd=cwd, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout.strip()


def build(kind: str, out: Path, tree: Path = ROOT) -> str:
    """Name of the distribution of ``kind`` that the build backend writes to ``out``."""
    code = f"import hatchling.build as b; print(b.build_{kind}({str(out)!r}))"
    done = subprocess.run([sys.executable, "-c", code], cwd=tree, capture_output=True, text=True, check=True)
    return done.stdout.split()[-1]


@pytest.mark.parametrize("name", tdcr.__all__)
def test_every_public_name_is_there_and_documented(name):
    found = getattr(tdcr, name)
    assert found is getattr(tdcr, name)
    assert name == "__version__" or (found.__doc__ and name in dir(tdcr))


def test_other_names_are_refused():
    with pytest.raises(AttributeError, match="simulat"):
        tdcr.simulat  # noqa: B018


def test_type_checkers_see_every_name():
    """Those that are imported under their own name are exported by a stub."""
    stub = Path(tdcr.__file__).with_suffix(".pyi").read_text(encoding="utf-8")
    seen = re.findall(r"import (\w+) as \1$", stub, re.MULTILINE)
    assert sorted([*seen, "__version__"]) == sorted(tdcr.__all__)


@pytest.mark.integration
def test_identify_is_the_function_and_still_a_package():
    """Both in one interpreter, whichever is used first."""
    before = "import tdcr_fe as t; t.identify; import tdcr_fe.identify.settings as o; "
    after = "import tdcr_fe.identify.settings as o; import tdcr_fe as t; "
    show = "print(callable(t.identify), o.IdentifySettings is t.IdentifySettings)"
    for code in (before, after):
        assert python(code + show, ROOT, Path(tdcr.__file__).parents[1]) == "True True"
    with pytest.raises(TypeError):
        tdcr.identify()


def test_the_package_and_the_help_of_its_command_bring_no_other():
    """So that they take some milliseconds; numpy and Exudyn come with the first name that needs them."""
    packages = ("exudyn", "numpy", "scipy", "pandas", "matplotlib", "pydantic", "jinja2")
    code = "import contextlib, sys, tdcr_fe\nfrom tdcr_fe.cli import main\n"
    code += "with contextlib.suppress(SystemExit):\n    main(['--help'])\n"
    code += f"print('imported', *[m for m in {packages} if m in sys.modules])"
    assert python(code, ROOT, Path(tdcr.__file__).parents[1]).splitlines()[-1] == "imported"


def test_registering_twice_changes_nothing():
    exu = importlib.import_module("exudyn")
    tdcr.register()
    once = exu.MainSystem.CreateTDCR, exu.MainSystem.SolveTDCR
    tdcr.register()
    assert (exu.MainSystem.CreateTDCR, exu.MainSystem.SolveTDCR) == once


def test_an_editable_install_is_a_plain_path(tmp_path):
    """Editors and type checkers read a path; import hooks they do not."""
    archive = zipfile.ZipFile(tmp_path / build("editable", tmp_path))
    paths = [archive.read(n).decode().strip() for n in archive.namelist() if n.endswith(".pth")]
    assert [Path(path) for path in paths] == [ROOT]
    assert not [n for n in archive.namelist() if n.endswith(".py")]


def test_classifiers_name_the_pythons_that_are_tested():
    prefix = "Programming Language :: Python :: 3."
    named = {c.removeprefix(prefix) for c in PROJECT["project"]["classifiers"] if c.startswith(prefix)}
    script = (ROOT / ".ci" / "pythons").read_text(encoding="utf-8")
    versions = re.search(r"for version in ([^;]+);", script)[1].split()
    assert {f"3.{minor}" for minor in named} == set(versions)
    assert PROJECT["project"]["requires-python"] == f">={min(versions)}"


SOLVE = """
import tdcr_fe, tdcr_fe.elements.friction, tdcr_fe.validation.reference
from tdcr_fe.validation.paper.cases import figure
robot = figure("fig3").robot
result = tdcr_fe.simulate(robot, tdcr_fe.Model(elements_per_bay=1), [tdcr_fe.LoadStep(tensions={"t1": 1.0})])
print(tdcr_fe.__file__, round(float(result.bending_angles[0]), 3))
"""


@pytest.fixture(scope="session")
def wheel(tmp_path_factory):
    """The project built as a wheel, from its source distribution."""
    out = tmp_path_factory.mktemp("wheel")
    with tarfile.open(out / build("sdist", out)) as archive:
        archive.extractall(out, filter="data")
        (tree,) = {name.split("/")[0] for name in archive.getnames()}
    return out / build("wheel", out, out / tree)


@pytest.mark.integration
def test_the_wheel_holds_the_package_and_neither_tests_nor_documentation(wheel):
    names = zipfile.ZipFile(wheel).namelist()
    assert {n.split("/")[0] for n in names if ".dist-info/" not in n} == {"tdcr_fe"}
    assert not [n for n in names if re.search(r"/tests/|/docs/|/test_[^/]*$", n)]
    sources = {p.relative_to(ROOT).as_posix() for p in (ROOT / "tdcr_fe").rglob("*") if p.is_file()}
    for folder in ("elements", "validation"):
        sources |= {f"tdcr_fe/{p.relative_to(ROOT).as_posix()}" for p in (ROOT / folder).rglob("*.*")}
    assert {n for n in sources if "__pycache__" not in n} <= set(names)


@pytest.mark.integration
def test_python_started_in_a_clone_solves_beside_an_installed_copy(wheel, tmp_path):
    """The folder in the clone shadows the installed package, and must be complete: e3bbe5d found no elements there."""
    zipfile.ZipFile(wheel).extractall(tmp_path / "site")
    printed = {}
    for cwd in (ROOT, tmp_path):
        where, printed[cwd] = python(SOLVE, cwd, tmp_path / "site").split()
        assert Path(where).is_relative_to(ROOT if cwd == ROOT else tmp_path / "site")
    assert printed[ROOT] == printed[tmp_path]

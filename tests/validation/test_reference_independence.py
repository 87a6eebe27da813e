"""The reference shares nothing with the finite elements but the description of the robot."""

import ast
import subprocess
import sys
from pathlib import Path

import tdcr_fe.validation.reference as reference

FOLDER = Path(reference.__file__).parent
SHARED = {
    "tdcr_fe.model.robot",
    "tdcr_fe.model.backbone",
    "tdcr_fe.model.tendon",
    "tdcr_fe.model.routing",
    "tdcr_fe.model.loading",
    "tdcr_fe.model.results",
    "tdcr_fe.model.interpolation",
    "tdcr_fe.model.checks",
    "tdcr_fe.model.friction",
}


def imported(path):
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, path
            yield node.module


def test_modules_import_only_numpy_scipy_and_the_description():
    standard = sys.stdlib_module_names
    for path in FOLDER.glob("*.py"):
        for name in imported(path):
            head = name.split(".")[0]
            allowed = head in standard or head in ("numpy", "scipy") or name in SHARED
            assert allowed or name.startswith("tdcr_fe.validation.reference"), f"{path.name} imports {name}"


def test_solving_loads_neither_exudyn_nor_the_solver():
    code = """
import sys
from tdcr_fe.model.loading import LoadStep, Model
from tdcr_fe.model.backbone import Backbone
from tdcr_fe.model.robot import Disks
from tdcr_fe.model.robot import Robot
from tdcr_fe.model.tendon import Tendon
from tdcr_fe.model.routing import ParallelRouting
from tdcr_fe.validation.reference import solve_reference
tendon = Tendon("t", ParallelRouting(4e-3))
robot = Robot(Backbone(0.25, 0.4e-3, 85e9, 0.3), Disks.equally_spaced(5, 0.25), (tendon,))
assert solve_reference(robot, Model(), [LoadStep(tensions={"t": 1.0})]).converged
banned = ("exudyn", "tdcr_fe.elements", "tdcr_fe.solve", "tdcr_fe.scene.builder")
found = [m for m in sys.modules if any(m == b or m.startswith(b + ".") for b in banned)]
assert not found, found
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stdout == ""


def test_modules_print_nothing_and_open_no_file():
    for path in FOLDER.glob("*.py"):
        calls = [n for n in ast.walk(ast.parse(path.read_text(encoding="utf-8"))) if isinstance(n, ast.Call)]
        names = {c.func.id for c in calls if isinstance(c.func, ast.Name)}
        assert not names & {"print", "open"}, path.name

"""The product broken by hand in one place at a time: which test notices.

Each mutation is a line of the product and what it becomes; the line is found by its text. The tests run in a temporary
copy of the clone: first the files that are nearest to the mutation, then all default tests, then the integration tests.
"""

from __future__ import annotations

import argparse
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, ClassVar, NamedTuple

import pandas as pd

from tdcr_fe.model.messages import count
from tdcr_fe.validation.runner import Campaign

#: The clone: mutations need its tests.
CLONE = Path(__file__).parents[2]
#: Folders of the product in which lines are looked for.
PRODUCT = ("elements", "tdcr_fe")
#: Tiers of the tests, as pytest's marker expressions, in the order in which they run.
TIERS = {"default": "not integration and not campaign", "integration": "integration"}
#: Mutations that only the integration tests may catch.
MOST_LATE = 2


class Mutation(NamedTuple):
    """A line of the product, and what it becomes."""

    line: str  # occurs once in the product; several lines where one is not enough
    becomes: str
    near: tuple[str, ...] = ()  # test files that should notice, below tests/


MUTATIONS: Mapping[str, Mutation] = {
    "friction: sign of Capstan's exponent": Mutation(
        "turned = -coefficient * angles", "turned = coefficient * angles", ("elements/test_friction.py",)
    ),
    "friction: bound of the mobilisation": Mutation(
        "np.clip(trial, -1.0, 1.0), state, time)",
        "np.clip(trial, -1.0, 0.98), state, time)",
        ("elements/test_friction.py", "elements/test_friction_robot.py"),
    ),
    "friction: presliding twice as long": Mutation(
        "return state.mobilisation + (slip - state.slip) / presliding",
        "return state.mobilisation + (slip - state.slip) / (2.0 * presliding)",
        ("elements/test_friction.py",),
    ),
    "friction: history of the slip is not carried over": Mutation(
        "return FrictionState(field.slip, field.mobilisation, field.slip_rate, field.time)",
        "return FrictionState(field.slip, 0.0 * field.mobilisation, field.slip_rate, field.time)",
        ("elements/test_friction.py", "elements/test_friction_robot.py"),
    ),
    "friction: names of the hole states exchanged": Mutation(
        'np.where(mobilisation >= 1.0, "pull", np.where(mobilisation <= -1.0, "release", "stick"))',
        'np.where(mobilisation >= 1.0, "release", np.where(mobilisation <= -1.0, "pull", "stick"))',
        ("elements/test_friction_robot.py", "commands/test_run.py"),
    ),
    "tendon: turning angle is the chord": Mutation(
        "angles = 2.0 * np.arcsin(np.minimum(0.5 * np.sqrt(chord), 1.0))\n        return lengths",
        "angles = np.sqrt(chord)\n        return lengths",
        ("elements/test_tendons.py",),
    ),
    "tendon in Exudyn's solvers: turning angle is the chord": Mutation(
        "angles = 2.0 * np.arcsin(np.minimum(0.5 * np.sqrt(chord), 1.0))\n        trial",
        "angles = np.sqrt(chord)\n        trial",
        ("elements/test_straight_tendons.py",),
    ),
    "tendon: stretch twice as large": Mutation(
        "stretch = 1.0 / (1.0 + c * tension)",
        "stretch = 1.0 / (1.0 + 2.0 * c * tension)",
        ("elements/test_friction.py", "elements/test_friction_robot.py", "solve/test_pretension.py"),
    ),
    "tendon: converging holes": Mutation(
        "rate = (self.end_offset - self.offset) / end",
        "rate = (self.end_offset - self.offset) / (1.01 * end)",
        ("model/test_robot_facts.py",),
    ),
    "tangent: no geometric stiffness": Mutation(
        "return self.measured.shape.lines.stiffness(self.field.tension)",
        "return self.measured.shape.lines.stiffness(0.0 * self.field.tension)",
        ("solve/test_tangent.py", "elements/test_tendons.py"),
    ),
    "backbone: torsional stiffness of the section": Mutation(
        "return self.torsional_stiffness or self.shear_modulus * 2.0 * self.second_moment",
        "return float(self.shear_modulus * 1.9 * self.second_moment)",
        ("model/test_robot_facts.py",),
    ),
    "backbone: a shear correction": Mutation(
        "return self.shear_stiffness or self.shear_modulus * self.area",
        "return 0.9 * self.shear_modulus * self.area",
        ("model/test_robot_facts.py",),
    ),
    "backbone: disks are not rigid": Mutation(
        "stiffness[rigid] *= INSERT_FACTORS",
        "stiffness[rigid] *= 1.0",
        ("solve/test_solver.py", "effects/test_effects.py"),
    ),
    "backbone: damping of the material": Mutation(
        "return np.asarray(self.retardation[:, None] * twist_stiffness)",
        "return np.asarray(0.5 * self.retardation[:, None] * twist_stiffness)",
        ("scene/test_material_damping.py",),
    ),
    "load: one that follows the section is turned": Mutation(
        'return BEAM_TO_SECTION.T if self.frame == "section" else np.eye(3)',
        "return np.eye(3)",
        ("solve/test_solver.py", "scene/test_load_ramps.py", "solve/test_robot_model.py"),
    ),
    "load: gravity upside down": Mutation(
        "mass[:, None] * np.array(model.gravity)",
        "-mass[:, None] * np.array(model.gravity)",
        ("solve/test_robot_model.py", "solve/test_solver.py"),
    ),
    "load: gravity upside down in a scene": Mutation(
        "loadVector=list(gravity)",
        "loadVector=[-g for g in gravity]",
        ("scene/test_energy_sensor.py",),
    ),
    "history: loads that a step does not name end": Mutation(
        "loads = {**loads, **step.loads}",
        "loads = dict(step.loads)",
        ("model/test_robot_facts.py",),
    ),
    "mesh: half the estimated error": Mutation(
        'return float(np.sqrt(np.max(np.einsum("ni,ni->n", self.nodes, self.nodes))))',
        'return 0.5 * float(np.sqrt(np.max(np.einsum("ni,ni->n", self.nodes, self.nodes))))',
        ("solve/test_mesh.py",),
    ),
    "inverse statics: lower bounds of the tensions": Mutation(
        "low = np.clip(self.lower - tensions, -radius, radius) / self.scale",
        "low = np.clip(0.0 * self.lower - tensions, -radius, radius) / self.scale",
        ("solve/test_inverse.py",),
    ),
    "contact: radius of the disks": Mutation(
        "radius = robot.disks.radius if on_disk else float(radii[k])",
        "radius = 0.5 * robot.disks.radius if on_disk else float(radii[k])",
        ("scene/test_disk_contact.py",),
    ),
    "effect: torsion of stiffness_scale": Mutation(
        'b.GJ * values["torsion"]',
        'b.GJ * values["bending"]',
        ("effects/test_effects.py",),
    ),
    "effect: size of the backlash": Mutation(
        "low, high = (-backlash, 0.0) if first > 0.0 else (0.0, backlash)",
        "low, high = (-0.5 * backlash, 0.0) if first > 0.0 else (0.0, backlash)",
        ("effects/test_effects.py",),
    ),
    "effect: offset of the markers": Mutation(
        'along=before.along + values.get("offset_z", 0.0)',
        'along=before.along - values.get("offset_z", 0.0)',
        ("effects/test_effects.py", "identify/test_reader.py"),
    ),
    "reader: angle_deg in degrees": Mutation(
        "np.deg2rad(self.angle_deg) + rate * s",
        "self.angle_deg + rate * s",
        ("model/test_robot_facts.py",),
    ),
    "reader: a negative tension is taken": Mutation(
        'tension = _number(0.0, allowed="a tension must be zero or more [N]"',
        'tension = _number(-1e3, allowed="a tension must be zero or more [N]"',
        ("io/test_measured.py",),
    ),
    "schema: range of the parameters of effects": Mutation(
        'bounds = {"minimum": p.lower, "maximum": p.upper}',
        'bounds = {"minimum": p.lower}',
        ("io/test_json_schema.py",),
    ),
    "tables: numbers of the segments": Mutation(
        "for k, (tension, state) in enumerate(zip(tensions, states, strict=True), start=1)",
        "for k, (tension, state) in enumerate(zip(tensions, states, strict=True), start=0)",
        ("commands/test_run.py", "io/test_output.py", "model/test_results.py"),
    ),
    "tables: order of the quaternion": Mutation(
        ".as_quat(), 1, axis=1)", ".as_quat(), 0, axis=1)", ("model/test_results.py", "io/test_output.py")
    ),
    "command: exit status of a run that fails": Mutation(
        "return INTERRUPTED if interrupted else FAILURE",
        "return INTERRUPTED if interrupted else SUCCESS",
        ("commands/test_cli.py",),
    ),
    "sweep: Sobol index of total order": Mutation(
        "0.5 * (change**2).mean(axis=0) / variance",
        "(change**2).mean(axis=0) / variance",
        ("sweeps/test_statistics.py",),
    ),
    "identify: sigma is ignored": Mutation(
        "problem = replace(problem, sigma=sigma)\n",
        "problem = replace(problem, sigma=np.full_like(sigma, np.median(sigma)))\n",
        ("identify/test_data_faults.py",),
    ),
    "identify: held-out readings are fitted": Mutation(
        "return ~self.held_out", "return np.ones_like(self.held_out)", ("identify/test_identify.py",)
    ),
    "identify: structure of the residual": Mutation(
        "return is_noise(structure(problem.data, r, len(fit.free)), significance)",
        "return True",
        ("identify/test_identify.py",),
    ),
    "identify: verdict of a part": Mutation(
        "return Verdict.PARTLY_EXPLAINED if state.best.effects",
        "return Verdict.EXPLAINED if state.best.effects",
        ("identify/test_identify.py",),
    ),
}


@dataclass(frozen=True)
class Outcome:
    """Which test notices a mutation."""

    mutation: str
    file: str  # of the product
    tier: str  # whose tests notice, empty where none does
    caught_by: str  # the first test that fails
    problem: str  # why it could not be tried; empty where it was

    @property
    def passed(self) -> bool:
        """Whether a test notices."""
        return bool(self.tier)


def place(line: str, root: Path = CLONE) -> Path:
    """The file with a line of the product, relative to the root.

    Raises
    ------
    ValueError
        The line does not occur exactly once: the table needs its present text.
    """
    files = [f for folder in PRODUCT for f in sorted((root / folder).rglob("*.py"))]
    found = [f for f in files for _ in range(f.read_text(encoding="utf-8").count(line))]
    if len(found) != 1:
        raise ValueError(f"occurs {len(found)} times: {line!r}")
    return found[0].relative_to(root)


@contextmanager
def mutated(mutation: Mutation) -> Iterator[tuple[Path, Path]]:
    """A copy of the clone with a mutation, and the file that has it."""
    file = place(mutation.line)
    with TemporaryDirectory() as folder:
        copy = Path(folder) / "clone"
        shutil.copytree(CLONE, copy, ignore=shutil.ignore_patterns(".*", "__pycache__", "out"))
        text = (copy / file).read_text(encoding="utf-8")
        (copy / file).write_text(text.replace(mutation.line, mutation.becomes), encoding="utf-8")
        yield copy, file


def run_tests(copy: Path, tests: Sequence[str], tier: str, workers: int) -> str:
    """The first test that fails in a copy; empty where all pass.

    Raises
    ------
    RuntimeError
        The tests could not run: the mutation breaks an import, or a file is not there.
    """
    command = [sys.executable, "-m", "pytest", "-x", "-q", "-rfE", "--no-header", "-p", "no:cacheprovider"]
    command += ["-n", str(workers), "-m", TIERS[tier], *tests]
    environment = {**os.environ, "PYTHONPATH": str(copy), "PYTHONDONTWRITEBYTECODE": "1"}
    done = subprocess.run(command, cwd=copy, env=environment, capture_output=True, text=True, check=False)
    failed = re.search(r"^(?:FAILED|ERROR) (\S.*?)(?: - |$)", done.stdout, re.MULTILINE)
    if done.returncode == 1 and failed:
        return failed.group(1)
    if done.returncode in (0, 5):  # 5: no tests of this tier
        return ""
    raise RuntimeError((done.stdout + done.stderr)[-1000:])


def try_mutation(name: str, near_only: bool, workers: int) -> Outcome:
    """Mutate a copy, and run tests until one notices."""
    try:
        with mutated(MUTATIONS[name]) as (copy, file):
            near = [f"tests/{path}" for path in MUTATIONS[name].near if (copy / "tests" / path).exists()]
            runs = [(near, "default", 0)] if near else []
            if not near_only:
                runs += [([], tier, workers) for tier in TIERS]
            for tests, tier, number in runs:
                test = run_tests(copy, tests, tier, number)
                if test and run_tests(CLONE, [test], tier, 0):
                    raise RuntimeError(f"{test} fails without the mutation, too")
                if test:
                    return Outcome(name, str(file), tier, test, "")
            return Outcome(name, str(file), "", "", "")
    except (ValueError, RuntimeError) as error:
        return Outcome(name, "", "", "", str(error))


class Mutations(Campaign):
    """See the text of this module."""

    unit = "mutation"
    outcome = Outcome
    most_late: ClassVar[int] = MOST_LATE

    def add_options(self, parser: argparse.ArgumentParser) -> None:
        """How far to go."""
        parser.add_argument("--near", action="store_true", help="only the tests nearest to each mutation")
        parser.add_argument("--workers", type=int, default=2, help="of pytest, for all tests (2)")

    def cases(self, options: argparse.Namespace) -> Mapping[str, Any]:
        """All mutations."""
        return {name: (name, options.near, options.workers) for name in MUTATIONS}

    def run(self, case: tuple[str, bool, int], out: Path) -> Outcome:
        """Break the product and run the tests."""
        return try_mutation(*case)

    def report(self, outcomes: Sequence[Outcome]) -> list[str | pd.DataFrame]:
        """Which test notices, and how many do."""
        early = sum(o.tier == "default" for o in outcomes)
        caught = sum(o.passed for o in outcomes)
        text = (
            f"{count(len(outcomes), self.unit)}: {early} caught by the default tests, {caught} by all tests"
        )
        return [self.table(outcomes), text]

    def passed(self, outcomes: Sequence[Outcome]) -> bool:
        """All are caught, nearly all of them by the default tests."""
        return (
            all(o.passed for o in outcomes) and sum(o.tier != "default" for o in outcomes) <= self.most_late
        )


CAMPAIGN = Mutations()

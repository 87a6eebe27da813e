"""Random two-segment robots through `tdcr-fe run` with default settings, against the equations of two public codes."""

from __future__ import annotations

import csv
import json
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tdcr_fe.io.write_toml import robot_to_toml, scenario_to_toml
from tdcr_fe.model.backbone import Backbone
from tdcr_fe.model.loading import Load, LoadStep, Model
from tdcr_fe.model.robot import Disks, Robot
from tdcr_fe.model.routing import ParallelRouting
from tdcr_fe.model.tendon import Tendon
from tdcr_fe.validation.public_codes.equations import solve

Array = NDArray[np.float64]

#: Largest distance of the tip, as a fraction of the length, unless the summary's error estimate is larger.
TOLERANCE = 5e-4


@dataclass(frozen=True)
class Case:
    """One robot and its loading.

    Attributes
    ----------
    number : int
        Seed.
    robot : Robot
    path : str
        "straight" or "continuous".
    tensions : dict of str to float
        [N].
    force : ndarray, shape (3,)
        At the tip, world frame [N].
    """

    number: int
    robot: Robot
    path: str
    tensions: dict[str, float]
    force: Array

    @property
    def disks_per_segment(self) -> int:
        """Disks of each of the two segments."""
        return len(self.robot.disks.positions) // 2


def draw(number: int) -> Case:
    """A robot of two segments and six tendons, as both public codes have it, with random sizes and loading.

    Parameters
    ----------
    number
        Seed; even numbers have straight tendons, odd ones continuous.
    """
    rng = np.random.default_rng([2021, number])
    path = ("straight", "continuous")[number % 2]
    lengths = rng.uniform(0.08, 0.25, 2)
    disks = int(rng.integers(3, 21))
    radius = float(rng.uniform(0.3e-3, 0.6e-3))
    youngs_modulus = float(rng.uniform(50e9, 85e9))
    total = float(lengths.sum())
    steps = np.arange(1, disks + 1) / disks
    positions = (*(lengths[0] * steps).tolist(), *(lengths[0] + lengths[1] * steps).tolist())
    backbone = Backbone(total, radius, youngs_modulus, 0.3)
    offsets = rng.uniform(3e-3, 8e-3, 2)
    tendons, tensions = [], {}
    for k in range(2):
        end = float(positions[disks - 1]) if k == 0 else total
        pulled = rng.choice(3, int(rng.integers(1, 3)), replace=False)
        angle = float(rng.uniform(0.2, 1.4))
        for i in range(3):
            name = f"s{k + 1}t{i + 1}"
            tendons.append(
                Tendon(name, ParallelRouting(float(offsets[k]), 90.0 + 120.0 * i + 60.0 * k), end=end)
            )
            if i in pulled:
                share = float(rng.uniform(0.3, 1.0)) if len(pulled) > 1 else 1.0
                tensions[name] = share * angle * backbone.EI / (float(offsets[k]) * float(lengths[k]))
    force = np.zeros(3)
    if rng.random() < 0.6:
        force = rng.uniform(0.0, 0.6) * backbone.EI / total**2 * rng.standard_normal(3)
    robot = Robot(backbone, Disks(positions, radius=10e-3), tuple(tendons), name=f"public-{number}")
    return Case(number, robot, path, tensions, force)


@dataclass(frozen=True)
class Comparison:
    """Tip position by the command and by the equations.

    Attributes
    ----------
    case : Case
    status : int
        Exit status of the command.
    deviation : float
        Distance of both tips over the length [1].
    deviation_without_kinks : float
        The same from the equations without the kinks of tendons that go on where others end, as the first code has
        them [1].
    estimate : float
        Discretisation error in the summary over the length [1].
    bending_deg : float
        Angle of the tip tangent to +z [deg].
    warnings : tuple of str
    """

    case: Case
    status: int
    deviation: float
    deviation_without_kinks: float
    estimate: float
    bending_deg: float
    warnings: tuple[str, ...]

    @property
    def passed(self) -> bool:
        """Within the tolerance, or within twice the estimate of the summary."""
        return self.status == 0 and self.deviation <= max(TOLERANCE, 2.0 * self.estimate)


def compare(case: Case, folder: Path) -> Comparison:
    """Solve a case with both.

    Parameters
    ----------
    case
        What to solve.
    folder
        Where the files of the run go.
    """
    folder.mkdir(parents=True, exist_ok=True)
    length = case.robot.backbone.length
    f = tuple(float(x) for x in case.force)
    step = LoadStep("load", case.tensions, loads={"tip": Load(length, f)} if any(f) else {})  # type: ignore[arg-type]
    (folder / "robot.toml").write_text(robot_to_toml(case.robot), encoding="utf-8")
    model = Model(case.path, "none")  # type: ignore[arg-type]
    (folder / "scenario.toml").write_text(scenario_to_toml(model, [step]), encoding="utf-8")
    out = folder / "out"
    command = [sys.executable, "-m", "tdcr_fe", "run", str(folder / "scenario.toml"), "-o", str(out)]
    done = subprocess.run([*command, "--no-pictures", "-q"], capture_output=True, text=True, check=False)
    if not (out / "steps.csv").exists():
        raise RuntimeError(f"case {case.number}: tdcr-fe run gave no result: {done.stderr.strip()}")
    solution, without = (
        solve(case.robot, case.tensions, case.force, case.path, kinks=kinks) for kinks in (True, False)
    )
    with (out / "steps.csv").open(encoding="utf-8", newline="") as table:
        row = list(csv.DictReader(table))[-1]
    summary = json.loads((out / "summary.json").read_text(encoding="utf-8"))
    tip = np.array([float(row[f"tip_{axis}"]) for axis in "xyz"])
    return Comparison(
        case,
        done.returncode,
        float(np.linalg.norm(tip - solution.tip)) / length,
        float(np.linalg.norm(tip - without.tip)) / length,
        summary["steps"][-1]["discretisation_error"] / length,
        float(np.degrees(np.arccos(np.clip(solution.tangent[2], -1.0, 1.0)))),
        tuple(summary["warnings"]),
    )


def compare_all(numbers: range, folder: Path) -> Iterator[Comparison]:
    """`compare` for every seed."""
    for number in numbers:
        yield compare(draw(number), folder / str(number))


def format_row(c: Comparison) -> str:
    """A comparison as a row of the table."""
    errors = (f"{100.0 * x:.5f} %" for x in (c.deviation, c.deviation_without_kinks, c.estimate))
    cells = [
        str(c.case.number),
        c.case.path,
        str(c.case.disks_per_segment),
        "yes" if np.any(c.case.force) else "no",
        f"{c.bending_deg:.1f}",
        *errors,
        "yes" if c.passed else "NO",
    ]
    return f"| {' | '.join(cells)} |"


COLUMNS = (
    "seed",
    "tendons",
    "disks a segment",
    "tip force",
    "tip angle [deg]",
    "off the equations",
    "off them without kinks",
    "estimate",
    "passed",
)
HEAD = f"| {' | '.join(COLUMNS)} |\n|{' --- |' * len(COLUMNS)}"

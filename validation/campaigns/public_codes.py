"""Random two-segment robots through tdcr-fe run with default settings, against the equations of two public codes."""

from __future__ import annotations

import csv
import json
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from tdcr_fe.io.write_toml import robot_to_toml, scenario_to_toml
from tdcr_fe.model.backbone import Backbone
from tdcr_fe.model.loading import Load, LoadStep, Model
from tdcr_fe.model.robot import Disks, Robot
from tdcr_fe.model.routing import ParallelRouting
from tdcr_fe.model.tendon import Tendon
from tdcr_fe.validation.public_codes import solve
from tdcr_fe.validation.runner import Campaign

Array = NDArray[np.float64]

#: Largest distance of the tip, as a fraction of the length, unless the summary's error estimate is larger.
TOLERANCE = 5e-4


@dataclass(frozen=True)
class Case:
    """One robot and its loading."""

    number: int  # seed
    robot: Robot
    path: str  # "straight" or "continuous"
    tensions: dict[str, float]  # [N]
    force: Array  # at the tip, world frame [N], shape (3,)


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
            routing = ParallelRouting(float(offsets[k]), 90.0 + 120.0 * i + 60.0 * k)
            tendons.append(Tendon(name, routing, end=end))
            if i in pulled:
                share = float(rng.uniform(0.3, 1.0)) if len(pulled) > 1 else 1.0
                tensions[name] = share * angle * backbone.EI / (float(offsets[k]) * float(lengths[k]))
    force = np.zeros(3)
    if rng.random() < 0.6:
        force = rng.uniform(0.0, 0.6) * backbone.EI / total**2 * rng.standard_normal(3)
    robot = Robot(backbone, Disks(positions, radius=10e-3), tuple(tendons), name=f"public-{number}")
    return Case(number, robot, path, tensions, force)


@dataclass(frozen=True)
class Outcome:
    """Tip position by the command and by the equations."""

    seed: int
    tendons: str  # "straight" or "continuous"
    disks: int
    tip_force: bool
    tip_angle: float  # angle of the tip tangent to +z [deg]
    deviation: float  # distance of both tips over the length [1]
    #: The same from the equations without the kinks of tendons that go on where others end, as the first code has them.
    deviation_without_kinks: float
    estimate: float  # discretisation error in the summary over the length [1]
    status: int  # exit status of the command

    @property
    def passed(self) -> bool:
        """Within the tolerance, or within twice the estimate of the summary."""
        return self.status == 0 and self.deviation <= max(TOLERANCE, 2.0 * self.estimate)


def compare(case: Case, folder: Path) -> Outcome:
    """Solve a case with both; the files of the run go into a folder."""
    folder.mkdir(parents=True, exist_ok=True)
    length = case.robot.backbone.length
    x, y, z = (float(c) for c in case.force)
    step = LoadStep("load", case.tensions, loads={"tip": Load(length, (x, y, z))} if any((x, y, z)) else {})
    model = Model(case.path, "none")  # type: ignore[arg-type]
    (folder / "robot.toml").write_text(robot_to_toml(case.robot), encoding="utf-8")
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
    return Outcome(
        case.number,
        case.path,
        len(case.robot.disks.positions),
        bool(np.any(case.force)),
        float(np.degrees(np.arccos(np.clip(solution.tangent[2], -1.0, 1.0)))),
        float(np.linalg.norm(tip - solution.tip)) / length,
        float(np.linalg.norm(tip - without.tip)) / length,
        summary["steps"][-1]["discretisation_error"] / length,
        done.returncode,
    )


class PublicCodes(Campaign):
    """See the text of this module."""

    count: ClassVar[int | None] = 40
    outcome = Outcome

    def run(self, case: int, out: Path) -> Outcome:
        """Draw a case and compare."""
        return compare(draw(case), out / "runs" / str(case))

    def row(self, outcome: Outcome) -> dict[str, Any]:
        """Deviations in per cent of the length."""
        return {
            "seed": outcome.seed,
            "tendons": outcome.tendons,
            "disks": outcome.disks,
            "tip force": "yes" if outcome.tip_force else "no",
            "tip angle [deg]": round(outcome.tip_angle, 1),
            "off the equations [%]": f"{100.0 * outcome.deviation:.5f}",
            "off them without kinks [%]": f"{100.0 * outcome.deviation_without_kinks:.5f}",
            "estimate [%]": f"{100.0 * outcome.estimate:.5f}",
            "passed": outcome.passed,
        }

    def report(self, outcomes: Sequence[Outcome]) -> list[str | pd.DataFrame]:
        """All robots, and the largest deviation by tendon path."""
        largest = {
            path: max((o.deviation for o in outcomes if o.tendons == path), default=0.0)
            for path in ("straight", "continuous")
        }
        return [
            *super().report(outcomes),
            *(f"{path}: at most {100.0 * worst:.5f} % of the length" for path, worst in largest.items()),
        ]


CAMPAIGN = PublicCodes()

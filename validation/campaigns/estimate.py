"""Estimated forces and tensions of a rod with friction, against those that act in the independent reference.

The problem is that of Kuntz-Lab/bendier: tensions between 0.2 and 1.2 N, whose errors and the force at the tip change
with a correlation time of 1 s, 30 frames a second, and the tip measured to 0.1 mm.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from time import process_time
from typing import Any, ClassVar

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.stats import chi2

import tdcr_fe as tdcr
from tdcr_fe.validation.reference.sequence import solve_reference
from tdcr_fe.validation.runner import Campaign

Array = NDArray[np.float64]

LENGTH, RATE = 0.25, 30.0
FORCE_SIGMA, READING_SIGMA = 0.05, 1e-4
#: Friction in the reference and standard deviation of the tensions [1, N].
CASES = ((0.0, 0.1), (0.0, 0.01), (0.1, 0.01), (0.2, 0.01), (0.3, 0.01))
#: Frames at the beginning that do not count.
BEGINNING = 5


def rod(friction: float = 0.0) -> tdcr.Robot:
    """0.25 m, 1.2 mm thick, nine disks, holes at 10 mm, a helical tendon and three straight ones."""
    routings: dict[str, Any] = {"helix": tdcr.HelicalRouting(0.01, turns=1.0)}
    routings |= {f"t{a}": tdcr.ParallelRouting(0.01, angle_deg=float(a)) for a in (180, 270, 0)}
    return tdcr.Robot(
        tdcr.Backbone(LENGTH, 0.6e-3, 40e9, 1.0 / 3.0),
        tdcr.Disks.equally_spaced(9, LENGTH, radius=0.012),
        tuple(tdcr.Tendon(n, x, friction_coefficient=friction) for n, x in routings.items()),
    )


def model(friction: float = 0.0) -> tdcr.Model:
    """One element a bay."""
    return tdcr.Model(elements_per_bay=1, friction="per-hole" if friction else "none")


@dataclass(frozen=True, eq=False)
class Drawn:
    """What is commanded and what acts."""

    robot: tdcr.Robot
    times: Array
    commands: Array  # (count, m): Tensions [N]
    tensions: Array  # (count, m): That act [N]
    forces: Array  # (count, 3): At the tip [N]

    @classmethod
    def of(
        cls,
        friction: float,
        tension_sigma: float,
        count: int,
        seed: int,
        scale: float = 1.0,
        memory: float = 1.0,
    ) -> Drawn:
        """Draw from the priors; ``scale``: of all standard deviations; ``memory``: correlation time [s]."""
        rng, times = np.random.default_rng(seed), np.arange(count) / RATE
        period, phase = rng.uniform(3.0, 8.0, 4), rng.uniform(0.0, 2.0 * np.pi, 4)
        commands = 0.7 + 0.5 * np.sin(2.0 * np.pi * times[:, None] / period + phase)
        errors = scale * gauss_markov(rng, count, np.repeat((tension_sigma, FORCE_SIGMA), (4, 3)), memory)
        tensions = np.maximum(commands + errors[:, :4], 0.0)
        return cls(rod(friction), times, commands, tensions, errors[:, 4:])

    def step(self, tensions: Array, k: int, **loads: tdcr.Load) -> tdcr.LoadStep:
        """A frame, from 0."""
        named = dict(zip(self.robot.tendon_names, tensions[k].tolist(), strict=True))
        return tdcr.LoadStep(tensions=named, loads=loads, time=float(self.times[k]))

    def steps(self, at: float = LENGTH) -> list[tdcr.LoadStep]:
        """All frames as they act, with the force at an arc length."""
        loads = [tdcr.Load(at=at, force=tuple(f.tolist())) for f in self.forces]
        return [self.step(self.tensions, k, force=load) for k, load in enumerate(loads)]


def gauss_markov(rng: np.random.Generator, count: int, sigma: Array, memory: float) -> Array:
    """Rows of a Gauss-Markov process with a correlation time [s]."""
    kept = np.exp(-1.0 / RATE / memory)
    rows = sigma * rng.standard_normal((count, len(sigma)))
    for k in range(1, count):
        rows[k] = kept * rows[k - 1] + np.sqrt(1.0 - kept**2) * rows[k]
    return rows


def read(
    rng: np.random.Generator, point: Array, at: float = LENGTH, sigma: float = READING_SIGMA
) -> list[tdcr.Reading]:
    """Coordinates of a marker with noise."""
    values = point + sigma * rng.standard_normal(3)
    return [tdcr.Reading(0, f"position_{a}", at, float(x), sigma) for a, x in zip("xyz", values, strict=True)]


def squared(errors: Array, covariances: Array) -> Array:
    """Errors in units of their covariances, squared, by frame."""
    return np.asarray(np.einsum("ki,kij,kj->k", errors, np.linalg.inv(covariances), errors))


@dataclass(frozen=True)
class Outcome:
    """Of one run."""

    friction: float
    tension_sigma: float  # [N]
    seed: int
    force_error: float  # root of the mean square of the distance [mN]
    force_nees: float  # mean of the error in units of its covariance, squared; ideally 3
    inside: float  # part of the frames inside the 95 % interval
    tension_nees: float  # the same of the tensions, for three degrees of freedom
    shape_error: float  # largest of any node, over the length [%]
    milliseconds: float  # of the processor for a frame: median, and 95 % within
    milliseconds_95: float
    not_solved: int

    @property
    def passed(self) -> bool:
        """All frames were solved."""
        return not self.not_solved


def run(friction: float, tension_sigma: float, seed: int, count: int) -> Outcome:
    """Draw a run, solve it with the reference, and estimate it."""
    drawn, rng = Drawn.of(friction, tension_sigma, count, seed), np.random.default_rng(1000 + seed)
    truth = solve_reference(drawn.robot, model(friction), drawn.steps()).steps
    own = tdcr.Estimator(
        drawn.robot, model(friction), tdcr.LoadPrior(sigma=FORCE_SIGMA), tdcr.InputPrior(sigma=tension_sigma)
    )
    frames, times = [], []
    for k, step in enumerate(truth):
        readings, begun = read(rng, step.positions[-1]), process_time()
        frames.append(own.step(drawn.step(drawn.commands, k), readings))
        times.append(1e3 * (process_time() - begun))
    counted = slice(BEGINNING, None)
    force = (np.array([f.force for f in frames]) - drawn.forces)[counted]
    tension = (np.array([f.tensions for f in frames]) - drawn.tensions)[counted]
    of_force = squared(force, np.array([f.force_covariance for f in frames])[counted])
    of_tension = squared(tension, np.array([f.tension_covariance for f in frames])[counted])
    shapes = [np.abs(f.result.positions - t.positions).max() for f, t in zip(frames, truth, strict=True)]
    return Outcome(
        friction,
        tension_sigma,
        seed,
        1e3 * float(np.sqrt(np.mean(np.sum(force**2, axis=1)))),
        float(of_force.mean()),
        float(np.mean(of_force < chi2.ppf(0.95, 3))),
        float(of_tension.mean()) * 3.0 / tension.shape[1],
        100.0 * float(max(shapes[counted])) / LENGTH,
        float(np.median(times)),
        float(np.quantile(times, 0.95)),
        sum(bool(f.message) for f in frames),
    )


class Estimation(Campaign):
    """See the text of this module."""

    unit: ClassVar[str] = "run"
    count: ClassVar[int | None] = 3
    outcome = Outcome

    def add_options(self, parser: argparse.ArgumentParser) -> None:
        """Number of frames."""
        parser.add_argument("--frames", type=int, default=270, help="frames of each run (270)")

    def cases(self, options: argparse.Namespace) -> Mapping[str, Any]:
        """Every friction and error of the tensions, with each seed."""
        seeds = range(options.first, options.first + options.n)
        return {f"{mu} {sigma} {s}": (mu, sigma, s, options.frames) for s in seeds for mu, sigma in CASES}

    def run(self, case: tuple[float, float, int, int], out: Path) -> Outcome:
        """One run."""
        return run(*case)

    def report(self, outcomes: Sequence[Outcome]) -> list[str | pd.DataFrame]:
        """Means over the seeds."""
        table = self.table(outcomes).drop(columns="seed")
        return [table.groupby(["friction", "tension_sigma"]).mean().round(3).reset_index()]


CAMPAIGN = Estimation()

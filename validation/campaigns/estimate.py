"""Estimated forces and tensions of a rod with friction, against those that act in the independent reference.

The problem is that of Kuntz-Lab/bendier: tensions between 0.2 and 1.2 N, whose errors and the force at the tip change
with a correlation time of 1 s, 30 frames a second, and the tip measured to 0.1 mm. Options have other readings, two
segments, and the finite elements as truth, with which there is time for minutes of frames.
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
from scipy.stats import chi2

import tdcr_fe as tdcr
from tdcr_fe.effects import Experiment, with_effects
from tdcr_fe.elements import Array
from tdcr_fe.model.channels import channel
from tdcr_fe.model.loading import resolve
from tdcr_fe.model.observed_step import Observation, ObservedStep
from tdcr_fe.model.results import SequenceResult, StepResult
from tdcr_fe.solve.load_steps.load_path import StepFailed
from tdcr_fe.validation.reference.sequence import solve_reference
from tdcr_fe.validation.runner import Campaign

Random = np.random.Generator

LENGTH, RATE = 0.25, 30.0
FORCE_SIGMA, READING_SIGMA = 0.05, 1e-4
#: Friction in the reference and standard deviation of the tensions [1, N].
CASES = ((0.0, 0.1), (0.0, 0.01), (0.1, 0.01), (0.2, 0.01), (0.3, 0.01))
#: Standard deviations of bending stiffness and friction where they are not known exactly [1].
UNCERTAIN = {"stiffness_scale.bending": 0.05, "friction_coefficient.mu": 0.03}
#: Frames at the beginning that do not count.
BEGINNING = 5
_POSITION, _CURVATURE = [f"position_{a}" for a in "xyz"], ["curvature_x", "curvature_y"]
#: What is read: channels, arc lengths over the length, and standard deviation [m or 1/m].
READINGS: dict[str, tuple[list[str], tuple[float, ...], float]] = {
    "tip": (_POSITION, (1.0,), READING_SIGMA),
    "middle": (_POSITION, (0.5, 1.0), READING_SIGMA),
    "markers": (_POSITION, (1.0 / 3.0, 2.0 / 3.0, 1.0), READING_SIGMA),  # the place of the force is unknown
    "curvatures": (_CURVATURE, (1.0 / 3.0, 2.0 / 3.0), 0.02),
}


def rod(friction: float = 0.0, segments: int = 1) -> tdcr.Robot:
    """0.25 m, 1.2 mm thick, nine disks a segment, holes at 10 mm.

    One segment has a helical tendon and three straight ones, each of two has four straight ones.
    """
    tendons = [tdcr.Tendon("helix", tdcr.HelicalRouting(0.01, turns=1.0), friction)]
    tendons += [_straight(f"t{a}", float(a), friction) for a in (180, 270, 0)]
    if segments == 2:
        lower = [_straight(f"a{a}", float(a), friction, 0.5 * LENGTH) for a in (0, 90, 180, 270)]
        tendons = [*lower, *(_straight(f"b{a}", float(a), friction) for a in (45, 135, 225, 315))]
    backbone = tdcr.Backbone(LENGTH, 0.6e-3, 40e9, 1.0 / 3.0)
    return tdcr.Robot(backbone, tdcr.Disks.equally_spaced(9 * segments, LENGTH, radius=0.012), tuple(tendons))


def _straight(name: str, angle: float, friction: float, end: float = LENGTH) -> tdcr.Tendon:
    return tdcr.Tendon(name, tdcr.ParallelRouting(0.01, angle_deg=angle), friction, end)


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
        segments: int = 1,
    ) -> Drawn:
        """Draw from the priors; ``scale``: of all standard deviations; ``memory``: correlation time [s]."""
        rng, times, robot = np.random.default_rng(seed), np.arange(count) / RATE, rod(friction, segments)
        m = len(robot.tendons)
        period, phase = rng.uniform(3.0, 8.0, m), rng.uniform(0.0, 2.0 * np.pi, m)
        commands = 0.7 + 0.5 * np.sin(2.0 * np.pi * times[:, None] / period + phase)
        errors = scale * gauss_markov(rng, count, np.repeat((tension_sigma, FORCE_SIGMA), (m, 3)), memory)
        tensions = np.maximum(commands + errors[:, :m], 0.0)
        return cls(robot, times, commands, tensions, errors[:, m:])

    def step(self, tensions: Array, k: int, **loads: tdcr.Load) -> tdcr.LoadStep:
        """A frame, from 0."""
        named = dict(zip(self.robot.tendon_names, tensions[k].tolist(), strict=True))
        return tdcr.LoadStep(tensions=named, loads=loads, time=float(self.times[k]))

    def steps(self, at: float = LENGTH) -> list[tdcr.LoadStep]:
        """All frames as they act, with the force at an arc length."""
        loads = [tdcr.Load(at=at, force=tuple(f.tolist())) for f in self.forces]
        return [self.step(self.tensions, k, force=load) for k, load in enumerate(loads)]


def gauss_markov(rng: Random, count: int, sigma: Array, memory: float) -> Array:
    """Rows of a Gauss-Markov process with a correlation time [s]."""
    kept = np.exp(-1.0 / RATE / memory)
    rows = sigma * rng.standard_normal((count, len(sigma)))
    for k in range(1, count):
        rows[k] = kept * rows[k - 1] + np.sqrt(1.0 - kept**2) * rows[k]
    return rows


def read(rng: Random, point: Array, at: float = LENGTH, sigma: float = READING_SIGMA) -> list[tdcr.Reading]:
    """Coordinates of a marker with noise."""
    values = point + sigma * rng.standard_normal(3)
    return [tdcr.Reading(0, f"position_{a}", at, float(x), sigma) for a, x in zip("xyz", values, strict=True)]


def readings_of(kind: str, step: StepResult, names: tuple[str, ...], rng: Random) -> list[tdcr.Reading]:
    """Readings of `READINGS` of a solved step, with noise."""
    quantities, places, sigma = READINGS[kind]
    seen, found = ObservedStep.of(step, names, Observation()), []
    for at in LENGTH * np.array(places):
        for quantity in quantities:
            value = float(channel(quantity).predict(seen, [at])[0]) + sigma * rng.standard_normal()
            found.append(tdcr.Reading(0, quantity, float(at), value, sigma))
    return found


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
    smoothed_error: float  # as `force_error`, given also the readings of later frames [mN]
    smoothed_nees: float
    tension_nees: float  # the same of the tensions, for three degrees of freedom
    shape_error: float  # largest of any node, over the length [%]
    # of frames whose force exceeds three standard deviations: median and 95 % within, over the length [%]
    place_error: float
    place_error_95: float
    milliseconds: float  # of the processor for a frame: median, and 95 % within
    milliseconds_95: float
    not_solved: int

    @property
    def passed(self) -> bool:
        """All frames were solved."""
        return not self.not_solved


def solve_elements(of: tdcr.Robot, about: tdcr.Model, steps: Sequence[tdcr.LoadStep]) -> SequenceResult:
    """As `solve_reference`, by finite elements; a load step whose path cannot be resolved is one substep."""
    targets = resolve(of, steps)
    simulation, found = tdcr.Simulation(of, about, targets), []
    for k, target in enumerate(targets):
        before = simulation.position
        try:
            report = simulation.advance(target)
        except StepFailed:
            simulation.return_to(before)
            report = simulation.advance(target, 1)
        found.append(simulation.result(k + 1, "", report, target))
    return SequenceResult(of, about, tuple(found))


def run(friction: float, tension_sigma: float, seed: int, options: argparse.Namespace) -> Outcome:
    """Draw a run, solve it with the reference or the finite elements, and estimate it."""
    drawn = Drawn.of(friction, tension_sigma, options.frames, seed, segments=options.segments)
    rng, solve = np.random.default_rng(1000 + seed), solve_elements if options.elements else solve_reference
    robot, sigmas = drawn.robot, dict(list(UNCERTAIN.items())[: 2 if friction else 1])
    if options.parameters != "known":
        bending, mu = np.array((1.0, friction)) + rng.standard_normal(2) * list(UNCERTAIN.values())
        values = {"stiffness_scale": {"bending": float(bending)}}
        if friction:
            values["friction_coefficient"] = {"mu": float(mu)}
        robot = with_effects(Experiment(robot, model(friction)), values).robot
    truth = solve(robot, model(friction), drawn.steps()).steps
    at: Any = "unknown" if options.readings == "markers" else "tip"
    priors = tdcr.LoadPrior(at, FORCE_SIGMA), tdcr.InputPrior(sigma=tension_sigma)
    uncertain = tdcr.ParameterPrior.independent(sigmas) if options.parameters == "estimated" else None
    own = tdcr.Estimator(drawn.robot, model(friction), *priors, uncertain=uncertain)
    frames, times = [], []
    for k, step in enumerate(truth):
        readings = readings_of(options.readings, step, drawn.robot.tendon_names, rng)
        begun = process_time()
        frames.append(own.step(drawn.step(drawn.commands, k), readings))
        times.append(1e3 * (process_time() - begun))
    counted = slice(BEGINNING, None)
    forces, covariances = _forces(frames, counted)
    force = forces - drawn.forces[counted]
    later, of_later = _forces(tdcr.smoothed(frames), counted)
    later = later - drawn.forces[counted]
    tension = (np.array([f.tensions for f in frames]) - drawn.tensions)[counted]
    of_force = squared(force, covariances)
    of_tension = squared(tension, np.array([f.tension_covariance for f in frames])[counted])
    shapes = [np.abs(f.result.positions - t.positions).max() for f, t in zip(frames, truth, strict=True)]
    places = 100.0 * np.array([abs(f.at - LENGTH) / LENGTH for f in frames])[counted]
    shown = np.sum(forces**2, axis=1) > 9.0 * np.trace(covariances, axis1=1, axis2=2) / 3.0
    place, place_95 = np.nanquantile(np.where(shown, places, np.nan), (0.5, 0.95))
    return Outcome(
        friction,
        tension_sigma,
        seed,
        _millinewtons(force),
        float(of_force.mean()),
        float(np.mean(of_force < chi2.ppf(0.95, 3))),
        _millinewtons(later),
        float(squared(later, of_later).mean()),
        float(of_tension.mean()) * 3.0 / tension.shape[1],
        100.0 * float(max(shapes[counted])) / LENGTH,
        float(place),
        float(place_95),
        float(np.median(times)),
        float(np.quantile(times, 0.95)),
        sum(bool(f.message) for f in frames),
    )


def _forces(frames: Sequence[tdcr.Estimate], counted: slice) -> tuple[Array, Array]:
    """Forces, and their covariances."""
    forces, covariances = (f.force for f in frames), (f.force_covariance for f in frames)
    return np.array([*forces])[counted], np.array([*covariances])[counted]


def _millinewtons(errors: Array) -> float:
    """Root of the mean square of a distance."""
    return 1e3 * float(np.sqrt(np.mean(np.sum(errors**2, axis=1))))


class Estimation(Campaign):
    """See the text of this module."""

    unit: ClassVar[str] = "run"
    count: ClassVar[int | None] = 3
    outcome = Outcome

    def add_options(self, parser: argparse.ArgumentParser) -> None:
        """Number of frames, what is read of them, and what solves them."""
        parser.add_argument("--frames", type=int, default=270, help="frames of each run (270)")
        parser.add_argument("--readings", choices=READINGS, default="tip", help="what is read (tip)")
        parser.add_argument("--segments", type=int, choices=(1, 2), default=1, help="of the robot (1)")
        known = (
            "bending stiffness and friction: known exactly, not known, or estimated, to 5 %% and 0.03 (known)"
        )
        parser.add_argument(
            "--parameters", choices=("known", "unknown", "estimated"), default="known", help=known
        )
        parser.add_argument("--elements", action="store_true", help="truth by finite elements")

    def cases(self, options: argparse.Namespace) -> Mapping[str, Any]:
        """Every friction and error of the tensions, with each seed."""
        seeds = range(options.first, options.first + options.n)
        return {f"{mu} {sigma} {s}": (mu, sigma, s, options) for s in seeds for mu, sigma in CASES}

    def run(self, case: tuple[float, float, int, argparse.Namespace], out: Path) -> Outcome:
        """One run."""
        return run(*case)

    def report(self, outcomes: Sequence[Outcome]) -> list[str | pd.DataFrame]:
        """Means over the seeds."""
        table = self.table(outcomes).drop(columns="seed")
        return [table.groupby(["friction", "tension_sigma"]).mean().round(3).reset_index()]


CAMPAIGN = Estimation()

"""What a load step costs, and how far the finite elements are from the independent reference.

``python docs/benchmarks.py`` prints the tables of the page "Validation" within a minute.
"""

from __future__ import annotations

import argparse
import platform
import time
from collections.abc import Callable
from dataclasses import replace
from math import degrees

import exudyn as exu
import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from tdcr_fe import (
    Backbone,
    CreateTDCR,
    Disks,
    LoadStep,
    Model,
    ParallelRouting,
    Robot,
    Simulation,
    SolverSettings,
    Tendon,
    simulate,
)
from tdcr_fe.model.loading import resolve
from tdcr_fe.validation.reference import solve_reference

Array = NDArray[np.float64]

LENGTH = 0.25
PULL = [LoadStep(tensions={"t1": t}) for t in (0.5, 1.0, 1.5, 2.0, 2.5)]
RELEASE = [LoadStep(tensions={"t1": t}) for t in (2.0, 1.5, 1.0, 0.5, 0.0)]


def robot(disks: int) -> Robot:
    """The paper's robot with another number of disks."""
    return Robot(
        backbone=Backbone(LENGTH, 0.4e-3, 85e9, 0.3, 5600.0),
        disks=Disks.equally_spaced(disks, LENGTH, mass=0.17e-3),
        tendons=(Tendon("t1", ParallelRouting(4.5e-3), friction_coefficient=0.3),),
    )


def least_time(call: Callable[[], object], count: int) -> float:
    """The least of single calls, which other programs disturb least [s]."""
    times = []
    for _ in range(count):
        begun = time.process_time()
        call()
        times.append(time.process_time() - begun)
    return min(times)


def exudyn_iteration(simulation: Simulation, count: int = 200) -> float:
    """Exudyn's residual and Jacobian in the present state, once each [s]."""
    mbs, settings = simulation.handle.mbs, exu.SimulationSettings()
    settings.solution.file.write = False
    settings.staticSolver.verboseMode = 0
    kernel = exu.MainSolverStatic()
    kernel.InitializeSolver(mbs, settings)

    def residual() -> None:
        kernel.ComputeNewtonResidual(mbs, settings)

    def jacobian() -> None:
        kernel.ComputeJacobianODE2RHS(mbs)
        kernel.ComputeJacobianAE(mbs)

    return least_time(residual, count) + least_time(jacobian, count)


def load_steps(disks: int, repeats: int = 100) -> tuple[Array, Array, float]:
    """Load steps of 0.5 N up to 2.5 N with friction.

    Returns
    -------
    times : ndarray, shape (5,)
        Least of every load step [s].
    iterations : ndarray, shape (5,)
    unit : float
        Exudyn's residual and Jacobian [s].
    """
    targets = resolve(robot(disks), PULL)
    times, unit = np.full(len(targets), np.inf), np.inf
    for _ in range(repeats):
        simulation = Simulation(robot(disks), Model(friction="per-hole", elements_per_bay=1), targets)
        iterations = np.zeros(len(targets))
        for i, target in enumerate(targets):
            begun = time.process_time()
            iterations[i] = simulation.advance(target).iterations_total
            times[i] = min(times[i], time.process_time() - begun)
        # In between, so that other load on the machine affects both alike.
        unit = min(unit, exudyn_iteration(simulation, 5))
    return times, iterations, unit


def accuracy(model: Model, per_bay: int, goal: Array) -> tuple[float, float]:
    """Tip angle [deg] at 2.5 N, and distance of the tip from the reference's [share of the length]."""
    result = simulate(robot(13), replace(model, elements_per_bay=per_bay), PULL)
    gap = float(np.linalg.norm(result.steps[-1].tip - goal)) / LENGTH
    return degrees(result.steps[-1].bending_angle), gap


def print_accuracy() -> None:
    """Print the table of mesh convergence against the Cosserat shooting reference."""
    print(
        "\n| elements per bay | no friction [deg] | off the reference | friction [deg] | off the reference |"
    )
    print("| --- | --- | --- | --- | --- |")
    models = (Model(friction="none"), Model(friction="per-hole"))
    goals = [solve_reference(robot(13), model, PULL).steps[-1] for model in models]
    for per_bay in (1, 2, 4, 8):
        cells = []
        for model, goal in zip(models, goals, strict=True):
            angle, gap = accuracy(model, per_bay, goal.tip)
            cells += [f"{angle:.4f}", f"{100.0 * gap:.4f} %"]
        print(f"| {per_bay} | {' | '.join(cells)} |", flush=True)
    angles = [f"{degrees(goal.bending_angle):.4f}" for goal in goals]
    print(f"| reference | {angles[0]} | | {angles[1]} | |")


#: Forty parameters: by tendon, of backbone and disks, of effects.
PARAMETERS = (
    *(f"inputs.t{k}" for k in (1, 2, 3)),
    *(f"tendons.t{k}.{n}" for n in ("offset", "angle_deg", "friction_coefficient") for k in (1, 2, 3)),
    *(f"backbone.{n}" for n in ("youngs_modulus", "radius", "poisson_ratio", "density", "length")),
    *(f"backbone.{n}_stiffness" for n in ("bending", "torsional", "axial", "shear")),
    *("backbone.precurvature[0]", "backbone.precurvature[1]", "disks.mass", "disks.positions[3]", "tip_mass"),
    *("tendons.offset", "tendons.friction_coefficient", "tendons.adhesion", "effects.actuator_gain.gain"),
    *(f"effects.gravity.g_{axis}" for axis in "xyz"),
    *("effects.stiffness_scale.bending", "effects.stiffness_scale.torsion", "effects.tip_payload.mass"),
    *("effects.hole_adhesion.drop", "effects.routing_twist.angle_tip", "effects.hole_clearance.clearance"),
    "effects.tendon_stretch.axial_stiffness",
)


def print_sensitivities() -> None:
    """Print what parameters beside a run cost, in steps of one substep."""
    tendons = tuple(
        Tendon(f"t{k + 1}", ParallelRouting(4.5e-3, 120.0 * k), friction_coefficient=0.3) for k in range(3)
    )
    arm, settings = replace(robot(13), tendons=tendons), SolverSettings(mesh_tolerance=np.inf)
    inputs = [(1.0 + float(np.sin(k / 9.0)), 1.0 + float(np.cos(k / 15.0)), 0.3) for k in range(100)]
    steps = [LoadStep(tensions=dict(zip(arm.tendon_names, x, strict=True)), substeps=1) for x in inputs]
    print("\n| parameters | 100 load steps [s] | over the run alone |\n| --- | --- | --- |")
    alone = 0.0
    for count in (0, 1, 10, len(PARAMETERS)):
        spent = np.inf
        for _ in range(5):
            begun = time.process_time()
            simulate(arm, Model(elements_per_bay=1), steps, settings, sensitivities=PARAMETERS[:count])
            spent = min(spent, time.process_time() - begun)
        alone = alone or spent
        print(f"| {count} | {spent:.2f} | {spent / alone:.2f} |", flush=True)


def dynamics(segments: int) -> tuple[float, int]:
    """Processor time [s] and iterations of a motion in Exudyn, with friction and material damping, in steps of 2 ms.

    Every segment has five disks, a tenth of a metre, and three tendons that end at its tip.
    """
    length, disks = 0.1 * segments, Disks.equally_spaced(5 * segments, 0.1 * segments, mass=0.17e-3)
    tendons = tuple(
        Tendon(
            f"t{3 * k + j + 1}",
            ParallelRouting(4.5e-3, 120.0 * j + 40.0 * k),
            friction_coefficient=0.2,
            end=None if k == segments - 1 else 0.1 * (k + 1),
        )
        for k in range(segments)
        for j in range(3)
    )
    backbone = Backbone(length, 0.4e-3, 85e9, 0.3, 5600.0, retardation_time=1e-2)
    container = exu.SystemContainer()
    mbs = container.AddSystem()
    arm = CreateTDCR(
        mbs, Robot(backbone, disks, tendons), Model(elements_per_bay=1), gravity=(0.0, 0.0, 9.81)
    )
    mbs.Assemble()
    phases = 2.0 / 3.0 * np.pi * np.arange(len(tendons))

    def tensions(t: float) -> Array:
        share = 0.5 * (1.0 - np.cos(np.pi * min(2.0 * t, 1.0)))
        return share * (0.6 + 0.4 * np.sin(2.0 * np.pi * t + phases))

    arm.set_inputs_over_time(tensions)
    settings = arm.recommended_settings(1.0, 2e-3)
    settings.timeIntegration.verboseMode, settings.solution.file.write = 0, False
    begun = time.process_time()
    mbs.SolveDynamic(settings)
    return time.process_time() - begun, mbs.sys["dynamicSolver"].it.newtonStepsCount


def print_dynamics() -> None:
    """Print how fast motions in Exudyn are."""
    print("\n| segments | tendons | time simulated over processor time | iterations of 500 steps |")
    print("| --- | --- | --- | --- |")
    for segments in (1, 2, 3):
        spent, iterations = min(dynamics(segments) for _ in range(3))
        print(f"| {segments} | {3 * segments} | {1.0 / spent:.2f} | {iterations} |", flush=True)


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--disks", type=int, nargs="*", default=[10, 13, 20, 40, 80])
    disks = parser.parse_args().disks
    print(f"Exudyn {exu.__version__}, numpy {np.__version__}, Python {platform.python_version()}\n")
    print(
        "| disks | load step [ms] | iterations | Exudyn's residual and Jacobian [ms] | step / (iterations x that) "
        "| first step from rest [ms] |"
    )
    print("| --- | --- | --- | --- | --- | --- |")
    for n in disks:
        times, iterations, unit = load_steps(n, 100 if n < 30 else 15)
        step, count = float(np.median(times)), float(np.median(iterations))
        print(
            f"| {n} | {1e3 * step:.2f} | {count:.0f} | {1e3 * unit:.3f} | {step / count / unit:.2f} "
            f"| {1e3 * times[0]:.2f} |",
            flush=True,
        )

    print("\n| the paper's robot, 13 disks | time [ms] |\n| --- | --- |")
    for name, model, steps in (
        ("2.5 N in one step, no friction", Model(friction="none", elements_per_bay=1), PULL[-1:]),
        ("2.5 N in one step, friction", Model(friction="per-hole", elements_per_bay=1), PULL[-1:]),
        ("up to 2.5 N in five steps and down in five, friction", Model(elements_per_bay=1), PULL + RELEASE),
        ("the same, two elements per bay", Model(elements_per_bay=2), PULL + RELEASE),
    ):
        spent = least_time(lambda model=model, steps=steps: simulate(robot(13), model, steps), 7)  # type: ignore[misc]
        print(f"| {name} | {1e3 * spent:.0f} |", flush=True)
    print_dynamics()
    print_sensitivities()
    print_accuracy()


if __name__ == "__main__":
    with threadpool_limits(1):  # threads cost more than they gain on matrices of this size
        main()

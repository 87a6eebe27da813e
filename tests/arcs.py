"""Synthetic results for tests of tables and pictures: every step is a circular arc."""

import numpy as np
from robots import BACKBONE, DISKS, tendon

from tdcr_fe import Robot, SequenceResult, StepResult
from tdcr_fe.model.loading import LoadStep, Model, resolve
from tdcr_fe.validation.reference.closed_forms import constant_strain


def paper_robot(tendons: int = 1) -> Robot:
    """The paper's single-segment robot; further tendons at equal angles about the backbone."""
    each = tuple(tendon(f"t{i + 1}", 360.0 * i / tendons) for i in range(tendons))
    return Robot(BACKBONE, DISKS, each, name="single-segment")


def arc_step(robot: Robot, number: int, angle: float, phi: float, tensions: np.ndarray, **rest) -> StepResult:
    """A backbone bent by ``angle`` [rad] towards ``phi`` [rad]; tension falls by a tenth at every hole."""
    length = robot.backbone.length
    s = np.linspace(0.0, length, 27)
    strain = np.array([-np.sin(phi) * angle / length, np.cos(phi) * angle / length, 0.0, 0.0, 0.0, 1.0])
    rotations, positions = map(np.array, zip(*(constant_strain(strain, x) for x in s), strict=True))
    profiles, states = [], []
    for each, tension in zip(robot.tendons, tensions, strict=True):
        n = len(robot.hole_arc_lengths(each)) - 1
        profiles.append(tension * 0.9 ** np.arange(n))
        states.append((*("pull" if i % 2 else "stick" for i in range(n - 1)), "anchor"))
    inputs = {"base_tensions": np.asarray(tensions, dtype=float)}
    inputs["displacements"] = np.full(len(robot.tendons), 4.5e-3 * angle)
    found = {"tensions": tuple(profiles), "hole_states": tuple(states), **inputs}
    given = {"label": "", "converged": True, "iterations": 4, "substeps": 1, "residual": 1e-11, **rest}
    return StepResult(step=number, s=s, positions=positions, rotations=rotations, **found, **given)


def arc_result(robot: Robot | None = None, steps=None, model: Model | None = None, **rest) -> SequenceResult:
    """Synthetic result with hysteresis: the angle follows a lagging tension; a tip load turns the plane of bending."""
    robot = robot or paper_robot()
    names = robot.tendon_names
    if steps is None:
        steps = [LoadStep(f"pull {t}", {names[0]: t}) for t in (0.5, 1.0, 1.5, 2.0, 2.5)]
        steps += [LoadStep(f"release {t}", {names[0]: t}) for t in (2.0, 1.5, 1.0, 0.5, 0.0)]
    solved, before, angle = [], 0.0, 0.0
    for number, (step, state) in enumerate(zip(steps, resolve(robot, steps), strict=True), start=1):
        total = float(state.values.sum())
        goal = 0.56 * total
        angle = max(goal, angle) if total >= before else min(angle, 0.1 + 0.6 * total + 0.1 * (total > 1))
        before = total
        force = sum((np.array(x.force) for x in state.loads.values()), np.zeros(3))
        phi = float(np.arctan2(10.0 * force[1], 1.0))
        solved.append(arc_step(robot, number, angle, phi, state.values, label=step.label, actuation=state))
    return SequenceResult(robot, model or Model(), tuple(solved), message="solved", wall_time=0.1, **rest)

"""Figures 3 to 6: every case with every model, the stability of each step, and the reference."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tdcr_fe.model.loading import Model, resolve
from tdcr_fe.model.results import StepResult
from tdcr_fe.solve.load_steps.load_path import StepFailed
from tdcr_fe.solve.simulate import Simulation
from tdcr_fe.solve.stability import Stability, stability
from tdcr_fe.validation.paper.cases import PaperCase
from tdcr_fe.validation.reference.sequence import solve_reference


@dataclass(frozen=True)
class ModelRun:
    """One case with one model.

    Attributes
    ----------
    steps : tuple of StepResult
    stabilities : tuple of Stability
        One a step.
    failure : str
        Empty where all steps converged.
    reference_gap : float
        Distance of the tip at the last step from that of the independent reference [m]; nan where it was not computed.
    """

    steps: tuple[StepResult, ...]
    stabilities: tuple[Stability, ...]
    failure: str
    reference_gap: float = float("nan")

    @property
    def snapped(self) -> tuple[str, ...]:
        """Labels of steps in which the robot jumped to another equilibrium."""
        return tuple(s.label for s in self.steps if s.details.get("snapped"))

    def at(self, label: str) -> StepResult:
        """The step of that label."""
        return next(s for s in self.steps if s.label == label)


@dataclass(frozen=True)
class CaseStudy:
    """A figure with every model."""

    case: PaperCase
    runs: dict[str, ModelRun]


def run_model(case: PaperCase, model: Model, reference: bool = False) -> ModelRun:
    """A case with one model, its stability at every step.

    Parameters
    ----------
    case, model
        What is solved.
    reference
        Whether the independent reference solves it as well.
    """
    targets = resolve(case.robot, case.steps)
    simulation = Simulation(case.robot, model, targets)
    steps, found, failure = [], [], ""
    for number, (step, target) in enumerate(zip(case.steps, targets, strict=True), start=1):
        try:
            report = simulation.advance(target, step.substeps)
        except StepFailed as problem:
            failure = f"step {number} ({step.label}): {problem}"
            break
        steps.append(simulation.result(number, step.label, report))
        found.append(stability(simulation))
    gap = float("nan")
    if reference and not failure:
        other = solve_reference(case.robot, model, case.steps)
        if other.converged:
            gap = float(np.linalg.norm(other.steps[-1].tip - steps[-1].tip))
    return ModelRun(tuple(steps), tuple(found), failure, gap)


def deformation(step: StepResult, length: float) -> float:
    """Distance of the tip from where it is unloaded [m]."""
    return float(np.linalg.norm(step.tip - [0.0, 0.0, length]))


def case_table(study: CaseStudy) -> list[dict[str, float | str]]:
    """Rows for people: every marked state with every model, in mm and degrees."""
    rows: list[dict[str, float | str]] = []
    length = study.case.robot.backbone.length
    for label in study.case.marked:
        base: StepResult | None = None
        for key, run in study.runs.items():
            k = next((i for i, s in enumerate(run.steps) if s.label == label), None)
            if k is None:
                continue
            step = run.steps[k]
            base = base or step
            rows.append(
                {
                    "label": label,
                    "model": key,
                    "x_mm": 1e3 * float(step.tip[0]),
                    "y_mm": 1e3 * float(step.tip[1]),
                    "z_mm": 1e3 * float(step.tip[2]),
                    "displacement_mm": 1e3 * deformation(step, length),
                    "offset_mm": 1e3 * step.tip_offset,
                    "bending_deg": float(np.rad2deg(step.bending_angle)),
                    "chord_deg": float(np.rad2deg(step.chord_angle)),
                    "end_tension_N": float(max(t[-1] for t in step.tensions)),
                    "from_classical_mm": 1e3 * float(np.linalg.norm(step.tip - base.tip)),
                    "from_classical_percent": 100.0 * float(np.linalg.norm(step.tip - base.tip)) / length,
                    "eigenvalue": run.stabilities[k].smallest,
                }
            )
    return rows

"""Figures 3 to 6: every case with every model, the stability of each step, and the distance from the reference."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from tdcr_fe.io.atomic import write_text
from tdcr_fe.model.loading import Model, resolve
from tdcr_fe.model.results import StepResult
from tdcr_fe.report.style import COLOURS, styled, svg
from tdcr_fe.solve.load_steps.load_path import StepFailed
from tdcr_fe.solve.simulate import Simulation
from tdcr_fe.solve.stability import Stability, stability
from tdcr_fe.validation.paper.cases import MODEL_NAMES, MODELS, PaperCase, paper_case
from tdcr_fe.validation.reference import solve_reference

Array = NDArray[np.float64]

#: Colour, line and width of every model.
_LOOKS: dict[str, dict[str, Any]] = {
    "classical": {"color": "#777777", "ls": (0, (1, 1)), "lw": 2.4},
    "discrete": {"color": COLOURS[0], "ls": "-", "lw": 1.3},
    "per-tendon": {"color": COLOURS[1], "ls": (0, (5, 1.5)), "lw": 1.8},
    "per-hole": {"color": COLOURS[2], "ls": "-", "lw": 1.0},
}


@dataclass(frozen=True)
class ModelRun:
    """One case with one model."""

    steps: tuple[StepResult, ...]
    stabilities: tuple[Stability, ...]  # by step
    failure: str  # empty where all steps converged


def run_model(case: PaperCase, model: Model) -> ModelRun:
    """A case with one model, and its stability at every step."""
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
    return ModelRun(tuple(steps), tuple(found), failure)


def deformation(step: StepResult, length: float) -> float:
    """Distance of the tip from where it is unloaded [m]."""
    return float(np.linalg.norm(step.tip - [0.0, 0.0, length]))


def study_figure(name: str, out: Path) -> dict[str, Any]:
    """A figure of the paper with all models: its marked states, its stability, and the picture ``NAME.svg``.

    Returns
    -------
    dict
        "states": a row for each marked state and model; "smallest": eigenvalue over all steps; "snapped" and "failed":
        models; "reference_gap": of the model without friction at the last step, over the length.
    """
    case = paper_case(name)
    runs = {key: run_model(case, model) for key, model in MODELS.items()}
    write_text(svg(draw_figure(case, runs)), out / f"{name}.svg")
    reference = solve_reference(case.robot, MODELS["discrete"], case.steps)
    gap = float(np.linalg.norm(reference.steps[-1].tip - runs["discrete"].steps[-1].tip))
    return {
        "title": case.title,
        "assumed": case.assumed,
        "states": state_rows(case, runs),
        "smallest": min(x.smallest for run in runs.values() for x in run.stabilities),
        "snapped": [key for key, run in runs.items() if any(s.details.get("snapped") for s in run.steps)],
        "failed": [key for key, run in runs.items() if run.failure],
        "reference_gap": gap / case.robot.backbone.length if reference.converged else None,
    }


def state_rows(case: PaperCase, runs: dict[str, ModelRun]) -> list[dict[str, Any]]:
    """Every marked state with every model, in mm and degrees."""
    rows = []
    loaded = False
    for k, step in enumerate(case.steps):
        loaded = loaded or any(any(load.force) for load in step.loads.values())
        for key, run in runs.items():
            if step.label in case.marked and len(run.steps) > k:
                solved = run.steps[k]
                x, y, z = (round(1e3 * float(c), 2) for c in solved.tip)
                rows.append(
                    {
                        "state": step.label,
                        "tendons alone": not loaded,
                        "model": key,
                        "tip x, y, z [mm]": f"{x:.2f}, {y:.2f}, {z:.2f}",
                        "tip displacement [mm]": 1e3 * deformation(solved, case.robot.backbone.length),
                        "bending angle [deg]": float(np.rad2deg(solved.bending_angle)),
                        "smallest eigenvalue": run.stabilities[k].smallest,
                    }
                )
    return rows


#: Takes points, shape (n, 3), to the coordinates of a view.
Projection = Callable[[Array], tuple[Array, Array]]


def draw_figure(case: PaperCase, runs: dict[str, ModelRun]) -> Figure:
    """Three views of every marked state with every model, and how the tip and its stability follow the load."""
    plane = int(np.argmax(np.abs(runs["classical"].steps[-1].tip[:2])))
    views: tuple[tuple[str, Projection, str, str], ...] = (
        ("isometric", lambda p: (0.866 * (p[:, 0] - p[:, 1]), p[:, 2] - 0.5 * (p[:, 0] + p[:, 1])), "", ""),
        ("top", lambda p: (p[:, 0], p[:, 1]), "x [mm]", "y [mm]"),
        ("side", lambda p: (p[:, plane], p[:, 2]), f"{'xy'[plane]} [mm]", "z [mm]"),
    )
    with styled():
        figure = Figure(figsize=(13.2, 3.5), layout="constrained")
        axes = figure.subplots(1, 4, width_ratios=(1, 1, 1, 1.25))
        for axis, (name, project, xlabel, ylabel) in zip(axes[:3], views, strict=True):
            _draw_shapes(axis, case, runs, project)
            axis.set(title=name, xlabel=xlabel, ylabel=ylabel)
        axes[0].set(xticklabels=[], yticklabels=[])
        _draw_sequence(axes[3], case, runs)
        figure.legend(*axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=4)
    return figure


def _draw_shapes(axis: Any, case: PaperCase, runs: dict[str, ModelRun], project: Projection) -> None:
    """Every marked state with every model in one view, later states darker."""
    last = len(case.marked) - 1
    for key, run in runs.items():
        for step in run.steps:
            if step.label in case.marked:
                k = case.marked.index(step.label)
                points = 1e3 * step.position_at(np.linspace(0.0, step.s[-1], 61))
                label = MODEL_NAMES[key] if k == last else None
                axis.plot(*project(points), alpha=0.45 + 0.55 * k / max(last, 1), label=label, **_LOOKS[key])
    axis.plot(*project(np.zeros((1, 3))), "ks", ms=4)
    axis.set_aspect("equal", adjustable="datalim")


def _draw_sequence(axis: Any, case: PaperCase, runs: dict[str, ModelRun]) -> None:
    """Tip displacement and smallest eigenvalue along the loading sequence."""
    second = axis.twinx()
    second.grid(False)
    for key, run in runs.items():
        x = np.arange(1, len(run.steps) + 1)
        axis.plot(x, [1e3 * deformation(s, case.robot.backbone.length) for s in run.steps], **_LOOKS[key])
        thin = {**_LOOKS[key], "lw": 0.8, "alpha": 0.7, "marker": ".", "ms": 3}
        second.plot(x, [s.smallest for s in run.stabilities], **thin)
    ticks = [s.label.replace(" at the tip", "").replace("pull ", "T ") for s in case.steps]
    axis.set_xticks(range(1, len(ticks) + 1), ticks, rotation=90, fontsize=6.5)
    axis.set(title="along the loading sequence", ylabel="tip displacement [mm]")
    axis.set_ylim(bottom=0.0)
    second.set(ylim=(0.0, 1.05), ylabel="smallest eigenvalue (dots)")

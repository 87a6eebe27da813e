"""Search for critical loads in the helical case: a load is raised in small steps, a loss of stability is bisected."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from matplotlib import colormaps
from matplotlib.figure import Figure
from numpy.typing import NDArray

from tdcr_fe.io.atomic import write_text
from tdcr_fe.model.loading import Load, LoadStep, Model, resolve
from tdcr_fe.model.robot import Robot
from tdcr_fe.report.style import styled, svg
from tdcr_fe.solve.load_steps.load_path import StepFailed
from tdcr_fe.solve.simulate import Simulation
from tdcr_fe.solve.stability import Stability, stability
from tdcr_fe.validation.paper.cases import MODELS, paper_case, prototype
from tdcr_fe.validation.paper.tables import fit_table

Array = NDArray[np.float64]

#: Loads of the search [N]; up to twice the paper's own.
LOADS = (0.01, 0.02, 0.04, 0.06, 0.08, 0.1, 0.15, 0.2, 0.3, 0.4, 0.6, 0.8, 1.2, 1.6)
#: Tensions of the search [N]; the simulation has 1.2 N, the prototype 5 to 30 N.
TENSIONS = (1.2, 5.0, 10.0, 20.0, 30.0)
#: Directions of the load.
DIRECTIONS = {"+x": (1, 0, 0), "+y": (0, 1, 0), "-x": (-1, 0, 0), "-y": (0, -1, 0), "-z": (0, 0, -1)}
ACROSS = ("+x", "+y", "-x", "-y")
#: Relative accuracy of a critical load [1].
TOLERANCE = 1e-4


@dataclass(frozen=True)
class CriticalSearch:
    """Result of raising a load at the tip."""

    loads: list[float]  # sizes that were solved [N], the first one zero
    eigenvalues: list[float]  # smallest at each, see `tdcr_fe.solve.stability` [1]
    critical: float | None  # where the smallest real part becomes zero, or no equilibrium follows [N]
    how: str  # "none", "eigenvalue", "snap" (the robot jumped) or "stop" (no equilibrium was found)
    rate: float  # largest tip displacement per load [m/N]
    rate_at: float  # load in the middle of that increment [N]


class _Path(NamedTuple):
    """Equilibria along a ramp of the load."""

    stabilities: list[Stability]  # at every size solved, the unloaded state first
    tips: list[Array]  # [m]
    how: str  # why it ended, as in `CriticalSearch`


def search_critical_load(
    robot: Robot,
    model: Model,
    before: Sequence[LoadStep],
    direction: Sequence[float],
    loads: Sequence[float] = LOADS,
) -> CriticalSearch:
    """Raise a load at the tip until the robot loses its stability, or until the largest load.

    Parameters
    ----------
    robot, model
        Description. The criterion is the sign of the smallest real part of the tangent's eigenvalues, see
        `tdcr_fe.solve.stability`.
    before
        Steps that come first (the tendons); the last of them is the state without load. Without any, the unloaded robot
        is solved.
    direction
        Of the load in the world, shape (3,); its length does not matter.
    loads
        Sizes, ascending [N].
    """
    unit = np.asarray(direction, dtype=float) / np.linalg.norm(direction)
    sizes = [0.0, *loads]
    path = _follow(robot, model, before, unit, sizes)
    critical = None
    if path.how != "none":
        good = len(path.stabilities) - (path.how == "eigenvalue")
        low, high = sizes[max(good - 1, 0)], sizes[min(good, len(sizes) - 1)]
        stable = sizes[: max(good, 1)]
        while high - low > TOLERANCE * max(high, 1e-6):
            middle = 0.5 * (low + high)
            if _follow(robot, model, before, unit, [*stable, middle]).how == "none":
                low = middle
                stable.append(middle)
            else:
                high = middle
        critical = 0.5 * (low + high)
    solved = sizes[: len(path.stabilities)]
    rates = np.linalg.norm(np.diff(path.tips, axis=0), axis=1) / np.diff(solved) if len(solved) > 1 else [0.0]
    k = int(np.argmax(rates))
    at = 0.5 * (solved[k] + solved[min(k + 1, len(solved) - 1)]) if solved else 0.0
    return CriticalSearch(
        solved, [x.smallest for x in path.stabilities], critical, path.how, float(rates[k]), at
    )


def _follow(
    robot: Robot, model: Model, before: Sequence[LoadStep], unit: Array, sizes: Sequence[float]
) -> _Path:
    """Follow the equilibrium over sizes of the load [N], of which the first is zero, until stability is lost."""
    forces = [tuple((f * unit).tolist()) for f in (sizes[1:] if before else sizes)]
    tip = robot.backbone.length
    steps = [*before, *(LoadStep("load", loads={"tip": Load(tip, f)}) for f in forces)]
    targets = resolve(robot, steps)
    simulation = Simulation(robot, model, targets)
    found: list[Stability] = []
    tips: list[Array] = []
    for number, target in enumerate(targets, start=1):
        try:
            report = simulation.advance(target)
        except StepFailed:
            return _Path(found, tips, "stop")
        if number < len(before):
            continue
        if report.snapped and number > len(before):
            return _Path(found, tips, "snap")
        found.append(stability(simulation))
        tips.append(simulation.state.configuration.positions[-1].copy())
        if found[-1].divergence <= 0.0:
            return _Path(found, tips, "eigenvalue")
    return _Path(found, tips, "none")


def euler_load(robot: Robot) -> float:
    """Critical load of the backbone as a column clamped at the base, ``pi^2 EI / (4 L^2)`` [N]."""
    return float(np.pi**2 * robot.backbone.EI / (4.0 * robot.backbone.length**2))


def search_column() -> CriticalSearch:
    """Euler's column, the robot of Fig. 5 with its tendon slack: the search must find its critical load."""
    robot = paper_case("fig5").robot
    slack = LoadStep("slack", {robot.tendon_names[0]: 0.0})
    return search_critical_load(robot, MODELS["discrete"], [slack], (0, 0, -1), (0.02, 0.04, 0.06, 0.08))


def study_critical(out: Path) -> dict[str, Any]:
    """All searches, and the picture ``critical.svg``.

    Returns
    -------
    dict
        "searches": a row each, with "robot", "model", "tension", "direction" and the fields of `CriticalSearch`;
        "column" and "euler": critical load of a column, found and by Euler's formula [N].
    """
    robot = paper_case("fig5").robot
    asked = [(robot, "simulation", "discrete", t, d) for t in TENSIONS for d in DIRECTIONS]
    asked += [(robot, "simulation", "per-hole", t, d) for t in TENSIONS for d in ACROSS]
    prototypes = {"prototype as declared": prototype(3), "prototype as stiff as Table 3": fit_table(3).robot}
    asked += [
        (r, name, "per-hole", t, d) for name, r in prototypes.items() for t in TENSIONS[1:] for d in ACROSS
    ]
    rows = []
    for which, name, model, tension, direction in asked:
        pull = LoadStep("pull", {which.tendon_names[0]: tension})
        found = search_critical_load(which, MODELS[model], [pull], DIRECTIONS[direction])
        rows.append(
            {"robot": name, "model": model, "tension": tension, "direction": direction, **vars(found)}
        )
    write_text(svg(draw_searches(rows)), out / "critical.svg")
    return {"searches": rows, "column": search_column().critical, "euler": euler_load(robot)}


def draw_searches(rows: list[dict[str, Any]]) -> Figure:
    """Smallest eigenvalue against load for the robot of the simulation, for every direction and tension."""
    with styled():
        figure = Figure(figsize=(13.2, 2.9), layout="constrained")
        axes = dict(zip(DIRECTIONS, figure.subplots(1, len(DIRECTIONS), sharey=True), strict=True))
        colors = dict(zip(TENSIONS, colormaps["viridis"](np.linspace(0.0, 0.85, len(TENSIONS))), strict=True))
        for row in (r for r in rows if r["robot"] == "simulation"):
            plain = row["model"] == "discrete"
            look = {"color": colors[row["tension"]], "ls": "-" if plain else ":", "lw": 1.4}
            label = f"{row['tension']:g} N" if plain else None
            axes[row["direction"]].plot(row["loads"], row["eigenvalues"], label=label, **look)
        for direction, axis in axes.items():
            axis.axhline(0.0, color="#cc0000", lw=1.0)
            axis.set(title=f"load along {direction}", xlabel="load [N]")
        axes["+x"].set(ylabel="smallest eigenvalue", ylim=(-0.05, 1.05))
        handles = axes["+x"].get_legend_handles_labels()
        title = "tension of the helical tendon (dotted: with friction per hole)"
        figure.legend(*handles, loc="outside lower center", ncols=len(TENSIONS), title=title)
    return figure

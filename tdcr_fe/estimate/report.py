"""Files of an estimation: `estimates.csv`, `shape.csv` and the page `report.html`."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from scipy.stats import chi2

from tdcr_fe.elements import Array
from tdcr_fe.estimate.description import Estimate
from tdcr_fe.estimate.frame import name_at
from tdcr_fe.estimate.run import EstimateResult
from tdcr_fe.io.files import write_folder, write_text
from tdcr_fe.io.result_files import versions
from tdcr_fe.model.columns import shape_frame
from tdcr_fe.model.messages import count
from tdcr_fe.model.results import SequenceResult
from tdcr_fe.report import page as kit
from tdcr_fe.report import viewer
from tdcr_fe.report.environment import quantity
from tdcr_fe.report.motion import motion_of
from tdcr_fe.report.page import Card, Page, Picture, Section
from tdcr_fe.report.style import COLOURS, styled

ESTIMATES, SMOOTHED, SHAPE, REPORT = "estimates.csv", "smoothed.csv", "shape.csv", "report.html"
#: Half the width of an interval that holds 95 % of a Gaussian, in standard deviations.
HALF_95 = 1.96
#: The same of an ellipsoid.
RADIUS_95 = math.sqrt(chi2.ppf(0.95, 3))
_BAND = "The bands are 95 % intervals."


def estimates_frame(result: EstimateResult) -> pd.DataFrame:
    """One row per step, with the columns of `estimates.csv`."""
    steps = zip(result.estimation.data.step_ids, result.frames, strict=False)
    return pd.DataFrame([_row(step, frame, result) for step, frame in steps])


def _row(step: int, frame: Estimate, result: EstimateResult) -> dict[str, Any]:
    given, tendons = result.estimation, result.estimation.data.robot.tendon_names
    found = {"step": step, "time": frame.time, "at": frame.at} | _by_axis("force", frame.force)
    for i, j in zip(*np.triu_indices(3), strict=True):
        found[f"cov_{'xyz'[i]}{'xyz'[j]}"] = frame.force_covariance[i, j]
    for name, tension, sigma in zip(tendons, frame.tensions, frame.sigma_tensions, strict=True):
        found |= {f"tension_{name}": tension, f"sigma_tension_{name}": sigma}
    found |= _by_axis("tip", frame.tip) | _by_axis("sigma_tip", frame.sigma_tip)
    found["milliseconds"] = frame.milliseconds
    if given.load.sigma_moment > 0.0:
        sigmas = np.sqrt(np.diagonal(frame.moment_covariance))
        found |= _by_axis("moment", frame.moment) | _by_axis("sigma_moment", sigmas)
    if given.load.at == "unknown":
        found["sigma_at"] = frame.sigma_at
    numbers = given.uncertain.names, frame.parameters, frame.sigma_parameters
    for name, value, sigma in zip(*numbers, strict=True):
        found |= {name: value, f"sigma_{name}": sigma}
    return found | ({"message": frame.message} if result.failed else {})


def _by_axis(name: str, values: Array) -> dict[str, float]:
    return {f"{name}_{axis}": x for axis, x in zip("xyz", values, strict=True)}


def sequence(result: EstimateResult) -> SequenceResult:
    """The most probable states as the result of a simulation, for tables and drawings."""
    data = result.estimation.data
    return SequenceResult(data.robot, data.model, tuple(frame.result for frame in result.frames))


def write_estimates(result: EstimateResult, out: str | os.PathLike[str]) -> list[Path]:
    """Write the files of an estimation into a directory.

    Parameters
    ----------
    result
        With at least one frame.
    out
        Made where it does not exist.

    Returns
    -------
    list of pathlib.Path
        What was written.
    """

    def write(folder: Path) -> None:
        estimates_frame(result).to_csv(folder / ESTIMATES, index=False)
        smooth = estimates_frame(replace(result, frames=result.smoothed)).drop(columns="milliseconds")
        smooth.to_csv(folder / SMOOTHED, index=False)
        shape_frame(sequence(result)).to_csv(folder / SHAPE, index=False)
        write_text(kit.render(_page(result), "tdcr_fe.estimate"), folder / REPORT)

    return write_folder(out, write, (ESTIMATES, SMOOTHED, SHAPE, REPORT))


def _ellipsoid(frame: Estimate) -> dict[str, Array]:
    """Semi-axes of the 95 % ellipsoid of the force, by name of the load [N]; empty where its place is not known."""
    variances, directions = np.linalg.eigh(frame.force_covariance)
    axes = RADIUS_95 * np.sqrt(np.maximum(variances, 0.0))[:, None] * directions.T
    return {} if frame.sigma_at > 0.0 else {name_at(frame.at): axes}


def _page(result: EstimateResult) -> Page:
    given, table = result.estimation, estimates_frame(result)
    for axis in "xyz":
        table[f"sigma_force_{axis}"] = np.sqrt(table[f"cov_{axis}{axis}"])
    drawn = {"Force over time": _bands(table, {a: f"force_{a}" for a in "xyz"}, "force [N]")}
    if given.load.sigma_moment > 0.0:
        drawn["Moment over time"] = _bands(table, {a: f"moment_{a}" for a in "xyz"}, "moment [N m]")
    if unknown := given.load.at == "unknown":
        drawn["Place over time"] = _bands(table, {"place of the force": "at"}, "arc length [m]")
    if numbers := given.uncertain.names:
        title = "Numbers of effects over time"
        drawn[title] = _bands(table, dict(zip(numbers, numbers, strict=True)), "", shared=False)
    if names := given.data.robot.tendon_names:
        drawn["Tensions"] = _bands(table, {n: f"tension_{n}" for n in names}, "tension [N]")
    size = np.linalg.norm(table.filter(regex="^force_"), axis=1)
    most = int(np.argmax(size))
    where = "at an unknown place" if unknown else f"at {quantity(table['at'][0], 'm')}"
    ellipsoids = tuple(map(_ellipsoid, result.frames))
    panel = viewer.panel(replace(motion_of(sequence(result)), ellipsoids=ellipsoids))
    force, tensions = (table.filter(regex=f"^sigma_{name}_").to_numpy() for name in ("force", "tension"))
    sizes = np.linalg.norm(force, axis=1), tensions, 1e-3 * table["milliseconds"]
    typical = [float(np.median(x)) if x.size else 0.0 for x in sizes]
    return Page(
        title=f"Estimated states of {given.data.robot.name}",
        verdict=f"The largest estimated force {where} is {quantity(size[most], 'N')}, at {table['time'][most]:.4g} s.",
        level="open" if result.interrupted else "part" if result.failed or result.contradiction else "good",
        sentences=tuple(_sentences(result)),
        cards=(
            Card(str(len(table)), "frames"),
            Card(quantity(typical[0], "N"), "standard deviation of the force, median"),
            Card(quantity(typical[1], "N"), "standard deviation of a tension, median"),
            Card(quantity(typical[2], "s"), "per frame, median"),
        ),
        pictures=tuple(Picture(figure, text, _BAND) for text, figure in drawn.items()),
        sections=(Section("motion", "The robot in 3D", "motion.html.j2", {"panel": panel}, folded=False),),
        notes=(
            f"In the same folder: {ESTIMATES}, a row per step; {SMOOTHED}, the same given also the readings of later "
            f"steps; and {SHAPE}, the shape of the backbone in each.",
            "Versions: " + ", ".join(f"{name} {version}" for name, version in versions().items()) + ".",
        ),
        has_panel=True,
    )


def _sentences(result: EstimateResult) -> list[str]:
    """How many frames had readings, and what was not solved."""
    data = result.estimation.data
    read = len({r.step for r in data.readings})
    found = [f"{count(len(data.readings), 'reading')} in {read} of {count(len(data.steps), 'frame')}."]
    if text := result.contradiction:
        found.append(f"{text[0].upper()}{text[1:]}.")
    if result.failure:
        found.append(f"{result.failure}. They have the state without their readings.")
    if result.interrupted:
        found.append(f"Interrupted after {count(len(result.frames), 'frame')}.")
    return found


def _bands(table: pd.DataFrame, columns: Mapping[str, str], label: str, shared: bool = True) -> Figure:
    """Columns over time with their 95 % intervals, a panel each with its title; ``shared``: all have one scale."""
    with styled():
        figure = Figure(figsize=(3.9 * len(columns), 2.6), layout="constrained")
        axes = figure.subplots(1, len(columns), sharey=shared, squeeze=False)[0]
        for k, (ax, (title, name)) in enumerate(zip(axes, columns.items(), strict=True)):
            half, colour = HALF_95 * table[f"sigma_{name}"], COLOURS[k % len(COLOURS)]
            value = table[name].where(np.isfinite(half))  # a stiffness may be infinite
            ax.fill_between(table["time"], value - half, value + half, color=colour, alpha=0.25, lw=0)
            ax.plot(table["time"], value, color=colour, lw=1.2)
            ax.set_title(title)
            ax.set_xlabel("time [s]")
        axes[0].set_ylabel(label)
    return figure

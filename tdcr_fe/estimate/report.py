"""Files of an estimation: `estimates.csv`, `shape.csv` and the page `report.html`."""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

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
    data = result.estimation.data
    rows = [_row(n, f, data.robot.tendon_names) for n, f in zip(data.step_ids, result.frames, strict=False)]
    if result.estimation.load.sigma_moment > 0.0:
        rows = [row | _moment(frame) for row, frame in zip(rows, result.frames, strict=True)]
    found = pd.DataFrame(rows)
    if result.estimation.load.at == "unknown":
        found["sigma_at"] = [frame.sigma_at for frame in result.frames]
    for k, name in enumerate(result.estimation.uncertain.names):
        found[name] = [frame.parameters[k] for frame in result.frames]
        found[f"sigma_{name}"] = [frame.sigma_parameters[k] for frame in result.frames]
    if result.failed:
        found["message"] = [frame.message for frame in result.frames]
    return found


def _row(step: int, frame: Estimate, tendons: Sequence[str]) -> dict[str, float]:
    found = {"step": step, "time": frame.time, "at": frame.at} | _by_axis("force", frame.force)
    for i, j in zip(*np.triu_indices(3), strict=True):
        found[f"cov_{'xyz'[i]}{'xyz'[j]}"] = float(frame.force_covariance[i, j])
    for tendon, tension, sigma in zip(tendons, frame.tensions, frame.sigma_tensions, strict=True):
        found |= {f"tension_{tendon}": float(tension), f"sigma_tension_{tendon}": float(sigma)}
    found |= _by_axis("tip", frame.tip) | _by_axis("sigma_tip", frame.sigma_tip)
    return {**found, "milliseconds": frame.milliseconds}


def _by_axis(name: str, values: Array) -> dict[str, float]:
    return {f"{name}_{axis}": float(x) for axis, x in zip("xyz", values, strict=True)}


def _moment(frame: Estimate) -> dict[str, float]:
    """The estimated moment and its standard deviations [N m]."""
    sigmas = np.sqrt(np.diagonal(frame.moment_covariance))
    return _by_axis("moment", frame.moment) | _by_axis("sigma_moment", sigmas)


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
    frames, names = result.frames, result.estimation.data.robot.tendon_names
    force, tensions = np.array([f.force for f in frames]), np.array([f.tensions for f in frames])
    sigma = np.sqrt(np.array([np.diagonal(f.force_covariance) for f in frames]))
    sigma_tensions = np.array([f.sigma_tensions for f in frames])
    at = np.array([[f.at, f.sigma_at] for f in frames])
    pictures = [Picture(_bands(frames, force, sigma, "xyz", "force [N]"), "Force over time", _BAND)]
    if result.estimation.load.sigma_moment > 0.0:
        moment = pd.DataFrame([_moment(f) for f in frames]).to_numpy()
        drawn = _bands(frames, moment[:, :3], moment[:, 3:], "xyz", "moment [N m]")
        pictures.append(Picture(drawn, "Moment over time", _BAND))
    if unknown := result.estimation.load.at == "unknown":
        place = _bands(frames, at[:, :1], at[:, 1:], ["place of the force"], "arc length [m]")
        pictures.append(Picture(place, "Place over time", _BAND))
    if numbers := result.estimation.uncertain.names:
        values = np.array([f.parameters for f in frames])
        sigmas = np.array([f.sigma_parameters for f in frames])
        drawn = _bands(frames, values, sigmas, numbers, "", shared=False)
        pictures.append(Picture(drawn, "Numbers of effects over time", _BAND))
    of_tensions = Picture(_bands(frames, tensions, sigma_tensions, names, "tension [N]"), "Tensions", _BAND)
    size = np.linalg.norm(force, axis=1)
    most = int(np.argmax(size))
    where = "at an unknown place" if unknown else f"at {quantity(frames[0].at, 'm')}"
    panel = viewer.panel(replace(motion_of(sequence(result)), ellipsoids=tuple(map(_ellipsoid, frames))))
    sizes = np.linalg.norm(sigma, axis=1), sigma_tensions, 1e-3 * np.array([f.milliseconds for f in frames])
    typical = [float(np.median(x)) if x.size else 0.0 for x in sizes]
    return Page(
        title=f"Estimated states of {result.estimation.data.robot.name}",
        verdict=f"The largest estimated force {where} is {quantity(size[most], 'N')}, at {frames[most].time:.4g} s.",
        level="open" if result.interrupted else "part" if result.failed or result.contradiction else "good",
        sentences=tuple(_sentences(result)),
        cards=(
            Card(str(len(frames)), "frames"),
            Card(quantity(typical[0], "N"), "standard deviation of the force, median"),
            Card(quantity(typical[1], "N"), "standard deviation of a tension, median"),
            Card(quantity(typical[2], "s"), "per frame, median"),
        ),
        pictures=tuple(pictures),
        sections=(
            Section("tensions", "Tensions", "picture.html.j2", {"picture": of_tensions}, folded=False),
            Section("motion", "The robot in 3D", "motion.html.j2", {"panel": panel}, folded=False),
        ),
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
        found.append(f"{result.failure}. They have the state of the frame before.")
    if result.interrupted:
        found.append(f"Interrupted after {count(len(result.frames), 'frame')}.")
    return found


def _bands(
    frames: Sequence[Estimate],
    values: Array,
    sigmas: Array,
    names: Sequence[str],
    label: str,
    shared: bool = True,
) -> Figure:
    """Values over time with their 95 % intervals, a panel each; ``shared``: all have one unit and one scale."""
    times = [f.time for f in frames]
    with styled():
        figure = Figure(figsize=(3.9 * max(1, len(names)), 2.6), layout="constrained")
        axes = figure.subplots(1, max(1, len(names)), sharey=shared, squeeze=False)[0]
        for k, (ax, name) in enumerate(zip(axes, names, strict=False)):
            value, half, colour = values[:, k], HALF_95 * sigmas[:, k], COLOURS[k % len(COLOURS)]
            value = np.where(np.isfinite(half), value, np.nan)  # a stiffness may be infinite
            ax.fill_between(times, value - half, value + half, color=colour, alpha=0.25, lw=0)
            ax.plot(times, value, color=colour, lw=1.2)
            ax.set_title(name)
            ax.set_xlabel("time [s]")
        axes[0].set_ylabel(label)
    return figure

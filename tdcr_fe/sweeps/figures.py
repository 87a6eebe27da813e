"""Pictures of a sweep: workspace cloud, Sobol indices, histograms, main effects."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.ticker import EngFormatter, MaxNLocator
from numpy.typing import ArrayLike, NDArray

from tdcr_fe.report.style import COLOURS, INK, PALE, styled
from tdcr_fe.sweeps.result import SweepResult, shown
from tdcr_fe.sweeps.statistics import varies

Array = NDArray[np.float64]

#: Most inputs in one picture.
MOST_INPUTS = 6
#: Inputs with more values than the first are divided into as many bins as the second.
MOST_LEVELS, BINS = 15, 12
#: More points than this are drawn as pixels in vector graphics.
VECTOR_POINTS = 500
_WIDTH = 11.6


def tip_columns(result: SweepResult) -> list[str]:
    """Columns of the tip, of the last step that has them; empty where fewer than two coordinates vary."""
    for name in reversed(result.outputs):
        if name.startswith("tip_z"):
            names = [name.replace("_z", f"_{axis}", 1) for axis in "xyz"]
            if set(names) <= set(result.outputs):
                return names if sum(varies(result.column(n)) for n in names) > 1 else []
    return []


def tips(result: SweepResult) -> Array:
    """Tips of the cases that have them, in mm, shape (n, 3)."""
    return 1e3 * result.cases[tip_columns(result)].dropna().to_numpy(dtype=float)


def workspace(result: SweepResult) -> Figure | None:
    """Tip positions of all cases from two sides and from above, coloured by the sum of the tensions."""
    if not tip_columns(result):
        return None
    points = tips(result)
    values, label = _colouring(result)
    colour = values[result.cases[tip_columns(result)].notna().all(axis=1)]
    # The same scale in all three; the base is in the side views.
    reach = 1.08 * float(np.abs(points[:, :2]).max())
    margin = 0.08 * reach
    low, high = min(0.0, float(points[:, 2].min())), max(0.0, float(points[:, 2].max()))
    order = np.argsort(-colour, kind="stable")  # the cases with the smallest colour are drawn last
    views = ((0, 2, "From the side"), (1, 2, "From the front"), (0, 1, "From above"))
    figure = Figure(figsize=(_WIDTH, 4.1), layout="constrained")
    axes = figure.subplots(1, 3)
    look: dict[str, Any] = {
        "s": 9.0 if len(order) < 2000 else 4.0,
        "lw": 0.0,
        "rasterized": len(order) > VECTOR_POINTS,
    }
    for ax, (i, j, title) in zip(axes, views, strict=True):
        drawn = ax.scatter(points[order, i], points[order, j], c=colour[order], cmap="viridis", **look)
        ax.plot(0.0, 0.0, marker="s" if j == 2 else "+", ms=6, mew=1.6, color=INK, zorder=3)
        ax.set(title=title, xlabel=f"tip {'xyz'[i]} [mm]", ylabel=f"tip {'xyz'[j]} [mm]", aspect="equal")
        ax.set_xlim(-reach, reach)
        ax.set_ylim(*((low - margin, high + margin) if j == 2 else (-reach, reach)))
        ax.xaxis.set_major_locator(MaxNLocator(6))
        ax.yaxis.set_major_locator(MaxNLocator(6))
    if label:
        bar = figure.colorbar(drawn, ax=axes, shrink=0.85, pad=0.01, label=label)
        _with_prefixes(bar.ax.yaxis, colour)
        bar.outline.set_visible(False)
    return figure


def _colouring(result: SweepResult) -> tuple[Array, str]:
    """Numbers that colour the points of the workspace, and their label."""
    pulls = [n for n in result.inputs if n.startswith("pull_")] if result.sweep.workspace else []
    if pulls:
        return result.cases[pulls].to_numpy(dtype=float).sum(axis=1), "sum of the tensions [N]"
    for name, label in result.inputs.items():
        if result.cases[name].dtype.kind in "fi" and varies(result.column(name)):
            return result.column(name), label
    return np.zeros(len(result.cases)), ""


def sobol(result: SweepResult) -> Figure | None:
    """First and total Sobol indices of the results, with their 95 % intervals."""
    indices = result.sobol_indices()
    names = [n for n in result.drawn if n in indices]
    if not names:
        return None
    place = np.arange(len(result.inputs))
    figure = Figure(figsize=(_WIDTH, 1.0 + 0.42 * len(place)), layout="constrained")
    axes = figure.subplots(1, len(names), squeeze=False, sharey=True)[0]
    for ax, name in zip(axes, names, strict=True):
        found = indices[name]
        for value, interval, shift, colour, label in (
            (found.first, found.first_interval, -0.19, COLOURS[0], "first order: by itself"),
            (found.total, found.total_interval, 0.19, COLOURS[1], "total order: with interactions"),
        ):
            ax.barh(place + shift, value, height=0.36, color=colour, label=label)
            reach = np.abs(interval.T - value)
            ax.errorbar(value, place + shift, xerr=reach, fmt="none", ecolor=INK, elinewidth=0.9)
        ax.set(title=shown(name).label, xlabel="Sobol index")
        ax.set_xlim(min(0.0, ax.get_xlim()[0]), max(1.0, ax.get_xlim()[1]))
        ax.grid(axis="y", visible=False)
    axes[0].set_yticks(place, labels=result.inputs)
    axes[0].invert_yaxis()
    figure.legend(*axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=2)
    return figure


def distributions(result: SweepResult) -> Figure | None:
    """Histograms of the results of a sample, with mean, median and the interval of 95 % of the cases."""
    if not result.sweep.sampling.is_sample or not result.drawn:
        return None
    figure = Figure(figsize=(_WIDTH, 2.9), layout="constrained")
    axes = figure.subplots(1, len(result.drawn), squeeze=False)[0]
    for ax, name in zip(axes, result.drawn, strict=True):
        how, found = shown(name), result.statistics()[name]
        values = how.factor * result.column(name)
        low, median, high = (how.factor * x for x in found.quantiles)
        ax.axvspan(low, high, color=COLOURS[5], alpha=0.18, lw=0)
        count = int(np.clip(np.sqrt(found.count), 8, 40))
        ax.hist(values[np.isfinite(values)], bins=count, color=COLOURS[0], alpha=0.85)
        ax.axvline(how.factor * found.mean, color=INK, lw=1.4)
        ax.axvline(median, color=INK, lw=1.2, ls=(0, (2, 2)))
        ax.set_xlabel(how.axis)
        ax.xaxis.set_major_locator(MaxNLocator(5))
        ax.grid(axis="x", visible=False)
    axes[0].set_ylabel("cases")
    return figure


def main_effects(result: SweepResult) -> Figure | None:
    """Mean of each result over each input, all other inputs averaged; bars are standard errors of the mean."""
    inputs = list(result.inputs.items())[:MOST_INPUTS]
    if not result.drawn:
        return None
    size = (max(4.6, min(_WIDTH, 0.6 + 2.9 * len(inputs))), 0.5 + 2.0 * len(result.drawn))
    figure = Figure(figsize=size, layout="constrained")
    axes = figure.subplots(len(result.drawn), len(inputs), squeeze=False, sharey="row")
    for row, name in zip(axes, result.drawn, strict=True):
        how = shown(name)
        for ax, (given, _) in zip(row, inputs, strict=True):
            _main_effect(ax, result.cases[given], how.factor * result.cases[name])
        row[0].set_ylabel(how.axis)
        row[0].yaxis.set_major_locator(MaxNLocator(5))
    for ax, (_, label) in zip(axes[-1], inputs, strict=True):
        ax.set_xlabel(label.replace(".", ".\n") if len(label) > 26 else label)
    return figure


def _main_effect(ax: Axes, given: pd.Series, values: pd.Series) -> None:
    numeric = given.dtype.kind in "fi"
    groups = given
    if numeric and given.nunique() > MOST_LEVELS:  # bins of as many cases each
        groups = pd.qcut(given.rank(method="first"), min(BINS, max(2, len(given) // 10)), labels=False)
    found = values.groupby(groups, sort=numeric).agg(["mean", "sem"])
    place = given.groupby(groups).mean().to_numpy() if numeric else np.arange(len(found))
    look: dict[str, Any] = {"color": COLOURS[0], "ecolor": PALE, "marker": "o", "ms": 3.5, "elinewidth": 1.2}
    ax.errorbar(place, found["mean"], yerr=found["sem"], lw=1.4 if numeric else 0.0, **look)
    if numeric:
        ax.xaxis.set_major_locator(MaxNLocator(4))
        _with_prefixes(ax.xaxis, place)
    else:
        ax.set_xticks(place, labels=[str(x) for x in found.index])
        ax.set_xlim(-0.6, len(found) - 0.4)


def _with_prefixes(axis: Axis, values: ArrayLike) -> None:
    """Numbers as 60 G or 50 µ where they are large or small, in place of a power of ten beside the axis."""
    largest = float(np.nanmax(np.abs(values), initial=0.0))
    if largest >= 1e5 or 0.0 < largest < 1e-3:
        axis.set_major_formatter(EngFormatter())


class Picture(NamedTuple):
    """A picture that a sweep may have."""

    draw: Callable[[SweepResult], Figure | None]  # None where the sweep has no data for it
    title: str
    caption: str


#: Every picture, by its file.
PICTURES = {
    "workspace.png": Picture(
        workspace,
        "Workspace",
        "Tip of every case that converged. Side views share z, the direction of the undeformed backbone.",
    ),
    "sobol_indices.png": Picture(
        sobol,
        "Sobol indices",
        "Share of the variance of a result that an input explains by itself (first order), and with all its "
        "interactions (total order). Lines are 95 % intervals from a bootstrap over the base samples.",
    ),
    "distributions.png": Picture(
        distributions,
        "Distributions of the results",
        "Cases by value. Solid line: mean; dashed line: median; shaded: the middle 95 % of the cases.",
    ),
    "main_effects.png": Picture(
        main_effects,
        "Main effects",
        "Mean of a result over one input, averaged over all others; inputs with many values are divided into bins "
        "with equally many cases. Bars: standard error of the mean.",
    ),
}


def drawn(result: SweepResult) -> dict[str, Figure]:
    """The pictures for which a sweep has data, by their files; the one that suits best comes first."""
    # The cloud of tips is one result among others, unless it was asked for.
    order = sorted(PICTURES, key=lambda n: (n == "workspace.png") != result.sweep.workspace)
    if not result.counts.get("converged", 0):
        return {}
    with styled():
        figures = {name: PICTURES[name].draw(result) for name in order}
    return {name: figure for name, figure in figures.items() if figure is not None}

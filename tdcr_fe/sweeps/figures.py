"""Pictures of a sweep: workspace cloud, Sobol indices, histograms, main effects."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.ticker import EngFormatter, MaxNLocator
from numpy.typing import ArrayLike

from tdcr_fe.report.page import Picture
from tdcr_fe.report.style import COLOURS, HEAT, INK, PALE, styled
from tdcr_fe.sweeps.result import SweepResult, display, varies

#: Most inputs in one picture.
MOST_INPUTS = 6
#: Inputs with more values than the first are divided into as many bins as the second.
MOST_LEVELS, BINS = 15, 12
#: More points than this are drawn as pixels in vector graphics.
VECTOR_POINTS = 500
_WIDTH = 11.6


def tips(result: SweepResult) -> pd.DataFrame:
    """Tips [mm] of the cases that have them, in the last step that is kept; empty where only one coordinate varies."""
    for name in reversed(result.outputs):
        names = {name.replace("_z", f"_{axis}", 1): axis for axis in "xyz"}
        if name.startswith("tip_z") and set(names) <= set(result.outputs):
            table = 1e3 * result.cases[list(names)].rename(columns=names).dropna()
            return table if sum(map(result.varies, names)) > 1 else table[:0]
    return pd.DataFrame()


def _row_of_axes(count: int, height: float, **options: Any) -> tuple[Figure, list[Axes]]:
    figure = Figure(figsize=(max(_WIDTH, 2.6 * count), height), layout="constrained")
    return figure, list(figure.subplots(1, count, squeeze=False, **options)[0])


def workspace(result: SweepResult) -> Figure | None:
    """Tip positions of all cases from two sides and from above, coloured by the sum of the tensions."""
    points = tips(result)
    if points.empty:
        return None
    values, label = _colouring(result)
    points = points.assign(colour=values[points.index])
    points = points.sort_values("colour", ascending=False, kind="stable")  # the smallest are drawn last
    # The same scale in all three; the base is in the side views.
    reach = 1.08 * float(points[["x", "y"]].abs().max().max())
    low, high = min(0.0, points["z"].min()) - 0.08 * reach, max(0.0, points["z"].max()) + 0.08 * reach
    figure, axes = _row_of_axes(3, 4.1)
    size, many = 9.0 if len(points) < 2000 else 4.0, len(points) > VECTOR_POINTS
    for ax, across, up, title in zip(axes, "xyx", "zzy", ("the side", "the front", "above"), strict=True):
        look: dict[str, Any] = {"c": points["colour"], "cmap": HEAT, "s": size, "rasterized": many}
        cloud = ax.scatter(points[across], points[up], lw=0.0, **look)
        ax.plot(0.0, 0.0, marker="s" if up == "z" else "+", ms=6, mew=1.6, color=INK, zorder=3)
        labels = {"xlabel": f"tip {across} [mm]", "ylabel": f"tip {up} [mm]"}
        limits = {"xlim": (-reach, reach), "ylim": (low, high) if up == "z" else (-reach, reach)}
        ax.set(title=f"From {title}", aspect="equal", **labels, **limits)
        ax.xaxis.set_major_locator(MaxNLocator(6))
        ax.yaxis.set_major_locator(MaxNLocator(6))
    if label:
        bar = figure.colorbar(cloud, ax=axes, shrink=0.85, pad=0.01, label=label)
        _with_prefixes(bar.ax.yaxis, points["colour"])
        bar.outline.set_visible(False)
    return figure


def _colouring(result: SweepResult) -> tuple[pd.Series, str]:
    """Numbers that colour the points of the workspace, and their label."""
    pulls = [n for n in result.inputs if n.startswith("pull_")] if result.sweep.workspace else []
    if pulls:
        return result.cases[pulls].sum(axis=1), "sum of the tensions [N]"
    for name in map(str, result.cases[list(result.inputs)].select_dtypes("number")):
        if varies(result.column(name)):
            return result.cases[name], result.inputs[name]
    return pd.Series(0.0, result.cases.index), ""


def sobol(result: SweepResult) -> Figure | None:
    """First and total Sobol indices of the results, with their 95 % intervals."""
    indices = result.sobol_indices()
    names = [n for n in result.drawn if n in indices]
    if not names:
        return None
    place = np.arange(len(result.inputs))
    figure, axes = _row_of_axes(len(names), 1.0 + 0.42 * len(place), sharey=True)
    for ax, name in zip(axes, names, strict=True):
        of = indices[name]
        for value, interval, shift, colour, label in (
            (of.first, of.first_interval, -0.19, COLOURS[0], "first order: by itself"),
            (of.total, of.total_interval, 0.19, COLOURS[1], "total order: with interactions"),
        ):
            reach = np.abs(interval.T - value)
            bars: dict[str, Any] = {"ecolor": INK, "error_kw": {"elinewidth": 0.9}}
            ax.barh(place + shift, value, xerr=reach, height=0.36, color=colour, label=label, **bars)
        ax.set(title=display(name).label, xlabel="Sobol index")
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
    figure, axes = _row_of_axes(len(result.drawn), 2.9)
    table = result.statistics()
    for ax, name in zip(axes, result.drawn, strict=True):
        how, s = display(name), display(name).factor * table[name]
        ax.axvspan(s["quantile_2.5"], s["quantile_97.5"], color=COLOURS[5], alpha=0.18, lw=0)
        bins = int(np.clip(np.sqrt(table[name]["count"]), 8, 40))
        ax.hist(how.factor * result.cases[name].dropna(), bins=bins, color=COLOURS[0], alpha=0.85)
        ax.axvline(s["mean"], color=INK, lw=1.4)
        ax.axvline(s["median"], color=INK, lw=1.2, ls=(0, (2, 2)))
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
        how = display(name)
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
    means = values.groupby(groups, sort=numeric).agg(["mean", "sem"])
    place = given.groupby(groups).mean().to_numpy() if numeric else np.arange(len(means))
    look: dict[str, Any] = {"color": COLOURS[0], "ecolor": PALE, "marker": "o", "ms": 3.5, "elinewidth": 1.2}
    ax.errorbar(place, means["mean"], yerr=means["sem"], lw=1.4 if numeric else 0.0, **look)
    if numeric:
        ax.xaxis.set_major_locator(MaxNLocator(4))
        _with_prefixes(ax.xaxis, place)
    else:
        ax.set_xticks(place, labels=[str(x) for x in means.index])
        ax.set_xlim(-0.6, len(means) - 0.4)


def _with_prefixes(axis: Axis, values: ArrayLike) -> None:
    """Numbers as 60 G or 50 µ where they are large or small, in place of a power of ten beside the axis."""
    largest = float(np.nanmax(np.abs(values), initial=0.0))
    if largest >= 1e5 or 0.0 < largest < 1e-3:
        axis.set_major_formatter(EngFormatter())


#: By file, what draws a picture (None where the sweep has no data for it), its title and its caption.
PICTURES: dict[str, tuple[Callable[[SweepResult], Figure | None], str, str]] = {
    "workspace.png": (
        workspace,
        "Tip positions",
        "Tip of every case that converged. Side views share z, the direction of the undeformed backbone.",
    ),
    "sobol_indices.png": (
        sobol,
        "Sobol indices",
        "Share of the variance of a result that an input explains by itself (first order), and with all its "
        "interactions (total order). Lines are 95 % intervals from a bootstrap over the base samples.",
    ),
    "distributions.png": (
        distributions,
        "Distributions of the results",
        "Cases by value. Solid line: mean; dashed line: median; shaded: the middle 95 % of the cases.",
    ),
    "main_effects.png": (
        main_effects,
        "Main effects",
        "Mean of a result over one input, averaged over all others; inputs with many values are divided into bins "
        "with equally many cases. Bars: standard error of the mean.",
    ),
}


def drawn(result: SweepResult) -> dict[str, Picture]:
    """The pictures for which a sweep has data, by their files; the one that suits best comes first."""
    if not result.counts.get("converged", 0):
        return {}
    # The cloud of tips is one result among others, unless it was asked for.
    order = sorted(PICTURES, key=lambda n: (n == "workspace.png") != result.sweep.workspace)
    found = {}
    with styled():
        for name in order:
            draw, title, caption = PICTURES[name]
            if (figure := draw(result)) is not None:
                found[name] = Picture(figure, title, caption)
    return found

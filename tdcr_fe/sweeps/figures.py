"""Pictures of a sweep: workspace cloud, histograms, main effects, Sobol indices."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.ticker import EngFormatter, MaxNLocator
from numpy.typing import NDArray

from tdcr_fe.report.style import COLOURS, INK, PALE, SOFT, styled
from tdcr_fe.sweeps.result import SweepResult, shown, shown_outputs
from tdcr_fe.sweeps.sampling import SAMPLED
from tdcr_fe.sweeps.statistics import bins, main_effect, summarise, varies

Array = NDArray[np.float64]

_MM = 1e3
#: Most results, and most inputs, in one picture.
MOST_OUTPUTS, MOST_INPUTS = 4, 6
#: Inputs with more values than this are divided into bins.
MOST_LEVELS = 15
#: More points than this are drawn as pixels in vector graphics.
VECTOR_POINTS = 500


def tip_columns(result: SweepResult) -> tuple[str, str, str] | None:
    """Columns of the tip, of the last step that has them; None where fewer than two coordinates vary."""
    suffixes = [f"_step{k}" for k in reversed(result.sweep.output.steps)] or [""]
    for suffix in suffixes:
        names = tuple(f"tip_{axis}{suffix}" for axis in "xyz")
        if set(names) <= set(result.outputs):
            if sum(varies(result.column(n)) for n in names) < 2:
                return None
            return names[0], names[1], names[2]
    return None


def pulls(result: SweepResult) -> list[str]:
    """Inputs of a workspace that are tensions."""
    if not result.sweep.workspace:
        return []
    return [v.name for v in result.sweep.variations if v.name.startswith("pull_")]


# ------------------------------------------------------------------------------------------------ workspace


def workspace(result: SweepResult) -> Figure | None:
    """Tip positions of all cases from two sides and from above, coloured by the sum of the tensions."""
    names = tip_columns(result)
    if names is None:
        return None
    tips = _MM * np.column_stack([result.column(n) for n in names])
    sound = np.isfinite(tips).all(axis=1)
    colour, label = _colouring(result)
    with styled():
        figure = Figure(figsize=(11.6, 4.1), layout="constrained")
        axes = figure.subplots(1, 3)
        drawn = None
        # The same scale in all three; the base is in the side views.
        reach = 1.08 * float(np.abs(tips[sound, :2]).max())
        low, high = min(0.0, float(tips[sound, 2].min())), max(0.0, float(tips[sound, 2].max()))
        heights = (low - 0.08 * reach, high + 0.08 * reach)
        # From the side with little in front: the cases with the smallest colour are drawn last.
        order = np.flatnonzero(sound)[np.argsort(-colour[sound], kind="stable")]
        for ax, (i, j) in zip(axes, ((0, 2), (1, 2), (0, 1)), strict=True):
            drawn = ax.scatter(
                tips[order, i],
                tips[order, j],
                c=colour[order],
                s=9.0 if len(order) < 2000 else 4.0,
                lw=0.0,
                cmap="viridis",
                rasterized=len(order) > VECTOR_POINTS,
            )
            ax.set_xlabel(f"tip {'xyz'[i]} [mm]")
            ax.set_ylabel(f"tip {'xyz'[j]} [mm]")
            ax.set_aspect("equal")
            ax.set_xlim(-reach, reach)
            ax.set_ylim(*(heights if j == 2 else (-reach, reach)))
            _base(ax, j == 2)
            ax.xaxis.set_major_locator(MaxNLocator(6))
            ax.yaxis.set_major_locator(MaxNLocator(6))
        for ax, title in zip(axes, ("From the side", "From the front", "From above"), strict=True):
            ax.set_title(title)
        if drawn is not None and label:
            bar = figure.colorbar(drawn, ax=axes, shrink=0.85, pad=0.01)
            bar.set_label(label)
            _with_prefixes(bar.ax.yaxis, colour)
            bar.outline.set_visible(False)
    return figure


def _base(ax: Axes, from_side: bool) -> None:
    """Mark the base plate, or the axis that the undeformed backbone lies on."""
    ax.plot(0.0, 0.0, marker="s" if from_side else "+", ms=6, mew=1.6, color=INK, zorder=3)
    if from_side:
        ax.annotate("base", (0.0, 0.0), xytext=(6, 5), textcoords="offset points", color=SOFT, fontsize=8)


def _colouring(result: SweepResult) -> tuple[Array, str]:
    """Numbers that colour the points of the workspace, and their label."""
    tensions = pulls(result)
    if len(tensions) > 1:
        return result.cases[tensions].to_numpy(dtype=float).sum(axis=1), "sum of the tensions [N]"
    if tensions:
        return result.column(tensions[0]), "tension [N]"
    for name in result.inputs:
        column = result.cases[name]
        if column.dtype.kind in "fi" and varies(column.to_numpy(dtype=float)):
            return column.to_numpy(dtype=float), name
    return np.zeros(len(result.cases)), ""


# -------------------------------------------------------------------------------------------- distributions


def distributions(result: SweepResult) -> Figure | None:
    """Histograms of the results of a sample, with mean, median and the interval of 95 % of the cases."""
    names = shown_outputs(result)[:MOST_OUTPUTS]
    if result.design.method not in SAMPLED or not names:
        return None
    with styled():
        figure = Figure(figsize=(11.6, 2.9), layout="constrained")
        axes = figure.subplots(1, len(names), squeeze=False)[0]
        for ax, name in zip(axes, names, strict=True):
            how = shown(name)
            values = how.factor * result.column(name)
            values = values[np.isfinite(values)]
            found = summarise(values)
            count = int(np.clip(np.sqrt(len(values)), 8, 40))
            ax.axvspan(found.quantiles[0], found.quantiles[2], color=COLOURS[5], alpha=0.18, lw=0)
            ax.hist(values, bins=count, color=COLOURS[0], alpha=0.85)
            ax.axvline(found.mean, color=INK, lw=1.4)
            ax.axvline(found.quantiles[1], color=INK, lw=1.2, ls=(0, (2, 2)))
            ax.set_xlabel(how.axis)
            ax.xaxis.set_major_locator(MaxNLocator(5))
            ax.grid(axis="x", visible=False)
        axes[0].set_ylabel("cases")
    return figure


# --------------------------------------------------------------------------------------------- main effects


def main_effects(result: SweepResult) -> Figure | None:
    """Mean of each result over each input, all other inputs averaged; bars are standard errors of the mean."""
    outputs, inputs = shown_outputs(result)[:MOST_OUTPUTS], list(result.inputs)[:MOST_INPUTS]
    if not outputs or not inputs:
        return None
    with styled():
        size = (max(4.6, min(11.6, 0.6 + 2.9 * len(inputs))), 0.5 + 2.0 * len(outputs))
        figure = Figure(figsize=size, layout="constrained")
        axes = figure.subplots(len(outputs), len(inputs), squeeze=False, sharey="row")
        for row, name in zip(axes, outputs, strict=True):
            how = shown(name)
            values = how.factor * result.column(name)
            for ax, given in zip(row, inputs, strict=True):
                _main_effect(ax, result, given, values)
            row[0].set_ylabel(how.axis)
            row[0].yaxis.set_major_locator(MaxNLocator(5))
        for ax, given in zip(axes[-1], inputs, strict=True):
            ax.set_xlabel(_wrapped(given))
    return figure


def _with_prefixes(axis: Axis, values: Array) -> None:
    """Numbers as 60 G or 50 µ where they are large or small, in place of a power of ten beside the axis."""
    largest = float(np.nanmax(np.abs(values), initial=0.0))
    if largest >= 1e5 or 0.0 < largest < 1e-3:
        axis.set_major_formatter(EngFormatter())


def _wrapped(key: str) -> str:
    """A long key in two lines."""
    if len(key) <= 26:
        return key
    cut = key.rfind(".", 0, 26)
    return f"{key[: cut + 1]}\n{key[cut + 1 :]}" if cut > 0 else key


def _main_effect(ax: Axes, result: SweepResult, given: str, values: Array) -> None:
    column = result.cases[given]
    numeric = column.dtype.kind in "fi"
    if numeric:
        found = column.to_numpy(dtype=float)
        levels, at = np.unique(found, return_inverse=True)
        if len(levels) > MOST_LEVELS:
            at, levels = bins(found)
    else:
        at, levels = pd.factorize(column.to_numpy())  # in the order of the file
    mean, error = main_effect(at, values, len(levels))
    place = levels if numeric else np.arange(len(levels))
    several = np.bincount(at).max() > 1
    ax.errorbar(
        place,
        mean,
        yerr=error if several and len(result.inputs) > 1 else None,
        color=COLOURS[0],
        ecolor=PALE,
        marker="o",
        ms=3.5,
        lw=1.4 if numeric else 0.0,
        elinewidth=1.2,
    )
    if numeric:
        ax.xaxis.set_major_locator(MaxNLocator(4))
        _with_prefixes(ax.xaxis, levels)
    else:
        ax.set_xticks(place, labels=[str(x) for x in levels])
        ax.set_xlim(-0.6, len(levels) - 0.4)


# -------------------------------------------------------------------------------------------- Sobol indices


def sobol(result: SweepResult) -> Figure | None:
    """First and total Sobol indices of the results, with their 95 % intervals."""
    indices = result.sobol_indices()
    names = [n for n in shown_outputs(result) if n in indices][:MOST_OUTPUTS]
    if not names:
        return None
    inputs = list(result.inputs)
    with styled():
        figure = Figure(figsize=(11.6, 1.0 + 0.42 * len(inputs)), layout="constrained")
        axes = figure.subplots(1, len(names), squeeze=False, sharey=True)[0]
        place = np.arange(len(inputs))
        for ax, name in zip(axes, names, strict=True):
            found = indices[name]
            both = ((found.first, found.first_interval, -0.19), (found.total, found.total_interval, 0.19))
            for (value, interval, shift), colour, label in zip(
                both, COLOURS, ("by itself (first order)", "with interactions (total)"), strict=False
            ):
                reach = np.abs(interval.T - value)
                style: Any = {"height": 0.36, "color": colour, "label": label}
                ax.barh(
                    place + shift, value, xerr=reach, error_kw={"ecolor": INK, "elinewidth": 0.9}, **style
                )
            ax.set_title(shown(name).label)
            ax.set_xlim(min(0.0, ax.get_xlim()[0]), max(1.0, ax.get_xlim()[1]))
            ax.set_xlabel("share of the variance")
            ax.grid(axis="y", visible=False)
        axes[0].set_yticks(place, labels=inputs)
        axes[0].invert_yaxis()
        handles, labels = axes[0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=2)
    return figure


#: Every picture that a sweep may have, by its file.
PICTURES: dict[str, Callable[[SweepResult], Figure | None]] = {
    "workspace.png": workspace,
    "sobol_indices.png": sobol,
    "distributions.png": distributions,
    "main_effects.png": main_effects,
}


def drawn(result: SweepResult) -> dict[str, Figure]:
    """The pictures for which a sweep has data, by their files; the one that suits best comes first."""
    if not result.counts.get("converged", 0):
        return {}
    order = list(PICTURES)
    if not result.sweep.workspace:  # the cloud of tips is then one result among others
        order = [*order[1:], order[0]]
    figures = {name: PICTURES[name](result) for name in order}
    return {name: figure for name, figure in figures.items() if figure is not None}


def save(figures: dict[str, Figure], out: Path, dpi: float = 150.0) -> Sequence[Path]:
    """Write pictures into a directory that exists."""
    for name, figure in figures.items():
        with styled():
            figure.savefig(out / name, dpi=dpi, facecolor="white")
    return [out / name for name in figures]

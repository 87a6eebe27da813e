"""The report on a sweep: workspace cloud, Sobol indices, histograms and main effects, in one HTML page and as files."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.ticker import EngFormatter, MaxNLocator
from numpy.typing import ArrayLike

from tdcr_fe.io.files import write_text
from tdcr_fe.io.result_files import versions
from tdcr_fe.model.messages import shown as value_text
from tdcr_fe.report.environment import fixed, quantity
from tdcr_fe.report.page import Card, Page, Picture, Section, render
from tdcr_fe.report.style import COLOURS, HEAT, INK, PALE, styled
from tdcr_fe.sweeps.description import Variation
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


# ---------------------------------------------------------------------------------------------------------- the page

#: Warnings that are listed.
MOST_WARNINGS = 40
#: Where the 95 % interval of a Sobol index is wider, the samples are too few for it: the order of inputs is open.
WIDEST = 0.2
_METHODS = {
    "grid": "every combination of the values",
    "list": "the values taken together, in their order",
    "latin-hypercube": "a Latin hypercube",
    "sobol": "scrambled Sobol points",
    "saltelli": "Saltelli's design for Sobol indices",
}


def write_report(result: SweepResult, out: Path) -> None:
    """Write `report.html` and the pictures into a directory that exists."""
    pictures = drawn(result)
    for name, picture in pictures.items():
        with styled():
            picture.figure.savefig(out / name, dpi=150.0, facecolor="white")
    write_text(render(_page(result, pictures), "tdcr_fe.sweeps"), out / "report.html")


def _page(result: SweepResult, pictures: dict[str, Picture]) -> Page:
    names, sections = list(pictures), []
    if result.failures:
        every = [(status, m) for status, messages in result.failures.items() for m in messages]
        failed = [(m.count, status, m.case, m.example) for status, m in every]
        head = ("cases", "status", "first case", "reason of that case")
        section = _table("failures", "Cases that did not converge", head, failed)
        sections.append(replace(section, folded=len(failed) > MOST_INPUTS))
    for name in names[1:]:
        context = {"picture": pictures[name], "note": _left_out(name, result)}
        anchor, folded = name.partition(".")[0], len(sections) > 1
        sections.append(Section(anchor, pictures[name].text, "picture.html.j2", context, folded=folded))
    note = "A factor multiplies the declared value, an offset is added to it."
    inputs = [_input(v) for v in result.sweep.variations]
    columns: tuple[str, ...] = ("column", "mode", "values", "key")
    sections.append(_table("inputs", "What was varied", columns, inputs, note))
    if result.warnings:
        warned = [(m.count, m.case, m.example) for m in result.warnings[:MOST_WARNINGS]]
        columns = ("times", "first case", "warning of that case")
        sections.append(_table("warnings", "Warnings", columns, warned))
    finding, *sentences = _sentences(result)
    return Page(
        title="Sweep of a tendon-driven continuum robot",
        verdict=finding,
        level="open" if result.interrupted else "good" if result.converged else "part" if pictures else "bad",
        sentences=tuple(sentences),
        cards=(
            Card(str(len(result.cases)), "cases"),
            Card(str(result.counts.get("converged", 0)), "converged"),
            Card(quantity(result.wall_time, "s"), f"for {result.solved_now} cases in this run"),
        ),
        pictures=tuple(pictures[name] for name in names[:1]),
        summary=_statistics(result),
        sections=tuple(sections),
        notes=(
            "In the same folder: the table of cases, one row per case; summary.json with all numbers of this page; "
            "cases.jsonl, from which the same command continues.",
            "Versions: " + ", ".join(f"{name} {version}" for name, version in versions().items()) + ".",
        ),
    )


def _table(
    anchor: str, title: str, head: tuple[str, ...], rows: Sequence[tuple[object, ...]], note: str = ""
) -> Section:
    return Section(anchor, title, "table.html.j2", {"head": head, "rows": rows, "note": note})


def _sentences(result: SweepResult) -> list[str]:
    """The first screen: what was found, as the headline, and on how many cases it rests."""
    count, converged = len(result.cases), result.counts.get("converged", 0)
    if result.interrupted:
        not_run = f"{result.counts['not run']} were not run. The same command continues with them."
        how_many = f"Interrupted: {converged} of {count} cases converged, {not_run}"
    elif result.converged:
        how_many = f"All {count} cases converged." if count > 1 else "The case converged."
    else:
        how_many = f"{converged} of {count} cases converged."
    sampling, inputs = result.sweep.sampling, list(result.inputs)
    method = _METHODS[sampling.method]
    if sampling.method == "saltelli":
        method += f", {sampling.samples} base samples × ({len(inputs)} inputs + 2)"
    seed = f", seed {sampling.seed}" if sampling.is_sample else ""
    varied = ", ".join(inputs[:MOST_INPUTS]) + (" and others" if len(inputs) > MOST_INPUTS else "")
    sentences = [*_findings(result), how_many, f"Varied: {varied}. Cases: {method}{seed}."]
    if result.warnings:
        warned = int((result.cases["warnings"] > 0).sum())
        sentences.append(f"{warned} of the cases have warnings; they are listed below.")
    return sentences


def _findings(result: SweepResult) -> list[str]:
    """The result that was asked for: the workspace, or the scatter of the first result and its cause."""
    if result.sweep.workspace and len(points := tips(result)):
        low, high = points.min(), points.max()
        box = ", ".join(f"{axis} from {fixed(low[axis], 1)} to {fixed(high[axis], 1)}" for axis in "xyz")
        offset = np.hypot(points["x"], points["y"]).max()
        return [f"The tip reaches {box} mm, at most {fixed(offset, 1)} mm from the z axis."]
    if not result.listed:
        return []
    name = result.listed[0]
    how, s = display(name), display(name).texts(result.statistics()[name])
    what, unit = how.label[0].upper() + how.label[1:], f" {how.unit}" if how.unit else ""
    if not result.sweep.sampling.is_sample:
        return [f"{what} ranges from {s['min']} to {s['max']}{unit}."]
    spread = f"mean {s['mean']}{unit}, standard deviation {s['std']}{unit}"
    between = f"{s['quantile_2.5']} and {s['quantile_97.5']}{unit}"
    scatter = f"{what}: {spread}; 95 % of the cases lie between {between}."
    if (indices := result.sobol_indices().get(name)) is None:
        return [scatter]
    k = int(np.nanargmax(indices.total))
    low, high = indices.total_interval[k]
    cause = f"{list(result.inputs)[k]} for {how.label}"
    if high - low > WIDEST:
        text = f"Too few samples for Sobol indices: the 95 % interval of the largest one (total order, {cause}) is"
        # The width falls with the root of the number.
        more = max(256, 4 * (result.sweep.sampling.samples or 0))
        return [scatter, f"{text} {low:.2f} to {high:.2f}. Use samples = {more}."]
    text = f"{indices.total[k]:.2f} (95 % interval {low:.2f} to {high:.2f}), the largest"
    return [scatter, f"Total-order Sobol index of {cause}: {text}."]


def _statistics(result: SweepResult) -> Section:
    """Statistics of the results over the cases that converged."""
    columns = {
        "count": "cases",
        "mean": "mean",
        "std": "standard deviation",
        "min": "smallest",
        "quantile_2.5": "2.5 %",
        "median": "median",
        "quantile_97.5": "97.5 %",
        "max": "largest",
    }
    table = result.statistics()
    texts = {name: display(name).texts(table[name]) for name in result.listed}
    rows = [(name, display(name).unit, *(s[c] for c in columns)) for name, s in texts.items()]
    sampled = result.sweep.sampling.is_sample and not result.sweep.workspace
    note = "Over the cases that converged" + ("." if sampled else ", each with the same weight.")
    head = ("result", "unit", *columns.values())
    return _table("results", "", head, rows, note if rows else "No result differs between the cases.")


def _input(v: Variation) -> tuple[object, ...]:
    """Column, mode, values and key of a variation."""
    if v.distribution is not None:
        kind, numbers = v.described()
        what = f"{kind} ({', '.join(f'{k} {value_text(x)}' for k, x in numbers.items())})"
    elif len(v.options) <= 2 * MOST_INPUTS:
        what = ", ".join(map(value_text, v.options))
    else:
        what = f"{len(v.options)} values from {value_text(v.options[0])} to {value_text(v.options[-1])}"
    return v.label, v.mode, what, v.key


def _left_out(name: str, result: SweepResult) -> str:
    """A remark where a picture shows only some of the columns."""
    if result.drawn == result.listed or name == "workspace.png":
        return ""
    some = f"Drawn: {', '.join(display(n).label for n in result.drawn)} of {len(result.listed)} results;"
    return f"{some} [output] quantities in sweep.toml chooses others. cases.csv has all of them."

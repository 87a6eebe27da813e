"""The report on a sweep: one HTML page and the same pictures as files."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from tdcr_fe.io.atomic import write_text
from tdcr_fe.io.result_files import versions
from tdcr_fe.model.messages import shown as value_text
from tdcr_fe.report.environment import fixed, quantity
from tdcr_fe.report.page import Card, Page, Picture, Section, render
from tdcr_fe.report.style import styled
from tdcr_fe.sweeps.description import Variation
from tdcr_fe.sweeps.figures import MOST_INPUTS, drawn, tips
from tdcr_fe.sweeps.result import SweepResult, display

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

"""The report on a sweep: one HTML page and the same pictures as files."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from tdcr_fe.io.atomic import write_text
from tdcr_fe.io.summary import versions
from tdcr_fe.model.messages import shown as value_text
from tdcr_fe.report import page as kit
from tdcr_fe.report.environment import fixed, quantity, significant
from tdcr_fe.report.page import Card, Level, Page, Picture, Section
from tdcr_fe.report.style import svg
from tdcr_fe.sweeps.description import Variation
from tdcr_fe.sweeps.figures import MOST_INPUTS, MOST_OUTPUTS, drawn, save, tip_columns
from tdcr_fe.sweeps.result import SweepResult, shown, shown_outputs
from tdcr_fe.sweeps.sampling import SAMPLED

#: By picture: title of its section, caption.
CAPTIONS = {
    "workspace.png": (
        "Workspace",
        "Tip of every case that converged. Side views share z, the direction of the undeformed backbone.",
    ),
    "sobol_indices.png": (
        "Sobol indices",
        "Share of the variance of a result that an input explains by itself (first order), and with all its "
        "interactions (total). Lines are 95 % intervals from a bootstrap over the base samples.",
    ),
    "distributions.png": (
        "Distributions of the results",
        "Cases by value. Solid line: mean; dashed line: median; shaded: the middle 95 % of the cases.",
    ),
    "main_effects.png": (
        "Main effects",
        "Mean of a result over one input, all others averaged; inputs with many values are divided into bins of as "
        "many cases each. Bars: standard error of the mean.",
    ),
}

_METHODS = {
    "grid": "every combination of the values",
    "list": "the values taken together, in their order",
    "latin-hypercube": "a Latin hypercube",
    "sobol": "scrambled Sobol points",
    "saltelli": "the design for Sobol indices (Saltelli)",
}


def headline(result: SweepResult) -> str:
    """The verdict in one sentence."""
    count, converged = len(result.cases), result.counts.get("converged", 0)
    if result.interrupted:
        left = result.counts.get("not run", 0)
        return f"Interrupted: {converged} of {count} cases converged, {left} were not run."
    if converged == count:
        return f"All {count} cases converged." if count > 1 else "The case converged."
    return f"{converged} of {count} cases converged."


def level(result: SweepResult) -> Level:
    """Level of the verdict."""
    if result.interrupted:
        return "open"
    if result.converged:
        return "good"
    return "part" if result.counts.get("converged", 0) else "bad"


def sentences(result: SweepResult) -> list[str]:
    """Further sentences of the first screen."""
    sampling = result.sweep.sampling
    how = _METHODS[sampling.method]
    if result.design.base_samples:
        d = len(result.inputs)
        how += f", {sampling.samples} base samples times {d} + 2"
    seed = "" if sampling.samples is None else f", seed {sampling.seed}"
    varied = ", ".join(result.inputs[:6]) + (" and others" if len(result.inputs) > 6 else "")
    found = [f"Varied: {varied}. Cases: {how}{seed}."]
    if result.sweep.workspace and tip_columns(result) is not None:
        found.append(_reach(result))
    elif result.design.base_samples:
        found += _leading_input(result)
    names = shown_outputs(result)
    if names and not result.sweep.workspace:
        found.append(_scatter(result, names[0]))
    if result.interrupted:
        found.append("The same command continues with the cases that were not run.")
    if result.warnings:
        noted = int((result.cases["warnings"] > 0).sum())
        found.append(f"{noted} of the cases carry warnings; they are listed below.")
    return found


def _scatter(result: SweepResult, name: str) -> str:
    """How a result is distributed in a sample; else its range."""
    how, s = shown(name), result.statistics()[name]
    what, unit = how.label[0].upper() + how.label[1:], f" {how.unit}" if how.unit else ""
    if result.design.method not in SAMPLED:
        low, high = (significant(how.factor * x, 4) for x in (s.smallest, s.largest))
        return f"{what} goes from {low} to {high}{unit}."
    mean, low, high = (significant(how.factor * x, 4) for x in (s.mean, s.quantiles[0], s.quantiles[2]))
    return (
        f"{what}: mean {mean}{unit}, standard deviation {significant(how.factor * s.std)}{unit}; 95 % of the cases lie "
        f"from {low} to {high}{unit}."
    )


def _reach(result: SweepResult) -> str:
    names = tip_columns(result)
    assert names is not None
    tips = 1e3 * result.cases[list(names)].to_numpy(dtype=float)
    tips = tips[np.isfinite(tips).all(axis=1)]
    low, high = tips.min(axis=0), tips.max(axis=0)
    box = ", ".join(f"{a} from {fixed(low[k], 1)} to {fixed(high[k], 1)}" for k, a in enumerate("xyz"))
    offset = np.hypot(tips[:, 0], tips[:, 1]).max()
    return f"The tip reaches {box} mm, and {fixed(offset, 1)} mm from the z axis at most."


def _leading_input(result: SweepResult) -> list[str]:
    """Which input explains most of the first result."""
    indices = result.sobol_indices()
    names = [n for n in shown_outputs(result) if n in indices]
    if not names:
        return []
    found = indices[names[0]]
    k = int(np.nanargmax(found.total))
    low, high = found.total_interval[k]
    return [
        f"Of the variance of {shown(names[0]).label}, {result.inputs[k]} has a share of {found.total[k]:.2f} with its "
        f"interactions (95 % interval {low:.2f} to {high:.2f})."
    ]


def _cards(result: SweepResult) -> tuple[Card, ...]:
    count = len(result.cases)
    rate = result.solved_now / result.wall_time if result.wall_time > 0.0 and result.solved_now else None
    cards = [
        Card(str(count), "cases"),
        Card(str(result.counts.get("converged", 0)), "converged"),
        Card("–" if rate is None else f"{significant(rate)} / s", "cases a second in this run"),
    ]
    mean = result.case_seconds / max(1, count - result.counts.get("not run", 0))
    return (*cards, Card(quantity(mean, "s"), "mean time of a case"))


def _statistics(result: SweepResult) -> list[dict[str, Any]]:
    found = result.statistics()
    rows = []
    for name in shown_outputs(result):
        how, s = shown(name), found[name]
        numbers = (s.mean, s.std, s.smallest, *s.quantiles, s.largest)
        rows.append(
            {
                "column": name,
                "unit": how.unit,
                "count": s.count,
                "numbers": [significant(how.factor * x, 4) for x in numbers],
            }
        )
    return rows


def _inputs(variations: tuple[Variation, ...]) -> list[dict[str, str]]:
    rows = []
    for v in variations:
        if v.distribution is not None:
            numbers = {k: x for k, x in vars(v.distribution).items() if x is not None}
            what = type(v.distribution).__name__.lower()
            what += " (" + ", ".join(f"{k} {value_text(x)}" for k, x in numbers.items()) + ")"
        elif len(v.options) <= 12:
            what = ", ".join(value_text(x) for x in v.options)
        else:
            what = f"{len(v.options)} values from {value_text(v.options[0])} to {value_text(v.options[-1])}"
        keys = ", ".join(key.text for key in v.keys)
        rows.append({"name": v.name, "keys": "" if keys == v.name else keys, "mode": v.mode, "values": what})
    return rows


def _picture(name: str, figure: Figure) -> Picture:
    title, caption = CAPTIONS[name]
    return Picture(svg(figure), title, caption)


def page(result: SweepResult, figures: dict[str, Figure]) -> Page:
    """The report as a page."""
    pictures = {name: _picture(name, figure) for name, figure in figures.items()}
    first = next(iter(pictures), None)
    sections = []
    if result.failures:
        failures = [(status, m) for status, found in result.failures.items() for m in found]
        sections.append(
            Section(
                "failures",
                "Cases that did not converge",
                "failures.html.j2",
                {"failures": failures},
                folded=len(failures) > 8,
            )
        )
    for name, picture in pictures.items():
        if name != first:
            anchor = name.partition(".")[0]
            context = {"picture": picture, "note": _left_out(name, result)}
            sections.append(
                Section(anchor, CAPTIONS[name][0], "picture.html.j2", context, folded=len(sections) > 1)
            )
    sections.append(
        Section("inputs", "What was varied", "inputs.html.j2", {"inputs": _inputs(result.sweep.variations)})
    )
    if result.warnings:
        sections.append(
            Section("warnings", "Warnings", "warnings.html.j2", {"warnings": result.warnings[:40]})
        )
    sampled = bool(result.sweep.sampling.samples) and not result.sweep.workspace
    return Page(
        title="Sweep of a tendon-driven continuum robot",
        verdict=headline(result),
        level=level(result),
        sentences=tuple(sentences(result)),
        cards=_cards(result),
        pictures=() if first is None else (pictures[first],),
        summary=Section(
            "results", "", "results.html.j2", {"rows": _statistics(result), "is_sample": sampled}
        ),
        sections=tuple(sections),
        notes=(
            "Beside this page: the table of cases, one row a case; summary.json with all numbers of this page; "
            "cases.jsonl, from which the same command continues.",
            "Versions: " + ", ".join(f"{name} {version}" for name, version in versions().items()) + ".",
        ),
    )


def _left_out(name: str, result: SweepResult) -> str:
    """A remark where a picture shows only some of the columns."""
    outputs, inputs = len(shown_outputs(result)), len(result.inputs)
    parts = []
    if outputs > MOST_OUTPUTS and name != "workspace.png":
        parts.append(f"{MOST_OUTPUTS} of {outputs} results are drawn; the table of cases has all")
    if inputs > MOST_INPUTS and name == "main_effects.png":
        parts.append(f"{MOST_INPUTS} of {inputs} inputs are drawn")
    return "; ".join(parts) + "." if parts else ""


def write_report(result: SweepResult, out: Path) -> None:
    """Write `report.html` and the pictures into a directory that exists."""
    figures = drawn(result)
    save(figures, out)
    write_text(kit.render(page(result, figures), "tdcr_fe.sweeps"), out / "report.html")

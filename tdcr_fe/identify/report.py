"""The report: one self-contained HTML page on what was found, its first screen for readers without statistics."""

from __future__ import annotations

import io
import math
import os
from collections.abc import Sequence
from importlib.resources import files
from pathlib import Path
from typing import Any

import jinja2
import numpy as np
from markupsafe import Markup
from matplotlib.figure import Figure
from numpy.typing import NDArray

from tdcr_fe.effects import effect
from tdcr_fe.identify.holdout import directions
from tdcr_fe.identify.outcome import IdentificationResult, Misfit
from tdcr_fe.io.measured import QUANTITIES

Array = NDArray[np.float64]

BEFORE, AFTER, HELD = "#b5532a", "#1f6fa8", "#e9e4d8"

#: Units in which people read: factor and text, by the unit of the file.
SHOWN = {"m": (1e3, "mm"), "rad": (math.degrees(1.0), "deg"), "N": (1.0, "N")}


# ------------------------------------------------------------------------------------------------ sentences


def headline(result: IdentificationResult) -> str:
    """The verdict in one sentence."""
    names = " and ".join(e.name.replace("_", " ") for e in result.effects)
    if result.verdict == "nothing missing":
        return "Nothing is missing: the declared model already explains the measurement down to its noise."
    if result.verdict == "explained":
        return f"Explained: what the declared model lacks is {names}."
    if result.verdict == "partly explained" and result.remaining.where == "not known":
        return f"Partly explained: {names} would explain the measurement, but it is too small to test that."
    if result.verdict == "partly explained":
        return (
            f"Partly explained: {names} {'remove' if len(result.effects) > 1 else 'removes'} part of the error, but "
            "something remains that no listed effect explains."
        )
    return "Unexplained: the model lacks something that no listed effect explains."


def _size(misfit: Misfit) -> str:
    if misfit.rms_position is not None:
        return f"{1e3 * misfit.rms_position:.3g} mm"
    if misfit.rms_angle is not None:
        return f"{math.degrees(misfit.rms_angle):.3g} degrees"
    return f"{math.sqrt(misfit.chi2_per_dof):.3g} sigma"


def noise_size(result: IdentificationResult) -> str:
    """What the noise alone would give, in the same measure as the misfit."""
    readings = result.data.readings
    p = np.array([r.quantity.startswith("position_") for r in readings])
    if np.any(p):
        markers = {(r.step, r.location) for r in readings if r.quantity.startswith("position_")}
        return f"{1e3 * math.sqrt(float(np.sum(result.sigma[p] ** 2)) / len(markers)):.3g} mm"
    a = np.array([r.unit == "rad" for r in readings])
    if np.any(a):
        return f"{math.degrees(float(np.sqrt(np.mean(result.sigma[a] ** 2)))):.3g} degrees"
    return "1 sigma"


def sentences(result: IdentificationResult) -> list[str]:
    """The first screen as text."""
    told = [
        f"The robot as declared misses the measurement by {_size(result.before_fit)} on average."
        if not result.effects
        else f"The robot as declared misses the measurement by {_size(result.before_fit)} on average; with what was "
        f"added, by {_size(result.after_fit)}. The noise of the measurement alone is {noise_size(result)}."
    ]
    if not result.effects:
        told[0] += f" The noise of the measurement alone is {noise_size(result)}."
    if result.held_out_steps and result.effects:
        told.append(
            f"{len(result.held_out_steps)} of {len(result.data.steps)} steps, whole branches of the loading, were kept "
            f"aside and not used for fitting. On them the error falls from {_size(result.before_held_out)} to "
            f"{_size(result.after_held_out)}: the model predicts what it has not seen."
            if result.after_held_out.chi2_per_dof < 0.5 * result.before_held_out.chi2_per_dof
            else f"On steps that were not used for fitting the error goes from {_size(result.before_held_out)} to "
            f"{_size(result.after_held_out)}."
        )
    for e in result.effects:
        if e.indistinguishable_from:
            others = " or ".join(n.replace("_", " ") for n in e.indistinguishable_from)
            told.append(
                f"These data cannot tell {e.name.replace('_', ' ')} from {others}, which would explain them about as "
                "well. What to measure to tell them apart stands below."
            )
    if result.verdict in ("partly explained", "unexplained"):
        # What is known of the place; the size of the moment and the tests stand below.
        first = result.remaining.description.split("; ")[0]
        plain = (
            first
            if first.startswith("not on the list") or not result.remaining.where.startswith("bay")
            else ""
        )
        told.append(f"What remains: {plain or 'it is largest in ' + result.remaining.where}.")
    if result.data.left_out:
        told.append(f"{len(result.data.left_out)} bad rows were left out; they are named below.")
    if result.outliers:
        told.append(f"{len(result.outliers)} single readings stand out; they are named below.")
    if result.interrupted:
        told.append("The search was interrupted; this is what was found until then.")
    return told


def summary(result: IdentificationResult) -> str:
    """The verdict and the effects with their numbers, as plain text."""
    lines = [headline(result), *sentences(result)]
    for e in result.effects:
        for name, p in e.parameters.items():
            error = f" +- {1.96 * p.std_error:.2g}" if p.std_error is not None else ""
            lines.append(
                f"    {e.name}.{name} = {p.value:.5g}{error} {p.unit} {f'({p.note})' if p.note else ''}".rstrip()
            )
    return "\n".join(lines)


# ------------------------------------------------------------------------------------------------- pictures


def _svg(figure: Figure) -> str:
    buffer = io.StringIO()
    figure.savefig(buffer, format="svg", bbox_inches="tight", metadata={"Date": None, "Creator": None})
    text = buffer.getvalue()
    return text[text.index("<svg") :]


def _axes(width: float = 8.0, height: float = 2.8) -> tuple[Figure, Any]:
    figure = Figure(figsize=(width, height), layout="constrained")
    axes = figure.subplots()
    axes.grid(True, color="#ddd", linewidth=0.6)
    axes.spines[["top", "right"]].set_visible(False)
    return figure, axes


def _decades(axes: Any) -> None:
    """A logarithmic axis of at least two decades, so that scatter does not look like structure."""
    axes.set_yscale("log")
    low, high = axes.get_ylim()
    middle = math.sqrt(low * high)
    axes.set_ylim(min(low, middle / 10.0), max(high, middle * 10.0))


def _main_unit(result: IdentificationResult) -> tuple[NDArray[np.bool_], float, str]:
    """Readings that the pictures show: positions where there are any, else the most frequent unit."""
    units = np.array([r.unit for r in result.data.readings])
    p = np.array([r.quantity.startswith("position_") for r in result.data.readings])
    if np.any(p):
        return p, 1e3, "mm"
    unit = max(set(units.tolist()), key=lambda u: int(np.sum(units == u)))
    return units == unit, *SHOWN[unit]


def _rms_by(groups: Sequence[Any], values: Array) -> tuple[list[Any], Array]:
    keys = list(dict.fromkeys(groups))
    g = np.array([keys.index(x) for x in groups])
    return keys, np.sqrt(np.bincount(g, values**2) / np.bincount(g))


def _by_step(result: IdentificationResult) -> str:
    mask, factor, unit = _main_unit(result)
    position = {n: k for k, n in enumerate(result.data.step_ids)}
    steps = [result.data.readings[i].step for i in np.flatnonzero(mask)]
    figure, axes = _axes()
    for n in result.held_out_steps:
        axes.axvspan(position[n] - 0.5, position[n] + 0.5, color=HELD, linewidth=0)
    for r, color, label in (
        (result.residual_before, BEFORE, "declared"),
        (result.residual_after, AFTER, "with what was added"),
    ):
        keys, size = _rms_by(steps, r[mask] * factor)
        axes.plot(
            [position[k] for k in keys], size, "o-", color=color, markersize=3.5, linewidth=1.2, label=label
        )
    axes.axhline(
        float(np.sqrt(np.mean(result.sigma[mask] ** 2))) * factor, color="#555", linestyle=":", label="noise"
    )
    _decades(axes)
    ids = result.data.step_ids
    ticks = range(0, len(ids), max(1, len(ids) // 20))
    axes.set_xticks(list(ticks), [str(ids[k]) for k in ticks])
    axes.set_xlabel("load step (shaded: held out)")
    axes.set_ylabel(f"error, rms of a reading [{unit}]")
    axes.legend(frameon=False, ncols=3, loc="upper center", bbox_to_anchor=(0.5, 1.18))
    return _svg(figure)


def _along(result: IdentificationResult) -> str:
    mask, factor, unit = _main_unit(result)
    places = [result.data.readings[i].location for i in np.flatnonzero(mask)]
    if not all(isinstance(p, float) for p in places) or len(set(places)) < 2:
        return ""
    figure, axes = _axes(3.9)
    for r, color in ((result.residual_before, BEFORE), (result.residual_after, AFTER)):
        keys, size = _rms_by(places, r[mask] * factor)
        order = np.argsort(keys)
        axes.plot(1e3 * np.array(keys)[order], size[order], "o-", color=color, markersize=4)
    _decades(axes)
    axes.set_xlabel("place along the backbone [mm]")
    axes.set_ylabel(f"error, rms [{unit}]")
    return _svg(figure)


def _over_input(result: IdentificationResult) -> str:
    """Error over the largest input, loading and unloading apart, loaded tips apart."""
    mask, factor, unit = _main_unit(result)
    data = result.data
    position = {n: k for k, n in enumerate(data.step_ids)}
    k = np.array([position[data.readings[i].step] for i in np.flatnonzero(mask)])
    driven = data.driven_by_displacement
    size = np.array(
        [
            max((abs(v) for v in (s.displacements if driven else s.tensions).values()), default=0.0)
            for s in data.steps
        ]
    )
    moves = directions(data)[:, : len(data.robot.tendons)]
    leading = np.array([np.sign(m[np.argmax(np.abs(m))]) if np.any(m) else 0 for m in moves])
    if not driven:
        tensions = np.array([[s.tensions.get(n, 0.0) for n in data.robot.tendon_names] for s in data.steps])
        main = tensions.argmax(axis=1)
        leading = moves[np.arange(len(main)), main]
    loaded = np.array([any(any(x.force) for x in s.loads.values()) for s in data.steps])
    figure = Figure(figsize=(8.0, 2.8), layout="constrained")
    axes = figure.subplots(1, 2, sharey=True)
    for ax, r, title, color in (
        (axes[0], result.residual_before, "declared", BEFORE),
        (axes[1], result.residual_after, "with what was added", AFTER),
    ):
        keys, rms = _rms_by(k.tolist(), r[mask] * factor)
        for sign, marker, label in ((1, "^", "loading"), (-1, "v", "unloading"), (0, "s", "tendons held")):
            for tip, fill in ((False, color), (True, "white")):
                chosen = [i for i, q in enumerate(keys) if leading[q] == sign and loaded[q] == tip]
                if chosen:
                    x = size[[keys[i] for i in chosen]] * (1e3 if driven else 1.0)
                    ax.plot(x, rms[chosen], marker, color=color, markerfacecolor=fill, markersize=5, linestyle="",
                            label=label + (", tip loaded" if tip else ""))  # fmt: skip
        ax.set_title(title, fontsize=10)
        ax.grid(True, color="#ddd", linewidth=0.6)
        ax.spines[["top", "right"]].set_visible(False)
        ax.set_xlabel("largest displacement [mm]" if driven else "largest tension [N]")
    _decades(axes[0])
    axes[0].set_ylabel(f"error, rms [{unit}]")
    axes[0].legend(frameon=False, fontsize=7)
    return _svg(figure)


def _moment(result: IdentificationResult) -> str:
    rest = result.remaining
    if rest.moment is None or rest.bays is None:
        return ""
    size = 1e3 * np.sqrt(np.sum(rest.moment**2, axis=2)).T
    figure, axes = _axes(8.0, 3.0)
    axes.grid(False)
    edges = np.arange(size.shape[1] + 1) - 0.5
    mesh = axes.pcolormesh(edges, 1e3 * rest.bays, size, cmap="magma_r")
    figure.colorbar(mesh, ax=axes, label="missing moment [N mm]")
    ids = result.data.step_ids
    ticks = range(0, len(ids), max(1, len(ids) // 20))
    axes.set_xticks(list(ticks), [str(ids[k]) for k in ticks])
    axes.set_xlabel("load step")
    axes.set_ylabel("place along the backbone [mm]")
    return _svg(figure)


# ---------------------------------------------------------------------------------------------------- page


def render(result: IdentificationResult) -> str:
    """The whole page."""
    place = files("tdcr_fe.identify") / "report.html.j2"
    environment = jinja2.Environment(
        autoescape=True, undefined=jinja2.StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    template = environment.from_string(place.read_text(encoding="utf-8"))
    readings = result.data.readings
    svg = {
        name: Markup(draw(result))
        for name, draw in {
            "steps": _by_step,
            "along": _along,
            "input": _over_input,
            "moment": _moment,
        }.items()
    }
    robot = result.data.robot
    candidates = sorted(result.candidates, key=lambda c: (c.round, c.model, -c.drop))
    standing = [
        {
            "line": readings[i].line,
            "step": readings[i].step,
            "quantity": readings[i].quantity,
            "location": "" if readings[i].location is None else readings[i].location,
            "value": f"{readings[i].value:.6g} {QUANTITIES[readings[i].quantity][1]}",
            "sigma": f"{r:+.1f}",
        }
        for i, r in result.outliers
    ]
    return template.render(
        result=result,
        headline=headline(result),
        sentences=sentences(result),
        svg=svg,
        effects=[(e, effect(e.name)) for e in result.effects],
        robot=robot,
        model=result.data.model,
        candidates=[c for c in candidates if c.drop > 0.5 or c.fitted],
        outliers=standing,
        size=_size,
        noise=noise_size(result),
        wide=lambda x: f"{x:.5g}",
        short=lambda x: "" if x is None else f"{x:.3g}",
    )


def write_report(result: IdentificationResult, path: str | os.PathLike[str]) -> None:
    """Write the page."""
    Path(path).write_text(render(result), encoding="utf-8")

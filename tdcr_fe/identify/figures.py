"""Pictures of the report on an identification: measured against predicted, where the error lies, parameters."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping
from statistics import mode
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from tdcr_fe.elements import Array, Flags
from tdcr_fe.identify.noise import series
from tdcr_fe.identify.result import Estimate, IdentificationResult
from tdcr_fe.identify.rows import FEWEST, read_rows
from tdcr_fe.identify.sentences import of_markers
from tdcr_fe.report.environment import shown_unit, words
from tdcr_fe.report.style import CORRECTED, DECLARED, HELD_OUT, MEASURED, logarithmic, styled

#: Pairs of parameters with a correlation above this size are drawn, and so many of them and of the profiles [1].
HARDLY_SEPARATE, SHOWN = 0.8, 4


def _drawn(result: IdentificationResult, before: Array, after: Array) -> list[tuple[Array, str, str]]:
    """What is drawn of the declared and of the corrected model, with colour and label; of one where they coincide."""
    if not result.effects:
        return [(before, DECLARED, "declared model; nothing was added")]
    return [(before, DECLARED, "declared model"), (after, CORRECTED, "corrected model")]


# --------------------------------------------------------------------------------- measured against predicted


def comparison(result: IdentificationResult) -> Figure:
    """Tip path, shapes and a loop of loading and unloading: measured, and predicted before and after.

    Without position readings, the readings of the most frequent quantity over the load steps.
    """
    drawers = [_tip_path, _shape_lines, _loop] if np.isfinite(result.shapes.measured).any() else [_readings]
    with styled():
        figure = Figure(figsize=(11.6, 3.7), layout="constrained")
        for ax, draw in zip(figure.subplots(1, len(drawers), squeeze=False)[0], drawers, strict=True):
            ax.set_visible(draw(ax, result))
        fills = {"measured": MEASURED} | ({"measured, held out": "white"} if result.held_out_steps else {})
        drawn = _drawn(result, result.shapes.before, result.shapes.after)
        handles = [
            *(Line2D([], [], color=MEASURED, marker="o", ms=4, mfc=c, ls="none", label=t) for t, c in fills.items()),
            *(Line2D([], [], color=c, lw=1.5, label=t) for _, c, t in drawn),
        ]  # fmt: skip
        figure.legend(handles=handles, loc="outside lower center", ncols=2)
    return figure


def _tip(result: IdentificationResult) -> tuple[Array, Array, Array]:
    """Measured, declared and corrected positions of the marker next to the tip [mm], shape (n_steps, 3) each.

    Zero along axes that are not measured, as where a camera looks from the side.
    """
    s, seen = result.shapes, _measured_axes(result)
    last = int(np.argmax(np.where(np.isfinite(s.measured).any(axis=(0, 2)), s.arc_lengths, -np.inf)))
    measured, before, after = (np.where(seen, 1e3 * x[:, last], 0.0) for x in (s.measured, s.before, s.after))
    return measured, before, after


def _measured_axes(result: IdentificationResult) -> Flags:
    """Axes along which positions are measured, shape (3,)."""
    return np.asarray(np.isfinite(result.shapes.measured).any(axis=(0, 1)))


def _dots(axes: Axes, points: Array, held_out: Flags) -> None:
    """Measured points, shape (n, 2)."""
    for chosen, fill in ((~held_out, MEASURED), (held_out, "white")):
        axes.plot(*points[chosen].T, "o", ms=3.8, mec=MEASURED, mfc=fill, mew=0.9, zorder=4)


def _tip_path(axes: Axes, result: IdentificationResult) -> bool:
    """The path of the marker next to the tip, from above, or from the side where it stays in an upright plane."""
    measured, before, after = _tip(result)
    known = measured[np.isfinite(measured).all(axis=1)]
    if len(known) < 2:
        return False
    across = np.linalg.svd(known[:, :2] - known[:, :2].mean(axis=0))[2]
    spread = np.ptp(known[:, :2] @ across.T, axis=0)
    flat = spread[1] < 0.08 * spread[0] and _measured_axes(result)[2]
    towards = across[0] * (np.sign(across[0][int(np.argmax(np.abs(across[0])))]) or 1.0)
    project = np.array([[*towards, 0.0], [0.0, 0.0, 1.0]]) if flat else np.eye(3)[:2]
    for path, colour, _ in _drawn(result, before, after):
        axes.plot(*(path @ project.T).T, "x-", color=colour, lw=0.8, ms=3)
    _dots(axes, measured @ project.T, result.shapes.held_out)
    axes.set_aspect("equal", adjustable="datalim")
    angle = float(np.degrees(np.arctan2(towards[1], towards[0])))
    axes.set_title("Path of the tip, from the side" if flat else "Path of the tip, from above")
    axes.set_xlabel(f"horizontal, at {angle:.0f} deg from x [mm]" if flat else "x [mm]")
    axes.set_ylabel("z [mm]" if flat else "y [mm]")
    return True


def _shape_lines(axes: Axes, result: IdentificationResult) -> bool:
    """The shape in the step that bends most, and in the held-out step that bends most, each in its own plane."""
    s, tips, axes_seen = result.shapes, _tip(result)[0], _measured_axes(result)
    offset = np.linalg.norm(tips[:, :2], axis=1)
    if not np.isfinite(offset).any() or not axes_seen[2]:
        return False
    steps = [int(np.nanargmax(offset))]
    other = np.where(s.held_out & ~s.held_out[steps[0]], offset, np.nan)
    if np.isfinite(other).any():
        steps.append(int(np.nanargmax(other)))
    for side, k in zip((1.0, -1.0), steps, strict=False):
        across = side * tips[k, :2] / max(float(offset[k]), 1e-9)

        def seen(points: Array, across: Array = across) -> Array:
            return 1e3 * np.column_stack((points[:, :2] @ across, points[:, 2]))

        for backbone, colour, _ in _drawn(result, s.backbone_before[k], s.backbone_after[k]):
            axes.plot(*seen(backbone).T, color=colour, lw=1.4)
        for markers, colour, _ in _drawn(result, s.before[k], s.after[k]):  # they may be off the backbone
            axes.plot(*seen(markers).T, "x", color=colour, ms=4)
        _dots(axes, seen(np.where(axes_seen, s.measured[k], 0.0)), np.full(len(s.arc_lengths), s.held_out[k]))
        axes.annotate(f"step {result.data.step_ids[k]}", (side * float(offset[k]), float(tips[k, 2])),
                      xytext=(0, 9), textcoords="offset points", ha="center", fontsize=8,
                      bbox={"fc": "white", "ec": "none", "alpha": 0.7, "pad": 1})  # fmt: skip
    axes.set_aspect("equal", adjustable="datalim")
    axes.margins(x=0.15, y=0.1)
    sides = "distance from the z axis [mm]" if len(steps) == 1 else "distance, to either side [mm]"
    axes.set(title="Shape, in the plane of the tip", xlabel=sides, ylabel="z [mm]")
    return True


def _inputs(result: IdentificationResult) -> tuple[Array, str]:
    """Commanded tensions [N] or displacements [mm], shape (n_steps, n_tendons), and their unit."""
    data = result.data
    driven = data.driven_by_displacement
    inputs = [s.displacements if driven else s.tensions for s in data.steps]
    values = np.array([[own.get(n, 0.0) for n in data.robot.tendon_names] for own in inputs])
    return (1e3 * values, "mm") if driven else (values, "N")


def loop(result: IdentificationResult) -> tuple[int, range] | None:
    """The longest run of steps in which the inputs go along one line and back under the same loads.

    Returns
    -------
    (int, range) or None
        Number of the tendon whose input changes most, and the steps.
    """
    values, _ = _inputs(result)
    loads = [tuple(load.force for load in s.loads.values()) for s in result.data.steps]
    same = 0.02 * max(float(np.ptp(values)) if values.size else 0.0, 1e-12)
    found: tuple[int, range] | None = None
    begin = 0
    while values.size and begin < len(values) - 1:
        end = begin + 2
        while end < len(values) and loads[end] == loads[begin]:
            path = values[begin : end + 1] - values[begin]
            if np.any(np.linalg.svd(path, compute_uv=False)[1:] > same):
                break
            end += 1
        j = int(np.argmax(np.ptp(values[begin:end], axis=0)))
        change = np.diff(values[begin:end, j])
        longest = FEWEST - 1 if found is None else len(found[1])
        if end - begin > longest and np.any(change > same) and np.any(change < -same):
            found = j, range(begin, end)
        begin = end - 1
    return found


def _loop(axes: Axes, result: IdentificationResult) -> bool:
    """Travel of the tip over the input of one tendon that is pulled and released."""
    longest = loop(result)
    if longest is None:
        return False
    j, steps = longest[0], np.array(longest[1])
    measured, before, after = (tips[steps] for tips in _tip(result))
    known = np.isfinite(measured).all(axis=1)
    if np.count_nonzero(known) < FEWEST:
        return False
    start = measured[known][0]
    path = measured[known] - start
    along = np.linalg.svd(path, full_matrices=False)[2][0]
    along = along * np.sign(path[int(np.argmax(np.linalg.norm(path, axis=1)))] @ along)
    values, unit = _inputs(result)
    x = values[steps, j]
    for tips, colour, _ in _drawn(result, before, after):
        axes.plot(x, (tips - start) @ along, color=colour, lw=1.3)
    _dots(axes, np.column_stack((x, (measured - start) @ along)), result.shapes.held_out[steps])
    ids, name = result.data.step_ids, result.data.robot.tendon_names[j]
    axes.set_title(f"Loading and unloading, steps {ids[steps[0]]} to {ids[steps[-1]]}")
    axes.set_xlabel(f"{'displacement' if unit == 'mm' else 'tension'} of {name} [{unit}]")
    axes.set_ylabel("travel of the tip [mm]")
    return True


def _readings(axes: Axes, result: IdentificationResult) -> bool:
    """Readings of the most frequent quantity over the steps."""
    chosen = max(series(result.data.readings), key=len)
    value = np.array([result.data.readings[i].value for i in chosen])
    first, k = result.data.readings[chosen[0]], read_rows(result.data)[chosen]
    factor, symbol = shown_unit(first.unit, float(np.max(np.abs(value))))
    for residual, colour, _ in _drawn(result, result.residuals.before, result.residuals.after):
        axes.plot(k, factor * (value - residual[chosen]), color=colour, lw=1.3)
    _dots(axes, np.column_stack((k, factor * value)), result.shapes.held_out[k])
    _step_axis(axes, result)
    where = "" if first.location is None else f", {first.location}"
    axes.set_ylabel(f"{first.quantity.replace('_', ' ')}{where} [{symbol}]")
    return True


def _step_axis(axes: Axes, result: IdentificationResult) -> None:
    ids = result.data.step_ids
    ticks = range(0, len(ids), max(1, len(ids) // 20))
    axes.set_xticks(list(ticks), [str(ids[k]) for k in ticks])
    axes.set_xlabel("load step")


# ----------------------------------------------------------------------------------------- where the error lies


def where_error_is(result: IdentificationResult) -> Figure:
    """Error in every load step and, where two places on the backbone were measured, along it; before and after.

    The error of a marker is the distance in space where positions were measured [mm]; without positions it is the error
    of a reading of the most frequent unit.
    """
    readings, left = result.data.readings, result.residuals
    space = [i for i, r in enumerate(readings) if r.quantity.startswith("position_")]
    unit = mode(r.unit for r in readings)
    chosen = np.array(space or [i for i, r in enumerate(readings) if r.unit == unit])
    factor, symbol = (1e3, "mm") if space else shown_unit(unit, float(np.max(np.abs(left.before[chosen]))))
    groups: dict[str, Any] = {"load step": read_rows(result.data)[chosen]}
    # the squares of the coordinates of a marker add up to that of its distance
    coordinates = len({readings[i].quantity for i in space}) or 1
    places = [readings[i].location for i in chosen]
    if all(isinstance(x, float) for x in places) and len(set(places)) > 1:
        groups["arc length s [mm]"] = [1e3 * float(x or 0.0) for x in places]
    lines = [*_drawn(result, left.before, left.after), (left.sigma, MEASURED, "noise")]
    with styled():
        figure = Figure(figsize=(11.6, 2.9), layout="constrained")
        axes = figure.subplots(1, len(groups), squeeze=False, width_ratios=(2, 1)[: len(groups)])[0]
        for n in result.held_out_steps:
            k = result.data.step_ids.index(n)
            axes[0].axvspan(k - 0.5, k + 0.5, color=HELD_OUT, linewidth=0)
        for ax, (label, group) in zip(axes, groups.items(), strict=True):
            x, number = np.unique(group, return_inverse=True)
            each = np.bincount(number) / coordinates
            for residual, colour, text in lines:
                rms = np.sqrt(np.bincount(number, residual[chosen] ** 2) / each)
                style = ":" if text == "noise" else "o-"
                ax.plot(x, factor * rms, style, color=colour, ms=3.5, lw=1.2, label=text)
            logarithmic(ax)
            ax.set_xlabel(label)
        _step_axis(axes[0], result)
        axes[0].set_ylabel(f"rms {of_markers(result) or 'error'} [{symbol}]")
        handles, labels = axes[0].get_legend_handles_labels()
        if result.held_out_steps:
            handles, labels = [*handles, Patch(color=HELD_OUT)], [*labels, "held out"]
        figure.legend(handles, labels, loc="outside upper center", ncols=4)
    return figure


# -------------------------------------------------------------------------------------------------- parameters


def parameters(result: IdentificationResult) -> Figure | None:
    """Profiles of the parameters, and 95 % regions of pairs that the data hardly separate; None without profiles."""
    shown = result.parameters.profiles[:SHOWN]
    if not shown:
        return None
    estimates = {f"{e.form or e.name}.{n}": p for e in result.effects for n, p in e.parameters.items()}
    pairs = result.parameters.correlated(HARDLY_SEPARATE)[:SHOWN]
    with styled():
        rows, columns = 2 if pairs else 1, max(len(shown), len(pairs))
        figure = Figure(figsize=(min(11.6, 3.9 * columns), 2.8 * rows), layout="constrained")
        axes: Any = figure.subplots(rows, columns, squeeze=False)
        for ax, profile in zip(axes[0], shown, strict=False):
            factor, label = _axis(profile.name, estimates)
            fine = np.linspace(profile.values[0], profile.values[-1], 81)
            ax.plot(factor * fine, np.interp(fine, profile.values, profile.roots) ** 2, color=CORRECTED)
            ax.plot(factor * profile.values, profile.roots**2, "o", color=CORRECTED, ms=4)
            for end in profile.interval:
                ax.axvline(factor * end, color=MEASURED, ls=":", lw=1.0)
            ax.set(xlabel=label, title="" if profile.is_normal else "not normally distributed")
        axes[0, 0].set_ylabel("growth of chi-square")
        angle = np.linspace(0.0, 2.0 * np.pi, 73)
        for ax, (correlation, a, b) in zip(axes[-1], pairs, strict=False):
            turned = np.array([np.cos(angle), np.cos(angle - np.arccos(correlation))]) * np.sqrt(5.99)
            (x, across), (y, up) = _axis(a, estimates), _axis(b, estimates)
            values = np.array([x * estimates[a].value, y * estimates[b].value])
            errors = np.array([x * (estimates[a].std_error or 0.0), y * (estimates[b].std_error or 0.0)])
            ax.plot(*(values[:, None] + errors[:, None] * turned), color=CORRECTED)
            ax.plot(*values, "o", color=CORRECTED, ms=4)
            ax.set(xlabel=across, ylabel=up)
        for ax in axes.ravel():
            ax.set_visible(ax.has_data())
    return figure


def _axis(name: str, estimates: Mapping[str, Estimate]) -> tuple[float, str]:
    """Factor with which a parameter is drawn, and its label with the unit."""
    factor, symbol = shown_unit(estimates[name].unit, 0.0)
    return factor, textwrap.fill(words(name) + (f" [{symbol}]" if symbol else ""), 40)

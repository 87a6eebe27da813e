"""Pictures of the report on an identification: measured against predicted, and where the error lies."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from numpy.typing import NDArray

from tdcr_fe.identify.load_steps import directions
from tdcr_fe.identify.result import Estimate, IdentificationResult
from tdcr_fe.identify.statistics import correlated
from tdcr_fe.report.environment import shown_unit
from tdcr_fe.report.style import CORRECTED, DECLARED, HELD_OUT, MEASURED, logarithmic, styled

Array = NDArray[np.float64]

#: A run of steps shows a loop where it has at least as many.
_LOOP_STEPS = 4

#: Pairs of parameters with a correlation above this size are drawn, and so many of them and of the profiles [1].
HARDLY_SEPARATE, SHOWN = 0.8, 4


# --------------------------------------------------------------------------------- measured against predicted


def comparison(result: IdentificationResult) -> Figure:
    """Tip path, shapes and a loop of loading and unloading: measured, and predicted before and after.

    Without position readings, the readings of the most frequent quantity over the load steps.
    """
    drawers = [_tip_path, _shape_lines, _loop] if np.isfinite(result.shapes.measured).any() else [_readings]
    with styled():
        figure = Figure(figsize=(11.6, 3.7), layout="constrained")
        axes = figure.subplots(1, len(drawers), squeeze=False)[0]
        for ax, draw in zip(axes, drawers, strict=True):
            if not draw(ax, result):
                ax.set_visible(False)
        handles = [
            Line2D([], [], color=MEASURED, marker="o", ms=4, ls="none", label="measured"),
            Line2D(
                [], [], color=MEASURED, marker="o", ms=4, mfc="white", ls="none", label="measured, held out"
            ),
            *(Line2D([], [], color=c, lw=1.5, label=text) for _, c, text in _models(result)),
        ]
        if not result.held_out_steps:
            del handles[1]
        figure.legend(handles=handles, loc="outside lower center", ncols=2)
    return figure


def _tip(result: IdentificationResult) -> tuple[Array, Array, Array]:
    """Measured, declared and corrected positions of the marker next to the tip [mm], shape (n_steps, 3) each."""
    s = result.shapes
    last = int(np.argmax(np.where(np.isfinite(s.measured).any(axis=(0, 2)), s.arc_lengths, -np.inf)))
    return 1e3 * s.measured[:, last], 1e3 * s.before[:, last], 1e3 * s.after[:, last]


def _dots(axes: Axes, x: Array, y: Array, held_out: NDArray[np.bool_]) -> None:
    for chosen, fill in ((~held_out, MEASURED), (held_out, "white")):
        axes.plot(x[chosen], y[chosen], "o", ms=3.8, mec=MEASURED, mfc=fill, mew=0.9, zorder=4)


def _tip_path(axes: Axes, result: IdentificationResult) -> bool:
    """The path of the marker next to the tip, from above, or from the side where it stays in an upright plane."""
    measured, before, after = _tip(result)
    known = measured[np.isfinite(measured).all(axis=1)]
    if len(known) < 2:
        return False
    across = np.linalg.svd(known[:, :2] - known[:, :2].mean(axis=0))[2]
    spread = np.ptp(known[:, :2] @ across.T, axis=0)
    flat = spread[1] < 0.08 * spread[0]
    towards = across[0] * (np.sign(across[0][int(np.argmax(np.abs(across[0])))]) or 1.0)
    if flat:
        project = np.array([[*towards, 0.0], [0.0, 0.0, 1.0]])
        angle = float(np.degrees(np.arctan2(towards[1], towards[0])))
        axes.set_xlabel(f"horizontal, at {angle:.0f} deg from x [mm]")
    else:
        project = np.eye(3)[:2]
        axes.set_xlabel("x [mm]")
    for path, colour in _drawn(result, before, after):
        for steps in _runs(result):
            axes.plot(
                *(path[steps] @ project.T).T,
                "-" if len(steps) > 1 else "x",
                color=colour,
                lw=1.1,
                ms=4,
                alpha=0.9,
            )
    if all(len(steps) == 1 for steps in _runs(result)):
        _connect(axes, measured @ project.T, after @ project.T)
    x, y = (measured @ project.T).T
    _dots(axes, x, y, result.shapes.held_out)
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_title("Path of the tip, from the side" if flat else "Path of the tip, from above")
    axes.set_ylabel("z [mm]" if flat else "y [mm]")
    return True


def _runs(result: IdentificationResult) -> list[list[int]]:
    """Positions of the steps of each branch; all of them where branches have no names."""
    found: dict[str, list[int]] = {}
    for k, name in enumerate(result.data.branches):
        found.setdefault(name, []).append(k)
    return list(found.values()) or [list(range(len(result.data.step_ids)))]


def _connect(axes: Axes, measured: Array, predicted: Array) -> None:
    """Thin lines from measured points to predicted ones, shape (n, 2) each."""
    ends = np.stack((measured, predicted, np.full_like(measured, np.nan)), axis=1).reshape(-1, 2)
    axes.plot(*ends.T, color="0.6", lw=0.7, zorder=1)


def _shape_lines(axes: Axes, result: IdentificationResult) -> bool:
    """The shape in the step that bends most, and in the held-out step that bends most, each in its own plane."""
    s = result.shapes
    offset = np.linalg.norm(_tip(result)[0][:, :2], axis=1)
    if not np.isfinite(offset).any():
        return False
    steps = [int(np.nanargmax(offset))]
    other = np.where(s.held_out & ~s.held_out[steps[0]], offset, np.nan)
    if np.isfinite(other).any():
        steps.append(int(np.nanargmax(other)))
    for side, k in zip((1.0, -1.0), steps, strict=False):
        tip = _tip(result)[0][k, :2]
        across = tip / max(float(np.linalg.norm(tip)), 1e-9)
        for backbone, colour in _drawn(result, s.backbone_before[k], s.backbone_after[k]):
            axes.plot(side * 1e3 * backbone[:, :2] @ across, 1e3 * backbone[:, 2], color=colour, lw=1.4)
        measured, before, after = (
            np.column_stack((side * 1e3 * x[k][:, :2] @ across, 1e3 * x[k][:, 2]))
            for x in (s.measured, s.before, s.after)
        )
        if _beside_backbone(result):  # then the lines do not pass through the markers
            for markers, colour in _drawn(result, before, after):
                axes.plot(*markers.T, "x", color=colour, ms=4)
            _connect(axes, measured, after)
        _dots(axes, measured[:, 0], measured[:, 1], np.full(len(measured), s.held_out[k]))
        axes.annotate(f"step {result.data.step_ids[k]}", (side * float(tip @ across), float(_tip(result)[0][k, 2])),
                      xytext=(0, 7), textcoords="offset points", ha="center", fontsize=8)  # fmt: skip
    axes.set_aspect("equal", adjustable="datalim")
    axes.margins(y=0.1)
    axes.set_title("Shape, in the plane of the tip")
    axes.set_xlabel("distance from the z axis [mm]" if len(steps) == 1 else "distance, to either side [mm]")
    axes.set_ylabel("z [mm]")
    return True


def _beside_backbone(result: IdentificationResult) -> bool:
    """Whether predicted markers are off the predicted backbone, by more than a hundredth of its length."""
    s = result.shapes
    far = 0.0
    for markers, backbone in zip(s.after, s.backbone_after, strict=True):
        gap = np.linalg.norm(markers[:, None] - backbone[None], axis=2).min(axis=1)
        far = max(far, float(np.max(gap, initial=0.0, where=np.isfinite(gap))))
    spacing = result.data.robot.backbone.length / max(1, s.backbone_after.shape[1] - 1)
    return far > 0.01 * result.data.robot.backbone.length + 0.5 * spacing


def _inputs(result: IdentificationResult) -> tuple[Array, str]:
    """Commanded tensions [N] or displacements [mm], shape (n_steps, n_tendons), and their unit."""
    data = result.data
    driven = data.driven_by_displacement
    values = [
        [(s.displacements if driven else s.tensions).get(n, 0.0) for n in data.robot.tendon_names]
        for s in data.steps
    ]
    return np.array(values).reshape(len(data.steps), -1) * (1e3 if driven else 1.0), "mm" if driven else "N"


def loops(result: IdentificationResult) -> list[tuple[int, range]]:
    """Runs of steps in which the inputs go along one line and back under the same loads, the longest first.

    Returns
    -------
    list of (int, range)
        Number of the tendon whose input changes most, and the steps.
    """
    values, _ = _inputs(result)
    loads = [tuple(load.force for load in s.loads.values()) for s in result.data.steps]
    same = 0.02 * max(float(np.ptp(values)) if values.size else 0.0, 1e-12)
    found: list[tuple[int, range]] = []
    begin = 0
    while begin < len(values) - 1:
        end = begin + 2
        while (
            end < len(values) and loads[end] == loads[begin] and _off_a_line(values[begin : end + 1]) <= same
        ):
            end += 1
        j = int(np.argmax(np.ptp(values[begin:end], axis=0)))
        change = np.diff(values[begin:end, j])
        if end - begin >= _LOOP_STEPS and np.any(change > same) and np.any(change < -same):
            found.append((j, range(begin, end)))
        begin = end - 1
    return sorted(found, key=lambda x: -len(x[1]))


def _off_a_line(points: Array) -> float:
    """Largest distance of points from the line through the first and the farthest, shape (n, k)."""
    path = points - points[0]
    far = path[int(np.argmax(np.linalg.norm(path, axis=1)))]
    length = float(np.linalg.norm(far))
    if length == 0.0:
        return 0.0
    return float(np.max(np.linalg.norm(path - np.outer(path @ far, far) / length**2, axis=1)))


def _loop(axes: Axes, result: IdentificationResult) -> bool:
    """Travel of the tip over the input of one tendon that is pulled and released."""
    measured, before, after = _tip(result)
    for j, steps in loops(result):
        chosen = np.array(steps)
        points = measured[chosen]
        if np.isfinite(points).all(axis=1).sum() < _LOOP_STEPS:
            continue
        start = points[np.isfinite(points).all(axis=1)][0]
        path = np.nan_to_num(points - start)
        along = np.linalg.svd(path, full_matrices=False)[2][0]
        along = along * np.sign(path[int(np.argmax(np.linalg.norm(path, axis=1)))] @ along)
        values, unit = _inputs(result)
        x = values[chosen, j]
        for tips, colour in _drawn(result, before, after):
            axes.plot(x, (tips[chosen] - start) @ along, color=colour, lw=1.3)
        _dots(axes, x, (points - start) @ along, result.shapes.held_out[chosen])
        name = result.data.robot.tendon_names[j]
        ids = result.data.step_ids
        axes.set_title(f"Loading and unloading, steps {ids[steps[0]]} to {ids[steps[-1]]}")
        axes.set_xlabel(f"{'displacement' if unit == 'mm' else 'tension'} of {name} [{unit}]")
        axes.set_ylabel("travel of the tip [mm]")
        return True
    return False


def _readings(axes: Axes, result: IdentificationResult) -> bool:
    """Readings of the most frequent quantity over the steps."""
    keys = [(r.quantity, r.location) for r in result.data.readings]
    key = max(dict.fromkeys(keys), key=keys.count)
    mask = np.array([k == key for k in keys])
    value = np.array([r.value for r in result.data.readings])
    unit = next(r.unit for r, m in zip(result.data.readings, mask, strict=True) if m)
    factor, symbol = shown_unit(unit, float(np.max(np.abs(value[mask]))))
    position = {n: k for k, n in enumerate(result.data.step_ids)}
    k = np.array([position[r.step] for r, m in zip(result.data.readings, mask, strict=True) if m])
    for residual, colour in _drawn(result, result.residual_before, result.residual_after):
        axes.plot(k, factor * (value - residual)[mask], color=colour, lw=1.3)
    _dots(axes, k, factor * value[mask], result.shapes.held_out[k])
    _step_axis(axes, result)
    where = "" if key[1] is None else f", {key[1]}"
    axes.set_ylabel(f"{key[0].replace('_', ' ')}{where} [{symbol}]")
    return True


# ----------------------------------------------------------------------------------------- where the error lies


def _errors(result: IdentificationResult, residual: Array) -> tuple[list[int], Array, str]:
    """Readings by marker and step: index of a reading of each, its error, and the unit.

    The error of a marker is the distance in space where positions were measured [mm]; without positions it is the
    error of a reading of the most frequent unit.
    """
    readings = result.data.readings
    space = [i for i, r in enumerate(readings) if r.quantity.startswith("position_")]
    if space:
        groups: dict[Any, list[int]] = {}
        for i in space:
            groups.setdefault((readings[i].step, readings[i].location), []).append(i)
        size = np.array([np.sqrt(np.sum(residual[g] ** 2)) for g in groups.values()])
        return [g[0] for g in groups.values()], size * 1e3, "mm"
    units = [r.unit for r in readings]
    unit = max(dict.fromkeys(units), key=units.count)
    chosen = [i for i, u in enumerate(units) if u == unit]
    factor, symbol = shown_unit(unit, float(np.max(np.abs(residual[chosen]), initial=0.0)) or 1.0)
    return chosen, np.abs(residual[chosen]) * factor, symbol


def _noise(result: IdentificationResult) -> float:
    """Noise in the measure of `_errors` of the declared model."""
    if result.noise.rms_position is not None:
        return 1e3 * result.noise.rms_position
    chosen, _, _ = _errors(result, result.residual_before)
    unit = result.data.readings[chosen[0]].unit
    factor, _ = shown_unit(unit, float(np.max(np.abs(result.residual_before[chosen]), initial=0.0)) or 1.0)
    return float(np.sqrt(np.mean(result.sigma[chosen] ** 2))) * factor


def _rms_by(groups: Sequence[Any], values: Array) -> tuple[list[Any], Array]:
    keys = list(dict.fromkeys(groups))
    g = np.array([keys.index(x) for x in groups])
    return keys, np.sqrt(np.bincount(g, values**2) / np.bincount(g))


def _label(result: IdentificationResult, unit: str) -> str:
    return (
        f"rms distance in space [{unit}]" if result.noise.rms_position is not None else f"rms error [{unit}]"
    )


def _models(result: IdentificationResult) -> list[tuple[Array, str, str]]:
    """Residual, colour and label of the declared and of the corrected model; of one where nothing was added."""
    both = _drawn(result, result.residual_before, result.residual_after)
    labels = ["declared model", "corrected model"] if len(both) > 1 else ["declared model; nothing was added"]
    return [(residual, colour, text) for (residual, colour), text in zip(both, labels, strict=True)]


def _drawn(result: IdentificationResult, before: Array, after: Array) -> list[tuple[Array, str]]:
    """What is drawn of the declared and the corrected model, with its colour; the former alone where they coincide."""
    changed = bool(result.effects) or result.law is not None
    return [(before, DECLARED), (after, CORRECTED)] if changed else [(before, DECLARED)]


def _step_axis(axes: Axes, result: IdentificationResult) -> None:
    ids = result.data.step_ids
    ticks = range(0, len(ids), max(1, len(ids) // 20))
    axes.set_xticks(list(ticks), [str(ids[k]) for k in ticks])
    axes.set_xlabel("load step")


def by_step(result: IdentificationResult) -> Figure:
    """Error in every load step, before and after."""
    position = {n: k for k, n in enumerate(result.data.step_ids)}
    with styled():
        figure = Figure(figsize=(11.6, 2.9), layout="constrained")
        axes = figure.subplots()
        for n in result.held_out_steps:
            axes.axvspan(position[n] - 0.5, position[n] + 0.5, color=HELD_OUT, linewidth=0)
        unit = ""
        for residual, colour, label in _models(result):
            chosen, size, unit = _errors(result, residual)
            keys, rms = _rms_by([result.data.readings[i].step for i in chosen], size)
            axes.plot([position[k] for k in keys], rms, "o-", color=colour, ms=3.5, lw=1.2, label=label)
        axes.axhline(_noise(result), color=MEASURED, ls=":", lw=1.0, label="noise")
        logarithmic(axes)
        _step_axis(axes, result)
        axes.set_ylabel(_label(result, unit))
        handles, labels = axes.get_legend_handles_labels()
        if result.held_out_steps:
            handles, labels = [*handles, Patch(color=HELD_OUT)], [*labels, "held out"]
        figure.legend(handles, labels, loc="outside upper center", ncols=4)
    return figure


def along(result: IdentificationResult) -> Figure | None:
    """Error over the arc length; None where fewer than two locations on the backbone were measured."""
    chosen, _, _ = _errors(result, result.residual_before)
    s = [result.data.readings[i].location for i in chosen]
    if not all(isinstance(x, float) for x in s) or len(set(s)) < 2:
        return None
    with styled():
        figure = Figure(figsize=(5.4, 2.9), layout="constrained")
        axes = figure.subplots()
        unit = ""
        for residual, colour, label in _models(result):
            _, size, unit = _errors(result, residual)
            keys, rms = _rms_by(s, size)
            order = np.argsort(keys)
            axes.plot(1e3 * np.array(keys)[order], rms[order], "o-", color=colour, ms=4, label=label)
        axes.axhline(_noise(result), color=MEASURED, ls=":", lw=1.0, label="noise")
        logarithmic(axes)
        axes.set_xlabel("arc length s [mm]")
        axes.set_ylabel(_label(result, unit))
        figure.legend(loc="outside upper center", ncols=3)
    return figure


def over_input(result: IdentificationResult) -> Figure:
    """Error over the largest input: loading and unloading, tip loaded or not."""
    data = result.data
    position = {n: k for k, n in enumerate(data.step_ids)}
    values, unit_in = _inputs(result)
    size_in = np.max(np.abs(values), axis=1, initial=0.0)
    moves = directions(data)[:, : len(data.robot.tendons)]
    main = np.argmax(np.abs(moves) if data.driven_by_displacement else values, axis=1)
    leading = np.sign(moves[np.arange(len(main)), main])
    loaded = np.array([any(any(x.force) for x in s.loads.values()) for s in data.steps])
    with styled():
        figure = Figure(figsize=(11.6, 3.1), layout="constrained")
        models = _models(result)
        axes = figure.subplots(1, len(models), sharey=True, squeeze=False)[0]
        unit = ""
        for ax, (residual, colour, title) in zip(axes, models, strict=True):
            chosen, size, unit = _errors(result, residual)
            keys, rms = _rms_by([position[data.readings[i].step] for i in chosen], size)
            for sign, marker in ((1, "^"), (-1, "v"), (0, "s")):
                for tip, fill in ((False, colour), (True, "white")):
                    at = [i for i, q in enumerate(keys) if leading[q] == sign and loaded[q] == tip]
                    ax.plot(
                        size_in[[keys[i] for i in at]], rms[at], marker, color=colour, mfc=fill, ms=5, ls=""
                    )
            ax.set_title(title)
            ax.set_xlabel(f"largest {'displacement' if unit_in == 'mm' else 'tension'} [{unit_in}]")
        logarithmic(axes[0])
        axes[0].set_ylabel(_label(result, unit))
        texts = {"^": "loading", "v": "unloading", "s": "tendons constant"}
        handles = [Line2D([], [], color=MEASURED, marker=m, ms=5, ls="", label=t) for m, t in texts.items()]
        handles.append(
            Line2D([], [], color=MEASURED, marker="o", mfc="white", ms=5, ls="", label="open: tip loaded")
        )
        figure.legend(handles=handles, loc="outside lower center", ncols=4)
    return figure


# -------------------------------------------------------------------------------------------------- parameters


def parameters(result: IdentificationResult) -> Figure | None:
    """Profiles of the parameters, and 95 % regions of pairs that the data hardly separate; None without profiles."""
    shown = result.profiles[:SHOWN]
    if not shown:
        return None
    estimates = {f"{e.form or e.name}.{n}": p for e in result.effects for n, p in e.parameters.items()}
    pairs = correlated(result, HARDLY_SEPARATE)[:SHOWN]
    with styled():
        rows = 2 if pairs else 1
        figure = Figure(figsize=(11.6, 2.8 * rows), layout="constrained")
        axes = figure.subplots(rows, max(len(shown), len(pairs)), squeeze=False)
        for ax in axes.ravel():
            ax.set_visible(False)
        for ax, profile in zip(axes[0], shown, strict=False):
            ax.set_visible(True)
            fine = np.linspace(profile.values[0], profile.values[-1], 81)
            ax.plot(fine, np.interp(fine, profile.values, profile.roots) ** 2, color=CORRECTED)
            ax.plot(profile.values, profile.roots**2, "o", color=CORRECTED, ms=4)
            for end in profile.interval:
                ax.axvline(end, color=MEASURED, ls=":", lw=1.0)
            ax.set_xlabel(_axis(profile.name, estimates))
            ax.set_title("" if profile.is_normal else "not normally distributed")
        axes[0, 0].set_ylabel("growth of chi-square")
        angle = np.linspace(0.0, 2.0 * np.pi, 73)
        for ax, (correlation, a, b) in zip(axes[-1], pairs, strict=False):
            ax.set_visible(True)
            first, second = estimates[a], estimates[b]
            along = np.array([np.cos(angle), np.cos(angle - np.arccos(correlation))]) * np.sqrt(5.99)
            ax.plot(
                first.value + (first.std_error or 0.0) * along[0],
                second.value + (second.std_error or 0.0) * along[1],
                color=CORRECTED,
            )
            ax.plot(first.value, second.value, "o", color=CORRECTED, ms=4)
            ax.set_xlabel(_axis(a, estimates))
            ax.set_ylabel(_axis(b, estimates))
    return figure


def _axis(name: str, estimates: Mapping[str, Estimate]) -> str:
    _, symbol = shown_unit(estimates[name].unit, 0.0)
    return name.replace("_", " ") if symbol == "1" else f"{name.replace('_', ' ')} [{symbol}]"

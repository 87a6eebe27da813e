"""The 3D panel of a robot over its load steps: a part of a report, or a page of its own, without further files.

Its data are a motion as JSON with quantised arrays, small enough for one HTML file.
"""

from __future__ import annotations

import base64
from dataclasses import replace
from typing import Any, Literal

import numpy as np
from markupsafe import Markup
from numpy.typing import NDArray

from tdcr_fe.elements import Array, Index
from tdcr_fe.model.messages import count
from tdcr_fe.report.environment import environment
from tdcr_fe.report.motion import Motion, nearest, spread

#: Number of poses (sections times load steps) in one page; more are thinned out.
POSES = 80_000
#: Number of sections that are always kept where there are as many.
SECTIONS = 400
#: Stored numbers run from 0 to this; the number above it stands for a missing value.
LEVELS = 65534
#: A tendon is slack where its tension is below this part of the largest tension of the run [1].
SLACK = 1e-6
#: Codes of the hole states.
STATES = ("stick", "pull", "release", "anchor", "slack")


def quantised(values: Array) -> dict[str, Any]:
    """An array as whole numbers of 16 bits between the smallest and the largest value of each column.

    The error is at most half of the range over `LEVELS`.

    Parameters
    ----------
    values
        Any shape; the last axis are the columns. NaN is a missing value.

    Returns
    -------
    dict
        ``shape``, ``low`` and ``step`` by column, and ``data``: little-endian, base64.
    """
    values = np.asarray(values, dtype=float)
    columns = values.reshape(-1, values.shape[-1]) if values.size else np.zeros((0, values.shape[-1]))
    known = np.isfinite(columns)
    low = np.min(columns, axis=0, initial=np.inf, where=known)
    high = np.max(columns, axis=0, initial=-np.inf, where=known)
    low = np.where(np.isfinite(low), low, 0.0)
    step = np.where(np.isfinite(high), high - low, 0.0) / LEVELS
    levels = np.rint((np.where(known, columns, low) - low) / np.where(step > 0.0, step, 1.0))
    stored = np.where(known, levels, LEVELS + 1).astype("<u2")
    return {
        "shape": list(values.shape),
        "low": low.tolist(),
        "step": step.tolist(),
        "data": base64.b64encode(stored.tobytes()).decode(),
    }


def thinned(motion: Motion, poses: int = POSES) -> Motion:
    """The motion with so few sections and load steps that a page can hold it; the same where it is small.

    Nodes within bays are left out first, then load steps; the first and the last step stay.
    """
    if len(motion.s) * len(motion.steps) <= poses:
        return motion
    loaded = nearest(motion.s, [load.at for loads in motion.loads for load in loads.values()])
    required = np.unique(
        np.concatenate([[0, len(motion.s) - 1], loaded, motion.disks, *(t.frames for t in motion.tendons)])
    ).astype(np.intp)
    others = np.setdiff1d(np.arange(len(motion.s)), required)
    room = max(0, max(SECTIONS, poses // len(motion.steps)) - len(required))
    kept = np.union1d(required, others[spread(len(others), room)] if room and len(others) else [])
    motion = _sections(motion, kept.astype(np.intp))
    return motion.at_steps(spread(len(motion.steps), max(2, poses // len(motion.s))))


def _sections(motion: Motion, kept: Index) -> Motion:
    place = np.zeros(len(motion.s), dtype=np.intp)
    place[kept] = np.arange(len(kept))
    return replace(
        motion,
        s=motion.s[kept],
        radius=motion.radius[kept],
        positions=motion.positions[:, kept],
        rotations=motion.rotations[:, kept],
        disks=place[motion.disks],
        tendons=tuple(replace(t, frames=place[t.frames]) for t in motion.tendons),
    )


def hole_codes(motion: Motion) -> list[NDArray[np.uint8]]:
    """By tendon, the code of the state of the hole at the far end of every segment, shape (n_steps, n_segments).

    A hole is slack where neither of the segments that meet there carries tension.
    """
    codes = []
    for tensions, states in zip(motion.tensions, motion.hole_states, strict=True):
        code = np.select([states == name for name in STATES], np.arange(len(STATES), dtype=np.uint8))
        loose = tensions <= SLACK * motion.largest_tension
        code[:, :-1][loose[:, :-1] & loose[:, 1:]] = STATES.index("slack")
        codes.append(code)
    return codes


def _loads(motion: Motion, step: int) -> list[dict[str, Any]]:
    """Loads of a step as the page draws them."""
    ellipsoids = motion.ellipsoids[step] if motion.ellipsoids else {}
    found = []
    for name, place, vector, moment in motion.load_arrows(step):
        axes = [_short(axis) for axis in ellipsoids.get(name, ())] if not moment else []
        arrow = {"name": name, "at": _short(place), "vector": _short(vector), "moment": moment}
        found.append({**arrow, "ellipsoid": axes})
    return found


def _short(vector: Array) -> list[float]:
    """Numbers to seven digits of the largest."""
    size = float(np.max(np.abs(vector), initial=0.0)) or 1.0
    return [float(f"{size * round(float(x) / size, 7):.7g}") for x in vector]


def panel_data(motion: Motion) -> dict[str, Any]:
    """All that the script of the panel draws, as JSON.

    Returns
    -------
    dict
        Lengths in m, forces in N; arrays as `quantised` gives them, hole states one byte each.
    """
    total = len(motion.steps)
    motion = thinned(motion)
    codes = hole_codes(motion)
    count = len(motion.steps)
    flat = np.concatenate([np.zeros((count, 0)), *motion.tensions], axis=1)
    states = np.concatenate([np.zeros((count, 0), dtype=np.uint8), *codes], axis=1)
    data: dict[str, Any] = {
        "name": motion.name,
        "length": motion.length,
        "steps": list(motion.steps),
        "labels": [motion.label(k) for k in range(len(motion.steps))],
        "stepsInAll": total,
        "s": np.round(motion.s, 9).tolist(),
        "radius": motion.radius.tolist(),
        "position": quantised(motion.positions),
        "rotation": quantised(motion.rotations),
        "disks": {
            "at": motion.disks.tolist(),
            "radius": motion.disk_radius,
            "thickness": motion.disk_thickness,
        },
        "tendons": [
            {
                "name": t.name,
                "at": t.frames.tolist(),
                "points": t.points.round(9).tolist(),
                "segments": t.segments.tolist(),
                "count": int(tension.shape[1]),
            }
            for t, tension in zip(motion.tendons, motion.tensions, strict=True)
        ],
        "tension": quantised(flat[..., None]),
        "state": base64.b64encode(states.tobytes()).decode() if motion.friction else "",
        "baseTension": quantised(motion.base_tensions),
        "displacement": quantised(motion.displacements),
        "byDisplacement": motion.driven_by_displacement.any(axis=0).tolist(),
        "bending": np.degrees(motion.bending_angles).round(4).tolist(),
        "loads": [_loads(motion, k) for k in range(count)],
        "gravity": motion.gravity.tolist(),
        "markers": None,
    }
    if (given := motion.markers) is not None:
        drawn = {"measured": quantised(motion.drawn_markers), "declared": quantised(given.declared)}
        data["markers"] = {"s": given.s.tolist(), **drawn}
    return data


# --------------------------------------------------------------------------------------------------------- the panel

#: Direction of view: lifted, turned off the normal of the bending plane, and turned where nothing bends [rad].
LIFT, OFF_PLANE, UNBENT = 0.32, 0.3, -0.96
#: Size of the picture [pixels] and margin [1].
WIDTH, HEIGHT, MARGIN = 640, 560, 0.06


def panel(motion: Motion, extent: Literal["part", "whole"] = "part") -> Markup:
    """The panel as a part of an HTML page whose template is told that it ``has_panel``.

    Parameters
    ----------
    motion
        What is drawn.
    extent
        Whether it is part of a page or the whole of it; only then it hears all keys and has links to its views.
    """
    template = environment().get_template("viewer.html.j2")
    return Markup(template.render(extent=extent, data=panel_data(motion), still=still(motion)))


def summary(motion: Motion) -> str:
    """The motion in a few words, for titles."""
    parts = {"load step": motion.steps, "disk": motion.disks, "tendon": motion.tendons}
    return ", ".join(count(len(every), noun) for noun, every in parts.items())


def view_page(motion: Motion) -> str:
    """One HTML page with the panel alone; it needs no server and no network."""
    template, whole = environment().get_template("viewer_page.html.j2"), panel(motion, "whole")
    return template.render(name=motion.name, summary=summary(motion), panel=whole, has_panel=True)


# ---------------------------------------------------------------- still picture


def _view(tip: Array, length: float) -> Array:
    """Rows to the right and up in the picture, and towards the eye, as the panel begins; shape (3, 3)."""
    bent = np.hypot(tip[0], tip[1]) >= 0.02 * length
    turn = np.arctan2(tip[1], tip[0]) - np.pi / 2.0 + OFF_PLANE if bent else UNBENT
    c, s = np.cos(LIFT), np.sin(LIFT)
    towards = np.array([c * np.cos(turn), c * np.sin(turn), s])
    right = np.array([-np.sin(turn), np.cos(turn), 0.0])
    return np.stack((right, np.cross(towards, right), towards))


def _svg_path(points: Array) -> str:
    return "M" + "L".join(f"{x:.1f} {y:.1f}" for x, y in points)


def still(motion: Motion) -> dict[str, Any]:
    """Backbone, disks, tendons and measured markers in the load step that bends the tip most, as paths of an SVG."""
    k = int(np.argmax(motion.bending_angles))
    view, plate = _view(motion.tips[k], motion.length), motion.plate
    rims, curve = motion.rims(k), motion.curve(k)
    tendons = [motion.tendon_points(k, t) for t in motion.tendons]
    markers = motion.drawn_markers[k]
    everything = np.concatenate([curve, plate, *rims, *tendons]) @ view[:2].T
    low, high = everything.min(axis=0), everything.max(axis=0)
    scale = float(np.min((1.0 - 2.0 * MARGIN) * np.array([WIDTH, HEIGHT]) / np.maximum(high - low, 1e-12)))

    def flat(points: Array) -> Array:
        centred = (points @ view[:2].T - (low + high) / 2.0) * scale
        return np.asarray(np.array([WIDTH, HEIGHT]) / 2.0 + centred * [1.0, -1.0])

    depth = [float(rim.mean(axis=0) @ view[2]) for rim in rims]
    known = markers[np.isfinite(markers).all(axis=1)]
    title = f"step {motion.steps[k]}" + (f": {label}" if (label := motion.label(k)) else "")
    return {
        "size": (WIDTH, HEIGHT),
        "text": f"{motion.name}, {title}",
        "plate": _svg_path(flat(plate)),
        "disks": [_svg_path(flat(rims[i])) for i in np.argsort(depth)],
        "backbone": _svg_path(flat(curve)),
        "width": max(1.5, 2.0 * float(motion.radius.max()) * scale),
        "tendons": [_svg_path(flat(t)) for t in tendons],
        "markers": flat(known).tolist(),
    }

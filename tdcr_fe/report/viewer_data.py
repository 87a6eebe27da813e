"""The data of the 3D panel: a motion as JSON with quantised arrays, small enough for one HTML file."""

from __future__ import annotations

import base64
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tdcr_fe.elements import Array, Index
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

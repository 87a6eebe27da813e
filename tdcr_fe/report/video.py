"""A video of a motion: the robot in 3D beside its response, drawn by matplotlib, as GIF or MP4."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.animation import AbstractMovieWriter, FFMpegWriter, PillowWriter
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d.art3d import Line3DCollection, Poly3DCollection  # type: ignore[import-untyped]

from tdcr_fe.elements import Array
from tdcr_fe.report.motion import MM, Motion, between
from tdcr_fe.report.plots import FORCE, LONGEST, MOMENT
from tdcr_fe.report.style import COLOURS, HEAT, INK, PALE, SOFT, space, styled

#: Kinds of files, by ending.
KINDS = (".gif", ".mp4")
#: Pictures a second, and the number of pictures that a short sequence is filled up to.
RATE, AT_LEAST = 12, 60
#: Pictures at most from one load step to the next.
PER_STEP = 6
#: Size [inch] and resolution [1/inch].
SIZE, DPI = (9.6, 5.0), 100


def problem(path: Path) -> str:
    """Why no video can be written to that path; empty where it can."""
    if path.suffix.lower() not in KINDS:
        return "must end in .gif or .mp4"
    if path.suffix.lower() == ".mp4" and shutil.which("ffmpeg") is None:
        return "needs the program ffmpeg, which is not installed; install it, or write a .gif"
    return ""


def times(count: int) -> Array:
    """Times of the pictures, in load steps from 0: every step, and some between where there are few steps."""
    if count < 2:
        return np.zeros(1)
    per_step = int(np.clip(-(-AT_LEAST // (count - 1)), 1, PER_STEP))
    return np.linspace(0.0, count - 1.0, per_step * (count - 1) + 1)


class _Drawing:
    """The figure of a video, and what changes from picture to picture."""

    def __init__(self, motion: Motion) -> None:
        self.motion = motion
        self.largest = motion.largest_tension or 1.0
        self.largest_loads = motion.largest_loads(range(len(motion.steps)))
        self.figure = Figure(figsize=SIZE, dpi=DPI)
        self.space: Any = self.figure.add_axes((0.0, 0.05, 0.62, 0.88), projection="3d")
        response = self.figure.add_axes((0.69, 0.13, 0.29, 0.66))
        self.title = self.figure.text(0.02, 0.95, "", weight="bold", size=11, va="center")
        self.response, label = self._response()
        self.dot = self._plot_response(response, label)
        self._box()
        if motion.tendons:
            bar = self.figure.add_axes((0.72, 0.93, 0.24, 0.018))
            mappable = ScalarMappable(Normalize(0.0, self.largest), HEAT)
            self.figure.colorbar(mappable, cax=bar, orientation="horizontal", label="tension [N]")
        self.moving: list[Any] = []

    def _box(self) -> None:
        m, plate = self.motion, MM * self.motion.plate
        points = np.concatenate([MM * m.positions.reshape(-1, 3), plate])
        low, high = points.min(axis=0), points.max(axis=0)
        half = np.maximum(high - low, 0.2 * float(np.max(high - low))) / 2.0
        space(self.space, np.stack(((low + high) / 2.0 - half, (low + high) / 2.0 + half), axis=1), "mm")
        self.space.plot(*(MM * m.tips).T, color=PALE, lw=0.8)
        self.space.add_collection3d(Poly3DCollection([plate], facecolor="#8b95a1"))

    def _response(self) -> tuple[Array, str]:
        """The input that changes most and the bending angle in degrees, shape (steps, 2); the input's label."""
        m, angle = self.motion, np.degrees(self.motion.bending_angles)
        x, label, most = np.array(m.steps, dtype=float), "load step", 0.0
        for (_, values, text), by_displacement in zip(m.inputs(), m.driven_by_displacement.T, strict=True):
            change = float(np.ptp(values)) / (MM * m.length if by_displacement.any() else self.largest)
            if change > most:
                most, x, label = change, values, text
        return np.column_stack((x, angle)), label

    def _plot_response(self, axes: Axes, label: str) -> Any:
        """Bending angle over the input of a label, with a dot for the present time, which is given back."""
        x, angle = self.response.T
        axes.plot(x, angle, color=SOFT, lw=1.0)
        axes.set_xlabel(label)
        axes.set_ylabel("bending angle of the tip [deg]")
        return axes.plot([x[0]], [angle[0]], "o", color=COLOURS[0], ms=8)[0]

    def show(self, time: float) -> None:
        """Draw the robot at a time, in load steps from 0."""
        for artist in self.moving:
            artist.remove()
        m, step = between(self.motion, time), round(time)
        label = f": {label}" if (label := self.motion.label(step)) else ""
        self.title.set_text(f"{m.name}, step {self.motion.steps[step]} of {self.motion.steps[-1]}{label}")
        at = range(len(self.response))
        self.dot.set_data(*([np.interp(time, at, values)] for values in self.response.T))
        parts: list[Any] = [self.space.plot(*(MM * m.curve(0)).T, color=INK, lw=2.2)[0]]
        if len(m.disks):
            look: dict[str, Any] = {"facecolor": (0.75, 0.78, 0.82, 0.7), "edgecolor": SOFT, "lw": 0.4}
            parts.append(self.space.add_collection3d(Poly3DCollection(list(MM * m.rims(0)), **look)))
        for tendon, tensions in zip(m.tendons, m.tensions, strict=True):
            corners = MM * m.tendon_points(0, tendon)
            sides = np.stack((corners[:-1], corners[1:]), axis=1)
            colours = HEAT(tensions[0, tendon.segments] / self.largest)
            parts.append(self.space.add_collection3d(Line3DCollection(list(sides), colors=colours, lw=1.6)))
        for _, place, vector, moment in m.load_arrows(0):
            scaled = LONGEST * MM * m.length / self.largest_loads[moment] * vector
            parts.append(self.space.quiver(*(MM * place), *scaled, color=MOMENT if moment else FORCE, lw=1.6))
        self.moving = parts


def write_video(motion: Motion, path: str | Path, progress: Callable[[float], None] | None = None) -> Path:
    """Write a video of the motion; between load steps it is interpolated.

    Parameters
    ----------
    motion
        What is drawn.
    path
        Ends in ``.gif`` or ``.mp4``; the latter needs the program ffmpeg.
    progress
        Called with the fraction done after every picture.

    Raises
    ------
    ValueError
        No video can be written to that path; see `problem`.
    """
    path = Path(path)
    reason = problem(path)
    if reason:
        raise ValueError(f"{path}: {reason}")
    gif = path.suffix.lower() == ".gif"
    writer: AbstractMovieWriter = PillowWriter(fps=RATE) if gif else FFMpegWriter(fps=RATE, bitrate=2400)
    partial = path.with_name(f".{path.stem}.partial{path.suffix}")
    path.parent.mkdir(parents=True, exist_ok=True)
    try:
        with styled():
            drawing = _Drawing(motion)
            chosen = times(len(motion.steps))
            with writer.saving(drawing.figure, str(partial), DPI):
                for i, time in enumerate(chosen):
                    drawing.show(float(time))
                    writer.grab_frame(facecolor="white")
                    if progress is not None:
                        progress((i + 1) / len(chosen))
        partial.replace(path)
    finally:
        partial.unlink(missing_ok=True)
    return path

"""The 3D panel of a robot over its load steps: a part of a report, or a page of its own, without further files."""

from __future__ import annotations

import json
from typing import Literal

import numpy as np
from markupsafe import Markup

from tdcr_fe.elements import Array
from tdcr_fe.model.messages import count
from tdcr_fe.report.environment import environment
from tdcr_fe.report.motion import Motion
from tdcr_fe.report.viewer_data import panel_data

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
    text = json.dumps(panel_data(motion), ensure_ascii=False, allow_nan=False, separators=(",", ":"))
    data, template = Markup(text.replace("<", "\\u003c")), environment().get_template("viewer.html.j2")
    return Markup(template.render(name=motion.name, extent=extent, data=data, still=Markup(still(motion))))


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


def _svg_path(points: Array, closed: bool = False) -> str:
    text = "L".join(f"{x:.1f} {y:.1f}" for x, y in points)
    return f"M{text}{'Z' if closed else ''}"


def still(motion: Motion) -> str:
    """Backbone, disks, tendons and measured markers in the load step that bends the tip most, as SVG text."""
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

    width = max(1.5, 2.0 * float(motion.radius.max()) * scale)
    depth = [float(rim.mean(axis=0) @ view[2]) for rim in rims]
    disk, line = 'fill="#dfe3e7" fill-opacity="0.8" stroke="#8b95a1"', 'fill="none" stroke'
    parts = [f'<path d="{_svg_path(flat(plate), True)}" fill="#8b95a1"/>']
    parts += [f'<path d="{_svg_path(flat(rims[i]), True)}" {disk}/>' for i in np.argsort(depth)]
    parts += [f'<path d="{_svg_path(flat(curve))}" {line}="#3d4957" stroke-width="{width:.1f}"/>']
    parts += [f'<path d="{_svg_path(flat(t))}" {line}="#c2334a" stroke-width="1.3"/>' for t in tendons]
    known = markers[np.isfinite(markers).all(axis=1)]
    parts += [f'<circle cx="{x:.1f}" cy="{y:.1f}" r="4" fill="#009e6b"/>' for x, y in flat(known)]
    title = f"step {motion.steps[k]}" + (f": {label}" if (label := motion.label(k)) else "")
    text = f"{motion.name}, {title}".replace("&", "&amp;").replace("<", "&lt;").replace('"', "&quot;")
    head = f'<svg viewBox="0 0 {WIDTH} {HEIGHT}" width="{WIDTH}" height="{HEIGHT}" role="img" aria-label="{text}">'
    return f"{head}{''.join(parts)}</svg><small>{text}</small>"

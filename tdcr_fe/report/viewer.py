"""The 3D panel of a robot over its load steps: a part of a report, or a page of its own, without further files."""

from __future__ import annotations

import json
from typing import Literal

from markupsafe import Markup

from tdcr_fe.report.environment import environment
from tdcr_fe.report.motion import Motion
from tdcr_fe.report.viewer_data import panel_data
from tdcr_fe.report.viewer_still import still

#: Parts of the script, in the order in which they refer to each other.
SCRIPTS = ("viewer_data.js", "viewer_gl.js", "viewer_scene.js", "viewer_plots.js", "viewer.js")


def _text(name: str) -> str:
    return environment().get_template(name).render()


def style() -> Markup:
    """Style sheet of the panel, once a page."""
    return Markup(_text("viewer.css"))


def script() -> Markup:
    """Script of the panel, once a page; its names are visible to itself only."""
    return Markup("(() => {\n" + "\n".join(_text(name) for name in SCRIPTS) + "\n})();")


def panel(
    motion: Motion,
    theme: Literal["auto", "light", "dark"] = "light",
    extent: Literal["part", "whole"] = "part",
) -> Markup:
    """The panel as a part of an HTML page that contains `style` and `script`.

    Parameters
    ----------
    motion
        What is drawn.
    theme
        "auto" follows the reader's system.
    extent
        Whether it is part of a page or the whole of it; only then it hears all keys and has a switch of the theme.
    """
    text = json.dumps(panel_data(motion), ensure_ascii=False, allow_nan=False, separators=(",", ":"))
    return Markup(
        environment()
        .get_template("viewer.html.j2")
        .render(
            name=motion.name,
            theme=theme,
            extent=extent,
            data=Markup(text.replace("<", "\\u003c")),
            still=Markup(still(motion)),
        )
    )


def summary(motion: Motion) -> str:
    """The motion in a few words, for titles."""
    count, disks, tendons = len(motion.steps), len(motion.disks), len(motion.tendons)
    parts = [(count, "load step"), (disks, "disk"), (tendons, "tendon")]
    return ", ".join(f"{n} {noun}{'' if n == 1 else 's'}" for n, noun in parts)


def view_page(motion: Motion) -> str:
    """One HTML page with the panel alone; it needs no server and no network."""
    return (
        environment()
        .get_template("viewer_page.html.j2")
        .render(
            name=motion.name,
            summary=summary(motion),
            css=style(),
            panel=panel(motion, "auto", "whole"),
            script=script(),
        )
    )

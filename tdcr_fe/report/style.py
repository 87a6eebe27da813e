"""The style of all figures: colours, settings of matplotlib, and figures as SVG text."""

from __future__ import annotations

import io
import math
import re
from contextlib import AbstractContextManager
from importlib.resources import files
from typing import Any

import numpy as np
from matplotlib import colormaps, rc_context, rc_params_from_file
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from tdcr_fe.elements import Array

#: Text and main lines; labels and secondary text; frames.
INK, SOFT, PALE = "#1f2933", "#56626f", "#b8c0c8"
BAD = "#c0392b"
#: Distinguishable for colour-blind readers, too (Okabe and Ito, yellow replaced by a darker one).
COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#b8860b", "#56b4e9")
#: One colour for the same thing in every report.
MEASURED, DECLARED, CORRECTED = INK, COLOURS[1], COLOURS[0]
#: Colours of tensions; without the yellow end, which is invisible on white and, inverted, on black.
HEAT = ListedColormap(colormaps["plasma"](np.linspace(0.0, 0.86, 256)), "heat")
#: Ground of steps that were held out.
HELD_OUT = "#ebe6da"
#: Direction from which views in space are seen [deg].
ELEVATION, AZIMUTH = 22.0, -55.0

#: Settings of matplotlib.
STYLE = rc_params_from_file(str(files("tdcr_fe") / "data" / "figures.mplstyle"), use_default_template=False)


def styled() -> AbstractContextManager[None]:
    """Context in which figures are made and drawn; outside of it the settings of matplotlib are as they were."""
    return rc_context(STYLE)


def svg(figure: Figure) -> str:
    """A figure as SVG text, without the XML declaration; the same text for the same figure."""
    buffer = io.StringIO()
    with styled():
        options = {"bbox_inches": "tight", "pad_inches": 0.04, "metadata": {"Date": None, "Creator": None}}
        figure.savefig(buffer, format="svg", transparent=True, **options)
    text = buffer.getvalue()
    return text[text.index("<svg") :]


def panels(figure: Figure) -> list[tuple[str, float]]:
    """Every column of axes in a figure as SVG text of its own, with its width in pixels; legends come last.

    What a row has at its left end only is repeated, since panels may stand below each other. Colour bars stay beside
    the last column. The layout of the figure is fixed from then on.
    """
    columns: dict[Any, list[Any]] = {}
    first: dict[Any, Axes] = {}
    for ax in figure.axes:
        spec = ax.get_subplotspec()
        if ax.get_label() == "<colorbar>" or spec is None:
            columns[next(reversed(columns))].append(ax)
        elif ax.get_visible():
            columns.setdefault(spec.colspan, []).append(ax)
            start = first.setdefault(spec.rowspan, ax)
            ax.tick_params(labelleft=True)
            ax.set_ylabel(ax.get_ylabel() or start.get_ylabel())
    for legend in figure.legends[:]:  # in a row they would be too small to read on a narrow page
        legend.remove()
        with styled():
            handles: Any = legend.legend_handles
            figure.legend(handles, [t.get_text() for t in legend.get_texts()], ncols=2)
    parts = [*columns.values(), *([legend] for legend in figure.legends)]
    boxes = [box.width / figure.dpi for ax in first.values() if (box := ax.yaxis.get_tightbbox())]
    more = len(columns) * max(boxes, default=0.0) - 0.4 * figure.get_figwidth()  # labels must leave room
    figure.set_figwidth(figure.get_figwidth() + max(more, 0.0))
    with styled():
        figure.draw_without_rendering()
    figure.set_layout_engine("none")
    texts = []
    for part in parts:
        for artist in (artist for other in parts for artist in other):
            artist.set_visible(artist in part)
        text = svg(figure)
        width = re.search(r'width="([\d.]+)pt"', text)
        texts.append((text, 96.0 / 72.0 * float(width[1] if width else 0.0)))
    return texts


def logarithmic(axes: Axes, decades: float = 2.0) -> None:
    """Make the y axis logarithmic and at least ``decades`` high, so that scatter does not look like structure."""
    axes.set_yscale("log")
    axes.yaxis.set_major_formatter("{x:g}")  # that of matplotlib writes formulae
    low, high = axes.get_ylim()
    middle, half = math.sqrt(low * high), 10.0 ** (0.5 * decades)
    axes.set_ylim(min(low, middle / half), max(high, middle * half))


def space(axes: Any, limits: Array, unit: str) -> None:
    """Prepare axes in three dimensions for what lies within limits of shape (3, 2), to scale."""
    span = limits[:, 1] - limits[:, 0]
    for name, ends, width in zip("xyz", limits, span, strict=True):
        getattr(axes, f"set_{name}lim")(*ends)
        getattr(axes, f"set_{name}label")(f"{name} [{unit}]", labelpad=6.0)
        getattr(axes, f"{name}axis").set_major_locator(MaxNLocator(4 if width > 0.6 * span.max() else 2))
        getattr(axes, f"{name}axis").pane.set_facecolor("#fafafa")
    axes.tick_params(pad=1.0, labelsize=8.5)
    axes.set_box_aspect(span, zoom=0.92)
    axes.view_init(elev=ELEVATION, azim=AZIMUTH)

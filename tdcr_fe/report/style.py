"""The style of all figures: colours, settings of matplotlib, and figures as SVG text."""

from __future__ import annotations

import io
import math
from contextlib import AbstractContextManager
from typing import Any

from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure

#: Text and main lines; labels and secondary text; frames; grid lines.
INK, SOFT, PALE, RULE = "#1f2933", "#56626f", "#b8c0c8", "#dfe3e7"
BAD = "#c0392b"
#: Distinguishable for colour-blind readers, too (Okabe and Ito, yellow replaced by a darker one).
COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#b8860b", "#56b4e9")
#: One colour for the same thing in every report.
MEASURED, DECLARED, CORRECTED, REFERENCE = INK, COLOURS[1], COLOURS[0], INK
#: Ground of steps that were held out.
HELD_OUT = "#ebe6da"

STYLE: Any = {
    "font.family": "sans-serif",
    "font.sans-serif": ["Helvetica", "Arial", "Liberation Sans", "DejaVu Sans"],
    "font.size": 9.0,
    "axes.titlesize": 9.5,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.labelcolor": SOFT,
    "axes.edgecolor": PALE,
    "axes.linewidth": 0.8,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": RULE,
    "grid.linewidth": 0.6,
    "xtick.color": SOFT,
    "ytick.color": SOFT,
    "text.color": INK,
    "lines.solid_capstyle": "round",
    "legend.frameon": False,
    "legend.fontsize": 8.5,
    "figure.titlesize": 10.5,
    "figure.titleweight": "bold",
    "svg.fonttype": "path",
    # The same figure drawn twice gives the same text.
    "svg.hashsalt": "tdcr-fe",
}


def styled() -> AbstractContextManager[None]:
    """Context in which figures are made and drawn; outside of it the settings of matplotlib are as they were."""
    return rc_context(STYLE)


def svg(figure: Figure) -> str:
    """A figure as SVG text, without the XML declaration; the same text for the same figure."""
    buffer = io.StringIO()
    with styled():
        figure.savefig(
            buffer,
            format="svg",
            bbox_inches="tight",
            pad_inches=0.04,
            metadata={"Date": None, "Creator": None},
        )
    text = buffer.getvalue()
    return text[text.index("<svg") :]


def logarithmic(axes: Axes, decades: float = 2.0) -> None:
    """Make the y axis logarithmic and at least ``decades`` high, so that scatter does not look like structure."""
    axes.set_yscale("log")
    low, high = axes.get_ylim()
    middle, half = math.sqrt(low * high), 10.0 ** (0.5 * decades)
    axes.set_ylim(min(low, middle / half), max(high, middle * half))


def no_axes(axes: Axes) -> None:
    """Hide ticks, grid and frame, for a drawing to scale that carries its own scale bar."""
    axes.set_xticks([])
    axes.set_yticks([])
    axes.grid(visible=False)
    for spine in axes.spines.values():
        spine.set_visible(False)

"""Pictures of a sweep: numbers at the axes are readable whatever their size."""

from __future__ import annotations

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from tdcr_fe.sweeps.figures import _with_prefixes


@pytest.mark.parametrize(
    ("values", "label"),
    [
        ([50e9, 60e9, 70e9], "60 G"),
        ([2e-5, 4e-5, 6e-5], "40 µ"),
        ([0.1, 0.2, 0.3], "0.2"),
        ([1.0, 2.0, 3.0], "2"),
    ],
)
def test_large_and_small_inputs_have_prefixes_and_others_stay(values: list[float], label: str) -> None:
    """Young's modulus had "5.4, 6.0, 6.6" and a 1e10 on the label of the next plot."""
    figure = Figure()
    canvas = FigureCanvasAgg(figure)
    ax = figure.add_subplot()
    ax.plot(values, values)
    ax.set_xticks(values)
    _with_prefixes(ax.xaxis, np.array(values))
    canvas.draw()
    assert ax.get_xticklabels()[1].get_text() == label
    assert ax.xaxis.get_offset_text().get_text() == ""

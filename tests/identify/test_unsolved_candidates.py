"""A candidate whose model is not solved at its start stays as it is."""

from __future__ import annotations

import numpy as np
import pytest

from tdcr_fe.effects import effect
from tdcr_fe.identify.fitting import Race, descend
from tdcr_fe.identify.problem import Fit


def test_a_candidate_that_is_not_solved_is_not_improved():
    """A search among places of a soft robot ended in a LinAlgError of the least squares."""
    unsolved = Fit(
        (effect("gravity"),),
        {"gravity": {"g_x": 0.0, "g_y": 0.0, "g_z": 0.0}},
        np.full(6, np.nan),
        np.inf,
        np.inf,
        np.ones((6, 1)),
        (("gravity", "g_x"),),
        None,  # type: ignore[arg-type]
    )
    with pytest.raises(StopIteration) as done:
        next(descend(None, unsolved, Race()))  # type: ignore[arg-type]
    assert done.value.value is unsolved

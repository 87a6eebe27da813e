"""Effects that touch few of the readings are found in noisy data, too."""

import numpy as np
import pytest
from identify_data import measured, problem_of

from tdcr_fe.effects import effect
from tdcr_fe.identify.fitting import fit
from tdcr_fe.identify.problem import evaluate
from tdcr_fe.identify.screening import screen

SIGMA, OFFSET = 4e-3, 12e-3


def test_the_offset_of_one_marker_is_found_below_a_noise_of_fifty_typical_steps():
    """A typical step, 0.2 mm, changes one of six readings of a step by 0.05 sigma: rms 0.02, which was left out."""
    noisy = problem_of(measured({"marker_offset": {"offset_x_marker_2": OFFSET}}, SIGMA, 4), sigma=SIGMA)
    declared = evaluate(noisy, (), {})
    (each,) = [f for f in effect("marker_offset").forms(noisy.experiment) if f.name.endswith("(each)")]
    (score,), _ = screen(noisy, declared, [each])
    assert score.note == "" and score.drop > 50.0
    found = fit(noisy, [each], score.start.points)
    value = found.values[each.name]["offset_x_marker_2"]
    # Eleven readings of x determine it; the section turns, and shares it with the others.
    assert value == pytest.approx(OFFSET, abs=4.0 * SIGMA / np.sqrt(11.0)) and len(found.free) == 6
    assert declared.cost - found.cost > 50.0

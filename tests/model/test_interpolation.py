"""Positions between nodes and their derivatives."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tdcr_fe.model.interpolation import ElementChange, within_elements, within_elements_change


@pytest.mark.parametrize("angle", [1e-9, 9e-3, 1.1e-2, 0.3, 2.0])
def test_derivatives_within_elements_are_those_of_central_differences(angle):
    """Ends that move and turn, shares that change; on both sides of where the closed forms are series."""
    rng = np.random.default_rng(3)
    m, count, h = 6, 4, 1e-5
    start, end = rng.normal(size=(2, m, 3))
    turn = Rotation.random(m, random_state=1)
    relative = rng.normal(size=(m, 3))
    end_turn = turn * Rotation.from_rotvec(angle * relative / np.linalg.norm(relative, axis=1)[:, None])
    share = np.concatenate(([0.0, 1.0], rng.uniform(size=m - 2)))
    by = ElementChange(*rng.normal(size=(4, m, 3, count)), rng.normal(size=(m, count)))

    def moved(p, x):
        return within_elements(
            start + x * by.start[..., p],
            (Rotation.from_rotvec(x * by.turn[..., p]) * turn).as_matrix(),
            end + x * by.end[..., p],
            (Rotation.from_rotvec(x * by.end_turn[..., p]) * end_turn).as_matrix(),
            share + x * by.share[:, p],
        )

    expected = np.stack([(moved(p, h) - moved(p, -h)) / (2.0 * h) for p in range(count)], axis=-1)
    found = within_elements_change(start, turn.as_matrix(), end, end_turn.as_matrix(), share, by)
    np.testing.assert_allclose(found, expected, rtol=1e-7, atol=1e-7)

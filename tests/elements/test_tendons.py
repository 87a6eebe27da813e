"""Cables from hole to hole: where they lie in holes with clearance."""

import numpy as np
from scipy.spatial.transform import Rotation

from tdcr_fe.elements.tendons import CableGeometry


def test_clearance_shifts_the_tendon_towards_where_it_is_pulled():
    """At a bend the tendon lies at the inner edge of an oversized hole; at base plate and anchor it is not shifted."""
    count, radius, gap = 3, 0.05, 0.2e-3
    angle = 0.4 * np.arange(count + 1)
    p = radius * np.stack((np.sin(angle), 1 - np.cos(angle), 0 * angle), axis=1)
    r = Rotation.from_rotvec(angle[:, None] * [0.0, 0.0, 1.0]).as_matrix()
    offsets = np.zeros((1, count + 1, 3))
    offsets[..., 2] = 1e-3
    mask = np.ones((1, count), bool)
    cable = CableGeometry(offsets, mask, np.array([gap]))
    shift = cable.shifted(p, r) - offsets
    assert np.all(np.abs(shift[0, 1:-1, 1] - gap) < 0.01 * gap)
    assert np.all(shift[0, -1] == 0.0) and np.all(shift[..., 0] == 0.0)
    tight = CableGeometry(offsets, mask).evaluate(p, r).lengths.sum()
    assert cable.evaluate(p, r).lengths.sum() < tight

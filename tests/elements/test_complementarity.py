"""The complementarity solver against an exhaustive search over all active sets."""

from __future__ import annotations

from itertools import product

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from tdcr_fe.elements.complementarity import solve_box


def by_trying(matrix, right):
    """The one active set that satisfies every condition."""
    k = len(right)
    found = []
    for sides in product((-1, 0, 1), repeat=k):
        side = np.array(sides)
        s = side.astype(float)
        free = side == 0
        if free.any():
            s[free] = np.linalg.solve(matrix[np.ix_(free, free)], (right - matrix[:, ~free] @ s[~free])[free])
        w = right - matrix @ s
        if np.all(np.abs(s) <= 1 + 1e-9) and np.all(w[side == 1] >= -1e-9) and np.all(w[side == -1] <= 1e-9):
            found.append(s)
    assert found
    return found


@settings(deadline=None, max_examples=150)
@given(st.integers(1, 5), st.integers(0, 10**6), st.sampled_from([0.05, 0.3, 1.0]))
def test_solution_is_that_of_exhaustive_search(k, seed, skewness):
    """Positive definite, unsymmetric matrices (every such one is a P-matrix), any first guess."""
    rng = np.random.default_rng(seed)
    a, b = rng.normal(size=(k, k)), rng.normal(size=(k, k))
    matrix = a @ a.T + 0.05 * np.eye(k) + skewness * (b - b.T)
    right = matrix @ rng.normal(size=k) * rng.choice([0.1, 1.0, 10.0])
    s, solved = solve_box(matrix, right, rng.choice([-1.0, 0.0, 0.4, 1.0], size=k))
    assert solved
    assert min(np.max(np.abs(s - other)) for other in by_trying(matrix, right)) < 1e-8


def test_a_singular_block_is_reported():
    s, solved = solve_box(np.zeros((2, 2)), np.array([0.1, 0.2]), np.zeros(2))
    assert not solved
    assert np.all(np.isfinite(s)) and np.all(np.abs(s) <= 1.0)

"""The complementarity solver against an exhaustive search over all active sets."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest
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


@settings(deadline=None, max_examples=40)
@given(st.integers(10, 120), st.integers(0, 10**6))
def test_conditions_hold_for_many_holes(k, seed):
    rng = np.random.default_rng(seed)
    a, b = rng.normal(size=(k, k)), rng.normal(size=(k, k))
    matrix = a @ a.T / k + 1e-3 * np.eye(k) + 0.1 * (b - b.T)
    right = matrix @ (2.0 * rng.normal(size=k))
    s, solved = solve_box(matrix, right, np.zeros(k))
    assert solved
    w = right - matrix @ s
    assert np.all(np.abs(s) <= 1.0)
    assert np.all(np.abs(w[np.abs(s) < 1.0 - 1e-9]) < 1e-7)
    assert np.all(w[s >= 1.0] > -1e-7) and np.all(w[s <= -1.0] < 1e-7)


def test_nothing_to_solve():
    s, solved = solve_box(np.zeros((0, 0)), np.zeros(0), np.zeros(0))
    assert solved and s.size == 0


def test_a_singular_block_is_reported():
    s, solved = solve_box(np.zeros((2, 2)), np.array([0.1, 0.2]), np.zeros(2))
    assert not solved
    assert np.all(np.isfinite(s)) and np.all(np.abs(s) <= 1.0)


def test_every_reported_solution_is_one_for_other_matrices_too():
    """Random matrices with minors of both signs: some are reported as unsolved; the others satisfy every condition."""
    rng = np.random.default_rng(0)
    outcomes = []
    for _ in range(300):
        matrix, right = rng.normal(size=(3, 3)), rng.normal(size=3)
        s, solved = solve_box(matrix, right, np.zeros(3))
        outcomes.append(solved)
        assert np.all(np.isfinite(s)) and np.all(np.abs(s) <= 1.0)
        if solved:
            np.testing.assert_allclose(s, np.clip(s + right - matrix @ s, -1.0, 1.0), atol=1e-9)
    assert 0 < sum(outcomes) < len(outcomes)


@pytest.mark.parametrize("k", [1, 8])
def test_a_decoupled_problem_is_a_clip(k):
    right = np.linspace(-3.0, 3.0, k) if k > 1 else np.array([2.0])
    s, _ = solve_box(2.0 * np.eye(k), right, np.zeros(k))
    assert s == pytest.approx(np.clip(right / 2.0, -1.0, 1.0), abs=1e-15)

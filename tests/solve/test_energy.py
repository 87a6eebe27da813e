"""Energy balance: work of actuators and loads against elastic energy and dissipation."""

from __future__ import annotations

import numpy as np
import pytest
from balance import Ledger, capstan_violation, divide, elastic_energy, random_cycles
from robots import BACKBONE, LENGTH, paper, pull, solve, three

from tdcr_fe.model.loading import Load, LoadStep


def test_elastic_energy_of_a_bent_rod_is_that_of_pure_bending():
    """A moment M at the tip stores M^2 L / (2 EI); checks the energy that the tests below rely on."""
    m = 3e-3
    robot = paper()
    step = solve(robot, [LoadStep("", loads={"tip": Load(LENGTH, moment=(0.0, m, 0.0))})]).steps[0]
    assert elastic_energy(robot, step) == pytest.approx(m**2 * LENGTH / (2.0 * BACKBONE.EI), rel=1e-9)


@pytest.mark.integration
@pytest.mark.parametrize("friction", ["none", "per-tendon", "per-hole"])
def test_the_energy_balance_closes_with_order_two_in_the_substeps(friction):
    """Pull to 2 N and release with a tip force: the balance by the trapezoidal rule closes with order two."""
    robot = paper(0.3)
    cycle = [
        LoadStep("", {"t1": 2.0}, loads={"tip": Load(LENGTH, (0.0, 0.03, 0.01))}),
        LoadStep("", {"t1": 0.3}),
        LoadStep("", {"t1": 1.5}, loads={"tip": Load(LENGTH)}),
        LoadStep("", {"t1": 0.0}),
    ]
    gaps, works = [], []
    for parts in (16, 32, 64):
        steps, forces = divide(robot, cycle, parts)
        ledger = Ledger(solve(robot, steps, friction=friction), forces)
        assert np.all(ledger.dissipated >= -1e-9 * abs(ledger.work))
        gaps.append(abs(ledger.gap))
        works.append(ledger.work)
    scale = 0.01  # J, what is stored at 2 N
    assert gaps[-1] < 1e-4 * scale
    if friction == "none":
        assert abs(works[-1]) < 1e-4 * scale
    else:
        assert works[-1] > 0.05 * scale
        assert gaps[-1] < gaps[0]


def test_dissipation_of_a_pull_without_reversal():
    """Sliding in one direction: the dissipation is (T_k - T_k+1) times the slip, summed over holes."""
    robot = paper(0.3)
    steps, forces = divide(robot, pull(2.0), 64)
    ledger = Ledger(solve(robot, steps), forces)
    assert ledger.gap == pytest.approx(0.0, abs=1e-4 * ledger.work)
    # The farther from the base, the less material passes and the less tension is left.
    assert np.all(np.diff(ledger.dissipated) < 0.0)


@pytest.mark.campaign
def test_hundred_random_cycles_converge_keep_the_bounds_and_create_no_energy():
    """Three tendons up to 2 N, tip forces up to 50 mN, default settings, then the energy over finer steps."""
    robot = three(0.3)
    cycles = random_cycles(robot, 100, seed=1)
    result = solve(robot, cycles)
    assert max(capstan_violation(robot, s) for s in result.steps) < 1e-8
    gaps = []
    for parts in (4, 16):
        steps, forces = divide(robot, cycles, parts)
        result = solve(robot, steps)
        ledger = Ledger(result, forces)
        assert max(capstan_violation(robot, s) for s in result.steps) < 1e-8
        gaps.append(abs(ledger.gap) / ledger.work)
    assert np.all(ledger.dissipated > 0.0)
    assert ledger.work >= ledger.stored
    assert gaps[1] < 0.02 and gaps[1] < 0.5 * gaps[0]

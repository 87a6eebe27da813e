"""The ceiling: a flexible regression finds what depends on inputs, history and time, and nothing in noise."""

import numpy as np
import pytest
from identify_data import data_of
from searches import GRAVITY, problem_of, result

from tdcr_fe import LoadStep, Reading
from tdcr_fe.identify.noise import held_out_ceiling, predicted_residual
from tdcr_fe.identify.problem import Fit
from tdcr_fe.identify.result import Misfit
from tdcr_fe.identify.sentences import sentences

# Eight pulls and releases of two tendons to different tensions, as branches, with times.
STEPS, BRANCHES = [], []
for n in range(8):
    peak = 0.6 + 0.1 * n
    for j, t in enumerate([*np.linspace(0.2, peak, 5), *np.linspace(peak, 0.1, 5)[1:]]):
        pulls = {"t1": float(t) * (n % 2 == 0), "t2": float(t) * (n % 2)}
        STEPS.append(LoadStep(tensions=pulls, time=float(len(STEPS))))
        BRANCHES.append(f"{'up' if j < 5 else 'down'} {n}")
READ = [Reading(k, f"position_{a}", 0.2, 0.0, 1e-4) for k in range(1, len(STEPS) + 1) for a in "xyz"]
DATA = data_of(STEPS, tuple(READ), branches=BRANCHES)
PROBLEM = problem_of(DATA, [n for n, b in zip(DATA.step_ids, DATA.branches, strict=True) if b[-1] in "25"])
HELD = PROBLEM.held_out
NOISE = np.random.default_rng(0).normal(size=HELD.size)


def fit(residual):
    """A model with such a residual over sigma."""
    cost, held = float(np.sum(residual[~HELD] ** 2)), float(np.sum(residual[HELD] ** 2))
    return Fit((), {}, residual, cost, held, np.zeros((HELD.size, 0)), (), None, residual)


def by_step(values):
    """The same value for all three coordinates of a step, with signs."""
    return np.repeat(values, 3) * np.tile([1.0, -0.5, 0.3], len(values))


TENSION = np.array([s.tensions["t1"] + 0.7 * s.tensions["t2"] for s in DATA.steps])
RISING = np.array([1.0 if b.startswith("up") else -1.0 for b in DATA.branches])
TIME = np.array([s.time for s in DATA.steps])


@pytest.mark.parametrize(
    "cause",
    [40.0 * TENSION**2, 15.0 * RISING * TENSION, 30.0 * np.sin(TIME / 20.0)],
    ids=["inputs", "direction", "time"],
)
def test_what_depends_on_inputs_direction_or_time_is_removed(cause):
    residual = by_step(cause) + NOISE
    left = residual - predicted_residual(PROBLEM, residual)
    assert np.mean(left[HELD] ** 2) < 0.05 * np.mean(residual[HELD] ** 2)
    least = held_out_ceiling(PROBLEM, fit(residual), fit(residual))
    assert least.chi2_per_dof == pytest.approx(np.mean(left[HELD] ** 2))


def test_the_held_out_readings_are_never_used():
    residual = by_step(40.0 * TENSION**2) + NOISE
    unknown = np.where(HELD, 1e3, residual)
    np.testing.assert_allclose(*(predicted_residual(PROBLEM, r) for r in (residual, unknown)))


def test_noise_has_no_ceiling_below_itself():
    """The regression predicts next to nothing, and the ceiling is never above the final model's own error."""
    assert np.mean(predicted_residual(PROBLEM, NOISE)[HELD] ** 2) < 0.2
    least = held_out_ceiling(PROBLEM, fit(NOISE), fit(NOISE))
    assert 0.8 * np.mean(NOISE[HELD] ** 2) <= least.chi2_per_dof <= np.mean(NOISE[HELD] ** 2)


def test_result_and_report_say_how_much_can_be_removed():
    found = result(GRAVITY, ceiling=Misfit(1.7e-4, None, 4e-4, 1.0))
    assert found.to_json()["ceiling"]["held_out"]["rms_position"] == 1.7e-4
    assert any("leaves 0.17\N{NO-BREAK SPACE}mm" in text for text in sentences(found))

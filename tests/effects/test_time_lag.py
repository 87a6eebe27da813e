"""Readings that belong to earlier commands."""

from __future__ import annotations

import numpy as np
import pytest
from robots import LENGTH, three

from tdcr_fe.effects import ExcitationRange, Experiment, effect, with_effect
from tdcr_fe.model.loading import Load, LoadStep, Model, resolve


def timed(*values: float, times=None, **rest) -> Experiment:
    """Displacements of one tendon [m], a second apart."""
    at = range(1, len(values) + 1) if times is None else times
    steps = tuple(
        LoadStep(displacements={"t1": v, "t2": 0.0, "t3": 0.0}, time=float(t), **rest)
        for v, t in zip(values, at, strict=True)
    )
    return Experiment(three(), Model(), steps)


def read_at(lagged: Experiment) -> list[tuple[float, float]]:
    """Time and displacement of the first tendon where the readings belong to."""
    actions = resolve(lagged.robot, lagged.steps)
    return [
        (a.time, float(a.values[0])) for a, (_, f) in zip(actions, lagged.step_ends, strict=True) if f == 1.0
    ]


@pytest.mark.parametrize("lag", [0.25, 1.0, 1.6])
def test_every_reading_sees_the_commands_of_an_earlier_time(lag):
    values = np.array([0.0, 1e-3, 3e-3, 2e-3, -1e-3, 0.0])
    lagged = with_effect(timed(*values), "time_lag", lag=lag)
    expected = [(max(t - lag, 1.0), np.interp(t - lag, np.arange(1, 7), values)) for t in range(1, 7)]
    np.testing.assert_allclose(read_at(lagged), expected, atol=1e-12)


def test_the_robot_passes_every_commanded_turning_point():
    """The peak at 2 s lies between two readings, and is a step of its own."""
    lagged = with_effect(timed(0.0, 2e-3, 0.0), "time_lag", lag=0.25)
    found = [(s.time, s.displacements["t1"]) for s in lagged.steps]
    np.testing.assert_allclose(found, [(1.0, 0.0), (1.75, 1.5e-3), (2.0, 2e-3), (2.75, 5e-4)])
    assert lagged.step_ends == ((0, 1.0), (1, 1.0), (2, 0.25), (2, 1.0))


def test_loads_are_interpolated_as_commands_are():
    steps = tuple(
        LoadStep(tensions={"t1": f}, loads={"tip": Load(LENGTH, (f, 0.0, 0.0))}, time=t)
        for f, t in ((0.0, 1.0), (0.4, 2.0))
    )
    lagged = with_effect(Experiment(three(), Model(), steps), "time_lag", lag=0.25)
    assert lagged.steps[-1].loads["tip"].force[0] == pytest.approx(0.3)
    assert lagged.steps[-1].tensions["t1"] == pytest.approx(0.3)


def test_without_lag_or_without_times():
    setup = timed(0.0, 1e-3)
    assert with_effect(setup, "time_lag", lag=0.0) == setup
    untimed = Experiment(three(), Model(), (LoadStep(tensions={"t1": 1.0}),))
    with pytest.raises(ValueError, match="needs a time in every step"):
        with_effect(untimed, "time_lag", lag=0.1)
    assert effect("time_lag").probe_points(untimed, ExcitationRange(duration=1.0)) == []
    assert effect("time_lag").bounds(setup)["lag"] == (0.0, 4.0)

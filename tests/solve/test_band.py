"""The banded tangent of one robot alone against the full one, and what it costs as the number of disks grows."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest
from robots import LENGTH, paper, pull, tendon, three

from tdcr_fe.model.loading import LoadStep, Model, resolve
from tdcr_fe.model.robot import Disks, Robot
from tdcr_fe.solve.equations import band
from tdcr_fe.solve.simulation import Simulation


def short_and_long() -> Robot:
    """Three tendons of different ends, one elastic, one with adhesion."""
    tendons = (
        tendon("t1", 0.0, 0.3, end=float(paper().disks.positions[6])),
        tendon("t2", 120.0, 0.2, axial_stiffness=2000.0),
        tendon("t3", 250.0, 0.1, adhesion=0.02),
    )
    return replace(paper(), tendons=tendons)


def free_end() -> Robot:
    """One tendon that ends at the last disk, a fifth of the length before the tip."""
    disks = Disks.equally_spaced(13, 0.8 * LENGTH)
    return replace(paper(), disks=disks, tendons=(tendon("t1", 0.0, 0.3, end=float(disks.positions[-1])),))


CASES: dict[str, tuple[Robot, dict[str, Any], LoadStep]] = {
    "one tendon": (paper(0.3), {}, pull(2.0)[0]),
    "no friction": (paper(), {"friction": "none"}, pull(2.0)[0]),
    "one sign per tendon": (paper(0.3), {"friction": "per-tendon"}, pull(2.0)[0]),
    "two elements a bay": (paper(0.3), {"elements_per_bay": 2}, pull(2.0)[0]),
    "different ends": (short_and_long(), {}, LoadStep("", {"t1": 1.0, "t2": 0.6, "t3": 0.9})),
    "displacements": (three(0.3), {}, LoadStep("", displacements={"t1": 2e-3, "t2": -1e-3, "t3": -1.2e-3})),
    "free end": (free_end(), {}, pull(2.0)[0]),
}


@pytest.mark.parametrize("case", CASES)
def test_a_run_is_the_same_with_the_band_and_without(case: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Positions of all nodes at the end of three steps, and the iterations but for a last one near round-off."""
    robot, model, step = CASES[case]
    shares = (0.5, 1.0, 0.8)
    steps = [
        replace(
            step,
            tensions={n: x * s for n, x in step.tensions.items()},
            displacements={n: x * s for n, x in step.displacements.items()},
        )
        for s in shares
    ]
    found = []
    for widest in (1.0, 0.0):
        monkeypatch.setattr(band, "WIDEST", widest)
        targets = resolve(robot, steps)
        simulation = Simulation(robot, Model(**{"elements_per_bay": 1, **model}), targets)
        assert (simulation.system.layout.bands == (None,)) == (widest == 0.0)
        iterations = [simulation.advance(t).iterations_total for t in targets]
        found.append((iterations, simulation.state.configuration.positions))
    assert max(abs(a - b) for a, b in zip(found[0][0], found[1][0], strict=True)) <= 1
    # One iteration more or less makes this difference: the residual has a tolerance of 1e-8.
    assert found[0][1] == pytest.approx(found[1][1], abs=1e-9 * LENGTH)

"""Slip reversals within load steps: followed through the linearised equilibrium, located, and reported."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from random_robots import largest_gap, random_robot, random_steps
from robots import LENGTH, distance, paper, pull, solve, three

from tdcr_fe.elements.complementarity import solve_box
from tdcr_fe.model.loading import Load, LoadStep, Model
from tdcr_fe.model.settings import SolverSettings
from tdcr_fe.solve.friction_path import SlipRates, follow
from tdcr_fe.solve.simulate import simulate
from tdcr_fe.validation.random_robots import draw

DELTA = 1e-6


def by_small_steps(start, end, mobilisation, count):
    """The same path by many complementarity steps, which lose a reversal's overshoot within one step only."""
    s, u = mobilisation.copy(), np.zeros_like(mobilisation)
    for k in range(count):
        x = (k + 0.5) / count
        load = ((1.0 - x) * start.by_load + x * end.by_load) / count
        matrix = (1.0 - x) * start.matrix + x * end.matrix
        new, _ = solve_box(matrix, load + matrix @ s, s)
        u += load + DELTA * (new - s) - matrix @ (new - s)
        s = new
    return u, s


def random_rates(seed, count=8):
    """Slip rates of both signs that change within the substep, and a coupling that is far larger than presliding."""
    draw = np.random.default_rng(seed)
    ends = []
    base = draw.normal(size=(count, count))
    for _ in range(2):
        part = base + 0.1 * draw.normal(size=(count, count))
        matrix = DELTA * np.eye(count) + 1e-5 * part @ part.T / count
        ends.append(SlipRates(2e-5 * draw.normal(size=count), matrix))
    mobilisation = np.clip(draw.uniform(-1.5, 1.5, count), -1.0, 1.0)
    return *ends, mobilisation


def test_a_single_hole_turns_where_its_slip_rate_vanishes():
    """Slip rates from 3 to -1 micrometre: it turns at 3/4 after 1.125, and lets out 0.125 presliding distances."""
    alone = np.array([[DELTA]])
    path = follow(
        SlipRates(np.array([3e-6]), alone), SlipRates(np.array([-1e-6]), alone), np.array([1.0]), DELTA
    )
    assert path.complete and path.reversed.all()
    assert path.turning_factor == pytest.approx([0.75], abs=1e-3)
    assert path.turning_slip == pytest.approx([1.125e-6], rel=1e-4)
    assert path.mobilisation == pytest.approx([0.875], abs=1e-3)


def test_a_slip_that_keeps_its_direction_is_not_reversed():
    alone = np.array([[DELTA]])
    rates = [SlipRates(np.array([x]), alone) for x in (3e-6, 1e-6)]
    path = follow(*rates, np.array([-0.5]), DELTA)
    assert path.complete and not path.reversed.any()
    assert path.slip == pytest.approx([2e-6]) and path.mobilisation == pytest.approx([1.0])


@pytest.mark.parametrize("seed", range(12))
def test_coupled_holes_are_followed_as_by_many_small_steps(seed):
    """Eight coupled holes, with reversals caused by other holes that begin to slip; 4000 small steps as the measure."""
    start, end, mobilisation = random_rates(seed)
    path = follow(start, end, mobilisation, DELTA)
    slip, final = by_small_steps(start, end, mobilisation, 4000)
    assert path.complete
    assert path.mobilisation == pytest.approx(final, abs=0.03)
    assert path.slip == pytest.approx(slip, abs=0.03 * np.abs(slip).max())


def test_reversals_occur_among_them():
    assert sum(follow(*random_rates(seed), DELTA).reversed.sum() for seed in range(12)) > 10


def test_a_pull_from_rest_takes_one_solve_although_every_hole_begins_to_slip():
    """Twelve holes change from stick to slip; version 0.1 solved this load step three times."""
    result = solve(paper(0.3), pull(1.0))
    (step,) = result.steps
    assert step.hole_states[0][:-1] == ("pull",) * 12
    assert step.substeps == 1 and step.details["iterations_total"] <= 5
    fine = solve(paper(0.3), pull(1.0, substeps=64))
    assert distance(result.tips[-1], fine.tips[-1]) < 1e-6 * LENGTH


def test_a_release_reverses_at_its_beginning_and_takes_few_solves():
    """Every hole turns at the very beginning, which needs no division."""
    steps = pull(2.0, 1.0)
    result = solve(paper(0.3), steps)
    fine = solve(paper(0.3), [replace(s, substeps=64) for s in steps])
    assert result.steps[-1].details["iterations_total"] < 12
    assert distance(result.tips[-1], fine.tips[-1]) < 1e-6 * LENGTH


def moved_across() -> list[LoadStep]:
    """A force at the tip turns round while three tendons are pulled."""
    return [
        LoadStep("", {"t1": 1.5, "t2": 0.5}),
        LoadStep("", {"t1": 0.3, "t2": 1.2}, loads={"tip": Load(LENGTH, (0.01, 0.02, 0.0))}),
        LoadStep("", {"t1": 1.0, "t3": 0.8}, loads={"tip": Load(LENGTH, (-0.02, 0.01, 0.0))}),
    ]


def test_fixed_substeps_approach_the_resolved_path():
    """Of 1, 64 and 512 equal substeps, each taken as a whole, more lose less of the reversals."""
    steps = moved_across()
    chosen = solve(three(0.3), steps)
    assert all(s.details["refinement_error"] == 0.0 for s in chosen.steps)
    away = [
        distance(chosen.tips, solve(three(0.3), [replace(s, substeps=n) for s in steps]).tips) / LENGTH
        for n in (1, 64, 512)
    ]
    assert away[0] > 1e-3 > away[1]
    assert away[2] < 2e-5


def test_reversals_located_in_a_substep_are_solved_with_it():
    """The same as where the path is recorded, so that it is divided at reversals, in fewer substeps."""
    steps = moved_across()
    located = solve(three(0.3), steps)
    divided = simulate(three(0.3), Model(friction="per-hole", elements_per_bay=1), steps, record_path=[])
    fine = solve(three(0.3), [replace(s, substeps=512) for s in steps])
    assert sum(s.substeps for s in located.steps) < sum(s.substeps for s in divided.steps)
    for result in (located, divided):
        assert distance(result.tips, fine.tips) < 2e-5 * LENGTH


def test_slips_that_reverse_and_return_within_a_pull_are_found():
    """Five tendons pulled and let go; a check of the slip rates at both ends alone was 4.6e-4 of the length off."""
    case = draw(28)
    model = replace(case.model, elements_per_bay=1)
    result = simulate(case.robot, model, case.steps)
    fine = simulate(case.robot, model, [replace(s, substeps=128) for s in case.steps])
    assert largest_gap(result, fine)[-1] < 5e-5


def test_a_path_that_is_not_resolved_is_reported_with_its_error():
    """With a single substep reversals are neither located nor divided; the estimate is not below the true error."""
    steps = [LoadStep("", {"t1": 2.0}), LoadStep("", loads={"tip": Load(LENGTH, (-0.05, 0.0, 0.0))})]
    resolved = solve(paper(0.3), steps)
    settings = SolverSettings(max_substeps=1, max_substep_turn=10.0)
    coarse = solve(paper(0.3), steps, settings=settings)
    error = coarse.steps[-1].details["refinement_error"]
    true = distance(resolved.tips[-1], coarse.tips[-1]) / LENGTH
    assert 1e-3 < true < error < 30.0 * true
    assert any(f"by {error:.1e} of the length" in w for w in coarse.warnings)
    assert not any("not resolved" in w for w in resolved.warnings)


def test_a_reversal_that_doubling_missed_is_found():
    """Six tendons; in the third step version 0.1 was 4.8e-4 of the length off without a warning."""
    robot = random_robot(6, 11)
    steps = random_steps(robot, 11)
    model = Model("straight", "per-hole", elements_per_bay=1)
    chosen = simulate(robot, model, steps)
    fine = simulate(robot, model, [replace(s, substeps=512) for s in steps])
    assert chosen.warnings == fine.warnings
    assert np.max(largest_gap(chosen, fine)) < 3e-5

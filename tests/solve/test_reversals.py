"""Slip reversals within load steps: followed through the linearised equilibrium, located, and reported."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from linear_slips import LinearSlips
from random_robots import largest_gap, random_robot, random_steps
from robots import LENGTH, distance, paper, pull, solve, three

from tdcr_fe.elements.complementarity import solve_box
from tdcr_fe.model.backbone import Backbone
from tdcr_fe.model.loading import Actuation, Load, LoadStep, Model, SolverSettings, resolve
from tdcr_fe.model.robot import Disks, Robot
from tdcr_fe.model.routing import HelicalRouting, ParallelRouting
from tdcr_fe.model.tendon import Tendon
from tdcr_fe.solve.equations.configuration import Target
from tdcr_fe.solve.friction_path.follow import follow_friction
from tdcr_fe.solve.friction_path.rates import columns_of
from tdcr_fe.solve.friction_path.response import Equilibrium, TautTendons
from tdcr_fe.solve.friction_path.reversals import InterpolationPoint, SolvedStates, SubstepSlips
from tdcr_fe.solve.load_steps.load_path import Ramp
from tdcr_fe.solve.load_steps.substep import SubstepSolver
from tdcr_fe.solve.load_steps.substep_reversals import KnownStates, Span, solve_within
from tdcr_fe.solve.newton.steps import FrictionCoupling
from tdcr_fe.solve.simulate import simulate
from tdcr_fe.solve.simulation import Simulation
from tdcr_fe.validation.random_robots import draw

DELTA = 1e-6


def followed(slips, mobilisation):
    """The path, with a tension that nothing depends on."""
    return follow_friction(slips, mobilisation, np.zeros(0), np.ones(1))


def by_small_steps(slips, mobilisation, count):
    """The same path by many complementarity steps, which lose a reversal's overshoot within one step only."""
    s = mobilisation.copy()
    u = slips.slip(0.0, s)
    for k in range(count):
        x = (k + 1) / count
        matrix = slips.matrix(x)
        new, _ = solve_box(matrix, slips.slip(x, s) - u + matrix @ s, s)
        s, u = new, slips.slip(x, new)
    return s


def random_slips(seed, count=8):
    """Slip rates of both signs that change within the substep, and a coupling that is far larger than presliding."""
    draw = np.random.default_rng(seed)
    loads, matrices = [], []
    base = draw.normal(size=(count, count))
    for _ in range(2):
        part = base + 0.1 * draw.normal(size=(count, count))
        matrices.append(DELTA * np.eye(count) + 1e-5 * part @ part.T / count)
        loads.append(2e-5 * draw.normal(size=count))
    mobilisation = np.clip(draw.uniform(-1.5, 1.5, count), -1.0, 1.0)
    return LinearSlips(loads, matrices, mobilisation, DELTA), mobilisation


def alone(start, end, mobilisation):
    """One hole with slip rates at both ends of the substep."""
    matrix = np.full((2, 1, 1), DELTA)
    return LinearSlips([[start], [end]], matrix, [mobilisation], DELTA), np.array([mobilisation])


def test_a_single_hole_turns_where_its_slip_rate_vanishes():
    """Slip rates from 3 to -1 micrometre: it turns at 3/4 after 1.125, and lets out 0.125 presliding distances."""
    path = followed(*alone(3e-6, -1e-6, 1.0))
    assert path.complete and path.reversed.all()
    assert path.reversal_factor == pytest.approx([0.75], abs=1e-3)
    assert path.reversal_slip == pytest.approx([1.125e-6], rel=1e-4)
    assert path.unknowns == pytest.approx([0.875], abs=1e-3)


def test_a_slip_that_keeps_its_direction_is_not_reversed():
    path = followed(*alone(3e-6, 1e-6, -0.5))
    assert path.complete and not path.reversed.any()
    assert path.unknowns == pytest.approx([1.0])


def test_a_path_that_overflows_is_not_complete():
    assert not followed(*alone(np.inf, 1e-6, 1.0)).complete


@pytest.mark.parametrize("seed", range(12))
def test_coupled_holes_are_followed_as_by_many_small_steps(seed):
    """Eight coupled holes, with reversals caused by other holes that begin to slip; 4000 small steps as the measure."""
    slips, mobilisation = random_slips(seed)
    path = followed(slips, mobilisation)
    assert path.complete
    assert path.unknowns == pytest.approx(by_small_steps(slips, mobilisation, 4000), abs=0.03)


def test_reversals_occur_among_them():
    assert sum(followed(*random_slips(seed)).reversed.sum() for seed in range(12)) > 10


def end_of(simulation):
    """The last solved state with its linearisation."""
    target = Target(simulation.state.inputs, simulation.state.loads, simulation.state.time)
    return Equilibrium.at(simulation.system, simulation.state, target)


def pulled(adhesion=0.0, stiffness=None):
    """A helical and a parallel tendon under tension, seven disks."""
    tendons = (
        Tendon("a", HelicalRouting(4e-3, 0.5), 0.3, adhesion=adhesion, axial_stiffness=stiffness),
        Tendon("b", ParallelRouting(4.5e-3, 100.0), 0.2, axial_stiffness=stiffness),
    )
    robot = Robot(paper().backbone, Disks.equally_spaced(7, LENGTH), tendons)
    steps = resolve(robot, [LoadStep("", {"a": 0.6, "b": 0.9})])
    simulation = Simulation(robot, Model(elements_per_bay=1), steps)
    simulation.advance(steps[0])
    return simulation


def test_the_flexibility_of_the_segments_is_symmetric():
    """Maxwell and Betti, although the tangent with friction is not symmetric; positive definite besides."""
    simulation = pulled()
    end = end_of(simulation)
    both = TautTendons.of([end]).numbers
    flexibility = end.with_response(simulation.system.layout.clamped, both).response.flexibility
    assert np.abs(flexibility - flexibility.T).max() < 1e-9 * np.abs(flexibility).max()
    assert np.linalg.eigvalsh(flexibility).min() > 0.0


@pytest.mark.parametrize(
    "given", [{}, {"stiffness": 400.0}, {"adhesion": 0.02}], ids=["plain", "elastic", "adhesive"]
)
def test_slips_and_their_derivatives_are_those_of_the_solved_ends(given):
    """The model of the substep against the slips and the response to mobilisations of the finite elements."""
    simulation = pulled(**given)
    start = end_of(simulation)
    after = np.array([1.1, 0.4])
    simulation.advance(Actuation(np.zeros(2, dtype=bool), after))
    end = end_of(simulation)
    targets = tuple(Target((x,), start.state.loads, 0.0) for x in (np.array([0.6, 0.9]), after))
    clamped, both = simulation.system.layout.clamped, TautTendons.of([start, end])
    start, end = (at.with_response(clamped, both.numbers) for at in (start, end))
    points = [InterpolationPoint(0.0, start), InterpolationPoint(1.0, end)]
    substep = SubstepSlips.of(SolvedStates(points, both, targets, DELTA, LENGTH, 1e-6))
    for x, at in ((0.0, start), (1.0, end)):
        tension = np.concatenate([f.field.tension.reshape(-1) for f in at.forces])
        state = substep.model.slips.at(x, at.mobilisation, tension)
        line = at.linearization
        coupling = FrictionCoupling.of(line.numbering, at.forces, clamped, line.slack)
        every = np.arange(len(at.mobilisation))
        matrix = coupling.response(line.factorisation.solve, every, DELTA).matrix
        assert state.tension == pytest.approx(tension, rel=1e-9)
        assert state.slip == pytest.approx(at.slips, rel=1e-9, abs=1e-12)
        assert np.abs(columns_of(state.derivatives, every).T - matrix).max() < 1e-8 * np.abs(matrix).max()


def test_slips_are_interpolated_better_through_a_state_within_the_substep():
    """Against equilibria at fixed friction on the followed path; one state halves the error."""
    simulation = pulled()
    start = end_of(simulation)
    after = np.array([1.1, 0.4])
    simulation.advance(Actuation(np.zeros(2, dtype=bool), after))
    end, system = end_of(simulation), simulation.system
    targets = tuple(Target((x,), start.state.loads, 0.0) for x in (np.array([0.6, 0.9]), after))
    solver = SubstepSolver(system, Ramp.of(system, start.state, 0.0, 0.0), simulation.settings)
    both = TautTendons.of([start, end])

    def ready(at):
        return at.with_response(system.layout.clamped, both.numbers)

    whole = (InterpolationPoint(0.0, ready(start)), InterpolationPoint(1.0, ready(end)))
    states = SolvedStates(whole, both, targets, DELTA, LENGTH, 1e-6)
    known = KnownStates(Span(0.0, 1.0), both, whole)
    substep = SubstepSlips.of(states)
    path = substep.follow()
    middle = InterpolationPoint(0.5, ready(solve_within(solver, known, path, 0.5)))
    refined = SubstepSlips.of(states._replace(points=[whole[0], middle, whole[1]]))
    for factor in (0.25, 0.75):
        inside = solve_within(solver, known, path, factor)
        assert np.array_equal(inside.mobilisation, path.at(factor)[0])
        tension = both.tensions(inside)
        errors = [
            float(np.abs(model.slips.at(factor, inside.mobilisation, tension).slip - inside.slips).max())
            for model in (substep.model, refined.model)
        ]
        assert errors[1] < errors[0] / 2.0 and errors[1] < 0.2 * DELTA


def test_a_large_step_of_six_tendons_takes_few_solves(monkeypatch):
    """Before, 124 followed paths and 72 solves in these three steps; now states within each step serve all of it."""
    case, solves = draw(22), []
    solve_substep = SubstepSolver.solve
    monkeypatch.setattr(SubstepSolver, "solve", lambda *a: solves.append(0) or solve_substep(*a))
    model = replace(case.model, elements_per_bay=1)
    found = simulate(case.robot, model, case.steps)
    assert len(solves) <= 24
    tight = simulate(case.robot, model, case.steps, SolverSettings(path_tolerance=1e-6))
    assert all(s.details["refinement_error"] == 0.0 for s in tight.steps)
    assert distance(found.tips, tight.tips) < 1e-5 * case.robot.backbone.length


@pytest.mark.parametrize(("seed", "states"), [(31, 4), (89, 16)])
def test_the_error_of_a_path_through_several_states_is_that_without_every_other_of_them(seed, states):
    """Second steps through states within them, of which there are more only where they are needed.

    Where all states lie near the followed path, what changes without every other one is the error: three within the
    step of the first robot are enough, whose number had to be doubled for an estimate. In the second robot they lie off
    the path, what changes is three times less than the error, and 1.5e-5 of the length would be left.
    """
    case = draw(seed)
    model = replace(case.model, elements_per_bay=1)
    before, step = case.steps[:2]
    found = simulate(case.robot, model, (before, step))
    assert found.steps[-1].substeps == states
    assert found.steps[-1].details["refinement_error"] == 0.0
    fine = simulate(case.robot, model, (before, step), SolverSettings(path_tolerance=1e-7))
    whole = simulate(case.robot, model, (before, replace(step, substeps=1)))
    length = case.robot.backbone.length
    assert np.abs(found.tips[-1] - fine.tips[-1]).max() < 5e-6 * length
    assert np.abs(whole.tips[-1] - fine.tips[-1]).max() > 1e-4 * length


def test_a_hole_whose_last_reversal_the_interpolation_misses_is_found_by_states_within_the_step():
    """The third step of a robot of six tendons: the fourth hole of the last one sticks in the end.

    Between the ends of the step its slip is interpolated with a last reversal 43 um before the true one, and it would
    slip at the end. That moved the tip by 1.4e-3 of the length, unsaid: a path with other slips showed nothing of it.
    """
    case = draw(533)
    model = replace(case.model, elements_per_bay=1)
    found = simulate(case.robot, model, case.steps[:3])
    assert found.steps[-1].hole_states[-1][3] == "stick"
    fine = simulate(case.robot, model, case.steps[:3], SolverSettings(path_tolerance=1e-7))
    assert np.abs(found.tips - fine.tips).max() < 1e-5 * case.robot.backbone.length


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
    """The same as where the path is recorded, so that it is divided at reversals, with fewer iterations."""
    steps = moved_across()
    located = solve(three(0.3), steps)
    divided = simulate(three(0.3), Model(friction="per-hole", elements_per_bay=1), steps, record_path=[])
    fine = solve(three(0.3), [replace(s, substeps=512) for s in steps])
    spent = [sum(s.details["iterations_total"] for s in each.steps) for each in (located, divided)]
    assert spent[0] < spent[1]
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


#: Displacements of nine tendons in five load steps [micrometre]; the last one lets all of them out again.
BACK_AND_FORTH = (
    (-4019.03, 1810.098, 1825.437, -3512.816, 3359.418, -92.039, -2024.855, 3880.972, -2040.195),
    (-4341.166, 1963.496, 1948.156, -3804.273, 3650.875, -92.039, -2193.593, 4203.108, -2178.253),
    (-4709.322, 2193.593, 2147.573, -4126.409, 4003.69, -92.039, -2393.01, 4601.943, -2377.671),
    (-4801.361, 2285.632, 2285.632, -4126.409, 4111.069, -92.039, -2454.37, 4755.341, -2454.37),
    (-4417.865, 2193.593, 2193.593, -3834.952, 3850.292, -92.039, -2331.651, 4402.525, -2331.651),
)


def test_holes_that_turn_shortly_after_each_other_are_all_found():
    """Three segments and 72 frictional holes, of which some turned too late: that moved the robot by 3.4e-4."""
    ends, angles = (
        (0.06, 0.1225, 0.1865),
        (-174.07, -51.778, 64.394, -141.927, -26.58, 95.781, -120.459, 6.102, 128.657),
    )
    tendons = [
        Tendon(f"t{i + 1}", ParallelRouting(4.5e-3, angle), 0.1, end=ends[i // 3])
        for i, angle in enumerate(angles)
    ]
    disks = np.concatenate([a + (b - a) * np.arange(1, 7) / 6 for a, b in pairwise((0.0, *ends))])
    robot = Robot(
        Backbone(ends[-1], 0.5e-3, 50e9, 0.3, density=6450.0),
        Disks(disks, mass=0.3e-3, radius=5.5e-3),
        tendons,
    )
    pulls = 1e-6 * np.array(BACK_AND_FORTH)
    parts = [*pulls[:-1], *(pulls[-2] + (pulls[-1] - pulls[-2]) * x for x in np.arange(1, 9) / 8)]

    def end_of_history(rows):
        steps = [LoadStep("", displacements=dict(zip(robot.tendon_names, row, strict=True))) for row in rows]
        result = simulate(robot, Model(elements_per_bay=1), steps)
        assert result.converged
        return result.steps[-1].positions

    assert end_of_history(pulls) == pytest.approx(end_of_history(parts), abs=1e-5 * ends[-1])

"""Slip reversals within load steps, and tendons that become slack and taut: followed, located, reported."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from robots import LENGTH, distance, paper, pull, seven, solve, tendon, three

from tdcr_fe import Backbone, Disks, Load, LoadStep, Model, Robot, SolverSettings, Tendon, simulate
from tdcr_fe.elements.complementarity import solve_box
from tdcr_fe.model.routing import ConvergingRouting
from tdcr_fe.solve.friction_path.follow import follow_friction
from tdcr_fe.solve.friction_path.rates import SlipDerivatives, SlipState
from tdcr_fe.validation.fuzz import drawing
from tdcr_fe.validation.fuzz.checks import CHECKS, check_step
from tdcr_fe.validation.fuzz.energy import divided
from tdcr_fe.validation.random_robots import draw

DELTA = 1e-6


class LinearSlips:
    """``u = a x + b x^2 / 2 + (C0 + x C1) (z - z0)``; mobilisations first in ``z``, then tensions at the base.

    Parameters
    ----------
    by_load
        ``a`` and ``a + b``, shape (2, n).
    matrix
        Presliding distance times identity (zero for tensions) minus ``C`` at both ends, shape (2, n, n).
    start
        ``z0``, shape (n,).
    presliding
        [m].
    holes
        Number of mobilisations; None where all unknowns are.
    slack
        Of the tensions at the start, shape (n - holes,).
    """

    def __init__(self, by_load, matrix, start, presliding, holes=None, slack=()):
        self.breakpoints, self.compilable = np.ones(1), False
        self.transfer = None
        self._load, self._matrix, self._start = np.array(by_load), np.array(matrix), np.array(start)
        holes = len(start) if holes is None else holes
        self.elastic_slip = np.append(np.full(holes, presliding), np.zeros(len(start) - holes))
        self._first = np.append(np.zeros(holes), -np.array(slack))

    def _by_unknowns(self, x):
        return np.diag(self.elastic_slip) - (1.0 - x) * self._matrix[0] - x * self._matrix[1]

    def slip(self, x, z):
        """Slips, then minus the slack."""
        load = x * self._load[0] + 0.5 * x * x * (self._load[1] - self._load[0])
        return self._first + load + self._by_unknowns(x) @ (z - self._start)

    def at(self, x, z, tension):
        """As of `tdcr_fe.solve.friction_path.slips.InterpolatedSlips`: tensions stay as they are."""
        change = self._matrix[0] - self._matrix[1]
        load = (1.0 - x) * self._load[0] + x * self._load[1] + change @ (z - self._start)
        still, none = np.zeros(len(tension)), np.zeros((len(z), len(tension)))
        given = (load, self.elastic_slip, np.zeros(0, dtype=bool), still, none)
        derivatives = SlipDerivatives(*given, self.matrix(x).T.copy())
        return SlipState(tension, self.slip(x, z), derivatives)

    def matrix(self, x):
        """Minus the derivatives of the complements by the unknowns."""
        return np.diag(self.elastic_slip) - self._by_unknowns(x)


def followed(slips, mobilisation):
    """The path, with a tension that nothing depends on."""
    return follow_friction(slips, mobilisation, np.zeros(0), np.ones(1))


def by_small_steps(slips, mobilisation, count):
    """The same path by many complementarity steps, which lose a reversal's overshoot within one step only."""
    s, u = mobilisation, slips.slip(0.0, mobilisation)
    for x in np.arange(1, count + 1) / count:
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
    assert path.reversal_factor == pytest.approx([0.75], abs=2e-3)
    assert path.reversal_slip == pytest.approx([1.125e-6], rel=1e-4)
    assert path.unknowns == pytest.approx([0.875], abs=1e-3)
    (reversal,) = path.reversals(np.array([True]))
    assert reversal.factor == path.reversal_factor and not reversal.arrives.any()


def test_a_slip_that_keeps_its_direction_is_not_reversed():
    path, steady = (followed(*alone(3e-6, end, -0.5)) for end in (1e-6, 3e-6))
    assert path.complete and not path.reversed.any() and len(path.segments.start) > 10
    assert path.unknowns == pytest.approx([1.0]) and len(steady.segments.start) < 9


def test_a_path_that_overflows_is_not_complete():
    assert not followed(*alone(np.inf, 1e-6, 1.0)).complete


@pytest.mark.parametrize("seed", range(6))
def test_coupled_holes_are_followed_as_by_many_small_steps(seed):
    """Eight coupled holes, with reversals caused by other holes that begin to slip; 4000 small steps as the measure."""
    slips, mobilisation = random_slips(seed)
    path = followed(slips, mobilisation)
    assert path.complete
    assert path.unknowns == pytest.approx(by_small_steps(slips, mobilisation, 4000), abs=1e-3)


@pytest.mark.integration
def test_a_hole_whose_last_reversal_the_interpolation_misses_is_found_by_states_within_the_step():
    """The third step of a robot of six tendons: the fourth hole of the last one sticks in the end.

    Between the ends of the step its slip is interpolated with a last reversal 43 um before the true one, and it would
    slip at the end. That moved the tip by 1.4e-3 of the length, unsaid: a path with other slips showed nothing of it.
    """
    case = draw(533)
    model = replace(case.model, elements_per_bay=1)
    found = simulate(case.robot, model, case.steps[:3])
    assert found.steps[-1].hole_states[-1][3] == "stick"
    fine = simulate(case.robot, model, [replace(step, substeps=200) for step in case.steps[:3]])
    assert np.abs(found.tips - fine.tips).max() < 1e-5 * case.robot.backbone.length


@pytest.mark.integration
@pytest.mark.parametrize("seed, to, parts, most", [(266, 3, 2, 1e-5), (545, 3, 2, 1e-5), (235, 4, 8, 1.5e-5)])
def test_what_happens_in_a_step_is_not_lost_by_the_drift_of_its_path(seed, to, parts, most):
    """Whole load steps of random robots against parts with a tight tolerance; nothing was said of these errors.

    266: a hole came to its bound late by the drift of its path segment, and the one beside it had turned meanwhile,
    2e-5 of the length. 545: another one was free as well and kept what it had moved by too much, 3e-5. 235: a hole that
    sticks at the end comes to 0.006 of its bound on the path; in truth it slips there, 3.6e-4.
    """
    case, tight = draw(seed), SolverSettings(path_tolerance=1e-7, max_substeps=200)
    model = replace(case.model, elements_per_bay=1)
    found = simulate(case.robot, model, case.steps[:to])
    fine = simulate(case.robot, model, divided(case.robot, case.steps[:to], parts), tight)
    ends = (np.array([s.positions for s in each]) for each in (found.steps, fine.steps[parts - 1 :: parts]))
    assert np.abs(np.subtract(*ends)).max() < most * case.robot.backbone.length


@pytest.mark.parametrize(("tensions", "most"), [((1.0,), 5), ((2.0, 1.0), 11)], ids=["pull", "release"])
def test_a_pull_from_rest_and_a_release_take_few_solves_although_every_hole_changes(tensions, most):
    """Twelve holes begin to slip, which version 0.1 solved three times; or turn at the very beginning."""
    result, fine = solve(paper(0.3), pull(*tensions)), solve(paper(0.3), pull(*tensions, substeps=64))
    last = result.steps[-1]
    assert last.hole_states[0][:-1] == ("pull" if len(tensions) == 1 else "release",) * 12
    assert last.substeps == 1 and last.details["iterations_total"] <= most
    assert distance(result.tips[-1], fine.tips[-1]) < 1e-6 * LENGTH


def test_a_slip_of_dahls_law_that_reverses_and_returns_within_a_step_is_not_lost():
    """A hole slips towards the base at both ends: solved at once, nodes were 1.4e-4 of the length off."""
    tendons = tendon("t1", mu=0.7), tendon("t2", 160.0, end=LENGTH / 2, axial_stiffness=3000.0)
    robot = Robot(paper().backbone, Disks((LENGTH / 2, LENGTH)), tendons)
    given = np.array([[1.4e-3, 1.2e-3], *np.linspace([1.4e-3, 1.2e-3], [1.6e-3, 0.1e-3], 11)[1:]])
    model, settings = Model(hysteresis="dahl", elements_per_bay=4), SolverSettings(mesh_tolerance=np.inf)
    steps = [LoadStep(displacements=dict(zip(("t1", "t2"), map(float, d), strict=True))) for d in given]
    both = steps[:1] + steps[-1:], steps
    whole, parts = (simulate(robot, model, some, settings).steps[-1] for some in both)
    assert np.abs(whole.positions - parts.positions).max() < 1e-5 * LENGTH


@pytest.mark.integration
def test_reversals_located_in_a_substep_are_solved_with_it():
    """As with many small steps; and again along its recorded path, with fewer iterations.

    A force at the tip turns round while three tendons are pulled.
    """
    one, other = ({"tip": Load(LENGTH, force)} for force in ((0.01, 0.02, 0.0), (-0.02, 0.01, 0.0)))
    steps = [LoadStep("", {"t1": 1.5, "t2": 0.5}), LoadStep("", {"t1": 0.3, "t2": 1.2}, loads=one)]
    steps += [LoadStep("", {"t1": 1.0, "t3": 0.8}, loads=other)]
    model, path = Model(friction="per-hole", elements_per_bay=1), []
    located = simulate(seven(0.3), model, steps, record_path=path)
    again = simulate(seven(0.3), model, steps, reference_path=path)
    fine = solve(seven(0.3), [replace(s, substeps=256) for s in steps])
    spent = [sum(s.details["iterations_total"] for s in each.steps) for each in (located, again)]
    assert spent[1] < spent[0]
    for result in (located, again):
        assert distance(result.tips, fine.tips) < 2e-5 * LENGTH


def test_a_path_that_is_not_resolved_is_reported_with_its_error():
    """With a single substep reversals are neither located nor divided; the estimate is not below the true error."""
    steps = [LoadStep("", {"t1": 2.0}), LoadStep("", loads={"tip": Load(LENGTH, (-0.05, 0.0, 0.0))})]
    resolved = solve(paper(0.3), steps)
    coarse = solve(paper(0.3), steps, settings=SolverSettings(max_substeps=1, max_substep_turn=10.0))
    error = coarse.steps[-1].details["refinement_error"]
    true = distance(resolved.tips[-1], coarse.tips[-1]) / LENGTH
    assert 1e-3 < true < error < 30.0 * true
    assert any(f"by {100.0 * error:.2g} % of the length" in w for w in coarse.warnings)
    assert not any("not resolved" in w for w in resolved.warnings)


def tendon_over_one_hole(by_load, tension, slack):
    """Rates of a hole whose slip the tension moves by 0.5 mm/N, and of a tendon with 1 mm of slack per newton.

    `by_load`: of the slip and of minus the slack [m]; `tension`: at the start [N].
    """
    matrix = np.array([[DELTA, -5e-4], [0.0, 1e-3]])
    start = np.array([-1.0, tension])
    slips = LinearSlips([by_load, by_load], [matrix, matrix], start, DELTA, 1, [slack])
    return follow_friction(slips, start[:1], start[1:], np.ones(1)), slips


def test_a_tendon_becomes_taut_where_its_slack_is_used_up():
    """1 mm of slack at 2 mm per step: taut at 1/2, 1 N at the end; the slip rate turns from -0.3 to 0.7 mm."""
    path, slips = tendon_over_one_hole([-3e-4, 2e-3], 0.0, 1e-3)
    assert path.complete and path.reversed.all()
    assert path.unknowns == pytest.approx([1.0, 1.0], rel=1e-6)
    assert path.reversal_factor == pytest.approx([0.5], abs=1e-6)
    assert path.reversal_slip == pytest.approx([-1.5e-4], rel=1e-6)
    (reversal,) = path.reversals(np.array([True]))
    assert reversal.factor == path.reversal_factor and reversal.arrives.tolist() == [False, True]
    assert not path.reversals(np.array([False]))
    assert slips.slip(1.0, path.unknowns) == pytest.approx([-1.5e-4 + 3.5e-4, 0.0], rel=1e-2, abs=1e-9)


def test_a_tendon_becomes_slack_where_its_tension_ends():
    """1 N that falls by 2 N per step: slack at 1/2, by 1 mm at the end."""
    path, slips = tendon_over_one_hole([-3e-4, -2e-3], 1.0, 0.0)
    assert path.complete and not path.reversed.any()
    assert path.unknowns == pytest.approx([-1.0, 0.0], abs=1e-9)
    assert slips.slip(1.0, path.unknowns) == pytest.approx([-3e-4 - 5e-4, -1e-3], rel=1e-6)


def test_a_tendon_may_become_slack_and_taut_again():
    """The load turns: 0.5 N - 4 N x (1 - x) is zero from x = 0.15 to 0.85, and 0.5 N again at the end."""
    matrix = np.array([[DELTA, 0.0], [0.0, 1e-3]])
    slips = LinearSlips([[0.0, -4e-3], [0.0, 4e-3]], [matrix, matrix], [0.0, 0.5], DELTA, 1, [0.0])
    path = follow_friction(slips, np.zeros(1), np.array([0.5]), np.ones(1))
    assert path.complete
    assert path.unknowns[1] == pytest.approx(0.5, rel=1e-6)


@pytest.mark.integration
def test_slips_that_reverse_where_a_tendon_becomes_taut_are_found():
    """Version 0.1 was 9.6e-4 of the length off, unsaid: holes let out until the tendon was taut, then pulled.

    The third tendon is slack until shortly before the end of the second step.
    """
    moved = (1e-3, -2.5531158e-3, -2.1764913e-3), (2e-3, -5.0532918e-3, -0.9379651e-3)
    steps = [LoadStep("", displacements=dict(t1=a, t2=b, t3=c)) for a, b, c in moved]
    found = solve(three(0.3), steps)
    fine = solve(three(0.3), [replace(s, substeps=512) for s in steps])
    assert found.steps[1].hole_states[2][:-1] == ("pull",) * 12
    assert distance(found.tips, fine.tips) < 1e-6 * LENGTH
    assert found.steps[1].substeps <= 2


# ------------------------------------------------------------ complementarity problems, and whole robots


#: Of friction, and of tensions.
BOUNDS = [(-1.0, 1.0), (0.0, np.inf)]
SKEWNESS = [0.0, 0.05, 0.3, 1.0]


@settings(max_examples=150)
@given(st.integers(1, 5), st.integers(0, 10**6), st.sampled_from(SKEWNESS), st.sampled_from(BOUNDS))
def test_the_solution_meets_all_conditions_which_only_one_does(k, seed, skewness, bounds):
    """Positive definite, unsymmetric matrices (every such one is a P-matrix), any first guess; friction, and slack.

    What is left of the right side is zero inside of the bounds, and pushes outwards at them.
    """
    rng = np.random.default_rng(seed)
    a, b = rng.normal(size=(k, k)), rng.normal(size=(k, k))
    matrix = a @ a.T + 0.05 * np.eye(k) + skewness * (b - b.T)
    right = matrix @ rng.normal(size=k) * rng.choice([0.1, 1.0, 10.0])
    s, solved = solve_box(matrix, right, np.clip(rng.choice([-1.0, 0.0, 0.4, 1.0], size=k), *bounds), *bounds)
    left, (low, high) = right - matrix @ s, bounds
    assert solved and np.all(low <= s) and np.all(s <= high)
    assert np.all(left[s < high] < 1e-8) and np.all(left[s > low] > -1e-8)


def test_a_singular_block_is_reported():
    s, solved = solve_box(np.zeros((2, 2)), np.array([0.1, 0.2]), np.zeros(2))
    assert not solved
    assert np.all(np.isfinite(s)) and np.all(np.abs(s) <= 1.0)


@pytest.mark.integration
@pytest.mark.parametrize("seed", [1154, 1279])
def test_steps_in_which_no_tensions_meet_the_linearised_displacements_converge(seed: int) -> None:
    """Two robots of the fuzz with six tendons; without any one of them they converged before.

    Friction from earlier iterations acted against the pull, or a bay was near buckling, so that the linearised problem
    had no solution. Slack tendons then stayed slack, and the first step of one robot and the second of the other were
    not solved: a relative residual of 1e-3 after 20 iterations, and 1.3e-4 after 40.
    """
    case = drawing.draw(seed)
    result = simulate(case.robot, case.model, case.steps[:2])
    assert result.converged, result.message
    for step in result.steps:
        assert step.residual <= 1e-8
        checked = check_step(result.robot, result.model, step)
        assert all(checked[check.name] <= check.tolerance for check in CHECKS if check.name in checked)


@pytest.mark.integration
def test_slips_of_a_tendon_that_adhesion_holds_while_its_base_is_slack():
    """A force at mid-span slackens and tightens a released tendon within one load step.

    Taken whole, the step was 1.6e-4 of the length off the same step in 100 substeps, and nothing was said. Now it is
    off by less than the path tolerance.
    """
    given = {"adhesion": 0.01, "axial_stiffness": 1500.0, "pretension": 0.5}
    routings = [ConvergingRouting(5e-3, 2e-3, 120.0 * k) for k in range(3)]
    tendons = tuple(Tendon(f"t{k}", x, 0.25, **given) for k, x in enumerate(routings))
    backbone = Backbone(0.24, 0.45e-3, 85e9, 0.3, 5600.0, taper=((0.0, 0.45e-3), (0.24, 0.3e-3)))
    robot = Robot(backbone, Disks.equally_spaced(12, 0.24, mass=2e-4, radius=6e-3), tendons)
    model = Model(gravity=(0.0, 0.0, -9.81), elements_per_bay=1)
    loads = {"m": Load(0.13, (0.05, 0.08, -0.03), (0.0, 0.0, 0.003))}
    steps = [LoadStep(displacements={"t0": 4e-3, "t1": -2e-3, "t2": -2e-3}), LoadStep(loads=loads)]
    whole = simulate(robot, model, steps)
    fine = simulate(robot, model, [steps[0], replace(steps[1], substeps=100)])
    assert whole.steps[1].tensions[1][0] == 0.0 and whole.steps[1].tensions[1][-1] > 0.1
    assert np.max(np.abs(whole.steps[1].positions - fine.steps[1].positions)) < 2e-5 * 0.24

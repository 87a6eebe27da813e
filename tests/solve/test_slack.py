"""Tendons with prescribed displacements that become slack and taut: complementarity problems, and whole robots."""

from __future__ import annotations

from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from robots import BACKBONE, DISKS, LENGTH, tendon

from tdcr_fe.elements.complementarity import positive_definite_near, solve_nonnegative
from tdcr_fe.model.backbone import Backbone
from tdcr_fe.model.loading import Load, LoadStep, Model
from tdcr_fe.model.robot import Disks, Robot
from tdcr_fe.model.routing import ConvergingRouting, ParallelRouting
from tdcr_fe.model.tendon import Tendon
from tdcr_fe.solve.equations.linearization import BorderedFactors, DenseFactors
from tdcr_fe.solve.simulate import simulate
from tdcr_fe.validation.fuzz.checks import CHECKS, check_step
from tdcr_fe.validation.fuzz.drawing import draw

ANGLES = {"a": (0.0, 120.0, 240.0), "b": (40.0, 160.0, 280.0)}
#: Arc lengths of the anchors: the middle disk and the last one.
ENDS = {"a": float(DISKS.positions[5]), "b": float(DISKS.positions[-1])}


def two_segments(mu: float) -> Robot:
    """Three tendons to the middle disk, three to the last one."""
    tendons = [
        tendon(f"{segment}{i}", angle, mu, end=ENDS[segment])
        for segment, angles in ANGLES.items()
        for i, angle in enumerate(angles)
    ]
    return Robot(BACKBONE, DISKS, tuple(tendons), name="two segments")


def bending(angle: float, plane: float, spare: float) -> LoadStep:
    """Displacements of an arc of that angle [rad], and by how much tendons on the inner side are let out more [m]."""
    displacements = {}
    for segment, angles in ANGLES.items():
        for i, own in enumerate(angles):
            arc = 4.5e-3 * angle * ENDS[segment] / LENGTH * np.cos(np.radians(own) - plane)
            displacements[f"{segment}{i}"] = float(arc - (spare if arc < 0.0 else 0.0))
    return LoadStep("", displacements=displacements)


@pytest.mark.parametrize("seed", range(20))
def test_the_complementarity_problem_of_tensions_is_that_of_the_best_partition(seed: int) -> None:
    """Against all 2^k partitions: exactly one has no negative tension and no tendon that is too long."""
    rng = np.random.default_rng(seed)
    k = int(rng.integers(1, 7))
    root = rng.normal(size=(k, k))
    matrix, right = root @ root.T + 0.1 * np.eye(k), rng.normal(size=k)
    found, solved = solve_nonnegative(matrix, right, np.maximum(rng.normal(size=k), 0.0))
    assert solved
    solutions = []
    for taut in product((False, True), repeat=k):
        which, z = np.array(taut), np.zeros(k)
        z[which] = np.linalg.solve(matrix[np.ix_(which, which)], -right[which])
        if np.all(z >= 0.0) and np.all(right + matrix @ z >= -1e-12):
            solutions.append(z)
    assert len(solutions) == 1
    assert found == pytest.approx(solutions[0], abs=1e-10)


@pytest.mark.parametrize("seed", range(20))
def test_a_positive_definite_matrix_near_any_other_has_tensions_for_any_displacements(seed: int) -> None:
    """One that is definite already is left as it is, the eigenvalues of any other are positive."""
    rng = np.random.default_rng(seed)
    k = int(rng.integers(1, 7))
    matrix, right = rng.normal(size=(k, k)), rng.normal(size=k)
    near = positive_definite_near(matrix)
    assert near == pytest.approx(near.T)
    assert np.linalg.eigvalsh(near)[0] > 0.0
    found, solved = solve_nonnegative(near, right, np.zeros(k))
    excess = right + near @ found
    assert solved
    assert excess.min() >= -1e-10 and np.abs(found * excess).max() <= 1e-10
    definite = np.eye(k) + 0.1 * near / np.abs(near).max()
    assert positive_definite_near(definite) == pytest.approx(definite, abs=1e-14)


@pytest.mark.parametrize("seed", [1154, 1279])
def test_steps_in_which_no_tensions_meet_the_linearised_displacements_converge(seed: int) -> None:
    """Two robots of the fuzz with six tendons; without any one of them they converged before.

    Friction from earlier iterations acted against the pull, or a bay was near buckling, so that the linearised problem
    had no solution. Slack tendons then stayed slack, and the first step of one robot and the second of the other were
    not solved: a relative residual of 1e-3 after 20 iterations, and 1.3e-4 after 40.
    """
    case = draw(seed)
    result = simulate(case.robot, case.model, case.steps[:2])
    assert result.converged, result.message
    for step in result.steps:
        assert step.residual <= 1e-8
        checked = check_step(result.robot, result.model, step)
        assert all(checked[check.name] <= check.tolerance for check in CHECKS if check.name in checked)


def test_bordered_factors_are_those_of_the_whole_matrix() -> None:
    """Solution for one and several right sides and the sign of the determinant, with every set of slack tendons."""
    rng = np.random.default_rng(5)
    n, k = 12, 3
    inner, columns, rows = (rng.normal(size=s) for s in ((n, n), (n, k), (k, n)))
    own = rng.normal(size=k)
    factors = BorderedFactors.of(DenseFactors.of(inner.copy()), columns, rows, own, np.zeros(k, dtype=bool))
    for slack in product((False, True), repeat=k):
        loose = np.array(slack)
        lower = np.where(loose[:, None], np.eye(k, n + k, n), np.hstack((rows, np.diag(own))))
        whole = np.vstack((np.hstack((inner, columns)), lower))
        changed = factors.with_slack(loose)
        for right in (rng.normal(size=n + k), rng.normal(size=(n + k, 4))):
            assert whole @ changed.solve(right) == pytest.approx(right, abs=1e-11)
        assert changed.sign == np.sign(np.linalg.det(whole))


@pytest.mark.parametrize("mu", [0.0, 0.1])
def test_small_steps_of_a_robot_with_slack_tendons_take_few_iterations(mu: float) -> None:
    """Six tendons, those on the inner side let out a little more than needed, through two bends in two planes.

    Which tendons were slack was judged before the robot had moved: a tendon let out counted as slack until the others
    had pulled the robot after it, which took up to 6 iterations a step, 3.4 in the mean.
    """
    path = [(0.1 * k, 0.4, 2e-5 * (k % 3)) for k in range(1, 9)]
    path += [(0.8, 0.4 + 0.1 * k, 2e-5 * (k % 3)) for k in range(1, 9)]
    steps = [bending(*x) for x in path]
    friction = "per-hole" if mu else "none"
    result = simulate(two_segments(mu), Model(friction=friction, elements_per_bay=1), steps)  # type: ignore[arg-type]
    assert result.converged
    tensions = np.array([s.base_tensions for s in result.steps])
    assert np.count_nonzero((tensions > 0.0).any(axis=0)) > 3 and (tensions == 0.0).any()
    assert max(s.residual for s in result.steps) <= 1e-8
    assert np.mean([s.iterations / s.substeps for s in result.steps]) <= 3.1


@pytest.mark.parametrize("drive", ["displacements", "tensions"])
def test_a_step_in_which_all_tendons_stay_slack_is_solved(drive):
    """A ValueError ("cannot reshape array of size 0") where slips were followed with no tendon under tension."""
    tendons = tuple(Tendon(f"t{k}", ParallelRouting(4e-3, 120.0 * k), 0.3) for k in range(2))
    robot = Robot(Backbone(0.2, 0.4e-3, 85e9, 0.3), Disks.equally_spaced(4, 0.2), tendons)
    slack = {drive: dict.fromkeys(robot.tendon_names, -0.02 if drive == "displacements" else 0.0)}
    pushes = [0.01, 0.03, 0.05]
    steps = [LoadStep("", loads={"tip": Load(0.2, (x, 0.0, 0.0))}, **slack) for x in pushes]
    bare = [LoadStep("", loads={"tip": Load(0.2, (x, 0.0, 0.0))}) for x in pushes]
    model = Model(elements_per_bay=2)
    result = simulate(robot, model, steps).raise_if_failed()
    expected = simulate(Robot(robot.backbone, robot.disks), model, bare).raise_if_failed()
    np.testing.assert_allclose(result.tips, expected.tips, rtol=0.0, atol=1e-9)


def test_slips_of_a_tendon_that_adhesion_holds_while_its_base_is_slack():
    """A force at mid-span slackens and tightens a released tendon within one load step.

    Taken whole, the step was 1.6e-4 of the length off the same step in 100 substeps, and nothing was said. Now it is
    off by less than the path tolerance.
    """
    tendons = tuple(
        Tendon(
            f"t{k}",
            ConvergingRouting(5e-3, 2e-3, 120.0 * k),
            friction_coefficient=0.25,
            adhesion=0.01,
            axial_stiffness=1500.0,
            pretension=0.5,
        )
        for k in range(3)
    )
    taper = ((0.0, 0.45e-3), (0.24, 0.3e-3))
    backbone = Backbone(0.24, 0.45e-3, 85e9, 0.3, 5600.0, taper=taper)
    robot = Robot(backbone, Disks.equally_spaced(12, 0.24, mass=2e-4, radius=6e-3), tendons)
    model = Model(gravity=(0.0, 0.0, -9.81), elements_per_bay=1)
    steps = [
        LoadStep(displacements={"t0": 4e-3, "t1": -2e-3, "t2": -2e-3}),
        LoadStep(loads={"m": Load(0.13, (0.05, 0.08, -0.03), (0.0, 0.0, 0.003))}),
    ]
    whole = simulate(robot, model, steps)
    fine = simulate(robot, model, [steps[0], replace(steps[1], substeps=100)])
    assert whole.steps[1].tensions[1][0] == 0.0 and whole.steps[1].tensions[1][-1] > 0.1
    assert np.max(np.abs(whole.steps[1].positions - fine.steps[1].positions)) < 2e-5 * 0.24


def test_adhesion_in_tendons_that_are_pulled_one_after_another():
    """Adhesion holds tension in two tendons that are slack at the base, while the third is pulled and released.

    Slips of tendons that are slack at the base were not followed: the path was divided 64 times, with errors of up to
    2e-3 of the length. Derivatives of the tensions jump where a hole with no tension before it begins to be released;
    used across such a point, they left 1.1e-3, and nothing was said. The last step has a second equilibrium with the
    same history, 1.1e-4 away: whether it was taken hung on round-off. The reference has 200 substeps in every
    step that is not a first pull; its own error falls with their number, and is 2e-5.
    """
    routings = [ConvergingRouting(5.8e-3, 3.2e-3, angle) for angle in (30.0, 150.0, 270.0)]
    tendons = tuple(
        Tendon(f"t{k}", routing, friction_coefficient=0.3, adhesion=0.023)
        for k, routing in enumerate(routings, 1)
    )
    backbone = Backbone(0.376, 0.36e-3, 87e9, 0.3, 6450.0)
    robot = Robot(backbone, Disks.equally_spaced(8, 0.376, mass=5e-4, radius=7e-3), tendons)
    push = {"tip": Load(0.376, (3.7e-3, 2.1e-3, 0.0))}
    steps = [
        LoadStep(tensions={"t3": 0.19}),
        LoadStep(tensions={"t3": 0.75}),
        LoadStep(loads=push),
        LoadStep(tensions={"t3": 0.26}),
        LoadStep(loads={"tip": Load(0.376)}),
        LoadStep(tensions={"t3": 0.42}),
    ]
    model = Model(elements_per_bay=1)
    cut = [*steps[:2], *(replace(step, substeps=200) for step in steps[2:])]
    fine = simulate(robot, model, cut).raise_if_failed()
    for change in (0.0, 1e-12, -1e-12, 2e-9):
        slightly = [LoadStep(tensions={"t3": 0.19 * (1.0 + change)}), *steps[1:]]
        result = simulate(robot, model, slightly).raise_if_failed()
        off = np.linalg.norm(result.tips - fine.tips, axis=1)
        assert np.max(off) < 3e-5 * 0.376
        assert max(step.substeps for step in result.steps) <= 12

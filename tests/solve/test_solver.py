"""Newton in strain space: its tangent against differences, how fast it converges, how it fails and goes back."""

from __future__ import annotations

from dataclasses import replace

import exudyn as exu
import exudyn.itemInterface as eii
import numpy as np
import pytest
from robots import BACKBONE, DISKS, distance, paper, pull, scene, solve, three
from scipy.spatial.transform import Rotation

from tdcr_fe.elements.backbone import strain_matrices
from tdcr_fe.model.loading import LoadStep
from tdcr_fe.model.robot import Robot, Superelastic, Tendon
from tdcr_fe.model.routing import HelicalRouting
from tdcr_fe.model.settings import SolverSettings
from tdcr_fe.solve.solver import NotConverged, StrainSpaceSolver
from tdcr_fe.solve.stepping import StepFailed

HELIX = Robot(BACKBONE, DISKS, (Tendon("t1", HelicalRouting(4.5e-3, 1.0), 0.3),), name="helix")


def newton(robot, tensions, settings=None, by_displacement=False, prepare=None, **model):
    """One solve from straight; the solver at the solution, and its report."""
    keep, mbs, handle = scene(robot, assemble=False, **model)
    if prepare is not None:
        prepare(handle)
    mbs.Assemble()
    solver = StrainSpaceSolver(mbs, settings)
    handle.actuation.by_displacement[:] = by_displacement
    report = solver.newton([np.asarray(tensions, dtype=float)])
    return keep, handle, solver, report


@pytest.mark.parametrize(
    ("robot", "tensions", "model"),
    [
        pytest.param(paper(), [1.0], {"friction": "none"}, id="no friction"),
        pytest.param(three(0.3), [1.0, 0.4, 0.0], {"friction": "per-tendon"}, id="per-tendon"),
        pytest.param(three(0.3), [0.5, 0.2, 0.0], {"friction": "per-hole"}, id="per-hole"),
        pytest.param(HELIX, [1.0], {"friction": "per-hole"}, id="helical"),
        pytest.param(paper(), [1.0], {"friction": "none", "tendon_path": "continuous"}, id="continuous"),
        pytest.param(
            paper(0.3, backbone=replace(BACKBONE, superelastic=Superelastic(0.002, 0.5))),
            [0.8],
            {},
            id="superelastic",
        ),
    ],
)
def test_newton_converges_quadratically(robot, tensions, model):
    """The tangent is consistent, away from equilibrium too: each residual is of the order of the last one's square."""
    *_, report = newton(robot, tensions, SolverSettings(tolerance=1e-9), **model)
    assert report.iterations <= 6
    r = np.array(report.residuals)
    near = np.flatnonzero((r[:-1] < 5e-2) & (r[:-1] > 1e-5))
    assert near.size
    assert np.all(r[near + 1] <= np.maximum(10.0 * r[near] ** 2, 1e-8))


@pytest.mark.parametrize(
    ("robot", "model"),
    [
        pytest.param(three(0.0), {"friction": "none"}, id="no friction"),
        pytest.param(three(0.3), {"friction": "per-hole"}, id="per-hole"),
        pytest.param(three(0.3, axial_stiffness=300.0), {"friction": "per-tendon"}, id="per-tendon, elastic"),
        pytest.param(three(0.0), {"friction": "none", "tendon_path": "continuous"}, id="continuous"),
        pytest.param(
            three(0.3, replace(BACKBONE, superelastic=Superelastic(0.001, 0.5))), {}, id="superelastic"
        ),
    ],
)
def test_tangent_of_the_complete_system_against_differences(robot, model):
    """Change of all nodal wrenches when single strains change, poses rebuilt by exponentials; at equilibrium.

    There the turning of the frames in which the residual is written does not matter.
    """
    tensions = np.array([1.0, 0.5, 0.2])
    _keep, handle, solver, _ = newton(
        robot, tensions, SolverSettings(tolerance=1e-12, max_iterations=30), **model
    )
    n = len(handle.nNodes)
    solver._update_forces()
    solver._residual()
    k = np.array(solver._jacobian(0.0))
    start = [x.copy() for x in solver.now.twists]
    # Increments of the nodes that change one strain: what the strain matrices say, solved from the base on.
    b = strain_matrices(start[0])
    rng = np.random.default_rng(0)
    for element in (0, 5, 12):
        change = np.zeros((n - 1, 6))
        change[element] = rng.normal(size=6) * [1e-3, 1e-3, 1e-3, 1.0, 1.0, 1.0]
        nodes = np.zeros((n, 6))
        for e in range(n - 1):
            nodes[e + 1] = np.linalg.solve(b[e, :, 6:], change[e] - b[e, :, :6] @ nodes[e])
        found = []
        h = 1e-6
        for sign in (1.0, -1.0):
            solver.now.twists = [start[0] + sign * h * change]
            solver.now.rebuild()
            solver._update_forces()
            found.append(np.array(solver._residual()))
        difference = (found[0] - found[1]) / (2 * h)
        predicted = k[:, : 6 * n] @ nodes.ravel()
        scale = np.max(np.abs(difference[: 6 * n]))
        assert predicted[: 6 * n] == pytest.approx(difference[: 6 * n], abs=2e-5 * scale)
    solver.now.twists = start
    solver.now.rebuild()


@pytest.mark.parametrize("axial_stiffness", [None, 300.0], ids=["inextensible", "elastic"])
def test_forces_and_slips_by_mobilisation_against_differences(axial_stiffness):
    """The other columns and rows of the system: what a hole gives and what moves it."""
    robot = three(0.3, axial_stiffness=axial_stiffness)
    _keep, handle, solver, _ = newton(robot, [1.0, 0.5, 0.2])
    act = handle.actuation
    s = 0.5 * solver._mobilisation[0]
    h = 1e-6
    (p, r), tension = solver.now.poses[0], act.base_tension.copy()

    def state(s):
        act.update_mixed(p, r, tension, s, solver.now.twists[0])
        solver._mobilisation[0] = s
        solver._update_forces()
        force = np.array(solver._residual())[: 6 * len(handle.nNodes)]
        return force, act.field.slip[act.law.frictional].copy(), act.field.base_slip.copy()

    state(s)
    columns, (_, _, own) = act.mobilisation_columns().copy(), act.slip_rows()
    base = act.base_slip_by_mobilisation().copy()
    # Exudyn's residual is what is unbalanced: inner less applied force, or the other way round; one sign for all.
    for index, (i, g) in enumerate(zip(*np.nonzero(act.law.frictional), strict=True)):
        if index % 7:
            continue
        shift = np.zeros_like(s)
        shift[i, g] = h
        up, down = state(s + shift), state(s - shift)
        force, slip, base_slip = ((a - b) / (2 * h) for a, b in zip(up, down, strict=True))
        assert columns[:, index] == pytest.approx(force, abs=1e-6)
        assert own[:, index] == pytest.approx(slip, abs=1e-8)
        assert base[:, index] == pytest.approx(base_slip, abs=1e-8)


def test_residual_is_a_number_of_the_size_of_the_force():
    """Straight robot, 1 N: a tendon of 1 N unbalanced at its ends."""
    *_, report = newton(paper(), [1.0], friction="none")
    assert report.residuals[0] == pytest.approx(1.0, rel=0.05)
    assert report.residual < 1e-8


@pytest.mark.parametrize("friction", ["none", "per-hole"])
def test_a_turned_robot_takes_the_same_iterations(friction):
    counts = set()
    for seed in range(3):
        turn = Rotation.random(random_state=seed).as_matrix()
        *_, report = newton(paper(0.3), [2.5], friction=friction, baseRotationMatrix=turn)
        counts.add(report.iterations)
    assert len(counts) == 1


def test_going_back_to_a_snapshot():
    """Solve, go on, go back: the same state to the bit, and the same way onwards."""
    _keep, _, solver, _ = newton(paper(0.3), [1.0])
    solver.commit()
    before = solver.snapshot()
    shape = solver.positions().copy()
    solver.newton([np.array([2.0])])
    once = solver.positions().copy()
    solver.commit()
    solver.restore(before)
    assert np.array_equal(solver.positions(), shape)
    solver.newton([np.array([2.0])])
    assert distance(solver.positions(), once) < 1e-12


def test_a_snapshot_is_not_changed_by_what_follows():
    _keep, _, solver, _ = newton(paper(0.3), [1.0])
    before = solver.snapshot()
    at = before.place
    seen = (at.coordinates, at.multipliers, at.twists[0], before.tensions[0])
    kept = [x.copy() for x in seen]
    solver.newton([np.array([2.0])])
    for a, b in zip(kept, seen, strict=True):
        assert np.array_equal(a, b)


def test_history_is_committed_only_when_told():
    _keep, handle, solver, _ = newton(paper(0.3), [1.0])
    assert np.all(handle.actuation.state.mobilisation == 0.0)
    solver.commit()
    assert np.all(handle.actuation.state.mobilisation == 1.0)


def test_a_body_that_moves_freely_is_reported():
    keep = exu.SystemContainer()
    mbs = keep.AddSystem()
    from tdcr_fe.model.loading import Model
    from tdcr_fe.scene.builder import CreateTDCR

    CreateTDCR(mbs, paper(0.3), Model(elements_per_bay=1))
    node = mbs.AddNode(eii.NodePoint(referenceCoordinates=[1.0, 0.0, 0.0]))
    mbs.AddObject(eii.MassPoint(nodeNumber=node, mass=1.0))
    mbs.Assemble()
    with pytest.raises(NotConverged, match="moves freely"):
        StrainSpaceSolver(mbs).newton([np.array([1.0])])


def test_failure_names_residual_place_and_cure():
    _keep, mbs, handle = scene(paper(0.3))
    handle.set_tensions([1e6])
    from tdcr_fe.solve.statics import SolveTDCR

    with pytest.raises(StepFailed, match=r"residual.*Try smaller load steps") as caught:
        SolveTDCR(mbs, SolverSettings(min_substep=0.25))
    assert caught.value.share == 0.0 and caught.value.residual > 0.0


def test_scene_larger_than_a_thousand_coordinates_stays_silent(capfd):
    """Numerics print nothing, Exudyn's advice on large systems included."""
    solve(paper(0.0), pull(1.0), friction="none", elements_per_bay=12)
    out = capfd.readouterr()
    assert out.out.strip() == "" and out.err.strip() == ""


def test_other_bodies_of_the_scene_are_solved_too():
    """A mass on a spring under a force hangs at F/k beside the robot."""
    keep = exu.SystemContainer()
    mbs = keep.AddSystem()
    from tdcr_fe.model.loading import Model
    from tdcr_fe.scene.builder import CreateTDCR

    node = mbs.AddNode(eii.NodePoint(referenceCoordinates=[1.0, 0.0, 0.0]))
    body = mbs.AddObject(eii.MassPoint(nodeNumber=node, mass=1.0))
    marker = mbs.AddMarker(eii.MarkerBodyPosition(bodyNumber=body))
    ground = mbs.AddMarker(
        eii.MarkerBodyPosition(bodyNumber=mbs.AddObject(eii.ObjectGround()), localPosition=[1, 0, 0])
    )
    mbs.AddObject(eii.CartesianSpringDamper(markerNumbers=[ground, marker], stiffness=[200.0] * 3))
    mbs.AddLoad(eii.Force(markerNumber=marker, loadVector=[0.0, 4.0, 0.0]))
    handle = CreateTDCR(mbs, paper(0.3), Model(elements_per_bay=1))
    mbs.Assemble()
    StrainSpaceSolver(mbs).newton([np.array([1.0])])
    at = mbs.GetNodeOutput(node, exu.OutputVariableType.Position)
    assert at == pytest.approx([1.0, 0.02, 0.0], abs=1e-9)
    expected = solve(paper(0.3), [LoadStep("", {"t1": 1.0})]).tips[-1]
    assert distance(handle.tip_position, expected) < 1e-8

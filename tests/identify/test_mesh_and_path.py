"""The error of the mesh is told apart from that of the friction path: both runs take the same substeps."""

from dataclasses import replace

import numpy as np
from identify_data import FRICTIONAL, ROBOT, measured, simulated
from identify_search import problem_of

from tdcr_fe.identify.forward import ForwardModel
from tdcr_fe.identify.problem import ORDER, evaluate, refine, with_elements
from tdcr_fe.identify.run import mesh_nodes

#: Far coarser than the noise: the path is then off by more than the mesh.
LOOSE = 3e-3


def problem(data, path_tolerance=LOOSE):
    return replace(problem_of(data), path_tolerance=path_tolerance)


def test_a_path_is_taken_to_another_mesh_with_the_twist_of_the_backbone():
    """The sum of the elements' twists is that of the whole backbone; holes and tendons have the same states."""
    about = measured(robot=ROBOT, model=FRICTIONAL).experiment
    run = simulated(about, 1e-4, record=True)
    finer = with_elements(about, 3)
    (own,) = run.trajectories
    moved = own.on_mesh(mesh_nodes(finer))
    for before, after in zip(own.waypoints, moved.waypoints, strict=True):
        for a, b in zip(before, after, strict=True):
            assert a.load_factor == b.load_factor
            (coarse,), (fine,) = a.state.unknowns.twists, b.state.unknowns.twists
            assert len(fine) == 3 * len(coarse)
            np.testing.assert_allclose(fine.sum(axis=0), coarse.sum(axis=0), atol=1e-12)
            np.testing.assert_array_equal(a.state.mobilisation[0], b.state.mobilisation[0])
    along, free = simulated(finer, 1e-4, (moved,)), simulated(finer, 1e-4)
    np.testing.assert_allclose(along.positions, free.positions, atol=1e-5)


def test_the_error_of_the_path_is_not_counted_as_error_of_the_mesh(monkeypatch):
    """A blind set (two segments, hole adhesion) was refined to six elements a bay for a path error of one sigma.

    Its mesh error was 0.14 sigma with one. Every run then cost five times as much, and the set took 270 s. Every run on
    a finer mesh takes the substeps of the coarser one; the estimate is that of runs whose path is resolved.
    """
    data = measured({"hole_adhesion": {"drop": 0.05}}, robot=ROBOT, model=FRICTIONAL)
    asked, run = [], ForwardModel.run

    def recorded(self, jobs, *rest):
        asked.extend((j.experiment.model.elements_per_bay, j.reference is not None) for j in jobs)
        return run(self, jobs, *rest)

    monkeypatch.setattr(ForwardModel, "run", recorded)
    refined, _ = refine(problem(data), (), {})
    assert asked[0] == (1, False) and all(along for n, along in asked if n > 1)
    fine = problem(data, 1e-5)
    meshes = [replace(fine, experiment=with_elements(fine.experiment, n)) for n in (1, 6)]
    coarse, exact = (evaluate(x, (), {}).residual for x in meshes)
    true_error = float(np.sqrt(np.mean((coarse - exact) ** 2)))
    found = refined.mesh_error * refined.experiment.model.elements_per_bay**ORDER
    assert 0.8 * true_error < found < 1.25 * true_error

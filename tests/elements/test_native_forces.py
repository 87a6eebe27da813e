"""Forces of tendons and backbone for Exudyn's own solvers, their derivatives, and Jacobians of a step."""

from dataclasses import replace

import numpy as np
import pytest
from robots import LENGTH, tendon, three
from scenes import recommended, scene, scene_with, solve_scene, tip_load

from tdcr_fe import Disks, HelicalRouting
from tdcr_fe.elements.native.coordinates import twists_by_coordinates
from tdcr_fe.elements.poses import rotation_of_euler_parameters


def robots():
    """Robots whose tendons have constant tension or friction, end at different disks, and wind around."""
    ends = (LENGTH * 7 / 13, LENGTH, LENGTH * 10 / 13)
    shorter = tuple(tendon(f"t{i + 1}", 120.0 * i, 0.3, end=end) for i, end in enumerate(ends))
    helical = replace(tendon("t1"), routing=HelicalRouting(4.5e-3, 1.0, 20.0))
    return {
        "three": (three(0.3), {}),
        "per tendon": (three(0.3), {"friction": "per-tendon"}),
        "no friction": (three(0.0), {"friction": "none"}),
        "one ends earlier": (replace(three(0.3), tendons=shorter), {}),
        "two elements a bay": (three(0.3), {"elements_per_bay": 2}),
        "all end earlier": (replace(three(0.3), tendons=shorter[:1]), {}),
        "helical": (replace(three(0.3), tendons=(helical,)), {}),
        "one disk": (three(0.3, disks=Disks.equally_spaced(1, LENGTH, mass=1e-3)), {"elements_per_bay": 4}),
    }


@pytest.mark.parametrize("case", robots())
def test_the_tangent_is_the_derivative_of_the_forces(case):
    """By central differences along all motions of the nodes, in configurations with sticking and sliding holes."""
    robot, model = robots()[case]
    _keep, _mbs, handle = scene(robot, **model)
    handle.set_tensions([1.0, 0.4, 0.2][: len(robot.tendons)])
    actuation, rng = handle.actuation, np.random.default_rng(1)
    reference = actuation.node_coordinates.reference
    for size in (1e-7, 1e-4, 1e-2):
        there = reference + size * rng.normal(size=reference.shape)
        there[:, 3:] /= np.linalg.norm(there[:, 3:], axis=1)[:, None]
        moved = (there - reference).ravel()
        # Solvers ask with a negative factor; without an iterate before, there are no secants.
        actuation._scene_forces.forget()
        tangent = np.array(actuation.jacobian_on_coordinates(moved, 0.0, -1.0, 0.0).Convert2DenseMatrix())
        to_twist = twists_by_coordinates(rotation_of_euler_parameters(there[:, 3:]), there[:, 3:])
        change = min(1e-9, 1e-3 * size)
        for node, axis in np.ndindex(len(there), 6):
            way = np.zeros(there.shape)
            way[node] = np.linalg.pinv(to_twist[node])[:, axis]
            step = change * way.ravel()
            ends = [actuation.forces_on_coordinates(moved + sign * step, 0.0) for sign in (1.0, -1.0)]
            error = tangent @ way.ravel() - (ends[0] - ends[1]) / (2.0 * change)
            assert np.abs(error).max() <= 1e-5 * np.abs(tangent).max()


# ------------------------------------------------------------ iterated tendons


@pytest.mark.parametrize("count", [1, 3])
def test_a_swing_with_friction_takes_few_jacobians(count):
    """With holes that change between stick and slip: 1.3 to 1.6 a step of 1 ms; without the prediction 1.8 to 2.3."""
    _keep, mbs, handle, load = scene_with(tip_load, three(0.3))
    solve_scene(mbs, handle, [1.0, *([0.3, 0.2] if count == 3 else [0.0, 0.0])])
    load.set([0.0, 0.005, 0.003])
    assert mbs.SolveDynamic(recommended(handle, 0.1, 1e-3))
    it = mbs.sys["dynamicSolver"].it
    assert 1.0 <= it.newtonJacobiCount / it.currentStepIndex < 1.75
    assert it.newtonStepsCount / it.currentStepIndex < 6.5

"""Forces of tendons and backbone for Exudyn's own solvers: the general evaluation, and Jacobians of a step."""

from dataclasses import replace

import numpy as np
import pytest
from native_solvers import recommended
from robots import LENGTH, scene, solve_scene, tendon, three

from tdcr_fe.model.robot import Disks
from tdcr_fe.model.routing import HelicalRouting


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
def test_forces_and_tangent_are_those_of_the_general_evaluation(case):
    """In configurations with sticking and sliding holes; unit Euler parameters."""
    robot, model = robots()[case]
    _keep, _mbs, handle = scene(robot, **model)
    count = len(robot.tendons)
    handle.set_tensions([1.0, 0.4, 0.2][:count])
    actuation, rng = handle.actuation, np.random.default_rng(1)
    scene_forces = actuation._scene_forces
    straight = scene_forces._straight
    assert straight is not None
    reference = actuation._node_coordinates.reference
    for size in (1e-7, 1e-4, 1e-2):
        there = reference + size * rng.normal(size=reference.shape)
        there[:, 3:] /= np.linalg.norm(there[:, 3:], axis=1)[:, None]
        moved = (there - reference).ravel()
        found, tangent = [], []
        for used in (straight, None):
            scene_forces._straight = used
            found.append(actuation.forces_on_coordinates(moved.tolist(), size))
            jacobian = actuation.jacobian_on_coordinates(moved.tolist(), size, 1.0, 0.0)
            tangent.append(np.array(jacobian.Convert2DenseMatrix()))
        scene_forces._straight = straight
        assert np.abs(found[0] - found[1]).max() <= 1e-9 * np.abs(found[1]).max()
        # By norms of Euler parameters, which constraints keep, both may differ.
        assert np.abs(tangent[0] - tangent[1]).max() <= 1e-8 * np.abs(tangent[1]).max()


# ------------------------------------------------------------ iterated tendons


@pytest.mark.parametrize("count", [1, 3])
def test_a_swing_with_friction_takes_few_jacobians(count):
    """With holes that change between stick and slip: 1.3 to 1.6 a step of 1 ms; without the prediction 1.8 to 2.3."""
    _keep, mbs, handle = scene(three(0.3), assemble=False)
    load = handle.add_load("tip", LENGTH)
    mbs.Assemble()
    solve_scene(mbs, handle, [1.0, *([0.3, 0.2] if count == 3 else [0.0, 0.0])])
    load.set([0.0, 0.005, 0.003])
    assert mbs.SolveDynamic(recommended(handle, 0.1, 1e-3))
    it = mbs.sys["dynamicSolver"].it
    assert 1.0 <= it.newtonJacobiCount / it.currentStepIndex < 1.65
    assert it.newtonStepsCount / it.currentStepIndex < 6.0

"""Forces of straight tendons for Exudyn's own solvers against the general evaluation, and their tangent."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from robots import LENGTH, scene, tendon, three

from tdcr_fe.elements.native.straight_tendons import StraightTendons
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


def test_robots_that_need_the_general_evaluation_have_none_of_this():
    for robot, model in (
        (three(0.3, axial_stiffness=400.0), {}),
        (three(0.0), {"tendon_path": "continuous", "friction": "none"}),
    ):
        _keep, _mbs, handle = scene(robot, **model)
        assert StraightTendons.of(handle.actuation.model) is None


def test_a_hole_that_has_saturated_since_the_iterate_before_is_linearised_by_the_secant():
    """From pulled to released by trial values of -1e4 and 3e4: two over their difference; the others by the tangent."""
    _keep, _mbs, handle = scene(three(0.3))
    straight = StraightTendons.of(handle.actuation.model)
    assert straight is not None
    law = handle.actuation.law
    there = handle.actuation._node_coordinates.reference
    pull = straight.pull(there, np.ones(3), law.initial_state())
    trial = np.full_like(pull.trial, 0.5)
    before, after = trial.copy(), trial.copy()
    before[0], after[0] = -1e4, 3e4
    before[1], after[1] = 5.0, 7.0
    before[2], after[2] = 5.0, 0.25
    before[3], after[3] = 0.5, 2.0
    slopes = pull._replace(trial=after).slopes(pull._replace(trial=before))
    assert slopes[:5, 0] == pytest.approx([2.0 / 4e4, 0.0, 1.0, 0.5 / 1.5, 1.0])
    assert pull._replace(trial=after).slopes(None)[:5, 0] == pytest.approx([0.0, 0.0, 1.0, 0.0, 1.0])

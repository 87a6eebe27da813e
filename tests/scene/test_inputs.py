"""Inputs of a robot in a scene: for single tendons, over time, refused where they are wrong; its base marker."""

from __future__ import annotations

import exudyn as exu
import exudyn.itemInterface as eii
import numpy as np
import pytest
from native_solvers import dynamic_settings, static_settings
from robots import LENGTH, distance, paper, scene, three
from scipy.spatial.transform import Rotation

from tdcr_fe.model.loading import Model
from tdcr_fe.native import register
from tdcr_fe.scene.builder import CreateTDCR

register()

MODEL = Model(friction="per-hole", elements_per_bay=1)


def test_a_tension_set_after_inputs_over_time_leaves_the_other_tendons_as_they_are():
    """In version 0.1 the tensions of t2 and t3 were set to zero."""
    _keep, mbs, handle = scene(three(0.3))
    handle.set_inputs_over_time(lambda t: [0.2 * t, 0.5 * t, 0.1 * t])
    assert mbs.SolveStatic(static_settings(20))
    handle.set_tensions({"t1": 0.3})
    assert handle.actuation.input_values() == pytest.approx([0.3, 0.5, 0.1], abs=1e-12)
    mbs.SolveTDCR()
    assert [handle.tensions()[t][0] for t in ("t1", "t2", "t3")] == pytest.approx([0.3, 0.5, 0.1])


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ([1.0], r"returned \[1.0\]; must be a number for each of 3 tendons"),
        ([0.1, -0.5, 0.1], r"returned -0.5 for tendon 't2'; must be finite, a tension >= 0"),
        ([0.1, 0.1, float("nan")], "returned nan for tendon 't3'"),
        ("fast", "must return a number for each of 3 tendons"),
    ],
)
@pytest.mark.parametrize("solver", ["SolveTDCR", "SolveStatic", "SolveDynamic"])
def test_wrong_inputs_over_time_are_refused_by_every_solver(solver, values, words):
    """In version 0.1 one value acted on three tendons, and -0.5 N pushed."""
    _keep, mbs, handle = scene(three(0.3))
    handle.set_inputs_over_time(lambda t: values)
    settings = {"SolveTDCR": (), "SolveStatic": (static_settings(5),)}.get(
        solver, (dynamic_settings(0.01, 1e-3),)
    )
    with pytest.raises((ValueError, RuntimeError), match=words):
        getattr(mbs, solver)(*settings)


def test_round_off_below_zero_tension_is_zero():
    _keep, mbs, handle = scene(three(0.3))
    handle.set_inputs_over_time(lambda t: [-1e-16, 0.1 * t, 0.0])
    mbs.SolveTDCR()
    assert handle.tensions()["t1"][0] == 0.0


def test_inputs_over_time_that_are_no_function_are_refused():
    with pytest.raises(TypeError, match="needs a function of the time"):
        scene(three(0.3))[2].set_inputs_over_time([1.0, 0.0, 0.0])


def carrier(position, rotation):
    """A free body with a rigid marker at a pose."""
    keep = exu.SystemContainer()
    mbs = keep.AddSystem()
    node = mbs.AddNode(eii.NodeRigidBodyEP(referenceCoordinates=[0.1, 0.2, 0.3, 1, 0, 0, 0]))
    body = mbs.AddObject(
        eii.ObjectRigidBody(nodeNumber=node, mass=1.0, inertia=[1.0, 1.0, 1.0, 0.0, 0.0, 0.0])
    )
    frame = exu.HT(rotation=rotation, translation=np.array(position) - [0.1, 0.2, 0.3])
    return keep, mbs, mbs.AddMarker(eii.MarkerBodyRigid(bodyNumber=body, localHT=frame))


def test_the_pose_of_the_base_is_that_of_its_marker():
    """In version 0.1 the pose had to be given a second time, and another one closed the joint by force."""
    turn = Rotation.from_euler("xyz", [0.3, -0.4, 1.0]).as_matrix()
    _keep, mbs, marker = carrier([0.5, 0.0, 0.1], turn)
    handle = CreateTDCR(mbs, paper(), MODEL, baseMarker=marker)
    mbs.Assemble()
    assert distance(handle.tip_position, [0.5, 0.0, 0.1] + turn @ [0.0, 0.0, LENGTH]) < 1e-12


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"basePosition": [0.0, 0.0, 0.0]}, "basePosition .* differs from that of baseMarker"),
        ({"baseRotationMatrix": np.eye(3)}, "baseRotationMatrix differs from the axes of baseMarker"),
    ],
)
def test_a_base_pose_other_than_that_of_the_marker_is_refused(given, words):
    _keep, mbs, marker = carrier([0.5, 0.0, 0.1], Rotation.from_euler("x", 0.3).as_matrix())
    with pytest.raises(ValueError, match=words):
        CreateTDCR(mbs, paper(), MODEL, baseMarker=marker, **given)

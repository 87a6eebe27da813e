"""Exudyn's argument names in `CreateTDCR` give what ours give; both at once are refused by name."""

from __future__ import annotations

import exudyn as exu
import exudyn.graphics as graphics
import exudyn.itemInterface as eii
import numpy as np
import pytest
from robots import scene, three

from tdcr_fe.model.loading import Model
from tdcr_fe.scene import CreateTDCR
from tdcr_fe.solve.statics import SolveTDCR

TURN = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])
HEAVY = [0.0, 0.0, -9.81]


def bent(mbs, handle):
    """Shape after a pull."""
    mbs.Assemble()
    handle.set_tensions([0.5, 0.1, 0.0])
    SolveTDCR(mbs)
    return handle.shape()[0]


def test_both_names_give_the_same_robot():
    _keep, mbs, handle = scene(
        three(0.0),
        assemble=False,
        gravity=tuple(HEAVY),
        basePosition=[0.1, 0.2, 0.0],
        baseRotationMatrix=TURN,
    )
    ours = bent(mbs, handle)
    brick = graphics.Brick([0.1, 0.2, -0.02], [0.05, 0.05, 0.01])
    _keep_other, other, made = _with_their_names(brick)
    theirs = bent(other, made["tdcr"])
    assert np.array_equal(ours, theirs)
    assert made["nodeNumbers"] == made["tdcr"].nNodes and made["diskNumbers"] == made["tdcr"].bDisks
    ground = other.GetObject(other.GetObjectNumber("three.ground"), addGraphicsData=True)
    assert len(ground["VgraphicsData"]) == 2
    assert list(other.GetObject(made["beamNumbers"][0])["Vcolor"]) == pytest.approx([1.0, 0.0, 0.0, 1.0])


def _with_their_names(brick):
    keep = exu.SystemContainer()
    mbs = keep.AddSystem()
    made = CreateTDCR(
        mbs,
        three(0.0),
        Model(friction="per-hole", elements_per_bay=1),
        referencePosition=[0.1, 0.2, 0.0],
        referenceRotationMatrix=TURN,
        gravity=HEAVY,
        color=[1.0, 0.0, 0.0, 1.0],
        graphicsDataList=[brick],
        returnDict=True,
    )
    return keep, mbs, made


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"basePosition": [0, 0, 0], "referencePosition": [0, 0, 0]}, "basePosition and referencePosition"),
        (
            {"baseRotationMatrix": np.eye(3), "referenceRotationMatrix": np.eye(3)},
            "baseRotationMatrix and referenceRotationMatrix",
        ),
        ({"gravity": HEAVY, "model": Model(gravity=tuple(HEAVY))}, "by the argument and by the model"),
        ({"color": [2.0, 0.0, 0.0, 1.0]}, "four numbers from 0 to 1"),
    ],
)
def test_two_names_at_once_and_wrong_values_are_refused(given, message):
    keep = exu.SystemContainer()
    with pytest.raises(ValueError, match=message):
        CreateTDCR(keep.AddSystem(), three(0.0), **given)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        (
            {"graphicsDataList": graphics.Sphere(radius=0.1)},
            "graphicsDataList is of type dict; expected a list of",
        ),
        ({"graphicsDataList": [0.1]}, "graphicsDataList is of type float; expected a list of graphics"),
        ({"show": "no"}, "show is 'no'; expected True or False"),
        ({"referencePosition": [0.0, 1.0]}, "referencePosition is of type list; expected 3 numbers"),
    ],
)
def test_arguments_of_another_type_are_refused_before_anything_is_added(given, message):
    """One graphic in place of a list was taken, ``show`` failed inside, and ``referencePosition`` had another name."""
    keep = exu.SystemContainer()
    mbs = keep.AddSystem()
    with pytest.raises(TypeError, match=message):
        CreateTDCR(mbs, three(0.0), **given)
    assert mbs.systemData.NumberOfNodes() == 0


def test_graphics_need_a_base_on_ground():
    keep = exu.SystemContainer()
    mbs = keep.AddSystem()
    marker = mbs.AddMarker(eii.MarkerBodyRigid(bodyNumber=mbs.CreateGround()))
    with pytest.raises(ValueError, match="graphicsDataList is drawn on the base"):
        CreateTDCR(mbs, three(0.0), baseMarker=marker, graphicsDataList=[graphics.Sphere(radius=0.1)])


def test_handles_print_in_a_line_and_are_told_apart():
    """They printed all arrays and items of the robot, and two of them could not be compared."""
    keep = exu.SystemContainer()
    mbs = keep.AddSystem()
    arms = [CreateTDCR(mbs, three(0.0), name=name) for name in ("left", "right")]
    assert repr(arms[0]) == "<TDCR 'left': 13 disks, tendons t1, t2, t3; nodes 0 to 26>"
    assert arms.index(arms[1]) == 1 and len(set(arms)) == 2

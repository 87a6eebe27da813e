"""Systems that are reset or edited after a robot was made, and solvers called where they cannot be."""

from __future__ import annotations

import exudyn as exu
import exudyn.itemInterface as eii
import numpy as np
import pytest
from native_solvers import dynamic_settings
from robots import LENGTH, distance, scene, three

from tdcr_fe.native import register
from tdcr_fe.solve.statics import SolveTDCR

register()
INPUTS = [0.5, 0.1, 0.1]


def solved(mbs, handle):
    """Tip after a pull."""
    handle.set_tensions(INPUTS)
    SolveTDCR(mbs)
    return handle.tip_position


def test_a_system_is_built_again_after_a_reset_with_other_items_first():
    _keep, mbs, old = scene(three(0.3), elements_per_bay=1)
    expected = solved(mbs, old)
    mbs.Reset()
    mbs.AddNode(eii.NodePointGround())
    new = mbs.CreateTDCR(three(0.3), old.model)
    mbs.Assemble()
    assert np.abs(solved(mbs, new) - expected).max() < 1e-9 * LENGTH
    for use in (lambda: old.tip_position, lambda: old.set_tensions(INPUTS)):
        with pytest.raises(ValueError, match="not in the system any more"):
            use()


@pytest.mark.parametrize(
    ("kind", "use"), [("node", "SolveTDCR"), ("object", "SolveDynamic"), ("object", "set_tensions")]
)
def test_items_deleted_before_those_of_a_robot_are_refused(kind, use):
    keep = exu.SystemContainer()
    mbs = keep.AddSystem()
    node = mbs.AddNode(eii.NodePoint(referenceCoordinates=[1.0, 0.0, 0.0]))
    ground = mbs.CreateGround(referencePosition=[1.0, 0.0, 0.0])
    handle = mbs.CreateTDCR(three(0.3))
    if kind == "object":
        mbs.DeleteObject(ground)
    else:
        mbs.DeleteNode(node)
    mbs.Assemble()
    with pytest.raises((ValueError, RuntimeError), match="because items were deleted"):
        if use == "set_tensions":
            handle.set_tensions(INPUTS)
        elif use == "SolveTDCR":
            SolveTDCR(mbs)
        else:
            mbs.SolveDynamic(dynamic_settings(2e-3, 1e-3))


def test_solve_tdcr_in_a_step_function_is_refused():
    _keep, mbs, handle = scene(three(0.3))

    def before(mbs, t):
        SolveTDCR(mbs)
        return True

    mbs.SetPreStepUserFunction(before)
    with pytest.raises(ValueError, match="it is solving already"):
        solved(mbs, handle)
    mbs.SetPreStepUserFunction(0)
    assert np.isfinite(solved(mbs, handle)).all()
    assert handle.tensions()["t1"][0] == pytest.approx(0.5)


# ---------------------------------------------------------------- base joint


def test_a_robot_whose_base_joint_is_switched_off_is_refused_unless_something_else_holds_it():
    """Without its base it has no position at rest."""
    _keep, mbs, handle = scene(three(0.3), assemble=False)
    expected = solved(*scene(three(0.3))[1:])
    ground = mbs.AddMarker(eii.MarkerBodyRigid(bodyNumber=mbs.CreateGround()))
    stiffness = np.diag([1e6] * 3 + [1e3] * 3)
    spring = mbs.AddObject(
        eii.RigidBodySpringDamper(
            markerNumbers=[ground, handle.mBase], stiffness=stiffness, damping=np.zeros((6, 6))
        )
    )
    mbs.SetObjectParameter(handle.oBaseJoint, "activeConnector", False)
    mbs.Assemble()
    assert distance(solved(mbs, handle), expected) < 1e-9
    mbs.SetObjectParameter(spring, "activeConnector", False)
    with pytest.raises(ValueError, match="robot 'three': its base joint is switched off"):
        SolveTDCR(mbs)
    mbs.SetObjectParameter(handle.oBaseJoint, "activeConnector", True)
    assert distance(solved(mbs, handle), expected) < 1e-9

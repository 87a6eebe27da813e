"""A robot without friction against Exudyn's ReevingSystemSprings, a rope over sheaves of no radius."""

from __future__ import annotations

import exudyn as exu
import exudyn.itemInterface as eii
import numpy as np
from robots import distance, scene, three

from tdcr_fe.solve.statics import SolveTDCR

STIFFNESS = 400.0


def test_elastic_tendons_without_friction_are_exudyns_rope():
    """Three tendons pulled in, each as a rope through the markers of its holes: 1e-9 of the length, tensions alike."""
    pulled = np.array([6e-3, 1e-3, 2e-3])
    _keep, mbs, handle = scene(three(0.0, axial_stiffness=STIFFNESS), friction="none")
    _keep_other, other, compared = scene(three(0.0), friction="none", assemble=False)
    ropes, length = [], compared.robot.backbone.length
    for holes in compared.mHoles:
        ropes.append(
            other.AddObject(
                eii.ReevingSystemSprings(
                    markerNumbers=holes,
                    hasCoordinateMarkers=False,
                    stiffnessPerLength=STIFFNESS,
                    dampingPerLength=0.0,
                    referenceLength=length,
                    sheavesAxes=exu.Vector3DList([[0.0, 0.0, 1.0]] * len(holes)),
                    sheavesRadii=[0.0] * len(holes),
                )
            )
        )
    other.Assemble()
    for part in np.linspace(0.25, 1.0, 4):
        handle.set_displacements((part * pulled).tolist())
        SolveTDCR(mbs)
        for rope, by in zip(ropes, part * pulled, strict=True):
            other.SetObjectParameter(rope, "referenceLength", length - by)
        SolveTDCR(other)
    assert np.degrees(np.arccos(handle.tip_rotation[2, 2])) > 20.0
    assert distance(handle.shape()[0], compared.shape()[0]) < 1e-9

"""Stiffness of the forces of joints, which Exudyn's Jacobian leaves out.

A joint that moves with its bodies turns its force, or the lever of it. This is what holds a pendulum upright.
"""

from __future__ import annotations

from collections.abc import Sequence

import exudyn as exu
import numpy as np

from tdcr_fe.elements import Array
from tdcr_fe.elements.section import DIFFERENCE


def joints_of(mbs: exu.MainSystem) -> list[exu.ObjectIndex]:
    """Numbers of all joints of an assembled system."""
    objects = [exu.ObjectIndex(i) for i in range(mbs.systemData.NumberOfObjects())]
    return [i for i in objects if exu.ComputeItemType.ReactionForces in mbs.ComputeItem(i)]


def joint_stiffness(mbs: exu.MainSystem, joints: Sequence[exu.ObjectIndex]) -> Array:
    """Derivative of the forces of joints at the present multipliers by the ODE2 coordinates, shape (n2, n2)."""
    data = mbs.systemData
    current: Array = data.GetODE2Coordinates(exu.ConfigurationType.Current, copy=False)
    found = np.zeros((len(current), len(current)))
    for joint in joints:
        moving = data.GetObjectLTGODE2(joint)
        for k in moving:
            start = current[k]
            for step in (DIFFERENCE, -DIFFERENCE):
                current[k] = start + step
                found[moving, k] += mbs.ComputeItem(joint, exu.ComputeItemType.ReactionForces) / (2.0 * step)
            current[k] = start
    return found

"""The tables of a result as pandas data frames."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

if TYPE_CHECKING:
    from tdcr_fe.model.results import SequenceResult

Array = NDArray[np.float64]


def quaternions(rotations: Array) -> Array:
    """Unit quaternions of sections, with ``qw >= 0``.

    Where ``qw`` is zero both signs are the same rotation; the one nearer to the previous section is taken.

    Parameters
    ----------
    rotations
        World rotations of the sections, shape (n, 3, 3).

    Returns
    -------
    numpy.ndarray
        ``qw, qx, qy, qz`` in each row, shape (n, 4).
    """
    q = np.roll(Rotation.from_matrix(np.asarray(rotations, dtype=float)).as_quat(), 1, axis=1)
    q[np.abs(q[:, 0]) < 1e-15, 0] = 0.0
    q[q[:, 0] < 0.0] *= -1.0
    for k in np.flatnonzero(q[:, 0] == 0.0):
        if k > 0 and q[k] @ q[k - 1] < 0.0:
            q[k] *= -1.0
    return np.asarray(q + 0.0, dtype=float)  # no negative zeros


def steps_frame(result: SequenceResult) -> pd.DataFrame:
    """One row per load step: actuation, tip pose and angles, with the columns of `steps.csv`."""
    names = result.robot.tendon_names
    rows = [
        [
            *(s.step, s.label, bool(s.converged), int(s.iterations)),
            *map(float, s.base_tensions),
            *map(float, s.displacements),
            *map(float, s.tip),
            *map(float, s.tangent),
            math.degrees(s.bending_angle),
            math.degrees(s.chord_angle),
            s.tip_offset,
        ]
        for s in result.steps
    ]
    columns = [
        *("step", "label", "converged", "iterations"),
        *(f"tension_{n}" for n in names),
        *(f"displacement_{n}" for n in names),
        *("tip_x", "tip_y", "tip_z", "tangent_x", "tangent_y", "tangent_z"),
        *("bending_angle_deg", "chord_angle_deg", "tip_offset"),
    ]
    return pd.DataFrame(rows, columns=columns)


def shape_frame(result: SequenceResult) -> pd.DataFrame:
    """One row per backbone node and load step, with the columns of `shape.csv`."""
    columns = ["step", "s", "x", "y", "z", "qw", "qx", "qy", "qz"]
    tables = [
        pd.DataFrame(
            np.column_stack((s.s, s.positions, quaternions(s.rotations))), columns=columns[1:]
        ).assign(step=s.step)
        for s in result.steps
    ]
    return pd.concat(tables, ignore_index=True)[columns] if tables else pd.DataFrame(columns=columns)


def tensions_frame(result: SequenceResult) -> pd.DataFrame:
    """One row per tendon segment and load step, with the columns of `tensions.csv`."""
    rows = [
        (s.step, name, k, float(tension), state)
        for s in result.steps
        for name, tensions, states in zip(result.robot.tendon_names, s.tensions, s.hole_states, strict=True)
        for k, (tension, state) in enumerate(zip(tensions, states, strict=True), start=1)
    ]
    return pd.DataFrame(rows, columns=["step", "tendon", "segment", "tension", "hole_state"])

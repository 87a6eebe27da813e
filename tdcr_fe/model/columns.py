"""The tables of a result as pandas data frames: the columns of `steps.csv`, `shape.csv` and so on."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial.transform import Rotation

from tdcr_fe.elements import Array

if TYPE_CHECKING:
    import pandas as pd

    from tdcr_fe.model.results import SequenceResult, StepResult


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


#: Columns of `steps.csv` before those of the tendons: attributes of a step.
BEFORE_TENDONS = ("step", "label", "converged", "iterations")
#: Those after the tendons, and their values.
AFTER_TENDONS: dict[str, Callable[[StepResult], object]] = {
    "tip_x": lambda s: float(s.tip[0]),
    "tip_y": lambda s: float(s.tip[1]),
    "tip_z": lambda s: float(s.tip[2]),
    "tangent_x": lambda s: float(s.tangent[0]),
    "tangent_y": lambda s: float(s.tangent[1]),
    "tangent_z": lambda s: float(s.tangent[2]),
    "bending_angle_deg": lambda s: math.degrees(s.bending_angle),
    "chord_angle_deg": lambda s: math.degrees(s.chord_angle),
    "tip_offset": lambda s: s.tip_offset,
}
#: Columns of `steps.csv` that every tendon has: the beginning of their names, and the values of all tendons.
OF_TENDONS: dict[str, Callable[[StepResult], Array]] = {
    "tension": lambda s: s.base_tensions,
    "displacement": lambda s: s.displacements,
}


def tendon_columns(names: Iterable[str]) -> list[str]:
    """Columns of all `OF_TENDONS` for tendons of these names: first the tensions of all, then the displacements."""
    names = tuple(names)
    return [f"{quantity}_{name}" for quantity in OF_TENDONS for name in names]


def steps_frame(result: SequenceResult) -> pd.DataFrame:
    """One row per load step: actuation, tip pose and angles, with the columns of `steps.csv`."""
    import pandas as pd

    columns = [*BEFORE_TENDONS, *tendon_columns(result.robot.tendon_names), *AFTER_TENDONS]
    rows = [
        [
            *(getattr(s, name) for name in BEFORE_TENDONS),
            *(float(x) for values in OF_TENDONS.values() for x in values(s)),
            *(value(s) for value in AFTER_TENDONS.values()),
        ]
        for s in result.steps
    ]
    return pd.DataFrame(rows, columns=columns)


def sensitivities_frame(result: SequenceResult) -> pd.DataFrame:
    """One row per load step and parameter, with the columns of `sensitivities.csv`."""
    import pandas as pd

    tip = ("tip_x", "tip_y", "tip_z", "rotation_x", "rotation_y", "rotation_z")
    columns = ["step", "label", "parameter", "value", *tendon_columns(result.robot.tendon_names), *tip]
    rows = [
        [
            *(s.step, s.label, each.parameter, each.value),
            *(float(x) for x in (*each.base_tensions[k], *each.displacements[k])),
            *(float(x) for x in (*each.positions[k, -1], *each.rotations[k, -1])),
        ]
        for k, s in enumerate(result.steps)
        for each in result.sensitivities.values()
    ]
    return pd.DataFrame(rows, columns=columns)


def shape_frame(result: SequenceResult) -> pd.DataFrame:
    """One row per backbone node and load step, with the columns of `shape.csv`."""
    import pandas as pd

    columns, tables = ["step", "s", "x", "y", "z", "qw", "qx", "qy", "qz"], []
    for s in result.steps:
        poses = np.column_stack((s.s, s.positions, quaternions(s.rotations)))
        tables.append(pd.DataFrame(poses, columns=columns[1:]).assign(step=s.step))
    return pd.concat(tables, ignore_index=True)[columns] if tables else pd.DataFrame(columns=columns)


def tensions_frame(result: SequenceResult) -> pd.DataFrame:
    """One row per tendon segment and load step, with the columns of `tensions.csv`."""
    import pandas as pd

    rows = [
        (s.step, name, k, float(tension), state)
        for s in result.steps
        for name, tensions, states in zip(result.robot.tendon_names, s.tensions, s.hole_states, strict=True)
        for k, (tension, state) in enumerate(zip(tensions, states, strict=True), start=1)
    ]
    return pd.DataFrame(rows, columns=["step", "tendon", "segment", "tension", "hole_state"])

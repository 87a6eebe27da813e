"""Exudyn sensors on a robot in a scene: tip pose and disks; tensions, displacement and friction of tendons."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import exudyn as exu
import exudyn.itemInterface as eii
import numpy as np


def sensor_output(fileName: str, key: str, storeInternal: bool) -> dict[str, Any]:
    """Arguments for a sensor's output: a file of its own if a prefix is given, and memory if requested."""
    file = f"{fileName}_{key}.txt" if fileName else ""
    return {"storeInternal": storeInternal, "fileName": file, "writeToFile": bool(fileName)}


def add_tip_sensors(
    mbs: exu.MainSystem, tip_node: Any, robot: str, fileName: str, storeInternal: bool
) -> dict[str, Any]:
    """Add sensors of the tip's position [m] and rotation matrix; return them by name."""
    out = exu.OutputVariableType
    variables = {"tip_position": out.Position, "tip_rotation": out.RotationMatrix}
    return {
        key: mbs.AddSensor(
            eii.SensorNode(
                name=f"{robot}.{key}",
                nodeNumber=tip_node,
                outputVariableType=variable,
                **sensor_output(fileName, key, storeInternal),
            )
        )
        for key, variable in variables.items()
    }


def add_disk_sensors(
    mbs: exu.MainSystem, nodes: Sequence[Any], robot: str, fileName: str, storeInternal: bool
) -> dict[str, Any]:
    """Add a sensor of the position of every disk [m], whose nodes are given from the base on; return them by name."""
    keys = [f"disk_position_{k}" for k in range(1, len(nodes) + 1)]
    return {
        key: mbs.AddSensor(
            eii.SensorNode(
                name=f"{robot}.{key}",
                nodeNumber=node,
                outputVariableType=exu.OutputVariableType.Position,
                **sensor_output(fileName, key, storeInternal),
            )
        )
        for key, node in zip(keys, nodes, strict=True)
    }


def add_tendon_sensors(
    mbs: exu.MainSystem,
    history: Any,
    quantities: Mapping[str, slice],
    robot: str,
    tendon: str,
    fileName: str,
    storeInternal: bool,
) -> dict[str, Any]:
    """Add sensors of a tendon after every solved step; return them by name.

    Parameters
    ----------
    mbs
        The system.
    history
        Data node of the tendon's history.
    quantities
        Which coordinates of the node, by quantity.
    robot, tendon
        Names.
    fileName, storeInternal
        As in `TDCR.add_sensors`.
    """
    node = mbs.AddSensor(
        eii.SensorNode(
            name=f"{robot}.{tendon}.history",
            nodeNumber=history,
            outputVariableType=exu.OutputVariableType.Coordinates,
            writeToFile=False,
        )
    )
    return {
        f"{quantity}_{tendon}": mbs.AddSensor(
            eii.SensorUserFunction(
                name=f"{robot}.{quantity}_{tendon}",
                sensorNumbers=[node],
                factors=[float(which.start), float(which.stop)],
                sensorUserFunction=_part,
                **sensor_output(fileName, f"{quantity}_{tendon}", storeInternal),
            )
        )
        for quantity, which in quantities.items()
        if which.stop > which.start
    }


def _part(
    mbs: exu.MainSystem, t: float, sensors: Sequence[int], factors: Sequence[float], configuration: Any
) -> list[float]:
    """Values of a sensor from one number to another; arguments as Exudyn passes them."""
    values = np.atleast_1d(mbs.GetSensorValues(sensors[0], configuration))
    return [float(x) for x in values[round(factors[0]) : round(factors[1])]]

"""Exudyn sensors on a robot in a scene: tip pose and tendon tensions."""

from __future__ import annotations

from typing import Any

import exudyn as exu
import exudyn.itemInterface as eii


def _output(fileName: str, key: str, storeInternal: bool) -> dict[str, Any]:
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
                **_output(fileName, key, storeInternal),
            )
        )
        for key, variable in variables.items()
    }


def add_tension_sensors(
    mbs: exu.MainSystem, segments: list[Any], robot: str, tendon: str, fileName: str, storeInternal: bool
) -> dict[str, Any]:
    """Add sensors of a tendon's tension in its first and its last segment [N]; return them by name."""
    wanted = {f"tension_{tendon}": segments[0], f"anchor_tension_{tendon}": segments[-1]}
    return {
        key: mbs.AddSensor(
            eii.SensorObject(
                name=f"{robot}.{key}",
                objectNumber=segment,
                outputVariableType=exu.OutputVariableType.ForceLocal,
                **_output(fileName, key, storeInternal),
            )
        )
        for key, segment in wanted.items()
    }

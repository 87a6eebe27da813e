"""Exudyn sensors on a robot in a scene: tip pose and disks; tensions, displacement and friction of tendons."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import exudyn as exu
import exudyn.itemInterface as eii
import numpy as np


@dataclass(frozen=True)
class SensorMaker:
    """Adds sensors of one robot to its system."""

    mbs: exu.MainSystem
    robot: str  # its name, prefix of the names of the sensors
    fileName: str  # prefix of the files; empty writes none
    storeInternal: bool

    def output(self, key: str) -> dict[str, Any]:
        """Arguments for a sensor's output: a file of its own if a prefix is given, and memory if requested."""
        file = f"{self.fileName}_{key}.txt" if self.fileName else ""
        return {"storeInternal": self.storeInternal, "fileName": file, "writeToFile": bool(file)}

    def of_node(self, key: str, node: Any, variable: Any) -> dict[str, Any]:
        """Add a sensor of a node; return it by its key."""
        sensor = eii.SensorNode(
            name=f"{self.robot}.{key}", nodeNumber=node, outputVariableType=variable, **self.output(key)
        )
        return {key: self.mbs.AddSensor(sensor)}

    def of_function(self, key: str, function: Callable[..., list[float]], **rest: Any) -> dict[str, Any]:
        """Add a sensor whose values a function gives; return it by its key.

        Parameters
        ----------
        key
            Its name.
        function
            Of the arguments that Exudyn passes: system, time, sensors, factors, configuration.
        rest
            Further arguments of ``SensorUserFunction``.
        """
        sensor = eii.SensorUserFunction(
            name=f"{self.robot}.{key}", sensorUserFunction=function, **rest, **self.output(key)
        )
        return {key: self.mbs.AddSensor(sensor)}

    def of_tendon(self, tendon: str, history: Any, quantities: dict[str, slice]) -> dict[str, Any]:
        """Add sensors of a tendon after every solved step; return them by name.

        Parameters
        ----------
        tendon
            Its name.
        history
            Data node of its history.
        quantities
            Which coordinates of the node, by quantity.
        """
        name, coordinates = f"{self.robot}.{tendon}.history", exu.OutputVariableType.Coordinates
        node = self.mbs.AddSensor(
            eii.SensorNode(name=name, nodeNumber=history, outputVariableType=coordinates, writeToFile=False)
        )
        made: dict[str, Any] = {}
        for quantity, which in quantities.items():
            if which.stop > which.start:
                part = [float(which.start), float(which.stop)]
                made |= self.of_function(f"{quantity}_{tendon}", _part, sensorNumbers=[node], factors=part)
        return made


def _part(
    mbs: exu.MainSystem, t: float, sensors: Sequence[int], factors: Sequence[float], configuration: Any
) -> list[float]:
    """Values of a sensor from one number to another; arguments as Exudyn passes them."""
    values = np.atleast_1d(mbs.GetSensorValues(sensors[0], configuration))
    return [float(x) for x in values[round(factors[0]) : round(factors[1])]]

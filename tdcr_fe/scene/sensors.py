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
        """A sensor's name and output: a file of its own if a prefix is given, and memory if requested."""
        file = f"{self.fileName}_{key}.txt" if self.fileName else ""
        output = {"storeInternal": self.storeInternal, "fileName": file, "writeToFile": bool(file)}
        return {"name": f"{self.robot}.{key}", **output}

    def of_node(self, key: str, node: Any, variable: Any) -> dict[str, Any]:
        """Add a sensor of a node; return it by its key."""
        sensor = eii.SensorNode(nodeNumber=node, outputVariableType=variable, **self.output(key))
        return {key: self.mbs.AddSensor(sensor)}

    def of_function(self, key: str, function: Callable[..., list[float]], **rest: Any) -> dict[str, Any]:
        """Add a sensor whose values a function gives; return it by its key.

        Parameters
        ----------
        key
            Its name.
        function
            Function of the arguments that Exudyn passes: system, time, sensors, factors, configuration.
        rest
            Further arguments of ``SensorUserFunction``.
        """
        sensor = eii.SensorUserFunction(sensorUserFunction=function, **rest, **self.output(key))
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
        what = {"outputVariableType": exu.OutputVariableType.Coordinates, "writeToFile": False}
        sensor = eii.SensorNode(name=f"{self.robot}.{tendon}.history", nodeNumber=history, **what)
        node = self.mbs.AddSensor(sensor)
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

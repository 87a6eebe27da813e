"""Sweeps: many cases of a scenario with other values, over processes or machines, and one table out."""

from tdcr_fe.sweeps.description import Sweep
from tdcr_fe.sweeps.execution import ExecutorBroken
from tdcr_fe.sweeps.read import read_sweep
from tdcr_fe.sweeps.result import SweepResult
from tdcr_fe.sweeps.run import sweep
from tdcr_fe.sweeps.variation import ParameterFunction, parameter_function

__all__ = [
    "ExecutorBroken",
    "ParameterFunction",
    "Sweep",
    "SweepResult",
    "parameter_function",
    "read_sweep",
    "sweep",
]

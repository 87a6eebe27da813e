"""Sweeps: many cases of a scenario with other values, over processes or machines, and one table out."""

from tdcr_fe.sweeps.cases import parameter_function
from tdcr_fe.sweeps.description import Sweep
from tdcr_fe.sweeps.execution import SweepInterrupted, sweep
from tdcr_fe.sweeps.read import read_sweep
from tdcr_fe.sweeps.result import SweepResult

__all__ = ["Sweep", "SweepInterrupted", "SweepResult", "parameter_function", "read_sweep", "sweep"]

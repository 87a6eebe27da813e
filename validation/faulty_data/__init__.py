"""Measured data with one fault each: identify must name the fault or say that it cannot tell."""

from tdcr_fe.validation.faulty_data.campaign import run_all
from tdcr_fe.validation.faulty_data.faults import FAULTS, Fault

__all__ = ["FAULTS", "Fault", "run_all"]

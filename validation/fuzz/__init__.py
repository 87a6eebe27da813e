"""Random valid robots and histories; every state that is called converged is checked from outside the solver."""

from tdcr_fe.validation.fuzz.checks import CHECKS, Check, check_step
from tdcr_fe.validation.fuzz.drawing import FuzzCase, draw

__all__ = ["CHECKS", "Check", "FuzzCase", "check_step", "draw"]

"""Independent Cosserat shooting reference: numpy and scipy only, shares nothing but the robot description."""

from tdcr_fe.validation.reference.sequence import solve_reference
from tdcr_fe.validation.reference.settings import ReferenceSettings

__all__ = ["ReferenceSettings", "solve_reference"]

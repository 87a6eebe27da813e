"""Independent Cosserat shooting reference: numpy and scipy only, independent but for the robot description."""

from tdcr_fe.validation.reference.sequence import solve_reference
from tdcr_fe.validation.reference.settings import Extras, HoleFriction, ReferenceSettings

__all__ = ["Extras", "HoleFriction", "ReferenceSettings", "solve_reference"]

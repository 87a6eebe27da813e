"""The safety net: what the program computes is stored, and later code is compared with it, number by number."""

from tdcr_fe.validation.net.comparison import Difference, compare
from tdcr_fe.validation.net.parts import PARTS
from tdcr_fe.validation.net.storage import store

__all__ = ["PARTS", "Difference", "compare", "store"]

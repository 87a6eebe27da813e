"""Random robots and loading histories, both solvers with default settings: every difference must be announced."""

from tdcr_fe.validation.random_robots.comparison import Comparison, compare
from tdcr_fe.validation.random_robots.drawing import RandomCase, draw

__all__ = ["Comparison", "RandomCase", "compare", "draw"]

"""Random robots and loading histories, both solvers with default settings: every difference must be announced."""

from tdcr_fe.validation.random_robots.answers import FINITE_ELEMENTS, REFERENCE, Answer, solve
from tdcr_fe.validation.random_robots.comparison import Comparison, compare
from tdcr_fe.validation.random_robots.drawing import RandomCase, draw

__all__ = ["FINITE_ELEMENTS", "REFERENCE", "Answer", "Comparison", "RandomCase", "compare", "draw", "solve"]

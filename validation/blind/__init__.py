"""Blind data: what a robot with hidden effects would show, made by the reference, to judge the closed loop."""

from __future__ import annotations

from tdcr_fe.validation.blind.maker import Answer, make_blind
from tdcr_fe.validation.blind.recipes import OFF_LIST, ROBOTS, Recipe, plan

__all__ = ["OFF_LIST", "ROBOTS", "Answer", "Recipe", "make_blind", "plan"]

"""Blind benchmark of the identification: data of robots with hidden effects, simulated by the reference."""

from __future__ import annotations

from tdcr_fe.validation.blind.maker import Answer, make_blind
from tdcr_fe.validation.blind.recipes import OFF_LIST, ROBOTS, Recipe, plan

__all__ = ["OFF_LIST", "ROBOTS", "Answer", "Recipe", "make_blind", "plan"]

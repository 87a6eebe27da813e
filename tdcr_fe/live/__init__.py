"""A robot live: a page on the user's own computer, where every change is a load step with its history."""

from __future__ import annotations

from tdcr_fe.callable_package import callable_package
from tdcr_fe.live.notebook import LiveRobot, live

__all__ = ["LiveRobot", "live"]

callable_package(__name__, live)

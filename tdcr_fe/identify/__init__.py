"""Closing the loop: from measured data to the effect that a declared model lacks."""

from __future__ import annotations

from tdcr_fe.identify.loop import identify
from tdcr_fe.identify.outcome import IdentificationResult, IdentifySettings

__all__ = ["IdentificationResult", "IdentifySettings", "identify"]

"""Closing the loop: from measured data to the effects that a declared model lacks."""

from __future__ import annotations

from tdcr_fe.identify.identification import NotSolved, identify
from tdcr_fe.identify.outcome import IdentificationResult, IdentifySettings

__all__ = ["IdentificationResult", "IdentifySettings", "NotSolved", "identify"]

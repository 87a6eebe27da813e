"""Identification: from measured data to the effects that a declared model is missing."""

from __future__ import annotations

from tdcr_fe.callable_package import callable_package
from tdcr_fe.identify.identification import NotSolved, identify
from tdcr_fe.identify.result import IdentificationResult
from tdcr_fe.identify.settings import IdentifySettings

__all__ = ["IdentificationResult", "IdentifySettings", "NotSolved", "identify"]

callable_package(__name__, identify)

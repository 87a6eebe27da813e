"""Identification: from measured data to the effects that a declared model is missing."""

from __future__ import annotations

import sys
from types import ModuleType
from typing import Any

from tdcr_fe.identify.identification import NotSolved, identify
from tdcr_fe.identify.result import IdentificationResult
from tdcr_fe.identify.settings import IdentifySettings

__all__ = ["IdentificationResult", "IdentifySettings", "NotSolved", "identify"]


class _CallablePackage(ModuleType):
    """Lets ``tdcr_fe.identify(data)`` call the function, although the package has the same name."""

    def __call__(self, *args: Any, **kwargs: Any) -> IdentificationResult:
        return identify(*args, **kwargs)


sys.modules[__name__].__class__ = _CallablePackage

"""`CreateTDCR`, `SolveTDCR` and others as methods of ``exudyn.MainSystem``, beside the library's own."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import exudyn as exu

from tdcr_fe.scene.builder import CreateTDCR
from tdcr_fe.scene.linearized import TDCREigenvalues, TDCRLinearized
from tdcr_fe.solve.statics import SolveTDCR


def register() -> None:
    """Make `CreateTDCR`, `SolveTDCR`, `TDCREigenvalues` and `TDCRLinearized` methods of every Exudyn system.

    Call it once, at any time; a second call changes nothing. The plain functions, which take ``mbs`` first, work
    without it.
    """
    _bind("CreateTDCR", CreateTDCR)
    _bind("SolveTDCR", SolveTDCR)
    _bind("TDCREigenvalues", TDCREigenvalues)
    _bind("TDCRLinearized", TDCRLinearized)


def _bind(method: str, function: Callable[..., Any]) -> None:
    """Make a function that takes ``mbs`` first a method of ``exudyn.MainSystem``."""
    try:
        from exudyn.misc import extensionRegistry
    except ImportError:
        # The registry is not public; without it the plain function is bound just the same.
        setattr(exu.MainSystem, method, function)
        return
    if getattr(exu.MainSystem, method, None) is not function:
        extensionRegistry.extends(exu.MainSystem, method)(function)
        extensionRegistry.install()

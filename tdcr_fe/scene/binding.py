"""Functions that take ``mbs`` first as methods of ``exudyn.MainSystem``."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import exudyn as exu


def bind(method: str, function: Callable[..., Any]) -> None:
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

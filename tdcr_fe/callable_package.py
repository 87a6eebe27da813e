"""Packages that are the function of their name: ``tdcr_fe.identify(data)`` beside ``tdcr_fe.identify.result``."""

from __future__ import annotations

import sys
from collections.abc import Callable
from types import ModuleType


def callable_package(name: str, function: Callable[..., object]) -> None:
    """Let a package be called as a function.

    Parameters
    ----------
    name
        Full name of the package, which is being imported.
    function
        What is called.
    """

    class CallablePackage(ModuleType):
        __module__ = name  # where documentation finds the function

        def __call__(self, *args: object, **kwargs: object) -> object:
            return function(*args, **kwargs)

    sys.modules[name].__class__ = CallablePackage

"""Functions that numba compiles where it is installed (extra ``fast``), and that are plain Python elsewhere.

There is one source for both: functions on arrays, numbers and named tuples of these, of which numba takes the part of
numpy that it knows. `compilable` marks a function that compiled ones call; `compiled_as` the few that numba has to have
written in another way; `run_compiled` calls one from outside. Only the friction path within a step is compiled: it
integrates in many small steps, which numpy's overhead dominates.

numba is imported at the first call, not before. What it has compiled is kept in a folder of the user's cache that
belongs to these sources, so that it is compiled once. Times: docs/validation.md, section "Time".
"""

from __future__ import annotations

import inspect
import os
import tempfile
import warnings
from collections.abc import Callable
from contextlib import suppress
from functools import cache
from hashlib import sha256
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

Function = TypeVar("Function", bound=Callable[..., Any])

#: Environment variable that switches compiled functions off where it is 0.
SWITCH = "TDCR_FE_COMPILED"
#: As numpy: a division by zero gives infinity.
_OPTIONS = {"error_model": "numpy"}
#: What compiled functions call in place of a function: itself, or what is written in another way.
_REPLACEMENTS: dict[Callable[..., Any], Callable[..., Any]] = {}
_REGISTERED: set[Callable[..., Any]] = set()


def compilable(function: Function) -> Function:
    """Mark a function that compiled functions call."""
    _REPLACEMENTS[function] = function
    return function


def compiled_as(replacement: Callable[..., Any]) -> Callable[[Function], Function]:
    """Name what compiled functions call in place of a function, with the same arguments."""

    def mark(function: Function) -> Function:
        _REPLACEMENTS[function] = replacement
        return function

    return mark


@cache
def is_compiled() -> bool:
    """Whether compiled functions are used: numba is installed, can be imported, and is not switched off.

    That is looked up once in a process.
    """
    return os.environ.get(SWITCH, "1") != "0" and _numba() is not None


def numba_version() -> str:
    """Version of numba, "not used" where functions are not compiled."""
    return str(_numba().__version__) if is_compiled() else "not used"


def run_compiled(function: Callable[..., Any], *given: Any) -> Any:
    """What a function returns, by its compiled form; everything that it calls has to be marked before.

    Compiled functions take inverses, and have no way on where a matrix is singular: plain Python then runs. Where
    numba cannot compile, it runs from then on, with a warning.
    """
    try:
        return _compiled(function)(*given)
    except np.linalg.LinAlgError:
        return function(*given)
    except Exception as error:
        if not isinstance(error, _numba().core.errors.NumbaError):
            raise
        warnings.warn(f"numba {numba_version()} cannot compile {function.__name__}: {error}", stacklevel=2)
        # In this process and those that it starts.
        os.environ[SWITCH] = "0"
        is_compiled.cache_clear()
        return function(*given)


@cache
def _compiled(function: Callable[..., Any]) -> Callable[..., Any]:
    numba = _numba()
    _register()
    before = numba.config.CACHE_DIR
    folder = _folder(before)
    if not any(folder.iterdir()):
        warnings.warn(
            f"numba compiles once, which takes about a minute; what it makes is kept in {folder}",
            stacklevel=3,
        )
    numba.config.CACHE_DIR = str(folder)
    try:
        compiled: Callable[..., Any] = numba.njit(function, cache=True, **_OPTIONS)
    finally:
        numba.config.CACHE_DIR = before
    return compiled


@cache
def _numba() -> Any:
    """The module; None where it is not installed, and, with a warning, where it cannot be imported.

    As beside a numpy that it does not know.
    """
    try:
        import numba
    except ImportError as error:
        if error.name != "numba":
            warnings.warn(
                f"numba is installed and cannot be imported, so that functions are not compiled: {error}",
                stacklevel=2,
            )
        return None
    return numba


def _register() -> None:
    """Tell numba what functions may be called, and what replaces them: those marked since the last time."""
    from numba.extending import overload

    for function, replacement in _REPLACEMENTS.items():
        if function not in _REGISTERED:
            _REGISTERED.add(function)
            overload(function, jit_options=_OPTIONS, strict=False)(_giving(replacement))


def _giving(replacement: Callable[..., Any]) -> Callable[..., Callable[..., Any]]:
    return lambda *types: replacement


def _folder(base: str) -> Path:
    """Folder for what is compiled from these sources, below a given one or the user's cache.

    numba itself looks at the file of the function that is called from outside only: after a change of another one it
    would use what it had compiled before.
    """
    files = sorted({inspect.getfile(f) for f in _REPLACEMENTS.values()})
    name = sha256(b"".join(Path(f).read_bytes() for f in files)).hexdigest()[:16]
    with suppress(OSError, RuntimeError):  # the latter where the user has no home
        folder = Path(base or os.environ.get("XDG_CACHE_HOME") or "~/.cache").expanduser() / "tdcr_fe" / name
        folder.mkdir(parents=True, exist_ok=True)
        if os.access(folder, os.W_OK):
            return folder
    return Path(tempfile.mkdtemp(prefix="tdcr_fe_"))

"""Limit linear algebra to one thread: for small matrices more threads only cost processor time."""

from __future__ import annotations

from contextlib import AbstractContextManager, nullcontext
from functools import lru_cache

from threadpoolctl import ThreadpoolController


@lru_cache(maxsize=1)
def _controller() -> ThreadpoolController:
    """The linear algebra libraries of this process, found once."""
    return ThreadpoolController()


def one_thread() -> AbstractContextManager[object]:
    """Limit BLAS to one thread inside a ``with`` block; nothing is done where it has no more than one."""
    libraries = _controller().lib_controllers
    if all(library.get_num_threads() == 1 for library in libraries if library.user_api == "blas"):
        return nullcontext()
    return _controller().limit(limits=1, user_api="blas")

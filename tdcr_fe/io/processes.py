"""Many cases: worker processes that end with their parent, futures as they end, SIGTERM as an interruption.

A worker blocks on a pipe whose writing end exists only in the parent. When the parent closes it or ends for any reason
(also by ``kill -9``), the operating system closes the pipe and the worker exits at once. This needs no polling and
works on every platform.
"""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Callable, Generator, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Executor, Future, ProcessPoolExecutor, wait
from contextlib import contextmanager
from multiprocessing import get_context
from multiprocessing.connection import Connection
from types import FrameType
from typing import Any, TypeVar

from tdcr_fe.model.messages import ignore_warnings

#: Variables that limit the threads of the linear algebra libraries; read when a library is loaded.
THREAD_VARIABLES = ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "OMP_NUM_THREADS")


@contextmanager
def _handled(number: int, handler: Callable[[int, FrameType | None], object]) -> Iterator[Any]:
    """Handle a signal otherwise inside; yields the handler before.

    In another thread than the main one, where Python allows no signal handlers, it changes nothing.
    """
    if threading.current_thread() is not threading.main_thread():
        yield None
        return
    before = signal.signal(number, handler)
    try:
        yield before
    finally:
        signal.signal(number, before)


@contextmanager
def sigterm_as_interrupt() -> Iterator[list[int]]:
    """Raise `KeyboardInterrupt` in the main thread on SIGTERM, so that a command ends as on Ctrl-C.

    Yields
    ------
    list of int
        SIGTERM for each time that it arrived, also where the exception has been handled since.
    """
    received: list[int] = []

    def interrupt(number: int, frame: FrameType | None) -> None:
        received.append(number)
        raise KeyboardInterrupt

    with _handled(signal.SIGTERM, interrupt):
        yield received


@contextmanager
def interruption_deferred() -> Iterator[None]:
    """Let Ctrl-C wait until the block, of a second or two, has ended: some libraries make another error of it."""
    received: list[int] = []
    with _handled(signal.SIGINT, lambda number, frame: received.append(number)) as before:
        yield
    if received and callable(before):
        before(received[0], None)


@contextmanager
def worker_pool(processes: int) -> Iterator[ProcessPoolExecutor]:
    """A pool of worker processes that ends with this process.

    Workers leave Ctrl-C and warnings to the parent and use one thread for linear algebra. When the block ends by an
    exception (an interruption in particular), they exit at once; otherwise they finish what was submitted.

    Parameters
    ----------
    processes
        Number of workers.

    Yields
    ------
    ProcessPoolExecutor
    """
    # The only method on all platforms; a fork would inherit the pipe of its siblings.
    context = get_context("spawn")
    alive, owned = context.Pipe(duplex=False)
    pool = ProcessPoolExecutor(max(1, processes), context, _start_worker, (alive,))
    with alive, owned:
        try:
            yield pool
        except BaseException:
            owned.close()
            raise
        finally:
            pool.shutdown(wait=True, cancel_futures=True)


def _start_worker(alive: Connection) -> None:
    """First thing in a worker."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_exit_with_parent, args=(alive,), daemon=True, name="parent-watch").start()
    for variable in THREAD_VARIABLES:
        os.environ[variable] = "1"
    from threadpoolctl import threadpool_limits

    threadpool_limits(1)  # for libraries that are loaded already
    ignore_warnings()


def _exit_with_parent(alive: Connection) -> None:
    """Wait for the end of the pipe, then end this process without any clean-up that could block."""
    try:
        alive.recv_bytes()
    except (EOFError, OSError):
        os._exit(1)


# -------------------------------------------------------------------------------------------------------- many cases

Task = TypeVar("Task")
Key = TypeVar("Key")


def as_completed(
    executor: Executor, solve: Callable[[Task], Any], tasks: Iterable[tuple[Key, Task]], most: int
) -> Generator[tuple[Key, Future[Any]], None, None]:
    """Futures of tasks, given by key, as they end; ``most`` are handed over at a time, so that many cost no memory.

    Raises
    ------
    concurrent.futures.BrokenExecutor
        The executor takes no more tasks.
    """
    running: dict[Future[Any], Key] = {}
    try:
        for key, task in tasks:
            running[executor.submit(solve, task)] = key
            if len(running) >= most:
                yield from _finished(running)
        while running:
            yield from _finished(running)
    finally:
        for future in running:
            future.cancel()


def _finished(running: dict[Future[Any], Key]) -> Iterator[tuple[Key, Future[Any]]]:
    done, _ = wait(running, return_when=FIRST_COMPLETED)
    for future in done:
        yield running.pop(future), future

"""Solve random cases in parallel processes, and keep finished records, so that a run can be resumed."""

from __future__ import annotations

from collections.abc import Generator, Sequence
from concurrent.futures import as_completed
from pathlib import Path

from tdcr_fe.io.processes import worker_pool
from tdcr_fe.validation.crosscheck.campaign import silence_exudyn, versions
from tdcr_fe.validation.random_robots.comparison import Comparison, compare
from tdcr_fe.validation.random_robots.drawing import draw
from tdcr_fe.validation.random_robots.report import read_record, write_record


def solve_all(numbers: Sequence[int], folder: Path, processes: int) -> Generator[Comparison, None, None]:
    """Records of all cases, those known first, the others as they are finished and written."""
    digest = versions()["source"]
    left = []
    for number in numbers:
        known = read_record(number, folder, digest)
        if known is None:
            left.append(number)
        else:
            yield known
    if not left:
        return
    with worker_pool(min(processes, len(left)), silence_exudyn) as pool:
        for done in as_completed([pool.submit(_solve, number) for number in left]):
            record = done.result()
            write_record(record, folder, digest)
            yield record


def _solve(number: int) -> Comparison:
    return compare(draw(number))

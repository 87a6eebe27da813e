"""Solve random cases in parallel processes, and keep finished answers, so that a run can be resumed."""

from __future__ import annotations

from collections.abc import Generator, Sequence
from concurrent.futures import as_completed
from pathlib import Path

from tdcr_fe.io.processes import worker_pool
from tdcr_fe.validation.crosscheck.campaign import silence_exudyn
from tdcr_fe.validation.random_robots.answers import (
    FINITE_ELEMENTS,
    REFERENCE,
    SOLVERS,
    Answer,
    read,
    solve,
    write,
)
from tdcr_fe.validation.random_robots.comparison import Comparison, compare


def solve_all(
    numbers: Sequence[int], folder: Path, processes: int, *, keep_reference: bool = False
) -> Generator[Comparison, None, None]:
    """Comparisons of all cases, those known first, the others as they are finished; answers are written at once.

    Parameters
    ----------
    numbers
        Seeds.
    folder
        Where answers are kept.
    processes
        Number of cases at a time.
    keep_reference
        Take answers of the reference that are there, even if other code found them.
    """
    answers: dict[int, dict[str, Answer]] = {number: {} for number in numbers}
    for number, found in answers.items():
        for solver in SOLVERS:
            known = read(number, solver, folder, any_version=keep_reference and solver == REFERENCE)
            if known is not None:
                found[solver] = known
        if len(found) == len(SOLVERS):
            yield _compare(found)
    left = [(n, solver) for n, found in answers.items() for solver in SOLVERS if solver not in found]
    if not left:
        return
    with worker_pool(min(processes, len(left)), silence_exudyn) as pool:
        for done in as_completed([pool.submit(solve, *task) for task in left]):
            answer = done.result()
            write(answer, folder)
            found = answers[answer.number]
            found[answer.solver] = answer
            if len(found) == len(SOLVERS):
                yield _compare(found)


def _compare(found: dict[str, Answer]) -> Comparison:
    return compare(found[FINITE_ELEMENTS], found[REFERENCE])

"""Collect what the cases of a campaign give, with a progress bar, until all are done or it is interrupted."""

from __future__ import annotations

import sys
from collections.abc import Generator
from contextlib import closing
from typing import TypeVar

from tdcr_fe.io.processes import sigterm_as_interrupt

Found = TypeVar("Found")


def collect(cases: Generator[Found, None, None], total: int, unit: str) -> tuple[list[Found], int | None]:
    """What all cases give, for a command that is started again to resume.

    Parameters
    ----------
    cases
        Gives the results as they are found, and keeps them; it is closed here, so that its workers end first.
    total
        Number of cases.
    unit
        What a case is called beside the progress bar.

    Returns
    -------
    found : list
        In the order in which they were found.
    interrupted : int or None
        Exit status of the command where it was interrupted, which is said on stderr; else None.
    """
    from tqdm import tqdm

    found: list[Found] = []
    with sigterm_as_interrupt() as termination:
        try:
            with closing(cases), tqdm(total=total, unit=unit) as bar:
                for each in cases:
                    found.append(each)
                    bar.update()
        except KeyboardInterrupt:
            print("interrupted; start it again to resume", file=sys.stderr)
            return found, termination.status
    return found, None

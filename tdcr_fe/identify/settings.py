"""Settings of an identification, and its time limit: when its parts end, and the simulations that end with it.

Every part has a deadline. There simulations end under way: they raise `OutOfTime`, fits end where they are, and
what was complete before remains.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

from tdcr_fe.effects import Effect


@dataclass(frozen=True)
class IdentifySettings:
    """How the search works; nothing about the robot.

    Attributes
    ----------
    processes : int
        Worker processes. More than one needs a main module that may be imported.
    candidates : int
        So many laws are evaluated in a round, half as many forms or places of each, and half as many fits made.
    max_effects : int
        At most so many effects are added; beyond four, only while each takes away a tenth of the misfit on held-out
        steps.
    time_limit : float
        Processor time of the whole identification, in all its processes; what it does not suffice for is left out and
        reported. Only the declared model is simulated whatever time that takes [s].
    hold_out_branches : tuple of str
        Shell patterns; every branch of ``loading.csv`` that matches one is held out, and no other step. Empty: whole
        branches are chosen.
    own_effects : tuple of Effect
        Candidates besides the listed ones; see `tdcr_fe.io.user_effects.read_own_effects`.
    """

    processes: int = 1
    candidates: int = 5
    max_effects: int = 12
    time_limit: float = 900.0
    hold_out_branches: tuple[str, ...] = ()
    own_effects: tuple[Effect, ...] = ()


class Part(StrEnum):
    """Parts of an identification that are left out where its time does not suffice."""

    FAULTS = "errors in the data"
    FURTHER_EFFECTS = "further effects"
    EXCHANGES = "exchanges of effects"
    FRICTION = "the best model with friction"
    NEXT_EXPERIMENT = "the next experiment"
    SCATTER = "what may be different in every step"
    PROFILES = "the profiles of the parameters"
    ALL_STEPS = "the fit to all load steps"
    OTHER_MODELS = "other models on all load steps"
    CEILING = "the explainable part of the error"
    TABLES = "the tables of the corrected robot"


#: Parts that may explain what is left: where one was not tried, and more than noise is left, the verdict is open.
MAY_EXPLAIN = frozenset({Part.FURTHER_EFFECTS, Part.EXCHANGES, Part.FRICTION})

#: How much later than all others the simulation for the tables of the corrected robot may end, over the time limit [1].
GRACE = 0.2

#: Shares of the time limit that are kept for the final fit to all load steps, and for the model with friction where the
#: search runs without [1].
FINAL_FIT, WITH_FRICTION = 0.3, 0.1


class OutOfTime(Exception):
    """The time limit has passed within a simulation."""


#: Processor time that workers have used, which those of this process do not know [s].
_of_workers = 0.0


def clock() -> float:
    """Processor time of an identification in this process and its workers, of which deadlines are readings [s].

    On a busy computer an identification takes longer, and finds the same.
    """
    return _of_workers + time.process_time()


def spend(seconds: float) -> None:
    """Count processor time that workers have used [s]."""
    global _of_workers
    _of_workers += seconds


def end_at(deadline: float, progress: Any) -> None:
    """Called with every progress of a simulation, to end it at a deadline, which is a reading of `clock` [s].

    Raises
    ------
    OutOfTime
    """
    if clock() > deadline:
        raise OutOfTime

"""Rows of the loading sequence: which branches they form, which are held out, which a search uses of long data."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase

import numpy as np

from tdcr_fe.elements import Array, Index
from tdcr_fe.io.files import InputError, Problem
from tdcr_fe.io.measured import MeasuredData
from tdcr_fe.model.loading import Actuation, LoadStep, resolve

#: Fewest steps, or readings, from which anything is concluded or shown, and steps with readings of which some are held
#: out.
FEWEST = 4


def clock_of(data: MeasuredData) -> str:
    """What a drift depends on: time, else the row; empty where there are no times and rows are left out."""
    times = [s.time for s in data.steps]
    if all(t is not None for t in times) and len(set(times)) > 1:
        return "time"
    ids = data.step_ids
    return "row" if ids == tuple(range(ids[0], ids[0] + len(ids))) else ""


def progress_along(steps: Sequence[LoadStep]) -> Array:
    """From near zero to one along steps, by time or, without times, by their number, shape (n,)."""
    times = [s.time for s in steps]
    known = np.array([t for t in times if t is not None], dtype=float)
    if known.size == len(times) and np.ptp(known) > 0.0:
        return known / max(float(np.max(known)), 1e-300)
    return np.arange(1.0, len(times) + 1.0) / len(times)


def possible_starts(data: MeasuredData) -> range:
    """Rows, from 0, in which something may begin: there are some before and some after it."""
    return range(3, len(data.steps) - 2)


def read_rows(data: MeasuredData) -> Index:
    """Rows, from 0, to which the readings belong, shape (n,)."""
    row = {n: k for k, n in enumerate(data.step_ids)}
    return np.array([row[r.step] for r in data.readings], dtype=int)


def tip_forces(actions: Sequence[Actuation]) -> Array:
    """Force on the tip in every step, shape (n_steps, 3)."""
    return np.array([a.loads["tip"].force if "tip" in a.loads else (0.0, 0.0, 0.0) for a in actions])


def inputs(data: MeasuredData) -> Array:
    """Commands and tip forces of every step, each over its largest value, shape (n_steps, n_tendons + 3)."""
    actions = resolve(data.robot, data.steps, restarts=data.restarts)
    commands = np.array([a.values for a in actions]).reshape(len(actions), -1)
    table = np.concatenate((commands, tip_forces(actions)), axis=1)
    for part in (slice(0, -3), slice(-3, None)):
        table[:, part] /= np.max(np.abs(table[:, part]), initial=0.0) or 1.0
    return table


def directions(data: MeasuredData) -> Index:
    """Inputs that rise (+1) and fall (-1) towards every step, shape (n_steps, n_tendons + 3)."""
    table = inputs(data)
    change = np.diff(table, axis=0, prepend=np.zeros((1, table.shape[1])))
    return np.where(np.abs(change) < 1e-9, 0, np.sign(change)).astype(int)


def blocks(data: MeasuredData) -> list[list[int]]:
    """Runs of consecutive steps in one branch, as positions in the sequence.

    A branch is what the file calls so; without that, a run of steps in which the same inputs grow and fall.
    """
    named = len(set(data.branches)) > 1
    # of several data sets, some may have names of branches, others none
    both = zip(data.branches, directions(data), strict=True)
    marks = [(b, () if named and not b.endswith("/") else tuple(d)) for b, d in both]
    return [list(own) for _, own in itertools.groupby(range(len(marks)), lambda k: marks[k])]


def choose_held_out(data: MeasuredData, share: float = 0.3) -> tuple[int, ...]:
    """Positions of the steps that are held out.

    Whole blocks, about every third, chosen so that the fitted steps cover the range of every input as far as
    possible. With a single monotone branch, its last levels. With fewer than four steps with readings, none.

    Parameters
    ----------
    data
        Measured data.
    share
        Share of the readings, about.
    """
    read = np.bincount(read_rows(data), minlength=len(data.steps)).astype(float)
    with_readings = np.flatnonzero(read)
    if with_readings.size < FEWEST:
        return ()
    parts = [own for b in blocks(data) if (own := [k for k in b if read[k] > 0.0])]
    if len(parts) == 1:
        last = max(1, round(share * with_readings.size * 0.75))
        return tuple(int(k) for k in with_readings[-last:])
    if len(parts) == 2:
        return tuple(parts[1])
    table = inputs(data)
    every, whole = max(2, round(1.0 / share)), np.ptp(table[with_readings], axis=0)
    best: tuple[float, Sequence[int]] = (-np.inf, ())
    for offset in range(min(every, len(parts))):
        held = [k for i, b in enumerate(parts) if i % every == offset for k in b]
        kept = np.setdiff1d(with_readings, held)
        seen, tested = (np.ptp(table[k], axis=0) / np.maximum(whole, 1e-12) for k in (kept, held))
        used = whole > 1e-9
        part = read[held].sum() / read.sum()
        value = float(np.min(seen[used], initial=1.0) + 0.3 * np.mean(tested[used]) - abs(part - share))
        if value > best[0] + 1e-12:
            best = (value, held)
    return tuple(int(k) for k in best[1])


def held_out_branches(data: MeasuredData, patterns: Sequence[str]) -> tuple[int, ...]:
    """Positions of the steps whose branch matches a pattern; whole branches, all steps of the same name.

    Parameters
    ----------
    data
        Measured data.
    patterns
        Shell patterns (``*``, ``?``, ``[...]``), matched with case against the ``branch`` of ``loading.csv``.

    Returns
    -------
    tuple of int
        Steps with readings.

    Raises
    ------
    InputError
        A pattern matches no branch with readings, or the patterns leave nothing to fit. The message names the branches.
    """
    with_readings = np.unique(read_rows(data)).tolist()
    names = list(dict.fromkeys(data.branches[k] for k in with_readings if data.branches[k]))
    there = f"branches with readings are {', '.join(names)}" if names else "loading.csv names no branches"
    unmatched = [p for p in patterns if not any(fnmatchcase(name, p) for name in names)]
    allowed = f"matches no branch with readings; {there}"
    problems = [Problem(data.name, "--hold-out", p, allowed) for p in unmatched]
    held = tuple(k for k in with_readings if any(fnmatchcase(data.branches[k], p) for p in patterns))
    if not problems and len(held) == len(with_readings):
        allowed = f"matches every step with readings, and nothing is left to fit; {there}"
        problems.append(Problem(data.name, "--hold-out", ", ".join(patterns), allowed))
    if problems:
        raise InputError(problems)
    return held


# ------------------------------------------------------------------------------------- what a search uses of long data

# A search simulates the loading sequence hundreds of times. On long data it takes a part of the steps that covers the
# inputs. With friction the history matters, so that steps are not left out one by one at random:
#
# - Whole branches are chosen, those whose inputs differ most from the ones chosen before (farthest-point sampling). A
#   robot that returns to the same inputs between two branches brings little history from one to the next.
# - Within a branch, steps are left out where the path of the inputs is nearly straight between its neighbours that stay
#   (Ramer, Douglas and Peucker): friction that does not depend on the rate has the same history on the same path, in
#   however many steps it is commanded. Turning points always stay.

#: A path whose inputs deviate by less than this from a straight one, over their range, is straight.
STRAIGHT = 0.02

#: Data with more steps than this are long; about how many steps a search then takes, and in a branch at most. Branches
#: of fewer steps on average are joined to pieces of twice as many. Where that is more, a search takes two branches of
#: each input and a step, so that one parameter per tendon can be determined.
LONG, SEARCHED, IN_BRANCH = 200, 72, 6

#: Share of the chosen steps that are held out, where there are enough of them.
HELD_OUT = 0.33


@dataclass(frozen=True)
class RowChoice:
    """The load steps that a search takes."""

    steps: tuple[int, ...]  # positions in the loading sequence, ascending
    numbers: tuple[int, ...]  # those of ``loading.csv``
    readings: tuple[int, ...]  # indices of their readings
    total: int  # steps of the loading sequence

    @classmethod
    def of_steps(cls, data: MeasuredData, steps: Sequence[int]) -> RowChoice:
        """The choice of steps by their positions in the loading sequence."""
        readings = np.flatnonzero(np.isin(read_rows(data), steps))
        return cls(
            tuple(steps), tuple(data.step_ids[k] for k in steps), tuple(readings.tolist()), len(data.steps)
        )

    def of(self, data: MeasuredData) -> MeasuredData:
        """The data of the chosen steps."""
        steps = tuple(data.steps[k] for k in self.steps)
        branches = tuple(data.branches[k] for k in self.steps)
        readings = tuple(data.readings[i] for i in self.readings)
        return replace(data, step_ids=self.numbers, steps=steps, branches=branches, readings=readings)


def choose_rows(data: MeasuredData, held_out: Sequence[int], history: bool = True) -> RowChoice | None:
    """The load steps that a search takes; None where it takes all, which is so for data that are not long.

    Parameters
    ----------
    data
        Measured data of one loading sequence.
    held_out
        Positions of the steps that are held out, whole branches.
    history
        Whether the model has friction. Without, every step is solved for itself and costs little: twice as many are
        taken, of more branches.

    Returns
    -------
    RowChoice or None
    """
    if len(data.steps) <= LONG or data.parts:
        return None
    read, table, held = read_rows(data), inputs(data), set(held_out)
    with_readings = set(read.tolist())
    branches = [own for b in blocks(data) if (own := [k for k in b if k in with_readings])]
    if len(with_readings) < IN_BRANCH * len(branches):
        branches = _joined(branches, held)
    else:
        branches = [_simplified(table, b) for b in branches]
    groups = ([b for b in branches if b[0] in held], [b for b in branches if b[0] not in held])
    total = max(SEARCHED, (2 * IN_BRANCH + 1) * int(np.count_nonzero(np.ptp(table, axis=0))))
    total *= 1 if history else 2
    share = round(HELD_OUT * total)
    rows = sorted([*_spread(table, groups[0], share), *_spread(table, groups[1], total - share)])
    return None if len(rows) == len(data.steps) else RowChoice.of_steps(data, rows)


def _joined(branches: Sequence[Sequence[int]], held: set[int]) -> list[list[int]]:
    """Neighbouring short branches as pieces of the sequence, each fitted or held out, twice as long as `IN_BRANCH`.

    Where the inputs turn at every other step, nothing can be left out between.
    """
    found: list[list[int]] = []
    for branch in branches:
        joins = found and len(found[-1]) < 2 * IN_BRANCH and (found[-1][0] in held) == (branch[0] in held)
        if joins and branch[0] == found[-1][-1] + 1:
            found[-1].extend(branch)
        else:
            found.append(list(branch))
    return found


def _simplified(table: Array, branch: Sequence[int]) -> list[int]:
    """Steps of a branch that describe the path of its inputs best, `IN_BRANCH` at most, ascending.

    The first, the last, and then always the step farthest from the straight path between its neighbours; where the path
    is straight, that in the middle of the longest part.
    """
    x, kept = table[list(branch)], sorted({0, len(branch) - 1})
    while len(kept) < min(IN_BRANCH, len(branch)):
        inside = [_farthest(x, a, b) for a, b in itertools.pairwise(kept) if b - a > 1]
        kept = sorted((*kept, max(inside, key=lambda found: found[:2])[2]))
    return [branch[i] for i in kept]


def _farthest(x: Array, first: int, last: int) -> tuple[float, float, int]:
    """How far the farthest step between two is from the straight path, how long that is, and that step."""
    chord = x[last] - x[first]
    length, inner = float(np.max(np.abs(chord))), x[first + 1 : last]
    along = (inner - x[first]) @ chord / max(float(chord @ chord), 1e-300)
    gap = np.max(np.abs(inner - (x[first] + np.clip(along, 0.0, 1.0)[:, None] * chord)), axis=1)
    if np.max(gap) < STRAIGHT:
        return 0.0, length, first + 1 + int(np.argmin(np.abs(along - 0.5)))
    return float(np.max(gap)), length, first + 1 + int(np.argmax(gap))


def _spread(table: Array, branches: Sequence[Sequence[int]], most: int) -> list[int]:
    """Steps of branches whose inputs differ most from each other, up to about so many; at least one branch."""
    if not branches:
        return []
    far = np.array([table[b[int(np.argmax(np.abs(table[list(b)]).max(axis=1)))]] for b in branches])
    chosen, distance = [0], np.max(np.abs(far - far[0]), axis=1)
    count = len(branches[0])
    while len(chosen) < len(branches):
        nearest = int(np.argmax(distance))
        if distance[nearest] <= 0.0 or count + len(branches[nearest]) > most:
            break
        chosen.append(nearest)
        count += len(branches[nearest])
        distance = np.minimum(distance, np.max(np.abs(far - far[nearest]), axis=1))
    return [k for i in chosen for k in branches[i]]

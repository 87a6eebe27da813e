"""Load steps: which are held out, and how commanded steps are divided and joined."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from fnmatch import fnmatchcase

import numpy as np
from numpy.typing import NDArray

from tdcr_fe.effects import Experiment
from tdcr_fe.effects.actuation import loads_between
from tdcr_fe.io.measured import MeasuredData
from tdcr_fe.io.problems import InputError, Problem
from tdcr_fe.model.loading import Actuation, LoadStep, resolve

Array = NDArray[np.float64]


def inputs(data: MeasuredData) -> Array:
    """Commands and tip forces of every step, each over its largest value, shape (n_steps, n_tendons + 3)."""
    actions = resolve(data.robot, data.steps)
    force = [a.loads["tip"].force if "tip" in a.loads else (0.0, 0.0, 0.0) for a in actions]
    table = np.concatenate(
        (np.array([a.values for a in actions]).reshape(len(actions), -1), np.array(force)), axis=1
    )
    for part in (slice(0, -3), slice(-3, None)):
        largest = np.max(np.abs(table[:, part]), initial=0.0)
        if largest > 0.0:
            table[:, part] /= largest
    return table


def directions(data: MeasuredData) -> NDArray[np.int_]:
    """Inputs that rise (+1) and fall (-1) towards every step, shape (n_steps, n_tendons + 3)."""
    table = inputs(data)
    change = np.diff(table, axis=0, prepend=np.zeros((1, table.shape[1])))
    return np.where(np.abs(change) < 1e-9, 0, np.sign(change)).astype(int)


def blocks(data: MeasuredData) -> list[list[int]]:
    """Runs of consecutive steps in one branch, as positions in the sequence.

    A branch is what the file calls so; without that, a run of steps in which the same inputs grow and fall.
    """
    count = len(data.steps)
    marks: list[object]
    if data.parts:  # several data sets: some may have names of branches, others none
        turns = [
            () if not b.endswith("/") else tuple(d)
            for b, d in zip(data.branches, directions(data), strict=True)
        ]
        marks = list(zip(data.branches, turns, strict=True))
    elif len(set(data.branches)) > 1:
        marks = list(data.branches)
    else:
        marks = [tuple(d) for d in directions(data)]
    found: list[list[int]] = []
    for k in range(count):
        if k and marks[k] == marks[k - 1]:
            found[-1].append(k)
        else:
            found.append([k])
    return found


def choose_held_out(data: MeasuredData, share: float = 0.3) -> tuple[int, ...]:
    """Positions of the steps that are held out.

    Whole blocks, about every third, chosen so that the fitted steps cover the range of every input as far as
    possible. With a single monotone branch, its last levels. With fewer than four steps with readings, none.

    Parameters
    ----------
    data
        Measured data.
    share
        Of the readings, about.
    """
    position = {n: k for k, n in enumerate(data.step_ids)}
    read = np.bincount([position[r.step] for r in data.readings], minlength=len(data.steps)).astype(float)
    with_readings = np.flatnonzero(read)
    if with_readings.size < 4:
        return ()
    parts = [[k for k in b if read[k] > 0.0] for b in blocks(data)]
    parts = [b for b in parts if b]
    if len(parts) == 1:
        last = max(1, round(share * with_readings.size * 0.75))
        return tuple(int(k) for k in with_readings[-last:])
    if len(parts) == 2:
        return tuple(parts[1])
    table = inputs(data)
    every = max(2, round(1.0 / share))
    best: tuple[float, Sequence[int]] = (-np.inf, ())
    for offset in range(every):
        held = [k for i, b in enumerate(parts) if i % every == offset for k in b]
        kept = np.setdiff1d(with_readings, held)
        if kept.size == 0 or not held:
            continue
        seen = np.ptp(table[kept], axis=0) / np.maximum(np.ptp(table[with_readings], axis=0), 1e-12)
        tested = np.ptp(table[held], axis=0) / np.maximum(np.ptp(table[with_readings], axis=0), 1e-12)
        used = np.ptp(table[with_readings], axis=0) > 1e-9
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
    read = {r.step for r in data.readings}
    with_readings = [k for k, n in enumerate(data.step_ids) if n in read]
    names = list(dict.fromkeys(data.branches[k] for k in with_readings if data.branches[k]))
    there = f"branches with readings are {', '.join(names)}" if names else "loading.csv names no branches"
    problems = [
        Problem(data.name, "--hold-out", p, f"matches no branch with readings; {there}")
        for p in patterns
        if not any(fnmatchcase(name, p) for name in names)
    ]
    held = tuple(k for k in with_readings if any(fnmatchcase(data.branches[k], p) for p in patterns))
    if not problems and len(held) == len(with_readings):
        allowed = f"matches every step with readings, and nothing is left to fit; {there}"
        problems.append(Problem(data.name, "--hold-out", ", ".join(patterns), allowed))
    if problems:
        raise InputError(problems)
    return held


def divide_steps(experiment: Experiment, which: set[int], parts: int) -> Experiment:
    """Divide commanded steps into equal parts to resolve path dependence.

    Steps already divided, of a fixed number of substeps, or in which a tendon changes from tension to displacement stay
    whole. Without friction at each hole, or with friction that has no history, all steps stay whole.

    Parameters
    ----------
    experiment
        With the commands.
    which
        Commanded steps, from 0.
    parts
        Of each.

    Returns
    -------
    Experiment
        The same one where nothing is to be divided.
    """
    if experiment.model.friction != "per-hole":
        return experiment
    if experiment.restarts:
        firsts = iter((0, *experiment.restarts))

        def divide(part: Experiment) -> Experiment:
            first = next(firsts)
            return divide_steps(part, {k - first for k in which if k >= first}, parts)

        return experiment.with_sequences(divide)
    actions = resolve(experiment.robot, experiment.steps)
    whole = [k for k, factor in experiment.step_ends if factor == 1.0]
    single = {k for k, _ in experiment.step_ends if [x for x, _ in experiment.step_ends].count(k) == 1}
    steps: list[LoadStep] = []
    ends: list[tuple[int, float]] = []
    names = experiment.robot.tendon_names
    before = Actuation(actions[0].drives, np.zeros(len(names)))
    for step, action, (k, factor) in zip(experiment.steps, actions, experiment.step_ends, strict=True):
        same = bool(np.all(before.by_displacement == action.by_displacement))
        if k in which and k in single and k in whole and same and step.substeps is None:
            for i in range(1, parts):
                x = i / parts
                values = before.values + x * (action.values - before.values)
                commanded = {n: float(values[names.index(n)]) for n in (*step.tensions, *step.displacements)}
                steps.append(
                    replace(
                        step,
                        tensions={n: commanded[n] for n in step.tensions},
                        displacements={n: commanded[n] for n in step.displacements},
                        loads=loads_between(before.loads, step.loads, x),
                        time=None if step.time is None else before.time + x * (action.time - before.time),
                    )
                )
                ends.append((k, x))
        steps.append(step)
        ends.append((k, factor))
        before = action
    if len(steps) == len(experiment.steps):
        return experiment
    return replace(experiment, steps=tuple(steps), ends=tuple(ends))


def join_steps(experiment: Experiment) -> Experiment:
    """Join the parts into which effects have divided commanded steps, where no state depends on those before.

    Without friction the robot has no history: what counts is the end of a commanded step. Effects that have a history
    of their own, such as backlash, have acted already.

    Parameters
    ----------
    experiment
        Of one loading sequence, with all its effects.

    Returns
    -------
    Experiment
        The same one where there is friction, or nothing is divided.
    """
    if experiment.model.friction != "none" or experiment.ends is None:
        return experiment
    steps: list[LoadStep] = []
    passed: LoadStep | None = None
    for j, (step, (k, _)) in enumerate(zip(experiment.steps, experiment.ends, strict=True)):
        passed = step if passed is None else _after(passed, step)
        if j + 1 == len(experiment.ends) or experiment.ends[j + 1][0] != k:
            steps.append(passed)
            passed = None
    if len(steps) == len(experiment.steps):
        return experiment
    return replace(experiment, steps=tuple(steps), ends=None)


def _after(first: LoadStep, second: LoadStep) -> LoadStep:
    """One step for two, of which the second keeps what it does not name."""
    tensions = {n: v for n, v in first.tensions.items() if n not in second.displacements}
    displacements = {n: v for n, v in first.displacements.items() if n not in second.tensions}
    return replace(
        second,
        tensions={**tensions, **second.tensions},
        displacements={**displacements, **second.displacements},
        loads={**first.loads, **second.loads},
        time=first.time if second.time is None else second.time,
    )

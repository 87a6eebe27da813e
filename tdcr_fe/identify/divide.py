"""Commanded steps in parts: divided to resolve path dependence, and joined where no state depends on those before."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from tdcr_fe.effects import Experiment
from tdcr_fe.effects.actuation import loads_between
from tdcr_fe.model.loading import Actuation, LoadStep, resolve


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
    before = Actuation(actions[0].by_displacement, np.zeros(len(names)))
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

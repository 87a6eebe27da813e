"""Effects between command and base plate: gain, idle tension, backlash, friction of the actuation, time lag."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from tdcr_fe.effects.base import Bounds, Effect, ExcitationRange, Experiment, Kind, Parameter, Values
from tdcr_fe.effects.by_tendon import NumberForm, SharedNumber, of_single_tendons
from tdcr_fe.elements import Array
from tdcr_fe.model.loading import Actuation, Load, LoadStep, resolve


@dataclass(frozen=True)
class Play:
    """Play operator: the output ``a`` stays between two increasing bounds of the command and moves only at a bound."""

    low: Callable[[float], float]  # bounds, from the command
    high: Callable[[float], float]
    pushes: Callable[[float], float]  # the command at which a rising one pushes ``a`` up at the lower bound
    pulls: Callable[[float], float]  # the command at which a falling one pulls ``a`` down at the upper bound

    def arrive(self, before: float, command: float) -> float:
        """Output at a command [N or m]."""
        return min(max(before, self.low(command)), self.high(command))

    def kink(self, before: float, start: float, end: float) -> float | None:
        """Load factor of a ramp of the command at which the output begins to move; None if at once or never."""
        if start == end:
            return None
        factor = ((self.pushes if end > start else self.pulls)(before) - start) / (end - start)
        return factor if 1e-9 < factor < 1.0 - 1e-9 else None


def tension_play(dead_band: float, efficiency: float) -> Play:
    """Friction before the base: from ``(T - dead_band) efficiency`` to ``T / efficiency + dead_band``, at least 0."""
    return Play(
        lambda t: max((t - dead_band) * efficiency, 0.0),
        lambda t: max(t / efficiency + dead_band, 0.0),
        lambda a: a / efficiency + dead_band,
        lambda a: (a - dead_band) * efficiency,
    )


def displacement_play(low: float, high: float) -> Play:
    """Lost motion [m]: the output stays between the command plus ``low`` and plus ``high``."""
    return Play(lambda d: d + low, lambda d: d + high, lambda a: a - low, lambda a: a - high)


def first_travel(commands: Iterable[float], backlash: float) -> float:
    """The first command beyond the lost motion [m], zero where none is."""
    return next((d for d in commands if abs(d) > backlash), 0.0)


def loads_between(old: Mapping[str, Load], new: Mapping[str, Load], factor: float) -> dict[str, Load]:
    """Loads at a load factor between two steps."""
    result = {}
    for name, load in new.items():
        start = old.get(name)
        if start is None or (start.at, start.frame) != (load.at, load.frame):
            start = replace(load, force=(0.0, 0.0, 0.0), moment=(0.0, 0.0, 0.0))
        between: dict[str, Any] = {
            key: tuple((1.0 - factor) * a + factor * b for a, b in zip(*ends, strict=True))
            for key, ends in (("force", (start.force, load.force)), ("moment", (start.moment, load.moment)))
        }
        result[name] = replace(load, **between)
    return result


def with_commands(step: LoadStep, values: Mapping[str, float], **rest: Any) -> LoadStep:
    """A step with other tensions and displacements of the tendons that it names, and with other changes.

    It must be in newtons and metres (`tdcr_fe.model.loading.in_newtons_and_metres`): angles of motors would stay.
    """
    rest |= {kind: {n: values[n] for n in getattr(step, kind)} for kind in ("tensions", "displacements")}
    return replace(step, **rest)


def pass_through(
    experiment: Experiment,
    tension: Play | None = None,
    displacement: Callable[[list[float]], Play] | None = None,
    slack: float = 0.0,
) -> Experiment:
    """Replace the commands of every tendon by the output of a play operator.

    Where several inputs change in one step, the output of one may begin to move within the step. The step is divided
    there, because friction depends on the order in which tendons move.

    Parameters
    ----------
    experiment
        With the commands.
    tension
        Play of tendons driven by tension; None leaves them unchanged.
    displacement
        From the commands of a tendon [m] to its play; None leaves them unchanged.
    slack
        Travel before which a tendon driven by displacement does not move at all [m].
    """
    actions = resolve(experiment.robot, [LoadStep(), *experiment.steps])
    names = experiment.robot.tendon_names
    count = len(names)
    plays: list[Play | None] = []
    for i in range(count):
        travel = [float(a.values[i]) for a in actions[1:] if a.by_displacement[i]]
        plays.append(displacement(travel) if displacement is not None and travel else None)
    arrived, moving, begin = np.zeros(count), np.zeros(count, dtype=bool), 0.0
    steps: list[LoadStep] = []
    ends: list[tuple[int, float]] = []
    each = zip(experiment.steps, itertools.pairwise(actions), experiment.ends, strict=True)
    for step, (before, action), (commanded, done) in each:
        command, goal = before.values, action.values
        play = [plays[i] if action.by_displacement[i] else tension for i in range(count)]
        loaded = any(x != before.loads.get(n) for n, x in action.loads.items())
        factors = {1.0}
        if np.count_nonzero(goal != command) + loaded > 1:
            ramps = zip(play, arrived, command, goal, strict=True)
            kinks = [None if p is None else p.kink(here, a, b) for p, here, a, b in ramps]
            for k in kinks:
                # Tendons that begin to move together divide the step once, whatever the round-off.
                if k is not None and min(abs(k - x) for x in factors) > 1e-9:
                    factors.add(k)
        for factor in sorted(factors):
            there = command + factor * (goal - command)
            moving |= ~action.by_displacement | (np.abs(there) > slack)
            for i, p in enumerate(play):
                if p is None:
                    arrived[i] = there[i]
                elif moving[i]:
                    arrived[i] = p.arrive(float(arrived[i]), float(there[i]))
            part = step
            if factor < 1.0:
                then = None if step.time is None else before.time + factor * (step.time - before.time)
                part = replace(step, loads=loads_between(before.loads, step.loads, factor), time=then)
            steps.append(with_commands(part, dict(zip(names, arrived.tolist(), strict=True))))
            ends.append((commanded, float(begin + factor * (done - begin))))
        begin = done % 1.0  # a commanded step that has parts goes on
    return replace(experiment, steps=tuple(steps), ends=tuple(ends))


class ActuatorBacklash(Effect):
    """Displacement lost before the tendon follows.

    Gears, couplings and slack tendons lose some travel at the start and at every reversal. Where the play begins in its
    middle, half of it is lost at the start.

    Distinguished by: command small cycles about one position and measure travel at the base plate.
    """

    name = "actuator_backlash"
    kind = Kind("input", ("direction of loading",))
    parameters = (Parameter("backlash", "m", 0.0, 0.05, 0.0, 1e-4, "travel that is lost"),)
    more = (
        replace(parameters[0], name="from_middle", meaning="travel that is lost, half of it at the start"),
    )

    def forms(self, experiment: Experiment) -> tuple[Effect, ...]:
        """All of it is lost at the start, or half of it."""
        return self, NumberForm(self, "from the middle", ["from_middle"], experiment)

    def typical_steps(self, experiment: Experiment, excitation: ExcitationRange) -> dict[str, float]:
        """A fifth of the largest displacement; nothing on data driven by tension."""
        driven = any(s.displacements for s in experiment.steps)
        return {"backlash": 0.2 * excitation.displacement} if driven else {}

    def bounds(self, experiment: Experiment) -> Bounds:
        """Up to the largest displacement."""
        largest = max((abs(d) for s in experiment.steps for d in s.displacements.values()), default=0.0)
        return {"backlash": (0.0, max(largest, 1e-6))}

    def apply(self, experiment: Experiment, values: Values) -> Experiment:
        """See `Effect.apply`."""
        backlash, half = values.get("backlash", 0.0), 0.5 * values.get("from_middle", 0.0)
        if backlash == half == 0.0:
            return experiment

        def play(commands: list[float]) -> Play:
            low = -backlash if first_travel(commands, backlash) > 0.0 else 0.0
            return displacement_play(low - half, low + backlash + half)

        return pass_through(experiment, displacement=play, slack=backlash)


class ActuatorLoss(Effect):
    """Friction before the base plate.

    Pulleys, sheaths and the motor lose part of the tension before the base plate, by friction.

    Distinguished by: measure the tension at the base plate while pulling and while letting out.
    """

    name = "actuator_loss"
    kind = Kind("input", ("direction of loading",))
    parameters = (
        Parameter("dead_band", "N", 0.0, 20.0, 0.0, 0.02, "tension lost whatever the tension is"),
        Parameter("efficiency", "1", 0.3, 1.0, 1.0, 0.02, "fraction of the rest that arrives"),
    )

    def typical_steps(self, experiment: Experiment, excitation: ExcitationRange) -> dict[str, float]:
        """A tenth of the largest tension; nothing on data driven by displacement."""
        driven = any(s.tensions for s in experiment.steps)
        return {"dead_band": 0.1 * excitation.tension, "efficiency": -0.1} if driven else {}

    def bounds(self, experiment: Experiment) -> Bounds:
        """A dead band up to the largest tension."""
        return {"dead_band": (0.0, max(experiment.largest_tension, 1e-6)), "efficiency": (0.3, 1.0)}

    def apply(self, experiment: Experiment, values: Values) -> Experiment:
        """See `Effect.apply`."""
        if values["dead_band"] == 0.0 and values["efficiency"] == 1.0:
            return experiment
        return pass_through(experiment, tension_play(values["dead_band"], values["efficiency"]))


class CommandNumber(SharedNumber):
    """An effect that gives the commands of every tendon one number, ``parameters[0]``.

    Besides that of all, ``NAME_TENDON`` is the number of one tendon, ``NAME_folder_K`` that of the K-th folder, from
    1, and ``NAME_TENDON_folder_K`` that of a tendon in it. The most particular one that is given counts.
    """

    def forms(self, experiment: Experiment) -> tuple[Effect, ...]:
        """One for all, for each tendon, or for a single one; with several folders also for each and for a tendon in it.

        Without numbers for the first folder, where it is as declared, too.
        """
        name, tendons = self.parameters[0].name, experiment.robot.tendon_names
        folders = range(1, experiment.folder_count + 1)
        parts = [("", [""]), ("each later folder", [f"_folder_{k}" for k in folders[1:]])]
        parts.append(("each folder", [f"_folder_{k}" for k in folders]))
        forms: list[Effect] = [self]
        for kind, ends in parts if len(folders) > 1 else parts[:1]:
            if kind:
                forms.append(NumberForm(self, kind, [name + end for end in ends], experiment))
            if len(tendons) > 1:
                names = [f"{name}_{t}{end}" for end in ends for t in tendons]
                kind_each = f"each tendon, {kind}" if kind else "each tendon"
                forms.append(NumberForm(self, kind_each, names, experiment))
        return (*forms, *of_single_tendons(self, experiment))

    def parts_of(self, experiment: Experiment) -> dict[str, str]:
        """Each tendon, each folder, and each tendon in each folder."""
        tendons = experiment.robot.tendon_names
        folders = range(1, experiment.folder_count + 1) if experiment.folder_count > 1 else ()
        parts = {t: t for t in tendons}
        parts |= {f"folder_{k}": f"folder {k}" for k in folders if f"folder_{k}" not in tendons}
        return parts | {f"{t}_folder_{k}": f"{t} in folder {k}" for k in folders for t in tendons}

    def number(self, experiment: Experiment, values: Values, tendon: str) -> float:
        """The number of a tendon in the experiment's folder."""
        one = self.parameters[0]
        folder = f"folder_{experiment.folder}"
        names = [f"{one.name}_{tendon}_{folder}", f"{one.name}_{folder}", f"{one.name}_{tendon}", one.name]
        return next((values[n] for n in names if n in values), one.null_value)

    def alone(self, values: Values, experiment: Experiment) -> dict[str, float]:
        """See `Effect.alone`."""
        one = self.parameters[0].name
        if set(values) <= {one, *(f"{one}_{t}" for t in experiment.robot.tendon_names)}:
            return dict(values)
        return {f"{one}_{t}": self.number(experiment, values, t) for t in experiment.robot.tendon_names}


class ActuatorGain(CommandNumber):
    """Commanded displacement or tension off by a factor.

    Command and actual value differ by a factor: radius of a spool, scale of a load cell, a gear.

    Distinguished by: measure tension or travel at the base plate itself.
    """

    name = "actuator_gain"
    kind = Kind("input", ("nothing",))
    parameters = (Parameter("gain", "1", 0.05, 20.0, 1.0, 0.03, "actual over commanded value"),)

    def apply(self, experiment: Experiment, values: Values) -> Experiment:
        """See `Effect.apply`."""
        gain = {t: self.number(experiment, values, t) for t in experiment.robot.tendon_names}
        steps = []
        for step in experiment.steps:
            commands = {**step.tensions, **step.displacements}
            steps.append(with_commands(step, {n: gain[n] * x for n, x in commands.items()}))
        return replace(experiment, steps=tuple(steps))


class IdleTension(CommandNumber):
    """Tension that is left in tendons whose command is less.

    Tendons that are commanded no tension still carry some: the controller keeps them from becoming slack, or they
    drag the motor along.

    Distinguished by: measure the tension of an idle tendon at the base plate while another one is pulled.
    """

    name = "idle_tension"
    kind = Kind("input", ("nothing",))
    parameters = (Parameter("tension", "N", 0.0, 20.0, 0.0, 0.02, "least tension of a tendon"),)

    def typical_steps(self, experiment: Experiment, excitation: ExcitationRange) -> dict[str, float]:
        """A fiftieth of the largest tension; nothing where every tendon is always commanded more, or a displacement."""
        commands, step = [t for s in experiment.steps for t in s.tensions.values()], 0.02 * excitation.tension
        return {"tension": step} if any(t > 0.0 for t in commands) and min(commands) < step else {}

    def bounds(self, experiment: Experiment) -> Bounds:
        """Up to the largest tension."""
        return {"tension": (0.0, max(experiment.largest_tension, 1e-6))}

    def apply(self, experiment: Experiment, values: Values) -> Experiment:
        """See `Effect.apply`; tendons that no step has named yet are commanded zero."""
        least = {t: self.number(experiment, values, t) for t in experiment.robot.tendon_names}
        if not any(least.values()):
            return experiment
        steps = []
        for k, step in enumerate(experiment.steps):
            tensions = dict(step.tensions)
            if k == 0:
                idle = [t for t in experiment.robot.tendons if t.pretension == 0.0]
                tensions = {t.name: 0.0 for t in idle if t.name not in step.displacements} | tensions
            steps.append(replace(step, tensions={n: max(t, least[n]) for n, t in tensions.items()}))
        return replace(experiment, steps=tuple(steps))


# -------------------------------------------------------------------------------------------------------------- time


class TimeLag(Effect):
    """Readings belong to a time earlier than that of the commands they stand beside.

    Commands and readings are not taken at the same instant: a camera that delivers late, a filter, a bus. What is
    read while the robot moves belongs to an earlier command.

    Distinguished by: repeat a movement at half the speed, or let the robot rest before each reading.
    """

    name = "time_lag"
    kind = Kind("input", ("time",))
    parameters = (
        Parameter("lag", "s", 0.0, 3600.0, 0.0, 0.02, "time by which a reading is older than its command"),
    )

    def bounds(self, experiment: Experiment) -> Bounds:
        """Up to four times the median time between steps."""
        times = [experiment.steps[k].time for k in experiment.whole_steps]
        pauses = np.diff([t for t in times if t is not None])
        longest = 4.0 * float(np.median(pauses)) if np.any(pauses > 0.0) else 1e-3
        return {"lag": (0.0, longest)}

    def typical_steps(self, experiment: Experiment, excitation: ExcitationRange) -> dict[str, float]:
        """Half of the median time between steps; nothing on data without times."""
        timed = experiment.steps and all(s.time is not None for s in experiment.steps)
        step = 0.125 * self.bounds(experiment)["lag"][1]
        return {"lag": step} if timed and excitation.duration > 0.0 else {}

    def apply(self, experiment: Experiment, values: Values) -> Experiment:
        """See `Effect.apply`. Between two steps, inputs and loads change linearly with time.

        Every step ends where its reading belongs to, and is divided where the commands have a kink before that.
        Before the time of the first step, the robot is as at its end.
        """
        lag = values["lag"]
        if lag == 0.0 or not experiment.steps:
            return experiment
        times = [s.time for s in experiment.steps]
        if any(t is None for t in times):
            raise ValueError("time_lag needs a time in every step")
        at = np.array(times, dtype=float)
        actions = resolve(experiment.robot, experiment.steps)
        first, *later = experiment.whole_steps
        steps, ends = list(experiment.steps[: first + 1]), list(experiment.ends[: first + 1])
        begin, j = at[first], first
        for k in later:
            commanded = experiment.ends[k][0]
            end = max(at[k] - lag, at[first])
            while j + 1 < len(at) and at[j + 1] < end:
                j += 1
                if at[j] > begin:
                    steps.append(experiment.steps[j])
                    ends.append((commanded, float((at[j] - begin) / (end - begin))))
            steps.append(_between(experiment, actions, at, j, float(end)))
            ends.append((commanded, 1.0))
            begin = end
        return replace(experiment, steps=tuple(steps), ends=tuple(ends))


def _between(experiment: Experiment, actions: list[Actuation], at: Array, j: int, time: float) -> LoadStep:
    """The step that ends at a time [s] on the way from the end of step ``j`` to that of the next."""
    names, steps = experiment.robot.tendon_names, experiment.steps
    if time <= at[j] or j + 1 == len(at):
        return replace(steps[j], time=time)
    before, after, step = actions[j], actions[j + 1], steps[j + 1]
    if np.any(before.by_displacement != after.by_displacement):
        raise ValueError("time_lag: a tendon changes between tension and displacement")
    factor = float((time - at[j]) / (at[j + 1] - at[j]))
    values = dict(zip(names, ((1.0 - factor) * before.values + factor * after.values).tolist(), strict=True))
    return with_commands(step, values, time=time, loads=loads_between(before.loads, step.loads, factor))

"""Unlisted causes that change what the tendons are driven with: offsets, gains, limits, shares, lags, jumps."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from scipy.integrate import cumulative_trapezoid

from tdcr_fe.effects import Experiment, Parameter
from tdcr_fe.effects.base import Kind, Values
from tdcr_fe.elements import Array, Flags
from tdcr_fe.identify.bay_state import BayState, last_direction
from tdcr_fe.identify.causes import Cause, ChangedDescription, number, settling_span
from tdcr_fe.identify.criteria import PER_FACTOR
from tdcr_fe.identify.rows import clock_of, possible_starts, progress_along
from tdcr_fe.io.measured import MeasuredData
from tdcr_fe.model.loading import LoadStep, resolve

if TYPE_CHECKING:
    from tdcr_fe.identify.problem import FitProblem


def input_causes(problem: FitProblem, state: BayState) -> list[Cause]:
    """Inputs other than commanded; ``state``: of the declared model."""
    own, clock, data = _Inputs.of(problem, state), clock_of(problem.data), problem.data
    if not own.names:
        return []
    by_row = [*own.lags(data), *own.jumps(data)] if clock and not data.parts else []
    return [*own.by_law(clock), *own.limits(), *own.waves(), *own.shares(), *by_row]


class Commands(NamedTuple):
    """The inputs of a loading sequence by kind, and progress along its rows."""

    # By field of `LoadStep`: inputs, zero where a step names none, and where it names one, shape (K, m)
    kinds: Mapping[str, tuple[Array, Flags]]
    progress: Array  # shape (K, 1)

    @classmethod
    def of(cls, experiment: Experiment) -> Commands:
        """The commands of one loading sequence, which must be in newtons and metres: angles of motors are not read."""
        steps, names = experiment.steps, experiment.robot.tendon_names
        kinds = {}
        for kind in ("tensions", "displacements"):
            table = np.array([[getattr(s, kind).get(n, np.nan) for n in names] for s in steps])
            table = table.reshape(len(steps), len(names))
            kinds[kind] = np.nan_to_num(table), np.isfinite(table)
        progress = progress_along([steps[j] for j in experiment.whole_steps])
        return cls(kinds, progress[[k for k, _ in experiment.ends], None])


#: What a change of the inputs is in proportion to: from inputs and progress of `Commands`, and values of the cause.
_InputLaw = Callable[[Array, Array, Values], Any]


class ChangedInputs(ChangedDescription):
    """A cause that changes inputs by numbers times what follows from all inputs and from progress along the rows.

    It acts by an `_InputLaw`. Where no number has the name of a tendon, the first one is that of all.
    """

    def _numbers(self, tendons: Sequence[str]) -> list[str]:
        """By tendon, name of the number by which the change of its input is multiplied; empty where it stays."""
        own = [p.name for p in self.parameters]
        of_all = "" if own[0] in tendons else own[0]
        return [name if name in own else of_all for name in tendons]

    def apply(self, experiment: Experiment, values: Values) -> Experiment:
        """See `Effect.apply`; no tension falls below zero."""
        names = experiment.robot.tendon_names
        factors = np.array([values.get(n, 0.0) for n in self._numbers(names)])
        if not factors.any():
            return experiment
        commands, steps = Commands.of(experiment), list(experiment.steps)
        for kind, (table, given) in commands.kinds.items():
            moved = table + factors * self.acts(table, commands.progress, values)
            new = np.where(given, np.maximum(moved, 0.0) if kind == "tensions" else moved, table)
            for j in np.flatnonzero(np.any(new != table, axis=1)):
                own: Any = {n: float(x) for n, x, there in zip(names, new[j], given[j], strict=True) if there}
                steps[j] = replace(steps[j], **{kind: own})
        return replace(experiment, steps=tuple(steps))

    def by_number(self, experiment: Experiment, commands: Commands, values: Values, name: str) -> Array:
        """Derivatives of all inputs by a number that multiplies them, where it is zero, shape (K, m).

        What a step does not name stays as it was before.
        """
        own = [n == name for n in self._numbers(experiment.robot.tendon_names)]
        named = np.any([given for _, given in commands.kinds.values()], axis=0)
        found = np.zeros(named.shape)
        for table, given in commands.kinds.values():
            found += np.where(given & own, self.acts(table, commands.progress, values), 0.0)
        rows = np.where(named, np.arange(len(found))[:, None], 0)
        return np.take_along_axis(found, np.maximum.accumulate(rows), axis=0)


class _Inputs(NamedTuple):
    """The inputs of a loading sequence that change."""

    every: Sequence[str]  # Names of all tendons
    names: tuple[str, ...]  # Names of those whose inputs change
    largest: tuple[float, ...]  # Largest input of each of these [N or m]
    most: float  # Largest input of all [N or m]
    unit: str
    rows: Array  # progress of the rows, shape (K,)
    # Mean along every tendon of its tension squared, over the largest, shape (K, m); zero where it would change nothing
    squared: Array

    @classmethod
    def of(cls, problem: FitProblem, state: BayState) -> _Inputs:
        """The inputs of the declared loading sequence that change; ``state``: see `input_causes`."""
        actions, tendons = resolve(problem.data.robot, problem.data.steps), problem.data.robot.tendon_names
        commands = np.array([a.values for a in actions]).reshape(len(actions), -1)
        driven = np.flatnonzero(np.ptp(commands, axis=0) > 0.0)
        displaced = driven.size and actions[0].by_displacement[driven[0]]
        names, sizes = tuple(tendons[i] for i in driven), np.max(np.abs(commands), axis=0, initial=0)
        most = float(np.max(sizes, initial=0.0))
        squared = np.einsum("b,kbt->kt", np.diff(state.edges), state.tension**2)
        # Where several sequences are joined, progress does not tell which one a step is in.
        squared = squared * bool(displaced and not problem.data.parts) / (np.max(squared, initial=0.0) or 1.0)
        unit, rows = "m" if displaced else "N", progress_along(problem.data.steps)
        return cls(tendons, names, tuple(sizes[driven].tolist()), most, unit, rows, squared)

    def by_law(self, clock: str) -> Iterator[Cause]:
        """Off by a constant, by a part that grows with them, or that changes along the rows: all, each or one."""
        most, grows = self.most, "the gain of the inputs depends on their size"
        gain_settles, (span, spans) = "the gain of the inputs settles", settling_span("1", 1.0)
        missing = "a share of the largest input so far is missing"
        unequal = "the tendons' stretch is not in proportion to their tension"

        def settled(p: Array, values: Values) -> Array:
            return 1.0 - np.exp(-p / values["span"])

        def largest(u: Array, *_: Any) -> Array:  # no tension falls below zero
            found = np.maximum.accumulate(np.abs(u), axis=0)
            return np.where(u == 0.0, 0.0, found) if self.unit == "N" else found

        def so_far(u: Array, p: Array, _: Values) -> Array:
            return cumulative_trapezoid(np.maximum(u, 0.0), p, axis=0, initial=0)

        def stretched(u: Array, p: Array, _: Values) -> Array:
            return -np.stack([np.interp(p[:, 0], self.rows, own) for own in self.squared.T], axis=1)

        direction, another = "direction of loading", "the gain of the inputs is another one while they"
        laws: list[tuple[str, str, _InputLaw, str]] = [
            ("offset", "nothing", lambda *_: 1.0, "the inputs are off by a constant"),
            ("gain that grows", "tension", lambda u, *_: u * np.abs(u) / most, grows),
            ("gain by the largest so far", "tension", largest, missing),
            ("gain while rising", direction, lambda u, *_: u * (last_direction(u) > 0.0), f"{another} rise"),
            ("gain while falling", direction, lambda u, *_: u * (last_direction(u) < 0.0), f"{another} fall"),
            ("gain that drifts", clock, lambda u, p, _: u * p, "the gain of the inputs drifts"),
            ("offset that drifts", clock, lambda u, p, _: p, "the inputs drift"),
            ("gain that settles", clock, lambda u, *x: u * settled(*x), gain_settles),
            ("offset that settles", clock, lambda u, *x: settled(*x), "the inputs drift and settle"),
            ("stretch by the square", "tension" * bool(self.squared.any()), stretched, unequal),
            ("gain over the time so far", clock * (self.unit == "m"), so_far, "pulled tendons give way"),
        ]
        for name, depends, shape, text in (law for law in laws if law[1]):
            is_gain = name.startswith("gain")
            size, unit = (1.0, "1") if is_gain else (most, self.unit)
            last, held = ((span,), spans) if name.endswith("settles") else ((), {})
            one = number("all", unit, (-0.9 * size, 3.0 * size), 0.0, 0.01 * size)
            each = tuple(replace(one, name=n) for n in self.names)
            of_all = is_gain or shape is stretched
            forms: dict[str, tuple[Parameter, ...]] = {"all": (one,)} if of_all else {}
            forms = {**forms, "each": each} if len(each) > 1 else {}
            for who, own in (forms | {p.name: (p,) for p in each}).items():
                single = who in self.names
                kind = Kind("input", (depends,), f"tendon {who}" if single else "everywhere")
                price = math.log(len(laws) * (len(each) if single else 1))
                price += PER_FACTOR * (depends != "nothing")
                yield ChangedInputs(f"input {name} ({who})", kind, (*own, *last), shape, text, price, held)

    def waves(self) -> Iterator[Cause]:
        """Displacements off by a wave of themselves, as from a spool that runs out of true."""
        size = number("size", "m", (-self.most, self.most), 0.0, 0.01 * self.most)
        period = number("period", "m", (0.2 * self.most, 20.0 * self.most), self.most, 0.1 * self.most)
        phase = number("phase", "rad", (-4.0, 4.0), 0.0, 0.1)
        tried = {"period": [x * self.most for x in (0.5, 1.0, 2.0, 4.0)], "phase": [0.0, 0.5 * math.pi]}
        for name in self.names if self.unit == "m" else ():

            def wave(u: Array, _: Array, values: Values, tendon: str = name) -> Array:
                turned = 2.0 * math.pi * u / values["period"] + values["phase"]
                moved = np.sin(turned) - math.sin(values["phase"])
                return np.where(np.isin(self.every, tendon), moved, 0.0)

            kind, numbers = Kind("input", ("tension",), f"tendon {name}"), (size, period, phase)
            label, text = f"wave of the input (tendon {name})", "an input is off by a wave, as of a spool"
            yield ChangedInputs(label, kind, numbers, wave, text, math.log(len(self.names)), tried)

    def limits(self) -> Iterator[Cause]:
        """A share of what is beyond a limit, or of what is below it, does not arrive: of all, or of one."""
        share = number("share", "1", (-1.0, 1.0), 0.0, 0.1)
        # Names of tendons, their largest input, how a cause is named and begins in words, its place and price.
        whose = [(self.names, self.most, "inputs", "the inputs have", "everywhere", 0.0)]
        price = math.log(len(self.names))
        for n, most in zip(self.names, self.largest, strict=True) if len(self.names) > 1 else ():
            whose.append(((n,), most, f"input (tendon {n})", "an input has", f"tendon {n}", price))
        beyond, below = "a limit: a share of what is beyond", "a dead zone: a share of what is below a limit"
        for (names, most, label, having, where, price), above in itertools.product(whose, (True, False)):
            here = np.isin(self.every, names)

            def lost(u: Array, _: Array, values: Values, here: Flags = here, above: bool = above) -> Array:
                size, limit = np.abs(u), values["limit"]
                part = np.maximum(size - limit, 0.0) if above else np.minimum(size, limit)
                return np.where(here, -np.sign(u) * part, 0.0)

            what, null = ("limit", most) if above else ("dead zone", 0.0)
            tried = (0.5, 0.7, 0.85) if above else (0.1, 0.2, 0.4)
            numbers = share, number("limit", self.unit, (0.0, most), null, 0.05 * most)
            text = f"{having} {beyond if above else below} does not arrive"
            kind, held = Kind("input", ("tension",), where), {"limit": [x * most for x in tried]}
            yield ChangedInputs(f"{what} of the {label}", kind, numbers, lost, text, price, held)

    def shares(self) -> Iterator[Cause]:
        """A share of the input of one tendon in another."""
        couples = list(itertools.permutations(self.names, 2))
        for source, name in couples:

            def other(u: Array, *_: Any, i: int = self.every.index(source)) -> Array:
                return u[:, [i]]

            share = number(name, "1", (-0.9, 0.9), 0.0, 0.01)
            kind, price = Kind("input", ("tension",), f"tendon {name}"), math.log(len(couples))
            text = f"a share of the input of tendon {source} acts in tendon {name}"
            yield ChangedInputs(f"crosstalk from {source} to {name}", kind, (share,), other, text, price)

    def lags(self, data: MeasuredData) -> Iterator[Cause]:
        """What acts stays behind its command, by a share of the way from what acted in the row before.

        Or, where the times between rows differ, by so many seconds on the way from the command of the row before.
        """
        share, kind = number("share", "1", (-0.5, 0.9), 0.0, 0.01), Kind("input", ("the row before",))
        text = "the inputs stay behind their commands"

        def lagging(experiment: Experiment, values: Values) -> Experiment:
            return _behind(experiment, [values["share"]] * len(experiment.whole_steps), of_commands=False)

        def coming_late(experiment: Experiment, values: Values) -> Experiment:
            pauses = _pauses([experiment.steps[k] for k in experiment.whole_steps])
            shares = [min(values["late"] / pause, 1.0) for pause in pauses]
            return _behind(experiment, shares, of_commands=True)

        yield ChangedDescription("lag of the inputs", kind, (share,), lagging, text)
        pauses = _pauses(data.steps)
        typical = float(np.median(pauses))
        if np.all(pauses > 0.0) and np.ptp(pauses[1:]) > 0.01 * typical:
            late = number("late", "s", (-0.5 * typical, 0.9 * typical), 0.0, 0.01 * typical)
            yield ChangedDescription("late inputs", kind, (late,), coming_late, text)

    def jumps(self, data: MeasuredData) -> Iterator[Cause]:
        """Another zero of one input, or another gain of one or all, from a row on."""
        progress, price = progress_along(data.steps), math.log(len(data.steps))
        gain = number("all", "1", (-0.9, 3.0), 0.0, 0.01)
        for k in possible_starts(data):
            since, start = f"from row {data.step_ids[k]} on", float(progress[k])

            def later(u: Array, p: Array, _: Values, start: float = start) -> Flags:
                return p >= start

            def gained(u: Array, p: Array, _: Values, start: float = start) -> Array:
                return u * (p >= start)

            kind, text = Kind("input", ("row",), since), "the gain of the inputs jumps"
            yield ChangedInputs(f"jump of the gain ({since})", kind, (gain,), gained, text, price)
            for name in self.names:
                where, each = f"tendon {name}, {since}", price + math.log(len(self.names))
                zero = number(name, self.unit, (-self.most, self.most), 0.0, 0.01 * self.most)
                own, kind = replace(gain, name=name), Kind("input", ("row",), where)
                text = "the zero of an input jumps"
                yield ChangedInputs(f"jump of the input ({where})", kind, (zero,), later, text, each)
                text = "the gain of an input jumps"
                yield ChangedInputs(f"jump of the gain ({where})", kind, (own,), gained, text, each)


def _pauses(steps: Sequence[LoadStep]) -> Array:
    """Times between every step and the one before [s], infinite for the first; nan where they are not known."""
    return np.diff([math.nan if s.time is None else s.time for s in steps], prepend=-math.inf)


def _behind(experiment: Experiment, shares: Sequence[float], of_commands: bool) -> Experiment:
    """Inputs that stay behind their commands by shares of the way from the row before, one of each row.

    The way from what acted there, or ``of_commands`` from what was commanded.
    """
    steps, last = [], LoadStep()

    def behind(command: Mapping[str, float], before: Mapping[str, float], share: float) -> dict[str, float]:
        return {n: u + share * (before.get(n, u) - u) for n, u in command.items()}

    for step, (k, factor) in zip(experiment.steps, experiment.ends, strict=True):
        tensions = behind(step.tensions, last.tensions, shares[k])
        displacements = behind(step.displacements, last.displacements, shares[k])
        steps.append(replace(step, tensions=tensions, displacements=displacements))
        if factor == 1.0:
            last = step if of_commands else steps[-1]
    return replace(experiment, steps=tuple(steps))

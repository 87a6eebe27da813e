"""Causes on no list that change what the tendons are driven with: offsets, gains, limits, shares, lags, jumps."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from tdcr_fe.effects import Experiment, Parameter
from tdcr_fe.effects.base import Kind, Values
from tdcr_fe.elements import Array
from tdcr_fe.identify.causes import PER_FACTOR, Cause, Change, ChangedDescription, number, settling_span
from tdcr_fe.identify.rows import clock_of, possible_starts, progress_along
from tdcr_fe.io.measured import MeasuredData
from tdcr_fe.model.loading import LoadStep, resolve

if TYPE_CHECKING:
    from tdcr_fe.identify.problem import FitProblem


def input_causes(problem: FitProblem) -> list[Cause]:
    """Inputs other than commanded."""
    own, clock, data = _Inputs.of(problem), clock_of(problem.data), problem.data
    if not own.names:
        return []
    by_row = [*own.lags(data), *own.jumps(data)] if clock and not data.parts else []
    return [*own.by_law(clock), *own.limits(), *own.shares(), *by_row]


#: What a change of an input is in proportion to: from all inputs of a step, the tendon's name, progress along the rows,
#: and values of the cause.
_InputLaw = Callable[[Mapping[str, float], str, float, Values], float]


class _Inputs(NamedTuple):
    """The inputs of a loading sequence that change."""

    names: tuple[str, ...]  # Of their tendons
    largest: tuple[float, ...]  # Of each of them [N or m]
    most: float  # Of all
    unit: str

    @classmethod
    def of(cls, problem: FitProblem) -> _Inputs:
        """Those of the declared loading sequence."""
        actions, tendons = resolve(problem.data.robot, problem.data.steps), problem.data.robot.tendon_names
        commands = np.array([a.values for a in actions]).reshape(len(actions), -1)
        driven = np.flatnonzero(np.ptp(commands, axis=0) > 0.0)
        displaced = driven.size and actions[0].by_displacement[driven[0]]
        names, sizes = tuple(tendons[i] for i in driven), np.max(np.abs(commands), axis=0, initial=0.0)
        most = float(np.max(sizes, initial=0.0))
        return cls(names, tuple(sizes[driven].tolist()), most, "m" if displaced else "N")

    def by_law(self, clock: str) -> Iterator[Cause]:
        """Off by a constant, by a part that grows with them, or that changes along the rows: all, each or one."""
        most, grows = self.most, "the gain of the inputs depends on their size"
        gain_settles, (span, spans) = "the gain of the inputs settles", settling_span("span", "1", 1.0)

        def settled(p: float, values: Values) -> float:
            return 1.0 - math.exp(-p / values["span"])

        laws: list[tuple[str, str, _InputLaw, str]] = [
            ("offset of the input", "nothing", lambda *_: 1.0, "the inputs are off by a constant"),
            ("gain that grows", "tension", lambda u, n, *_: u[n] * abs(u[n]) / most, grows),
            ("gain that drifts", clock, lambda u, n, p, _: u[n] * p, "the gain of the inputs drifts"),
            ("offset that drifts", clock, lambda u, n, p, _: p, "the inputs drift"),
            ("gain that settles", clock, lambda u, n, *x: u[n] * settled(*x), gain_settles),
            ("offset that settles", clock, lambda u, n, *x: settled(*x), "the inputs drift and settle"),
        ]
        for name, depends, shape, text in laws:
            if not depends:
                continue
            is_gain = name.startswith("gain")
            size, unit = (1.0, "1") if is_gain else (most, self.unit)
            change = _with_inputs(shape)
            law, held = ((span,), spans) if name.endswith("settles") else ((), Cause.held)
            one = number("all", unit, (-0.9 * size, 3.0 * size), 0.0, 0.01 * size)
            each = tuple(replace(one, name=n) for n in self.names)
            forms: dict[str, tuple[Parameter, ...]] = {"all": (one,)} if is_gain else {}
            forms |= {"each": each} if len(each) > 1 else {}
            for who, own in (forms | {p.name: (p,) for p in each}).items():
                single = who in self.names
                kind = Kind("input", (depends,), f"tendon {who}" if single else "everywhere")
                price = math.log(len(laws) * (len(each) if single else 1))
                price += PER_FACTOR * (depends != "nothing")
                numbers = *own, *law
                yield ChangedDescription(f"{name} ({who})", kind, numbers, change, text, price, held=held)

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

            def limited(
                experiment: Experiment, values: Values, names: tuple[str, ...] = names, above: bool = above
            ) -> Experiment:
                def less(commands: Mapping[str, float], n: str, *_: Any) -> float:
                    size, limit = abs(commands[n]), values["limit"]
                    lost = max(size - limit, 0.0) if above else min(size, limit)
                    return math.copysign(lost, -commands[n])

                return _with_inputs(less)(experiment, dict.fromkeys(names, values["share"]))

            what, null, tried = (
                ("limit", most, (0.5, 0.7, 0.85)) if above else ("dead zone", 0.0, (0.1, 0.2, 0.4))
            )
            numbers = share, number("limit", self.unit, (0.0, most), null, 0.05 * most)
            text = f"{having} {beyond if above else below} does not arrive"
            kind, held = Kind("input", ("tension",), where), {"limit": [x * most for x in tried]}
            yield ChangedDescription(f"{what} of the {label}", kind, numbers, limited, text, price, held=held)

    def shares(self) -> Iterator[Cause]:
        """A share of the input of one tendon in another."""
        couples = list(itertools.permutations(self.names, 2))
        for source, name in couples:

            def other(commands: Mapping[str, float], *_: Any, source: str = source) -> float:
                return commands.get(source, 0.0)

            share, change = number(name, "1", (-0.9, 0.9), 0.0, 0.01), _with_inputs(other)
            kind, price = Kind("input", ("tension",), f"tendon {name}"), math.log(len(couples))
            text = f"a share of the input of tendon {source} acts in tendon {name}"
            yield ChangedDescription(f"share of {source} in {name}", kind, (share,), change, text, price)

    def lags(self, data: MeasuredData) -> Iterator[Cause]:
        """What acts stays behind its command, by a share of the way from what acted in the row before.

        Or, where the times between rows differ, by so many seconds on the way from the command of the row before.
        """
        share, kind = number("share", "1", (-0.5, 0.9), 0.0, 0.01), Kind("input", ("the row before",))
        text = "the inputs stay behind their commands"

        def lagging(experiment: Experiment, values: Values) -> Experiment:
            shares = [values["share"]] * len(experiment.whole_steps)
            return _behind(experiment, shares, of_commands=False)

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
        """Another zero of one input, or another gain of all, from a row on."""
        progress, price = progress_along(data.steps), math.log(len(data.steps))
        gain = number("all", "1", (-0.9, 3.0), 0.0, 0.01)
        for k in possible_starts(data):
            since, start = f"from row {data.step_ids[k]} on", float(progress[k])

            def later(u: Mapping[str, float], n: str, p: float, _: Values, start: float = start) -> float:
                return float(p >= start)

            def gained(u: Mapping[str, float], n: str, p: float, _: Values, start: float = start) -> float:
                return u[n] * (p >= start)

            kind, text = Kind("input", ("row",), since), "the gain of the inputs jumps"
            label, change = f"jump of the gain ({since})", _with_inputs(gained)
            yield ChangedDescription(label, kind, (gain,), change, text, price)
            for name in self.names:
                where, text = f"tendon {name}, {since}", "the zero of an input jumps"
                one = number(name, self.unit, (-self.most, self.most), 0.0, 0.01 * self.most)
                kind, change = Kind("input", ("row",), where), _with_inputs(later)
                label = f"jump of the input ({where})"
                each = price + math.log(len(self.names))
                yield ChangedDescription(label, kind, (one,), change, text, each)


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

    for step, (k, factor) in zip(experiment.steps, experiment.step_ends, strict=True):
        tensions = behind(step.tensions, last.tensions, shares[k])
        displacements = behind(step.displacements, last.displacements, shares[k])
        steps.append(replace(step, tensions=tensions, displacements=displacements))
        if factor == 1.0:
            last = step if of_commands else steps[-1]
    return replace(experiment, steps=tuple(steps))


def _with_inputs(shape: _InputLaw) -> Change:
    """A change of all inputs by a number times what follows from the inputs and from progress along the rows."""

    def changed(experiment: Experiment, values: Values) -> Experiment:
        progress = progress_along([experiment.steps[k] for k in experiment.whole_steps])

        def with_change(step: LoadStep, p: float) -> LoadStep:
            def new(commands: Mapping[str, float], least: float) -> dict[str, float]:
                factors = {n: values.get(n, values.get("all", 0.0)) for n in commands}
                moved = {n: x and x * shape(commands, n, p, values) for n, x in factors.items()}
                return {n: max(x + moved[n], least) if moved[n] else x for n, x in commands.items()}

            tensions, displacements = new(step.tensions, 0.0), new(step.displacements, -math.inf)
            if tensions == step.tensions and displacements == step.displacements:
                return step
            return replace(step, tensions=tensions, displacements=displacements)

        of_steps = zip(experiment.steps, experiment.step_ends, strict=True)
        steps = (with_change(step, float(progress[k])) for step, (k, _) in of_steps)
        return replace(experiment, steps=tuple(steps))

    return changed

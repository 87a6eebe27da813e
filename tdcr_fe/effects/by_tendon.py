"""Effects with one number of the tendons: the same for all, one for each segment, or one for each tendon."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from tdcr_fe.effects.base import Effect, ExcitationRange, Experiment, Form, Parameter, Values
from tdcr_fe.model.checks import ARC_TOLERANCE
from tdcr_fe.model.robot import Robot
from tdcr_fe.model.tendon import Tendon


def mean(declared: Sequence[float]) -> float:
    """Mean of the tendons' declared values; exactly their value where all are the same."""
    return declared[0] if len(set(declared)) == 1 else sum(declared) / max(1, len(declared))


def shifted(declared: float, null: float, value: float) -> float:
    """A tendon's value when the mean changes from ``null`` to ``value``: in proportion, or uniform from zero."""
    return declared * value / null if null > 0.0 and declared != null else value


def segments(robot: Robot) -> tuple[tuple[str, ...], ...]:
    """Names of the tendons by segment: those that end at the same disk, from the base to the tip."""
    ends = sorted({robot.end(t) for t in robot.tendons})
    first = [s for k, s in enumerate(ends) if k == 0 or s - ends[k - 1] > ARC_TOLERANCE]
    found: list[list[str]] = [[] for _ in first]
    for t in robot.tendons:
        found[sum(s <= robot.end(t) for s in first) - 1].append(t.name)
    return tuple(tuple(names) for names in found)


class TendonNumber(Effect):
    """An effect that gives every tendon one number, ``parameters[0]``.

    Besides that of all tendons, ``NAME_segment_K`` is the number of those that end at the same disk, counted from the
    base, and ``NAME_TENDON`` that of one tendon. The most particular one that is given counts. Where a number is given
    for several tendons that declare different ones, it is their mean.
    """

    def declared(self, experiment: Experiment, tendon: Tendon) -> float:
        """What a tendon declares."""
        raise NotImplementedError

    def with_number(self, tendon: Tendon, value: float) -> Tendon:
        """A tendon with another number."""
        raise NotImplementedError

    def applies_to(self, tendon: Tendon) -> bool:
        """Whether a tendon has such a number."""
        return True

    def combined(self, declared: float, null: float, value: float) -> float:
        """A tendon's number when the mean of several changes from ``null`` to ``value``."""
        return shifted(declared, null, value)

    def forms(self, experiment: Experiment) -> tuple[Effect, ...]:
        """The same for all tendons, one for each segment, and one for each."""
        if self.needs_disks and experiment.robot.without_disks:
            return ()
        names = experiment.robot.tendon_names
        groups = self._groups(experiment.robot)
        found: tuple[Effect, ...] = (self,)
        if 1 < len(groups) < len(names):
            found = (*found, NumberForm(self, "by segment", tuple(groups), experiment))
        if len(names) > 1:
            found = (*found, NumberForm(self, "each", [f"{self._name}_{n}" for n in names], experiment))
        return found

    def parameters_of(self, experiment: Experiment) -> tuple[Parameter, ...]:
        """Of all, of each segment where there are several, and of each tendon."""
        one, robot = self.parameters[0], experiment.robot
        groups = self._groups(robot)
        by_segment = tuple(
            replace(one, name=name, meaning=f"{one.meaning}: {', '.join(own)}")
            for name, own in groups.items()
            if len(groups) > 1
        )
        each = tuple(
            replace(one, name=f"{self._name}_{t}", meaning=f"{one.meaning}: {t}") for t in robot.tendon_names
        )
        return (*self.parameters, *by_segment, *each)

    @property
    def further_parameters(self) -> Mapping[str, Parameter]:
        """See `Effect.further_parameters`."""
        return {f"^{self._name}_.+$": self.parameters[0]}

    def null_values(self, experiment: Experiment) -> dict[str, float]:
        """The declared number; where tendons differ, their mean."""
        return {self._name: self._mean(experiment, experiment.robot.tendon_names)}

    def null_value(self, experiment: Experiment, name: str) -> float:
        """The same of a segment or of a tendon."""
        groups = self._groups(experiment.robot)
        names = experiment.robot.tendon_names
        own = [n for n in names if name == f"{self._name}_{n}"] or groups.get(name, names)
        return self._mean(experiment, own)

    def apply(self, experiment: Experiment, values: Values) -> Experiment:
        """See `Effect.apply`."""
        robot = experiment.robot
        chosen = self._chosen(robot, values)
        null = {key: self.null_value(experiment, key) for key in chosen}
        key_of = {t: key for key, own in chosen.items() for t in own}
        tendons = []
        for t in robot.tendons:
            key = key_of.get(t.name)
            if key is None or not self.applies_to(t):
                tendons.append(t)
                continue
            declared, value = self.declared(experiment, t), values[key]
            if value == null[key]:
                value = declared
            elif declared != null[key]:
                value = self.combined(declared, null[key], value)
            tendons.append(self.with_number(t, value))
        return experiment.with_robot(tendons=tuple(tendons))

    @property
    def _name(self) -> str:
        return self.parameters[0].name

    def _groups(self, robot: Robot) -> dict[str, tuple[str, ...]]:
        """Tendons of every segment, by the name of its parameter; a tendon of such a name hides it."""
        named = {f"{self._name}_segment_{k}": own for k, own in enumerate(segments(robot), 1)}
        return {
            k: own for k, own in named.items() if k not in {f"{self._name}_{t}" for t in robot.tendon_names}
        }

    def _chosen(self, robot: Robot, values: Values) -> dict[str, tuple[str, ...]]:
        """Tendons by the parameter whose value they take."""
        candidates = {f"{self._name}_{t}": (t,) for t in robot.tendon_names} | self._groups(robot)
        candidates[self._name] = robot.tendon_names
        taken: set[str] = set()
        found = {}
        for key, own in candidates.items():
            if key in values:
                found[key] = tuple(t for t in own if t not in taken)
                taken.update(own)
        return found

    def _mean(self, experiment: Experiment, names: Sequence[str]) -> float:
        """Number of several tendons: their common one, or the mean in the coordinate that is fitted."""
        one = self.parameters[0]
        declared = [
            self.declared(experiment, t)
            for t in experiment.robot.tendons
            if t.name in names and self.applies_to(t)
        ]
        if not declared:
            return one.null_value
        if len(set(declared)) == 1:
            return declared[0]
        return one.value(mean([one.coordinate(x) for x in declared]))


class NumberForm(Form):
    """One number of an effect for each of several parts: segments or tendons of a robot, folders of data."""

    def bounds(self, experiment: Experiment) -> dict[str, tuple[float, float]]:
        """Those of the number of all."""
        (limits,) = self.of.bounds(experiment).values()
        return {p.name: limits for p in self.parameters}

    def probe_points(
        self, experiment: Experiment, excitation: ExcitationRange
    ) -> list[list[dict[str, float]]]:
        """Each number by as much as that of all."""
        null, one = self.null_values(experiment), self.of.parameters[0]
        common = one.coordinate(self.of.null_values(experiment)[one.name])
        found = []
        for points in self.of.probe_points(experiment, excitation):
            by = one.coordinate(points[0][one.name]) - common
            found.append([{**null, n: one.value(one.coordinate(x) + by)} for n, x in null.items()])
        return found

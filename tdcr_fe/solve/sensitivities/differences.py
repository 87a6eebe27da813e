"""Derivatives by differences: rules for the steps, and changes of the inputs."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Generic, NamedTuple, TypeVar

import numpy as np

from tdcr_fe.effects import Experiment
from tdcr_fe.elements import Array, Flags
from tdcr_fe.elements.section_forces import DIFFERENCE
from tdcr_fe.model.loading import Actuation, LoadStep
from tdcr_fe.solve.sensitivities.parameters import ModelParameter, Parameter, StepInput, StepInputs
from tdcr_fe.solve.simulation import Simulation

T = TypeVar("T")

#: Difference steps: central, or to one side where the other is impossible; offsets and weights in units of the step.
_RULES = (((1.0, -1.0), (0.5, -0.5)), ((1.0, 2.0), (2.0, -0.5)), ((-1.0, -2.0), (-2.0, 0.5)))


class StructureChanged(ValueError):
    """A parameter changes the mesh or the number of load steps, so that results cannot be compared."""


class NoDerivative(ValueError):
    """There is no derivative by a parameter.

    Attributes
    ----------
    parameter, reason : str
    """

    def __init__(self, parameter: Parameter, reason: object) -> None:
        value = f" at {parameter.value:g}" if isinstance(parameter, ModelParameter) else ""
        super().__init__(f"sensitivities: no derivative by {parameter.name}{value}: {reason}")
        self.parameter, self.reason = parameter.name, str(reason)


@dataclass(frozen=True, eq=False)
class Stencil(Generic[T]):
    """Experiments at neighbouring values, and the weights with which their differences give a derivative."""

    offsets: np.ndarray  # (k,): Of the neighbours' values from the present one
    weights: np.ndarray  # (k,): Of their differences from the present one
    experiments: tuple[Experiment, ...]  # The neighbours
    models: tuple[T, ...]  # What was built from them


def stencil(
    experiment: Experiment, parameter: ModelParameter, build: Callable[[Experiment], T]
) -> Stencil[T]:
    """Neighbours of an experiment by a parameter: on both sides, or on one where the other is impossible.

    Parameters
    ----------
    experiment
        The present one.
    parameter
        What is changed.
    build
        Makes something of a neighbour; raises `StructureChanged` where it cannot be compared with the present one.

    Raises
    ------
    NoDerivative
        There are no such neighbours.
    """
    step = DIFFERENCE * parameter.size
    reason: ValueError | None = None
    for offsets, weights in _RULES:
        try:
            found = tuple(parameter.apply(experiment, parameter.value + step * x) for x in offsets)
            models = tuple(map(build, found))
        except ValueError as error:
            if not isinstance(reason, StructureChanged):
                reason = error
            continue
        return Stencil(step * np.array(offsets), np.array(weights) / step, found, models)
    raise NoDerivative(parameter, reason) from reason


@dataclass(frozen=True, eq=False)
class Tabulated:
    """Neighbours of an experiment that were made beforehand, as `ModelParameter.apply`; can be sent to a process."""

    value: float  # Present value
    step: float  # Difference step
    experiments: Mapping[int, Experiment]  # By offset from the present value, in difference steps
    refused: str = ""  # Why there are no others

    def __call__(self, experiment: Experiment, value: float) -> Experiment:
        """The neighbour with a value; ValueError where it was not made."""
        offset = round((value - self.value) / self.step)
        if offset not in self.experiments:
            raise ValueError(self.refused or f"no neighbour at {value:g}")
        return self.experiments[offset]


def tabulated(parameter: ModelParameter, experiment: Experiment) -> ModelParameter:
    """A parameter whose neighbours are made now: on both sides, or two on the side where that is possible."""
    step, refused = DIFFERENCE * parameter.size, ""
    made: Mapping[int, Experiment] = {}
    try:
        found = stencil(experiment, parameter, lambda neighbour: None)
        made = {round(x / step): own for x, own in zip(found.offsets, found.experiments, strict=True)}
    except NoDerivative as error:
        refused = error.reason
    return replace(parameter, apply=Tabulated(parameter.value, step, made, refused))


def same_structure(present: Sequence[LoadStep], other: Sequence[LoadStep]) -> bool:
    """Whether two loading sequences name the same inputs and loads in the same number of steps."""
    return len(present) == len(other) and all(
        set(a.tensions) == set(b.tensions)
        and set(a.displacements) == set(b.displacements)
        and {n: x.frame for n, x in a.loads.items()} == {n: x.frame for n, x in b.loads.items()}
        for a, b in zip(present, other, strict=True)
    )


class InputValues(NamedTuple):
    """Derivatives of inputs (m, P), loads (L, 6, P) and time (P,) at one load factor."""

    tendons: Array
    loads: Array
    time: Array


@dataclass(frozen=True, eq=False)
class InputDerivatives:
    """Derivatives of inputs and loads at the ends of all steps; a single one stands for any number of steps."""

    # (steps, m, P): Of tensions [N] and lengths wound [m]; 1 by an input of the step itself, in the unit of its drive
    tendons: Array
    loads: Array  # (steps, L, 6, P): Of the concentrated loads, in the order of the simulation
    times: Array  # (steps, P): Of the times [s]
    restarts: Flags  # (P,): Whose derivatives begin anew with every step

    def at(self, number: int, scale: Array) -> InputValues:
        """Derivatives at the end of a step, by its number from 0.

        ``scale`` is that of `TendonDrives`: tension or length wound by the unit of a tendon's input, shape (m,).
        """
        k = number if len(self.times) > 1 else 0
        tendons = np.where(self.restarts, scale[:, None] * self.tendons[k], self.tendons[k])
        return InputValues(tendons, self.loads[k], self.times[k])

    @classmethod
    def of_inputs(
        cls, tendons: int, loads: Sequence[Sequence[str]], chosen: Sequence[Parameter]
    ) -> InputDerivatives:
        """Where no parameter of the description changes inputs.

        Parameters
        ----------
        tendons
            Their number.
        loads
            By step, names of the concentrated loads in the scene, empty for those of other robots or steps.
        chosen
            All parameters.
        """
        steps, count = len(loads), len(chosen)
        found = cls(
            np.zeros((steps, tendons, count)),
            np.zeros((steps, len(loads[0]) if steps else 0, 6, count)),
            np.zeros((steps, count)),
            np.array([isinstance(p, StepInput) for p in chosen], dtype=bool),
        )
        for number, parameter in enumerate(chosen):
            if isinstance(parameter, StepInputs):
                found.tendons[:, :, number] = parameter.change
                for k, names in enumerate(loads):
                    for name, change in parameter.loads.items():
                        found.loads[k, names.index(name), :, number] = change[k]
            if not isinstance(parameter, StepInput):
                continue
            for k, names in enumerate(loads):
                if parameter.tendon >= 0:
                    found.tendons[k, parameter.tendon, number] = 1.0
                elif parameter.load in names:
                    found.loads[k, names.index(parameter.load), parameter.component, number] = 1.0
        return found

    @classmethod
    def of(
        cls,
        experiment: Experiment,
        simulation: Simulation,
        chosen: Sequence[Parameter],
        found: Mapping[int, Stencil[Any]],
        frictional: bool,
    ) -> InputDerivatives:
        """Derivatives by all parameters, ``found`` by their numbers. ``frictional``: whether any hole has friction.

        Raises
        ------
        NoDerivative
            A parameter divides the load steps in another way.
        """
        keys, present = list(simulation.loads), experiment.actions
        acting = [{simulation.load_key(n, load): n for n, load in a.loads.items()} for a in present]
        names = [[own.get(key, "") for key in keys] for own in acting]
        derivatives = cls.of_inputs(len(experiment.robot.tendons), names, chosen)
        for number, each in found.items():
            same_inputs = all(e.steps == experiment.steps for e in each.experiments)
            if same_inputs and all(step.is_in_newtons_and_metres for step in experiment.steps):
                continue
            parameter = chosen[number]
            ordered = frictional and isinstance(parameter, ModelParameter) and not parameter.approximate
            try:
                actions = [_actions_like(experiment, present, e, ordered) for e in each.experiments]
            except StructureChanged as error:
                raise NoDerivative(parameter, error) from error
            inputs = np.array([[own.values for own in sequence] for sequence in (present, *actions)])
            changes = inputs[1:] - inputs[0]
            # Where one neighbour alone changes an input, the other is beyond a bound: no tension falls below zero.
            alone = np.count_nonzero(changes, axis=0) == 1
            two_sided, one_sided = (np.tensordot(x, changes, 1) for x in (each.weights, 1.0 / each.offsets))
            derivatives.tendons[:, :, number] = np.where(alone, one_sided, two_sided)
            for weight, sequence in zip(each.weights, actions, strict=True):
                for k, (action, own) in enumerate(zip(sequence, present, strict=True)):
                    derivatives.times[k, number] += weight * (action.time - own.time)
                    for name, load in action.loads.items():
                        before = own.loads[name]
                        if load != before:
                            at = keys.index(simulation.load_key(name, before))
                            change = np.subtract((load.force, load.moment), (before.force, before.moment))
                            derivatives.loads[k, at, :, number] += weight * change.ravel()
        return derivatives


def _actions_like(
    present: Experiment, own: Sequence[Actuation], other: Experiment, ordered: bool
) -> list[Actuation]:
    """Inputs of an experiment at the ends of the steps of another, which effects may have divided differently.

    ``ordered``: whether the results depend on the order in which inputs change within a step.
    """
    actions, divided = other.actions, len(present.whole_steps) < len(present.steps)
    if same_structure(present.steps, other.steps):
        if [k for k, _ in present.ends] == [k for k, _ in other.ends]:
            return actions
        # A simulation does not know how effects divided its steps; a neighbour divided likewise has nearly its inputs.
        if not divided and _nearly_same(own, actions):
            return actions
    # Where only the neighbour is divided, its parts begin and end where the change of the parameter takes them.
    if ordered:
        raise StructureChanged(
            "it divides the load steps, and friction depends on the order of the inputs within them; at a value of its "
            "own there is a derivative (effect_parameter)"
        )
    whole = other.whole_steps
    if divided or len(whole) != len(present.steps):
        raise StructureChanged("the load steps are divided differently there")
    return [actions[j] for j in whole]


def _nearly_same(a: Sequence[Actuation], b: Sequence[Actuation]) -> bool:
    """Whether all inputs of two sequences differ by less than a thousandth of the largest one of their kind."""
    first, second = np.array([x.values for x in a]), np.array([x.values for x in b])
    driven = np.array([x.by_displacement for x in a])
    return all(
        float(np.max(np.abs(first - second)[kind], initial=0.0))
        <= 1e-3 * float(np.max(np.abs(first)[kind], initial=0.0))
        for kind in (driven, ~driven)
    )

"""Derivatives of inputs, loads and times at the ends of load steps."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tdcr_fe.effects import Experiment
from tdcr_fe.model.loading import Actuation, resolve
from tdcr_fe.solve.sensitivities.neighbours import Neighbours
from tdcr_fe.solve.sensitivities.parameters import ModelParameter, Parameter, StepInput
from tdcr_fe.solve.sensitivities.stencils import NoDerivative, StructureChanged, same_structure
from tdcr_fe.solve.simulation import Simulation

Array = NDArray[np.float64]


class InputValues(NamedTuple):
    """Derivatives of inputs (m, P), loads (L, 6, P) and time (P,) at one load factor."""

    tendons: Array
    loads: Array
    time: Array


@dataclass(frozen=True, eq=False)
class InputDerivatives:
    """Derivatives of inputs and loads at the ends of all steps.

    Attributes
    ----------
    tendons : ndarray, shape (steps, m, P)
        Of tensions [N] and displacements [m].
    loads : ndarray, shape (steps, L, 6, P)
        Of the concentrated loads, in the order of the simulation.
    times : ndarray, shape (steps, P)
        Of the times [s].
    restarts : ndarray of bool, shape (P,)
        Whose derivatives begin anew with every step.
    each_step : bool
        Whether there is one entry for every step; else the first one holds for all.
    """

    tendons: Array
    loads: Array
    times: Array
    restarts: NDArray[np.bool_]
    each_step: bool = True

    def at(self, number: int) -> InputValues:
        """Derivatives at the end of a step, by its number from 0."""
        k = number if self.each_step else 0
        return InputValues(self.tendons[k], self.loads[k], self.times[k])

    @classmethod
    def of_inputs(cls, tendons: int, loads: Sequence[str], chosen: Sequence[Parameter]) -> InputDerivatives:
        """Where no parameter but the inputs of the current step changes inputs.

        Parameters
        ----------
        tendons
            Their number.
        loads
            Names of the concentrated loads in the scene, empty for those of other robots.
        chosen
            All parameters.
        """
        count = len(chosen)
        found = cls(
            np.zeros((1, tendons, count)),
            np.zeros((1, len(loads), 6, count)),
            np.zeros((1, count)),
            np.array([isinstance(p, StepInput) for p in chosen], dtype=bool),
            each_step=False,
        )
        for number, parameter in enumerate(chosen):
            if isinstance(parameter, StepInput) and parameter.tendon >= 0:
                found.tendons[0, parameter.tendon, number] = 1.0
            elif isinstance(parameter, StepInput):
                found.loads[0, loads.index(parameter.load), parameter.component, number] = 1.0
        return found

    @classmethod
    def of(
        cls,
        experiment: Experiment,
        simulation: Simulation,
        chosen: Sequence[Parameter],
        found: Sequence[Neighbours],
        frictional: bool,
    ) -> InputDerivatives:
        """Derivatives by all parameters; see `neighbours`. ``frictional``: whether any hole has friction.

        Raises
        ------
        NoDerivative
            A parameter divides the load steps in another way.
        """
        steps, m = len(experiment.steps), len(experiment.robot.tendons)
        keys = list(simulation.loads)
        tendons = np.zeros((steps, m, len(chosen)))
        loads = np.zeros((steps, len(keys), 6, len(chosen)))
        times = np.zeros((steps, len(chosen)))
        present = resolve(experiment.robot, experiment.steps)
        for each in found:
            weights = (each.stencil.base_weight, *each.stencil.weights)
            others = each.stencil.experiments
            if all(e.steps is experiment.steps for e in others):
                continue
            parameter = chosen[each.number]
            ordered = frictional and isinstance(parameter, ModelParameter) and not parameter.approximate
            try:
                actions = [present, *(_actions_like(experiment, present, e, ordered) for e in others)]
            except StructureChanged as error:
                raise NoDerivative(parameter, error) from error
            for weight, sequence in zip(weights, actions, strict=True):
                for k, (action, same) in enumerate(zip(sequence, present, strict=True)):
                    tendons[k, :, each.number] += weight * action.values
                    times[k, each.number] += weight * action.time
                    for name, load in action.loads.items():
                        at = keys.index(simulation.load_key(name, same.loads[name]))
                        loads[k, at, :, each.number] += weight * np.array([*load.force, *load.moment])
        restarts = np.array([isinstance(p, StepInput) for p in chosen], dtype=bool)
        for number, parameter in enumerate(chosen):
            if not isinstance(parameter, StepInput):
                continue
            if parameter.tendon >= 0:
                tendons[:, parameter.tendon, number] = 1.0
            for k, action in enumerate(present):
                if parameter.load in action.loads:
                    at = keys.index(simulation.load_key(parameter.load, action.loads[parameter.load]))
                    loads[k, at, parameter.component, number] = 1.0
        return cls(tendons, loads, times, restarts)


def _actions_like(
    present: Experiment, own: Sequence[Actuation], other: Experiment, ordered: bool
) -> list[Actuation]:
    """Inputs of an experiment at the ends of the steps of another, which effects may have divided differently.

    ``ordered``: whether the results depend on the order in which inputs change within a step.
    """
    actions = resolve(other.robot, other.steps)
    if same_structure(present.steps, other.steps):
        if [k for k, _ in present.step_ends] == [k for k, _ in other.step_ends]:
            return actions
        # A simulation does not know how effects divided its steps; a neighbour divided likewise has nearly its inputs.
        if present.ends is None and _nearly_same(own, actions):
            return actions
    # Where only the neighbour is divided, its parts begin and end where the change of the parameter takes them.
    if ordered:
        raise StructureChanged(
            "it divides the load steps, and friction depends on the order of the inputs within them; at a value of its "
            "own there is a derivative (effect_parameter)"
        )
    whole = [j for j, (_, factor) in enumerate(other.step_ends) if factor == 1.0]
    if present.ends is not None or len(whole) != len(present.steps):
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

"""Models of a robot at neighbouring values of its parameters, built once for a simulation."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tdcr_fe.effects import Experiment
from tdcr_fe.solve.equations.robot_model import RobotModel
from tdcr_fe.solve.sensitivities.parameters import ModelParameter, Parameter
from tdcr_fe.solve.sensitivities.stencils import Stencil, StructureChanged, stencil

Array = NDArray[np.float64]


class Inherited(NamedTuple):
    """Derivatives of what an increment inherits, and of its times.

    Attributes
    ----------
    slip, slip_rate : ndarray, shape (m, g, P)
        Of the history [m, m/s].
    time, elapsed : ndarray, shape (P,)
        Of the time at its end, and of its duration [s].
    """

    slip: Array
    slip_rate: Array
    time: Array
    elapsed: Array


@dataclass(frozen=True, eq=False)
class Neighbours:
    """Models at neighbouring values of one parameter.

    Attributes
    ----------
    number : int
        Of the parameter.
    stencil : Stencil
    models : tuple of RobotModel
        Of the stencil's experiments.
    """

    number: int
    stencil: Stencil
    models: tuple[RobotModel, ...]


def neighbours(
    experiment: Experiment, present: RobotModel, chosen: Sequence[Parameter], presliding: float
) -> tuple[Neighbours, ...]:
    """Models at neighbouring values of all parameters of the description.

    Parameters
    ----------
    experiment
        The present one, with a number of elements for every bay.
    present
        Its model.
    chosen
        Parameters; inputs of the current step have no neighbours.
    presliding
        Presliding distance [m].

    Raises
    ------
    ValueError
        A parameter changes the mesh or the tendons' holes, so that there is no derivative.
    """
    counts = experiment.model.elements_per_bay
    found = []
    for number, parameter in enumerate(chosen):
        if not isinstance(parameter, ModelParameter):
            continue
        models: dict[int, RobotModel] = {}

        def build(each: Experiment, models: dict[int, RobotModel] = models) -> None:
            """Build and keep the model of a neighbour."""
            same_steps = each.steps is experiment.steps
            model = RobotModel.of(
                each.robot,
                replace(each.model, elements_per_bay=counts),
                load_positions(each),
                presliding,
                present if same_steps else None,
            )
            _check_structure(present, model)
            models[id(each)] = model

        at = stencil(experiment, parameter, build)
        found.append(Neighbours(number, at, tuple(models[id(e)] for e in at.experiments)))
    return tuple(found)


def load_positions(experiment: Experiment) -> list[float]:
    """Arc lengths of all loads [m], ascending."""
    return sorted({float(load.at) for step in experiment.steps for load in step.loads.values()})


def _check_structure(present: RobotModel, other: RobotModel) -> None:
    """Refuse a model of another mesh, or with other holes."""
    a, b = present.forces, other.forces
    if a.mesh.arc_lengths.size != b.mesh.arc_lengths.size or not np.array_equal(present.rigid, other.rigid):
        raise StructureChanged("the mesh has other nodes there")
    if a.law.shape != b.law.shape or not np.array_equal(a.law.parameters.mask, b.law.parameters.mask):
        raise StructureChanged("the tendons have other holes there")


@dataclass(frozen=True, eq=False)
class ParameterModels:
    """Models of a robot at the present values of its parameters, and at neighbouring values of each.

    Attributes
    ----------
    present : RobotModel
        At the present values.
    neighbours : tuple of Neighbours
        By parameter of the description; inputs of the load steps have none.
    count : int
        Number of parameters P, inputs included.
    """

    present: RobotModel
    neighbours: tuple[Neighbours, ...]
    count: int

    def where(self, differs: Callable[[RobotModel, RobotModel], bool]) -> Stacked:
        """The models of the parameters by which something differs from the present model."""
        return Stacked.of(
            self.present, [x for x in self.neighbours if any(differs(self.present, m) for m in x.models)]
        )


class Stacked(NamedTuple):
    """Models of some parameters, the present model first.

    Attributes
    ----------
    models : list of RobotModel
    parameters : ndarray of int, shape (P',)
        Numbers of the parameters.
    weights : ndarray, shape (P', S)
        Of the models in each derivative.
    """

    models: list[RobotModel]
    parameters: NDArray[np.int_]
    weights: Array

    @classmethod
    def of(cls, present: RobotModel, chosen: Sequence[Neighbours]) -> Stacked:
        """The models of all chosen parameters."""
        models = [present]
        weights = np.zeros((len(chosen), 1 + sum(len(x.models) for x in chosen)))
        for row, each in enumerate(chosen):
            weights[row, 0] = each.stencil.base_weight
            weights[row, len(models) : len(models) + len(each.models)] = each.stencil.weights
            models += each.models
        numbers = np.array([x.number for x in chosen], dtype=int)
        return cls(models, numbers, weights)

    def derivative(self, values: Array) -> Array:
        """Derivatives from values of all models, (S, ...) to (..., P')."""
        found = self.weights @ values.reshape(len(values), -1)
        return np.moveaxis(found.reshape(len(found), *values.shape[1:]), 0, -1)

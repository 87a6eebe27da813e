"""Derivatives of a simulation by parameters, carried along its load steps.

At the end of every substep the equations are satisfied, so their total derivative vanishes: the tangent at the solved
state times the derivative of the unknowns, plus the explicit derivative by the parameter, plus what the substep
inherits (slips and mobilisations at its beginning, inputs and loads from which it is ramped). Derivation:
documentation, page "Sensitivities".
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tdcr_fe.effects import Experiment
from tdcr_fe.model.loading import Actuation, resolve
from tdcr_fe.model.sensitivities import Sensitivities, Sensitivity
from tdcr_fe.solve.explicit import ExplicitDerivatives
from tdcr_fe.solve.linear_response import Disturbance, SolvedPoint, TendonChange
from tdcr_fe.solve.neighbours import Inherited, Neighbours, neighbours
from tdcr_fe.solve.parameters import ModelParameter, Parameter, StepInput, StructureChanged, same_structure
from tdcr_fe.solve.ramp import Ramp
from tdcr_fe.solve.robot_model import RobotModel, RobotPoint, load_wrench
from tdcr_fe.solve.simulation import Simulation
from tdcr_fe.solve.state import SolverState

Array = NDArray[np.float64]


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
    """

    tendons: Array
    loads: Array
    times: Array
    restarts: NDArray[np.bool_]

    @classmethod
    def of(
        cls,
        experiment: Experiment,
        simulation: Simulation,
        chosen: Sequence[Parameter],
        found: Sequence[Neighbours],
    ) -> InputDerivatives:
        """Derivatives by all parameters; see `neighbours`."""
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
            actions = [present, *(_actions_like(experiment, e) for e in others)]
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


def _actions_like(present: Experiment, other: Experiment) -> list[Actuation]:
    """Inputs of an experiment at the ends of the steps of another, which effects may have divided differently."""
    actions = resolve(other.robot, other.steps)
    if same_structure(present.steps, other.steps) and (
        [k for k, _ in present.step_ends] == [k for k, _ in other.step_ends]
    ):
        return actions
    # Where only the neighbour is divided, its parts begin and end where the change of the parameter takes them.
    whole = [j for j, (_, factor) in enumerate(other.step_ends) if factor == 1.0]
    if present.ends is not None or len(whole) != len(present.steps):
        raise StructureChanged("the load steps are divided differently there")
    return [actions[j] for j in whole]


@dataclass(eq=False)
class Derivative:
    """Derivative of the state at the end of a substep, on which the next one depends; parameters are the last axis.

    Attributes
    ----------
    slip, mobilisation, slip_rate : ndarray, shape (m, g, P)
        Of the history.
    base_tension, base_slip, inputs : ndarray, shape (m, P)
        Tension and slip at the base plate, and prescribed tension or displacement [N, m].
    loads : ndarray, shape (L, 6, P)
        Of the concentrated loads.
    time : ndarray, shape (P,)
        [s].
    """

    slip: Array
    mobilisation: Array
    slip_rate: Array
    base_tension: Array
    base_slip: Array
    inputs: Array
    loads: Array
    time: Array

    @classmethod
    def zero(cls, m: int, g: int, loads: int, count: int) -> Derivative:
        """Of a robot that was never loaded."""
        history = np.zeros((m, g, count))
        base = np.zeros((m, count))
        return cls(history, history, history, base, base, base, np.zeros((loads, 6, count)), np.zeros(count))

    def without(self, which: NDArray[np.bool_]) -> Derivative:
        """Zero for some parameters, shape (P,)."""
        if not which.any():
            return self
        keep = (~which).astype(float)
        return Derivative(*(x * keep for x in vars(self).values()))


class _Inputs(NamedTuple):
    """Derivatives of inputs (m, P), loads (L, 6, P) and time (P,) at the end of a substep."""

    tendons: Array
    loads: Array
    time: Array


@dataclass(eq=False)
class _StepValues:
    """Derivatives at the end of one step, for the result."""

    nodes: Array
    rotations: Array
    tendons: TendonChange
    displacements: Array
    slips: Array


@dataclass(eq=False)
class SensitivityHistory:
    """Derivatives along the load steps of a simulation.

    Attributes
    ----------
    simulation : Simulation
    parameters : tuple of Parameter
    explicit : ExplicitDerivatives
    inputs : InputDerivatives
    present : Derivative
        At the end of the last substep.
    mobilisation : ndarray, shape (m, g)
        Of the holes, also of those without friction at the present values.
    slip : ndarray, shape (m, g)
        Slips to which these belong [m].
    steps : list
        What has been computed, by load step.
    """

    simulation: Simulation
    parameters: tuple[Parameter, ...]
    explicit: ExplicitDerivatives
    inputs: InputDerivatives
    present: Derivative
    mobilisation: Array
    slip: Array
    steps: list[_StepValues] = field(default_factory=list)

    @classmethod
    def of(
        cls, simulation: Simulation, experiment: Experiment, chosen: Sequence[Parameter]
    ) -> SensitivityHistory:
        """Derivatives of a simulation that has not begun.

        Parameters
        ----------
        simulation
            Of the experiment.
        experiment
            Robot, model and steps.
        chosen
            By what is differentiated.

        Raises
        ------
        ValueError
            There is no derivative by a parameter; the message says why.
        """
        handle, presliding = simulation.handle, simulation.settings.presliding
        counts = handle.model.elements_per_bay
        experiment = replace(experiment, model=replace(experiment.model, elements_per_bay=counts))
        positions = sorted({at for _, at, _ in simulation.loads})
        present = RobotModel.of(experiment.robot, experiment.model, positions, presliding)
        found = neighbours(experiment, present, chosen, presliding)
        explicit = ExplicitDerivatives(present, found, len(chosen))
        inputs = InputDerivatives.of(experiment, simulation, chosen, found)
        (m, n), g = present.forces.law.shape, present.forces.law.groups
        every = len(explicit.law.slip_operator(n))
        state = Derivative.zero(m, g, len(simulation.loads), len(chosen))
        return cls(
            simulation, tuple(chosen), explicit, inputs, state, np.zeros((m, every)), np.zeros((m, every))
        )

    # ------------------------------------------------------------------ along the path

    def advance(
        self, ramp: Ramp, before: SolverState, increments: Sequence[tuple[float, SolverState]]
    ) -> None:
        """Differentiate one solved load step. The scene is left in another state.

        Parameters
        ----------
        ramp
            The load step.
        before
            State at its beginning.
        increments
            Load factors and states at the ends of its substeps.
        """
        number = len(self.steps)
        begin = self.present.without(self.inputs.restarts)
        self.present = begin
        driven = self.simulation.handle.actuation.by_displacement
        start = begin.base_tension
        if driven.any():
            prescribed = np.isnan(before.prescribed[0])[:, None]
            start = np.where(
                driven[:, None], np.where(prescribed, begin.base_slip, begin.inputs), begin.base_tension
            )
        history, values = before, None
        for factor, state in increments:
            inputs = (1.0 - factor) * start + factor * self.inputs.tendons[number]
            loads = (1.0 - factor) * begin.loads + factor * self.inputs.loads[number]
            time = (1.0 - factor) * begin.time + factor * self.inputs.times[number]
            values = self._substep(ramp, factor, history, state, _Inputs(inputs, loads, time))
            history = state
        assert values is not None
        self.steps.append(values)

    def _substep(
        self,
        ramp: Ramp,
        factor: float,
        history: SolverState,
        state: SolverState,
        inputs: _Inputs,
    ) -> _StepValues:
        """Differentiate one substep, and carry the derivative of its history on."""
        simulation, before = self.simulation, self.present
        system, presliding = simulation.system, simulation.settings.presliding
        target = ramp.apply(system, factor)
        solved = SolvedPoint.of(system, state._replace(friction=history.friction), target, presliding)
        own = solved.forces[0]
        point = RobotPoint.of(
            state.configuration.poses[0],
            state.configuration.twists[0],
            state.base_tension[0],
            state.mobilisation[0],
            history.friction[0],
            target.time,
        )
        self._follow_mobilisation(solved)
        inherited = Inherited(before.slip, before.slip_rate, inputs.time, inputs.time - before.time)
        explicit = self.explicit.at(own, point, self.mobilisation, inherited)
        wrenches = explicit.wrenches + self._load_wrenches(point, inputs.loads)
        disturbance = Disturbance(
            wrenches, inputs.tendons, explicit.tension, explicit.released, before.slip, before.mobilisation
        )
        response = solved.respond((disturbance,))
        change = response.tendons[0]
        law = own.model.law
        slip = np.einsum("gn,mnp->mgp", law.slip_operator, change.released)
        elapsed = target.time - history.friction[0].time
        rate = before.slip_rate
        if elapsed > 0.0:
            travel = (own.field.slip - history.friction[0].slip)[:, :, None] / elapsed
            rate = (slip - before.slip - travel * inherited.elapsed) / elapsed
        self.present = Derivative(
            slip, change.mobilisation, rate, change.base_tension, change.released.sum(axis=1), *inputs
        )
        part = solved.numbering.robots[0]
        moved = response.unknowns[part.nodes].reshape(-1, 2, 3, len(self.parameters))
        world = point.rotations[:, None] @ moved
        holes = np.triu(np.ones((law.shape[1] - 1, law.shape[1])), 1)
        displacements = self.present.base_slip.copy()
        displacements[part.driven] = inputs.tendons[part.driven]
        slips = np.einsum("hn,mnp->mhp", holes, change.released)
        return _StepValues(world[:, 0], world[:, 1], change, displacements, slips)

    def _follow_mobilisation(self, solved: SolvedPoint) -> None:
        """Mobilisations at the end of a substep, also of holes that have friction only at neighbouring values."""
        own, presliding = solved.forces[0], solved.presliding
        law = own.model.law
        if law.groups == self.mobilisation.shape[1] and law.frictional.all():
            self.mobilisation = solved.state.mobilisation[0]
            return
        operator = self.explicit.law.slip_operator(law.shape[1])
        slip = own.field.released_length @ operator.T
        free = np.clip(self.mobilisation + (slip - self.slip) / presliding, -1.0, 1.0)
        if law.groups == free.shape[1]:
            free = np.where(law.frictional, solved.state.mobilisation[0], free)
        self.mobilisation, self.slip = free, slip

    def _load_wrenches(self, point: RobotPoint, loads: Array) -> Array:
        """Derivatives of the concentrated loads on the nodes, shape (6 N, P)."""
        nodes = np.zeros((len(point.positions), len(self.parameters), 6))
        mesh = self.explicit.present.forces.mesh
        for (_, at, frame), values in zip(self.simulation.loads, loads, strict=True):
            if values.any():
                node = mesh.node_at(at, 1e-6)
                nodes[node] += load_wrench(values.T, frame, point.rotations[node])
        return nodes.transpose(0, 2, 1).reshape(-1, len(self.parameters))

    # ------------------------------------------------------------------ result

    def result(self) -> Sensitivities:
        """Derivatives at the ends of all load steps so far."""
        if not self.steps:
            return Sensitivities()
        robot = self.simulation.handle.robot
        counts = [len(robot.hole_arc_lengths(t)) - 1 for t in robot.tendons]
        continuous = self.explicit.present.forces.geometry is None
        found = []
        for k, parameter in enumerate(self.parameters):
            tensions, slips = [], []
            for i, n in enumerate(counts):
                along = np.array([s.tendons.tension[i, :, k] for s in self.steps]).reshape(
                    len(self.steps), -1
                )
                tensions.append(np.repeat(along[:, :1], n, axis=1) if continuous else along[:, :n])
                through = np.array([s.slips[i, :, k] for s in self.steps]).reshape(len(self.steps), -1)
                slips.append(through[:, : n - 1])
            found.append(
                Sensitivity(
                    parameter.name,
                    parameter.value if isinstance(parameter, ModelParameter) else np.nan,
                    np.array([s.nodes[:, :, k] for s in self.steps]),
                    np.array([s.rotations[:, :, k] for s in self.steps]),
                    np.array([s.tendons.base_tension[:, k] for s in self.steps]),
                    np.array([s.displacements[:, k] for s in self.steps]),
                    tuple(tensions),
                    tuple(slips),
                )
            )
        return Sensitivities(tuple(found))

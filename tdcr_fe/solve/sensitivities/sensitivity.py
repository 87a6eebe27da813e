"""Derivatives of a simulation by parameters, carried along its load steps.

At the end of every substep the equations are satisfied, so their total derivative vanishes: the tangent at the solved
state times the derivative of the unknowns, plus the explicit derivative by the parameter, plus what the substep
inherits (slips and mobilisations at its beginning, inputs and loads from which it is ramped). Derivation:
docs/algorithms.md, section "Derivatives along the history".
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from tdcr_fe.effects import Experiment
from tdcr_fe.elements import Array
from tdcr_fe.elements.backbone import BEAM_TO_SECTION
from tdcr_fe.elements.hysteresis import FrictionState
from tdcr_fe.elements.native.hooks import SceneHooks
from tdcr_fe.model.loading import Load, LoadStep
from tdcr_fe.model.results import Sensitivities, Sensitivity
from tdcr_fe.model.schema import check_instance
from tdcr_fe.scene.handle import TDCR
from tdcr_fe.solve.load_steps.stepping import SolvedLoadStep
from tdcr_fe.solve.load_steps.within_substep import ReversalPoint, reversal_points
from tdcr_fe.solve.sensitivities.differences import InputDerivatives, InputValues
from tdcr_fe.solve.sensitivities.linear_response import Disturbance, Response, SolvedPoint
from tdcr_fe.solve.sensitivities.parameters import ModelParameter, Parameter, parameters
from tdcr_fe.solve.sensitivities.robot_model import (
    ExplicitDerivatives,
    Inherited,
    Neighbours,
    RobotModel,
    neighbours,
)
from tdcr_fe.solve.simulation import Simulation


@dataclass(frozen=True, eq=False)
class Derivative:
    """Derivative of the state at the end of a substep, on which the next one depends; parameters are the last axis."""

    slip: Array  # (m, g, P): Slips in the history of the holes [m]
    former: Array  # (m, g, P): Slips in the history before that [m]
    mobilisation: Array  # (m, g, P): Mobilisations in the history [1]
    slip_rate: Array  # (m, g, P): Slip rates in the history [m/s]
    base_tension: Array  # (m, P): Tension of every tendon at the base plate [N]
    base_slip: Array  # (m, P): Its slip through the base plate [m]
    inputs: Array  # (m, P): What its drive prescribes: tension [N] or displacement [m]
    loads: Array  # (L, 6, P): Forces and moments of the concentrated loads [N, N m]
    time: Array  # (P,): Time [s]


class _Carried(NamedTuple):
    """What one substep hands on to the next."""

    derivative: Derivative
    mobilisation: Array  # (m, g): Mobilisations, also of holes without friction at the present values [1]
    slip: Array  # (m, g): Slips to which these belong [m]
    former: Array  # (m, g): Slips at the end of the substep before [m]
    # By robot, with which change of its history the next substep begins; that of this robot is in `derivative`. Empty
    # where none has changed
    histories: tuple[Disturbance, ...] = ()


class _Disturbed(NamedTuple):
    """What the parameters change in a solved state at fixed nodes."""

    disturbances: tuple[Disturbance, ...]  # By robot
    mobilisation: Array  # (m, g): Mobilisations in this state, see `_Carried` [1]
    slip: Array  # (m, g): Slips in this state [m]
    rate: Array  # (m, g): Slip rates [m/s]
    inherited: Inherited  # Changes of what the rates are counted from
    duration: float  # Time over which the rates are means [s], see `FrictionState.rates_from`


class _StepValues(NamedTuple):
    """Derivatives at the end of one substep, for the result, and what the next one begins with."""

    carried: _Carried
    nodes: Array
    rotations: Array
    tension: Array
    base_tension: Array
    displacements: Array
    slips: Array
    curvature_rates: Array | None = None  # (E, 2, 3, P): At the end of a load step


@dataclass(frozen=True, eq=False)
class SensitivityHistory:
    """Derivatives along the load steps of a robot."""

    handle: TDCR  # The robot in its scene
    parameters: tuple[Parameter, ...]
    explicit: ExplicitDerivatives
    inputs: InputDerivatives
    # For every concentrated load of the scene, its node, -1 where it is on another robot, and its frame
    loads: tuple[tuple[int, str], ...]
    curvatures: bool = True  # Whether derivatives of the curvature rates are needed; else they are zero
    # What has been computed, by load step. Cleared, the history begins anew.
    steps: list[_StepValues] = field(default_factory=list)

    @classmethod
    def of(
        cls, simulation: Simulation, experiment: Experiment, chosen: Sequence[Parameter]
    ) -> SensitivityHistory:
        """Derivatives of a simulation that has not begun.

        Parameters
        ----------
        simulation
            Simulation of the experiment.
        experiment
            Robot, model and steps.
        chosen
            By what is differentiated.

        Raises
        ------
        ValueError
            There is no derivative by a parameter; the message says why.
        """
        handle = simulation.handle
        loads = tuple((handle.mesh.node_at(at, 1e-6), frame) for _, at, frame in simulation.loads)
        present, near = models_around(handle, experiment, chosen)
        frictional = bool(present.forces.law.frictional.any())
        inputs = InputDerivatives.of(experiment, simulation, chosen, near, frictional)
        explicit = ExplicitDerivatives(present, near, len(chosen))
        return cls(handle, tuple(chosen), explicit, inputs, loads)

    @classmethod
    def of_scene(cls, arm: TDCR, names: Sequence[str | Parameter]) -> SensitivityHistory:
        """Derivatives of a robot in a scene; see `tdcr_fe.solve.statics.track_sensitivities`."""
        hint = "a robot, as CreateTDCR returns it"
        check_instance("track_sensitivities", "arm", arm, TDCR, hint)
        if arm.compliance_factor != 1.0 or arm.robot.backbone.creep_rate != 0.0:
            raise ValueError(f"robot {arm.name!r}: no sensitivities of a backbone that creeps in a scene")
        if arm.robot.springs and arm.actuation.clamp is None:
            raise ValueError(f"robot {arm.name!r}: no sensitivities of springs to ground on a moving base")
        # A step that names all loads and all nodes stands for those to come.
        at = dict(zip(map(int, arm.nNodes), arm.mesh.arc_lengths.tolist(), strict=True))
        named = {name: Load(at=at[int(load.node)]) for name, load in arm.loads.items()}
        nodes = {f"node {k}": Load(at=s) for k, s in enumerate(at.values())}
        experiment = Experiment(arm.robot, arm.model, (LoadStep(loads={**nodes, **named}),))
        chosen = parameters(experiment, names)
        for p in chosen:
            if p.name.startswith(("steps", "effects.actuator", "loads.node ")):
                raise ValueError(f"sensitivities: {p.name!r}: a scene has no load steps; name its inputs")
        explicit = ExplicitDerivatives(*models_around(arm, experiment, chosen), len(chosen))
        own = {id(load): name for name, load in arm.loads.items()}
        labels = [own.get(id(x), "") for x in SceneHooks.of(arm.mbs).point_loads]
        loads = tuple(
            (arm.mesh.node_at(named[n].at, 1e-6), arm.loads[n].frame) if n else (-1, "world") for n in labels
        )
        inputs = InputDerivatives.of_inputs(len(arm.robot.tendons), [labels], chosen)
        return cls(arm, tuple(chosen), explicit, inputs, loads)

    @property
    def carried(self) -> _Carried:
        """What the next load step begins with."""
        return self.steps[-1].carried if self.steps else self._unloaded

    def begin_anew(self) -> None:
        """Begin the next load step with the unloaded robot."""
        self.steps[-1] = self.steps[-1]._replace(carried=self._unloaded)

    @property
    def _unloaded(self) -> _Carried:
        """What the first load step begins with."""
        law = self.explicit.present.forces.law
        slip = law.released_unloaded() @ self.explicit.law.slip_operator(law.shape[1]).T
        # Not zero where tendons have pretension.
        released = self.explicit.released_unloaded()
        by_slip, base, count = law.slip_operator @ released, released.sum(axis=1), released.shape[2]
        history, none = np.zeros_like(by_slip), np.zeros_like(base)
        loads = np.zeros((len(self.loads), 6, count))
        begin = Derivative(by_slip, by_slip, history, history, none, base, none, loads, np.zeros(count))
        return _Carried(begin, np.zeros_like(slip), slip, slip)

    # ------------------------------------------------------------------ along the path

    def refuse_others(self) -> None:
        """Refuse a scene in which holes have slipped since the last load step."""
        robot, law = self.handle.actuation, self.handle.actuation.law
        if self.inputs.restarts.all() or not law.model.active:
            return
        passed = np.abs(robot.friction_without_stretch().slip - self.carried.slip)
        if passed.max(initial=0.0) > law.hysteresis.presliding:
            text = "holes slipped in a SolveTDCR without these sensitivities"
            raise ValueError(f"robot {self.handle.name!r}: {text}")

    def advance(self, step: SolvedLoadStep) -> None:
        """Differentiate one solved load step. The scene is left at its end."""
        solver, before = step.solver, step.before
        system, ramp = solver.system, solver.ramp
        robot = system.robots.index(self.handle.actuation)
        goal = self.inputs.at(len(self.steps), self.handle.actuation.drives.scale)
        carried, goes_on = self.carried, (~self.inputs.restarts).astype(float)
        begin = Derivative(*(x * goes_on for x in vars(carried.derivative).values()))
        histories = tuple([Disturbance(*(y * goes_on for y in x)) for x in carried.histories])
        carried = carried._replace(derivative=begin, histories=histories)
        wound = np.where(np.isnan(before.prescribed[robot])[:, None], begin.base_slip, begin.inputs)
        start = np.where(self.handle.actuation.drives.winds[:, None], wound, begin.base_tension)
        first, values = InputValues(start, begin.loads, begin.time), None

        def inputs_at(factor: float) -> InputValues:
            return InputValues(*((1.0 - factor) * a + factor * b for a, b in zip(first, goal, strict=True)))

        for substep in step.path.increments:
            for point in reversal_points(solver, substep):
                target = ramp.apply(system, point.load_factor)
                solved = SolvedPoint.of(system, point.state, target, sticking=point.sticking)
                own = self._disturbed(robot, solved, target.time, inputs_at(point.load_factor), carried)
                carried = _reversed(own, point, solved, carried, robot)
            target = ramp.apply(system, substep.load_factor)
            state, inputs = substep.state._replace(friction=substep.history), inputs_at(substep.load_factor)
            solved = SolvedPoint.of(system, state, target, softening=substep.presliding_factor)
            own = self._disturbed(robot, solved, target.time, inputs, carried)
            values = self._values(robot, own, solved, inputs, carried)
            carried = values.carried
        assert values is not None
        self.steps.append(values._replace(curvature_rates=self._curvature_rates(robot, values, solved)))
        ramp.apply(system, 1.0)
        system.store(step.path.state)

    def _disturbed(
        self, robot: int, solved: SolvedPoint, time: float, inputs: InputValues, carried: _Carried
    ) -> _Disturbed:
        """What the parameters change at the end of a substep, or at a reversal within it, at fixed nodes."""
        before, state, own = carried.derivative, solved.state, solved.forces[robot]
        history = state.friction[robot]
        mobilisation, at_slip = self._mobilisation(solved, robot, carried)
        rate = np.zeros_like(at_slip) if history.slip_rate is None else history.slip_rate
        # The slips from which rates are counted are linear in those of the history.
        begin, duration = _counted(history, carried.slip, carried.former).rates_from(time)
        by_begin, _ = _counted(history, before.slip, before.former).rates_from(time)
        elapsed = inputs.time - before.time
        if duration > 0.0:
            rate = (at_slip - begin) / duration
            elapsed = elapsed * duration / (time - history.time)
        inherited = Inherited(by_begin, before.slip_rate, inputs.time, elapsed)
        explicit = self.explicit.at(own, mobilisation, rate, (history.time, time), inherited)
        count, tendons = len(self.parameters), (inputs.tendons, explicit.tension, explicit.released)
        on_nodes = self._load_wrenches(own.measured.poses[1], inputs.loads)
        wrenches = explicit.wrenches.reshape(-1, count) + on_nodes
        disturbances = list(carried.histories) or [Disturbance.none(x, count) for x in solved.forces]
        disturbances[robot] = Disturbance(wrenches, *tendons, before.slip, before.mobilisation)
        return _Disturbed(tuple(disturbances), mobilisation, at_slip, rate, inherited, duration)

    def _values(
        self, robot: int, disturbed: _Disturbed, solved: SolvedPoint, inputs: InputValues, carried: _Carried
    ) -> _StepValues:
        """Derivatives at the end of a substep."""
        before, own = carried.derivative, solved.forces[robot]
        response = solved.respond(disturbed.disturbances)
        change = response.tendons[robot]
        law = own.model.law
        rates = before.slip_rate
        if disturbed.duration > 0.0:
            travel = disturbed.rate[:, : law.groups, None] * disturbed.inherited.elapsed
            rates = (change.slip - disturbed.inherited.slip - travel) / disturbed.duration
        base = change.base_tension, change.released.sum(axis=1)
        after = Derivative(change.slip, before.slip, change.mobilisation, rates, *base, *inputs)
        part = solved.numbering.robots[robot]
        moved = response.unknowns[part.nodes].reshape(-1, 2, 3, len(self.parameters))
        world = solved.state.configuration.poses[robot][1][:, None] @ moved
        holes = np.triu(np.ones((law.shape[1] - 1, law.shape[1])), 1)
        displacements = after.base_slip.copy()
        displacements[part.driven] = inputs.tendons[part.driven]
        slips = holes @ change.released
        pairs = zip(disturbed.disturbances, response.tendons, strict=True)
        histories = [x._replace(slip=y.slip, mobilisation=y.mobilisation) for x, y in pairs]
        carried = _Carried(after, disturbed.mobilisation, disturbed.slip, carried.slip, tuple(histories))
        of_tendons = change.tension, change.base_tension, displacements, slips
        return _StepValues(carried, world[:, 0], world[:, 1], *of_tendons)

    def _curvature_rates(self, robot: int, values: _StepValues, solved: SolvedPoint) -> Array:
        """Derivatives of the curvature rates at the end of a step, in section axes, shape (E, 2, 3, P)."""
        configuration, own = solved.state.configuration, solved.forces[robot]
        chain, rotations = configuration.chains[robot], configuration.poses[robot][1]
        if not self.curvatures:
            return np.zeros((len(chain.twists), 2, 3, len(self.parameters)))
        moved = rotations.swapaxes(1, 2)[:, None] @ np.stack((values.nodes, values.rotations), axis=1)
        changes = chain.changes(moved.reshape(len(moved), 6, -1)), values.base_tension
        at = chain.twists, own.base_tension
        return BEAM_TO_SECTION @ self.explicit.curvature_rates(*at, *changes, own.field.time)

    def _mobilisation(self, solved: SolvedPoint, robot: int, carried: _Carried) -> tuple[Array, Array]:
        """Mobilisations at the end of a substep, also of holes that have friction only at neighbouring values.

        With the slips to which they belong [m].
        """
        own = solved.forces[robot]
        law = own.model.law
        slip = own.field.released_length @ self.explicit.law.slip_operator(law.shape[1]).T
        before = FrictionState(carried.slip, carried.mobilisation)
        free = np.clip(law.hysteresis.trial(slip, before), -1.0, 1.0)
        if law.groups == free.shape[1]:
            free = np.where(law.frictional, solved.state.mobilisation[robot], free)
        return free, slip

    def _load_wrenches(self, rotations: Array, loads: Array) -> Array:
        """Derivatives of the concentrated loads on nodes with these rotations, shape (6 N, P)."""
        count = len(self.parameters)
        nodes = np.zeros((len(rotations), 2, 3, count))
        for (node, frame), values in zip(self.loads, loads, strict=True):
            if node >= 0:
                turn = BEAM_TO_SECTION if frame == "section" else rotations[node]
                nodes[node] += turn.T @ values.reshape(2, 3, count)
        return nodes.reshape(-1, count)

    # ------------------------------------------------------------------ result

    def result(self) -> Sensitivities:
        """Derivatives at the ends of all load steps so far."""
        if not self.steps:
            return Sensitivities()
        robot = self.handle.robot
        counts = [len(robot.hole_arc_lengths(t)) - 1 for t in robot.tendons]
        _, *values = zip(*self.steps, strict=True)
        nodes, rotations, tension, base_tension, displacements, slips, curved = map(np.array, values)
        if self.explicit.present.forces.geometry is None:
            # Tendons that follow the backbone have one tension.
            tension = np.repeat(tension[:, :, :1], max(counts, default=1), axis=2)
        found = [
            Sensitivity(
                parameter.name,
                parameter.value if isinstance(parameter, ModelParameter) else np.nan,
                nodes[..., k],
                rotations[..., k],
                curved[..., k],
                base_tension[..., k],
                displacements[..., k],
                tuple(tension[:, i, :n, k] for i, n in enumerate(counts)),
                tuple(slips[:, i, : n - 1, k] for i, n in enumerate(counts)),
                self.explicit.arc_lengths[:, k],
            )
            for k, parameter in enumerate(self.parameters)
        ]
        return Sensitivities({each.parameter: each for each in found})


def _reversed(
    disturbed: _Disturbed, point: ReversalPoint, solved: SolvedPoint, carried: _Carried, robot: int
) -> _Carried:
    """What goes on after a reversal: the holes that reverse count from the slip there.

    Where the rate of a slip goes through zero, its derivative at the reversal is that at a fixed load factor. Where it
    jumps, because another hole begins to slip or a tendon becomes taut, the load factor at which that happens changes.
    """
    by_robot = zip(disturbed.disturbances, point.input_rates, strict=True)
    disturbances = [own.with_inputs(rates) for own, rates in by_robot]
    response = solved.respond(tuple(disturbances), point.load_rates)
    change, histories = _load_factor_change(point, solved, response, disturbances), []
    for begin, tendons, turned in zip(disturbed.disturbances, response.tendons, point.reverses, strict=True):
        goes_on, there = ~turned[..., None], tendons.slip[..., :-1] + tendons.slip[..., -1:] * change
        slip, mobilisation = np.where(goes_on, begin.slip, there), goes_on * begin.mobilisation
        histories.append(begin._replace(slip=slip, mobilisation=mobilisation))
    after, turned = histories[robot], point.reverses[robot]
    return _Carried(
        replace(carried.derivative, slip=after.slip, mobilisation=after.mobilisation),
        np.where(turned, disturbed.mobilisation, carried.mobilisation),
        np.where(turned, disturbed.slip, carried.slip),
        carried.former,
        tuple(histories),
    )


def _counted(history: FrictionState, slip: Array, former: Array) -> FrictionState:
    """A history with other slips: its own, and those before it where there are any."""
    return replace(history, slip=slip, former=history.former and (former, history.former[1]))


def _load_factor_change(
    point: ReversalPoint, solved: SolvedPoint, response: Response, disturbances: Sequence[Disturbance]
) -> float | Array:
    """Derivatives of the load factor at which rates jump, shape (P,); zero where none does.

    There a mobilisation comes to its bound, a tension to zero, or the slack of a tendon is used up.
    """
    numbering, pulling = solved.numbering, point.pulling
    if point.slipping.any():
        arriving = numbering.at_frictional_holes([x.mobilisation for x in response.tendons])[point.slipping]
    elif numbering.at_driven(point.state.base_tension)[pulling].any():
        arriving = numbering.at_driven([x.base_tension for x in response.tendons])[pulling]
    elif pulling.any():
        by_robot = zip(response.tendons, disturbances, strict=True)
        slack = [tendons.released.sum(axis=1) - own.inputs for tendons, own in by_robot]
        arriving = numbering.at_driven(slack)[pulling]
    else:
        return 0.0
    # What only touches its bound, at rest, comes there at no load factor that changes.
    return np.asarray(-arriving[0, :-1] / arriving[0, -1]) if arriving[0, -1] != 0.0 else 0.0


def models_around(
    handle: TDCR, experiment: Experiment, chosen: Sequence[Parameter]
) -> tuple[RobotModel, Neighbours]:
    """Models of a robot in a scene at the present and at neighbouring values of all parameters."""
    present = RobotModel.of(handle, experiment)
    return present, neighbours(present, chosen)

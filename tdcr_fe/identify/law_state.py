"""What the robot knows at every bay and load step, its response to moments and forces there, and runs that carry them.

An action is a bending moment in every bay, about the x and y axes of its middle section [N m], and a force on every
disk in the world frame [N]: shape (K, n_bays, 5) over K commanded load steps. A moment acts as a couple at both ends of
its bay, so that it is internal to the backbone; actions grow linearly over a load step.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from tdcr_fe.effects import Experiment
from tdcr_fe.identify.forward import SMALLEST_ON_REFERENCE, last_parts, run_settings
from tdcr_fe.identify.problem import FitProblem
from tdcr_fe.identify.run import Ends, Run, RunDerivatives
from tdcr_fe.identify.settings import ending_at
from tdcr_fe.model.channels import channel
from tdcr_fe.model.interpolation import interpolate_positions
from tdcr_fe.model.loading import Load, LoadStep, resolve
from tdcr_fe.model.observed_step import ObservedChange
from tdcr_fe.model.results import SequenceResult

if TYPE_CHECKING:
    from tdcr_fe.solve.sensitivities.parameters import StepInput
    from tdcr_fe.solve.simulate import PathRecord

Array = NDArray[np.float64]

#: Components of an action in a bay: moments about x and y, forces along x, y and z.
COMPONENTS = 5

#: Names of the loads that carry an action begin with this.
LOAD = "law"


@dataclass(frozen=True)
class BayState:
    """State of all bays at the end of every commanded load step."""

    edges: Array  # arc lengths of base plate, disks and tip [m], shape (n_bays + 1,)
    curvature: Array  # mean curvatures about x and y and twist, section frame [1/m], shape (K, n_bays, 3)
    rotation: Array  # of the middle section of every bay, shape (K, n_bays, 3, 3)
    # displacement of the distal end of every bay since the unloaded state [m], shape (K, n_bays, 3)
    moved: Array
    # of the tendon segment that passes a bay, zero beyond a tendon's end [N], shape (K, n_bays, n_tendons)
    tension: Array
    lever: Array  # bending moment of a unit tension about x and y [m], shape (n_bays, n_tendons, 2)
    direction: Array  # sign of the last change of every tendon's command [1], shape (K, n_tendons)
    time: Array  # [s], shape (K,)
    # bending moment of the concentrated loads in the middle section [N m], shape (K, n_bays, 2)
    load_moment: Array

    @property
    def middles(self) -> Array:
        """Of the bays [m]."""
        return 0.5 * (self.edges[1:] + self.edges[:-1])

    @property
    def shape(self) -> tuple[int, int]:
        """Steps, bays."""
        return self.curvature.shape[0], self.curvature.shape[1]

    def corrected(self, change: Array) -> BayState:
        """With curvatures and displacements changed, shape (K, n_bays, 5): about x and y, along x, y and z."""
        curvature = self.curvature.copy()
        curvature[..., :2] += change[..., :2]
        return replace(self, curvature=curvature, moved=self.moved + change[..., 2:])


@dataclass(frozen=True)
class ActedRun:
    """A solved loading sequence with actions."""

    run: Run  # at the ends of the commanded steps
    state: BayState
    residual: Array  # reading less prediction over sigma; NaN where a step was not solved, shape (n,)
    action: Array  # that acted, shape (K, n_bays, 5)
    path: PathRecord  # reference path for runs with other actions
    ends: Ends  # division of the steps to which the path belongs
    result: SequenceResult
    steps: tuple[LoadStep, ...]  # that were simulated, with the action as loads

    @property
    def repeated(self) -> Action:
        """The action, with moments along the sections as they turned out."""
        return Action(self.action, self.state.rotation)

    @property
    def solved(self) -> bool:
        """Whether every step was."""
        return bool(np.all(np.isfinite(self.residual)))


class Action(NamedTuple):
    """What acts on the bays in every commanded step."""

    values: Array  # shape (K, n_bays, 5)
    rotation: Array  # of the middle sections, to which the moments belong, shape (K, n_bays, 3, 3)


def with_action(experiment: Experiment, action: Action) -> Experiment:
    """The experiment, possibly with divided steps, with an action as concentrated loads."""
    edges = experiment.robot.bay_edges
    couple = np.einsum("kbij,kbj->kbi", action.rotation[..., :2], action.values[..., :2])
    couple[:, :-1] -= couple[:, 1:]
    wrench = np.concatenate((action.values[..., 2:], couple), axis=-1)
    steps = []
    for step, (k, factor) in zip(experiment.steps, experiment.step_ends, strict=True):
        before = wrench[k - 1] if k else np.zeros_like(wrench[0])
        here = before + factor * (wrench[k] - before)
        loads = {
            f"{LOAD} {j + 1}": Load(float(edges[j + 1]), _triple(w[:3]), _triple(w[3:]))
            for j, w in enumerate(here)
        }
        steps.append(replace(step, loads={**step.loads, **loads}))
    return replace(experiment, steps=tuple(steps))


def _triple(x: Array) -> tuple[float, float, float]:
    return float(x[0]), float(x[1]), float(x[2])


def run_with_action(
    problem: FitProblem,
    experiment: Experiment,
    action: Action,
    reference: ActedRun | None = None,
    inputs: Sequence[StepInput] = (),
) -> ActedRun:
    """Simulate an experiment with an action, along the path of a similar run, with derivatives by loads.

    Raises
    ------
    KeyboardInterrupt
        The simulation was interrupted.
    OutOfTime
        The deadline of the problem has passed.
    """
    from tdcr_fe.solve.simulate import simulate

    acted = with_action(experiment, action)
    settings = run_settings(problem.forward.settings, problem.path_tolerance)
    end = ending_at(problem.deadline)
    path: PathRecord = []
    result = None
    if reference is not None and reference.ends == acted.step_ends and reference.solved:
        quick = replace(settings, min_substep=max(settings.min_substep, SMALLEST_ON_REFERENCE))
        result = simulate(acted.robot, acted.model, acted.steps, quick, end, reference_path=reference.path,
                          record_path=path, sensitivities=inputs)  # fmt: skip
    if result is None or not result.converged:
        path = []
        result = simulate(
            acted.robot, acted.model, acted.steps, settings, end, record_path=path, sensitivities=inputs
        )
    problem.forward.runs += 1
    iterations = sum(s.iterations for s in result.steps)
    problem.forward.iterations += iterations
    last = last_parts(acted)
    steps = [result.steps[j] for j in last if j < len(result.steps)]
    run = replace(Run.of(steps, len(last), acted, result.message), iterations=iterations)
    state, residual, ends = (
        _bay_state(acted, result, last),
        problem.residual(acted, run),
        tuple(acted.step_ends),
    )
    return ActedRun(run, state, residual, action.values, path, ends, result, acted.steps)


def _bay_state(experiment: Experiment, result: SequenceResult, last: Sequence[int]) -> BayState:
    """State of the bays at the ends of commanded steps; NaN where a step was not solved."""
    robot, edges = experiment.robot, experiment.robot.bay_edges
    count, bays, m = len(last), len(edges) - 1, len(robot.tendons)
    middles, widths = 0.5 * (edges[1:] + edges[:-1]), np.diff(edges)
    curvature = np.full((count, bays, 3), np.nan)
    rotation = np.full((count, bays, 3, 3), np.nan)
    moved = np.full((count, bays, 3), np.nan)
    tension = np.zeros((count, bays, m))
    load_moment = np.zeros((count, bays, 2))
    actions = resolve(robot, experiment.steps)
    holes = [robot.hole_arc_lengths(t) for t in robot.tendons]
    for k, j in enumerate(last):
        if j >= len(result.steps):
            continue
        step = result.steps[j]
        nodes = [int(np.argmin(np.abs(step.s - e))) for e in edges]
        frames = step.rotations[nodes]
        turn = Rotation.from_matrix(np.swapaxes(frames[:-1], 1, 2) @ frames[1:])
        curvature[k] = turn.as_rotvec() / widths[:, None]
        half = Rotation.from_rotvec(0.5 * turn.as_rotvec()).as_matrix()
        rotation[k] = frames[:-1] @ half
        moved[k] = step.positions[nodes[1:]] - np.array([0.0, 0.0, 1.0]) * edges[1:, None]
        for i in range(m):
            at = np.searchsorted(holes[i], middles) - 1
            inside = middles < robot.end(robot.tendons[i])
            tension[k, inside, i] = step.tensions[i][np.minimum(at[inside], len(step.tensions[i]) - 1)]
        x = interpolate_positions(step.s, step.positions, step.rotations, middles)
        for name, load in actions[j].loads.items():
            if name.startswith(f"{LOAD} ") or not any((*load.force, *load.moment)) or load.frame != "world":
                continue
            node = step.positions[int(np.argmin(np.abs(step.s - load.at)))]
            about = np.cross(node - x, np.array(load.force)) + np.array(load.moment)
            about[middles > load.at] = 0.0
            load_moment[k] += np.einsum("bij,bi->bj", rotation[k], about)[:, :2]
    lever = np.zeros((bays, m, 2))
    for i, tendon in enumerate(robot.tendons):
        end = robot.end(tendon)
        hole = tendon.routing.position(np.minimum(middles, end), end)
        lever[:, i] = np.stack((-hole[:, 1], hole[:, 0]), axis=1)
    whole = [actions[j] for j in last]
    time = np.array([a.time for a in whole])
    direction = last_direction(np.array([a.values for a in whole]).reshape(count, m))
    return BayState(edges, curvature, rotation, moved, tension, lever, direction, time, load_moment)


def last_direction(commands: Array) -> Array:
    """Sign of the last change of every command, from zero on, shape (K, n_tendons)."""
    change = np.sign(np.diff(commands, axis=0, prepend=np.zeros((1, commands.shape[1]))))
    found = np.zeros_like(commands)
    for k in range(len(commands)):
        found[k] = np.where(change[k] != 0.0, change[k], found[k - 1] if k else 0.0)
    return found


# ------------------------------------------------------------------------------------------------- response


@dataclass(frozen=True)
class ActionResponse:
    """Derivatives by the action of the same load step, everything before the step unchanged."""

    # by step, the readings of the step and their derivatives over sigma, shape (r, 5 n_bays)
    readings: list[tuple[NDArray[np.int_], Array]]
    # of curvatures about x and y and displacements of the bays, in the order of an action, shape (K, 5
    # n_bays, 5 n_bays)
    state: Array


def action_response(
    problem: FitProblem, experiment: Experiment, reference: ActedRun
) -> tuple[ActionResponse, ActedRun]:
    """Exact response of readings and bays to actions, in one run along the reference."""
    from tdcr_fe.solve.sensitivities.parameters import LOAD_COMPONENTS, StepInput

    bays = reference.state.shape[1]
    inputs = [
        StepInput(f"{LOAD} {j + 1} {LOAD_COMPONENTS[c]}", load=f"{LOAD} {j + 1}", component=c)
        for j in range(bays)
        for c in range(6)
    ]
    run = run_with_action(problem, experiment, reference.repeated, reference, inputs)
    acted = run.run
    ended = last_parts(experiment)[: acted.solved]
    by = RunDerivatives.of(run.result.sensitivities, ended, acted.solved, {})
    widths = np.diff(run.state.edges)
    nodes = [int(np.argmin(np.abs(acted.s - e))) for e in run.state.edges]
    reader, data = problem.readings.reader, problem.data
    observed = reader.observer(acted, experiment)
    by_step: list[tuple[NDArray[np.int_], Array]] = []
    state = np.zeros((acted.solved, COMPONENTS * bays, COMPONENTS * bays))
    for k in range(acted.solved):
        turn = _loads_of_action(run.state.rotation[k])
        change = ObservedChange(
            by.positions[k] @ turn,
            by.rotations[k] @ turn,
            by.displacements[k] @ turn,
            by.distal_tensions[k] @ turn,
            np.zeros((acted.s.size, turn.shape[-1])),
        )
        mine = np.flatnonzero(reader.step == k)
        rows = np.zeros((mine.size, COMPONENTS * bays))
        for quantity in dict.fromkeys(data.readings[i].quantity for i in mine):
            which = [n for n, i in enumerate(mine) if data.readings[i].quantity == quantity]
            locations = [data.readings[mine[n]].location for n in which]
            rows[which] = channel(quantity).derivatives(observed(k), change, locations)
        by_step.append((mine, rows / problem.sigma[mine][:, None]))
        turned = change.rotations[nodes]
        local = np.einsum("bij,bip->bjp", run.state.rotation[k], turned[1:] - turned[:-1])
        part = np.concatenate((local[:, :2] / widths[:, None, None], change.positions[nodes[1:]]), axis=1)
        state[k] = part.reshape(COMPONENTS * bays, -1)
    return ActionResponse(by_step, state), run


def _loads_of_action(rotation: Array) -> Array:
    """From an action to the loads at the ends of the bays (force, moment), shape (6 n_bays, 5 n_bays)."""
    bays = len(rotation)
    matrix = np.zeros((bays, 6, bays, COMPONENTS))
    for b in range(bays):
        matrix[b, 3:, b, :2] = rotation[b][:, :2]
        if b:
            matrix[b - 1, 3:, b, :2] = -rotation[b][:, :2]
        matrix[b, :3, b, 2:] = np.eye(3)
    return matrix.reshape(6 * bays, COMPONENTS * bays)

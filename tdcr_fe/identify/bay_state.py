"""What the robot knows in every bay at every load step, loads that act there, and the response to them.

An action is a moment in every bay, about the axes of its middle section [N m], and a force on the disk at its end, in
the world frame [N]: shape (K, n_bays, 6) over K commanded load steps. A moment acts as a couple at both ends of its
bay, so that it is internal to the backbone; actions grow linearly over a load step.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from tdcr_fe.effects import Experiment
from tdcr_fe.elements import Array, Flags
from tdcr_fe.model.loading import Load, LoadStep
from tdcr_fe.model.observed_step import turns
from tdcr_fe.model.results import StepResult
from tdcr_fe.model.robot import Robot

if TYPE_CHECKING:
    from tdcr_fe.identify.run import Run, RunDerivatives
    from tdcr_fe.solve.sensitivities.parameters import StepInput

#: Components of an action in a bay: moments about x, y and z, forces along them.
COMPONENTS = 6
MOMENT, FORCE = slice(0, 3), slice(3, 6)


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
    begins: Flags  # whether a loading sequence begins with a step, shape (K,)

    @property
    def middles(self) -> Array:
        """Arc lengths of the middles of the bays [m]."""
        return 0.5 * (self.edges[1:] + self.edges[:-1])

    def choices(self, bay: int) -> int:
        """Among how many places the end of a bay is one: the tip stands alone."""
        return 1 if bay == self.shape[1] - 1 else self.shape[1]

    @property
    def tip(self) -> Array:
        """Rotation of the section at the end of the last bay, shape (K, 3, 3)."""
        half = Rotation.from_rotvec(0.5 * (self.edges[-1] - self.edges[-2]) * self.curvature[:, -1])
        return np.asarray(self.rotation[:, -1] @ half.as_matrix())

    @property
    def shape(self) -> tuple[int, int]:
        """Steps, bays."""
        return self.curvature.shape[0], self.curvature.shape[1]

    def corrected(self, change: Array) -> BayState:
        """With curvatures and twist, and displacements, changed, shape (K, n_bays, 6)."""
        curvature, moved = self.curvature + change[..., MOMENT], self.moved + change[..., FORCE]
        return replace(self, curvature=curvature, moved=moved)


def end_of_bay(edges: Array, bay: int) -> str:
    """The end of a bay, from 0, in words; ``edges``: see `BayState`."""
    return "tip" if bay + 2 == len(edges) else f"disk at s = {edges[bay + 1]:.4g} m"


class Action(NamedTuple):
    """What acts on the bays in every commanded step."""

    values: Array  # shape (K, n_bays, 6)
    rotation: Array  # of the middle sections, to which the moments belong, shape (K, n_bays, 3, 3)

    @classmethod
    def none(cls, experiment: Experiment) -> Action:
        """No action."""
        steps, bays = len(experiment.whole_steps), len(experiment.robot.bay_edges) - 1
        return cls(np.zeros((steps, bays, COMPONENTS)), np.broadcast_to(np.eye(3), (steps, bays, 3, 3)))

    def in_frames(self, rotation: Array) -> Action:
        """The same about the axes of other middle sections, shape (K, n_bays, 3, 3)."""
        values = self.values.copy()
        values[..., MOMENT] = np.einsum("kbji,kbj->kbi", rotation, self.moments)
        return Action(values, rotation)

    @property
    def moments(self) -> Array:
        """In the world frame, shape (K, n_bays, 3)."""
        return np.einsum("kbij,kbj->kbi", self.rotation, self.values[..., MOMENT])


def at_ends(experiment: Experiment, values: Array) -> Iterator[tuple[LoadStep, Array]]:
    """All steps, possibly divided, with values of commanded steps, shape (K, ...), which grow linearly within each."""
    firsts = {0, *experiment.restarts}
    for step, (k, factor) in zip(experiment.steps, experiment.ends, strict=True):
        before = np.zeros_like(values[0]) if k in firsts else values[k - 1]
        yield step, before + factor * (values[k] - before)


def _load_places(experiment: Experiment) -> dict[str, float]:
    """Arc lengths of the loads that carry an action [m], by name: one at the end of every bay."""
    return {f"law {j}": s for j, s in enumerate(experiment.robot.bay_edges[1:].tolist(), 1)}


def with_action(experiment: Experiment, action: Action) -> Experiment:
    """The experiment, possibly with divided steps, with an action as concentrated loads."""
    places, steps = _load_places(experiment).items(), []
    for step, here in at_ends(experiment, _wrenches(action)):
        ends = zip(places, here.tolist(), strict=True)
        loads = {name: Load(s, (a, b, c), (d, e, f)) for (name, s), (a, b, c, d, e, f) in ends}
        steps.append(replace(step, loads={**step.loads, **loads}))
    return replace(experiment, steps=tuple(steps))


def _wrenches(action: Action) -> Array:
    """Forces and moments at the ends of the bays, shape (K, n_bays, 6)."""
    values = action.values.reshape(len(action.values), -1, 1)
    return (loads_of_action(action.rotation) @ values).reshape(action.values.shape)


def loads_of(experiment: Experiment, action: Action) -> dict[str, Array]:
    """The concentrated loads of `with_action` at the ends of all steps, by name, shape (n_steps, 6)."""
    wrenches = np.array([here for _, here in at_ends(experiment, _wrenches(action))])
    return dict(zip(_load_places(experiment), np.moveaxis(wrenches, 1, 0), strict=True))


def action_inputs(experiment: Experiment) -> tuple[StepInput, ...]:
    """Inputs by which a run with an action is differentiated."""
    from tdcr_fe.solve.sensitivities.parameters import LOAD_COMPONENTS, StepInput

    components = [*enumerate(LOAD_COMPONENTS)]
    names = _load_places(experiment)
    return tuple(StepInput(f"{name} {x}", load=name, component=c) for name in names for c, x in components)


def bay_state(experiment: Experiment, steps: Sequence[StepResult]) -> BayState:
    """State of the bays at the ends of all commanded steps, as they were solved."""
    robot, edges = experiment.robot, experiment.robot.bay_edges
    count, bays, m = len(steps), len(edges) - 1, len(robot.tendons)
    middles, widths = 0.5 * (edges[1:] + edges[:-1]), np.diff(edges)
    nodes = [int(np.argmin(np.abs(steps[0].s - e))) for e in edges]
    frames = np.array([step.rotations[nodes] for step in steps])
    turn = turns(frames)
    curvature = turn / widths[:, None]
    half = Rotation.from_rotvec(0.5 * turn.reshape(-1, 3)).as_matrix().reshape(count, bays, 3, 3)
    rotation = frames[:, :-1] @ half
    moved = np.array([step.positions[nodes[1:]] for step in steps]) - np.outer(edges[1:], (0.0, 0.0, 1.0))
    tension, lever = np.zeros((count, bays, m)), np.zeros((bays, m, 2))
    for i, tendon in enumerate(robot.tendons):
        end = robot.end(tendon)
        inside = middles < end
        every = np.array([step.tensions[i] for step in steps])
        at = np.searchsorted(robot.hole_arc_lengths(tendon), middles[inside]) - 1
        tension[:, inside, i] = every[:, np.minimum(at, every.shape[1] - 1)]
        hole = tendon.routing.position(np.minimum(middles, end), end)
        lever[:, i] = np.stack((-hole[:, 1], hole[:, 0]), axis=1)
    actions, starts = experiment.actions, experiment.restarts
    whole = [actions[j] for j in experiment.whole_steps]
    time = np.array([a.time for a in whole])
    commands = np.array([a.values for a in whole]).reshape(count, m)
    direction = np.concatenate([last_direction(own) for own in np.split(commands, starts)])
    begins = np.isin(np.arange(count), (0, *starts))
    return BayState(edges, curvature, rotation, moved, tension, lever, direction, time, begins)


def last_direction(values: Array, least: float = 0.0) -> Array:
    """Sign of the last change of more than ``least``, from zero on, by step, shape (K, n)."""
    change = np.diff(values, axis=0, prepend=np.zeros((1, values.shape[1])))
    found = np.where(np.abs(change) > least, np.sign(change), 0.0)
    for k in range(1, len(found)):
        found[k] = np.where(found[k] != 0.0, found[k], found[k - 1])
    return found


class Acted(NamedTuple):
    """The action that a run carries, and derivatives by that of the same load step, all before the step unchanged."""

    action: Action
    readings: Array  # of the predictions over sigma, shape (n, 6 n_bays)
    # of curvatures, twist and displacements of the bays, in the order of an action, shape (K, 6 n_bays, 6 n_bays)
    state: Array


def state_change(run: Run, by: RunDerivatives) -> Array:
    """Derivatives of curvatures, twist and displacements of the bays, shape (K, 6 n_bays, P)."""
    assert run.bays is not None
    state, steps = run.bays, len(run.positions)
    nodes = [int(np.argmin(np.abs(run.s - e))) for e in state.edges]
    turned = by.rotations[:, nodes]
    local = np.einsum("kbij,kbip->kbjp", state.rotation, turned[:, 1:] - turned[:, :-1])
    both = np.concatenate((local / np.diff(state.edges)[:, None, None], by.positions[:, nodes[1:]]), axis=2)
    return np.asarray(both.reshape(steps, COMPONENTS * state.shape[1], -1))


def loads_of_action(rotation: Array) -> Array:
    """From an action to the loads at the ends of the bays (force, moment), shape (K, 6 n_bays, 6 n_bays)."""
    steps, bays = rotation.shape[:2]
    matrix = np.zeros((steps, bays, 6, bays, COMPONENTS))
    for b in range(bays):
        matrix[:, b, 3:, b, MOMENT] = rotation[:, b]
        if b:
            matrix[:, b - 1, 3:, b, MOMENT] = -rotation[:, b]
        matrix[:, b, :3, b, FORCE] = np.eye(3)
    return matrix.reshape(steps, 6 * bays, COMPONENTS * bays)


def scale(robot: Robot) -> Array:
    """Moments and forces that bend a backbone by about its length, in the order of an action, shape (6,)."""
    backbone = robot.backbone
    return np.array([backbone.EI / backbone.length] * 3 + [backbone.EI / backbone.length**2] * 3)

"""Work, stored energy and dissipation along a finely divided history, from positions, rotations and tensions alone."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from scipy.spatial.transform import Rotation

from tdcr_fe.effects.actuation import loads_between
from tdcr_fe.elements import Array
from tdcr_fe.model.loading import Actuation, LoadStep, Model, resolve
from tdcr_fe.model.results import SequenceResult, StepResult
from tdcr_fe.model.robot import Robot
from tdcr_fe.validation.fuzz.state import State, elements, unloaded_pose


def divided(robot: Robot, steps: Sequence[LoadStep], parts: int) -> list[LoadStep]:
    """Every load step in equal parts, each a load step of its own; loads and inputs change linearly.

    Parameters
    ----------
    robot
        Whose tendons are named.
    steps
        In which no tendon changes between tension and displacement, and no load between frames.
    parts
        Number of parts.
    """
    found: list[LoadStep] = []
    ends = resolve(robot, steps)
    before = Actuation(ends[0].drives, np.zeros(len(robot.tendons)))
    for step, end in zip(steps, ends, strict=True):
        for x in np.arange(1, parts + 1) / parts:
            values = ((1.0 - x) * before.values + x * end.values).tolist()
            rows = list(zip(robot.tendon_names, values, end.by_displacement, strict=True))
            tensions = {name: value for name, value, pulled in rows if not pulled}
            moved = {name: value for name, value, pulled in rows if pulled}
            loads = loads_between(before.loads, end.loads, x)
            time = (1.0 - x) * before.time + x * end.time if step.time is not None else None
            found.append(LoadStep(step.label, tensions, moved, loads, time=time))
        before = end
    return found


def is_covered(robot: Robot, model: Model, steps: Sequence[LoadStep]) -> bool:
    """Whether the balance is implemented: straight tendons without clearance, no creep, loads in the world frame.

    Inputs may not change between tension and displacement.
    """
    if not steps or model.tendon_path != "straight" or not robot.tendons or robot.backbone.creep_rate:
        return False
    loads = [x for s in steps for x in s.loads.values()]
    modes, places = {tuple(a.by_displacement) for a in resolve(robot, steps)}, {x.at for x in loads}
    tight = all(t.clearance == 0.0 and t.pretension == 0.0 for t in robot.tendons)
    return len(modes) == 1 and tight and all(x.frame == "world" for x in loads) and len(places) <= 1


@dataclass(frozen=True)
class Ledger:
    """Energy from the unloaded robot, or the first state of one with weight, to the end of a history.

    Attributes
    ----------
    work : float
        Of the actuators, loads and weight [J].
    stored : float
        In backbone, springs and tendons [J].
    dissipated : ndarray, shape (n_holes,)
        At the holes of all tendons [J].
    turnover : float
        Sum of the sizes of all contributions [J].
    """

    work: float
    stored: float
    dissipated: Array
    turnover: float

    @property
    def gap(self) -> float:
        """Work less stored and dissipated energy, over the turnover [1]."""
        return abs(self.work - self.stored - float(self.dissipated.sum())) / self.turnover

    @property
    def gain(self) -> float:
        """Largest energy that a hole gives, over the turnover; zero where all dissipate [1]."""
        return float((-self.dissipated).max(initial=0.0)) / self.turnover


def ledger(result: SequenceResult) -> Ledger:
    """The energy balance of a finely divided history, by the trapezoidal rule."""
    robot, model = result.robot, result.model
    # Weight acts in full from the first state on.
    steps = [*([] if any(model.gravity) else [_unloaded(robot, result.steps[0])]), *result.steps]
    states = [State.of(robot, model, step) for step in steps]
    work, stored, turnover = 0.0, 0.0, 1e-12
    dissipated = np.zeros(len(states[0].tendons.holes))
    for a, b in pairwise(states):
        tendons, released = a.tendons, b.taken_in - a.taken_in
        tension = 0.5 * (a.tension + b.tension)
        # Tendon that passes the base side of each segment.
        of_tendons = np.split(released, tendons.last[:-1])
        passed = np.concatenate([np.cumsum(own[::-1])[::-1] for own in of_tendons])
        done = [*_external(a, b), *(tension * passed)[tendons.first]]
        # A tendon is stretched by what its segments take up beyond what they hand on.
        stretched = float(tension @ (b.lengths - a.lengths + released))
        bent = float(np.sum(0.5 * (a.gradient + b.gradient) * (b.twists - a.twists)))
        kept = [bent, stretched, *_springs(a, b)]
        dissipated += (tension[tendons.holes] - tension[tendons.holes + 1]) * passed[tendons.holes + 1]
        work, stored = work + float(sum(done)), stored + float(sum(kept))
        turnover += float(sum(map(abs, (*done, *kept))))
    return Ledger(work, stored, dissipated, turnover)


def _springs(a: State, b: State) -> list[float]:
    """Energy that goes into the springs between two states [J]."""
    found, rest = [], unloaded_pose(a.layout.section.rest, a.layout.lengths)[0]
    for spring in a.robot.springs:
        node = a.node(spring.at)
        away = [(x.step.positions - rest)[node, :2] for x in (a, b)]
        found.append(0.5 * spring.stiffness * float(away[1] @ away[1] - away[0] @ away[0]))
    return found


def _external(a: State, b: State) -> list[float]:
    """Work of loads and weight between two states [J]."""
    moved = b.step.positions - a.step.positions
    turned = Rotation.from_matrix(b.step.rotations @ np.swapaxes(a.step.rotations, 1, 2)).as_rotvec()
    loads = [x for s in (a, b) if s.step.actuation is not None for x in s.step.actuation.loads.values()]
    found = [0.5 * float(moved[a.node(x.at)] @ x.force + turned[a.node(x.at)] @ x.moment) for x in loads]
    return [*found, float(a.mass @ (moved @ np.array(a.model.gravity)))]


def _unloaded(robot: Robot, like: StepResult) -> StepResult:
    layout = elements(robot, like.s, 0.0)
    positions, rotations = unloaded_pose(layout.section.rest, layout.lengths)
    tensions = tuple(np.zeros_like(t) for t in like.tensions)
    like = replace(like, tensions=tensions, base_tensions=np.zeros_like(like.base_tensions), actuation=None)
    return replace(like, positions=positions, rotations=rotations)

"""Work, stored energy and dissipation along a finely divided history, from positions, rotations and tensions alone."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from tdcr_fe.model.loading import Actuation, Load, LoadStep, Model, resolve
from tdcr_fe.model.results import SequenceResult, StepResult
from tdcr_fe.model.robot import Robot
from tdcr_fe.validation.fuzz.rod import Elements, courses, relative_twists, unloaded_pose

Array = NDArray[np.float64]


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
    zero = np.zeros(len(robot.tendons))
    ends = resolve(robot, steps)
    before = Actuation(ends[0].by_displacement, np.where(ends[0].by_displacement, 0.0, zero))
    for step, end in zip(steps, ends, strict=True):
        for i in range(1, parts + 1):
            x = i / parts
            values = (1.0 - x) * before.values + x * end.values
            named = dict(zip(robot.tendon_names, values.tolist(), strict=True))
            pulled = dict(zip(robot.tendon_names, end.by_displacement.tolist(), strict=True))
            found.append(
                LoadStep(
                    step.label,
                    {n: v for n, v in named.items() if not pulled[n]},
                    {n: v for n, v in named.items() if pulled[n]},
                    {n: _between(before.loads.get(n), load, x) for n, load in end.loads.items()},
                    time=(1.0 - x) * before.time + x * end.time if step.time is not None else None,
                )
            )
        before = end
    return found


def _between(first: Load | None, last: Load, x: float) -> Load:
    if first is None:
        first = replace(last, force=(0.0, 0.0, 0.0), moment=(0.0, 0.0, 0.0))
    force = (1.0 - x) * np.array(first.force) + x * np.array(last.force)
    moment = (1.0 - x) * np.array(first.moment) + x * np.array(last.moment)
    return replace(last, force=tuple(force.tolist()), moment=tuple(moment.tolist()))


def is_covered(robot: Robot, model: Model, steps: Sequence[LoadStep]) -> bool:
    """Whether the balance is implemented: straight tendons without clearance, no creep, loads in the world frame.

    Inputs may not change between tension and displacement.
    """
    if not steps or model.tendon_path != "straight" or not robot.tendons or robot.backbone.creep_rate:
        return False
    kinds = [tuple(a.by_displacement) for a in resolve(robot, steps)]
    loads = [x for s in steps for x in s.loads.values()]
    return (
        len(set(kinds)) == 1
        and all(t.clearance == 0.0 and t.pretension == 0.0 for t in robot.tendons)
        and all(x.frame == "world" for x in loads)
        and len({x.at for x in loads}) <= 1
    )


@dataclass(frozen=True)
class Ledger:
    """Energy from the unloaded robot, or the first state of one with weight, to the end of a history.

    Attributes
    ----------
    work : float
        Of the actuators, loads and weight [J].
    stored : float
        In backbone, springs and tendons [J].
    dissipated : tuple of ndarray
        At the holes of each tendon [J].
    turnover : float
        Sum of the sizes of all contributions [J].
    """

    work: float
    stored: float
    dissipated: tuple[Array, ...]
    turnover: float

    @property
    def gap(self) -> float:
        """Work less stored and dissipated energy, over the turnover [1]."""
        return abs(self.work - self.stored - sum(float(d.sum()) for d in self.dissipated)) / self.turnover

    @property
    def gain(self) -> float:
        """Largest energy that a hole gives, over the turnover; zero where all dissipate [1]."""
        least = min((float(d.min(initial=0.0)) for d in self.dissipated), default=0.0)
        return max(0.0, -least) / self.turnover


def ledger(result: SequenceResult) -> Ledger:
    """The energy balance of a finely divided history, by the trapezoidal rule."""
    robot, model = result.robot, result.model
    # Weight acts in full from the first state on.
    states = [*([] if any(model.gravity) else [_unloaded(robot, result.steps[0])]), *result.steps]
    elements = Elements.of(robot, states[0].s, 0.0)
    work, stored, turnover = 0.0, 0.0, 1e-12
    counts = [len(t) - 1 for t in states[0].tensions]
    dissipated = [np.zeros(n) for n in counts]
    cables = [courses(robot, x.s, x.positions, x.rotations) for x in states]
    for (a, b), (ca, cb) in zip(pairwise(states), pairwise(cables), strict=True):
        done = [float(x) for x in _external(robot, model, a, b)]
        twists = [relative_twists(x.positions, x.rotations) for x in (a, b)]
        mean = 0.5 * (elements.gradient(twists[0]) + elements.gradient(twists[1]))
        kept = [float(np.sum(mean * (twists[1] - twists[0])))]
        for i, tendon in enumerate(robot.tendons):
            compliance = 0.0 if tendon.axial_stiffness is None else 1.0 / tendon.axial_stiffness
            ta, tb = a.tensions[i], b.tensions[i]
            released = ca[i].lengths / (1.0 + compliance * ta) - cb[i].lengths / (1.0 + compliance * tb)
            passed = np.cumsum(released[::-1])[::-1]
            done.append(0.5 * float(ta[0] + tb[0]) * float(passed[0]))
            kept.append(_stretch(ca[i].lengths, cb[i].lengths, ta, tb, released))
            dissipated[i] += 0.5 * (ta[:-1] - ta[1:] + tb[:-1] - tb[1:]) * passed[1:]
        for spring in robot.springs:
            kept.append(_spring(robot, spring.at, spring.stiffness, a, b, elements))
        work, stored = work + sum(done), stored + sum(kept)
        turnover += sum(map(abs, (*done, *kept)))
    return Ledger(work, stored, tuple(dissipated), turnover)


def _stretch(la: Array, lb: Array, ta: Array, tb: Array, released: Array) -> float:
    """Energy that goes into stretching a tendon: what its segments take up beyond what is handed on."""
    mean = 0.5 * (ta + tb)
    return float(np.sum(mean * (lb - la + released)))


def _spring(
    robot: Robot, at: float, stiffness: float, a: StepResult, b: StepResult, elements: Elements
) -> float:
    node = int(np.abs(a.s - at).argmin())
    rest = unloaded_pose(elements, a.s)[0][node, :2]
    away = [x.positions[node, :2] - rest for x in (a, b)]
    return 0.5 * stiffness * float(away[1] @ away[1] - away[0] @ away[0])


def _external(robot: Robot, model: Model, a: StepResult, b: StepResult) -> list[float]:
    """Work of loads and weight between two states [J]."""
    found = []
    moved = b.positions - a.positions
    turned = relative_rotation(a.rotations, b.rotations)
    loads_a = {} if a.actuation is None else a.actuation.loads
    loads_b = {} if b.actuation is None else b.actuation.loads
    for name in {*loads_a, *loads_b}:
        first, last = loads_a.get(name), loads_b.get(name)
        at = (last or first).at  # type: ignore[union-attr]
        node = int(np.abs(a.s - at).argmin())
        for load in (first, last):
            if load is not None:
                found.append(0.5 * float(np.array(load.force) @ moved[node]))
                found.append(0.5 * float(np.array(load.moment) @ turned[node]))
    if any(model.gravity):
        mass = np.zeros(len(a.s))
        own = Elements.of(robot, a.s, 0.0).mass
        mass[:-1] += 0.5 * own
        mass[1:] += 0.5 * own
        for disk in robot.disks.positions:
            mass[np.abs(a.s - disk).argmin()] += robot.disks.mass
        mass[-1] += robot.tip_mass
        found.append(float(mass @ (moved @ np.array(model.gravity))))
    return found


def relative_rotation(first: Array, second: Array) -> Array:
    """Rotation vectors from one set of frames to another, world axes, shape (n, 3)."""
    from scipy.spatial.transform import Rotation

    found: Array = Rotation.from_matrix(second @ np.swapaxes(first, 1, 2)).as_rotvec()
    return found


def _unloaded(robot: Robot, like: StepResult) -> StepResult:
    positions, rotations = unloaded_pose(Elements.of(robot, like.s, 0.0), like.s)
    return replace(
        like,
        positions=positions,
        rotations=rotations,
        base_tensions=np.zeros_like(like.base_tensions),
        tensions=tuple(np.zeros_like(t) for t in like.tensions),
        actuation=None,
    )


__all__ = ["Ledger", "divided", "is_covered", "ledger"]

"""Experiments with other arc lengths: a backbone of another length, a disk at another place."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from tdcr_fe.effects import Experiment
from tdcr_fe.model.checks import ARC_TOLERANCE
from tdcr_fe.model.robot import Robot
from tdcr_fe.model.routing import PointsRouting, Routing, TurnedRouting


def with_arc_lengths(experiment: Experiment, new: Callable[[float], float]) -> Experiment:
    """The experiment with every arc length moved: disks, ends, loads, patches, holes of listed points."""
    robot = experiment.robot

    def routing(old: Routing) -> Routing:
        if isinstance(old, TurnedRouting):
            return replace(old, base=routing(old.base))
        if isinstance(old, PointsRouting):
            return replace(old, arc_lengths=tuple(new(s) for s in old.arc_lengths))
        return old

    backbone = replace(
        robot.backbone,
        length=new(robot.backbone.length),
        taper=tuple((new(s), r) for s, r in robot.backbone.taper),
        patches=tuple(replace(p, start=new(p.start), end=new(p.end)) for p in robot.backbone.patches),
    )
    tendons = tuple(
        replace(
            t,
            routing=routing(t.routing),
            end=None if t.end is None else new(t.end),
            tight_holes=tuple(replace(x, at=new(x.at)) for x in t.tight_holes),
        )
        for t in robot.tendons
    )
    disks = replace(robot.disks, positions=tuple(new(s) for s in robot.disks.positions))
    steps = tuple(
        replace(s, loads={name: replace(load, at=new(load.at)) for name, load in s.loads.items()})
        for s in experiment.steps
    )
    springs = tuple(replace(x, at=new(x.at)) for x in robot.springs)
    moved = replace(robot, backbone=backbone, disks=disks, tendons=tendons, springs=springs)
    return replace(experiment, robot=moved, steps=steps)


def with_length(experiment: Experiment, length: float) -> Experiment:
    """The experiment with a backbone of another length, all arc lengths in proportion."""
    ratio = length / experiment.robot.backbone.length
    return with_arc_lengths(experiment, lambda s: s * ratio)


def with_disk_at(experiment: Experiment, present: float, new: float) -> Experiment:
    """The experiment with a disk at another arc length [m]; tendons anchored at it and loads on it move with it."""
    return with_arc_lengths(experiment, lambda s: new if abs(s - present) < 1e-9 else s)


def shortest_part(robot: Robot) -> float:
    """Shortest distance between disks and ends of patches [m], to which changes of arc lengths are small.

    Stiffness goes with the inverse of an element's length, so that a difference step in proportion to the whole
    backbone has an error that grows with the square of the number of elements.
    """
    patches = [s for patch in robot.backbone.patches for s in (patch.start, patch.end)]
    gaps = np.diff(sorted([0.0, *robot.disks.positions, *patches, robot.backbone.length]))
    return float(gaps[gaps > ARC_TOLERANCE].min())

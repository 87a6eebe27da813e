"""Stations and intervals of the multiple shooting, with the masses at the stations."""

from __future__ import annotations

import itertools
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from tdcr_fe.model.checks import ARC_TOLERANCE
from tdcr_fe.model.robot import Robot
from tdcr_fe.validation.reference.section import Section
from tdcr_fe.validation.reference.settings import Array, Index


@dataclass(frozen=True)
class Layout:
    """Stations along the backbone; interval i lies between stations i and i + 1.

    Attributes
    ----------
    s : ndarray, shape (n + 1,)
        Arc lengths of the stations, base first, tip last [m].
    nodes : ndarray of int
        Stations that are reported: base, disks, load points, tip.
    section : Section
        Law of the n intervals.
    point_mass : ndarray, shape (n + 1,)
        Disks and tip mass [kg].
    mass_per_length : ndarray, shape (n,)
        Of the backbone in the intervals [kg/m].
    """

    s: Array
    nodes: Index
    section: Section
    point_mass: Array
    mass_per_length: Array

    @property
    def lengths(self) -> Array:
        """Of the intervals [m], shape (n,)."""
        return np.diff(self.s)

    def station(self, s: float) -> int:
        """The station at an arc length [m]."""
        index = int(np.argmin(np.abs(self.s - s)))
        if abs(self.s[index] - s) > 2.0 * ARC_TOLERANCE:
            raise ValueError(f"no station at {s:g} m")
        return index


def _merge(points: Iterable[float]) -> list[float]:
    merged: list[float] = []
    for point in points:
        if all(abs(point - other) > ARC_TOLERANCE for other in merged):
            merged.append(point)
    return merged


def lay_out(robot: Robot, load_points: Iterable[float], max_interval: float) -> Layout:
    """Cut the backbone of a robot.

    Parameters
    ----------
    robot
        The robot.
    load_points
        Arc lengths of concentrated loads [m].
    max_interval
        Longest interval over the length of the backbone [1].

    Returns
    -------
    Layout
        With stations at base, tip, disks, load points, ends of rigid inserts and of stiffness patches.
    """
    backbone, disks = robot.backbone, robot.disks
    length = backbone.length
    reported = _merge([0.0, length, *disks.positions, *(min(p, length) for p in load_points)])
    half = disks.thickness / 2.0
    edges = [e for d in disks.positions for e in (max(0.0, d - half), min(length, d + half))]
    hinge = max(1e-5 * length, 5e-6)
    # The section is constant within an interval, so the radius changes by at most 1 % there.
    for (start, before), (end, after) in itertools.pairwise(backbone.taper):
        count = 1 + int(np.ceil(abs(np.log(after / before)) / 0.01))
        edges += list(np.linspace(start, end, count + 1))
    edges += [robot.end(t) for t in robot.tendons] if robot.without_disks else []
    edges += [hinge] if robot.base_stiffness is not None else []
    edges += [min(max(e, 0.0), length) for p in backbone.patches for e in (p.start, p.end)]
    cuts = np.array(sorted(_merge([*reported, *edges])))
    pieces = np.maximum(1, np.ceil(np.diff(cuts) / (max_interval * length) - 1e-9).astype(int))
    fine = [a + (b - a) * np.arange(n) / n for a, b, n in zip(cuts[:-1], cuts[1:], pieces, strict=True)]
    s = np.concatenate((*fine, [length]))
    middles = 0.5 * (s[1:] + s[:-1])
    rigid = np.any(np.abs(middles[:, None] - disks.positions) < half, axis=1)
    nodes = np.array([int(np.argmin(np.abs(s - r))) for r in sorted(reported)])
    mass = np.zeros(len(s))
    for d in disks.positions:
        mass[int(np.argmin(np.abs(s - d)))] += disks.mass
    mass[-1] += robot.tip_mass
    section = Section.of(backbone, middles, rigid)
    if robot.base_stiffness is not None:
        # A very short interval of this rotational stiffness.
        section.stiffness[0, :2] = robot.base_stiffness * hinge
    area = np.pi * backbone.radius_at(middles) ** 2
    density = backbone.density * backbone.material_factors(middles)[1]
    return Layout(s, nodes, section, mass, density * area)

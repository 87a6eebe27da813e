"""Robots without friction whose tip is known: in closed form, or by the equations of two public codes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from tdcr_fe.model.loading import Load
from tdcr_fe.model.robot import Disks, Robot, Tendon
from tdcr_fe.model.routing import ConvergingRouting, HelicalRouting, ParallelRouting, Routing
from tdcr_fe.validation.crosscheck.cases import BACKBONE, LENGTH
from tdcr_fe.validation.reference.closed_forms import constant_strain, elastica_tip, helix_wrench


@dataclass(frozen=True)
class Known:
    """A robot under tensions and loads, and where its tip is."""

    title: str
    robot: Robot
    path: str  # of the tendons
    tip: tuple[float, ...]  # [m]
    tensions: Mapping[str, float] = field(default_factory=dict)
    loads: Mapping[str, Load] = field(default_factory=dict)


_PLAIN = replace(BACKBONE, density=0.0)
_STIFF = replace(_PLAIN, axial_stiffness=1e8, shear_stiffness=1e8)
_WOUND = replace(_PLAIN, axial_stiffness=1e5, shear_stiffness=1e5)
_DISKS = Disks.equally_spaced(12, LENGTH)


def _pulled(routing: Routing) -> Robot:
    return Robot(_PLAIN, _DISKS, (Tendon("t1", routing),))


def _half_circle() -> Known:
    moment = Load(LENGTH, moment=(0.0, np.pi * _PLAIN.EI / LENGTH, 0.0))
    title, tip = "moment at the tip, half a circle", (2.0 * LENGTH / np.pi, 0.0, 0.0)
    return Known(title, Robot(_PLAIN, _DISKS), "straight", tip, loads={"tip": moment})


def _elastica() -> Known:
    force = 4.0 * _STIFF.EI / LENGTH**2
    across, along, _ = elastica_tip(LENGTH, _STIFF.EI, force)
    title = "elastica, force across the tip of 4 EI/L^2 (elliptic integrals)"
    load = Load(LENGTH, (force, 0.0, 0.0))
    return Known(title, Robot(_STIFF, _DISKS), "straight", (across, 0.0, along), loads={"tip": load})


def _helix() -> Known:
    turn, twist = 12.0, 9.0
    wrench = helix_wrench(turn, twist, _WOUND.EI, _WOUND.GJ)
    strain = np.array([0.0, turn, twist, *([0.0, 0.0, 1.0] + wrench[3:] / _WOUND.EA)])
    tip = tuple(constant_strain(strain, LENGTH)[1].tolist())
    load = Load(LENGTH, tuple(wrench[3:]), tuple(wrench[:3]), frame="section")
    return Known("helix of constant strain", Robot(_WOUND, _DISKS), "straight", tip, loads={"tip": load})


def _arc() -> Known:
    tension, offset = 3.0, 4.5e-3
    strain = np.array([0.0, tension * offset / _PLAIN.EI, 0.0, 0.0, 0.0, 1.0 - tension / _PLAIN.EA])
    tip = tuple(constant_strain(strain, LENGTH)[1].tolist())
    title = "classical tendon, arc of constant curvature T r/EI"
    return Known(title, _pulled(ParallelRouting(offset, 0.0)), "continuous", tip, {"t1": tension})


_UP, _WINDING = _pulled(ParallelRouting(4.5e-3, 90.0)), _pulled(HelicalRouting(4.5e-3, 2.0))
_NEARING = _pulled(ConvergingRouting(4.5e-3, 0.15e-3))
_SHORT = (Tendon(f"a{i}", ParallelRouting(4.5e-3, a), end=0.15) for i, a in enumerate((90.0, -30.0, 210.0)))
_LONG = (Tendon(f"b{i}", ParallelRouting(3e-3, a)) for i, a in enumerate((30.0, 150.0, 270.0)))
_TWO = Robot(replace(_PLAIN, length=0.4), Disks.equally_spaced(16, 0.4), (*_SHORT, *_LONG))
_PULL, _SIDE = {"t1": 1.5}, {"tip": Load(LENGTH, (0.05, 0.0, 0.0))}
_SEGMENTS = {"a0": 1.5, "b0": 1.2}

#: Closed forms; and the equations, solved at tight tolerance, of SvenLilge/tdcr-modeling (C++, Rao et al. 2021) and
#: TIMClab-CAMI (MATLAB, Tummers et al. 2023).
KNOWN: dict[str, tuple[Known, ...]] = {
    "closed": (_half_circle(), _elastica(), _helix(), _arc()),
    "literature": (
        Known("12 bays, 1.5 N", _UP, "straight", (0.0, 0.116729591, 0.208913102), _PULL),
        Known("1.5 N, tip force", _UP, "continuous", (0.114854092, 0.091730689, 0.183677266), _PULL, _SIDE),
        Known("two segments", _TWO, "continuous", (0.128612154, 0.232111762, 0.265667176), _SEGMENTS),
        Known("helical, 1.2 N", _WINDING, "continuous", (2.5530e-5, 0.015802078, 0.249006139), {"t1": 1.2}),
        Known("converging, tip force", _NEARING, "continuous", (0.157687722, 0.0, 0.178131348), _PULL, _SIDE),
    ),
}

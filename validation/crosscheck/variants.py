"""Cases of the cross-validation for the remaining properties of a description."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType
from typing import Any

import numpy as np

from tdcr_fe.model.backbone import StiffnessPatch, Superelastic
from tdcr_fe.model.loading import Load, LoadStep, Model
from tdcr_fe.model.robot import Robot
from tdcr_fe.validation.crosscheck.case import (
    ELEMENTS_PER_BAY,
    GRAVITY,
    LENGTH,
    Case,
    make_load,
    make_robot,
)

#: Model options of tendons that follow the backbone.
_CONTINUOUS = {"tendon_path": "continuous", "friction": "none"}

#: A tip force out of the plane of bending, and its name.
_SIDE, _SIDE_NAME = make_load("tip out of plane")[0], "tip out of plane"


def _case(name: str, robot: Robot, steps: Sequence[LoadStep], load: str = "no load", **model: Any) -> Case:
    options = {"elements_per_bay": ELEMENTS_PER_BAY, **model}
    return Case(
        f"variant_{name}", "variant", robot.name, load, robot, Model(**options), tuple(steps), quick=True
    )


def _up_and_down(loads: Mapping[str, Load] = MappingProxyType({}), most: float = 3.0) -> list[LoadStep]:
    """Loading, unloading, reloading of the tendon up to a tension [N], under loads that stay."""
    return [
        LoadStep(f"{x * most:g} N", {"t1": x * most}, loads=dict(loads), substeps=4)
        for x in (0.4, 1.0, 0.5, 0.1, 0.8)
    ]


def _by_displacement(most: float) -> list[LoadStep]:
    """The same with the tendon's displacement prescribed, up to a largest one [m]."""
    return [
        LoadStep(f"{1e3 * x * most:g} mm", displacements={"t1": x * most}, substeps=4)
        for x in (0.4, 1.0, 0.7, 0.2, 0.8)
    ]


def _tendons() -> Iterator[Case]:
    """Prescribed displacements and elastic tendons."""
    elastic, helical, converging = (
        make_robot(r, 15).with_tendons(axial_stiffness=400.0) for r in ("parallel", "helical", "converging")
    )
    yield _case("displacement-driven", make_robot("parallel", 15), _by_displacement(8e-3))
    yield _case("displacement-driven-elastic-tendon", elastic, _by_displacement(9e-3))
    yield _case("displacement-driven-continuous", elastic, _by_displacement(9e-3), **_CONTINUOUS)
    yield _case("elastic-tendon", converging, _up_and_down(_SIDE), _SIDE_NAME)
    yield _case("elastic-tendon-helical", helical, _up_and_down(_SIDE), _SIDE_NAME)


def _backbones() -> Iterator[Case]:
    """Thick disks, precurvature, superelasticity."""
    parallel, helical, converging = (make_robot(r, 15) for r in ("parallel", "helical", "converging"))
    bent = {"precurvature": (3.0, -2.0)}
    soft = Superelastic(0.002, 0.2)
    yield _case("thick-disks", parallel.with_disks(thickness=4.5e-3), _up_and_down(_SIDE), _SIDE_NAME)
    yield _case("thick-disks-helical", helical.with_disks(thickness=4.5e-3), _up_and_down())
    yield _case("precurved", parallel.with_backbone(**bent), _up_and_down(_SIDE), _SIDE_NAME)
    yield _case("precurved-continuous", helical.with_backbone(**bent), _up_and_down(), **_CONTINUOUS)
    yield _case("superelastic", parallel.with_backbone(superelastic=soft), _up_and_down(most=2.0))
    yield _case(
        "superelastic-tip-force",
        converging.with_backbone(superelastic=soft),
        _up_and_down(_SIDE, 2.0),
        _SIDE_NAME,
    )


def _friction_and_masses() -> Iterator[Case]:
    """Adhesion at the holes, a mass at the tip, a soft stretch of the backbone."""
    parallel, helical, converging = (make_robot(r, 15) for r in ("parallel", "helical", "converging"))
    yield _case("adhesion", parallel.with_tendons(adhesion=0.05), _up_and_down())
    adhesion_only = helical.with_tendons(adhesion=0.05, friction_coefficient=0.0)
    yield _case("adhesion-only", adhesion_only, _up_and_down())
    yield _case("tip-mass", replace(parallel, tip_mass=3e-3), _up_and_down(), "gravity", gravity=GRAVITY)
    patch = (StiffnessPatch(0.1, 0.13, 0.6, 0.8),)
    yield _case("stiffness-patch", converging.with_backbone(patches=patch), _up_and_down(_SIDE), _SIDE_NAME)


def _loads_and_disks() -> Iterator[Case]:
    """Follower loads, a moment between two disks, disks at uneven distances, tendons that nobody pulls."""
    parallel = make_robot("parallel", 15)
    follower = Load(LENGTH, (0.02, 0.05, 0.0), (2e-3, 0.0, 1e-3), frame="section")
    couple = Load(0.11, (0.0, 0.0, 0.0), (0.0, 4e-3, 2e-3))
    spaced = tuple(float(x) for x in LENGTH * (np.arange(1, 13) / 12.0) ** 1.2)
    uneven = replace(parallel, disks=replace(parallel.disks, positions=spaced))
    yield _case(
        "follower-load", parallel, _up_and_down({"tip": follower}), "force and moment that follow the tip"
    )
    yield _case("moment-in-a-bay", parallel, _up_and_down({"couple": couple}), "moment between two disks")
    yield _case("uneven-disks", uneven, _up_and_down(_SIDE), _SIDE_NAME)
    yield _case("no-tendon-pulled", parallel, [LoadStep("force", loads=_SIDE, substeps=2)], _SIDE_NAME)


def variants() -> Iterator[Case]:
    """Cases for the remaining properties of a description."""
    yield from _tendons()
    yield from _backbones()
    yield from _friction_and_masses()
    yield from _loads_and_disks()

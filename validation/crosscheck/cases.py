"""The cases of the cross-validation: all routings, models, loads and numbers of disks; histories; variants."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import product

import numpy as np

from tdcr_fe.model.loading import Load, LoadStep, Model
from tdcr_fe.model.robot import Robot
from tdcr_fe.model.routing import ParallelRouting
from tdcr_fe.model.tendon import Tendon
from tdcr_fe.validation.crosscheck.case import (
    DISKS,
    ELEMENTS_PER_BAY,
    LOADS,
    MODELS,
    MU,
    PLANE_DEG,
    ROUTINGS,
    Case,
    highest_tension,
    make_load,
    make_robot,
    pulls,
)
from tdcr_fe.validation.crosscheck.variants import variants


def grid() -> Iterator[Case]:
    """Routings x models x loads x numbers of disks: three levels up, one down."""
    for (r, routing), (m, (path, friction)), (k, load) in product(
        enumerate(ROUTINGS), enumerate(MODELS), enumerate(LOADS)
    ):
        for i, disks in enumerate(DISKS):
            loads, gravity = make_load(load)
            total = highest_tension(disks)
            substeps = 1 if friction == "none" else 4
            steps = tuple(
                LoadStep(
                    f"{share:g} of the highest tension",
                    pulls(routing, share, total),
                    loads=loads,
                    substeps=substeps,
                )
                for share in (0.3, 0.65, 1.0, 0.5)
            )
            yield Case(
                f"{routing}_{path}_{friction}_{load.replace(' ', '-')}_{disks}",
                "grid",
                routing,
                load,
                make_robot(routing, disks),
                Model(path, friction, ELEMENTS_PER_BAY, gravity),  # type: ignore[arg-type]
                steps,
                quick=i == (r + m + k) % len(DISKS),
            )


def large_bending() -> Iterator[Case]:
    """Tips turned far beyond 180 degrees."""
    for (path, friction), disks in product(MODELS, (15, 20)):
        most = 5.5 if friction == "none" else 8.0
        substeps = 1 if friction == "none" else 4
        yield Case(
            f"large_parallel_{path}_{friction}_{disks}",
            "large bending",
            "parallel",
            "no load",
            make_robot("parallel", disks),
            Model(path, friction, ELEMENTS_PER_BAY),  # type: ignore[arg-type]
            tuple(
                LoadStep(f"{t:g} N", {"t1": t}, substeps=substeps)
                for t in most * np.array([0.25, 0.5, 0.75, 1.0])
            ),
            quick=disks == 20,
        )


#: Loading, unloading, reloading, as shares of the highest tension.
CYCLE = (0.35, 0.7, 1.0, 0.8, 0.5, 0.2, 0.0, 0.3, 0.7, 1.0)


def _cycle(routing: str, total: float, loads: dict[str, Load]) -> tuple[LoadStep, ...]:
    return tuple(
        LoadStep(f"{share:g} of the highest tension", pulls(routing, share, total), loads=loads, substeps=4)
        for share in CYCLE
    )


def _antagonists(disks: int, mu: float = MU) -> Robot:
    tendons = tuple(Tendon(f"t{i}", ParallelRouting(4.5e-3, PLANE_DEG + 90.0 * i), mu) for i in range(4))
    return replace(make_robot("parallel", disks), tendons=tendons)


def histories() -> Iterator[Case]:
    """Loading, unloading and reloading; and four tendons pulled one against the other."""
    for routing, friction in product(ROUTINGS, ("per-tendon", "per-hole")):
        for disks, load in ((10, "no load"), (15, "tip out of plane"), (20, "gravity")):
            loads, gravity = make_load(load)
            yield Case(
                f"history_{routing}_{friction}_{load.replace(' ', '-')}_{disks}",
                "history",
                routing,
                load,
                make_robot(routing, disks),
                Model("straight", friction, ELEMENTS_PER_BAY, gravity),  # type: ignore[arg-type]
                _cycle(routing, highest_tension(disks), loads),
                quick=disks == 10,
            )
    for friction, disks in product(("per-tendon", "per-hole"), (10, 20)):
        turn = np.arange(12) * np.pi / 4.0
        levels = [
            {f"t{i}": float(0.4 + 0.9 * max(0.0, np.cos(a - i * np.pi / 2.0))) for i in range(4)}
            for a in turn
        ]
        yield Case(
            f"history_antagonists-circle_{friction}_{disks}",
            "history",
            "parallel",
            "no load",
            _antagonists(disks),
            Model("straight", friction, ELEMENTS_PER_BAY),  # type: ignore[arg-type]
            tuple(LoadStep(f"circle {k + 1}", t, substeps=4) for k, t in enumerate(levels)),
            quick=disks == 10,
        )
    for name, names, routing, disks in (
        ("antagonists", [f"t{i}" for i in range(4)], "parallel", 13),
        ("two-segment", ["a0", "a1", "a2", "b0", "b1", "b2"], "two-segment", 10),
    ):
        draw = np.random.default_rng(20)
        walk = [
            {n: float(t) for n, t in zip(names, draw.uniform(0.0, 6.0 / len(names), len(names)), strict=True)}
            for _ in range(8)
        ]
        robot = _antagonists(disks) if name == "antagonists" else make_robot(routing, disks)
        yield Case(
            f"history_{name}-walk_per-hole_{disks}",
            "history",
            routing,
            "no load",
            robot,
            Model("straight", "per-hole", ELEMENTS_PER_BAY),
            tuple(LoadStep(f"walk {k + 1}", t, substeps=6) for k, t in enumerate(walk)),
            quick=name == "two-segment",
        )


def all_cases() -> list[Case]:
    """Every case; those of the quick set are marked."""
    cases = [*grid(), *large_bending(), *histories(), *variants()]
    if len({case.id for case in cases}) != len(cases):
        raise RuntimeError("two cases have one id")
    return cases

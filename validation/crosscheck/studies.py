"""Studies in addition to the cases: finer meshes, compression of a bay, solutions known from elsewhere."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from tdcr_fe.elements import Array
from tdcr_fe.model.loading import LoadStep, Model
from tdcr_fe.model.robot import Robot
from tdcr_fe.solve.simulate import SolverSettings, simulate
from tdcr_fe.validation.crosscheck.cases import (
    ELEMENTS_PER_BAY,
    LENGTH,
    LOADS,
    MODELS,
    ROUTINGS,
    all_cases,
    bay_buckling_load,
    highest_tension,
    make_robot,
    pulls,
)
from tdcr_fe.validation.crosscheck.compare import PRESLIDING
from tdcr_fe.validation.crosscheck.known import KNOWN
from tdcr_fe.validation.records import Record
from tdcr_fe.validation.reference import ReferenceSettings, solve_reference


@dataclass(frozen=True)
class Study:
    """One study, of a kind; its record has what `run` returns."""

    id: str
    kind: str  # "mesh", "buckling", "closed" or "literature"
    run: Callable[[], Record] = field(repr=False)
    quick: bool = False  # part of the quick set


def all_studies() -> list[Study]:
    """Every study."""
    studies = []
    for i, routing in enumerate(ROUTINGS):
        for k, (path, friction) in enumerate(MODELS):
            run = partial(mesh_convergence, routing, path, friction)
            quick = k in (i % 4, (i + 3) % 4)
            studies.append(Study(f"mesh_{routing}_{path}_{friction}", "mesh", run, quick))
    for k, c in enumerate(NEAR_BUCKLING):
        studies.append(Study(f"buckling_{c}", "buckling", partial(near_buckling, c), k < 2))
    for kind, robots in KNOWN.items():
        studies += [Study(f"{kind}_{i}", kind, partial(known_tip, kind, i), True) for i in range(len(robots))]
    return studies


def tips(robot: Robot, model: Model, steps: Sequence[LoadStep], meshes: Sequence[int]) -> tuple[Array, Array]:
    """Tips by the reference, shape (n_steps, 3), and by finite elements on several meshes, (n_meshes, n_steps, 3) [m].

    Raises
    ------
    RuntimeError
        A solver did not converge.
    """
    settings = SolverSettings(presliding=PRESLIDING)
    exact = solve_reference(robot, model, steps, settings=ReferenceSettings(presliding=PRESLIDING))
    found = [simulate(robot, replace(model, elements_per_bay=n), steps, settings) for n in meshes]
    return exact.raise_if_failed().tips, np.array([r.raise_if_failed().tips for r in found])


# ------------------------------------------------------------------------------------------- convergence

#: Elements per bay of the mesh study.
MESHES = (2, 4, 8, 16)
#: Accuracy of the reference over the length; smaller deviations are left out of the convergence order [1].
FLOOR = 2e-8


def observed_order(sizes: Array, errors: Array) -> float:
    """Slope of log error over log size, of the errors above `FLOOR`; NaN where fewer than two are."""
    use = errors > FLOOR
    return float(np.polyfit(np.log(sizes[use]), np.log(errors[use]), 1)[0]) if use.sum() > 1 else np.nan


def mesh_convergence(routing: str, path: str, friction: str) -> Record:
    """Tip deviation from the reference over elements per bay; ten disks, tip force out of plane."""
    tensions = pulls(routing, highest_tension(10), 0.75)
    pull = LoadStep("pull", tensions, loads=LOADS["tip out of plane"], substeps=2)
    model = Model(path, friction)  # type: ignore[arg-type]
    exact, found = tips(make_robot(routing, 10), model, [pull], MESHES)
    errors = np.linalg.norm(found[:, -1] - exact[-1], axis=1) / LENGTH
    order, between = observed_order(1.0 / np.array(MESHES), errors), np.log2(errors[:-1] / errors[1:])
    made = {"routing": routing, "tendon_path": path, "friction": friction, "elements_per_bay": MESHES}
    return {**made, "deviation_percent": 100.0 * errors, "order": order, "orders_between": between}


# ---------------------------------------------------------------------------------- compression of a bay

#: Cases with few disks that differ most as the tension rises; the first two are part of the quick set.
NEAR_BUCKLING = (
    "parallel_straight_none_tip-in-plane_5",
    "helical_straight_none_mid-span_5",
    "helical_straight_none_gravity_5",
    "parallel_straight_none_no-load_5",
    "two-segment_straight_none_tip-in-plane_5",
)
#: Sum of the tensions over the buckling load of a bay [1].
COMPRESSIONS = (0.1, 0.2, 0.3, 0.4, 0.5)


def near_buckling(case_id: str) -> Record:
    """Deviation of the tip, worst step, in a case whose highest tension nears the buckling load of a bay.

    With the mesh of all cases, and with twice as many elements.
    """
    case = next(c for c in all_cases() if c.id == case_id)
    meshes, load = (ELEMENTS_PER_BAY, 2 * ELEMENTS_PER_BAY), bay_buckling_load(case.disks)
    deviations = []
    for share in COMPRESSIONS:
        factor = share * load / highest_tension(case.disks)
        tensions = [{name: factor * t for name, t in s.tensions.items()} for s in case.steps]
        steps = [replace(s, tensions=x) for s, x in zip(case.steps, tensions, strict=True)]
        exact, found = tips(case.robot, case.model, steps, meshes)
        deviations.append(100.0 * np.linalg.norm(found - exact, axis=2).max(axis=1) / LENGTH)
    made = {"case": case_id, "load": load, "shares": COMPRESSIONS, "elements_per_bay": meshes}
    return {**made, "deviation_percent": np.transpose(deviations)}


# ------------------------------------------------------------------------------------- known solutions


def known_tip(kind: str, number: int) -> Record:
    """One of `KNOWN` with both solvers: with the mesh of all cases, and with 16 elements per bay."""
    x, meshes = KNOWN[kind][number], (ELEMENTS_PER_BAY, 16)
    model = Model(x.path, "none")  # type: ignore[arg-type]
    ref, found = tips(x.robot, model, [LoadStep("", x.tensions, loads=x.loads)], meshes)
    percent = 100.0 / x.robot.backbone.length
    made = {"title": x.title, "tip": x.tip, "tip_reference": ref[-1], "elements_per_bay": meshes}
    made["reference_percent"] = percent * np.linalg.norm(ref[-1] - x.tip)
    return {**made, "deviation_percent": percent * np.linalg.norm(found[:, -1] - x.tip, axis=1)}

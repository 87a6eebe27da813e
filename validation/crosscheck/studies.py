"""Studies in addition to the cases: mesh convergence, compression of a bay, results of other codes, closed forms."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np

from tdcr_fe.model.backbone import Backbone
from tdcr_fe.model.loading import Load, LoadStep, Model
from tdcr_fe.model.results import SequenceResult, StepResult
from tdcr_fe.model.robot import Disks, Robot
from tdcr_fe.model.routing import ConvergingRouting, HelicalRouting, ParallelRouting
from tdcr_fe.model.tendon import Tendon
from tdcr_fe.solve.simulate import SolverSettings, simulate
from tdcr_fe.validation.crosscheck.cases import (
    BACKBONE,
    ELEMENTS_PER_BAY,
    LENGTH,
    MODELS,
    PRESLIDING,
    ROUTINGS,
    Case,
    all_cases,
    bay_buckling_load,
    highest_tension,
    make_load,
    make_robot,
    pulls,
)
from tdcr_fe.validation.crosscheck.compare import compare
from tdcr_fe.validation.reference import ReferenceSettings, solve_reference
from tdcr_fe.validation.reference.closed_forms import constant_strain, elastica_tip, helix_wrench

Record = dict[str, Any]

#: Elements per bay of the mesh study.
MESHES = (2, 4, 8, 16)
#: Accuracy of the reference over the length; smaller deviations are left out of the convergence order [1].
FLOOR = 2e-8


@dataclass(frozen=True)
class Study:
    """One study."""

    id: str
    kind: str  # names the function, see `run_study`
    arguments: tuple[Any, ...] = ()
    quick: bool = False  # part of the quick set


def all_studies() -> list[Study]:
    """Every study."""
    studies = []
    for i, routing in enumerate(ROUTINGS):
        for k, (path, friction) in enumerate(MODELS):
            name, quick = f"mesh_{routing}_{path}_{friction}", k in (i % 4, (i + 3) % 4)
            studies.append(Study(name, "mesh", (routing, path, friction), quick))
    studies += [Study(f"buckling_{c}", "buckling", (c,), k < 2) for k, c in enumerate(NEAR_BUCKLING)]
    studies += [Study(f"literature_{i}", "literature", (i,), True) for i in range(len(LITERATURE))]
    studies += [Study(f"closed_{i}", "closed", (name,), True) for i, name in enumerate(CLOSED_FORMS)]
    return studies


def run_study(study: Study) -> Record:
    """Run a study; returns plain numbers, ready for JSON."""
    functions: dict[str, Callable[..., Record]] = {
        "mesh": mesh_convergence,
        "buckling": near_buckling,
        "literature": literature,
        "closed": closed_form,
    }
    return {"id": study.id, "kind": study.kind, **functions[study.kind](*study.arguments)}


def _both(robot: Robot, model: Model, steps: list[LoadStep]) -> tuple[SequenceResult, SequenceResult]:
    fe = simulate(robot, model, steps, SolverSettings(presliding=PRESLIDING))
    ref = solve_reference(robot, model, steps, settings=ReferenceSettings(presliding=PRESLIDING))
    for name, result in (("finite elements", fe), ("reference", ref)):
        if not result.converged:
            raise RuntimeError(f"{name}: {result.message}")
    return fe, ref


def _gap(a: StepResult, b: StepResult, length: float) -> float:
    return float(np.linalg.norm(a.tip - b.tip)) / length


# ------------------------------------------------------------------------------------------- convergence


def observed_order(sizes: list[float], errors: list[float]) -> float:
    """Slope of log error over log size, of the errors above `FLOOR`; NaN where fewer than two are."""
    use = [(h, e) for h, e in zip(sizes, errors, strict=True) if e > FLOOR]
    if len(use) < 2:
        return float("nan")
    h, e = np.log(np.array(use)).T
    return float(np.polyfit(h, e, 1)[0])


def mesh_convergence(routing: str, path: str, friction: str) -> Record:
    """Tip deviation from the reference over elements per bay; ten disks, tip force out of plane."""
    loads, _ = make_load("tip out of plane")
    robot = make_robot(routing, 10)
    steps = [LoadStep("pull", pulls(routing, 0.75, highest_tension(10)), loads=loads, substeps=2)]
    errors, orientations = [], []
    model = Model(path, friction)  # type: ignore[arg-type]
    ref = solve_reference(
        robot, model, steps, settings=ReferenceSettings(presliding=PRESLIDING, max_step=0.015)
    )
    for n in MESHES:
        fe = simulate(robot, replace(model, elements_per_bay=n), steps, SolverSettings(presliding=PRESLIDING))
        if not (fe.converged and ref.converged):
            raise RuntimeError(f"{fe.message}; {ref.message}")
        errors.append(_gap(fe.steps[-1], ref.steps[-1], LENGTH))
        cosine = float(np.dot(fe.steps[-1].tangent, ref.steps[-1].tangent))
        sine = float(np.linalg.norm(np.cross(fe.steps[-1].tangent, ref.steps[-1].tangent)))
        orientations.append(float(np.degrees(np.arctan2(sine, cosine))))
    sizes = [1.0 / n for n in MESHES]
    steepness = [float(np.log2(a / b)) for a, b in pairwise(errors)]
    return {
        "routing": routing,
        "tendon_path": path,
        "friction": friction,
        "elements_per_bay": list(MESHES),
        "deviation_percent": [100.0 * e for e in errors],
        "orientation_deg": orientations,
        "order": observed_order(sizes, errors),
        "orders_between": steepness,
    }


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
    """Deviation of the tip in a case of the grid whose highest tension nears the buckling load of a bay.

    With the mesh of all cases, and with twice as many elements. Three levels up and one down, as in the case.
    """
    case: Case = next(c for c in all_cases() if c.id == case_id)
    load = bay_buckling_load(case.disks)
    meshes = (ELEMENTS_PER_BAY, 2 * ELEMENTS_PER_BAY)
    deviations: list[list[float]] = [[] for _ in meshes]
    bending: list[list[float]] = []
    for share in COMPRESSIONS:
        factor = share * load / highest_tension(case.disks)
        steps = tuple(
            replace(s, tensions={name: factor * t for name, t in s.tensions.items()}) for s in case.steps
        )
        for n, found in zip(meshes, deviations, strict=True):
            record = compare(replace(case, steps=steps, model=replace(case.model, elements_per_bay=n)))
            if not record["converged"]:
                raise RuntimeError(f"{share:g} of the buckling load: {'; '.join(record['reasons'])}")
            found.append(record["deviation_percent"])
        bending.append([s["turned_deg"] for s in record["steps"]])
    return {
        "case": case_id,
        "routing": case.routing,
        "load": case.load,
        "disks": case.disks,
        "shares": list(COMPRESSIONS),
        "tension": [share * load for share in COMPRESSIONS],
        "elements_per_bay": list(meshes),
        "deviation_percent": deviations,
        "bending_deg": bending,
    }


# -------------------------------------------------------------------------------- figures of other codes

_SIDE = {"tip": Load(LENGTH, (0.05, 0.0, 0.0))}
_PLAIN = replace(BACKBONE, density=0.0)


def _single(routing: Any, disks: int = 12, length: float = LENGTH) -> Robot:
    backbone = replace(_PLAIN, length=length)
    return Robot(backbone, Disks.equally_spaced(disks, length), (Tendon("t1", routing),))


_TWO = Robot(
    replace(_PLAIN, length=0.4),
    Disks.equally_spaced(16, 0.4),
    tuple(Tendon(f"a{i}", ParallelRouting(4.5e-3, a), end=0.15) for i, a in enumerate((90.0, -30.0, 210.0)))
    + tuple(Tendon(f"b{i}", ParallelRouting(3e-3, a)) for i, a in enumerate((30.0, 150.0, 270.0))),
)

#: Title, robot, tendon path, load step, tip [m], tip tangent: solved at tight tolerance with the equations of
#: SvenLilge/tdcr-modeling (C++, Rao et al. 2021) and TIMClab-CAMI (MATLAB, Tummers et al. 2023).
LITERATURE: tuple[tuple[str, Robot, str, LoadStep, tuple[float, ...], tuple[float, ...]], ...] = (
    (
        "12 equal bays, straight, one tendon at +y, 1.5 N",
        _single(ParallelRouting(4.5e-3, 90.0)),
        "straight",
        LoadStep(tensions={"t1": 1.5}, substeps=1),
        (0.0, 0.116729591, 0.208913102),
        (0.0, 0.8516199, 0.5241598),
    ),
    (
        "continuous, one tendon at +y, 1.5 N, tip force 0.05 N",
        _single(ParallelRouting(4.5e-3, 90.0)),
        "continuous",
        LoadStep(tensions={"t1": 1.5}, loads=_SIDE, substeps=1),
        (0.114854092, 0.091730689, 0.183677266),
        (0.6498777, 0.6678782, 0.3627639),
    ),
    (
        "continuous, two segments 0.15 + 0.25 m, 1.5 and 1.2 N",
        _TWO,
        "continuous",
        LoadStep(tensions={"a0": 1.5, "b0": 1.2}, substeps=1),
        (0.128612154, 0.232111762, 0.265667176),
        (0.6075647, 0.7237992, 0.3270778),
    ),
    (
        "continuous, helical 720 degrees, 1.2 N",
        _single(HelicalRouting(4.5e-3, 2.0)),
        "continuous",
        LoadStep(tensions={"t1": 1.2}, substeps=1),
        (2.5530e-5, 0.015802078, 0.249006139),
        (-0.0124805, 0.0012600, 0.9999213),
    ),
    (
        "continuous, converging 4.5 to 0.15 mm, 1.5 N, tip force 0.05 N",
        _single(ConvergingRouting(4.5e-3, 0.15e-3)),
        "continuous",
        LoadStep(tensions={"t1": 1.5}, loads=_SIDE, substeps=1),
        (0.157687722, 0.0, 0.178131348),
        (0.8763387, 0.0, 0.4816954),
    ),
)


def literature(number: int) -> Record:
    """One of `LITERATURE` with both solvers."""
    title, robot, path, step, tip, tangent = LITERATURE[number]
    length = robot.backbone.length
    record: Record = {"title": title, "tip": list(tip), "tangent": list(tangent)}
    for n in (ELEMENTS_PER_BAY, 16):
        fe, ref = _both(robot, Model(path, "none", n), [step])  # type: ignore[arg-type]
        key = "finite_element" if n == ELEMENTS_PER_BAY else "finite_element_fine"
        record[f"tip_{key}"] = fe.steps[-1].tip.tolist()
        record[f"{key}_percent"] = 100.0 * float(np.linalg.norm(fe.steps[-1].tip - tip)) / length
        record["tip_reference"] = ref.steps[-1].tip.tolist()
        record["reference_percent"] = 100.0 * float(np.linalg.norm(ref.steps[-1].tip - tip)) / length
        record["tangent_reference"] = float(np.linalg.norm(ref.steps[-1].tangent - tangent))
    return record


# ------------------------------------------------------------------------------------------ closed forms

_STIFF = Backbone(LENGTH, 0.4e-3, 85e9, 0.3, axial_stiffness=1e8, shear_stiffness=1e8)


def _rod(backbone: Backbone) -> Robot:
    return Robot(backbone, Disks.equally_spaced(10, LENGTH))


def _pure_moment() -> tuple[Robot, Model, list[LoadStep], list[float]]:
    moment = np.pi * _PLAIN.EI / LENGTH
    steps = [LoadStep("half a circle", loads={"tip": Load(LENGTH, moment=(0.0, moment, 0.0))}, substeps=1)]
    return _rod(_PLAIN), Model("straight", "none"), steps, [2.0 * LENGTH / np.pi, 0.0, 0.0]


def _elastica() -> tuple[Robot, Model, list[LoadStep], list[float]]:
    force = 4.0 * _STIFF.EI / LENGTH**2
    across, along, _ = elastica_tip(LENGTH, _STIFF.EI, force)
    steps = [LoadStep("4 EI/L^2", loads={"tip": Load(LENGTH, (force, 0.0, 0.0))}, substeps=1)]
    return _rod(_STIFF), Model("straight", "none"), steps, [across, 0.0, along]


def _helix() -> tuple[Robot, Model, list[LoadStep], list[float]]:
    turn, twist = 12.0, 9.0
    backbone = replace(_PLAIN, axial_stiffness=1e5, shear_stiffness=1e5)
    wrench = helix_wrench(turn, twist, backbone.EI, backbone.GJ)
    strain = np.concatenate(([0.0, turn, twist], [0.0, 0.0, 1.0] + wrench[3:] / 1e5))
    tip = constant_strain(strain, LENGTH)[1]
    load = Load(LENGTH, tuple(wrench[3:]), tuple(wrench[:3]), frame="section")
    return (
        _rod(backbone),
        Model("straight", "none"),
        [LoadStep("helix", loads={"tip": load}, substeps=8)],
        tip.tolist(),
    )


def _classical_arc() -> tuple[Robot, Model, list[LoadStep], list[float]]:
    robot, tension, offset = _single(ParallelRouting(4.5e-3, 0.0)), 3.0, 4.5e-3
    strain = np.array([0.0, tension * offset / _PLAIN.EI, 0.0, 0.0, 0.0, 1.0 - tension / _PLAIN.EA])
    tip = constant_strain(strain, LENGTH)[1]
    return robot, Model("continuous", "none"), [LoadStep("3 N", {"t1": tension}, substeps=1)], tip.tolist()


#: Robots, models and loads whose tip is known in closed form.
CLOSED_FORMS: dict[str, Callable[[], tuple[Robot, Model, list[LoadStep], list[float]]]] = {
    "moment at the tip, half a circle": _pure_moment,
    "elastica, force across the tip of 4 EI/L^2 (elliptic integrals)": _elastica,
    "helix of constant strain": _helix,
    "classical tendon, arc of constant curvature T r/EI": _classical_arc,
}


def closed_form(name: str) -> Record:
    """One of `CLOSED_FORMS` with both solvers."""
    robot, model, steps, tip = CLOSED_FORMS[name]()
    fe, ref = _both(robot, replace(model, elements_per_bay=ELEMENTS_PER_BAY), steps)
    deviation = {
        side: float(np.linalg.norm(result.steps[-1].tip - tip)) / LENGTH
        for side, result in (("finite_element", fe), ("reference", ref))
    }
    return {
        "title": name,
        "tip": list(tip),
        "tip_finite_element": fe.steps[-1].tip.tolist(),
        "tip_reference": ref.steps[-1].tip.tolist(),
        **{f"{side}_percent": 100.0 * d for side, d in deviation.items()},
    }

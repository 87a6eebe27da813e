"""Compare both solvers on one case: deviations of shape, orientation, tensions and hole states."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tdcr_fe.model.results import SequenceResult, StepResult
from tdcr_fe.model.robot import Robot
from tdcr_fe.solve.simulate import PathRecord, SolverSettings, simulate
from tdcr_fe.validation.crosscheck.cases import PRESLIDING, Case
from tdcr_fe.validation.fuzz.rod import courses
from tdcr_fe.validation.reference import ReferenceSettings, solve_reference

Array = NDArray[np.float64]
Record = dict[str, Any]

#: A hole whose states differ is at the stick-slip threshold where both mobilisations are within this of each other ...
THRESHOLD_MOBILISATION = 0.01
#: ... or where it moved less than this in the load step [m], a tenth of the presliding distance.
THRESHOLD_SLIP = 0.1 * PRESLIDING
#: Tensions below this share of the highest in the sequence are not compared [1].
SLACK = 1e-6


def compare(case: Case) -> Record:
    """Solve a case with both solvers and compare the solutions.

    Parameters
    ----------
    case
        The case.

    Returns
    -------
    dict
        Plain numbers, strings and lists, ready for JSON. ``steps`` has one entry per load step that both solved;
        the other keys are worst values over them.
    """
    fe, ref, friction = _solve_both(case)
    tops = _highest_tensions(case.robot, ref)
    steps = [
        _compare_step(case, a, b, hole, tops)
        for a, b, hole in zip(fe.steps, ref.steps, friction, strict=False)
    ]
    worst = max(range(len(steps)), key=lambda i: steps[i]["tip_percent"]) if steps else None
    off = [hole for s in steps for hole in s["holes_differing"] if not hole["at_threshold"]]
    largest = {key: max((s[key] for s in steps), default=float("nan")) for key in (*_LARGEST, *_BOUNDS)}
    reasons = _reasons(case, fe, ref, largest["tip_percent"], largest["tension_percent"], len(off))
    return {
        "id": case.id,
        "group": case.group,
        "routing": case.routing,
        "tendon_path": case.model.tendon_path,
        "friction": case.model.friction,
        "load": case.load,
        "disks": case.disks,
        "converged": fe.converged and ref.converged,
        "tip_finite_element": steps[worst]["tip_finite_element"] if worst is not None else None,
        "tip_reference": steps[worst]["tip_reference"] if worst is not None else None,
        "worst_step": None if worst is None else worst + 1,
        "deviation_percent": largest["tip_percent"],
        "tolerance_percent": case.tolerance_percent,
        "shape_percent": largest["shape_percent"],
        "orientation_deg": largest["orientation_deg"],
        "tension_percent": largest["tension_percent"],
        "tension_tolerance_percent": case.tension_tolerance_percent,
        "displacement_percent": largest["displacement_percent"],
        "largest_bending_deg": largest["turned_deg"],
        "holes": sum(s["holes"] for s in steps),
        "holes_differing": sum(len(s["holes_differing"]) for s in steps),
        "holes_differing_off_threshold": len(off),
        "same_path": all(s["substeps_finite_element"] == s["substeps_reference"] for s in steps),
        "bounds": {key: largest[key] for key in _BOUNDS},
        "iterations_finite_element": sum(s["iterations_finite_element"] for s in steps),
        "iterations_reference": sum(s["iterations_reference"] for s in steps),
        "substeps": sum(s["substeps_reference"] for s in steps),
        "time_finite_element": fe.wall_time,
        "time_reference": ref.wall_time,
        "passed": not reasons,
        "reasons": reasons,
        "steps": steps,
        "tendons": list(case.robot.tendon_names),
    }


class _Friction(NamedTuple):
    """Friction state of the finite elements at the end of a load step, both of shape (n_tendons, n_variables)."""

    mobilisation: Array  # [1]
    slip: Array  # in this load step [m]


def _solve_both(case: Case) -> tuple[SequenceResult, SequenceResult, list[_Friction]]:
    """Results of finite elements and reference, and the friction states of the former, one a solved step."""
    path: PathRecord = []
    settings = SolverSettings(presliding=PRESLIDING)
    fe = simulate(case.robot, case.model, case.steps, settings, record_path=path)
    # The reference is sampled at the nodes of the finite elements.
    nodes = tuple(float(x) for x in fe.steps[0].s) if fe.steps else ()
    ref = solve_reference(
        case.robot, case.model, case.steps, settings=ReferenceSettings(presliding=PRESLIDING, sample_at=nodes)
    )
    friction: list[_Friction] = []
    before: Array | float = 0.0
    for increments in path[: len(fe.steps)]:
        state = increments[-1].state.friction[0]
        friction.append(_Friction(state.mobilisation, state.slip - before))
        before = state.slip
    return fe, ref, friction


def _reasons(
    case: Case, fe: SequenceResult, ref: SequenceResult, deviation: float, tension: float, off: int
) -> list[str]:
    """Why a case fails, in sentences; empty where it passes."""
    reasons = []
    if not fe.converged:
        reasons.append(f"finite elements: {fe.message}")
    if not ref.converged:
        reasons.append(f"reference: {ref.message}")
    if fe.converged and ref.converged:
        if not deviation <= case.tolerance_percent:
            reasons.append(f"tip deviates by {deviation:.4f} % of the length")
        if not tension <= case.tension_tolerance_percent:
            reasons.append(f"a tension deviates by {tension:.3f} %")
    if off:
        reasons.append(f"{off} hole states differ that are not at the stick-slip threshold")
    return reasons


#: Of a step's values, those of which a case has the largest.
_LARGEST = (
    "tip_percent",
    "shape_percent",
    "orientation_deg",
    "tension_percent",
    "displacement_percent",
    "turned_deg",
)
_BOUNDS = ("outside_finite_element", "outside_reference", "off_bound_finite_element", "off_bound_reference")


def _highest_tensions(robot: Robot, result: SequenceResult) -> Array:
    """Highest tension of every tendon in the sequence [N]."""
    return np.array(
        [
            max((float(np.max(s.tensions[i])) for s in result.steps), default=0.0)
            for i in range(len(robot.tendons))
        ]
    )


def _compare_step(case: Case, a: StepResult, b: StepResult, friction: _Friction, tops: Array) -> Record:
    """One load step, of the finite elements and of the reference."""
    return {
        "label": b.label,
        **_compare_shapes(case, a, b),
        "tension_percent": _tension_deviation(a, b, tops),
        "displacement_percent": 100.0
        * float(np.max(np.abs(a.displacements - b.displacements), initial=0.0))
        / case.robot.backbone.length,
        "iterations_finite_element": a.iterations,
        "iterations_reference": b.iterations,
        "substeps_finite_element": a.substeps,
        "substeps_reference": b.substeps,
        "base_tensions": b.base_tensions.tolist(),
        "base_tensions_finite_element": a.base_tensions.tolist(),
        "displacements_finite_element": a.displacements.tolist(),
        "displacements_reference": b.displacements.tolist(),
        "tensions_finite_element": [x.tolist() for x in a.tensions],
        "tensions_reference": [x.tolist() for x in b.tensions],
        **_compare_friction(case, a, b, friction, tops),
    }


def _compare_shapes(case: Case, a: StepResult, b: StepResult) -> Record:
    """Positions and orientations of the nodes."""
    length = case.robot.backbone.length
    index = np.array([int(np.argmin(np.abs(b.s - s))) for s in a.s])
    if np.max(np.abs(b.s[index] - a.s)) > 1e-9:
        raise RuntimeError(f"{case.id}: the reference was not sampled at the nodes")
    gap = np.linalg.norm(a.positions - b.positions[index], axis=1)
    turn = np.degrees(_angles_between(a.rotations, b.rotations[index]))
    return {
        "tip_finite_element": a.tip.tolist(),
        "tip_reference": b.tip.tolist(),
        "tip_percent": 100.0 * float(gap[-1]) / length,
        "shape_percent": 100.0 * float(np.max(gap)) / length,
        "orientation_deg": float(np.max(turn)),
        "tip_orientation_deg": float(turn[-1]),
        "bending_deg": float(np.degrees(b.bending_angle)),
        "turned_deg": _swept_angle(b),
        "s": a.s.tolist(),
        "shape_finite_element": a.positions.round(9).tolist(),
        "shape_reference": b.positions[index].round(9).tolist(),
    }


def _angles_between(a: Array, b: Array) -> Array:
    """Angles of the relative rotations, shapes (n, 3, 3) to (n,) [rad]."""
    relative = np.swapaxes(a, 1, 2) @ b
    axial = [relative[:, i, j] - relative[:, j, i] for i, j in ((2, 1), (0, 2), (1, 0))]
    sine = 0.5 * np.linalg.norm(np.stack(axial, axis=1), axis=1)
    cosine = 0.5 * (np.trace(relative, axis1=1, axis2=2) - 1.0)
    return np.asarray(np.arctan2(sine, cosine))


def _tension_deviation(a: StepResult, b: StepResult, tops: Array) -> float:
    """Largest deviation of a segment's tension [% of the tendon's highest in this step], slack tendons left out."""
    worst = 0.0
    highest = float(np.max(tops, initial=0.0))
    for x, y in zip(a.tensions, b.tensions, strict=True):
        scale = float(np.max(y))
        if scale > SLACK * highest:
            worst = max(worst, 100.0 * float(np.max(np.abs(x - y))) / scale)
    return worst


def _compare_friction(case: Case, a: StepResult, b: StepResult, friction: _Friction, tops: Array) -> Record:
    """Hole states, mobilisations, dissipation, and the Capstan bounds of both solutions."""
    rough = case.model.friction != "none"
    record: Record = {
        "holes": sum(len(x) - 1 for x in b.hole_states) if rough else 0,
        "holes_differing": _differing(case, a, b, friction, tops) if rough else [],
    }
    for side, result in (("finite_element", a), ("reference", b)):
        outside, off = capstan(case, result) if rough else (0.0, 0.0)
        record[f"outside_{side}"], record[f"off_bound_{side}"] = outside, off
    return record


def _swept_angle(step: StepResult) -> float:
    """Angle that the tangent sweeps along the backbone [deg]; unlike the bending angle it may exceed 180."""
    tangents = step.rotations[:, :, 2]
    sine = np.linalg.norm(np.cross(tangents[:-1], tangents[1:]), axis=1)
    return float(np.degrees(np.sum(np.arctan2(sine, np.sum(tangents[:-1] * tangents[1:], axis=1)))))


def _of_holes(mobilisation: Array, count: int) -> Array:
    """Mobilisation at every hole of a tendon, shape (count,)."""
    if mobilisation.size == 0:
        return np.zeros(count)
    return np.full(count, mobilisation[0]) if mobilisation.size == 1 else mobilisation[:count]


def _differing(case: Case, a: StepResult, b: StepResult, friction: _Friction, tops: Array) -> list[Record]:
    """Holes whose states differ, and whether they are at the stick-slip threshold."""
    found: list[Record] = []
    mobilisation, moved = friction
    highest = float(np.max(tops, initial=0.0))
    for i, (mine, theirs) in enumerate(zip(a.hole_states, b.hole_states, strict=True)):
        share = b.details["mobilisation"][i]
        own, slip = _of_holes(mobilisation[i], len(share)), _of_holes(moved[i], len(share))
        for k, (x, y) in enumerate(zip(mine, theirs, strict=True)):
            if x == y:
                continue
            slack = max(a.tensions[i][k], b.tensions[i][k]) <= SLACK * highest
            at_threshold = (
                slack or abs(own[k] - share[k]) <= THRESHOLD_MOBILISATION or abs(slip[k]) <= THRESHOLD_SLIP
            )
            found.append(
                {
                    "tendon": case.robot.tendon_names[i],
                    "hole": k + 1,
                    "finite_element": x,
                    "reference": y,
                    "mobilisation_finite_element": float(own[k]),
                    "mobilisation_reference": float(share[k]),
                    "slip": float(slip[k]),
                    "at_threshold": bool(at_threshold),
                }
            )
    return found


def capstan(case: Case, step: StepResult) -> tuple[float, float]:
    """How far tensions violate the Capstan bounds, from the solved geometry and tensions alone.

    Returns
    -------
    tuple of float
        Largest excess beyond the bounds, and largest distance from its bound of a hole that slips, both relative
        to the tension before the hole.
    """
    outside = off = 0.0
    found = courses(case.robot, step.s, step.positions, step.rotations)
    for i, (tendon, course) in enumerate(zip(case.robot.tendons, found, strict=True)):
        tension = step.tensions[i]
        before, after = tension[:-1], tension[1:]
        factor = np.exp(tendon.friction_coefficient * course.angles)
        lower = np.maximum(0.0, before / factor - tendon.adhesion)
        upper = (before + tendon.adhesion) * factor
        states = np.array(step.hole_states[i][:-1])
        taut = before > 1e-6
        if not np.any(taut):
            continue
        scale = np.where(taut, before, np.inf)
        excess = np.maximum(np.maximum(after - upper, lower - after), 0.0) / scale
        bound = np.where(states == "pull", lower, upper)
        distance = np.where(states == "stick", 0.0, np.abs(after - bound)) / scale
        outside, off = max(outside, float(np.max(excess))), max(off, float(np.max(distance)))
    return outside, off

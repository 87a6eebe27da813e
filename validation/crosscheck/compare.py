"""What ``tdcr-fe validate`` compares on a case, and what may deviate: shape, orientation, tensions, hole states."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from tdcr_fe.elements import Array
from tdcr_fe.model.results import StepResult
from tdcr_fe.solve.simulate import PathRecord, SolverSettings, simulate
from tdcr_fe.validation.crosscheck.cases import Case
from tdcr_fe.validation.fuzz.checks import CHECKS
from tdcr_fe.validation.fuzz.state import State
from tdcr_fe.validation.records import Record
from tdcr_fe.validation.reference import ReferenceSettings, solve_reference

#: Presliding distance of both solvers [m].
PRESLIDING = 1e-6
#: Tolerances [% of the length], [% of the tendon's highest tension in the step].
TIP_TOLERANCE, TENSION_TOLERANCE = 0.05, 0.1
#: A hole whose states differ is at the stick-slip threshold where both mobilisations are within this of each other.
THRESHOLD = 0.01
#: Tensions of tendons below this are not compared [N].
SLACK = 1e-6
#: Values of which a case has the largest of its steps.
LARGEST = (
    "deviation_percent",
    "shape_percent",
    "orientation_deg",
    "tension_percent",
    "displacement_percent",
    "bending_deg",
    "outside_bounds",
)

_BOUNDS = [c.value for c in CHECKS if c.name in ("Capstan bounds", "slipping holes at their bound")]


def compare(case: Case) -> Record:
    """Solve a case with both solvers and compare the solutions.

    Parameters
    ----------
    case
        The case.

    Returns
    -------
    dict
        Numbers, strings and lists. ``steps`` has one entry per load step; the other keys are worst values over them.

    Raises
    ------
    RuntimeError
        A solver did not converge.
    """
    path: PathRecord = []
    fe = simulate(case.robot, case.model, case.steps, SolverSettings(presliding=PRESLIDING), record_path=path)
    if not fe.converged:
        raise RuntimeError(f"finite elements: {fe.message}")
    # The reference is sampled at the nodes of the finite elements.
    settings = ReferenceSettings(presliding=PRESLIDING, sample_at=tuple(fe.steps[0].s.tolist()))
    ref = solve_reference(case.robot, case.model, case.steps, settings=settings)
    if not ref.converged:
        raise RuntimeError(f"reference: {ref.message}")
    steps = [
        {
            **_shapes(a, b),
            "tension_percent": _tension_percent(a, b),
            "holes_differing": _differing(case, a, b, increments[-1].state.mobilisation[0]),
            "outside_bounds": max(f(State.of(case.robot, case.model, s)) for f in _BOUNDS for s in (a, b)),
        }
        for a, b, increments in zip(fe.steps, ref.steps, path, strict=True)
    ]
    worst = max(range(len(steps)), key=lambda i: steps[i]["deviation_percent"])
    largest = {key: max(s[key] for s in steps) for key in LARGEST}
    differing = [hole for s in steps for hole in s["holes_differing"]]
    off = sum(not hole["at_threshold"] for hole in differing)
    reasons = []
    if not largest["deviation_percent"] <= TIP_TOLERANCE:
        reasons.append(f"tip deviates by {largest['deviation_percent']:.4f} % of the length")
    if not largest["tension_percent"] <= TENSION_TOLERANCE:
        reasons.append(f"a tension deviates by {largest['tension_percent']:.3f} %")
    if off:
        reasons.append(f"{off} hole states differ that are not at the stick-slip threshold")
    rough = case.model.friction != "none"
    count = sum(len(x) - 1 for s in ref.steps for x in s.hole_states) if rough else 0
    holes = {"holes": count, "holes_differing": len(differing), "holes_differing_off_threshold": off}
    tips = {key: steps[worst][key] for key in ("tip_finite_element", "tip_reference")}
    verdict = {"passed": not reasons, "reasons": reasons, "steps": steps}
    return {**tips, "worst_step": worst + 1, **largest, **holes, **verdict}


def _shapes(a: StepResult, b: StepResult) -> Record:
    """Tips of the finite elements and of the reference, and deviations of nodes, orientations and displacements."""
    index = np.abs(b.s[:, None] - a.s).argmin(axis=0)
    if np.max(np.abs(b.s[index] - a.s)) > 1e-9:
        raise RuntimeError("the reference was not sampled at the nodes")
    positions, rotations = b.positions[index], b.rotations[index]
    gap = 100.0 * np.linalg.norm(a.positions - positions, axis=1) / a.s[-1]
    turn = Rotation.from_matrix(np.swapaxes(a.rotations, 1, 2) @ rotations).magnitude()
    # The angle that the tangent sweeps along the backbone; unlike that between its ends it may exceed 180 degrees.
    swept = 2.0 * np.arcsin(0.5 * np.linalg.norm(np.diff(b.rotations[:, :, 2], axis=0), axis=1))
    moved = float(np.max(np.abs(a.displacements - b.displacements), initial=0.0))
    tips = {"tip_finite_element": a.tip.tolist(), "tip_reference": b.tip.tolist()}
    points = {"deviation_percent": float(gap[-1]), "shape_percent": float(np.max(gap))}
    angles = {"orientation_deg": np.degrees(np.max(turn)), "bending_deg": np.degrees(np.sum(swept))}
    angles = {key: float(angle) for key, angle in angles.items()}
    return {**tips, **points, **angles, "displacement_percent": 100.0 * moved / float(a.s[-1])}


def _tension_percent(a: StepResult, b: StepResult) -> float:
    """Largest deviation of a tension, over the highest of its tendon [%]."""
    taut = [(x, y) for x, y in zip(a.tensions, b.tensions, strict=True) if np.max(y) > SLACK]
    return max((100.0 * float(np.max(np.abs(x - y)) / np.max(y)) for x, y in taut), default=0.0)


def _differing(case: Case, a: StepResult, b: StepResult, mobilisations: Array) -> list[Record]:
    """Holes whose states differ, and whether they are at the stick-slip threshold."""
    found: list[Record] = []
    rows = zip(case.robot.tendon_names, a.hole_states, b.hole_states, strict=True)
    for i, (tendon, own_states, reference_states) in enumerate(rows):
        for k, (x, y) in enumerate(zip(own_states, reference_states, strict=True)):
            if x == y:
                continue
            # With friction per tendon all of its holes have one mobilisation.
            own = float(mobilisations[i][min(k, mobilisations.shape[1] - 1)])
            other = float(b.details["mobilisation"][i][k])
            states = {"finite_element": x, "reference": y}
            shares = {"mobilisation_finite_element": own, "mobilisation_reference": other}
            near = abs(own - other) <= THRESHOLD
            found.append({"tendon": tendon, "hole": k + 1, **states, **shares, "at_threshold": near})
    return found

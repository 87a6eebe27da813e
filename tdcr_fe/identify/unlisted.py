"""Effects at every place as candidates, and the missing moment from the shape."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from tdcr_fe.effects import Effect, EffectAtPlace, PlaceEffect
from tdcr_fe.identify.problem import Fit, FitProblem
from tdcr_fe.model.interpolation import interpolate_positions
from tdcr_fe.model.loading import resolve

Array = NDArray[np.float64]


def local_candidates(problem: FitProblem, fit: Fit) -> list[list[Effect]]:
    """Effects at every place of the robot, each kind from the base on, without the kinds that the model has."""
    robot = problem.with_effects(fit.effects, fit.values).robot
    return [
        [e.at(place) for place in e.places(robot)]
        for e in problem.catalogue
        if isinstance(e, PlaceEffect) and e.name not in {x.listed for x in fit.effects}
    ]


def strong_candidates(problem: FitProblem, fit: Fit) -> list[EffectAtPlace]:
    """Local causes that saturate, at two places along every tendon that is driven."""
    data = problem.data
    driven = np.ptp([a.values for a in resolve(data.robot, data.steps)], axis=0) > 0.0
    found: list[EffectAtPlace] = []
    for e in problem.catalogue:
        if not isinstance(e, PlaceEffect) or not e.saturates or e.name in {x.listed for x in fit.effects}:
            continue
        for i in np.flatnonzero(driven):
            places = [p for p in e.places(data.robot) if p.get("tendon") == i + 1.0]
            count = len(places)
            found += [e.at(places[k]) for k in sorted({count // 4, (3 * count) // 4}) if k < count]
    return found


def missing_moment(problem: FitProblem, fit: Fit) -> tuple[Array, Array]:
    """Bending moment missing in the model, per load step and bay, from the measured shape.

    An extra curvature in a bay turns everything beyond it; the extra curvatures that turn the model's shape into
    the measured one, as smooth along the backbone as the noise allows, times the bending stiffness, are the
    missing moment.

    Returns
    -------
    moment : ndarray, shape (n_steps, n_bays, 2)
        About the section's x and y axes [N m].
    edges : ndarray, shape (n_bays + 1,)
        Of the bays [m].
    """
    edges = problem.data.robot.bay_edges
    bays = len(edges) - 1
    data, run = problem.data, fit.run
    experiment = problem.with_effects(fit.effects, fit.values)
    moment = np.zeros((len(data.steps), bays, 2))
    stiffness = experiment.robot.backbone.EI
    difference = np.diff(np.eye(bays), n=1, axis=0)
    smooth = np.kron(difference, np.eye(2))
    width = np.diff(edges)
    middle = 0.5 * (edges[1:] + edges[:-1])
    prior = 1e-3 * np.eye(2 * bays)
    for k in range(run.solved):
        mine = np.flatnonzero(problem.readings.reader.step == k)
        mine = mine[np.isfinite(fit.residual[mine])]
        rows, right = [], []
        p, rot = run.positions[k], run.rotations[k]
        centres = interpolate_positions(run.s, p, rot, middle)
        node = [int(np.argmin(np.abs(run.s - m))) for m in middle]
        axes = rot[node][:, :, :2]
        for i in mine:
            r = data.readings[i]
            row = np.zeros((bays, 2))
            if r.quantity.startswith("position_") and isinstance(r.location, float):
                x = interpolate_positions(run.s, p, rot, np.array([r.location]))[0]
                axis = "xyz".index(r.quantity[-1])
                share = np.clip((r.location - edges[:-1]) / width, 0.0, 1.0)
                arm = np.cross(np.swapaxes(axes, 1, 2), (x - centres)[:, None, :])[:, :, axis]
                row = arm * (share * width)[:, None]
            elif r.quantity == "bending_angle":
                t = rot[-1][:, 2]
                out = np.array([t[0], t[1], 0.0])
                if np.linalg.norm(out) < 1e-6:
                    continue
                hinge = np.cross(np.array([0.0, 0.0, 1.0]), out / np.linalg.norm(out))
                row = np.einsum("bij,i->bj", axes, hinge) * width[:, None]
            elif r.quantity.startswith("curvature_") and isinstance(r.location, float):
                bay = int(np.clip(np.searchsorted(edges, r.location) - 1, 0, bays - 1))
                row[bay, "xy".index(r.quantity[-1])] = 1.0
            else:
                continue
            rows.append(row.ravel() / problem.sigma[i])
            right.append(fit.residual[i])
        if not rows:
            continue
        a, b = np.array(rows), np.array(right)
        # The weight of smoothness: the largest at which the residual is noise.
        best = np.zeros(2 * bays)
        for weight in np.logspace(4, -4, 17) * np.mean(a**2):
            whole = np.concatenate((a, np.sqrt(weight) * smooth, np.sqrt(weight) * 1e-2 * prior))
            best = np.linalg.lstsq(whole, np.concatenate((b, np.zeros(len(whole) - len(b)))), rcond=None)[0]
            if np.sum((b - a @ best) ** 2) <= len(b):
                break
        moment[k] = stiffness * best.reshape(bays, 2)
    return moment, edges


def describe_moment(problem: FitProblem, moment: Array, edges: Array) -> tuple[str, str]:
    """Where along the backbone and at which loads the missing moment acts, as texts."""
    size = np.sqrt(np.sum(moment**2, axis=2))
    by_bay = np.sqrt(np.mean(size**2, axis=0))
    if not np.any(by_bay > 0.0):
        return "nowhere", "no missing moment"
    b = int(np.argmax(by_bay))
    by_step = np.sqrt(np.mean(size**2, axis=1))
    order = np.argsort(by_step)[::-1][:3]
    ids = problem.data.step_ids
    steps = ", ".join(str(ids[k]) for k in sorted(order))
    what: Sequence[str] = [
        f"the missing bending moment is largest in bay {b + 1} (s = {edges[b]:.4g} to {edges[b + 1]:.4g} m), "
        f"{1e3 * by_bay[b]:.3g} N mm rms over the steps",
        f"it acts most in steps {steps} ({_inputs_text(problem, order[0])})",
    ]
    return f"bay {b + 1} (s = {edges[b]:.4g} to {edges[b + 1]:.4g} m), steps {steps}", "; ".join(what)


def _inputs_text(problem: FitProblem, k: int) -> str:
    step = problem.data.steps[int(k)]
    parts = [f"{n} = {v:.3g} N" for n, v in step.tensions.items() if v > 0.0]
    parts += [f"{n} = {1e3 * v:.3g} mm" for n, v in step.displacements.items() if v != 0.0]
    parts += [
        f"tip force ({', '.join(f'{x:.3g}' for x in load.force)}) N"
        for load in step.loads.values()
        if any(load.force)
    ]
    return ", ".join(parts) or "no tendon pulled"

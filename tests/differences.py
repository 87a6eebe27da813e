"""Derivatives of whole simulations by central differences, along the same substeps."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from tdcr_fe import Experiment, Sensitivities, Simulation
from tdcr_fe.model.loading import SolverSettings, resolve
from tdcr_fe.solve.load_steps.load_path import Increment
from tdcr_fe.solve.load_steps.stepping import SolvedLoadStep
from tdcr_fe.solve.sensitivities.differences import stencil
from tdcr_fe.solve.sensitivities.parameters import ModelParameter, Parameter, parameters
from tdcr_fe.solve.sensitivities.sensitivity import SensitivityHistory

SETTINGS = SolverSettings(tolerance=1e-11)
#: Relative error that derivatives must meet.
TOLERANCE = 1e-5
#: Sizes of results of each kind.
PLAIN = {"positions": 0.25, "rotations": 1.0, "base_tensions": 1.0, "displacements": 1e-2}
SCALES = {**PLAIN, "tensions": 1.0, "slips": 1e-2}


#: Substeps of the load steps of a run.
Substeps = list[list[Increment]]


def run(
    experiment: Experiment, chosen: Sequence[str | Parameter] = (), path: Substeps | None = None
) -> tuple[dict[str, np.ndarray], Sensitivities, Substeps]:
    """Simulate, with sensitivities, along the substeps of another run where they are given.

    The results at the ends of the steps are by kind, with those of all tendons side by side.
    """
    actions = resolve(experiment.robot, experiment.steps)
    simulation = Simulation(experiment.robot, experiment.model, actions, SETTINGS)
    history = None
    if chosen:
        history = SensitivityHistory.of(simulation, experiment, parameters(experiment, chosen))
    solved: list[SolvedLoadStep] = []
    made, results, slips = [], [], []
    for k, (step, action) in enumerate(zip(experiment.steps, actions, strict=True)):
        report = simulation.advance(action, step.substeps, () if path is None else path[k], solved.append)
        made.append(solved[-1].path.recorded())
        if history is not None:
            history.advance(solved[-1])
        results.append(simulation.result(k + 1, "", report, action))
        released = simulation.handle.actuation.current_forces().field.released_length
        slips.append(np.cumsum(released[:, ::-1], axis=1)[:, ::-1][:, 1:])
    values = {kind: np.array([getattr(r, kind) for r in results]) for kind in PLAIN}
    values["tensions"] = np.array([np.concatenate(r.tensions) for r in results])
    values["slips"] = np.array(slips)
    return values, Sensitivities() if history is None else history.result(), made


def _whole(experiment: Experiment, count: int, path: Substeps) -> tuple[dict[str, np.ndarray], Substeps]:
    """Results of a neighbour at the ends of the steps of the present experiment, which is undivided if it differs."""
    if len(experiment.steps) == count:
        values, _, made = run(experiment, (), path)
        return values, made
    last = [k for k, (_, factor) in enumerate(experiment.ends) if factor == 1.0]
    return {kind: v[last] for kind, v in run(experiment)[0].items()}, path


def same_states(a: Substeps, b: Substeps) -> bool:
    """Whether two runs have the same substeps, and all holes and tendons the same states at their ends."""
    if [len(x) for x in a] != [len(x) for x in b]:
        return False
    pairs = [(x.state, y.state) for one, two in zip(a, b, strict=True) for x, y in zip(one, two, strict=True)]
    holes = all(np.array_equal(np.trunc(x.mobilisation[0]), np.trunc(y.mobilisation[0])) for x, y in pairs)
    return holes and all(np.array_equal(x.base_tension[0] > 0.0, y.base_tension[0] > 0.0) for x, y in pairs)


def rotation_vectors(before: np.ndarray, change: np.ndarray) -> np.ndarray:
    """World rotation vectors of changes of rotation matrices."""
    w = change @ np.swapaxes(before, -1, -2)
    return np.stack((w[..., 2, 1], w[..., 0, 2], w[..., 1, 0]), axis=-1)


def check(experiment: Experiment, name: str | Parameter, relative: Sequence[float] = (1e-4, 1e-3)) -> None:
    """Compare sensitivities with central differences, over the largest derivative of each kind.

    The best of several difference steps counts, as each has its own truncation error and round-off; no further ones are
    tried where all errors are below `TOLERANCE`. Where the neighbours have divided load steps, the ends of the whole
    steps are compared.
    """
    base, found, path = run(experiment, [name])
    parameter = parameters(experiment, [name])[0]
    assert isinstance(parameter, ModelParameter)
    own = found[parameter.name]
    ours = {kind: getattr(own, kind) for kind in PLAIN}
    ours["tensions"] = np.concatenate(own.tensions, axis=1)
    if own.slips and own.slips[0].size and all(s.shape == own.slips[0].shape for s in own.slips):
        ours["slips"] = np.stack(own.slips, axis=1)
    best: dict[str, float] = {}
    for h in relative:
        near = replace(parameter, size=parameter.size * h / 1e-5)
        at = stencil(experiment, near, lambda each: _whole(each, len(experiment.steps), path))
        if not all(same_states(path, made) for _, made in at.models):
            continue  # differences across a change of state say nothing about the derivative
        for kind, derivative in ours.items():
            now = base[kind]
            theirs = sum(w * (v[kind] - now) for w, (v, _) in zip(at.weights, at.models, strict=True))
            if kind == "rotations":
                theirs = rotation_vectors(now, theirs)
            # A derivative of zero is one far below the value over the parameter.
            size = max(float(np.abs(theirs).max()), 1e-6 * SCALES[kind] / parameter.size)
            best[kind] = min(best.get(kind, np.inf), float(np.abs(derivative - theirs).max()) / size)
        if max(best.values()) < TOLERANCE:
            return
    assert best, "holes change their states between all neighbours"
    assert max(best.values()) < TOLERANCE, best

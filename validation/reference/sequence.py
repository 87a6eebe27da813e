"""A loading sequence: solves one load step after another and collects the results."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import asdict

import numpy as np

from tdcr_fe.model.loading import Actuation, LoadStep, Model, resolve
from tdcr_fe.model.results import SequenceResult, StepResult
from tdcr_fe.model.robot import Robot
from tdcr_fe.validation.reference.path import (
    MAX_BISECTIONS,
    PATH_TOLERANCE,
    SLIPPING,
    LoadStepPath,
    NotConverged,
    Path,
    Point,
    Ramp,
)
from tdcr_fe.validation.reference.rod import Rod
from tdcr_fe.validation.reference.settings import Array, Extras, ReferenceSettings
from tdcr_fe.validation.reference.statics import State, Statics


class Sampler:
    """Poses at the reported nodes and at the samples requested by the settings."""

    def __init__(self, statics: Statics) -> None:
        layout, settings = statics.layout, statics.settings
        length = statics.robot.backbone.length
        wanted = np.unique(np.clip(settings.sample_at, 0.0, length))
        off = np.abs(layout.s[:, None] - wanted)
        known = off.min(axis=0) <= 1e-9
        self.stations = np.unique(np.concatenate((layout.nodes, off.argmin(axis=0)[known])))
        self.extra = wanted[~known]
        self.interval = np.searchsorted(layout.s, self.extra) - 1
        self.s = np.concatenate((layout.s[self.stations], self.extra))
        self.order = np.argsort(self.s)
        self.statics = statics
        if len(self.extra):
            starts = layout.s[self.interval]
            section = statics.section.take(self.interval)
            robot = statics.robot if statics.continuous else None
            self.rod = Rod(section, starts, self.extra - starts, statics.max_step, statics.heavy, robot)

    def __call__(self, state: State) -> tuple[Array, Array, Array]:
        """Arc lengths [m], positions [m] and rotations, in order."""
        positions, rotations = state.positions[self.stations], state.rotations[self.stations]
        if len(self.extra):
            at = self.interval
            self.rod.section = self.statics.section.take(at)
            weight = None
            if self.statics.heavy:
                weight = np.einsum("nji,nj->ni", state.rotations[at], self.statics.weight[at])
            tension = state.tensions if self.statics.continuous else None
            flow = self.rod.integrate(state.wrenches[at], weight, tension)
            start = state.rotations[at]
            more = state.positions[at] + (start @ flow.position[:, :, None])[..., 0]
            positions = np.concatenate((positions, more))
            rotations = np.concatenate((rotations, start @ flow.rotation))
        return self.s[self.order], positions[self.order], rotations[self.order]


def solve_reference(
    robot: Robot,
    model: Model,
    steps: Sequence[LoadStep],
    *,
    settings: ReferenceSettings | None = None,
    extras: Extras | None = None,
) -> SequenceResult:
    """Solve a loading sequence by multiple shooting on the Cosserat equations.

    The first load step starts from the unloaded robot; gravity acts in full from its first substep on. Within
    a load step tensions, displacements, concentrated loads and time change linearly, and the friction
    history is committed after every substep. Substeps are chosen by step doubling (see
    `tdcr_fe.validation.reference.path`), unless the load step or the settings give their number. Where several
    equilibria exist, small load steps stay on the branch that starts at the unloaded robot.

    A tendon driven by displacement that has gone slack keeps the displacement imposed in ``displacements``.

    Parameters
    ----------
    robot
        The robot.
    model
        Path of the tendons, friction and gravity; ``elements_per_bay`` is not used.
    steps
        The loading sequence.
    settings
        Numerical settings; None takes the defaults.
    extras
        Properties beyond the robot description.

    Returns
    -------
    SequenceResult
        With nodes at base, disks, load points, tip and the samples of the settings. ``details`` of a
        step: "mobilisation" [1], by tendon and hole; "base_wrench" [N m, N], shape (6,), internal wrench just above the
        base plate (of rod and tendons together in the classical model); "refinement_error", the change of the shape
        over the length [1] that halving every substep made, summed over the substeps, NaN where their number was
        given. ``warnings`` name the steps where it is beyond the tolerance.

    Raises
    ------
    ValueError
        A coefficient of friction that depends on the slip rate, or a load step that does not fit the robot.
    """
    settings = settings or ReferenceSettings()
    clock = time.perf_counter()
    actuations = resolve(robot, steps)
    points = sorted({min(load.at, robot.backbone.length) for a in actuations for load in a.loads.values()})
    statics = Statics(robot, model, points, settings, extras or Extras())
    sampler = Sampler(statics)
    point = Point(statics.rest, statics.tendons.start())
    before: Actuation | None = None
    direction = np.zeros(statics.tendons.count)
    results: list[StepResult] = []
    warnings: list[str] = []
    failed, message = None, f"all {len(actuations)} steps converged"
    for number, (step, actuation) in enumerate(zip(steps, actuations, strict=True), start=1):
        ramp = Ramp.between(statics, before, actuation, point.state, direction)
        direction = ramp.direction
        one, count = LoadStepPath(statics, ramp), step.substeps or settings.substeps
        name = f"step {number} ({step.label or 'no label'})"
        try:
            path = one.solve(point, count)
        except NotConverged:
            failed = number
            message = (
                f"{name} did not converge after {MAX_BISECTIONS} bisections; use smaller load steps, more substeps, or "
                "a larger presliding distance"
            )
            break
        point, before = path.end, actuation
        results.append(_result(sampler, one, path, number, step))
        if count is not None and path.substeps > count and statics.tendons.n_friction:
            warnings.append(
                f"{name}: {path.substeps} substeps were needed in place of {count}; the friction history was "
                "committed after each"
            )
        if path.refinement_error > PATH_TOLERANCE:
            warnings.append(
                f"{name}: path not resolved; halving every substep once more would move a node by about "
                f"{path.refinement_error:.1e} of the length; use smaller load steps"
            )
    return SequenceResult(
        robot=robot,
        model=model,
        steps=tuple(results),
        converged=failed is None,
        message=message,
        failed_step=failed,
        wall_time=time.perf_counter() - clock,
        warnings=tuple(warnings),
        settings={"solver": "reference", **asdict(settings)},
    )


def _result(sampler: Sampler, solved: LoadStepPath, path: Path, number: int, step: LoadStep) -> StepResult:
    """The state reached, as a result."""
    statics, state = solved.statics, path.end.state
    tendons, robot, driver = statics.tendons, statics.robot, solved.ramp.driver(1.0)
    s, positions, rotations = sampler(state)
    pulled = tendons.base_sum @ tendons.taken_in(state.lengths, state.tensions)[0]
    tensions: list[Array] = []
    states: list[tuple[str, ...]] = []
    mobilisations: list[Array] = []
    share = np.zeros(len(tendons.holes))
    share[tendons.rough] = state.mobilisation[tendons.variable[tendons.rough]]
    for tendon, first, last in zip(robot.tendons, tendons.first, tendons.last, strict=True):
        pull = state.tensions[first:last]
        own = share[(tendons.holes >= first) & (tendons.holes < last)]
        if statics.continuous:
            segments = len(robot.hole_arc_lengths(tendon)) - 1
            pull, own = np.repeat(pull, segments), np.zeros(segments - 1)
        words = ["pull" if x >= SLIPPING else "release" if x <= -SLIPPING else "stick" for x in own]
        tensions.append(pull.copy())
        states.append((*words, "anchor"))
        mobilisations.append(own)
    return StepResult(
        step=number,
        label=step.label,
        converged=True,
        iterations=solved.iterations,
        substeps=path.substeps,
        s=s,
        positions=positions,
        rotations=rotations,
        base_tensions=state.tensions[tendons.first] if tendons.count else np.zeros(0),
        displacements=np.where(driver.by_displacement, driver.values, pulled),
        tensions=tuple(tensions),
        hole_states=tuple(states),
        residual=state.residual,
        details={
            "mobilisation": tuple(mobilisations),
            "base_wrench": state.wrenches[0].copy(),
            "refinement_error": path.refinement_error,
        },
    )

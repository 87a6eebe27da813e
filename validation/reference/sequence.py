"""A loading sequence: one load step after another, each substep's friction history committed once."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from tdcr_fe.model.loading import Actuation, Load, LoadStep, Model, resolve
from tdcr_fe.model.results import SequenceResult, StepResult
from tdcr_fe.model.robot import Robot
from tdcr_fe.validation.reference.extras import Extras
from tdcr_fe.validation.reference.rod import Rod
from tdcr_fe.validation.reference.settings import ReferenceSettings
from tdcr_fe.validation.reference.statics import Attempt, State, Statics
from tdcr_fe.validation.reference.tendons import Driver, History

Array = NDArray[np.float64]

#: Mobilisation from which on a hole counts as slipping.
_SLIPS = 1.0 - 1e-9


@dataclass
class _Progress:
    """Where the sequence stands: the last converged state and what is remembered of it."""

    state: State
    history: History
    dissipated: Array
    iterations: int = 0
    substeps: int = 0
    attempts: int = 0
    residual: float = 0.0


@dataclass(frozen=True)
class _Ramp:
    """Linear change of tensions, displacements and loads over one load step."""

    by_displacement: NDArray[np.bool_]
    begin: Array
    end: Array
    old: Mapping[str, Load]
    new: Mapping[str, Load]
    times: tuple[float, float]

    def time(self, share: float) -> float:
        """Time at a share 0..1 of the step [s]."""
        return (1.0 - share) * self.times[0] + share * self.times[1]

    def driver(self, share: float) -> Driver:
        """What the actuators impose at a share 0..1 of the step."""
        return Driver(self.by_displacement, (1.0 - share) * self.begin + share * self.end)

    def loads(self, share: float) -> list[tuple[float, Load]]:
        """Factors and concentrated loads at a share 0..1 of the step."""
        kept = {name: load for name, load in self.new.items() if self.old.get(name) == load}
        going = [(1.0 - share, load) for name, load in self.old.items() if name not in kept]
        coming = [(share, load) for name, load in self.new.items() if name not in kept]
        return [(1.0, load) for load in kept.values()] + [(f, load) for f, load in going + coming if f != 0.0]


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
    history is committed after every substep. Where several equilibria exist, small load steps stay on the
    branch that starts at the unloaded robot.

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
        What the robot has beyond its description.

    Returns
    -------
    SequenceResult
        With nodes at base, disks, load points, tip and where the settings ask for samples. ``details`` of a
        step: "dissipation" [J], by tendon the work lost at each hole since the start; "mobilisation" [1], by
        tendon and hole; "base_wrench" [N m, N], shape (6,), internal wrench just above the base plate (of
        rod and tendons together in the classical model); "bisections", substeps that had to be halved.

    Raises
    ------
    ValueError
        The classical model is asked for friction, a coefficient of friction depends on slip rate or normal force, or
        a load step does not fit the robot.
    """
    laws = [t.name for t in robot.tendons if t.friction is not None and model.friction != "none"]
    if laws:
        raise ValueError(
            f"the reference knows constant coefficients of friction only, not the law of {laws[0]!r}"
        )
    settings = settings or ReferenceSettings()
    clock = time.perf_counter()
    actuations = resolve(robot, steps)
    points = sorted({min(load.at, robot.backbone.length) for a in actuations for load in a.loads.values()})
    statics = Statics(robot, model, points, settings, extras)
    sampler = _Sampler(statics)
    history = statics.tendons.start()
    progress = _Progress(statics.rest, history, np.zeros(len(statics.tendons.holes)))
    before: Actuation | None = None
    results: list[StepResult] = []
    warnings: list[str] = []
    failed, message = None, f"all {len(actuations)} steps converged"
    for number, (step, actuation) in enumerate(zip(steps, actuations, strict=True), start=1):
        progress.iterations = progress.substeps = progress.attempts = 0
        ramp = _ramp(statics, before, actuation, progress.state)
        count = step.substeps or settings.substeps
        solved = True
        for k in range(count):
            solved = _advance(statics, progress, ramp, k / count, (k + 1) / count, settings.max_bisections)
            if not solved:
                break
        if not solved:
            failed = number
            message = (
                f"step {number} ({step.label or 'no label'}) did not converge: scaled residual "
                f"{progress.residual:.2g} after {settings.max_bisections} bisections; "
                f"use smaller load steps, more substeps, or a larger presliding distance"
            )
            break
        results.append(_result(statics, sampler, progress, ramp, number, step, count))
        before = actuation
        if progress.attempts and statics.tendons.n_friction:
            warnings.append(
                f"step {number} ({step.label or 'no label'}): {progress.substeps} substeps were needed in "
                f"place of {count}; the friction history was committed after each"
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


def _ramp(statics: Statics, before: Actuation | None, now: Actuation, state: State) -> _Ramp:
    """From the state reached to what the step asks for; a tendon that changes its mode starts where it is."""
    tendons = statics.tendons
    tension = state.tensions[tendons.first] if tendons.count else np.zeros(0)
    pulled = tendons.base_sum @ tendons.taken_in(state.lengths, state.tensions)[0]
    old_modes = np.zeros(tendons.count, dtype=bool) if before is None else before.by_displacement
    old_values = np.zeros(tendons.count) if before is None else before.values
    begin = np.where(now.by_displacement, pulled, tension)
    begin = np.where(old_modes == now.by_displacement, old_values, begin)
    times = (0.0 if before is None else before.time, now.time)
    return _Ramp(
        now.by_displacement, begin, now.values, {} if before is None else before.loads, now.loads, times
    )


def _advance(
    statics: Statics, progress: _Progress, ramp: _Ramp, begin: float, end: float, bisections: int
) -> bool:
    """Go from one share of a load step to another and commit the history; halve the way where it fails."""
    for attempt in _attempts(statics, progress, ramp, end):
        progress.iterations += attempt.iterations
        progress.residual = attempt.state.residual
        if attempt.converged:
            _commit(statics, progress, attempt.state)
            progress.substeps += 1
            return True
    if bisections == 0:
        return False
    progress.attempts += 1
    middle = 0.5 * (begin + end)
    return _advance(statics, progress, ramp, begin, middle, bisections - 1) and _advance(
        statics, progress, ramp, middle, end, bisections - 1
    )


def _attempts(statics: Statics, progress: _Progress, ramp: _Ramp, share: float) -> Iterator[Attempt]:
    """Newton from the last state; with friction, then by way of larger presliding distances."""
    forces, driver = statics.forces(ramp.loads(share)), ramp.driver(share)
    delta, history = statics.settings.presliding, progress.history
    if statics.robot.backbone.creep_rate != 0.0:
        statics.set_compliance_factor(statics.robot.backbone.compliance_factor(ramp.time(share)))
    start = progress.state.unknowns
    yield statics.solve(start, forces, driver, history, delta)
    if statics.tendons.n_friction:
        attempt = Attempt(progress.state, False, 0)
        iterations = 0
        for factor in (1e5, 1e4, 1e3, 100.0, 10.0, 1.0):
            attempt = statics.solve(start, forces, driver, history, factor * delta)
            iterations += attempt.iterations
            if not attempt.converged:
                break
            start = attempt.state.unknowns
        yield Attempt(attempt.state, attempt.converged, iterations)


def _commit(statics: Statics, progress: _Progress, state: State) -> None:
    """Remember what has passed the holes, and what was lost there."""
    tendons, old = statics.tendons, progress.history
    passed = tendons.passed_sum @ tendons.taken_in(state.lengths, state.tensions)[0]
    new = History(state.mobilisation.copy(), passed)
    if tendons.n_friction:
        share = state.mobilisation[tendons.variable]
        creep = statics.settings.presliding * (share - old.mobilisation[tendons.variable])
        before = tendons.taken_in(progress.state.lengths, progress.state.tensions)[0]
        now = tendons.taken_in(state.lengths, state.tensions)[0]
        slip = tendons.beyond @ (now - before) - creep
        slip[(tendons.variable < 0) | (np.abs(share) < _SLIPS)] = 0.0
        progress.dissipated += (state.tensions[tendons.holes] - state.tensions[tendons.holes + 1]) * slip
    progress.state, progress.history = state, new


def _result(
    statics: Statics,
    sampler: _Sampler,
    progress: _Progress,
    ramp: _Ramp,
    number: int,
    step: LoadStep,
    count: int,
) -> StepResult:
    """The state reached, in the words of the result types."""
    tendons, state, robot = statics.tendons, progress.state, statics.robot
    s, positions, rotations = sampler(state)
    pulled = tendons.base_sum @ tendons.taken_in(state.lengths, state.tensions)[0]
    driver = ramp.driver(1.0)
    displacements = np.where(driver.by_displacement, driver.values, pulled)
    tensions: list[Array] = []
    states: list[tuple[str, ...]] = []
    mobilisations: list[Array] = []
    dissipation: list[Array] = []
    share = np.zeros(len(tendons.holes))
    share[tendons.rough] = state.mobilisation[tendons.variable[tendons.rough]]
    for i, tendon in enumerate(robot.tendons):
        pull = state.tensions[tendons.first[i] : tendons.last[i]]
        segments = len(robot.hole_arc_lengths(tendon)) - 1
        mine = (tendons.holes >= tendons.first[i]) & (tendons.holes < tendons.last[i])
        own = share[mine]
        if statics.continuous:
            pull, own = np.repeat(pull, segments), np.zeros(segments - 1)
        words = ["pull" if x >= _SLIPS else "release" if x <= -_SLIPS else "stick" for x in own]
        tensions.append(pull.copy())
        states.append((*words, "anchor"))
        mobilisations.append(own)
        dissipation.append(progress.dissipated[mine].copy())
    return StepResult(
        step=number,
        label=step.label,
        converged=True,
        iterations=progress.iterations,
        substeps=max(progress.substeps, count),
        s=s,
        positions=positions,
        rotations=rotations,
        base_tensions=state.tensions[tendons.first] if tendons.count else np.zeros(0),
        displacements=displacements,
        tensions=tuple(tensions),
        hole_states=tuple(states),
        residual=state.residual,
        details={
            "dissipation": tuple(dissipation),
            "mobilisation": tuple(mobilisations),
            "base_wrench": state.wrenches[0].copy(),
            "bisections": progress.attempts,
        },
    )


class _Sampler:
    """Poses at the nodes to report and at the samples that the settings ask for."""

    def __init__(self, statics: Statics) -> None:
        layout, settings = statics.layout, statics.settings
        length = statics.robot.backbone.length
        nodes = layout.s[layout.nodes]
        wanted = [min(max(p, 0.0), length) for p in settings.sample_at]
        for a, b in pairwise(nodes):
            n = settings.samples_per_bay
            wanted += [float(a + (b - a) * (i + 1) / (n + 1)) for i in range(n)]
        extra = [p for p in wanted if np.min(np.abs(layout.s - p)) > 1e-9]
        inner = [int(np.argmin(np.abs(layout.s - p))) for p in wanted if np.min(np.abs(layout.s - p)) <= 1e-9]
        self.stations = np.unique(np.concatenate((layout.nodes, np.array(inner, dtype=np.intp))))
        self.extra = np.unique(np.array(extra))
        self.interval = np.searchsorted(layout.s, self.extra) - 1
        self.s = np.concatenate((layout.s[self.stations], self.extra))
        self.order = np.argsort(self.s)
        self.statics = statics
        if len(self.extra):
            starts = layout.s[self.interval]
            self.rod = Rod(
                statics.section.take(self.interval),
                starts,
                self.extra - starts,
                statics.max_step,
                statics.heavy,
                statics.robot if statics.continuous else None,
            )

    def __call__(self, state: State) -> tuple[Array, Array, Array]:
        """Arc lengths [m], positions [m] and rotations, in order."""
        positions, rotations = state.positions[self.stations], state.rotations[self.stations]
        if len(self.extra):
            at = self.interval
            self.rod.section = self.statics.section.take(at)
            weight = None
            if self.statics.heavy:
                weight = np.einsum("nji,j->ni", state.rotations[at], self.statics.weight)
            flow = self.rod.integrate(
                state.wrenches[at],
                weight,
                state.tensions if self.statics.continuous else None,
                derivatives=False,
            )
            start = state.rotations[at]
            more = state.positions[at] + (start @ flow.position[:, :, None])[..., 0]
            positions = np.concatenate((positions, more))
            rotations = np.concatenate((rotations, start @ flow.rotation))
        return self.s[self.order], positions[self.order], rotations[self.order]

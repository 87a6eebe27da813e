"""Substeps of a load step: as many as convergence and the accuracy of the path ask for."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tdcr_fe.solve.solver import NewtonReport, NotConverged, Snapshot, StrainSpaceSolver

Array = NDArray[np.float64]


class Applied(NamedTuple):
    """What acts at some share of a load step.

    Attributes
    ----------
    inputs : list of ndarray
        By robot, tension [N] or displacement [m] of every tendon, shape (m,).
    load_size : float
        Size of the applied loads, for the scale of the residual [N].
    time : float
        Time that user functions see [s].
    loads_change : bool
        Whether the applied loads change in this load step.
    """

    inputs: list[Array]
    load_size: float
    time: float
    loads_change: bool = False


#: Takes the share of the load step in [0, 1], applies it to the scene, and says what acts then.
Apply = Callable[[float], Applied]


class StepFailed(Exception):
    """A load step could not be solved; says where, the residual, and what to try."""

    def __init__(self, message: str, share: float, residual: float) -> None:
        super().__init__(message)
        self.share = share
        self.residual = residual


@dataclass(frozen=True)
class Waypoint:
    """End of an accepted substep.

    Attributes
    ----------
    share : float
        Of the load step, in (0, 1] [1].
    state : Snapshot
        The solved state, history committed.
    """

    share: float
    state: Snapshot


@dataclass
class _Count:
    """What it took to get somewhere; a list of waypoints where they are wanted."""

    record: list[Waypoint] | None = None
    iterations: int = 0
    substeps: int = 0
    wasted: int = 0
    residual: float = 0.0
    snapped: bool = False
    softened: float = 1.0
    path_error: float = 0.0
    slips: list[list[Array]] = field(default_factory=list)

    def like(self) -> _Count:
        """A count from nothing."""
        return _Count(None if self.record is None else [])

    def add(self, other: _Count) -> None:
        """Take what another counted as gone."""
        if self.record is not None and other.record is not None:
            self.record.extend(other.record)
        self.iterations += other.iterations
        self.substeps += other.substeps
        self.wasted += other.wasted
        self.residual = other.residual
        self.snapped = self.snapped or other.snapped
        self.softened = max(self.softened, other.softened)
        self.path_error = max(self.path_error, other.path_error)


class LoadStepper:
    """Takes a solver through load steps.

    With friction the answer depends on the path, but only where a hole changes its state on the way. Where one
    does, the step is divided in two, four, eight and so on, until doubling has changed nothing twice: once is no
    proof, as a hole may turn round and back unseen.

    Parameters
    ----------
    solver
        The solver, in the state where the next step begins.
    """

    def __init__(self, solver: StrainSpaceSolver) -> None:
        self.solver = solver

    def advance(
        self,
        apply: Apply,
        substeps: int | None = None,
        guide: Sequence[Waypoint] | None = None,
        record: list[Waypoint] | None = None,
    ) -> dict[str, Any]:
        """Go through one load step and commit its history.

        Parameters
        ----------
        apply
            See `Apply`.
        substeps
            A fixed number (each is still halved where it does not converge); None chooses by the path's error.
        guide
            Waypoints of a similar run: the same substeps are taken, each from the state of the guide. For
            neighbours of a solved sequence, as sensitivities ask for: the path is then divided alike, so that
            differences are smooth, and two iterations a substep are enough.
        record
            Where the waypoints of this step are appended.

        Returns
        -------
        dict
            ``iterations`` of the accepted path, ``iterations_total`` with those of trials, ``substeps``,
            ``residual``, ``snapped`` (the robot jumped to another equilibrium on the way), ``presliding_factor``
            (by how much the presliding distance had to be larger for the holes to settle, 1 as a rule),
            ``path_error`` (largest change of a node at the last doubling over the length, where doubling has not yet
            changed nothing often enough, or a hole may still turn round unseen; else 0).

        Raises
        ------
        StepFailed
        """
        count = _Count(record)
        try:
            if guide is not None:
                self._replay(apply, guide, count)
            elif substeps is None:
                self._path(apply, count)
            else:
                for k in range(substeps):
                    self._converge(apply, k / substeps, (k + 1) / substeps, count)
        finally:
            # Solved or not, the scene is left in the last state that converged.
            self.solver.finish()
        return {
            "iterations": count.iterations,
            "iterations_total": count.iterations + count.wasted,
            "substeps": count.substeps,
            "residual": count.residual,
            "snapped": count.snapped,
            "presliding_factor": count.softened,
            "path_error": count.path_error,
        }

    # ------------------------------------------------------------------

    def _solve(self, apply: Apply, share: float) -> NewtonReport:
        now = apply(share)
        self._loads_change = now.loads_change
        return self.solver.newton(now.inputs, now.time, now.load_size)

    def _fail(self, start: float, end: float, cause: NotConverged) -> StepFailed:
        return StepFailed(
            f"{cause}, between {start:.4f} and {end:.4f} of the step, although divided down to "
            f"{self.solver.settings.min_substep:g}. Try smaller load steps; if the load is near the point where "
            "the robot buckles or snaps through, no equilibrium follows this path; a larger presliding distance "
            "(solver setting, 1e-5 m) helps where holes cannot settle.",
            start,
            cause.residual,
        )

    def _accept(self, report: NewtonReport, share: float, count: _Count) -> None:
        self.solver.commit()
        if report.iterations and not self.solver.any_driven:
            # With driven tendons the sign also changes where one falls slack, and says nothing.
            self.solver.stable_sign = self.solver.tangent_sign
        if count.record is not None:
            count.record.append(Waypoint(share, self.solver.snapshot()))
        count.slips.append([r.state.slip for r in self.solver.robots])
        count.iterations += report.iterations
        count.substeps += 1
        count.residual = report.residual

    def _converge(
        self, apply: Apply, start: float, end: float, count: _Count, before: Snapshot | None = None
    ) -> None:
        """One substep from the state ``before``, the present one, halved only where it does not converge."""
        before = before or self.solver.snapshot()
        try:
            report = self._solve(apply, end)
        except NotConverged as cause:
            count.wasted += cause.iterations
            self.solver.restore(before)
            if end - start <= self.solver.settings.min_substep:
                self._rescue(apply, start, end, cause, count)
                return
            middle = 0.5 * (start + end)
            self._converge(apply, start, middle, count)
            self._converge(apply, middle, end, count)
            return
        self._accept(report, end, count)

    def _replay(self, apply: Apply, guide: Sequence[Waypoint], count: _Count) -> None:
        """The substeps of a guide, each from the guide's own solution; without it where that misleads."""
        start = 0.0
        for point in guide:
            before = self.solver.snapshot()
            self.solver.guess(point.state)
            try:
                report = self._solve(apply, point.share)
            except NotConverged as cause:
                count.wasted += cause.iterations
                self.solver.restore(before)
                self._converge(apply, start, point.share, count)
            else:
                self._accept(report, point.share, count)
            start = point.share

    def _path(self, apply: Apply, count: _Count) -> None:
        """A load step, divided until it converges and until dividing changes nothing."""
        solver = self.solver
        before = solver.snapshot()
        settings = solver.settings
        now = count.like()
        self._converge(apply, 0.0, 1.0, now, before)
        matters = now.substeps > 1 or self._path_matters(before)
        if not (matters or self._leaps(before)):
            count.add(now)
            return
        agreed, pieces, error = 0, 1, 0.0
        needed = 2 if matters else 1
        while agreed < needed and 2 * pieces <= settings.max_substeps:
            pieces *= 2
            reached, shape = solver.snapshot(), solver.positions().copy()
            solver.restore(before)
            finer = count.like()
            try:
                for k in range(pieces):
                    self._converge(apply, k / pieces, (k + 1) / pieces, finer)
            except StepFailed:
                # The coarser way is kept, and its doubt told.
                solver.restore(reached)
                apply(1.0)
                count.wasted += finer.iterations + finer.wasted
                error = max(error, 2.0 * settings.path_tolerance)
                break
            error = float(np.max(np.abs(solver.positions() - shape))) / solver.length
            agreed = agreed + 1 if error <= settings.path_tolerance and not self._turns_back(finer) else 0
            finer.wasted += now.iterations + now.wasted
            now = finer
        now.path_error = 0.0 if agreed >= needed else error
        count.add(now)

    def _rescue(self, apply: Apply, start: float, end: float, cause: NotConverged, count: _Count) -> None:
        """The smallest substep does not converge: let the robot snap through, then let its holes creep more."""
        solver = self.solver
        before = solver.snapshot()
        shape = solver.positions().copy()
        for factor in (1.0, 10.0, 100.0):
            now = apply(end)
            try:
                report = solver.newton(
                    now.inputs,
                    now.time,
                    now.load_size,
                    relax=True,
                    presliding=factor * solver.settings.presliding,
                )
            except NotConverged as again:
                count.wasted += again.iterations
                solver.restore(before)
                continue
            moved = float(np.max(np.abs(solver.positions() - shape)))
            count.snapped = count.snapped or moved > 0.02 * solver.length
            count.softened = max(count.softened, factor)
            self._accept(report, end, count)
            return
        raise self._fail(start, end, cause)

    def _leaps(self, before: Snapshot) -> bool:
        """Whether a substep went so far, or so strangely, that it may have left the robot's path."""
        solver = self.solver
        if solver.turn_since(before) > solver.settings.max_substep_turn:
            return True
        return solver.tangent_sign * solver.stable_sign < 0

    def _path_matters(self, before: Snapshot) -> bool:
        """Whether any hole under tension changed its state since ``before``.

        A tendon that is pulled from slack, and slips towards the base at every hole, has no choice of path. Where loads
        change, a hole may turn round and back.
        """
        for robot, state, tension in zip(self.solver.robots, before.histories, before.tensions, strict=True):
            if not robot.law.has_friction:
                continue
            if not self._loads_change and robot.field.mobilisation is state.mobilisation:
                # No hole has moved at all, as is the rule while loading.
                continue
            taut = (tension > 0.0)[:, None]
            if self._loads_change and np.any(taut & robot.law.frictional):
                return True
            old, new = np.trunc(state.mobilisation), np.trunc(robot.field.mobilisation)
            pulled = (robot.base_tension > 0.0)[:, None] & (new < 1.0)
            if np.any((old != new) & robot.law.frictional & (taut | pulled)):
                return True
        return False

    def _turns_back(self, count: _Count) -> bool:
        """Whether any hole that slips may have turned round unseen within the last substep.

        What it slipped in the last two substeps is taken as a parabola. Where that has come back by more than a
        twentieth of the presliding distance at the end, the hole sticks by then or slips the other way, although on
        the whole it went on.
        """
        if len(count.slips) < 3:
            return False
        back = 0.05 * self.solver.settings.presliding
        for robot, *slips in zip(self.solver.robots, *count.slips[-3:], strict=True):
            if not robot.law.has_friction:
                continue
            first, last = slips[1] - slips[0], slips[2] - slips[1]
            rate, bend = 0.5 * (3.0 * last - first), last - first
            slides = (np.abs(robot.state.mobilisation) >= 1.0) & (robot.base_tension > 0.0)[:, None]
            comes_back = (last * rate < 0.0) & (rate**2 > 2.0 * back * np.abs(bend))
            if np.any(slides & robot.law.frictional & comes_back):
                return True
        return False

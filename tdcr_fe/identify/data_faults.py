"""Faults of measured data: what is seen in the readings, and what would make the declared model fit them."""

from __future__ import annotations

import itertools
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment
from scipy.special import gammaln

from tdcr_fe.effects import Experiment
from tdcr_fe.identify.forward import last_parts
from tdcr_fe.identify.noise import series
from tdcr_fe.identify.problem import ROBUST, Fit, FitProblem, huber
from tdcr_fe.identify.result import Jump
from tdcr_fe.io.measured import MeasuredData
from tdcr_fe.io.spreadsheet import number
from tdcr_fe.model.loading import LoadStep

Array = NDArray[np.float64]

#: A fault explains the data where their mean square over sigma falls to this, from `MISFIT` times as much or more [1].
#: A positional residual of pure noise has 1; a robust sum is a little less.
EXPLAINED, MISFIT = 1.5, 4.0
#: Price of a fitted number or a chosen step, in the sum of squares, over the logarithm of the number of readings [1].
PRICE = 2.0
#: Equal readings in so many successive steps are a fault where the model moves by so many sigma meanwhile.
EQUAL_STEPS, MOVES = 4, 10.0
#: A noise of sigma changes every reading where the readings differ by less than this share of sigma.
RESOLVED = 0.2
#: Readings are rounded where they are multiples of more than so many sigma.
ROUNDED = 3.0
#: Sigma is wrong where the scatter of the residual is larger or smaller by this factor [1].
WRONG_SIGMA = 3.0
#: A location beyond the declared length, up to so many times that length, is that of a marker, not of another unit [1].
FARTHEST = 2.0
#: A jump of the residual that is left is reported where it is this many times the scatter before and after it, and
#: sigma [1], there are so many steps on both sides, and it leaves at most this share of what a line leaves [1].
CLEAR_JUMP, LEAST_PART, BESIDE_TREND = 4.0, 4, 0.7
#: A marker is elsewhere where it is read farther from the base than its arc length by this share of the length [1].
ELSEWHERE = 0.25
#: Other drives are simulated with friction where they leave less than this share of the residual without it [1].
LIKELY = 0.5
#: Share of the readings that must be predicted without friction to say whether drives are likely [1].
SOLVED_SHARE = 0.25
#: Largest number of load steps that are simulated to try exchanged tendons.
MOST_STEPS = 1500


@dataclass(frozen=True)
class _Grid:
    """Readings of positions by step, marker and axis; NaN where there is none."""

    # By the declared model [m], shape (n_steps, n_markers, 3)
    measured: Array
    predicted: Array
    sigma: Array
    steps: tuple[int, ...]  # numbers of the steps
    markers: tuple[float, ...]  # arc lengths [m]

    @classmethod
    def of(cls, problem: FitProblem, declared: Fit) -> _Grid:
        """Of the problem's readings and the declared model's predictions."""
        readings = problem.data.readings
        chosen = [
            i
            for i, r in enumerate(readings)
            if r.channel.family == "position" and isinstance(r.location, float)
        ]
        read = {readings[i].step for i in chosen}
        steps = tuple(n for n in problem.data.step_ids if n in read)
        markers = tuple(sorted({float(readings[i].location or 0.0) for i in chosen}))
        row, column = {n: k for k, n in enumerate(steps)}, {s: k for k, s in enumerate(markers)}
        grids = np.full((3, len(steps), len(markers), 3), np.nan)
        predicted = problem.readings.values - declared.residual * problem.sigma
        for i in chosen:
            r = readings[i]
            at = row[r.step], column[float(r.location or 0.0)], "xyz".index(r.quantity[-1])
            grids[(slice(None), *at)] = r.value, predicted[i], problem.sigma[i]
        return cls(grids[0], grids[1], grids[2], steps, markers)

    @property
    def count(self) -> int:
        """Number of readings."""
        return int(np.count_nonzero(np.isfinite(self.measured)))

    def cost(self, measured: Array) -> float:
        """Robust mean square over sigma of readings that were changed; infinite where few are left."""
        r = (measured - self.predicted) / self.sigma
        known = np.isfinite(r)
        if np.count_nonzero(known) < 0.8 * self.count:
            return float("inf")
        return _mean_square(r[known])


def _mean_square(r: Array) -> float:
    """Robust mean square of residuals over sigma; infinite where one is missing."""
    return float(np.mean(huber(r, ROBUST))) if np.all(np.isfinite(r)) else float("inf")


def data_fault(problem: FitProblem, declared: Fit) -> str:
    """The fault of the data that explains the declared model's misfit, as a sentence; empty where there is none.

    Tried are axes exchanged or counted the other way, markers exchanged, readings that belong to other steps, a jump or
    a drift of one coordinate, tendons exchanged or driven the other way. Reported is only what leaves no more than
    noise, where the declared model does not; and sensors that stand still while the robot moves.

    Parameters
    ----------
    problem
        Readings with their sigma.
    declared
        The declared model.
    """
    seen = _declared_length(problem.data) or _opposite_sign(problem, declared)
    if seen:
        return seen
    grid = _Grid.of(problem, declared)
    if len(grid.steps) < EQUAL_STEPS or not grid.markers:
        return ""
    seen = _rounded(grid) or _standing_still(problem, declared)
    if seen:
        return seen
    now = grid.cost(grid.measured)
    if now < MISFIT:
        return ""
    limit = min(EXPLAINED, now / MISFIT)
    price = PRICE * np.log(grid.count) / grid.count
    found = [(grid.cost(m) + count * price, text) for m, count, text in _mended(grid)]
    best = min(found, default=(float("inf"), ""))
    if best[0] > limit:
        best = min(_other_drives(problem, declared), default=best)
    elif (
        "relabelled" in best[1]
    ):  # a symmetric robot turns or mirrors its motion where its tendons are exchanged
        others = [text for cost, text in _other_drives(problem, declared) if cost <= limit]
        best = best[0], ", or if ".join([best[1], *(text.partition(" if ")[2] for text in others)])
    return best[1] if best[0] <= limit else impossible_place(problem.data)


def wrong_sigma(problem: FitProblem, best: Fit) -> str:
    """Whether the scatter about the best model contradicts sigma, as a sentence; empty where it does not.

    Larger scatter counts only where it has no structure along the steps: otherwise the model lacks something.
    """
    r = best.residual[problem.readings.is_position]
    if r.size < 20 or not np.all(np.isfinite(r)):
        return ""
    scatter = 1.4826 * float(np.median(np.abs(r)))
    if scatter < 1.0 / WRONG_SIGMA:
        return (
            f"the readings scatter about the model by {scatter:.2g} times their sigma: sigma is too large, and may "
            "hide what the model is missing"
        )
    if scatter < WRONG_SIGMA:
        return ""
    products = np.concatenate(
        [best.residual[i][1:] * best.residual[i][:-1] for i in series(problem.data.readings) if i.size >= 3]
        or [np.zeros(1)]
    )
    correlation = float(np.median(products)) / scatter**2
    if abs(correlation) > 0.1:
        return ""
    return (
        f"the readings scatter about the model by {scatter:.2g} times their sigma, with no pattern along the steps: "
        "sigma is too small, or the readings are noisier than assumed"
    )


def jump_of_residual(problem: FitProblem, best: Fit) -> Jump | None:
    """The clearest jump of the residual that the best model leaves.

    Measurements on several days have markers that were glued on again, or a camera that was moved. One coordinate of a
    marker is then off by a constant from a step on, whatever effects the model has.
    """
    grid = _Grid.of(problem, best)
    residual, found, clearest = grid.measured - grid.predicted, None, CLEAR_JUMP
    for column, axis in itertools.product(range(len(grid.markers)), range(3)):
        read = np.flatnonzero(np.isfinite(residual[:, column, axis]))
        r = residual[read, column, axis]
        if len(read) < 2 * LEAST_PART:
            continue
        k, size, left = _division(r)
        sigma = float(np.median(grid.sigma[read, column, axis]))
        clear = abs(size) / max(1.4826 * float(np.median(np.abs(left))), sigma)
        trend = r - np.polyval(np.polyfit(read, r, 1), read)
        if clear > clearest and np.sum(np.abs(left)) < BESIDE_TREND * np.sum(np.abs(trend)):
            clearest = clear
            found = Jump(grid.steps[read[k]], grid.markers[column], "xyz"[axis], size)
    return found


def _division(r: Array) -> tuple[int, float, Array]:
    """Where two constants leave the least of a series: the index, their difference, and what is left, shape (n,)."""
    found = []
    for k in range(LEAST_PART, r.size - LEAST_PART + 1):
        before, after = float(np.median(r[:k])), float(np.median(r[k:]))
        found.append((k, after - before, np.concatenate((r[:k] - before, r[k:] - after))))
    return min(found, key=lambda division: float(np.sum(np.abs(division[2]))))


# --------------------------------------------------------------------------------------- seen in the readings


def _declared_length(data: MeasuredData) -> str:
    """Whether a marker of many steps is farther along the backbone than the declared one is long, as a sentence."""
    length = data.robot.backbone.length
    beyond = Counter(number(b.value) for b in data.left_out if b.column == "location")
    markers = {s: n for s, n in beyond.items() if length < s <= FARTHEST * length and n >= EQUAL_STEPS}
    if not markers:
        return ""
    listed = ", ".join(f"s = {s:.4g} m" for s in sorted(markers))
    return (
        f"the declared length contradicts the readings: {sum(markers.values())} of them are of {listed}, beyond the "
        f"end of a backbone that is declared {length:.4g} m long (they were left out); a marker on something beyond "
        "the tip is declared at the tip, with marker_offset along the tangent"
    )


def impossible_place(data: MeasuredData) -> str:
    """A marker that most readings place farther from the base than the backbone is long up to it, as a sentence."""
    squares: dict[tuple[float, int], float] = {}
    for r in data.readings:
        if r.channel.family == "position" and isinstance(r.location, float):
            squares[r.location, r.step] = squares.get((r.location, r.step), 0.0) + r.value**2
    for s in sorted({s for s, _ in squares}):
        far = float(np.sqrt(np.median([x for (at, _), x in squares.items() if at == s])))
        if far > s + ELSEWHERE * data.robot.backbone.length:
            return (
                f"the marker at s = {s:g} m is read {far:.4g} m from the base, where no backbone reaches that has this "
                f"length: it sits at s = {far:.3g} m or beyond"
            )
    return ""


def _opposite_sign(problem: FitProblem, declared: Fit) -> str:
    """Displacements of tendons that were read with the other sign, as a sentence."""
    read = problem.readings.quantities == "tendon_displacement"
    r, value = declared.residual[read], problem.readings.values[read] / problem.sigma[read]
    if np.count_nonzero(read) < EQUAL_STEPS or MISFIT * _mean_square(r - 2.0 * value) > _mean_square(r):
        return ""
    return (
        "the readings of tendon_displacement fit with the other sign: it is positive where a tendon is pulled in, "
        "negative where it is let out"
    )


def _rounded(grid: _Grid) -> str:
    """Readings in steps that are coarser than sigma."""
    values = np.unique(np.round(grid.measured[np.isfinite(grid.measured)], 9))
    if values.size < 5 or grid.count < 20:
        return ""
    step = float(np.min(np.diff(values)))
    whole = np.abs(values / step - np.round(values / step)).max() < 1e-3
    if not whole or step < ROUNDED * float(np.nanmedian(grid.sigma)):
        return ""
    return (
        f"positions are rounded to {1e3 * step:.3g} mm, but their sigma says "
        f"{1e3 * float(np.nanmedian(grid.sigma)):.2g} mm: give the readings as the sensor has them, or the sigma that "
        "belongs to the rounding"
    )


def _standing_still(problem: FitProblem, declared: Fit) -> str:
    """A sensor that reads the same in several steps in which the model moves."""
    readings = problem.data.readings
    predicted = problem.readings.values / problem.sigma - declared.residual
    quantities = problem.readings.quantities
    resolved = {
        q: float(np.min(np.diff(np.unique(problem.readings.values[quantities == q])), initial=np.inf))
        for q in set(quantities.tolist())
    }
    found: list[tuple[int, str]] = []
    for i in series(readings):
        values = problem.readings.values[i]
        resolution = resolved[readings[i[0]].quantity]
        if resolution > RESOLVED * float(np.median(problem.sigma[i])):
            continue  # the noise may leave such readings as they are
        for run in np.split(i, np.flatnonzero(np.diff(values)) + 1):
            moves = float(np.ptp(predicted[run]))
            if run.size >= EQUAL_STEPS and moves > MOVES:
                first, last = readings[run[0]], readings[run[-1]]
                at = "" if first.location is None else f" at {_place(first.location)}"
                text = (
                    f"{first.quantity}{at} is constant at {first.value:.6g} {first.unit} from step {first.step} to "
                    f"{last.step}, where the model moves by {moves:.0f} sigma: the sensor is stuck or saturated"
                )
                found.append((run.size, text))
    if not found:
        return ""
    more = f" ({len(found) - 1} more such stretches)" if len(found) > 1 else ""
    return max(found)[1] + more


def _place(location: float | str) -> str:
    return location if isinstance(location, str) else f"s = {location:g} m"


# --------------------------------------------------------------------------------------- what would mend them


def _mended(grid: _Grid) -> Iterator[tuple[Array, float, str]]:
    """Readings with a fault mended, how many numbers were chosen for it, and what it says."""
    yield from _axes(grid)
    yield from _markers(grid)
    yield from _steps(grid)
    yield from _jumps(grid)
    yield from _drifts(grid)


def _axes(grid: _Grid) -> Iterator[tuple[Array, float, str]]:
    for order in itertools.permutations(range(3)):
        for signs in itertools.product((1.0, -1.0), repeat=3):
            if order == (0, 1, 2) and min(signs) > 0.0:
                continue
            read = ", ".join(
                f"{'xyz'[a]} = {'-' if sign < 0.0 else ''}position_{'xyz'[b]}"
                for a, b, sign in zip(range(3), order, signs, strict=True)
                if a != b or sign < 0.0
            )
            text = f"the readings fit if the axes are relabelled: {read}"
            yield grid.measured[..., order] * np.array(signs), 1, text


def _markers(grid: _Grid) -> Iterator[tuple[Array, float, str]]:
    for a, b in itertools.combinations(range(len(grid.markers)), 2):
        order = np.arange(len(grid.markers))
        order[[a, b]] = b, a
        text = f"the markers at s = {grid.markers[a]:g} m and s = {grid.markers[b]:g} m are exchanged"
        yield grid.measured[:, order], 1, f"the readings fit if {text}"


def _steps(grid: _Grid) -> Iterator[tuple[Array, float, str]]:
    """The assignment of readings to predicted steps that fits best."""
    n = len(grid.steps)
    r = (grid.measured[:, None] - grid.predicted[None, :]) / grid.sigma[:, None]
    both = np.isfinite(r)
    cost = np.sum(huber(np.where(both, r, 0.0), ROBUST) + np.where(both, 0.0, ROBUST), axis=(2, 3))
    for late in (-2, -1, 1, 2):
        moved = np.full_like(grid.measured, np.nan)
        here, there = (
            (slice(late, n), slice(0, n - late)) if late > 0 else (slice(0, n + late), slice(-late, n))
        )
        moved[there] = grid.measured[here]
        count = "one step" if abs(late) == 1 else "two steps"
        way = "later" if late > 0 else "earlier"
        yield (
            moved,
            1,
            f"the readings are shifted: each step has those of {count} {way} in the loading sequence",
        )
    rows, columns = linear_sum_assignment(cost)
    if np.any(columns != rows):
        moved = np.empty_like(grid.measured)
        moved[columns] = grid.measured
        others = int(np.count_nonzero(columns != rows))
        text = f"the readings of {others} of {n} steps fit other steps: their order is not that of the loading sequence"
        yield moved, float(gammaln(others + 1)) / np.log(grid.count), text


def _jumps(grid: _Grid) -> Iterator[tuple[Array, float, str]]:
    """One coordinate of one marker, or of all, off by a constant from a step on."""
    difference = grid.measured - grid.predicted
    groups: list[tuple[slice | int, str]] = [(slice(None), "all markers")]
    if len(grid.markers) > 1:
        groups += [(k, f"the marker at s = {s:g} m") for k, s in enumerate(grid.markers)]
    for (where, name), axis in itertools.product(groups, range(3)):
        part = difference[:, where, axis].reshape(len(grid.steps), -1)
        best, at, by = float("inf"), 0, 0.0
        for k in range(2, len(grid.steps) - 2):
            if np.isnan(part[k:]).all():  # nothing was read there any more
                break
            size = float(np.nanmedian(part[k:]))
            left = np.nansum(np.abs(part[:k])) + np.nansum(np.abs(part[k:] - size))
            if left < best:
                best, at, by = float(left), k, size
        moved = grid.measured.copy()
        moved[at:, where, axis] -= by
        text = (
            f"the readings jump: from step {grid.steps[at]} on, those of {name} are off by {1e3 * by:.3g} mm along "
            f"{'xyz'[axis]}"
        )
        yield moved, 2, text


def _drifts(grid: _Grid) -> Iterator[tuple[Array, float, str]]:
    """One coordinate of all markers that drifts in proportion to the number of the step."""
    number = np.arange(len(grid.steps), dtype=float)
    for axis in range(3):
        difference = grid.measured[..., axis] - grid.predicted[..., axis]
        if np.isnan(difference).all(axis=1).any():
            continue
        level = np.nanmedian(difference, axis=1)
        slope, start = np.polyfit(number, level, 1)
        moved = grid.measured.copy()
        moved[..., axis] -= (start + slope * number)[:, None]
        text = f"the readings drift along {'xyz'[axis]} by {1e3 * slope:.3g} mm per step, in the order of the steps"
        yield moved, 2, text


def _other_drives(problem: FitProblem, declared: Fit) -> Iterator[tuple[float, str]]:
    """Mean squares with two tendons exchanged, or all displacements counted the other way, where that may be."""
    robot, steps = problem.data.robot, problem.experiment.steps
    changes: list[tuple[Mapping[str, str], float, str]] = []
    for a, b in itertools.combinations(robot.tendons, 2):
        if robot.end(a) == robot.end(b):
            changes.append(
                ({a.name: b.name, b.name: a.name}, 1.0, f"tendons {a.name} and {b.name} are exchanged")
            )
    if problem.data.driven_by_displacement:
        changes.append(({}, -1.0, "displacements have the opposite sign"))
    changes = changes[: MOST_STEPS // max(1, len(steps))]
    experiments = [
        replace(problem.experiment, steps=_driven(steps, names, sign)) for names, sign, _ in changes
    ]
    likely = _likely_without_friction(problem, declared, experiments)
    tried = [(e, text) for e, (_, _, text), ok in zip(experiments, changes, likely, strict=True) if ok]
    runs = problem.solve([e for e, _ in tried])
    for (experiment, text), run in zip(tried, runs, strict=True):
        r = problem.residual(experiment, run)[problem.readings.is_position]
        yield _mean_square(r), f"the readings fit if {text}"


def _likely_without_friction(
    problem: FitProblem, declared: Fit, experiments: Sequence[Experiment]
) -> list[bool]:
    """Whether other drives would remove most of the residual, by the change of the predictions without friction.

    A run without friction costs a tenth of one with it. The exchange of two tendons moves the robot by as much as they
    do; friction changes a part of that. Where other drives are not solved to the end, the steps before that decide, if
    they are `SOLVED_SHARE` of all; fewer say nothing, and the drives are tried with friction.
    """
    if problem.experiment.model.friction == "none":
        return [True] * len(experiments)
    free = [
        replace(e, model=replace(e.model, friction="none"), ends=None, steps=_commanded(e))
        for e in (problem.experiment, *experiments)
    ]
    here, *others = [
        problem.residual(e, run)[problem.readings.is_position]
        for e, run in zip(free, problem.solve(free), strict=True)
    ]
    r = declared.residual[problem.readings.is_position]
    found = []
    for other in others:
        left = np.abs(r + other - here)
        known = np.isfinite(left)
        enough = np.count_nonzero(known) >= SOLVED_SHARE * r.size
        found.append(not enough or bool(np.mean(left[known]) <= LIKELY * np.mean(np.abs(r[known]))))
    return found


def _commanded(experiment: Experiment) -> tuple[LoadStep, ...]:
    """The steps that are commanded, as ends of their parts."""
    return tuple(experiment.steps[j] for j in last_parts(experiment))


def other_sign_solves(problem: FitProblem) -> str:
    """A sentence where the declared model, which is not solved, is solved with displacements of the other sign."""
    if not problem.data.driven_by_displacement:
        return ""
    steps = _driven(problem.experiment.steps, {}, -1.0)
    (run,) = problem.solve([replace(problem.experiment, steps=steps)])
    if run.solved < len(problem.data.steps):
        return ""
    return (
        "With the opposite sign of all displacements it does: they are positive where a tendon is pulled in, negative "
        "where it is let out."
    )


def _driven(steps: tuple[LoadStep, ...], names: Mapping[str, str], sign: float) -> tuple[LoadStep, ...]:
    """The steps with the inputs of some tendons given to others, and displacements times a sign."""
    return tuple(
        replace(
            s,
            tensions={names.get(n, n): t for n, t in s.tensions.items()},
            displacements={names.get(n, n): sign * d for n, d in s.displacements.items()},
        )
        for s in steps
    )

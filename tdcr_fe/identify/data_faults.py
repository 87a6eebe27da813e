"""Faults of measured data: seen in the readings, or mended so that the declared model fits."""

from __future__ import annotations

import itertools
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
from scipy.optimize import linear_sum_assignment
from scipy.special import gammaln

from tdcr_fe.effects import Experiment
from tdcr_fe.elements import Array, Index
from tdcr_fe.identify.forward import Job
from tdcr_fe.identify.noise import OUTLIER, is_noise, outliers, robust_scatter, series, structure
from tdcr_fe.identify.problem import NOISE_REACHES, Fit, FitProblem, huber, join_steps
from tdcr_fe.identify.result import MOST_NOISE
from tdcr_fe.identify.rows import FEWEST, RowChoice
from tdcr_fe.io.measured import MeasuredData, impossible_place
from tdcr_fe.io.tables import number
from tdcr_fe.model.channels import CHANNELS, arc_lengths
from tdcr_fe.model.loading import Load
from tdcr_fe.model.units import mistaken

#: A fault is looked for where the mean square of the residual over sigma is at least so many times that of noise. It
#: explains the data where it reduces that to noise and by this factor, or by the square of the factor [1]. A missing
#: effect may be left beside the right fault, which still removes far more than a wrong one: displacements with the
#: other sign and errors of 30 and 100 um left a 190th to a 29th, wrong faults an eighth.
MISFIT = 4.0
#: A noise of sigma changes every reading where the readings differ by less than this share of sigma [1].
RESOLVED = 0.2
#: Sigma is wrong where the scatter of the residual is larger or smaller by this factor [1].
WRONG_SIGMA = 3.0
#: Gross errors are those of at most this share of all markers in all steps [1].
MOST_GROSS = 0.1
#: A location beyond the declared length, up to so many times that length, is that of a marker, not of another unit [1].
FARTHEST = 2.0

#: Steps of long data on which other inputs are tried: 44 for nine tendons took 150 s on all, 44 s on thirty steps.
SHOWING = 15

#: How the sentence of a fault begins, and the sign of displacements.
_FIT_IF, _PULLED_IN = "the readings fit if {since}", "they are positive where a tendon is pulled in"


# ------------------------------------------------------------------------------------------------ the judgement


class _Fault(NamedTuple):
    """What would mend the data."""

    residual: Array  # of the mended readings over sigma, as those of `_Grid`
    text: str  # with ``{since}`` for the row from which on it holds
    chosen: float = 1.0  # how many numbers were chosen for it


class _Drive(NamedTuple):
    """What the declared inputs should have been."""

    text: str
    names: Mapping[str, str] = MappingProxyType({})  # which tendon those of a tendon are of
    displacements: float = 1.0  # their factor
    forces: float = 1.0


@dataclass(frozen=True)
class _Grid:
    """Readings of positions or curvatures by step, marker and axis, or of tendons; NaN where there is none."""

    family: str  # of the quantities
    # By the declared model, shape (n_steps, n_markers, n_axes)
    measured: Array
    predicted: Array
    sigma: Array
    steps: tuple[int, ...]  # numbers of the steps
    markers: tuple[float | str, ...]  # arc lengths [m], or names of tendons
    which: Index  # indices of the readings, shape (n,)
    at: tuple[Index, ...]  # where they are

    @classmethod
    def of(cls, problem: FitProblem, declared: Fit, family: str) -> _Grid:
        """Grid of the problem's readings and the declared model's predictions."""
        names = [c.quantity for c in CHANNELS if c.family == family]
        which = np.flatnonzero(np.isin(problem.readings.quantities, names))
        places = [problem.data.readings[i].location for i in which]
        at_tendons = family.endswith(("displacement", "tension"))
        where = np.array(places) if at_tendons else arc_lengths(places)
        markers, column = np.unique(where, return_inverse=True)
        rows, row = np.unique(problem.readings.step[which], return_inverse=True)
        at = row, column, np.array([names.index(q) for q in problem.readings.quantities[which]], dtype=int)
        steps = tuple(problem.data.step_ids[k] for k in rows)
        measured, predicted, sigma = np.full((3, rows.size, markers.size, len(names)), np.nan)
        values = problem.readings.values
        measured[at], sigma[at] = values[which], problem.whole_sigma[which]
        predicted[at] = (values - problem.lengths(declared.residual))[which]
        return cls(family, measured, predicted, sigma, steps, tuple(markers.tolist()), which, at)

    def table(self, values: Array) -> Array:
        """Values of all readings by step, marker and axis."""
        found = np.full_like(self.measured, np.nan)
        found[self.at] = values[self.which]
        return found

    def mended(self, measured: Array, text: str, chosen: float = 1.0) -> _Fault:
        """A fault with the readings as they should be."""
        return _Fault((measured - self.predicted) / self.sigma, text, chosen)

    def judged(self, fault: _Fault) -> tuple[float, str, int]:
        """Robust mean square over sigma with a fault mended from some row on, its sentence, and that row from 0.

        With a price for every number that was chosen, and for the row: twice the logarithm of how many there are.
        Infinite where few readings are left.
        """
        both = np.stack(((self.measured - self.predicted) / self.sigma, fault.residual))
        known = np.isfinite(both)
        squares = np.sum(huber(np.where(known, both, 0.0), NOISE_REACHES), axis=(2, 3))
        counts = np.sum(known, axis=(2, 3))

        def since(values: Array) -> Array:
            before = np.concatenate(([0.0], np.cumsum(values[0])[:-1]))
            return before + np.cumsum(values[1][::-1])[::-1]

        left, total = since(counts), float(counts[0].sum())
        price = 2.0 * np.log(total) / total * (fault.chosen + (np.arange(len(left)) > 0))
        cost = np.where(left < 0.8 * total, np.inf, since(squares) / np.maximum(left, 1.0) + price)
        k = int(np.argmin(cost))
        return float(cost[k]), fault.text.format(since=f"from step {self.steps[k]} on " if k else ""), k


def data_fault(problem: FitProblem, declared: Fit) -> str:
    """The fault of the data that explains the declared model's misfit, as a sentence; empty where there is none.

    Tried are axes of positions or curvatures exchanged or counted the other way, heights that do not count from the
    base, markers exchanged, readings that belong to other steps, tendons exchanged, moved on by one, or driven or
    pushed the other way, and readings of tendons exchanged or in another unit; each from some row on. Reported is only
    what leaves no more than noise, where the declared model does not, or far less than that; and sensors that stand
    still while the robot moves. Readings that jump or drift are causes of the dictionary.

    Parameters
    ----------
    problem
        Readings with their sigma.
    declared
        The declared model.
    """
    if seen := _declared_length(problem.data):
        return seen
    grids = [_Grid.of(problem, declared, family) for family in ("position", "curvature")]
    found = [_mended(problem, declared, g) for g in grids if len(g.steps) >= FEWEST]
    return next(filter(None, found), "") or _tendon_readings(problem, declared)


def _mended(problem: FitProblem, declared: Fit, grid: _Grid) -> str:
    """The fault of one family of readings, as a sentence."""
    seen = _rounded(grid) or _standing_still(problem, declared)
    now = _mean_square(declared.residual[grid.which])
    if seen or now < MISFIT:
        return seen
    limit = max(min(MOST_NOISE, now / MISFIT), now / MISFIT**2)
    length = problem.data.robot.backbone.length
    faults = (*_axes(grid), *_heights(grid, length), *_markers(grid), *_steps(grid))
    cost, text, _ = min(map(grid.judged, faults))
    if cost > limit:
        cost, text = _other_drives(problem, declared, grid)
    elif "relabelled" in text:
        # A symmetric robot turns or mirrors its motion where its tendons are exchanged.
        other, drives = _other_drives(problem, declared, grid)
        text += f", or if {drives.partition(' if ')[2]}" if other <= limit else ""
    if cost > limit:
        return impossible_place(problem.data)
    how = "fit" if cost <= MOST_NOISE else "fit far better, though not to their noise,"
    return text.replace("fit", how, 1)


def _tendon_readings(problem: FitProblem, declared: Fit) -> str:
    """Displacements or tensions that fit with another sign, in another unit or of another tendon, as a sentence."""
    for family, unit in (("tendon_displacement", "m"), ("base_tension", "N"), ("distal_tension", "N")):
        grid = _Grid.of(problem, declared, family)
        if len(grid.steps) >= FEWEST:
            scales = {f"if they are in {other}": size for other, size in mistaken(unit).items()}
            if unit == "m":
                scales[f"with the other sign: {_PULLED_IN}"] = -1.0
            read = f"the readings of {family} fit"
            scaled = (grid.mended(grid.measured * x, f"{read} {text}") for text, x in scales.items())
            faults = [(_mean_square(f.residual[grid.at]), f.text) for f in (*_markers(grid), *scaled)]
            cost, text = min(faults)
            nothing = _mean_square((grid.predicted / grid.sigma)[grid.at])  # what a small factor leaves
            if MISFIT * cost < min(_mean_square(declared.residual[grid.which]), nothing):
                return text.format(since="")
    return ""


def _mean_square(r: Array) -> float:
    """Robust mean square of residuals over sigma; infinite where one is missing."""
    return float(np.mean(huber(r, NOISE_REACHES))) if np.all(np.isfinite(r)) else float("inf")


def wrong_sigma(problem: FitProblem, best: Fit) -> str:
    """Whether the scatter about the best model contradicts sigma, as a sentence; empty where it does not.

    Larger scatter counts only where it has no structure along the steps: otherwise the model lacks something.
    """
    r = best.residual[problem.readings.is_position]
    if r.size < 20 or not np.all(np.isfinite(r)):
        return ""
    scatter = robust_scatter(r)
    seen = f"the readings scatter about the model by {scatter:.2g} times their sigma"
    if scatter < 1.0 / WRONG_SIGMA:
        return f"{seen}: sigma is too large, and may hide what the model is missing"
    if scatter < WRONG_SIGMA:
        return ""
    along = [best.residual[i] for i in series(problem.data.readings) if i.size >= 3]
    products = np.concatenate([x[1:] * x[:-1] for x in along] or [np.zeros(1)])
    correlation = float(np.median(products)) / scatter**2
    if abs(correlation) > 0.1:
        return ""
    why = "sigma is too small, or the readings are noisier than assumed"
    return f"{seen}, with no pattern along the steps: {why}"


def gross_errors(problem: FitProblem, best: Fit) -> str:
    """Whether a few readings alone contradict the best model, as a sentence; empty where they do not.

    A marker is left out in a step with all its readings where one is an outlier; what is left has to be noise. Half of
    them are twice as far off as an outlier: a wall along the backbone, taken for one at the tip, left one just above.
    Not all of several markers in the same steps: a loose base did that in all steps without tension.
    """
    data, r = problem.data, best.residual
    where = [(x.step, x.location) for x in data.readings]
    found = outliers(r)
    wrong, count = {where[i] for i, _ in found}, len(set(where))
    far = np.abs([x for _, x in found])
    if not wrong or len(wrong) > MOST_GROSS * count or np.median(far) < 2.0 * OUTLIER:
        return ""
    kept = np.array([at not in wrong for at in where])
    rest = replace(data, readings=tuple(itertools.compress(data.readings, kept)))
    if not is_noise(structure(rest, r[kept], len(best.free))):
        return ""
    steps = sorted({step for step, _ in wrong})
    if len(steps) < len(wrong) == len({at for at in where if at[0] in steps}):
        return ""
    listed = ", ".join(map(str, steps[:10])) + (", ..." if len(steps) > 10 else "")
    off = f"{len(wrong)} of {count} markers and sensors, counted in every step, are far off"
    why = "their readings are wrong, or something acts in these steps alone"
    return f"{off} (in steps {listed}), and all others leave only noise: {why}"


# --------------------------------------------------------------------------------------- seen in the readings


def _declared_length(data: MeasuredData) -> str:
    """Whether a marker of many steps is farther along the backbone than the declared one is long, as a sentence."""
    length = data.robot.backbone.length
    beyond = Counter(number(b.value) for b in data.left_out if b.column == "location")
    markers = {s: n for s, n in beyond.items() if length < s <= FARTHEST * length and n >= FEWEST}
    if not markers:
        return ""
    listed = ", ".join(f"s = {s:.4g} m" for s in sorted(markers))
    return (
        f"the declared length contradicts the readings: {sum(markers.values())} of them are of {listed}, beyond the "
        f"end of a backbone that is declared {length:.4g} m long (they were left out); a marker on something beyond "
        "the tip is declared at the tip, with marker_offset along the tangent"
    )


def _rounded(grid: _Grid) -> str:
    """Positions in steps that are coarser than sigma."""
    if grid.family != "position":
        return ""
    values = np.unique(np.round(grid.measured[np.isfinite(grid.measured)], 9))
    if values.size < 5 or grid.which.size < 20:
        return ""
    step, sigma = float(np.min(np.diff(values))), float(np.nanmedian(grid.sigma))
    # steps of 3.5 sigma alone give that sigma
    whole = np.abs(values / step - np.round(values / step)).max() < 1e-3
    if not whole or step < NOISE_REACHES * sigma:
        return ""
    seen = f"positions are rounded to {1e3 * step:.3g} mm, but their sigma says {1e3 * sigma:.2g} mm"
    return f"{seen}: give the readings as the sensor has them, or the sigma that belongs to the rounding"


def _standing_still(problem: FitProblem, declared: Fit) -> str:
    """A sensor that reads the same in several steps in which the model moves."""
    readings = problem.data.readings
    predicted = (problem.readings.values - problem.lengths(declared.residual)) / problem.sigma
    found: list[tuple[int, str]] = []
    for i in series(readings):
        values = problem.readings.values[i]
        alike = problem.readings.values[problem.readings.quantities == readings[i[0]].quantity]
        resolution = float(np.min(np.diff(np.unique(alike)), initial=np.inf))
        if resolution > RESOLVED * float(np.median(problem.sigma[i])):
            continue  # the noise may leave such readings as they are
        for run in np.split(i, np.flatnonzero(np.diff(values)) + 1):
            moves = float(np.ptp(predicted[run]))
            first, last = readings[run[0]], readings[run[-1]]
            slack = first.unit == "N" and first.value == 0.0 and values.any()
            if run.size >= FEWEST and moves > 2.0 * OUTLIER and not slack:
                place = first.location if isinstance(first.location, str) else f"s = {first.location:g} m"
                at = "" if first.location is None else f" at {place}"
                seen = f"constant at {first.value:.6g} {first.unit} from step {first.step} to {last.step}"
                why = f"where the model moves by {moves:.0f} sigma: the sensor is stuck or saturated"
                found.append((run.size, f"{first.quantity}{at} is {seen}, {why}"))
    if not found:
        return ""
    return max(found)[1] + (f" ({len(found) - 1} more such stretches)" if len(found) > 1 else "")


# --------------------------------------------------------------------------------------- what would mend them


def _axes(grid: _Grid) -> Iterator[_Fault]:
    n = grid.measured.shape[-1]
    for order in itertools.permutations(range(n)):
        for signs in itertools.product((1.0, -1.0), repeat=n):
            axes = zip("xyz"[:n], order, signs, strict=True)
            read = [(a, "-" if x < 0.0 else "", "xyz"[b]) for a, b, x in axes if a != "xyz"[b] or x < 0.0]
            if read:
                text = ", ".join(f"{a} = {sign}{grid.family}_{b}" for a, sign, b in read)
                measured = grid.measured[..., order] * np.array(signs)
                yield grid.mended(measured, f"{_FIT_IF}the axes are relabelled: {text}")


def _heights(grid: _Grid, length: float) -> Iterator[_Fault]:
    """Heights that count from the unloaded marker or from the tip, up or down."""
    starts = (("the unloaded marker", np.array(grid.markers)), ("the unloaded tip", length))
    for start, zero in starts if grid.family == "position" else ():
        for sign, way in ((1.0, "up"), (-1.0, "down")):
            measured = grid.measured.copy()
            measured[..., 2] = zero + sign * measured[..., 2]
            text = f"position_z counts {way} from {start}, not from the base plate"
            yield grid.mended(measured, _FIT_IF + text)


def _markers(grid: _Grid) -> Iterator[_Fault]:
    for a, b in itertools.combinations(range(len(grid.markers)), 2):
        order = np.arange(len(grid.markers))
        order[[a, b]] = b, a
        one, other = grid.markers[a], grid.markers[b]
        if isinstance(one, str):
            text = f"the readings of {grid.family} fit if {{since}}those of {one} and {other} are exchanged"
        else:
            text = f"{_FIT_IF}the markers at s = {one:g} m and s = {other:g} m are exchanged"
        yield grid.mended(grid.measured[:, order], text)


def _steps(grid: _Grid) -> Iterator[_Fault]:
    """Readings of one or two steps before or after, and the assignment to predicted steps that fits best."""
    n = len(grid.steps)
    for late in (-2, -1, 1, 2):
        moved = np.full_like(grid.measured, np.nan)
        here, there = slice(max(late, 0), n + min(late, 0)), slice(max(-late, 0), n - max(late, 0))
        moved[there] = grid.measured[here]
        count, way = "one step" if abs(late) == 1 else "two steps", "later" if late > 0 else "earlier"
        text = f"the readings are shifted: {{since}}those of each step appear {count} {way}"
        yield grid.mended(moved, text)
    r = (grid.measured[:, None] - grid.predicted[None, :]) / grid.sigma[:, None]
    each = np.where(np.isfinite(r), huber(r, NOISE_REACHES), NOISE_REACHES)
    rows, columns = linear_sum_assignment(np.sum(each, axis=(2, 3)))
    others = int(np.count_nonzero(columns != rows))
    if others:
        moved = np.empty_like(grid.measured)
        moved[columns] = grid.measured
        text = f"the readings of {others} of {n} steps fit other steps: their order is not that of the loading sequence"
        yield grid.mended(moved, text, float(gammaln(others + 1)) / np.log(grid.which.size))


def _other_drives(problem: FitProblem, declared: Fit, grid: _Grid) -> tuple[float, str]:
    """Mean square with two tendons exchanged, those that end together moved on, displacements or forces reversed.

    And the sentence of what fits best.

    Runs without friction, which cost a tenth, show which change promises most, of long data on some of the steps; that
    one is simulated with friction.
    """
    robot, declared_drive = problem.data.robot, problem.experiment
    couples = itertools.combinations(robot.tendon_names, 2)
    drives = [_Drive(f"tendons {a} and {b} are exchanged", {a: b, b: a}) for a, b in couples]
    for end in sorted({robot.end(t) for t in robot.tendons}):
        ring = [t.name for t in robot.tendons if robot.end(t) == end]
        for k in range(1, len(ring)) if len(ring) > 2 else ():
            turned = ring[k:] + ring[:k]
            text = f"the inputs of {', '.join(ring)} are those of {', '.join(turned)}"
            drives.append(_Drive(text, dict(zip(ring, turned, strict=True))))
    if problem.data.driven_by_displacement:
        drives.append(_Drive("displacements have the opposite sign", displacements=-1.0))
    if any(step.loads for step in declared_drive.steps):
        drives.append(_Drive("forces at the tip have the opposite sign", forces=-1.0))
    if not drives:
        return np.inf, ""
    steps = len(problem.data.steps)
    if steps > 4 * SHOWING and not problem.data.parts:
        rows = RowChoice.of_steps(problem.data, range(0, steps, steps // SHOWING))
        known = replace(declared, residual=declared.residual[list(rows.readings)])
        few = problem.of_rows(rows)
        drives = [_most_promising(few, known, _Grid.of(few, known, grid.family), drives)[-1]]
    cost, text, first, drive = _most_promising(problem, declared, grid, drives)
    if cost > 0.5 * _mean_square(declared.residual[grid.which]):
        return np.inf, ""
    driven = _driven(declared_drive, drive, problem.data.step_ids.index(grid.steps[first]))
    (run,) = problem.run([Job(driven)])
    return _mean_square(problem.residual(driven, run)[grid.which]), text


def _most_promising(
    problem: FitProblem, declared: Fit, grid: _Grid, drives: Sequence[_Drive]
) -> tuple[float, str, int, _Drive]:
    """The inputs, of several, that fit best without friction, after what `_Grid.judged` says of them."""
    plain = replace(
        problem.experiment, model=replace(problem.experiment.model, friction="none", elements_per_bay=1)
    )
    free = [join_steps(plain), *(join_steps(_driven(plain, drive)) for drive in drives)]
    runs = problem.run([Job(e) for e in free])
    here, *others = [problem.residual(e, run) for e, run in zip(free, runs, strict=True)]
    judged = []
    for other, drive in zip(others, drives, strict=True):
        fault = _Fault(grid.table(declared.residual + other - here), _FIT_IF + drive.text)
        judged.append((*grid.judged(fault), drive))
    return min(judged, key=lambda x: x[0])


def _driven(experiment: Experiment, drive: _Drive, since: int = 0) -> Experiment:
    """With other inputs and forces from a commanded step on."""
    (_, names, factor, push), steps = drive, list(experiment.steps)

    def pushed(load: Load) -> Load:
        x, y, z = load.force
        return replace(load, force=(push * x, push * y, push * z))

    for j, (k, _) in enumerate(experiment.ends):
        if k >= since:
            tensions = {names.get(n, n): x for n, x in steps[j].tensions.items()}
            displacements = {names.get(n, n): factor * x for n, x in steps[j].displacements.items()}
            loads = {n: pushed(x) for n, x in steps[j].loads.items()}
            steps[j] = replace(steps[j], tensions=tensions, displacements=displacements, loads=loads)
    return replace(experiment, steps=tuple(steps))


def other_sign_solves(problem: FitProblem) -> str:
    """A sentence where the declared model, which is not solved, is solved with displacements of the other sign."""
    if not problem.data.driven_by_displacement:
        return ""
    (run,) = problem.run([Job(_driven(problem.experiment, _Drive("", displacements=-1.0)))])
    if not run.solved:
        return ""
    return f"With the opposite sign of all displacements it does: {_PULLED_IN}, negative where it is let out."

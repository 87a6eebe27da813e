"""Fit the parameters of some effects to the readings: whitened, bounded, robust, from sensitivities of the solver."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import lsq_linear

from tdcr_fe.effects import EFFECTS, Effect, ExcitationRange, Experiment
from tdcr_fe.identify.forward import ForwardModel, Reader, Run, divide_steps
from tdcr_fe.identify.outcome import Misfit
from tdcr_fe.io.measured import MeasuredData

Array = NDArray[np.float64]
Point = dict[str, dict[str, float]]

#: A single reading counts in full up to this many of its sigma (of the present misfit, where that is larger).
ROBUST = 4.0

#: A parameter whose natural step changes the readings by less than this, rms over sigma, changes nothing.
NOTHING = 0.02

#: Error of the mesh that is let pass, rms over sigma: hundreds of readings do not make a signal of it.
MESH = 0.1

#: Elements a bay, at most.
FINEST = 6

#: Order of the mesh's error that is counted on; four where bending is small.
ORDER = 3.2

#: Share of the extrapolated error of mesh and path that may be wrong.
UNSURE = 1.0 / 3.0

#: The computation is trusted to this share of the length, and to as many radians.
NUMERICS = 2e-5

#: A step that moves a reading by more than this, over sigma, when it is divided, stays divided.
PATH = 0.4

#: Into how many parts to see; twice as many where it matters.
PARTS = 4


@dataclass(frozen=True)
class Fit:
    """A model with its parameters fitted.

    Attributes
    ----------
    effects : tuple of Effect
        In the order of adding.
    values : dict
        By effect and parameter.
    residual : ndarray, shape (n,)
        Reading less model, over sigma, of all readings.
    cost, held_cost : float
        Robust sums of squares over fitted and held-out readings.
    jacobian : ndarray, shape (n, p)
        Of the predictions over sigma, by coordinate of every free parameter.
    free : tuple of (str, str)
        Effect and name of every free parameter.
    run : Run
    """

    effects: tuple[Effect, ...]
    values: Point
    residual: Array
    cost: float
    held_cost: float
    jacobian: Array
    free: tuple[tuple[str, str], ...]
    run: Run
    details: dict[str, float] = field(default_factory=dict)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the effects."""
        return tuple(e.name for e in self.effects)

    @property
    def anew(self) -> Fit:
        """The same without its sensitivities, so that fresh ones are taken."""
        return replace(self, jacobian=self.jacobian[:, :0])

    @property
    def solved(self) -> bool:
        """Whether every reading is predicted."""
        return bool(np.isfinite(self.cost + self.held_cost))


def huber(r: Array, threshold: float) -> Array:
    """Contribution of every residual to the robust sum of squares."""
    a = np.abs(r)
    return np.where(a <= threshold, a**2, 2.0 * threshold * a - threshold**2)


class Problem:
    """Readings, their sigma, and the forward model that predicts them.

    Parameters
    ----------
    data
        Readings and declared robot.
    sigma
        Of every reading, in its unit, shape (n,).
    held
        Which readings are held out, shape (n,).
    forward
        Runs experiments.
    """

    def __init__(
        self, data: MeasuredData, sigma: Array, held: NDArray[np.bool_], forward: ForwardModel
    ) -> None:
        self.data = data
        self.forward = forward
        self.held = held
        self.values = np.array([r.value for r in data.readings])
        self.sigma = sigma
        self.reader = Reader(data.readings, data.step_ids, data.robot.tendon_names)
        self.declared = Experiment(data.robot, replace(data.model, elements_per_bay=1), data.steps)
        #: What a finer mesh and path would add to the residual, over sigma, as last seen.
        self.correction = np.zeros_like(self.values)
        self.mesh_error = 0.0
        units = np.array([r.unit for r in data.readings])
        quantities = np.array([r.quantity for r in data.readings])
        self.quantities = quantities
        self.is_position = np.array([q.startswith("position_") for q in quantities])
        self.is_angle = units == "rad"
        places: dict[tuple[int, float | str | None], int] = {}
        #: Which marker in which step a position reading belongs to.
        self.markers = np.array([places.setdefault((r.step, r.location), len(places)) for r in data.readings])
        self.threshold = ROBUST
        self.scales: dict[tuple[str, str], float] = {}

    # ------------------------------------------------------------------ predicting

    def setup(self, effects: Sequence[Effect], values: Point) -> Experiment:
        """The declared experiment with effects, applied in the order of the catalogue, unlisted ones last."""
        order = {e.name: i for i, e in enumerate(EFFECTS)}
        experiment = self.declared
        for e in sorted(effects, key=lambda e: order.get(e.name, len(order))):
            experiment = e.apply(experiment, values[e.name])
        return experiment

    def residuals(
        self,
        effects: Sequence[Effect],
        points: Sequence[Point],
        guide: Run | None = None,
        record: bool = False,
    ) -> tuple[list[Array], list[Run]]:
        """Reading less model over sigma at several points; NaN where the model does not get."""
        experiments = [self.setup(effects, p) for p in points]
        runs = self.forward.run(experiments, guide, record)
        return [self.residual(s, run) for s, run in zip(experiments, runs, strict=True)], runs

    def residual(self, experiment: Experiment, run: Run) -> Array:
        """Reading less model over sigma."""
        return (self.values - self.reader.read(run, experiment)) / self.sigma + self.correction

    def sharpen(self, effects: Sequence[Effect], values: Point) -> bool:
        """Choose mesh and path so fine that their errors stay below the noise near a point.

        A run with one element a bay more and all steps divided tells whether either matters; if so, each is judged
        by itself. Elements are added until the error, which falls with a power of their number, is small; steps that
        come out otherwise when divided stay divided. What is then left is extrapolated and taken out of the
        predictions.

        Returns
        -------
        bool
            Whether anything was changed, so that earlier predictions no longer count.
        """
        self.correction = np.zeros_like(self.values)
        (here,), _ = self.residuals(effects, [values], record=True)
        both, _ = self._finer(effects, values, mesh=True, path=True)
        n = self.declared.model.starting_elements_per_bay
        share = 1.0 - (n / (n + 1.0)) ** ORDER
        change = _known(both - here)
        total = float(np.sqrt(np.mean(change**2)))
        if total <= MESH * share and float(np.max(np.abs(change))) <= PATH:
            self.mesh_error = total / share
            self.correction = change / share
            return False
        meshed, _ = self._finer(effects, values, mesh=True, path=False)
        self.mesh_error = float(np.sqrt(np.mean(_known(meshed - here) ** 2))) / share
        changed = False
        change = np.abs(_known(both - meshed))
        steps = {int(k) for k in np.unique(self.reader.step[change > PATH])}
        if steps:
            finer = divide_steps(self.declared, steps, 2 * PARTS)
            changed = finer is not self.declared
            self.declared = finer
        if self.mesh_error > MESH and n < FINEST:
            more = min(FINEST, max(n + 1, int(np.ceil(n * (self.mesh_error / MESH) ** (1.0 / ORDER)))))
            self.declared = replace(self.declared, model=replace(self.declared.model, elements_per_bay=more))
            self.mesh_error *= (n / more) ** ORDER
            changed = True
        return changed

    def _finer(self, effects: Sequence[Effect], values: Point, mesh: bool, path: bool) -> tuple[Array, Run]:
        """Residual at a point with one element a bay more, or with every step divided."""
        coarse = self.declared
        if mesh:
            n = coarse.model.starting_elements_per_bay + 1
            self.declared = replace(self.declared, model=replace(coarse.model, elements_per_bay=n))
        if path:
            self.declared = divide_steps(self.declared, set(range(len(self.data.steps))), PARTS)
        try:
            (r,), (run,) = self.residuals(effects, [values])
        finally:
            self.declared = coarse
        return r, run

    def cost(self, r: Array) -> tuple[float, float]:
        """Robust sums of squares over fitted and held-out readings; infinite where a prediction is missing."""
        if not np.all(np.isfinite(r)):
            return float("inf"), float("inf")
        c = huber(r, self.threshold)
        return float(np.sum(c[~self.held])), float(np.sum(c[self.held]))

    def misfit(self, r: Array, which: NDArray[np.bool_], parameters: int = 0) -> Misfit:
        """Misfit of residuals over sigma on some readings."""
        raw = r * self.sigma
        angles = raw[which & self.is_angle]
        p = which & self.is_position
        distance = np.sqrt(np.bincount(self.markers[p], weights=raw[p] ** 2)) if np.any(p) else np.zeros(0)
        distance = distance[np.bincount(self.markers[p]) > 0] if np.any(p) else distance
        return Misfit(
            float(np.sqrt(np.mean(distance**2))) if distance.size else None,
            float(np.sqrt(np.mean(angles**2))) if angles.size else None,
            float(np.max(distance)) if distance.size else None,
            float(np.sum(r[which] ** 2) / max(1, int(np.count_nonzero(which)) - parameters)),
            int(np.count_nonzero(which)),
            float(np.sqrt(np.mean(raw[p] ** 2))) if np.any(p) else None,
            {
                q: float(np.sqrt(np.mean(raw[which & (self.quantities == q)] ** 2)))
                for q in dict.fromkeys(self.quantities[which].tolist())
            },
        )

    def excitation_range(self, run: Run) -> ExcitationRange:
        """How far the data go."""
        bend = np.linalg.norm(run.curvature[..., :2], axis=-1)
        commanded = [t for s in self.data.steps for t in s.tensions.values()]
        needed = float(np.nanmax(run.base_tensions, initial=0.0))
        moved = [abs(d) for s in self.data.steps for d in s.displacements.values()]
        times = [s.time for s in self.data.steps if s.time is not None]
        return ExcitationRange(
            max([*commanded, needed, 1e-6]),
            max([*moved, float(np.nanmax(np.abs(run.displacements), initial=0.0)), 1e-9]),
            float(np.nanmax(bend, initial=1e-6)),
            max(times, default=0.0),
        )

    # ------------------------------------------------------------------ coordinates

    def bounds(self, e: Effect, name: str) -> tuple[float, float]:
        """Bounds of a parameter's coordinate."""
        p = next(p for p in e.parameters if p.name == name)
        a, b = (p.coordinate(x) for x in e.bounds(self.declared)[name])
        return min(a, b), max(a, b)

    def coordinates(self, effects: Sequence[Effect], values: Point, free: Sequence[tuple[str, str]]) -> Array:
        """Fitted numbers of the free parameters, shape (p,)."""
        parameter = {(e.name, p.name): p for e in effects for p in e.parameters}
        return np.array([parameter[k].coordinate(values[k[0]][k[1]]) for k in free])

    def point(
        self, effects: Sequence[Effect], values: Point, free: Sequence[tuple[str, str]], z: Array
    ) -> Point:
        """Values with the free parameters at these coordinates."""
        parameter = {(e.name, p.name): p for e in effects for p in e.parameters}
        new = {k: dict(v) for k, v in values.items()}
        for k, x in zip(free, z, strict=True):
            new[k[0]][k[1]] = parameter[k].value(float(x))
        return new

    # ------------------------------------------------------------------ fitting

    def evaluate(self, effects: Sequence[Effect], values: Point) -> Fit:
        """A model at given values, nothing fitted."""
        (r,), (run,) = self.residuals(effects, [values], record=True)
        return Fit(tuple(effects), values, r, *self.cost(r), np.zeros((r.size, 0)), (), run)

    def sensitivities(
        self, effects: Sequence[Effect], fit: Fit, free: Sequence[tuple[str, str]], steps: Array
    ) -> Array:
        """Derivatives of the predictions over sigma by the coordinates, by runs beside the present one, (n, p)."""
        z = self.coordinates(effects, fit.values, free)
        points, taken = [], []
        by_name = {e.name: e for e in effects}
        for j, k in enumerate(free):
            low, high = self.bounds(by_name[k[0]], k[1])
            h = steps[j] if z[j] + steps[j] <= high else -steps[j]
            if z[j] + h < low:
                h = max(high - z[j], low - z[j], key=abs)
            moved = z.copy()
            moved[j] += h
            taken.append(h)
            points.append(self.point(effects, fit.values, free, moved))
        found, _ = self.residuals(effects, points, guide=fit.run)
        columns = [(fit.residual - r) / h for r, h in zip(found, taken, strict=True)]
        matrix = np.stack(columns, axis=1) if columns else np.zeros((fit.residual.size, 0))
        return np.where(np.isfinite(matrix), matrix, 0.0)

    def fit(
        self,
        effects: Sequence[Effect],
        starts: Sequence[Point],
        hopeless: float = float("inf"),
        max_iterations: int = 12,
        guide: Run | None = None,
        polish: bool = True,
    ) -> Fit:
        """Levenberg and Marquardt with bounds.

        On the way, every run follows the path of the one before, which is fast; what comes out is simulated on its
        own path, and improved from there where that differs.

        Parameters
        ----------
        effects
            Whose parameters are fitted.
        starts
            Points to begin from; the best is taken. The second and later ones are tried only where the first does not
            improve on ``guide`` alone.
        hopeless
            A fit that hardly moves while its cost is above this is given up.
        max_iterations
            Steps.
        guide
            A neighbour's run for the starting points.
        polish
            Go on to the end; see `finish`.

        Returns
        -------
        Fit
            Parameters that change nothing on these readings stay where they began and are not free.
        """
        effects = tuple(effects)
        found, runs = self.residuals(effects, starts, guide, record=True)
        costs = [self.cost(r) for r in found]
        best = int(np.argmin([c[0] for c in costs]))
        every = tuple((e.name, p.name) for e in effects for p in e.parameters)
        now = Fit(
            effects,
            starts[best],
            found[best],
            *costs[best],
            np.zeros((len(self.values), 0)),
            every,
            runs[best],
        )
        if not np.isfinite(now.cost):
            return now
        if polish:
            return self.finish(now, hopeless, max_iterations)
        return self._descend(now, hopeless, max_iterations, last=False)

    def finish(self, now: Fit, hopeless: float = float("inf"), max_iterations: int = 12) -> Fit:
        """Improve a fit to the end, on its own path, with the sensitivities there."""
        for _ in range(2):
            now = self._descend(now, hopeless, max_iterations)
            if now.cost > hopeless:
                break
            (r,), (run,) = self.residuals(now.effects, [now.values], record=True)
            alone = replace(now, residual=r, cost=self.cost(r)[0], held_cost=self.cost(r)[1], run=run)
            if not np.isfinite(alone.cost):
                return alone
            change = abs(alone.cost - now.cost)
            now = alone
            if change < 1.0 + 1e-2 * now.cost:
                break
        return now

    def _descend(self, now: Fit, hopeless: float, max_iterations: int, last: bool = True) -> Fit:
        """Iterate from a fit on the path of its run.

        Between fresh sensitivities, what each step shows is put into the old ones (Broyden), which costs no run.
        ``last``: fresh ones at the end.
        """
        effects = now.effects
        every = now.free
        natural = {(e.name, p.name): p.scale for e in effects for p in e.parameters}
        scale = np.array([self.scales.get(k, natural[k]) for k in every])
        steps = 0.2 * scale
        free = every
        damping, j = 1e-3, now.jacobian
        fitted = ~self.held
        by_name = {e.name: e for e in effects}
        known = j.shape[1] == len(free)
        size = np.sqrt(np.mean(j[fitted] ** 2, axis=0)) if known else np.ones(len(free))
        if known:
            steps = np.clip(1.0 / np.maximum(size, 1e-300), 1e-3 * scale, 0.5 * scale)
        fresh, stale = False, not known
        for _ in range(max_iterations if free else 0):
            if stale:
                j = self.sensitivities(effects, now, free, steps)
                size = np.sqrt(np.mean(j[fitted] ** 2, axis=0))
                keep = size * scale > NOTHING
                if not np.all(keep):
                    free = tuple(k for k, ok in zip(free, keep, strict=True) if ok)
                    j, steps, scale, size = j[:, keep], steps[keep], scale[keep], size[keep]
                if not free:
                    break
                # The next derivatives: over a change of the readings by one sigma.
                steps = np.clip(1.0 / size, 1e-3 * scale, 0.5 * scale)
                fresh, stale = True, False
            z = self.coordinates(effects, now.values, free)
            limits = np.array([self.bounds(by_name[k[0]], k[1]) for k in free])
            a = np.abs(now.residual)
            w = np.sqrt(np.where(a <= self.threshold, 1.0, self.threshold / np.maximum(a, 1e-300)))[fitted]
            jw, rw = j[fitted] * w[:, None], now.residual[fitted] * w
            norm = np.linalg.norm(jw, axis=0)
            move = _bounded_step(jw, rw, norm, damping, limits[:, 0] - z, limits[:, 1] - z)
            promised = float(np.sum(rw**2) - np.sum((rw - jw @ move) ** 2))
            if promised < 0.02 + 2e-4 * now.cost:
                if fresh or known:
                    break
                stale = True
                continue
            point = self.point(effects, now.values, free, z + move)
            (r,), (run,) = self.residuals(effects, [point], now.run, record=True)
            cost, held_cost = self.cost(r)
            if not cost < now.cost:
                damping *= 100.0
                if not fresh:
                    stale = True
                elif damping > 1e6:
                    break
                continue
            gain = now.cost - cost
            if gain > 0.25 * promised:
                damping = max(1e-6, 0.1 * damping)
            seen = now.residual - r - j @ move
            ruler = size**2
            j = j + np.outer(seen, ruler * move) / float(np.sum(ruler * move**2))
            was_fresh, fresh, stale = fresh or known, False, gain < 0.5 * promised
            known = False
            now = replace(now, values=point, residual=r, cost=cost, held_cost=held_cost, run=run, free=free)
            if gain < 0.05 + 1e-3 * now.cost and (was_fresh or promised < 2.0 * gain):
                break
            if now.cost > hopeless and gain < 0.5 * now.cost and was_fresh is False:
                break
        if free and last and not (fresh or known):
            j = self.sensitivities(effects, now, free, steps)
        return replace(now, jacobian=j, free=free)

    def covariance(self, fit: Fit, inflate: bool = True) -> Array:
        """Of the coordinates of the free parameters, shape (p, p).

        Larger where the misfit is above noise, and by what the errors of the computation itself can do.
        """
        if not fit.free:
            return np.zeros((0, 0))
        fitted = ~self.held
        w = np.minimum(1.0, self.threshold / np.maximum(np.abs(fit.residual), 1e-300))[fitted]
        j = fit.jacobian[fitted] * np.sqrt(w)[:, None]
        norm = np.maximum(np.linalg.norm(j, axis=0), 1e-300)
        inner = np.linalg.pinv((j / norm).T @ (j / norm), rcond=1e-10)
        dof = max(1, int(np.count_nonzero(fitted)) - len(fit.free))
        factor = max(1.0, fit.cost / dof) if inflate else 1.0
        # A systematic error too small to be seen moves the parameters most where it looks like what they do.
        scale = np.where(self.is_position, self.data.robot.backbone.length, 1.0) / self.sigma
        known = (self.is_position | self.is_angle) & fitted
        factor += NUMERICS**2 * float(np.sum(scale[known] ** 2))
        # The error of mesh and path that was taken out is known to about a third; so is what it does to the parameters.
        shift = inner / np.outer(norm, norm) @ (j.T @ (UNSURE * self.correction[fitted] * np.sqrt(w)))
        return np.asarray(inner / np.outer(norm, norm) * factor + np.outer(shift, shift))


def _known(r: Array) -> Array:
    """Differences, zero where a prediction is missing."""
    return np.where(np.isfinite(r), r, 0.0)


def _bounded_step(j: Array, r: Array, norm: Array, damping: float, low: Array, high: Array) -> Array:
    """Least squares step with Marquardt's damping, inside bounds."""
    norm = np.maximum(norm, 1e-300)
    scaled = np.concatenate((j / norm, np.sqrt(damping) * np.eye(len(norm))))
    right = np.concatenate((r, np.zeros(len(norm))))
    low, high = np.minimum(low * norm, -1e-12), np.maximum(high * norm, 1e-12)
    solution = lsq_linear(scaled, right, (low, high), method="bvls")
    return np.asarray(solution.x / norm)

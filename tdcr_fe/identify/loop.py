"""The closed loop: find the residual, trace it to effects that the model lacks, add them, and stop at noise."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation
from scipy.stats import chi2 as chi2_distribution

from tdcr_fe.effects import EFFECTS, Effect
from tdcr_fe.identify.fitting import Fit, Point, Problem
from tdcr_fe.identify.forward import ForwardModel
from tdcr_fe.identify.holdout import choose_held_out
from tdcr_fe.identify.noise import alike, estimate_sigma, excess, is_noise, outliers, structure
from tdcr_fe.identify.outcome import (
    AddedEffect,
    Candidate,
    Estimate,
    IdentificationResult,
    IdentifySettings,
    Misfit,
    Noise,
    Remainder,
    Shapes,
    Verdict,
)
from tdcr_fe.identify.screening import Score, screen
from tdcr_fe.identify.unlisted import (
    SideSpring,
    SoftBay,
    bay_edges,
    describe_moment,
    local_suspects,
    missing_moment,
)
from tdcr_fe.io.measured import MeasuredData

Array = NDArray[np.float64]

#: Takes a sentence on what is done, and the share of the work that is done, about [1].
Progress = Callable[[str, float], None]

#: Models whose criterion differs by less than this are not told apart (odds of about 20 to 1).
SAME = 6.0

#: The sum of squares of the held-out readings must fall by this much, in units of the misfit that is left.
HELD_OUT = 4.0

#: Tolerance of the path of loading, as a share of the noise of a position (a third of it is left), and its limit.
PATH_SHARE, LOOSEST = 0.6, 3e-4

#: Readings more than fitted parameters, below which a fit with no steps kept aside explains nothing.
FEW = 10

#: Noise is no larger than this, in standard deviations of its sum of squares.
SPREAD = 4.0


class NotSolved(Exception):
    """The declared model does not converge on this loading sequence; says where and why."""


@dataclass
class _State:
    """What is known so far; an interruption ends the loop with this."""

    best: Fit
    base: Fit
    fits: dict[frozenset[str], Fit] = field(default_factory=dict)
    screens: dict[frozenset[str], list[Score]] = field(default_factory=dict)
    candidates: list[Candidate] = field(default_factory=list)
    refused: dict[str, str] = field(default_factory=dict)
    rivals: dict[str, list[str]] = field(default_factory=dict)
    places: dict[frozenset[str], list[Score]] = field(default_factory=dict)
    local: Fit | None = None
    history: list[str] = field(default_factory=list)
    interrupted: bool = False


def identify(
    data: MeasuredData, settings: IdentifySettings | None = None, progress: Progress | None = None
) -> IdentificationResult:
    """Trace what a declared model leaves unexplained to effects that it lacks.

    Parameters
    ----------
    data
        Robot as declared, loading sequence, readings; see `tdcr_fe.io.measured.read_measured`.
    settings
        How the loop works.
    progress
        Told what is done.

    Returns
    -------
    IdentificationResult

    Raises
    ------
    NotSolved
        The declared model does not converge.
    """
    settings = settings or IdentifySettings()
    begun = time.perf_counter()
    tell = progress or (lambda text, share: None)
    with ForwardModel(settings.processes, settings.path_tolerance) as forward:
        tell("the declared model", 0.0)
        problem, estimated = _pose(data, settings, forward)
        base = problem.evaluate((), {})
        if not base.solved:
            raise NotSolved(f"the declared model does not follow the loading sequence: {base.run.message}")
        problem.threshold = _threshold(base.residual)
        base = problem.evaluate((), {})
        state = _State(best=base, base=base)
        state.fits[frozenset()] = base
        loop = _Loop(problem, settings, state, tell)
        try:
            loop.go(estimated)
        except KeyboardInterrupt:
            state.interrupted = True
            state.history.append("interrupted; what was found until then is reported")
        tell("the remainder", 0.97)
        return _conclude(problem, settings, state, estimated, forward.runs, time.perf_counter() - begun)


def _pose(data: MeasuredData, settings: IdentifySettings, forward: ForwardModel) -> tuple[Problem, bool]:
    """The problem with sigma known, steps held out, mesh and path fine enough."""
    held_positions = set(choose_held_out(data, settings.hold_out))
    position = {n: k for k, n in enumerate(data.step_ids)}
    held = np.array([position[r.step] in held_positions for r in data.readings])
    ones = np.ones(len(data.readings))
    problem = Problem(data, ones, held, forward)
    (residual,), _ = problem.residuals((), [{}], record=True)
    sigma, estimated = estimate_sigma(data, residual)
    problem.sigma = sigma
    if np.any(problem.is_position):
        share = PATH_SHARE * float(np.median(sigma[problem.is_position])) / data.robot.backbone.length
        forward.path_tolerance = float(np.clip(share, forward.path_tolerance, LOOSEST))
    problem.sharpen((), {})
    return problem, estimated


def _threshold(r: Array) -> float:
    """Up to where single residuals count in full."""
    return 4.0 * max(1.0, 1.4826 * float(np.median(np.abs(r))))


class _Loop:
    def __init__(self, problem: Problem, settings: IdentifySettings, state: _State, tell: Progress) -> None:
        self.problem, self.settings, self.state, self.tell = problem, settings, state, tell
        self.count = len(problem.values)
        self.fitted = ~problem.held
        self.share = 0.0

    # ------------------------------------------------------------------ judging

    def criterion(self, fit: Fit) -> float:
        """Misfit on all readings and a price per parameter; smaller is better."""
        return fit.cost + fit.held_cost + len(fit.free) * math.log(self.count)

    def level(self, fit: Fit) -> float:
        """Misfit per degree of freedom, at least one."""
        return max(1.0, fit.cost / max(1, int(np.count_nonzero(self.fitted)) - len(fit.free)))

    def doubt(self, fit: Fit) -> float:
        """What a difference of the criterion is measured by when models are told apart, at least one.

        The misfit per degree of freedom where noise is left. Else that on all readings, times the number of steps over
        which the residual stays alike: what is left is then the same error seen many times, and no witness for the
        model that happens to follow it.
        """
        if self.is_noise(fit):
            return self.level(fit)
        misfit = (fit.cost + fit.held_cost) / max(1, self.count - len(fit.free))
        rho = float(np.clip(alike(self.problem.data, fit.residual), 0.0, 0.9))
        return max(1.0, misfit) * (1.0 + rho) / (1.0 - rho)

    def is_noise(self, fit: Fit) -> bool:
        """Whether what a model leaves is noise, on fitted and on held-out readings, in size and in structure."""
        if not fit.solved:
            return False
        r, held = fit.residual, self.problem.held
        if excess(r[~held], len(fit.free)) > SPREAD or (np.any(held) and excess(r[held]) > SPREAD):
            return False
        return is_noise(structure(self.problem.data, r, len(fit.free)), self.settings.significance)

    def bar(self, parameters: int) -> float:
        """By how much the sum of squares must fall for so many parameters."""
        return float(chi2_distribution.isf(self.settings.significance / len(EFFECTS), max(1, parameters)))

    def better(self, new: Fit, old: Fit) -> bool:
        """Whether a larger model is worth its parameters, on the fitted and on the held-out readings."""
        if not new.solved:
            return False
        level = self.level(new)
        extra = len(new.free) - len(old.free)
        if old.cost - new.cost <= self.bar(extra) * level:
            return False
        if not np.any(self.problem.held):
            return True
        return old.held_cost - new.held_cost > HELD_OUT * level

    # ------------------------------------------------------------------ the loop

    def go(self, estimated: bool) -> None:
        """Rounds of adding, then removing and swapping, then what is on no list."""
        s = self.state
        self.tell("rounds of adding", 0.05)
        self.grow(estimated)
        if s.local is not None:
            return
        if s.best.effects:
            self.share = 0.75
            self.tell("removing and swapping", self.share)
            self.prune()
            self.compare()
        if s.best.effects or not self.is_noise(s.best):
            self.tell("places along the backbone", 0.85)
            self.look_for_places()

    def screened(self, fit: Fit) -> list[Score]:
        """Scores of all candidates beside a fitted model, once."""
        key = frozenset(fit.names)
        if key not in self.state.screens:
            others = [e for e in EFFECTS if e.name not in fit.names and e.name not in self.state.refused]
            scores = screen(self.problem, fit, others)
            self.state.screens[key] = scores
            if not fit.effects:
                self.state.refused.update({x.effect.name: x.note for x in scores if x.note})
        return self.state.screens[key]

    def fit(
        self,
        effects: Sequence[Effect],
        starts: Sequence[Point],
        hopeless: float = math.inf,
        beside: Fit | None = None,
    ) -> Fit:
        """Fit a model, once; ``beside`` is the one whose path the first runs follow."""
        key = frozenset(e.name for e in effects)
        if key not in self.state.fits:
            guide = None if beside is None else beside.run
            self.state.fits[key] = self.problem.fit(effects, starts, hopeless, guide=guide)
        return self.state.fits[key]

    def race(
        self, starters: Sequence[tuple[Fit, Score]], known: float = math.inf
    ) -> list[tuple[Fit, Score, Fit]]:
        """Fit several models, each a fitted one and an effect more; only those near the best are fitted to the end."""
        found = []
        for parent, score in starters:
            effects = (*parent.effects, score.effect)
            key = frozenset(e.name for e in effects)
            new = self.state.fits.get(key)
            if new is None:
                self.tell(f"fitting {_list([e.name for e in effects])}", self.share)
                starts = score.starts
                first = self.problem.fit(effects, starts[:1], 3.0 * known, 5, parent.run, polish=False)
                new = first
                if len(starts) > 1 and not first.cost < max(1.5 * known, parent.cost - 0.7 * score.drop):
                    other = self.problem.fit(effects, starts[1:], 3.0 * known, 5, parent.run, polish=False)
                    new = min(first, other, key=lambda f: f.cost)
            known = min(known, new.cost)
            found.append((parent, score, new))
        result = []
        for parent, score, new in sorted(found, key=lambda f: f[2].cost):
            key = frozenset(new.names)
            if key not in self.state.fits:
                if new.solved and new.cost < 1.3 * known + 60.0:
                    self.tell(f"fitting {_list(new.names)} to the end", self.share)
                    new = self.problem.finish(new.anew)
                    known = min(known, new.cost)
                self.state.fits[key] = new
            result.append((parent, score, self.state.fits[key]))
        return result

    def grow(self, estimated: bool) -> None:
        """Add one effect at a time, several models side by side."""
        s, settings = self.state, self.settings
        level = [s.best]
        for number in range(1, settings.max_effects + 1):
            share = 0.05 + 0.65 * (1.0 - 0.5 ** (number - 1))
            proposals: list[tuple[float, Fit, Score]] = []
            for fit in level:
                self.tell(
                    f"round {number}: screening beside {_list(fit.names) or 'the declared model'}", share
                )
                for score in self.screened(fit):
                    worth = score.drop > self.bar(score.count) * max(1.0, self.level(fit) * 0.02)
                    s.candidates.append(
                        Candidate(
                            number,
                            fit.names,
                            score.effect.name,
                            score.drop / self.level(fit),
                            note=score.note,
                        )
                    )
                    if worth:
                        proposals.append((fit.cost - score.drop, fit, score))
            proposals.sort(key=lambda p: p[0])
            chosen: dict[frozenset[str], tuple[Fit, Score]] = {}
            for _, fit, score in proposals:
                if len(chosen) < settings.candidates:
                    chosen.setdefault(frozenset({*fit.names, score.effect.name}), (fit, score))
            self.share = share
            fits: list[Fit] = []
            for fit, score, new in self.race(list(chosen.values())):
                fits.append(new)
                self.note(number, fit, score, new)
            fits = sorted((f for f in fits if f.solved), key=self.criterion)
            accepted = [f for f in fits if self.better(f, self.parent(f)) and self.improves(f)]
            if not accepted:
                s.history.append(
                    f"round {number}: no candidate improves fitted and held-out steps"
                    if proposals
                    else f"round {number}: no candidate is significant"
                )
                return
            s.best = accepted[0]
            self.sharpen()
            s.history.append(
                f"round {number}: {_list(s.best.names)}, misfit per reading "
                f"{self.mean(s.best.cost, self.fitted):.3g} on fitted and "
                f"{self.mean(s.best.held_cost, self.problem.held):.3g} on held-out steps"
            )
            others = [s.fits[frozenset(f.names)] for f in accepted[1 : settings.beam]]
            level = [s.best] if self.is_noise(s.best) or number > 1 else [s.best, *others]
            if number == 1 and not self.is_noise(s.best):
                # One place that explains everything spares the search for several effects that mimic it.
                kept, told = s.best, list(s.history)
                self.look_for_places(alone=True)
                if s.local is not None and self.is_noise(s.local):
                    return
                s.best, s.local, s.history = kept, None, told

    def parent(self, fit: Fit) -> Fit:
        """The best smaller model that was fitted and is contained in it."""
        inside = [f for k, f in self.state.fits.items() if k < frozenset(fit.names) and f.solved]
        return min(inside, key=lambda f: f.cost)

    def improves(self, fit: Fit) -> bool:
        """Whether a model is better than the best so far, which need not be contained in it."""
        return self.criterion(fit) < self.criterion(self.state.best) - SAME

    def mean(self, cost: float, which: NDArray[np.bool_]) -> float:
        """Cost per reading."""
        return cost / max(1, int(np.count_nonzero(which)))

    def note(self, number: int, fit: Fit, score: Score, new: Fit) -> None:
        """Complete a candidate's entry after its fit."""
        for i, c in enumerate(self.state.candidates):
            if (c.round, c.model, c.name) == (number, fit.names, score.effect.name):
                self.state.candidates[i] = Candidate(
                    c.round,
                    c.model,
                    c.name,
                    c.drop,
                    True,
                    self.mean(new.cost, self.fitted),
                    self.mean(new.held_cost, self.problem.held) if np.any(self.problem.held) else None,
                    "" if new.solved else "the model did not converge there",
                )

    def sharpen(self) -> None:
        """Choose mesh and path anew where the best model is; if that changes them, judge what was fitted anew."""
        s, problem = self.state, self.problem
        problem.threshold = min(problem.threshold, _threshold(s.best.residual))
        before = s.best.residual
        changed = False
        for _ in range(3):
            if not problem.sharpen(s.best.effects, s.best.values):
                break
            changed = True
        again = problem.evaluate(s.best.effects, s.best.values)
        shift = again.residual - before
        for key, old in s.fits.items():
            r = old.residual + shift
            cost, held_cost = problem.cost(r)
            s.fits[key] = replace(old, residual=r, cost=cost, held_cost=held_cost)
        s.best = problem.finish(replace(again, free=s.best.free, jacobian=s.best.jacobian))
        s.fits[frozenset(s.best.names)] = s.best
        if changed:
            s.base = problem.evaluate((), {})
        else:
            s.base = s.fits[frozenset()]
        s.fits[frozenset()] = s.base

    def without(self, effect: Effect) -> Fit:
        """The best model less one effect, fitted anew."""
        best = self.state.best
        rest = tuple(e for e in best.effects if e is not effect)
        if not rest:
            return self.state.base
        return self.fit(rest, [{e.name: best.values[e.name] for e in rest}])

    def prune(self) -> None:
        """Drop effects that the rest makes needless."""
        s = self.state
        while len(s.best.effects) > 1:
            needless = [(e, self.without(e)) for e in s.best.effects]
            needless = [(e, f) for e, f in needless if f.solved and not self.better(s.best, f)]
            if not needless:
                return
            e, s.best = min(needless, key=lambda p: self.criterion(p[1]))
            s.history.append(f"{e.name} dropped: the others do without it")

    def compare(self) -> None:
        """Put other effects in the place of each; name those that do as well, take those that do better."""
        s = self.state
        for _ in range(3):
            s.rivals = {}
            swapped = False
            for e in s.best.effects:
                rest = self.without(e)
                scores = [x for x in self.screened(rest) if x.effect.name != e.name and x.starts]
                room = s.best.cost * 1.5 + 60.0
                chosen = [x for i, x in enumerate(scores) if i < 3 or rest.cost - x.drop < room][
                    : self.settings.candidates
                ]
                worth = [x for x in chosen if x.drop >= 0.3 * max(1e-9, rest.cost - s.best.cost)]
                for _, x, other in self.race([(rest, x) for x in worth], s.best.cost):
                    if not other.solved:
                        continue
                    gap = (self.criterion(other) - self.criterion(s.best)) / self.level(s.best)
                    if gap < -SAME and self.better(other, rest):
                        s.history.append(f"{x.effect.name} in the place of {e.name}: it explains more")
                        s.best, swapped = other, True
                        break
                    if self.criterion(other) - self.criterion(s.best) < SAME * self.doubt(s.best):
                        s.rivals.setdefault(e.name, []).append(x.effect.name)
                if swapped:
                    break
            if not swapped:
                break
        self.compare_sets()

    def compare_sets(self) -> None:
        """Name effects of other models of the same size that do as well, each beside the effect that it resembles."""
        s = self.state
        signatures = {x.effect.name: x.signature for x in self.screened(s.base)}
        mine = set(s.best.names)
        for key, other in s.fits.items():
            if not other.solved or len(key) != len(mine) or len(key & mine) > len(mine) - 2:
                continue
            if self.criterion(other) - self.criterion(s.best) >= SAME * self.doubt(s.best):
                continue
            for name in key - mine:
                likeness = {e: _likeness(signatures.get(e), signatures.get(name)) for e in mine - key}
                like = max(likeness, key=lambda e: likeness[e])
                if name not in s.rivals.setdefault(like, []):
                    s.rivals[like].append(name)

    def placed(self, fit: Fit) -> list[Score]:
        """Scores of places along the backbone beside a model: every other one, and the neighbours of the best."""
        key = frozenset(fit.names)
        if key in self.state.places:
            return self.state.places[key]
        found: dict[str, Score] = {}
        for family in local_suspects(self.problem, fit):
            scores = screen(self.problem, fit, family[1::2] or family)
            best = scores[0].effect
            place = next(i for i, e in enumerate(family) if e.name == best.name)
            near = [family[i] for i in (place - 1, place + 1) if 0 <= i < len(family)]
            found |= {x.effect.name: x for x in (*scores, *screen(self.problem, fit, near))}
        self.state.places[key] = sorted(found.values(), key=lambda x: -x.drop)
        return self.state.places[key]

    def look_for_places(self, alone: bool = False) -> None:
        """Try single bays and springs at one place, beside the best model and beside smaller ones, or alone."""
        s = self.state
        bases: dict[frozenset[str], Fit] = {frozenset(): s.base}
        if not alone and not self.is_noise(s.best):
            bases[frozenset(s.best.names)] = s.best
        for e in () if alone else s.best.effects:
            rest = self.without(e)
            if rest.solved:
                bases[frozenset(rest.names)] = rest
        found: list[tuple[float, Fit, Score]] = []
        for base in sorted(bases.values(), key=self.criterion)[:3]:
            # To first order a place must do about as well as the best model, or it is not worth a fit; the best place
            # has more room, because linearisation misleads.
            room = 0.1 * base.cost + 5.0 * s.best.cost if base is not s.best else math.inf
            scores = [
                x for x in self.placed(base) if x.drop > self.bar(1) * max(1.0, self.level(base) * 0.02)
            ]
            found += [
                (base.cost - x.drop, base, x)
                for i, x in enumerate(scores[:2])
                if base.cost - x.drop < (room if i else max(room, 0.6 * base.cost))
            ]
        fits = []
        for _, base, score in sorted(found, key=lambda p: p[0])[:3]:
            self.tell(f"fitting {score.effect.name}", 0.9)
            new = self.problem.fit(
                (*base.effects, score.effect), score.starts, 2.0 * s.best.cost, guide=base.run
            )
            if new.solved and self.better(new, base):
                fits.append(new)
        if not fits:
            return
        local = min(fits, key=self.criterion)
        gain = (self.criterion(s.best) - self.criterion(local)) / self.level(local)
        if gain > SAME:
            s.local = local
            listed = tuple(e for e in local.effects if not isinstance(e, SoftBay | SideSpring))
            s.history.append(f"{local.effects[-1].name} explains more than any listed effect in its place")
            if frozenset(e.name for e in listed) != frozenset(s.best.names):
                s.best = s.fits[frozenset(e.name for e in listed)]
                s.rivals = {k: v for k, v in s.rivals.items() if k in s.best.names}


def _likeness(a: Array | None, b: Array | None) -> float:
    """Largest cosine between what two effects can do to the readings; zero where one is not known."""
    if a is None or b is None or not a.size or not b.size:
        return 0.0
    first, second = np.linalg.qr(a)[0], np.linalg.qr(b)[0]
    return float(np.linalg.svd(first.T @ second, compute_uv=False)[0])


def _list(names: Sequence[str]) -> str:
    return " + ".join(names)


# --------------------------------------------------------------------------------------------- concluding


def _conclude(
    problem: Problem, settings: IdentifySettings, state: _State, estimated: bool, runs: int, wall_time: float
) -> IdentificationResult:
    data, held = problem.data, problem.held
    fitted = ~held
    best, base = state.best, state.base
    loop = _Loop(problem, settings, state, lambda text, share: None)
    quiet = state.local is None and loop.is_noise(best)
    # So few readings and none kept aside: whatever has as many parameters follows them.
    untested = not np.any(held) and len(problem.values) - len(best.free) < FEW
    verdict: Verdict
    if not quiet:
        verdict = "partly explained" if best.effects else "unexplained"
    elif not best.effects:
        verdict = "nothing missing"
    else:
        verdict = "partly explained" if untested else "explained"
    tests = structure(data, best.residual, len(best.free))
    covariance = problem.covariance(best)
    deviation = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    outer = np.maximum(np.outer(deviation, deviation), 1e-300)
    effects = _added(problem, loop, state, deviation)
    moment, edges = missing_moment(problem, best)
    where, description = _remaining(problem, loop, state, quiet, tests, moment, edges)
    if quiet and best.effects and untested:
        where = "not known"
        description = (
            f"{len(problem.values)} readings, {len(best.free)} fitted numbers, too few steps to keep any aside: what "
            "was added follows the readings down to their noise, but nothing tests it"
        )
    held_ids = sorted({data.readings[i].step for i in np.flatnonzero(held)}, key=data.step_ids.index)
    return IdentificationResult(
        data=data,
        verdict=verdict,
        effects=effects,
        before_fit=problem.misfit(base.residual, fitted),
        before_held_out=problem.misfit(base.residual, held),
        after_fit=problem.misfit(best.residual, fitted, len(best.free)),
        after_held_out=problem.misfit(best.residual, held),
        held_out_steps=tuple(held_ids),
        remaining=Remainder(where, description, moment, edges),
        candidates=tuple(state.candidates),
        structure=tests[:12],
        residual_before=base.residual * problem.sigma,
        residual_after=best.residual * problem.sigma,
        sigma=problem.sigma,
        sigma_estimated=estimated,
        outliers=outliers(best.residual),
        correlation=covariance / outer,
        parameter_names=tuple(f"{a}.{b}" for a, b in best.free),
        mesh_error=problem.mesh_error,
        noise=_noise(problem, estimated),
        shapes=_shapes(problem, base, best, set(held_ids)),
        corrected=replace(
            problem.setup(best.effects, best.values),
            model=replace(
                problem.setup(best.effects, best.values).model, elements_per_bay=data.model.elements_per_bay
            ),
        ),
        left_out_candidates=dict(state.refused),
        runs=runs,
        wall_time=wall_time,
        interrupted=state.interrupted,
        history=tuple(state.history),
    )


def _noise(problem: Problem, estimated: bool) -> Noise:
    """What sigma alone gives, in the measures of a misfit."""
    all_readings = np.ones(len(problem.values), dtype=bool)
    size = problem.misfit(np.ones(len(problem.values)), all_readings)
    return Noise(size.rms_position, size.rms_coordinate, size.rms_angle, size.rms_by_quantity, estimated)


def _shapes(problem: Problem, base: Fit, best: Fit, held_out: set[int]) -> Shapes:
    """Measured and predicted positions by step, location and axis."""
    data = problem.data
    index = np.flatnonzero(problem.is_position)
    locations = np.unique([float(data.readings[i].location or 0.0) for i in index])
    table = np.full((3, len(data.steps), locations.size, 3), np.nan)
    for i in index:
        r = data.readings[i]
        at = (
            problem.reader.step[i],
            int(np.searchsorted(locations, r.location)),
            "xyz".index(r.quantity[-1]),
        )
        for k, value in enumerate((0.0, base.residual[i], best.residual[i])):
            table[(k, *at)] = r.value - value * problem.sigma[i]
    backbones = []
    for fit in (base, best):
        observation = problem.setup(fit.effects, fit.values).observation
        frame = Rotation.from_rotvec(np.array(observation.rotation)).as_matrix()
        backbones.append(fit.run.positions @ frame.T)
    return Shapes(
        step_ids=data.step_ids,
        branches=data.branches,
        held_out=np.array([n in held_out for n in data.step_ids]),
        arc_lengths=locations,
        measured=table[0],
        before=table[1],
        after=table[2],
        backbone_before=backbones[0],
        backbone_after=backbones[1],
    )


def _added(problem: Problem, loop: _Loop, state: _State, deviation: Array) -> tuple[AddedEffect, ...]:
    """Effects in the order of adding, with what spoke for each."""
    best = state.best
    added = []
    before = state.base
    for i, e in enumerate(best.effects):
        names = frozenset(x.name for x in best.effects[: i + 1])
        after = best if i == len(best.effects) - 1 else state.fits.get(names)
        if after is None or not after.solved:
            after = loop.fit(
                best.effects[: i + 1], [{x.name: best.values[x.name] for x in best.effects[: i + 1]}]
            )
        numbers = {}
        for p in e.parameters:
            value = best.values[e.name][p.name]
            error, note = None, ""
            if (e.name, p.name) in best.free:
                j = best.free.index((e.name, p.name))
                error = float(deviation[j]) * (value**2 if p.inverse and math.isfinite(value) else 1.0)
                low, high = problem.bounds(e, p.name)
                z = p.coordinate(value)
                if min(abs(z - low), abs(high - z)) < 1e-9 * max(1.0, abs(high - low)):
                    note = "at its bound"
            else:
                note = "not determined by these data; left where it changes nothing"
            numbers[p.name] = Estimate(float(value), error, p.unit, note)
        rivals = tuple(state.rivals.get(e.name, ()))
        level = loop.level(after)
        evidence = {
            "chi2_drop_fit": before.cost - after.cost,
            "chi2_drop_held_out": before.held_cost - after.held_cost,
            "needed_drop": loop.bar(len(e.parameters)) * level,
        }
        experiment = ""
        if rivals:
            others = [x for x in EFFECTS if x.name in rivals]
            experiment = f"for {e.name}: {e.separating_experiment}" + "".join(
                f"; for {x.name}: {x.separating_experiment}" for x in others
            )
        added.append(
            AddedEffect(
                e.name,
                numbers,
                problem.misfit(after.residual, ~problem.held, len(after.free)),
                problem.misfit(after.residual, problem.held),
                evidence,
                rivals,
                experiment,
            )
        )
        before = after
    return tuple(added)


def _remaining(
    problem: Problem,
    loop: _Loop,
    state: _State,
    quiet: bool,
    tests: Sequence[object],
    moment: Array,
    edges: Array,
) -> tuple[str, str]:
    """Where and what is left, as texts."""
    if quiet:
        return "nowhere", "what is left has the size and the structure of the noise"
    where, text = describe_moment(problem, moment, edges)
    local = state.local
    if local is not None:
        suspect = local.effects[-1]
        assert isinstance(suspect, SoftBay | SideSpring)
        (name, value), *_ = local.values[suspect.name].items()
        error = 0.0
        if (suspect.name, name) in local.free:
            j = local.free.index((suspect.name, name))
            error = float(np.sqrt(problem.covariance(local)[j, j]))
            error *= value**2 if suspect.parameters[0].inverse else 1.0
        what = "a bending stiffness of" if isinstance(suspect, SoftBay) else "a spring of"
        unit = "times the declared one" if isinstance(suspect, SoftBay) else "N/m"
        ending = (
            "to noise"
            if loop.is_noise(local)
            else f"to {local.cost / max(1, int(np.count_nonzero(loop.fitted))):.3g} per reading"
        )
        return (
            suspect.where,
            f"not on the list: {what} {value:.3g} +- {1.96 * error:.2g} {unit}, {suspect.where}, would bring the "
            f"misfit {ending}; {text}",
        )
    told = [
        t for t in structure(problem.data, state.best.residual, len(state.best.free)) if t.p_value < 1e-4
    ][:3]
    if told:
        text += "; the residual is largest in: " + ", ".join(t.group for t in told)
    return where, text


def misfit_ratio(after: Misfit, before: Misfit) -> float:
    """Misfit after over before, of the sums of squares [1]."""
    return after.chi2_per_dof / before.chi2_per_dof


__all__ = ["NotSolved", "Progress", "bay_edges", "identify"]

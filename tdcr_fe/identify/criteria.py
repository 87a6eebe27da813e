"""Criteria by which models are compared, the test for noise, and whether the data suffice for a verdict."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from scipy.special import chdtri, expit

from tdcr_fe.effects import EFFECTS, Effect
from tdcr_fe.elements import Array
from tdcr_fe.identify import noise
from tdcr_fe.identify.causes import Cause, ReadingCause
from tdcr_fe.identify.problem import NOISE_REACHES, Fit, FitProblem, Point
from tdcr_fe.identify.rows import FEWEST
from tdcr_fe.io.measured import MeasuredData
from tdcr_fe.model.quantities import EARTH

#: An unlisted cause of the dictionary is a priori by this factor less probable than a listed effect, as a logarithm.
UNLISTED = 2.0

#: Price of everything that a law depends on, see `Cause.price`.
PER_FACTOR = 1.5

#: An unknown cause, one that is not in the dictionary but that several causes of it together imitate, is a priori by
#: this factor less probable than a listed effect, as a logarithm.
UNKNOWN = 7.0

#: What the choice of a cause from the list costs, as a logarithm.
CHOICE = math.log(len(EFFECTS))

#: Price of a gravity of another magnitude than on Earth: the declared masses would have to be wrong, too [1]. From this
#: deviation on [m/s^2].
OTHER_GRAVITY, EARTH_TOLERANCE = 8.0, 0.3

#: Smallest difference of BIC that separates two models (odds of about 20 to 1).
BIC_DIFFERENCE = 6.0

#: A model with a parameter at a bound ranks as if its misfit were larger by this share.
BOUND_PENALTY = 0.3

#: The sum of squares of the held-out readings must fall by this much, in units of the reduced chi-square.
HELD_OUT_DROP = 4.0

#: Where held-out readings cannot decide, a larger model has to leave noise, or at most this share of the misfit. More
#: than noise may be left although the cause is nearly right: weights hung a disk too low, in fitted branches alone,
#: were explained by a gain of the loads down to a fiftieth of the misfit. Errors that differ in every step are looked
#: for only where a round has left a larger share. A cause that explains more is probably right, and the rest is another
#: one, which such errors could imitate: pretension left a seventh of one data set, and the rest was friction.
HALVED = 0.5

#: Smallest share of the misfit for which a further one of many causes is added, or the declared friction kept.
WORTHWHILE = 0.1


def price(effects: Sequence[Effect]) -> float:
    """Twice the negative logarithm of the prior probability of causes.

    Every cause is one of the list; one at a place, or of a single tendon, is one of all of its kind; unlisted causes
    have a price of their own besides.
    """
    total = 2.0 * CHOICE * len(effects)
    for e in effects:
        total += 2.0 * math.log(e.among)
        if isinstance(e, Cause):
            total += 2.0 * (UNLISTED + e.price)
    return total


def bic(problem: FitProblem, fit: Fit) -> float:
    """Bayesian information criterion over all readings; smaller is better.

    The sum of squares, and what the causes cost.
    """
    return fit.cost + fit.held_cost + price_of(problem, fit)


def price_of(problem: FitProblem, fit: Fit) -> float:
    """What the causes of a model cost in the criterion."""
    return complexity(problem, fit.effects, fit.values, len(fit.free))


def complexity(problem: FitProblem, effects: Sequence[Effect], values: Point, count: int) -> float:
    """What causes cost in the criterion: their prior, and log(n) for each of so many numbers.

    On Earth only the direction of a gravity is fitted.
    """
    found = price(effects) + count * math.log(problem.count)
    if "gravity" in values:
        size = math.sqrt(sum(x * x for x in values["gravity"].values()))
        on_earth = abs(size - EARTH) <= EARTH_TOLERANCE
        found += -math.log(problem.count) if on_earth else OTHER_GRAVITY
    return found


def probability_of_unknown(fit: Fit) -> float:
    """Probability that one cause outside the dictionary acts in place of all causes of a model [1].

    Such a cause is taken to fit as well with as many numbers, so that the priors alone decide. Every unlisted cause in
    the model makes it more probable, except shifts of readings, which no other cause imitates.
    """
    unlisted = sum(isinstance(e, Cause) and not isinstance(e, ReadingCause) for e in fit.effects)
    return float(expit(CHOICE * (len(fit.effects) - 1) + UNLISTED * unlisted - UNKNOWN))


def at_bound(problem: FitProblem, fit: Fit) -> bool:
    """Whether a free parameter has come to a bound other than its null value, and so is no estimate.

    A value of zero is an estimate even where zero is the bound: it says that the robot has no friction, for example.
    Otherwise a law in which friction depends on the normal force would be preferred to that.
    """
    null = {e.name: e.null_values(problem.experiment) for e in fit.effects}
    z, start = (problem.coordinates(fit.effects, x, fit.free)[:, None] for x in (fit.values, null))
    limits = problem.limits(fit.effects, fit.free)
    near = 1e-6 * np.maximum(np.ptp(limits, axis=1), 1e-300)[:, None]
    return bool(np.any((np.abs(z - limits) <= near) & (np.abs(start - limits) > near) & (limits != 0.0)))


def rank(problem: FitProblem, fit: Fit) -> float:
    """BIC by which models are ordered and exchanged, larger where a parameter is at a bound."""
    penalty = BOUND_PENALTY * (fit.cost + fit.held_cost) if fit.solved and at_bound(problem, fit) else 0.0
    return bic(problem, fit) + penalty


def reduced_chi_square(problem: FitProblem, fit: Fit) -> float:
    """Sum of squares of the fitted readings per degree of freedom, at least one."""
    return max(1.0, fit.cost / max(1, int(np.count_nonzero(problem.fitted)) - len(fit.free)))


def effective_noise(problem: FitProblem, fit: Fit) -> float:
    """Unit of a difference of BIC when models are compared: reduced chi-square, inflated by autocorrelation.

    Where the residual is noise, the reduced chi-square. Elsewhere that of all readings times (1 + rho) / (1 - rho)
    with the lag-1 autocorrelation rho over the steps (at most 0.9): neighbouring steps with the same error are not
    independent evidence.
    """
    if residual_is_noise(problem, fit):
        return reduced_chi_square(problem, fit)
    misfit = (fit.cost + fit.held_cost) / max(1, problem.count - len(fit.free))
    rho = float(np.clip(noise.lag1_autocorrelation(problem.data, fit.residual), 0.0, 0.9))
    return max(1.0, misfit) * (1.0 + rho) / (1.0 - rho)


def residual_is_noise(problem: FitProblem, fit: Fit) -> bool:
    """Whether a model leaves noise, on fitted and on held-out readings, in size and in structure."""
    if not fit.solved:
        return False
    r, held_out = fit.residual, problem.held_out
    if noise.chi_square_z_score(r[~held_out], len(fit.free)) > NOISE_REACHES:
        return False
    if np.any(held_out) and noise.chi_square_z_score(r[held_out]) > NOISE_REACHES:
        return False
    return noise.is_noise(noise.structure(problem.data, r, len(fit.free)))


def chi_square_threshold(parameters: int) -> float:
    """Fall of the sum of squares that so many parameters reach by chance, with Bonferroni's correction over effects."""
    return float(chdtri(max(1, parameters), noise.SIGNIFICANCE / len(EFFECTS)))


def is_improvement(problem: FitProblem, new: Fit, old: Fit) -> bool:
    """Whether a larger model improves the criteria enough, on the fitted and on the held-out readings.

    Where the two models predict nearly the same held-out readings, these cannot decide: the fitted ones then do, if the
    larger model leaves noise or half of the misfit.
    """
    if not new.solved:
        return False
    level = reduced_chi_square(problem, new)
    extra = len(new.free) - len(old.free)
    if old.cost - new.cost <= chi_square_threshold(extra) * level:
        return False
    if not np.any(problem.held_out):
        return True
    needed = HELD_OUT_DROP * level
    if old.held_cost - new.held_cost > needed:
        return True
    # If the larger model is right, the drop to be expected is the sum of squares of what they differ by.
    difference = (new.residual - old.residual)[problem.held_out]
    mostly = new.cost < HALVED * old.cost or residual_is_noise(problem, new)
    return float(difference @ difference) < needed and mostly


def robust_threshold(residual: Array) -> float:
    """Residual over sigma up to which a reading counts in full: four sigma, or four robust scatters if larger."""
    return NOISE_REACHES * max(1.0, noise.robust_scatter(residual))


#: With a larger share of faulty readings, "nothing missing" is not said.
MOST_FAULTY = 0.3

#: Degrees of freedom needed for a verdict where no steps could be held out.
TO_SPARE = 10


def insufficient_data(problem: FitProblem, declared: Fit, best: Fit, explained: bool) -> str:
    """Why these data do not suffice for a verdict; empty where they do.

    Parameters
    ----------
    problem
        Readings and their sigma.
    declared, best
        The declared and the final model.
    explained
        Whether the final model leaves noise.
    """
    unusable = unusable_data(problem, declared)
    if unusable:
        return unusable
    steps = len({r.step for r in problem.data.readings})
    if explained and steps < FEWEST:
        needed = f"at least {FEWEST} are needed to say that nothing is missing"
        return f"readings of {steps} steps, too few: {needed}"
    faulty = len(problem.data.left_out)
    if explained and faulty > MOST_FAULTY * (faulty + problem.count):
        out = f"{faulty} of {faulty + problem.count} readings are faulty and were left out"
        return f"{out}: too many to trust the others, although these agree with the model"
    if explained and lacks_test(problem, best):
        found = "what was added follows" if best.effects else "the declared model follows"
        fitted = f"{problem.count} readings, {len(best.free)} fitted parameters"
        untested = f"{found} the readings down to their noise, but nothing tests it"
        return f"{fitted}, too few steps to hold any out: {untested}"
    return ""


def unusable_data(problem: FitProblem, declared: Fit) -> str:
    """Why these data cannot discriminate between models, so that no search is made; empty where they can."""
    if problem.count < FEWEST:
        readings = "1 reading" if problem.count == 1 else f"{problem.count} readings"
        return f"{readings}: at least {FEWEST} are needed to judge a model"
    unknown = unknown_noise(problem.data)
    if unknown:
        needed = "that takes at least three steps with readings of the same quantity at the same location"
        return f"no sigma is given for {', '.join(unknown)}, and it cannot be estimated: {needed}"
    ratio = motion_over_noise(problem, declared)
    if ratio < 1.0:
        differ = f"differ from those of the straight, unloaded robot by {ratio:.2g} times their sigma (rms)"
        return f"the noise is larger than the motion of the robot: the predicted readings {differ}"
    return ""


def lacks_test(problem: FitProblem, fit: Fit) -> bool:
    """Whether no steps are held out and few readings are left beyond the fitted parameters."""
    return not np.any(problem.held_out) and problem.count - len(fit.free) < TO_SPARE


def unknown_noise(data: MeasuredData) -> list[str]:
    """Families of channels whose sigma is neither given nor to be estimated from the scatter over three steps."""
    missing = {r.channel.family for r in data.readings if r.sigma is None}
    estimable = {data.readings[int(i[0])].channel.family for i in noise.series(data.readings) if i.size >= 3}
    return sorted(missing - estimable)


def mostly_estimated_noise(data: MeasuredData) -> str:
    """Why a declared model that leaves noise proves nothing: most readings have no sigma; empty where they have.

    The noise is then estimated from what the declared model leaves, so that it cannot speak for that model.
    """
    without = [r for r in data.readings if r.sigma is None]
    if 2 * len(without) <= len(data.readings):
        return ""
    families = ", ".join(sorted({r.channel.family for r in without}))
    return (
        f"no sigma is given for {families}, and what the declared model leaves scatters from step to step like noise: "
        "if that is the noise of the sensors, nothing is missing; but an effect that changes from step to step without "
        "order would look the same. Give sigma in observations.csv"
    )


def motion_over_noise(problem: FitProblem, declared: Fit) -> float:
    """Predicted readings less those of the straight, unloaded robot, rms over sigma [1]."""
    heights = (r.location if r.quantity == "position_z" else 0.0 for r in problem.data.readings)
    at_rest = np.array([float(s or 0.0) for s in heights])
    motion = (problem.readings.values / problem.sigma - declared.residual) - at_rest / problem.sigma
    known = motion[np.isfinite(motion)]
    return float(np.sqrt(np.mean(known**2))) if known.size else 0.0

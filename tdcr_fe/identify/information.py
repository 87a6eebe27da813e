"""Whether the data suffice for a verdict: number of readings, known noise, and motion above the noise."""

from __future__ import annotations

import numpy as np

from tdcr_fe.identify.noise import series
from tdcr_fe.identify.problem import Fit, FitProblem
from tdcr_fe.io.measured import MeasuredData

#: Smallest number of readings from which models are compared.
FEWEST = 4

#: Smallest number of steps with readings, and largest share of faulty readings, with which nothing may be missing.
FEWEST_STEPS, MOST_FAULTY = 4, 0.3

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
    if explained and steps < FEWEST_STEPS:
        return f"readings of {steps} steps, too few: at least {FEWEST_STEPS} are needed to say that nothing is missing"
    faulty = len(problem.data.left_out)
    if explained and faulty > MOST_FAULTY * (faulty + problem.count):
        return (
            f"{faulty} of {faulty + problem.count} readings are faulty and were left out: too many to trust the "
            "others, although these agree with the model"
        )
    if explained and lacks_test(problem, best):
        found = "what was added follows" if best.effects else "the declared model follows"
        return (
            f"{problem.count} readings, {len(best.free)} fitted parameters, too few steps to hold any out: {found} the "
            "readings down to their noise, but nothing tests it"
        )
    return ""


def unusable_data(problem: FitProblem, declared: Fit) -> str:
    """Why these data cannot discriminate between models, so that no search is made; empty where they can."""
    if problem.count < FEWEST:
        readings = "1 reading" if problem.count == 1 else f"{problem.count} readings"
        return f"{readings}: at least {FEWEST} are needed to judge a model"
    unknown = unknown_noise(problem.data)
    if unknown:
        return (
            f"no sigma is given for {', '.join(unknown)}, and it cannot be estimated: that takes at least three steps "
            "with readings of the same quantity at the same location"
        )
    ratio = motion_over_noise(problem, declared)
    if ratio < 1.0:
        return (
            "the noise is larger than the motion of the robot: the predicted readings differ from those of the "
            f"straight, unloaded robot by {ratio:.2g} times their sigma (rms)"
        )
    return ""


def lacks_test(problem: FitProblem, fit: Fit) -> bool:
    """Whether no steps are held out and few readings are left beyond the fitted parameters."""
    return not np.any(problem.held_out) and problem.count - len(fit.free) < TO_SPARE


def unknown_noise(data: MeasuredData) -> list[str]:
    """Families of channels whose sigma is neither given nor to be estimated from the scatter over three steps."""
    missing = {r.channel.family for r in data.readings if r.sigma is None}
    estimable = {data.readings[int(i[0])].channel.family for i in series(data.readings) if i.size >= 3}
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
    at_rest = np.array([r.channel.at_rest(r.location) for r in problem.data.readings])
    predicted = problem.readings.values / problem.sigma - declared.residual
    motion = predicted - at_rest / problem.sigma
    known = motion[np.isfinite(motion)]
    return float(np.sqrt(np.mean(known**2))) if known.size else 0.0

"""Likelihood profiles of fitted parameters: how the misfit grows as one is moved and the others follow it.

Where a parameter is normally distributed, the misfit grows with the square of the distance in standard errors. Where it
is not, its 95 % interval is that of the profile (Bates and Watts, Nonlinear Regression Analysis, Sec. 6.1). The others
follow along the ridge that the covariance gives, so that a profile takes four runs.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tdcr_fe.identify import fitting
from tdcr_fe.identify.problem import Fit, FitProblem
from tdcr_fe.identify.result import Profile
from tdcr_fe.identify.settings import OutOfTime

Array = NDArray[np.float64]

#: Where a profile is computed, in standard errors [1].
DISTANCES = np.array([-2.0, -1.0, 0.0, 1.0, 2.0])


def profiles(problem: FitProblem, fit: Fit) -> tuple[Profile, ...]:
    """Profiles of all free parameters of a fit; those for which the time of the problem does not suffice are left out.

    Parameters
    ----------
    problem
        Readings and forward model.
    fit
        The final model.
    """
    spread = fitting.covariance(problem, fit)
    deviation = np.sqrt(np.maximum(np.diag(spread), 0.0))
    by_name = {e.name: e for e in fit.effects}
    z = problem.coordinates(fit.effects, fit.values, fit.free)
    limits = np.array([problem.bounds(by_name[k[0]], k[1]) for k in fit.free]).reshape(-1, 2)
    weights = problem.root_weights(fit.residual)[problem.fitted]
    jacobian = fit.jacobian[problem.fitted] * weights[:, None]
    found = []
    for i, key in enumerate(fit.free):
        if not deviation[i] > 0.0:
            continue
        step = spread[:, i] / deviation[i]
        ridge = z + DISTANCES[:, None] * step
        inside = np.all((ridge >= limits[:, 0]) & (ridge <= limits[:, 1]), axis=1)
        points = [problem.point(fit.effects, fit.values, fit.free, x) for x in ridge[inside]]
        try:
            runs = fitting.run_fits(
                problem, [fitting.evaluated(problem, fit.effects, p, (), fit) for p in points]
            )
        except OutOfTime:
            break
        cost = np.array([x.cost for x in runs])
        # In units of the growth by one standard error where the model is linear.
        growth = np.sqrt(np.maximum(cost - fit.cost, 0.0)) / np.linalg.norm(jacobian @ step)
        roots = np.sign(DISTANCES[inside]) * growth
        values = np.array([p[key[0]][key[1]] for p in points])
        known = np.isfinite(growth)
        order = np.argsort(values[known])
        found.append(Profile(".".join(key), values[known][order], roots[known][order]))
    return tuple(found)

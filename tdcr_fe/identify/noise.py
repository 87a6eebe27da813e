"""Tests of whether a residual is noise: size, structure, outliers; and estimates of sigma."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtrc, ndtr, ndtri

from tdcr_fe.identify.holdout import directions, inputs
from tdcr_fe.identify.misfit import Structure
from tdcr_fe.io.measured import MeasuredData
from tdcr_fe.io.readings import Reading

Array = NDArray[np.float64]

#: Residuals are clipped at this many sigma in tests of noise, so that a few outliers do not dominate.
CLIP = 4.0

#: A reading with a residual above this many sigma (of the remaining misfit, where that is larger) is an outlier.
OUTLIER = 5.0


def series(readings: Sequence[Reading]) -> list[NDArray[np.int_]]:
    """Indices of the readings of each quantity and location, in their order."""
    found: dict[tuple[str, float | str | None], list[int]] = {}
    for i, r in enumerate(readings):
        found.setdefault((r.quantity, r.location), []).append(i)
    return [np.array(i) for i in found.values()]


def estimate_sigma(data: MeasuredData, residual: Array) -> tuple[Array, bool]:
    """Sigma of every reading, in its unit: what is given, or the scatter of the residual about smooth curves.

    The scatter is taken robustly from second differences along the steps, over all readings of the same kind.

    Parameters
    ----------
    data
        Readings.
    residual
        Reading less model, in the readings' units, shape (n,).

    Returns
    -------
    sigma : ndarray, shape (n,)
    estimated : bool
        Whether any was missing.
    """
    sigma = np.array([math.nan if r.sigma is None else r.sigma for r in data.readings])
    missing = np.isnan(sigma)
    if not np.any(missing):
        return sigma, False
    family = np.array([r.channel.family for r in data.readings])
    for kind in set(family[missing].tolist()):
        seconds = []
        for i in series(data.readings):
            if family[i[0]] == kind and i.size >= 3:
                r = residual[i]
                seconds.append(r[2:] - 2.0 * r[1:-1] + r[:-2])
        values = np.abs(np.concatenate(seconds)) if seconds else np.abs(residual[family == kind])
        values = values[np.isfinite(values)]
        scatter = (
            1.4826 * float(np.median(values)) / (math.sqrt(6.0) if seconds else 1.0) if values.size else 0.0
        )
        known = data.readings[int(np.flatnonzero(family == kind)[0])].channel
        floor = known.resolution(data.robot.backbone.length)
        sigma[missing & (family == kind)] = max(scatter, floor)
    return sigma, True


def clipped(r: Array) -> Array:
    """Residuals clipped to the range of noise."""
    return np.clip(r, -CLIP, CLIP)


def chi_square_z_score(r: Array, parameters: int = 0) -> float:
    """Sum of squares against noise of unit variance, as a z-score (robust: residuals are clipped)."""
    dof = max(1, r.size - parameters)
    p = float(chdtrc(dof, float(np.sum(clipped(r) ** 2))))
    return float(-ndtri(max(p, 1e-300)))


def lag1_autocorrelation(data: MeasuredData, r: Array) -> float:
    """Autocorrelation of the residual between neighbouring steps, over all quantities and locations [1]."""
    parts = [r[i] for i in series(data.readings) if i.size >= 2]
    size = sum(float(np.sum(x[1:] ** 2 + x[:-1] ** 2)) for x in parts) / 2.0
    return sum(float(np.sum(x[1:] * x[:-1])) for x in parts) / size if size > 0.0 else 0.0


def structure(data: MeasuredData, r: Array, parameters: int = 0) -> tuple[Structure, ...]:
    """Tests of a residual over sigma: by quantity, location, tendon, branch, load, step; autocorrelation and signs.

    Parameters
    ----------
    data
        Readings.
    r
        Residual over sigma, shape (n,).
    parameters
        How many were fitted.

    Returns
    -------
    tuple of Structure
        The most significant first.
    """
    c = clipped(r)
    readings = data.readings
    position = {n: k for k, n in enumerate(data.step_ids)}
    step = np.array([position[x.step] for x in readings])
    tests: list[Structure] = []

    def size(group: str, mask: NDArray[np.bool_]) -> None:
        n = int(np.count_nonzero(mask))
        if n >= 5:
            share = n * (1.0 - parameters / max(r.size, parameters + 1))
            p = float(chdtrc(share, float(np.sum(c[mask] ** 2))))
            tests.append(Structure(group, float(-ndtri(max(p, 1e-300))), p))

    size("all readings", np.ones(r.size, dtype=bool))
    for q in dict.fromkeys(x.quantity for x in readings):
        size(f"quantity {q}", np.array([x.quantity == q for x in readings]))
    for location in sorted({x.location for x in readings if isinstance(x.location, float)}):
        size(f"at s = {location:g} m", np.array([x.location == location for x in readings]))
    table, moves = inputs(data), directions(data)
    m = len(data.robot.tendons)
    for i, name in enumerate(data.robot.tendon_names):
        pulled = table[:, i] > 0.3
        size(f"tendon {name} pulled", pulled[step])
        size(f"tendon {name} being pulled", (moves[:, i] > 0)[step])
        size(f"tendon {name} being let out", (moves[:, i] < 0)[step])
    size("loaded at the tip", (np.abs(table[:, m:]).max(axis=1) > 0.0)[step])
    size("not loaded at the tip", (np.abs(table[:, m:]).max(axis=1) == 0.0)[step])
    for number, k in position.items():
        size(f"step {number}", step == k)
    products, means = [], []
    for one in series(readings):
        if one.size >= 4:
            products.append(c[one][1:] * c[one][:-1])
            means.append((one, float(np.sum(c[one]) / math.sqrt(one.size))))
    if products:
        together = np.concatenate(products)
        z = float(np.sum(together) / math.sqrt(together.size))
        tests.append(Structure("lag-1 autocorrelation over the steps", z, float(ndtr(-z))))
        runs = np.sign(together)
        z = float(np.sum(runs) / math.sqrt(runs.size))
        tests.append(Structure("equal signs in neighbouring steps", z, float(ndtr(-z))))
    for which, z in means:
        x = readings[int(which[0])]
        at = "" if x.location is None else f" at {x.location}"
        tests.append(Structure(f"mean of {x.quantity}{at}", abs(z), float(2.0 * ndtr(-abs(z)))))
    return tuple(sorted(tests, key=lambda t: t.p_value))


def is_noise(tests: Sequence[Structure], significance: float) -> bool:
    """Whether no test is significant, with Bonferroni's correction for their number."""
    return all(t.p_value * len(tests) > significance for t in tests)


def outliers(r: Array) -> tuple[tuple[int, float], ...]:
    """Indices of outliers, and their residual over sigma."""
    scale = max(1.0, 1.4826 * float(np.median(np.abs(r))))
    return tuple((int(i), float(r[i])) for i in np.flatnonzero(np.abs(r) > OUTLIER * scale))

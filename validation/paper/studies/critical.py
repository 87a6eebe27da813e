"""Search for critical loads: a load is raised in small steps, and a loss of stability is bracketed by bisection."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tdcr_fe.model.loading import Load, LoadStep, Model, resolve
from tdcr_fe.model.robot import Robot
from tdcr_fe.solve.load_steps.load_path import StepFailed
from tdcr_fe.solve.simulate import Simulation
from tdcr_fe.solve.stability import Stability, stability

Array = NDArray[np.float64]

#: Arc-length distance over the length above which two points count in the nearest approach [1].
APART = 0.18


@dataclass(frozen=True)
class CriticalSearch:
    """Result of raising a load at the tip.

    Attributes
    ----------
    direction : (float, float, float)
        Unit vector of the load.
    loads : ndarray, shape (n,)
        Sizes that were solved [N], the first one zero.
    eigenvalues : ndarray, shape (n,)
        Smallest eigenvalue at each, see `tdcr_fe.solve.stability` [1].
    divergences : ndarray, shape (n,)
        Smallest real part of the eigenvalues of the tangent itself; with friction a bifurcation is where this vanishes,
        without friction it is the same [1].
    tips : ndarray, shape (n, 3)
        [m].
    nearest : float
        Least distance of two points of the backbone that are more than `APART` of the length apart along it [m];
        contact of the robot with itself is not modelled.
    critical : float or None
        Load at which the smallest real part becomes zero, or beyond which no equilibrium follows [N]; None where
        none was met.
    how : str
        "none", "eigenvalue", "snap" (the robot jumped) or "stop" (no equilibrium was found).
    """

    direction: tuple[float, float, float]
    loads: Array
    eigenvalues: Array
    divergences: Array
    tips: Array
    nearest: float
    critical: float | None
    how: str

    @property
    def smallest(self) -> float:
        """Smallest eigenvalue over all loads [1]."""
        return float(np.min(self.eigenvalues))

    @property
    def largest_rate(self) -> tuple[float, float]:
        """Largest tip displacement per load [m/N], and the load in the middle of that increment [N]."""
        if len(self.loads) < 2:
            return 0.0, 0.0
        rates = np.linalg.norm(np.diff(self.tips, axis=0), axis=1) / np.diff(self.loads)
        k = int(np.argmax(rates))
        return float(rates[k]), float(0.5 * (self.loads[k] + self.loads[k + 1]))


def search_critical_load(
    robot: Robot,
    model: Model,
    before: Sequence[LoadStep],
    direction: Sequence[float],
    loads: Sequence[float],
    tolerance: float = 1e-4,
) -> CriticalSearch:
    """Raise a load at the tip until the robot loses its stability, or until the largest load.

    Parameters
    ----------
    robot, model
        Description. The criterion is the sign of the smallest real part of the tangent's eigenvalues, see
        `tdcr_fe.solve.stability`.
    before
        Steps that come first (the tendons).
    direction
        Of the load in the world, shape (3,); its length does not matter.
    loads
        Sizes, ascending [N].
    tolerance
        Relative accuracy of a critical load [1].
    """
    unit = np.asarray(direction, dtype=float) / np.linalg.norm(direction)
    ramp = _Ramp(robot, model, tuple(before), unit)
    path = ramp.follow([0.0, *loads])
    length = robot.backbone.length
    return CriticalSearch(
        _vector(unit),
        np.array([0.0, *loads][: len(path.stabilities)]),
        np.array([x.smallest for x in path.stabilities]),
        np.array([x.divergence for x in path.stabilities]),
        np.array([p[-1] for p in path.shapes]),
        min((_nearest(p, length) for p in path.shapes), default=float("nan")),
        None if path.how == "none" else ramp.bracketed([0.0, *loads], path, tolerance),
        path.how,
    )


class _Path(NamedTuple):
    """Equilibria along a ramp of the load.

    Attributes
    ----------
    stabilities : list of Stability
        At every size solved, the unloaded state first.
    shapes : list of ndarray, shape (n, 3)
        Positions of the nodes [m].
    how : str
        Why it ended, as in `CriticalSearch`.
    """

    stabilities: list[Stability]
    shapes: list[Array]
    how: str


@dataclass(frozen=True)
class _Ramp:
    """A load at the tip, in a direction, after other steps.

    Attributes
    ----------
    robot : Robot
    model : Model
    before : tuple of LoadStep
        The last of them is the state without load; without any, the unloaded robot is solved.
    direction : ndarray, shape (3,)
        Unit vector.
    """

    robot: Robot
    model: Model
    before: tuple[LoadStep, ...]
    direction: Array

    def follow(self, sizes: Sequence[float]) -> _Path:
        """Follow the equilibrium over sizes of the load [N], of which the first is zero, until stability is lost."""
        tip = self.robot.backbone.length
        new = sizes[1:] if self.before else sizes
        steps = [
            *self.before,
            *(LoadStep(f"{f:.6g} N", loads={"tip": Load(tip, _vector(f * self.direction))}) for f in new),
        ]
        targets = resolve(self.robot, steps)
        simulation = Simulation(self.robot, self.model, targets)
        found: list[Stability] = []
        shapes: list[Array] = []
        for number, target in enumerate(targets, start=1):
            try:
                report = simulation.advance(target)
            except StepFailed:
                return _Path(found, shapes, "stop")
            if number < len(self.before):
                continue
            if report.snapped and number > len(self.before):
                return _Path(found, shapes, "snap")
            found.append(stability(simulation))
            shapes.append(simulation.state.configuration.positions.copy())
            if found[-1].divergence <= 0.0:
                return _Path(found, shapes, "eigenvalue")
        return _Path(found, shapes, "none")

    def bracketed(self, sizes: Sequence[float], path: _Path, tolerance: float) -> float:
        """Load at which a path lost its stability, by bisection to a relative tolerance [N]."""
        good = len(path.stabilities) - (path.how == "eigenvalue")
        low, high = sizes[max(good - 1, 0)], sizes[min(good, len(sizes) - 1)]
        stable = list(sizes[: max(good, 1)])
        while high - low > tolerance * max(high, 1e-6):
            middle = 0.5 * (low + high)
            if self.follow([*stable, middle]).how == "none":
                low = middle
                stable.append(middle)
            else:
                high = middle
        return 0.5 * (low + high)


def _nearest(places: Array, length: float) -> float:
    """Least distance between nodes that are far apart along the backbone [m]."""
    step = np.linalg.norm(np.diff(places, axis=0), axis=1)
    s = np.concatenate(([0.0], np.cumsum(step)))
    distance = np.linalg.norm(places[:, None] - places[None], axis=2)
    far = np.abs(s[:, None] - s[None]) > APART * length
    return float(distance[far].min())


def _vector(v: Array) -> tuple[float, float, float]:
    return float(v[0]), float(v[1]), float(v[2])

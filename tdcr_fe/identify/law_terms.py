"""Terms of a law: factors that the robot knows in a bay, times a direction, at one place or along all bays."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import combinations_with_replacement

import numpy as np
from numpy.typing import NDArray

from tdcr_fe.identify.law_state import COMPONENTS, BayState

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Factor:
    """A number that the robot knows in every bay."""

    name: str  # in sentences
    symbol: str  # in formulas
    powers: tuple[int, int, int]  # of metre, newton and second
    value: Callable[[BayState], Array]  # from a `BayState` to shape (K, n_bays)


@dataclass(frozen=True)
class Direction:
    """What a moment or force points along."""

    name: str
    symbol: str
    powers: tuple[int, int, int]  # of metre, newton and second
    value: Callable[[BayState], Array]  # from a `BayState` to an action of shape (K, n_bays, 5)
    is_force: bool = False


def _moment(x: Array, y: Array) -> Array:
    full = np.zeros((*x.shape, COMPONENTS))
    full[..., 0], full[..., 1] = x, y
    return full


def _force(x: Array) -> Array:
    full = np.zeros((*x.shape[:2], COMPONENTS))
    full[..., 2:] = x
    return full


def _constant(x: float, y: float) -> Callable[[BayState], Array]:
    return lambda b: _moment(np.full(b.shape, x), np.full(b.shape, y))


def _tendon(b: BayState, weight: Array) -> Array:
    moment = np.einsum("kbt,btc->kbc", weight, b.lever)
    return _moment(moment[..., 0], moment[..., 1])


def _across(b: BayState) -> Array:
    return b.moved * np.array([1.0, 1.0, 0.0])


CURVATURE = Factor(
    "the curvature", "|kappa|", (-1, 0, 0), lambda b: np.linalg.norm(b.curvature[..., :2], axis=2)
)
POSITION = Factor(
    "the position along the backbone", "s", (1, 0, 0), lambda b: np.broadcast_to(b.middles, b.shape)
)
TENSION = Factor("the sum of the tensions", "T", (0, 1, 0), lambda b: b.tension.sum(axis=2))
TIME = Factor("time", "t", (0, 0, 1), lambda b: np.broadcast_to(b.time[:, None], b.shape))
TWIST = Factor("the twist", "tau", (-1, 0, 0), lambda b: b.curvature[..., 2])
LOADING = Factor(
    "the direction of the last command",
    "sign",
    (0, 0, 0),
    lambda b: np.broadcast_to(_overall_direction(b)[:, None], b.shape),
)
DEFLECTION = Factor("the displacement", "|u|", (1, 0, 0), lambda b: np.linalg.norm(_across(b), axis=2))


def _overall_direction(b: BayState) -> Array:
    """Sign of the last change of any tendon, by step."""
    total = b.tension.sum(axis=(1, 2))
    change = np.diff(total, prepend=0.0)
    scale = float(np.max(np.abs(total), initial=0.0))
    found = np.zeros(len(total))
    for k in range(len(total)):
        moved = abs(change[k]) > 1e-3 * scale
        found[k] = np.sign(change[k]) if moved else (found[k - 1] if k else 0.0)
    return found


BENDING = Direction(
    "along the curvature", "kappa", (-1, 0, 0), lambda b: _moment(b.curvature[..., 0], b.curvature[..., 1])
)
BENDING_X = Direction(
    "about the section's x axis, with the curvature there",
    "kappa_x e_x",
    (-1, 0, 0),
    lambda b: _moment(b.curvature[..., 0], 0.0 * b.curvature[..., 0]),
)
BENDING_Y = Direction(
    "about the section's y axis, with the curvature there",
    "kappa_y e_y",
    (-1, 0, 0),
    lambda b: _moment(0.0 * b.curvature[..., 0], b.curvature[..., 1]),
)
CROSSED = Direction(
    "across the curvature",
    "e_z x kappa",
    (-1, 0, 0),
    lambda b: _moment(-b.curvature[..., 1], b.curvature[..., 0]),
)
ABOUT_X = Direction("about the section's x axis", "e_x", (0, 0, 0), _constant(1.0, 0.0))
ABOUT_Y = Direction("about the section's y axis", "e_y", (0, 0, 0), _constant(0.0, 1.0))
TENDONS = Direction("along the moment of the tendons", "m_T", (1, 1, 0), lambda b: _tendon(b, b.tension))
TENDON_SIGN = Direction(
    "along the moment of each tendon, by the sign of its last motion",
    "sum(sign_i m_Ti)",
    (1, 1, 0),
    lambda b: _tendon(b, b.tension * b.direction[:, None, :]),
)
TENDON_LEVER = Direction(
    "along the lever of each tendon, by the sign of its last motion",
    "sum(sign_i r_i)",
    (1, 0, 0),
    lambda b: _tendon(b, np.broadcast_to(b.direction[:, None, :], b.tension.shape) * (b.tension > 0.0)),
)
LOADS = Direction(
    "along the bending moment of the loads",
    "m_F",
    (1, 1, 0),
    lambda b: _moment(b.load_moment[..., 0], b.load_moment[..., 1]),
)
DISPLACED = Direction(
    "along the displacement across the axis", "u", (1, 0, 0), lambda b: _force(_across(b)), True
)

#: Factors of which products of up to two are formed, and the directions they go with.
_FACTORS = (CURVATURE, POSITION, TENSION, TIME, TWIST, LOADING)
_DIRECTIONS = (
    BENDING, BENDING_X, BENDING_Y, CROSSED, ABOUT_X, ABOUT_Y, TENDONS, TENDON_SIGN, TENDON_LEVER, LOADS,
)  # fmt: skip

#: Products that a listed effect has: a stiffness, a precurvature, a gain.
_LISTED = {((), BENDING), ((), ABOUT_X), ((), ABOUT_Y), ((), TENDONS)}


@dataclass(frozen=True)
class Term:
    """One term of a law, without its coefficient."""

    factors: tuple[Factor, ...]
    direction: Direction
    bay: int | None = None  # the only bay where it acts, from 0; None: all bays

    @property
    def key(self) -> str:
        """Its factors, direction and bay as a text."""
        where = "" if self.bay is None else f" in bay {self.bay + 1}"
        return f"{self.product}{where}"

    @property
    def product(self) -> str:
        """Factors and direction as a formula."""
        symbols: list[str] = []
        for name in dict.fromkeys(f.symbol for f in self.factors):
            power = sum(f.symbol == name for f in self.factors)
            symbols.append(name if power == 1 else f"{name}^{power}")
        return " ".join([*symbols, self.direction.symbol])

    @property
    def unit(self) -> str:
        """Of its coefficient."""
        target = (0, 1, 0) if self.direction.is_force else (1, 1, 0)
        powers = [*(f.powers for f in self.factors), self.direction.powers]
        left = [t - sum(p[i] for p in powers) for i, t in enumerate(target)]
        names = {1: "N", 0: "m", 2: "s"}
        text = [names[i] if left[i] == 1 else f"{names[i]}^{left[i]}" for i in (1, 0, 2) if left[i] != 0]
        return " ".join(text) or "1"

    def action(self, state: BayState) -> Array:
        """With a coefficient of one, shape (K, n_bays, 5)."""
        value = self.direction.value(state)
        for f in self.factors:
            value = value * f.value(state)[..., None]
        if self.bay is not None:
            value = value * (np.arange(value.shape[1]) == self.bay)[None, :, None]
        return np.asarray(value)

    def slope(self, state: BayState) -> Array:
        """Derivative of the action by curvatures and displacements of the same bay, shape (K, n_bays, 5, 5)."""
        here = self.action(state)
        columns = []
        length = float(state.edges[-1])
        for c in range(COMPONENTS):
            h = 1e-6 / length if c < 2 else 1e-6 * length
            change = np.zeros(here.shape)
            change[..., c] = h
            columns.append((self.action(state.corrected(change)) - here) / h)
        return np.stack(columns, axis=-1)


def library(state: BayState) -> list[Term]:
    """Candidate terms on the data: those that are not zero everywhere.

    Products of up to two factors along every direction in all bays; of one factor in single bays; forces on single
    disks that grow with the second or third power of the displacement. Products that a listed effect has are left out.
    """
    products = [p for n in (0, 1, 2) for p in combinations_with_replacement(_FACTORS, n)]
    terms = [
        Term(p, d)
        for d in _DIRECTIONS
        for p in products
        if (p, d) not in _LISTED and not _repeated_sign(p, d)
    ]
    bays = state.shape[1]
    for b in range(bays):
        terms += [Term((f,), BENDING, b) for f in (CURVATURE, TENSION, TIME, LOADING)]
        terms += [Term((f,), d, b) for f in (TIME, TENSION) for d in (ABOUT_X, ABOUT_Y)]
        terms += [Term((DEFLECTION,) * n, DISPLACED, b) for n in (1, 2)]
    return [t for t in terms if float(np.nanmax(np.abs(t.action(state)), initial=0.0)) > 0.0]


def _repeated_sign(factors: tuple[Factor, ...], direction: Direction) -> bool:
    """Whether a sign stands twice: its square is one."""
    count = factors.count(LOADING) + (direction in (TENDON_SIGN, TENDON_LEVER))
    return count > 1

"""How tension passes along a tendon: Capstan friction with presliding at every hole, and its tangent.

Laws of the coefficient of friction (constant, Stribeck, force-dependent) are in `tdcr_fe/model/friction.py`.

A tendon is pulled at the base plate, runs through holes ``k = 1 .. n-1`` and is anchored at hole ``n``.
Segment ``k`` lies between hole ``k-1`` and hole ``k``; it has length ``l_k`` and tension ``T_k``; the tendon turns
by ``theta_k`` at hole ``k``. Tendon material that has passed hole ``k`` towards the base is the slip ``u_k``.
The mobilisation ``s_k`` in [-1, 1] is the part of the available friction that acts at a hole: +1 where the tendon is
pulled, -1 where it is released, between where it sticks. It follows the slip (`tdcr_fe.elements.hysteresis`), and

    T_k+1 = max(0, T_k exp(-s_k mu theta_k) - s_k a)            for s_k >= 0,
    T_k+1 = (T_k + |s_k| a) exp(|s_k| mu theta_k)               for s_k < 0,

which is the Capstan equation (paper, Eqs. 28-31) where the hole slips, with an adhesion ``a`` beside it. The
coefficient ``mu`` is a number, or depends on slip rate and normal force (`tdcr_fe.elements.coefficients`). The
derivation is in docs/theory.md, section "Friction".
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tdcr_fe.elements import Array, Flags
from tdcr_fe.elements.capstan import TensionDerivatives, TensionField, capstan
from tdcr_fe.elements.coefficients import (
    MAX_ITERATIONS,
    CoefficientLaw,
    Coefficients,
    Linearisation,
    evaluate_laws,
    normal_forces,
    solve_coefficients,
    tension_derivatives,
)
from tdcr_fe.elements.complementarity import solve_box
from tdcr_fe.elements.hysteresis import ACCEPTED, ElasticPlastic, FrictionState, Hysteresis
from tdcr_fe.elements.tendons import CableShape

#: Least part of a step in a line search [1]. With 0.2, 12 of 2400 random states found no mobilisations, with this none.
LEAST_PART = 0.01


#: Gives ratios of coefficients and their slopes by the slips, see `TendonLaw.coefficient_curves`.
CoefficientCurve = Callable[[Array, Array], tuple[Array, Array]]


@dataclass(frozen=True)
class TendonParameters:
    """Parameters of all tendons of one robot; shorter tendons are padded at the end."""

    lengths: Array  # (m, n): Length of every segment in the unloaded state, zero where padded [m]
    mask: Flags  # (m, n): Which segments exist
    friction: Array  # (m, n-1): Friction coefficient at every hole, zero at and beyond the anchor [1]
    adhesion: Array  # (m, n-1): Tension drop at every hole that does not grow with the tension [N]
    compliance: Array  # (m,): ``1 / EA`` of the tendon, zero where inextensible [1/N]
    pretension: Array  # (m,): Tension in the unloaded state where the displacement at the base is zero [N]
    spring: Array  # (m,): Compliance of the spring between drive and tendon, zero where there is none [m/N]
    follows: Flags  # (m, n-1): Which holes follow the law of their tendon instead of ``friction``
    # Law of each tendon's coefficients of friction; None where they are constant
    laws: tuple[CoefficientLaw | None, ...]

    @property
    def rigid(self) -> Flags:
        """Which tendons stretch no more than the spring at their drive, (m,)."""
        return (self.compliance == 0.0) & (self.spring == 0.0)

    @property
    def material(self) -> Array:
        """Length of every segment's tendon without tension, where the displacement at the base is zero [m], (m, n)."""
        return self.lengths / (1.0 + self.compliance * self.pretension)[:, None]

    @cached_property
    def by_law(self) -> list[tuple[CoefficientLaw, Flags]]:
        """Laws of coefficients, each once, with the holes that follow it."""
        # they may have no hash
        each = [x for i, x in enumerate(self.laws) if x is not None and x not in self.laws[:i]]
        return [(x, self.follows & np.array([own == x for own in self.laws])[:, None]) for x in each]


@dataclass(frozen=True)
class FrictionModel:
    """Which slip drives friction at which holes, by ``g`` mobilisations of every tendon.

    The matrices are given for a number ``n`` of segments. Adding a model takes an entry of `FRICTION_MODELS` and its
    name in `tdcr_fe.model.loading.FrictionKind`.
    """

    # From released segment lengths to the slip that drives each mobilisation, shape (g, n)
    slip_operator: Callable[[int], Array]
    hole_incidence: Callable[[int], Array]  # From the mobilisations to the holes ``1 .. n-1``, shape (n-1, g)
    active: bool = True  # Whether there is friction


#: Every friction model, by its name in ``scenario.toml``: none, so that the tension is the same all along (paper,
#: Eq. 11); the paper's law, with one sign per tendon from the rate of its whole length (Eqs. 15-31, Fig. 2); and stick,
#: pull-slip or release-slip at each hole, from the material that passes that hole.
FRICTION_MODELS: dict[str, FrictionModel] = {
    "none": FrictionModel(lambda n: np.zeros((0, n)), lambda n: np.zeros((n - 1, 0)), active=False),
    "per-tendon": FrictionModel(lambda n: np.ones((1, n)), lambda n: np.ones((n - 1, 1))),
    "per-hole": FrictionModel(lambda n: np.triu(np.ones((n - 1, n)), 1), lambda n: np.eye(n - 1)),
}


class TendonLaw:
    """Tensions along all tendons of a robot from the lengths and angles of their segments.

    Parameters
    ----------
    parameters
        Parameters of the tendons.
    model
        The slip that drives the friction at each hole.
    hysteresis
        How the mobilisation of a hole follows its slip.

    Attributes
    ----------
    shape : tuple of int
        Numbers of tendons and of segments of the longest one, (m, n).
    groups : int
        Mobilisations per tendon, g.
    slip_operator : ndarray, shape (g, n)
        From released segment lengths to the slip that drives each mobilisation [1].
    hole_incidence : ndarray, shape (n-1, g)
        From the mobilisations to the holes [1].
    frictional : ndarray of bool, shape (m, g)
        For which mobilisations there is friction.
    has_friction : bool
        Whether there is friction anywhere.
    adhesive : ndarray of bool, shape (m,)
        Which tendons have a hole with adhesion.
    elastic : bool
        Whether any tendon stretches, or the spring at its drive.
    varies : bool
        Whether any coefficient of friction follows a law.
    simple : bool
        Whether tensions follow from angles and mobilisations alone, and these linearly from the slips.
    """

    def __init__(
        self, parameters: TendonParameters, model: FrictionModel, hysteresis: Hysteresis | None = None
    ) -> None:
        self.parameters = parameters
        self.model = model
        self.hysteresis = hysteresis or ElasticPlastic()
        m, n = parameters.lengths.shape
        self.shape = (m, n)
        adhesion = parameters.adhesion
        self.adhesive: Flags = np.asarray(np.any(adhesion > 0.0, axis=1))
        self._adhesion = adhesion if model.active and self.adhesive.any() else None
        self.slip_operator = model.slip_operator(n)
        self.hole_incidence = model.hole_incidence(n)
        self.groups = self.slip_operator.shape[0]
        self.varies = model.active and bool(np.any(parameters.follows))
        acts = (parameters.friction > 0.0) | (adhesion > 0.0) | parameters.follows
        self.frictional: Flags = (acts.astype(float) @ np.abs(self.hole_incidence)) > 0.0
        self._material = parameters.material
        self.has_friction = bool(np.any(self.frictional))
        self.elastic = bool(np.any(parameters.compliance > 0.0) or np.any(parameters.spring > 0.0))
        self._masked = parameters.mask.astype(float)
        special = self.elastic or self._adhesion is not None or self.varies
        self.simple = self.hysteresis.linear and not special

    def initial_state(self) -> FrictionState:
        """History of a robot that was never loaded, its tendons just taut."""
        slip = self.slips(self.released_unloaded())
        return FrictionState(slip, np.zeros_like(slip))

    def released_unloaded(self) -> Array:
        """Released lengths in the unloaded shape without tension [m], shape (m, n): zero but for pretension."""
        found = self._material - self.parameters.lengths
        found[:, 0] -= self.parameters.spring * self.parameters.pretension
        return found

    def slips(self, released: Array) -> Array:
        """Slip that drives each mobilisation, from the released segment lengths [m], (m, n) to (m, g)."""
        return released @ self.slip_operator.T

    def at_holes(self, mobilisation: Array) -> Array:
        """Mobilisation of every hole, (m, g) to (m, n-1)."""
        return mobilisation @ self.hole_incidence.T

    def field(
        self, base_tension: Array, shape: CableShape, mobilisation: Array, state: FrictionState, time: float
    ) -> TensionField:
        """Tensions for given mobilisations.

        Parameters
        ----------
        base_tension
            Tension at the base plate [N], shape (m,).
        shape
            Lengths of the segments, and angles by which the tendons turn at their holes.
        mobilisation
            Shape (m, g).
        state
            History at the beginning of the step, from which slip rates are computed.
        time
            At the end of the step [s]. Where none has passed since ``state``, slip rates stay as they were.

        Returns
        -------
        TensionField
            With the mobilisations fixed.
        """
        if self.varies:
            return self._field_with_laws(base_tension, shape, mobilisation, state, time)
        at_holes, friction = self.at_holes(mobilisation), self.parameters.friction
        tension, slopes = capstan(base_tension, shape.angles, at_holes, friction, self._adhesion)

        def derive() -> TensionDerivatives:
            return slopes().derivatives(self.hole_incidence)

        released, d_length, d_tension = self._released(tension, shape.lengths)
        slip = self.slips(released)
        return TensionField(
            tension, released, slip, mobilisation, d_length, d_tension, None, time, False, derive, slopes
        )

    def _released(self, tension: Array, lengths: Array) -> tuple[Array, Array, Array]:
        """Released lengths of the segments [m], with derivatives by their own lengths and tensions.

        That of the first has what the spring between drive and tendon gives.
        """
        if not self.elastic:  # the same, without what is one or zero: 1 % of a load step
            return (self._material - lengths) * self._masked, -self._masked, np.zeros_like(lengths)
        c = self.parameters.compliance[:, None]
        stretch = 1.0 / (1.0 + c * tension)
        released = (self._material - lengths * stretch) * self._masked
        by_tension = lengths * c * stretch**2 * self._masked
        released[:, 0] += self.parameters.spring * (tension[:, 0] - self.parameters.pretension)
        by_tension[:, 0] += self.parameters.spring
        return released, -stretch * self._masked, by_tension

    def _slip_rate(self, slip: Array, state: FrictionState, time: float) -> Array:
        """Rate of the slips at a time [m/s], that of the state where none has passed, shape (m, g)."""
        begin, duration = state.rates_from(time)
        if duration > 0.0:
            return np.asarray((slip - begin) / duration)
        return np.zeros_like(slip) if state.slip_rate is None else state.slip_rate

    def coefficient_curves(
        self, field: TensionField, angles: Array, state: FrictionState
    ) -> CoefficientCurve:
        """Coefficients as functions of slips [m] and mobilisations, (m, g), at the normal forces of a field.

        Over those of the field, without what is linear in the slips, which the derivatives of the field have.

        Parameters
        ----------
        field
            With laws of the coefficients.
        angles
            Turning angles at the holes [rad], shape (m, n-1).
        state
            History at the beginning of the step.

        Returns
        -------
        callable
            Gives these ratios [1] and their slopes [1/m], shape (m, g) each.
        """
        _, duration = state.rates_from(field.time)
        if not (self.varies and duration > 0.0):
            return lambda slip, mobilisation: (np.ones_like(slip), np.zeros_like(slip))
        summed = np.abs(self.hole_incidence)

        def at(slip: Array, mobilisation: Array) -> tuple[Array, Array]:
            rate = self._slip_rate(slip, state, field.time)
            found = self._coefficients(field.tension, angles, rate, mobilisation)
            return found.value @ summed, found.by_rate @ summed / duration

        value, slope = at(field.slip, field.mobilisation)
        scale = np.where(value > 0.0, value, np.inf)

        def ratios(slip: Array, mobilisation: Array) -> tuple[Array, Array]:
            there, slope_there = at(slip, mobilisation)
            bent = there - value - slope * (slip - field.slip)
            return 1.0 + bent / scale, (slope_there - slope) / scale

        return ratios

    def coefficient_change(self, field: TensionField, angles: Array, before: FrictionState) -> Array:
        """Changes of the coefficients with the slip rates since a history [1], shape (m, n-1).

        Arguments as of `coefficient_curves`.
        """
        if field.slip_rate is None:
            return np.zeros_like(angles)
        rates = field.slip_rate, self._slip_rate(before.slip, before, before.time)
        now, then = (self._coefficients(field.tension, angles, r, field.mobilisation).value for r in rates)
        return np.abs(now - then)

    def _coefficients(self, tension: Array, angles: Array, rate: Array, mobilisation: Array) -> Coefficients:
        """Coefficients by the laws; where a slip goes against its friction, as within presliding, it counts as rest.

        Parameters
        ----------
        tension, angles
            Tensions of the segments [N], shape (m, n), and turning angles at the holes [rad], shape (m, n-1).
        rate
            Rate of the slips [m/s], shape (m, g).
        mobilisation
            Shape (m, g).
        """
        p, along = self.parameters, self.at_holes((rate * mobilisation > 0.0).astype(float))
        normal = normal_forces(tension, angles)
        found = evaluate_laws(p.by_law, p.friction, normal, self.at_holes(rate) * along, angles)
        return found._replace(by_rate=found.by_rate * along)

    def _field_with_laws(
        self, base_tension: Array, shape: CableShape, mobilisation: Array, state: FrictionState, time: float
    ) -> TensionField:
        """`field` where coefficients of friction follow laws."""
        duration, lengths, angles = state.rates_from(time)[1], shape.lengths, shape.angles
        at_holes = self.at_holes(mobilisation)
        half, per_second = 0.5 * angles, 1.0 / duration if duration > 0.0 else 0.0
        # Derivatives of the slip rates at the holes by the released lengths of the segments [1/s].
        rate_by_released = (self.hole_incidence @ self.slip_operator) * per_second

        def linearise(coefficient: Array) -> Linearisation:
            tension, slopes = capstan(base_tension, angles, at_holes, coefficient, self._adhesion)
            released, _, released_d_tension = self._released(tension, lengths)
            rate = self._slip_rate(self.slips(released), state, time)
            law = self._coefficients(tension, angles, rate, mobilisation)
            by_tension = (law.by_rate[:, :, None] * rate_by_released) * released_d_tension[:, None, :]
            by_pull = law.by_normal * np.sin(half)
            hole = np.arange(half.shape[1])
            by_tension[:, hole, hole] += by_pull
            by_tension[:, hole, hole + 1] += by_pull
            at_hole = slopes()
            by_coefficient = at_hole.chain()[:, :, 1:] * at_hole.by_coefficient[:, None, :]
            return Linearisation(tension, slopes, law, by_tension, by_coefficient)

        undiminished = np.repeat(base_tension[:, None], self.shape[1], axis=1)
        about = self._slip_rate(self.slips(self._released(undiminished, lengths)[0]), state, time)
        start = self._coefficients(undiminished, angles, about, mobilisation)
        solved = solve_coefficients(linearise, start.value)
        tension = solved.tension
        released, d_length, d_tension = self._released(tension, lengths)
        slip = self.slips(released)
        rate = self._slip_rate(slip, state, time)
        depends = duration > 0.0 and bool(np.any(solved.law.by_rate))

        def derive() -> TensionDerivatives:
            by_length = rate_by_released[None] * d_length[:, None, :]
            return tension_derivatives(solved, angles, by_length, self.hole_incidence)

        return TensionField(
            tension, released, slip, mobilisation, d_length, d_tension, rate, time, depends, derive
        )

    def evaluate(
        self, base_tension: Array, shape: CableShape, state: FrictionState, time: float = 0.0
    ) -> TensionField:
        """Tensions with the mobilisations that follow from the configuration.

        Parameters
        ----------
        base_tension, shape
            As in `field`.
        state
            History at the beginning of the step.
        time
            As in `field`.

        Returns
        -------
        TensionField
            With derivatives that include the change of the mobilisations.
        """
        hysteresis = self.hysteresis
        if not self.elastic:
            # The slip does not depend on the tensions, so that the mobilisations follow at once.
            trial = hysteresis.trial(self.slips(self.parameters.lengths - shape.lengths), state)
            field = self.field(base_tension, shape, np.clip(trial, -1.0, 1.0), state, time)
            return self.with_slopes(field, lambda: np.abs(trial) < 1.0, trial, state)
        if not hysteresis.linear:
            return self._evaluate_in_slips(base_tension, shape, state, time)
        mobilisation = state.mobilisation
        for _ in range(MAX_ITERATIONS):
            field = self.field(base_tension, shape, mobilisation, state, time)
            trial = hysteresis.trial(field.slip, state)
            error = np.abs(np.clip(trial, -1.0, 1.0) - mobilisation)
            if not np.max(error, initial=0.0) > ACCEPTED:  # ends with nan, too
                break
            # A step of Newton's method: a complementarity problem by tendon.
            slip = hysteresis.slip_of(mobilisation, state)
            matrix = self._matrix(field, hysteresis.flexibility(mobilisation, mobilisation))
            right = field.slip - state.slip - slip + (matrix @ mobilisation[..., None])[..., 0]
            by_tendon = zip(matrix, right, mobilisation, strict=True)
            mobilisation = np.stack([solve_box(*x)[0] for x in by_tendon])
        return self.with_slopes(field, lambda: np.abs(trial) < 1.0, trial, state)

    def _evaluate_in_slips(
        self, base_tension: Array, shape: CableShape, state: FrictionState, time: float
    ) -> TensionField:
        """As `evaluate`, of elastic tendons whose mobilisations are curves of the slips.

        Newton's method for the slips, with a line search by tendon: for the mobilisations it went to and fro for ever
        in 68 of 600 random states.
        """
        slip, way = state.slip, np.zeros_like(state.slip)
        part, size = np.ones(len(slip)), np.full(len(slip), np.inf)
        for _ in range(4 * MAX_ITERATIONS):
            at = slip + part[:, None] * way
            trial = self.hysteresis.trial(at, state)
            mobilisation = np.clip(trial, -1.0, 1.0)
            field = self.field(base_tension, shape, mobilisation, state, time)
            trial_there = self.hysteresis.trial(field.slip, state)
            error = np.abs(np.clip(trial_there, -1.0, 1.0) - mobilisation)
            if not np.max(error, initial=0.0) > ACCEPTED:  # ends with nan, too
                break
            off = field.slip - at
            now = np.linalg.norm(off, axis=1)
            worse = now > size
            ahead = np.sign(np.where(at == state.slip, off, at - state.slip))
            # Full friction does not change with the slip, here within a metre.
            flexibility = np.where(np.abs(trial) < 1.0, self.hysteresis.flexibility(mobilisation, ahead), 1.0)
            step = flexibility * np.linalg.solve(self._matrix(field, flexibility), off[..., None])[..., 0]
            slip, way = np.where(worse[:, None], slip, at), np.where(worse[:, None], way, step)
            # A step of which no part is better is taken as a whole: the curves have corners at no slip.
            stuck = worse & (part < LEAST_PART)
            part = np.where(worse & ~stuck, 0.5 * part, 1.0)
            size = np.where(stuck, np.inf, np.where(worse, size, now))
        return self.with_slopes(field, lambda: np.abs(trial_there) < 1.0, trial_there, state)

    def _matrix(self, field: TensionField, flexibility: Array) -> Array:
        """Derivatives by the mobilisations of the slips that belong to them, less those of the slips [m], (m, g, g).

        The slips depend on them through the stretch of the tendons.
        """
        slips = (self.slip_operator * field.released_d_tension[:, None, :]) @ field.by_mobilisation
        return flexibility[:, :, None] * np.eye(self.groups) - slips

    def with_slopes(
        self, field: TensionField, slopes: Callable[[], NDArray[Any]], trial: Array, state: FrictionState
    ) -> TensionField:
        """A field with derivatives that include the change of the mobilisations, formed when first used.

        With the slopes 1 of holes that stick and 0 of those that slide it is the consistent tangent of the return
        mapping.

        Parameters
        ----------
        field
            At the mobilisations in this configuration.
        slopes
            Gives the derivatives of the mobilisations by their trial values [1], shape (m, g).
        trial
            These values, which are not limited to [-1, 1], shape (m, g).
        state
            History at the beginning of the step.
        """

        def derive() -> TensionDerivatives:
            direction = np.sign(trial - state.mobilisation)
            flexibility, slope = self.hysteresis.flexibility(field.mobilisation, direction), slopes()
            by_released = (slope / flexibility)[:, :, None] * self.slip_operator
            by_length, n = by_released * field.released_d_length[:, None, :], self.shape[1]
            by_shape, by_base, by_mobilisation = field.derivatives
            total = by_shape.copy()
            if not self.elastic:
                total[:, :, :n] += by_mobilisation @ by_length
                return TensionDerivatives(total, by_base, by_mobilisation)
            scaled = self._matrix(field, flexibility) / flexibility[:, :, None]
            jacobian = np.where(slope[:, :, None] > 0.0, scaled, np.eye(self.groups))
            by_tension = by_released * field.released_d_tension[:, None, :]
            right = by_tension @ np.concatenate((by_shape, by_base[:, :, None]), axis=2)
            right[:, :, :n] += by_length
            ds = by_mobilisation @ np.linalg.solve(jacobian, right)
            return TensionDerivatives(total + ds[:, :, :-1], by_base + ds[:, :, -1], by_mobilisation)

        return replace(field, depends_on_length=True, derive=derive, at_holes=None)

    def commit(self, field: TensionField, before: FrictionState | None = None) -> FrictionState:
        """History after a converged (sub)step; with the one before it where the next one goes on."""
        former = None
        if before is not None and field.slip_rate is not None and field.time > before.time:
            former = before.slip, before.time
        return FrictionState(field.slip, field.mobilisation, field.slip_rate, field.time, former)


def hole_states(mobilisation: Array, count: int) -> tuple[str, ...]:
    """Names of the states of the holes at the distal end of ``count`` segments, the anchor last.

    Parameters
    ----------
    mobilisation
        Mobilisation of the holes 1 .. n-1, shape (>= count - 1,).
    count
        Number of segments.
    """
    names = np.where(mobilisation >= 1.0, "pull", np.where(mobilisation <= -1.0, "release", "stick"))
    return (*names[: count - 1].tolist(), "anchor")

"""Along tendons: friction in closed forms, bounds, laws of the coefficient, derivatives; cables in wide holes."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from two_tendons import ANGLES, HOLES, LENGTHS, MASK, tendon_law

from tdcr_fe.elements.coefficients import normal_forces
from tdcr_fe.elements.friction import FRICTION_MODELS, TendonLaw, TendonParameters
from tdcr_fe.elements.hysteresis import Dahl, FrictionState
from tdcr_fe.elements.tendons import CableGeometry, CableShape
from tdcr_fe.model.friction import AngleDependentFriction, ForceDependentFriction, StribeckFriction

#: Tensions at the base [N].
BASE = np.array([2.0, 1.0])

# ---------------------------------------------------------------- adhesion, presliding, bounds


def test_without_friction_the_tension_is_the_same_all_along():
    x = tendon_law(FRICTION_MODELS["none"])
    field = x.evaluate(BASE, CableShape(0.9 * LENGTHS, ANGLES), x.initial_state())
    assert np.array_equal(field.tension, np.array([[2.0] * 4, [1.0] * 4]))
    assert not x.has_friction


def test_adhesion_drops_the_tension_by_the_same_at_every_hole():
    x = tendon_law(FRICTION_MODELS["per-hole"], mu=0.0, adhesion=0.1)
    for released, tensions in ((-1e-3, [2.0, 1.9, 1.8, 1.7]), (1e-3, [2.0, 2.1, 2.2, 2.3])):
        field = x.evaluate(BASE, CableShape(LENGTHS + released * MASK, ANGLES), x.initial_state())
        assert field.tension[0] == pytest.approx(tensions, abs=1e-14)


def test_a_reversal_has_to_slide_twice_the_presliding_distance():
    """From full pull to full release; at half of the slip the friction is zero."""
    x = tendon_law(FRICTION_MODELS["per-hole"], presliding=1e-6)
    state = x.commit(x.evaluate(BASE, CableShape(LENGTHS - 1e-3 * MASK, ANGLES), x.initial_state()))
    back = np.zeros((2, 4))
    back[0, 3] = 1e-6
    half = x.evaluate(BASE, CableShape(LENGTHS - 1e-3 * MASK + back, ANGLES), state)
    assert half.mobilisation[0] == pytest.approx([0.0] * 3, abs=1e-7)
    assert half.tension[0] == pytest.approx([2.0] * 4, abs=1e-7)
    whole = x.evaluate(BASE, CableShape(LENGTHS - 1e-3 * MASK + 2.1 * back, ANGLES), state)
    assert np.array_equal(whole.mobilisation[0], [-1.0] * 3)


#: Of a work: tensions up to 5 N and slips up to 15 um, each known to 16 digits [J].
ROUND_OFF = 1e-16


@pytest.mark.parametrize("compliance", [0.0, 1.0 / 400.0])
@settings(max_examples=150)
@given(
    base=st.just(0.0) | st.floats(1e-3, 5.0),
    changes=st.lists(st.lists(st.floats(-3e-6, 3e-6), min_size=4, max_size=4), min_size=1, max_size=5),
)
def test_bounds_hold_and_no_hole_creates_energy_whatever_is_done(compliance, base, changes):
    """Ratio within exp(+- mu theta); dissipation (T_k - T_k+1) du_k summed over presliding cycles.

    At a hole that slides, the tension drops in the direction in which the tendon moves.
    """
    x = tendon_law(FRICTION_MODELS["per-hole"], compliance=compliance)
    state = x.initial_state()
    for change in changes:
        lengths = LENGTHS + np.array(change) * MASK
        field = x.evaluate(np.array([base, base]), CableShape(lengths, ANGLES), state)
        for i, count in ((0, 4), (1, 2)):
            t, s = field.tension[i, :count], field.mobilisation[i, : count - 1]
            grip = np.exp(0.3 * ANGLES[i, : count - 1])
            assert np.all(t[1:] <= t[:-1] * grip * (1 + 1e-12))
            assert np.all(t[1:] * grip * (1 + 1e-12) >= t[:-1])
            moved = (field.slip - state.slip)[i, : count - 1]
            slides = np.abs(s) >= 1.0
            assert np.all((s * moved)[slides & (np.abs(moved) > 1e-15)] > 0.0)
            assert np.all(((t[:-1] - t[1:]) * moved)[slides] >= -ROUND_OFF)
        state = x.commit(field)


# ------------------------------------------------------------ friction coefficients


class ForceAndRate:
    """A with_coefficient that depends on both arguments, and on the direction of the rate."""

    def coefficient(self, normal_force, slip_rate, turning_angle):
        mu = 0.3 + 0.2 * normal_force + 0.05 * np.tanh(slip_rate / 1e-3)
        return mu, 0.2 + 0.0 * mu, 0.05 / 1e-3 / np.cosh(slip_rate / 1e-3) ** 2, 0.0 * mu


COEFFICIENTS = [
    pytest.param(0.3, id="constant"),
    pytest.param(StribeckFriction(0.4, 0.2, stribeck_rate=1e-3, exponent=2.0, viscous=5.0), id="stribeck"),
    pytest.param(ForceDependentFriction(0.3, reference_force=0.2), id="hertz"),
    pytest.param(ForceDependentFriction(0.3, 0.2, exponent=0.5, smallest_force=1e-2), id="rising"),
    pytest.param(AngleDependentFriction(0.2, 1.5), id="angle"),
    pytest.param(ForceAndRate(), id="force-and-rate"),
]


def with_coefficient(coefficient, model=None, **rest) -> TendonLaw:
    """Two tendons whose coefficients follow this with_coefficient, or are this number."""
    of_law = {"mu": 0.0, "coefficients": (coefficient,) * 2}
    given = {"mu": coefficient} if isinstance(coefficient, float) else of_law
    return tendon_law(model or FRICTION_MODELS["per-hole"], **given, **rest)


def fan(coefficient, holes: int, total: float, base: float, pulled: float) -> np.ndarray:
    """Tensions of one tendon that turns by ``total`` [rad] in equal holes and is pulled in by ``pulled`` [m] in 1 s."""
    n = holes + 1
    lengths, mask = np.full((1, n), 1e-3), np.ones((1, n), dtype=bool)
    zeros = [np.zeros((1, holes))] * 2 + [np.zeros(1)] * 3
    parameters = TendonParameters(lengths, mask, *zeros, mask[:, 1:], (coefficient,))
    x = TendonLaw(parameters, FRICTION_MODELS["per-hole"])
    moved = lengths.copy()
    moved[0, -1] -= pulled
    shape = CableShape(moved, np.full((1, holes), total / holes))
    return x.evaluate(np.array([base]), shape, x.initial_state(), time=1.0).tension[0]


# ---------------------------------------------------------------- closed forms


@pytest.mark.parametrize("way", [1.0, -1.0], ids=["pulled", "released"])
@pytest.mark.parametrize("exponent", [-1.0 / 3.0, 0.5])
def test_force_dependent_coefficient_follows_the_wrapped_tendon_with_order_two(way, exponent):
    """A tendon wrapped by phi in many equal holes of angle theta: ``dT/dphi = -+mu (T/f)^p T``, f = N_ref / theta.

    Closed form: ``T^-p = T_0^-p +- p mu f^-p phi``. With the mean of both tensions in the normal force the
    error falls as the square of the angle of a hole.
    """
    f, total, base = 1.5, 2.0, 2.0
    exact = (base**-exponent + way * exponent * 0.3 * f**-exponent * total) ** (-1.0 / exponent)
    errors = []
    for holes in (8, 16, 32, 64):
        coefficient = ForceDependentFriction(0.3, f * total / holes, exponent, smallest_force=1e-9)
        errors.append(abs(fan(coefficient, holes, total, base, way * 1e-3)[-1] - exact) / exact)
    assert errors[-1] < 1e-4
    assert -2.1 < np.polyfit(np.log([8, 16, 32, 64]), np.log(errors), 1)[0] < -1.9


# ---------------------------------------------------------------- consistency and derivatives


@pytest.mark.parametrize("coefficients", COEFFICIENTS[1:])
@pytest.mark.parametrize("compliance", [0.0, 1.0 / 400.0], ids=["inextensible", "elastic"])
@pytest.mark.parametrize("adhesion", [0.0, 0.02])
def test_the_coefficient_is_that_of_the_normal_force_and_rate_reached(coefficients, compliance, adhesion):
    """Recovered from the tensions where a hole slips towards the base: ``mu = log(T_k / (T_k+1 + a)) / theta``."""
    x = with_coefficient(coefficients, compliance=compliance, adhesion=adhesion)
    rest = x.evaluate(BASE, CableShape(LENGTHS, ANGLES), x.initial_state())
    state = FrictionState(rest.slip, np.zeros_like(rest.slip), time=1.0)
    field = x.evaluate(BASE, CableShape(LENGTHS - 1e-3 * MASK, ANGLES), state, time=2.0)
    assert np.all(field.mobilisation[HOLES] == 1.0)
    t = field.tension
    with np.errstate(divide="ignore", invalid="ignore"):
        used = np.log(t[:, :-1] / (t[:, 1:] + adhesion)) / ANGLES
    rate = (field.slip - state.slip) / 1.0
    assert field.slip_rate == pytest.approx(rate, abs=1e-15)
    # With adhesion the mean tension still is that of both segments.
    expected = coefficients.coefficient(normal_forces(t, ANGLES)[HOLES], rate[HOLES], ANGLES[HOLES])[0]
    assert used[HOLES] == pytest.approx(expected, abs=1e-10)


def central(function, x, h):
    """Central differences of an array function of an array, (output..., input...)."""
    columns = []
    for index in np.ndindex(x.shape):
        shift = np.zeros_like(x)
        shift[index] = h
        columns.append((function(x + shift) - function(x - shift)) / (2 * h))
    return np.stack(columns, axis=-1).reshape(*columns[0].shape, *x.shape)


ELASTIC = {"compliance": 1.0 / 400.0, "adhesion": 0.05}
WAYS = {"held": ("mobilisation", 20), "sticking": ("configuration", 0.2), "sliding": ("configuration", 20)}
TENDONS = {"inextensible": {}, "elastic, adhesion": ELASTIC, "Dahl": {**ELASTIC, "hysteresis": Dahl}}


def own(d):
    """The diagonal blocks of (m, n, m, k), by tendon; the coupling between tendons must vanish."""
    assert np.max(np.abs(d[0, :, 1])) < 1e-6 and np.max(np.abs(d[1, :, 0])) < 1e-6
    return np.stack([d[i, :, i] for i in range(2)])


@pytest.mark.parametrize("coefficients", COEFFICIENTS)
@pytest.mark.parametrize("model", ["per-tendon", "per-hole"])
@pytest.mark.parametrize("tendon", TENDONS.values(), ids=TENDONS)
@pytest.mark.parametrize(("given", "scale"), WAYS.values(), ids=WAYS)
def test_derivatives_against_central_differences(coefficients, model, tendon, given, scale):
    """By lengths, angles, base tension, and mobilisations where these are kept; in a step of 0.3 s."""
    x = with_coefficient(coefficients, FRICTION_MODELS[model], presliding=1e-4, **tendon)
    rng = np.random.default_rng(5)
    state = FrictionState(np.zeros((2, x.groups)), 0.1 * np.ones((2, x.groups)) * x.frictional, time=1.0)
    state = replace(state, slip=x.evaluate(BASE, CableShape(LENGTHS, ANGLES), state).slip)
    lengths = LENGTHS - scale * 1e-5 * rng.uniform(0.2, 1.0, size=LENGTHS.shape) * MASK
    s = rng.uniform(0.2, 0.9, size=(2, x.groups)) * x.frictional

    def field(base=BASE, lengths=lengths, angles=ANGLES, s=s):
        if given == "mobilisation":
            return x.field(base, CableShape(lengths * MASK, angles), s, state, 1.3)
        return x.evaluate(base, CableShape(lengths * MASK, angles), state, time=1.3)

    f, m = field(), MASK[:, :, None]
    if given == "configuration" and "hysteresis" not in tendon:
        assert np.any(np.abs(f.mobilisation) >= 1.0) == (scale > 1.0)
    size = np.max(np.abs(f.d_length)) + 1.0
    by_length = own(central(lambda v: field(lengths=v).tension * MASK, lengths, 1e-9))
    assert by_length * m == pytest.approx(f.d_length * m * MASK[:, None, :], abs=2e-6 * size)
    by_angle = own(central(lambda v: field(angles=v).tension * MASK, ANGLES, 1e-6))
    assert by_angle == pytest.approx(f.d_angle * m, abs=1e-6)
    by_base = own(central(lambda v: field(base=v).tension * MASK, BASE, 1e-6)[..., None])[..., 0]
    assert by_base == pytest.approx(f.d_base * MASK, abs=1e-6)
    if given == "mobilisation":
        by_s = own(central(lambda v: field(s=v).tension * MASK, s, 1e-6))
        assert by_s == pytest.approx(f.by_mobilisation * m, abs=1e-7)
        assert f.depends_on_length == (np.max(np.abs(f.d_length)) > 0.0)


# ---------------------------------------------------------------- cables


def test_clearance_shifts_the_tendon_towards_where_it_is_pulled():
    """At a bend the tendon lies at the inner edge of an oversized hole; at base plate and anchor it is not shifted."""
    count, radius, gap = 3, 0.05, 0.2e-3
    angle = 0.4 * np.arange(count + 1)
    p = radius * np.stack((np.sin(angle), 1 - np.cos(angle), 0 * angle), axis=1)
    r = Rotation.from_rotvec(angle[:, None] * [0.0, 0.0, 1.0]).as_matrix()
    offsets = np.zeros((1, count + 1, 3))
    offsets[..., 2] = 1e-3
    mask = np.ones((1, count), bool)
    cable = CableGeometry(offsets, mask, np.array([gap]))
    shift = cable.shifted(p, r) - offsets
    assert np.all(np.abs(shift[0, 1:-1, 1] - gap) < 0.01 * gap)
    assert np.all(shift[0, -1] == 0.0) and np.all(shift[..., 0] == 0.0)
    assert cable.evaluate(p, r).lengths.sum() < CableGeometry(offsets, mask).evaluate(p, r).lengths.sum()

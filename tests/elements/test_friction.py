"""The friction law along one tendon and several: Capstan's closed form, bounds, and derivatives."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from two_tendons import ANGLES, LENGTHS, MASK, tendon_law

from tdcr_fe.elements.friction import FRICTION_MODELS, TendonLaw


def law(kind, mu=0.3, **rest) -> TendonLaw:
    """Two tendons with friction at every hole."""
    return tendon_law(kind, mu, **rest)


LAWS = [FRICTION_MODELS["per-tendon"], FRICTION_MODELS["per-hole"]]


# ---------------------------------------------------------------- Capstan


@pytest.mark.parametrize("kind", LAWS, ids=lambda k: k.kind)
@pytest.mark.parametrize("way", [1, -1])
def test_sliding_tendon_obeys_the_capstan_equation(kind, way):
    """T_k+1 / T_k = exp(-+ mu theta_k), paper Eqs. 28-30; the whole tendon in or out by a millimetre."""
    x = law(kind)
    lengths = LENGTHS - way * 1e-3 * MASK
    field = x.evaluate(np.array([2.0, 1.0]), lengths, ANGLES, x.initial_state())
    expected = 2.0 * np.exp(-way * 0.3 * np.concatenate(([0.0], np.cumsum(ANGLES[0]))))
    assert field.tension[0] == pytest.approx(expected, rel=1e-14)
    assert field.tension[1, :2] == pytest.approx([1.0, np.exp(-way * 0.3 * 0.15)], rel=1e-14)
    assert field.base_slip == pytest.approx(way * np.array([4e-3, 2e-3]), rel=1e-12)


def test_without_friction_the_tension_is_the_same_all_along():
    field = law(FRICTION_MODELS["none"]).evaluate(
        np.array([2.0, 1.0]), 0.9 * LENGTHS, ANGLES, law(FRICTION_MODELS["none"]).initial_state()
    )
    assert np.array_equal(field.tension, np.array([[2.0] * 4, [1.0] * 4]))
    assert not law(FRICTION_MODELS["none"]).has_friction


def test_adhesion_drops_the_tension_by_the_same_at_every_hole():
    x = law(FRICTION_MODELS["per-hole"], mu=0.0, adhesion=0.1)
    pulled = x.evaluate(np.array([2.0, 1.0]), LENGTHS - 1e-3 * MASK, ANGLES, x.initial_state())
    assert pulled.tension[0] == pytest.approx([2.0, 1.9, 1.8, 1.7], abs=1e-14)
    released = x.evaluate(np.array([2.0, 1.0]), LENGTHS + 1e-3 * MASK, ANGLES, x.initial_state())
    assert released.tension[0] == pytest.approx([2.0, 2.1, 2.2, 2.3], abs=1e-14)


def test_a_reversal_has_to_slide_twice_the_presliding_distance():
    """From full pull to full release; at half of the slip the friction is zero."""
    x = law(FRICTION_MODELS["per-hole"], presliding=1e-6)
    tension = np.array([2.0, 1.0])
    state = x.commit(x.evaluate(tension, LENGTHS - 1e-3 * MASK, ANGLES, x.initial_state()))
    back = np.zeros((2, 4))
    back[0, 3] = 1e-6
    half = x.evaluate(tension, LENGTHS - 1e-3 * MASK + back, ANGLES, state)
    assert half.mobilisation[0] == pytest.approx([0.0] * 3, abs=1e-7)
    assert half.tension[0] == pytest.approx([2.0] * 4, abs=1e-7)
    whole = x.evaluate(tension, LENGTHS - 1e-3 * MASK + 2.1 * back, ANGLES, state)
    assert np.array_equal(whole.mobilisation[0], [-1.0] * 3)


#: Of a work: tensions up to 5 N and slips up to 15 um, each known to 16 digits [J].
ROUND_OFF = 1e-16


@pytest.mark.parametrize("compliance", [0.0, 1.0 / 400.0])
@settings(deadline=None, max_examples=150)
@given(
    base=st.just(0.0) | st.floats(1e-3, 5.0),
    changes=st.lists(st.lists(st.floats(-3e-6, 3e-6), min_size=4, max_size=4), min_size=1, max_size=5),
)
def test_bounds_hold_and_no_hole_creates_energy_whatever_is_done(compliance, base, changes):
    """Ratio within exp(+- mu theta); dissipation (T_k - T_k+1) du_k summed over presliding cycles.

    At a hole that slides, the tension drops in the direction in which the tendon moves.
    """
    x = law(FRICTION_MODELS["per-hole"], compliance=compliance)
    state = x.initial_state()
    for change in changes:
        lengths = LENGTHS + np.array(change) * MASK
        field = x.evaluate(np.array([base, base]), lengths, ANGLES, state)
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


# ---------------------------------------------------------------- derivatives


def test_elastic_tendon_releases_its_stretch():
    """Slip at the base of a straight tendon under T, from its EA: L (1 - 1/(1 + T/EA))."""
    x = law(FRICTION_MODELS["per-hole"], mu=0.0, compliance=1.0 / 400.0)
    field = x.evaluate(np.array([4.0, 2.0]), LENGTHS, 0.0 * ANGLES, x.initial_state())
    assert field.base_slip == pytest.approx(
        LENGTHS.sum(axis=1) * np.array([0.01 / 1.01, 0.005 / 1.005]), rel=1e-12
    )

"""Friction laws in the reference: those it implements, by itself, and those it refuses by name."""

import numpy as np
import pytest

from tdcr_fe.model.backbone import Backbone
from tdcr_fe.model.friction import ConstantFriction, ForceDependentFriction, StribeckFriction
from tdcr_fe.model.loading import LoadStep, Model
from tdcr_fe.model.robot import Disks, Robot
from tdcr_fe.model.routing import ParallelRouting
from tdcr_fe.model.tendon import Tendon
from tdcr_fe.validation.reference import solve_reference

LENGTH = 0.25
STEPS = [LoadStep(tensions={"t": x}, substeps=4) for x in (1.0, 2.0, 1.2)]
MODEL = Model("straight", "per-hole", elements_per_bay=4)


def robot(**tendon):
    return Robot(
        Backbone(LENGTH, 0.4e-3, 85e9, 0.3),
        Disks.equally_spaced(10, LENGTH),
        (Tendon("t", ParallelRouting(4.5e-3, 20.0), **tendon),),
    )


def test_a_constant_law_is_the_friction_coefficient():
    one = solve_reference(robot(friction=ConstantFriction(0.3)), MODEL, STEPS)
    other = solve_reference(robot(friction_coefficient=0.3), MODEL, STEPS)
    np.testing.assert_array_equal(one.tips, other.tips)


def test_exponent_zero_is_a_constant_coefficient():
    law = ForceDependentFriction(0.3, 0.1, exponent=0.0)
    one = solve_reference(robot(friction=law), MODEL, STEPS)
    other = solve_reference(robot(friction_coefficient=0.3), MODEL, STEPS)
    np.testing.assert_allclose(one.tips, other.tips, atol=1e-12)


def test_slipping_holes_obey_the_law_at_their_own_normal_force():
    """``ln(T_before / T_after) = mu(N) theta`` with N from the solved tensions and angles."""
    law = ForceDependentFriction(0.3, 0.1, exponent=-1.0 / 3.0)
    model = robot(friction=law)
    step = solve_reference(model, MODEL, STEPS).steps[1]
    holes = np.concatenate((model.holes(model.tendons[0]), np.zeros((11, 1))), axis=1)
    edges = np.diff(step.positions + np.einsum("nij,nj->ni", step.rotations, holes), axis=0)
    edges /= np.linalg.norm(edges, axis=1)[:, None]
    angle = np.arccos(np.sum(edges[:-1] * edges[1:], axis=1))
    tension = step.tensions[0]
    normal = (tension[:-1] + tension[1:]) * np.sin(0.5 * angle)
    mu = 0.3 * ((normal**2 + law.smallest_force**2) / 0.01) ** (-1.0 / 6.0)
    assert set(step.hole_states[0]) == {"pull", "anchor"}
    np.testing.assert_allclose(np.log(tension[:-1] / tension[1:]), mu * angle, rtol=1e-7)


def test_a_rate_dependent_law_is_refused_by_name():
    model = robot(friction=StribeckFriction(0.4, 0.2, 1e-3))
    with pytest.raises(ValueError, match=r"friction law 'stribeck' of tendon 't'"):
        solve_reference(model, MODEL, STEPS)
    assert solve_reference(model, Model("straight", "none"), STEPS).converged

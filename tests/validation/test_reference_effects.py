"""Clearance of holes, creep, springs and stuck holes in the reference: closed forms, and finite elements."""

from dataclasses import replace

import numpy as np
import pytest

from tdcr_fe.model.backbone import Backbone, Superelastic
from tdcr_fe.model.friction import ForceDependentFriction
from tdcr_fe.model.loading import Load, LoadStep, Model
from tdcr_fe.model.robot import Disks, Robot
from tdcr_fe.model.routing import (
    ConvergingRouting,
    HelicalRouting,
    ParallelRouting,
    PointsRouting,
    VaryingHelicalRouting,
)
from tdcr_fe.model.tendon import Tendon
from tdcr_fe.solve.simulate import simulate
from tdcr_fe.validation.reference import solve_reference

L = 0.25
BACKBONE = Backbone(L, 0.4e-3, 85e9, 0.3, density=5600.0)


def robot(*routings, disks=10, **tendon):
    routings = routings or (ParallelRouting(4.5e-3),)
    friction = tendon if "friction" in tendon else {"friction_coefficient": 0.2, **tendon}
    return Robot(
        BACKBONE,
        Disks.equally_spaced(disks, L, mass=0.17e-3),
        tuple(Tendon(f"t{i + 1}", r, **friction) for i, r in enumerate(routings)),
    )


def solve(robot, steps, friction="none"):
    result = solve_reference(robot, Model(friction=friction), steps)
    assert result.converged, result.message
    assert max(s.residual for s in result.steps) <= 1e-10
    return result


def pulls(*values, name="t1", **rest):
    return [LoadStep(tensions={name: v}, **rest) for v in values]


# ---------------------------------------------------------------------------------------------- clearance


def test_clearance_adds_to_the_offset_of_a_bent_planar_robot():
    """The tendon lies at the inner side of every hole but the anchor's, so the offset there is larger."""
    clearance, offset = 2e-4, 4.5e-3
    loose = solve(robot(clearance=clearance), pulls(2.0)).steps[0]
    s = np.linspace(0.0, L, 11)
    # A turn of the tendon by b shifts it by c b / sqrt(b^2 + 0.01^2); b is that of equal bays here.
    turn = 2.0 * np.sin(0.5 * loose.bending_angle / 10.0)
    share = turn / np.hypot(turn, 0.01)
    assert share > 0.98
    holes = [(offset + clearance * share, 0.0)] * 10 + [(offset, 0.0)]
    # The base plate's neighbour below is straight, so it turns half as much.
    half = 2.0 * np.sin(0.25 * loose.bending_angle / 10.0)
    holes[0] = (offset + clearance * half / np.hypot(half, 0.01), 0.0)
    exact = solve(robot(PointsRouting(tuple(s), tuple(holes))), pulls(2.0)).steps[0]
    tight = solve(robot(), pulls(2.0)).steps[0]
    assert np.linalg.norm(loose.tip - tight.tip) > 2e-3
    np.testing.assert_allclose(loose.tip, exact.tip, atol=2e-5)
    assert loose.bending_angle == pytest.approx(exact.bending_angle, rel=2e-4)


def test_clearance_needs_straight_segments():
    with pytest.raises(ValueError, match="clearance"):
        solve_reference(robot(clearance=1e-4), Model("continuous", "none"), pulls(1.0))


# ---------------------------------------------------------------------------------------------- creep


def softened(factor):
    b = BACKBONE
    return replace(b, bending_stiffness=b.EI / factor, torsional_stiffness=b.GJ / factor)


def test_creep_is_a_softer_backbone_at_every_time():
    subject = robot(HelicalRouting(4.5e-3, 0.5))
    steps = [LoadStep(tensions={"t1": 1.2}, time=t) for t in (10.0, 200.0, 500.0)]
    creeping = solve(subject.with_backbone(creep_rate=4e-4), steps)
    for step, result in zip(steps, creeping.steps, strict=True):
        soft = softened(1.0 + 4e-4 * step.time)
        exact = solve(replace(subject, backbone=soft), pulls(1.2)).steps[0]
        np.testing.assert_allclose(result.positions, exact.positions, atol=1e-10)


# ---------------------------------------------------------------------------------------------- springs and stuck holes


# ---------------------------------------------------------------------------------------------- finite elements

TWO = (ParallelRouting(4.5e-3), ParallelRouting(4.5e-3, 120.0))
TURNING = (VaryingHelicalRouting(4.5e-3, 0.2, 1.5, 30.0), HelicalRouting(4.5e-3, 0.5, 120.0))


@pytest.mark.integration
@pytest.mark.parametrize(
    ("subject", "elements"),
    [
        (robot(*TWO, clearance=2.5e-4), 4),
        (robot(ConvergingRouting(5e-3, 2e-3), HelicalRouting(4.5e-3, 0.5, 120.0), clearance=2.5e-4), 4),
        (robot(*TWO).with_backbone(creep_rate=5e-4), 4),
        (robot(*TWO).with_backbone(creep_rate=5e-4, superelastic=Superelastic(2e-3, 0.6)), 8),
        (robot(*TURNING), 4),
        (robot(*TWO, friction=ForceDependentFriction(0.3, 0.1)), 4),
    ],
    ids=[
        "clearance",
        "clearance, converging",
        "creep",
        "creep, softening",
        "varying pitch",
        "force-dependent",
    ],
)
def test_finite_elements_agree(subject, elements):
    """What the cases of `tdcr-fe validate` leave out; the softening section needs finer elements."""
    side = {"tip": Load(L, (0.0, 0.03, 0.0))}
    pulled = ({"t1": 0.8}, {"t1": 1.6}, {}, {"t1": 1.0, "t2": 0.4}, {"t1": 0.3})
    steps = [
        LoadStep(tensions=t, loads=side if k == 3 else {}, substeps=4, time=120.0 * k)
        for k, t in enumerate(pulled, start=1)
    ]
    ours = solve(subject, steps, friction="per-hole")
    theirs = simulate(subject, Model(friction="per-hole", elements_per_bay=elements), steps)
    assert theirs.converged
    assert np.max(np.linalg.norm(ours.tips - theirs.tips, axis=1)) < 3e-4 * L

"""Clearance of holes, creep, springs and stuck holes in the reference: closed forms, and finite elements."""

from dataclasses import replace

import numpy as np
import pytest

from tdcr_fe.model.backbone import Backbone, Superelastic
from tdcr_fe.model.friction import ForceDependentFriction
from tdcr_fe.model.loading import Load, LoadStep, Model
from tdcr_fe.model.robot import Disks, Robot, SideSpring
from tdcr_fe.model.routing import (
    ConvergingRouting,
    HelicalRouting,
    ParallelRouting,
    PointsRouting,
    VaryingHelicalRouting,
)
from tdcr_fe.model.tendon import Tendon, TightHole
from tdcr_fe.solve.simulate import simulate
from tdcr_fe.validation.reference import ReferenceSettings, solve_reference

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


def test_clearance_has_no_effect_on_a_straight_robot():
    still = solve(robot(clearance=3e-4), pulls(0.0)).steps[0]
    np.testing.assert_allclose(still.tip, (0.0, 0.0, L), atol=1e-12)
    assert still.displacements[0] == pytest.approx(0.0, abs=1e-15)


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


def test_creep_under_a_tip_moment_is_an_arc_of_growing_curvature():
    bare = Robot(replace(BACKBONE, creep_rate=1e-3), Disks.equally_spaced(5, L))
    moment, samples = 2e-3, ReferenceSettings(sample_at=(0.02, 0.11))
    steps = [LoadStep(loads={"tip": Load(L, moment=(0.0, moment, 0.0))}, time=t) for t in (0.0, 300.0)]
    result = solve_reference(bare, Model(friction="none"), steps, settings=samples)
    for step, factor in zip(result.steps, (1.0, 1.3), strict=True):
        assert step.bending_angle == pytest.approx(moment * L * factor / BACKBONE.EI, rel=1e-9)
        k = moment * factor / BACKBONE.EI
        np.testing.assert_allclose(step.positions[:, 0], (1.0 - np.cos(k * step.s)) / k, atol=1e-10)


# ---------------------------------------------------------------------------------------------- springs and stuck holes


def test_a_soft_spring_at_the_tip_of_a_cantilever():
    """Force F against EI and spring k: deflection F / (3 EI / L^3 + k), as long as it is small."""
    k, force = 0.3, 1e-5
    bare = Robot(BACKBONE, Disks.equally_spaced(5, L), springs=(SideSpring(L, k),))
    step = solve(bare, [LoadStep(loads={"tip": Load(L, (force, 0.0, 0.0))})]).steps[0]
    assert step.tip[0] == pytest.approx(force / (3.0 * BACKBONE.EI / L**3 + k), rel=1e-4)


def test_a_spring_pulls_as_an_equal_load_would():
    at, k = 0.125, 3.0
    subject = robot(ParallelRouting(4.5e-3, 30.0))
    held = solve(replace(subject, springs=(SideSpring(at, k),)), pulls(1.5)).steps[0]
    x, y, _ = held.position_at(at)
    load = Load(at, (-k * x, -k * y, 0.0))
    loaded = solve(subject, [LoadStep(tensions={"t1": 1.5}, loads={"spring": load})]).steps[0]
    np.testing.assert_allclose(held.tip, loaded.tip, atol=1e-9)
    assert np.hypot(x, y) > 5e-3


def test_a_stuck_hole_keeps_its_tension_beyond_while_the_base_changes():
    """Nothing passes hole 4, so the tendon beyond it keeps its length: the outer part acts as a strut."""
    smooth = robot(friction_coefficient=0.0)
    stuck = smooth.with_tendons(tight_holes=(TightHole(0.1, 20.0),))
    result = solve(stuck, pulls(0.5, 1.0), friction="per-hole")
    last = result.steps[-1]
    assert last.hole_states[0][3] == "stick"
    assert last.tensions[0][2] == pytest.approx(1.0)
    assert last.tensions[0][4] < 0.05
    free = solve(smooth, pulls(0.5, 1.0), friction="per-hole").steps[-1]
    assert free.bending_angle > 2.0 * last.bending_angle
    with pytest.raises(ValueError, match="per-hole"):
        solve_reference(stuck, Model(friction="none"), pulls(1.0))


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

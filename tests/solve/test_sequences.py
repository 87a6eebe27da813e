"""Loading sequences with history: reversals, bounds, paths, driven tendons, pretension."""

import numpy as np
import pytest
from robots import LENGTH, cables, degrees, distance, paper, pull, routed, seven, solve

from tdcr_fe import ParallelRouting
from tdcr_fe.model.loading import LoadStep, resolve


@pytest.mark.parametrize("friction", ["per-tendon", "per-hole"])
def test_ratio_is_at_a_bound_where_a_hole_slips_and_inside_where_it_sticks(friction):
    robot = paper(0.3)
    bounds = {"pull": 1.0, "release": -1.0}
    for step in solve(robot, pull(1.0, 2.0, 1.9, 1.5, 0.5, 0.7, 1.8), friction=friction).steps:
        (_, angle), t = cables(robot, step)[0], step.tensions[0]
        share = np.log(t[:-1] / t[1:]) / (0.3 * angle)
        for state, x in zip(step.hole_states[0], share, strict=False):
            if state in bounds:
                assert x == pytest.approx(bounds[state], abs=1e-8)
            else:
                assert -1.0 < x < 1.0


def test_a_closed_loop_of_tension_repeats():
    """After the first cycle the tip passes through the same positions again."""
    angle = degrees(solve(paper(0.3), pull(2.0, *([0.5, 2.0] * 3))))
    assert angle[1::2] == pytest.approx(angle[1], abs=2e-3)
    assert angle[0::2] == pytest.approx(angle[0], abs=2e-3)


# ---------------------------------------------------------------- driven by displacement


@pytest.mark.parametrize("friction", ["none", "per-tendon", "per-hole"])
def test_displacement_driven_is_the_inverse_of_tension_driven(friction):
    """Displacements found under given tensions, when prescribed, need these tensions; through a reversal too."""
    by_tension = solve(paper(0.3), pull(0.5, 1.5, 2.5, 2.0), friction=friction)
    steps = [LoadStep("", displacements={"t1": float(s.displacements[0])}) for s in by_tension.steps]
    by_displacement = solve(paper(0.3), steps, friction=friction)
    for a, b in zip(by_tension.steps, by_displacement.steps, strict=True):
        assert b.base_tensions == pytest.approx(a.base_tensions, abs=2e-4)
        assert distance(a.positions, b.positions) < 1e-4


def test_elastic_tendon_needs_more_displacement_by_its_stretch():
    """No friction: displacement = shortening + T L_now / (EA + T)."""
    robot = paper(0.0, axial_stiffness=400.0)
    stiff, soft = solve(paper(0.0), pull(2.0)).steps[0], solve(robot, pull(2.0)).steps[0]
    assert distance(stiff.tip, soft.tip) < 1e-9
    length = cables(robot, soft)[0][0].sum()
    assert soft.displacements[0] - stiff.displacements[0] == pytest.approx(length * 2.0 / 402.0, rel=1e-9)


@pytest.mark.parametrize("stiffness", [None, 400.0], ids=["inextensible", "elastic"])
def test_slack_tendon_has_no_tension_until_it_is_taut_again(stiffness):
    """Let out beyond taut, a tendon has tension zero; pulled in again, it acts as before."""
    both = (ParallelRouting(4.5e-3, angle) for angle in (0.0, 180.0))
    robot = routed(*both, mu=0.3, axial_stiffness=stiffness)
    moved = {"t1": 3e-3, "t2": -6e-3}, {"t1": -4e-3, "t2": -6e-3}, {"t1": 3e-3}
    result = solve(robot, [LoadStep("", displacements=x) for x in moved])
    assert np.all(np.concatenate([t for s in result.steps for t in s.tensions]) >= 0.0)
    assert result.steps[0].base_tensions[0] > 0.1 and result.steps[0].base_tensions[1] == 0.0
    assert np.array_equal(result.steps[1].base_tensions, [0.0, 0.0])
    assert distance(result.tips[1], np.array([0.0, 0.0, LENGTH])) < 1e-6
    assert distance(result.tips[2], result.tips[0]) < 1e-6


def test_both_ways_of_driving_mixed_and_switched():
    """One tendon by tension and one by displacement, then exchanged; inputs that are not named are kept."""
    steps = [LoadStep("", {"t1": 1.0}, {"t2": 0.0}), LoadStep("", {"t3": 0.5}, {"t1": 4e-3})]
    steps += [LoadStep("", {"t1": 0.5, "t2": 0.3}), LoadStep("", {"t1": 0.0, "t2": 0.0, "t3": 0.0})]
    a, b, c, d = solve(seven(0.3), steps).steps
    assert a.base_tensions[0] == 1.0
    assert a.displacements[1] == pytest.approx(0.0, abs=1e-8) or a.base_tensions[1] == 0.0
    assert b.displacements[0] == pytest.approx(4e-3, abs=1e-8)
    assert c.base_tensions == pytest.approx([0.5, 0.3, 0.5], abs=1e-15)
    assert distance(d.tip, np.array([0.0, 0.0, LENGTH])) < 1e-5


# ------------------------------------------------------------ pretension


EA, T0 = 400.0, 0.7


#: Three elastic tendons around a straight backbone.
TIGHTENED = seven(0.0).with_tendons(axial_stiffness=EA, pretension=T0)


def test_a_tendon_let_out_is_slack_only_beyond_its_stretch():
    """One tendon on a backbone too stiff to bend: T = T0 + EA d / (L - d), and zero beyond."""
    stiff = routed(disks=4, axial_stiffness=EA, pretension=T0).with_backbone(radius=4e-3)
    stretch = LENGTH * (1.0 - 1.0 / (1.0 + T0 / EA))
    values = np.array([0.5, 0.0, -0.5, -0.9, -1.1, -3.0, 0.2]) * stretch
    found = solve(stiff, [LoadStep(displacements={"t1": float(d)}) for d in values], friction="none")
    expected = np.maximum(EA * (LENGTH / (LENGTH - stretch - values) - 1.0), 0.0)
    np.testing.assert_allclose([s.base_tensions[0] for s in found.steps], expected, atol=1e-3 * T0)


def test_tendons_that_no_step_names_are_held_at_displacement_zero():
    targets = resolve(TIGHTENED, [LoadStep(displacements={"t1": 1e-3})])
    assert targets[0].by_displacement.all()
    assert targets[0].values.tolist() == [1e-3, 0.0, 0.0]
    assert not resolve(seven(), [LoadStep()])[0].by_displacement.any()

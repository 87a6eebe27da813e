"""Robots without disks, tapered backbones, fibres that harden or soften: closed forms, the reference, mistakes."""

from dataclasses import replace

import numpy as np
import pytest
from robots import BACKBONE, DISKS, LENGTH, routed, seven, single, three

from tdcr_fe import Disks, Load, LoadStep, Model, Robot, Tendon, simulate
from tdcr_fe.effects import Experiment, with_effects
from tdcr_fe.model.backbone import Backbone, NonlinearMaterial, StiffnessPatch, Superelastic
from tdcr_fe.model.friction import AngleDependentFriction, ForceDependentFriction
from tdcr_fe.model.observed_step import Observation, ObservedStep
from tdcr_fe.model.routing import ConvergingRouting, HelicalRouting, ParallelRouting, VaryingHelicalRouting
from tdcr_fe.validation.reference import solve_reference

L = 0.3
SOFT = Backbone(L, 12e-3, 0.4e6, 0.45, density=1100.0)
CONE = replace(SOFT, taper=((0.0, 12e-3), (0.25, 6e-3), (L, 5e-3)))
FOLLOWS = Model("continuous", "none")


def converging(name, angle, end=0.25):
    return Tendon(name, ConvergingRouting(9e-3, 3e-3, angle), end=end)


TENTACLE = Robot(CONE, tendons=(converging("a", -60.0), converging("b", 60.0, 0.18)))
WINDING = Robot(SOFT, tendons=(Tendon("a", HelicalRouting(8e-3, 0.7, 20.0)),))
STEPS = [LoadStep(tensions={"a": 1.0}), LoadStep(tensions={"a": 3.0, "b": 1.5})]


@pytest.mark.parametrize("count", [1, 2])
def test_the_curvature_within_a_bay_is_the_moment_of_its_straight_tendon(count):
    """The lever of the tendon is longest in the middle of the bay. The mean over an element is up to 12 % off."""
    tension, bay = 1.5, LENGTH / 7
    model = Model(friction="none", elements_per_bay=count)
    (step,) = simulate(single(), model, [LoadStep(tensions={"t1": tension})]).steps
    seen = ObservedStep.of(step, ("t1",), Observation())
    nodes = [int(np.argmin(np.abs(step.s - k * bay))) for k in (3, 4)]
    base, end = (step.positions[k] + step.rotations[k] @ [4.5e-3, 0.0, 0.0] for k in nodes)
    s = bay * np.array([3.05, 3.25, 3.5, 3.8])
    along = (end - base) / np.linalg.norm(end - base)
    levers = np.linalg.norm(np.cross(seen.markers(s) - base, along), axis=1)
    np.testing.assert_allclose(seen.curvature(s)[:, 1], tension * levers / BACKBONE.EI, rtol=4e-3 / count**2)


@pytest.mark.parametrize("count", [1, 4])
def test_a_moment_bends_a_tapered_rod_by_its_compliance_at_every_place(count):
    """``k = M / EI(s)``; elements have their mean compliance, so that the estimated error is that of the positions."""
    rod, moment = replace(BACKBONE, taper=((0.0, BACKBONE.radius), (LENGTH, 0.25e-3))), 2e-3
    robot, model = Robot(rod, Disks.equally_spaced(4, LENGTH)), Model(friction="none", elements_per_bay=count)
    (step,) = simulate(robot, model, [LoadStep(loads={"tip": Load(LENGTH, moment=(0.0, moment, 0.0))})]).steps
    s = np.linspace(0.01, 0.99, 50) * LENGTH
    curvature = ObservedStep.of(step, (), Observation()).curvature(s)[:, 1]
    exact = moment / (rod.EI * (rod.radius_at(s) / rod.radius) ** 4)
    np.testing.assert_allclose(curvature, exact, rtol=2e-2 / count**2)
    fine = (np.arange(20000) + 0.5) * LENGTH / 20000
    angle = np.cumsum(moment / (rod.EI * (rod.radius_at(fine) / rod.radius) ** 4)) * LENGTH / 20000
    tip = np.array([np.sin(angle).mean(), 0.0, np.cos(angle).mean()]) * LENGTH
    assert step.discretisation_error == pytest.approx(np.linalg.norm(step.tip - tip), rel=0.05)


def test_a_parallel_tendon_bends_the_bare_rod_to_a_circular_arc():
    """Without weight: strain and curvature are constant, ``EI k = T a (1 + e - a k)/|...|``: pure bending about y.

    The tendon at ``x = a`` has the stretch ``1 + e - a k`` along the tangent, so its pull is along the tangent and
    ``EA e = -T``, ``EI k = T a``.
    """
    a, tension = 5e-3, 2.0
    rod = Robot(SOFT, tendons=(Tendon("t", ParallelRouting(a)),))
    result = simulate(rod, FOLLOWS, [LoadStep(tensions={"t": tension})]).raise_if_failed()
    curvature, stretch = tension * a / SOFT.EI, 1.0 - tension / SOFT.EA
    radius, angle = stretch / curvature, curvature * L
    expected = [radius * (1.0 - np.cos(angle)), 0.0, radius * np.sin(angle)]
    np.testing.assert_allclose(result.tips[0], expected, atol=1e-9)
    assert result.steps[0].displacements[0] == pytest.approx(L * (1.0 - (stretch - a * curvature)), rel=1e-9)


TWO_MATERIALS = replace(CONE, patches=(StiffnessPatch(0.2, L, modulus=0.4, density=2.0),))


@pytest.mark.parametrize("length", [2e-3, 0.25])
def test_a_base_that_gives_way_turns_by_the_moment_over_its_stiffness(length):
    """The element that stands for it was 5 micrometres long at least, and the rod of 2 mm shorter by as much."""
    backbone = Backbone(length=length, radius=1.6e-3 * length, youngs_modulus=85e9, poisson_ratio=0.3)
    stiffness = 2.0 * backbone.EI / length
    robot = Robot(backbone, Disks.equally_spaced(4, length, radius=0.02 * length), base_stiffness=stiffness)
    step = LoadStep(loads={"tip": Load(at=length, moment=(0.0, stiffness, 0.0))})
    (solved,) = simulate(robot, Model(), [step]).steps
    assert solved.bending_angle == pytest.approx(1.0 + 2.0, rel=2e-5)


@pytest.mark.parametrize("backbone", [SOFT, CONE, TWO_MATERIALS], ids=["even", "cone", "two materials"])
def test_a_hanging_rod_without_tendons_stretches_by_its_weight(backbone):
    """Every section by its own modulus and area, under the weight of what is below it."""
    model = Model(gravity=(0.0, 0.0, 9.81), elements_per_bay=4)
    result = simulate(Robot(backbone), model, [LoadStep()]).raise_if_failed()
    s = np.linspace(0.0, L, 60001)
    modulus, density = backbone.material_factors(s)
    area = np.pi * backbone.radius_at(s) ** 2
    line = area * density * backbone.density
    mass = np.concatenate(([0.0], np.cumsum(0.5 * (line[1:] + line[:-1]) * np.diff(s))))
    strain = 9.81 * (mass[-1] - mass) / (backbone.youngs_modulus * modulus * area)
    expected = float(np.sum(0.5 * (strain[1:] + strain[:-1]) * np.diff(s)))
    assert result.tips[0][2] - L == pytest.approx(expected, rel=3e-4)


def test_bays_are_twentieths_and_every_end_of_a_tendon_has_a_node():
    result = simulate(TENTACLE, replace(FOLLOWS, elements_per_bay=1), STEPS[:1])
    expected = sorted({*np.round(L * np.arange(21) / 20, 9), 0.25, 0.18})
    np.testing.assert_allclose(result.steps[0].s, expected, atol=1e-12)
    assert len(TENTACLE.bay_edges) == 21
    assert [len(t) for t in result.steps[0].tensions] == [1, 1]


# ------------------------------------------------------------ nonlinear material


NEO_HOOKEAN = NonlinearMaterial(-1.0, 4.0 / 3.0)
ROD = Backbone(L, 10e-3, 0.4e6, 0.45, density=1100.0)

LAWS = [NonlinearMaterial(0.0, 30.0), NEO_HOOKEAN, NonlinearMaterial(4.0, 12.0), NonlinearMaterial(0.0, -2.0)]


@pytest.mark.parametrize("law", LAWS)
def test_an_axial_force_stretches_the_rod_along_the_stress_strain_curve(law):
    """``F = EA (e + b e^2 + c e^3)``: the cubic solved by numpy."""
    steps = [LoadStep(loads={"tip": Load(L, (0.0, 0.0, 0.08 * ROD.EA))})]
    result = simulate(Robot(replace(ROD, nonlinear=law)), Model(), steps).raise_if_failed()
    roots = np.roots([law.cubic, law.quadratic, 1.0, -0.08])
    stretch = min(float(r.real) for r in roots if abs(r.imag) < 1e-9 and r.real > 0.0)
    assert result.tips[0][2] == pytest.approx(L * (1.0 + stretch), rel=1e-9)


# ------------------------------------------------------------ the reference


COURSES = [Tendon("a", ConvergingRouting(8e-3, 3e-3, -60.0), end=0.25)]
COURSES += [Tendon("b", ConvergingRouting(8e-3, 3e-3, 60.0))]
FIBRES = Robot(replace(ROD, taper=((0.0, 10e-3), (L, 5e-3))), tendons=tuple(COURSES))
NARROWING = three(0.2).with_backbone(taper=((0.0, 0.4e-3), (0.1, 0.35e-3), (LENGTH, 0.2e-3)))
PLACES = {
    "soft_bay": {"s": 0.1, "factor": 0.4},
    "kink": {"s": 0.1, "kappa_x": 3.0, "kappa_y": -2.0},
    "side_spring": {"s": DISKS.positions[6], "stiffness": 2.0},
    "stuck_hole": {"tendon": 1, "s": DISKS.positions[5], "drop": 0.2},
}


def pulls(*tensions):
    return [LoadStep(tensions=dict(zip(("t1", "t2", "t3"), each, strict=False))) for each in tensions]


def to_and_fro(robot, elements=4):
    """Pulled and released, with a force across, in two minutes a step."""
    loads = [{}, {}, {}, {"tip": Load(LENGTH, (0.0, 0.03, 0.0))}, {}]
    pulled = ({"t1": 0.8}, {"t1": 1.6}, {}, {"t1": 1.0, "t2": 0.4}, {"t1": 0.3})
    rows = zip(pulled, loads, (120.0, 240.0, 360.0, 480.0, 600.0), strict=True)
    steps = [LoadStep(tensions=t, loads=x, substeps=4, time=time) for t, x, time in rows]
    return robot, Model(elements_per_bay=elements), steps, 3e-4


def tightened(friction):
    """Three elastic tendons with a pretension, one of which becomes slack, and the way back."""
    robot = seven(0.2).with_tendons(axial_stiffness=400.0, pretension=0.7)
    moved = ((2e-3, -1e-3, -1e-3), (-1e-3, 1e-3, -5e-3), (0.0, 0.0, 0.0))
    steps = [LoadStep(displacements=dict(zip(robot.tendon_names, each, strict=True))) for each in moved]
    return robot, Model(friction=friction, elements_per_bay=4), steps, 1e-5


TWO = (ParallelRouting(4.5e-3), ParallelRouting(4.5e-3, 120.0))
DOWN = replace(FOLLOWS, gravity=(0.0, 0.0, 9.81))
ASKEW = {"friction": "none", "gravity": (0.0, 3.0, -9.81)}
PULLS = [LoadStep(tensions={"a": 1.5}), LoadStep(tensions={"a": 2.0, "b": 1.0})]
PUSHED = LoadStep(tensions={"t1": 1.6}, loads={"tip": Load(LENGTH, (0.02, 0.03, 0.0))})
BENT = [*pulls((1.0, 0.2, 0.2)), PUSHED, *pulls((0.8, 0.6))]
#: Robot, model, load steps, and the tolerance of tips and displacements over the length.
AGREE = {
    "tapered, two ends": (TENTACLE, DOWN, STEPS, 1e-4),
    "helix": (WINDING, DOWN, [LoadStep(tensions={"a": 1.0}), LoadStep(tensions={"a": 3.0})], 1e-4),
    "narrowing": (NARROWING, Model("straight", **ASKEW), pulls((0.3, 0.1, 0.1), (0.4,)), 2e-4),
    "narrowing, continuous": (NARROWING, Model("continuous", **ASKEW), pulls((0.3, 0.1, 0.1), (0.4,)), 2e-4),
    "fibres": (
        replace(FIBRES.with_backbone(nonlinear=NEO_HOOKEAN), disks=Disks.equally_spaced(12, L, radius=12e-3)),
        replace(DOWN, tendon_path="straight"), PULLS, 2e-4),
    "fibres, continuous": (FIBRES.with_backbone(nonlinear=NonlinearMaterial(4.0, 12.0)), DOWN, PULLS, 2e-4),
    "base that gives way": (
        replace(three(0.2), base_stiffness=0.02), Model(elements_per_bay=2), pulls((1.0, 0.3), (0.5, 0.0, 0.4)), 1e-4),
    "places": (with_effects(Experiment(three(0.2), Model()), PLACES).robot, Model(elements_per_bay=2), BENT, 1e-4),
    **{f"pretension, {x}": tightened(x) for x in ("none", "per-hole", "per-tendon")},
    "clearance": to_and_fro(
        routed(ConvergingRouting(5e-3, 2e-3), HelicalRouting(4.5e-3, 0.5, 120.0), disks=10, mu=0.2, clearance=2.5e-4)),
    "creep, softening": to_and_fro(  # which needs finer elements
        routed(*TWO, disks=10, mu=0.2).with_backbone(creep_rate=5e-4, superelastic=Superelastic(2e-3, 0.6)), 8),
    "varying pitch": to_and_fro(
        routed(VaryingHelicalRouting(4.5e-3, 0.2, 1.5, 30.0), HelicalRouting(4.5e-3, 0.5, 120.0), disks=10, mu=0.2)),
    "force-dependent": to_and_fro(routed(*TWO, disks=10, friction=ForceDependentFriction(0.3, 0.1))),
    "angle-dependent": to_and_fro(routed(*TWO, disks=10, friction=AngleDependentFriction(0.0, 1.5))),
}  # fmt: skip


@pytest.mark.integration
@pytest.mark.parametrize("row", AGREE)
def test_finite_elements_agree_with_the_reference(row):
    """What the cases of `tdcr-fe validate` leave out."""
    robot, model, steps, tolerance = AGREE[row]
    exact = solve_reference(robot, model, steps).raise_if_failed()
    found = simulate(robot, model, steps).raise_if_failed()
    limit = tolerance * robot.backbone.length
    assert np.linalg.norm(found.tips - exact.tips, axis=1).max() < limit
    for a, b in zip(found.steps, exact.steps, strict=True):
        np.testing.assert_allclose(a.displacements, b.displacements, atol=limit)
        np.testing.assert_allclose(a.base_tensions, b.base_tensions, atol=20.0 * tolerance)

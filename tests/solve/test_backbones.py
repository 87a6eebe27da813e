"""Robots without disks, tapered backbones, fibres that harden or soften: closed forms, the reference, mistakes."""

from dataclasses import replace

import numpy as np
import pytest
from robots import LENGTH, distance, three

from tdcr_fe.model.backbone import Backbone, NonlinearMaterial, StiffnessPatch
from tdcr_fe.model.loading import Load, LoadStep, Model
from tdcr_fe.model.robot import Disks, Robot
from tdcr_fe.model.routing import ConvergingRouting, HelicalRouting, ParallelRouting
from tdcr_fe.model.tendon import Tendon
from tdcr_fe.solve.simulate import simulate
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


def test_a_tapered_cantilever_bends_under_a_small_tip_force_as_in_the_integral():
    """``w = F int (L - s)^2 / EI(s) ds`` and the shear ``F int ds / GA(s)``, by Gauss's rule on both stretches."""
    force = 1e-5
    model = Model(elements_per_bay=6)
    result = simulate(Robot(CONE), model, [LoadStep(loads={"tip": Load(L, (force, 0.0, 0.0))})])
    points, weights = np.polynomial.legendre.leggauss(40)
    expected = 0.0
    for start, end in ((0.0, 0.25), (0.25, L)):
        s = start + 0.5 * (end - start) * (points + 1.0)
        ratio = CONE.radius_at(s) / CONE.radius
        by_area = (L - s) ** 2 / (CONE.EI * ratio**4) + 1.0 / (CONE.GA * ratio**2)
        expected += force * 0.5 * (end - start) * float(weights @ by_area)
    assert result.tips[0][0] == pytest.approx(expected, rel=1e-4)


@pytest.mark.integration
@pytest.mark.parametrize("robot", [TENTACLE, WINDING], ids=["tapered, two ends", "helix"])
def test_finite_elements_agree_with_the_reference(robot):
    model = replace(FOLLOWS, gravity=(0.0, 0.0, 9.81))
    steps = [
        LoadStep(tensions={k: v for k, v in s.tensions.items() if k in robot.tendon_names}) for s in STEPS
    ]
    exact = solve_reference(robot, model, steps).raise_if_failed()
    found = simulate(robot, model, steps).raise_if_failed()
    np.testing.assert_allclose(found.tips, exact.tips, atol=1e-4 * L)
    for a, b in zip(found.steps, exact.steps, strict=True):
        np.testing.assert_allclose(a.displacements, b.displacements, atol=1e-4 * L)
        assert [len(t) for t in a.tensions] == [1] * len(robot.tendons)


def test_bays_are_twentieths_and_every_end_of_a_tendon_has_a_node():
    result = simulate(TENTACLE, replace(FOLLOWS, elements_per_bay=1), STEPS[:1])
    expected = sorted({*np.round(L * np.arange(21) / 20, 9), 0.25, 0.18})
    np.testing.assert_allclose(result.steps[0].s, expected, atol=1e-12)
    assert len(TENTACLE.bay_edges) == 21


# ------------------------------------------------------------ taper


R0, R1 = 0.4e-3, 0.2e-3
BENDING = [
    LoadStep(tensions={"t1": 0.3, "t2": 0.1, "t3": 0.1}),
    LoadStep(tensions={"t1": 0.4}, loads={"tip": Load(LENGTH, (0.002, 0.003, 0.0))}),
    LoadStep(tensions={"t1": 0.2, "t2": 0.2}),
]


@pytest.mark.integration
@pytest.mark.parametrize("path", ["straight", "continuous"])
def test_tapered_robots_converge_to_the_reference_with_order_two(path):
    robot = three(0.2).with_backbone(taper=((0.0, R0), (0.1, 0.35e-3), (LENGTH, R1)))
    model = Model(path, "none", gravity=(0.0, 3.0, -9.81))
    exact = solve_reference(robot, model, BENDING[:2]).raise_if_failed()
    found = []
    for n in (1, 2, 4, "auto"):
        found.append(simulate(robot, replace(model, elements_per_bay=n), BENDING[:2]).raise_if_failed().tips)
    ratio = distance(found[0], found[1]) / distance(found[1], found[2])
    assert 3.5 < ratio < 4.6
    assert distance(found[2], exact.tips) < 2e-4 and distance(found[3], exact.tips) < 2e-4


# ------------------------------------------------------------ nonlinear material


NEO_HOOKEAN = NonlinearMaterial(-1.0, 4.0 / 3.0)
LAWS = [NonlinearMaterial(0.0, 30.0), NEO_HOOKEAN, NonlinearMaterial(4.0, 12.0), NonlinearMaterial(0.0, -2.0)]
ROD = Backbone(L, 10e-3, 0.4e6, 0.45, density=1100.0)


def rod(law, **changes):
    return Robot(replace(ROD, nonlinear=law, **changes))


@pytest.mark.parametrize("law", LAWS)
def test_an_axial_force_stretches_the_rod_along_the_stress_strain_curve(law):
    """``F = EA (e + b e^2 + c e^3)``: the cubic solved by numpy."""
    force = 0.08 * ROD.EA
    result = simulate(
        rod(law), Model(), [LoadStep(loads={"tip": Load(L, (0.0, 0.0, force))})]
    ).raise_if_failed()
    roots = np.roots([law.cubic, law.quadratic, 1.0, -0.08])
    stretch = min(float(r.real) for r in roots if abs(r.imag) < 1e-9 and r.real > 0.0)
    assert result.tips[0][2] == pytest.approx(L * (1.0 + stretch), rel=1e-9)


FIBRES = Robot(
    replace(ROD, taper=((0.0, 10e-3), (L, 5e-3))),
    tendons=(
        Tendon("a", ConvergingRouting(8e-3, 3e-3, -60.0), end=0.25),
        Tendon("b", ConvergingRouting(8e-3, 3e-3, 60.0)),
    ),
)
PULLS = [LoadStep(tensions={"a": 1.5}), LoadStep(tensions={"a": 2.0, "b": 1.0})]


@pytest.mark.integration
@pytest.mark.parametrize(
    ("path", "law"), [("straight", NEO_HOOKEAN), ("continuous", NonlinearMaterial(4.0, 12.0))]
)
def test_nonlinear_fibres_agree_with_the_reference(law, path):
    robot = FIBRES.with_backbone(nonlinear=law)
    if path == "straight":
        robot = replace(robot, disks=Disks.equally_spaced(12, L, radius=12e-3))
    model = Model(path, "none", gravity=(0.0, 0.0, 9.81))
    exact = solve_reference(robot, model, PULLS).raise_if_failed()
    found = simulate(robot, model, PULLS).raise_if_failed()
    linear = simulate(replace(robot, backbone=FIBRES.backbone), model, PULLS)
    assert np.abs(found.tips - exact.tips).max() < 2e-4 * L < 0.02 * np.abs(linear.tips - exact.tips).max()

"""Robots without disks: tendons follow the backbone. Closed forms, the reference, guides, scenes and mistakes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tdcr_fe.model.backbone import Backbone, StiffnessPatch
from tdcr_fe.model.loading import Load, LoadStep, Model
from tdcr_fe.model.robot import Robot
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
    result = simulate(rod, FOLLOWS, [LoadStep(tensions={"t": tension})])
    assert result.converged, result.message
    curvature, stretch = tension * a / SOFT.EI, 1.0 - tension / SOFT.EA
    radius, angle = stretch / curvature, curvature * L
    expected = [radius * (1.0 - np.cos(angle)), 0.0, radius * np.sin(angle)]
    np.testing.assert_allclose(result.tips[0], expected, atol=1e-9)
    assert result.steps[0].displacements[0] == pytest.approx(L * (1.0 - (stretch - a * curvature)), rel=1e-9)


TWO_MATERIALS = replace(CONE, patches=(StiffnessPatch(0.2, L, modulus=0.4, density=2.0),))


@pytest.mark.parametrize("backbone", [SOFT, CONE, TWO_MATERIALS], ids=["even", "cone", "two materials"])
def test_a_hanging_rod_without_tendons_stretches_by_its_weight(backbone):
    """Every section by its own modulus and area, under the weight of what is below it."""
    result = simulate(Robot(backbone), Model(gravity=(0.0, 0.0, 9.81), elements_per_bay=4), [LoadStep()])
    assert result.converged, result.message
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
    exact = solve_reference(robot, model, steps)
    found = simulate(robot, model, steps)
    assert exact.converged and found.converged, (exact.message, found.message)
    np.testing.assert_allclose(found.tips, exact.tips, atol=1e-4 * L)
    for a, b in zip(found.steps, exact.steps, strict=True):
        np.testing.assert_allclose(a.displacements, b.displacements, atol=1e-4 * L)
        assert [len(t) for t in a.tensions] == [1] * len(robot.tendons)


def test_bays_are_twentieths_and_every_end_of_a_tendon_has_a_node():
    result = simulate(TENTACLE, replace(FOLLOWS, elements_per_bay=1), STEPS[:1])
    expected = sorted({*np.round(L * np.arange(21) / 20, 9), 0.25, 0.18})
    np.testing.assert_allclose(result.steps[0].s, expected, atol=1e-12)
    assert len(TENTACLE.bay_edges) == 21


def test_a_straight_path_without_disks_is_refused_by_name():
    with pytest.raises(ValueError, match=r'model\.tendon_path = "straight".*follow the backbone'):
        simulate(TENTACLE, Model(), STEPS)


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"end": 0.31}, r"tendons\[0\]\.end: 0\.31; beyond the tip"),
        ({"clearance": 1e-3}, r"tendons\[0\]\.clearance: given; a robot without disks has no holes"),
    ],
)
def test_what_needs_holes_is_refused_by_name(change, text):
    with pytest.raises(ValueError, match=text):
        TENTACLE.with_tendons(["a"], **change)

"""Fibres that harden or soften: closed forms, derivatives, the reference, the mesh's error, files and mistakes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tdcr_fe.elements.section import NonlinearSection
from tdcr_fe.io.problems import InputError
from tdcr_fe.io.toml import read_robot
from tdcr_fe.io.write_toml import robot_to_toml
from tdcr_fe.model.backbone import Backbone, NonlinearMaterial
from tdcr_fe.model.loading import Load, LoadStep, Model
from tdcr_fe.model.robot import Disks, Robot
from tdcr_fe.model.routing import ConvergingRouting
from tdcr_fe.model.tendon import Tendon
from tdcr_fe.solve.simulate import simulate
from tdcr_fe.validation.reference import solve_reference

L = 0.3
NEO_HOOKEAN = NonlinearMaterial(-1.0, 4.0 / 3.0)
LAWS = [NonlinearMaterial(0.0, 30.0), NEO_HOOKEAN, NonlinearMaterial(4.0, 12.0), NonlinearMaterial(0.0, -2.0)]
ROD = Backbone(L, 10e-3, 0.4e6, 0.45, density=1100.0)


def rod(law, **changes):
    return Robot(replace(ROD, nonlinear=law, **changes))


@pytest.mark.parametrize("law", LAWS)
def test_an_axial_force_stretches_the_rod_along_the_stress_strain_curve(law):
    """``F = EA (e + b e^2 + c e^3)``: the cubic solved by numpy."""
    force = 0.08 * ROD.EA
    result = simulate(rod(law), Model(), [LoadStep(loads={"tip": Load(L, (0.0, 0.0, force))})])
    assert result.converged, result.message
    roots = np.roots([law.cubic, law.quadratic, 1.0, -0.08])
    stretch = min(float(r.real) for r in roots if abs(r.imag) < 1e-9 and r.real > 0.0)
    assert result.tips[0][2] == pytest.approx(L * (1.0 + stretch), rel=1e-9)


def test_a_tip_moment_bends_a_hardening_rod_to_the_arc_of_its_moment_curvature_curve():
    """Without an axial force and without b: ``M = EI k (1 + c R^2 k^2 / 2)``, while ``3 c n`` leaves n = 0."""
    law, curvature = NonlinearMaterial(0.0, 30.0), 8.0
    moment = ROD.EI * curvature * (1.0 + 0.5 * law.cubic * ROD.radius**2 * curvature**2)
    result = simulate(rod(law), Model(), [LoadStep(loads={"tip": Load(L, moment=(0.0, moment, 0.0))})])
    angle = curvature * L
    expected = [(1.0 - np.cos(angle)) / curvature, 0.0, np.sin(angle) / curvature]
    np.testing.assert_allclose(result.tips[0], expected, atol=1e-9)


def test_bending_stretches_a_material_that_is_softer_in_tension():
    """Pure bending, no axial force: ``EA (n + b n^2) + EI b k^2 = 0`` to second order in the strain."""
    law, curvature = NonlinearMaterial(-1.0, 1.0), 3.0
    moment = ROD.EI * curvature
    result = simulate(rod(law), Model(), [LoadStep(loads={"tip": Load(L, moment=(0.0, moment, 0.0))})])
    step = result.steps[0]
    stretch = step.tip[0] / (1.0 - np.cos(step.bending_angle)) * step.bending_angle / L - 1.0
    assert stretch == pytest.approx(ROD.EI / ROD.EA * curvature**2, rel=0.01)


@pytest.mark.parametrize("law", LAWS)
def test_wrench_is_the_integral_of_the_stress_and_stiffness_its_derivative(law):
    ea, ei = ROD.EA, ROD.EI
    one = np.ones(1)
    section = NonlinearSection(
        ea * one, ei * one, ROD.radius * one, law.quadratic * one, law.cubic * one, np.zeros((1, 3))
    )
    n, bend = np.array([0.03]), np.array([[4.0, -6.0]])
    s, weight = np.polynomial.legendre.leggauss(12)
    radii, angles = 0.5 * ROD.radius * (s + 1.0), np.linspace(0.0, 2.0 * np.pi, 33)[:-1]
    y, z = np.outer(radii, np.cos(angles)), np.outer(radii, np.sin(angles))
    area = np.outer(0.5 * ROD.radius * weight * radii, np.full(32, 2.0 * np.pi / 32))
    # Curvature about y strains fibres by +z, about z by -y, in beam axes.
    e = n[0] + bend[0, 0] * z - bend[0, 1] * y
    stress = ROD.youngs_modulus * (law.quadratic * e**2 + law.cubic * e**3)
    expected = [np.sum(stress * f * area) for f in (1.0, z, -y)]
    np.testing.assert_allclose(section.wrench(n, bend)[0], expected, rtol=1e-9)
    for k, step in enumerate(np.eye(3) * np.array([1e-6, 1e-4, 1e-4])):
        up = section.wrench(n + step[0], bend + step[1:])
        down = section.wrench(n - step[0], bend - step[1:])
        size = step[k]
        np.testing.assert_allclose(
            section.stiffness(n, bend)[0, :, k], ((up - down) / (2.0 * size))[0], rtol=1e-6
        )


SOFT = Robot(
    replace(ROD, taper=((0.0, 10e-3), (L, 5e-3))),
    tendons=(
        Tendon("a", ConvergingRouting(8e-3, 3e-3, -60.0), end=0.25),
        Tendon("b", ConvergingRouting(8e-3, 3e-3, 60.0)),
    ),
)
STEPS = [LoadStep(tensions={"a": 1.5}), LoadStep(tensions={"a": 2.0, "b": 1.0})]


@pytest.mark.integration
@pytest.mark.parametrize("law", [NEO_HOOKEAN, NonlinearMaterial(4.0, 12.0)])
@pytest.mark.parametrize("path", ["continuous", "straight"])
def test_finite_elements_agree_with_the_reference(law, path):
    robot = SOFT.with_backbone(nonlinear=law)
    if path == "straight":
        robot = replace(robot, disks=Disks.equally_spaced(12, L, radius=12e-3))
    model = Model(path, "none", gravity=(0.0, 0.0, 9.81))
    exact = solve_reference(robot, model, STEPS)
    found = simulate(robot, model, STEPS)
    assert exact.converged and found.converged, (exact.message, found.message)
    linear = simulate(replace(robot, backbone=SOFT.backbone), model, STEPS)
    assert np.abs(found.tips - exact.tips).max() < 2e-4 * L < 0.02 * np.abs(linear.tips - exact.tips).max()


@pytest.mark.parametrize(
    ("law", "more", "text"),
    [
        ("{ quadratic = 80.0 }", "", "falls from 0.00625 on"),
        ("{ cubic = -100000.0 }", "", "cubic"),
        ("{ cubic = 1.0 }", "creep_rate = 1e-3", "cannot be combined with creep_rate"),
    ],
)
def test_laws_that_cannot_be_are_refused_by_name(tmp_path, law, more, text):
    lines = robot_to_toml(rod(None)).replace("[backbone]", f"[backbone]\nnonlinear = {law}\n{more}")
    (tmp_path / "robot.toml").write_text(lines)
    with pytest.raises(InputError, match=r"backbone\.nonlinear") as found:
        read_robot(tmp_path / "robot.toml")
    assert text in str(found.value)

"""The backbone as a beam: closed forms of rods without tendons, and the mesh."""

from dataclasses import dataclass, replace

import numpy as np
import pytest
from robots import BACKBONE, DISKS, LENGTH, distance, paper, pull, solve

from tdcr_fe.model.backbone import Backbone
from tdcr_fe.model.loading import Load, LoadStep, Model
from tdcr_fe.model.robot import Disks, Robot
from tdcr_fe.scene.mesh import build_mesh
from tdcr_fe.validation.reference.closed_forms import constant_strain, elastica_tip, helix_wrench

ROD = Robot(BACKBONE, DISKS, (), name="rod")
EI, GJ, EA, GA = BACKBONE.EI, BACKBONE.GJ, BACKBONE.EA, BACKBONE.GA


def loaded(robot: Robot = ROD, elements: int = 1, at: float = LENGTH, **load):
    """One load, one step."""
    return solve(robot, [LoadStep("", loads={"x": Load(at, **load)})], elements_per_bay=elements).steps[0]


@pytest.mark.parametrize("turns", [0.25, 0.5, 1.0, 1.5])
def test_pure_moment_bends_to_a_circle(turns):
    """M = EI k: one element per bay is exact; a whole circle closes."""
    k = 2 * np.pi * turns / LENGTH
    step = loaded(moment=(0.0, EI * k, 0.0))
    exact = [(1 - np.cos(k * LENGTH)) / k, 0.0, np.sin(k * LENGTH) / k]
    assert step.tip == pytest.approx(exact, abs=1e-9)


def test_small_force_bends_a_cantilever():
    """F s^2 (3 L - s) / (6 EI) + F s / GA, and F s (2 L - s) / (2 EI): exact at the nodes of any mesh.

    What the residual bending flexibility makes of an element whose strain is constant.
    """
    f = 1e-6
    robot = Robot(BACKBONE, Disks((LENGTH,)), ())
    for k in (1, 2, 3, 8):
        step = loaded(robot, k, force=(f, 0.0, 0.0))
        s, tangent = step.s, step.rotations[:, :, 2]
        across = f * s**2 * (3 * LENGTH - s) / (6 * EI) + f * s / GA
        slope = f * s * (2 * LENGTH - s) / (2 * EI)
        assert step.positions[:, 0] == pytest.approx(across, abs=1e-9 * across[-1])
        # The tangent of the section leaves out the shear.
        assert tangent[:, 0] == pytest.approx(slope, abs=1e-9 * slope[-1])


@pytest.mark.parametrize("force", [0.05, 0.2])
def test_elastica_under_a_transverse_end_force(force):
    """Bisshopp and Drucker, Large deflection of cantilever beams, Quart. Appl. Math. 3 (1945) 272-275."""
    robot = Robot(replace(BACKBONE, axial_stiffness=1e7, shear_stiffness=1e7), DISKS, ())
    _, along, theta = elastica_tip(LENGTH, EI, force)
    n = np.array([1, 2, 4])
    steps = [loaded(robot, k, force=(force, 0.0, 0.0)) for k in n]
    angle = np.array([abs(s.bending_angle - theta) for s in steps])
    z = np.array([abs(s.tip[2] - along) for s in steps]) / LENGTH
    assert angle[0] < 5e-6 and z[0] < 2e-6
    for error in (angle, z):
        assert np.diff(np.log(error)) / np.diff(np.log(n)) == pytest.approx([-4.0, -4.0], abs=0.02)


def test_rod_of_constant_strain_is_a_helix():
    """Constant strain u, v in a precurved rod: moment and force are constant in the section's frame.

    A wrench fixed in the tip frame balances it, and the pose at the tip is one exponential. Elements of constant
    strain would be exact but for their residual flexibility, which takes the moment to change with the shear force;
    here ``u x m`` makes up for it.
    """
    k, twist = 3.0, 2.0
    robot = Robot(replace(BACKBONE, precurvature=(0.0, k)), DISKS, ())
    m, force = np.split(helix_wrench(k, twist, 0.0, GJ), 2)
    load = [LoadStep("", loads={"tip": Load(LENGTH, tuple(force), tuple(m), "section")})]
    n = np.array([1, 2, 4])
    steps = [solve(robot, load, elements_per_bay=each).steps[0] for each in n]
    strain = np.array([0.0, k, twist, 0.0, force[1] / GA, 1.0 + force[2] / EA])
    rotation, tip = constant_strain(strain, LENGTH)
    error = [distance(step.tip, tip) for step in steps]
    assert np.diff(np.log(error)) / np.diff(np.log(n)) == pytest.approx([-2.0, -2.0], abs=0.02)
    assert error[-1] < 1e-5
    assert steps[-1].rotations[-1] == pytest.approx(rotation, abs=2e-6)


def test_loads_in_world_and_section_frame():
    """A force that follows the section, against the same force turned into the world at the solution."""
    follower = loaded(elements=2, force=(0.05, 0.02, -0.03), moment=(1e-3, 2e-3, 1e-3), at=0.2)
    assert follower.bending_angle > 0.1
    step = solve(
        ROD,
        [LoadStep("", loads={"x": Load(0.2, (0.05, 0.02, -0.03), (1e-3, 2e-3, 1e-3), "section")})],
        elements_per_bay=2,
    ).steps[0]
    k = int(np.argmin(abs(step.s - 0.2)))
    r = step.rotations[k]
    dead = loaded(
        elements=2, at=0.2, force=tuple(r @ [0.05, 0.02, -0.03]), moment=tuple(r @ [1e-3, 2e-3, 1e-3])
    )
    assert distance(dead.positions, step.positions) < 1e-7
    assert distance(follower.tip, step.tip) > 1e-3


@dataclass(frozen=True)
class Tube(Backbone):
    """A user-defined section: its area and second moment decide on stiffness and mass."""

    bore: float = 0.0

    @property
    def area(self) -> float:
        return float(np.pi * (self.radius**2 - self.bore**2))

    @property
    def second_moment(self) -> float:
        return float(np.pi * (self.radius**4 - self.bore**4) / 4.0)


def test_another_section_takes_its_area_and_second_moment_alone():
    """A tube against a rod with the tube's stiffnesses and mass declared."""
    solid = Backbone(LENGTH, 0.4e-3, 85e9, 0.3, 5600.0)
    tube = Tube(LENGTH, 0.4e-3, 85e9, 0.3, 5600.0, bore=0.3e-3)
    assert pytest.approx(solid.EI * (1 - 0.75**4)) == tube.EI
    declared = replace(
        solid,
        density=5600.0 * tube.area / solid.area,
        bending_stiffness=tube.EI,
        torsional_stiffness=tube.GJ,
        axial_stiffness=tube.EA,
        shear_stiffness=tube.GA,
    )
    a, b = (solve(paper(0.3, backbone=x), pull(0.5, 0.2), gravity=(9.81, 0.0, 0.0)) for x in (tube, declared))
    assert distance(a.tips, b.tips) < 1e-12
    assert distance(a.tips, solve(paper(0.3), pull(0.5, 0.2), gravity=(9.81, 0.0, 0.0)).tips) > 0.05
    # Of the rotary inertia, the hole takes the fourth power of the radii.
    inertia = [build_mesh(paper(backbone=x), Model())[0].rotary_inertia for x in (tube, solid)]
    assert inertia[0] == pytest.approx((1 - 0.75**4) * inertia[1])

"""The backbone as a beam: closed forms of rods without tendons, and the mesh."""

from dataclasses import dataclass, replace

import numpy as np
import pytest
from robots import BACKBONE, DISKS, LENGTH, distance, paper, pull, solve

from tdcr_fe import Backbone, Disks, Load, LoadStep, Model, NonlinearMaterial, Robot, Superelastic
from tdcr_fe.elements.material import NonlinearSection
from tdcr_fe.elements.section_forces import SectionForces
from tdcr_fe.scene.mesh import build_mesh
from tdcr_fe.validation.reference.closed_forms import elastica_tip
from tdcr_fe.validation.reference.section import bending_moment

ROD = Robot(BACKBONE, DISKS, (), name="rod")
EI, GA = BACKBONE.EI, BACKBONE.GA


def loaded(robot: Robot = ROD, elements: int = 1, at: float = LENGTH, **load):
    """One load, one step."""
    return solve(robot, [LoadStep("", loads={"x": Load(at, **load)})], elements_per_bay=elements).steps[0]


SOFTENING = Superelastic(0.002, 0.3)
SOFT = Backbone(LENGTH, 10e-3, 0.4e6, 0.45, nonlinear=NonlinearMaterial(0.0, 30.0))
#: Backbones, curvatures [1/m], and the moments that make these: ``EI k``, as the reference has the softening law, and
#: ``EI k (1 + c R^2 k^2 / 2)`` of fibres without b, while ``3 c n`` leaves n = 0.
ARCS = {
    **{f"{x} turns": (BACKBONE, k := 2 * np.pi * x / LENGTH, EI * k) for x in (0.25, 0.5, 1.0, 1.5)},
    "softening": (replace(BACKBONE, superelastic=SOFTENING), 12.0,
        float(bending_moment(np.array([12.0]), np.array([EI]), SOFTENING, BACKBONE.radius)[0][0])),
    "hardening": (SOFT, 8.0, SOFT.EI * 8.0 * (1.0 + 0.5 * 30.0 * (SOFT.radius * 8.0) ** 2)),
}  # fmt: skip


@pytest.mark.parametrize("row", ARCS)
def test_a_moment_at_the_tip_bends_to_an_arc(row):
    """One element per bay is exact, by any law; a whole circle closes."""
    backbone, k, moment = ARCS[row]
    assert "turn" in row or not 0.85 < moment / (backbone.EI * k) < 1.05
    step = loaded(Robot(backbone, DISKS, ()), moment=(0.0, moment, 0.0))
    exact = [(1 - np.cos(k * LENGTH)) / k, 0.0, np.sin(k * LENGTH) / k]
    assert step.tip == pytest.approx(exact, abs=1e-7 if row == "softening" else 1e-9)


def test_small_force_bends_a_cantilever():
    """F s^2 (3 L - s) / (6 EI) + F s / GA, and F s (2 L - s) / (2 EI): exact at the nodes of any mesh.

    What the residual bending flexibility makes of an element whose strain is constant.
    """
    f = 1e-6
    for k in (1, 2, 3, 8):
        step = loaded(Robot(BACKBONE, Disks((LENGTH,)), ()), k, force=(f, 0.0, 0.0))
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


@pytest.mark.parametrize("length", [2e-2, 2e-6])
def test_tangent_of_the_nonlinear_section_is_its_stiffness_in_elements_of_any_length(length):
    """Moments in the node in front change by stiffness over length, also where two nodes nearly coincide."""
    law = NonlinearSection(*np.array([[36.0], [1.3e-4], [3.8e-3], [-1.6], [2.5]]), np.zeros((1, 3)))
    lengths = np.array([length, 0.1])
    twists = lengths[:, None] * np.array([[1.01, 0.0, 0.0, 0.0, 4.0, -7.0], [1.0, 0.0, 0.0, 0.0, 0.0, 0.0]])
    exact = law.stiffness(*law.strain(twists[:1], lengths[:1]))[0] / length
    tangent = SectionForces(lengths, material=law).wrench_tangent(twists, np.zeros(0))[0]
    which = np.ix_([6, 10, 11], [6, 10, 11])
    # The wrench also turns with the node, which is small beside the stiffness of so short an element.
    assert tangent[which] == pytest.approx(-exact, rel=1e-2, abs=1e-3 * np.abs(exact).max())


def test_loads_in_world_and_section_frame():
    """A force that follows the section, against the same force turned into the world at the solution."""
    load = {"force": (0.05, 0.02, -0.03), "moment": (1e-3, 2e-3, 1e-3)}
    world, step = (loaded(elements=2, at=0.2, **load, frame=frame) for frame in ("world", "section"))
    assert world.bending_angle > 0.1
    r = step.rotations[int(np.argmin(abs(step.s - 0.2)))]
    dead = loaded(elements=2, at=0.2, **{kind: tuple(r @ x) for kind, x in load.items()})
    assert distance(dead.positions, step.positions) < 1e-7
    assert distance(world.tip, step.tip) > 1e-3


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
    tube = Tube(LENGTH, 0.4e-3, 85e9, 0.3, 5600.0, bore=0.3e-3)
    assert pytest.approx(BACKBONE.EI * (1 - 0.75**4)) == tube.EI
    stiffness = {"bending_stiffness": tube.EI, "torsional_stiffness": tube.GJ}
    stiffness |= {"axial_stiffness": tube.EA, "shear_stiffness": tube.GA}
    declared = replace(BACKBONE, density=5600.0 * tube.area / BACKBONE.area, **stiffness)
    a, b = (solve(paper(0.3, backbone=x), pull(0.5, 0.2), gravity=(9.81, 0.0, 0.0)) for x in (tube, declared))
    assert distance(a.tips, b.tips) < 1e-12
    assert distance(a.tips, solve(paper(0.3), pull(0.5, 0.2), gravity=(9.81, 0.0, 0.0)).tips) > 0.05
    # Of the rotary inertia, the hole takes the fourth power of the radii.
    inertia = [build_mesh(paper(backbone=x), Model())[0].rotary_inertia for x in (tube, BACKBONE)]
    assert inertia[0] == pytest.approx((1 - 0.75**4) * inertia[1])

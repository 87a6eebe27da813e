"""Quantities that do not fit together get one remark that names them; robots as published get none."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
from robots import solve

import tdcr_fe
from tdcr_fe.model.backbone import Backbone
from tdcr_fe.model.limits import nearest_material
from tdcr_fe.model.loading import Load, LoadStep, Model
from tdcr_fe.model.messages import PlausibilityRemark
from tdcr_fe.model.plausibility import plausibility, understood
from tdcr_fe.model.robot import Disks, Robot
from tdcr_fe.model.routing import ParallelRouting, PointsRouting
from tdcr_fe.model.tendon import Spool, Tendon

STEEL = Backbone(0.2, 0.5e-3, 200e9, 0.3, 7850.0)
DISKS = Disks.equally_spaced(10, 0.2, mass=0.9e-3, thickness=3e-3, radius=8e-3)
HELD = Model(gravity=(0.0, -9.81, 0.0))
PULL = [LoadStep(tensions={"t1": t}) for t in (2.0, 4.0, 6.0)]
SHIFTED = (*DISKS.positions[:4], 0.095, *DISKS.positions[5:])


def robot(angles=(0.0, 120.0, 240.0), **changes) -> Robot:
    tendons = (
        Tendon(f"t{i + 1}", ParallelRouting(6.5e-3, a), friction_coefficient=0.15, axial_stiffness=5e3)
        for i, a in enumerate(angles)
    )
    return replace(Robot(STEEL, DISKS, tuple(tendons), "steel"), **changes)


def one(**changes) -> Robot:
    """The robot with another first tendon."""
    return robot().with_tendons(["t1"], **changes)


def pulled(*tensions: float) -> list[LoadStep]:
    return [LoadStep(tensions={"t1": t}) for t in tensions]


def drawn(t1: float, t2: float, t3: float) -> list[LoadStep]:
    return [LoadStep(displacements={"t1": t1, "t2": t2, "t3": t3})]


HOLES = ((6.5e-3, 0.0),) * 11
SWAPPED = (*HOLES[:5], HOLES[5][::-1], *HOLES[6:])
ROWS = {
    "exponent of E": (robot().with_backbone(youngs_modulus=20e9), HELD, PULL[:2], "backbone.youngs_modulus", "steel"),
    "GJ or EI": (
        robot().with_backbone(bending_stiffness=1e-3), HELD, pulled(0.5), "backbone.bending_stiffness", "not fit"),
    "EI of a diameter": (
        robot().with_backbone(bending_stiffness=0.05, torsional_stiffness=0.035), HELD, pulled(10.0, 30.0),
        "backbone.bending_stiffness = 0.05 N m^2", "EI = 0.00982"),
    "mass of a pack": (robot().with_disks(mass=9e-3, thickness=1e-3), Model(), PULL, "disks.mass = 0.009", "density"),
    "mass of steel": (robot().with_disks(mass=5.2e-3), HELD, PULL, "disks.mass = 0.0052 kg: weight", "sags"),
    "no gravity": (robot(tip_mass=0.1), Model(), PULL, "model.gravity = 0 m/s^2", "masses"),
    "a tenth of gravity": (robot(), Model(gravity=(0.0, 0.0, 0.981)), PULL, "model.gravity = 0.981", "9.81"),
    "a disk elsewhere": (robot().with_disks(positions=SHIFTED), HELD, PULL, "disks.positions[4] = 0.095 m", "0.02 m"),
    "one offset": (one(routing=ParallelRouting(5.6e-3)), HELD, PULL, "tendons[0].offset = 0.0056 m", "have 0.0065 m"),
    "one friction": (one(friction_coefficient=0.015), HELD, PULL, "tendons[0].friction_coefficient = 0.015", "0.15"),
    "one angle": (robot((0.0, 12.0, 240.0)), HELD, PULL, "tendons.angle_deg: 0, 12, 240 degrees", "balance"),
    "breaking load": (robot().with_tendons(axial_stiffness=80.0), HELD, PULL, "tendons[0].axial_stiffness = 80", "kN?"),
    "x and y of one hole": (
        one(routing=PointsRouting((0.0, *DISKS.positions), SWAPPED)), HELD, PULL, "tendons[0].holes[5]", "neighbours"),
    "decimal point": (robot(), HELD, pulled(2.0, 0.4, 6.0), "steps[1].tensions.t1 = 0.4 N: 2 N before", "point"),
    "kgf": (robot(), HELD, pulled(0.2, 0.6), "steps: tensions", "0.068 rad"),
    "load in gf": (
        robot(), HELD, [*PULL, LoadStep(loads={"tip": Load(0.2, (0.0, 2.0, 0.0))})], "steps[3].loads.tip.force", "gf?"),
    "tip at 0.02": (
        robot(), HELD, [*PULL, LoadStep(loads={"tip": Load(0.02, (0.0, 0.2, 0.0))})], "steps[3].loads.tip.at", "tip"),
    "a spool's spring in N/mm": (
        one(spool=Spool(8e-3, 5.0)), HELD, PULL, "tendons[0].spool.stiffness = 5 N/m", "meant in N/mm?"),
    "pretension": (
        robot().with_tendons(pretension=15.0), HELD, drawn(2e-3, -1e-3, -1e-3), "tendons[0].pretension = 15", "alone"),
    "force and moment": (
        robot(), HELD, [*PULL, LoadStep(loads={"tip": Load(0.2, moment=(0.0, 0.1, 0.0))})],
        "steps[3].loads.tip.moment = 0.1 N m", "right angle"),
    "sign of one motor": (robot(), HELD, drawn(4e-3, 2e-3, -2e-3), "steps[0].displacements of t1, t2, t3", "sign"),
    "increments": (robot(), HELD, 3 * drawn(4e-3, -2e-3, -2e-3), "steps: 2 steps ask for the same", "totals"),
}  # fmt: skip


@pytest.mark.parametrize("row", ROWS)
def test_what_does_not_fit_together_gets_one_remark_and_no_warning(row):
    described, model, steps, begin, words = ROWS[row]
    assert plausibility(described, model, steps).warnings == []
    found = plausibility(described, model, steps).remarks
    assert len(found) == 1 and found[0].startswith(begin) and words in found[0], found


@pytest.mark.parametrize(
    "angles", [(0.0,), (0.0, 180.0), (0.0, 90.0), (0.0, 120.0, 240.0), (0.0, 90.0, 180.0, 270.0)]
)
def test_a_common_robot_gets_no_remark(angles):
    described = robot(angles)
    for steps in (PULL, [LoadStep(displacements={"t1": 1e-3}), LoadStep(displacements={"t1": 3e-3})]):
        assert plausibility(described, HELD, steps).warnings == []
        assert plausibility(described, HELD, steps).remarks == []


def test_materials_are_known_by_modulus_and_density():
    known = {
        "steel": (207e9, 7850.0), "NiTi": (60e9, 6450.0), "glass fibre": (40e9, 2000.0), "plastic": (2.3e9, 1140.0),
        "carbon fibre": (130e9, 1600.0), "rubber": (0.2e6, 1070.0), "copper or brass": (110e9, 8500.0),
    }  # fmt: skip
    assert {name: nearest_material(*row)[0] for name, row in known.items()} == {name: name for name in known}


def test_the_tension_that_is_said_to_bend_by_a_right_angle_does():
    """Without friction a parallel tendon bends the backbone to the arc T r L / EI (closed form)."""
    described = robot((0.0,)).with_tendons(friction_coefficient=0.0, axial_stiffness=None)
    first, second = understood(described, HELD)
    assert "like steel" in first and "sideways" in first
    tension = float(second.split()[2])
    result = solve(described, [LoadStep(tensions={"t1": tension})], friction="none", tendon_path="continuous")
    # The tendon also shortens the backbone.
    assert math.degrees(result.steps[0].bending_angle) == pytest.approx(90.0, rel=5e-3)


def test_a_weight_that_is_said_to_sag_does():
    """A cantilever under its own weight sags by W L^3 / 8 EI (closed form)."""
    described = Robot(STEEL, Disks.equally_spaced(10, 0.2))
    (line,) = understood(described, HELD)
    sag = 1e-3 * float(line.split("sags by ")[1].split()[0])
    result = solve(described, [LoadStep()], friction="none", gravity=HELD.gravity)
    assert -result.steps[0].tip[1] == pytest.approx(sag, rel=1e-2)  # shear and three digits


def test_remarks_reach_the_caller_in_python_by_their_own_category():
    with pytest.warns(PlausibilityRemark, match="balance") as found:
        result = tdcr_fe.simulate(robot((0.0, 12.0, 240.0)), Model(elements_per_bay=1), PULL[:1])
    assert [str(w.message) for w in found] == list(result.remarks) and result.warnings == ()
    assert found[0].filename == __file__

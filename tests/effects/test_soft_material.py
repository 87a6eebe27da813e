"""Effects of soft bodies: what they change, and where a search tries them."""

from __future__ import annotations

from dataclasses import replace

import pytest
from robots import paper

from tdcr_fe.effects import Experiment, effect, with_effect
from tdcr_fe.model.backbone import Backbone, NonlinearMaterial
from tdcr_fe.model.loading import LoadStep, Model
from tdcr_fe.model.robot import Robot
from tdcr_fe.model.routing import ParallelRouting
from tdcr_fe.model.tendon import Tendon
from tdcr_fe.solve.simulate import simulate

BODY = Backbone(0.3, 10e-3, 0.4e6, 0.45, density=1100.0)
SOFT = Robot(BODY, tendons=(Tendon("a", ParallelRouting(6e-3)),))
MODEL = Model("continuous", "none", gravity=(0.0, 0.0, 9.81), elements_per_bay=1)
SETUP = Experiment(SOFT, MODEL, (LoadStep(tensions={"a": 2.0}),))
NAMES = ["modulus_scale", "density_scale", "nonlinear_material"]


def tip(experiment):
    return simulate(experiment.robot, experiment.model, experiment.steps).tips[-1]


@pytest.mark.parametrize("name", NAMES)
def test_they_are_tried_on_soft_bodies_alone(name):
    assert effect(name).forms(SETUP) == (effect(name),)
    wire = Experiment(paper(0.3), Model(gravity=(0.0, 0.0, -9.81)), (LoadStep(tensions={"t1": 2.5}),))
    assert effect(name).forms(wire) == ()


def test_density_is_tried_where_the_declared_model_has_weight():
    light = replace(SETUP, model=replace(MODEL, gravity=(0.0, 0.0, 0.0)))
    assert effect("density_scale").forms(light) == ()


def test_modulus_density_and_tension_by_one_factor_change_nothing():
    """Static shapes depend on the ratios of stiffness, weight and tension alone."""
    every = with_effect(with_effect(SETUP, "modulus_scale", factor=1.3), "density_scale", factor=1.3)
    every = with_effect(every, "actuator_gain", gain=1.3)
    assert tip(every) == pytest.approx(tip(SETUP), abs=1e-9)
    assert abs(tip(with_effect(SETUP, "modulus_scale", factor=1.3)) - tip(SETUP)).max() > 4e-3


def test_declared_stiffnesses_are_scaled_too():
    declared = replace(SETUP, robot=SOFT.with_backbone(bending_stiffness=2e-3, axial_stiffness=90.0))
    scaled = with_effect(declared, "modulus_scale", factor=2.0).robot.backbone
    assert pytest.approx((4e-3, 180.0, 2.0 * BODY.GJ)) == (scaled.EI, scaled.EA, scaled.GJ)


def test_a_nonlinear_material_replaces_the_declared_one():
    law = with_effect(SETUP, "nonlinear_material", quadratic=-1.0, cubic=2.0)
    assert law.robot.backbone.nonlinear == NonlinearMaterial(-1.0, 2.0)
    kept = with_effect(law, "nonlinear_material", cubic=3.0)
    assert kept.robot.backbone.nonlinear == NonlinearMaterial(-1.0, 3.0)
    assert with_effect(SETUP, "nonlinear_material").robot == SOFT

"""Causes beyond the list, for blind sets: closed forms of the reference's user functions, recipes, judgement."""

from types import SimpleNamespace

import numpy as np
import pytest

from tdcr_fe import Backbone, Disks, Load, LoadStep, Model, Robot, effect
from tdcr_fe.effects.base import Kind
from tdcr_fe.validation.blind.unlisted import LEAST_OFF, MOST_OFF, RECIPES, make_unlisted
from tdcr_fe.validation.campaigns.unlisted import judge
from tdcr_fe.validation.reference import Extras, ReferenceSettings, solve_reference
from tdcr_fe.validation.reference.settings import PointForce

LENGTH = 0.2
ROBOT = Robot(Backbone(LENGTH, 0.5e-3, 60e9, 0.3, 6000.0), Disks.equally_spaced(4, LENGTH), ())
EI = ROBOT.backbone.EI
MODEL = Model(friction="none")


@pytest.mark.parametrize("share", [0.3, 2.0, -0.15])
def test_a_moment_bends_a_hardening_rod_to_the_arc_of_its_law(share):
    """EI kappa + c kappa^2 = M along the whole rod: an arc, whose curvature solves the quadratic equation."""
    moment = 4.0 * EI
    c = share * EI / 4.0
    law = Extras(bending=lambda b: c * np.linalg.norm(b.strain[:, :2], axis=1)[:, None] * b.strain[:, :2])
    steps = [LoadStep(loads={"tip": Load(LENGTH, moment=(0.0, moment, 0.0))})]
    result = solve_reference(ROBOT, MODEL, steps, settings=ReferenceSettings(substeps=4), extras=law)
    kappa = (-EI + np.sqrt(EI**2 + 4.0 * c * moment)) / (2.0 * c)
    angle = kappa * LENGTH
    tip = np.array([(1.0 - np.cos(angle)) / kappa, 0.0, np.sin(angle) / kappa])
    np.testing.assert_allclose(result.steps[0].tip, tip, atol=2e-7 * LENGTH)
    assert abs(angle - moment * LENGTH / EI) > 0.05


def test_a_force_that_depends_on_the_displacement_balances_the_load():
    """A cubic spring at the tip of a rod that hardly bends: u L^3-compliance and spring in series."""
    stiffness = 3.0 * EI / LENGTH**3
    u = 1e-3 * LENGTH
    cubic = 0.1 * stiffness / u**2
    force = stiffness * u + cubic * u**3
    spring = PointForce(LENGTH, lambda d: np.array([-cubic * d[0] ** 3, 0.0, 0.0]))
    steps = [LoadStep(loads={"tip": Load(LENGTH, (force, 0.0, 0.0))})]
    settings = ReferenceSettings(substeps=4)
    result = solve_reference(ROBOT, MODEL, steps, settings=settings, extras=Extras(forces=(spring,)))
    assert result.steps[0].tip[0] == pytest.approx(u, rel=1e-4)  # shear and shortening: below 1e-4


@pytest.mark.integration
@pytest.mark.parametrize("name", ["hardening", "drift of the camera"])
def test_a_blind_set_differs_from_the_declared_robot_above_the_noise(name):
    made = make_unlisted(next(r for r in RECIPES if r.name == name), 9000)
    assert LEAST_OFF <= made.declared_off <= MOST_OFF
    noise = [r.value - x for r, x in zip(made.data.readings, made.exact, strict=True)]
    sigma = [r.sigma for r in made.data.readings]
    assert np.std(np.array(noise) / sigma) == pytest.approx(1.0, abs=0.1)
    assert made.data.steps[-1].time is None


def judged(name, *kinds, effects=()):
    """The outcome of a set where causes of these kinds and these effects were found."""
    causes = [("", Kind(perturbs, tuple(depends_on))) for perturbs, *depends_on in kinds]
    causes += [(e, effect(e).kind) for e in effects]
    misfit = SimpleNamespace(rms_position=1e-3)
    errors = SimpleNamespace(held_out=misfit)
    result = SimpleNamespace(
        verdict="explained by a law found", before=errors, after=errors, noise=misfit,
        effects=[SimpleNamespace(name=n, found=bool(n), kind=kind, kind_probability=1.0) for n, kind in causes],
    )  # fmt: skip
    return judge(next(r for r in RECIPES if r.name == name), result, 1.0)


def test_a_set_passes_with_its_kind_and_dependence_alone_and_no_name():
    right = ("stiffness", "curvature")
    assert judged("hardening", right).passed
    assert not judged("hardening", right, effects=("superelastic",)).passed
    assert not judged("hardening", right, ("precurvature", "time")).right
    assert not judged("hardening", ("stiffness", "curvature", "place")).right
    assert not judged("hardening", ("moment", "curvature")).right
    assert not judged("hardening").right

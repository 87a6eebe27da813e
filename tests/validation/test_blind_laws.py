"""Laws of the reference, for blind sets: closed forms, and recipes that hide what no listed effect is."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from tdcr_fe.effects import EFFECTS
from tdcr_fe.identify.result import FoundCause
from tdcr_fe.identify.terms import BENDING, CURVATURE, DEFLECTION, DISPLACED, Term, where
from tdcr_fe.model.backbone import Backbone
from tdcr_fe.model.loading import Load, LoadStep, Model
from tdcr_fe.model.robot import Disks, Robot
from tdcr_fe.validation.blind.laws import LAWS, make_law_set
from tdcr_fe.validation.campaigns.blind_laws import judge
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


def test_laws_do_not_go_with_tendons_along_the_backbone():
    with pytest.raises(ValueError, match="a law of bending with tendon_path 'continuous'"):
        continuous = Model(tendon_path="continuous", friction="none")
        solve_reference(ROBOT, continuous, [LoadStep()], extras=Extras(bending=lambda b: b.strain[:, :2]))


def test_there_are_twelve_laws_and_none_is_a_listed_effect():
    assert len(LAWS) == 12 and len({r.name for r in LAWS}) == 12
    assert not {r.name for r in LAWS} & {e.name for e in EFFECTS}


@pytest.mark.integration
def test_a_blind_set_of_a_law_differs_from_the_declared_robot_far_above_the_noise():
    made = make_law_set(LAWS[0])
    assert made.declared_off > 10.0
    noise = [r.value - x for r, x in zip(made.data.readings, made.exact, strict=True)]
    sigma = [r.sigma for r in made.data.readings]
    assert np.std(np.array(noise) / sigma) == pytest.approx(1.0, abs=0.1)


def judged(name, *terms, effects=(), alternatives=(), after=0.0005):
    """The outcome of a set where these terms, as (product, where), were found."""
    found = tuple(FoundCause(p, "stiffness", ("curvature",), w, 1.0) for p, w in (*terms, *effects))
    law = SimpleNamespace(formula="m", alternatives=alternatives) if terms else None
    errors = [SimpleNamespace(rms_position=x) for x in (0.001, after)]
    result = SimpleNamespace(
        verdict="explained by a law found", law=law, effects=(), causes=found, data=SimpleNamespace(robot=ROBOT),
        before_held_out=errors[0], after_held_out=errors[1], noise=errors[0],
    )  # fmt: skip
    return judge(next(r for r in LAWS if r.name == name), result, 1.0)


def test_a_formula_is_right_with_the_product_of_its_recipe_and_nothing_else():
    hardening = ("|kappa| kappa", "everywhere")
    assert judged("hardening", hardening).right
    assert not judged("hardening", ("|kappa|^2 kappa", "everywhere")).right
    assert not judged("hardening", hardening, ("t e_x", "everywhere")).right
    assert not judged("hardening", hardening, effects=(("gravity", "everywhere"),)).right
    assert not judged("hardening").right
    assert judged("hardening", ("T kappa", "everywhere"), alternatives=("|kappa| kappa",)).among_others


def test_a_formula_at_one_place_is_right_at_that_place_only():
    """Of four bays and disks: the law acts in the third bay, the spring on the third disk."""
    edges = ROBOT.bay_edges
    for name, term, bay in (
        ("hardening in one bay", Term((CURVATURE,), BENDING, 2), 2),
        ("cubic spring", Term((DEFLECTION, DEFLECTION), DISPLACED, 2), 2),
    ):
        assert judged(name, (term.product, where(term, edges))).right
        assert not judged(name, (term.product, where(replace(term, bay=bay - 1), edges))).right
        assert not judged(name, (term.product, "everywhere")).right


def test_half_of_the_error_is_the_mark():
    assert judged("drift", after=0.0005).halved and not judged("drift", after=0.00051).halved

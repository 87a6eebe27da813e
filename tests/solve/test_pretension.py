"""Pretension of elastic tendons: tension where all displacements are zero."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from robots import BACKBONE, LENGTH, distance, solve, tendon, three

from tdcr_fe.model.loading import LoadStep, Model, resolve
from tdcr_fe.model.robot import Disks, Robot
from tdcr_fe.validation.reference import solve_reference

EA, T0 = 400.0, 0.7
HELD = {"t1": 0.0, "t2": 0.0, "t3": 0.0}


def tightened(mu: float = 0.0, tension: float = T0) -> Robot:
    """Three elastic tendons around a straight backbone."""
    return three(mu).with_tendons(axial_stiffness=EA, pretension=tension)


def moved(*values: float) -> LoadStep:
    """A load step with the displacements of the three tendons [m]."""
    return LoadStep(displacements=dict(zip(HELD, values, strict=True)))


def test_tension_at_displacement_zero_is_the_pretension_less_the_compression_of_the_backbone():
    """Strain e of backbone and tendons: T = T0 - EA_t e and EA_b e = 3 T, to first order in e."""
    result = solve(tightened(), [LoadStep(displacements=HELD)], friction="none")
    expected = T0 / (1.0 + 3.0 * EA / BACKBONE.EA)
    np.testing.assert_allclose(result.steps[0].base_tensions, expected, rtol=2e-3)
    np.testing.assert_allclose(result.steps[0].displacements, 0.0, atol=1e-15)


def test_pretension_is_displacement_that_was_pulled_in_before():
    """The same robot without pretension, every tendon pulled in by what the pretension stretches it."""
    before = LENGTH * (1.0 - 1.0 / (1.0 + T0 / EA))
    values = [(1.5e-3, -5e-4, 0.0), (-4e-4, 1e-3, 2e-4)]
    a = solve(tightened(0.2), [moved(*v) for v in values])
    b = solve(tightened(0.2, 0.0), [moved(*(x + before for x in v)) for v in values])
    # Their friction paths are interpolated from different states; the path's tolerance is 1e-5 of the length.
    assert distance(a.tips, b.tips) < 1e-6
    for x, y in zip(a.steps, b.steps, strict=True):
        np.testing.assert_allclose(x.base_tensions, y.base_tensions, atol=1e-5)


def test_a_tendon_let_out_is_slack_only_beyond_its_stretch():
    """One tendon on a backbone too stiff to bend: T = T0 + EA d / (L - d), and zero beyond."""
    stiff = Robot(
        replace(BACKBONE, radius=4e-3),
        Disks.equally_spaced(4, LENGTH),
        (tendon("t1", 0.0, 0.0, axial_stiffness=EA, pretension=T0),),
    )
    stretch = LENGTH * (1.0 - 1.0 / (1.0 + T0 / EA))
    values = np.array([0.5, 0.0, -0.5, -0.9, -1.1, -3.0, 0.2]) * stretch
    found = solve(stiff, [LoadStep(displacements={"t1": float(d)}) for d in values], friction="none")
    material = LENGTH - stretch
    expected = np.maximum(EA * (LENGTH / (material - values) - 1.0), 0.0)
    np.testing.assert_allclose([s.base_tensions[0] for s in found.steps], expected, atol=1e-3 * T0)


def test_tendons_that_no_step_names_are_held_at_displacement_zero():
    targets = resolve(tightened(), [LoadStep(displacements={"t1": 1e-3})])
    assert targets[0].by_displacement.all()
    assert targets[0].values.tolist() == [1e-3, 0.0, 0.0]
    assert not resolve(three(), [LoadStep()])[0].by_displacement.any()


@pytest.mark.integration
@pytest.mark.parametrize("friction", ["none", "per-hole", "per-tendon"])
def test_pretension_agrees_with_the_reference(friction):
    """Also where a tendon becomes slack, and on the way back."""
    robot = tightened(0.0 if friction == "none" else 0.2)
    steps = [moved(0.0, 0.0, 0.0), moved(2e-3, -1e-3, -1e-3), moved(-1e-3, 1e-3, -5e-3), moved(0.0, 0.0, 0.0)]
    ours = solve(robot, steps, friction=friction, elements_per_bay=2)
    theirs = solve_reference(robot, Model(friction=friction), steps)
    assert theirs.converged, theirs.message
    assert distance(ours.tips, theirs.tips) < 1e-5
    for a, b in zip(ours.steps, theirs.steps, strict=True):
        np.testing.assert_allclose(a.base_tensions, b.base_tensions, atol=2e-4 * T0)
    assert ours.steps[2].base_tensions[2] == 0.0


def test_an_inextensible_tendon_has_no_pretension():
    with pytest.raises(ValueError, match=r"tendons\[0\].pretension: 0.5; needs an elastic tendon"):
        three().with_tendons(pretension=0.5)

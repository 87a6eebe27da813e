"""The reference resolves the friction path of a load step by itself, and reports where it does not."""

from dataclasses import replace

import numpy as np
import pytest
from random_robots import largest_gap, random_robot, random_steps

from tdcr_fe.model.backbone import Backbone
from tdcr_fe.model.loading import LoadStep, Model
from tdcr_fe.model.robot import Disks, Robot
from tdcr_fe.model.routing import VaryingHelicalRouting
from tdcr_fe.model.tendon import Tendon
from tdcr_fe.solve.simulate import simulate
from tdcr_fe.validation.reference import ReferenceSettings, path, sequence, solve_reference
from tdcr_fe.validation.reference.path import LoadStepPath

MODEL = Model("straight", "per-hole")


@pytest.mark.campaign
@pytest.mark.parametrize("tendons", [1, 2, 3, 4, 5, 6])
def test_a_whole_step_agrees_with_the_step_divided_into_64(tendons):
    """Within 1e-4 of the length, or the step is flagged."""
    robot = random_robot(tendons, 1)
    steps = random_steps(robot, 1)
    whole = solve_reference(robot, MODEL, steps)
    cut = solve_reference(robot, MODEL, [replace(s, substeps=64) for s in steps])
    assert whole.converged and cut.converged
    resolved = np.array([s.details["refinement_error"] <= path.PATH_TOLERANCE for s in whole.steps])
    assert np.all(largest_gap(whole, cut)[resolved] < 1e-4)
    assert np.count_nonzero(resolved) >= 2


@pytest.mark.integration
def test_slip_that_ends_where_it_began_is_detected():
    """A tip force reverses the slip at a hole between the points of coarse substeps; compared with 512 substeps."""
    robot = random_robot(1, 16)
    steps = random_steps(robot, 16)[:2]
    whole = solve_reference(robot, MODEL, steps)
    cut = solve_reference(
        robot, MODEL, [replace(s, substeps=n) for s, n in zip(steps, (8, 512), strict=True)]
    )
    assert np.all(largest_gap(whole, cut) < 2e-5)


@pytest.mark.integration
def test_a_step_taken_whole_misses_slip_reversals():
    """The default of the reference at e3bbe5d: one substep, without a warning."""
    robot = random_robot(4, 1)
    steps = random_steps(robot, 1)
    single, cut, resolved = (
        solve_reference(robot, MODEL, steps, settings=ReferenceSettings(substeps=n)) for n in (1, 64, None)
    )
    assert np.max(largest_gap(single, cut)) > 10.0 * np.max(largest_gap(resolved, cut))
    assert all(np.isnan(s.details["refinement_error"]) for s in single.steps)


@pytest.mark.integration
def test_a_tolerance_that_is_not_met_is_reported_with_the_refinement_error(monkeypatch):
    for module in (path, sequence):
        monkeypatch.setattr(module, "PATH_TOLERANCE", 1e-9)
        monkeypatch.setattr(module, "MAX_BISECTIONS", 1)
    robot = random_robot(4, 1)
    result = solve_reference(robot, MODEL, random_steps(robot, 1))
    unresolved = [s for s in result.steps if s.details["refinement_error"] > 1e-9]
    assert unresolved
    assert len(result.warnings) == len(unresolved)
    for step, warning in zip(unresolved, result.warnings, strict=True):
        assert f"step {step.step} ({step.label}): path not resolved" in warning
        assert f"{step.details['refinement_error']:.1e} of the length" in warning


@pytest.mark.integration
def test_where_a_smaller_substep_does_not_converge_the_larger_is_kept_and_flagged(monkeypatch):
    """Every substep that ends between two 16ths of the load step fails here."""
    honest = LoadStepPath._substep

    def failing(self, start, factor):
        return None if (16.0 * factor) % 1.0 else honest(self, start, factor)

    for module in (path, sequence):
        monkeypatch.setattr(module, "PATH_TOLERANCE", 1e-12)
    monkeypatch.setattr(LoadStepPath, "_substep", failing)
    robot = random_robot(3, 1)
    result = solve_reference(robot, MODEL, random_steps(robot, 1))
    assert result.converged
    assert len(result.warnings) == 3
    assert max(s.substeps for s in result.steps) <= 16


def test_without_friction_halving_changes_nothing():
    robot = random_robot(3, 2)
    steps = random_steps(robot, 2)
    result = solve_reference(robot, Model("straight", "none"), steps)
    single = solve_reference(robot, Model("straight", "none"), steps, settings=ReferenceSettings(substeps=1))
    assert max(s.details["refinement_error"] for s in result.steps) < 1e-9
    assert np.max(largest_gap(result, single)) < 1e-9


@pytest.mark.parametrize("name", ["substeps", "presliding", "max_step"])
def test_settings_out_of_range_are_refused(name):
    with pytest.raises(ValueError, match=f"{name} = 0"):
        ReferenceSettings(**{name: 0})


@pytest.mark.integration
def test_finite_elements_take_a_helix_of_varying_pitch_as_the_reference_does():
    """The reference reads the routing's positions and slopes alone, so a new routing needs no change there."""
    routing = VaryingHelicalRouting(4.5e-3, 0.2, 1.5, 30.0)
    robot = Robot(
        Backbone(0.25, 0.4e-3, 85e9, 0.3), Disks.equally_spaced(10, 0.25), (Tendon("t", routing, 0.3),)
    )
    steps = [LoadStep(tensions={"t": x}, substeps=2) for x in (1.0, 0.6)]
    for model in (replace(MODEL, elements_per_bay=4), Model("continuous", "none", elements_per_bay=4)):
        own, other = simulate(robot, model, steps), solve_reference(robot, model, steps)
        assert np.linalg.norm(own.tips - other.tips, axis=1).max() < 5e-4 * 0.25

"""The reference resolves the friction path of a load step by itself, and reports where it does not."""

from dataclasses import replace

import numpy as np
import pytest
from random_robots import largest_gap, random_robot, random_steps

from tdcr_fe.model.loading import Model
from tdcr_fe.validation.reference import ReferenceSettings, path, sequence, solve_reference

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


@pytest.mark.parametrize("name", ["substeps", "presliding", "max_step"])
def test_settings_out_of_range_are_refused(name):
    with pytest.raises(ValueError, match=f"{name} = 0"):
        ReferenceSettings(**{name: 0})

"""Candidates whose model is not solved, or is impossible, end as such; the search goes on."""

from dataclasses import replace

import numpy as np
import pytest
from identify_data import MODEL, ROBOT, measured, problem_of

from tdcr_fe import NonlinearMaterial, effect
from tdcr_fe.identify import fitting
from tdcr_fe.identify.fitting import Race, descend
from tdcr_fe.identify.problem import Fit, evaluate
from tdcr_fe.identify.screening import screen


def test_a_candidate_that_is_not_solved_is_not_improved():
    """A search among places of a soft robot ended in a LinAlgError of the least squares."""
    values, lost = {"gravity": {"g_x": 0.0, "g_y": 0.0, "g_z": 0.0}}, np.full(6, np.nan)
    free = (("gravity", "g_x"),)
    unsolved = Fit((effect("gravity"),), values, lost, np.inf, np.inf, np.ones((6, 1)), free, None, lost)
    with pytest.raises(StopIteration) as done:
        next(descend(None, unsolved, Race()))
    assert done.value.value is unsolved


def hardening():
    """A problem whose declared backbone hardens."""
    law = NonlinearMaterial(cubic=5.0)
    robot = replace(ROBOT, backbone=replace(ROBOT.backbone, nonlinear=law))
    return problem_of(measured(robot=robot, model=replace(MODEL, gravity=(0.0, 0.0, -9.81))))


def test_laws_of_the_material_that_exclude_each_other_are_not_tried_together():
    """A search on a soft robot ended with "backbone.nonlinear: cannot be combined with superelastic"."""
    problem = hardening()
    declared = evaluate(problem, (), {})
    assert declared.solved
    both = [effect("superelastic"), effect("actuator_gain")]
    scores = {s.effect.name: s for s in screen(problem, declared, both)[0]}
    assert scores["superelastic"].note == "the robot cannot be combined with it"
    assert scores["actuator_gain"].note == "" and scores["actuator_gain"].start.points


def test_a_model_of_an_impossible_robot_counts_as_not_solved_with_the_reason():
    problem = hardening()
    both = (effect("superelastic"), effect("actuator_gain"))
    start = {"superelastic": {"threshold_strain": 0.01, "plateau_ratio": 0.2}, "actuator_gain": {"gain": 1.0}}
    fit = fitting.fit(problem, both, [start])
    assert not fit.solved
    assert "backbone.nonlinear: given; cannot be combined with superelastic" in fit.run.message

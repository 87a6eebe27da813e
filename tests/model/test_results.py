"""A result in Python: a summary of ten lines, data frames with the columns of the files, a table in notebooks."""

import dataclasses

import numpy as np
import pytest
from arcs import arc_result, arc_step, paper_robot

from tdcr_fe.model.loading import LoadStep


def test_a_result_prints_in_ten_lines():
    """Robot, model, steps, status, last step, tip, tension, displacement and warnings, each with its values."""
    result = dataclasses.replace(arc_result(paper_robot(2)), warnings=("step 2: first", "step 3: second"))
    last = result.steps[-1]
    text = str(result)
    assert repr(result) == text
    assert len(text.splitlines()) <= 10
    assert max(map(len, text.splitlines())) < 140
    for part in (
        "single-segment: 2 tendons, 13 disks, length 250 mm",
        f"friction {result.model.friction}",
        f"{len(result.steps)} solved;",
        f"({1e3 * last.tip[0]:.3f}, {1e3 * last.tip[1]:.3f}, {1e3 * last.tip[2]:.3f})",
        f"t2 {last.base_tensions[1]:.4g}",
        f"t1 {1e3 * last.displacements[0]:.3f}",
        f"t1 {last.tensions[0][-1]:.4g}",
        "2, the first: step 2: first",
    ):
        assert part in text


def test_angles_and_offset_of_an_arc_in_any_plane():
    step = arc_step(paper_robot(), 1, 1.2, 0.7, np.array([1.0]))
    assert (step.bending_angle, step.chord_angle) == pytest.approx((1.2, 0.6))
    assert step.tip_offset == pytest.approx(0.25 / 1.2 * (1.0 - np.cos(1.2)))


def test_a_failed_result_names_its_step_and_raises_when_asked():
    good = arc_result()
    assert good.raise_if_failed() is good
    message = "step 7 did not converge: use smaller load steps"
    failed = dataclasses.replace(good, converged=False, failed_step=7, message=message)
    assert "step 7 not" in str(failed) and failed.message in str(failed)
    with pytest.raises(RuntimeError, match="use smaller load steps"):
        failed.raise_if_failed()


def test_a_result_without_any_step_or_tendon_prints_too():
    ended = {"converged": False, "failed_step": 1, "message": "step 1 failed"}
    assert "0 solved, step 1 not" in str(dataclasses.replace(arc_result(), steps=(), **ended))
    robot = dataclasses.replace(paper_robot(), tendons=())
    assert "no tendons" in str(arc_result(robot, [LoadStep("still")]))


def test_a_notebook_shows_the_summary_and_the_steps_with_names_escaped():
    html = arc_result(dataclasses.replace(paper_robot(), name="<b>arm</b> & co"))._repr_html_()
    assert "&lt;b&gt;arm&lt;/b&gt; &amp; co" in html and "<b>" not in html
    assert "bending_angle_deg" in html and html.count("<table") == 2

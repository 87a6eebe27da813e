"""Pictures: each shows what it says, with units, for few steps and for many."""

from __future__ import annotations

import dataclasses

import matplotlib as mpl
import numpy as np
import pytest
from arcs import arc_result, paper_robot

from tdcr_fe.io.tables import PICTURE_FILES
from tdcr_fe.model.loading import LoadStep, Model
from tdcr_fe.model.robot import Robot
from tdcr_fe.report import plots


def axes_by_title(figure):
    return {ax.get_title(loc="left"): ax for ax in figure.axes}


def many_steps():
    return [LoadStep("", {"t1": 2.0 * abs(np.sin(k / 7)), "t2": 0.5}) for k in range(150)]


def test_pictures_are_written_and_settings_of_matplotlib_stay(tmp_path):
    before = dict(mpl.rcParams)
    written = plots.save_pictures(arc_result(), tmp_path, dpi=50)
    assert [p.name for p in written] == ["shapes.png", "tensions.png", "hysteresis.png"]
    assert all(p.read_bytes().startswith(b"\x89PNG") for p in written)
    assert dict(mpl.rcParams) == before


def test_shapes_are_drawn_to_scale_in_millimetres_with_every_step():
    result = arc_result()
    axes = axes_by_title(plots.shapes(result))
    side = axes["Seen along y"]
    assert (side.get_xlabel(), side.get_ylabel(), side.get_aspect()) == ("x [mm]", "z [mm]", 1.0)
    assert axes["Seen along x"].get_xlabel() == "y [mm]"
    ends = np.array([line.get_xydata()[-1] for line in side.lines])
    for tip in result.tips:
        assert np.min(np.linalg.norm(ends - 1e3 * tip[[0, 2]], axis=1)) < 1e-6


def test_straight_tendon_is_drawn_from_hole_to_hole_and_classical_one_along_the_backbone():
    result = arc_result()
    step, tendon = result.steps[4], result.robot.tendons[0]
    line = plots._tendon_line(result, step, tendon)
    assert len(line) == 14
    nodes = np.concatenate(([0], np.arange(2, 27, 2)))
    holes = step.positions[nodes] + 4.5e-3 * step.rotations[nodes][:, :, 0]
    assert line == pytest.approx(holes, abs=1e-9)
    classical = dataclasses.replace(result, model=Model("continuous", "none"))
    assert len(plots._tendon_line(classical, step, tendon)) == 120


def test_many_steps_are_thinned_and_explained_by_a_bar_not_a_legend():
    figure = plots.shapes(arc_result(paper_robot(3), many_steps()))
    assert (
        len(axes_by_title(figure)["Seen along y"].lines) < plots.DRAWN_STEPS + 3 * plots.DETAILED_STEPS + 10
    )
    (legend,) = figure.legends
    assert [t.get_text() for t in legend.get_texts()] == ["tendon t1", "tendon t2", "tendon t3"]
    assert "load step" in [ax.get_ylabel() for ax in figure.axes]


def test_tensions_are_steps_over_arc_length_for_each_tendon():
    result = arc_result(paper_robot(2))
    axes = axes_by_title(plots.tensions(result))
    ax = axes["tendon t1"]
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("arc length s [mm]", "tension [N]")
    drawn = [patch.get_data() for patch in ax.patches]
    assert any(np.array_equal(d.values, result.steps[4].tensions[0]) for d in drawn)
    assert drawn[0].edges == pytest.approx(1e3 * result.robot.hole_arc_lengths(result.robot.tendons[0]))
    assert "tendon t2" in axes


def test_hysteresis_is_drawn_where_a_tension_rises_and_falls():
    result = arc_result()
    ax = axes_by_title(plots.hysteresis(result))["tendon t1"]
    assert (ax.get_xlabel(), ax.get_ylabel()) == (
        "tension of t1 at the base [N]",
        "bending angle of the tip [deg]",
    )
    assert len(ax.lines) == len(result.steps) - 1


def test_no_hysteresis_where_tensions_only_rise(tmp_path):
    result = arc_result(steps=[LoadStep("", {"t1": t}) for t in (0.5, 1.0, 1.5)])
    assert plots.hysteresis(result) is None
    assert [p.name for p in plots.save_pictures(result, tmp_path, dpi=40)] == ["shapes.png", "tensions.png"]


def test_single_step_and_no_tendons_are_drawn(tmp_path):
    one = arc_result(steps=[LoadStep("", {"t1": 0.0})])
    assert plots.save_pictures(one, tmp_path, dpi=40)
    bare = Robot(one.robot.backbone, one.robot.disks)
    step = dataclasses.replace(
        one.steps[0],
        tensions=(),
        hole_states=(),
        base_tensions=np.zeros(0),
        displacements=np.zeros(0),
    )
    result = dataclasses.replace(one, robot=bare, steps=(step,))
    assert [p.name for p in plots.save_pictures(result, tmp_path, dpi=40)] == ["shapes.png"]
    with pytest.raises(ValueError, match="no tendons"):
        plots.tensions(result)


def test_every_picture_is_known_to_whom_replaces_them():
    assert tuple(plots.PICTURES) == PICTURE_FILES


def test_nothing_is_drawn_of_nothing(tmp_path):
    result = dataclasses.replace(arc_result(), steps=())
    assert plots.save_pictures(result, tmp_path) == []
    with pytest.raises(ValueError, match="no step was solved"):
        plots.shapes(result)

"""Pictures and videos: contents, labels and units, for few steps and for many, and of scenes."""

from dataclasses import replace

import matplotlib as mpl
import numpy as np
import pytest
from arcs import arc_result, arc_step, paper_robot
from PIL import Image
from robots import three
from scenes import scene

from tdcr_fe.elements.drives import DISPLACEMENT, TendonDrives
from tdcr_fe.model.loading import Actuation, Load, LoadStep, Model
from tdcr_fe.model.results import SequenceResult
from tdcr_fe.model.robot import Disks, Robot
from tdcr_fe.report import plots, video
from tdcr_fe.report.motion import between, geometry, motion_of
from tdcr_fe.report.plots import LoadArrows
from tdcr_fe.report.scene_picture import scene_picture
from tdcr_fe.report.video import times, write_video
from tdcr_fe.report.viewer import STATES, hole_codes


def axes_by_title(figure):
    return {ax.get_title(loc="left"): ax for ax in figure.axes}


def test_pictures_are_written_and_settings_of_matplotlib_stay(tmp_path):
    before, result = dict(mpl.rcParams), arc_result()
    result = replace(result, robot=replace(result.robot, name=r"no formula: $\frac$"))
    written = plots.save_pictures(result, tmp_path, dpi=50)
    assert [p.name for p in written] == ["shapes.png", "tensions.png", "hysteresis.png"]
    assert all(p.read_bytes().startswith(b"\x89PNG") for p in written)
    assert dict(mpl.rcParams) == before


def test_shapes_are_drawn_to_scale_in_millimetres_with_the_tip_of_every_step():
    result = arc_result()
    axes = axes_by_title(plots.shapes(result))
    side = axes["Seen along y"]
    assert (side.get_xlabel(), side.get_ylabel(), side.get_aspect()) == ("x [mm]", "z [mm]", 1.0)
    assert axes["Seen along x"].get_xlabel() == "y [mm]"
    drawn = np.concatenate([line.get_xydata() for line in side.lines])
    for tip in result.tips:
        assert np.min(np.linalg.norm(drawn - 1e3 * tip[[0, 2]], axis=1)) < 1e-6


def test_straight_tendon_is_drawn_from_hole_to_hole_and_classical_one_along_the_backbone():
    result = arc_result()
    motion = motion_of(result)
    step, line = result.steps[4], motion.tendon_points(4, motion.tendons[0])
    nodes = np.concatenate(([0], np.arange(2, 27, 2)))
    assert line == pytest.approx(step.positions[nodes] + 4.5e-3 * step.rotations[nodes][:, :, 0], abs=1e-9)
    classical_model = Model("continuous", "none")
    classical = motion_of(replace(result, model=classical_model))
    assert len(classical.tendon_points(4, classical.tendons[0])) == 6 * 13 + 1
    soft = geometry(replace(result, robot=replace(result.robot, disks=Disks(())), model=classical_model))
    assert len(soft["tendons"][0]["path"]) == 37  # without disks it had six sides


def test_tensions_are_steps_over_arc_length():
    result = arc_result(paper_robot(2))
    drawn = [patch.get_data() for patch in axes_by_title(plots.tensions(result))["tendon t1"].patches]
    assert any(np.array_equal(d.values, result.steps[4].tensions[0]) for d in drawn)
    assert drawn[0].edges == pytest.approx(1e3 * result.robot.hole_arc_lengths(result.robot.tendons[0]))
    second = plots.tensions(arc_result(paper_robot(2), [LoadStep("", {"t2": 1.0})]))
    # Limits were those of the first.
    assert axes_by_title(second)["tendon t2"].get_ylim()[1] > 1.0


def test_what_there_is_is_drawn(tmp_path):
    """No steps: nothing. One step, or tensions that only rise: no hysteresis. No tendons: the shapes."""
    assert plots.save_pictures(replace(arc_result(), steps=()), tmp_path) == []
    one = arc_result(steps=[LoadStep("", {"t1": 0.0})])
    rising = arc_result(steps=[LoadStep("", {"t1": t}) for t in (0.5, 1.0, 1.5)])
    assert plots.hysteresis(one) is None is plots.hysteresis(rising)
    bare = Robot(one.robot.backbone, one.robot.disks)
    written = plots.save_pictures(arc_result(bare, [LoadStep()]), tmp_path, dpi=40)
    assert [p.name for p in written] == ["shapes.png"]


@pytest.mark.parametrize("draw", [plots.shapes, plots.tensions, plots.hysteresis], ids=lambda f: f.__name__)
def test_title_and_legend_of_six_tendons_lie_apart_from_the_axes(draw):
    """In 0.1 the title lay on those of the axes, and the second row of the legend on their labels.

    Two segments: three tendons end at the middle disk, three at the tip.
    """
    one = paper_robot(6)
    ends = [one.disks.positions[6]] * 3 + [None] * 3
    names = [f"{part}{k}" for part in ("proximal", "distal") for k in (1, 2, 3)]
    tendons = tuple(replace(t, name=n, end=e) for t, n, e in zip(one.tendons, names, ends, strict=True))
    robot = replace(one, tendons=tendons, name="two segments, six tendons")
    steps = [LoadStep("", dict.fromkeys(names, value)) for value in (0.2, 0.4, 0.6, 0.4, 0.2)]
    figure = draw(arc_result(robot, steps))
    figure.draw_without_rendering()
    title, legend = (text.get_window_extent() for text in (figure.texts[0], figure.legends[0]))
    extents = [ax.get_tightbbox() for ax in figure.axes if ax.get_visible()]
    assert extents and not any(x.overlaps(title) or x.overlaps(legend) for x in extents)
    assert legend.x0 >= 0.0 and legend.x1 <= figure.bbox.width


def test_labels_of_a_wide_robot_in_space_lie_apart_from_the_view_beside_it():
    robot = paper_robot()
    steps = tuple(arc_step(robot, k + 1, 1.8, k * np.pi, np.ones(1)) for k in range(2))
    figure = plots.shapes(SequenceResult(robot, Model(), steps))
    figure.draw_without_rendering()
    space, side, *_ = figure.axes
    assert space.zaxis.label.get_window_extent().x1 < side.get_tightbbox().x0


@pytest.mark.parametrize("by_displacement", [False, True])
def test_hysteresis_is_drawn_over_the_input(by_displacement):
    """0.1 drew the tension that follows in place of a displacement."""
    result, given = arc_result(), "base_tensions"
    if by_displacement:
        driven, given = TendonDrives((DISPLACEMENT,), np.ones(1)), "displacements"
        moved = [replace(s, actuation=Actuation(driven, s.displacements)) for s in result.steps]
        result = replace(result, steps=tuple(moved))
    (line, *_), steps = axes_by_title(plots.hysteresis(result))["tendon t1"].lines, result.steps[:2]
    assert line.get_xdata() == pytest.approx([1e3**by_displacement * getattr(s, given)[0] for s in steps])
    assert line.get_ydata() == pytest.approx(np.degrees([s.bending_angle for s in steps]))


def test_loads_and_gravity_are_drawn_as_arrows_to_scale():
    """0.1 drew neither."""
    mid = Load(0.125, force=(0.025, 0.0, 0.0), moment=(0.0, 0.0, 1e-3))
    loads = {"tip": Load(0.25, force=(0.0, 0.05, 0.0)), "mid": mid}
    result = arc_result(None, [LoadStep("", {"t1": 0.5}, loads=loads)], Model(gravity=(0.0, 0.0, -9.81)))
    step = result.steps[0]
    motion = motion_of(result)
    (tip, force, moment) = motion.load_arrows(0)
    assert tip[1] == pytest.approx(step.tip) and (tip[3], force[3], moment[3]) == (False, False, True)
    lengths = [np.linalg.norm(vector) for _, vector, _ in LoadArrows(motion, [0]).arrows]
    assert lengths == pytest.approx([0.2 * 250.0, 0.1 * 250.0, 0.2 * 250.0])
    front = axes_by_title(plots.shapes(result))["Seen along x"]
    # The force along y; the moment along z with two heads; gravity. The force along x is seen end on.
    assert len([t.arrow_patch for t in front.texts if getattr(t, "arrow_patch", None)]) == 4
    assert front.get_xlim()[1] > 1e3 * step.tip[1] + 0.2 * 250.0


def test_a_load_that_follows_the_section_is_turned_with_it():
    loads = {"tip": Load(0.25, force=(0.0, 0.0, 1.0), frame="section")}
    result = arc_result(steps=[LoadStep("", {"t1": t}, loads=loads) for t in (0.5, 1.0)])
    motion = motion_of(result)
    for k, step in enumerate(result.steps):
        assert motion.load_arrows(k)[0][2] == pytest.approx(step.tangent)


def test_a_slack_tendon_is_called_slack():
    """In 0.1 its holes were drawn as slipping or sticking."""
    result = arc_result(paper_robot(2), [LoadStep("", {"t1": t}) for t in (0.5, 1.0)])
    figure = plots.tensions(result)
    assert [t.get_text() for t in axes_by_title(figure)["tendon t2"].texts] == ["slack in every step drawn"]
    assert not axes_by_title(figure)["tendon t1"].texts
    assert "tendon slack" in [t.get_text() for t in figure.legends[0].get_texts()]
    pulled, loose = hole_codes(motion_of(result))
    assert set(loose[0, :-1]) == {STATES.index("slack")} and STATES.index("slack") not in pulled[0]


# ------------------------------------------------------------ scene picture


def test_a_robot_and_its_tendons_are_drawn_without_a_display(monkeypatch):
    monkeypatch.delenv("DISPLAY", raising=False)
    container, _mbs, _handle = scene(three())
    drawn = scene_picture(container, center=[0.0, 0.0, 0.12], height=0.28, size=(450, 350))
    assert drawn.shape[:2] == (350, 450)
    drawn = drawn[..., :3] / (255.0 if drawn.max() > 1.0 else 1.0)
    # Backbone and disks, and the three tendons in their colours.
    assert (drawn.min(axis=2) < 0.7).mean() > 0.005
    red, green, blue = drawn[..., 0], drawn[..., 1], drawn[..., 2]
    for seen in (red > blue + 0.3, blue > red + 0.3, (green > red + 0.2) & (green > blue + 0.1)):
        assert seen.sum() > 20


# ------------------------------------------------------------ video


def short(count):
    result = arc_result(paper_robot(2))
    return motion_of(replace(result, steps=result.steps[:count]))


@pytest.mark.parametrize("count", [1, 12, 500])
def test_every_load_step_has_its_picture(count):
    found = times(count)
    assert set(range(count)) <= set(found.round(9))
    assert found[-1] == count - 1 and len(found) <= video.PER_STEP * max(count, 1)
    assert count != 500 or len(found) == 500


def test_between_two_steps_positions_are_halfway_and_rotations_turn_by_half():
    motion = short(3)
    middle = between(motion, 0.5)
    assert middle.positions[0] == pytest.approx(motion.positions[:2].mean(axis=0), abs=1e-15)
    assert np.linalg.norm(middle.rotations, axis=-1) == pytest.approx(1.0)
    whole = np.degrees(motion.bending_angles)
    assert np.degrees(middle.bending_angles[0]) == pytest.approx(whole[:2].mean(), abs=1e-6)
    assert middle.tensions[0][0] == pytest.approx(motion.tensions[0][:2].mean(axis=0))
    end = between(motion, 2.0)
    assert np.array_equal(end.positions[0], motion.positions[2]) and end.steps == (3,)


def test_a_gif_has_all_pictures_and_they_differ(tmp_path):
    motion, said = short(2), []
    with Image.open(write_video(motion, tmp_path / "robot.gif", said.append)) as picture:
        assert picture.n_frames == len(times(2)) == len(said)
        assert picture.size == (960, 500)
        frames = []
        for k in (0, picture.n_frames - 1):
            picture.seek(k)
            frames.append(np.asarray(picture.convert("RGB")))
    assert np.count_nonzero(np.any(frames[0] != frames[1], axis=-1)) > 500
    assert [p.name for p in tmp_path.iterdir()] == ["robot.gif"]


def test_an_interrupted_video_leaves_no_file(tmp_path):
    def stop(share):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        write_video(short(2), tmp_path / "robot.gif", stop)
    assert list(tmp_path.iterdir()) == []

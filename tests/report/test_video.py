"""Videos: one picture for every time, and what is between two load steps."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from arcs import arc_result, paper_robot
from PIL import Image

from tdcr_fe.report import video
from tdcr_fe.report.motion import between, motion_of
from tdcr_fe.report.video import times, write_video


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
    motion, said = short(3), []
    path = write_video(motion, tmp_path / "robot.gif", said.append)
    with Image.open(path) as picture:
        assert picture.n_frames == len(times(3)) == len(said) == 13
        assert picture.size == (960, 500)
        frames = []
        for k in (0, 12):
            picture.seek(k)
            frames.append(np.asarray(picture.convert("RGB")))
    assert np.count_nonzero(np.any(frames[0] != frames[1], axis=-1)) > 500
    assert [p.name for p in tmp_path.iterdir()] == ["robot.gif"]


def test_a_path_that_cannot_be_a_video_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(video.shutil, "which", lambda name: None)
    with pytest.raises(ValueError, match=r"needs the program ffmpeg, which is not installed"):
        write_video(short(1), tmp_path / "robot.mp4")
    with pytest.raises(ValueError, match=r"must end in \.gif or \.mp4"):
        write_video(short(1), tmp_path / "robot.avi")
    assert list(tmp_path.iterdir()) == []


def test_an_interrupted_video_leaves_no_file(tmp_path):
    def stop(share):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        write_video(short(2), tmp_path / "robot.gif", stop)
    assert list(tmp_path.iterdir()) == []

"""``tdcr-fe view`` as users call it: where the page goes, and what is wrong with a folder."""

import json
from dataclasses import replace
from unittest.mock import Mock

import pytest
from arcs import arc_result
from inputs import said

from tdcr_fe import LoadStep, cli, write_results
from tdcr_fe.report import video


@pytest.fixture
def folder(tmp_path):
    write_results(arc_result(), tmp_path / "out", pictures=False)
    return tmp_path / "out"


def test_the_page_goes_beside_the_results_or_where_it_is_asked_for(folder, tmp_path, capsys, monkeypatch):
    assert cli.main(["view", str(folder)]) == 0
    assert "single-segment: 10 load steps, 13 disks, 1 tendon. Written: " in capsys.readouterr().out
    assert cli.main(["view", str(folder), "-o", str(tmp_path / "new" / "robot.html"), "-q"]) == 0
    assert (folder / "view.html").read_bytes() == (tmp_path / "new" / "robot.html").read_bytes()
    assert capsys.readouterr().out == ""
    monkeypatch.setattr(video, "write_video", Mock(side_effect=KeyboardInterrupt))
    # As if there were no page.
    assert "; no further results were" in said(capsys, 130, "view", folder, "--video", tmp_path / "robot.gif")


def test_a_folder_without_results_or_a_solved_step_is_refused(tmp_path, capsys):
    allowed = "must be a folder with results of tdcr-fe run, follow or identify (of one folder)"
    assert f"summary.json is missing; {allowed}" in said(capsys, 2, "view", tmp_path)
    assert list(tmp_path.iterdir()) == []
    write_results(replace(arc_result(), steps=(), converged=False, failed_step=1), tmp_path)
    assert "no step was solved, so there is nothing to draw" in said(capsys, 2, "view", tmp_path)


@pytest.mark.parametrize("file", ["summary.json", "steps.csv", "shape.csv", "tensions.csv"])
def test_a_missing_or_broken_file_is_named(folder, file, capsys):
    path = folder / file
    text = path.read_text()
    for broken in ("", "step\n1\n", text[: len(text) // 2], "\0\1"):
        path.write_text(broken)
        err = said(capsys, 2, "view", folder)
        assert file in err and "Traceback" not in err
        assert not (folder / "view.html").exists()
    path.unlink()
    assert f"{file} is missing" in said(capsys, 2, "view", folder)


def test_results_of_the_version_before_are_refused_with_what_to_do(folder, capsys):
    path = folder / "summary.json"
    found = json.loads(path.read_text())
    del found["geometry"]
    path.write_text(json.dumps(found))
    words = "geometry: missing; written since version 0.2: run the scenario again"
    assert words in said(capsys, 2, "view", folder)


@pytest.mark.integration
def test_video_and_vtk_are_written_beside_the_page(tmp_path, capsys):
    folder = tmp_path / "two steps"
    write_results(arc_result(steps=[LoadStep("", {"t1": t}) for t in (0.5, 1.0)]), folder, pictures=False)
    args = ["view", str(folder), "--vtk", str(tmp_path / "vtk"), "--video", str(tmp_path / "robot.gif")]
    assert cli.main(args) == 0
    out = capsys.readouterr().out
    assert "robot.pvd and 2 files next to it" in out and "robot.gif (" in out
    assert len(list((tmp_path / "vtk").iterdir())) == 3
    assert (tmp_path / "robot.gif").read_bytes()[:4] == b"GIF8"


def test_a_video_that_cannot_be_written_is_refused_before_anything_is(folder, tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(video.shutil, "which", lambda name: None)
    text = said(capsys, 2, "view", folder, "--video", tmp_path / "robot.mp4", "--vtk", tmp_path / "vtk")
    assert "robot.mp4: needs the program ffmpeg, which is not installed; install it, or write a .gif" in text
    wrong = "--video", tmp_path / "robot.avi", "--vtk", folder / "steps.csv", "-o"
    text = said(capsys, 2, "view", folder, *wrong, "x.pdf")  # one after the other in 0.2
    words = "3 mistakes", "must end in .gif or .mp4", "must be a file that ends in .html", "--vtk = "
    assert all(x in text for x in words), text
    assert "is a directory; must be a file" in said(capsys, 2, "view", folder, "-o", folder)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["out"] and not (folder / "view.html").exists()

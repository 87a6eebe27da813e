"""Files are written completely, or keep their old contents."""

import errno
import json
import math
from functools import partial

import numpy as np
import pytest

from tdcr_fe.io.files import InputError, check_output_folder, write_folder, write_json, write_text


def test_text_is_written_with_its_folder_and_replaces_what_was_there(tmp_path):
    path = tmp_path / "a" / "b.txt"
    for text in ("één\n", "two\n"):
        write_text(text, path)
        assert path.read_bytes() == text.encode()
    assert [p.name for p in path.parent.iterdir()] == ["b.txt"]
    # Text that cannot be moved into place leaves nothing behind.
    with pytest.raises(OSError):
        write_text("text", path.parent)
    assert [p.name for p in tmp_path.iterdir()] == ["a"]


def test_a_complete_run_removes_what_a_killed_one_left(tmp_path):
    """Six kills had left six hidden folders."""
    (tmp_path / ".out.partial" / "inside").mkdir(parents=True)
    write_folder(tmp_path / "out", lambda folder: (folder / "a.csv").write_text("whole"))
    assert [p.name for p in tmp_path.iterdir()] == ["out"]
    assert [p.name for p in (tmp_path / "out").iterdir()] == ["a.csv"]


def test_json_has_null_for_numbers_that_are_not_finite_and_lists_for_arrays(tmp_path):
    path = tmp_path / "x.json"
    write_json({"a": math.nan, "b": np.arange(2.0), "c": np.float64(0.5), "d": (1, math.inf)}, path)
    assert json.loads(path.read_text()) == {"a": None, "b": [0.0, 1.0], "c": 0.5, "d": [1, None]}


@pytest.mark.parametrize("existed", [True, False])
@pytest.mark.parametrize("reason", [KeyboardInterrupt, partial(OSError, errno.ENOSPC, "No space left")])
def test_folder_that_fails_halfway_stays_as_it_was(tmp_path, existed, reason):
    """A full disk is reported with the folder."""
    out = tmp_path / "out"
    if existed:
        out.mkdir()
        (out / "old.csv").write_text("old")

    def write(folder):
        (folder / "old.csv").write_text("new")
        raise reason()

    with pytest.raises((KeyboardInterrupt, OSError)) as error:
        write_folder(out, write)
    assert getattr(error.value, "filename", str(out)) == str(out)
    assert out.exists() == existed
    assert not existed or [p.read_text() for p in out.iterdir()] == ["old"]
    assert [p.name for p in tmp_path.iterdir()] == ["out"] * existed


def test_folder_loses_files_of_an_earlier_run_and_keeps_others(tmp_path):
    for name in ("mine.txt", "picture.png", "old.csv"):
        (tmp_path / name).write_text(name)
    ours = ("old.csv", "picture.png")
    written = write_folder(tmp_path, lambda f: (f / "old.csv").write_text("new"), ours=ours)
    assert written == [tmp_path / "old.csv"]
    assert {p.name: p.read_text() for p in tmp_path.iterdir()} == {"mine.txt": "mine.txt", "old.csv": "new"}


def test_an_output_folder_that_cannot_be_one_is_refused(tmp_path):
    (tmp_path / "file").write_text("")
    (tmp_path / "link").symlink_to("nowhere")
    for bad, words in (("file", "is a file"), ("file/deeper", "is a file"), ("link", "is a link to nowhere")):
        with pytest.raises(InputError, match=f"{words}; must be a directory"):
            check_output_folder(tmp_path / bad)
    assert check_output_folder(tmp_path / "new" / "deep") == tmp_path / "new" / "deep"

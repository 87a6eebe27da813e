"""Records of many cases: kept as they are found, and recalled."""

from __future__ import annotations

import json
from contextlib import closing

import pytest

from tdcr_fe.io.store import Folder, Lines, OtherHead, solve_all

HEAD = {"source": "abc", "n": 3}


def square(x):
    return {"square": x * x}


def solved(store, tasks, **more):
    with closing(solve_all(tasks, square, store, own_process=False, **more)) as found:
        return list(found)


def stores(tmp_path):
    lines = Lines(tmp_path / "records.jsonl", HEAD)
    lines.begin_or_check()
    return [Folder(tmp_path / "plain"), Folder(tmp_path / "digest", digest=lambda key: "d" + key), lines]


@pytest.mark.parametrize("kind", range(3))
def test_what_is_kept_is_not_solved_again(tmp_path, kind):
    store = stores(tmp_path)[kind]
    assert solved(store, {"2": 2}) == [("2", {"square": 4}, False)]
    assert solved(store, {"2": 2, "3": 3}) == [("2", {"square": 4}, True), ("3", {"square": 9}, False)]
    again = solved(store, {"2": 2, "3": 3}, again=lambda record: record["square"] == 9)
    assert again == [("2", {"square": 4}, True), ("3", {"square": 9}, False)]
    assert dict(store.recall(["3"])) == {"3": {"square": 9}}


@pytest.mark.parametrize("kind", range(3))
def test_an_interruption_keeps_what_was_found(tmp_path, kind):
    store = stores(tmp_path)[kind]
    with closing(solve_all({str(k): k for k in range(5)}, square, store, own_process=False)) as found:
        for _ in range(2):
            next(found)
    known = [key for key, _, known in solved(store, {str(k): k for k in range(5)}) if known]
    assert known == ["0", "1"]


@pytest.mark.integration
def test_processes_find_the_same(tmp_path):
    store = Folder(tmp_path)
    with closing(solve_all({str(k): k for k in range(7)}, square, store, processes=2)) as found:
        assert sorted((int(key), record["square"]) for key, record, _ in found) == [
            (k, k * k) for k in range(7)
        ]
    assert len(list(tmp_path.iterdir())) == 7


def test_a_record_of_another_digest_or_a_broken_file_is_solved_again(tmp_path):
    store = Folder(tmp_path, digest=lambda key: "new", about={"versions": {"numpy": "2"}})
    store.keep("1", {"square": 1})
    assert json.loads(store.path("1").read_text())["versions"] == {"numpy": "2"}
    assert list(Folder(tmp_path, digest=lambda key: "other").recall(["1"])) == []
    for text in ("", "{", "[]", '{"digest": "new"}', '{"digest": "new", "record": 3}'):
        store.path("1").write_text(text)
        assert list(store.recall(["1", "2"])) == []


def test_a_line_that_a_kill_cut_off_is_removed(tmp_path):
    store = Lines(tmp_path / "r.jsonl", HEAD)
    store.begin()
    store.keep("1", {"square": 1})
    whole = store.path.read_bytes()
    for rest in (b'{"key": "2", "squ', b'{"key": "2", "square": 4}'):
        store.path.write_bytes(whole + rest)
        assert list(store.recall(["1", "2"])) == [("1", {"square": 1})]
        assert store.path.read_bytes() == whole


def test_lines_of_another_run_are_not_touched(tmp_path):
    path = tmp_path / "r.jsonl"
    Lines(path, HEAD).begin()
    with pytest.raises(OtherHead, match="n differ") as caught:
        Lines(path, {**HEAD, "n": 4}).begin_or_check()
    assert caught.value.differing == ("n",)
    path.write_text("no head\n")
    with pytest.raises(OtherHead, match="does not begin with a head"):
        list(Lines(path, HEAD).records())
    assert path.read_text() == "no head\n"

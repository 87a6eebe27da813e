"""Records of many cases: kept as they are found, and recalled."""

from __future__ import annotations

from contextlib import closing

import pytest

from tdcr_fe.io.store import Lines, OtherHead, solve_all

HEAD = {"source": "abc", "n": 3}


def square(x):
    return {"square": x * x}


def solved(store, tasks, **more):
    with closing(solve_all(tasks, square, store, own_process=False, **more)) as found:
        return list(found)


@pytest.fixture
def store(tmp_path):
    lines = Lines(tmp_path / "records.jsonl", HEAD)
    lines.begin_or_check()
    return lines


def test_what_is_kept_is_not_solved_again(store):
    assert solved(store, {"2": 2}) == [("2", {"square": 4}, False)]
    assert solved(store, {"2": 2, "3": 3}) == [("2", {"square": 4}, True), ("3", {"square": 9}, False)]
    again = solved(store, {"2": 2, "3": 3}, again=lambda record: record["square"] == 9)
    assert again == [("2", {"square": 4}, True), ("3", {"square": 9}, False)]
    assert dict(store.recall(["3"])) == {"3": {"square": 9}}


def test_an_interruption_keeps_what_was_found(store):
    with closing(solve_all({str(k): k for k in range(5)}, square, store, own_process=False)) as found:
        for _ in range(2):
            next(found)
    known = [key for key, _, known in solved(store, {str(k): k for k in range(5)}) if known]
    assert known == ["0", "1"]


@pytest.mark.integration
def test_processes_find_the_same(store):
    with closing(solve_all({str(k): k for k in range(7)}, square, store, processes=2)) as found:
        records = sorted((int(key), record["square"]) for key, record, _ in found)
    assert records == [(k, k * k) for k in range(7)]
    assert len(dict(store.recall(map(str, range(7))))) == 7


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

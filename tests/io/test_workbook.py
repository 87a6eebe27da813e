"""Excel workbooks give the data that CSV gives, or are refused with the reason."""

from __future__ import annotations

import datetime
import sys

import pytest
from inputs import ROBOT, write

from tdcr_fe.io.measured import read_measured
from tdcr_fe.io.problems import InputError
from tdcr_fe.io.spreadsheet import read_table

openpyxl = pytest.importorskip("openpyxl")

HEADER = ["step", "quantity", "location", "value", "sigma"]
ROWS = [[1, "position_x", 0.25, -1.5e-3, 1e-4], [2, "tendon_displacement", "t1", 0.125, None]]


def workbook(path, rows, title="Sheet"):
    book = openpyxl.Workbook()
    book.active.title = title
    for row in rows:
        book.active.append(row)
    book.create_sheet("notes").append(["not read"])
    book.save(path)
    return path


def problem(path):
    with pytest.raises(InputError) as caught:
        read_table(path)
    return str(caught.value.problems[0])


@pytest.mark.parametrize("name", ["t.xlsx", "t.csv"])
def test_the_first_sheet_is_the_table(tmp_path, name):
    """Also where the file is called .csv; numbers come with a point, whatever the spreadsheet shows."""
    path = workbook(tmp_path / name, [[], [*HEADER, None], *ROWS[:1], [None, "  "], *ROWS[1:]])
    table = read_table(path)
    assert list(table.columns) == HEADER
    assert table.to_numpy().tolist() == [
        ["1", "position_x", "0.25", "-0.0015", "0.0001"],
        ["2", "tendon_displacement", "t1", "0.125", ""],
    ]
    assert list(table.index) == [3, 5]


def test_a_folder_may_have_workbooks_in_place_of_tables(tmp_path):
    folder = tmp_path / "set"
    folder.mkdir()
    write(folder, robot=ROBOT)
    loading = [["step", "tension_t1", "branch"], [1, 0.5, "up"], [2, 1, "up"]]
    rows = [[k, "position_x", 0.25, 0.01 * k, 1e-4] for k in (1, 2)]
    workbook(folder / "loading.xlsx", loading)
    workbook(folder / "observations.xlsx", [HEADER, *rows])
    data = read_measured(folder)
    assert [s.tensions for s in data.steps] == [{"t1": 0.5}, {"t1": 1.0}]
    assert [r.value for r in data.readings] == [0.01, 0.02]
    assert set(data.digests) == {"robot.toml", "loading.xlsx", "observations.xlsx"}


def test_what_is_wrong_is_named_by_cell(tmp_path):
    """Spreadsheets turn 1.5 into the first of May where the decimal mark is a comma."""
    rows = [["step", "value"], [1, datetime.date(2026, 5, 1)], [2, "#DIV/0!"]]
    text = problem(workbook(tmp_path / "t.xlsx", rows, "Data"))
    assert "sheet Data, cell B2 = 2026-05-01" in text and "is a date or a time" in text
    with pytest.raises(InputError, match=r"cell B3 = #DIV/0!: is an error of a formula"):
        read_table(tmp_path / "t.xlsx")


def test_files_that_are_no_workbooks_are_refused(tmp_path):
    (tmp_path / "zip.xlsx").write_bytes(b"PK\x03\x04" + 60 * b"\0")
    assert "is not an Excel workbook that can be read" in problem(tmp_path / "zip.xlsx")
    (tmp_path / "old.xls").write_bytes(b"\xd0\xcf\x11\xe0" + 60 * b"\0")
    assert "is a workbook of the old Excel format (xls); save it as xlsx or CSV" in problem(
        tmp_path / "old.xls"
    )
    assert "is empty; must have a header" in problem(workbook(tmp_path / "empty.xlsx", []))


def test_without_openpyxl_the_error_names_the_extra(tmp_path, monkeypatch):
    path = workbook(tmp_path / "t.xlsx", [HEADER, *ROWS])
    monkeypatch.setitem(sys.modules, "openpyxl", None)
    assert problem(path).endswith("save it as CSV, or install openpyxl: pip install 'tdcr-fe[xlsx]'")

"""Tables of any spreadsheet, also as workbooks, give the same data; an ambiguous file is refused with the reason."""

from __future__ import annotations

import csv
import datetime
import io
import sys

import pytest
from inputs import ROBOT, write

from tdcr_fe.io.measured import read_measured
from tdcr_fe.io.problems import InputError
from tdcr_fe.io.spreadsheet import read_table

HEADER = ["step", "quantity", "location", "value", "sigma"]
ROWS = [
    ["1", "position_x", "0.25", "-1.5e-3", "0.0001"],
    ["1", "tendon_displacement", "t, left", "0.125", ""],
    ["2", "bending_angle", "", "1", "0.5"],
]


def text(delimiter=",", decimal=".", quoting=csv.QUOTE_MINIMAL, end="\n"):
    out = io.StringIO()
    writer = csv.writer(out, delimiter=delimiter, quoting=quoting, lineterminator=end)
    writer.writerow(HEADER)
    for row in ROWS:
        writer.writerow([x.replace(".", decimal) for x in row])
    return out.getvalue()


def problem(path):
    with pytest.raises(InputError) as caught:
        read_table(path)
    (found,) = caught.value.problems
    return found


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "utf-16-le", "utf-16-be"])
@pytest.mark.parametrize("end", ["\n", "\r\n"])
@pytest.mark.parametrize("quoting", [csv.QUOTE_MINIMAL, csv.QUOTE_ALL], ids=["few quotes", "all quoted"])
@pytest.mark.parametrize(
    ("delimiter", "decimal"), [(",", "."), (";", ","), (";", "."), ("\t", ","), ("\t", ".")]
)
def test_every_dialect_gives_the_same_table(tmp_path, delimiter, decimal, quoting, end, encoding):
    """In 0.1 semicolons gave "missing column" five times, and UTF-16 the error of pandas."""
    path = tmp_path / "t.csv"
    path.write_bytes(text(delimiter, decimal, quoting, end).encode(encoding))
    table = read_table(path)
    assert list(table.columns) == HEADER
    assert table.to_numpy().tolist() == ROWS
    assert list(table.index) == [2, 3, 4]


def test_decimal_commas_in_quotes_are_taken(tmp_path):
    path = tmp_path / "t.csv"
    path.write_text('step,value\n1,"0,5"\n2,"-1,25e-3"\n')
    assert read_table(path).value.tolist() == ["0.5", "-1.25e-3"]


def test_hint_of_excel_blank_rows_and_empty_columns_at_the_end_are_skipped(tmp_path):
    path = tmp_path / "t.csv"
    path.write_text("sep=;\nstep;value;;\n\n1;0,5;;\n;;;\n2;1,5;;\n")
    table = read_table(path)
    assert (list(table.columns), table.value.tolist(), list(table.index)) == (
        ["step", "value"],
        ["0.5", "1.5"],
        [4, 6],
    )


def test_text_with_a_comma_is_no_number(tmp_path):
    path = tmp_path / "t.csv"
    path.write_text("step;branch;value\n1;a,5;0,5\n2;1,2,3;0,25\n")
    table = read_table(path)
    assert table.branch.tolist() == ["a,5", "1,2,3"]


@pytest.mark.parametrize(
    ("content", "key", "word"),
    [
        ("step;value\n1;0,5\n2;0.5\n", "line 2, value", "decimal: line 3, value has 0.5"),
        ("step;value\n1;1,234\n2;5,678\n", "line 2, value", "decimal: may be a decimal comma or a thousands"),
        ("step;value\n1;1.234,5\n", "line 2, value", "decimal: remove the thousands separators"),
        ("step;value,sigma\n1;0,5\n", "line 1", "delimiter: the header has comma and semicolon"),
        ("step,value\n1,0,5\n", "line 2", "has 3 cells; the header has 2; where these are decimal commas"),
        ("step,value,value\n1,2,3\n", "value", "the column appears more than once"),
        ('step,value\n1,"2\n', "line 2", "not a table"),
        ("", "", "is empty"),
        (b"PK\x03\x04rest", "", "is not an Excel workbook that can be read"),
        (b"step,branch\n1,gr\xfcn\n", "line 2", 'encoding: must be UTF-8 or UTF-16; save as "CSV UTF-8"'),
    ],
)  # fmt: skip
def test_ambiguous_file_is_refused_with_a_word_for_the_reason(tmp_path, content, key, word):
    path = tmp_path / "t.csv"
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    found = problem(path)
    assert (found.file, found.key) == (str(path), key)
    assert word in found.allowed


def test_file_that_is_not_there_is_named(tmp_path):
    assert problem(tmp_path / "t.csv").allowed == "no such file"


def test_a_decimal_comma_among_thousands_is_unambiguous(tmp_path):
    path = tmp_path / "t.csv"
    path.write_text("step;value\n1;1,234\n2;0,5\n")
    assert read_table(path).value.tolist() == ["1.234", "0.5"]


# ------------------------------------------------------------ workbook


openpyxl = pytest.importorskip("openpyxl")

CELLS = [[1, "position_x", 0.25, -1.5e-3, 1e-4], [2, "tendon_displacement", "t1", 0.125, None]]


def workbook(path, rows, title="Sheet"):
    book = openpyxl.Workbook()
    book.active.title = title
    for row in rows:
        book.active.append(row)
    book.create_sheet("notes").append(["not read"])
    book.save(path)
    return path


def said(path):
    with pytest.raises(InputError) as caught:
        read_table(path)
    return str(caught.value.problems[0])


@pytest.mark.parametrize("name", ["t.xlsx", "t.csv"])
def test_the_first_sheet_is_the_table(tmp_path, name):
    """Also where the file is called .csv; numbers come with a point, whatever the spreadsheet shows."""
    path = workbook(tmp_path / name, [[], [*HEADER, None], *CELLS[:1], [None, "  "], *CELLS[1:]])
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
    text = said(workbook(tmp_path / "t.xlsx", rows, "Data"))
    assert "sheet Data, cell B2 = 2026-05-01" in text and "is a date or a time" in text
    with pytest.raises(InputError, match=r"cell B3 = #DIV/0!: is an error of a formula"):
        read_table(tmp_path / "t.xlsx")


def test_files_that_are_no_workbooks_are_refused(tmp_path):
    (tmp_path / "zip.xlsx").write_bytes(b"PK\x03\x04" + 60 * b"\0")
    assert "is not an Excel workbook that can be read" in said(tmp_path / "zip.xlsx")
    (tmp_path / "old.xls").write_bytes(b"\xd0\xcf\x11\xe0" + 60 * b"\0")
    assert "is a workbook of the old Excel format (xls); save it as xlsx or CSV" in said(tmp_path / "old.xls")
    assert "is empty; must have a header" in said(workbook(tmp_path / "empty.xlsx", []))


def test_without_openpyxl_the_error_names_the_extra(tmp_path, monkeypatch):
    path = workbook(tmp_path / "t.xlsx", [HEADER, *CELLS])
    monkeypatch.setitem(sys.modules, "openpyxl", None)
    assert said(path).endswith("save it as CSV, or install openpyxl: pip install 'tdcr-fe[xlsx]'")

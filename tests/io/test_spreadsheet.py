"""Tables as spreadsheets write them give the same data; an ambiguous file is refused with the reason."""

import csv

import pytest

from tdcr_fe.io.files import InputError
from tdcr_fe.io.tables import read_table

HEADER = ["step", "quantity", "location", "value", "sigma"]
ROWS = [
    ["1", "position_x", "0.25", "-1.5e-3", "0.0001"],
    ["1", "tendon_displacement", "t, left", "0.125", ""],
    ["2", "bending_angle", "", "1", "0.5"],
]


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig"])
@pytest.mark.parametrize("end", ["\n", "\r\n"])
@pytest.mark.parametrize("quoting", [csv.QUOTE_MINIMAL, csv.QUOTE_ALL], ids=["few quotes", "all quoted"])
@pytest.mark.parametrize("delimiter, decimal", [(",", "."), (";", ","), (";", "."), ("\t", "."), ("\t", ",")])
def test_every_dialect_gives_the_same_table(tmp_path, delimiter, decimal, quoting, end, encoding):
    """In 0.1 semicolons gave "missing column" five times."""
    path, rows = tmp_path / "t.csv", [HEADER, *([x.replace(".", decimal) for x in row] for row in ROWS)]
    with path.open("w", encoding=encoding, newline="") as file:
        csv.writer(file, delimiter=delimiter, quoting=quoting, lineterminator=end).writerows(rows)
    table = read_table(path)
    assert list(table.columns) == HEADER
    assert table.to_numpy().tolist() == ROWS
    assert list(table.index) == [2, 3, 4]


def test_blank_rows_comments_and_empty_columns_at_the_end_are_skipped(tmp_path):
    path = tmp_path / "t.csv"
    path.write_text("# May, 3\nbranch;step;value;;\n\na,5;1;0,5;;\n# new; c\n;;;;\n1,2,3;2;1,5;;\n#3;3;2;;\n")
    table = read_table(path)
    assert (table.value.tolist(), list(table.index)) == (["0.5", "1.5", "2"], [4, 7, 8])
    assert table.branch.tolist() == ["a,5", "1,2,3", "#3"]  # no numbers, no comment


@pytest.mark.parametrize(
    ("content", "key", "word"),
    [
        ("step;value\n1;0,5\n2;0.5\n", "line 2, value", "decimal: line 3, value has 0.5"),
        ("step,value\n1,0,5\n", "line 2", "has 3 cells; the header has 2; where these are decimal commas"),
        ("step,value,value\n1,2,3\n", "value", "the column appears more than once"),
        ('step,value\n1,"2\n', "line 2", "not a table"),
        ("", "", "is empty"),
        (b"PK\x03\x04rest", "", "is an Excel workbook; save it as CSV"),
        (b"step,branch\n1,gr\xfcn\n", "line 2", 'encoding: must be UTF-8; save as "CSV UTF-8"'),
    ],
)  # fmt: skip
def test_ambiguous_file_is_refused_with_a_word_for_the_reason(tmp_path, content, key, word):
    path = tmp_path / "t.csv"
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    with pytest.raises(InputError) as caught:
        read_table(path)
    (found,) = caught.value.problems
    assert (found.file, found.key) == (str(path), key)
    assert word in found.allowed

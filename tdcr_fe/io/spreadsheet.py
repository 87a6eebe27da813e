"""Read tables as spreadsheets write them: separated by comma, tab or semicolon, the latter also with decimal commas."""

from __future__ import annotations

import csv
import io
import math
import re
from pathlib import Path

import pandas as pd

from tdcr_fe.io.problems import StrPath, read_bytes, refusal

_DECIMAL = {mark: re.compile(rf"(?=.*\d)[+-]?\d*\{mark}\d*([eE][+-]?\d+)?") for mark in ",."}


def read_table(path: StrPath) -> pd.DataFrame:
    """A table as texts; where semicolons or tabs separate the cells, decimal commas become points.

    Parameters
    ----------
    path
        Text file with a header, which decides what separates the cells.

    Returns
    -------
    pandas.DataFrame
        One row per row that is not empty and no comment (``# ...``), all cells as text without blanks at their ends;
        the index is the line of the row in the file.

    Raises
    ------
    InputError
        The file cannot be read, has a column twice, a row longer than its header, or both decimal commas and points.
    """
    path = Path(path)
    text = _text(path)
    header = next((line for line in text.splitlines() if line.strip() and not line.startswith("# ")), "")
    delimiter = next((mark for mark in ";\t" if mark in header), ",")
    rows, line = dict[int, list[str]](), 1
    reader = csv.reader(io.StringIO(text, newline=""), delimiter=delimiter, strict=True)
    try:
        for row in reader:
            cells = [cell.strip() for cell in row]
            comment = bool(cells) and cells[0].startswith("# ") and (bool(rows) or not any(cells[1:]))
            if any(cells) and not comment:
                rows[line] = cells
            line = reader.line_num + 1
    except csv.Error as error:
        raise refusal(path, f"not a table: {error}", f"line {line}") from error
    if not rows:
        raise refusal(path, "is empty; must have a header")
    names = rows.pop(next(iter(rows)))
    while not names[-1]:
        names.pop()
    if twice := [c for c in names if names.count(c) > 1]:
        raise refusal(path, "the column appears more than once", twice[0])
    for line, cells in rows.items():
        if any(cells[len(names) :]):
            text = f"has {len(cells)} cells; the header has {len(names)}"
            if delimiter == ",":
                text += "; where these are decimal commas, separate the cells by semicolons or tabs"
            raise refusal(path, text, f"line {line}")
    equal = [(row + [""] * len(names))[: len(names)] for row in rows.values()]
    table = pd.DataFrame(equal, columns=names, index=pd.Index(rows, name="line"), dtype=object)
    return table if delimiter == "," else _with_points(path, table)


def number(text: str) -> float:
    """A finite number, or NaN."""
    try:
        value = float(text)
    except ValueError:
        return math.nan
    return value if math.isfinite(value) else math.nan


def _text(path: Path) -> str:
    """The text of a file."""
    raw = read_bytes(path)
    if raw.startswith((b"PK\x03\x04", b"\xd0\xcf\x11\xe0")):
        raise refusal(path, "is an Excel workbook; save it as CSV")
    try:
        return raw.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = raw.count(b"\n", 0, error.start) + 1
        text = 'encoding: must be UTF-8; save as "CSV UTF-8"'
        raise refusal(path, text, f"line {line}", f"byte 0x{raw[error.start]:02x}") from error


def _with_points(path: Path, table: pd.DataFrame) -> pd.DataFrame:
    """The table with decimal points in place of decimal commas; with these no number may have a point."""
    cells = {(line, name): x for name in table for line, x in table[name].items()}
    commas, points = ([k for k, x in cells.items() if mark.fullmatch(x)] for mark in _DECIMAL.values())
    if commas and points:
        (line, name), (other, column) = commas[0], points[0]
        text = f"decimal: line {other}, {column} has {cells[points[0]]}; use a point or a comma throughout"
        raise refusal(path, text, f"line {line}, {name}", cells[commas[0]])
    return table.map(lambda x: x.replace(",", ".") if _DECIMAL[","].fullmatch(x) else x)

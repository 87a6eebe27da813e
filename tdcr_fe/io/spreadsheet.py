"""Read tables that any spreadsheet writes: comma, semicolon or tab; decimal point or comma; UTF-8, UTF-16 or xlsx."""

from __future__ import annotations

import codecs
import csv
import datetime
import io
import math
import os
import re
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from tdcr_fe.io.problems import InputError, Problem, read_bytes, refusal

_BYTE_ORDER_MARKS = {
    codecs.BOM_UTF8: "utf-8-sig",
    codecs.BOM_UTF32_LE: "utf-32",
    codecs.BOM_UTF32_BE: "utf-32",
    codecs.BOM_UTF16_LE: "utf-16",
    codecs.BOM_UTF16_BE: "utf-16",
}
_DELIMITERS = {",": "comma", ";": "semicolon", "\t": "tab"}
_NUMBERS = {
    "comma": re.compile(r"[+-]?\d*,\d+([eE][+-]?\d+)?|[+-]?\d+,"),
    "point": re.compile(r"[+-]?\d*\.\d+([eE][+-]?\d+)?"),
    "thousands": re.compile(r"[+-]?[1-9]\d{0,2}(,\d{3})+"),
    "both": re.compile(r"(?=.*\.)(?=.*,)[+-]?\d{1,3}([.,]\d{3})+[.,]\d+"),
}
#: A row of texts with its line in the file.
_Row = tuple[int, list[str]]


def read_table(path: str | os.PathLike[str]) -> pd.DataFrame:
    """A table as texts, whatever spreadsheet wrote it; numbers come with a decimal point.

    The delimiter is that of the header. A decimal comma is taken where no number has a point. Of an Excel workbook
    (xlsx) the first sheet is read, which needs openpyxl.

    Parameters
    ----------
    path
        Text file or workbook with a header.

    Returns
    -------
    pandas.DataFrame
        One row per row that is not empty, all cells as text without blanks at their ends; the index is the line of the
        row in the file.

    Raises
    ------
    InputError
        The file cannot be read, has a column twice, or leaves open what its delimiter or its decimal mark is; or it is
        a workbook that cannot be read.
    """
    path = Path(path)
    raw = read_bytes(path)
    delimiter = ""
    if raw.startswith(b"PK\x03\x04"):
        rows = _rows_of_workbook(path, raw)
    else:
        rows, delimiter = _rows_of_text(path, _decode(path, raw))
    (_, names), *rest = rows
    names = names[: max(k + 1 for k, name in enumerate(names) if name)]
    twice = [c for c in names if names.count(c) > 1]
    if twice:
        raise refusal(path, "the column appears more than once", twice[0])
    for number, row in rest:
        if any(row[len(names) :]):
            allowed = f"has {len(row)} cells; the header has {len(names)}"
            if delimiter == ",":
                allowed += "; where these are decimal commas, separate the cells by semicolons"
            raise refusal(path, allowed, f"line {number}")
    cells = [(row + [""] * len(names))[: len(names)] for _, row in rest]
    table = pd.DataFrame(
        np.array(cells, dtype=object).reshape(len(cells), len(names)),
        columns=pd.Index(names, dtype=object),
        index=pd.Index([n for n, _ in rest], name="line"),
        dtype=object,
    )
    return _with_points(path, table)


def table_file(path: Path) -> Path:
    """The file of a table: ``path``, or the workbook of that name where only this one is there."""
    workbook = path.with_suffix(".xlsx")
    return workbook if workbook.is_file() and not path.exists() else path


def number(text: str) -> float:
    """A finite number, or NaN."""
    try:
        value = float(text)
    except ValueError:
        return math.nan
    return value if math.isfinite(value) else math.nan


def whole_number(text: str) -> int | None:
    """A whole number, or None."""
    value = number(text)
    return int(value) if math.isfinite(value) and value == int(value) else None


def millimetres_hint(value: float, limit: float) -> str:
    """End of a message on a length [m] that would be within a limit [m] if it were in mm; empty if it would not."""
    return f"; {value / 1000.0:g} would fit, are these mm?" if abs(value) / 1000.0 <= limit else ""


def _decode(path: Path, raw: bytes) -> str:
    """The text of a file, by its byte order mark, or as UTF-8."""
    if raw.startswith(b"\xd0\xcf\x11\xe0"):
        raise refusal(path, "is a workbook of the old Excel format (xls); save it as xlsx or CSV")
    encoding = "utf-8"
    if b"\0" in raw[:200]:  # UTF-16 without a mark: every other byte of plain English is zero
        encoding = "utf-16-le" if raw[1:2] == b"\0" else "utf-16-be"
    encoding = next((e for mark, e in _BYTE_ORDER_MARKS.items() if raw.startswith(mark)), encoding)
    try:
        return raw.decode(encoding)
    except UnicodeDecodeError as error:
        line = raw.count(b"\n", 0, error.start) + 1
        allowed = 'encoding: must be UTF-8 or UTF-16; save as "CSV UTF-8"'
        raise refusal(path, allowed, f"line {line}", f"byte 0x{raw[error.start]:02x}") from error


def _rows_of_text(path: Path, text: str) -> tuple[list[_Row], str]:
    """Rows that are not empty, header first, and the delimiter: that of the header, or of a first line ``sep=;``."""
    lines = [line for line in text.splitlines() if line.strip()]
    hint = re.fullmatch(r'"?sep=(.)"?', lines[0].strip()) if lines else None
    if len(lines) <= bool(hint):
        raise refusal(path, "is empty; must have a header")
    delimiter = hint.group(1) if hint else ","
    bare = re.sub(r'"(?:[^"]|"")*"', "", lines[0])
    there = [d for d in _DELIMITERS if d in bare and not hint]
    if len(there) > 1:
        both = " and ".join(_DELIMITERS[d] for d in there)
        raise refusal(path, f"delimiter: the header has {both}; use one of them", "line 1", lines[0].strip())
    delimiter = there[0] if there else delimiter
    reader = csv.reader(io.StringIO(text, newline=""), delimiter=delimiter, strict=True)
    rows, begin = [], 1
    try:
        for row in reader:
            rows.append((begin, [cell.strip() for cell in row]))
            begin = reader.line_num + 1
    except csv.Error as error:
        raise refusal(path, f"not a table: {error}", f"line {begin}") from error
    rows = [(n, row) for n, row in rows if any(row)][bool(hint) :]
    if not rows:
        raise refusal(path, "is empty; must have a header")
    return rows, delimiter


def _with_points(path: Path, table: pd.DataFrame) -> pd.DataFrame:
    """The table with a decimal point in every number."""
    if not any("," in x for row in table.to_numpy() for x in row):
        return table
    cells = [(f"line {n}, {c}", x) for n, row in table.to_dict("index").items() for c, x in row.items()]
    found = {kind: [cell for cell in cells if p.fullmatch(cell[1])] for kind, p in _NUMBERS.items()}
    if found["both"]:
        key, x = found["both"][0]
        raise refusal(path, "decimal: remove the thousands separators", key, x)
    commas = found["comma"] or found["thousands"]
    if not commas:
        return table
    if found["point"]:
        where, other = found["point"][0]
        allowed = f"decimal: {where} has {other}; use a point or a comma throughout"
        raise refusal(path, allowed, commas[0][0], commas[0][1])
    if set(found["comma"]) <= set(found["thousands"]):
        allowed = "decimal: may be a decimal comma or a thousands separator; write a decimal point"
        raise refusal(path, allowed, commas[0][0], commas[0][1])
    return table.map(lambda x: x.replace(",", ".") if _NUMBERS["comma"].fullmatch(x) else x)


def _rows_of_workbook(path: Path, contents: bytes) -> list[_Row]:
    """Rows of the first sheet that are not empty.

    Numbers are written with a decimal point, whatever the spreadsheet shows; of a formula its value is taken.
    """
    try:
        import openpyxl
    except ImportError as error:
        text = "is an Excel workbook; save it as CSV, or install openpyxl: pip install 'tdcr-fe[xlsx]'"
        raise refusal(path, text) from error
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of styles and extensions that do not matter here
            book = openpyxl.load_workbook(io.BytesIO(contents), data_only=True)
    except Exception as error:  # openpyxl raises what its parsers of zip and XML raise
        text = f"is not an Excel workbook that can be read: {error}; save it as xlsx or CSV"
        raise refusal(path, text) from error
    if not book.worksheets:
        raise refusal(path, "has no sheet with cells")
    sheet = book.worksheets[0]
    problems: list[Problem] = []
    rows: list[_Row] = []
    for line, row in enumerate(sheet.iter_rows(), 1):
        cells = [(cell.coordinate, *_text(cell.value)) for cell in row]
        problems += [
            Problem(str(path), f"sheet {sheet.title}, cell {at}", text, wrong)
            for at, text, wrong in cells
            if wrong
        ]
        if any(text for _, text, _ in cells):
            rows.append((line, [text for _, text, _ in cells]))
    if problems:
        raise InputError(problems)
    if not rows:
        raise refusal(path, "is empty; must have a header", f"sheet {sheet.title}")
    return rows


def _text(value: Any) -> tuple[str, str]:
    """A cell as text, and what is wrong with it."""
    if isinstance(value, bool):
        return str(value).lower(), ""
    if isinstance(value, int | float):
        return repr(value), ""
    text = "" if value is None else str(value).strip()
    if isinstance(value, datetime.date | datetime.time | datetime.timedelta):
        return text, "is a date or a time; format the cell as a number, and enter it again"
    if text.startswith("#") and text.endswith(("!", "?", "/A")):
        return text, "is an error of a formula"
    return text, ""

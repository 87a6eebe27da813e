"""Read tables that any spreadsheet writes: comma, semicolon or tab; decimal point or comma; UTF-8, UTF-16 or xlsx."""

from __future__ import annotations

import codecs
import csv
import io
import os
import re
from pathlib import Path

import numpy as np
import pandas as pd

from tdcr_fe.io.problems import InputError, Problem
from tdcr_fe.io.workbook import rows_of_workbook

_BYTE_ORDER_MARKS = (
    (codecs.BOM_UTF8, "utf-8-sig"),
    (codecs.BOM_UTF32_LE, "utf-32"),
    (codecs.BOM_UTF32_BE, "utf-32"),
    (codecs.BOM_UTF16_LE, "utf-16"),
    (codecs.BOM_UTF16_BE, "utf-16"),
)
_DELIMITERS = {",": "comma", ";": "semicolon", "\t": "tab"}
_WITH_COMMA = re.compile(r"[+-]?\d*,\d+([eE][+-]?\d+)?|[+-]?\d+,")
_WITH_POINT = re.compile(r"[+-]?\d*\.\d+([eE][+-]?\d+)?")
_THOUSANDS = re.compile(r"[+-]?[1-9]\d{0,2}(,\d{3})+")
_BOTH = re.compile(r"[+-]?\d{1,3}([.,]\d{3})+[.,]\d+")


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
    raw = _contents(path)
    if raw.startswith(b"PK\x03\x04"):
        (_, head), *rest = rows_of_workbook(path, raw)
        return _frame(path, _without_empty_end(head), [(n, r) for n, r in rest if any(r)])
    text = _decode(path, raw)
    lines = text.lstrip("\r\n").splitlines()
    if not lines or not lines[0].strip():
        raise _error(path, "", "is empty; must have a header")
    hint = re.fullmatch(r'"?sep=(.)"?', lines[0].strip())
    start = text.index(lines[0]) + (len(lines[0]) if hint else 0)
    body = text[start:].lstrip("\r\n") if hint else text[start:]
    skipped = text[: len(text) - len(body)].count("\n")
    delimiter = hint.group(1) if hint else _delimiter(path, body.splitlines()[0])
    reader = csv.reader(io.StringIO(body, newline=""), delimiter=delimiter, strict=True)
    rows: list[tuple[int, list[str]]] = []
    begin = skipped + 1
    try:
        for row in reader:
            rows.append((begin, [cell.strip() for cell in row]))
            begin = skipped + reader.line_num + 1
    except csv.Error as error:
        raise _error(path, f"line {begin}", f"not a table: {error}") from error
    filled = [(n, r) for n, r in rows[1:] if any(r)]
    return _frame(path, _without_empty_end(rows[0][1]), filled, commas=delimiter == ",")


def _without_empty_end(names: list[str]) -> list[str]:
    """Names of columns without those that are empty at the end."""
    count = max((k + 1 for k, name in enumerate(names) if name), default=0)
    return names[:count]


def _error(path: Path, key: str, allowed: str, value: str = "") -> InputError:
    return InputError([Problem(str(path), key, value, allowed)])


def table_file(path: Path) -> Path:
    """The file of a table: ``path``, or the workbook of that name where only this one is there."""
    workbook = path.with_suffix(".xlsx")
    return workbook if workbook.is_file() and not path.exists() else path


def _contents(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except FileNotFoundError:
        raise _error(path, "", "no such file") from None
    except IsADirectoryError:
        raise _error(path, "", "is a directory, not a file") from None
    except OSError as error:
        reason = "is a directory, not a file" if path.is_dir() else f"cannot be read: {error.strerror}"
        raise _error(path, "", reason) from error


def _decode(path: Path, raw: bytes) -> str:
    """The text of a file, by its byte order mark, or as UTF-8."""
    if raw.startswith(b"\xd0\xcf\x11\xe0"):
        raise _error(path, "", "is a workbook of the old Excel format (xls); save it as xlsx or CSV")
    encoding = next((e for mark, e in _BYTE_ORDER_MARKS if raw.startswith(mark)), "")
    if not encoding:
        encoding = "utf-8"
        if b"\0" in raw[:200]:  # UTF-16 without a mark: every other byte of plain English is zero
            encoding = "utf-16-le" if raw[1:2] == b"\0" else "utf-16-be"
    try:
        return raw.decode(encoding)
    except UnicodeDecodeError as error:
        line = raw.count(b"\n", 0, error.start) + 1
        byte = f"byte 0x{raw[error.start]:02x}"
        raise _error(
            path, f"line {line}", 'encoding: must be UTF-8 or UTF-16; save as "CSV UTF-8"', byte
        ) from error


def _delimiter(path: Path, header: str) -> str:
    """The delimiter of a header line; quoted cells do not count."""
    bare = re.sub(r'"(?:[^"]|"")*"', "", header)
    there = [d for d in _DELIMITERS if d in bare]
    if len(there) > 1:
        names = " and ".join(_DELIMITERS[d] for d in there)
        raise _error(path, "line 1", f"delimiter: the header has {names}; use one of them", header.strip())
    return there[0] if there else ","


def _frame(
    path: Path, names: list[str], rows: list[tuple[int, list[str]]], commas: bool = False
) -> pd.DataFrame:
    """The table of rows with their lines; ``commas``: whether commas separate the cells."""
    twice = [c for c in names if names.count(c) > 1]
    if twice:
        raise _error(path, twice[0], "the column is there more than once")
    for number, row in rows:
        if any(row[len(names) :]):
            allowed = f"has {len(row)} cells; the header has {len(names)}"
            if commas:
                allowed += "; where these are decimal commas, separate the cells by semicolons"
            raise _error(path, f"line {number}", allowed)
    cells = [(row + [""] * len(names))[: len(names)] for _, row in rows]
    table = pd.DataFrame(
        np.array(cells, dtype=object).reshape(len(cells), len(names)),
        columns=pd.Index(names, dtype=object),
        index=pd.Index([n for n, _ in rows], name="line"),
        dtype=object,
    )
    return _with_points(path, table)


def _with_points(path: Path, table: pd.DataFrame) -> pd.DataFrame:
    """The table with a decimal point in every number."""
    if not any("," in x for row in table.to_numpy() for x in row):
        return table
    cells = [(n, c, x) for n, row in table.to_dict("index").items() for c, x in row.items() if x]
    for number, column, x in cells:
        if _BOTH.fullmatch(x) and "," in x and "." in x:
            raise _error(path, f"line {number}, {column}", "decimal: remove the thousands separators", x)
    comma = [(n, c, x) for n, c, x in cells if _WITH_COMMA.fullmatch(x)]
    grouped = [(n, c, x) for n, c, x in cells if _THOUSANDS.fullmatch(x)]
    point = [(n, c, x) for n, c, x in cells if _WITH_POINT.fullmatch(x)]
    if not comma and not grouped:
        return table
    number, column, x = (comma or grouped)[0]
    if point:
        line, where, other = point[0]
        allowed = f"decimal: line {line}, {where} has {other}; use a point or a comma throughout"
        raise _error(path, f"line {number}, {column}", allowed, x)
    if len(grouped) == len({*comma, *grouped}):
        allowed = "decimal: may be a decimal comma or a thousands separator; write a decimal point"
        raise _error(path, f"line {number}, {column}", allowed, x)
    return table.map(lambda x: x.replace(",", ".") if _WITH_COMMA.fullmatch(x) else x)

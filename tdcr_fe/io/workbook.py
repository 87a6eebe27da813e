"""Read the first sheet of an Excel workbook (xlsx) as rows of texts; needs openpyxl, the extra ``xlsx``."""

from __future__ import annotations

import datetime
import io
import warnings
from pathlib import Path
from typing import Any

from tdcr_fe.io.problems import InputError, Problem


def rows_of_workbook(path: Path, contents: bytes) -> list[tuple[int, list[str]]]:
    """Rows of the first sheet from its first row that is not empty, each with its number from 1.

    Numbers are written with a decimal point, whatever the spreadsheet shows; of a formula its value is taken.

    Parameters
    ----------
    path
        For messages.
    contents
        Of the file.

    Raises
    ------
    InputError
        openpyxl is not installed, the file is no workbook, its first sheet is empty, or a cell is a date, a formula
        without a value or an error.
    """
    try:
        import openpyxl
    except ImportError as error:
        text = "is an Excel workbook; save it as CSV, or install openpyxl: pip install 'tdcr-fe[xlsx]'"
        raise InputError([Problem(str(path), "", "", text)]) from error
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of styles and extensions that do not matter here
            book = openpyxl.load_workbook(io.BytesIO(contents), read_only=False, data_only=True)
    except Exception as error:  # openpyxl raises what its parsers of zip and XML raise
        text = f"is no Excel workbook that can be read: {error}; save it as xlsx or CSV"
        raise InputError([Problem(str(path), "", "", text)]) from error
    if not book.worksheets:
        raise InputError([Problem(str(path), "", "", "has no sheet with cells")])
    sheet = book.worksheets[0]
    problems: list[Problem] = []
    rows: list[tuple[int, list[str]]] = []
    for number, row in enumerate(sheet.iter_rows(), 1):
        texts = []
        for cell in row:
            text, wrong = _text(cell.value)
            if wrong:
                problems.append(
                    Problem(str(path), f"sheet {sheet.title}, cell {cell.coordinate}", text, wrong)
                )
            texts.append(text)
        if rows or any(texts):
            rows.append((number, texts))
    if problems:
        raise InputError(problems)
    if not rows:
        raise InputError([Problem(str(path), f"sheet {sheet.title}", "", "is empty; must have a header")])
    return rows


def _text(value: Any) -> tuple[str, str]:
    """A cell as text, and what is wrong with it."""
    if value is None:
        return "", ""
    if isinstance(value, bool):
        return str(value).lower(), ""
    if isinstance(value, int | float):
        return repr(value), ""
    if isinstance(value, datetime.date | datetime.time | datetime.timedelta):
        return str(value), "is a date or a time; format the cell as a number, and enter it again"
    text = str(value).strip()
    if text.startswith("#") and text.endswith(("!", "?", "/A")):
        return text, "is an error of a formula"
    return text, ""

"""Mutations of tables: of their columns, rows and cells, and of the way in which a spreadsheet writes them."""

from __future__ import annotations

import csv
import io
from collections.abc import Callable

import numpy as np

from tdcr_fe.validation.broken_files.toml_mutations import Mutated

Random = np.random.Generator
Rows = list[list[str]]

#: Columns that may be missing.
_OPTIONAL = ("branch", "time", "label", "tension_t1", "tension_t2", "tension_t3")


def _rows(text: str) -> Rows:
    return list(csv.reader(io.StringIO(text)))


def _text(rows: Rows, delimiter: str = ",") -> str:
    out = io.StringIO()
    csv.writer(out, delimiter=delimiter, lineterminator="\n").writerows(rows)
    return out.getvalue()


def _cell(rng: Random, rows: Rows) -> tuple[int, int]:
    if len(rows) < 2:
        raise LookupError("there are no rows")
    return int(rng.integers(1, len(rows))), int(rng.integers(len(rows[0])))


def missing_column(rng: Random, text: str) -> Mutated:
    """A column is not there."""
    rows = _rows(text)
    k = int(rng.integers(len(rows[0])))
    name = rows[0][k]
    return _text([row[:k] + row[k + 1 :] for row in rows]), (name,), "", name not in _OPTIONAL


def renamed_column(rng: Random, text: str) -> Mutated:
    """A column has a name that is misspelt."""
    rows = _rows(text)
    k = int(rng.integers(len(rows[0])))
    rows[0][k] = str(
        rng.choice([rows[0][k] + "s", rows[0][k][:-1] + "_", " ", "tension_nobody", rows[0][k] + " [mm]"])
    )
    return _text(rows), (rows[0][k].strip(),), "", True


def duplicate_column(rng: Random, text: str) -> Mutated:
    """A column is there twice."""
    rows = _rows(text)
    k = int(rng.integers(len(rows[0])))
    return _text([[*row, row[k]] for row in rows]), (rows[0][k],), "", True


def unequal_rows(rng: Random, text: str) -> Mutated:
    """A row has a cell too many or too few."""
    rows = _rows(text)
    i, k = _cell(rng, rows)
    more = bool(rng.integers(2))
    rows[i] = [*rows[i], "7"] if more else rows[i][:k] + rows[i][k + 1 :]
    return _text(rows), ("line",), "", more


def changed_cell(rng: Random, text: str) -> Mutated:
    """A cell is empty, no number, negative, huge, or in another unit."""
    rows = _rows(text)
    i, k = _cell(rng, rows)
    rows[i][k] = str(
        rng.choice(
            ["", "abc", "nan", "inf", "-inf", "-1", "0", "1e300", "1e999", "1,5", "1.234,5", "0.5 N", "1e-320",
             "#DIV/0!", "NA", "1" + 400 * "0", "0x10", "1_000", "５", "--1", "TRUE", "=A1", "\x00", "1.5", "2147483648"]
        )
    )  # fmt: skip
    return _text(rows), ("line",), rows[i][k][:40], False


def in_millimetres(rng: Random, text: str) -> Mutated:
    """All numbers of a column are a thousand times as large."""
    rows = _rows(text)
    _, k = _cell(rng, rows)
    for row in rows[1:]:
        try:
            row[k] = repr(1000.0 * float(row[k]))
        except ValueError:
            continue
    return _text(rows), (rows[0][k],), "", False


def repeated_row(rng: Random, text: str) -> Mutated:
    """A row is there twice."""
    rows = _rows(text)
    i, _ = _cell(rng, rows)
    return _text([*rows, rows[i]]), ("line",), "", False


def other_order(rng: Random, text: str) -> Mutated:
    """Rows or columns in another order."""
    head, *rest = _rows(text)
    if rng.integers(2):
        return _text([head, *(rest[int(i)] for i in rng.permutation(len(rest)))]), ("line",), "", False
    order = [int(k) for k in rng.permutation(len(head))]
    return _text([[row[k] for k in order] for row in (head, *rest)]), ("line",), "", False


def no_header(rng: Random, text: str) -> Mutated:
    """The first line is missing."""
    return text.partition("\n")[2], (), "", True


def no_rows(rng: Random, text: str) -> Mutated:
    """Nothing but the header."""
    return text.partition("\n")[0] + "\n", (), "", True


def many_rows(rng: Random, text: str) -> Mutated:
    """A hundred thousand rows."""
    head, *rest = _rows(text)
    return _text([head, *(rest * (1 + 100_000 // len(rest)))[:100_000]]), (), "100000 rows", False


def semicolons_and_commas(rng: Random, text: str) -> Mutated:
    """As a German spreadsheet writes it: semicolons and decimal commas."""
    return _text([[x.replace(".", ",") for x in row] for row in _rows(text)], ";"), (), "", False


def other_delimiter(rng: Random, text: str) -> Mutated:
    """Semicolons, tabs, blanks or bars between the cells."""
    return _text(_rows(text), str(rng.choice([";", "\t", " ", "|"]))), (), "", False


def mixed_delimiters(rng: Random, text: str) -> Mutated:
    """A header with commas and rows with semicolons."""
    head, _, rest = text.partition("\n")
    return head + "\n" + rest.replace(",", ";"), ("line",), "", False


def open_quote(rng: Random, text: str) -> Mutated:
    """A quote that is not closed."""
    k = int(rng.integers(len(text)))
    return text[:k] + '"' + text[k:], ("line",), '"', False


def cut_off(rng: Random, text: str) -> Mutated:
    """The end is missing."""
    return text[: int(rng.integers(1, len(text)))], (), "", False


def more_lines(rng: Random, text: str) -> Mutated:
    """Blank lines, comments or a title above the header."""
    return (
        str(rng.choice(["\n\n", "# measured on Monday\n", "My data;;;\n", "sep=;\n", "\x00\n"])) + text,
        (),
        "",
        False,
    )


TABLE_MUTATIONS: tuple[Callable[[Random, str], Mutated], ...] = (
    missing_column,
    renamed_column,
    duplicate_column,
    unequal_rows,
    changed_cell,
    in_millimetres,
    repeated_row,
    other_order,
    no_header,
    no_rows,
    many_rows,
    semicolons_and_commas,
    other_delimiter,
    mixed_delimiters,
    open_quote,
    cut_off,
    more_lines,
)


def mutate(name: str, rng: Random, text: str) -> Mutated:
    """Apply a mutation by the name of its function."""
    function = next(f for f in TABLE_MUTATIONS if f.__name__ == name)
    return function(rng, text)

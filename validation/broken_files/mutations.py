"""Mutations of a folder of input files: of the contents of one file, of its encoding, or of the file itself.

A mutation of contents is a function from random numbers and the contents to the text now, the path of what was changed,
its value as text, and whether it must be refused.
"""

from __future__ import annotations

import csv
import io
import tomllib
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass

import numpy as np

from tdcr_fe.validation.broken_files.toml_mutations import (
    DATA_MUTATIONS,
    TEXT_MUTATIONS,
    Mutated,
    Mutation,
    Random,
    pick,
    register,
)

Rows = list[list[str]]

#: Columns that may be missing.
_OPTIONAL = ("branch", "time", "label", "tension_t1", "tension_t2", "tension_t3")
#: What a cell becomes: empty, no number, negative, huge, or in another unit.
_CELLS = ["", "abc", "nan", "inf", "-inf", "-1", "0", "1e300", "1e999", "1,5", "1.234,5", "0.5 N", "1e-320",
          "#DIV/0!", "NA", "1" + 400 * "0", "0x10", "1_000", "５", "--1", "TRUE", "=A1", "\x00", "1.5",
          "2147483648"]  # fmt: skip

#: Mutations of tables, by their names.
TABLE_MUTATIONS: dict[str, Mutation] = {}


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


@register(TABLE_MUTATIONS)
def missing_column(rng: Random, text: str) -> Mutated:
    """A column is not there."""
    rows = _rows(text)
    k = int(rng.integers(len(rows[0])))
    name = rows[0][k]
    return _text([row[:k] + row[k + 1 :] for row in rows]), (name,), "", name not in _OPTIONAL


@register(TABLE_MUTATIONS)
def renamed_column(rng: Random, text: str) -> Mutated:
    """A column has a name that is misspelt."""
    rows = _rows(text)
    k = int(rng.integers(len(rows[0])))
    name = rows[0][k]
    rows[0][k] = pick(rng, [name + "s", name[:-1] + "_", " ", "tension_nobody", name + " [mm]"])
    return _text(rows), (rows[0][k].strip(),), "", True


@register(TABLE_MUTATIONS)
def duplicate_column(rng: Random, text: str) -> Mutated:
    """A column is there twice."""
    rows = _rows(text)
    k = int(rng.integers(len(rows[0])))
    return _text([[*row, row[k]] for row in rows]), (rows[0][k],), "", True


@register(TABLE_MUTATIONS)
def unequal_rows(rng: Random, text: str) -> Mutated:
    """A row has a cell too many or too few."""
    rows = _rows(text)
    i, k = _cell(rng, rows)
    more = bool(rng.integers(2))
    rows[i] = [*rows[i], "7"] if more else rows[i][:k] + rows[i][k + 1 :]
    return _text(rows), ("line",), "", more


@register(TABLE_MUTATIONS)
def changed_cell(rng: Random, text: str) -> Mutated:
    """A cell has other contents."""
    rows = _rows(text)
    i, k = _cell(rng, rows)
    rows[i][k] = pick(rng, _CELLS)
    return _text(rows), ("line",), rows[i][k][:40], False


@register(TABLE_MUTATIONS)
def in_millimetres(rng: Random, text: str) -> Mutated:
    """All numbers of a column are a thousand times as large."""
    rows = _rows(text)
    _, k = _cell(rng, rows)
    for row in rows[1:]:
        with suppress(ValueError):
            row[k] = repr(1000.0 * float(row[k]))
    return _text(rows), (rows[0][k],), "", False


@register(TABLE_MUTATIONS)
def repeated_row(rng: Random, text: str) -> Mutated:
    """A row is there twice."""
    rows = _rows(text)
    i, _ = _cell(rng, rows)
    return _text([*rows, rows[i]]), ("line",), "", False


@register(TABLE_MUTATIONS)
def other_order(rng: Random, text: str) -> Mutated:
    """Rows or columns in another order."""
    head, *rest = _rows(text)
    if rng.integers(2):
        return _text([head, *(rest[int(i)] for i in rng.permutation(len(rest)))]), ("line",), "", False
    order = [int(k) for k in rng.permutation(len(head))]
    return _text([[row[k] for k in order] for row in (head, *rest)]), ("line",), "", False


@register(TABLE_MUTATIONS)
def no_header(rng: Random, text: str) -> Mutated:
    """The first line is missing."""
    return text.partition("\n")[2], (), "", True


@register(TABLE_MUTATIONS)
def no_rows(rng: Random, text: str) -> Mutated:
    """Nothing but the header."""
    return text.partition("\n")[0] + "\n", (), "", True


@register(TABLE_MUTATIONS)
def many_rows(rng: Random, text: str) -> Mutated:
    """A hundred thousand rows."""
    head, *rest = _rows(text)
    return _text([head, *(rest * (1 + 100_000 // len(rest)))[:100_000]]), (), "100000 rows", False


@register(TABLE_MUTATIONS)
def semicolons_and_commas(rng: Random, text: str) -> Mutated:
    """As a German spreadsheet writes it: semicolons and decimal commas."""
    return _text([[x.replace(".", ",") for x in row] for row in _rows(text)], ";"), (), "", False


@register(TABLE_MUTATIONS)
def other_delimiter(rng: Random, text: str) -> Mutated:
    """Semicolons, tabs, blanks or bars between the cells."""
    return _text(_rows(text), pick(rng, [";", "\t", " ", "|"])), (), "", False


@register(TABLE_MUTATIONS)
def mixed_delimiters(rng: Random, text: str) -> Mutated:
    """A header with commas and rows with semicolons."""
    head, _, rest = text.partition("\n")
    return head + "\n" + rest.replace(",", ";"), ("line",), "", False


@register(TABLE_MUTATIONS)
def open_quote(rng: Random, text: str) -> Mutated:
    """A quote that is not closed."""
    k = int(rng.integers(len(text)))
    return text[:k] + '"' + text[k:], ("line",), '"', False


TABLE_MUTATIONS["cut_off"] = TEXT_MUTATIONS["truncated"]


@register(TABLE_MUTATIONS)
def more_lines(rng: Random, text: str) -> Mutated:
    """Blank lines, comments or a title above the header."""
    above = ["\n\n", "# measured on Monday\n", "My data;;;\n", "sep=;\n", "\x00\n"]
    return pick(rng, above) + text, (), "", False


# ---------------------------------------------------------------------------------------------------- one file


@dataclass(frozen=True)
class Change:
    """What was done to one file."""

    file: str
    mutation: str
    contents: bytes | None  # of the file now; None where there is no file
    kind: str = "file"  # or "directory", "link to itself", "nothing": what stands at its name
    #: Path of the key, or column, that was changed; "line" where a message can name no more than the line; empty where
    #: it can name the file only.
    key: str = ""
    value: str = ""  # what stands there now
    must_be_refused: bool = False  # whether the result is certainly wrong


#: What the contents of a whole file may be replaced by.
_CONTENTS: dict[str, bytes] = {
    "empty file": b"",
    "blanks": b" \n\t\n",
    "zeros": 4096 * b"\0",
    "random bytes": np.random.default_rng(0).bytes(4096),
    "workbook": b"PK\x03\x04" + 100 * b"\0",
    "web page": b"<!DOCTYPE html><html><body>404</body></html>\n",
}
#: Ways to encode a text; the last one has a byte that is no UTF-8 in its middle.
_ENCODINGS = {
    "UTF-16": "utf-16",
    "UTF-16 without mark": "utf-16-le",
    "UTF-8 with mark": "utf-8-sig",
    "Latin-1": "latin-1",
    "UTF-32": "utf-32",
    "a byte that is no UTF-8": "",
}
#: What may stand at the name of a file in place of it.
_IN_ITS_PLACE = ("directory", "link to itself", "nothing")
_WHOLE = [*_CONTENTS, *_ENCODINGS, *_IN_ITS_PLACE, "other file"]
#: Tables of results may have further columns, and only some of theirs are read.
_RESULT_TABLES = ("steps.csv", "shape.csv", "tensions.csv")

#: Mutations of contents, by the ending of the file.
_OF_FILES = {"toml": {**DATA_MUTATIONS, **TEXT_MUTATIONS}, "csv": TABLE_MUTATIONS}
#: Names of all mutations.
MUTATIONS: tuple[str, ...] = (*_OF_FILES["toml"], *TABLE_MUTATIONS, *_WHOLE)


def change(rng: Random, files: Mapping[str, bytes], required: tuple[str, ...]) -> Change:
    """A random mutation of a random file.

    Parameters
    ----------
    rng
        Random numbers.
    files
        Good contents by name.
    required
        Names of the files without which the command cannot run.
    """
    while True:
        file = pick(rng, list(files))
        own = list(_OF_FILES.get(file.rpartition(".")[2], _WHOLE))
        name = pick(rng, own if rng.random() < 0.85 else _WHOLE)
        try:
            if name in _WHOLE:
                return _replaced(rng, files, file, name, file in required)
            mutate, text = _OF_FILES[file.rpartition(".")[2]][name], files[file].decode()
            given = tomllib.loads(text) if mutate in DATA_MUTATIONS.values() else text
            found, path, value, refuse = mutate(rng, given)
        except LookupError:  # the file has nothing that this mutation could change
            continue
        contents, key = found.encode("utf-8", errors="surrogatepass"), ".".join(map(str, path))
        refuse = refuse and file not in _RESULT_TABLES
        return Change(file, name, contents, key=key, value=value, must_be_refused=refuse)


def _replaced(rng: Random, files: Mapping[str, bytes], file: str, name: str, required: bool) -> Change:
    """The whole file is another one, or encoded in another way."""
    old, toml = files[file], file.endswith(".toml")
    if name in _IN_ITS_PLACE:
        return Change(file, name, None, name, must_be_refused=required)
    if name in _CONTENTS:
        no_toml = toml and name not in ("empty file", "blanks")
        return Change(file, name, _CONTENTS[name], must_be_refused=required or no_toml)
    if name == "other file":
        other = pick(rng, [f for f in files if f != file])
        return Change(file, name, files[other], value=other, must_be_refused=True)
    half = len(old.decode()) // 2
    contents = old[:half] + b"\xff" + old[half:]
    if _ENCODINGS[name]:
        contents = old.decode().encode(_ENCODINGS[name], errors="replace")
    wrong = toml and name != "UTF-8 with mark" and contents != old
    key = "line" if wrong or name == "a byte that is no UTF-8" else ""
    return Change(file, name, contents, key=key, must_be_refused=wrong)

"""Mutations of a folder of input files: of the contents of one file, of its encoding, or of the file itself."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from tdcr_fe.validation.broken_files import table_mutations, toml_mutations

Random = np.random.Generator


@dataclass(frozen=True)
class Change:
    """What was done to one file.

    Attributes
    ----------
    file : str
        Its name.
    mutation : str
        Name of what was done.
    contents : bytes or None
        Of the file now; None where there is no file.
    kind : str
        "file", "directory", "link to itself" or "nothing": what stands at its name.
    key : str
        Path of the key, or column, that was changed; "line" where a message can name no more than the line; empty where
        it can name the file only.
    value : str
        What stands there now.
    must_be_refused : bool
        Whether the result is certainly wrong.
    """

    file: str
    mutation: str
    contents: bytes | None
    kind: str = "file"
    key: str = ""
    value: str = ""
    must_be_refused: bool = False


#: What the contents of a whole file may be replaced by.
_CONTENTS: dict[str, bytes] = {
    "empty file": b"",
    "blanks": b" \n\t\n",
    "zeros": 4096 * b"\0",
    "random bytes": np.random.default_rng(0).bytes(4096),
    "workbook": b"PK\x03\x04" + 100 * b"\0",
    "web page": b"<!DOCTYPE html><html><body>404</body></html>\n",
}


def _encoded(name: str) -> Callable[[str], bytes]:
    def encode(text: str) -> bytes:
        return text.encode(name, errors="replace")

    return encode


#: Ways to encode a text.
_ENCODINGS: dict[str, Callable[[str], bytes]] = {
    "UTF-16": _encoded("utf-16"),
    "UTF-16 without mark": _encoded("utf-16-le"),
    "UTF-8 with mark": _encoded("utf-8-sig"),
    "Latin-1": _encoded("latin-1"),
    "UTF-32": _encoded("utf-32"),
    "a byte that is no UTF-8": lambda text: (
        text.encode()[: len(text) // 2] + b"\xff" + text.encode()[len(text) // 2 :]
    ),
}

#: What may stand at the name of a file in place of it.
_IN_ITS_PLACE = ("directory", "link to itself", "nothing")

#: Tables of results may have further columns, and only some of theirs are read.
_RESULT_TABLES = ("steps.csv", "shape.csv", "tensions.csv")

_TOML = [f.__name__ for f in (*toml_mutations.DATA_MUTATIONS, *toml_mutations.TEXT_MUTATIONS)]
_TABLE = [f.__name__ for f in table_mutations.TABLE_MUTATIONS]
_WHOLE = [*_CONTENTS, *_ENCODINGS, *_IN_ITS_PLACE, "other file"]

#: Names of all mutations.
MUTATIONS: tuple[str, ...] = (*_TOML, *_TABLE, *_WHOLE)


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
        file = str(rng.choice(list(files)))
        own = _TOML if file.endswith(".toml") else _TABLE if file.endswith(".csv") else _WHOLE
        name = str(rng.choice(own if rng.random() < 0.85 else _WHOLE))
        try:
            return _changed(rng, files, file, name, file in required)
        except LookupError:  # the file has nothing that this mutation could change
            continue


def _changed(rng: Random, files: Mapping[str, bytes], file: str, name: str, required: bool) -> Change:
    text = files[file].decode()
    if name in _IN_ITS_PLACE:
        return Change(file, name, None, name, must_be_refused=required)
    if name in _CONTENTS:
        no_toml = file.endswith(".toml") and name not in ("empty file", "blanks")
        return Change(file, name, _CONTENTS[name], must_be_refused=required or no_toml)
    if name in _ENCODINGS:
        contents = _ENCODINGS[name](text)
        wrong = file.endswith(".toml") and name != "UTF-8 with mark" and contents != files[file]
        key = "line" if wrong or name == "a byte that is no UTF-8" else ""
        return Change(file, name, contents, key=key, must_be_refused=wrong)
    if name == "other file":
        other = str(rng.choice([f for f in files if f != file]))
        return Change(file, name, files[other], value=other, must_be_refused=True)
    module = toml_mutations if file.endswith(".toml") else table_mutations
    found, path, value, refuse = module.mutate(name, rng, text)
    refuse = refuse and file not in _RESULT_TABLES
    key = ".".join(str(p) for p in path)
    try:
        contents = found.encode()
    except UnicodeEncodeError:
        contents = found.encode("utf-8", errors="surrogatepass")
    return Change(file, name, contents, key=key, value=value, must_be_refused=refuse)

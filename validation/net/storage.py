"""Files of the net: one a part, with a short index in JSON and all numbers in full precision, compressed."""

from __future__ import annotations

import json
import lzma
import platform
import subprocess
from collections.abc import Mapping
from importlib.metadata import version
from math import prod
from pathlib import Path

import numpy as np

from tdcr_fe.validation.net.parts import Record

#: Name of the file about the code and the machine of the stored data.
MANIFEST = "manifest.json"


def write_part(name: str, records: Mapping[str, Record], folder: Path) -> None:
    """Write the records of a part, by the keys of its cases."""
    index: dict[str, dict[str, str | list[int]]] = {}
    numbers = [np.zeros(0)]
    for key, record in records.items():
        index[key] = {}
        for quantity, value in record.items():
            index[key][quantity] = value if isinstance(value, str) else list(value.shape)
            if not isinstance(value, str):
                numbers.append(np.asarray(value, dtype="<f8").ravel())
    flat = np.concatenate(numbers)
    # Bytes of the same place side by side: signs and exponents compress well.
    shuffled = flat.view(np.uint8).reshape(-1, 8).T.tobytes()
    head = json.dumps(index, separators=(",", ":"), ensure_ascii=True).encode()
    folder.mkdir(parents=True, exist_ok=True)
    (folder / f"{name}.xz").write_bytes(lzma.compress(head + b"\n" + shuffled, preset=9))


def read_part(name: str, folder: Path) -> dict[str, Record]:
    """The stored records of a part; `FileNotFoundError` where there are none."""
    head, shuffled = lzma.decompress((folder / f"{name}.xz").read_bytes()).split(b"\n", 1)
    flat = np.frombuffer(shuffled, dtype=np.uint8).reshape(8, -1).T.copy().view("<f8").ravel()
    records: dict[str, Record] = {}
    place = 0
    for key, quantities in json.loads(head).items():
        records[key] = {}
        for quantity, value in quantities.items():
            if isinstance(value, str):
                records[key][quantity] = value
            else:
                size = prod(value)
                records[key][quantity] = flat[place : place + size].reshape(value)
                place += size
    return records


def note(part: str, folder: Path) -> None:
    """Note in the manifest with what code and versions a part was stored."""
    path = folder / MANIFEST
    known = json.loads(path.read_text(encoding="utf-8")) if path.exists() else {}
    command, here = ["git", "rev-parse", "HEAD"], Path(__file__).parent
    done = subprocess.run(command, cwd=here, capture_output=True, text=True, check=False)
    packages = {name: version(name) for name in ("exudyn", "numpy", "scipy")}
    machine = {"python": platform.python_version(), "platform": f"{platform.system()} {platform.machine()}"}
    known[part] = {"commit": done.stdout.strip(), **packages, **machine}
    path.write_text(json.dumps(known, indent=2, sort_keys=True) + "\n", encoding="utf-8")

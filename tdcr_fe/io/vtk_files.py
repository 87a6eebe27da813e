"""Write a motion for ParaView: one VTK file (XML PolyData) for each load step, and a list of them."""

from __future__ import annotations

import base64
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tdcr_fe.elements import Array
from tdcr_fe.io.atomic import write_folder
from tdcr_fe.report.environment import environment
from tdcr_fe.report.motion import Motion
from tdcr_fe.report.viewer import hole_codes

#: Name of the list of all load steps, which ParaView opens.
LIST = "robot.pvd"
#: Codes of the cell array ``part``.
PARTS = ("backbone", "tendon", "disk", "hole", "load")
#: Kinds of cells, in the order of the file.
KINDS = ("Verts", "Lines", "Polys")

_TYPES = {"f": "Float32", "i": "Int32", "u": "UInt8"}


def _array(name: str, values: NDArray[np.generic]) -> str:
    """One array as XML: base64 with its number of bytes in front."""
    kind = values.dtype.kind
    raw = np.ascontiguousarray(values, dtype={"f": "<f4", "i": "<i4", "u": "u1"}[kind]).tobytes()
    columns = f' NumberOfComponents="{values.shape[1]}"' if values.ndim == 2 else ""
    text = base64.b64encode(np.array([len(raw)], dtype="<u4").tobytes() + raw).decode()
    return f'<DataArray type="{_TYPES[kind]}" Name="{name}"{columns} format="binary">{text}</DataArray>'


class _Cell(NamedTuple):
    """A vertex, line or polygon with its own points."""

    kind: str  # "Verts", "Lines" or "Polys"
    points: Array  # shape (n, 3)
    part: str
    tendon: int = -1
    tension: float = np.nan
    state: int = 255


def vtk_text(motion: Motion, step: int, codes: Sequence[NDArray[np.uint8]]) -> str:
    """One load step (from 0) as the text of a ``.vtp`` file.

    Lines are the backbone and the sides of the tendons, polygons the disks, vertices the holes and the places of
    loads. Cell arrays: ``part`` (`PARTS`), ``tendon`` (number from 0, or -1), ``tension`` [N] (NaN elsewhere) and
    ``hole_state`` (number in `tdcr_fe.report.viewer.STATES`; 255 elsewhere). Point arrays: ``arc_length`` and
    ``radius`` of the backbone [m] (NaN off it), ``force`` [N] and ``moment`` [N m].

    Parameters
    ----------
    motion, step
        What is written.
    codes
        States of the holes, see `tdcr_fe.report.viewer.hole_codes`.
    """
    verts, lines = [], [_Cell("Lines", motion.positions[step], "backbone")]
    for j, tendon in enumerate(motion.tendons):
        corners = motion.tendon_points(step, tendon)
        for i, segment in enumerate(tendon.segments):
            tension = float(motion.tensions[j][step, segment])
            lines.append(_Cell("Lines", corners[i : i + 2], "tendon", j, tension))
            if i + 1 == len(tendon.segments) or tendon.segments[i + 1] != segment:
                state = int(codes[j][step, segment])
                verts.append(_Cell("Verts", corners[i + 1 : i + 2], "hole", j, tension, state))
    polys = [_Cell("Polys", rim[:-1], "disk") for rim in motion.rims(step)]  # which are closed
    arrows = motion.load_arrows(step)
    verts += [_Cell("Verts", at[None], "load") for _, at, _, _ in arrows]
    before = sum(len(cell.points) for cell in verts)
    count = before + sum(len(cell.points) for cell in (*lines, *polys))
    on_backbone = np.full((2, count), np.nan)
    on_backbone[:, before : before + len(motion.s)] = motion.s, motion.radius
    vectors = np.zeros((2, count, 3))
    for i, (_, _, vector, moment) in enumerate(arrows):
        vectors[int(moment), before - len(arrows) + i] = vector
    of_points = dict(zip(("arc_length", "radius", "force", "moment"), (*on_backbone, *vectors), strict=True))
    return _document([*verts, *lines, *polys], of_points)


def _document(cells: Sequence[_Cell], of_points: Mapping[str, Array]) -> str:
    """The text of a file from its cells, by kind, and the arrays of its points."""
    points = np.concatenate([cell.points for cell in cells])
    sections: list[tuple[str, str, Mapping[str, NDArray[np.generic]]]] = [("Points", "", {"Points": points})]
    numbers, first = {}, 0
    for kind in KINDS:
        ends = np.cumsum([len(cell.points) for cell in cells if cell.kind == kind], dtype=np.int32)
        numbers[kind], count = len(ends), int(ends[-1]) if len(ends) else 0
        connections = first + np.arange(count, dtype=np.int32)
        sections.append((kind, "", {"connectivity": connections, "offsets": ends}))
        first += count
    of_cells: dict[str, NDArray[np.generic]] = {
        "part": np.array([PARTS.index(cell.part) for cell in cells], dtype=np.int32),
        "tendon": np.array([cell.tendon for cell in cells], dtype=np.int32),
        "tension": np.array([cell.tension for cell in cells]),
        "hole_state": np.array([cell.state for cell in cells], dtype=np.uint8),
    }
    sections += [("PointData", ' Vectors="force"', of_points), ("CellData", ' Scalars="tension"', of_cells)]
    template = environment().get_template("robot.vtp.j2")
    return template.render(points=len(points), numbers=numbers, sections=sections, array=_array) + "\n"


def write_vtk(motion: Motion, folder: str | Path) -> list[Path]:
    """Write ``robot_0001.vtp`` and so on, one file for each load step, and ``robot.pvd``, which lists them.

    Parameters
    ----------
    motion
        What is written.
    folder
        Made where it does not exist; other files in it stay.
    """
    width = max(4, len(str(max(motion.steps))))
    names = [f"robot_{n:0{width}d}.vtp" for n in motion.steps]
    listed = zip(motion.steps, names, strict=True)
    listing = environment().get_template("robot.pvd.j2").render(files=listed) + "\n"
    codes = hole_codes(motion)

    def write(place: Path) -> None:
        for k, name in enumerate(names):
            (place / name).write_text(vtk_text(motion, k, codes), encoding="ascii")
        (place / LIST).write_text(listing, encoding="ascii")

    return write_folder(folder, write)

"""Write a motion for ParaView: one VTK file (XML PolyData) for each load step, and a list of them."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tdcr_fe.io.atomic import write_folder
from tdcr_fe.report.motion import Motion
from tdcr_fe.report.viewer_data import hole_codes

Array = NDArray[np.float64]

#: Name of the list of all load steps, which ParaView opens.
LIST = "robot.pvd"
#: Codes of the cell array ``part``.
PARTS = ("backbone", "tendon", "disk", "hole", "load")
#: Corners of a disk's rim.
CORNERS = 24

_TYPES = {"f": "Float32", "i": "Int32", "u": "UInt8"}


def _array(name: str, values: NDArray[np.generic], indent: str) -> str:
    """One array as XML: base64 with its number of bytes in front."""
    kind = values.dtype.kind
    stored = np.ascontiguousarray(values, dtype={"f": "<f4", "i": "<i4", "u": "u1"}[kind])
    raw = stored.tobytes()
    columns = f' NumberOfComponents="{values.shape[1]}"' if values.ndim == 2 else ""
    text = base64.b64encode(np.array([len(raw)], dtype="<u4").tobytes() + raw).decode()
    return (
        f'{indent}<DataArray type="{_TYPES[kind]}" Name="{name}"{columns} format="binary">{text}</DataArray>'
    )


class _Cells:
    """Cells of one kind with their points and values, in the order in which they are added."""

    def __init__(self) -> None:
        self.points: list[Array] = []
        self.sizes: list[int] = []
        self.values: list[tuple[int, int, float, int]] = []  # part, tendon, tension, hole state

    def add(
        self, points: Array, part: str, tendon: int = -1, tension: float = np.nan, state: int = 255
    ) -> None:
        """Add a cell with its own points, shape (n, 3)."""
        self.points.append(points)
        self.sizes.append(len(points))
        self.values.append((PARTS.index(part), tendon, tension, state))

    def xml(self, name: str, first: int) -> str:
        """The table of connections; the first point has the number ``first``."""
        count = sum(self.sizes)
        return "\n".join(
            [
                f"      <{name}>",
                _array("connectivity", first + np.arange(count, dtype=np.int32), "        "),
                _array(
                    "offsets", np.cumsum(np.array(self.sizes, dtype=np.int32), dtype=np.int32), "        "
                ),
                f"      </{name}>",
            ]
        )


def vtk_text(motion: Motion, step: int, codes: Sequence[NDArray[np.uint8]]) -> str:
    """One load step (from 0) as the text of a ``.vtp`` file.

    Lines are the backbone and the sides of the tendons, polygons the disks, vertices the holes and the places of
    loads. Cell arrays: ``part`` (`PARTS`), ``tendon`` (number from 0, or -1), ``tension`` [N] (NaN elsewhere) and
    ``hole_state`` (number in `tdcr_fe.report.viewer_data.STATES`; 255 elsewhere). Point arrays: ``arc_length`` and
    ``radius`` of the backbone [m] (NaN off it), ``force`` [N] and ``moment`` [N m].

    Parameters
    ----------
    motion, step
        What is written.
    codes
        States of the holes, see `tdcr_fe.report.viewer_data.hole_codes`.
    """
    verts, lines, polys = _Cells(), _Cells(), _Cells()
    lines.add(motion.positions[step], "backbone")
    for j, tendon in enumerate(motion.tendons):
        corners = motion.tendon_points(step, tendon)
        for i, segment in enumerate(tendon.segments):
            lines.add(corners[i : i + 2], "tendon", j, float(motion.tensions[j][step, segment]))
            if i + 1 == len(tendon.segments) or tendon.segments[i + 1] != segment:
                state = int(codes[j][step, segment])
                tension = float(motion.tensions[j][step, segment])
                verts.add(corners[i + 1 : i + 2], "hole", j, tension, state)
    angle = np.linspace(0.0, 2.0 * np.pi, CORNERS + 1)[:-1]
    rim = motion.disk_radius * np.stack((np.cos(angle), np.sin(angle), 0.0 * angle), axis=-1)
    turns = motion.matrices(step)
    for k in motion.disks:
        polys.add(motion.positions[step, k] + rim @ turns[k].T, "disk")
    arrows = motion.load_arrows(step)
    for _, at, _, _ in arrows:
        verts.add(at[None], "load")
    kinds = (verts, lines, polys)
    counts = [sum(c.sizes) for c in kinds]
    points = np.concatenate([p for c in kinds for p in c.points])
    arc, radius = np.full(len(points), np.nan), np.full(len(points), np.nan)
    backbone = slice(counts[0], counts[0] + len(motion.s))
    arc[backbone], radius[backbone] = motion.s, motion.radius
    vectors = np.zeros((2, len(points), 3))
    for i, (_, _, vector, moment) in enumerate(arrows):
        vectors[int(moment), counts[0] - len(arrows) + i] = vector
    return _document(kinds, points, arc, radius, vectors)


def _document(
    kinds: tuple[_Cells, _Cells, _Cells], points: Array, arc: Array, radius: Array, vectors: Array
) -> str:
    """The text of a file from its vertices, lines and polygons, and the arrays of its points."""
    verts, lines, polys = kinds
    counts = [sum(c.sizes) for c in kinds]
    columns = list(zip(*(v for c in kinds for v in c.values), strict=True))
    sizes = [len(c.sizes) for c in kinds]
    return "\n".join(
        [
            '<?xml version="1.0"?>',
            '<VTKFile type="PolyData" version="1.0" byte_order="LittleEndian" header_type="UInt32">',
            "  <PolyData>",
            f'    <Piece NumberOfPoints="{len(points)}" NumberOfVerts="{sizes[0]}" NumberOfLines="{sizes[1]}" '
            f'NumberOfStrips="0" NumberOfPolys="{sizes[2]}">',
            "      <Points>",
            _array("Points", points, "        "),
            "      </Points>",
            verts.xml("Verts", 0),
            lines.xml("Lines", counts[0]),
            polys.xml("Polys", counts[0] + counts[1]),
            '      <PointData Vectors="force">',
            _array("arc_length", arc, "        "),
            _array("radius", radius, "        "),
            _array("force", vectors[0], "        "),
            _array("moment", vectors[1], "        "),
            "      </PointData>",
            '      <CellData Scalars="tension">',
            _array("part", np.array(columns[0], dtype=np.int32), "        "),
            _array("tendon", np.array(columns[1], dtype=np.int32), "        "),
            _array("tension", np.array(columns[2], dtype=float), "        "),
            _array("hole_state", np.array(columns[3], dtype=np.uint8), "        "),
            "      </CellData>",
            "    </Piece>",
            "  </PolyData>",
            "</VTKFile>",
            "",
        ]
    )


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
    rows = [
        f'    <DataSet timestep="{n}" file="{name}"/>' for n, name in zip(motion.steps, names, strict=True)
    ]
    head = '<?xml version="1.0"?>\n<VTKFile type="Collection" version="1.0" byte_order="LittleEndian">\n  <Collection>'
    listing = "\n".join([head, *rows, "  </Collection>", "</VTKFile>", ""])

    codes = hole_codes(motion)

    def write(place: Path) -> None:
        for k, name in enumerate(names):
            (place / name).write_text(vtk_text(motion, k, codes), encoding="ascii")
        (place / LIST).write_text(listing, encoding="ascii")

    return write_folder(folder, write)

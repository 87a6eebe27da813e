"""Read a folder of results, as ``tdcr-fe run``, ``follow`` or ``identify`` writes it, for drawing and for ParaView."""

from __future__ import annotations

import base64
import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from tdcr_fe.elements import Array
from tdcr_fe.io.files import StrPath, refusal, write_folder
from tdcr_fe.model.columns import tendon_columns
from tdcr_fe.model.loading import Load
from tdcr_fe.model.results import HOLE_STATES
from tdcr_fe.report.environment import environment
from tdcr_fe.report.motion import Markers, Motion, Nodes, assemble
from tdcr_fe.report.viewer import hole_codes

#: Files that are read.
STEPS, SHAPE, TENSIONS, SUMMARY = "steps.csv", "shape.csv", "tensions.csv", "summary.json"
#: Folder of `identify` with the results of the corrected robot, and its tables of measured markers and of the
#: backbone of the declared model.
CORRECTED, MARKERS, DECLARED = "corrected", "markers.csv", "declared.csv"


@contextmanager
def _reading(path: Path) -> Iterator[None]:
    """Refuse a file whose contents make an error inside."""
    try:
        yield
    except (KeyError, TypeError, ValueError, IndexError, RecursionError) as error:
        reason = f"missing: {error.args[0]}" if isinstance(error, KeyError) else str(error).partition("\n")[0]
        raise refusal(path, f"not as tdcr-fe wrote it: {reason}") from error


def _table(path: Path, numbers: Sequence[str], texts: Sequence[str] = ()) -> pd.DataFrame:
    """These columns of a table; texts stay as they are."""
    with _reading(path):
        types = {**dict.fromkeys(numbers, float), **dict.fromkeys(texts, str)}
        empty = {name: ["", "nan"] for name in numbers}
        return pd.read_csv(path, usecols=list(types), dtype=types, keep_default_na=False, na_values=empty)


def _by_step(rows: pd.DataFrame, path: Path, steps: Sequence[int], may_miss: bool = False) -> Array:
    """The finite numbers of a table that has the same rows in every step, shape (n_steps, n_rows, n_columns).

    ``may_miss``: numbers may be missing, and are NaN.
    """
    count = len(rows) // len(steps)
    values: Array = rows.drop(columns="step").to_numpy(dtype=float)
    sound = np.isfinite(values) | (may_miss & np.isnan(values))
    if not np.array_equal(rows.step, np.repeat(steps, count)) or not sound.all():
        raise refusal(path, "must have the same rows in every step of steps.csv, and finite numbers", "step")
    return values.reshape(len(steps), count, values.shape[1])


def _folder(folder: StrPath) -> Path:
    """The folder that holds the tables."""
    path = Path(folder)
    if (path / CORRECTED / SUMMARY).is_file() and not (path / SUMMARY).is_file():
        path = path / CORRECTED
    if missing := [n for n in (SUMMARY, STEPS, SHAPE, TENSIONS) if not (path / n).is_file()]:
        what = f"{missing[0]} is missing" if path.exists() else "no such folder"
        raise refusal(
            path, f"{what}; must be a folder with results of tdcr-fe run, follow or identify (of one folder)"
        )
    return path


def _nodes(path: Path, steps: list[int]) -> Nodes:
    """Poses of the nodes from ``shape.csv``."""
    columns = ["step", "s", "x", "y", "z", "qw", "qx", "qy", "qz"]
    values = _by_step(_table(path, columns)[columns], path, steps)
    if np.any(np.abs(np.linalg.norm(values[:, :, 4:], axis=-1) - 1.0) > 1e-3):
        raise refusal(path, "must be unit quaternions", "qw, qx, qy, qz")
    return Nodes(values[0, :, 0], values[:, :, 1:4], values[:, :, 4:])


def _tensions(path: Path, names: list[str], steps: list[int]) -> tuple[tuple[Array, ...], tuple[Any, ...]]:
    """By tendon: tensions of shape (n_steps, n_segments), and the states of holes by step."""
    table = _table(path, ["step", "segment", "tension"], ["tendon", "hole_state"])
    if wrong := sorted(set(table.hole_state) - set(HOLE_STATES)):
        raise refusal(path, f"must be one of {', '.join(HOLE_STATES)}", "hole_state", wrong[0])
    by_tendon = [table[table.tendon == name] for name in names]
    tensions = tuple(_by_step(rows[["step", "tension"]], path, steps)[:, :, 0] for rows in by_tendon)
    return tensions, tuple(rows.hole_state.to_numpy().reshape(len(steps), -1) for rows in by_tendon)


def _markers(folder: Path, steps: list[int]) -> Markers | None:
    """Measured markers and the declared model's backbone, where `identify` has written them."""
    if not (folder / MARKERS).is_file():
        return None
    columns, paths = ["step", "s", "x", "y", "z"], (folder / MARKERS, folder / DECLARED)
    measured, declared = (_by_step(_table(path, columns)[columns], path, steps, True) for path in paths)
    return Markers(measured[0, :, 0], measured[:, :, 1:], declared[:, :, 1:])


def read_motion(folder: StrPath) -> Motion:
    """Read what a drawing needs from the results of a run, a followed path or an identification.

    Parameters
    ----------
    folder
        With ``steps.csv``, ``shape.csv``, ``tensions.csv`` and ``summary.json``; that of `identify` has them in
        ``corrected``.

    Raises
    ------
    InputError
        The folder has no such results, or a file is not as it was written.
    """
    path = _folder(folder)
    with _reading(path / SUMMARY):
        summary = json.loads((path / SUMMARY).read_text(encoding="utf-8"))
        if "geometry" not in summary:
            text = "missing; written since version 0.2: run the scenario again"
            raise refusal(path / SUMMARY, text, "geometry")
        shape = summary["geometry"]
        names = [str(t["name"]) for t in shape["tendons"]]
        columns = tendon_columns(names)
        table = _table(path / STEPS, ["step", *columns], ["label"])
        steps = [int(x) for x in table.step]
        if not steps:
            raise refusal(path / STEPS, "no step was solved, so there is nothing to draw")
        tensions, states = _tensions(path / TENSIONS, names, steps)
        nodes = _nodes(path / SHAPE, steps)
        m, by_step = len(names), {int(s["step"]): s for s in summary["steps"]}
        inputs = [by_step[k] for k in steps]
        return assemble(
            shape,
            nodes,
            name=str(summary["robot"]["name"]),
            steps=tuple(steps),
            labels=tuple(table.label),
            tensions=tensions,
            hole_states=states,
            base_tensions=table[columns[:m]].to_numpy(dtype=float),
            displacements=table[columns[m : 2 * m]].to_numpy(dtype=float),
            driven_by_displacement=np.array(
                [[n in s.get("displacement_controlled", ()) for n in names] for s in inputs], dtype=bool
            ).reshape(len(steps), m),
            loads=tuple({n: Load(**load) for n, load in s.get("loads", {}).items()} for s in inputs),
            gravity=np.array(summary["model"]["gravity"], dtype=float),
            friction=summary["model"]["friction"] != "none",
            markers=_markers(path, steps),
        )


def write_markers(markers: Markers, steps: Iterable[int], folder: Path) -> None:
    """Write ``markers.csv`` and ``declared.csv`` into a folder: ``step,s,x,y,z``, in the robot's frame."""
    numbers = list(steps)
    count = markers.declared.shape[1]
    share = np.linspace(0.0, 1.0, count) if count else np.zeros(0)
    for name, s, points in ((MARKERS, markers.s, markers.measured), (DECLARED, share, markers.declared)):
        places = {"step": np.repeat(numbers, len(s)), "s": np.tile(s, len(numbers))}
        table = pd.DataFrame(places | dict(zip("xyz", points.reshape(-1, 3).T, strict=True)))
        table.to_csv(folder / name, index=False)


# ------------------------------------------------------------------------------------------------ files for ParaView

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

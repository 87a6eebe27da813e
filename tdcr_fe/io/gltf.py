"""Write a motion as one animated glTF file (.glb), which Blender, PowerPoint and most 3D viewers open."""

from __future__ import annotations

import json
import struct
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from tdcr_fe.io.atomic import write_bytes
from tdcr_fe.report.motion import Motion
from tdcr_fe.report.viewer_data import thinned

Array = NDArray[np.float64]

#: Seconds from one load step to the next.
SECONDS = 0.25
#: Sides of a rod.
SIDES = 16
#: Smallest radius of backbone and tendons, over the length of the backbone [1]; wires would be invisible.
THINNEST_BACKBONE, THINNEST_TENDON = 0.002, 0.001
#: Thickness of a disk that has none, over its radius [1].
THIN_DISK = 0.1
#: Colours (linear RGB).
COLOURS = {"backbone": (0.07, 0.11, 0.16), "disk": (0.60, 0.64, 0.68), "plate": (0.15, 0.18, 0.23)}
TENDONS = ((0.54, 0.03, 0.07), (0.0, 0.19, 0.25), (0.58, 0.16, 0.0), (0.14, 0.07, 0.29), (0.05, 0.19, 0.07))

_FLOAT, _SHORT = 5126, 5123
_ARRAY, _ELEMENTS = 34962, 34963


def _rod() -> tuple[Array, Array, NDArray[np.int64]]:
    """Points, normals and triangles of a closed rod of radius 1 from z = 0 to z = 1."""
    angle = 2.0 * np.pi * np.arange(SIDES) / SIDES
    ring = np.stack((np.cos(angle), np.sin(angle), 0.0 * angle), axis=-1)
    up = np.tile([0.0, 0.0, 1.0], (SIDES, 1))
    points = np.concatenate((ring, ring + up, ring, ring + up))
    normals = np.concatenate((ring, ring, -up, up))
    k, n = np.arange(SIDES), SIDES
    after = (k + 1) % n
    wall = np.concatenate(
        (np.stack((k, after, n + after), axis=-1), np.stack((k, n + after, n + k), axis=-1))
    )
    fan = np.arange(1, n - 1)
    bottom = np.stack((0 * fan, fan + 1, fan), axis=-1) + 2 * n
    top = np.stack((0 * fan, fan, fan + 1), axis=-1) + 3 * n
    return points, normals, np.concatenate((wall, bottom, top)).ravel()


def _aligned(rotations: Array, chords: Array) -> Array:
    """Rotations turned by the least angle so that their third axis has the direction of a chord, as x, y, z, w.

    Parameters
    ----------
    rotations
        qw, qx, qy, qz, shape (n, 4).
    chords
        Shape (n, 3).
    """
    base = Rotation.from_quat(np.roll(rotations, -1, axis=1))
    tangent = base.apply([0.0, 0.0, 1.0])
    way = chords / np.maximum(np.linalg.norm(chords, axis=1, keepdims=True), 1e-300)
    least = np.column_stack((np.cross(tangent, way), 1.0 + np.sum(tangent * way, axis=1)))
    opposite = least[:, 3] < 1e-9
    least[opposite] = [1.0, 0.0, 0.0, 0.0]
    found: Array = (Rotation.from_quat(least) * base).as_quat()
    return found


def _continuous(quaternions: Array) -> Array:
    """The same rotations with signs such that each is near the one before."""
    found = quaternions.copy()
    for k in range(1, len(found)):
        if found[k] @ found[k - 1] < 0.0:
            found[k] *= -1.0
    return found


class _Model:
    """The glTF document while its nodes are added."""

    def __init__(self, motion: Motion) -> None:
        self.motion = motion
        self.data = bytearray()  # binary part of the file
        self.views: list[dict[str, int]] = []
        self.accessors: list[dict[str, Any]] = []
        self.nodes: list[dict[str, Any]] = []
        self.samplers: list[dict[str, Any]] = []
        self.channels: list[dict[str, Any]] = []
        self.materials: list[dict[str, Any]] = []
        self.meshes: list[dict[str, Any]] = []
        points, normals, triangles = _rod()
        position, normal = self.array(points, bounds=True, target=_ARRAY), self.array(normals, target=_ARRAY)
        indices = self.array(triangles, target=_ELEMENTS)
        self.shape = {"attributes": {"POSITION": position, "NORMAL": normal}, "indices": indices}
        self.times = self.array(SECONDS * np.arange(len(motion.steps), dtype=float), bounds=True)

    def array(self, values: NDArray[np.generic], bounds: bool = False, target: int | None = None) -> int:
        """Number of the accessor of an array of floats, or of whole numbers."""
        whole = values.dtype.kind in "iu"
        stored = np.ascontiguousarray(values, dtype="<u2" if whole else "<f4")
        view = {"buffer": 0, "byteOffset": len(self.data), "byteLength": stored.nbytes}
        self.views.append(view if target is None else {**view, "target": target})
        self.data += stored.tobytes() + b"\0" * (-stored.nbytes % 4)
        accessor: dict[str, Any] = {
            "bufferView": len(self.views) - 1,
            "componentType": _SHORT if whole else _FLOAT,
            "count": len(values),
            "type": "SCALAR" if values.ndim == 1 else f"VEC{values.shape[1]}",
        }
        if bounds:
            rows = stored.reshape(len(values), -1)
            accessor |= {"min": rows.min(axis=0).tolist(), "max": rows.max(axis=0).tolist()}
        self.accessors.append(accessor)
        return len(self.accessors) - 1

    def mesh(self, name: str, colour: tuple[float, float, float]) -> int:
        """Number of a rod of that colour."""
        surface = {"baseColorFactor": [*colour, 1.0], "metallicFactor": 0.1, "roughnessFactor": 0.6}
        self.materials.append({"name": name, "pbrMetallicRoughness": surface})
        self.meshes.append(
            {"name": name, "primitives": [{**self.shape, "material": len(self.materials) - 1}]}
        )
        return len(self.meshes) - 1

    def add(self, name: str, mesh: int, place: Array, turn: Array, size: Array) -> None:
        """A rod that moves: place (n, 3), turn as x, y, z, w (n, 4) and size (n, 3) by load step."""
        turn = _continuous(turn)
        first = {"translation": place[0], "rotation": turn[0], "scale": size[0]}
        self.nodes.append({"name": name, "mesh": mesh, **{k: v.tolist() for k, v in first.items()}})
        if len(place) < 2:
            return
        for path, values in (("translation", place), ("rotation", turn), ("scale", size)):
            if np.all(values == values[0]):
                continue
            self.samplers.append({"input": self.times, "output": self.array(values)})
            target = {"node": len(self.nodes) - 1, "path": path}
            self.channels.append({"sampler": len(self.samplers) - 1, "target": target})

    def side(self, name: str, mesh: int, start: Array, end: Array, turn: Array, radius: float) -> None:
        """A rod from start to end by load step, shape (n, 3) each; ``turn`` of the section at its start, (n, 4)."""
        chord = end - start
        length = np.linalg.norm(chord, axis=1)
        size = np.column_stack((np.full(len(length), radius), np.full(len(length), radius), length))
        self.add(name, mesh, start, _aligned(turn, chord), size)

    def document(self) -> dict[str, Any]:
        """The JSON part of the file; a node above all turns z up into the y up of glTF."""
        half = float(np.sqrt(0.5))
        root = {
            "name": self.motion.name,
            "rotation": [-half, 0.0, 0.0, half],
            "children": list(range(len(self.nodes))),
        }
        animation = {"name": "load steps", "samplers": self.samplers, "channels": self.channels}
        return {
            "asset": {"version": "2.0", "generator": "tdcr-fe"},
            "scene": 0,
            "scenes": [{"nodes": [len(self.nodes)]}],
            "nodes": [*self.nodes, root],
            "meshes": self.meshes,
            "materials": self.materials,
            **({"animations": [animation]} if self.channels else {}),
            "accessors": self.accessors,
            "bufferViews": self.views,
            "buffers": [{"byteLength": len(self.data)}],
        }


def glb(motion: Motion) -> bytes:
    """The motion as the contents of a ``.glb`` file: rods for backbone, tendons and disks, animated by load step.

    Lengths are in m, `SECONDS` of the animation are one load step. Thin parts are drawn thicker, and very
    long results are thinned out as in the 3D page.
    """
    m = thinned(motion)
    model = _Model(m)
    section = [np.roll(m.rotations[:, i], -1, axis=1) for i in range(len(m.s))]
    backbone, disk = model.mesh("backbone", COLOURS["backbone"]), model.mesh("disk", COLOURS["disk"])
    plate = model.mesh("base plate", COLOURS["plate"])
    for i in range(len(m.s) - 1):
        radius = max(float(m.radius[i : i + 2].mean()), THINNEST_BACKBONE * m.length)
        ends = m.positions[:, i], m.positions[:, i + 1]
        model.side(f"backbone {i + 1}", backbone, *ends, m.rotations[:, i], radius)
    height = max(m.disk_thickness, THIN_DISK * m.disk_radius)
    for number, k in enumerate(m.disks, start=1):
        up = Rotation.from_quat(section[k]).apply([0.0, 0.0, -0.5 * height])
        size = np.tile([m.disk_radius, m.disk_radius, height], (len(m.steps), 1))
        model.add(f"disk {number}", disk, m.positions[:, k] + up, section[k], size)
    still = np.tile([1.6 * m.disk_radius, 1.6 * m.disk_radius, height], (1, 1))
    model.add("base plate", plate, np.array([[0.0, 0.0, -height]]), np.array([[0.0, 0.0, 0.0, 1.0]]), still)
    for j, tendon in enumerate(m.tendons):
        mesh = model.mesh(f"tendon {tendon.name}", TENDONS[j % len(TENDONS)])
        corners = np.array([m.tendon_points(k, tendon) for k in range(len(m.steps))])
        for i in range(corners.shape[1] - 1):
            turn = m.rotations[:, tendon.frames[i]]
            name = f"{tendon.name} {i + 1}"
            model.side(name, mesh, corners[:, i], corners[:, i + 1], turn, THINNEST_TENDON * m.length)
    text = json.dumps(model.document(), separators=(",", ":")).encode()
    text += b" " * (-len(text) % 4)
    data = bytes(model.data)
    chunks = struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(data), b"BIN\0") + data
    return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks


def write_glb(motion: Motion, path: str | Path) -> None:
    """Write a ``.glb`` file; its folder is made where it does not exist."""
    write_bytes(glb(motion), path)

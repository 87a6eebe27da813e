"""The glTF file: well formed by the rules of the format, and its nodes are where the robot is in every load step."""

from __future__ import annotations

import json
import struct

import numpy as np
import pytest
from arcs import arc_result, paper_robot
from scipy.spatial.transform import Rotation

from tdcr_fe.io.gltf import SECONDS, glb
from tdcr_fe.report.motion import motion_of

RESULT = arc_result(paper_robot(2))
COLUMNS = {"SCALAR": 1, "VEC3": 3, "VEC4": 4}


@pytest.fixture(scope="module")
def read():
    """The document, and its arrays by the number of their accessor."""
    raw = glb(motion_of(RESULT))
    magic, version, length = struct.unpack("<4sII", raw[:12])
    assert (magic, version, length) == (b"glTF", 2, len(raw))
    size, kind = struct.unpack("<I4s", raw[12:20])
    assert kind == b"JSON" and size % 4 == 0
    document = json.loads(raw[20 : 20 + size])
    count, kind = struct.unpack("<I4s", raw[20 + size : 28 + size])
    data = raw[28 + size :]
    assert kind == b"BIN\0" and count == len(data) == document["buffers"][0]["byteLength"] and count % 4 == 0
    arrays = []
    for a in document["accessors"]:
        view = document["bufferViews"][a["bufferView"]]
        assert view["byteOffset"] % 4 == 0
        part = data[view["byteOffset"] : view["byteOffset"] + view["byteLength"]]
        values = np.frombuffer(part, "<f4" if a["componentType"] == 5126 else "<u2")
        assert len(values) == a["count"] * COLUMNS[a["type"]]
        arrays.append(values.reshape(a["count"], -1))
    return document, arrays


def moving(read, name):
    """Translation, rotation and scale of a node by load step."""
    document, arrays = read
    (number,) = (i for i, n in enumerate(document["nodes"]) if n["name"] == name)
    node, (animation,) = document["nodes"][number], document["animations"]
    found = {p: np.tile(node[p], (10, 1)) for p in ("translation", "rotation", "scale")}
    for c in animation["channels"]:
        if c["target"]["node"] == number:
            sampler = animation["samplers"][c["sampler"]]
            assert arrays[sampler["input"]].ravel() == pytest.approx(SECONDS * np.arange(10))
            found[c["target"]["path"]] = arrays[sampler["output"]]
    return found


def ends(found):
    """Where a rod begins and ends by load step."""
    axis = Rotation.from_quat(found["rotation"]).apply([0.0, 0.0, 1.0])
    return found["translation"], found["translation"] + found["scale"][:, 2:] * axis


def test_every_part_of_the_robot_is_a_node_below_one_that_turns_z_up(read):
    document, _ = read
    names = [n["name"] for n in document["nodes"]]
    assert len(names) == len(set(names)) == 26 + 13 + 1 + 2 * 13 + 1
    root = document["nodes"][document["scenes"][0]["nodes"][0]]
    assert root["children"] == list(range(len(names) - 1))
    up = Rotation.from_quat(root["rotation"]).apply([0.0, 0.0, 1.0])
    assert up == pytest.approx([0.0, 1.0, 0.0], abs=1e-12)


def test_rods_lie_between_nodes_and_between_holes_in_every_step(read):
    for i in (0, 12, 25):
        start, end = ends(moving(read, f"backbone {i + 1}"))
        assert start == pytest.approx(np.array([s.positions[i] for s in RESULT.steps]), abs=1e-7)
        assert end == pytest.approx(np.array([s.positions[i + 1] for s in RESULT.steps]), abs=1e-7)
    motion = motion_of(RESULT)
    corners = np.array([motion.tendon_points(k, motion.tendons[1]) for k in range(10)])
    start, end = ends(moving(read, "t2 5"))
    assert start == pytest.approx(corners[:, 4], abs=1e-7) and end == pytest.approx(corners[:, 5], abs=1e-7)


def test_disks_turn_with_their_sections(read):
    found = moving(read, "disk 13")
    start, end = ends(found)
    assert (start + end) / 2.0 == pytest.approx(RESULT.tips, abs=1e-7)
    tangents = np.array([s.tangent for s in RESULT.steps])
    assert (end - start) / found["scale"][:, 2:] == pytest.approx(tangents, abs=1e-6)
    assert found["scale"][:, 0] == pytest.approx(5e-3)
    turns = found["rotation"]
    assert np.all(np.sum(turns[1:] * turns[:-1], axis=1) > 0.0)  # no detour between two steps


def test_triangles_are_seen_from_outside_and_close_the_rod(read):
    document, arrays = read
    shape = document["meshes"][0]["primitives"][0]
    points, normals = (arrays[shape["attributes"][n]] for n in ("POSITION", "NORMAL"))
    corners = points[arrays[shape["indices"]].reshape(-1, 3)]
    area = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]) / 2.0
    outward = normals[arrays[shape["indices"]].reshape(-1, 3)].mean(axis=1)
    assert np.all(np.sum(area * outward, axis=1) > 0.0)
    volume = np.sum(corners.mean(axis=1) * area) / 3.0
    assert volume == pytest.approx(16 * np.sin(2 * np.pi / 16) / 2, rel=1e-6)
    assert np.sum(area, axis=0) == pytest.approx([0.0, 0.0, 0.0], abs=1e-6)

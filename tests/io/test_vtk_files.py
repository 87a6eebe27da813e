"""Files for ParaView: points, cells and values are those of the result, read back by their format's rules."""

from __future__ import annotations

import base64
from dataclasses import replace
from xml.etree import ElementTree

import numpy as np
import pytest
from arcs import arc_result, paper_robot

from tdcr_fe.io.vtk_files import PARTS, write_vtk
from tdcr_fe.model.loading import Load, LoadStep, resolve
from tdcr_fe.report.motion import motion_of
from tdcr_fe.report.viewer_data import STATES

TYPES = {"Float32": "<f4", "Int32": "<i4", "UInt8": "u1"}


def arrays(parent):
    """Arrays by name; header (number of bytes) and data are one base64 text, as VTK has it without compression."""
    found = {}
    for x in parent:
        raw = base64.b64decode(x.text, validate=True)
        assert int(np.frombuffer(raw[:4], "<u4")[0]) == len(raw) - 4
        values = np.frombuffer(raw[4:], TYPES[x.get("type")])
        columns = int(x.get("NumberOfComponents", 1))
        found[x.get("Name")] = values.reshape(-1, columns) if columns > 1 else values
    return found


@pytest.fixture(scope="module")
def case(tmp_path_factory):
    robot = paper_robot(2)
    loads = {"tip": Load(0.25, (0.0, 0.05, 0.0), moment=(0.0, 1e-3, 0.0))}
    steps = [LoadStep("", {"t1": 0.5 * k}, loads=loads if k == 2 else {}) for k in (1, 2)]
    result = arc_result(robot, steps)
    solved = zip(result.steps, resolve(robot, steps), strict=True)
    result = replace(result, steps=tuple(replace(s, actuation=a) for s, a in solved))
    folder = tmp_path_factory.mktemp("vtk")
    return result, folder, write_vtk(motion_of(result), folder)


def test_the_list_names_a_file_for_every_load_step(case):
    _, folder, written = case
    assert sorted(p.name for p in written) == ["robot.pvd", "robot_0001.vtp", "robot_0002.vtp"]
    rows = ElementTree.parse(folder / "robot.pvd").getroot().findall("Collection/DataSet")
    assert [(r.get("timestep"), r.get("file")) for r in rows] == [
        ("1", "robot_0001.vtp"),
        ("2", "robot_0002.vtp"),
    ]


def test_points_cells_and_values_are_those_of_the_result(case):
    result, folder, _ = case
    step = result.steps[1]
    piece = ElementTree.parse(folder / "robot_0002.vtp").getroot().find("PolyData/Piece")
    points = arrays(piece.find("Points"))["Points"]
    cells = {kind: arrays(piece.find(kind)) for kind in ("Verts", "Lines", "Polys")}
    of_cells, of_points = arrays(piece.find("CellData")), arrays(piece.find("PointData"))
    sizes = [len(cells[kind]["offsets"]) for kind in cells]
    assert sizes == [2 * 13 + 2, 1 + 2 * 13, 13]
    assert [int(piece.get(f"NumberOf{k}")) for k in cells] == sizes and len(points) == int(
        piece.get("NumberOfPoints")
    )
    assert all(len(x) == sum(sizes) for x in of_cells.values())
    assert all(len(x) == len(points) for x in of_points.values())
    used = np.concatenate([x["connectivity"] for x in cells.values()])
    assert np.array_equal(used, np.arange(len(points)))

    line = cells["Lines"]["connectivity"][: cells["Lines"]["offsets"][0]]
    assert points[line] == pytest.approx(step.positions, abs=1e-8)
    assert of_points["arc_length"][line] == pytest.approx(step.s)
    lines = slice(sizes[0], sizes[0] + sizes[1])
    assert [PARTS[k] for k in of_cells["part"][lines]] == ["backbone", *["tendon"] * 26]
    assert of_cells["tension"][lines][1:14] == pytest.approx(step.tensions[0], rel=1e-6)
    assert [STATES[k] for k in of_cells["hole_state"][:13]] == list(step.hole_states[0])
    hole = step.positions[2] + step.rotations[2] @ [4.5e-3, 0.0, 0.0]
    assert points[0] == pytest.approx(hole, abs=1e-8)
    at = sizes[0] - 2
    assert points[at : at + 2] == pytest.approx(np.stack([step.tip, step.tip]), abs=1e-8)
    assert of_points["force"][at] == pytest.approx([0.0, 0.05, 0.0])
    assert of_points["moment"][at + 1] == pytest.approx([0.0, 1e-3, 0.0])
    assert np.count_nonzero(of_points["force"]) == np.count_nonzero(of_points["moment"]) == 1
    rim = points[cells["Polys"]["connectivity"]].reshape(13, -1, 3)
    assert np.linalg.norm(rim - step.positions[2::2, None], axis=-1) == pytest.approx(5e-3, abs=1e-8)

"""Results: files with documented columns, none incomplete; files for ParaView; in Python, a summary and tables."""

import base64
import html
import json
import math
from dataclasses import replace
from xml.etree import ElementTree

import numpy as np
import pytest
from arcs import arc_result, arc_step, paper_robot
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

import tdcr_fe as tdcr
from tdcr_fe import Load, LoadStep, write_results
from tdcr_fe.io import result_files as output
from tdcr_fe.io.result_folder import PARTS, write_vtk
from tdcr_fe.model.columns import quaternions
from tdcr_fe.report.motion import motion_of
from tdcr_fe.report.viewer import STATES


def test_columns_are_those_of_the_format_also_without_a_solved_step(tmp_path):
    full = arc_result(paper_robot(2))
    none = replace(full, steps=(), converged=False, failed_step=1, message="no")
    for result, pictures in ((full, False), (none, True)):
        written = write_results(result, tmp_path / "out", pictures=pictures)
        head = {p.name: p.read_text("utf-8").splitlines()[0] for p in written}
        assert set(head) == set(output.RESULT_FILES)
        assert head["steps.csv"] == (
            "step,label,converged,iterations,tension_t1,tension_t2,displacement_t1,displacement_t2,"
            "tip_x,tip_y,tip_z,tangent_x,tangent_y,tangent_z,bending_angle_deg,chord_angle_deg,tip_offset"
        )
        assert head["shape.csv"] == "step,s,x,y,z,qw,qx,qy,qz"
        assert head["tensions.csv"] == "step,tendon,segment,tension,hole_state"
    assert all((tmp_path / "out" / n).read_text().count("\n") == 1 for n in output.RESULT_FILES[:3])


@given(st.lists(st.floats(-4.0, 4.0), min_size=3, max_size=3))
def test_quaternion_is_a_unit_one_of_the_section_with_qw_not_negative(rotvec):
    rotation = Rotation.from_rotvec(rotvec).as_matrix()[None]
    (q,) = quaternions(rotation)
    assert q[0] >= 0.0
    assert np.linalg.norm(q) == pytest.approx(1.0, abs=1e-14)
    assert Rotation.from_quat(q[[1, 2, 3, 0]]).as_matrix() == pytest.approx(rotation[0], abs=1e-12)
    # They run on at half a turn.
    q = quaternions(Rotation.from_rotvec(np.outer([0.9 * np.pi, np.pi, np.pi], [1.0, 0.0, 0.0])).as_matrix())
    assert np.all(q[:, 1] > 0.9) and np.all(q[:, 0] >= 0.0)


def test_summary_names_versions_settings_digest_and_outcome(tmp_path):
    settings = {"tolerance": np.float64(1e-10), "limits": np.array([1, 2]), "worst": math.inf}
    result = arc_result(settings=settings, warnings=("careful",))
    write_results(result, tmp_path, {"scenario.toml": "ab" * 32}, 10, pictures=False)
    summary = json.loads((tmp_path / "summary.json").read_text("utf-8"))
    assert set(summary["versions"]) == {"tdcr_fe", "exudyn", "numpy", "scipy", "numba", "python"}
    assert summary["versions"]["numpy"] == np.__version__
    assert summary["settings"] == {"tolerance": 1e-10, "limits": [1, 2], "worst": None}
    assert summary["input"] == {"scenario.toml": {"sha256": "ab" * 32}}
    assert (summary["converged"], summary["failed_step"]) == (True, None)
    assert (summary["steps_asked"], summary["steps_solved"]) == (10, 10)
    assert summary["warnings"] == ["careful"]
    assert summary["wall_time"] == 0.1
    assert summary["model"]["friction"] == "per-hole"


def test_a_notebook_shows_the_page_that_a_run_writes(tmp_path, monkeypatch):
    monkeypatch.setattr("tdcr_fe.report.plots.save_pictures", lambda result, folder: [])
    result = arc_result()
    write_results(result, tmp_path)
    shown = tdcr.view(result)._repr_html_()
    page = (tmp_path / "view.html").read_text("utf-8")
    assert shown.startswith("<iframe srcdoc=") and html.unescape(shown.split('"')[1]) == page


# ------------------------------------------------------------ vtk files


def arrays(parent):
    """Arrays by name; header (number of bytes) and data are one base64 text, as VTK has it without compression."""
    found = {}
    for x in parent:
        raw = base64.b64decode(x.text, validate=True)
        assert int(np.frombuffer(raw[:4], "<u4")[0]) == len(raw) - 4
        values = np.frombuffer(raw[4:], {"Float32": "<f4", "Int32": "<i4", "UInt8": "u1"}[x.get("type")])
        columns = int(x.get("NumberOfComponents", 1))
        found[x.get("Name")] = values.reshape(-1, columns) if columns > 1 else values
    return found


def test_vtk_files_have_points_cells_and_values_of_every_load_step(tmp_path):
    loads = {"tip": Load(0.25, (0.0, 0.05, 0.0), moment=(0.0, 1e-3, 0.0))}
    steps = [LoadStep("", {"t1": 0.5 * k}, loads=loads if k == 2 else {}) for k in (1, 2)]
    result = arc_result(paper_robot(2), steps)
    written = write_vtk(motion_of(result), tmp_path)
    assert sorted(p.name for p in written) == ["robot.pvd", "robot_0001.vtp", "robot_0002.vtp"]
    rows = ElementTree.parse(tmp_path / "robot.pvd").getroot().findall("Collection/DataSet")
    assert {r.get("timestep"): r.get("file") for r in rows} == {"1": "robot_0001.vtp", "2": "robot_0002.vtp"}

    step = result.steps[1]
    piece = ElementTree.parse(tmp_path / "robot_0002.vtp").getroot().find("PolyData/Piece")
    points = arrays(piece.find("Points"))["Points"]
    cells = {kind: arrays(piece.find(kind)) for kind in ("Verts", "Lines", "Polys")}
    of_cells, of_points = arrays(piece.find("CellData")), arrays(piece.find("PointData"))
    sizes = [len(cells[kind]["offsets"]) for kind in cells]
    assert sizes == [2 * 13 + 2, 1 + 2 * 13, 13]
    assert [int(piece.get(f"NumberOf{kind}")) for kind in (*cells, "Points")] == [*sizes, len(points)]
    assert all(len(x) == sum(sizes) for x in of_cells.values())
    assert all(len(x) == len(points) for x in of_points.values())
    assert np.array_equal(np.concatenate([x["connectivity"] for x in cells.values()]), np.arange(len(points)))

    line = cells["Lines"]["connectivity"][: cells["Lines"]["offsets"][0]]
    assert points[line] == pytest.approx(step.positions, abs=1e-8)
    assert of_points["arc_length"][line] == pytest.approx(step.s)
    lines = slice(sizes[0], sizes[0] + sizes[1])
    assert [PARTS[k] for k in of_cells["part"][lines]] == ["backbone", *["tendon"] * 26]
    assert of_cells["tension"][lines][1:14] == pytest.approx(step.tensions[0], rel=1e-6)
    assert [STATES[k] for k in of_cells["hole_state"][:13]] == list(step.hole_states[0])
    assert points[0] == pytest.approx(step.positions[2] + step.rotations[2] @ [4.5e-3, 0.0, 0.0], abs=1e-8)
    at = sizes[0] - 2
    assert points[at : at + 2] == pytest.approx(np.stack([step.tip, step.tip]), abs=1e-8)
    assert of_points["force"][at] == pytest.approx([0.0, 0.05, 0.0])
    assert of_points["moment"][at + 1] == pytest.approx([0.0, 1e-3, 0.0])
    assert np.count_nonzero(of_points["force"]) == np.count_nonzero(of_points["moment"]) == 1
    rim = points[cells["Polys"]["connectivity"]].reshape(13, -1, 3)
    assert np.linalg.norm(rim - step.positions[2::2, None], axis=-1) == pytest.approx(5e-3, abs=1e-8)


# ------------------------------------------------------------------------------------------------ in Python


def test_a_result_prints_in_ten_lines():
    """Robot, model, steps, status, last step, tip, tension, displacement and warnings, each with its values."""
    result = replace(arc_result(paper_robot(2)), warnings=("step 2: first", "step 3: second"))
    last = result.steps[-1]
    text = str(result)
    assert repr(result) == text
    assert len(text.splitlines()) <= 10
    assert max(map(len, text.splitlines())) < 140
    for part in (
        "single-segment: 2 tendons, 13 disks, length 250 mm",
        f"friction {result.model.friction}",
        f"{len(result.steps)} solved;",
        f"({1e3 * last.tip[0]:.3f}, {1e3 * last.tip[1]:.3f}, {1e3 * last.tip[2]:.3f})",
        f"t2 {last.base_tensions[1]:.4g}",
        f"t1 {1e3 * last.displacements[0]:.3f}",
        f"t1 {last.tensions[0][-1]:.4g}",
        "2, the first: step 2: first",
    ):
        assert part in text


def test_angles_and_offset_of_an_arc_in_any_plane():
    step = arc_step(paper_robot(), 1, 1.2, 0.7, np.array([1.0]))
    assert (step.bending_angle, step.chord_angle) == pytest.approx((1.2, 0.6))
    assert step.tip_offset == pytest.approx(0.25 / 1.2 * (1.0 - np.cos(1.2)))


def test_a_failed_result_names_its_step_and_raises_when_asked():
    good = arc_result()
    assert good.raise_if_failed() is good
    message = "step 7 did not converge: use smaller load steps"
    failed = replace(good, converged=False, failed_step=7, message=message)
    assert "step 7 not" in str(failed) and failed.message in str(failed)
    with pytest.raises(RuntimeError, match="use smaller load steps"):
        failed.raise_if_failed()


def test_a_result_without_any_step_or_tendon_prints_too():
    ended = {"converged": False, "failed_step": 1, "message": "step 1 failed"}
    assert "0 solved, step 1 not" in str(replace(arc_result(), steps=(), **ended))
    robot = replace(paper_robot(), tendons=())
    assert "no tendons" in str(arc_result(robot, [LoadStep("still")]))


def test_a_notebook_shows_the_summary_and_the_steps_with_names_escaped():
    page = arc_result(replace(paper_robot(), name="<b>arm</b> & co"))._repr_html_()
    assert "&lt;b&gt;arm&lt;/b&gt; &amp; co" in page and "<b>" not in page
    assert "bending_angle_deg" in page and page.count("<table") == 2

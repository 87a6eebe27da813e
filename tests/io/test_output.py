"""Result files: documented columns, and no incomplete files."""

from __future__ import annotations

import dataclasses
import json
import math

import numpy as np
import pandas as pd
import pytest
from arcs import arc_result, paper_robot
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from tdcr_fe.io import result_files as output
from tdcr_fe.io.result_files import write_results
from tdcr_fe.model.columns import quaternions
from tdcr_fe.model.loading import LoadStep


def read(path):
    """A table, its numbers exactly as written."""
    columns = path.read_text().splitlines()[0].split(",")
    others = {"step", "label", "converged", "iterations", "tendon", "segment", "hole_state"}
    return pd.read_csv(path, keep_default_na=False, converters=dict.fromkeys(set(columns) - others, float))


def test_columns_are_those_of_the_format(tmp_path):
    write_results(arc_result(paper_robot(2)), tmp_path / "out", pictures=False)
    head = {n: (tmp_path / "out" / n).read_text().splitlines()[0] for n in output.RESULT_FILES[:3]}
    assert head["steps.csv"] == (
        "step,label,converged,iterations,tension_t1,tension_t2,displacement_t1,displacement_t2,"
        "tip_x,tip_y,tip_z,tangent_x,tangent_y,tangent_z,bending_angle_deg,chord_angle_deg,tip_offset"
    )
    assert head["shape.csv"] == "step,s,x,y,z,qw,qx,qy,qz"
    assert head["tensions.csv"] == "step,tendon,segment,tension,hole_state"


def test_columns_are_the_same_without_a_solved_step(tmp_path):
    result = dataclasses.replace(arc_result(), steps=(), converged=False, failed_step=1, message="no")
    written = write_results(result, tmp_path / "out")
    assert {p.name for p in written} == set(output.RESULT_FILES)
    full = tmp_path / "full"
    write_results(arc_result(), full)
    for name in output.RESULT_FILES[:3]:
        assert (tmp_path / "out" / name).read_text() == (full / name).read_text().splitlines()[0] + "\n"


def test_steps_hold_what_the_result_says_to_the_last_bit(tmp_path):
    result = arc_result()
    write_results(result, tmp_path, pictures=False)
    table = read(tmp_path / "steps.csv")
    assert list(table["step"]) == list(range(1, 11))
    assert list(table["label"]) == [s.label for s in result.steps]
    assert table["converged"].all() and table["converged"].dtype == bool
    assert np.array_equal(table[["tip_x", "tip_y", "tip_z"]], result.tips)
    assert np.array_equal(table["tension_t1"], [s.base_tensions[0] for s in result.steps])
    assert np.array_equal(table["bending_angle_deg"], [math.degrees(s.bending_angle) for s in result.steps])
    assert table["chord_angle_deg"].to_numpy() == pytest.approx(table["bending_angle_deg"] / 2)
    assert table["tip_offset"].to_numpy() == pytest.approx(np.hypot(table["tip_x"], table["tip_y"]))


@given(st.lists(st.floats(-4.0, 4.0), min_size=3, max_size=3))
def test_quaternion_is_a_unit_one_of_the_section_with_qw_not_negative(rotvec):
    rotation = Rotation.from_rotvec(rotvec).as_matrix()[None]
    (q,) = quaternions(rotation)
    assert q[0] >= 0.0
    assert np.linalg.norm(q) == pytest.approx(1.0, abs=1e-14)
    assert Rotation.from_quat(q[[1, 2, 3, 0]]).as_matrix() == pytest.approx(rotation[0], abs=1e-12)


def test_quaternions_run_on_at_half_a_turn():
    turns = Rotation.from_rotvec(np.outer([0.9 * np.pi, np.pi, np.pi], [1.0, 0.0, 0.0]))
    q = quaternions(turns.as_matrix())
    assert np.all(q[:, 1] > 0.9) and np.all(q[:, 0] >= 0.0)


def test_label_with_comma_quote_and_line_break_comes_back(tmp_path):
    label = 'a, "b"\nc'
    write_results(arc_result(steps=[LoadStep(label, {"t1": 1.0})]), tmp_path, pictures=False)
    assert read(tmp_path / "steps.csv")["label"].tolist() == [label]
    assert json.loads((tmp_path / "summary.json").read_text("utf-8"))["steps"][0]["label"] == label


def test_summary_names_versions_settings_digest_and_outcome(tmp_path):
    result = arc_result(
        settings={"tolerance": np.float64(1e-10), "limits": np.array([1, 2]), "worst": math.inf},
        warnings=("careful",),
    )
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


def test_directory_that_exists_keeps_what_is_not_ours(tmp_path):
    (tmp_path / "notes.txt").write_text("mine")
    (tmp_path / "steps.csv").write_text("old")
    write_results(arc_result(), tmp_path)
    assert (tmp_path / "hysteresis.png").exists()
    write_results(arc_result(), tmp_path, pictures=False)
    assert {p.name for p in tmp_path.iterdir()} == {"notes.txt", *output.RESULT_FILES}
    assert (tmp_path / "steps.csv").read_text() != "old"

"""Cross-validation: the cases, the comparison, the studies, resuming, and the report."""

import json
import re
from dataclasses import replace
from itertools import product

import numpy as np
import pytest

from tdcr_fe.cli import main
from tdcr_fe.io.files import plain
from tdcr_fe.validation.crosscheck import cases, compare, report, studies
from tdcr_fe.validation.crosscheck import run as solving

ALL = cases.all_cases()
BY_ID = {case.id: case for case in ALL}


def test_the_cases_cover_routings_models_and_loads_with_5_to_20_disks():
    grid = {(c.routing, c.model.tendon_path, c.model.friction, c.load) for c in ALL if c.group == "grid"}
    expected = {(r, *m, load) for r, m, load in product(cases.ROUTINGS, cases.MODELS, cases.LOADS)}
    assert grid == expected
    assert {(c.routing, c.model.tendon_path, c.model.friction, c.load) for c in ALL if c.quick} >= expected
    assert {c.disks for c in ALL if c.group == "grid"} == {5, 10, 15, 20}
    for routing, friction in product(cases.ROUTINGS, ("per-tendon", "per-hole")):
        history = [c for c in ALL if c.group == "history" and c.quick]
        assert any((c.routing, c.model.friction) == (routing, friction) for c in history)


@pytest.mark.parametrize("name", ["large_parallel_continuous_none_20", "variant_precurved-continuous"])
def test_finite_elements_agree_with_the_reference(name):
    """`tdcr-fe validate` compares all cases."""
    record = compare.compare(BY_ID[name])
    assert record["passed"], record["reasons"]
    assert record["deviation_percent"] < 0.05
    assert record["tension_percent"] < 0.1
    assert record["holes_differing_off_threshold"] == 0
    assert record["outside_bounds"] < 1e-8
    json.dumps(plain(record), allow_nan=False)


def test_a_moved_tip_and_a_wrong_state_are_noticed(monkeypatch):
    honest = compare.simulate

    def wrong(*args, **kwargs):
        result = honest(*args, **kwargs)
        last = result.steps[-1]
        states = ("release", *last.hole_states[0][1:])
        moved = last.positions + np.array([1e-3 * 0.25, 0.0, 0.0])
        last = replace(last, positions=moved, hole_states=(states,))
        increment = kwargs["record_path"][-1][-1]
        (mobilisation,) = increment.state.mobilisation
        wrong = replace(increment.state, mobilisation=(-mobilisation,))
        kwargs["record_path"][-1][-1] = replace(increment, state=wrong)
        return replace(result, steps=(*result.steps[:-1], last))

    monkeypatch.setattr(compare, "simulate", wrong)
    record = compare.compare(replace(few()[1], steps=few()[1].steps[:3]))
    assert not record["passed"]
    assert record["deviation_percent"] == pytest.approx(0.1, abs=0.02)
    assert record["holes_differing_off_threshold"] == 1
    assert record["outside_bounds"] > 1e-3


@pytest.mark.integration
def test_more_elements_reduce_the_error_of_a_compressed_bay():
    """Helical tendon, five disks, gravity: order 1.9 or better at every share of a bay's buckling load."""
    found = studies.near_buckling("helical_straight_none_gravity_5")
    four, eight = (np.array(x) for x in found["deviation_percent"])
    assert np.all(np.diff(four) > 0.0)
    assert np.all(np.log2(four / eight) > report.LEAST_ORDER)
    assert four[found["shares"].index(cases.MOST_COMPRESSION)] < compare.TIP_TOLERANCE < four[-1]


@pytest.mark.parametrize(("kind", "number"), [("closed", 1), ("closed", 2), ("literature", 0)])
def test_both_solvers_find_the_known_tips(kind, number):
    """Closed forms, and a result of a public code, quoted to 1e-9 m; `tdcr-fe validate` has the others."""
    record = studies.known_tip(kind, number)
    coarse, fine = record["deviation_percent"]
    assert record["reference_percent"] < {"closed": 1e-6, "literature": 2e-6}[kind]
    assert coarse < 0.01 and fine < 0.001


def few():
    names = ("parallel_straight_none_no-load_20", "history_parallel_per-hole_tip-out-of-plane_15")
    return [replace(BY_ID[n], steps=BY_ID[n].steps[:4], quick=True) for n in names]


def test_an_error_fails_its_case_and_nothing_else():
    record, failed = (solving.solve(case) for case in (few()[0], replace(few()[0], steps=None)))
    assert failed["error"]
    outcome = report.judge([failed, record], [], False, {"wall": 1.0, "processes": 1, "recalled": 0})
    assert not outcome["passed"]
    assert outcome["counts"]["failing"] == 1
    page = report.to_html(outcome)
    assert failed["error"].split(":")[0] in page and "1 process," in page


@pytest.mark.integration
def test_the_command_writes_one_html_file_and_json_and_returns_its_status(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(cases, "all_cases", few)
    chosen = [s for s in studies.all_studies() if s.id in ("literature_0", "mesh_parallel_continuous_none")]
    monkeypatch.setattr(studies, "all_studies", lambda: [replace(s, quick=True) for s in chosen])
    out = tmp_path / "out"
    # Without closed forms, what must be shown of them is not shown: a requirement fails.
    assert main(["validate", "-o", str(out), "--processes", "2", "-q"]) == 1
    assert "closed forms" in capsys.readouterr().err
    written = json.loads((out / "report.json").read_text())
    assert [c["id"] for c in written["cases"]] == [c.id for c in few()]
    assert {"tip_finite_element", "tip_reference", "deviation_percent", "passed"} <= set(written["cases"][0])
    page = (out / "report.html").read_text()
    assert "All 2 cases pass" in page
    sources = re.findall(r'(?:src|href)="([^"]*)"', page)
    assert sources and all(s.startswith(("data:", "#")) for s in sources)

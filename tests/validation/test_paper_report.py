"""The packaged cases, the verdicts and the report of ``tdcr-fe paper``."""

from __future__ import annotations

import json
import re

import numpy as np
import pytest

from tdcr_fe.cli import main
from tdcr_fe.io.toml import read_scenario
from tdcr_fe.model.loading import LoadStep
from tdcr_fe.solve.simulate import simulate
from tdcr_fe.validation.paper.cases import (
    CASE_IDS,
    MODELS,
    paper_case,
    prototype,
    without_small_steps,
    write_cases,
)
from tdcr_fe.validation.paper.claims import verdicts
from tdcr_fe.validation.paper.claims.order import orders
from tdcr_fe.validation.paper.report import html, to_json, write_docs, write_report
from tdcr_fe.validation.paper.run import PaperRun, run_paper
from tdcr_fe.validation.paper.studies.figures import CaseStudy, run_model
from tdcr_fe.validation.paper.studies.limitations import (
    PressureDependence,
    adhesion,
    disk_thickness,
    pressure_dependent_friction,
)
from tdcr_fe.validation.reference.sequence import solve_reference


@pytest.fixture(scope="module")
def figures() -> PaperRun:
    """Figs. 3 and 5 with every model."""
    run = PaperRun()
    for name in ("fig3", "fig5"):
        case = paper_case(name)
        run.cases[name] = CaseStudy(case, {key: run_model(case, model) for key, model in MODELS.items()})
    return run


@pytest.mark.parametrize("name", CASE_IDS)
def test_a_case_has_the_numbers_of_section_3_1(name):
    robot = paper_case(name).robot
    assert robot.backbone.radius == 0.4e-3
    assert robot.backbone.youngs_modulus == 85e9
    assert robot.backbone.length == (0.4 if name == "fig4" else 0.25)
    assert all(t.friction_coefficient == 0.3 for t in robot.tendons)
    assert {s.label for s in without_small_steps(paper_case(name)).steps} == set(paper_case(name).marked)


@pytest.mark.parametrize("table", [1, 2, 3, 4])
def test_a_prototype_is_that_of_section_3_2(table):
    robot = prototype(table)
    assert (robot.backbone.radius, robot.backbone.length) == (0.45e-3, 0.25)


def test_cases_are_written_for_tdcr_fe_run(tmp_path, capsys):
    written = write_cases(tmp_path)
    assert len(written) == len(CASE_IDS) * len(MODELS)
    for path in written:
        scenario = read_scenario(path)
        assert scenario.model == MODELS[path.stem]
        assert tuple(scenario.steps) == paper_case(path.parent.name).steps
    assert (
        main(
            [
                "run",
                str(tmp_path / "fig5" / "per-tendon.toml"),
                "-o",
                str(tmp_path / "out"),
                "--no-pictures",
                "-q",
            ]
        )
        == 0
    )


def test_an_unknown_case_is_named():
    with pytest.raises(KeyError, match="fig3"):
        paper_case("fig9")


@pytest.mark.parametrize("key", ["classical", "discrete"])
def test_tendons_alone_agree_with_the_reference(key):
    """Fig. 5, last state before the load, within 0.05 % of the length."""
    case = paper_case("fig5")
    steps = case.steps[:3]
    own = simulate(case.robot, MODELS[key], steps).steps[-1]
    other = solve_reference(case.robot, MODELS[key], steps).steps[-1]
    assert np.linalg.norm(own.tip - other.tip) < 5e-4 * case.robot.backbone.length


def test_order_of_the_models_is_not_the_papers(figures):
    """Parallel: discrete > classical > friction. Helical: classical > friction > discrete."""
    states = {(o.case, o.label): o for o in orders(figures)}
    parallel, helical = states["fig3", "pull 1.5 N"], states["fig5", "pull 1.2 N"]
    assert parallel.larger("discrete", "classical") and parallel.larger("classical", "per-tendon")
    assert helical.larger("classical", "discrete") and helical.larger("per-tendon", "discrete")


def test_verdicts_say_so(figures):
    found = {v.claim.split(" ")[0]: v for v in verdicts(figures)}
    assert found["1a."].verdict == "does not hold"
    assert found["1b."].verdict in ("does not hold", "holds in part")
    assert all(v.evidence and v.reason for v in found.values())


def test_all_states_are_stable_on_the_branch_from_the_unloaded_robot(figures):
    for study in figures.cases.values():
        for run in study.runs.values():
            assert not run.failure and not run.snapped
            assert min(s.smallest for s in run.stabilities) > 0.5


def test_thick_disks_bend_less_about_as_a_shorter_rod():
    """13 disks of 1 mm are 5.2 % of the length; the bending angle falls by about as much."""
    case = paper_case("fig3")
    pull = [LoadStep("", {"t1": 0.5})]
    base = simulate(case.robot, MODELS["per-hole"], pull).steps[-1].bending_angle
    (found,) = disk_thickness(case.robot, pull, [1e-3])
    assert found.angle_shift / base == pytest.approx(-0.05, abs=0.01)


def test_adhesion_grows_with_the_drop():
    case = paper_case("fig3")
    found = adhesion(case.robot, [LoadStep("", {"t1": 1.0})], [5e-3, 10e-3])
    assert 1.8 < found[1].tip_shift / found[0].tip_shift < 2.2


def test_pressure_dependence_with_exponent_zero_is_coulombs_law():
    case = paper_case("fig3")
    found = pressure_dependent_friction(
        case.robot, LoadStep("", {"t1": 1.0}), PressureDependence(exponent=0.0)
    )
    assert found.tip_shift < 1e-9


def test_report_is_one_page_and_json_without_nan(figures, tmp_path):
    parts = run_paper(("signs", "stiffness"))
    parts.cases = figures.cases
    page, numbers = write_report(parts, tmp_path, 1.0)
    text = page.read_text(encoding="utf-8")
    assert "data:image/svg+xml" in text and "<link" not in text and "<script src" not in text
    assert all(s.startswith(("data:", "#")) for s in re.findall(r'(?:src|href)="([^"]*)"', text))
    data = json.loads(numbers.read_text(encoding="utf-8"))
    assert len(data["verdicts"]) >= 5
    assert data["stiffness"]["new_load_error"] < 0.02
    assert data == to_json(parts, 1.0)
    written = write_docs(parts, tmp_path / "docs", 1.0)
    assert written[0].name == "paper.md" and (tmp_path / "docs" / "pictures" / "paper_fig3.svg").exists()


def test_the_first_screen_has_a_verdict_line_for_each_claim(figures):
    """In 0.1 the first screen was the full text of all evidence; now the evidence is folded under each claim."""
    found = PaperRun()
    found.cases = figures.cases
    text = html(found, to_json(found, 1.0))
    first = text[: text.index("<nav")]
    claims = verdicts(found)
    assert first.count('class="mark ') == first.count("<details>") == len(claims)
    assert re.search(r"<h1>Of the paper&#39;s claims \d", first)
    assert "<details open" not in first


def test_what_was_finished_is_kept_where_the_user_interrupts(tmp_path, monkeypatch, capsys):
    def stopped(run, report):
        run.thickness.append(None)
        raise KeyboardInterrupt

    monkeypatch.setattr("tdcr_fe.validation.paper.run._limitations", stopped)
    monkeypatch.setattr("tdcr_fe.validation.paper.run.PARTS", ("signs", "limitations", "effects"))
    docs = tmp_path / "docs"
    assert main(["paper", "-o", str(tmp_path), "--docs", str(docs)]) == 130
    assert "unfinished: interrupted in 'limitations'" in capsys.readouterr().err
    data = json.loads((tmp_path / "report.json").read_text(encoding="utf-8"))
    assert data["interrupted"] == "limitations" and len(data["signs"]) == 7 and not data["missing"]
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert "Unfinished: interrupted in" in page
    assert (
        set(re.findall(r'href="#(\w+)"', page))
        == set(re.findall(r'class="section" id="(\w+)"', page))
        == {"signs"}
    )
    assert not docs.exists()
    monkeypatch.setattr("tdcr_fe.validation.paper.run.PARTS", ("limitations", "signs"))
    assert main(["paper", "-o", str(tmp_path / "nothing")]) == 130
    empty = json.loads((tmp_path / "nothing" / "report.json").read_text(encoding="utf-8"))
    assert empty["interrupted"] == "limitations" and not empty["verdicts"]


@pytest.mark.campaign
def test_the_whole_command(tmp_path, capsys):
    assert main(["paper", "-o", str(tmp_path / "out"), "--no-effects"]) == 0
    data = json.loads((tmp_path / "out" / "report.json").read_text(encoding="utf-8"))
    verdict = {v["claim"].split(" ")[0]: v["verdict"] for v in data["verdicts"]}
    assert verdict["1a."] == "does not hold"
    assert verdict["2."] == "does not hold"
    assert verdict["3."] == "holds in part"
    assert data["tables"]["1"]["deviations"]["declared"]["all"]["mean_percent"] > 5.0

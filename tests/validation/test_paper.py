"""The paper's cases and tables, and the verdicts on its claims."""

import pytest

from tdcr_fe.cli import main as command
from tdcr_fe.io.toml import read_scenario
from tdcr_fe.validation.paper.cases import MARKED, MODELS, figure, write_cases
from tdcr_fe.validation.runner import main


@pytest.mark.parametrize("name", MARKED)
def test_a_case_has_the_numbers_of_section_3_1(name):
    case = figure(name)
    backbone = case.robot.backbone
    assert (backbone.radius, backbone.youngs_modulus) == (0.4e-3, 85e9)
    assert backbone.length == (0.4 if name == "fig4" else 0.25)
    assert all(t.friction_coefficient == 0.3 for t in case.robot.tendons)
    assert set(MARKED[name]) <= {s.label for s in case.steps}


@pytest.mark.integration
def test_cases_are_written_for_tdcr_fe_run(tmp_path):
    written = write_cases(tmp_path)
    assert len(written) == len(MARKED) * len(MODELS)
    for path in written:
        scenario = read_scenario(path)
        assert scenario.model == MODELS[path.stem]
        assert scenario.steps == figure(path.parent.name).steps
    scenario = str(tmp_path / "fig5" / "per-tendon.toml")
    assert command(["run", scenario, "-o", str(tmp_path / "out"), "--no-pictures", "-q"]) == 0


@pytest.mark.integration
def test_the_campaign_judges_claims_and_writes_cases(tmp_path, capsys):
    assert main(["paper", "-o", str(tmp_path), "--only", "consistency", "stiffness"]) == 0
    text = (tmp_path / "paper.md").read_text(encoding="utf-8")
    assert "| Tables 1-4 are measurements of one elastic robot each | does not hold |" in text
    assert (tmp_path / "cases" / "fig3" / "per-hole.toml").exists()

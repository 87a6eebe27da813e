"""A sweep gives what single runs give, in the order of cases, whatever happens on the way."""

import math
import os

import numpy as np
import pandas as pd
import pytest
from exudyn.processing import ParameterVariation
from sweep_files import HASTY, SCENARIO, SWEEP, InProcess, varying, write_files

import tdcr_fe as tdcr
from tdcr_fe.sweeps.execution import journal
from tdcr_fe.sweeps.keys import KeyProblem


def test_every_row_is_the_result_of_its_scenario(tmp_path):
    cases = tdcr.sweep(write_files(tmp_path), executor=InProcess()).cases
    assert cases["case"].tolist() == [1, 2, 3, 4, 5, 6]
    assert cases["steps[0].tensions.t1"].tolist() == [0.5, 0.5, 1.0, 1.0, 1.5, 1.5]
    assert cases["backbone.youngs_modulus"].tolist() == [1.0, 1.2] * 3
    assert set(cases["status"]) == {"converged"}
    scenario = tdcr.read_scenario(tmp_path / "scenario.toml")
    for _, row in cases.iterrows():
        robot = scenario.robot.with_backbone(youngs_modulus=85e9 * row["backbone.youngs_modulus"])
        steps = [tdcr.LoadStep(tensions={"t1": row["steps[0].tensions.t1"]})]
        expected = tdcr.simulate(robot, scenario.model, steps, scenario.settings).to_frame().iloc[-1]
        for name in ("tip_x", "tip_z", "bending_angle_deg", "tension_t2", "displacement_t1"):
            assert row[name] == expected[name]


def test_an_interrupted_sweep_continues(tmp_path):
    path = write_files(tmp_path)
    tdcr.sweep(path, tmp_path / "whole", executor=InProcess(), report=False)
    out = tmp_path / "out"
    with pytest.raises(tdcr.Interrupted) as stop:
        tdcr.sweep(path, out, executor=InProcess(stop_after=1), in_flight=1, report=False)
    first = stop.value.result
    done = first.solved_now
    assert first.interrupted and 0 < done < 6
    assert first.counts == {"converged": done, "not run": 6 - done}
    states = pd.read_csv(out / "cases.csv")["status"].tolist()
    assert states == ["converged"] * done + ["not run"] * (6 - done)
    second = tdcr.sweep(path, out, executor=InProcess(), report=False)
    assert second.solved_now == 6 - done and second.converged
    assert (out / "cases.csv").read_bytes() == (tmp_path / "whole" / "cases.csv").read_bytes()
    third = tdcr.sweep(path, out, executor=InProcess(stop_after=0), report=False)
    assert third.solved_now == 0 and third.converged


def test_a_journal_of_another_sweep_is_refused_and_replaced_on_demand(tmp_path):
    out = tmp_path / "out"
    tdcr.sweep(write_files(tmp_path), out, executor=InProcess(), report=False)
    before = (out / "cases.jsonl").read_bytes()
    other = write_files(tmp_path, SWEEP.replace("1.2", "1.3"))
    with pytest.raises(tdcr.InputError, match="of another run: variations differ"):
        tdcr.sweep(other, out, executor=InProcess(), report=False)
    robot = (tmp_path / "robot.toml").read_text().replace("8500", "8000")
    with pytest.raises(tdcr.InputError, match="of another run: tables differ"):
        tdcr.sweep(write_files(tmp_path, robot=robot), out, executor=InProcess(), report=False)
    assert (out / "cases.jsonl").read_bytes() == before
    assert tdcr.sweep(other, out, executor=InProcess(), fresh=True, report=False).converged


def test_two_sweeps_cannot_write_to_one_folder_at_a_time(tmp_path):
    """Both solved all cases, into a journal with every case twice."""
    path, out = write_files(tmp_path), tmp_path / "out"
    with journal(out, {}, fresh=True), pytest.raises(tdcr.InputError, match="another sweep is writing there"):
        tdcr.sweep(path, out, executor=InProcess(), fresh=True, report=False)
    assert tdcr.sweep(path, out, executor=InProcess(), fresh=True, report=False).converged


def test_a_case_that_fails_keeps_its_reason_and_does_not_stop_the_others(tmp_path):
    """50 kN do not converge within four iterations; an offset beyond the disk is no robot."""
    keys = {"steps[0].tensions.t1": [1.0, 5e4], "tendons.offset": [4e-3, 6e-3], "disks.radius": [7e-3, 5e-3]}
    path = write_files(tmp_path, varying(keys), scenario=HASTY)
    result = tdcr.sweep(path, tmp_path / "out", executor=InProcess(), report=False)
    expected = [*["converged"] * 3, "invalid", *["not converged"] * 3, "invalid"]
    assert result.cases["status"].tolist() == expected
    reasons = result.cases["reason"]
    assert "must not lie outside the disk" in reasons[3]
    assert "step 1" in reasons[4]
    assert np.isfinite(result.cases["tip_x"][:3]).all() and result.cases["tip_x"][3:].isna().all()
    assert sum(m.count for m in result.failures["not converged"]) == 3
    assert tdcr.sweep(path, tmp_path / "out", executor=InProcess(), retry=True, report=False).solved_now == 5
    recalled = tdcr.sweep(path, tmp_path / "out", executor=InProcess(), report=False)
    assert recalled.solved_now == 0
    assert recalled.failures == result.failures  # not counted twice, from two lines of the journal


def curvature(result):
    """A number of one's own."""
    return {"chord": float(np.linalg.norm(result.steps[-1].tip)), "steps": len(result.steps)}


def reserved(result):
    """A name that is taken."""
    return {"tip_x": 0.0}


def unlucky(result):
    """Ends its process for one case, and raises for another."""
    tension = result.steps[-1].base_tensions[0]
    if tension == 1.0:
        os._exit(3)
    if tension == 1.5:
        raise ZeroDivisionError("no luck")
    return {"tension": tension}


def test_a_function_of_ones_own_adds_columns(tmp_path):
    result = tdcr.sweep(write_files(tmp_path), executor=InProcess(), evaluate=curvature)
    tips = result.cases[["tip_x", "tip_y", "tip_z"]].to_numpy()
    assert np.allclose(result.cases["chord"], np.linalg.norm(tips, axis=1), rtol=1e-14)
    taken = tdcr.sweep(write_files(tmp_path), executor=InProcess(), evaluate=reserved)
    assert taken.counts == {"error": 6} and "name of another column" in taken.cases["reason"][0]
    with pytest.raises(TypeError, match="function of a module"):
        tdcr.sweep(write_files(tmp_path), executor=InProcess(), evaluate=lambda result: {})


@pytest.mark.integration
def test_a_process_that_dies_costs_its_own_case_only(tmp_path):
    path = write_files(tmp_path, varying({"steps[0].tensions.t1": [1.0, 0.5, 1.5]}))
    result = tdcr.sweep(path, processes=2, evaluate=unlucky)
    assert result.cases["status"].tolist() == ["error", "converged", "error"]
    assert result.cases["tension"][1] == 0.5
    assert "ended without a result" in result.cases["reason"][0]
    assert result.cases["reason"][2] == "ZeroDivisionError: no luck"


def test_chosen_columns_of_a_step_are_those_of_its_end_where_an_effect_divides_it(tmp_path):
    """What arrives of the first tendon stays, while the second is pulled, until it is a command over the efficiency."""
    text = SWEEP + '[output]\nsteps = "all"\nquantities = ["tip_x", "tension_t1"]\n'
    more = "[[steps]]\ntensions = { t1 = 0.1, t2 = 0.5 }\n[effects]\nactuator_loss = { efficiency = 0.8 }\n"
    path = write_files(tmp_path, text, scenario=SCENARIO + more)
    assert tdcr.read_scenario(tmp_path / "scenario.toml").ends == (1, 3)
    result = tdcr.sweep(path, executor=InProcess())
    assert result.outputs == ("tension_t1_step1", "tip_x_step1", "tension_t1_step2", "tip_x_step2")
    assert result.cases["tension_t1_step2"].tolist() == pytest.approx([0.1 / 0.8] * 6)


def test_a_sweep_from_objects(tmp_path):
    from_files = tdcr.sweep(write_files(tmp_path), executor=InProcess()).cases
    scenario = tdcr.read_scenario(tmp_path / "scenario.toml")
    vary = [{"key": "steps[0].tensions.t1", "values": [0.5, 1.0, 1.5]}]
    vary += [{"key": "backbone.youngs_modulus", "mode": "factor", "values": [1.0, 1.2]}]
    contents = {"robot": scenario.robot, "model": scenario.model, "steps": scenario.steps, "vary": vary}
    contents["solver"] = scenario.settings
    pd.testing.assert_frame_equal(tdcr.sweep(contents, executor=InProcess()).cases, from_files)


QUANTITIES = ["tip_x", "bending_angle_deg"]


def test_parameter_variation_of_exudyn(tmp_path):
    cases = tdcr.sweep(write_files(tmp_path), executor=InProcess()).cases
    function = tdcr.parameter_function(tmp_path / "scenario.toml", QUANTITIES)
    parameters = {"steps[0].tensions.t1": (0.5, 1.5, 3), "backbone.youngs_modulus": [85e9, 1.2 * 85e9]}
    given, values = ParameterVariation(function, parameters, showProgress=False)
    assert given["steps[0].tensions.t1"] == pytest.approx([0.5, 0.5, 1.0, 1.0, 1.5, 1.5])
    assert np.allclose(np.array(values, dtype=float), cases[QUANTITIES].to_numpy(), rtol=1e-12)


def test_a_case_without_an_equilibrium_gives_nan_and_a_wrong_key_an_error(tmp_path):
    write_files(tmp_path)
    function = tdcr.parameter_function(tmp_path / "scenario.toml", ["tip_x"])
    (value,) = function({"backbone.radius": -1.0})
    assert math.isnan(value)
    with pytest.raises(KeyProblem, match="did you mean backbone"):
        function({"backbon.radius": 1e-3})
    with pytest.raises(tdcr.InputError, match="did you mean tip_x"):
        tdcr.parameter_function(tmp_path / "scenario.toml", ["tipx"])


# ------------------------------------------------------------------------------------- uncertainty propagation

CANTILEVER = {
    "robot": tdcr.Robot(tdcr.Backbone(0.2, 1e-3, 1e9, 0.3), tdcr.Disks.equally_spaced(2, 0.2)),
    "model": tdcr.Model(friction="none", elements_per_bay=8),
    "steps": [tdcr.LoadStep(loads={"tip": tdcr.Load(0.2, (1e-5, 0.0, 0.0))})],
    "solver": tdcr.SolverSettings(mesh_tolerance=math.inf),
    "sampling": {"method": "sobol", "samples": 128, "seed": 5},
    "vary": [
        {"key": "backbone.youngs_modulus", "uniform": {"lower": 0.7e9, "upper": 1.3e9}},
        {"key": "steps[0].loads.tip.force[0]", "mode": "factor", "normal": {"mean": 1.0, "std": 0.2}},
    ],
}


def test_variance_of_the_deflection_of_a_cantilever():
    """Tip of a cantilever: ``u = F L^3 / (3 EI) = c F / E`` (Euler, Bernoulli; shear adds 2e-5 of it).

    With E uniform on [a, b] and an independent F: ``E(1/E) = ln(b/a) / (b - a)``, ``E(1/E^2) = 1 / (a b)``.
    """
    result = tdcr.sweep(CANTILEVER, executor=InProcess())
    assert result.counts == {"converged": 128}
    c = 1e-5 * 0.2**3 / (3.0 * math.pi * 1e-3**4 / 4.0)
    a, b, mean_force, std_force = 0.7e9, 1.3e9, 1.0, 0.2
    mean = c * mean_force * math.log(b / a) / (b - a)
    variance = c**2 * (mean_force**2 + std_force**2) / (a * b) - mean**2
    found = result.statistics()["tip_x"]
    assert found["mean"] == pytest.approx(mean, rel=0.005)
    assert found["std"] ** 2 == pytest.approx(variance, rel=0.02)

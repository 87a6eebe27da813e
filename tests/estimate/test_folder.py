"""``tdcr-fe estimate``: its files, and what it says of folders that it cannot estimate."""

import json
import re
import shutil
from dataclasses import replace
from unittest.mock import Mock

import numpy as np
import pandas as pd
import pytest
from inputs import said
from rod import Truth

from tdcr_fe import ParameterPrior, PlausibilityWarning, Spool, read_estimation, run_estimation, with_effects
from tdcr_fe.cli import main
from tdcr_fe.io.measured import MeasuredData
from tdcr_fe.validation.campaigns.estimate import model
from tdcr_fe.validation.measured_folder import write_measured

COUNT = 4


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Four frames; the third has no readings."""
    truth, rng = Truth(COUNT, 1), np.random.default_rng(2)
    readings = [r for k in (0, 1, 3) for r in truth.positions(rng, k)]
    steps = tuple(truth.command(k) for k in range(COUNT))
    data = MeasuredData("rod", truth.robot, model(), (1, 2, 3, 4), steps, ("",) * COUNT, tuple(readings))
    path = tmp_path_factory.mktemp("set") / "set"
    write_measured(data, path)
    priors = "[load]\nsigma = 0.05\n[inputs]\nsigma = 0.01\ncorrelation_time = 1.0\n"
    (path / "estimate.toml").write_text(priors)
    return path


@pytest.fixture
def wrong(folder, tmp_path):
    """A copy of the folder, to be changed."""
    return shutil.copytree(folder, tmp_path / "set")


def test_the_command_writes_tables_and_a_page(folder, tmp_path, capsys, monkeypatch):
    monkeypatch.setattr("tdcr_fe.estimate.run.WINDOW", 1)
    assert main(["estimate", str(folder), "-o", str(tmp_path / "out")]) == 0
    assert "4 frames estimated" in capsys.readouterr().out
    found = pd.read_csv(tmp_path / "out" / "estimates.csv")
    tendons = [f"{p}tension_{n}" for n in ("helix", "t180", "t270", "t0") for p in ("", "sigma_")]
    assert list(found.columns) == [
        *("step", "time", "at", "force_x", "force_y", "force_z"),
        *("cov_xx", "cov_xy", "cov_xz", "cov_yy", "cov_yz", "cov_zz"),
        *tendons,
        *("tip_x", "tip_y", "tip_z", "sigma_tip_x", "sigma_tip_y", "sigma_tip_z", "milliseconds"),
    ]
    assert found["step"].tolist() == [1, 2, 3, 4]
    assert (found["at"] == 0.25).all()
    assert np.isfinite(found.to_numpy(dtype=float)).all()
    # Without readings the tip is known less well.
    assert found["sigma_tip_x"][2] > 10.0 * found["sigma_tip_x"][3]
    assert sorted(set(pd.read_csv(tmp_path / "out" / "shape.csv")["step"])) == [1, 2, 3, 4]
    smooth = pd.read_csv(tmp_path / "out" / "smoothed.csv")  # the fourth step tells of the third
    assert list(smooth.columns) == [*found.columns[:-1]] and smooth["step"].tolist() == [1, 2, 3, 4]
    assert smooth["sigma_tip_x"][2] < 0.9 * found["sigma_tip_x"][2]
    page = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    assert "9 readings in 3 of 4 frames." in page
    assert "The robot in 3D" in page
    (data,) = re.findall(r'<script type="application/json">(.*?)</script>', page, flags=re.S)
    for loads, row in zip(json.loads(data)["loads"], found.to_numpy(), strict=True):
        axes = np.array(loads[0]["ellipsoid"])
        covariance = row[[[6, 7, 8], [7, 9, 10], [8, 10, 11]]]
        np.testing.assert_allclose(axes.T @ axes, 7.8147 * covariance, rtol=1e-3, atol=1e-10)


def test_a_declared_loss_of_tension_acts(folder, tmp_path):
    """As the same tensions do that it leaves, also where it divides load steps."""
    found = []
    for name in ("declared", "acting"):
        path = shutil.copytree(folder, tmp_path / name)
        if name == "declared":
            text = (path / "model.toml").read_text() + "\n[effects]\nactuator_loss.dead_band = 0.05\n"
            (path / "model.toml").write_text(text + "actuator_loss.efficiency = 1.0\n")
        else:
            loading = pd.read_csv(path / "loading.csv")
            for column in loading.filter(like="tension_"):
                arrived = 0.0
                for k, command in enumerate(loading[column]):
                    arrived = max(min(arrived, command + 0.05), max(command - 0.05, 0.0))
                    loading.loc[k, column] = arrived
            loading.to_csv(path / "loading.csv", index=False)
        frames = run_estimation(read_estimation(path)).frames
        found.append([(*frame.tip, *frame.force, *frame.tensions) for frame in frames])
    np.testing.assert_allclose(*found, rtol=1e-6, atol=1e-9)


def test_moment_and_place_are_written_where_they_are_estimated(wrong):
    """Step 3 has no readings: what is known of it is what step 2 says, and the prior."""
    known = '0.05\nsigma_moment = 1e-3\nat = "unknown"'
    (wrong / "estimate.toml").write_text((wrong / "estimate.toml").read_text().replace("0.05", known))
    assert main(["estimate", str(wrong), "-o", str(wrong / "out")]) == 0
    found = pd.read_csv(wrong / "out" / "estimates.csv")
    moments = [f"{p}moment_{a}" for p in ("", "sigma_") for a in "xyz"]
    assert list(found.columns[-7:]) == [*moments, "sigma_at"]
    assert found["sigma_at"].between(0.0, 0.25 / 12**0.5, inclusive="right").all()
    sigma = found["sigma_moment_x"]
    assert (sigma[:2] < 1e-3).all() and sigma[1] < sigma[2] < 1e-3
    assert "Moment over time" in (wrong / "out" / "report.html").read_text(encoding="utf-8")


WRONG_FILES = [
    ("estimate.toml", "[inputs]\nsigma = 0.01\ncorrelation_time = 1.0", "", "inputs: missing; must be a table"),
    ("estimate.toml", "[inputs]", "[uncertain.side_spring]\ns = 1\n[inputs]", "uncertain: no derivative by"),
    ("estimate.toml", "sigma = 0.05", "sigma = -1.0", "load.sigma = -1.0: must be a positive number [N]"),
    ("estimate.toml", "sigma = 0.05", 'at = "top"',
        'load.at = "top": must be an arc length above zero [m], "tip" or "unknown"'),
    ("estimate.toml", "sigma = 0.05", "at = 0.9", "load.at = 0.9: must be at most the length"),
    ("estimate.toml", "sigma = 0.01", "sigma = {helix = 0.1}",
        "tendon t180 is missing; tendon t270 is missing; tendon t0 is missing; the robot has helix, t180, t270"),
    ("model.toml", "elastic-plastic", "dahl", "model.toml: model.hysteresis = \"dahl\": must be 'elastic-plastic'"),
    ("loading.csv", "time", "tim", "loading.csv: tim: unknown column"),
    ("observations.csv", "quantity", "channel", "observations.csv: quantity: missing column"),
    ("observations.csv", "position_", "place_", "0 of 9 rows would be left"),
    ("observations.csv", ",0.0001", ",", "estimation needs every standard deviation; it is missing in line 2"),
]  # fmt: skip


@pytest.mark.parametrize(("file", "old", "new", "words"), WRONG_FILES)
def test_mistakes_are_named(wrong, tmp_path, capsys, file, old, new, words):
    (wrong / file).write_text((wrong / file).read_text().replace(old, new))
    assert words in said(capsys, 2, "estimate", wrong, "-o", tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_a_load_and_inputs_in_mn_are_warned_of_before_the_first_frame(wrong, monkeypatch):
    monkeypatch.setattr("tdcr_fe.estimate.run.Estimator.step", Mock(side_effect=KeyboardInterrupt))
    text = (wrong / "estimate.toml").read_text().replace("0.05", "500.0\nsigma_moment = 500.0")
    (wrong / "estimate.toml").write_text(text.replace("0.01", "500.0"))
    with pytest.warns(PlausibilityWarning) as found:
        assert run_estimation(read_estimation(wrong)).interrupted
    text = "\n".join(str(w.message) for w in found)
    assert "estimate.toml: load.sigma = 500 N:" in text and "was it meant in mN" in text
    assert "(also" not in text  # all tendons have one key
    assert "estimate.toml: inputs.sigma" in text and "estimate.toml: load.sigma_moment = 500 N m:" in text


def test_times_are_needed(folder, wrong, tmp_path, capsys):
    pd.read_csv(wrong / "loading.csv").drop(columns="time").to_csv(wrong / "loading.csv", index=False)
    (wrong / "estimate.toml").unlink()
    command = "estimate", wrong, "-o", tmp_path / "out"
    assert "toml: no such file; must have at least 'inputs = {sigma = 0.01}'" in said(capsys, 2, *command)
    (line,) = said(capsys, 2, "estimate", wrong / "robot.toml", "-o", tmp_path / "out").splitlines()[1:]
    assert line.endswith("toml: is a file; must be a folder with robot.toml, loading.csv, observations.csv")
    shutil.copy(folder / "estimate.toml", wrong)
    needed = "time: estimation needs the time of every step [s]; it is missing in step 1"
    assert needed in said(capsys, 2, *command)


def test_coordinates_of_the_other_sign_are_doubted(folder, wrong, tmp_path, capsys, monkeypatch):
    """All frames were solved, with wrong forces and without a word."""
    table = pd.read_csv(wrong / "observations.csv")
    table.loc[table["quantity"] == "position_x", "value"] *= -1.0
    table.to_csv(wrong / "observations.csv", index=False)
    doubt = "times as far from what is expected as their standard deviations: axes, signs or units may be"
    out = "-o", tmp_path / "out"
    assert re.search(f"{doubt}.*; most in step 1", said(capsys, 0, "estimate", wrong, *out))
    assert doubt in (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    assert doubt not in said(capsys, 0, "estimate", folder, *out)
    table.loc[table["quantity"] == "position_z", "value"] *= -1.0
    table[table["step"] == 1].to_csv(wrong / "observations.csv", index=False)
    monkeypatch.setattr("tdcr_fe.estimate.most_probable.MOST_STATES", 5)
    assert "): wrong axes, signs or units?" in said(capsys, 1, "estimate", wrong, *out)
    found = pd.read_csv(tmp_path / "out" / "estimates.csv")
    assert found["message"].isna().tolist() == [False, True, True, True]


def test_errors_of_the_angle_of_a_motor_are_in_radians(folder, tmp_path):
    """Of the length wound they are so many times the radius of the spool; one of a tension stays what it is."""
    declared = read_estimation(folder).data
    robot = declared.robot.with_tendons(["helix"], spool=Spool(radius=0.01))
    path = tmp_path / "motor"
    write_measured(replace(declared, robot=robot), path)
    table = pd.read_csv(path / "loading.csv").rename(columns={"tension_helix": "motor_angle_helix"})
    table.to_csv(path / "loading.csv", index=False)
    shutil.copy(folder / "estimate.toml", path)
    (path / "model.toml").write_text((path / "model.toml").read_text() + "\n[inputs]\nsigma = 0.02\n")
    found = read_estimation(path)
    assert found.data.input_sigma == pytest.approx((0.02 * 0.01, 0.02, 0.02, 0.02))
    assert found.inputs.sigmas(robot.tendon_names) == pytest.approx([0.01 * 0.01, 0.01, 0.01, 0.01])
    (path / "estimate.toml").write_text("")  # those of model.toml are independent from step to step
    own = dict(zip(robot.tendon_names, found.data.input_sigma, strict=True))
    assert read_estimation(path).inputs == replace(found.inputs, sigma=own, correlation_time=0.0)


def identified(path, errors):
    """Results of identify in a folder: a stiffness, a gain of the commands, and a cause beyond the list."""
    names = ["stiffness_scale (both).bending", "actuator_gain.gain", "bending stiffness by row.slope"]
    found = {
        "effects": [{"effect": "stiffness_scale", "parameters": {"bending": {"value": 1.1}}}],
        "friction": "none",
        "stand_ins": {"actuator_gain": {"gain": 0.98}, "bending stiffness by row": {"slope": 1.0}},
        "parameters": names,
        "standard_errors": errors,
        "correlation": np.eye(3).tolist(),
        "input": dict(read_estimation(path).data.digests),
    }
    (path / "found").mkdir()
    (path / "found" / "result.json").write_text(json.dumps(found))
    priors = path / "estimate.toml"
    priors.write_text(f'identified = "found"\n{priors.read_text()}[uncertain]\nprecurvature.kappa_x = 0.1\n')


def test_effects_that_identify_found_act_with_their_covariance(wrong, tmp_path, capsys):
    declared = read_estimation(wrong)
    identified(wrong, [1e-9, 0.01, 1.0])  # the gain is no more than a stand-in, and has no covariance
    warned = said(capsys, 0, "estimate", wrong, "-o", tmp_path / "out")
    assert "bending stiffness by row: not a listed effect, left out" in warned
    found = pd.read_csv(tmp_path / "out" / "estimates.csv")
    names = ["stiffness_scale.bending", "precurvature.kappa_x"]
    assert list(found.columns[-4:]) == [x for name in names for x in (name, f"sigma_{name}")]
    assert found["sigma_precurvature.kappa_x"].is_monotonic_decreasing
    data, sigma = declared.data, {"precurvature.kappa_x": 0.1}
    effects = {"stiffness_scale": {"bending": 1.1}, "actuator_gain": {"gain": 0.98}}
    corrected = with_effects(data.experiment, effects)
    data = replace(data, robot=corrected.robot, steps=corrected.steps)
    same = run_estimation(replace(declared, data=data, uncertain=ParameterPrior.independent(sigma)))
    forces = np.array([frame.force for frame in same.frames])
    np.testing.assert_allclose(found[["force_x", "force_y", "force_z"]], forces, atol=1e-6)


WRONG_RESULTS = [
    ("found/result.json", "standard_errors", "errors", "must be a folder with a result.json of identify"),
    ("found/result.json", "[0.05", "[null", "of identify (this version), with all standard errors"),
    ("robot.toml", "", "\n", "must be found with the robot.toml and model.toml of this folder"),
    ("estimate.toml", "_x = 0.1", "_x = -0.1", "uncertain.precurvature.kappa_x = -0.1: must be"),
    ("estimate.toml", "kappa_x", "kapa_x", "did you mean kappa_x?"),
]


@pytest.mark.parametrize(("file", "old", "new", "words"), WRONG_RESULTS)
def test_wrong_results_of_identify_are_named(wrong, tmp_path, capsys, file, old, new, words):
    identified(wrong, [0.05, 0.01, 1.0])
    (wrong / file).write_text((wrong / file).read_text().replace(old, new, 1))
    assert words in said(capsys, 2, "estimate", wrong, "-o", tmp_path / "out")

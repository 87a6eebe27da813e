"""The report on an identification: first screen, next step, remarks on values; on a synthetic result."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tdcr_fe.effects import Experiment, with_effects
from tdcr_fe.effects.base import Observation
from tdcr_fe.identify import figures
from tdcr_fe.identify.corrected import corrected_files, effects_block
from tdcr_fe.identify.estimate import Estimate
from tdcr_fe.identify.findings import AddedEffect, Remainder, Shapes
from tdcr_fe.identify.found_law import FoundLaw
from tdcr_fe.identify.misfit import Misfit, Noise, Structure
from tdcr_fe.identify.outcome import IdentificationResult
from tdcr_fe.identify.remarks import largest_strain, remarks
from tdcr_fe.identify.replay import corrected_motion, markers, replay
from tdcr_fe.identify.report import render
from tdcr_fe.identify.sentences import headline, summary
from tdcr_fe.io.measured import MeasuredData
from tdcr_fe.io.readings import Reading
from tdcr_fe.io.result_folder import read_motion
from tdcr_fe.io.toml import read_scenario
from tdcr_fe.model.backbone import Backbone
from tdcr_fe.model.disks import Disks
from tdcr_fe.model.loading import Load, LoadStep, Model
from tdcr_fe.model.robot import Robot
from tdcr_fe.model.routing import ParallelRouting
from tdcr_fe.model.settings import SolverSettings
from tdcr_fe.model.tendon import Tendon
from tdcr_fe.report.style import CORRECTED, DECLARED
from tdcr_fe.report.viewer import view_page
from tdcr_fe.solve.simulate import simulate

LENGTH = 0.2
ROBOT = Robot(
    Backbone(LENGTH, 0.4e-3, 85e9, 0.3, 5600.0),
    Disks.equally_spaced(4, LENGTH, mass=0.5e-3),
    tuple(Tendon(f"t{i + 1}", ParallelRouting(4.5e-3, 90.0 * i), axial_stiffness=2474.0) for i in range(2)),
    name="small",
)
PULLS = (0.0, 0.5, 1.0, 0.5, 0.0)
STEPS = (
    *tuple(
        LoadStep(tensions={"t1": pull, "t2": 0.1}, loads={"tip": Load(LENGTH, (0.0, 0.0, 0.0))})
        for pull in PULLS
    ),
    LoadStep(tensions={"t1": 1.0, "t2": 0.5}, loads={"tip": Load(LENGTH, (0.0, 0.02, 0.0))}),
)


def arc(angle, n=9):
    """A planar arc that turns by ``angle`` over the length, shape (n, 3)."""
    s = np.linspace(0.0, LENGTH, n)
    kappa = max(angle, 1e-6) / LENGTH
    return np.column_stack(((1.0 - np.cos(kappa * s)) / kappa, 0.0 * s, np.sin(kappa * s) / kappa))


def result(*effects, angles=(0.1, 0.5, 1.0, 0.6, 0.2, 1.1), **rest):
    """Measured arcs; the declared model bends 20 % too far, the corrected one is right."""
    ids = tuple(range(1, len(STEPS) + 1))
    after = np.stack([arc(a) for a in angles])
    before = np.stack([arc(1.2 * a) for a in angles])
    nodes = [4, 8]
    readings = tuple(
        Reading(n, f"position_{a}", nodes[m] * LENGTH / 8, float(after[k, nodes[m], "xyz".index(a)]), 1e-4)
        for k, n in enumerate(ids)
        for m in range(2)
        for a in "xyz"
    )
    residual = (after - before)[:, nodes].ravel()
    shapes = Shapes(
        ids, ("",) * len(ids), np.array([False] * 5 + [True]), np.array([0.1, 0.2]),
        after[:, nodes], before[:, nodes], after[:, nodes], before, after,
    )  # fmt: skip
    experiment = Experiment(ROBOT, Model(), STEPS)
    fields = {
        "data": MeasuredData("made up", ROBOT, Model(), ids, STEPS, ("",) * len(ids), readings),
        "verdict": "explained" if effects else "nothing missing",
        "effects": effects,
        "before_fit": Misfit(0.0188, None, 0.02, 900.0), "before_held_out": Misfit(0.0174, None, 0.02, 800.0),
        "after_fit": Misfit(1.8e-4, None, 4e-4, 1.05), "after_held_out": Misfit(1.87e-4, None, 4e-4, 1.1),
        "held_out_steps": (6,),
        "remaining": Remainder("", "what is left has the size of the noise"),
        "candidates": (), "structure": (Structure("step 3", 2.0, 0.02),),
        "residual_before": residual, "residual_after": 0.0 * residual + 1e-4,
        "sigma": np.full(len(readings), 1e-4), "sigma_estimated": False, "outliers": (),
        "correlation": np.eye(2), "parameter_names": ("a", "b"), "mesh_error": 0.01,
        "noise": Noise(1.73e-4, 1e-4, None, {"position_x": 1e-4}, False),
        "shapes": shapes,
        "corrected": with_effects(experiment, {}), "commanded": experiment, "solver": SolverSettings(),
    }  # fmt: skip
    return IdentificationResult(**{**fields, **rest})


def added(name, others=(), **parameters):
    """An effect with value, standard error and unit of each parameter."""
    misfit = Misfit(1.8e-4, None, 4e-4, 1.05)
    evidence = {"chi2_drop_fit": 1e5, "chi2_drop_held_out": 5e4, "needed_drop": 23.5}
    estimates = {n: Estimate(*p) for n, p in parameters.items()}
    return AddedEffect(name, estimates, misfit, misfit, evidence, others, "bend the bare backbone")


GRAVITY = added("gravity", g_x=(0.0, 0.01, "m/s^2"), g_y=(6.95, 0.007, "m/s^2"), g_z=(-6.91, 0.03, "m/s^2"))


def plain(html):
    text = re.sub(r"<style>.*?</style>|<script>.*?</script>|<[^>]+>", " ", html, flags=re.S)
    return re.sub(r"\s+", " ", text.replace("\N{NO-BREAK SPACE}", " "))


def test_the_first_screen_has_verdict_errors_effects_picture_and_next_step():
    html = render(result(GRAVITY))
    first = html[: html.index("<nav")]
    text = plain(first)
    for words in (
        "Explained: the declared model lacks gravity.",
        "18.8 mm → 0.18 mm", "17.4 mm → 0.187 mm",
        "noise of the measurement alone (rms, distance in space)", "0.173 mm",
        "standard error", "half-width, 95 %", "m/s²",
        "Next step: run the corrected robot", "[effects] gravity = {",
    ):  # fmt: skip
        assert words in text
    assert first.count("data:image/svg+xml") == 1
    assert "average" not in plain(html)


def test_long_parts_are_folded_and_every_link_leads_somewhere():
    html = render(result(GRAVITY))
    after = html[html.index("</nav>") :]
    assert after.count('<details class="section"') == 6
    assert '<section class="section"' not in after
    anchors = set(re.findall(r' id="([\w-]+)"', html))
    assert set(re.findall(r'href="#([\w-]+)"', html)) <= anchors


def test_the_next_step_runs(tmp_path):
    """The scenario of the report is read with its effects and steps."""
    for name, text in corrected_files(result(GRAVITY)).items():
        (tmp_path / name).write_text(text, encoding="utf-8")
    scenario = read_scenario(tmp_path / "effects.toml")
    assert scenario.model.gravity == pytest.approx((0.0, 6.95, -6.91))
    assert [dict(s.tensions) for s in scenario.steps] == [dict(s.tensions) for s in STEPS]
    assert scenario.steps[-1].loads["tip"].force == (0.0, 0.02, 0.0)


def test_an_effect_on_the_measurement_is_not_part_of_the_scenario(tmp_path):
    found = result(GRAVITY, added("marker_offset", offset_x=(1e-3, 1e-5, "m"), offset_y=(0.0, 1e-5, "m")))
    assert "# acts on the measurement only: marker_offset" in effects_block(found)
    for name, text in corrected_files(found).items():
        (tmp_path / name).write_text(text, encoding="utf-8")
    assert read_scenario(tmp_path / "effects.toml").model.gravity[1] == pytest.approx(6.95)


def test_a_declared_value_that_the_fit_contradicts_is_named():
    """Tendons of 107 N where 2474 N is declared: 0.1 had no remark."""
    stretch = added("tendon_stretch", ("actuator_gain",), axial_stiffness=(107.0, 5.0, "N"))
    (text,) = remarks(result(stretch))["tendon_stretch"]
    text = text.replace("\N{NO-BREAK SPACE}", " ")
    assert "is fitted as 107.0 ± 9.8 N, declared as 2.474 kN" in text and "actuator gain" in text
    assert text in plain(render(result(stretch)))
    near = added("tendon_stretch", axial_stiffness=(2470.0, 5.0, "N"))
    assert not remarks(result(near))


def test_an_effect_that_cannot_act_at_the_strain_seen_is_named():
    """Superelastic at a strain of 0.027 %: 0.1 had no remark."""
    soft = added("superelastic", threshold_strain=(2.7e-4, 1e-5, "1"), plateau_ratio=(0.5, 0.01, "1"))
    (text,) = remarks(result(soft))["superelastic"]
    assert "strain of 0.027 %" in text and "not plausible" in text
    # An arc of 1.1 rad over 200 mm with a radius of 0.4 mm.
    assert largest_strain(result(soft)) == pytest.approx(1.1 / LENGTH * 0.4e-3, rel=1e-3)
    metal = added("superelastic", threshold_strain=(0.01, 1e-5, "1"), plateau_ratio=(0.5, 0.01, "1"))
    assert not remarks(result(metal))


def test_gravity_of_another_size_than_on_earth_is_named():
    assert "as on earth" in remarks(result(GRAVITY))["gravity"][0]
    odd = added("gravity", g_x=(0.0, 0.1, "m/s^2"), g_y=(0.0, 0.1, "m/s^2"), g_z=(-5.0, 0.1, "m/s^2"))
    assert "not 9.81 m/s²" in remarks(result(odd))["gravity"][0]


def test_friction_above_that_of_common_materials_is_named():
    """Of all tendons, or of each: with coefficients for each the report failed."""
    for values in ({"mu": (1.3, 0.1, "1")}, {"mu_t1": (0.2, 0.1, "1"), "mu_t2": (1.3, 0.1, "1")}):
        text = remarks(result(added("friction_coefficient", **values)))["friction_coefficient"][-1]
        assert text == "A friction coefficient of 1.3 is above that of common materials."
    each = added("friction_coefficient", mu_t1=(0.2, 0.1, "1"), mu_t2=(0.3, 0.1, "1"))
    assert not remarks(result(each))


def test_the_summary_labels_its_half_widths():
    text = summary(result(GRAVITY)).replace("\N{NO-BREAK SPACE}", " ")
    assert "gravity.g_y = 6.950 ± 0.014 m/s² (95 %)" in text


def test_a_loop_is_a_run_in_which_one_tendon_moves():
    assert figures.loops(result()) == [(0, range(5))]


@pytest.mark.parametrize("draw", [figures.comparison, figures.by_step, figures.along, figures.over_input])
def test_where_nothing_was_added_one_model_is_drawn_with_one_label(draw):
    unchanged, changed = draw(result()), draw(result(GRAVITY))
    assert DECLARED in unchanged and CORRECTED not in unchanged
    assert DECLARED in changed and CORRECTED in changed


def test_readings_without_positions_are_drawn_over_the_steps():
    found = result()
    angles = tuple(Reading(n, "bending_angle", None, 0.1 * n, 0.01) for n in found.data.step_ids)
    shapes = replace(found.shapes, measured=np.full_like(found.shapes.measured, np.nan))
    misfit = Misfit(None, 0.02, None, 4.0)
    found = replace(
        found, data=replace(found.data, readings=angles), shapes=shapes, sigma=np.full(6, 0.01),
        residual_before=np.full(6, 0.1), residual_after=np.full(6, 0.01), before_fit=misfit, after_fit=misfit,
        before_held_out=misfit, after_held_out=misfit, noise=Noise(None, None, 0.01, {"bending_angle": 0.01}, False),
    )  # fmt: skip
    text = plain(render(found))
    assert "rms error of the angles is 1.15 deg; the noise alone gives 0.573 deg" in text


@pytest.mark.parametrize(
    ("verdict", "level"),
    [
        ("explained", "good"),
        ("partly explained", "part"),
        ("unexplained", "bad"),
        ("nothing missing", "good"),
        ("cannot tell", "open"),
        ("unfinished", "open"),
    ],
)
def test_every_verdict_has_a_line_and_a_level(verdict, level):
    html = render(result(GRAVITY, verdict=verdict))
    assert f'<header class="{level}">' in html
    assert re.search(r"<h1>\w.+\.</h1>", html)


# ------------------------------------------------------------------------------------------------ the 3D panel


def test_the_report_with_a_motion_has_the_panel_and_needs_no_other_file(tmp_path):
    found = result(GRAVITY)
    motion = corrected_motion(found, tmp_path)
    html = render(found, motion)
    after = html[html.index("</nav>") :]
    assert after.count('<section class="section" id="robot">') == 1 and html.count('class="robot-view"') == 1
    assert "measured markers" in html and len(html) < 1e6
    outside = re.sub(r"data:image/svg\+xml;base64,[\w+/=]+", "", html)
    assert not re.search(r"https?:|<link|@import|fetch\(|src=\"[^\"]", outside)
    assert 'class="robot-view"' not in render(found)


def test_the_folder_of_identify_can_be_viewed(tmp_path):
    """The tables of the corrected robot and of the markers give the same panel as the report has."""
    motion = corrected_motion(result(GRAVITY), tmp_path)
    read = read_motion(tmp_path)
    assert view_page(read) == view_page(motion)
    assert read.steps == (1, 2, 3, 4, 5, 6)
    assert np.array_equal(read.markers.measured, result().shapes.measured)


def test_the_replay_is_the_corrected_robot_step_by_step():
    """A dead band divides steps; the replay has those of loading.csv, each at its end."""
    experiment = with_effects(
        Experiment(ROBOT, Model(friction="none", elements_per_bay=1), STEPS),
        {"actuator_loss": {"dead_band": 0.1, "efficiency": 0.9}},
    )
    assert len(experiment.steps) > len(STEPS)
    found = replay(result(corrected=experiment, commanded=replace(experiment, steps=STEPS, ends=None)))
    assert [s.step for s in found.steps] == [1, 2, 3, 4, 5, 6]
    whole = simulate(ROBOT, experiment.model, experiment.steps)
    assert found.steps[-1].tip == pytest.approx(whole.steps[-1].tip, abs=1e-9)
    assert found.steps[2].base_tensions[0] == pytest.approx((1.0 - 0.1) * 0.9, rel=1e-9)


def test_the_replay_has_a_law_that_was_found_as_loads():
    """Otherwise the panel shows the robot without it, away from the markers."""
    misfit = Misfit(1.8e-4, None, 4e-4, 1.05)
    steps = tuple(
        replace(s, loads={**s.loads, "law 1": Load(LENGTH, moment=(0.0, 2e-3, 0.0))}) for s in STEPS
    )
    law = FoundLaw((), "A moment.", misfit, misfit, (), steps)
    model = Model(friction="none", elements_per_bay=1)
    experiment = Experiment(ROBOT, model, STEPS)
    found = replay(result(corrected=experiment, commanded=experiment, law=law))
    assert found.steps[0].actuation.loads["law 1"].moment == (0.0, 2e-3, 0.0)
    assert found.steps[0].tip == pytest.approx(simulate(ROBOT, model, steps[:1]).steps[0].tip, abs=1e-9)
    assert found.steps[0].tip[0] > 0.01


def test_a_turned_measuring_frame_turns_the_markers_back():
    rotation = (0.1, -0.2, 0.3)
    found = result(corrected=replace(Experiment(ROBOT, Model(), STEPS), observation=Observation(rotation)))
    turn = Rotation.from_rotvec(rotation)
    seen = markers(found, 6)
    assert turn.apply(seen.measured.reshape(-1, 3)) == pytest.approx(found.shapes.measured.reshape(-1, 3))
    assert turn.apply(seen.declared.reshape(-1, 3)) == pytest.approx(
        found.shapes.backbone_before.reshape(-1, 3)
    )


def test_a_printed_result_is_its_summary_as_the_command_prints_it():
    """It used to be every field of the result, arrays and all."""
    found = result(GRAVITY)
    assert repr(found) == summary(found)
    assert repr(found).startswith(headline(found)) and len(repr(found).splitlines()) < 30


def test_pretension_beside_the_stretch_that_it_needs_is_written():
    """Each effect used to be applied alone, and the command ended in a traceback after the search."""
    both = (
        added("pretension", tension=(2.0, 0.1, "N")),
        added("tendon_stretch", axial_stiffness=(400.0, 5.0, "N")),
    )
    assert "pretension = 2.0" in corrected_files(result(*both))["robot.toml"]

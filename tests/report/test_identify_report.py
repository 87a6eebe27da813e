"""The report on an identification: first screen, next step, remarks on values; on a result made by hand."""

import math
import re
import shutil
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from browser import browser, in_chromium
from identify_data import LENGTH, MODEL
from scipy.spatial.transform import Rotation
from searches import GRAVITY, ROBOT, STEPS, added, result

from tdcr_fe import Experiment, Load, Reading, SolverSettings, simulate, with_effects
from tdcr_fe.effects.base import Observation
from tdcr_fe.identify import figures
from tdcr_fe.identify.corrected import corrected_motion, effects_block, markers, replay
from tdcr_fe.identify.report import LEVELS, render
from tdcr_fe.identify.result import Errors, Misfit, Parameters, Profile, Residuals, Simulated
from tdcr_fe.identify.sentences import goodness, measure, remarks, sentences
from tdcr_fe.io.result_folder import read_motion, write_markers
from tdcr_fe.report.motion import nearest
from tdcr_fe.report.viewer import view_page


def plain(html):
    text = re.sub(r"<style>.*?</style>|<script>.*?</script>|<[^>]+>", " ", html, flags=re.S)
    return re.sub(r"\s+", " ", text.replace("\N{NO-BREAK SPACE}", " "))


def test_the_first_screen_has_verdict_errors_effects_picture_and_next_step():
    html = render(result(GRAVITY))
    first = html[: html.index("<nav")]
    text = plain(first)
    assert '<header class="good">' in html
    for words in (
        "Explained: the declared model is missing gravity.",
        "18.8 mm → 0.18 mm", "17.4 mm → 0.187 mm",
        "noise of the measurement alone (rms, distance in space)", "0.173 mm",
        "g_y acceleration of gravity along y 6.950 ± 0.014 m/s² 0 m/s²", "not different from the declared value",
        "reduced chi-square 900 1.05", "as on Earth", "probability 0.99.",
        "Next step: run the corrected robot", "[effects] gravity = {",
    ):  # fmt: skip
        assert words in text
    assert first.count("<figure>") == 1 and first.count("data:image/svg+xml") == 4  # three panels, the legend
    assert "average" not in plain(html)


def test_the_error_of_a_marker_is_a_distance_along_what_was_measured_and_is_drawn_there():
    whole = result(GRAVITY)
    seen = tuple(r for r in whole.data.readings if r.quantity in ("position_x", "position_z"))
    words = measure(replace(whole, data=replace(whole.data, readings=seen)))
    assert words == "rms distance along x and z between measured and predicted markers"
    shapes = replace(whole.shapes, measured=whole.shapes.measured * (1.0, np.nan, 1.0))
    assert all(ax.get_visible() for ax in figures.comparison(replace(whole, shapes=shapes)).axes)


SMALL, VAGUE = 0.01, 3.0
REMARKS = [
    # effect, value and standard error of its parameters, unit; words of the remark, none where all is plausible
    ("tendon_stretch", {"axial_stiffness": (107.0, 5.0)}, "N", "107.0 ± 9.8 N, declared 2.474 kN"),
    ("tendon_stretch", {"axial_stiffness": (2470.0, 5.0)}, "N", ""),
    ("superelastic", {"threshold_strain": (2.7e-4, 1e-5), "plateau_ratio": (0.5, SMALL)}, "1", "strain of 0.027 %"),
    ("superelastic", {"threshold_strain": (0.01, 1e-5), "plateau_ratio": (0.5, SMALL)}, "1", ""),
    ("gravity", {"g_x": (0.0, 0.007), "g_y": (6.95, 0.007), "g_z": (-6.91, 0.03)}, "m/s^2", "as on Earth"),
    ("gravity", {"g_x": (0.0, 0.1), "g_y": (0.0, 0.1), "g_z": (-5.0, 0.1)}, "m/s^2", "not 9.81 m/s²"),
    ("gravity", {"g_x": (0.0, VAGUE), "g_y": (0.0, VAGUE), "g_z": (-5.0, VAGUE)}, "m/s^2", ""),
    ("friction_coefficient", {"mu": (1.3, 0.1)}, "1", "A friction coefficient of 1.3 is above that of common"),
    ("friction_coefficient", {"mu_t1": (0.2, 0.1), "mu_t2": (1.3, 0.1)}, "1", "of 1.3 is above that of common"),
    ("friction_coefficient", {"mu_t1": (0.2, 0.1), "mu_t2": (0.3, 0.1)}, "1", ""),
]  # fmt: skip


@pytest.mark.parametrize(("name", "values", "unit", "words"), REMARKS)
def test_a_value_that_is_not_plausible_gets_a_remark(name, values, unit, words):
    """0.1 had no remark on tendons of 107 N, where 2474 N is declared."""
    found = added(name, **{parameter: (*value, unit) for parameter, value in values.items()})
    text = " ".join(remarks(result(found)).get(name, [])).replace("\N{NO-BREAK SPACE}", " ")
    assert words in text and bool(words) == bool(text)


RIVALS = [("tendon_stretch (each tendon)", "none of the listed effects"), ("pretension", "pretension")]


@pytest.mark.parametrize(("rival", "words"), RIVALS)
def test_another_form_of_an_effect_contradicts_the_declared_value_as_well(rival, words):
    """Friction of each tendon was given as another cause, should the declared friction be certain."""
    found = added("tendon_stretch", (rival,), axial_stiffness=(107.0, 5.0, "N"))
    (text,) = remarks(result(found))["tendon_stretch"]
    assert text.endswith(f"the error has another cause: {words}.")


def test_statistics_are_those_of_lmfit():
    """A straight line through (0, 1.1), (1, 1.9), (2, 3.2), (3, 3.8): squares of 0.082."""
    x, y = np.arange(4.0), np.array([1.1, 1.9, 3.2, 3.8])
    squares = float(np.polyfit(x, y, 1, full=True)[1][0])
    found = goodness(Misfit(None, None, None, squares / 2.0, 4), 2)
    # as `lmfit.minimizer.MinimizerResult._calculate_statistics`
    assert found["chi-square"] == pytest.approx(squares) == pytest.approx(0.082)
    assert found["Akaike (AIC)"] == pytest.approx(4.0 * math.log(squares / 4.0) + 2.0 * 2)
    assert found["Bayesian (BIC)"] == pytest.approx(4.0 * math.log(squares / 4.0) + math.log(4.0) * 2)


def test_the_printed_result_has_statistics_values_with_intervals_and_correlations():
    linked = result(GRAVITY, parameters=Parameters(("a", "b"), np.array([[1.0, -0.4], [-0.4, 1.0]])))
    lines = repr(linked).replace("\N{NO-BREAK SPACE}", " ").splitlines()
    values = [re.split(" {2,}", line.strip()) for line in lines]
    assert ["reduced chi-square", "900", "1.05"] in values
    assert ["gravity: g_y", "6.950 ± 0.014 m/s²", "0 m/s²", "acceleration of gravity along y"] in values
    assert ["a", "b", "−0.40"] in values
    names, every = tuple(f"p{k}" for k in range(24)), np.full((24, 24), 0.5)
    many = repr(result(GRAVITY, parameters=Parameters(names, every))).splitlines()
    assert sum(line.endswith("0.50") for line in many) == 12  # a robot with 24 parameters printed 176 lines
    assert "not different from the declared value" in repr(linked)  # of g_x, which is 0 +- 0.02


def test_profiles_are_drawn_in_the_unit_of_their_axis():
    """0.2 drew radians on an axis in degrees, and wrote "[]" where there is no unit."""
    found = added("actuator_gain", gain_t1=(0.9, 0.01, "1"), twist=(0.1, 0.01, "rad"))
    names, span = ("actuator_gain.gain_t1", "actuator_gain.twist"), np.array([-2.0, 0.0, 2.0])
    profiles = [Profile(n, x + 0.01 * span, span) for n, x in zip(names, (0.9, 0.1), strict=True)]
    together = Parameters(names, np.array([[1.0, 0.99], [0.99, 1.0]]), tuple(profiles))
    gain, twist, both, _ = figures.parameters(result(found, parameters=together)).axes
    assert gain.get_xlabel() == both.get_xlabel() == "actuator gain.gain t1"
    assert twist.get_xlabel() == both.get_ylabel() == "actuator gain.twist [deg]"
    assert twist.lines[1].get_xdata() == pytest.approx(np.degrees([0.08, 0.1, 0.12]))
    assert [float(x[0]) for x in both.lines[1].get_data()] == pytest.approx([0.9, np.degrees(0.1)])


def test_long_labels_of_axes_are_wrapped_and_keep_apart():
    """They ran into each other below three pictures in a row."""
    values = dict.fromkeys(("moment_x_per_tension", "moment_y_per_tension", "twist"), (0.1, 0.01, "N"))
    found = added("side_load (tendon = t1, from = 0.125, until = 0.25)", **values)
    profiles = tuple(Profile(f"{found.name}.{n}", np.array([0.0, 0.1]), np.array([-1.0, 0])) for n in values)
    figure = figures.parameters(result(found, parameters=Parameters((), np.eye(0), profiles)))
    figure.draw_without_rendering()
    boxes = [ax.xaxis.label.get_window_extent() for ax in figure.axes]
    assert all(left.x1 < right.x0 for left, right in pairwise(boxes)) and boxes[-1].x1 < figure.bbox.x1


def test_names_that_contain_commas_are_joined_with_semicolons():
    for name, comma in (("spring (tendon = t1, s = 0.1)", "; "), ("friction", ", ")):
        (first, *_) = sentences(result(GRAVITY, added(name), added("actuator_gain")))
        assert first.endswith(f" is missing gravity{comma}{name} and actuator gain.")
    # A loop is a run in which one tendon moves.
    assert figures.loop(result()) == (0, range(5))


def test_readings_without_positions_are_drawn_over_the_steps():
    found = result()
    angles = tuple(Reading(n, "bending_angle", None, 0.1 * n, 0.01) for n in found.data.step_ids)
    shapes = replace(found.shapes, measured=np.full_like(found.shapes.measured, np.nan))
    misfit, tenth = Misfit(None, 0.02, None, 4.0), np.full(11, 0.1)
    noise = Misfit(None, 0.01, None, 1.0, rms_by_quantity={"bending_angle": 0.01})
    found = replace(
        found, data=replace(found.data, readings=angles), shapes=shapes, noise=noise,
        residuals=Residuals(tenth, 0.1 * tenth, 0.1 * tenth),
        before=Errors(misfit, misfit), after=Errors(misfit, misfit),
    )  # fmt: skip
    assert "rms error of the angles is 1.15 deg; the noise alone gives 0.573 deg" in plain(render(found))


@pytest.mark.parametrize("verdict", LEVELS)
def test_every_verdict_has_a_line(verdict):
    line = sentences(result(GRAVITY, verdict=verdict))[0]
    assert re.fullmatch(r"\w.+\.", line) and ("gravity" in line) == (
        verdict not in ("nothing missing", "unexplained")
    )


# ------------------------------------------------------------------------------------------------ the 3D panel


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A folder with the tables of the corrected robot, and its motion."""
    path = tmp_path_factory.mktemp("identified")
    return path, corrected_motion(result(GRAVITY), path)


@in_chromium
def test_the_page_fits_a_phone(folder, tmp_path):
    """In dark mode on 390 pixels, folded parts included; 0.1 scrolled sideways and stayed white."""
    page = tmp_path / "report.html"
    page.write_text(render(result(GRAVITY), folder[1]), encoding="utf-8")
    with browser() as b:
        b.open(page, 390, 844, dark=True)
        b.ask("document.querySelectorAll('details').forEach(d => { d.open = true; })")
        assert b.ask("document.documentElement.scrollWidth") <= 390
        ground = "getComputedStyle(document.body).backgroundColor"
        assert b.ask(ground) == "rgb(20, 24, 29)"
        b.ask("document.querySelector('button.theme').click()")
        assert b.ask(ground) == "rgb(255, 255, 255)"
        assert b.errors() == []


def test_the_folder_of_identify_can_be_viewed(folder):
    """The tables of the corrected robot and of the markers give the same panel as the report has."""
    path, motion = folder
    read = read_motion(path)
    assert view_page(read) == view_page(motion)
    assert read.steps == tuple(range(1, 12))
    assert np.array_equal(read.markers.measured, result().shapes.measured)


@pytest.mark.parametrize("count", [0, 1])
def test_markers_may_be_missing_where_the_folder_is_viewed(folder, tmp_path, count):
    """Of some steps, or, where angles alone were measured, of all; view refused the tables of identify."""
    read = read_motion(shutil.copytree(folder[0], tmp_path / "found"))
    seen = read.markers.measured[:, :count].copy()
    seen[2:5] = np.nan
    markers = replace(read.markers, s=read.markers.s[:count], measured=seen)
    write_markers(markers, read.steps, tmp_path / "found" / "corrected")
    again = read_motion(tmp_path / "found")
    assert np.array_equal(again.markers.measured, seen, equal_nan=True)
    assert view_page(again) == view_page(replace(read, markers=markers))


def test_markers_seen_from_one_side_are_drawn_on_the_robot_along_the_line_of_sight(folder):
    """The 3D page of planar data had no measured markers."""
    motion = folder[1]
    flat, there = motion.markers.measured.copy(), motion.positions[:, nearest(motion.s, motion.markers.s)]
    flat[..., 1], flat[3] = np.nan, np.nan
    drawn = np.where([False, True, False], there, flat)
    drawn[3] = np.nan
    pages = [view_page(replace(motion, markers=replace(motion.markers, measured=x))) for x in (flat, drawn)]
    assert pages[0] == pages[1]


def _with(corrected, commanded, *effects):
    """A result with these experiments."""
    return result(*effects, simulated=Simulated(commanded, corrected, SolverSettings()))


def test_the_replay_is_the_corrected_robot_step_by_step():
    """A dead band divides steps; the replay has those of loading.csv, each at its end."""
    declared = Experiment(ROBOT, MODEL, STEPS)
    experiment = with_effects(declared, {"actuator_loss": {"dead_band": 0.1, "efficiency": 0.9}})
    assert len(experiment.steps) > len(STEPS)
    found = replay(_with(experiment, replace(experiment, steps=STEPS, ends=())))
    assert [s.step for s in found.steps] == list(range(1, 12))
    whole = simulate(ROBOT, experiment.model, experiment.steps)
    assert found.steps[-1].tip == pytest.approx(whole.steps[-1].tip, abs=1e-9)
    assert found.steps[2].base_tensions[0] == pytest.approx((1.2 - 0.1) * 0.9, rel=1e-9)


def test_the_replay_has_a_law_that_was_found_as_loads():
    """Otherwise the panel shows the robot without it, away from the markers."""
    moment = {"law 1": Load(LENGTH, moment=(0.0, 2e-3, 0.0))}
    steps = tuple(replace(s, loads={**s.loads, **moment}) for s in STEPS)
    corrected = Experiment(ROBOT, MODEL, steps)
    law = replace(added("moment that drifts"), sentence="a moment that drifts")
    result = _with(corrected, replace(corrected, steps=STEPS), law)
    assert effects_block(result) == ""  # no scenario can name it
    found = replay(result)
    assert found.steps[0].actuation.loads["law 1"].moment == (0.0, 2e-3, 0.0)
    assert found.steps[0].tip == pytest.approx(simulate(ROBOT, MODEL, steps[:1]).steps[0].tip, abs=1e-9)
    assert found.steps[0].tip[0] > 0.01


def test_a_turned_measuring_frame_turns_the_markers_back():
    rotation = (0.1, -0.2, 0.3)
    declared = Experiment(ROBOT, MODEL, STEPS)
    found = _with(replace(declared, observation=Observation(rotation)), declared)
    turn = Rotation.from_rotvec(rotation).as_matrix().T
    seen = markers(found, len(STEPS))
    np.testing.assert_allclose(seen.measured @ turn, found.shapes.measured, atol=1e-12)
    np.testing.assert_allclose(seen.declared @ turn, found.shapes.backbone_before, atol=1e-12)

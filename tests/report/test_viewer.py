"""The 3D panel: its data are those of the results, its page needs nothing else, and it answers mouse and keys."""

import base64
import json
import re
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from arcs import arc_result, arc_step, paper_robot
from browser import NO_GL, browser, in_chromium
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from inputs import write

from tdcr_fe import Load, LoadStep, Model, SequenceResult, cli, write_results
from tdcr_fe.io.result_folder import read_motion
from tdcr_fe.report.motion import CURVE_POINTS, Markers, motion_of
from tdcr_fe.report.viewer import LEVELS, STATES, quantised, thinned, view_page


def page_data(html: str) -> dict:
    (text,) = re.findall(r'<script type="application/json">(.*?)</script>', html, flags=re.S)
    return json.loads(text)


def restored(stored: dict) -> np.ndarray:
    """The array that `quantised` has stored."""
    levels = np.frombuffer(base64.b64decode(stored["data"]), dtype="<u2").reshape(stored["shape"])
    return np.where(levels > LEVELS, np.nan, np.array(stored["low"]) + levels * np.array(stored["step"]))


TWIST = Load(0.1, moment=(0.0, 0.0, 1e-3), frame="section")


def loaded_result() -> SequenceResult:
    """Ten steps of a robot with two tendons, a force and a moment at the tip, and gravity."""
    robot = paper_robot(2)
    loads = {"tip": Load(0.25, (0.0, 0.05, 0.0)), "twist": TWIST}
    steps = [LoadStep(f"pull {k}", {"t1": 0.25 * k}, loads=loads if k == 5 else {}) for k in range(1, 11)]
    return arc_result(robot, steps, Model(gravity=(0.0, 0.0, -9.81)))


@settings(suppress_health_check=[HealthCheck.too_slow])
@given(
    arrays(float, st.tuples(st.integers(0, 5), st.integers(1, 4), st.integers(1, 3)),
           elements=st.floats(-1e6, 1e6) | st.just(np.nan))
)  # fmt: skip
def test_quantised_numbers_are_within_half_a_level(values):
    stored = json.loads(json.dumps(quantised(values)))
    found = restored(stored)
    assert found.shape == values.shape
    assert np.array_equal(np.isnan(found), np.isnan(values))
    if values.size:
        known = np.where(np.isfinite(values), values, 0.0)
        smallest = np.finfo(float).tiny  # a range below it has no levels
        bound = 0.5 * np.array(stored["step"]) + 1e-9 * np.max(np.abs(known), axis=(0, 1)) + smallest
        assert np.all(np.abs(np.where(np.isnan(values), 0.0, found - values)) <= bound)


def test_the_page_holds_shape_csv_and_tensions_csv(tmp_path):
    """Every node, rotation, tension and hole state of a simulated run, through files, page and back."""
    assert cli.main(["run", str(write(tmp_path)), "-o", str(tmp_path / "out"), "-q", "--no-pictures"]) == 0
    assert cli.main(["view", str(tmp_path / "out"), "-o", str(tmp_path / "page.html"), "-q"]) == 0
    data = page_data((tmp_path / "page.html").read_text(encoding="utf-8"))
    shape = pd.read_csv(tmp_path / "out" / "shape.csv")
    position, rotation = restored(data["position"]), restored(data["rotation"])
    s = np.array(data["s"])
    for k, step in enumerate(data["steps"]):
        rows = shape[shape.step == step]
        at = [int(np.argmin(np.abs(s - x))) for x in rows.s]
        assert np.max(np.abs(s[at] - rows.s)) < 1e-8
        assert np.max(np.abs(position[k, at] - rows[["x", "y", "z"]])) < 0.51 * max(data["position"]["step"])
        assert np.max(np.abs(rotation[k, at] - rows[["qw", "qx", "qy", "qz"]])) < 0.51 / LEVELS * 2.0
    tensions = pd.read_csv(tmp_path / "out" / "tensions.csv")
    found = restored(data["tension"])[..., 0]
    wide = np.array([tensions[tensions.step == n].tension for n in data["steps"]])
    assert found == pytest.approx(wide, abs=0.51 * data["tension"]["step"][0])
    codes = np.frombuffer(base64.b64decode(data["state"]), dtype=np.uint8).reshape(found.shape)
    states = np.array([tensions[tensions.step == n].hole_state for n in data["steps"]])
    known = codes != STATES.index("slack")
    assert np.array_equal(np.array(STATES)[codes][known], states[known]) and known.any()


def test_a_folder_gives_the_same_motion_as_the_result(tmp_path):
    result = loaded_result()
    write_results(result, tmp_path, pictures=False)
    read, made = read_motion(tmp_path), motion_of(result)
    assert view_page(read) == view_page(made)
    assert read.loads[4]["twist"] == TWIST
    assert [len(x) for x in read.loads] == [0, 0, 0, 0, 2, 2, 2, 2, 2, 2]


def test_disks_between_nodes_and_the_line_drawn_lie_on_the_curve_of_constant_strain():
    robot = paper_robot()
    off = replace(robot, disks=replace(robot.disks, positions=(0.03, 0.11, 0.25)))
    motion = motion_of(SequenceResult(off, Model(), (arc_step(off, 1, 1.2, 0.7, np.array([1.0])),)))
    assert motion.s[motion.disks] == pytest.approx([0.03, 0.11, 0.25])
    even, radius = np.linspace(0.0, 0.25, CURVE_POINTS), 0.25 / 1.2
    for s, points in ((motion.s, motion.positions[0]), (even, motion.curve(0))):
        assert np.hypot(*points[:, :2].T) == pytest.approx(radius * (1.0 - np.cos(s / radius)), abs=1e-12)
        assert points[:, 2] == pytest.approx(radius * np.sin(s / radius), abs=1e-12)


def test_long_results_are_thinned_first_and_last_step_and_every_disk_kept():
    full = motion_of(arc_result(paper_robot(4), [LoadStep("", {"t1": 0.005 * k}) for k in range(1, 301)]))
    motion = thinned(full, poses=2_000)
    assert len(motion.s) * len(motion.steps) <= 2_000
    assert (motion.steps[0], motion.steps[-1]) == (1, 300)
    assert motion.s[motion.disks] == pytest.approx(full.s[full.disks])
    at = [int(np.flatnonzero(full.s == s)[0]) for s in motion.s]
    assert np.array_equal(motion.positions, full.positions[np.ix_([k - 1 for k in motion.steps], at)])
    assert page_data(view_page(full))["stepsInAll"] == 300


def test_the_page_needs_no_other_file_and_says_no_number_twice():
    html = view_page(motion_of(loaded_result()))
    assert not re.search(r"https?:|//[a-z]+\.[a-z]|<link|@import|import\(|fetch\(|XMLHttp|src=|url\(", html)
    assert html.count("<script>") == 2
    # 0.2 said "step 25 of 25: 25" on the pages of `estimate` and "step 6 of 6: step 6" on those of `follow`.
    steps = [LoadStep(label, {"t1": 0.1}) for label in ("1", "step 2", "step 2")]
    assert page_data(view_page(motion_of(arc_result(paper_robot(4), steps))))["labels"] == ["", "", "step 2"]


def test_names_from_files_cannot_break_the_page():
    result = loaded_result()
    odd = "</script><b>&\"'"
    steps = tuple(replace(s, label=odd) for s in result.steps)
    html = view_page(motion_of(replace(result, steps=steps, robot=replace(result.robot, name=odd))))
    assert html.count("</script>") == 3 and "<b>&" not in html
    assert page_data(html)["labels"][0] == odd


# ------------------------------------------------------------------------------------------------- in Chromium

PANEL = "document.querySelector('.robot-view').panel"


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    path = tmp_path_factory.mktemp("page") / "view.html"
    result = loaded_result()
    measured = np.stack([s.positions[[9, 26]] for s in result.steps])
    markers = Markers(np.array([0.09, 0.25]), measured, 1.1 * np.stack([s.positions for s in result.steps]))
    path.write_text(view_page(motion_of(result, markers)), encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def chromium(page):
    with browser() as b:
        b.open(page)
        b.until(f"!!{PANEL}")
        yield b


@in_chromium
def test_the_robot_is_drawn_with_webgl_and_without_errors(chromium):
    assert chromium.ask(f"{PANEL}.surface !== null")
    count = chromium.ask(
        f"(() => {{ const p = {PANEL}; p.draw(); const gl = p.surface.gl, w = gl.drawingBufferWidth, "
        "h = gl.drawingBufferHeight, all = new Uint8Array(4 * w * h); "
        "gl.readPixels(0, 0, w, h, gl.RGBA, gl.UNSIGNED_BYTE, all); "
        "return all.filter((x, i) => i % 4 === 3 && x > 0).length; })()"
    )
    assert count > 3000  # pixels of grid, robot and arrows
    assert chromium.errors() == []


@in_chromium
def test_positions_in_the_browser_are_those_of_the_result(chromium):
    result = loaded_result()
    nodes = np.isin(motion_of(result).s, result.steps[0].s)
    for k in (0, 4, 9):
        chromium.ask(f"{PANEL}.go({k})")
        found = np.array(chromium.ask(f"Array.from({PANEL}.motion.p)")).reshape(-1, 3)[nodes]
        assert found == pytest.approx(result.steps[k].positions, abs=5e-6)
        corner = chromium.ask(f"{PANEL}.motion.point({PANEL}.motion.tendons[0].at[13], [0.0045, 0, 0])")
        expected = result.steps[k].positions[-1] + result.steps[k].rotations[-1] @ [4.5e-3, 0.0, 0.0]
        assert corner == pytest.approx(expected, abs=5e-6)
    chromium.ask(f"{PANEL}.go(3.5)")
    found = np.array(chromium.ask(f"Array.from({PANEL}.motion.p)")).reshape(-1, 3)[nodes]
    assert found == pytest.approx((result.steps[3].positions + result.steps[4].positions) / 2.0, abs=5e-6)


@in_chromium
def test_the_page_is_printed_on_one_sheet(chromium):
    """0.2 printed two, with one plot over another."""
    pdf = base64.b64decode(chromium.call("Page.printToPDF", paperWidth=8.27, paperHeight=11.69)["data"])
    assert len(re.findall(rb"/Type\s*/Page\b", pdf)) == 1


@in_chromium
def test_keys_change_the_step_and_play(chromium):
    step = f"{PANEL}.motion.step"
    for key, expected in [("Home", 0), ("ArrowRight", 1), ("ArrowRight", 2), ("ArrowLeft", 1), ("End", 9),
                          ("ArrowRight", 9)]:  # fmt: skip
        chromium.key(key)
        assert chromium.ask(step) == expected, key
    assert chromium.ask("document.querySelector('output').textContent") == "step 10 of 10: pull 10"
    slider = "document.querySelector('input[type=range]')"
    assert chromium.ask(f"{slider}.getAttribute('aria-valuetext')").startswith("step 10")
    chromium.key("Home")
    chromium.key(" ")
    assert chromium.ask(f"{PANEL}.playing")
    chromium.until(f"{PANEL}.motion.time > 1.0")
    chromium.key(" ")
    assert not chromium.ask(f"{PANEL}.playing")
    assert chromium.ask(f"{PANEL}.motion.time === {step}")  # stopped on a load step


@in_chromium
def test_the_mouse_turns_moves_zooms_and_resets(chromium):
    x, y = chromium.ask("(() => { const b = document.querySelector('.stage').getBoundingClientRect();"
                       " return [b.left + b.width / 2, b.top + b.height / 2]; })()")  # fmt: skip
    camera = f"(c => [c.turn, c.lift, c.distance, ...c.target])({PANEL}.camera)"
    chromium.ask(f"{PANEL}.reset()")
    start = np.array(chromium.ask(camera))
    chromium.drag((x, y), (x + 50, y + 20))
    turned = np.array(chromium.ask(camera))
    assert turned[:2] - start[:2] == pytest.approx([-0.4, 0.16]) and np.array_equal(turned[2:], start[2:])
    point = chromium.ask(f"{PANEL}.project({PANEL}.camera.target)")
    target = chromium.ask(f"{PANEL}.camera.target")
    chromium.drag((x, y), (x + 40, y - 30), button="right")
    moved = chromium.ask(f"{PANEL}.project({json.dumps(target)})")  # it stays under the mouse
    assert np.array(moved[:2]) - point[:2] == pytest.approx([40.0, -30.0], abs=0.5)
    before = chromium.ask(f"{PANEL}.camera.distance")
    chromium.mouse("mouseWheel", x, y, deltaX=0, deltaY=-200)
    chromium.until(f"{PANEL}.camera.distance < {0.9 * before}")
    for count in (1, 2):
        chromium.click(x, y, count)
    chromium.until(f"{PANEL}.camera.distance > {0.99 * start[2]}")
    assert chromium.ask(camera) == pytest.approx(start)


@in_chromium
def test_pointing_at_a_hole_tells_its_tension_and_a_plot_leads_to_the_step(chromium):
    chromium.ask(f"{PANEL}.reset(), {PANEL}.go(5)")
    place = chromium.ask(
        f"(() => {{ const p = {PANEL}, b = p.stage.getBoundingClientRect(), m = p.motion, t = m.tendons[0];"
        "const [x, y] = p.project(m.point(t.at[5], t.points[5])); return [b.left + x, b.top + y]; })()"
    )
    chromium.mouse("mouseMoved", *place)
    chromium.until("!document.querySelector('.tip').hidden")
    text = chromium.ask("document.querySelector('.tip').textContent")
    said = re.fullmatch(r"t1, hole 5: sticks, s = 96.15 mm\n([\d.]+) N below, ([\d.]+) N above", text)
    assert said and [float(x) for x in said.groups()] == pytest.approx([1.5 * 0.9**4, 1.5 * 0.9**5], abs=2e-4)
    point = chromium.ask(
        f"(() => {{ const s = {PANEL}.plots, q = s.response, p = s.responsePoints[2];"
        "const b = q.svg.getBoundingClientRect(); return [b.left + q.x(p[0]), b.top + q.y(p[1])]; })()"
    )
    chromium.click(*point)
    assert chromium.ask(f"{PANEL}.motion.step") == 2


@in_chromium
def test_without_webgl_a_sentence_and_a_still_picture(page):
    with browser(*NO_GL) as b:
        b.open(page)
        b.until(f"!!{PANEL}")
        assert b.ask(f"{PANEL}.surface === null")
        assert "This browser has no WebGL" in b.ask("document.querySelector('.still').innerText")
        assert b.ask("document.querySelector('.still svg').getBoundingClientRect().height") > 200
        b.key("Home")
        assert b.ask(f"{PANEL}.motion.step") == 0
        assert b.errors() == []


@in_chromium
@pytest.mark.parametrize(("width", "dark"), [(360, False), (1400, True)])
def test_nothing_is_wider_than_the_window_and_controls_have_names(page, width, dark):
    with browser() as b:
        b.open(page, width, 900, dark)
        b.until(f"!!{PANEL}")
        assert b.ask("document.documentElement.scrollWidth") <= width
        assert b.ask(f"{PANEL}.look.theme") == ("dark" if dark else "light")
        nameless = b.ask(
            "[...document.querySelectorAll('button, select, input, svg, [tabindex]')].filter(e => !(e.ariaLabel || "
            "e.getAttribute('aria-label') || e.closest('label'))).map(e => e.outerHTML.slice(0, 80))"
        )
        assert nameless == []

"""The live page in a browser: sliders, the mouse on the robot, and the end of its server."""

from collections.abc import Iterator

import pytest
from browser import Browser, browser, in_chromium
from robots import three

import tdcr_fe as tdcr

CONTROL = "document.querySelector('form.live').control"


@pytest.fixture
def opened() -> Iterator[tuple[Browser, tdcr.LiveRobot]]:
    served = tdcr.live(three(), tdcr.Model(elements_per_bay=1))
    with browser() as page:
        page.open(served.url, 1366, 768)
        page.until(f"{CONTROL} !== undefined")
        yield page, served
    served.close()


def answered(page: Browser) -> None:
    page.until(f"!{CONTROL}.asking")


def tip(page: Browser) -> list[float]:
    """Where the page shows the tip in its window [pixels]."""
    return page.ask(
        f"(() => {{ const p = {CONTROL}.panel, b = p.stage.getBoundingClientRect();"
        f" const q = p.project(p.motion.tip(p.motion.count - 1)); return [b.left + q[0], b.top + q[1]]; }})()"
    )


def errors(page: Browser, served: tdcr.LiveRobot) -> list[str]:
    return [e for e in page.errors() if not e.startswith(served.url.split("?")[0])]


@in_chromium
def test_sliders_mouse_and_switches_are_load_steps(opened):
    page, served = opened
    slider = f"{CONTROL}.tendons[0].slider"
    page.ask(f"{slider}.value = 1.5; {slider}.dispatchEvent(new Event('input'))")
    answered(page)
    assert served.steps[-1].tensions == {"t1": 1.5}
    x, y = tip(page)
    page.drag((x, y), (x + 60, y + 40))
    answered(page)
    pulls = [s for s in served.steps if "pull_13" in s.loads]
    assert pulls and any(pulls[0].loads["pull_13"].force) and not any(served.steps[-1].loads["pull_13"].force)
    turn = page.ask(f"{CONTROL}.panel.camera.turn")
    page.drag((120, 500), (180, 490))
    assert page.ask(f"{CONTROL}.panel.camera.turn") != turn, "elsewhere dragging turns the view"
    count = len(served.steps)
    page.ask("document.querySelector('[data-do=friction]').click()")
    answered(page)
    assert [s.label for s in served.steps] == ["unloaded", "friction off"] and count > 2
    page.ask("document.querySelector('[data-do=restart]').click()")
    answered(page)
    assert [s.label for s in served.steps] == ["unloaded"]
    assert page.ask(f"{slider}.valueAsNumber") == 0.0
    page.ask(f"{CONTROL}.tendons[0].number.select()")
    for key in "10":
        page.key(key)
    answered(page)
    assert served.steps[-1].tensions == {"t1": 10.0}, "keys belong to the number while it has the focus"
    assert errors(page, served) == []


@in_chromium
def test_changes_that_wait_for_an_answer(opened):
    """They are sent as what they were asked for, newest last, and not in the unit that was chosen since."""
    page, served = opened
    moves = [f"{CONTROL}.tendons[{j}].slider" for j in range(2)]
    drive = "document.querySelector('[data-choice=drive]')"
    with served.solving:
        for value in (1.0, 1.5):
            page.ask(f"{moves[0]}.value = {value}; {moves[0]}.dispatchEvent(new Event('input'))")
        page.ask(f"{drive}.value = 'displacement'; {drive}.dispatchEvent(new Event('change'))")
        page.ask(f"{moves[1]}.value = 2; {moves[1]}.dispatchEvent(new Event('input'))")
        assert page.ask(f"{moves[0]}.valueAsNumber") == 0.0, "zero is among the values of a slider"
    answered(page)
    assert [s.tensions for s in served.steps] == [{}, {"t1": 1.0}, {"t1": 1.5}, {}]
    assert served.steps[-1].displacements == {"t2": 2e-3}
    with served.solving:
        for value in (1.0, 3.0):
            page.ask(f"{moves[1]}.value = {value}; {moves[1]}.dispatchEvent(new Event('input'))")
        page.ask("document.querySelector('[data-do=restart]').click()")
    answered(page)
    assert [s.label for s in served.steps] == ["unloaded"], "a restart ends what was asked for before"
    assert errors(page, served) == []


@in_chromium
def test_a_change_that_is_not_made_is_no_step_of_the_page(opened, monkeypatch):
    page, _ = opened
    monkeypatch.setattr("tdcr_fe.live.played.LONGEST_STEP", 0.0)
    friction = "document.querySelector('[data-do=friction]')"
    page.ask(f"{friction}.click()")
    answered(page)
    assert "not made" in page.ask("document.querySelector('[data-say=message]').textContent")
    assert page.ask(f"{friction}.checked") and page.ask(f"{CONTROL}.panel.motion.count") == 1


@in_chromium
def test_the_page_says_that_its_server_has_ended(opened):
    page, served = opened
    served.close()
    page.until("document.querySelector('[data-say=message]').textContent.includes('has ended')")
    assert page.ask(f"{CONTROL}.tendons[0].slider.disabled")


@in_chromium
def test_the_page_on_a_phone(opened):
    page, served = opened
    page.open(served.url, 390, 844, dark=True)
    assert page.ask("document.documentElement.scrollWidth") <= 390
    page.call("Emulation.setEmulatedMedia", media="print")
    assert page.ask("document.querySelector('.stage').clientHeight") > 0, "the robot is printed"

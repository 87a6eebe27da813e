"""The page of all reports: formatted numbers, sections from templates, no external files."""

import base64
import math
import re

import pytest
from matplotlib.figure import Figure

from tdcr_fe.report import style
from tdcr_fe.report.environment import estimate, fixed, quantity, significant
from tdcr_fe.report.page import Card, Page, Picture, Section, render

HERE = "tdcr_fe.report"


SHOWN = [
    (0.0188, "m", "18.8 mm"),
    (0.25, "m", "250 mm"),
    (2.0e-7, "m", "200 nm"),
    (-3.5e-6, "m", "−3.5 µm"),
    (math.pi / 2.0, "rad", "90 deg"),
    (107.0, "N", "107 N"),
    (0.02, "kg", "20 g"),
    (6.95, "m/s^2", "6.95 m/s²"),
    (0.0, "m", "0 m"),
    (math.nan, "m", "–"),
]


@pytest.mark.parametrize(("value", "unit", "text"), SHOWN)
def test_a_quantity_has_its_unit_and_prefix(value, unit, text):
    assert quantity(value, unit).replace("\N{NO-BREAK SPACE}", " ") == text


def test_an_estimate_ends_where_its_interval_begins():
    def plain(*args):
        return estimate(*args).replace("\N{NO-BREAK SPACE}", " ")

    assert plain(6.9503, 0.0142, "m/s^2") == "6.950 ± 0.014 m/s²"
    assert plain(0.00012, 0.01, "m") == "0 ± 10 mm"
    assert plain(107.0, None, "N") == "107 N"
    assert plain(-3.415e-7, 4.4e-9, "N m^2 s^-1") == "(−3.415 ± 0.044)e-7 N m²/s"


def test_plain_numbers():
    assert (fixed(-1.005, 1), fixed(None), fixed(-0.0001)) == ("−1.0", "–", "0.00")
    assert significant(123456.0) == "1.23e+05"
    assert significant(183.0, 2) == "180" and significant(-12_340.0) == "−12300"


def page(**rest):
    return Page(**{"title": "A report", "verdict": "All <b> hold.", "level": "good", **rest})


def test_a_page_needs_no_other_file_and_escapes_text():
    figure = Figure()
    figure.subplots().plot([0, 1])
    picture = Picture(figure, "a rising line", "One line.")
    text = render(page(pictures=(picture,), cards=(Card("3 mm", "tip"),), notes=("made < today",)), HERE)
    assert "All &lt;b&gt; hold." in text and "made &lt; today" in text and "3 mm" in text
    assert "url(" not in text and "@import" not in text and "<link" not in text
    (source,) = re.findall(r'(?:src|href)="([^"]*)"', text)
    kind, code = source.split(",")
    assert kind == "data:image/svg+xml;base64"
    assert base64.b64decode(code).decode() == style.svg(figure)


def test_sections_are_linked_and_folded_as_they_say():
    seen = Section("open", "To be seen", "macros.html.j2", folded=False)
    text = render(page(sections=(seen, Section("more", "Folded", "macros.html.j2"))), HERE)
    assert set(re.findall(r'href="#(\w+)"', text)) == {"open", "more"}
    assert '<details class="section" id="more">' in text and '<section class="section" id="open">' in text


def test_letters_in_a_picture_have_9_pixels_on_a_phone():
    """A legend in one row was 800 pixels wide, with letters of 4 pixels on a narrow page; a wide panel had 7."""
    figure = Figure(figsize=(9.0, 2.5), layout="constrained")
    axes = figure.add_subplot()
    for k in range(4):
        axes.plot([0.0, 1.0], [0.0, k], label=f"measured, held out, branch {k}")
    figure.legend(loc="outside lower center", ncols=4)
    text = render(page(pictures=(Picture(figure, "wide"),)), HERE)
    found = re.findall(r'base64,([^"]*)" alt="\w*" style="min-width: (\d+)px', text)
    for code, least in found:
        width = float(re.search(r'width="([\d.]+)pt', base64.b64decode(code).decode())[1])
        shrunk = max(0.75 * int(least), min(0.75 * 362.0, width)) / width
        assert style.STYLE["legend.fontsize"] * shrunk >= 0.75 * 9.0
    assert len(found) == 2 and width < 0.75 * 500.0  # the legend comes last

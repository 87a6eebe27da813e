"""The page "Friction laws": its Python runs, and prints what the page shows."""

from __future__ import annotations

import contextlib
import io
import re
from pathlib import Path

import numpy as np
import pytest

PAGE = Path(__file__).parents[2] / "docs" / "friction.md"
FENCE = re.compile(r"^```(\w+)\n(.*?)^```$", re.MULTILINE | re.DOTALL)


def run_page():
    """Names that the page's Python leaves, what it printed, and what the page says it prints."""
    fences = FENCE.findall(PAGE.read_text(encoding="utf-8"))
    names = {"__name__": __name__}
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed):
        for language, code in fences:
            if language == "python":
                exec(compile(code, str(PAGE), "exec", dont_inherit=True), names)
    shown = "".join(code for language, code in fences if language == "text")
    return names, printed.getvalue(), shown


def test_the_page_prints_what_it_shows_and_its_law_is_what_it_says():
    """A law of one's own in 20 lines: the angle of the page, and coefficients between its bounds."""
    names, printed, shown = run_page()
    assert printed == shown
    law = names["CoatedFriction"](0.1, 0.4, 0.2)
    force = np.linspace(0.0, 2.0, 21)
    mu, by_force, _ = law.coefficient(force, 0.0 * force)
    assert mu[0] == 0.1 and 0.399 < mu[-1] <= 0.4
    difference = law.coefficient(force + 1e-6, force)[0] - law.coefficient(force - 1e-6, force)[0]
    assert by_force == pytest.approx(difference / 2e-6, abs=1e-8)
    source = next(
        c for _, c in FENCE.findall(PAGE.read_text(encoding="utf-8")) if "class CoatedFriction" in c
    )
    assert len(source.splitlines()) <= 25

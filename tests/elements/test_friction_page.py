"""The page "Friction laws": its Python runs, and prints what the page shows."""

from __future__ import annotations

import contextlib
import io
import re
from pathlib import Path

import numpy as np
import pytest

from tdcr_fe.io.problems import InputError
from tdcr_fe.io.toml import read_robot

PAGE = Path(__file__).parents[2] / "docs" / "friction.md"
FENCE = re.compile(r"^```(\w+)\n(.*?)^```$", re.MULTILINE | re.DOTALL)


def run_page():
    """Names defined by the page's Python, its output, and the output shown on the page."""
    fences = FENCE.findall(PAGE.read_text(encoding="utf-8"))
    names = {"__name__": __name__}
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed):
        for language, code in fences:
            if language == "python":
                exec(compile(code, str(PAGE), "exec", dont_inherit=True), names)
    shown = "".join(code for language, code in fences if language == "text")
    return names, printed.getvalue(), shown


def test_the_tables_of_the_page_are_the_tendons_of_its_python(tmp_path):
    tables = "".join(
        code for language, code in FENCE.findall(PAGE.read_text(encoding="utf-8")) if language == "toml"
    )
    rest = """[backbone]
length = 0.25
radius = 0.4e-3
youngs_modulus = 85e9
poisson_ratio = 0.3
[disks]
count = 13
"""
    path = tmp_path / "robot.toml"
    path.write_text(rest + tables, encoding="utf-8")
    names, *_ = run_page()
    assert read_robot(path).tendons == (names["t1"], names["t2"])


@pytest.mark.parametrize(
    ("law", "value"),
    [
        ("kind = 'stribeck', static = 0.3, kinetic = -0.1, stribeck_rate = 1e-3", "kinetic"),
        ("kind = 'stribeck', static = 0.3, kinetic = 0.1, stribeck_rate = 0.0", "stribeck_rate"),
        ("kind = 'stribeck', static = 0.3, kinetic = 0.1", "stribeck_rate"),
        ("kind = 'force-dependent', mu = 0.3, reference_force = 0.2, exponent = 2", "exponent"),
        ("kind = 'stribek', static = 0.3", "kind"),
    ],
)
def test_an_invalid_law_is_refused_by_its_key(tmp_path, law, value):
    path = tmp_path / "robot.toml"
    path.write_text(
        "[backbone]\nlength = 0.25\nradius = 4e-4\nyoungs_modulus = 85e9\npoisson_ratio = 0.3\n[disks]\ncount = 13\n"
        f"[[tendons]]\nname = 't1'\nrouting = 'parallel'\noffset = 4.5e-3\nfriction = {{ {law} }}\n",
        encoding="utf-8",
    )
    with pytest.raises(InputError) as caught:
        read_robot(path)
    assert [p.key for p in caught.value.problems] == [f"tendons[0].friction.{value}"]


def test_output_and_law_of_the_page_are_those_stated():
    """A user-defined law: the angle of the page, and coefficients between its bounds."""
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

"""The page "Sweeps" shows files that can be read, and every method, distribution and status."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

import tdcr_fe as tdcr
from tdcr_fe.sweeps.cases import STATUSES
from tdcr_fe.sweeps.sampling import DISTRIBUTIONS, METHODS

DOCS = Path(__file__).parents[2] / "docs"
PAGE = (DOCS / "sweeps.md").read_text(encoding="utf-8")


@pytest.mark.parametrize(("name", "cases"), [("uncertainty", 384), ("workspace", 512)])
def test_the_sweeps_of_the_page_are_the_files_of_the_examples(name, cases):
    path = DOCS / "examples" / "sweeps" / f"{name}.toml"
    shown = re.search(rf"^```toml\n# {name}\.toml\n(.*?)^```$", PAGE, re.MULTILINE | re.DOTALL)[1]
    assert shown == path.read_text(encoding="utf-8")
    assert tdcr.read_sweep(path).design().count == cases


def test_the_page_names_everything():
    for word in (*METHODS, *STATUSES, *DISTRIBUTIONS, "factor", "offset"):  # keys are generated
        assert re.search(rf'[`"]{re.escape(word)}["`]', PAGE), word

"""The page "Troubleshooting" has an entry for every message that a user can get, and none that no longer exists."""

import re
from functools import cache
from itertools import pairwise
from pathlib import Path

from source_messages import VALUE, messages

ROOT = Path(__file__).parent.parent
PAGE = (ROOT / "docs" / "troubleshooting.md").read_text(encoding="utf-8")
#: Messages of Python itself.
OF_PYTHON = {"No module named 'tdcr_fe.elements'", "has no attribute 'CreateTDCR'"}
ALL = messages(ROOT)


def entries() -> list[str]:
    """The quoted words of every entry: a line before one that begins with a colon."""
    lines = PAGE.splitlines()
    terms = [a for a, b in pairwise(lines) if b.startswith(": ")]
    return [word for term in terms if not term.startswith("*") for word in re.findall(r"`([^`]+)`", term)]


@cache
def pattern(entry: str) -> re.Pattern[str]:
    return re.compile(".*?".join(map(re.escape, entry.split(VALUE))), re.DOTALL)


def matches(entry: str, text: str) -> bool:
    return pattern(entry).search(text) is not None


def test_messages_are_found():
    """Of every kind: errors, problems of files, contradictions, warnings, states of the solver, faults of data."""
    assert len(ALL) > 300
    texts = "\n".join(m.text for m in ALL)
    for part in (
        "no disk is there; the nearest",
        "No equilibrium followed the path",
        "nothing has mass, so it does nothing",
        "without it the history of loading is lost",
        "something in the scene moves freely",
        "the readings drift along",
        "no robot in this system",
    ):
        assert part in texts


def test_every_message_has_an_entry():
    known = entries()
    missing = [f"{m.place}: {m.text}" for m in ALL if not any(matches(e, m.text) for e in known)]
    assert not missing, "no entry in docs/troubleshooting.md:\n" + "\n".join(missing)


def test_every_entry_is_that_of_a_message():
    shortest = messages(ROOT, words=1)
    stale = [e for e in entries() if e not in OF_PYTHON and not any(matches(e, m.text) for m in shortest)]
    assert not stale


def test_an_entry_is_specific():
    """Two words at least, and no entry for more than a twelfth of all messages."""
    for entry in entries():
        assert len(entry.split()) >= 2 or entry.endswith(":")
        assert sum(matches(entry, m.text) for m in ALL) < len(ALL) / 12, entry


def test_an_entry_names_cause_or_remedy_in_a_few_sentences():
    texts = re.findall(r"^: ((?:.|\n  )+)", PAGE, re.MULTILINE)
    assert len(texts) > 150
    assert all(20 < len(t) < 600 for t in texts)

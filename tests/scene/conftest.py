"""Figures that tests of scenes have seen; ``python -m pytest tests/scene --figures`` prints them as a table.

With the option only the tests that give figures run, slow ones included.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

#: What is measured and its limit, by the name that tests use.
FIGURES: dict[str, tuple[str, float]] = {
    "repeat": ("a second `mbs.SolveDynamic`, after `arm.reset()` too, against the first [length]", 1e-12),
    "functions": ("user functions set in any order, taken away again, against none [length]", 1e-12),
    "contact": ("every contact item, `mbs.SolveTDCR` against `mbs.SolveStatic` [length]", 1e-4),
    "contact friction": ("the same with friction in the holes [length]", 1e-3),
    "contact iterations": ("iterations of a step of these", 30),
    "ramp": ("sequences of tensions and loads in a scene against `simulate` [length]", 1e-9),
    "hand-over": ("motion at rest after `mbs.SolveTDCR`, both drives [length]", 1e-6),
    "hand-over tension": ("change of the tensions there [1]", 1e-4),
    "mode free": ("eigenfrequency against the spectrum of the swing, holes without friction [1]", 5e-3),
    "mode stuck": ("the same, holes stuck [1]", 5e-3),
    "mode driven": ("the same, tendons driven by displacement [1]", 5e-3),
    "decay": ("decay of three bending modes by material damping against the closed form [1]", 1e-2),
    "rod": ("rod released from a wrench, 2 s at 1 ms, against half the step and twice the elements [length]", 1e-3),
    "energy": ("energy neither stored nor dissipated by friction and material, 0.5 s at 1 ms, 20 robots [work]", 1e-4),
    "energy balance": ("the same without the error of the integration in time [work]", 1e-4),
    "sudden": ("cut and sudden pull of 2 N, thin and thick disks: steps over those of 1 ms", 5.0),
    "sudden long": ("the same, over those of 5 ms", 5.0),
    "recommended": ("robots of the tests that the recommended settings do not solve at 1 ms", 0),
    "step 1": ("step of 13 disks, one tendon with friction, over constant forces without hooks", 2.5),
    "step 3": ("the same, three tendons", 3.5),
    "jacobian": ("Jacobian of the forces beside 3000 other coordinates [ms]", 0.5),
    "memory": ("memory of a scene that is dropped [MB]", 0.01),
    "rope": ("robot without friction against `ReevingSystemSprings` [length]", 1e-9),
    "slow pull": ("pull of 4 s with friction against statics [length]", 1e-5),
}  # fmt: skip

SEEN = pytest.StashKey[dict[str, tuple[float, int]]]()


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add the option."""
    parser.addoption(
        "--figures", action="store_true", help="run the tests that give figures, and print these"
    )


def pytest_configure(config: pytest.Config) -> None:
    """Select slow tests, too."""
    config.stash[SEEN] = {}
    if config.getoption("figures", default=False):
        config.option.markexpr = ""


def pytest_collection_modifyitems(config: pytest.Config, items: list[Any]) -> None:
    """Leave out the tests without figures."""
    if config.getoption("figures", default=False):
        without = [item for item in items if "figure" not in getattr(item, "fixturenames", ())]
        config.hook.pytest_deselected(items=without)
        items[:] = [item for item in items if item not in without]


@pytest.fixture
def figure(request: pytest.FixtureRequest) -> Callable[[str, float], None]:
    """Keep a figure for the table, and check that it is within the limit of its name."""
    seen = request.config.stash[SEEN]

    def check(name: str, value: float) -> None:
        worst, count = seen.get(name, (0.0, 0))
        seen[name] = max(worst, float(value)), count + 1
        assert value <= FIGURES[name][1]

    return check


def pytest_terminal_summary(terminalreporter: Any, config: pytest.Config) -> None:
    """Print the table: the largest of every figure."""
    if not config.getoption("figures", default=False):
        return
    terminalreporter.write_line("\n| what | largest seen | limit | tests |\n| --- | --- | --- | --- |")
    for name, (text, limit) in FIGURES.items():
        if name in config.stash[SEEN]:
            worst, count = config.stash[SEEN][name]
            terminalreporter.write_line(f"| {text} | {worst:.2g} | {limit:g} | {count} |")

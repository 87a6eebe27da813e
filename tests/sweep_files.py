"""Small sweeps for tests, and executors that solve in this process."""

from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from typing import Any

from inputs import document
from robots import tendon

from tdcr_fe import Backbone, Disks, Robot, robot_to_toml

TENDONS = (tendon("t1", 0.0, 0.1), tendon("t2", 120.0, 0.2))
ROBOT = robot_to_toml(Robot(Backbone(0.2, 0.4e-3, 85e9, 0.3), Disks.equally_spaced(2, 0.2), TENDONS, "small"))
SCENARIO = """
robot = "robot.toml"
[model]
elements_per_bay = 1
[solver]
mesh_tolerance = inf
[[steps]]
tensions = { t1 = 1.0 }
"""
#: Of which large tensions do not converge.
HASTY = SCENARIO.replace("[solver]", "[solver]\nmax_iterations = 4\nmin_substep = 1.0")
#: Six cases.
SWEEP = """
scenario = "scenario.toml"
vary = [
  { key = "steps[0].tensions.t1", values = [0.5, 1.0, 1.5] },
  { key = "backbone.youngs_modulus", mode = "factor", values = [1.0, 1.2] },
]
"""


def varying(values: dict[str, list[float]]) -> str:
    """A sweep of the scenario with all combinations of values of keys."""
    vary = [{"key": key, "values": each} for key, each in values.items()]
    return document({"scenario": "scenario.toml", "vary": vary})


def write_files(folder: Path, sweep: str = SWEEP, scenario: str = SCENARIO, robot: str = ROBOT) -> Path:
    """Write the three files; the path of the sweep."""
    for name, text in (("robot", robot), ("scenario", scenario), ("sweep", sweep)):
        (folder / f"{name}.toml").write_text(text)
    return folder / "sweep.toml"


class InProcess(ThreadPoolExecutor):
    """Solves in this process; ``stop_after`` calls it raises KeyboardInterrupt, as Ctrl-C does."""

    def __init__(self, stop_after: int | None = None) -> None:
        super().__init__(1)
        self.stop_after, self.calls = stop_after, 0

    def submit(self, fn: Any, /, *args: Any, **kwargs: Any) -> Future[Any]:
        if self.calls == self.stop_after:
            raise KeyboardInterrupt
        self.calls += 1
        return super().submit(fn, *args, **kwargs)

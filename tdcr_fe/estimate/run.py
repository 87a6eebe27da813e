"""Estimation over a folder of measured data: `read_estimation` and `run_estimation`."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any

from tdcr_fe.estimate.description import Estimate, InputPrior, LoadPrior
from tdcr_fe.estimate.estimator import Estimator
from tdcr_fe.io.measured import MeasuredData, read_measured
from tdcr_fe.io.problems import Problem, Reporter, read_all
from tdcr_fe.io.readings import Reading
from tdcr_fe.io.toml import digest, read_toml
from tdcr_fe.model.loading import LoadStep
from tdcr_fe.model.schema import Keys, Quantity, keys_of

#: Keys at the top of ``estimate.toml``.
TOP = Keys(
    {
        "load": Annotated[
            dict[str, Any], Quantity("the load", allowed="a table [load] with at, sigma, correlation_time")
        ],
        "inputs": Annotated[
            dict[str, Any], Quantity("their errors", allowed="a table [inputs] with sigma, correlation_time")
        ],
    },
    {"load": {}},
)


@dataclass(frozen=True)
class Estimation:
    """Measured data, and what is known of load and inputs before any reading.

    Attributes
    ----------
    data : MeasuredData
    load : LoadPrior
    inputs : InputPrior
    digests : mapping of str to str
        SHA-256 of the files, by name.
    """

    data: MeasuredData
    load: LoadPrior
    inputs: InputPrior
    digests: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class EstimateResult:
    """The estimates of all frames.

    Attributes
    ----------
    estimation : Estimation
    frames : tuple of Estimate
        One for each load step, as far as the run went.
    interrupted : bool
        Whether the user pressed Ctrl-C.
    """

    estimation: Estimation
    frames: tuple[Estimate, ...]
    interrupted: bool = False

    @property
    def failed(self) -> tuple[int, ...]:
        """Numbers of the steps that were not solved, as the file has them."""
        ids = self.estimation.data.step_ids
        return tuple(n for n, frame in zip(ids, self.frames, strict=False) if frame.message)


def read_estimation(folder: str | os.PathLike[str]) -> Estimation:
    """Read a folder of measured data, as for `identify`, with times and an ``estimate.toml``.

    Raises
    ------
    InputError
        With every mistake in the files.
    """
    folder = Path(folder)
    path = folder / "estimate.toml"
    tables: list[dict[str, Any]] = []
    data, _ = read_all(lambda: read_measured(folder), lambda: tables.append(_tables(path)))
    top, reporter = tables[0], Reporter(str(path))
    load, inputs = LoadPrior(**top["load"]), InputPrior(**top["inputs"])
    try:
        inputs.sigmas(data.robot.tendon_names)
    except ValueError as error:
        reporter("inputs.sigma", str(top["inputs"]["sigma"]), str(error).removeprefix("sigma: "))
    length = data.robot.backbone.length
    if isinstance(load.at, float) and load.at > length:
        reporter(
            "load.at", f"{load.at:g}", f"must be an arc length up to the length of the backbone, {length:g} m"
        )
    reporter.problems.extend(_problems(data, folder))
    reporter.refuse()
    return Estimation(data, load, inputs, {**(data.digests or {}), path.name: digest(path)})


def _tables(path: Path) -> dict[str, Any]:
    """The valid tables of ``estimate.toml``."""
    contents, _ = read_toml(path)
    reporter = Reporter(str(path))
    top, _ = TOP.read(contents, "", reporter.mistake)
    found = {}
    for name, kind in (("load", LoadPrior), ("inputs", InputPrior)):
        if name in top:
            found[name], _ = keys_of(kind).read(top[name], name, reporter.mistake)
    reporter.refuse()
    return found


def _problems(data: MeasuredData, folder: Path) -> list[Problem]:
    """What estimation needs and `identify` does not: times, and standard deviations of all readings."""
    found = []
    loading, observations = str(folder / "loading.csv"), str(folder / "observations.csv")
    if all(step.time is None for step in data.steps):
        allowed = "missing column; estimation needs the time of every step [s]"
        found.append(Problem(loading, "time", "", allowed))
    elif untimed := [n for n, step in zip(data.step_ids, data.steps, strict=True) if step.time is None]:
        found.append(
            Problem(loading, "time", f"empty in step {untimed[0]}", "must be a time [s] in every step")
        )
    if unknown := [r for r in data.readings if r.sigma is None]:
        what = f"empty in line {unknown[0].line}" + (f" and {len(unknown) - 1} more" if unknown[1:] else "")
        found.append(
            Problem(observations, "sigma", what, "estimation needs the standard deviation of every reading")
        )
    if data.experiment.ends is not None:
        allowed = "estimation takes no effects that divide load steps, such as actuator_backlash"
        found.append(Problem(str(folder / "model.toml"), "effects", "", allowed))
    return found


def run_estimation(
    estimation: Estimation, progress: Callable[[Estimate], None] | None = None
) -> EstimateResult:
    """Estimate all frames in order.

    Parameters
    ----------
    estimation
        Data and priors.
    progress
        Called with every frame.

    Returns
    -------
    EstimateResult
        A frame that was not solved says so, and the run goes on with the next. After Ctrl-C, the frames until then.
    """
    data = estimation.data
    experiment = data.experiment
    by_step: dict[int, list[Reading]] = {n: [] for n in data.step_ids}
    for reading in data.readings:
        by_step[reading.step].append(reading)
    steps: tuple[LoadStep, ...] = experiment.steps
    estimator = Estimator(
        experiment.robot,
        experiment.model,
        estimation.load,
        estimation.inputs,
        steps=steps,
        observation=experiment.observation,
        settings=data.settings,
    )
    frames: list[Estimate] = []
    try:
        for number, step in zip(data.step_ids, steps, strict=True):
            frames.append(estimator.step(step, by_step[number]))
            if progress is not None:
                progress(frames[-1])
    except KeyboardInterrupt:
        return EstimateResult(estimation, tuple(frames), True)
    return EstimateResult(estimation, tuple(frames))

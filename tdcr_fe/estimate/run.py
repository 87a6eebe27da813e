"""Estimation over a folder of measured data: `read_estimation` and `run_estimation`."""

from __future__ import annotations

import math
import os
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any

from tdcr_fe.effects import Experiment, with_effects
from tdcr_fe.estimate.description import Estimate, InputPrior, LoadPrior, ParameterPrior
from tdcr_fe.estimate.estimator import Estimator
from tdcr_fe.estimate.identified import prior_of_robot, read_identified, read_sigma
from tdcr_fe.estimate.smoothing import smoothed
from tdcr_fe.io.files import Problem, Reporter, read_all, refusal
from tdcr_fe.io.measured import MeasuredData, first_checks, read_measured
from tdcr_fe.io.readings import Reading
from tdcr_fe.io.toml import read_toml
from tdcr_fe.model.loading import Load, LoadStep, SolverSettings
from tdcr_fe.model.messages import count, issue, warnings_to
from tdcr_fe.model.plausibility import Findings, plausibility
from tdcr_fe.model.schema import FieldError, Keys, Quantity

_FOUND = Quantity("folder that identify wrote", allowed="the folder of the results of identify, from here")
_UNCERTAIN = Quantity(
    "standard deviations of numbers of effects", allowed="a table [uncertain], as [effects]"
)
#: Keys of ``estimate.toml``.
TOP = Keys(
    {
        "identified": Annotated[str, _FOUND],
        "uncertain": Annotated[dict[str, Any], _UNCERTAIN],
        "load": Annotated[LoadPrior, Quantity("the load")],
        "inputs": Annotated[
            InputPrior, Quantity("errors of the inputs", allowed="a table [inputs] with sigma")
        ],
    },
    {"load": LoadPrior(), "inputs": None, "identified": "", "uncertain": {}},
)
#: What is said where there is no such file.
_LEAST = "must have at least 'inputs = {sigma = 0.01}', the error of the inputs [N, m or rad]; see docs/estimate.md"

#: Later frames whose readings at least count in the smoothed estimates; a frame takes 0.1 to 0.5 MB until then.
WINDOW = 100
#: Mean square of the innovations over their variance above which the readings contradict what is known of load and
#: inputs. Right readings give 0.4 to 1.2, errors of all kinds twice as large as said 3.6, y of the other sign 52.
CONTRADICTED = 4.0


@dataclass(frozen=True)
class Estimation:
    """Measured data, and what is known of load, inputs and robot before any reading.

    Attributes
    ----------
    data : MeasuredData
    load : LoadPrior
    inputs : InputPrior
    effects : mapping
        That `identify` found, by effect and parameter.
    uncertain : ParameterPrior
        Effects on the robot, and what is known of their numbers.
    """

    data: MeasuredData
    load: LoadPrior
    inputs: InputPrior
    effects: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    uncertain: ParameterPrior = field(default_factory=ParameterPrior)

    @property
    def experiment(self) -> Experiment:
        """With all effects."""
        return with_effects(self.data.experiment, self.effects)

    @property
    def estimator(self) -> Estimator:
        """A new one; a FieldError where what is given does not fit the robot."""
        declared, own, settings = self.data.experiment, self.experiment, self.data.settings
        return Estimator(
            declared.robot,
            declared.model,
            self.load,
            self.inputs,
            steps=own.steps,
            observation=own.observation,
            uncertain=self.uncertain,
            settings=None if settings == SolverSettings() else settings,
        )


@dataclass(frozen=True, eq=False)
class EstimateResult:
    """The estimates of all frames.

    Attributes
    ----------
    estimation : Estimation
    frames : tuple of Estimate
        One for each load step, as far as the run went.
    smoothed : tuple of Estimate
        The same, given also the readings of later frames, of at least `WINDOW`.
    interrupted : bool
        Whether the user pressed Ctrl-C.
    """

    estimation: Estimation
    frames: tuple[Estimate, ...]
    smoothed: tuple[Estimate, ...] = ()
    interrupted: bool = False

    @property
    def failed(self) -> tuple[int, ...]:
        """Numbers of the steps that were not solved, as the file has them."""
        ids = self.estimation.data.step_ids
        return tuple(n for n, frame in zip(ids, self.frames, strict=False) if frame.message)

    @property
    def failure(self) -> str:
        """How many frames were not solved, and the first reason; empty where there are none."""
        if not (failed := self.failed):
            return ""
        first = next(frame.message for frame in self.frames if frame.message)
        return f"{count(len(failed), 'frame')} not solved, the first is step {failed[0]}: {first}"

    @property
    def contradiction(self) -> str:
        """A sentence where the readings are far beyond what load, inputs and their noise explain; else empty."""
        data = self.estimation.data
        solved = zip(data.step_ids, self.frames, strict=False)
        misfits = {n: frame.misfit for n, frame in solved if not frame.message}
        read, squares = sum(r.step in misfits for r in data.readings), sum(misfits.values())
        if squares <= CONTRADICTED * read:
            return ""
        return (
            f"the readings are {math.sqrt(squares / read):.2g} times as far from what is expected as their standard "
            "deviations: axes, signs or units may be wrong, or sigma of load, inputs or readings is too small; most in "
            f"step {max(misfits, key=misfits.__getitem__)}"
        )


def read_estimation(folder: str | os.PathLike[str]) -> Estimation:
    """Read a folder of measured data, as for `identify`, with times and an ``estimate.toml``.

    Raises
    ------
    InputError
        With every mistake in the files.
    """
    folder = Path(folder)
    path = folder / "estimate.toml"
    # Where the path is no folder, one mistake says so; those of missing files would repeat it.
    data, top = read_all(lambda: read_measured(folder), lambda: folder.is_dir() and _read_priors(path))
    inputs, reporter, names = top["inputs"], Reporter(str(path)), data.robot.tendon_names
    sigma, identified = read_sigma(top["uncertain"], data, reporter), ParameterPrior()
    if top["identified"]:
        friction, identified = read_identified(folder / top["identified"], data, reporter)
        data = replace(data, model=replace(data.model, friction=friction or data.model.friction))
    untimed = [n for n, step in zip(data.step_ids, data.steps, strict=True) if step.time is None]
    unknown = [r.line for r in data.readings if r.sigma is None]
    for name, key, found, needed in (
        ("loading.csv", "time", untimed, "the time of every step [s]; it is missing in step"),
        ("observations.csv", "sigma", unknown, "every standard deviation; it is missing in line"),
    ):
        if found:
            text = f"estimation needs {needed} {found[0]}"
            reporter.problems.append(Problem(str(folder / name), key, "", text))
    if not (inputs or data.input_sigma):
        reporter("inputs", "", "missing; must be a table [inputs] with sigma")
    reporter.refuse()
    try:
        # Errors are counted in the units in which the steps were read. Those of model.toml are so already; they are
        # independent from step to step.
        own = (inputs.sigmas(names) * data.input_scales).tolist() if inputs else data.input_sigma
        prior = inputs or InputPrior(sigma=1.0, correlation_time=0.0)
        inputs = replace(prior, sigma=dict(zip(names, own, strict=True)))
        numbers = prior_of_robot(identified, data, sigma)
        estimation = Estimation(data, top["load"], inputs, identified.effects, numbers)
        with warnings_to():
            _ = estimation.estimator
    except FieldError as error:
        of_model = error.field.startswith("model.")
        raise refusal(
            path.with_name("model.toml") if of_model else path, error.allowed, error.field, error.value
        ) from error
    return estimation


def _read_priors(path: Path) -> dict[str, Any]:
    """Contents of ``estimate.toml``."""
    if not path.exists():
        raise refusal(path, f"no such file; {_LEAST}")
    reporter = Reporter(str(path))
    top, _ = TOP.read(read_toml(path)[0], "", reporter)
    reporter.refuse()
    return top


#: Keys of the priors, by those of the load steps in which they are judged.
_JUDGED = {
    r"steps\[0\]\.loads\.expected\.force": "estimate.toml: load.sigma",
    r"steps\[0\]\.loads\.expected\.moment": "estimate.toml: load.sigma_moment",
    r"steps\[0\]\.(?!loads)[.\w]+": "estimate.toml: inputs.sigma",
}


def _checks(estimation: Estimation) -> Findings:
    """`first_checks`, and of standard deviations of load and inputs beyond what the robot can carry."""
    data, prior, names = estimation.data, estimation.load, estimation.data.robot.tendon_names
    errors = dict(zip(names, estimation.inputs.sigmas(names), strict=True))
    found = first_checks(replace(data, input_sigma=tuple(errors.values())), "estimate.toml")
    drives: dict[str, Any] = {d.inputs: {n: errors[n] for n in given} for d, given in data.steps[0].inputs()}
    load = Load(data.robot.backbone.length, (prior.sigma, 0.0, 0.0), (prior.sigma_moment, 0.0, 0.0))
    for step in (LoadStep(loads={"expected": load}), LoadStep(**drives)):
        texts = plausibility(data.robot, data.model, [step]).warnings  # also of the robot
        for key, own in _JUDGED.items():
            judged = [own + re.sub(rf"^{key}| \(also .*", "", x) for x in texts if re.match(key, x)]
            found.warnings.extend(judged)
    return found


def run_estimation(
    estimation: Estimation, progress: Callable[[Estimate], object] | None = None
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
    data, experiment = estimation.data, estimation.experiment
    # The path within a frame is not resolved, so that a frame is not divided where backlash ends.
    steps = [experiment.steps[j] for j in experiment.whole_steps]
    _checks(estimation).issued()
    by_step: dict[int, list[Reading]] = {n: [] for n in data.step_ids}
    for reading in data.readings:
        by_step[reading.step].append(reading)
    estimator = estimation.estimator
    frames: list[Estimate] = []
    pending: list[Estimate] = []  # of which not all later readings are known
    done: list[Estimate] = []
    interrupted = False
    try:
        for number, step in zip(data.step_ids, steps, strict=True):
            pending.append(estimator.step(step, by_step[number]))
            frames.append(replace(pending[-1], passage=None))
            if len(pending) == 2 * WINDOW:
                done += smoothed(pending)[:WINDOW]
                del pending[:WINDOW]
            if progress is not None:
                progress(frames[-1])
    except KeyboardInterrupt:
        interrupted = True
    result = EstimateResult(estimation, tuple(frames), (*done, *smoothed(pending)), interrupted)
    issue(filter(None, [result.contradiction]))
    return result

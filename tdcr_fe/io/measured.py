"""Measured data: read and check a folder of robot, loading sequence and readings."""

from __future__ import annotations

import itertools
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, is_dataclass, replace
from pathlib import Path
from typing import Any

import pandas as pd

from tdcr_fe.effects import Experiment, Observation, changed_by, with_effects
from tdcr_fe.elements.drives import DRIVES
from tdcr_fe.io.files import InputError, Problem, Reporter, StrPath, refusal
from tdcr_fe.io.readings import BadRow, Reading, read_observations, read_rows
from tdcr_fe.io.tables import Loading, read_loading, read_table
from tdcr_fe.io.toml import digest, read_model_tables, read_robot
from tdcr_fe.io.user_effects import apply_effects
from tdcr_fe.model.checks import size_contradictions
from tdcr_fe.model.loading import LoadStep, Model, SolverSettings, in_newtons_and_metres
from tdcr_fe.model.plausibility import Findings, plausibility
from tdcr_fe.model.robot import Robot, by_tendon
from tdcr_fe.model.schema import FieldError

#: Files of a folder of measured data; the second one may be missing.
FILES = ("robot.toml", "model.toml", "loading.csv", "observations.csv")


@dataclass(frozen=True)
class MeasuredData:
    """A declared robot, its loading sequence, and the readings.

    Attributes
    ----------
    name : str
    robot : Robot
    model : Model
    step_ids : tuple of int
        Number of every load step, in order.
    steps : tuple of LoadStep
        The loading sequence.
    branches : tuple of str
        The ``branch`` of every step; empty texts where the file has none.
    readings : tuple of Reading
        Sound readings.
    left_out : tuple of BadRow
        Readings that are not sound.
    digests : mapping of str to str
        SHA-256 of the files, by name.
    settings : SolverSettings
        The ``[solver]`` table of ``model.toml``.
    parts : tuple of (str, int)
        Parts of data sets joined by `join_measured`: the name of each, and its number of steps.
    effects : mapping
        Declared effects on commands and on the measurement, by effect and parameter: the table ``[effects]`` of
        ``model.toml``. Those on robot and model are in ``robot`` and ``model`` already.
    input_sigma : tuple of float
        Standard deviations of the errors of the inputs, by tendon [N or m]: the table ``[inputs]`` of ``model.toml``;
        empty where it has none.
    input_scales : tuple of float
        From the inputs of the files to those of ``steps``, by tendon: where the angles of its motor were given, the
        radius of its spool [m], else 1.
    """

    name: str
    robot: Robot
    model: Model
    step_ids: tuple[int, ...]
    steps: tuple[LoadStep, ...]
    branches: tuple[str, ...]
    readings: tuple[Reading, ...]
    left_out: tuple[BadRow, ...] = ()
    digests: Mapping[str, str] | None = None
    settings: SolverSettings = field(default_factory=SolverSettings)
    parts: tuple[tuple[str, int], ...] = ()
    effects: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    input_sigma: tuple[float, ...] = ()
    input_scales: tuple[float, ...] = field(default=(), compare=False)

    def __post_init__(self) -> None:
        if not len(self.step_ids) == len(self.steps) == len(self.branches):
            raise ValueError("step_ids, steps and branches must have one entry per step")
        unknown = sorted({r.step for r in self.readings} - set(self.step_ids))
        if unknown:
            raise ValueError(f"a reading names step {unknown[0]}, which is not in the loading sequence")

    @property
    def restarts(self) -> tuple[int, ...]:
        """Positions of the steps at which the robot begins anew, unloaded."""
        return tuple(itertools.accumulate(count for _, count in self.parts[:-1]))

    @property
    def observation(self) -> Observation:
        """Markers where positions were read."""
        at = {float(r.location or 0.0) for r in self.readings if r.channel.family == "position"}
        return Observation(markers=tuple(sorted(at)))

    @property
    def experiment(self) -> Experiment:
        """The declared experiment: what arrives of the commands, and how the robot is observed."""
        plain = Experiment(self.robot, self.model, self.steps, self.observation, restarts=self.restarts)
        return plain.with_sequences(lambda own: with_effects(own, self.effects)) if self.effects else plain

    @property
    def driven_by_displacement(self) -> bool:
        """Whether any tendon is driven by displacement."""
        return any(s.displacements for s in self.steps)


# ------------------------------------------------------------------------------------------------- reading


def read_measured(folder: StrPath) -> MeasuredData:
    """Read a folder of measured data.

    Parameters
    ----------
    folder
        Contains ``robot.toml``, ``loading.csv``, ``observations.csv`` and, optionally, ``model.toml``.

    Returns
    -------
    MeasuredData
        With every reading that was left out in ``left_out``.

    Raises
    ------
    InputError
        A file or column is missing, a load step is not sound (its history would be lost), no reading is sound, or
        so many had to be left out that the rest cannot be trusted.
    """
    folder = Path(folder)
    if not folder.is_dir():
        what = "is a file" if folder.exists() else "no such folder"
        raise refusal(folder, f"{what}; must be a folder with robot.toml, loading.csv, observations.csv")
    files = of_robot, of_model, of_loading, observed = [folder / name for name in FILES]
    found = Reporter(str(folder))
    robot = found.sound(lambda: read_robot(of_robot))
    declared = found.sound(lambda: read_model_tables(of_model if of_model.exists() else None, robot))
    table, rows = found.sound(lambda: read_table(of_loading)), found.sound(lambda: read_rows(observed))
    found.refuse()
    model, settings = declared["model"], declared["solver"]
    loading, scales = _read_steps(table, robot, model, str(of_loading))
    readings, bad = read_observations(rows, robot, set(loading.step_ids), str(observed))
    digests = {path.name: digest(path) for path in files if path.exists()}
    reporter, inputs, sigmas = Reporter(str(of_model)), declared["inputs"], tuple[float, ...]()
    try:
        if inputs:
            sigmas = tuple((by_tendon("inputs.sigma", inputs.sigma, robot.tendon_names) * scales).tolist())
    except FieldError as error:
        reporter(error.field, error.value, error.allowed)
    read = tuple(readings), tuple(bad), digests
    of_inputs: dict[str, Any] = {"input_sigma": sigmas, "input_scales": scales}
    data = MeasuredData(folder.resolve().name, robot, model, *loading, *read, settings, **of_inputs)
    if declared["effects"]:
        data = _with_declared_effects(data, declared["effects"], reporter)
    reporter.refuse()
    return data


def _read_steps(
    table: pd.DataFrame, robot: Robot, model: Model, file: str
) -> tuple[Loading, tuple[float, ...]]:
    """The loading sequence, refused where the results would not fit into memory; and `MeasuredData.input_scales`."""
    loading, reporter = read_loading(table, robot, file), Reporter(file)
    reporter.contradictions(size_contradictions(robot, model, len(loading.steps)))
    reporter.refuse()
    drives = {n: drive for step in loading.steps for drive, given in step.inputs() for n in given}
    scales = tuple(drives[t.name].scale(t) if t.name in drives else 1.0 for t in robot.tendons)
    return loading._replace(steps=in_newtons_and_metres(robot, loading.steps)), scales


def _with_declared_effects(data: MeasuredData, table: object, reporter: Reporter) -> MeasuredData:
    """Data with the table ``[effects]`` of ``model.toml``."""
    declared = data.experiment
    sound, changed = apply_effects(table, declared, reporter)
    if reporter.problems:
        return data
    # What is left for the commands and the measurement once robot and model are as declared.
    beside, by_effect = {"steps", "ends", "observation"}, changed_by(declared, sound)
    rest = {name: values for name, values in sound.items() if beside & by_effect[name]}
    return replace(data, robot=changed.robot, model=changed.model, effects=rest)


def without_unread_steps(data: MeasuredData) -> MeasuredData:
    """The data without the steps after the last one with readings: they change no prediction."""
    read = {r.step for r in data.readings}
    kept = slice(1 + max(k for k, n in enumerate(data.step_ids) if n in read))
    if kept.stop == len(data.step_ids) or data.parts:
        return data
    return replace(data, step_ids=data.step_ids[kept], steps=data.steps[kept], branches=data.branches[kept])


def join_measured(sets: Sequence[MeasuredData]) -> MeasuredData:
    """Several data sets of one robot as one, each of which begins with the unloaded robot.

    Steps are numbered anew from 1; branches are named ``SET/BRANCH``, so that ``--hold-out "SET/*"`` holds out a set.

    Parameters
    ----------
    sets
        With the same declared robot, model, effects and solver settings, and different names.

    Raises
    ------
    InputError
        They differ; the message names what.
    """
    if len(sets) == 1:
        return sets[0]
    first, names, problems = sets[0], [s.name for s in sets], []
    others = "several folders are of one robot with one model, and with --robots of several of one design"
    allowed = f"must be as in {first.name}; {others}"
    for other in sets[1:]:
        for what in ("robot", "model", "settings", "effects", "input_sigma"):
            a, b = getattr(first, what), getattr(other, what)
            if a != b:
                parts = [f.name for f in fields(a)] if is_dataclass(a) else []
                differing = [name for name in parts if getattr(a, name) != getattr(b, name)]
                problems.append(Problem(other.name, what, f"another {', '.join(differing)}", allowed))
    for name in [n for n in names if names.count(n) > 1][:1]:
        problems.append(Problem(name, "", "", "two folders have this name; they must differ"))
    if problems:
        raise InputError(problems)
    trimmed = [without_unread_steps(s) for s in sets]
    steps = tuple(step for s in trimmed for step in s.steps)
    readings: list[Reading] = []
    before = 0
    for s in trimmed:
        number = {n: before + k + 1 for k, n in enumerate(s.step_ids)}
        readings += [replace(r, step=number[r.step]) for r in s.readings]
        before += len(s.steps)
    return replace(
        first,
        name=" + ".join(names),
        step_ids=tuple(range(1, len(steps) + 1)),
        steps=steps,
        branches=tuple(f"{s.name}/{b}" for s in trimmed for b in s.branches),
        readings=tuple(readings),
        left_out=tuple(replace(b, file=f"{s.name}/{b.file}") for s in sets for b in s.left_out),
        digests={f"{s.name}/{n}": d for s in sets for n, d in (s.digests or {}).items()},
        parts=tuple((s.name, len(s.steps)) for s in trimmed),
    )


# ------------------------------------------------------------------------------------- checks before solving

#: A marker is elsewhere where it is read farther from the base than its arc length by this share of the length [1].
ELSEWHERE = 0.25


def first_checks(data: MeasuredData, of_inputs: str = "model.toml") -> Findings:
    """Warnings and remarks on a data set.

    ``of_inputs``: the file that has the standard deviations of the inputs.

    Raises
    ------
    InputError
        A load is far beyond what the robot can carry.
    """
    try:
        found = plausibility(data.robot, data.model, data.steps)
    except ValueError as error:
        raise InputError([Problem(data.name, "", "", with_columns(str(error), data))]) from error
    found.warnings.extend([impossible_place(data), large_sigma(data, of_inputs)])
    return Findings(*([with_columns(x, data) for x in texts if x] for texts in found))


def large_sigma(data: MeasuredData, file: str) -> str:
    """Standard deviations of inputs that are larger than all inputs of their unit, as a sentence."""
    of = dict(zip(data.robot.tendon_names, data.input_sigma, strict=False))
    for drive in DRIVES:
        given = [x for step in data.steps for x in getattr(step, drive.inputs).items()]
        largest = max((abs(value) for _, value in given), default=0.0)
        sigma = max((of.get(name, 0.0) for name, _ in given), default=0.0)
        if 0.0 < largest < sigma:
            text = f"larger than every {drive.label}; the largest is {largest:g} {drive.unit}"
            return f"{file}: inputs.sigma = {sigma:g}: {text}"
    return ""


def with_columns(text: str, data: MeasuredData) -> str:
    """A sentence with the columns of loading.csv in place of keys of a scenario."""

    def column(found: re.Match[str]) -> str:
        name = re.sub(r"^loads\.\w+\.", "", found[2])
        for drive in DRIVES:
            name = name.replace(f"{drive.inputs}.", f"{drive.name}_")
        return f"loading.csv, step {data.step_ids[int(found[1])]}: {name}"

    return re.sub(r"steps\[(\d+)\]\.([\w.]+)", column, text)


def impossible_place(data: MeasuredData) -> str:
    """A marker that most readings place farther from the base than the backbone is long up to it, as a sentence."""
    rows = [(r.location, r.step, r.value**2) for r in data.readings if r.channel.family == "position"]
    squares = pd.DataFrame(rows, columns=["s", "step", "square"]).groupby(["s", "step"])["square"].sum()
    usual = squares.groupby("s").median() ** 0.5
    for s, far in zip(usual.index.to_numpy(dtype=float), usual.to_numpy(dtype=float), strict=True):
        if far > s + ELSEWHERE * data.robot.backbone.length:
            return (
                f"the marker at s = {s:g} m is read {far:.4g} m from the base, farther than the backbone reaches up to "
                f"there: it must be at s = {far:.3g} m or beyond"
            )
    return ""

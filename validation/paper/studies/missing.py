"""Identification on every table of the paper: what the declared robots lack, before and after."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from tdcr_fe.identify import identify
from tdcr_fe.identify.identification import NotSolved
from tdcr_fe.identify.load_steps import choose_held_out
from tdcr_fe.identify.result import IdentificationResult
from tdcr_fe.identify.settings import IdentifySettings
from tdcr_fe.io.measured import MeasuredData
from tdcr_fe.io.readings import Reading
from tdcr_fe.model.results import StepResult
from tdcr_fe.model.robot import Robot
from tdcr_fe.solve.simulate import simulate
from tdcr_fe.validation.paper.studies.comparison import Deviation, summarise
from tdcr_fe.validation.paper.studies.datasets import TableData, table_dataset
from tdcr_fe.validation.paper.tables import STIFFNESS_FACTOR, paper_table

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Stage:
    """One model of a table.

    Attributes
    ----------
    name : str
        "as declared", "one stiffness", or the effects that were added.
    predicted : ndarray, shape (n,)
        Of every reading, in its unit.
    fitted, held_out : Deviation
        Deviations on the fitted and on the held-out rows.
    """

    name: str
    predicted: Array
    fitted: Deviation
    held_out: Deviation


@dataclass(frozen=True)
class MissingStudy:
    """Identification of one table.

    Attributes
    ----------
    table : TableData
    stiffness_factor : float or None
        Factor on the declared bending and torsional stiffness at the start; None if it started from the declared
        robot.
    stages : tuple of Stage
        As declared; with that stiffness; with the effects added.
    held_out_rows : tuple of int
    max_effects : int
        Largest number of effects allowed.
    result : IdentificationResult or None
        None if the identification could not begin.
    failure : str
        Why.
    """

    table: TableData
    stiffness_factor: float | None
    stages: tuple[Stage, ...]
    held_out_rows: tuple[int, ...]
    max_effects: int
    result: IdentificationResult | None
    failure: str = ""


def predicted(readings: Sequence[Reading], data: MeasuredData, robot: Robot) -> Array:
    """Predictions of a robot for readings of angles, offsets and positions; nan where there is no solution."""
    result = simulate(robot, data.model, data.steps)
    steps = dict(zip(data.step_ids, result.steps, strict=False))

    def value(r: Reading) -> float:
        step: StepResult | None = steps.get(r.step)
        if step is None:
            return float("nan")
        if isinstance(r.location, float):
            return float(step.position_at(r.location)["xyz".index(r.quantity[-1])])
        return float(step.chord_angle if r.quantity == "chord_angle" else step.tip_offset)

    return np.array([value(r) for r in readings])


def left_over(data: MeasuredData, residual: Array, which: NDArray[np.bool_]) -> Deviation:
    """Summarise residuals of some readings."""
    used = which & np.isfinite(residual)
    angle = np.array([r.unit == "rad" for r in data.readings])
    offsets, angles = np.abs(residual[used & ~angle]), np.abs(residual[used & angle])
    return summarise(offsets, angles, offsets / data.robot.backbone.length)


def scaled(robot: Robot, factor: float) -> Robot:
    """A robot with its bending and torsional stiffness times a factor."""
    rod = robot.backbone
    return robot.with_backbone(bending_stiffness=factor * rod.EI, torsional_stiffness=factor * rod.GJ)


def first_stiffness(table: TableData) -> float | None:
    """Factor on the declared stiffness at the start of the identification; None where the declared one suffices.

    Where the tensions require more than `STIFFNESS_FACTOR` times the declared stiffness, the declared robot bends
    several times too far, up to folding over, and sensitivities there are not informative. Then one factor is fitted
    to the angles of the rows that are not held out.
    """
    data = table.data
    asked = paper_table(table.number)["stiffness_from_tension_Nm2"].to_numpy()
    start = float(np.median(asked) / data.robot.backbone.EI)
    if 1.0 / STIFFNESS_FACTOR < start < STIFFNESS_FACTOR:
        return None
    held = {data.step_ids[k] for k in choose_held_out(data)}
    readings = [r for r in data.readings if r.unit == "rad" and r.step not in held]
    measured = np.array([r.value for r in readings])

    def misfit(x: Array) -> Array:
        found = predicted(readings, data, scaled(data.robot, float(np.exp(x[0]))))
        return np.where(np.isfinite(found), found - measured, 1.0)

    best = least_squares(
        misfit,
        [np.log(start)],
        bounds=([np.log(start) - 2.5], [np.log(start) + 2.5]),
        diff_step=[1e-3],
        xtol=1e-4,
    )
    return float(np.exp(best.x[0]))


def study_missing(name: str) -> MissingStudy:
    """Run the identification on one data set of `tdcr_fe.validation.paper.studies.datasets`.

    Parameters
    ----------
    name
        One of `tdcr_fe.validation.paper.studies.datasets.DATASETS`.
    """
    table = table_dataset(name)
    data = table.data
    held_ids = {data.step_ids[k] for k in choose_held_out(data)}
    held = np.array([r.step in held_ids for r in data.readings])
    held_rows = tuple(sorted({table.row(r.step) for r in data.readings if r.step in held_ids}))
    measured = np.array([r.value for r in data.readings])

    def stage(text: str, residual: Array) -> Stage:
        return Stage(
            text, measured - residual, left_over(data, residual, ~held), left_over(data, residual, held)
        )

    stages = [stage("as declared", measured - predicted(data.readings, data, data.robot))]
    factor = first_stiffness(table)
    if factor is not None:
        data = replace(data, robot=scaled(data.robot, factor))
        stages.append(stage("one stiffness", measured - predicted(data.readings, data, data.robot)))
    # At least two rows for each effect: with fewer nothing could contradict it.
    most = max(1, (len(table.rows) - len(held_rows)) // 2)
    try:
        result = identify(data, IdentifySettings(max_effects=most))
    except NotSolved as problem:
        return MissingStudy(table, factor, tuple(stages), held_rows, most, None, str(problem))
    if result.effects:
        stages.append(stage(" + ".join(e.name for e in result.effects), result.residual_after))
    return MissingStudy(table, factor, tuple(stages), held_rows, most, result)


def tried(study: MissingStudy) -> list[tuple[str, float, float | None]]:
    """Effects fitted in the first round, best first: misfit over that before, fitted and held out."""
    result = study.result
    if result is None:
        return []
    fit, held = result.before_fit.chi2_per_dof, result.before_held_out.chi2_per_dof
    found = [
        (c.name, c.chi2_fit / fit, None if c.chi2_held_out is None else c.chi2_held_out / held)
        for c in result.candidates
        if c.round == 1 and c.chi2_fit is not None
    ]
    return sorted(found, key=lambda x: x[1] + (x[2] or 0.0))


def remarks(study: MissingStudy) -> list[str]:
    """Summary of a study, in sentences."""
    sentences: list[str] = []
    rows = len(study.table.rows)
    if study.stiffness_factor is not None:
        sentences.append(
            f"Identification begins with {study.stiffness_factor:.2f} times the declared stiffness, fitted to the "
            "rows that are not held out: the tensions require more than three times the declared stiffness, and "
            "bend the declared robot several times too far."
        )
    if not study.held_out_rows:
        sentences.append(f"{rows} rows are too few to hold one out: added effects are not tested.")
    elif len(study.held_out_rows) == 1:
        sentences.append(
            f"Held out is row {study.held_out_rows[0]}, the highest tension: one row is a weak test."
        )
    else:
        listed = ", ".join(str(k) for k in study.held_out_rows)
        sentences.append(f"Held out are rows {listed}.")
    result = study.result
    if result is None:
        return [*sentences, f"Identification could not begin: {study.failure}."]
    if result.effects:
        free = len(result.parameter_names)
        sentences.append(
            f"{free} number{'s' if free > 1 else ''} fitted to {rows - len(study.held_out_rows)} rows: the result "
            "changes the curve in the right direction, which does not prove that the cause is right."
        )
        for e in result.effects:
            if e.indistinguishable_from:
                sentences.append(
                    f"{e.name} is indistinguishable on these data from {', '.join(e.indistinguishable_from)}."
                )
    else:
        best = tried(study)[:3]
        sentences.append(
            "Nothing is added: no effect on the list improves the fitted and the held-out rows both."
        )
        if best:
            listed = ", ".join(
                f"{n} ({a:.2f}" + ("" if b is None else f" and {b:.2f}") + ")" for n, a, b in best
            )
            sentences.append(
                f"Nearest, with the misfit left over that before, fitted and held out: {listed}."
            )
    return sentences

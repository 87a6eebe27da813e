"""Compute the contents of the report on the paper, part by part."""

from __future__ import annotations

import copy
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, fields, replace

import pandas as pd

from tdcr_fe.model.loading import LoadStep
from tdcr_fe.model.results import StepResult
from tdcr_fe.model.routing import ParallelRouting
from tdcr_fe.solve.simulate import simulate
from tdcr_fe.validation.paper.cases import CASE_IDS, MODELS, paper_case, prototype
from tdcr_fe.validation.paper.studies import helical
from tdcr_fe.validation.paper.studies.comparison import Deviation, fit_table, load_direction_study
from tdcr_fe.validation.paper.studies.critical import CriticalSearch
from tdcr_fe.validation.paper.studies.datasets import DATASETS
from tdcr_fe.validation.paper.studies.figures import CaseStudy, run_model
from tdcr_fe.validation.paper.studies.limitations import (
    DynamicRun,
    Influence,
    PressureDependence,
    adhesion,
    disk_thickness,
    dynamic_run,
    pressure_dependent_friction,
)
from tdcr_fe.validation.paper.studies.missing import MissingStudy, study_missing
from tdcr_fe.validation.paper.studies.signs import SignStep, sign_steps, three_tendon_robot, trial_signs
from tdcr_fe.validation.paper.studies.stiffness_study import StiffnessStudy, study_stiffness
from tdcr_fe.validation.paper.studies.table_study import TableStudy, study_table, unloaded_deviation
from tdcr_fe.validation.paper.tables import TABLES

Progress = Callable[[str], None]


@dataclass
class PaperRun:
    """All results; `tdcr_fe.validation.paper.claims.verdicts` evaluates them.

    ``interrupted`` names the part in which the user stopped the run; it is empty where everything was done.
    """

    cases: dict[str, CaseStudy] = field(default_factory=dict)
    tables: dict[int, TableStudy] = field(default_factory=dict)
    printed_offset: Deviation | None = None
    simulation_rod: Deviation | None = None
    directions: pd.DataFrame | None = None
    searches: helical.Searches = field(default_factory=dict)
    prototype_searches: helical.Searches = field(default_factory=dict)
    column: CriticalSearch | None = None
    thickness: list[Influence] = field(default_factory=list)
    friction: list[Influence] = field(default_factory=list)
    dynamics: list[DynamicRun] = field(default_factory=list)
    signs: list[SignStep] = field(default_factory=list)
    signs_own: tuple[StepResult, ...] = ()
    stiffness: StiffnessStudy | None = None
    missing: dict[str, MissingStudy] = field(default_factory=dict)
    seconds: dict[str, float] = field(default_factory=dict)
    interrupted: str = ""


#: Parts of the run, in order.
PARTS = ("figures", "tables", "critical loads", "signs", "stiffness", "limitations", "effects")


def run_paper(
    parts: Sequence[str] = PARTS,
    progress: Progress | None = None,
    interrupted: Callable[[], bool] | None = None,
) -> PaperRun:
    """Compute what the report shows.

    Parameters
    ----------
    parts
        Some of `PARTS`; "effects" runs `tdcr_fe.identify` on every table.
    progress
        Called with every task that was finished.
    interrupted
        Whether an interruption was requested. A simulation that is interrupted ends early without an exception, so
        this is checked after every task.

    Returns
    -------
    PaperRun
        Where the user interrupts, with the finished parts (perhaps none) and the finished tables of the
        identification; ``interrupted`` then names the unfinished part.
    """
    run = PaperRun()
    functions: dict[str, Callable[[PaperRun, Progress], None]] = {
        "figures": _figures,
        "tables": _tables,
        "critical loads": _critical,
        "signs": _signs,
        "stiffness": _stiffness,
        "limitations": _limitations,
        "effects": _effects,
    }

    def report(text: str) -> None:
        if interrupted is not None and interrupted():
            raise KeyboardInterrupt
        if progress is not None:
            progress(text)

    for name in parts:
        begun = time.perf_counter()
        before = replace(run, **{f.name: copy.copy(getattr(run, f.name)) for f in fields(run)})
        try:
            functions[name](run, report)
        except (KeyboardInterrupt, Exception) as stop:
            # an interrupted simulation has fewer steps than the part expects, which ends it by an error
            if not isinstance(stop, KeyboardInterrupt) and not (interrupted is not None and interrupted()):
                raise
            if name != "effects":
                run = before
            run.interrupted = name
            break
        run.seconds[name] = time.perf_counter() - begun
    return run


def tasks(parts: Sequence[str] = PARTS) -> int:
    """How many times `run_paper` calls its progress function."""
    counts = {
        "figures": len(CASE_IDS) * len(MODELS),
        "tables": len(TABLES) + 1,
        "critical loads": len(helical.SEARCH_TENSIONS) + 3,
        "signs": 1,
        "stiffness": 1,
        "limitations": 5,
        "effects": len(DATASETS),
    }
    return sum(counts[p] for p in parts)


def _figures(run: PaperRun, report: Progress) -> None:
    for name in CASE_IDS:
        case = paper_case(name)
        runs = {}
        for key, model in MODELS.items():
            runs[key] = run_model(case, model, reference=key == "discrete")
            report(f"{name}, {key}")
        run.cases[name] = CaseStudy(case, runs)


def _tables(run: PaperRun, report: Progress) -> None:
    for number in TABLES:
        run.tables[number] = study_table(number)
        report(f"Table {number}")
    declared = prototype(1)
    printed = declared.with_tendons(declared.tendon_names, routing=ParallelRouting(0.43e-3))
    run.printed_offset = unloaded_deviation(printed)
    run.simulation_rod = unloaded_deviation(declared.with_backbone(radius=0.4e-3))
    run.directions = load_direction_study(run.tables[1].fits["stiffness"].robot)
    report("Table 1, directions of its load")


def _critical(run: PaperRun, report: Progress) -> None:
    run.searches |= helical.search_without_friction(report)
    run.searches |= helical.search_with_friction()
    report("helical, with friction")
    fit = run.tables[3].fits["stiffness"] if run.tables else fit_table(3)
    run.prototype_searches |= helical.search_prototype(helical.declared_and_fitted(fit.robot))
    report("helical, the prototype")
    run.column = helical.search_column()
    report("column")


def _signs(run: PaperRun, report: Progress) -> None:
    robot, steps = three_tendon_robot(), sign_steps()
    run.signs = trial_signs(robot, steps, try_all=True)
    run.signs_own = simulate(robot, MODELS["per-tendon"], steps).steps
    report("signs of Fig. 2")


def _stiffness(run: PaperRun, report: Progress) -> None:
    run.stiffness = study_stiffness()
    report("stiffness from loads")


def _limitations(run: PaperRun, report: Progress) -> None:
    robot = paper_case("fig3").robot
    pull = LoadStep("pull", {robot.tendon_names[0]: 1.5})
    run.thickness = disk_thickness(robot, [pull], (1e-3, 2e-3, 3e-3, 5e-3))
    report("disk thickness")
    run.friction = adhesion(robot, [pull], (5e-3, 20e-3, 50e-3))
    run.friction.append(pressure_dependent_friction(robot, pull, PressureDependence()))
    run.friction.append(pressure_dependent_friction(robot, pull, PressureDependence(reference=0.4)))
    report("nonlinear friction")
    for ramp in (0.3, 1.0, 3.0):
        run.dynamics.append(dynamic_run(robot, 1.5, ramp))
        report(f"dynamics, {ramp:g} s")


def _effects(run: PaperRun, report: Progress) -> None:
    for name in DATASETS:
        study = study_missing(name)
        if study.result is not None and study.result.interrupted:
            raise KeyboardInterrupt
        run.missing[name] = study
        report(f"what is missing, {name}")

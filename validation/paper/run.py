"""Compute the contents of the report on the paper: figures, tables, algorithm, identification, limitations."""

from __future__ import annotations

import copy
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, fields, replace

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from tdcr_fe.model.loading import Load, LoadStep, Model, resolve
from tdcr_fe.model.results import StepResult
from tdcr_fe.model.robot import Robot, Tendon
from tdcr_fe.model.routing import ParallelRouting
from tdcr_fe.solve.simulate import Simulation, simulate
from tdcr_fe.solve.stability import Stability, stability
from tdcr_fe.solve.stepping import StepFailed
from tdcr_fe.validation.paper.cases import CASE_IDS, MODELS, PaperCase, paper_case, prototype
from tdcr_fe.validation.paper.comparison import (
    Deviation,
    Reading,
    TableFit,
    compare_table,
    deviation,
    fit_table,
    load_direction_study,
)
from tdcr_fe.validation.paper.critical import CriticalSearch, search_critical_load
from tdcr_fe.validation.paper.datasets import DATASETS
from tdcr_fe.validation.paper.limitations import (
    DynamicRun,
    Influence,
    PressureDependence,
    adhesion,
    disk_thickness,
    dynamic_run,
    pressure_dependent_friction,
)
from tdcr_fe.validation.paper.missing import MissingStudy, study_missing
from tdcr_fe.validation.paper.signs import SignStep, trial_signs
from tdcr_fe.validation.paper.stiffness import (
    IdentifiedStiffness,
    identify_stiffness,
    validation_error,
    with_identified_stiffness,
)
from tdcr_fe.validation.paper.tables import TABLES, paper_table
from tdcr_fe.validation.reference.sequence import solve_reference

Array = NDArray[np.float64]
Progress = Callable[[str], None]

#: Loads of the search for a critical load in the helical case [N]; twice the paper's own.
SEARCH_LOADS = (0.01, 0.02, 0.04, 0.06, 0.08, 0.1, 0.15, 0.2, 0.3, 0.4, 0.6, 0.8, 1.2, 1.6)
#: Tensions of that search [N]; the simulation has 1.2 N, the prototype 5 to 30 N.
SEARCH_TENSIONS = (1.2, 5.0, 10.0, 20.0, 30.0)
#: Directions of that search.
SEARCH_DIRECTIONS = {"+x": (1, 0, 0), "+y": (0, 1, 0), "-x": (-1, 0, 0), "-y": (0, -1, 0), "-z": (0, 0, -1)}


@dataclass(frozen=True)
class ModelRun:
    """One case with one model.

    Attributes
    ----------
    steps : tuple of StepResult
    stabilities : tuple of Stability
        One a step.
    failure : str
        Empty where all steps converged.
    reference_gap : float
        Distance of the tip at the last step from that of the independent reference [m]; nan where it was not computed.
    """

    steps: tuple[StepResult, ...]
    stabilities: tuple[Stability, ...]
    failure: str
    reference_gap: float = float("nan")

    @property
    def snapped(self) -> tuple[str, ...]:
        """Labels of steps in which the robot jumped to another equilibrium."""
        return tuple(s.label for s in self.steps if s.details.get("snapped"))

    def at(self, label: str) -> StepResult:
        """The step of that label."""
        return next(s for s in self.steps if s.label == label)


@dataclass(frozen=True)
class CaseStudy:
    """A figure with every model."""

    case: PaperCase
    runs: dict[str, ModelRun]


@dataclass(frozen=True)
class TableStudy:
    """A table beside the models.

    Attributes
    ----------
    number : int
    table : DataFrame
        Of `paper_table`.
    readings : dict
        By model: "declared", "stiffness" (one EI fitted), "dead band" (EI and a dead band fitted; not Table 2).
    deviations : dict
        By model, with parts "all", "without load", "with load", "consistent rows".
    fits : dict of str to TableFit
    """

    number: int
    table: pd.DataFrame
    readings: dict[str, list[Reading]]
    deviations: dict[str, dict[str, Deviation]]
    fits: dict[str, TableFit]


@dataclass(frozen=True)
class StiffnessStudy:
    """Section 3.4 on synthetic experiments: displacements of the reference with the paper's measurement error.

    Attributes
    ----------
    true_stiffness, declared_stiffness, found_stiffness : float
        EI [N m^2].
    identified : IdentifiedStiffness
    new_load_error : float
        Of the predicted displacement under a load that was not used [1].
    shape_error, shape_error_declared : float
        Distance of the tip at 1.5 N of tension between the robot identified, the robot declared, and the true
        one [m].
    large_load_factor : float
        EI found over true where the loads bend the robot far (0.02 to 0.05 N) [1].
    """

    true_stiffness: float
    declared_stiffness: float
    found_stiffness: float
    identified: IdentifiedStiffness
    new_load_error: float
    shape_error: float
    shape_error_declared: float
    large_load_factor: float


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
    searches: dict[tuple[float, str, str], CriticalSearch] = field(default_factory=dict)
    prototype_searches: dict[tuple[float, str, str], CriticalSearch] = field(default_factory=dict)
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
        "critical loads": len(SEARCH_TENSIONS) + 3,
        "signs": 1,
        "stiffness": 1,
        "limitations": 5,
        "effects": len(DATASETS),
    }
    return sum(counts[p] for p in parts)


# --------------------------------------------------------------------------------------------------- figures


def run_model(case: PaperCase, model: Model, reference: bool = False) -> ModelRun:
    """A case with one model, its stability at every step.

    Parameters
    ----------
    case, model
        What is solved.
    reference
        Whether the independent reference solves it as well.
    """
    targets = resolve(case.robot, case.steps)
    simulation = Simulation(case.robot, model, targets)
    steps, found, failure = [], [], ""
    for number, (step, target) in enumerate(zip(case.steps, targets, strict=True), start=1):
        try:
            report = simulation.advance(target, step.substeps)
        except StepFailed as problem:
            failure = f"step {number} ({step.label}): {problem}"
            break
        steps.append(simulation.result(number, step.label, report))
        found.append(stability(simulation))
    gap = float("nan")
    if reference and not failure:
        other = solve_reference(case.robot, model, case.steps)
        if other.converged:
            gap = float(np.linalg.norm(other.steps[-1].tip - steps[-1].tip))
    return ModelRun(tuple(steps), tuple(found), failure, gap)


def _figures(run: PaperRun, report: Progress) -> None:
    for name in CASE_IDS:
        case = paper_case(name)
        runs = {}
        for key, model in MODELS.items():
            runs[key] = run_model(case, model, reference=key == "discrete")
            report(f"{name}, {key}")
        run.cases[name] = CaseStudy(case, runs)


# ---------------------------------------------------------------------------------------------------- tables


def study_table(number: int) -> TableStudy:
    """One table beside the declared and the fitted robots."""
    readings = {"declared": compare_table(number)}
    fits = {"stiffness": fit_table(number)}
    readings["stiffness"] = compare_table(number, fits["stiffness"].robot)
    if number != 2:
        fits["dead band"] = fit_table(number, dead_band=True)
        readings["dead band"] = compare_table(
            number, fits["dead band"].robot, dead_band=fits["dead band"].dead_band
        )
    length = prototype(number).backbone.length
    parts: dict[str, Callable[[Reading], bool]] = {
        "all": lambda r: True,
        "without load": lambda r: not r.loaded,
        "with load": lambda r: r.loaded,
        "consistent rows": lambda r: r.consistent,
    }
    deviations = {
        name: {part: deviation(found, length, where) for part, where in parts.items()}
        for name, found in readings.items()
    }
    return TableStudy(number, paper_table(number), readings, deviations, fits)


def _tables(run: PaperRun, report: Progress) -> None:
    for number in TABLES:
        run.tables[number] = study_table(number)
        report(f"Table {number}")
    declared = prototype(1)
    name = declared.tendon_names
    length = declared.backbone.length

    def unloaded(robot: Robot) -> Deviation:
        return deviation(compare_table(1, robot), length, lambda r: not r.loaded)

    run.printed_offset = unloaded(declared.with_tendons(name, routing=ParallelRouting(0.43e-3)))
    run.simulation_rod = unloaded(declared.with_backbone(radius=0.4e-3))
    run.directions = load_direction_study(run.tables[1].fits["stiffness"].robot)
    report("Table 1, directions of its load")


# -------------------------------------------------------------------------------------------- critical loads


def _critical(run: PaperRun, report: Progress) -> None:
    robot = paper_case("fig5").robot
    name = robot.tendon_names[0]
    for tension in SEARCH_TENSIONS:
        for text, direction in SEARCH_DIRECTIONS.items():
            run.searches[tension, text, "discrete"] = search_critical_load(
                robot, MODELS["discrete"], [LoadStep("pull", {name: tension})], direction, SEARCH_LOADS
            )
        report(f"helical, {tension:g} N, without friction")
    across = [text for text in SEARCH_DIRECTIONS if text != "-z"]
    for tension in SEARCH_TENSIONS:
        for text in across:
            run.searches[tension, text, "per-hole"] = search_critical_load(
                robot,
                MODELS["per-hole"],
                [LoadStep("pull", {name: tension})],
                SEARCH_DIRECTIONS[text],
                SEARCH_LOADS,
            )
    report("helical, with friction")
    # The robot of the experiments at its own tensions, with the declared and with the fitted stiffness.
    stiff = run.tables[3].fits["stiffness"].robot if run.tables else fit_table(3).robot
    for kind, own in (("as declared", prototype(3)), ("stiffness of Table 3", stiff)):
        for tension in SEARCH_TENSIONS[1:]:
            for text in across:
                run.prototype_searches[tension, text, kind] = search_critical_load(
                    own,
                    MODELS["per-hole"],
                    [LoadStep("pull", {own.tendon_names[0]: tension})],
                    SEARCH_DIRECTIONS[text],
                    SEARCH_LOADS,
                )
    report("helical, the prototype")
    # The search must find a critical load where there is one: Euler's column, the tendon slack.
    run.column = search_critical_load(
        robot, MODELS["discrete"], [LoadStep("slack", {name: 0.0})], (0, 0, -1), (0.02, 0.04, 0.06, 0.08)
    )
    report("column")


def euler_load(robot: Robot) -> float:
    """Critical load of the backbone as a column clamped at the base, ``pi^2 EI / (4 L^2)`` [N]."""
    return float(np.pi**2 * robot.backbone.EI / (4.0 * robot.backbone.length**2))


# ----------------------------------------------------------------------------------------------------- signs


def three_tendon_robot() -> Robot:
    """The single segment of Fig. 3 with three tendons, 120 degrees apart."""
    single = paper_case("fig3").robot
    tendons = tuple(
        Tendon(f"t{k + 1}", ParallelRouting(4.5e-3, 120.0 * k), friction_coefficient=0.3) for k in range(3)
    )
    return Robot(single.backbone, single.disks, tendons, "three-tendons")


def sign_steps() -> list[LoadStep]:
    """A loading sequence in which the tendons' signs change, and in which some tendons do not move at all."""
    return [
        LoadStep("all to 0.3 N", {"t1": 0.3, "t2": 0.3, "t3": 0.3}),
        LoadStep("t1 to 1.2 N", {"t1": 1.2}),
        LoadStep("t2 to 0.8 N", {"t2": 0.8}),
        LoadStep("t1 back to 0.4 N", {"t1": 0.4}),
        LoadStep("t3 to 1.0 N", {"t3": 1.0}),
        LoadStep("t3 back to 0.98 N", {"t3": 0.98}),
        LoadStep("5 mN at the tip", {}, loads={"tip": Load(0.25, (0.005, 0.0, 0.0))}),
    ]


def _signs(run: PaperRun, report: Progress) -> None:
    robot, steps = three_tendon_robot(), sign_steps()
    run.signs = trial_signs(robot, steps, try_all=True)
    run.signs_own = simulate(robot, MODELS["per-tendon"], steps).steps
    report("signs of Fig. 2")


# ------------------------------------------------------------------------------------------------- stiffness


def made_experiments(robot: Robot, forces: Array, error: float = 0.0, seed: int = 1) -> Array:
    """Displacements of the tip under forces, by the independent reference [m], shape (m, 3).

    Parameters
    ----------
    robot
        Its tendons are slack.
    forces
        On the tip [N], shape (m, 3).
    error
        Standard deviation of the measurement [m].
    seed
        Of its random numbers.
    """
    length = robot.backbone.length
    noise = np.random.default_rng(seed)
    found = []
    for f in forces:
        step = LoadStep("force", loads={"tip": Load(length, (float(f[0]), float(f[1]), float(f[2])))})
        tip = solve_reference(robot, Model("straight", "none"), [step]).steps[-1].tip
        found.append(tip - [0.0, 0.0, length] + error * noise.standard_normal(3))
    return np.array(found)


def _stiffness(run: PaperRun, report: Progress) -> None:
    declared = prototype(1)
    factor = 1.35  # glue and disks stiffen the rod; the factor to be identified
    true = declared.with_backbone(
        bending_stiffness=factor * declared.backbone.EI, torsional_stiffness=factor * declared.backbone.GJ
    )
    angle = np.arange(8) * np.pi / 4.0
    size = np.tile([2e-3, 4e-3], 4)
    forces = np.stack((size * np.cos(angle), size * np.sin(angle)), axis=1)
    three = np.pad(forces, ((0, 0), (0, 1)))
    moved = made_experiments(true, three, error=5e-5)
    # Displacements along the backbone are below the error: two components are identified.
    identified = identify_stiffness(forces, moved[:, :2])
    found = with_identified_stiffness(declared, identified)
    new = np.array([[0.0024, -0.0018, 0.0]])
    new_moved = made_experiments(true, new, error=5e-5, seed=2)
    far = identify_stiffness(10.0 * forces, made_experiments(true, 10.0 * three)[:, :2])
    pull = [LoadStep("pull", {declared.tendon_names[0]: 1.5})]

    def tip(robot: Robot) -> Array:
        return simulate(robot, Model(), pull).steps[-1].tip

    run.stiffness = StiffnessStudy(
        true.backbone.EI,
        declared.backbone.EI,
        found.backbone.EI,
        identified,
        validation_error(identified, new[0, :2], new_moved[0, :2]),
        float(np.linalg.norm(tip(found) - tip(true))),
        float(np.linalg.norm(tip(declared) - tip(true))),
        with_identified_stiffness(declared, far).backbone.EI / true.backbone.EI,
    )
    report("stiffness from loads")


# ----------------------------------------------------------------------------------------------- limitations


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


# --------------------------------------------------------------------------------------------------- effects


def _effects(run: PaperRun, report: Progress) -> None:
    for name in DATASETS:
        study = study_missing(name)
        if study.result is not None and study.result.interrupted:
            raise KeyboardInterrupt
        run.missing[name] = study
        report(f"what is missing, {name}")

"""The paper's claims and limitations (claims.toml), each with a function that finds its verdict and the evidence.

Wang, Du, Mao: Cosserat Rod-Based Tendon Friction Modeling, Simulation, and Experiments for Tendon-Driven Continuum
Robots, Micromachines 2025, 16(3), 346, https://doi.org/10.3390/mi16030346.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache
from itertools import product
from typing import Any, NamedTuple

import numpy as np

from tdcr_fe.elements import Array
from tdcr_fe.model.friction import ForceDependentFriction
from tdcr_fe.model.loading import Load, LoadStep, Model, resolve
from tdcr_fe.model.results import StepResult
from tdcr_fe.model.robot import Robot
from tdcr_fe.scene.builder import CreateTDCR
from tdcr_fe.solve.load_steps.load_path import StepFailed
from tdcr_fe.solve.simulate import Simulation, simulate
from tdcr_fe.solve.stability import Stability, stability
from tdcr_fe.validation.paper.cases import MARKED, MODELS, figure, prototype
from tdcr_fe.validation.paper.tables import TABLES, checked_table, deviation_percent, fit
from tdcr_fe.validation.reference import solve_reference

#: "holds", "holds in part", "does not hold", "matters" or "matters little"; and the numbers in sentences.
Verdict = tuple[str, str]

#: Error of the mesh; smaller differences of the tip displacement do not order the models [mm].
TIE = 5e-2
#: Loads of the search for a critical one [N]; up to twice the paper's own.
LOADS = (0.01, 0.02, 0.04, 0.06, 0.08, 0.1, 0.15, 0.2, 0.3, 0.4, 0.6, 0.8, 1.2, 1.6)
#: Directions of these loads, across the robot.
ACROSS = {"+x": (1, 0, 0), "+y": (0, 1, 0), "-x": (-1, 0, 0), "-y": (0, -1, 0)}


class Path(NamedTuple):
    """Equilibria of a loading sequence, as far as they are stable and follow one from the other."""

    steps: tuple[StepResult, ...]
    stabilities: tuple[Stability, ...]  # by step
    ended: str  # why not all steps were solved; empty where they were


def follow(robot: Robot, model: Model, steps: Sequence[LoadStep]) -> Path:
    """Follow the equilibrium through load steps, until it cannot be followed or loses its stability."""
    targets = resolve(robot, steps)
    simulation = Simulation(robot, model, targets)
    solved: list[StepResult] = []
    found: list[Stability] = []
    for number, (step, target) in enumerate(zip(steps, targets, strict=True), start=1):
        try:
            report = simulation.advance(target, step.substeps)
        except StepFailed:
            return Path(tuple(solved), tuple(found), f"{step.label}: no equilibrium found")
        here = stability(simulation)
        if report.snapped or here.divergence <= 0.0:
            lost = "the robot snaps" if report.snapped else "the equilibrium is unstable"
            return Path(tuple(solved), tuple(found), f"{step.label}: {lost}")
        solved.append(simulation.result(number, step.label, report))
        found.append(here)
    return Path(tuple(solved), tuple(found), "")


def deformation(step: StepResult) -> float:
    """Distance of the tip from where it is unloaded [m]."""
    return float(np.linalg.norm(step.tip - [0.0, 0.0, step.s[-1]]))


# ------------------------------------------------------------------------------------------------------ figures


@cache
def paths(name: str) -> dict[str, Path]:
    """A figure with every model."""
    case = figure(name)
    return {key: follow(case.robot, model, case.steps) for key, model in MODELS.items()}


def deforms_more(more: str, less: str) -> Verdict:
    """Whether one model deforms more than another, with and without load, in the states that the figures show."""
    texts, hits, counts = [], [0, 0], [0, 0]
    for name, marked in MARKED.items():
        loaded, found = False, paths(name)
        for step, a, b in zip(figure(name).steps, found[more].steps, found[less].steps, strict=False):
            loaded = loaded or bool(step.loads)
            if step.label in marked:
                sizes = 1e3 * deformation(a), 1e3 * deformation(b)
                hits[loaded] += sizes[0] - sizes[1] > TIE
                counts[loaded] += abs(sizes[0] - sizes[1]) > TIE
                if not loaded:
                    texts.append(f"{name} {sizes[0]:.2f} and {sizes[1]:.2f} mm")
    true, all_states = sum(hits), sum(counts)
    verdict = "holds" if true == all_states else "does not hold" if 3 * true < all_states else "holds in part"
    return verdict, (
        f"Tip displacement by tendons alone: {'; '.join(texts)}. True in {hits[0]} of {counts[0]} states without and "
        f"{hits[1]} of {counts[1]} with load."
    )


def figures_can_be_computed() -> Verdict:
    """Whether all figures are solved on a stable branch, and as the reference solves them."""
    found = {(name, key): path for name in MARKED for key, path in paths(name).items()}
    ended = [f"{name}, {key}, {path.ended}" for (name, key), path in found.items() if path.ended]
    smallest = min(x.smallest for path in found.values() for x in path.stabilities)
    gaps = []
    for name in MARKED:
        case = figure(name)
        reference = solve_reference(case.robot, MODELS["discrete"], case.steps).steps[-1]
        off = float(np.linalg.norm(reference.tip - paths(name)["discrete"].steps[-1].tip))
        gaps.append(off / case.robot.backbone.length)
    return "holds in part" if ended else "holds", (
        f"{len(MARKED)} cases with {len(MODELS)} models, from the unloaded state in small steps; not solved: "
        f"{', '.join(ended) or 'none'}; smallest eigenvalue of the tangent {smallest:.2f}; without friction, "
        f"tip within {100 * max(gaps):.1g} % of the length from the independent reference."
    )


# ------------------------------------------------------------------------------------------------------- tables


def accuracy() -> Verdict:
    """How far simulation and experiment deviate, as declared and after fitting."""
    declared = {n: deviation_percent(n, prototype(n)) for n in TABLES}
    # Table 2 has no row without load.
    fitted = {n: deviation_percent(n, *fit(n), unloaded=True) for n in TABLES if n != 2}
    one = checked_table(1)
    phi = np.deg2rad(one["angle_deg"])
    contradiction = float(np.mean(np.abs(one["offset_mm"] - 250.0 * np.sin(phi) ** 2 / phi))) / 2.5
    texts = ["; ".join(f"Table {n} {x:.1f} %" for n, x in found.items()) for found in (declared, fitted)]
    return "holds" if min(*declared.values(), *fitted.values()) < 0.3 else "does not hold", (
        f"Mean deviation of the offsets in per cent of the length, model as declared: {texts[0]}. Rows without load, "
        f"stiffness and dead band fitted: {texts[1]}. Offsets and angles of Table 1 alone disagree by "
        f"{contradiction:.1f} % of the length on average."
    )


def consistency() -> Verdict:
    """How many rows of the tables contradict themselves or each other."""
    rows = [checked_table(n)[["geometry_ok", "elastic_ok"]].to_numpy() for n in TABLES]
    ok = np.concatenate(rows)
    shape, elastic = (~ok).sum(axis=0)
    good = int(ok.all(axis=1).sum())
    return "does not hold" if 2 * good < len(ok) else "holds in part", (
        f"{shape} of {len(ok)} rows have an offset and an angle that contradict each other, {elastic} a load or a "
        f"stiffness that contradicts the others. {good} rows pass every check."
    )


# ---------------------------------------------------------------------------------------------- bifurcation


def critical_load(
    robot: Robot, model: Model, tension: float, direction: Sequence[float]
) -> tuple[float | None, float]:
    """Load at the tip that makes a pulled robot lose its stability [N], None where none does, and the least eigenvalue.

    The load is raised in small steps; a loss of stability is bisected to a thousandth.
    """
    pull = LoadStep("pull", {robot.tendon_names[0]: tension})

    def path(sizes: Sequence[float]) -> Path:
        x, y, z = direction
        loads = [Load(robot.backbone.length, (f * x, f * y, f * z)) for f in sizes]
        return follow(robot, model, [pull, *(LoadStep("load", loads={"tip": load}) for load in loads)])

    found = path(LOADS)
    least = min(x.smallest for x in found.stabilities)
    if not found.ended:
        return None, least
    stable, high = [0.0, *LOADS][: len(found.steps)], [0.0, *LOADS][len(found.steps)]
    while high - stable[-1] > 1e-3 * high:
        middle = 0.5 * (stable[-1] + high)
        if path([*stable, middle]).ended:
            high = middle
        else:
            stable.append(middle)
    return 0.5 * (stable[-1] + high), least


def bifurcation() -> Verdict:
    """Whether a load across the robot with a helical tendon becomes critical."""
    robot = figure("fig5").robot
    models = (MODELS["discrete"], MODELS["per-hole"])
    own = [critical_load(robot, model, 1.2, x) for model, x in product(models, ACROSS.values())]
    reached = [load for load, _ in own if load is not None]
    high, _ = critical_load(robot, MODELS["per-hole"], 30.0, ACROSS["-y"])
    verdict = "holds" if reached else "does not hold" if high is None else "holds in part"
    return verdict, (
        f"The paper's 1.2 N, loads across the robot up to {LOADS[-1]:g} N in four directions, with and without "
        f"friction: smallest eigenvalue {min(least for _, least in own):.2f} (1 unloaded, 0 critical), "
        f"{len(reached)} critical loads. At 30 N of tension with friction a load along -y is critical at "
        f"{'none' if high is None else f'{high:.3f}'} N."
    )


# -------------------------------------------------------------------------------------- stiffness, limitations


def stiffness() -> Verdict:
    """A robot 1.35 times as stiff as declared, its stiffness identified from eight small forces (Eqs. 36 to 40)."""
    declared = prototype(1)
    rod = declared.backbone
    true = declared.with_backbone(bending_stiffness=1.35 * rod.EI, torsional_stiffness=1.35 * rod.GJ)
    angle, size = np.arange(8) * np.pi / 4.0, np.tile([2e-3, 4e-3], 4)
    forces = np.stack((size * np.cos(angle), size * np.sin(angle)), axis=1)
    noise = np.random.default_rng(1).normal(0.0, 5e-5, forces.shape)

    def moved(forces: Array) -> Array:
        """Displacements of the tip across the robot [m], shape (n, 2)."""
        loads = [{"tip": Load(rod.length, (float(x), float(y), 0.0))} for x, y in forces]
        steps = [[LoadStep("force", loads=load)] for load in loads]
        return np.array([solve_reference(true, Model(friction="none"), step).tips[-1, :2] for step in steps])

    def bending_stiffness(compliance: Array) -> float:
        """EI of the cantilever that has the mean compliance of both directions, ``u/F = L^3 / (3 EI) + L / GA``."""
        mean = float(np.mean(np.diag(compliance)))
        return rod.length**3 / (3.0 * (mean - rod.length / rod.GA))

    compliance = np.linalg.lstsq(forces, moved(forces) + noise)[0].astype(float)
    far = np.linalg.lstsq(10.0 * forces, moved(10.0 * forces))[0].astype(float)
    new = np.array([[0.0024, -0.0018]])
    off = float(np.linalg.norm(new @ compliance - moved(new)) / np.linalg.norm(moved(new)))
    found, put_in = bending_stiffness(compliance), true.backbone.EI
    return "holds" if off < 0.02 and abs(found / put_in - 1.0) < 0.02 else "does not hold", (
        f"From 8 forces of 2 and 4 mN with 0.05 mm of noise: EI {1e3 * found:.3f}e-3 N m² where {1e3 * put_in:.3f}e-3 "
        f"was put in; a new load is predicted to {100 * off:.1f} %. With ten times the forces the stiffness is "
        f"{bending_stiffness(far) / put_in:.2f} times too large."
    )


def limitation(changes: dict[str, Callable[[Robot], Robot]]) -> Verdict:
    """How far something that the paper neglects moves the tip of the robot of Fig. 3."""
    robot, pull = figure("fig3").robot, [LoadStep("pull", {"t1": 1.5})]
    tip = simulate(robot, Model(), pull).tips[-1]
    tips = {name: simulate(change(robot), Model(), pull).tips[-1] for name, change in changes.items()}
    moves = {name: 1e3 * float(np.linalg.norm(moved - tip)) for name, moved in tips.items()}
    percent = 0.1 / robot.backbone.length
    texts = [f"{name}: {x:.2f} mm, {percent * x:.2f} %" for name, x in moves.items()]
    verdict = "matters" if percent * max(moves.values()) > 0.5 else "matters little"
    return verdict, f"Fig. 3 at 1.5 N, the tip moves by {'; '.join(texts)}."


def dynamics() -> Verdict:
    """How far the tip goes beyond its quasi-static position after a fast pull, with no damping but friction."""
    robot, model = figure("fig3").robot, Model("straight", "per-hole", 1)
    still = simulate(robot, model, [LoadStep("pull", {"t1": 1.5})]).tips[-1]
    texts, left = [], []
    for ramp in (0.3, 1.0, 3.0):
        times, tips = pulled_in(robot, model, 1.5, ramp)
        beyond = np.max(np.linalg.norm(tips[:, :2], axis=1)) - np.linalg.norm(still[:2])
        left.append(1e3 * float(np.linalg.norm(tips[times > ramp + 1.0].mean(axis=0) - still)))
        texts.append(f"pulled in {ramp:g} s: {1e3 * beyond:.1f} mm beyond, at rest {left[-1]:.2f} mm away")
    verdict = "matters" if left[0] > 1.0 else "matters little"
    return verdict, f"Fig. 3 to 1.5 N against the quasi-static tip: {'; '.join(texts)}."


def pulled_in(robot: Robot, model: Model, tension: float, ramp: float) -> tuple[Array, Array]:
    """Times and positions of the tip while its tendon is pulled in a time [s], and 1.5 s longer."""
    import exudyn as exu

    mbs = exu.SystemContainer().AddSystem()
    handle = CreateTDCR(mbs, robot, model, presliding=1e-5)
    sensors = handle.add_sensors()
    mbs.Assemble()

    def inputs(t: float) -> list[float]:
        x = min(t / ramp, 1.0)
        return [tension * x * x * (3.0 - 2.0 * x)]

    handle.set_inputs_over_time(inputs)
    settings = handle.recommended_settings(ramp + 1.5, 5e-3)
    settings.solution.file.write = False
    settings.solution.sensors.writePeriod = 5e-3
    mbs.SolveDynamic(settings)
    data = np.asarray(mbs.GetSensorStoredData(sensors["tip_position"]))
    return data[:, 0], data[:, 1:4]


Changes = dict[str, Callable[[Robot], Robot]]
THICK: Changes = {
    "disks 1 mm thick": lambda r: r.with_disks(thickness=1e-3),
    "3 mm": lambda r: r.with_disks(thickness=3e-3),
}
_BY_FORCE: dict[str, Any] = {"friction_coefficient": 0.0, "friction": ForceDependentFriction(0.3, 0.4)}
ROUGH: Changes = {
    "20 mN of adhesion at every hole": lambda r: r.with_tendons(adhesion=0.02),
    "friction coefficient ~ force^-1/3, 0.3 at 0.4 N": lambda r: r.with_tendons(**_BY_FORCE),
}
#: Functions by the claim's key in claims.toml.
CLAIMS: dict[str, Callable[[], Verdict]] = {
    "order": lambda: deforms_more("classical", "discrete"),
    "friction_order": lambda: deforms_more("discrete", "per-tendon"),
    "figures": figures_can_be_computed,
    "accuracy": accuracy,
    "consistency": consistency,
    "bifurcation": bifurcation,
    "stiffness": stiffness,
    "disks": lambda: limitation(THICK),
    "friction": lambda: limitation(ROUGH),
    "dynamics": dynamics,
}

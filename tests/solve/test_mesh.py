"""Discretisation error: its order, the estimate, refinement, warnings; and the balance of energy with substeps."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from robots import BACKBONE, LENGTH, distance, paper, pull, routed, single, solve

from tdcr_fe import ConvergingRouting, Disks, HelicalRouting, Interrupted, Load, LoadStep, Model, Robot
from tdcr_fe.model.backbone import NonlinearMaterial, Superelastic
from tdcr_fe.scene.mesh import elements_of_bays
from tdcr_fe.solve.simulate import PathRecord, Simulation, SolverSettings, StepFailed, simulate
from tdcr_fe.validation.fuzz.energy import divided, ledger

THREE_DISKS = replace(single(), disks=Disks.equally_spaced(3, LENGTH))
TAPERED = single().with_backbone(taper=((0.0, BACKBONE.radius), (LENGTH, 0.25e-3)))


FREE, FINE = Model(friction="none"), SolverSettings(mesh_tolerance=1e-6)
CASES = {
    "in plane": (single(), FREE, (0.0, 0.0, 0.0)),
    "out of plane": (single(), FREE, (0.0, 0.05, 0.0)),
    "friction": (single(0.3), Model(), (0.0, 0.05, 0.0)),
    "continuous": (single(), Model("continuous", "none"), (0.0, 0.05, 0.0)),
    "weight": (single().with_backbone(density=2e4), replace(FREE, gravity=(9.81, 0.0, 0.0)), (0.0, 0.0, 0.0)),
    "tapered": (TAPERED, FREE, (0.0, 0.05, 0.0)),
    "softening": (TAPERED.with_backbone(superelastic=Superelastic(0.006, 0.6)), Model(), (0.0, 0.02, 0.0)),
    "fibres": (TAPERED.with_backbone(nonlinear=NonlinearMaterial(-20.0, 200.0)), Model(), (0.0, 0.02, 0.0)),
}


@pytest.mark.parametrize(("robot", "model", "load"), CASES.values(), ids=CASES)
def test_the_estimate_tends_to_the_true_error(robot: Robot, model: Model, load: tuple[float, ...]) -> None:
    """With two elements a bay it is within 5 % of the distance to a mesh eight times as fine."""
    steps = [LoadStep("", {"t1": 1.5}, loads={"tip": Load(LENGTH, load)})]
    models = (replace(model, elements_per_bay=n) for n in (2, 16))
    coarse, fine = (simulate(robot, x, steps).steps[0] for x in models)
    error = np.linalg.norm(coarse.positions - fine.positions[::8], axis=1).max()
    assert coarse.discretisation_error == pytest.approx(error, rel=0.08)


def test_a_pure_moment_has_no_discretisation_error() -> None:
    """A continuous parallel tendon bends the backbone into an arc, which one element follows exactly."""
    assert simulate(single(), Model("continuous", "none", 1), pull(2.5)).steps[0].discretisation_error < 1e-12


def test_the_automatic_mesh_meets_its_tolerance() -> None:
    """Three disks a segment: 0.07 to 0.12 % of the length off with four elements a bay on e3bbe5d, no warning."""
    steps = [LoadStep("", {"t1": 2.5}, loads={"tip": Load(LENGTH, (0.0, 0.05, 0.0))})]
    models = FREE, replace(FREE, elements_per_bay=32)
    result, fine = (simulate(THREE_DISKS, model, steps) for model in models)
    assert np.linalg.norm(result.steps[0].tip - fine.steps[0].tip) < 1e-4 * LENGTH
    assert result.steps[0].discretisation_error < 1e-4 * LENGTH
    assert not any("too coarse" in w for w in result.warnings)


def test_refinement_begins_where_a_coarse_start_is_not_enough() -> None:
    """A tolerance below the error of the first mesh makes it finer, and the result keeps the user's model."""
    result = simulate(single(), FREE, pull(1.0, 2.5), FINE)
    assert max(result.elements_per_bay) > max(elements_of_bays(single(), FREE))
    assert all(s.discretisation_error < 1e-6 * LENGTH for s in result.steps)
    assert result.model == FREE and len(result.steps) == 2


def fail_on_refined_meshes(monkeypatch, at_step: int, error: BaseException) -> None:
    """Let a step fail on every mesh but the first."""
    advance = Simulation.advance
    calls: dict[Simulation, int] = {}

    def failing(self: Simulation, *args, **kwargs):
        calls[self] = calls.get(self, 0) + 1
        if len(calls) > 1 and calls[self] == at_step:
            raise error
        return advance(self, *args, **kwargs)

    monkeypatch.setattr(Simulation, "advance", failing)


def test_steps_of_the_coarser_mesh_are_kept_where_the_refined_one_fails(monkeypatch) -> None:
    """Before, a failure in step 2 of the refined run left one of the three steps that were solved."""
    fail_on_refined_meshes(monkeypatch, 2, StepFailed("no balance", 0.0, 1.0, None, 5))
    path: PathRecord = []
    result = simulate(single(), FREE, pull(1.0, 2.0, 2.5), FINE, record_path=path)
    assert result.converged and len(result.steps) == len(path) == 3
    assert result.elements_per_bay == elements_of_bays(single(), Model())
    assert all(s.discretisation_error > 1e-6 * LENGTH for s in result.steps)
    assert any("on which 3 steps were solved" in w and "step 2" in w for w in result.warnings)
    assert any("too coarse" in w for w in result.warnings)


def test_steps_of_the_coarser_mesh_are_kept_where_the_refined_run_is_interrupted(monkeypatch) -> None:
    fail_on_refined_meshes(monkeypatch, 1, KeyboardInterrupt())
    with pytest.raises(Interrupted) as stop:
        simulate(single(), FREE, pull(1.0, 2.5), FINE)
    result = stop.value.result
    assert (result.converged, result.message, len(result.steps)) == (False, "interrupted", 2)
    assert any("was interrupted" in w for w in result.warnings)


def test_a_given_number_of_elements_is_kept_and_its_error_reported() -> None:
    """Three disks with one element a bay are far off; the run reports it, with the size of the error."""
    result = simulate(THREE_DISKS, Model(friction="none", elements_per_bay=1), pull(2.5))
    assert result.elements_per_bay == (1, 1, 1, 1)
    assert result.steps[0].discretisation_error > 1e-4 * LENGTH
    assert any("too coarse" in w and "step 1" in w for w in result.warnings)


def test_a_bay_under_a_known_force_has_the_fraction_of_eulers_load() -> None:
    """A straight column between two disks under an axial force N: N a^2 / (pi^2 EI)."""
    backbone = replace(BACKBONE, length=0.02)
    step = LoadStep("", loads={"tip": Load(0.02, (0.0, 0.0, -0.3 * np.pi**2 * backbone.EI / 0.02**2))})
    result = simulate(Robot(backbone, Disks((0.02,)), ()), Model(friction="none"), [step])
    assert result.steps[0].buckling_load_fraction == pytest.approx(0.3, rel=1e-3)


def test_elements_per_bay_can_be_given_for_every_bay() -> None:
    counts = (3, 1, 2, 4)
    robot = replace(single(), disks=Disks((0.05, 0.1, 0.2)), tendons=())
    result = simulate(robot, Model(friction="none", elements_per_bay=counts), [LoadStep()])
    assert len(result.steps[0].s) == 1 + sum(counts)


# ------------------------------------------------------------ order of convergence


CASES = {
    "helical": routed(HelicalRouting(4.5e-3, 2.0), mu=0.3),
    "converging": routed(ConvergingRouting(4.5e-3, 0.15e-3), mu=0.3),
    "superelastic": paper(0.3).with_backbone(superelastic=Superelastic(0.002, 0.4)),
    "tapered": paper(0.3).with_backbone(taper=((0.0, 0.4e-3), (LENGTH, 0.25e-3))),
    "precurved": paper(0.3).with_backbone(precurvature=(1.0, 2.0)),
    "thick": paper(0.3).with_disks(thickness=4e-3),
}


@pytest.mark.parametrize("case", CASES)
def test_tip_converges_with_order_two_or_better_in_the_mesh(case):
    """Pulled to 1 N with friction, and a force at the tip; two elements per bay are within 1e-5 of the length.

    The order is ``log2 |x_2 - x_4| / |x_4 - x_8|``.
    """
    pulled = pull(1.0, loads={"tip": Load(LENGTH, (0.01, 0.02, 0.0))})
    tips = [solve(CASES[case], pulled, elements_per_bay=k).tips[-1] for k in (2, 4, 8)]
    first, second = (np.linalg.norm(b - a) for a, b in pairwise(tips))
    assert np.log2(first / second) > 1.95
    assert distance(tips[0], tips[-1]) < (5e-4 if case == "tapered" else 1e-5)


@pytest.mark.integration
@pytest.mark.parametrize("friction", ["none", "per-tendon", "per-hole"])
def test_the_energy_balance_closes_with_order_two_in_the_substeps(friction):
    """Pull to 2 N and release with a tip force: the balance by the trapezoidal rule closes with order two."""
    robot = single(0.3)
    pushed, free = {"tip": Load(LENGTH, (0.0, 0.03, 0.01))}, {"tip": Load(LENGTH)}
    cycle = [*pull(2.0, loads=pushed), *pull(0.3), *pull(1.5, loads=free), *pull(0.0)]
    gaps = []
    for parts in (8, 16, 32):
        found = ledger(solve(robot, divided(robot, cycle, parts), friction=friction))
        assert found.gain < 1e-9
        gaps.append(found.gap)
    assert gaps[-1] < 1e-4
    if friction == "none":
        assert abs(found.work) < 1e-6
    else:
        assert found.work > 5e-4
        assert gaps[-1] < 0.1 * gaps[0]

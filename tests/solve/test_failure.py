"""Message of a solve that ends without a solution, and the steps that are kept when it is interrupted."""

import re

import numpy as np
import pytest
from robots import distance, paper, pull, solve, three
from scenes import scene, solve_scene
from threadpoolctl import threadpool_info, threadpool_limits

from tdcr_fe import Interrupted, Load, LoadStep, Model, SolverSettings, SolveTDCR, StepFailed, simulate
from tdcr_fe.elements.native.actuation import TendonActuation
from tdcr_fe.model.loading import resolve
from tdcr_fe.solve.equations.configuration import Target
from tdcr_fe.solve.load_steps import substep
from tdcr_fe.solve.newton.convergence import NewtonStatus, Unmet
from tdcr_fe.solve.newton.newton import NewtonResult, newton
from tdcr_fe.solve.simulation import Simulation

TOLERANCES = {NewtonStatus.NO_BALANCE: 1e-8, NewtonStatus.NO_FRICTION_STATE: 1e-4}
UNMET = {status: Unmet(status, "something is", 1e-3, tolerance) for status, tolerance in TOLERANCES.items()}


def ended(status, residual):
    """A solve that ended without a solution."""
    return NewtonResult(status, None, residual, 20, UNMET.get(status), (), None, Target(()))


@pytest.mark.parametrize("status", [s for s in NewtonStatus if s is not NewtonStatus.CONVERGED])
def test_every_failure_names_size_and_tolerance_and_advises_settings_that_exist(status):
    text = f"{ended(status, 1e-3).reason(SolverSettings())} {substep.advice(status)}"
    assert "1.0e-03, tolerance 1e-0" in text
    for name in re.findall(r"(\w+) = [\d.e-]+ in the \[solver\] table", text):
        assert hasattr(SolverSettings(), name)


def test_a_step_whose_friction_needs_more_presliding_is_reported(monkeypatch):
    """Where only ten times the presliding distance converges, the step carries the factor and a warning."""

    def stubborn(*args, softening=1.0, **kwargs):
        if softening > 5.0:
            return newton(*args, softening=softening, **kwargs)
        return ended(NewtonStatus.NO_FRICTION_STATE, 1e-9)

    monkeypatch.setattr(substep, "newton", stubborn)
    result = solve(paper(0.3), pull(1.0), SolverSettings(min_substep=1.0))
    assert result.steps[0].details["presliding_factor"] == 10.0
    assert result.warnings[-1] == (
        "step 1: The stick-slip iteration did not converge; one substep used 10 times the presliding distance. "
        "Use smaller load steps."
    )


def test_an_interrupt_within_a_step_keeps_the_steps_before(monkeypatch):
    """Ctrl-C in the third step is raised again, with the two steps before and a message that names it."""

    def interrupted_beyond(*args, **kwargs):
        if args[2].inputs[0][0] > 1.0:
            raise KeyboardInterrupt
        return newton(*args, **kwargs)

    monkeypatch.setattr(substep, "newton", interrupted_beyond)
    with pytest.raises(Interrupted, match="what was solved before") as stop:
        simulate(paper(0.3), Model(elements_per_bay=1), pull(0.5, 1.0, 1.5, 2.0))
    result = stop.value.result
    assert len(result.steps) == 2 and not result.converged
    assert result.failed_step == 3 and result.message == "interrupted"


def interrupted(*args, **kwargs):
    raise KeyboardInterrupt


def test_an_interrupt_leaves_a_scene_at_the_beginning_of_the_step(monkeypatch):
    _keep, mbs, handle = scene(paper(0.3))
    solve_scene(mbs, handle, [1.0])
    before, history = handle.shape()[0], handle.actuation.state
    handle.set_tensions([2.0])
    with monkeypatch.context() as patch:
        patch.setattr(substep, "newton", interrupted)
        with pytest.raises(KeyboardInterrupt):
            SolveTDCR(mbs)
    assert distance(handle.shape()[0], before) < 1e-12
    assert np.array_equal(handle.actuation.state.slip, history.slip)
    SolveTDCR(mbs)
    assert distance(handle.tip_position, solve(paper(0.3), pull(1.0, 2.0)).tips[-1]) < 1e-9


def test_an_interrupt_in_exudyns_jacobian_is_raised_again(monkeypatch):
    """A following moment needs that Jacobian; what is raised in its callback, Exudyn raises as a ModelError."""

    def patch(step):
        monkeypatch.setattr(TendonActuation, "jacobian_on_coordinates", interrupted)

    turn = LoadStep(loads={"turn": Load(0.25, moment=(1e-3, 0.0, 0.0), frame="section")})
    with pytest.raises(Interrupted, match="what was solved before"):
        simulate(paper(0.3), Model(elements_per_bay=1), [*pull(0.5), turn], progress=patch)


def test_solves_use_one_thread_and_leave_the_limit_as_it_was():
    """Threads only cost processor time on matrices of this size; the caller's limit is restored."""
    seen = []

    def count():
        return [x["num_threads"] for x in threadpool_info() if x["user_api"] == "blas"]

    with threadpool_limits(2, user_api="blas"):
        before = count()
        simulate(paper(0.3), Model(elements_per_bay=1), pull(1.0), progress=lambda step: seen.append(count()))
        assert count() == before
    assert seen and all(n == 1 for n in seen[0])


def test_a_step_whose_jump_could_not_be_examined_in_time_is_not_solved(monkeypatch):
    """It was taken, with a warning that a node may be off by "inf %": the time was over between its halves."""
    steps = [LoadStep(displacements={"t1": 8e-3}), LoadStep(loads={"push": Load(0.25, (0.0, 0.0, -1.0))})]
    bent, pushed = resolve(three(), steps)
    model, calls = Model(elements_per_bay=1), iter([False, True])
    settings = SolverSettings(max_substeps=1, path_tolerance=1e-3)
    simulation = Simulation(three(), model, [bent, pushed], settings)
    simulation.advance(bent)
    monkeypatch.setattr(substep.SubstepSolver, "is_late", property(lambda _: next(calls, True)))
    with pytest.raises(StepFailed, match="time limit"):
        simulation.advance(pushed)

"""Solve a random case with one solver at its default settings, and keep what is compared."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tdcr_fe.io.atomic import plain, write_json
from tdcr_fe.io.summary import versions
from tdcr_fe.model.results import SequenceResult, StepResult
from tdcr_fe.solve.simulate import simulate
from tdcr_fe.validation.crosscheck.campaign import source_digest
from tdcr_fe.validation.random_robots.drawing import RandomCase, draw
from tdcr_fe.validation.reference import solve_reference

Array = NDArray[np.float64]

FINITE_ELEMENTS, REFERENCE = "finite_elements", "reference"

#: Solvers by name.
SOLVERS: Mapping[str, Callable[..., SequenceResult]] = {
    FINITE_ELEMENTS: simulate,
    REFERENCE: solve_reference,
}
#: Subpackages that affect the numbers of a solver.
_PACKAGES = {
    FINITE_ELEMENTS: ("elements", "model", "scene", "solve"),
    REFERENCE: ("model", "validation.reference"),
}


@dataclass(frozen=True)
class Answer:
    """What one solver finds for a random case.

    Attributes
    ----------
    number : int
        Seed of the case.
    solver : str
        One of `SOLVERS`.
    positions : tuple
        Of the disks in the solved steps [m], nested as shape (n_steps, n_disks, 3).
    estimates : tuple of float
        Discretisation error of every solved step that the solver announces [m].
    warnings : tuple of str
    failure : str
        Why not all steps were solved; empty where they were.
    seconds : float
        Processor time [s].
    """

    number: int
    solver: str
    positions: tuple[tuple[tuple[float, ...], ...], ...]
    estimates: tuple[float, ...]
    warnings: tuple[str, ...]
    failure: str
    seconds: float


def solve(number: int, solver: str) -> Answer:
    """Draw a case and solve it; an error of the program is a failure like any other.

    Parameters
    ----------
    number
        Seed of the case.
    solver
        One of `SOLVERS`.
    """
    case = draw(number)
    begun = time.process_time()
    try:
        result = SOLVERS[solver](case.robot, case.model, case.steps)
        positions = tuple(_disks(case, step) for step in result.steps)
    except Exception as error:
        failure = f"{type(error).__name__}: {error}"
        return Answer(number, solver, (), (), (), failure, time.process_time() - begun)
    seconds = time.process_time() - begun
    return Answer(
        number,
        solver,
        positions,
        tuple(step.discretisation_error or 0.0 for step in result.steps),
        tuple(result.warnings),
        "" if result.converged else result.message,
        seconds,
    )


def _disks(case: RandomCase, step: StepResult) -> tuple[tuple[float, ...], ...]:
    """Positions of the nodes at the disks [m]."""
    at = np.array(case.robot.disks.positions)
    nodes = np.abs(step.s[:, None] - at).argmin(axis=0)
    if np.abs(step.s[nodes] - at).max() > 1e-9:
        raise RuntimeError("a disk is no node of the solution")
    return tuple(tuple(map(float, p)) for p in step.positions[nodes])


@cache
def digest(solver: str) -> str:
    """Of the source that a solver's answers depend on, and of the versions of the packages."""
    own = source_digest((*_PACKAGES[solver], "validation.random_robots"))
    packages = ", ".join(f"{name} {number}" for name, number in sorted(versions().items()))
    return f"{own}; {packages}"


def write(answer: Answer, folder: Path) -> None:
    """Write an answer beside the digest of the code that found it."""
    document = {"digest": digest(answer.solver), "answer": plain(asdict(answer))}
    write_json(document, _path(answer.number, answer.solver, folder), indent=None)


def read(number: int, solver: str, folder: Path, *, any_version: bool = False) -> Answer | None:
    """An answer that was found before; None where there is none of the same code.

    Parameters
    ----------
    number, solver
        Case and solver.
    folder
        Where answers are kept.
    any_version
        Take it whatever code found it.
    """
    try:
        stored = json.loads(_path(number, solver, folder).read_text(encoding="utf-8"))
        known = stored["answer"]
        if not any_version and stored["digest"] != digest(solver):
            return None
        positions = tuple(tuple(tuple(p) for p in step) for step in known.pop("positions"))
        estimates, warnings = tuple(known.pop("estimates")), tuple(known.pop("warnings"))
        return Answer(positions=positions, estimates=estimates, warnings=warnings, **known)
    except (OSError, ValueError, TypeError, KeyError):
        return None


def _path(number: int, solver: str, folder: Path) -> Path:
    return folder / f"case_{number}_{solver}.json"

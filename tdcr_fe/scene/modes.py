"""Eigenfrequencies and modes of a scene with robots in their present state: `TDCREigenvalues`."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import exudyn as exu
import numpy as np
from numpy.typing import NDArray
from scipy.linalg import eig

from tdcr_fe.elements.actuation import Holes
from tdcr_fe.elements.hooks import SceneHooks
from tdcr_fe.model import arguments

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Modes:
    """Modes of a scene.

    Attributes
    ----------
    frequencies : ndarray, shape (k,)
        Ascending [Hz]; zero for a mode that does not swing, because it is unstable or moves freely.
    growth : ndarray, shape (k,)
        Rate at which the mode grows by itself [1/s]: positive where the state is unstable.
    shapes : ndarray, shape (n, k)
        By column, change of all ODE2 coordinates of the scene, the largest 1.
    """

    frequencies: Array
    growth: Array
    shapes: Array


def TDCREigenvalues(mbs: exu.MainSystem, *, holes: Holes = "stuck", numberOfEigenvalues: int = 10) -> Modes:
    """Eigenfrequencies and modes of small undamped vibrations about the present state of a scene.

    The state must be at rest, as `SolveTDCR` leaves it. Mass and stiffness are those of
    ``mbs.ComputeLinearizedSystem``, projected on what joints permit; the stiffness includes that of the tendons.
    ``mbs.ComputeLinearizedSystem`` and ``mbs.ComputeODE2Eigenvalues`` themselves give the derivative of the forces in
    the initial configuration, in which a hole at the bound of its friction sticks in one direction only.

    Parameters
    ----------
    mbs
        An assembled system with at least one robot.
    holes
        "stuck": no hole slips beyond its presliding, as in vibrations that are small enough. "sliding": every hole
        slides on, as on top of a motion that goes on.
    numberOfEigenvalues
        Number of modes, the lowest ones.

    Returns
    -------
    Modes

    Raises
    ------
    ValueError
        The system is not assembled or has no robot, or an argument is another.
    """
    hint = "SC = exudyn.SystemContainer(); mbs = SC.AddSystem() makes one."
    arguments.check_instance("TDCREigenvalues", "mbs", mbs, exu.MainSystem, "an exudyn.MainSystem", hint)
    arguments.check_count("TDCREigenvalues", "numberOfEigenvalues", numberOfEigenvalues)
    if holes not in ("stuck", "sliding"):
        raise ValueError(f"TDCREigenvalues: holes = {holes!r}; must be 'stuck' or 'sliding'")
    hooks = SceneHooks.of(mbs)
    if not hooks.actuations:
        raise ValueError("no robot in this system; add one with CreateTDCR")
    if not mbs.systemIsConsistent:
        raise ValueError("the system is not assembled; call mbs.Assemble()")
    with _linearized_about_the_present(mbs, hooks, holes), hooks.without_post_step():
        mass, stiffness, _, _, free = mbs.ComputeLinearizedSystem(
            projectIntoConstraintNullspace=True, returnConstraintNullspace=True
        )
    squared, vectors = eig(np.asarray(stiffness), np.asarray(mass))
    moving = np.isfinite(squared)
    squared, vectors = squared[moving], vectors[:, moving]
    rates = 1j * np.sqrt(squared.astype(complex))
    order = np.argsort(np.abs(squared))[:numberOfEigenvalues]
    coordinates = np.asarray(free).T @ np.real(vectors[:, order])
    return Modes(
        np.abs(rates.imag[order]) / (2.0 * np.pi),
        np.abs(rates.real[order]),
        coordinates / np.abs(coordinates).max(axis=0),
    )


@contextmanager
def _linearized_about_the_present(mbs: exu.MainSystem, hooks: SceneHooks, holes: Holes) -> Iterator[None]:
    """The present state as the initial one, with a tangent of the robots that assumes something of their holes."""
    data, initial = mbs.systemData, exu.ConfigurationType.Initial
    present, before = data.GetSystemState(), data.GetSystemState(initial)
    data.SetSystemState(present, initial)
    for robot in hooks.actuations:
        robot.holes = holes
    try:
        yield
    finally:
        for robot in hooks.actuations:
            robot.holes = "present"
        data.SetSystemState(before, initial)
        data.SetSystemState(present)

"""Eigenfrequencies and modes of a scene with robots in their present state: `TDCREigenvalues`."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import exudyn as exu
import numpy as np
from numpy.typing import NDArray
from scipy.linalg import eig

from tdcr_fe.elements.native.actuation import Holes
from tdcr_fe.elements.native.hooks import SceneHooks
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

    def show(self, mbs: exu.MainSystem, number: int, amplitude: float) -> None:
        """Put a scene into its present state plus a mode, to draw it; `hide` takes the mode away again.

        Parameters
        ----------
        mbs
            The scene, in the state of which these are the modes.
        number
            Of the mode, from 0.
        amplitude
            Of the coordinate that moves most [m], or [1] for an Euler parameter.
        """
        self._add(mbs, amplitude * self.shapes[:, number])

    def hide(self, mbs: exu.MainSystem, number: int, amplitude: float) -> None:
        """Take a mode away again; arguments as in `show`."""
        self._add(mbs, -amplitude * self.shapes[:, number])

    def _add(self, mbs: exu.MainSystem, change: Array) -> None:
        data = mbs.systemData
        data.SetODE2Coordinates(np.array(data.GetODE2Coordinates()) + change)


def TDCREigenvalues(mbs: exu.MainSystem, *, holes: Holes = "stuck", numberOfEigenvalues: int = 10) -> Modes:
    """Eigenfrequencies and modes of small undamped vibrations about the present state of a scene.

    The state must be at rest, as `SolveTDCR` leaves it. Mass and stiffness are those of
    ``mbs.ComputeLinearizedSystem``, projected on what joints permit; the stiffness includes that of the tendons.
    ``mbs.ComputeLinearizedSystem`` and ``mbs.ComputeODE2Eigenvalues`` themselves take the initial configuration, with
    stuck holes.

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
    arguments.check_count("TDCREigenvalues", "numberOfEigenvalues", numberOfEigenvalues)
    hooks = checked_hooks("TDCREigenvalues", mbs, holes)
    with linearized_about_the_present(mbs, hooks, holes), hooks.without_post_step():
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


def checked_hooks(function: str, mbs: exu.MainSystem, holes: Holes) -> SceneHooks:
    """Hooks of an assembled system with a robot; anything else is refused in the name of a function."""
    hint = "SC = exudyn.SystemContainer(); mbs = SC.AddSystem() makes one."
    arguments.check_instance(function, "mbs", mbs, exu.MainSystem, "an exudyn.MainSystem", hint)
    if holes not in ("stuck", "sliding"):
        raise ValueError(f"{function}: holes = {holes!r}; must be 'stuck' or 'sliding'")
    hooks = SceneHooks.of(mbs)
    if not hooks.actuations:
        raise ValueError("no robot in this system; add one with CreateTDCR")
    if not mbs.systemIsConsistent:
        raise ValueError("the system is not assembled; call mbs.Assemble()")
    hooks.refuse_motors(function)
    return hooks


@contextmanager
def linearized_about_the_present(mbs: exu.MainSystem, hooks: SceneHooks, holes: Holes) -> Iterator[None]:
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

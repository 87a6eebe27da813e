"""Exudyn's static solver kernel: residual and Jacobian of a scene in its current state."""

from __future__ import annotations

from typing import Any

import exudyn as exu
import numpy as np
from numpy.typing import NDArray

from tdcr_fe.elements.hooks import SceneHooks
from tdcr_fe.solve.equations.contact import ContactStates
from tdcr_fe.solve.equations.triangle_contact import TriangleContact

Array = NDArray[np.float64]


class StaticKernel:
    """Exudyn's static solver, evaluated one residual or Jacobian at a time; the scene stays as it is.

    Parameters
    ----------
    mbs
        An assembled system.
    hooks
        Of the system.

    Attributes
    ----------
    contact : ContactStates
    triangles : TriangleContact

    Raises
    ------
    RuntimeError
        Exudyn cannot initialise its solver.
    ValueError
        The scene has states that quasi-static steps do not solve: first-order states, or states with a history other
        than those of the robots.
    """

    def __init__(self, mbs: exu.MainSystem, hooks: SceneHooks) -> None:
        settings = exu.SimulationSettings()
        settings.solution.file.write = False
        settings.solution.sensors.active = False
        settings.staticSolver.verboseMode = 0
        self._mbs = mbs
        self._settings = settings
        own = [i for robot in hooks.actuations for i in robot.history_nodes.coordinate_numbers()]
        self.contact = ContactStates(mbs, own)
        self.triangles = TriangleContact(mbs)
        self._kernel = _initialised(mbs, hooks, settings, self.contact)
        if self._kernel.GetODE1size():
            raise ValueError(
                "the scene has first-order (ODE1) states, which the quasi-static solver does not solve; "
                "use mbs.SolveDynamic, or leave these items out"
            )

    def residual(self) -> Array:
        """Residual of all equations: forces on the coordinates, then constraints, shape (size,)."""
        self._kernel.ComputeNewtonResidual(self._mbs, self._settings)
        found: Array = self._kernel.GetSystemResidual()
        return found

    def jacobian(self, *, loads: bool = False, constraints: bool = True) -> Array:
        """Derivative of the residual, shape (size, size).

        Parameters
        ----------
        loads
            Whether that of loads is included.
        constraints
            Whether that of constraints is computed anew.
        """
        if not self.triangles.touching:
            return self._exudyns_jacobian(loads, constraints)
        n2 = self._mbs.systemData.ODE2Size()
        with self.triangles.switched_off():
            found = self._exudyns_jacobian(loads, constraints).copy()
        rest = found[:n2, :n2]
        couplings = self.triangles.couplings(
            lambda: self._exudyns_jacobian(loads, constraints=False)[:n2, :n2] - rest
        )
        rest += self.triangles.derivative(self.residual, couplings)
        return found

    def _exudyns_jacobian(self, loads: bool, constraints: bool) -> Array:
        """As `jacobian`, with what Exudyn takes for the derivative of contact with triangles."""
        self._kernel.ComputeJacobianODE2RHS(self._mbs, computeLoadsJacobian=int(loads))
        if constraints:
            self._kernel.ComputeJacobianAE(self._mbs)
        found: Array = self._kernel.GetSystemJacobian()
        return found


def _initialised(
    mbs: exu.MainSystem, hooks: SceneHooks, settings: exu.SimulationSettings, contact: ContactStates
) -> Any:
    """Exudyn's static solver, ready to evaluate residual and Jacobian; the scene stays as it is."""
    kernel, data = exu.MainSolverStatic(), mbs.systemData
    start = np.array(data.GetODE2Coordinates())
    multipliers = np.array(data.GetAECoordinates())
    states = np.array(data.GetDataCoordinates())
    # Exudyn's advice on large systems is about its own solvers.
    warned = exu.config.suppressWarnings
    exu.config.suppressWarnings = True
    try:
        with hooks.without_post_step():
            contact.initialise()
            ready = kernel.InitializeSolver(mbs, settings)
    finally:
        exu.config.suppressWarnings = warned
    if not ready:
        raise RuntimeError("Exudyn could not initialise its static solver for this system")
    data.SetODE2Coordinates(start)
    if multipliers.size:
        data.SetAECoordinates(multipliers)
    if states.size:
        data.SetDataCoordinates(states)
    return kernel

"""Ends a run of `mbs.SolveDynamic` that goes on in tiny steps because its tolerances lie below round-off."""

from __future__ import annotations

from collections.abc import Sequence

import exudyn as exu
import numpy as np

from tdcr_fe.elements.backbone import BackboneMesh

#: Round-off of the forces of an element, over its axial stiffness times the length of the backbone [1].
ROUND_OFF = 200.0 * float(np.finfo(float).eps)
#: A step is tiny where it is shorter than this part of the one that was asked for [1].
TINY = 0.01
#: So many tiny steps in a row end a run; after a sudden change a few of them are taken.
MOST = 50
#: Relative tolerance of Newton's method that round-off hardly ever prevents [1].
SAFE_TOLERANCE = 1e-7


def round_off(mesh: BackboneMesh) -> float:
    """Round-off of the generalised forces in the stiffest element of a backbone [N]."""
    return ROUND_OFF * float(mesh.arc_lengths[-1]) * float(np.max(mesh.stiffness[:, 0] / mesh.lengths))


class StepSizes:
    """Sizes of the steps of the run under way."""

    def __init__(self) -> None:
        self._last = 0.0
        self._tiny = 0

    def check(self, mbs: exu.MainSystem, t: float, meshes: Sequence[BackboneMesh]) -> None:
        """See a step that ended at a time [s].

        Parameters
        ----------
        mbs
            The system.
        t
            [s].
        meshes
            The backbones of its robots.

        Raises
        ------
        RuntimeError
            One of many tiny steps in a row, with tolerances below round-off; names what sets others.
        """
        size, self._last = t - self._last, t
        solver, settings = mbs.sys.get("dynamicSolver"), mbs.sys.get("simulationSettings")
        # Of a solver that ran before, as beside a static one, the time is another.
        running = solver is not None and settings is not None and solver.it.currentTime == t
        if not (running and meshes and 0.0 < size < TINY * _asked(settings)):
            self._tiny = 0
            return
        self._tiny += 1
        newton = settings.timeIntegration.newton
        limit = max(round_off(mesh) for mesh in meshes)
        if self._tiny < MOST or newton.relativeTolerance > SAFE_TOLERANCE or newton.absoluteTolerance > limit:
            return
        self._tiny = 0
        raise RuntimeError(
            f"{MOST} steps in a row were shorter than a hundredth of the step that was asked for, because Newton's "
            f"tolerances (relative {newton.relativeTolerance:g}, absolute {newton.absoluteTolerance:g}) lie below the "
            f"round-off of the backbone's forces ({limit:.1g} N); use arm.recommended_settings(end_time, step_size)"
        )


def _asked(settings: exu.SimulationSettings) -> float:
    """Step size that settings ask for in time [s]."""
    integration = settings.timeIntegration
    return float(integration.endTime - integration.startTime) / max(1, int(integration.numberOfSteps))

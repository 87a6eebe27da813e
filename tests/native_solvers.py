"""Settings of Exudyn's own solvers, and a robot whose tip is damped, for tests that use these solvers."""

import exudyn as exu
import exudyn.itemInterface as eii
from robots import scene_with

from tdcr_fe import TDCR, Robot


def damped(robot: Robot, damping: float = 0.03) -> tuple[exu.SystemContainer, exu.MainSystem, TDCR]:
    """A robot whose tip is damped against ground [N s/m]; by default near critical damping."""

    def damper(mbs: exu.MainSystem, handle: TDCR) -> None:
        both = [mbs.AddMarker(eii.MarkerBodyPosition(bodyNumber=mbs.CreateGround())), handle.mTip]
        values = {"stiffness": [0.0] * 3, "damping": [damping] * 3}
        mbs.AddObject(eii.CartesianSpringDamper(markerNumbers=both, **values))

    return scene_with(damper, robot)[:3]


def recommended(handle: TDCR, end: float, step: float) -> exu.SimulationSettings:
    """The robot's recommended settings up to an end [s], without output."""
    s = handle.recommended_settings(end, step)
    s.timeIntegration.verboseMode = s.staticSolver.verboseMode = 0
    s.solution.file.write = False
    return s

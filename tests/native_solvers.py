"""Settings of Exudyn's own solvers, and a robot whose tip is damped, for tests that use these solvers."""

import exudyn as exu
import exudyn.itemInterface as eii
from robots import scene_with

from tdcr_fe import TDCR, Robot


def static_settings(steps: int = 50) -> exu.SimulationSettings:
    """As docs/scenes.md advises."""
    s = exu.SimulationSettings()
    s.staticSolver.numberOfLoadSteps = steps
    s.staticSolver.newton.relativeTolerance = 1e-7
    s.staticSolver.newton.absoluteTolerance = 1e-9
    s.staticSolver.newton.maxIterations = 50
    s.staticSolver.verboseMode = 0
    s.solution.file.write = False
    return s


def dynamic_settings(end: float, step: float) -> exu.SimulationSettings:
    """As docs/scenes.md advises."""
    s = exu.SimulationSettings()
    s.timeIntegration.endTime = end
    s.timeIntegration.numberOfSteps = round(end / step)
    s.timeIntegration.generalizedAlpha.spectralRadius = 0.8
    s.timeIntegration.newton.relativeTolerance = 1e-6
    s.timeIntegration.newton.absoluteTolerance = 1e-8
    s.timeIntegration.verboseMode = 0
    s.solution.file.write = False
    return s


def damped(robot: Robot, damping: float = 0.03) -> tuple[exu.SystemContainer, exu.MainSystem, TDCR]:
    """A robot whose tip is damped against ground [N s/m]; by default near critical damping."""

    def damper(mbs: exu.MainSystem, handle: TDCR) -> None:
        both = [mbs.AddMarker(eii.MarkerBodyPosition(bodyNumber=mbs.CreateGround())), handle.mTip]
        values = {"stiffness": [0.0] * 3, "damping": [damping] * 3}
        mbs.AddObject(eii.CartesianSpringDamper(markerNumbers=both, **values))

    return scene_with(damper, robot)[:3]


def recommended(handle: TDCR, end: float, step: float, start: float = 0.0) -> exu.SimulationSettings:
    """The robot's recommended settings from a start to an end [s], without output."""
    s = handle.recommended_settings(end - start, step)
    s.timeIntegration.startTime, s.timeIntegration.endTime = start, end
    s.timeIntegration.verboseMode = 0
    s.solution.file.write = False
    return s

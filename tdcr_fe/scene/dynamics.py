"""Motion of a robot in time: damping by its material, and settings of `mbs.SolveDynamic` that suit it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import exudyn as exu
import numpy as np

from tdcr_fe.elements.backbone import BackboneMesh
from tdcr_fe.elements.native.hooks import round_off
from tdcr_fe.elements.native.items import SystemReference
from tdcr_fe.elements.native.material_damping import MaterialDamping
from tdcr_fe.model.robot import Robot

#: Up to this number of coordinates of a scene the linear equations are solved densely.
DENSE = 200


def add_material_damping(
    system: SystemReference, robot: Robot, mesh: BackboneMesh, nodes: Sequence[Any], name: str
) -> MaterialDamping | None:
    """Add the damping by the material of a backbone; None where the backbone has none.

    Parameters
    ----------
    system
        The system.
    robot, mesh
        Description and mesh.
    nodes
        Exudyn's numbers of the backbone nodes.
    name
        Of the robot.
    """
    if not robot.backbone.retardation_time > 0.0:
        return None
    retardation = np.full(len(mesh.lengths), robot.backbone.retardation_time)
    if robot.base_stiffness is not None:
        # The first element stands for the base that gives way, which is not of the material of the backbone.
        retardation[0] = 0.0
    return MaterialDamping(system, f"{name}.damping", nodes, retardation)


def recommended_settings(
    mesh: BackboneMesh, end_time: float, step_size: float, coordinates: int
) -> exu.SimulationSettings:
    """Settings for ``mbs.SolveDynamic``, whose tolerances are above the round-off of the stiffest element.

    Exudyn's defaults ask for a residual below round-off: the axial stiffness of a thin backbone turns the last digit of
    a node's position into a force, all the more so inside thick disks.

    Parameters
    ----------
    mesh
        The backbone.
    end_time, step_size
        [s].
    coordinates
        Number of ODE2 coordinates of the scene.

    Raises
    ------
    ValueError
        A time that is not positive and finite, or a step longer than the whole.
    """
    if not (np.isfinite(end_time) and 0.0 < step_size <= end_time):
        raise ValueError(
            f"recommended_settings: end_time = {end_time} s, step_size = {step_size} s; must be positive, and the step "
            "no longer than the whole"
        )
    settings = exu.SimulationSettings()
    integration = settings.timeIntegration
    integration.endTime = end_time
    integration.numberOfSteps = round(end_time / step_size)
    # After a sudden change the bending between the disks rings with a period shorter than the steps; without numerical
    # damping it goes on for long, and Newton's method then converges in very short steps only. Slow motion is not
    # damped: a vibration of a hundred steps a period loses 3e-5 of its amplitude in each.
    integration.generalizedAlpha.spectralRadius = 0.5
    integration.newton.relativeTolerance = 1e-6
    # Otherwise a first iteration that diverges sets the scale, and what follows counts as converged.
    integration.newton.adaptInitialResidual = False
    # A Jacobian left over from another step size, or from an iteration that diverged, costs more than a new one.
    integration.newton.modifiedNewtonJacUpdatePerStep = True
    # After a sudden change the step grows again as soon as two in a row have converged.
    integration.adaptiveStepRecoverySteps, integration.adaptiveStepRecoveryIterations = 2, 12
    # Friction couples nearly all coordinates of a robot; for one robot a dense factorisation is the fastest.
    solvers = exu.LinearSolverType
    settings.linearSolver.solverType = solvers.EigenDense if coordinates <= DENSE else solvers.EigenSparse
    integration.newton.absoluteTolerance = max(1e-8, round_off(mesh))
    return settings

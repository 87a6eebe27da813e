"""Settings of `mbs.SolveDynamic` that suit a robot."""

from __future__ import annotations

import exudyn as exu
import numpy as np

from tdcr_fe.elements.backbone import BackboneMesh

#: Round-off of the forces of an element, over its axial stiffness times the length of the backbone [1].
ROUND_OFF = 200.0 * float(np.finfo(float).eps)


def recommended_settings(mesh: BackboneMesh, end_time: float, step_size: float) -> exu.SimulationSettings:
    """Settings for ``mbs.SolveDynamic``, whose tolerances are above the round-off of the stiffest element.

    Exudyn's defaults ask for a residual below round-off: the axial stiffness of a thin backbone turns the last digit of
    a node's position into a force, all the more so inside thick disks.

    Parameters
    ----------
    mesh
        The backbone.
    end_time, step_size
        [s].

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
    integration.generalizedAlpha.spectralRadius = 0.8
    integration.newton.relativeTolerance = 1e-6
    stiffest = float(np.max(mesh.stiffness[:, 0] / mesh.lengths))
    integration.newton.absoluteTolerance = max(1e-8, ROUND_OFF * float(mesh.arc_lengths[-1]) * stiffest)
    return settings

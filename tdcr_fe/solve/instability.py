"""Unstable equilibria that a load step reached: where loads and weight compress the backbone, stability is computed.

A load step that passes the load at which a straight or nearly straight robot buckles can end in the equilibrium beyond
it, which is unstable. The sign of the tangent's determinant does not show this for a round backbone, of which two
eigenvalues change sign together (documentation, page "Theory"). The definiteness of the tangent in strain coordinates
shows it. It is computed only where loads and weight compress the backbone by a considerable part of Euler's load.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.linalg import LinAlgError, cholesky, eigvals

from tdcr_fe.model.loading import Model
from tdcr_fe.model.results import StepResult
from tdcr_fe.model.robot import Robot
from tdcr_fe.model.wording import steps_named
from tdcr_fe.solve.simulation import Simulation
from tdcr_fe.solve.stability import scaled_tangent

#: Compression over Euler's load from which stability is computed [1].
CONSIDERABLE = 0.25


def external_compression(robot: Robot, model: Model, step: StepResult) -> float:
    """Largest axial compression of the backbone by loads and weight, over Euler's load of the cantilever [1].

    Euler's load is ``pi^2 EI / (4 L^2)`` with the smallest bending stiffness of the backbone. Tendons are left out:
    their force turns with the backbone.

    Parameters
    ----------
    robot, model
        Description.
    step
        A solved step, with its loads in ``actuation``.
    """
    backbone, s = robot.backbone, step.s
    rotations = step.rotations
    beyond = np.zeros((len(s), 3))  # force on what lies beyond each node, itself included [N]
    for load in (step.actuation.loads if step.actuation is not None else {}).values():
        node = int(np.argmin(np.abs(s - load.at)))
        force = np.array(load.force)
        beyond[: node + 1] += rotations[node] @ force if load.frame == "section" else force
    middle = 0.5 * (s[1:] + s[:-1])
    mass = (
        backbone.mass_per_length
        * backbone.material_factors(middle)[1]
        * backbone.taper_factors(s)[1]
        * np.diff(s)
    )
    masses = np.append(0.0, mass)
    for at in robot.disks.positions:
        masses[int(np.argmin(np.abs(s - at)))] += robot.disks.mass
    masses[-1] += robot.tip_mass
    beyond += masses[::-1].cumsum()[::-1, None] * np.array(model.gravity)
    compression = -np.einsum("ni,ni->n", beyond, rotations[:, :, 2]).min()
    softest = float(np.min(backbone.stiffness_factors(middle)[0] * backbone.taper_factors(s)[0]))
    euler = np.pi**2 * backbone.EI * softest / (4.0 * backbone.length**2)
    return float(max(compression, 0.0) / euler)


def is_unstable(simulation: Simulation, step: StepResult) -> bool:
    """Whether the present state, the end of this step, is an unstable equilibrium under considerable compression.

    With friction, what counts is the tangent with the holes' present mobilisation (see `stability`).
    """
    robot, model = simulation.handle.robot, simulation.handle.model
    if external_compression(robot, model, step) < CONSIDERABLE:
        return False
    tangent = scaled_tangent(simulation)[0]
    try:
        cholesky(tangent + tangent.T, lower=True)
    except LinAlgError:
        return bool(np.min(eigvals(tangent).real) < 0.0)
    return False


def instability_warnings(numbers: Sequence[int]) -> list[str]:
    """A sentence on the steps that ended in an unstable equilibrium; none where there are none."""
    if not numbers:
        return []
    return [
        f"{steps_named(numbers)}: the equilibrium is unstable: loads or weight compress the backbone beyond its "
        "buckling load, and a real robot takes another shape. To find it, apply a sideways force of some percent of "
        "the load first, then the load in small steps"
    ]

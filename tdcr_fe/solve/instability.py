"""Unstable equilibria that a load step reached: where loads and weight compress the backbone, stability is computed.

A load step that passes the load at which a straight or nearly straight robot buckles can end in the equilibrium beyond
it, which is unstable. The sign of the tangent's determinant does not show this for a round backbone, of which two
eigenvalues change sign together (documentation, page "Theory"). The definiteness of the tangent in strain coordinates
shows it. It is computed only where loads and weight compress the backbone by a considerable part of Euler's load.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import LinAlgError, cholesky, eigvals

from tdcr_fe.model.messages import steps_named
from tdcr_fe.model.results import StepResult
from tdcr_fe.scene.motion import Masses
from tdcr_fe.solve.simulation import Simulation
from tdcr_fe.solve.stability import scaled_tangent

Array = NDArray[np.float64]

#: Compression over Euler's load from which stability is computed [1].
CONSIDERABLE = 0.25


@dataclass(frozen=True)
class ExternalCompression:
    """Axial compression of the backbone by loads and weight; tendons are left out: their force turns with the backbone.

    Attributes
    ----------
    mass_beyond : ndarray, shape (N,)
        Of what lies beyond each node, itself included [kg].
    gravity : ndarray, shape (3,)
        [m/s^2].
    euler : float
        Euler's load of the cantilever, ``pi^2 EI / (4 L^2)`` with the smallest bending stiffness of the backbone [N].
    """

    mass_beyond: Array
    gravity: Array
    euler: float

    @classmethod
    def of(cls, simulation: Simulation) -> ExternalCompression:
        """Of the robot of a simulation and its mesh."""
        handle = simulation.handle
        backbone, mesh = handle.robot.backbone, handle.actuation.mesh
        masses = Masses.of(handle.robot, handle.actuation, handle.model.gravity)
        of_nodes = masses.of_nodes + np.append(0.0, masses.of_elements)
        middle = 0.5 * (mesh.arc_lengths[1:] + mesh.arc_lengths[:-1])
        bending = backbone.stiffness_factors(middle)[0] * backbone.taper_factors(mesh.arc_lengths)[0]
        euler = np.pi**2 * backbone.EI * float(np.min(bending)) / (4.0 * backbone.length**2)
        return cls(of_nodes[::-1].cumsum()[::-1], masses.gravity, float(euler))

    def ratio(self, step: StepResult) -> float:
        """Largest compression in a solved step, with its loads in ``actuation``, over Euler's load [1]."""
        rotations = step.rotations
        beyond = self.mass_beyond[:, None] * self.gravity  # force on what lies beyond each node [N]
        for load in (step.actuation.loads if step.actuation is not None else {}).values():
            node = int(np.argmin(np.abs(step.s - load.at)))
            force = np.array(load.force)
            beyond[: node + 1] += rotations[node] @ force if load.frame == "section" else force
        compression = -np.einsum("ni,ni->n", beyond, rotations[:, :, 2]).min()
        return float(max(compression, 0.0) / self.euler)


def is_unstable(simulation: Simulation, compression: ExternalCompression, step: StepResult) -> bool:
    """Whether the present state, the end of this step, is an unstable equilibrium under considerable compression.

    With friction, what counts is the tangent with the holes' present mobilisation (see `stability`).
    """
    if compression.ratio(step) < CONSIDERABLE:
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

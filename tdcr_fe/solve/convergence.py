"""When an iteration has converged: sizes of residuals and steps relative to their scales, and the test itself."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tdcr_fe.elements.actuation import TendonActuation
from tdcr_fe.elements.forces import TendonForces
from tdcr_fe.elements.friction import FrictionState
from tdcr_fe.model.settings import SolverSettings
from tdcr_fe.solve.reduction import BodyFrameReduction

Array = NDArray[np.float64]

#: Largest allowed distance of a mobilisation from the one that its slip leads to [1].
FRICTION_TOLERANCE = 1e-4
#: Only below this relative residual may an iteration end because its steps have become too small [1].
STALLED_RESIDUAL = 1e-3


@dataclass(frozen=True)
class ResidualScales:
    """What residuals are compared with.

    Attributes
    ----------
    weights : ndarray
        By unknown: forces by one, moments by a lever of a fiftieth of the length, gaps in joints by the length.
    nodes : int
        Number of beam nodes.
    forces : int
        Number of unknowns whose residual is a force or moment; gaps follow.
    length : float
        Of the longest backbone [m].
    elastic_force : float
        EI / L^2 of the softest robot, the smallest scale of forces [N].
    """

    weights: Array
    nodes: int
    forces: int
    length: float
    elastic_force: float

    @classmethod
    def of(cls, robots: Sequence[TendonActuation], reduction: BodyFrameReduction) -> ResidualScales:
        """Scales of a scene."""
        length = max(float(r.mesh.arc_lengths[-1]) for r in robots)
        nodes = np.tile(np.repeat((1.0, 50.0 / length), 3), reduction.nodes)
        other = np.ones(len(reduction.other_coordinates))
        gaps = np.full(len(reduction.other_multipliers), 1.0 / length)
        elastic = min(
            float(np.min(r.mesh.stiffness[:, 5])) / float(r.mesh.arc_lengths[-1]) ** 2 for r in robots
        )
        return cls(
            np.concatenate((nodes, other, gaps)), reduction.nodes, len(nodes) + len(other), length, elastic
        )

    def relative_residual(self, unbalanced: Array, base_tension: Sequence[Array], load_size: float) -> float:
        """Largest unbalanced force, moment or gap over its scale [1].

        Parameters
        ----------
        unbalanced
            Reduced residual.
        base_tension
            By robot [N].
        load_size
            Size of the applied loads [N].
        """
        size = np.abs(unbalanced * self.weights)
        largest = max((max(t.tolist(), default=0.0) for t in base_tension), default=0.0)
        scale = largest + self.elastic_force + load_size
        if size.size == self.forces:
            return float(size.max()) / scale
        return max(float(size[: self.forces].max()) / scale, float(size[self.forces :].max()))

    def displacement_error(self, forces: TendonForces, displacement: Array, which: NDArray[np.int_]) -> float:
        """Largest deviation from prescribed tendon displacements over the length [1].

        Taut: the displacement is met. Slack: the base has let out more than the tendon needs.

        Parameters
        ----------
        forces
            Of the robot.
        displacement
            Of every tendon [m], shape (m,).
        which
            The tendons whose displacement is prescribed.
        """
        gap = (forces.field.base_slip - displacement)[which]
        error = np.where(forces.base_tension[which] > 0.0, np.abs(gap), np.maximum(-gap, 0.0))
        return float(np.max(error)) / self.length

    def step_size(self, step: Array) -> float:
        """Largest displacement over the length, or rotation, of any node in a step [1]."""
        largest = np.abs(step[: 6 * self.nodes].reshape(-1, 6)).max(axis=0).tolist()
        return max(max(largest[:3]) / self.length, *largest[3:])


def friction_error(
    forces: Sequence[TendonForces],
    mobilisation: Sequence[Array],
    history: Sequence[FrictionState],
    presliding: float,
) -> float:
    """Largest distance of any mobilisation from the one that its slip leads to [1], by robot as in `SolverState`."""
    worst = 0.0
    for own, s, before in zip(forces, mobilisation, history, strict=True):
        law = own.model.law
        if law.has_friction:
            trial = law.trial_mobilisation(own.field.slip, before, presliding)
            worst = max(worst, float((np.abs(trial.clip(-1.0, 1.0) - s) * law.frictional).max()))
    return worst


def balanced(residual: float, settings: SolverSettings) -> bool:
    """Whether forces, gaps and prescribed displacements are met within the tolerance."""
    return residual <= settings.tolerance


def stalled(residual: float, step: Array, scales: ResidualScales, settings: SolverSettings) -> bool:
    """Whether a step is so small that what is left of the residual is round-off of very stiff parts.

    Parameters
    ----------
    residual
        Relative residual before the step [1].
    step
        Change of the unknowns.
    scales
        Of the scene.
    settings
        Of the solver.
    """
    return residual < STALLED_RESIDUAL and scales.step_size(step) <= settings.step_tolerance

"""Stability of a solved state: the smallest eigenvalue of the tangent in strain coordinates.

An equilibrium of a robot whose forces have a potential (no friction) is stable where the potential has a minimum:
its Hessian, restricted to what the base joint and driven tendons leave free, is positive definite. The Hessian is
taken in the twists of the elements, where the linear elastic energy of a straight rod is diagonal, and measured
against that energy,

    lambda_min = min over all changes of shape of (second variation of the potential) / (2 x elastic energy),

which is dimensionless: 1 for the unloaded rod, 0 where an equilibrium loses its stability. For a column under an
axial force P it is 1 - P / P_cr.

With friction the forces have no potential and the tangent is not symmetric. What is given then belongs to the
tangent along which the robot moves while every hole keeps its mobilisation: `Stability.smallest` is the smallest
eigenvalue of its symmetric part (positive: the second-order work of every disturbance is positive, which is
sufficient for stability, R. Hill, J. Mech. Phys. Solids 6 (1958) 236-249), and `Stability.divergence` the smallest
real part of its eigenvalues (zero: a static bifurcation or limit point). Sticking holes restrain the tendon in
addition, so the robot at rest is stiffer than this tangent.

A load step that passes the load at which a straight or nearly straight robot buckles can end in the equilibrium beyond
it, which is unstable. The sign of the tangent's determinant does not show this for a round backbone, of which two
eigenvalues change sign together (docs/theory.md, section "Stability"). The definiteness of the tangent in strain
coordinates shows it. It is computed only where loads and weight compress the backbone by a considerable part of
Euler's load.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import LinAlgError, cholesky, eigh, eigvals, null_space

from tdcr_fe.elements import Array
from tdcr_fe.elements.backbone import strain_matrices
from tdcr_fe.model.messages import steps_named
from tdcr_fe.model.results import StepResult
from tdcr_fe.scene.energy import Masses
from tdcr_fe.solve.newton.unstable_motions import ROUND_OFF
from tdcr_fe.solve.simulation import Simulation

#: Compression over Euler's load from which stability is computed [1].
CONSIDERABLE = 0.25


@dataclass(frozen=True)
class Stability:
    """Stability of one state, in units of the linear elastic stiffness of the backbone.

    Attributes
    ----------
    smallest : float
        Smallest eigenvalue of the symmetric part of the tangent: 1 unloaded, 0 critical, below 0 unstable [1].
    divergence : float
        Smallest real part of the eigenvalues of the tangent itself; equal to `smallest` where the forces have a
        potential [1].
    asymmetry : float
        Norm of the skew part over that of the symmetric part [1]; zero where the forces have a potential.
    mode : ndarray, shape (N, 3)
        Displacement of the backbone nodes in the direction of the smallest eigenvalue, largest one 1, world axes
        [1].
    """

    smallest: float
    divergence: float
    asymmetry: float
    mode: Array

    @property
    def stable(self) -> bool:
        """Whether the smallest eigenvalue is positive."""
        return self.smallest > 0.0


def stability(simulation: Simulation) -> Stability:
    """Smallest eigenvalue of the tangent of a solved state, see the module's text.

    Parameters
    ----------
    simulation
        At an equilibrium.
    """
    scaled, free_to_nodes = scaled_tangent(simulation)
    symmetric = 0.5 * (scaled + scaled.T)
    skew = 0.5 * (scaled - scaled.T)
    asymmetry = float(np.linalg.norm(skew) / np.linalg.norm(symmetric))
    values, vectors = eigh(symmetric, subset_by_index=[0, 0])
    smallest = float(values[0])
    divergence = smallest if asymmetry < 1e-9 else float(np.min(eigvals(scaled).real))
    moved = (free_to_nodes @ vectors[:, 0]).reshape(-1, 6)[:, :3]
    rotations = simulation.state.configuration.poses[0][1]
    world = np.einsum("nij,nj->ni", rotations[1:], moved)
    mode = np.concatenate((np.zeros((1, 3)), world))
    return Stability(smallest, divergence, asymmetry, mode / np.max(np.abs(mode)))


def scaled_tangent(simulation: Simulation) -> tuple[Array, Array]:
    """Tangent by the changes of shape that displacement-driven tendons leave free, in units of the elastic stiffness.

    Returns
    -------
    tangent : ndarray, shape (k, k)
        The identity for the unloaded rod [1].
    to_nodes : ndarray, shape (6 (N-1), k)
        From these changes of shape to body-frame increments of the nodes 1 .. N-1.
    """
    system, state, robot = simulation.system, simulation.state, simulation.handle.actuation
    residual = system.residual(state, state.target, system.numbering())
    nodes = slice(6, 6 * system.layout.reduction.nodes)
    by_nodes = -system.tangent(residual)[nodes, nodes]
    blocks, mesh = strain_matrices(state.configuration.twists[0]), robot.mesh
    to_twists = np.zeros((6 * len(blocks), 6 * len(blocks) + 6))
    for e, block in enumerate(blocks):
        to_twists[6 * e : 6 * e + 6, 6 * e : 6 * e + 12] = block
    # The base stays where it is.
    weight = np.sqrt((mesh.lengths[:, None] / mesh.stiffness).ravel())
    to_nodes: Array = np.linalg.solve(to_twists[:, 6:], np.diag(weight))
    taut = robot.drives.winds & (robot.base_tension > 0.0)
    if np.any(taut):
        # A tendon with prescribed displacement keeps its length: only changes of shape that leave it are free.
        fixed = residual.forces[0].slip_equations(holes=False).rows[taut][:, 6:] @ to_nodes
        to_nodes = to_nodes @ null_space(fixed)
    return to_nodes.T @ by_nodes @ to_nodes, to_nodes


@dataclass(frozen=True)
class ExternalCompression:
    """Axial compression of the backbone by loads and weight, without tendons: their force turns with the backbone."""

    mass_beyond: Array  # (N,): Of what lies beyond each node, itself included [kg]
    gravity: Array  # (3,): [m/s^2]
    # Euler's load of the cantilever, ``pi^2 EI / (4 L^2)`` with the smallest bending stiffness of the backbone
    # [N]
    euler: float

    @classmethod
    def of(cls, simulation: Simulation) -> ExternalCompression:
        """Compression of the robot of a simulation, on its mesh."""
        handle = simulation.handle
        backbone, mesh = handle.robot.backbone, handle.actuation.mesh
        masses = Masses.of(handle.robot, mesh, handle.model.gravity)
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


def buckled_under_loads(simulation: Simulation, compression: ExternalCompression, step: StepResult) -> bool:
    """Whether the present state, the end of this step, is an unstable equilibrium under considerable compression.

    With friction, what counts is the tangent with the holes' present mobilisation (see `stability`).
    """
    if compression.ratio(step) < CONSIDERABLE:
        return False
    tangent = scaled_tangent(simulation)[0]
    try:
        cholesky(tangent + tangent.T, lower=True)
    except LinAlgError:
        return bool(np.min(eigvals(tangent).real) < -ROUND_OFF)
    return False


def instability_warnings(numbers: Sequence[int]) -> list[str]:
    """A sentence on the steps that ended in an unstable equilibrium; none where there are none."""
    if not numbers:
        return []
    return [
        f"{steps_named(numbers)}: the equilibrium is unstable: loads, weight or tendons compress the backbone beyond "
        "its buckling load, and a real robot takes another shape. To find it, apply a sideways force of some percent "
        "of the load first, then load and tensions in small steps"
    ]

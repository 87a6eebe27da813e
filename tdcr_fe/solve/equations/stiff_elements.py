"""Solutions with the tangent of a robot whose disks are thick, without the round-off of the stiff inserts.

The inserts are up to 1e5 times stiffer than the backbone. Added to the tangent, their stiffness leaves a round-off that
is a millionth of the softest modes. Here they are as soft as the backbone in the tangent, and forces make up for the
difference: with ``B`` from increments of the nodes to twists of the inserts, and the difference of stiffness ``D``,

    (K - B^T D B) x = r   is   K x - B^T f = r,   B x - D^-1 f = 0 .

A change of the inserts' unloaded twists makes ``r`` as large as their stiffness; nearly all of it is ``B^T g`` with
forces ``g`` in the inserts. With these taken off,

    K x - B^T (f + g) = r - B^T g,   B x - D^-1 (f + g) = -D^-1 g ,

no large parts have to cancel each other in ``x``.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import lu_factor, lu_solve

from tdcr_fe.elements.backbone import INSERT_FACTORS, BackboneMesh, strain_matrices
from tdcr_fe.elements.forces import TendonForces
from tdcr_fe.solve.equations.linearization import Linearization
from tdcr_fe.solve.equations.numbering import Numbering, zero_bases
from tdcr_fe.solve.equations.residual import Residual
from tdcr_fe.solve.equations.system import SceneSystem

Array = NDArray[np.float64]
Solve = Callable[[Array], Array]
#: Elements that bend this many times less than the softest one are stiff [1].
STIFF = 1e3


@dataclass(frozen=True)
class RelaxedMesh(BackboneMesh):
    """A backbone some of whose elements are softer and transmit the same forces in one configuration.

    Attributes
    ----------
    relaxed_stiffness : ndarray, shape (E, 6)
        By the twists [N/m, N m].
    relaxed_twists : ndarray, shape (E, 6)
        Unloaded twists.
    """

    relaxed_stiffness: Array
    relaxed_twists: Array

    @property
    def twist_stiffness(self) -> Array:
        """See `BackboneMesh.twist_stiffness`."""
        return self.relaxed_stiffness

    @property
    def reference_twists(self) -> Array:
        """See `BackboneMesh.reference_twists`."""
        return self.relaxed_twists


def linearize(system: SceneSystem, residual: Residual, numbering: Numbering) -> tuple[Linearization, Solve]:
    """Linearise a solved state; the linearisation, and the solution for several right sides.

    Parameters
    ----------
    system, residual, numbering
        As of `SceneSystem.linearize`.

    Raises
    ------
    numpy.linalg.LinAlgError
        The tangent is singular.
    """
    stiff = [_stiff(own.model.mesh) for own in residual.forces]
    if not any(s.any() for s in stiff) or not system.tangent_follows_from_elements():
        linear = system.linearize(residual, numbering)
        return linear, linear.factorisation.solve
    relaxed, rows, differences = [], [], []
    for i, (own, which) in enumerate(zip(residual.forces, stiff, strict=True)):
        twists = residual.state.configuration.twists[i]
        softer, difference = _relaxed(own, which, twists)
        relaxed.append(softer)
        differences.append(difference)
        first = numbering.robots[i].nodes.start
        for e, block in zip(np.flatnonzero(which), strain_matrices(twists[which]), strict=True):
            row = np.zeros((6, numbering.linear))
            row[:, first + 6 * e : first + 6 * e + 12] = block
            rows.append(row)
    linear = system.linearize(residual._replace(forces=tuple(relaxed)), numbering)
    to_twists = np.concatenate(rows)
    loads = np.asfortranarray(to_twists.T)
    zero_bases(loads, system.layout.clamped)
    by_force = linear.factorisation.solve(loads)
    softness = 1.0 / np.concatenate(differences)
    factors = lu_factor(np.diag(softness) - to_twists @ by_force)
    onto_forces = lu_factor(loads.T @ loads)

    def solve(right: Array) -> Array:
        forces = np.zeros((len(softness), *right.shape[1:]))
        for _ in range(2):  # the second pass takes off what round-off leaves of the first
            left = right - loads @ forces
            forces += lu_solve(onto_forces, loads.T @ left)
        start = linear.factorisation.solve(right - loads @ forces)
        twists = to_twists @ start + (softness * forces.T).T
        return np.asarray(start + by_force @ lu_solve(factors, twists))

    return linear, solve


def _stiff(mesh: BackboneMesh) -> NDArray[np.bool_]:
    """Which elements are stiff, shape (E,)."""
    bending = mesh.stiffness[:, 4]
    return np.asarray(bending > STIFF * bending.min())


def _relaxed(own: TendonForces, which: NDArray[np.bool_], twists: Array) -> tuple[TendonForces, Array]:
    """Forces with a relaxed mesh, and the stiffness that is taken off, shape (6 k,)."""
    mesh = own.model.mesh
    stiffness, reference = mesh.twist_stiffness.copy(), mesh.reference_twists.copy()
    whole = stiffness[which]
    stiffness[which] = whole / INSERT_FACTORS
    reference[which] = twists[which] - (twists[which] - reference[which]) * INSERT_FACTORS
    same = {f.name: getattr(mesh, f.name) for f in fields(BackboneMesh)}
    softer = RelaxedMesh(**same, relaxed_stiffness=stiffness, relaxed_twists=reference)
    return own._replace(model=replace(own.model, mesh=softer)), (whole - stiffness[which]).ravel()

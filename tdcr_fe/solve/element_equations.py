"""The Cosserat equations along every element of a backbone: stiffness, forces, and accurate integration."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tdcr_fe.elements import Array, Flags, Index
from tdcr_fe.elements.backbone import POINTS, WEIGHTS, add_residual_flexibility
from tdcr_fe.elements.forces import ForceModel
from tdcr_fe.elements.material import Material
from tdcr_fe.elements.poses import TWIST_MATRIX, coefficients, cross, exp_matrix, skew
from tdcr_fe.scene import TDCR


def _collocation_matrix() -> Array:
    """Integrals from 0 to every Gauss point of the polynomial through values at these points, shape (4, 4)."""
    powers = np.arange(len(POINTS))
    values = POINTS[:, None] ** powers
    integrals = POINTS[:, None] ** (powers + 1) / (powers + 1)
    return np.asarray(np.linalg.solve(values.T, integrals.T).T)


_INTEGRALS = np.concatenate((_collocation_matrix(), WEIGHTS[None]))
#: Components of a strain in which fibres along the backbone are strained: stretch and both curvatures.
_FIBRES = [0, 4, 5]
#: The pose of no motion, row by row, without its last row.
_IDENTITY: Array = np.eye(3, 4).ravel()
#: Fixed-point iterations of the collocation equations.
SWEEPS = 8


@dataclass(frozen=True)
class ElementModel:
    """Forces, weight and bays of the elements of one backbone."""

    forces: ForceModel  # Mesh, tendons that follow the backbone, and nonlinear material
    flexible: Flags  # (E,): False in rigid inserts, which have no error
    weight: Array  # (E, 3): Own weight of the elements per length, world axes [N/m]
    bays: Index  # (E,): Number of the bay that an element lies in, from 0
    buckling_lengths: Array  # (B,): Length ``a`` of the load ``pi^2 EI / a^2`` at which a bay buckles [m]

    @classmethod
    def of(cls, handle: TDCR) -> ElementModel:
        """The elements of a robot in a scene, with their current compliance."""
        mesh, robot = handle.actuation.mesh, handle.robot
        middle = 0.5 * (mesh.arc_lengths[1:] + mesh.arc_lengths[:-1])
        bays = np.searchsorted(np.asarray(robot.bay_ends, dtype=float), middle)
        free = np.bincount(bays, mesh.lengths * ~handle.rigid).astype(float)
        if robot.without_disks:
            free[:] = 2.0 * free.sum()
        elif robot.disks.positions[-1] < mesh.arc_lengths[-1] - 1e-9:
            free[-1] *= 2.0
        return cls(
            handle.actuation.model,
            ~handle.rigid,
            mesh.mass_per_length[:, None] * np.asarray(handle.model.gravity, dtype=float),
            bays,
            free,
        )


def _strain_under(law: Material, wrench: Array, strain: Array, unloaded: Array, compliance: Array) -> Array:
    """Stretch and curvatures of a nonlinear material under a wrench, by a Newton step from known ones, (S, E, 4, 3)."""
    points, known = law.at_points(), strain[..., _FIBRES]
    change = (strain - unloaded)[..., _FIBRES]
    linear = np.broadcast_to(1.0 / compliance[..., _FIBRES], known.shape)
    missing = wrench[..., _FIBRES] - change * linear - points.wrench(change[..., 0], change[..., 1:])
    slope = points.stiffness(change[..., 0], change[..., 1:]) + linear[..., None] * np.eye(3)
    return known + np.linalg.solve(slope, missing[..., None])[..., 0]


def stiffness_times(forces: ForceModel, twists: Array, strain: Array) -> Array:
    """Stiffness of the elements times changes of their twists, shape (S, E, 6)."""
    force = forces.mesh.twist_stiffness * strain
    if forces.section is not None and forces.section.material is not None:
        material, h = forces.section.material, forces.mesh.lengths
        slope = material.stiffness(*material.strain(twists, h)) / h[:, None, None]
        force[..., _FIBRES] += (slope @ strain[..., _FIBRES, None])[..., 0]
    return force


def exact_elements(
    model: ElementModel, twists: Array, wrenches: Array, weight: Array, tensions: Array
) -> tuple[Array, Array]:
    """Integrate the Cosserat equations along every element under the wrench at its first node.

    Parameters
    ----------
    model
        The elements.
    twists
        Of the finite elements, where the iteration starts, shape (S, E, 6).
    wrenches
        At the first node, in its frame, shape (S, E, 6).
    weight
        Own weight per length in the frame of the first node [N/m], shape (S, E, 3).
    tensions
        At the base [N], shape (S, m).

    Returns
    -------
    ends : ndarray, shape (S, E, 3, 4)
        Rotation and position of the last node in the frame of the first.
    moments : ndarray, shape (S, E, 3)
        First moment of the curve: integral of its position over the element [m^2].
    """
    section, mesh, h = model.forces.section, model.forces.mesh, model.forces.mesh.lengths[:, None]
    stiffness = mesh.stiffness.copy()
    # Of the section itself: without the residual flexibility of bending in the shear.
    add_residual_flexibility(stiffness, mesh.lengths, -1.0)
    compliance = (1.0 / stiffness)[:, None, :]
    unloaded = (mesh.reference_twists / h)[:, None, :]
    start = twists[..., None, :] * POINTS[:, None]
    poses = exp_matrix(start, coefficients(start[..., 3:]))[..., :3, :]
    strain = np.broadcast_to((twists / h)[..., None, :], start.shape)
    force, moment = wrenches[..., None, :3], wrenches[..., None, 3:]
    along = (h * POINTS)[..., None]
    integrals = _INTEGRALS * h[..., None]
    heavy = bool(np.any(model.weight))
    both = np.empty((*start.shape[:-1], 2, 3))
    both[..., 0, :] = force - weight[..., None, :] * along
    moments = np.zeros((*twists.shape[:-1], 3))
    arm = skew(force)
    for _ in range(SWEEPS):
        p = poses[..., 3]
        both[..., 1, :] = moment + (arm @ p[..., None])[..., 0]
        if heavy:
            below = integrals @ p
            moments = below[..., -1, :]
            both[..., 1, :] += cross(along * p - below[..., :-1, :], weight[..., None, :])
        wrench = (both @ poses[..., :3]).reshape(start.shape)
        if section is not None and section.tendons is not None:
            wrench = wrench - np.einsum("sm,ms...->s...", tensions, section.tendons.along(strain)[1])
        new = unloaded + wrench * compliance
        if section is not None and section.material is not None:
            new[..., _FIBRES] = _strain_under(section.material, wrench, strain, unloaded, compliance)
        strain = new
        rates = poses[..., :3] @ strain.dot(TWIST_MATRIX[:, :12]).reshape(*start.shape[:-1], 3, 4)
        every = integrals @ rates.reshape(*start.shape[:-1], 12)
        every += _IDENTITY
        every = every.reshape(*every.shape[:-1], 3, 4)
        poses, ends = every[..., :-1, :, :], every[..., -1, :, :]
    return ends, moments

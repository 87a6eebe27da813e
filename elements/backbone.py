"""The backbone: mesh, beam elements on Euler-parameter nodes, and their kinematics in strain space.

Exudyn's beams have their axis along the local x axis, so a node's frame is the section frame of the robot
with the axes renamed: beam (x, y, z) = section (z, x, y).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import exudyn as exu
import exudyn.itemInterface as eii
import numpy as np
from numpy.typing import NDArray

from tdcr_fe.elements.poses import (
    adjoint_inverse,
    euler_parameters_of_rotation,
    exp_se3,
    inverse_tangent_se3,
    log_se3,
)

Array = NDArray[np.float64]

#: Rotation from beam axes to section axes: its columns are the beam's axes in the section frame.
BEAM_TO_SECTION = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])

#: How much stiffer a rigid insert is than the backbone: axial and shear, torsion and bending. Stiff enough that
#: the insert bends a hundred-thousandth as much, soft enough that round-off does not become force.
INSERT_FACTORS = np.array([1e2, 1e2, 1e2, 1e5, 1e5, 1e5])


@dataclass(frozen=True)
class BackboneMesh:
    """Nodes and elements along the backbone.

    Attributes
    ----------
    arc_lengths : ndarray, shape (N,)
        Of the nodes, ascending, base first [m].
    stiffness : ndarray, shape (N-1, 6)
        Of every element, in beam axes: axial, shear, shear [N], torsion, bending, bending [N m^2].
    mass_per_length : float
        [kg/m].
    rotary_inertia : ndarray, shape (3,)
        Per length, about the beam's axes [kg m].
    precurvature : ndarray, shape (3,)
        Curvature of the unloaded state in beam axes [1/m].
    """

    arc_lengths: Array
    stiffness: Array
    mass_per_length: float
    rotary_inertia: Array
    precurvature: Array

    @property
    def lengths(self) -> Array:
        """Lengths of the elements [m], shape (N-1,)."""
        return np.diff(self.arc_lengths)

    @property
    def reference_twists(self) -> Array:
        """Unloaded relative twist of every element, length times strain, shape (N-1, 6)."""
        strain = np.concatenate(([1.0, 0.0, 0.0], self.precurvature))
        return self.lengths[:, None] * strain

    def node_at(self, s: float, tolerance: float = 1e-9) -> int:
        """Number of the node at an arc length [m]; `KeyError` where there is none."""
        k = int(np.argmin(np.abs(self.arc_lengths - s)))
        if abs(self.arc_lengths[k] - s) > tolerance:
            raise KeyError(f"no backbone node at s = {s:g} m; the nearest is at {self.arc_lengths[k]:.9g} m")
        return k


def subdivide(
    length: float,
    disks: Sequence[float],
    elements_per_bay: int,
    thickness: float = 0.0,
    extra: Sequence[float] = (),
    tolerance: float = 1e-9,
) -> tuple[Array, NDArray[np.bool_]]:
    """Arc lengths of nodes, and which elements are rigid inserts.

    Parameters
    ----------
    length
        Of the backbone [m].
    disks
        Arc lengths of the disks [m].
    elements_per_bay
        Elements between neighbouring disks (between their faces where they are thick).
    thickness
        Of the rigid insert at every disk [m].
    extra
        Further arc lengths where a node is wanted, such as loads [m].
    tolerance
        Nodes closer than this are one [m].

    Returns
    -------
    arc_lengths : ndarray, shape (N,)
    rigid : ndarray of bool, shape (N-1,)
    """
    faces = [0.0]
    inserts: list[tuple[float, float]] = []
    for s in disks:
        low, high = max(s - thickness / 2.0, 0.0), min(s + thickness / 2.0, length)
        faces += [low, s, high]
        if thickness > 0.0:
            inserts.append((low, high))
    faces.append(length)
    bounds = np.array(faces)
    bounds = bounds[np.concatenate(([True], np.diff(bounds) > tolerance))]
    nodes: list[float] = [0.0]
    for a, b in zip(bounds[:-1], bounds[1:], strict=True):
        rigid = any(lo - tolerance <= a and b <= hi + tolerance for lo, hi in inserts)
        parts = 1 if rigid else elements_per_bay
        nodes += [float(a + (b - a) * i / parts) for i in range(1, parts + 1)]
    for s in extra:
        if min(abs(s - x) for x in nodes) > tolerance:
            nodes.append(float(s))
    arc = np.array(sorted(nodes))
    middle = 0.5 * (arc[1:] + arc[:-1])
    is_rigid = np.zeros(middle.size, dtype=bool)
    for lo, hi in inserts:
        is_rigid |= (middle > lo) & (middle < hi)
    return arc, is_rigid


def reference_poses(mesh: BackboneMesh, position: Array, rotation: Array) -> tuple[Array, Array]:
    """World poses of all nodes in the unloaded state.

    Parameters
    ----------
    mesh
        The backbone.
    position, rotation
        Of the base, the rotation in beam axes; shapes (3,) and (3, 3).

    Returns
    -------
    positions : ndarray, shape (N, 3)
    rotations : ndarray, shape (N, 3, 3)
    """
    return chain_poses(position, rotation, mesh.reference_twists)


def chain_poses(position: Array, rotation: Array, twists: Array) -> tuple[Array, Array]:
    """Poses of all nodes from the base and the relative twist of every element, by exact exponentials."""
    relative_r, relative_p = exp_se3(twists)
    count = len(twists) + 1
    positions, rotations = np.empty((count, 3)), np.empty((count, 3, 3))
    positions[0], rotations[0] = position, rotation
    p, r = position, rotation
    for k in range(count - 1):
        p = p + r.dot(relative_p[k])
        r = r.dot(relative_r[k])
        positions[k + 1] = p
        rotations[k + 1] = r
    return positions, rotations


def relative_twists(positions: Array, rotations: Array) -> Array:
    """Relative twist of every element from the poses of its nodes, shape (N-1, 6)."""
    inverse = np.swapaxes(rotations[:-1], 1, 2)
    r = inverse @ rotations[1:]
    p = (inverse @ np.diff(positions, axis=0)[..., None])[..., 0]
    return log_se3(r, p)


def twist_increments(twists: Array, increments: Array) -> Array:
    """Linearised change of the elements' twists for body-frame increments of the nodes.

    Parameters
    ----------
    twists
        Of the elements, shape (N-1, 6).
    increments
        Twists ``[v, w]`` of the nodes in their own frames, shape (N, 6).
    """
    relative = exp_se3(twists)
    moved = increments[1:] - (adjoint_inverse(*relative) @ increments[:-1, :, None])[..., 0]
    return (inverse_tangent_se3(twists) @ moved[..., None])[..., 0]


def strain_matrices(twists: Array) -> Array:
    """Matrices that take the twists of both nodes to the change of the element's twist, shape (..., 6, 12)."""
    tangent = inverse_tangent_se3(twists)
    return np.concatenate((-tangent @ adjoint_inverse(*exp_se3(twists)), tangent), axis=-1)


@dataclass(frozen=True)
class BackboneItems:
    """What `add_backbone` made: Exudyn's node and object numbers."""

    nodes: list[Any]
    beams: list[Any]


def add_backbone(
    mbs: exu.MainSystem,
    mesh: BackboneMesh,
    position: Array,
    rotation: Array,
    name: str,
    draw_radius: float,
    color: Sequence[float],
) -> BackboneItems:
    """Add nodes and beam elements to a system.

    Parameters
    ----------
    mbs
        The system.
    mesh
        The backbone.
    position, rotation
        Of the base, the rotation in section axes; shapes (3,) and (3, 3).
    name
        Prefix of the items' names.
    draw_radius
        Radius to draw [m].
    color
        RGBA.
    """
    positions, rotations = reference_poses(mesh, position, rotation @ BEAM_TO_SECTION)
    parameters = euler_parameters_of_rotation(rotations)
    nodes = [
        mbs.AddNode(
            eii.NodeRigidBodyEP(
                name=f"{name}.node{k}",
                referenceCoordinates=[*positions[k], *parameters[k]],
                visualization={"show": False, "drawSize": -1.0, "color": list(color)},
            )
        )
        for k in range(len(positions))
    ]
    angles = np.linspace(0.0, 2.0 * np.pi, 13)[:-1]
    outline = exu.BeamSectionGeometry()
    outline.crossSectionRadiusY = outline.crossSectionRadiusZ = draw_radius
    points = exu.Vector2DList()
    for a in angles:
        points.Append([draw_radius * np.cos(a), draw_radius * np.sin(a)])
    outline.polygonalPoints = points
    beams = []
    for k, length in enumerate(mesh.lengths):
        section = exu.BeamSection()
        section.stiffnessMatrix = np.diag(mesh.stiffness[k])
        section.massPerLength = mesh.mass_per_length
        section.inertia = np.diag(mesh.rotary_inertia)
        beams.append(
            mbs.AddObject(
                eii.ObjectBeamGeometricallyExact(
                    name=f"{name}.beam{k}",
                    nodeNumbers=[nodes[k], nodes[k + 1]],
                    length=float(length),
                    sectionData=section,
                    visualization={"show": True, "sectionGeometry": outline, "color": list(color)},
                )
            )
        )
    return BackboneItems(nodes, beams)

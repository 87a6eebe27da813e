"""The backbone: mesh, beam elements on Euler-parameter nodes, and their kinematics in strain space.

Exudyn's beams have their axis along the local x axis, so a node's frame is the section frame of the robot
with the axes renamed: beam (x, y, z) = section (z, x, y).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import exudyn as exu
import exudyn.itemInterface as eii
import numpy as np
from numpy.typing import NDArray

from tdcr_fe.elements.poses import (
    adjoint_inverse,
    cross,
    euler_parameters_of_rotation,
    exp_se3,
    inverse_tangent_se3,
    log_se3,
    twist_change,
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
    for a, b in pairwise(bounds):
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
    return chain(position, rotation, *exp_se3(twists))


def chain(position: Array, rotation: Array, relative_r: Array, relative_p: Array) -> tuple[Array, Array]:
    """Poses of all nodes from the base and the pose of every node in the frame of the one before."""
    count = len(relative_p) + 1
    step = np.zeros((count - 1, 4, 4))
    step[:, :3, :3] = relative_r
    step[:, :3, 3] = relative_p
    step[:, 3, 3] = 1.0
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = rotation, position
    poses = np.empty((count, 4, 4))
    poses[0] = pose
    for k in range(count - 1):
        np.dot(poses[k], step[k], out=poses[k + 1])
    return poses[:, :3, 3].copy(), poses[:, :3, :3].copy()


def relative_twists(positions: Array, rotations: Array) -> Array:
    """Relative twist of every element from the poses of its nodes, shape (N-1, 6)."""
    inverse = np.swapaxes(rotations[:-1], 1, 2)
    r = inverse @ rotations[1:]
    p = (inverse @ np.diff(positions, axis=0)[..., None])[..., 0]
    return log_se3(r, p)


def twist_increments(twists: Array, increments: Array, relative: tuple[Array, Array] | None = None) -> Array:
    """Linearised change of the elements' twists for body-frame increments of the nodes.

    Parameters
    ----------
    twists
        Of the elements, shape (N-1, 6).
    increments
        Twists ``[v, w]`` of the nodes in their own frames, shape (N, 6).
    relative
        Exponentials of the twists, where they are known: rotations (N-1, 3, 3), translations (N-1, 3).
    """
    r, p = exp_se3(twists) if relative is None else relative
    before = increments[:-1]
    # Ad(h^-1) of the first node's twist: its velocity at the second node, in the second node's frame.
    at_second = np.concatenate(
        ((before[:, :3] + cross(before[:, 3:], p))[:, None, :], before[:, None, 3:]), axis=1
    )
    moved = increments[1:] - (at_second @ r).reshape(-1, 6)
    return twist_change(twists, moved)


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

"""The tendons of a robot in a scene: markers at holes, a connector per segment, geometry and friction."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import exudyn as exu
import exudyn.itemInterface as eii
import numpy as np
from numpy.typing import NDArray

from tdcr_fe.elements.backbone import BEAM_TO_SECTION, BackboneMesh, reference_poses
from tdcr_fe.elements.friction import TendonLaw
from tdcr_fe.elements.friction_models import FRICTION_MODELS, TendonParameters
from tdcr_fe.elements.section import ContinuousTendons
from tdcr_fe.elements.tendons import CableGeometry
from tdcr_fe.model.checks import ARC_TOLERANCE
from tdcr_fe.model.robot import Robot
from tdcr_fe.model.tendon import Tendon

Array = NDArray[np.float64]

#: Colours of the tendons in turn (RGBA).
TENDON_COLORS = (
    (0.85, 0.33, 0.10, 1.0),
    (0.00, 0.45, 0.70, 1.0),
    (0.00, 0.60, 0.45, 1.0),
    (0.80, 0.47, 0.65, 1.0),
)


@dataclass(frozen=True)
class TendonItems:
    """Exudyn's numbers of the items of the tendons.

    Attributes
    ----------
    holes : list of list
        By tendon, markers of its holes, base plate first, anchor last.
    segments : list of list
        By tendon, the spring-damper of every segment.
    """

    holes: list[list[Any]]
    segments: list[list[Any]]


def add_tendons(
    mbs: exu.MainSystem,
    robot: Robot,
    mesh: BackboneMesh,
    first_beam: Any,
    disks: list[Any],
    name: str,
    show: bool,
) -> TendonItems:
    """Add markers at all holes and a connector for every tendon segment, which is drawn and carries no force."""
    items = TendonItems([], [])
    for i, tendon in enumerate(robot.tendons):
        prefix = f"{name}.{tendon.name}"
        color = TENDON_COLORS[i % len(TENDON_COLORS)]
        if robot.without_disks:
            holes = _course_markers(mbs, robot, tendon, mesh, first_beam, prefix)
        else:
            holes = _hole_markers(mbs, robot.hole_points(tendon), mesh, first_beam, disks, prefix)
        items.holes.append(holes)
        items.segments.append(_segments(mbs, holes, prefix, color, show))
    return items


def _hole_markers(
    mbs: exu.MainSystem, holes: Array, mesh: BackboneMesh, first_beam: Any, disks: list[Any], prefix: str
) -> list[Any]:
    # The base plate's holes are on the first beam, which begins at the base.
    carriers = [first_beam, *disks[: len(holes) - 1]]
    along = [-0.5 * mesh.lengths[0]] + [0.0] * (len(holes) - 1)
    return [
        mbs.AddMarker(
            eii.MarkerBodyRigid(
                name=f"{prefix}.mHole{k}",
                bodyNumber=body,
                localPosition=[float(x + hole[2]), float(hole[0]), float(hole[1])],
                visualization={"show": False},
            )
        )
        for k, (body, x, hole) in enumerate(zip(carriers, along, holes, strict=True))
    ]


def _course_markers(
    mbs: exu.MainSystem, robot: Robot, tendon: Tendon, mesh: BackboneMesh, first_beam: Any, prefix: str
) -> list[Any]:
    """Markers along a tendon that follows the backbone, one at every node up to its end, on the beam before it."""
    end = robot.end(tendon)
    s = mesh.arc_lengths[mesh.arc_lengths <= end + ARC_TOLERANCE]
    offsets = tendon.routing.position(np.minimum(s, end), end)
    return [
        mbs.AddMarker(
            eii.MarkerBodyRigid(
                name=f"{prefix}.mHole{k}",
                bodyNumber=first_beam + max(k - 1, 0),
                localPosition=[
                    float((-0.5 if k == 0 else 0.5) * mesh.lengths[max(k - 1, 0)]),
                    *map(float, offset),
                ],
                visualization={"show": False},
            )
        )
        for k, offset in enumerate(offsets)
    ]


def _segments(
    mbs: exu.MainSystem, holes: list[Any], prefix: str, color: tuple[float, ...], show: bool
) -> list[Any]:
    return [
        mbs.AddObject(
            eii.SpringDamper(
                name=f"{prefix}.segment{k}",
                markerNumbers=[before, after],
                referenceLength=1.0,
                stiffness=0.0,
                force=0.0,
                activeConnector=False,
                visualization=eii.VObjectConnectorSpringDamper(show=show, drawSize=0.0, color=list(color)),
            )
        )
        for k, (before, after) in enumerate(itertools.pairwise(holes), start=1)
    ]


def cable_geometry(robot: Robot) -> CableGeometry:
    """Straight segments between the holes of all tendons; shorter tendons are padded at the end.

    The nodes with holes are the base plate and the disks, in this order.
    """
    counts = [len(robot.hole_arc_lengths(t)) - 1 for t in robot.tendons]
    m, n = len(counts), max(counts, default=1)
    offsets = np.zeros((m, n + 1, 3))
    nodes = np.zeros((m, n + 1), dtype=int)
    mask = np.zeros((m, n), dtype=bool)
    for i, (tendon, count) in enumerate(zip(robot.tendons, counts, strict=True)):
        offsets[i, : count + 1] = robot.hole_points(tendon) @ BEAM_TO_SECTION
        offsets[i, count + 1 :] = offsets[i, count]
        nodes[i] = np.minimum(np.arange(n + 1), count)
        mask[i, :count] = True
    clearance = np.array([t.clearance for t in robot.tendons])
    return CableGeometry(nodes, offsets, mask, 1 + max(1, len(robot.disks.positions)), clearance)


def cable_lengths(geometry: CableGeometry, mesh: BackboneMesh, hole_nodes: NDArray[np.int_]) -> Array:
    """Lengths of all segments of the unloaded robot [m], shape (m, n), with tendons shifted in their holes."""
    positions, rotations = reference_poses(mesh, np.zeros(3), BEAM_TO_SECTION)
    geometry.shift_in_holes(positions[hole_nodes], rotations[hole_nodes])
    return geometry.lengths(positions[hole_nodes], rotations[hole_nodes])


def continuous_lengths(tendons: ContinuousTendons, mesh: BackboneMesh) -> Array:
    """Lengths of tendons that follow the backbone of the unloaded robot [m], shape (m, 1)."""
    return tendons.evaluate(mesh.reference_twists, mesh.lengths)[0][:, None]


def tendon_law(
    tendons: tuple[Tendon, ...],
    holes: Sequence[Array],
    lengths: Array,
    mask: NDArray[np.bool_],
    friction: str,
    presliding: float,
) -> TendonLaw:
    """How tension passes along the tendons.

    Parameters
    ----------
    tendons
        Tendons of the robot.
    holes
        By tendon, arc lengths of its holes, base plate first [m].
    lengths, mask
        Unloaded length of every segment [m], and which segments exist; shapes (m, n).
    friction
        Name of the friction model, a key of `FRICTION_MODELS`.
    presliding
        Slip within which the friction at a hole goes from zero to full [m].
    """
    m, inner = len(tendons), mask[:, 1:]
    coefficient = np.array([t.friction_coefficient for t in tendons]).reshape(m, 1)
    adhesion = np.array([t.adhesion for t in tendons]).reshape(m, 1) * inner
    for i, tendon in enumerate(tendons):
        for hole in tendon.tight_holes:
            # Without the base plate's hole, in which there is no friction.
            adhesion[i, int(np.argmin(np.abs(holes[i][1:-1] - hole.at)))] = hole.drop
    compliance = np.array([0.0 if t.axial_stiffness is None else 1.0 / t.axial_stiffness for t in tendons])
    pretension = np.array([t.pretension for t in tendons])
    laws = tuple(t.friction for t in tendons)
    parameters = TendonParameters(lengths, mask, coefficient * inner, adhesion, compliance, pretension, laws)
    return TendonLaw(parameters, FRICTION_MODELS[friction], presliding)

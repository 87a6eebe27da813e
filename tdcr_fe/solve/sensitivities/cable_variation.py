"""Variation of straight tendons as their holes move in the disks, and of holes in which tendons shift sideways.

Right sides are the last axis. Holes are laid out by node first, ``(n + 1, 3, m, P)``, because all tendons have hole
``k`` on node ``k``.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tdcr_fe.elements.forces import TendonForces
from tdcr_fe.elements.tendons import CableGeometry

Array = NDArray[np.float64]


class CableVariation(NamedTuple):
    """Change of the tendons as their holes move, at fixed poses and tensions.

    Attributes
    ----------
    lengths : ndarray, shape (m, n, P)
        [m].
    angles : ndarray, shape (m, n-1, P)
        [rad].
    wrenches : ndarray, shape (n+1, 6, P)
        On the nodes with holes, in their own frames [N, N m].
    """

    lengths: Array
    angles: Array
    wrenches: Array


def _cross(a: Array, b: Array) -> Array:
    """Cross product along the second axis."""
    return np.stack(
        (
            a[:, 1] * b[:, 2] - a[:, 2] * b[:, 1],
            a[:, 2] * b[:, 0] - a[:, 0] * b[:, 2],
            a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0],
        ),
        axis=1,
    )


def _turned(rotations: Array, vectors: Array) -> Array:
    """Vectors (n+1, 3, ...) turned by one rotation a node."""
    flat = vectors.reshape(*vectors.shape[:2], -1)
    return (rotations @ flat).reshape(vectors.shape)


def by_node(values: Array) -> Array:
    """From (m, k, 3, ...) to (k, 3, m, ...)."""
    return np.moveaxis(values, 0, 2)


def cable_variation(own: TendonForces, rotations: Array, offsets: Array) -> CableVariation:
    """Change of the tendons as their holes move in the frames of the disks.

    Parameters
    ----------
    own
        Tensions in the present configuration.
    rotations
        Of all nodes, in beam axes, shape (N, 3, 3).
    offsets
        Change of the holes' positions [m], shape (n+1, 3, m, P).
    """
    shape, geometry = own.measured.shape, own.model.geometry
    assert geometry is not None
    frames = rotations[own.model.cable_nodes]
    e = by_node(shape.lines.directions)[..., None]
    exists = geometry.mask.T
    inverse = np.where(exists, 1.0 / np.where(exists, shape.lengths.T, 1.0), 0.0)[:, None, :, None]
    moved = _turned(frames, offsets)
    apart = moved[1:] - moved[:-1]
    lengths = (e * apart).sum(axis=1)
    turned = (apart - e * lengths[:, None]) * inverse
    sine = np.sin(shape.angles.T)
    weight = (sine / (sine**2 + 1e-24))[..., None]
    angles = ((e[1:] - e[:-1]) * (turned[1:] - turned[:-1])).sum(axis=1) * weight
    pulled = own.field.tension.T[:, None, :, None] * turned
    force = np.zeros_like(moved)
    force[:-1] = pulled
    force[1:] -= pulled
    back = frames.swapaxes(1, 2)
    force = _turned(back, force)
    present = _turned(back, by_node(shape.lines.pulls(own.field.tension)))[..., None]
    arm = by_node(geometry.offsets if own.measured.offsets is None else own.measured.offsets)[..., None]
    moment = _cross(arm, force) + _cross(offsets, present)
    wrenches = np.concatenate((force.sum(axis=2), moment.sum(axis=2)), axis=1)
    return CableVariation(lengths.transpose(1, 0, 2), angles.transpose(1, 0, 2), wrenches)


class HoleDisturbance(NamedTuple):
    """What moving the holes does at fixed poses, tensions at the base and mobilisations.

    Attributes
    ----------
    wrenches : ndarray, shape (6 N, P)
        On all nodes, in their own frames [N, N m].
    tension, released : ndarray, shape (m, n, P)
        Tensions [N] and released lengths [m] of the segments.
    """

    wrenches: Array
    tension: Array
    released: Array


def hole_disturbance(
    own: TendonForces,
    rotations: Array,
    offsets: Array,
    which: NDArray[np.int_] | slice,
    tension: Array,
    released: Array,
) -> HoleDisturbance:
    """Forces and tendons as holes move and laws change.

    Parameters
    ----------
    own
        Tensions in the present configuration.
    rotations
        Of all nodes, in beam axes, shape (N, 3, 3).
    offsets
        Change of the holes' positions in the frames of the disks [m], shape (n+1, 3, m, P').
    which
        Right sides for which the holes move.
    tension, released
        Changes at the same lengths and angles, as from a law, shape (m, n, P); changed in place.
    """
    field, shape, count = own.field, own.measured.shape, tension.shape[-1]
    wrenches = np.zeros((len(rotations), 6, count))
    if offsets.shape[-1]:
        moved = cable_variation(own, rotations, offsets)
        change = field.d_angle @ moved.angles
        if field.depends_on_length:
            change += field.d_length @ moved.lengths
        released[:, :, which] += (
            field.released_d_length[:, :, None] * moved.lengths
            + field.released_d_tension[:, :, None] * change
        )
        tension[:, :, which] += change
        on_disks = np.zeros((len(own.model.cable_nodes), 6, count))
        on_disks[:, :, which] = moved.wrenches
        wrenches[own.model.cable_nodes] = on_disks
    if tension.any():
        flat = tension.reshape(-1, count)
        pulled = shape.d_lengths.reshape(len(flat), -1).T @ flat
        wrenches[own.model.hole_nodes] -= pulled.reshape(-1, 6, count)
    return HoleDisturbance(wrenches.reshape(-1, count), tension, released)


def shift_variation(
    geometry: CableGeometry, positions: Array, rotations: Array, nodes: Array, holes: Array, clearance: Array
) -> Array:
    """Change of the tendons' places in oversized holes, see `CableGeometry.shift_in_holes`.

    Parameters
    ----------
    geometry
        Of the tendons.
    positions, rotations
        Of the nodes that tendons run through, shapes (n+1, 3) and (n+1, 3, 3).
    nodes
        Body-frame increments of these nodes, shape (n+1, 6, P).
    holes
        Change of the middles of the holes in the frames of the disks [m], shape (n+1, 3, m, P).
    clearance
        Change of the clearances [m], shape (m, P).

    Returns
    -------
    ndarray, shape (n+1, 3, m, P)
        Change of `CableGeometry.offsets` [m].
    """
    nominal = by_node(geometry.nominal)
    present = np.zeros(len(geometry.nominal)) if geometry.clearance is None else geometry.clearance
    back = rotations.swapaxes(1, 2)
    middle = positions[:, :, None] + _turned(rotations, nominal)
    d = np.diff(middle, axis=0)
    length = np.sqrt((d * d).sum(axis=1, keepdims=True))
    inverse = np.where(length > 0.0, 1.0 / np.where(length > 0.0, length, 1.0), 0.0)
    e = d * inverse
    pull = np.zeros_like(middle)
    pull[:-1] += e
    pull[1:] -= e
    pull[0] -= rotations[0, :, 0][:, None]
    local = _turned(back, pull)
    turn = nodes[:, 3:, None, :]
    moved = _turned(rotations, nodes[:, :3, None, :] + _cross(turn, nominal[..., None]) + holes)
    apart = np.diff(moved, axis=0)
    along = (e[..., None] * apart).sum(axis=1, keepdims=True)
    turned = (apart - e[..., None] * along) * inverse[..., None]
    change = np.zeros_like(moved)
    change[:-1] += turned
    change[1:] -= turned
    axis = np.zeros((1, 3, 1, 1))
    axis[0, 0] = 1.0
    change[:1] -= _turned(rotations[:1], _cross(turn[:1], axis) + np.zeros_like(change[:1]))
    change = _turned(back, change) - _cross(turn, local[..., None])
    local[:, 0], change[:, 0] = 0.0, 0.0
    size = np.sqrt((local * local).sum(axis=1, keepdims=True) + geometry.CLEARANCE_ANGLE**2)
    unit = (local / size)[..., None]
    scaled = (change - unit * (unit * change).sum(axis=1, keepdims=True)) / size[..., None]
    inner = np.ones((len(nominal), 1, nominal.shape[2], 1))
    inner[1:-1, 0, :, 0] = geometry.mask[:, 1:].T
    inner[-1] = 0.0
    shift = present[:, None] * scaled + unit * clearance
    return np.asarray(holes + inner * shift)

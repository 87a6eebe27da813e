"""Unknowns of Exudyn's implicit integrators during a step: twists of the backbone, and slips of the tendons.

A step of Newton's method turns the sections and moves the nodes along tangents, and what then does not fit, of second
order in the rotations, strains the elements along the backbone. Their large axial and shear stiffness makes forces of
it, up to thousands of newtons, which the next iteration removes. But the geometric stiffness of these forces is many
times the bending stiffness, so that it goes astray. Where a force of an element is larger than those at the beginning
of the step by more than what its bending stiffness may balance, the tangent therefore takes the forces from there. What
the iteration converges to does not change (compare D. Magisano, L. Leonetti, G. Garcea, How to improve efficiency and
robustness of the Newton method in geometrically non-linear structural problem discretized via displacement-based
finite elements, Comput. Methods Appl. Mech. Engrg. 313 (2017) 986-1005).

The mobilisation of a hole is a function of its slip with two corners, over a presliding distance that is far shorter
than what Newton's method moves in an iteration. With tangents of this function the iteration often jumps between all
holes sliding one way and all sliding the other way. Two things prevent that. The first iterate of a step is computed
for holes that go on sticking or sliding as at its beginning. In the others a hole that has saturated since the iterate
before is linearised by the secant between both iterates. Where an iteration converges, this is the tangent.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import exudyn as exu
import numpy as np

from tdcr_fe.elements import Array
from tdcr_fe.elements.backbone import BackboneMesh, relative_twists, strain_matrices
from tdcr_fe.elements.capstan import TensionField
from tdcr_fe.elements.native.condensation import ElasticTendons
from tdcr_fe.elements.native.coordinates import NodeCoordinates, generalized_tangent, twists_by_coordinates
from tdcr_fe.elements.poses import ONES3
from tdcr_fe.elements.section_forces import DIFFERENCE, add_element_tangent, nodal_sum, wrench_tangent
from tdcr_fe.elements.tendons import CableShape


def excess_tangent(coordinates: NodeCoordinates, mesh: BackboneMesh, displacements: Array) -> Array | None:
    """Derivative of the generalised forces of the elements by excessive axial and shear forces, at these forces.

    Excessive is a change since the beginning of the step whose geometric stiffness is of the order of the bending
    stiffness: ``EI / h^2``, where ``h`` is the length of an element, or that of a twentieth of the backbone if it is
    shorter.

    Parameters
    ----------
    coordinates
        Coordinates of the nodes.
    mesh
        The backbone.
    displacements
        Coordinates of the nodes in this iterate, without reference values, shape (7 N,).

    Returns
    -------
    ndarray, shape (7 N, 7 N), or None
        None where no element is stretched excessively.
    """
    lengths = np.maximum(mesh.lengths, mesh.arc_lengths[-1] / 20.0)
    limit = float(np.min(mesh.stiffness[:, 4:] / lengths[:, None] ** 2))
    before, after = coordinates.displacements(exu.ConfigurationType.StartOfStep), displacements.reshape(-1, 7)
    # The lengths of the chords are enough to see it, in a tenth of the time that the twists take.
    nodes = before[:, :3] + coordinates.reference[:, :3]
    moved = after[:, :3] - before[:, :3]
    way = moved[1:] - moved[:-1]
    grown = np.abs(((2.0 * (nodes[1:] - nodes[:-1]) + way) * way).dot(ONES3))
    if not (grown > 2.0 * mesh.lengths * limit / mesh.twist_stiffness[:, 0]).any():
        return None
    positions, rotations, parameters = coordinates.poses(after)
    twists = relative_twists(positions, rotations)
    wrenches = mesh.twist_stiffness * (twists - relative_twists(*coordinates.poses(before)[:2]))
    wrenches[:, 3:] = 0.0
    wrenches[(np.abs(wrenches) < limit).all(axis=1)] = 0.0

    def of_elements(moved: Array) -> Array:
        """These wrenches, kept, on both nodes of every element, in their own frames, shape (..., E, 12)."""
        return np.asarray(-(wrenches[:, None] @ strain_matrices(moved))[..., 0, :])

    blocks = wrench_tangent(of_elements, twists, np.full(twists.shape, DIFFERENCE))
    of_nodes = nodal_sum(of_elements(twists))
    k = np.zeros((of_nodes.size, of_nodes.size))
    add_element_tangent(k, blocks, of_nodes)
    return generalized_tangent(k, of_nodes[:, 3:], twists_by_coordinates(rotations, parameters))


class HoleIterate(NamedTuple):
    """Tensions in one iterate of a step."""

    trial: Array  # (m, g): Mobilisations before they are limited to [-1, 1]
    field: TensionField
    kept: bool = False  # Whether holes stick and slide as at the beginning, in place of the law of friction

    @classmethod
    def of(
        cls, tendons: ElasticTendons, shape: CableShape, before: HoleIterate | None = None, keep: bool = False
    ) -> HoleIterate:
        """Tensions in a configuration; the law must be `TendonLaw.simple`.

        Parameters
        ----------
        tendons
            In the step.
        shape
            The configuration.
        before
            The iterate before, from which holes that have saturated since are linearised by the secant; None is the
            derivative of the law.
        keep
            Whether holes stick and slide as at the beginning. The law of friction is taken nevertheless where it
            agrees, and where that is of no use: tensions below zero, or more than doubled.
        """
        law, state = tendons.model.law, tendons.history.friction
        trial = law.hysteresis.trial(law.slips(law.parameters.lengths - shape.lengths), state)
        limited = _limited(trial)
        if keep:
            start = state.mobilisation
            sticks = np.abs(start) < 1.0
            beyond = np.where(sticks, trial - start, 0.0)
            if (np.where(sticks, trial, start) != limited).any():
                field = law.field(tendons.values, shape, start, state, tendons.time)
                tension = field.tension + (field.by_mobilisation @ beyond[..., None])[..., 0]
                if ((tension >= 0.0) & (tension <= 2.0 * field.tension)).all():
                    field = law.with_slopes(field, lambda: sticks, trial, state)
                    return cls(trial, replace(field, tension=tension), kept=True)
        last = trial if before is None else before.trial
        field = law.field(tendons.values, shape, limited, state, tendons.time)
        return cls(trial, law.with_slopes(field, lambda: _secants(last, trial), trial, state))


def _secants(before: Array, trial: Array) -> Array:
    """Derivatives of limited mobilisations, or secants from the iterate before where they saturate, shape (m, g)."""
    slopes: Array = (np.abs(trial) < 1.0).astype(float)
    change = _limited(trial) - _limited(before)
    np.divide(change, trial - before, out=slopes, where=(slopes == 0.0) & (change != 0.0))
    return slopes


def _limited(trial: Array) -> Array:
    return np.minimum(np.maximum(trial, -1.0), 1.0)

"""Damping by the material of the backbone (Kelvin-Voigt), as dampers of Exudyn between neighbouring nodes.

The wrench of a section grows by the retardation time ``tau`` times its stiffness times the rate of its strain. A damper
acts in the middle of its element, on points that both nodes carry with them, in the frame halfway between both. The
relative velocity of these points and frames is the rate of the element's twist, up to the square of the angle by which
the element turns over twelve, and it is zero in rigid motion. Stretching is not damped: in bending the points part at
second order, which the large axial stiffness would make a force of. Points a sixth of the length from the nodes part at
fourth order only, but dampers between them took Newton's method 1.5 times the iterations, and moved the tip of a robot
pulled within 50 ms by 3e-6 of its length. Exudyn 1.13.6 drops the damping matrix of
`BeamSection` for `ObjectBeamGeometricallyExact`, which is why there are dampers.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import exudyn as exu
import exudyn.itemInterface as eii
import numpy as np

from tdcr_fe.elements import Array
from tdcr_fe.elements.backbone import BackboneMesh, relative_twists, strain_matrices
from tdcr_fe.elements.native.coordinates import NodeMotion
from tdcr_fe.elements.poses import exp_se3


@dataclass(frozen=True, eq=False)
class MaterialDamping:
    """Damping of one backbone in a scene."""

    retardation: Array  # (E,): Retardation time of every element [s]
    dampers: list[Any]  # Exudyn's numbers of the dampers, base first
    bodies: list[Any]  # Exudyn's numbers of the massless bodies on the nodes, between which the dampers act

    @classmethod
    def add(
        cls, mbs: exu.MainSystem, name: str, nodes: Sequence[Any], mesh: BackboneMesh, retardation: Array
    ) -> MaterialDamping:
        """Add the dampers to a system, between the nodes of a mesh from the base on."""
        massless = {"mass": 0.0, "inertia": [0.0] * 6, "visualization": eii.VObjectRigidBody(show=False)}
        bodies = [
            mbs.AddObject(eii.ObjectRigidBody(name=f"{name}.body{k}", nodeNumber=node, **massless))
            for k, node in enumerate(nodes)
        ]
        # From each node to the middle of the element in the unloaded state.
        ways = [exp_se3(sign * mesh.reference_twists) for sign in (0.5, -0.5)]
        dampers = []
        for e, damping in enumerate(viscosity(mesh, retardation)):
            markers = []
            for body, side, (turns, middles) in zip(bodies[e : e + 2], "ab", ways, strict=True):
                middle = exu.HT(rotation=turns[e], translation=middles[e])
                marker = eii.MarkerBodyRigid(name=f"{name}.marker{e}{side}", bodyNumber=body, localHT=middle)
                markers.append(mbs.AddMarker(marker))
            damper = eii.ObjectConnectorRigidBodySpringDamper(
                name=f"{name}{e}",
                markerNumbers=markers,
                damping=np.diag(damping),
                useIntrinsicFormulation=True,
                visualization=eii.VObjectConnectorRigidBodySpringDamper(show=False),
            )
            dampers.append(mbs.AddObject(damper))
        return cls(retardation, dampers, bodies)

    def follow(self, mbs: exu.MainSystem, mesh: BackboneMesh) -> None:
        """Take the stiffness of another mesh of the same elements."""
        for damper, damping in zip(self.dampers, viscosity(mesh, self.retardation), strict=True):
            mbs.SetObjectParameter(damper, "damping", np.diag(damping))

    def dissipated(self, mesh: BackboneMesh, start: NodeMotion, end: NodeMotion) -> float:
        """Energy dissipated in a step [J]: mean stress times the change of the twist, over all elements.

        Parameters
        ----------
        mesh
            With the present stiffness.
        start, end
            Motion of the nodes.
        """
        (before, first), (after, last) = map(twists_and_rates, (start, end))
        stress = 0.5 * viscosity(mesh, self.retardation) * (first + last)
        return float(np.sum(stress * (after - before)))


def viscosity(mesh: BackboneMesh, retardation: Array) -> Array:
    """Damping by the rates of the elements' twists, shape (E, 6), with their retardation times [s]."""
    found = retardation[:, None] * mesh.twist_stiffness
    found[:, 0] = 0.0
    return found


def twists_and_rates(motion: NodeMotion) -> tuple[Array, Array]:
    """Twists of the elements and their rates [m/s, rad/s], shape (E, 6) each."""
    twists = relative_twists(motion.positions, motion.rotations)
    both = np.concatenate((motion.twists[:-1], motion.twists[1:]), axis=1)
    return twists, (strain_matrices(twists) @ both[:, :, None])[:, :, 0]

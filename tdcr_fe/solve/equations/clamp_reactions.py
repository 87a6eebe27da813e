"""Reactions of the joints that clamp the bases of robots."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tdcr_fe.solve.equations.configuration import Configuration, Unknowns
from tdcr_fe.solve.equations.kernel import StaticKernel
from tdcr_fe.solve.equations.layout import SceneLayout
from tdcr_fe.solve.equations.residual import Residual

Array = NDArray[np.float64]


class ClampReactions(NamedTuple):
    """Multipliers of the joints of clamped bases that balance the wrenches on these bases.

    Attributes
    ----------
    joints : mapping
        By clamped robot, the numbers of its joint's multipliers.
    influence : mapping
        By clamped robot, from the wrench on its base to the joint's multipliers that cause it, shape (6, 6).
    """

    joints: Mapping[int, NDArray[np.int_]]
    influence: Mapping[int, Array]

    @classmethod
    def of(cls, kernel: StaticKernel, layout: SceneLayout) -> ClampReactions:
        """Compute the influence of the multipliers from Exudyn's Jacobian of the scene's current configuration.

        The same Jacobian gives further couplings between nodes, which the layout keeps.
        """
        configuration = layout.space.from_scene()
        layout.space.write(configuration)
        j = kernel.jacobian()
        layout.reduction.tangent(j, configuration.frames, search_couplings=True)
        found = {}
        for i, joint in layout.clamps.items():
            node = layout.space.slices[i].start
            rows = layout.reduction.node_rows(j, configuration.frames, node, joint)
            found[i] = np.asarray(np.linalg.inv(rows), dtype=float)
        return cls(layout.clamps, found)

    def balance(self, residual: Residual) -> Configuration:
        """The configuration of a state in equilibrium with the reactions of its clamps."""
        configuration = residual.state.configuration
        if not self.joints:
            return configuration
        old = configuration.unknowns
        multipliers = old.multipliers.copy()
        for (i, joint), acting in zip(self.joints.items(), residual.on_bases, strict=True):
            multipliers[joint] -= self.influence[i] @ acting
        unknowns = Unknowns(old.coordinates, multipliers, old.twists, old.bases)
        return configuration._replace(unknowns=unknowns)

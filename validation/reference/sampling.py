"""Poses between the stations: at the reported nodes and at the samples requested by the settings."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from tdcr_fe.validation.reference.rod import Rod
from tdcr_fe.validation.reference.statics import State, Statics

Array = NDArray[np.float64]


class Sampler:
    """Poses at the reported nodes and at the samples requested by the settings."""

    def __init__(self, statics: Statics) -> None:
        layout, settings = statics.layout, statics.settings
        length = statics.robot.backbone.length
        nodes = layout.s[layout.nodes]
        wanted = [min(max(p, 0.0), length) for p in settings.sample_at]
        for a, b in pairwise(nodes):
            n = settings.samples_per_bay
            wanted += [float(a + (b - a) * (i + 1) / (n + 1)) for i in range(n)]
        extra = [p for p in wanted if np.min(np.abs(layout.s - p)) > 1e-9]
        inner = [int(np.argmin(np.abs(layout.s - p))) for p in wanted if np.min(np.abs(layout.s - p)) <= 1e-9]
        self.stations = np.unique(np.concatenate((layout.nodes, np.array(inner, dtype=np.intp))))
        self.extra = np.unique(np.array(extra))
        self.interval = np.searchsorted(layout.s, self.extra) - 1
        self.s = np.concatenate((layout.s[self.stations], self.extra))
        self.order = np.argsort(self.s)
        self.statics = statics
        if len(self.extra):
            starts = layout.s[self.interval]
            self.rod = Rod(
                statics.section.take(self.interval),
                starts,
                self.extra - starts,
                statics.max_step,
                statics.heavy,
                statics.robot if statics.continuous else None,
            )

    def __call__(self, state: State) -> tuple[Array, Array, Array]:
        """Arc lengths [m], positions [m] and rotations, in order."""
        positions, rotations = state.positions[self.stations], state.rotations[self.stations]
        if len(self.extra):
            at = self.interval
            self.rod.section = self.statics.section.take(at)
            weight = None
            if self.statics.heavy:
                weight = np.einsum("nji,nj->ni", state.rotations[at], self.statics.weight[at])
            flow = self.rod.integrate(
                state.wrenches[at],
                weight,
                state.tensions if self.statics.continuous else None,
                derivatives=False,
            )
            start = state.rotations[at]
            more = state.positions[at] + (start @ flow.position[:, :, None])[..., 0]
            positions = np.concatenate((positions, more))
            rotations = np.concatenate((rotations, start @ flow.rotation))
        return self.s[self.order], positions[self.order], rotations[self.order]

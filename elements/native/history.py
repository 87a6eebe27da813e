"""History of a robot's tendons in data coordinates of Exudyn, one node a tendon.

Exudyn itself then restores it with the state: at the beginning of a solver run, in rejected steps, by
``GetSystemState`` and ``SetSystemState``, and from restart files.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import exudyn as exu
import exudyn.itemInterface as eii
import numpy as np

from tdcr_fe.elements import Array
from tdcr_fe.elements.friction import TendonLaw
from tdcr_fe.elements.hysteresis import FrictionState
from tdcr_fe.elements.native.items import SystemReference, data_coordinates

_CURRENT, _INITIAL = exu.ConfigurationType.Current, exu.ConfigurationType.Initial


@dataclass(frozen=True, eq=False)
class RobotHistory:
    """History of all tendons of one robot."""

    friction: FrictionState
    base_tension: Array  # (m,): Tension at the base in the last solved state [N]
    prescribed: Array  # (m,): Displacement prescribed there [m], nan of tendons driven by tension
    # (m, n): Length by which the segments of inextensible tendons, given an elasticity of their own in Exudyn's
    # solvers, are longer than they are, so that nothing moves where a state is handed over to these solvers [m]
    stretch: Array


class HistoryNodes:
    """The data nodes of one robot.

    The coordinates of the node of a tendon are, one after the other: time [s], tension at the base [N], whether it is
    driven by displacement, its displacement [m]; slip [m], mobilisation and slip rate [m/s] of its ``g`` friction
    variables; tension [N] and stretch [m] of its ``n`` segments.

    Parameters
    ----------
    system
        The system.
    law
        How tension passes along the tendons.
    names
        Names of the nodes, one a tendon.

    Attributes
    ----------
    nodes : list
        Exudyn's numbers of the nodes.
    size : int
        Number of data coordinates of all.
    """

    def __init__(self, system: SystemReference, law: TendonLaw, names: Sequence[str]) -> None:
        self._system = system
        (m, n), g = law.shape, law.groups
        size = 4 + 3 * g + 2 * n
        self._shape, self.size = (m, size), m * size
        parts = [slice(int(a), int(b)) for a, b in pairwise(np.cumsum([4, g, g, g, n, n]))]
        self._slip, self._mobilisation, self._rate, self._tension, self._stretch = parts
        #: That of a robot that was never loaded.
        self._unloaded = RobotHistory(law.initial_state(), np.zeros(m), np.full(m, np.nan), np.zeros((m, n)))
        self._slack, self._let_out = np.zeros((m, n)), law.released_unloaded().sum(axis=1)
        start = self._encode(self._unloaded, self._slack, self._let_out)
        self._raw, self._decoded = start.tobytes(), self._unloaded
        self.nodes: list[Any] = []
        for name, row in zip(names, start, strict=True):
            node = eii.NodeGenericData(name=name, numberOfDataCoordinates=size, initialCoordinates=row)
            self.nodes.append(system.mbs.AddNode(node))

    def sensed(self, segments: int) -> dict[str, slice]:
        """Which coordinates of a node are measured by sensors, by quantity.

        Parameters
        ----------
        segments
            Segments of the tendon.
        """
        first, holes = self._tension.start, self._mobilisation
        count = min(holes.stop - holes.start, max(segments - 1, 1))
        return {
            "tension": slice(first, first + 1),
            "anchor_tension": slice(first + segments - 1, first + segments),
            "tensions": slice(first, first + segments),
            "displacement": slice(3, 4),
            "mobilisation": slice(holes.start, holes.start + count),
            "slip": slice(self._slip.start, self._slip.start + count),
        }

    def coordinate_numbers(self) -> list[int]:
        """Numbers of all its data coordinates; needs an assembled system."""
        data = self._system.mbs.systemData
        return [int(i) for node in self.nodes for i in data.GetNodeLTGData(node)]

    def _coordinates(self, configuration: Any) -> Array:
        """The coordinates of all nodes in the memory of Exudyn, shape (m, size)."""
        mbs, size = self._system.mbs, self.size
        return data_coordinates(mbs, self.nodes[0], size, configuration).reshape(self._shape)

    @property
    def _present(self) -> bool:
        return self.size > 0 and self._system.mbs.systemIsConsistent

    def read(self) -> RobotHistory:
        """History in the current configuration of the scene; the same object as long as nothing has changed."""
        if not self._present:
            return self._unloaded
        raw = self._coordinates(_CURRENT)
        present = raw.tobytes()
        if present != self._raw:
            self._raw, self._decoded = present, self._decode(raw.copy())
        return self._decoded

    def _decode(self, raw: Array) -> RobotHistory:
        holes = raw[:, self._slip], raw[:, self._mobilisation], raw[:, self._rate]
        friction = FrictionState(*holes, float(raw[0, 0]))
        prescribed = np.where(raw[:, 2] > 0.5, raw[:, 3], np.nan)
        return RobotHistory(friction, raw[:, 1], prescribed, raw[:, self._stretch])

    def write(
        self, history: RobotHistory, tension: Array, displacement: Array, *, initial: bool = False
    ) -> None:
        """Write a history into the current configuration of the scene; nothing happens before ``mbs.Assemble()``.

        Parameters
        ----------
        history
            The history.
        tension
            Tension of every segment, for sensors [N], shape (m, n).
        displacement
            Displacement of every tendon at the base, for sensors [m], shape (m,); where prescribed, the one in the
            history counts.
        initial
            Whether it becomes that of the initial configuration, too.
        """
        if not self._present:
            return
        raw = self._encode(history, tension, displacement)
        self._coordinates(_CURRENT)[:] = raw
        if initial:
            self._coordinates(_INITIAL)[:] = raw
        self._raw, self._decoded = raw.tobytes(), history

    def reset(self) -> None:
        """Write the history of a robot that was never loaded into the current and the initial configuration."""
        self.write(self._unloaded, self._slack, self._let_out, initial=True)

    def _encode(self, history: RobotHistory, tension: Array, displacement: Array) -> Array:
        """Coordinates of all nodes, shape (m, size); arguments as in `write`."""
        raw, friction = np.zeros(self._shape), history.friction
        driven = ~np.isnan(history.prescribed)
        raw[:, 0], raw[:, 1], raw[:, 2] = friction.time, history.base_tension, driven
        raw[:, 3] = np.where(driven, history.prescribed, displacement)
        raw[:, self._slip], raw[:, self._mobilisation] = friction.slip, friction.mobilisation
        if friction.slip_rate is not None:
            raw[:, self._rate] = friction.slip_rate
        raw[:, self._tension], raw[:, self._stretch] = tension, history.stretch
        return raw

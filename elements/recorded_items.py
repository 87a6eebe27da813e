"""Whether items of a robot are where they were made: a reset removes them, deleting others gives them new numbers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import exudyn as exu


@dataclass(frozen=True)
class RecordedItems:
    """Names of some objects, nodes and loads, by their numbers.

    Attributes
    ----------
    objects, nodes, loads : tuple of (int, str)
        Number and name of each.
    """

    objects: tuple[tuple[int, str], ...]
    nodes: tuple[tuple[int, str], ...]
    loads: tuple[tuple[int, str], ...] = ()

    @classmethod
    def of(
        cls, mbs: exu.MainSystem, objects: Sequence[Any], nodes: Sequence[Any], loads: Sequence[Any] = ()
    ) -> RecordedItems:
        """The present names of objects, nodes and loads, given by Exudyn's numbers."""
        return cls(
            tuple((int(n), str(mbs.GetObjectParameter(n, "name"))) for n in objects),
            tuple((int(n), str(mbs.GetNodeParameter(n, "name"))) for n in nodes),
            tuple((int(n), str(mbs.GetLoadParameter(n, "name"))) for n in loads),
        )

    def joined(self, other: RecordedItems) -> RecordedItems:
        """These items and others."""
        return RecordedItems(self.objects + other.objects, self.nodes + other.nodes, self.loads + other.loads)

    def unchanged(self, mbs: exu.MainSystem) -> bool:
        """Whether every item has its number."""
        objects, nodes, loads = item_counts(mbs)
        return (
            all(n < objects and mbs.GetObjectParameter(n, "name") == name for n, name in self.objects)
            and all(n < nodes and mbs.GetNodeParameter(n, "name") == name for n, name in self.nodes)
            and all(n < loads and mbs.GetLoadParameter(n, "name") == name for n, name in self.loads)
        )

    def removed(self, mbs: exu.MainSystem) -> bool:
        """Whether none of the items is in the system."""
        objects, nodes, loads = item_counts(mbs)
        present = {("object", mbs.GetObjectParameter(n, "name")) for n in range(objects)}
        present |= {("node", mbs.GetNodeParameter(n, "name")) for n in range(nodes)}
        present |= {("load", mbs.GetLoadParameter(n, "name")) for n in range(loads)}
        own = {("object", name) for _, name in self.objects} | {("node", name) for _, name in self.nodes}
        own |= {("load", name) for _, name in self.loads}
        return not present & own


def item_counts(mbs: exu.MainSystem) -> tuple[int, int, int]:
    """Number of objects, of nodes and of loads of a system."""
    data = mbs.systemData
    return data.NumberOfObjects(), data.NumberOfNodes(), data.NumberOfLoads()

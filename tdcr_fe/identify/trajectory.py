"""Path of a run, as reference path for neighbouring runs: of other parameters, another division, or another mesh."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from tdcr_fe.effects import Experiment
from tdcr_fe.scene.mesh import build_mesh

if TYPE_CHECKING:
    from tdcr_fe.solve.load_steps.load_path import Increment
    from tdcr_fe.solve.simulate import PathRecord

Array = NDArray[np.float64]

#: For every step, the commanded step it belongs to and its load factor at the end, as in `Experiment.step_ends`.
Ends = tuple[tuple[int, float], ...]


@dataclass(frozen=True)
class Trajectory:
    """Path of a run, as reference path for neighbouring runs.

    Attributes
    ----------
    waypoints : list of list of Increment
        By step, see `tdcr_fe.solve.simulate.PathRecord`.
    ends : tuple of (int, float)
        Of its steps.
    s : ndarray, shape (n,)
        Arc lengths of the nodes [m].
    """

    waypoints: PathRecord
    ends: Ends
    s: Array

    def part(self, first: int, last: int) -> Trajectory:
        """Of the commanded steps from ``first`` up to ``last``, which is not included; they count from 0."""
        own = [j for j, (k, _) in enumerate(self.ends) if first <= k < last]
        ends = tuple((self.ends[j][0] - first, self.ends[j][1]) for j in own)
        return Trajectory([self.waypoints[j] for j in own], ends, self.s)

    @classmethod
    def joined(cls, parts: Sequence[Trajectory], lengths: Sequence[int]) -> Trajectory:
        """Of several loading sequences with so many commanded steps, one after another."""
        waypoints: PathRecord = []
        ends: list[tuple[int, float]] = []
        first = 0
        for part, length in zip(parts, lengths, strict=True):
            waypoints += part.waypoints
            ends += [(first + k, factor) for k, factor in part.ends]
            first += length
        return cls(waypoints, tuple(ends), parts[0].s)

    def divided(self, ends: Ends) -> PathRecord:
        """The path for the same commanded steps, divided in another way."""
        return self.waypoints if self.ends == ends else _divide(_join(self.waypoints, self.ends), ends)

    def on_mesh(self, s: Array) -> Trajectory | None:
        """The same path on another mesh: the same increments, with the twist of the backbone divided otherwise.

        Two runs on it differ by the error of the mesh alone, since both take the same substeps.

        Parameters
        ----------
        s
            Arc lengths of the nodes of the other mesh [m], shape (k,).

        Returns
        -------
        Trajectory or None
            None where the scene has coordinates besides those of the nodes.
        """
        if self.s.size == s.size and np.array_equal(self.s, s):
            return self
        moved: PathRecord = []
        for increments in self.waypoints:
            if any(x.state.unknowns.coordinates.size != _NODE * self.s.size for x in increments):
                return None
            moved.append([_on_mesh(x, self.s, s) for x in increments])
        return Trajectory(moved, self.ends, s)


#: Coordinates of a node in Exudyn: position and Euler parameters.
_NODE = 7


def mesh_nodes(experiment: Experiment) -> Array:
    """Arc lengths of the nodes of an experiment [m], shape (n,)."""
    loads = {load.at for step in experiment.steps for load in step.loads.values()}
    mesh, _ = build_mesh(experiment.robot, experiment.model, sorted(loads))
    return np.asarray(mesh.arc_lengths)


def _on_mesh(increment: Increment, before: Array, s: Array) -> Increment:
    """An increment with the twists of the elements of one mesh on another; both have one robot."""
    state = increment.state
    old = state.unknowns
    turned = np.concatenate((np.zeros((1, 6)), np.cumsum(old.twists[0], axis=0)))
    at = np.stack([np.interp(s, before, column) for column in turned.T], axis=1)
    nearest = np.argmin(np.abs(s[:, None] - before), axis=1)  # for the signs of the Euler parameters
    coordinates = old.coordinates.reshape(-1, _NODE)[nearest].ravel()
    # One for the Euler parameters of every node; their values follow from the others.
    multipliers = np.zeros(old.multipliers.size + s.size - before.size)
    unknowns = old._replace(coordinates=coordinates, multipliers=multipliers, twists=(np.diff(at, axis=0),))
    return replace(increment, state=replace(state, unknowns=unknowns))


def _join(waypoints: PathRecord, ends: Ends) -> dict[int, list[Increment]]:
    """Waypoints by commanded step, their load factors those of the commanded step."""
    joined: dict[int, list[Increment]] = {}
    done: dict[int, float] = {}
    for own, (k, factor) in zip(waypoints, ends, strict=True):
        start = done.get(k, 0.0)
        joined.setdefault(k, []).extend(
            replace(w, load_factor=start + (factor - start) * w.load_factor) for w in own
        )
        done[k] = factor
    return joined


def _divide(joined: dict[int, list[Increment]], ends: Ends) -> PathRecord:
    """Waypoints of commanded steps, for steps divided in another way."""
    divided = []
    done: dict[int, float] = {}
    for k, factor in ends:
        start = done.get(k, 0.0)
        inside = [w for w in joined[k] if start + 1e-9 < w.load_factor < factor - 1e-9]
        last = next(w for w in joined[k] if w.load_factor >= factor - 1e-9)
        part = [replace(w, load_factor=(w.load_factor - start) / (factor - start)) for w in inside]
        divided.append([*part, replace(last, load_factor=1.0)])
        done[k] = factor
    return divided

"""Predict readings from a simulated run."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tdcr_fe.effects import Experiment
from tdcr_fe.identify.run import Run, RunDerivatives
from tdcr_fe.io.readings import Reading
from tdcr_fe.model.channels import Channel, Location, arc_lengths, channel
from tdcr_fe.model.observed_step import AT_NODE, ObservedChange, ObservedStep

Array = NDArray[np.float64]


#: Family of the channels that read a coordinate of a marker.
POSITION = "position"


class _Markers(NamedTuple):
    """Readings of the coordinates of markers, which are predicted for all steps at once.

    What `ObservedStep.markers` and `ObservedStep.marker_changes` give step by step, for markers at nodes.

    Attributes
    ----------
    which : ndarray of int, shape (k,)
        Which readings.
    steps, axes : ndarray of int, shape (k,)
        Their steps and coordinates.
    s : ndarray, shape (k,)
        Arc lengths of the markers [m].
    """

    which: NDArray[np.int_]
    steps: NDArray[np.int_]
    axes: NDArray[np.int_]
    s: Array

    @classmethod
    def of(cls, readings: Sequence[Reading], steps: NDArray[np.int_]) -> _Markers:
        """Of all readings, with their steps."""
        which = np.array([i for i, r in enumerate(readings) if r.channel.family == POSITION], dtype=int)
        axes = np.array(["xyz".index(readings[i].quantity[-1]) for i in which], dtype=int)
        return cls(which, steps[which], axes, arc_lengths([readings[i].location for i in which]))

    def _nodes(self, run: Run) -> NDArray[np.int_]:
        places, inverse = np.unique(self.s, return_inverse=True)
        return np.argmin(np.abs(places[:, None] - run.s), axis=1)[inverse]

    def are_at_nodes(self, run: Run) -> bool:
        """Whether every marker is at a node."""
        if not self.which.size:
            return False
        return bool(np.max(np.abs(run.s[self._nodes(run)] - self.s)) < AT_NODE)

    def _levers(self, run: Run, seen: ObservedStep) -> Array:
        """Offsets of the markers from the backbone in the world [m], shape (k, 3)."""
        rotations = run.rotations[self.steps, self._nodes(run)]
        return np.asarray(np.einsum("nij,nj->ni", rotations, seen.offsets(self.s)))

    def positions(self, run: Run, seen: ObservedStep) -> Array:
        """Measured coordinates [m], shape (k,); ``seen``: any step as it is observed."""
        at = run.positions[self.steps, self._nodes(run)] + self._levers(run, seen)
        return np.asarray(np.einsum("nj,nj->n", seen.frame[self.axes], at) + seen.shift[self.axes])

    def changes(self, run: Run, by: RunDerivatives, seen: ObservedStep) -> Array:
        """Derivatives of `positions`, shape (k, P)."""
        nodes = self._nodes(run)
        turned = np.cross(by.rotations[self.steps, nodes], self._levers(run, seen)[..., None], axis=1)
        moved = by.positions[self.steps, nodes] + turned
        return np.asarray(np.einsum("nj,njp->np", seen.frame[self.axes], moved))


def _change(by: RunDerivatives, k: int, which: NDArray[np.bool_] | slice = slice(None)) -> ObservedChange:
    """Derivatives of a step by some of the parameters."""
    return ObservedChange(
        by.positions[k][..., which],
        by.rotations[k][..., which],
        by.displacements[k][..., which],
        by.distal_tensions[k][..., which],
        by.arc_lengths[..., which],
    )


class Reader:
    """Predicts readings from a run, by the channels of `tdcr_fe.model.channels`.

    Parameters
    ----------
    readings
        What is measured, where and in which step.
    step_ids
        Numbers of the steps in order.
    tendon_names
        Of the robot.
    """

    def __init__(
        self, readings: Sequence[Reading], step_ids: Sequence[int], tendon_names: Sequence[str]
    ) -> None:
        self._made_of = tuple(readings), tuple(step_ids), tuple(tendon_names)
        index = {n: i for i, n in enumerate(step_ids)}
        self.count = len(readings)
        self.step = np.array([index[r.step] for r in readings], dtype=int)
        self.tendon_names = tuple(tendon_names)
        self._markers = _Markers.of(readings, self.step)
        groups: dict[tuple[int, str], list[int]] = {}
        for i, r in enumerate(readings):
            groups.setdefault((index[r.step], r.quantity), []).append(i)
        self._groups: dict[int, list[tuple[Channel, Array, list[Location]]]] = {}
        for (k, quantity), which in groups.items():
            locations = [readings[i].location for i in which]
            self._groups.setdefault(k, []).append((channel(quantity), np.array(which), locations))

    def __reduce__(self) -> tuple[type[Reader], tuple[object, ...]]:
        """Sent to a process as what it is made of: channels are functions."""
        return Reader, self._made_of

    def read(self, run: Run, experiment: Experiment) -> Array:
        """What would be read, in the readings' units, shape (n,); NaN for steps that were not solved.

        Parameters
        ----------
        run
            Of the experiment's robot, model and steps.
        experiment
            Whose observation map is used.
        """
        out = np.full(self.count, np.nan)
        observe = self._observer(run, experiment)
        at_nodes = run.solved > 0 and self._markers.are_at_nodes(run)
        if at_nodes:
            out[self._markers.which] = self._markers.positions(run, observe(0))
        for k in range(run.solved):
            groups = self._groups_of(k, at_nodes)
            step = observe(k) if groups else None
            for known, which, locations in groups:
                assert step is not None
                out[which] = known.predict(step, locations)
        return out

    def derivatives(self, run: Run, experiment: Experiment) -> Array:
        """Derivatives of what would be read by the parameters of a run, shape (n, P); NaN where not solved.

        Parameters
        ----------
        run
            With derivatives.
        experiment
            Whose observation map is used.
        """
        by = run.derivatives
        assert by is not None
        out = np.full((self.count, len(by.names)), np.nan)
        observe = self._observer(run, experiment)
        at_nodes = run.solved > 0 and self._markers.are_at_nodes(run)
        moving = np.any(by.arc_lengths != 0.0, axis=0)  # then markers at nodes do not stay there
        if at_nodes:
            out[self._markers.which] = self._markers.changes(run, by, observe(0))
        for k in range(run.solved):
            step, change = observe(k), _change(by, k)
            for known, which, locations in self._groups_of(k, at_nodes):
                out[which] = known.derivatives(step, change, locations)
            if at_nodes and np.any(moving):
                change = _change(by, k, moving)
                for known, which, locations in self._groups.get(k, []):
                    out[np.ix_(which.astype(int), moving)] = known.derivatives(step, change, locations)
        return out

    def _groups_of(self, k: int, without_markers: bool) -> list[tuple[Channel, Array, list[Location]]]:
        """Readings of a step by channel; those of markers are left out where they are read for all steps at once."""
        own = self._groups.get(k, [])
        return [g for g in own if g[0].family != POSITION] if without_markers else own

    def _observer(self, run: Run, experiment: Experiment) -> Callable[[int], ObservedStep]:
        """What is observed of a run's steps."""
        return lambda k: experiment.observation.step(
            run.s,
            run.positions[k],
            run.rotations[k],
            run.displacements[k],
            run.distal_tensions[k],
            self.tendon_names,
        )

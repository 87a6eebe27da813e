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
from tdcr_fe.model.interpolation import (
    ElementChange,
    elements_at,
    share_change,
    within_elements,
    within_elements_change,
)
from tdcr_fe.model.observed_step import AT_NODE, ObservedChange, ObservedStep

Array = NDArray[np.float64]

#: Family of the channels that read a coordinate of a marker.
POSITION = "position"


class _Markers(NamedTuple):
    """Readings of the coordinates of markers, which are predicted for all steps at once.

    What `ObservedStep.markers` and `ObservedStep.marker_changes` give step by step.
    """

    which: NDArray[np.int_]  # which readings, shape (k,)
    # Their steps and coordinates, shape (k,)
    steps: NDArray[np.int_]
    axes: NDArray[np.int_]
    s: Array  # arc lengths of the markers [m], shape (k,)

    @classmethod
    def of(cls, readings: Sequence[Reading], steps: NDArray[np.int_]) -> _Markers:
        """Of all readings, with their steps."""
        which = np.array([i for i, r in enumerate(readings) if r.channel.family == POSITION], dtype=int)
        axes = np.array(["xyz".index(readings[i].quantity[-1]) for i in which], dtype=int)
        return cls(which, steps[which], axes, arc_lengths([readings[i].location for i in which]))

    def solved(self, run: Run) -> _Markers:
        """Those of the steps that were solved."""
        own = self.steps < run.solved
        return _Markers(self.which[own], self.steps[own], self.axes[own], self.s[own])

    def _seen(self, run: Run) -> _Seen:
        """The markers, each of them once."""
        places, at = np.unique(self.s, return_inverse=True)
        pairs, inverse = np.unique(self.steps * places.size + at, return_inverse=True)
        steps, s = pairs // places.size, places[pairs % places.size]
        return _Seen(steps, s, np.argmin(np.abs(s[:, None] - run.s), axis=1), inverse)

    def positions(self, run: Run, observed: ObservedStep) -> Array:
        """Measured coordinates [m], shape (k,); ``observed``: any step as it is observed."""
        seen = self._seen(run)
        at = seen.positions(run) + seen.levers(run, observed)
        return np.asarray(at @ observed.frame.T + observed.shift)[seen.inverse, self.axes]

    def changes(self, run: Run, by: RunDerivatives, observed: ObservedStep) -> Array:
        """Derivatives of `positions`, shape (k, P)."""
        seen = self._seen(run)
        levers = seen.levers(run, observed)
        turned = np.cross(by.rotations[seen.steps, seen.nodes], levers[..., None], axis=1)
        return np.asarray(observed.frame @ (seen.changes(run, by) + turned))[seen.inverse, self.axes]


class _Seen(NamedTuple):
    """Markers in the steps in which they are seen."""

    steps: NDArray[np.int_]  # shape (m,)
    s: Array  # arc lengths [m], shape (m,)
    nodes: NDArray[np.int_]  # the nodes nearest to them, shape (m,)
    inverse: NDArray[np.int_]  # for every reading, its marker, shape (k,)

    def _at_nodes(self, run: Run) -> bool:
        """Whether every marker is at a node."""
        return bool(np.max(np.abs(run.s[self.nodes] - self.s), initial=0.0) < AT_NODE)

    def levers(self, run: Run, observed: ObservedStep) -> Array:
        """Offsets of the markers from the backbone in the world [m], shape (m, 3)."""
        rotations = run.rotations[self.steps, self.nodes]
        return np.asarray(np.einsum("nij,nj->ni", rotations, observed.offsets(self.s)))

    def positions(self, run: Run) -> Array:
        """Of the backbone at the markers [m], shape (m, 3)."""
        if self._at_nodes(run):
            return np.asarray(run.positions[self.steps, self.nodes])
        k, share, _ = self._elements(run)
        p, r = run.positions, run.rotations
        ends = p[self.steps, k], r[self.steps, k], p[self.steps, k + 1], r[self.steps, k + 1]
        return within_elements(*ends, share)

    def changes(self, run: Run, by: RunDerivatives) -> Array:
        """Derivatives of `positions`, shape (m, 3, P)."""
        if self._at_nodes(run) and not np.any(by.arc_lengths):
            return np.asarray(by.positions[self.steps, self.nodes])
        k, share, length = self._elements(run)
        p, r = run.positions, run.rotations
        ends = p[self.steps, k], r[self.steps, k], p[self.steps, k + 1], r[self.steps, k + 1]
        change = ElementChange(
            by.positions[self.steps, k],
            by.rotations[self.steps, k],
            by.positions[self.steps, k + 1],
            by.rotations[self.steps, k + 1],
            share_change(by.arc_lengths[k], by.arc_lengths[k + 1], share, length),
        )
        return within_elements_change(*ends, share, change)

    def _elements(self, run: Run) -> tuple[NDArray[np.int_], Array, Array]:
        """Their elements, their shares of them [1], and the lengths of these [m]."""
        k = elements_at(run.s, self.s)
        length = run.s[k + 1] - run.s[k]
        return k, (self.s - run.s[k]) / length, length


def _change(by: RunDerivatives, k: int) -> ObservedChange:
    """Derivatives of a step."""
    return ObservedChange(
        by.positions[k], by.rotations[k], by.displacements[k], by.distal_tensions[k], by.arc_lengths
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
            if r.channel.family != POSITION:
                groups.setdefault((index[r.step], r.quantity), []).append(i)
        #: Readings of each step by channel, but for those of markers.
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
        observe = self.observer(run, experiment)
        markers = self._markers.solved(run)
        if markers.which.size:
            out[markers.which] = markers.positions(run, observe(0))
        for k in sorted(k for k in self._groups if k < run.solved):
            step = observe(k)
            for known, which, locations in self._groups[k]:
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
        observe = self.observer(run, experiment)
        markers = self._markers.solved(run)
        if markers.which.size:
            out[markers.which] = markers.changes(run, by, observe(0))
        for k in sorted(k for k in self._groups if k < run.solved):
            step, change = observe(k), _change(by, k)
            for known, which, locations in self._groups[k]:
                out[which] = known.derivatives(step, change, locations)
        return out

    def observer(self, run: Run, experiment: Experiment) -> Callable[[int], ObservedStep]:
        """What is observed of a run's steps."""
        return lambda k: experiment.observation.step(
            run.s,
            run.positions[k],
            run.rotations[k],
            run.displacements[k],
            run.distal_tensions[k],
            self.tendon_names,
        )

"""Predict readings from a simulated run."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from tdcr_fe.effects import Experiment
from tdcr_fe.identify.run import Run
from tdcr_fe.io.readings import Reading
from tdcr_fe.model.channels import Channel, Location, channel
from tdcr_fe.model.observed_step import ObservedChange, ObservedStep

Array = NDArray[np.float64]


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
        for k in range(run.solved):
            step = observe(k)
            for known, which, locations in self._groups.get(k, ()):
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
        for k in range(run.solved):
            step = observe(k)
            change = ObservedChange(
                by.positions[k], by.rotations[k], by.displacements[k], by.distal_tensions[k], by.arc_lengths
            )
            for known, which, locations in self._groups.get(k, ()):
                out[which] = known.derivatives(step, change, locations)
        return out

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

"""Effects of time between command and reading."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from tdcr_fe.effects.actuation import loads_between, with_commands
from tdcr_fe.effects.base import Bounds, Effect, ExcitationRange, Experiment, Kind, Parameter, Points, Values
from tdcr_fe.elements import Array
from tdcr_fe.model.loading import Actuation, LoadStep, resolve


class TimeLag(Effect):
    """Readings belong to a time earlier than that of the commands they stand beside.

    Commands and readings are not taken at the same instant: a camera that delivers late, a filter, a bus. What is
    read while the robot moves belongs to an earlier command.

    Distinguished by: repeat a movement at half the speed, or let the robot rest before each reading.
    """

    name = "time_lag"
    kind = Kind("input", ("time",))
    parameters = (
        Parameter("lag", "s", 0.0, 3600.0, 0.0, 0.02, "time by which a reading is older than its command"),
    )

    def bounds(self, experiment: Experiment) -> Bounds:
        """Up to four times the median time between steps."""
        times = [experiment.steps[k].time for k in experiment.whole_steps]
        pauses = np.diff([t for t in times if t is not None])
        longest = 4.0 * float(np.median(pauses)) if np.any(pauses > 0.0) else 1e-3
        return {"lag": (0.0, longest)}

    def probe_points(self, experiment: Experiment, excitation: ExcitationRange) -> Points:
        """A tenth and a half of the median time between steps; nothing on data without times."""
        if not experiment.steps or any(s.time is None for s in experiment.steps):
            return []
        longest = self.bounds(experiment)["lag"][1]
        return [[{"lag": share * longest}] for share in (0.025, 0.125)] if excitation.duration > 0.0 else []

    def apply(self, experiment: Experiment, values: Values) -> Experiment:
        """See `Effect.apply`. Between two steps, inputs and loads change linearly with time.

        Every step ends where its reading belongs to, and is divided where the commands have a kink before that.
        Before the time of the first step, the robot is as at its end.
        """
        lag = values["lag"]
        if lag == 0.0 or not experiment.steps:
            return experiment
        times = [s.time for s in experiment.steps]
        if any(t is None for t in times):
            raise ValueError("time_lag needs a time in every step")
        at = np.array(times, dtype=float)
        actions = resolve(experiment.robot, experiment.steps)
        first, *later = experiment.whole_steps
        steps, ends = list(experiment.steps[: first + 1]), list(experiment.step_ends[: first + 1])
        begin, j = at[first], first
        for k in later:
            commanded = experiment.step_ends[k][0]
            end = max(at[k] - lag, at[first])
            while j + 1 < len(at) and at[j + 1] < end:
                j += 1
                if at[j] > begin:
                    steps.append(experiment.steps[j])
                    ends.append((commanded, float((at[j] - begin) / (end - begin))))
            steps.append(_between(experiment, actions, at, j, float(end)))
            ends.append((commanded, 1.0))
            begin = end
        return replace(experiment, steps=tuple(steps), ends=tuple(ends))


def _between(experiment: Experiment, actions: list[Actuation], at: Array, j: int, time: float) -> LoadStep:
    """The step that ends at a time [s] on the way from the end of step ``j`` to that of the next."""
    names, steps = experiment.robot.tendon_names, experiment.steps
    if time <= at[j] or j + 1 == len(at):
        return replace(steps[j], time=time)
    before, after, step = actions[j], actions[j + 1], steps[j + 1]
    if np.any(before.by_displacement != after.by_displacement):
        raise ValueError("time_lag: a tendon changes between tension and displacement")
    factor = float((time - at[j]) / (at[j + 1] - at[j]))
    values = dict(zip(names, ((1.0 - factor) * before.values + factor * after.values).tolist(), strict=True))
    return with_commands(step, values, time=time, loads=loads_between(before.loads, step.loads, factor))

"""Effects with one number that acts on the commands: a gain, and the tension left in idle tendons.

The number is the same for all commands, or another one for each tendon, each folder of measured data, or each tendon in
each folder: between two series of measurements tendons are tied anew, and motors and load cells set to zero again.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from tdcr_fe.effects.base import Effect, ExcitationRange, Experiment, Parameter, Values
from tdcr_fe.effects.by_tendon import NumberForm
from tdcr_fe.model.loading import LoadStep


class CommandNumber(Effect):
    """An effect that gives the commands of every tendon one number, ``parameters[0]``.

    Besides that of all, ``NAME_TENDON`` is the number of one tendon, ``NAME_folder_K`` that of the K-th folder, from
    1, and ``NAME_TENDON_folder_K`` that of a tendon in it. The most particular one that is given counts.
    """

    def forms(self, experiment: Experiment) -> tuple[Effect, ...]:
        """One for all, or for each tendon; with several folders also for each folder, and for each tendon in it.

        Without numbers for the first folder, where it is as declared, too.
        """
        name, tendons = self.parameters[0].name, experiment.robot.tendon_names
        folders = range(1, experiment.folder_count + 1)
        parts = [("", [""]), ("each later folder", [f"_folder_{k}" for k in folders[1:]])]
        parts.append(("each folder", [f"_folder_{k}" for k in folders]))
        found: list[Effect] = [self]
        for kind, ends in parts if len(folders) > 1 else parts[:1]:
            if kind:
                found.append(NumberForm(self, kind, [name + end for end in ends], experiment))
            if len(tendons) > 1:
                names = [f"{name}_{t}{end}" for end in ends for t in tendons]
                own = f"each tendon, {kind}" if kind else "each tendon"
                found.append(NumberForm(self, own, names, experiment))
        return tuple(found)

    def parameters_of(self, experiment: Experiment) -> tuple[Parameter, ...]:
        """Of all, of each tendon, of each folder, and of each tendon in each folder."""
        one, tendons = self.parameters[0], experiment.robot.tendon_names
        folders = range(1, experiment.folder_count + 1) if experiment.folder_count > 1 else ()
        own = {f"_{t}": t for t in tendons}
        own |= {f"_folder_{k}": f"folder {k}" for k in folders if f"folder_{k}" not in tendons}
        own |= {f"_{t}_folder_{k}": f"{t} in folder {k}" for k in folders for t in tendons}
        each = (replace(one, name=one.name + x, meaning=f"{one.meaning}: {text}") for x, text in own.items())
        return (one, *each)

    @property
    def further_parameters(self) -> Mapping[str, Parameter]:
        """See `Effect.further_parameters`."""
        return {f"^{self.parameters[0].name}_.+$": self.parameters[0]}

    def null_value(self, experiment: Experiment, name: str) -> float:
        """That of the number of all."""
        return self.parameters[0].null_value

    def number(self, experiment: Experiment, values: Values, tendon: str) -> float:
        """The number of a tendon in the experiment's folder."""
        one = self.parameters[0]
        folder = f"folder_{experiment.folder}"
        names = [f"{one.name}_{tendon}_{folder}", f"{one.name}_{folder}", f"{one.name}_{tendon}", one.name]
        return next((values[n] for n in names if n in values), one.null_value)

    def alone(self, values: Values, experiment: Experiment) -> dict[str, float]:
        """See `Effect.alone`."""
        one = self.parameters[0].name
        if set(values) <= {one, *(f"{one}_{t}" for t in experiment.robot.tendon_names)}:
            return dict(values)
        return {f"{one}_{t}": self.number(experiment, values, t) for t in experiment.robot.tendon_names}


class ActuatorGain(CommandNumber):
    """Commanded displacement or tension off by a factor."""

    name = "actuator_gain"
    description = (
        "Command and actual value differ by a factor: radius of a spool, scale of a load cell, a gear."
    )
    separating_experiment = "measure tension or travel at the base plate itself"
    parameters = (Parameter("gain", "1", 0.05, 20.0, 1.0, 0.03, "actual over commanded value"),)

    def apply(self, experiment: Experiment, values: Values) -> Experiment:
        """See `Effect.apply`."""
        gain = {t: self.number(experiment, values, t) for t in experiment.robot.tendon_names}
        steps = tuple(
            replace(
                s,
                tensions={n: gain[n] * t for n, t in s.tensions.items()},
                displacements={n: gain[n] * d for n, d in s.displacements.items()},
            )
            for s in experiment.steps
        )
        return replace(experiment, steps=steps)


class IdleTension(CommandNumber):
    """Tension that is left in tendons whose command is less."""

    name = "idle_tension"
    description = (
        "Tendons that are commanded no tension still carry some: the controller keeps them from becoming slack, "
        "or they drag the motor along."
    )
    separating_experiment = (
        "measure the tension of an idle tendon at the base plate while another one is pulled"
    )
    parameters = (Parameter("tension", "N", 0.0, 20.0, 0.0, 0.02, "least tension of a tendon"),)

    def probe_points(
        self, experiment: Experiment, excitation: ExcitationRange
    ) -> list[list[dict[str, float]]]:
        """A fiftieth of the largest tension; nothing where every tendon is always commanded more, or a displacement."""
        commands = [t for s in experiment.steps for t in s.tensions.values()]
        probe = 0.02 * excitation.tension
        if not any(t > 0.0 for t in commands) or min(commands) >= probe:
            return []
        return [[{"tension": probe}]]

    def bounds(self, experiment: Experiment) -> dict[str, tuple[float, float]]:
        """Up to the largest tension."""
        largest = max((t for s in experiment.steps for t in s.tensions.values()), default=0.0)
        return {"tension": (0.0, max(largest, 1e-6))}

    def apply(self, experiment: Experiment, values: Values) -> Experiment:
        """See `Effect.apply`; tendons that no step has named yet are commanded zero."""
        least = {t: self.number(experiment, values, t) for t in experiment.robot.tendon_names}
        if not any(least.values()):
            return experiment
        steps = []
        for k, step in enumerate(experiment.steps):
            tensions = dict(step.tensions)
            if k == 0:
                idle = [t for t in experiment.robot.tendons if t.pretension == 0.0]
                tensions = {t.name: 0.0 for t in idle if t.name not in step.displacements} | tensions
            steps.append(_at_least(step, tensions, least))
        return replace(experiment, steps=tuple(steps))


def _at_least(step: LoadStep, tensions: Mapping[str, float], least: Mapping[str, float]) -> LoadStep:
    """A step with tensions of at least so much [N]."""
    return replace(step, tensions={n: max(t, least[n]) for n, t in tensions.items()})

"""Effects between the command and the base plate: gain, backlash, friction of the actuation; with their own history."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace

from tdcr_fe.loading import LoadStep
from tdcr_fe.validation.effects.contract import Effect, Parameter, Reach, Setup, Values

#: From the commands of one tendon over the steps to what arrives.
Transform = Callable[[list[float]], list[float]]


def transform_inputs(
    steps: Iterable[LoadStep], tension: Transform | None = None, displacement: Transform | None = None
) -> tuple[LoadStep, ...]:
    """Replace the commands of every tendon; what a step does not name stays as it was.

    Parameters
    ----------
    steps
        Loading sequence.
    tension, displacement
        Take the commands of one tendon, in order, and give what arrives [N or m]; None leaves them alone.
    """
    steps = list(steps)
    new = [(dict(s.tensions), dict(s.displacements)) for s in steps]
    for which, transform in ((0, tension), (1, displacement)):
        if transform is None:
            continue
        names = dict.fromkeys(n for pair in new for n in pair[which])
        for name in names:
            named = [k for k, pair in enumerate(new) if name in pair[which]]
            for k, value in zip(named, transform([new[k][which][name] for k in named]), strict=True):
                new[k][which][name] = value
    return tuple(replace(s, tensions=t, displacements=d) for s, (t, d) in zip(steps, new, strict=True))


def tension_that_arrives(commands: Iterable[float], dead_band: float, efficiency: float) -> list[float]:
    """Play operator of friction before the base plate.

    What arrives lies between ``(T - dead_band) efficiency`` and ``T / efficiency + dead_band``, never below zero,
    and changes only where it meets a bound. Before the first command both are zero.

    Parameters
    ----------
    commands
        Tensions at the actuator [N].
    dead_band
        [N].
    efficiency
        In (0, 1] [1].
    """
    arrived, result = 0.0, []
    for t in commands:
        low, high = (t - dead_band) * efficiency, t / efficiency + dead_band
        arrived = max(min(max(arrived, low), high), 0.0)
        result.append(arrived)
    return result


def displacement_that_arrives(commands: Iterable[float], backlash: float) -> list[float]:
    """Play operator of lost motion: ``backlash`` [m] is lost at the start, either way, and at every reversal."""
    arrived, result = 0.0, []
    low, high = -backlash, backlash  # at the start the play is open to both sides
    for d in commands:
        if low < 0.0 < high and abs(d) > backlash:
            low, high = (-backlash, 0.0) if d > 0.0 else (0.0, backlash)
        arrived = min(max(arrived, d + low), d + high)
        result.append(arrived)
    return result


class ActuatorGain(Effect):
    """Commanded displacement or tension off by a factor."""

    name = "actuator_gain"
    sentence = "What is commanded and what is done differ by a factor: radius of a spool, scale of a load cell, a gear."
    experiment = "measure tension or travel at the base plate itself"
    parameters = (Parameter("gain", "1", 0.05, 20.0, 1.0, 0.03, "what is done over what is commanded"),)

    def apply(self, setup: Setup, values: Values) -> Setup:
        """See `Effect.apply`."""
        gain = values["gain"]

        def scale(commands: list[float]) -> list[float]:
            return [gain * c for c in commands]

        return replace(setup, steps=transform_inputs(setup.steps, scale, scale))


class ActuatorBacklash(Effect):
    """Displacement lost before the tendon follows."""

    name = "actuator_backlash"
    sentence = "Gears, couplings and slack tendons lose some travel at the start and at every reversal."
    experiment = "command small cycles about one place and measure travel at the base plate"
    parameters = (Parameter("backlash", "m", 0.0, 0.05, 0.0, 1e-4, "travel that is lost"),)

    def starts(self, setup: Setup, reach: Reach) -> list[list[dict[str, float]]]:
        """A twentieth and a fifth of the largest displacement; nothing on data driven by tension."""
        if not any(s.displacements for s in setup.steps):
            return []
        return [[{"backlash": share * reach.displacement}] for share in (0.05, 0.2)]

    def bounds(self, setup: Setup) -> dict[str, tuple[float, float]]:
        """Up to the largest displacement."""
        largest = max((abs(d) for s in setup.steps for d in s.displacements.values()), default=0.0)
        return {"backlash": (0.0, max(largest, 1e-6))}

    def apply(self, setup: Setup, values: Values) -> Setup:
        """See `Effect.apply`."""
        return replace(
            setup,
            steps=transform_inputs(
                setup.steps,
                displacement=lambda commands: displacement_that_arrives(commands, values["backlash"]),
            ),
        )


class ActuatorLoss(Effect):
    """Friction before the base plate."""

    name = "actuator_loss"
    sentence = "Pulleys, sheaths and motor friction take part of the tension before the base plate, against the motion."
    experiment = "measure the tension at the base plate while pulling and while letting out"
    parameters = (
        Parameter("dead_band", "N", 0.0, 20.0, 0.0, 0.02, "tension lost whatever the tension is"),
        Parameter("efficiency", "1", 0.3, 1.0, 1.0, 0.02, "share that arrives of the rest"),
    )

    def starts(self, setup: Setup, reach: Reach) -> list[list[dict[str, float]]]:
        """Dead bands of a fiftieth and a tenth of the largest tension; nothing on data driven by displacement."""
        if not any(s.tensions for s in setup.steps):
            return []
        return [
            [
                {"dead_band": share * reach.tension, "efficiency": 1.0},
                {"dead_band": 0.0, "efficiency": 1.0 - share},
            ]
            for share in (0.02, 0.1)
        ]

    def bounds(self, setup: Setup) -> dict[str, tuple[float, float]]:
        """A dead band up to the largest tension."""
        largest = max((t for s in setup.steps for t in s.tensions.values()), default=0.0)
        return {"dead_band": (0.0, max(largest, 1e-6)), "efficiency": (0.3, 1.0)}

    def apply(self, setup: Setup, values: Values) -> Setup:
        """See `Effect.apply`."""
        return replace(
            setup,
            steps=transform_inputs(
                setup.steps,
                tension=lambda commands: tension_that_arrives(
                    commands, values["dead_band"], values["efficiency"]
                ),
            ),
        )

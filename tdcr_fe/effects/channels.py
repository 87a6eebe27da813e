"""Effect of the channels in a body without disks: they run elsewhere than declared."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from tdcr_fe.effects.base import Effect, Experiment, Form, Parameter, Values
from tdcr_fe.model.routing import MisplacedRouting
from tdcr_fe.model.tendon import Tendon

#: Numbers of a channel and what they are where it runs as declared; the names are those of `MisplacedRouting`.
AS_DECLARED = {"factor_base": 1.0, "factor_end": 1.0, "angle_base": 0.0, "angle_end": 0.0}


def _parameter(name: str) -> Parameter:
    kind, where = name.split("_")
    at = "at the base plate" if where == "base" else "at the tendon's end"
    if kind == "factor":
        return Parameter(name, "1", 0.1, 5.0, 1.0, 0.02, f"factor on the distance from the axis {at}")
    return Parameter(name, "rad", -1.6, 1.6, 0.0, 0.03, f"angle about the axis {at}")


class MisplacedChannels(Effect):
    """Channels run farther from the axis or nearer to it, or at another angle, linearly from base to end.

    A number holds for all tendons, and ``NAME_TENDON`` for one of them.
    """

    name = "misplaced_channels"
    description = (
        "The channels of the tendons run elsewhere in the body than declared: the pins that leave them free bend or "
        "shift in the mould when it is filled."
    )
    separating_experiment = "cut a casting of the same mould across, and measure where the channels are"
    parameters = (_parameter("factor_end"),)
    _further = tuple(_parameter(n) for n in AS_DECLARED if n != "factor_end")

    def forms(self, experiment: Experiment) -> tuple[Effect, ...]:
        """The offset at the end, an angle for each tendon, both, or all for each; none where disks hold the holes."""
        tendons = experiment.robot.tendon_names
        if not experiment.robot.without_disks or not tendons:
            return ()
        angles = [f"angle_{where}_{t}" for where in ("base", "end") for t in tendons]
        each = [f"factor_end_{t}" for t in tendons]
        return (
            self,
            Form(self, "angles", angles, experiment),
            Form(self, "offset and angles", ["factor_end", *angles], experiment),
            Form(self, "each", [*each, *angles], experiment),
        )

    def parameters_of(self, experiment: Experiment) -> tuple[Parameter, ...]:
        """Of all tendons, and of each."""
        common = (*self.parameters, *self._further)
        each = tuple(
            replace(p, name=f"{p.name}_{t}", meaning=f"{p.meaning}: {t}")
            for p in common
            for t in experiment.robot.tendon_names
        )
        return (*common, *each)

    @property
    def further_parameters(self) -> Mapping[str, Parameter]:
        """See `Effect.further_parameters`."""
        return {
            "^factor_(base|end)(_.+)?$": self.parameters[0],
            "^angle_(base|end)(_.+)?$": _parameter("angle_base"),
        }

    def null_value(self, experiment: Experiment, name: str) -> float:
        """One for factors, zero for angles."""
        return 1.0 if name.startswith("factor") else 0.0

    def apply(self, experiment: Experiment, values: Values) -> Experiment:
        """See `Effect.apply`."""
        tendons = tuple(_moved(t, values) for t in experiment.robot.tendons)
        return experiment.with_robot(tendons=tendons)


def _moved(tendon: Tendon, values: Values) -> Tendon:
    """A tendon whose channel runs elsewhere."""
    own = {n: values.get(f"{n}_{tendon.name}", values.get(n, x)) for n, x in AS_DECLARED.items()}
    return tendon if own == AS_DECLARED else replace(tendon, routing=MisplacedRouting(tendon.routing, **own))

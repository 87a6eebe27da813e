"""Effects of disks and of where they guide the tendons: thickness, turned disks, misplaced channels."""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from dataclasses import replace
from typing import ClassVar

from tdcr_fe.effects.base import Bounds, Effect, ExcitationRange, Experiment, Kind, Parameter, Points, Values
from tdcr_fe.effects.by_tendon import for_each
from tdcr_fe.model.backbone import StiffnessPatch
from tdcr_fe.model.robot import Tendon
from tdcr_fe.model.routing import MisplacedRouting, TwistedRouting


class RigidDisks(Effect):
    """Disks stiffen the length they occupy.

    Glued or clamped disks keep the backbone straight over the length they occupy; less of it bends.

    Distinguished by: measure positions on both sides of a disk closely, or compare a robot with thinner disks.
    """

    name = "rigid_disks"
    kind = Kind("stiffness", ("place",), "disks")
    needs_disks = True
    parameters = (
        Parameter("thickness", "m", 0.0, 0.1, 0.0, 1e-3, "length of backbone that each disk makes rigid"),
    )

    def null_values(self, experiment: Experiment) -> dict[str, float]:
        """The declared values."""
        return {"thickness": experiment.robot.disks.thickness}

    def bounds(self, experiment: Experiment) -> Bounds:
        """Largest thickness that leaves a flexible part of the shortest bay."""
        s = (0.0, *experiment.robot.disks.positions)
        first = 2.0 * s[1]
        return {"thickness": (0.0, 0.95 * min([first, *(b - a for a, b in itertools.pairwise(s))]))}

    def probe_points(self, experiment: Experiment, excitation: ExcitationRange) -> Points:
        """A tenth of a bay."""
        upper = self.bounds(experiment)["thickness"][1]
        here = self.null_values(experiment)["thickness"]
        return [[{"thickness": here + 0.1 * (upper - here)}]]

    def near_null(self, experiment: Experiment) -> Effect:
        """See `Effect.near_null`."""
        return ThinDisks() if experiment.robot.disks.thickness == 0.0 else self

    def apply(self, experiment: Experiment, values: Values) -> Experiment:
        """See `Effect.apply`."""
        return experiment.with_robot(disks=replace(experiment.robot.disks, thickness=values["thickness"]))


class ThinDisks(RigidDisks):
    """Disks so thin that they add no element: every bay is stiffer by the share of it that they make rigid.

    At small bends every bay then turns as with `RigidDisks`, to first order in the thickness. Where bays bend by half
    a radian, the derivative is up to twice as large, in nearly the same direction: enough to order candidates.
    """

    def apply(self, experiment: Experiment, values: Values) -> Experiment:
        """See `Effect.apply`."""
        edges = (0.0, *experiment.robot.disks.positions)
        backbone, thickness = experiment.robot.backbone, values["thickness"]
        bays = []
        for k, (start, end) in enumerate(itertools.pairwise(edges)):
            rigid = (0.5 if k == 0 else 1.0) * thickness
            factor = (end - start) / (end - start - rigid)
            bays.append(StiffnessPatch(start, end, factor, factor))
        return experiment.with_backbone(patches=(*backbone.patches, *bays))


class RoutingTwist(Effect):
    """Holes rotated about the backbone, growing linearly with arc length.

    Disks were mounted turned against each other, or the backbone was twisted when they were fixed.

    Distinguished by: look along the straight robot and measure the angle of the tip disk against the base.
    """

    name = "routing_twist"
    kind = Kind("routing", ("place",))
    parameters = (Parameter("angle_tip", "rad", -6.3, 6.3, 0.0, 0.03, "rotation of the holes at the tip"),)

    def apply(self, experiment: Experiment, values: Values) -> Experiment:
        """See `Effect.apply`."""
        angle = values["angle_tip"]
        if angle == 0.0:
            return experiment
        rate = angle / experiment.robot.backbone.length
        tendons = tuple(replace(t, routing=TwistedRouting(t.routing, rate)) for t in experiment.robot.tendons)
        return experiment.with_robot(tendons=tendons)


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

    The channels of the tendons run elsewhere in the body than declared: the pins that leave them free bend or
    shift in the mould when it is filled.

    Distinguished by: cut a casting of the same mould across, and measure where the channels are.

    A number holds for all tendons, and ``NAME_TENDON`` for one of them.
    """

    name = "misplaced_channels"
    kind = Kind("routing", ("place",))
    parameters = (_parameter("factor_end"),)
    _further = tuple(_parameter(n) for n in AS_DECLARED if n != "factor_end")
    further: ClassVar[Mapping[str, Parameter]] = {
        "^factor_(base|end)(_.+)?$": parameters[0],
        "^angle_(base|end)(_.+)?$": _parameter("angle_base"),
    }

    def forms(self, experiment: Experiment) -> tuple[Effect, ...]:
        """The offset at the end, an angle for each tendon, both, or all for each; none where disks hold the holes."""
        tendons = experiment.robot.tendon_names
        if not experiment.robot.without_disks or not tendons:
            return ()
        angles = [f"angle_{where}_{t}" for where in ("base", "end") for t in tendons]
        each = [f"factor_end_{t}" for t in tendons]
        return (
            self,
            self.form("angles", angles, experiment),
            self.form("offset and angles", ["factor_end", *angles], experiment),
            self.form("each", [*each, *angles], experiment),
        )

    def parameters_of(self, experiment: Experiment) -> tuple[Parameter, ...]:
        """Of all tendons, and of each."""
        common = (*self.parameters, *self._further)
        return (*common, *for_each(common, {t: t for t in experiment.robot.tendon_names}))

    def apply(self, experiment: Experiment, values: Values) -> Experiment:
        """See `Effect.apply`."""
        return experiment.with_robot(tendons=tuple(_moved(t, values) for t in experiment.robot.tendons))


def _moved(tendon: Tendon, values: Values) -> Tendon:
    """A tendon whose channel runs elsewhere."""
    numbers = {n: values.get(f"{n}_{tendon.name}", values.get(n, x)) for n, x in AS_DECLARED.items()}
    if numbers == AS_DECLARED:
        return tendon
    return replace(tendon, routing=MisplacedRouting(tendon.routing, **numbers))

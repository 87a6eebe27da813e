"""Tendons under tension at either end of a substep, and what their slips are in it as functions of the tensions."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tdcr_fe.solve.equations.state import Target
from tdcr_fe.solve.friction_path.equilibrium import Equilibrium
from tdcr_fe.solve.friction_path.slip_interpolation import SlipData
from tdcr_fe.solve.friction_path.tension_response import LoadResponse
from tdcr_fe.solve.friction_path.tension_transfer import TendonsInSubstep

Array = NDArray[np.float64]
Index = NDArray[np.int_]


class TautTendons(NamedTuple):
    """Tendons under tension at either end of a substep.

    All other tendons transmit nothing; their holes are left out of the friction path.

    Attributes
    ----------
    tendons : tuple of TendonsInSubstep
        By robot that has any of them.
    robots : tuple of int
        Numbers of these robots.
    numbers : tuple of ndarray of int
        By robot, all of them, numbers of the tendons under tension.
    holes : ndarray of int, shape (k,)
        Numbers of their frictional holes, among those of all tendons.
    """

    tendons: tuple[TendonsInSubstep, ...]
    robots: tuple[int, ...]
    numbers: tuple[Index, ...]
    holes: Index

    @classmethod
    def of(cls, states: Sequence[Equilibrium]) -> TautTendons:
        """Tendons under tension in any of some states.

        Parameters
        ----------
        states
            Solved states of a substep, from its start to its end.
        """
        start, end = states[0], states[-1]
        tendons, robots, numbers, holes = [], [], [], []
        hole = 0
        for part in end.numbering.robots:
            law = end.forces[part.robot].model.law
            tension = np.array([at.state.base_tension[part.robot] for at in (start, end)])
            taut = [np.any(at.forces[part.robot].field.tension > 0.0, axis=1) for at in states]
            which = np.flatnonzero(np.any(taut, axis=0))
            acting = part.frictional if part.has_friction else np.zeros_like(part.frictional)
            if which.size:
                driven = np.flatnonzero(np.isin(which, part.driven))
                tendons.append(TendonsInSubstep(law, which, acting[which], driven, tension[:, which]))
                robots.append(part.robot)
            numbers.append(which)
            order = hole + np.cumsum(acting.reshape(-1)).reshape(acting.shape) - 1
            holes.append(order[which][acting[which]])
            hole += int(np.count_nonzero(acting))
        return cls(tuple(tendons), tuple(robots), tuple(numbers), np.concatenate(holes))

    @property
    def unknown(self) -> int:
        """Number of unknown tensions at the base."""
        return sum(len(own.driven) for own in self.tendons)

    def base_tensions(self, end: int) -> Array:
        """Tensions at the base of tendons driven by displacement, at the start (0) or the end (1) [N], shape (c,)."""
        return np.concatenate([own.tension[end, own.driven] for own in self.tendons])

    def tensions(self, at: Equilibrium) -> Array:
        """Tensions of their segments in a state [N], shape (q,)."""
        return self._joined([own.field.tension for own in at.forces])

    def slip_data(
        self, at: Equilibrium, targets: tuple[Target, Target], factor: float, load: LoadResponse | None
    ) -> SlipData:
        """Slips and turning angles in a state, and their derivatives, see `SlipData`.

        Parameters
        ----------
        at
            The state, with its response to the tensions.
        targets
            Inputs and loads at both ends of the substep.
        factor
            Load factor of the state within the substep [1].
        load
            Response to the change of the loads in the substep; None where no load changes.
        """
        forces, response = at.forces, at.response
        assert response is not None
        flexibility, turning = response.flexibility, response.angles
        if load is None:
            load = LoadResponse.zero(response)
        values, by_tension, by_load = [], [], []
        bases: list[tuple[Array, Array, Array]] = []
        segment = 0
        for own, robot in zip(self.tendons, self.robots, strict=True):
            field, count, here = forces[robot].field, len(own.which), slice(segment, segment + own.segments)
            by_length = field.released_d_length[own.which].reshape(-1, 1)
            released = -by_length * flexibility[here]
            stretched = field.released_d_tension[own.which].reshape(-1)
            released[np.arange(own.segments), np.arange(here.start, here.stop)] += stretched
            both = np.column_stack((released, by_length[:, 0] * load.lengths[here]))
            both = both.reshape(count, own.law.shape[1], -1)
            slips = (own.law.slip_operator @ both)[own.frictional]
            values.append(field.slip[own.which][own.frictional])
            by_tension.append(slips[:, :-1])
            by_load.append(slips[:, -1])
            driven = own.which[own.driven]
            pulled = -both[own.driven].sum(axis=1)
            first, last = (target.inputs[robot][driven] for target in targets)
            minus_slack = first + factor * (last - first) - field.base_slip[driven]
            bases.append((minus_slack, pulled[:, :-1], pulled[:, -1] + last - first))
            segment = here.stop
        return SlipData(
            factor,
            self.tensions(at),
            np.concatenate(
                [
                    *values,
                    *(b[0] for b in bases),
                    self._joined([f.measured.shape.angles for f in forces]),
                ]
            ),
            np.concatenate([*by_tension, *(b[1] for b in bases), turning]),
            np.concatenate([*by_load, *(b[2] for b in bases), load.angles]),
        )

    def _joined(self, by_robot: list[Array]) -> Array:
        """Values of these tendons, of all robots one after the other."""
        return np.concatenate([x[n].reshape(-1) for x, n in zip(by_robot, self.numbers, strict=True)])

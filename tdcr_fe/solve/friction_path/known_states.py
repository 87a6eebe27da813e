"""Known states of a substep: those at its ends and those solved within it, and the state between them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tdcr_fe.solve.equations.configuration import SolverState
from tdcr_fe.solve.equations.system import SceneSystem
from tdcr_fe.solve.friction_path.path import FrictionPath
from tdcr_fe.solve.friction_path.response import Equilibrium, LoadResponse, TautTendons
from tdcr_fe.solve.friction_path.slips import cubic
from tdcr_fe.solve.newton.prediction import moved_elements

Array = NDArray[np.float64]


class InterpolationPoint(NamedTuple):
    """A solved state at an end of a substep or within it, between which slips are interpolated."""

    factor: float  # Load factor within the substep [1]
    # Linearised exactly, with the response to the tensions of all tendons under tension at any of the points
    state: Equilibrium
    # Response to the change of the loads in the whole substep; None where no load changes
    load: LoadResponse | None = None


class Span(NamedTuple):
    """Load factors of the load step at the ends of a substep [1]."""

    start: float
    end: float

    def load_factor(self, fraction: float) -> float:
        """Load factor of the load step at a fraction of the substep [1]."""
        return self.start + fraction * (self.end - self.start)


class KnownStates(NamedTuple):
    """States of a substep, from its start to its end."""

    span: Span  # The substep
    taut: TautTendons  # The tendons under tension in any of the states
    points: tuple[InterpolationPoint, ...]  # The states, by load factor

    @property
    def start(self) -> Equilibrium:
        """The state at the start of the substep."""
        return self.points[0].state

    @property
    def end(self) -> Equilibrium:
        """The state at its end."""
        return self.points[-1].state

    @property
    def within(self) -> tuple[tuple[float, SolverState], ...]:
        """States within the substep with their load factors in the load step."""
        return tuple(
            [(self.span.load_factor(point.factor), point.state.state) for point in self.points[1:-1]]
        )

    @property
    def before_end(self) -> list[tuple[float, Equilibrium]]:
        """All states but the last, with their fractions of the substep."""
        return [(point.factor, point.state) for point in self.points[:-1]]


def twists(point: Equilibrium) -> Array:
    """Twists of all elements: translations [m] and rotations [rad], six values each."""
    return np.concatenate([own.reshape(-1) for own in point.state.configuration.twists])


def twist_change(point: InterpolationPoint, tension: Array, load: float) -> Array:
    """Change of the twists of all elements by one of the tensions and of the loads, to first order.

    Parameters
    ----------
    point
        Where it is linearised.
    tension
        Change of the tensions of the segments [N], shape (q,).
    load
        Part of the change of the loads in the substep [1].
    """
    linear, response = point.state.linearization, point.state.response
    assert response is not None
    nodes = response.nodes @ tension
    if point.load is not None and load:
        nodes = nodes + load * point.load.nodes
    return linear.twist_changes(nodes)


def interpolated(
    system: SceneSystem, known: KnownStates, path: FrictionPath, factor: float, max_turn: float
) -> SolverState | None:
    """The state at a load factor within the substep, by interpolation; None where an element turns by too much.

    Twists of the elements by a cubic along the line between the tensions of the states on both sides, beside it linear
    in the tensions: as slips are interpolated (`tdcr_fe.solve.friction_path.slips`). Mobilisations and
    tensions at the base are those of the path.
    """
    (unknowns, tension), points, taut = path.at(factor), known.points, known.taut
    last = next(i for i, point in enumerate(points) if point.factor >= factor)
    first, then = points[last - 1], points[last]
    length = then.factor - first.factor
    x = (factor - first.factor) / length
    ends = [taut.tensions(point.state) for point in (first, then)]
    change, off_line = ends[1] - ends[0], tension - ends[0] - x * (ends[1] - ends[0])
    slopes = [twist_change(point, change, length) for point in (first, then)]
    square, cube = cubic(twists(then.state) - twists(first.state), *slopes)
    step = x * (slopes[0] + x * (square + x * cube))
    step += (1.0 - x) * twist_change(first, off_line, 0.0) + x * twist_change(then, off_line, 0.0)
    state = first.state.state
    configuration = moved_elements(system, state, step, max_turn)
    if configuration is None:
        return None
    return with_path_unknowns(first.state, taut, unknowns)._replace(configuration=configuration)


def with_path_unknowns(point: Equilibrium, taut: TautTendons, unknowns: Array) -> SolverState:
    """A state with other mobilisations, and other tensions at the base of tendons driven by displacement."""
    state, numbering, k = point.state, point.numbering, len(taut.holes)
    mobilised = point.mobilisation.copy()
    mobilised[taut.holes] = unknowns[:k]
    tension = np.zeros(numbering.linear - numbering.reduced)
    tension[taut.driven] = unknowns[k:]
    return state._replace(
        mobilisation=numbering.with_frictional_holes(state.mobilisation, mobilised),
        base_tension=numbering.with_driven(state.base_tension, tension),
    )

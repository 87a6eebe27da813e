"""A solved step as part of the smooth curve of solutions, from which the next one is predicted."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tdcr_fe.solve.equations.numbering import Numbering
from tdcr_fe.solve.equations.state import SolverState, Target

Array = NDArray[np.float64]


class SolvedStep(NamedTuple):
    """A solved step in which nothing but the inputs of tendons changed, and friction kept its state.

    Attributes
    ----------
    loading : ndarray
        Change of the inputs of all tendons [N, m].
    start, end : ndarray
        Unknowns at its ends, see `unknowns`.
    slope : ndarray or None
        Their derivative at its start, times its length; None where it is unknown.
    """

    loading: Array
    start: Array
    end: Array
    slope: Array | None

    @classmethod
    def of(
        cls,
        before: SolverState,
        after: SolverState,
        changes: tuple[Array, ...],
        numbering: Numbering,
        slope: Array | None = None,
    ) -> SolvedStep | None:
        """The step between two solutions under the same loads; None where friction changed in a tendon under tension.

        Parameters
        ----------
        before, after
            The solutions.
        changes
            By robot, changes of the inputs, see `input_changes`.
        numbering
            Of the unknowns.
        slope
            See `SolvedStep`.
        """
        if not _friction_kept(before, after):
            return None
        return cls(np.concatenate(changes), unknowns(before, numbering), unknowns(after, numbering), slope)

    def curvature(self, length: float, slope: Array) -> Array:
        """What a cubic polynomial adds to the linear change of the unknowns in a further step.

        The polynomial has the unknowns and slopes of both ends of this step; without the slope at its start it is
        quadratic (E. Hairer, S. P. Norsett, G. Wanner, Solving Ordinary Differential Equations I (1993), sec. II.6).

        Parameters
        ----------
        length
            Of this step over that of the further one [1].
        slope
            Linear change of the unknowns in the further one.
        """
        # x(t) = end + slope t + b t^2 + c t^3 is start at t = -length, with the slope of this step.
        mean = (self.end - self.start) / length
        quadratic = (slope - mean) / length
        if self.slope is None:
            return quadratic
        cubic = (slope + self.slope / length - 2.0 * mean) / length**2
        return np.asarray(quadratic + (length + 1.0) * cubic)


def unknowns(state: SolverState, numbering: Numbering) -> Array:
    """Twists of all elements, then tensions of tendons with prescribed displacement, of all robots."""
    parts = [twists.reshape(-1) for twists in state.configuration.twists]
    parts += [state.base_tension[p.robot][p.driven] for p in numbering.robots if p.driven.size]
    return np.concatenate(parts)


def input_changes(before: SolverState, target: Target) -> tuple[Array, ...]:
    """By robot, changes of tensions [N] and displacements [m] from a state to a target."""
    return tuple([new - old for old, new in zip(before.inputs, target.inputs, strict=True)])


def same_loads(before: SolverState, target: Target) -> bool:
    """Whether a target has the loads of a state."""
    return all(bool((a == b).all()) for a, b in zip(before.loads, target.loads, strict=True))


def _friction_kept(before: SolverState, after: SolverState) -> bool:
    """Whether no mobilisation of a tendon under tension changed."""
    for old, new, tension in zip(before.mobilisation, after.mobilisation, before.base_tension, strict=True):
        changed = old != new
        if changed.any() and changed[tension > 0.0].any():
            return False
    return True

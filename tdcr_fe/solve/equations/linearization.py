"""Linearised equilibrium: factors of the tangent, and the steps that follow from them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tdcr_fe.elements.backbone import ElementChain
from tdcr_fe.elements.complementarity import positive_definite_near, solve_nonnegative
from tdcr_fe.elements.forces import TendonForces
from tdcr_fe.solve.equations.factors import BorderedFactors, Factors
from tdcr_fe.solve.equations.numbering import Numbering, zero_bases
from tdcr_fe.solve.equations.solved_step import SolvedStep

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]


class Linearization(NamedTuple):
    """Equilibrium at fixed friction, linearised and factorised.

    Attributes
    ----------
    factorisation : Factors
        Of the tangent; `BorderedFactors` where any tendon has a prescribed displacement.
    chains : tuple of ElementChain
        The elements in whose frames its steps are.
    numbering : Numbering
        Of the unknowns.
    forces : tuple of TendonForces
        By robot, where it was linearised.
    solved : SolvedStep or None
        The step that ended here, where the next one may be predicted from it.
    """

    factorisation: Factors
    chains: tuple[ElementChain, ...]
    numbering: Numbering
    forces: tuple[TendonForces, ...]
    solved: SolvedStep | None = None

    @property
    def slack(self) -> tuple[Flags, ...]:
        """By robot, which of the tendons with prescribed displacement are slack; empty where there are none."""
        factors = self.factorisation
        if not isinstance(factors, BorderedFactors):
            return ()
        first = self.numbering.reduced
        return tuple(
            factors.slack[p.tensions.start - first : p.tensions.stop - first] for p in self.numbering.robots
        )

    def step(self, unbalanced: Array, forces: tuple[TendonForces, ...], inputs: tuple[Array, ...]) -> Array:
        """Step at fixed friction that undoes a residual, shape (linear,); the same tendons stay slack.

        Parameters
        ----------
        unbalanced
            Reduced residual, shape (reduced,).
        forces
            By robot.
        inputs
            By robot, prescribed tensions [N] and displacements [m], shape (m,).
        """
        factors = self.factorisation
        if not isinstance(factors, BorderedFactors):
            return factors.solve(-unbalanced)
        gap, tension = self._gaps(forces, inputs)
        return factors.solve(-np.concatenate((unbalanced, np.where(factors.slack, tension, gap))))

    def response(self, changes: tuple[Array, ...], clamped: Sequence[slice]) -> Array:
        """Change of the unknowns with the inputs, shape (linear,); the same tendons stay slack.

        Parameters
        ----------
        changes
            By robot, of the tensions [N] and displacements [m], shape (m,).
        clamped
            Unknowns of clamped bases.
        """
        right = np.zeros(self.numbering.linear)
        for part in self.numbering.robots:
            free = changes[part.robot]
            if part.driven.size:
                right[part.tensions] = np.where(self.slack[part.robot], 0.0, free[part.driven])
                free = free.copy()
                free[part.driven] = 0.0
            right[part.nodes] = -(self.forces[part.robot].base_tension_columns() @ free)
        zero_bases(right, clamped)
        return self.factorisation.solve(right)

    def complementarity_step(
        self, unbalanced: Array, forces: tuple[TendonForces, ...], inputs: tuple[Array, ...]
    ) -> tuple[Linearization, Array]:
        """Step at fixed friction in which tendons become slack or taut, and the linearisation with these.

        After the step every tendon with prescribed displacement is taut and meets it, or has no tension and takes less
        length than its base lets out: a complementarity problem in the tensions, with the robot in equilibrium.
        Arguments as of `step`.

        Far from a solution the problem may have none: with friction against the pull, or near buckling, a tendon that
        is pulled may let others go. The step is then that of a positive definite matrix nearby, which has one always;
        without it, slack tendons would stay slack, and the iteration where it is.
        """
        factors = self.factorisation
        if not isinstance(factors, BorderedFactors):
            return self, factors.solve(-unbalanced)
        gap, tension = self._gaps(forces, inputs)
        start = factors.inner.solve(-unbalanced)
        at_zero = gap + factors.rows @ start - factors.schur @ tension
        new, solved = solve_nonnegative(factors.schur, at_zero, tension)
        if not solved:
            new, solved = solve_nonnegative(positive_definite_near(factors.schur), at_zero, tension)
        if not solved:
            return self, self.step(unbalanced, forces, inputs)
        linear = self._replace(factorisation=factors.with_slack(new == 0.0))
        return linear, factors.at_tensions(start, new - tension)

    def _gaps(self, forces: tuple[TendonForces, ...], inputs: tuple[Array, ...]) -> tuple[Array, Array]:
        """By how much displacements exceed those prescribed [m], and the tensions of these tendons [N], (k,) each."""
        robots = self.numbering.robots
        gaps = [
            (forces[p.robot].field.base_slip - inputs[p.robot])[p.driven] for p in robots if p.driven.size
        ]
        tensions = [forces[p.robot].base_tension[p.driven] for p in robots if p.driven.size]
        if len(gaps) == 1:
            return gaps[0], tensions[0]
        return np.concatenate(gaps), np.concatenate(tensions)

    def turn_since(self, twists: tuple[Array, ...]) -> float:
        """Largest change of the rotation of any element since, with the present twists by robot [rad]."""
        pairs = zip(self.chains, twists, strict=True)
        return max([float(np.abs(new[:, 3:] - chain.twists[:, 3:]).max()) for chain, new in pairs])

"""Linearised equilibrium: factors of the tangent, and the steps that follow from them."""

from __future__ import annotations

from math import isfinite
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.lapack import dgetrf, dgetrs

from tdcr_fe.elements.backbone import ElementChain
from tdcr_fe.elements.forces import TendonForces
from tdcr_fe.solve.numbering import Numbering

Array = NDArray[np.float64]


class Factorisation(NamedTuple):
    """LU factors of a tangent.

    Attributes
    ----------
    lu : ndarray
        Of the transposed matrix.
    pivots : ndarray of int
    """

    lu: Array
    pivots: NDArray[np.int_]

    @classmethod
    def of(cls, matrix: Array) -> Factorisation:
        """Factorise, overwriting the matrix.

        Raises
        ------
        numpy.linalg.LinAlgError
            The matrix is singular.
        """
        lu, pivots, info = dgetrf(matrix.T, overwrite_a=True)
        if info != 0 or not isfinite(lu[-1, -1]):
            raise np.linalg.LinAlgError("singular matrix")
        return cls(lu, pivots)

    def solve(self, right: Array) -> Array:
        """Solution for one or several right sides."""
        solution: Array = dgetrs(self.lu, self.pivots, right, trans=1)[0]
        return solution

    @property
    def sign(self) -> int:
        """Sign of the determinant; it changes where an equilibrium loses its stability."""
        # The parity of row exchanges and negative pivots.
        turned = np.count_nonzero((self.pivots != np.arange(len(self.pivots))) ^ (self.lu.diagonal() < 0.0))
        return 1 if turned % 2 == 0 else -1


class Linearization(NamedTuple):
    """Equilibrium at fixed friction, linearised and factorised.

    Attributes
    ----------
    factorisation : Factorisation
        Of the tangent.
    chains : tuple of ElementChain
        The elements in whose frames its steps are.
    slack : tuple of ndarray of bool
        By robot, which of the tendons with prescribed displacement are slack; empty where there are none.
    numbering : Numbering
        Of the unknowns.
    """

    factorisation: Factorisation
    chains: tuple[ElementChain, ...]
    slack: tuple[NDArray[np.bool_], ...]
    numbering: Numbering

    def step(self, unbalanced: Array, forces: tuple[TendonForces, ...], inputs: tuple[Array, ...]) -> Array:
        """Step at fixed friction that undoes a residual, shape (linear,).

        Parameters
        ----------
        unbalanced
            Reduced residual, shape (reduced,).
        forces
            By robot.
        inputs
            By robot, prescribed tensions [N] and displacements [m], shape (m,).
        """
        numbering = self.numbering
        right = np.zeros(numbering.linear)
        np.negative(unbalanced, out=right[: numbering.reduced])
        for part in numbering.robots:
            if part.driven.size:
                own = forces[part.robot]
                gap = (own.field.base_slip - inputs[part.robot])[part.driven]
                tension = own.base_tension[part.driven]
                right[part.tensions] = -np.where(self.slack[part.robot], tension, gap)
        return self.factorisation.solve(right)

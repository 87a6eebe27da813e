"""Slips that are bilinear in the load factor and the unknowns, in place of a robot's."""

import numpy as np

from tdcr_fe.solve.friction_path.rates import SlipDerivatives, SlipState, SmallFactors


class LinearSlips:
    """``u = a x + b x^2 / 2 + (C0 + x C1) (z - z0)``; mobilisations first in ``z``, then tensions at the base.

    Parameters
    ----------
    by_load
        ``a`` and ``a + b``, shape (2, n).
    matrix
        Presliding distance times identity (zero for tensions) minus ``C`` at both ends, shape (2, n, n).
    start
        ``z0``, shape (n,).
    presliding
        [m].
    holes
        Number of mobilisations; None where all unknowns are.
    slack
        Of the tensions at the start, shape (n - holes,).
    """

    def __init__(self, by_load, matrix, start, presliding, holes=None, slack=()):
        self.breakpoints, self.compilable = np.ones(1), False
        self.transfer = self
        self._load, self._matrix, self._start = np.array(by_load), np.array(matrix), np.array(start)
        holes = len(start) if holes is None else holes
        self.elastic_slip = np.append(np.full(holes, presliding), np.zeros(len(start) - holes))
        self._first = np.append(np.zeros(holes), -np.array(slack))

    def _by_unknowns(self, x):
        return np.diag(self.elastic_slip) - (1.0 - x) * self._matrix[0] - x * self._matrix[1]

    def slip(self, x, z):
        """Slips, then minus the slack."""
        load = x * self._load[0] + 0.5 * x * x * (self._load[1] - self._load[0])
        return self._first + load + self._by_unknowns(x) @ (z - self._start)

    def at(self, x, z, tension):
        """As of `tdcr_fe.solve.friction_path.slips.InterpolatedSlips`: tensions stay as they are."""
        change = self._matrix[0] - self._matrix[1]
        load = (1.0 - x) * self._load[0] + x * self._load[1] + change @ (z - self._start)
        still, none = np.zeros(len(tension)), np.zeros((len(z), len(tension)))
        factors = SmallFactors(np.zeros((0, 0)), np.zeros(0, dtype=np.int32), False)
        given = (load, self.elastic_slip, self.branches(z, tension), still, none, none, factors)
        derivatives = SlipDerivatives(*given, np.zeros(len(z), dtype=bool), self.matrix(x).T.copy(), none)
        return SlipState(tension, self.slip(x, z), derivatives)

    def matrix(self, x):
        """Minus the derivatives of the complements by the unknowns."""
        return np.diag(self.elastic_slip) - self._by_unknowns(x)

    @staticmethod
    def branches(z, tension):
        """As of `tdcr_fe.solve.friction_path.transfer.AdhesiveTransfer`: derivatives do not jump."""
        return np.zeros(0, dtype=bool)

    @staticmethod
    def distance_to_branch_change(z, rate, tension, tension_rate):
        """As of `tdcr_fe.solve.friction_path.slips.InterpolatedSlips`."""
        return np.inf

"""Linearised equilibrium: the tangent of a scene, its factors, and the steps that follow from them."""

from __future__ import annotations

from collections.abc import Sequence
from math import isfinite
from typing import NamedTuple

import numpy as np
from scipy.linalg.lapack import dgetrf, dgetrs

from tdcr_fe.elements import Array, Flags, Index
from tdcr_fe.elements.backbone import BackboneMesh, ElementChain, NodeStiffness
from tdcr_fe.elements.complementarity import positive_definite_near, solve_box
from tdcr_fe.elements.forces import SlipEquations, TendonForces
from tdcr_fe.solve.equations.band import BandFactors
from tdcr_fe.solve.equations.configuration import SolverState, Target
from tdcr_fe.solve.equations.kernel import Residual
from tdcr_fe.solve.equations.layout import Numbering


class DenseFactors(NamedTuple):
    """LU factors of a full matrix."""

    lu: Array  # Factors L and U of the transposed matrix
    pivots: Index

    @classmethod
    def of(cls, matrix: Array) -> DenseFactors:
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
        """Solution for one or several right sides, shape (n,) or (n, k)."""
        return dgetrs(self.lu, self.pivots, right, trans=1)[0]

    @property
    def sign(self) -> int:
        """Sign of the determinant; it changes where an equilibrium loses its stability."""
        # The parity of row exchanges and negative pivots.
        turned = np.count_nonzero((self.pivots != np.arange(len(self.pivots))) ^ (self.lu.diagonal() < 0.0))
        return 1 if turned % 2 == 0 else -1


class BorderedFactors(NamedTuple):
    """Factors of a tangent with the tensions of tendons with prescribed displacement as further unknowns.

    The matrix is ``[[K, C], [R, D]]``. The rows of slack tendons are those of the identity, so another set of slack
    tendons takes the factors of a small matrix only.
    """

    inner: Factors  # Factors of ``K``, the tangent at fixed tensions
    columns: Array  # (n, k): ``K^-1 C``
    rows: Array  # (k, n): ``R``: change of the displacements at the base [m]
    # (k, k): ``D - R K^-1 C``: change of these displacements by the tensions, with the robot in equilibrium
    # [m/N]
    schur: Array
    slack: Flags  # (k,): Which of these tendons are slack
    border: DenseFactors  # Factors of ``schur`` with the rows of slack tendons replaced

    @classmethod
    def of(cls, inner: Factors, residual: Residual, numbering: Numbering) -> BorderedFactors:
        """From the factors of ``K``, and the forces in the state of a residual.

        Raises
        ------
        numpy.linalg.LinAlgError
            The matrix is singular.
        """
        slips = joined_slips(numbering, residual.forces, holes=False)
        response, slack = inner.solve(slips.columns), numbering.at_driven(residual.state.base_tension) <= 0.0
        schur = slips.matrix - slips.rows @ response
        return cls(inner, response, slips.rows, schur, slack, _border(schur, slack))

    def with_slack(self, slack: Flags) -> BorderedFactors:
        """The factors with another set of slack tendons; raises as `of`."""
        if np.array_equal(slack, self.slack):
            return self
        return self._replace(slack=slack, border=_border(self.schur, slack))

    def giving_way(self, compliance: Array) -> BorderedFactors:
        """The factors where each tendon gives way at its base [m/N], infinitely where it is slack, shape (k,)."""
        slack = np.isinf(compliance)
        border = _border(self.schur + np.diag(np.where(slack, 0.0, compliance)), slack)
        return self._replace(slack=slack, border=border)

    def compliances(self) -> Array:
        """Change of each displacement by its tension, while other tendons stay taut or slack [m/N], shape (k,)."""
        found = np.zeros(len(self.slack))
        for i in range(len(found)):
            slack = self.slack & (np.arange(len(found)) != i)
            found[i] = 1.0 / _border(self.schur, slack).solve(np.eye(len(found))[i])[i]
        return found

    def solve(self, right: Array) -> Array:
        """See `DenseFactors.solve`."""
        n = self.rows.shape[1]
        start = self.inner.solve(right[:n])
        given = right[n:][self.slack]
        rest = right[n:] - self.rows @ start
        rest[self.slack] = given
        change = self.border.solve(rest)
        # Without round-off: a tendon with any tension counts as taut.
        change[self.slack] = given
        return self.at_tensions(start, change)

    def at_tensions(self, start: Array, change: Array) -> Array:
        """The solution from that at fixed tensions, and the change of the tensions."""
        n = len(start)
        solution = np.empty((n + len(change), *start.shape[1:]), order="F")
        np.subtract(start, self.columns @ change, out=solution[:n])
        solution[n:] = change
        return solution

    @property
    def sign(self) -> int:
        """See `DenseFactors.sign`."""
        return self.inner.sign * self.border.sign


def joined_slips(numbering: Numbering, forces: Sequence[TendonForces], holes: bool) -> SlipEquations:
    """Slip equations of all robots: of the unknown tensions at the base, then with ``holes`` of the mobilisations."""
    count = (numbering.total if holes else numbering.linear) - numbering.reduced
    columns = np.zeros((numbering.reduced, count), order="F")
    found = SlipEquations(np.zeros((count, numbering.reduced)), np.zeros((count, count)), columns)
    for part in numbering.robots:
        slips = forces[part.robot].slip_equations(holes)
        own = np.append(part.driven, np.arange(len(part.frictional), len(slips.matrix)))
        here = np.r_[part.tensions, part.mobilisations][: len(own)] - numbering.reduced
        found.rows[here, part.nodes], columns[part.nodes, here] = slips.rows[own], slips.columns[:, own]
        found.matrix[np.ix_(here, here)] = slips.matrix[np.ix_(own, own)]
    columns[numbering.clamped] = 0.0
    return found


def _border(schur: Array, slack: Flags) -> DenseFactors:
    """Factors of a small matrix with rows of the identity for slack tendons."""
    return DenseFactors.of(np.where(slack[:, None], np.eye(len(slack)), schur))


#: A factorised matrix.
Factors = DenseFactors | BandFactors | BorderedFactors


class SolvedStep(NamedTuple):
    """A solved step in which nothing but the inputs of tendons changed, and friction kept its state."""

    loading: Array  # Change of the inputs of all tendons [N, m]
    start: Array  # Unknowns at its start, see `unknowns`
    end: Array  # Unknowns at its end
    slope: Array | None  # Derivative of the unknowns at its start, times its length; None where it is unknown
    slips: Array | None  # The same of the slips of all frictional holes [m]

    def curvature(self, length: float, slope: Array) -> Array:
        """What a cubic polynomial adds to the linear change of the unknowns in a further step.

        The polynomial has the unknowns and slopes of both ends of this step; without the slope at its start it is
        quadratic (E. Hairer, S. P. Norsett, G. Wanner, Solving Ordinary Differential Equations I (1993), sec. II.6).

        Parameters
        ----------
        length
            Length of this step over that of the further one [1].
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
    twists = [own.reshape(-1) for own in state.configuration.twists]
    return np.concatenate((*twists, numbering.at_driven(state.base_tension)))


def input_changes(before: SolverState, target: Target | SolverState) -> tuple[Array, ...]:
    """By robot, changes of tensions [N] and displacements [m] from a state to a target, or a solution under it."""
    return tuple([new - old for old, new in zip(before.inputs, target.inputs, strict=True)])


def same_loads(before: SolverState, target: Target | SolverState) -> bool:
    """Whether a target, or a solution under it, has the loads of a state."""
    return all(bool((a == b).all()) for a, b in zip(before.loads, target.loads, strict=True))


def _friction_kept(before: SolverState, after: SolverState) -> bool:
    """Whether no mobilisation of a tendon under tension changed."""
    for old, new, tension in zip(before.mobilisation, after.mobilisation, before.base_tension, strict=True):
        changed = old != new
        if changed.any() and changed[tension > 0.0].any():
            return False
    return True


class Linearization(NamedTuple):
    """Equilibrium at fixed friction, linearised and factorised."""

    # Factors of the tangent; `BorderedFactors` where any tendon has a prescribed displacement
    factorisation: Factors
    chains: tuple[ElementChain, ...]  # The elements in whose frames its steps are
    numbering: Numbering  # Order of the unknowns
    forces: tuple[TendonForces, ...]  # By robot, forces in the state in which it was linearised
    solved: SolvedStep | None = None  # The step that ended here, where the next one may be predicted from it

    @property
    def slack(self) -> Flags:
        """Which of all tendons with prescribed displacement are slack, see `Numbering.at_driven`."""
        factors = self.factorisation
        return factors.slack if isinstance(factors, BorderedFactors) else np.zeros(0, dtype=bool)

    def response(self, changes: tuple[Array, ...]) -> Array:
        """Change of the unknowns with the inputs, shape (linear,); the same tendons stay slack.

        Parameters
        ----------
        changes
            By robot, of the tensions [N] and displacements [m], shape (m,).
        """
        right = np.zeros(self.numbering.linear)
        right[self.numbering.reduced :] = np.where(self.slack, 0.0, self.numbering.at_driven(changes))
        for part in self.numbering.robots:
            free = changes[part.robot].copy()
            free[part.driven] = 0.0
            right[part.nodes] = -(self.forces[part.robot].base_tension_columns() @ free)
        right[self.numbering.clamped] = 0.0
        return self.factorisation.solve(right)

    def ended_by(
        self, loading: Array, before: SolverState, after: SolverState, *slopes: Array | None
    ) -> Linearization:
        """The same with the step between two solutions; the other arguments are fields of `SolvedStep`.

        Without a step where loads changed, or the friction in a tendon under tension.
        """
        kept = same_loads(before, after) and _friction_kept(before, after)
        ends = [unknowns(state, self.numbering) for state in (before, after)]
        return self._replace(solved=SolvedStep(loading, *ends, *slopes) if kept else None)

    def complementarity_step(
        self, unbalanced: Array, forces: tuple[TendonForces, ...], inputs: tuple[Array, ...]
    ) -> tuple[Linearization, Array]:
        """Step at fixed friction in which tendons become slack or taut, and the linearisation with these.

        After the step every tendon with prescribed displacement is taut and meets it, or has no tension and takes less
        length than its base lets out: a complementarity problem in the tensions, with the robot in equilibrium.

        Far from a solution the problem may have none: with friction against the pull, or near buckling, a tendon that
        is pulled may let others go. The step is then that of a positive definite matrix nearby, which has one always;
        without it, slack tendons would stay slack, and the iteration where it is.

        Parameters
        ----------
        unbalanced
            Reduced residual, shape (reduced,).
        forces
            By robot.
        inputs
            By robot, prescribed tensions [N] and displacements [m], shape (m,).
        """
        factors, pick = self.factorisation, self.numbering.at_driven
        if not isinstance(factors, BorderedFactors):
            return self, factors.solve(-unbalanced)
        # By how much displacements exceed those prescribed [m].
        gap = pick([own.field.base_slip - given for own, given in zip(forces, inputs, strict=True)])
        tension = pick([own.base_tension for own in forces])
        start = factors.inner.solve(-unbalanced)
        at_zero = gap + factors.rows @ start - factors.schur @ tension
        new, solved = solve_box(factors.schur, -at_zero, tension, 0.0, np.inf)
        if not solved:
            new, _ = solve_box(positive_definite_near(factors.schur), -at_zero, tension, 0.0, np.inf)
        linear = self._replace(factorisation=factors.with_slack(new == 0.0))
        return linear, factors.at_tensions(start, new - tension)

    def twist_changes(self, step: Array) -> Array:
        """Change of the twists of all elements with the unknowns of equilibrium, to first order."""
        parts = zip(self.chains, self.numbering.robots, strict=True)
        changes = [chain.changes(step[part.nodes].reshape(-1, 6)) for chain, part in parts]
        return np.concatenate([change.reshape(-1) for change in changes])


def backbone_tangent(
    residual: Residual, robot: int, nodes: slice, damping: Array, mesh: BackboneMesh | None = None
) -> NodeStiffness:
    """What Exudyn's Jacobian leaves out of the tangent of a backbone, or with a mesh all of it.

    These are the geometric terms of unbalanced wrenches, and the damping of pseudo-transient continuation.

    Parameters
    ----------
    residual
        Residual of a state.
    robot, nodes
        Its number, and its nodes among those of all robots.
    damping
        See `damping_of_node`, shape (6,).
    mesh
        Mesh of the only robot, where nothing else resists.
    """
    configuration = residual.state.configuration
    wrenches = residual.unbalanced[6 * nodes.start : 6 * nodes.stop]
    found = configuration.chains[robot].tangent(wrenches, *configuration.poses[robot], mesh)
    component = np.arange(6)
    # Exudyn's Jacobian is that of the right-hand side: minus the stiffness.
    found.itself[:, component, component] -= damping
    return found


def damping_of_node(damping: float, length: float) -> Array:
    """Damping of pseudo-transient continuation [N m] by the increments of a node, shape (6,).

    Forces act by a lever of the length [m].
    """
    return np.array([damping / length**2] * 3 + [damping] * 3)


def hold(k: Array, bases: Index) -> None:
    """Replace the equations of clamped bases, see `Numbering.clamped`, by zero increments."""
    k[bases] = 0.0
    k[bases, bases] = 1.0

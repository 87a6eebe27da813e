"""Whether an equilibrium in contact, or with buckled bays, is stable, and along which motions it is not.

A robot that is pressed against an obstacle may lose its stability and slide off to one side. Beyond that load the state
that goes on pressing is an equilibrium, too, and Newton's method finds it as easily. So it is with tendons that
compress a bay beyond its buckling load: a large load step may end bent to the wrong side. The response of the nodes to
small forces shows it: in a stable equilibrium no force moves them against itself,

    f^T C f > 0  for all forces f on the nodes, with their compliance C,

everything else in the scene eliminated: other bodies, joints, driven tendons, and holes that stick. Where friction
makes the compliance unsymmetric, its eigenvalues decide (R. Hill, J. Mech. Phys. Solids 6 (1958) 236-249).
"""

from __future__ import annotations

import numpy as np
from scipy.linalg import LinAlgError, cholesky, eig, qr, solve_triangular

from tdcr_fe.elements import Array, Index
from tdcr_fe.solve.equations.configuration import SolverState
from tdcr_fe.solve.equations.kernel import Residual
from tdcr_fe.solve.equations.linearization import Linearization, damping_of_node
from tdcr_fe.solve.equations.system import SceneSystem
from tdcr_fe.solve.newton.steps import FrictionCoupling

#: Round-off: part of the largest compliance that a negative one may have, of a motion that a coordinate may, and of a
#: displacement that may be along another one; and what an eigenvalue of `tdcr_fe.solve.stability` may be below zero,
#: 3e-6 of round columns that have buckled, which turn at no cost [1].
ROUND_OFF = 1e-5
#: Pivot of the tangent, its rows and columns of length 1, below which a motion meets no resistance [1].
NO_RESISTANCE = 1e-10


def unstable_motions(system: SceneSystem, residual: Residual) -> Array:
    """Increments of the nodes along which an equilibrium is unstable; none if it is stable.

    Parameters
    ----------
    system
        The scene.
    residual
        The last one evaluated, of a solved state, which is in the scene.

    Returns
    -------
    ndarray, shape (k, 6 N)
        Body-frame increments, the largest displacement 1; those of clamped bases are zero.
    """
    free = np.ones(6 * system.layout.reduction.nodes, dtype=bool)
    none = np.zeros((0, len(free)))
    try:
        linear = system.linearize(residual, system.numbering())
    except LinAlgError:
        return none
    free[linear.numbering.clamped] = False
    scale = np.sqrt(np.tile(damping_of_node(1.0, system.length), system.layout.reduction.nodes)[free])
    compliance = scale[:, None] * _compliance(system, residual, linear, np.flatnonzero(free)) * scale
    least = ROUND_OFF * float(np.abs(compliance).max())
    try:
        cholesky(0.5 * (compliance + compliance.T) + least * np.eye(len(compliance)))
        return none
    except LinAlgError:
        values, vectors = eig(compliance)
    below = values.real < -least
    motions = np.zeros((np.count_nonzero(below), len(free)))
    motions[:, free] = scale * vectors[:, below].real.T
    moved = motions.reshape(len(motions), len(free) // 6, 6)[..., :3]
    return motions / np.abs(moved).max(axis=(1, 2))[:, None]


def _compliance(system: SceneSystem, residual: Residual, linear: Linearization, which: Index) -> Array:
    """Increments of the nodes by forces on them, shape (k, k), for the unknowns of these numbers, shape (k,)."""
    numbering = linear.numbering
    right = np.zeros((numbering.linear, len(which)), order="F")
    # The tangent is minus the stiffness.
    right[which, np.arange(len(which))] = -1.0
    moved = linear.factorisation.solve(right)
    if numbering.has_friction:
        mobilised = numbering.at_frictional_holes(residual.state.mobilisation)
        stuck = np.flatnonzero(np.abs(mobilised) < 1.0)
        flexibility = numbering.at_frictional_holes([own.resting_flexibility for own in residual.forces])
        coupling = FrictionCoupling.of(numbering, residual.forces, linear.slack)
        columns, matrix = coupling.response(linear.factorisation.solve, stuck, flexibility)
        held = np.linalg.solve(matrix[stuck], coupling.rows[stuck] @ moved)
        moved = moved + columns @ held
    return moved[which]


def freely_moving(system: SceneSystem, state: SolverState) -> list[str]:
    """Robots and bodies by name that some motion without resistance displaces; none where it is not found.

    Parameters
    ----------
    system
        The scene.
    state
        In which it is at rest.
    """
    system.layout.space.write(state.configuration)
    # Without the forces of joints: they turn what spins freely, too, where it is not in equilibrium.
    tangent = system.kernel.exudyns_jacobian(loads=True)
    for axis in (1, 0):
        size = np.linalg.norm(tangent, axis=axis, keepdims=True)
        tangent = np.divide(tangent, size, out=np.zeros_like(tangent), where=size > 0.0)
    # The columns of what moves freely depend on the others, with the coordinates of the motion.
    triangle, order = qr(tangent, mode="r", pivoting=True)
    held = int(np.count_nonzero(np.abs(triangle.diagonal()) > NO_RESISTANCE))
    motions = solve_triangular(triangle[:held, :held], triangle[:held, held:])
    displaced = np.abs(motions).max(axis=1, initial=0.0) > ROUND_OFF
    return _moved(system, np.append(order[:held][displaced], order[held:]))


def _moved(system: SceneSystem, coordinates: Index) -> list[str]:
    """Names of the robots, and of the bodies beside them, that have any of the scene's ODE2 coordinates."""
    mbs, left, found = system.mbs, set(coordinates.tolist()), []
    for robot in system.robots:
        own = set(robot.coordinates.ravel().tolist())
        found += [] if own.isdisjoint(left) else [f"robot {robot.name!r}"]
        left -= own
    for i in range(mbs.systemData.NumberOfObjects()):
        own = set(mbs.systemData.GetObjectLTGODE2(i))
        found += [] if own.isdisjoint(left) else [repr(mbs.GetObject(i)["name"])]
        left -= own
    return found

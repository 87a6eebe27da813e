"""Discretisation error of solved states: estimate per step, mesh refinement, and axial load of every bay.

The estimate is a defect correction. In a solved state every element of the backbone has a wrench at its first node.
Under that wrench the Cosserat equations along the element are integrated to high accuracy (collocation at four Gauss
points), own weight and tendons that follow the backbone included. Where the exact relative pose of the element's ends
differs from that of the finite element, the difference ``e`` is an eigenstrain that the mesh neglects. Exact
elements, fixed in the solved configuration, would load the nodes with

    r = B^T K e + r_w ,

with the element's strain matrix ``B``, its stiffness ``K`` (that of the wrench's direction included), and the moment
``r_w`` by which own weight along a bent element differs from own weight lumped at its nodes. The tangent of the solved
state takes ``r`` to the displacement of all nodes: the error of the configuration to first order, amplified near
buckling as it must be (documentation, page "Theory").
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tdcr_fe.elements.backbone import add_residual_flexibility, strain_matrices
from tdcr_fe.elements.poses import coefficients, cross, exp_matrix, inverse_tangent_se3, skew
from tdcr_fe.elements.section import SectionForces
from tdcr_fe.model.loading import Model
from tdcr_fe.scene import TDCR
from tdcr_fe.solve.simulation import Simulation

Array = NDArray[np.float64]

_QUADRATURE_POINTS, _QUADRATURE_WEIGHTS = np.polynomial.legendre.leggauss(4)
#: Gauss points on [0, 1] and their weights; the same points at which `SectionForces` has the tendons.
POINTS: Array = 0.5 * (_QUADRATURE_POINTS + 1.0)
WEIGHTS: Array = 0.5 * _QUADRATURE_WEIGHTS


def _collocation_matrix() -> Array:
    """Integrals from 0 to every Gauss point of the polynomial through values at these points, shape (4, 4)."""
    powers = np.arange(len(POINTS))
    values = POINTS[:, None] ** powers
    integrals = POINTS[:, None] ** (powers + 1) / (powers + 1)
    return np.asarray(np.linalg.solve(values.T, integrals.T).T)


_INTEGRALS = np.concatenate((_collocation_matrix(), WEIGHTS[None]))
#: The pose of no motion, row by row, and ``strain @ _RATES``, the derivative of a pose in its own frame, row by row.
_IDENTITY: Array = np.eye(3, 4).ravel()
_RATES: Array = np.zeros((6, 3, 4))
_RATES[3:, :, :3] = skew(np.eye(3))
_RATES[:3, :, 3] = np.eye(3)
_RATES = _RATES.reshape(6, 12)
#: Fixed-point iterations of the collocation equations, least and most; the change of the elements' ends in one,
#: over their distance from the ends of the finite elements, that stops them.
LEAST_SWEEPS, MOST_SWEEPS, SWEEP_CHANGE = 4, 12, 0.01
#: Solved states that are estimated at once.
CHUNK = 8
#: Limits of automatic refinement: elements of one bay, elements of a robot, and meshes tried.
MOST_PER_BAY, MOST_ELEMENTS, MOST_MESHES = 32, 320, 6
#: Largest growth of a bay's number of elements from one mesh to the next.
GROWTH = 4
#: Fraction of its buckling load above which a bay causes a warning [1].
NEAR_BUCKLING = 0.5


@dataclass(frozen=True)
class ElementModel:
    """Stiffness, weight and bays of the elements of one backbone.

    Attributes
    ----------
    lengths : ndarray, shape (E,)
        Of the elements [m].
    element_stiffness : ndarray, shape (E, 6)
        Of the finite elements, in beam axes, as in `BackboneMesh.stiffness`.
    reference_strain : ndarray, shape (6,)
        Of the unloaded backbone, in beam axes [1, 1/m].
    flexible : ndarray of bool, shape (E,)
        False in rigid inserts, which have no error.
    section : SectionForces or None
        Tendons that follow the backbone, and superelastic softening.
    weight : ndarray, shape (3,)
        Own weight of the backbone per length, world axes [N/m].
    bays : ndarray of int, shape (E,)
        Number of the bay that an element lies in, from 0.
    cantilever : bool
        Whether the last bay ends at a free tip without a disk.
    """

    lengths: Array
    element_stiffness: Array
    reference_strain: Array
    flexible: NDArray[np.bool_]
    section: SectionForces | None
    weight: Array
    bays: NDArray[np.int_]
    cantilever: bool = False

    @classmethod
    def of(cls, handle: TDCR) -> ElementModel:
        """The elements of a robot in a scene, with their current compliance."""
        mesh, robot = handle.mesh, handle.robot
        stiffness = mesh.stiffness.copy()
        growth = handle.compliance_factor
        if growth != 1.0:
            add_residual_flexibility(stiffness, mesh.lengths, growth - 1.0)
            stiffness[:, 3:] /= growth
            stiffness[handle.rigid] = mesh.stiffness[handle.rigid]
        middle = 0.5 * (mesh.arc_lengths[1:] + mesh.arc_lengths[:-1])
        disks = np.asarray(robot.disks.positions, dtype=float)
        return cls(
            mesh.lengths,
            stiffness,
            np.concatenate(([1.0, 0.0, 0.0], mesh.precurvature)),
            ~handle.rigid,
            handle.actuation.section,
            robot.backbone.mass_per_length * np.asarray(handle.model.gravity, dtype=float),
            np.searchsorted(disks, middle),
            not disks.size or disks[-1] < mesh.arc_lengths[-1] - 1e-9,
        )

    @property
    def section_stiffness(self) -> Array:
        """Of the section itself: without the residual flexibility of bending in the shear, shape (E, 6)."""
        stiffness = self.element_stiffness.copy()
        residual = self.lengths[:, None] ** 2 / (12.0 * stiffness[:, 5:3:-1])
        stiffness[:, 1:3] = 1.0 / (1.0 / stiffness[:, 1:3] - residual)
        return stiffness


@dataclass(frozen=True)
class SolvedState:
    """Quantities of a solved state that the estimate needs.

    Attributes
    ----------
    twists : ndarray, shape (E, 6)
        Of the elements, length times strain.
    rotations : ndarray, shape (E, 3, 3)
        Of the first node of every element, in beam axes.
    tensions : ndarray, shape (m,)
        At the base [N].
    tangent_twists : ndarray, shape (E, 6)
        Of the elements where the tangent was factorised: in the solved state, or one iteration before. Forces and
        changes are taken by the twists of these elements, in which the tangent changes little.
    solve : callable
        Solves for body-frame increments of the nodes (6 N, k) under wrenches on the nodes (6 N, k) with that tangent,
        with mobilisations fixed and displacement-driven tendons taut.
    """

    twists: Array
    rotations: Array
    tensions: Array
    tangent_twists: Array
    solve: Callable[[Array], Array]

    @classmethod
    def of(cls, simulation: Simulation) -> SolvedState:
        """The last solved state of a simulation, with the tangent that was factorised last."""
        linearization, state = simulation.linearization(), simulation.state
        factorisation = linearization.factorisation
        nodes = slice(0, 6 * len(simulation.handle.nNodes))
        clamped = bool(simulation.system.layout.clamps)

        def solve(wrenches: Array) -> Array:
            right = np.zeros((len(factorisation.lu), wrenches.shape[1]), order="F")
            # The tangent is that of the forces on the nodes: minus the stiffness.
            right[nodes] = -wrenches
            if clamped:
                right[nodes][:6] = 0.0
            return factorisation.solve(right)[nodes]

        return cls(
            state.configuration.twists[0],
            state.configuration.poses[0][1][:-1],
            state.base_tension[0],
            linearization.chains[0].twists,
            solve,
        )


@dataclass(frozen=True)
class MeshEstimate:
    """Estimated discretisation error of one solved state.

    Attributes
    ----------
    nodes : ndarray, shape (N-1, 3)
        Estimated displacement of the nodes 1 .. N-1 to their positions with exact elements, world axes [m].
    by_bay : ndarray, shape (B,), or None
        Largest displacement of a node that each bay's own defect causes [m]; None where the error is below the goal.
    bay_loads : ndarray, shape (B,)
        Axial compression of each bay over its buckling load, see `bay_loads`; zero where it is not defined [1].
    """

    nodes: Array
    by_bay: Array | None
    bay_loads: Array

    @property
    def largest(self) -> float:
        """Largest displacement of a node [m]."""
        return float(np.sqrt(np.max(np.einsum("ni,ni->n", self.nodes, self.nodes))))


def _tendon_gradient(section: SectionForces, strain: Array, tensions: Array) -> Array:
    """Wrench that the tendons along the backbone give the section, at the Gauss points, shape (S, E, 4, 6)."""
    assert section.tendons is not None
    total = np.zeros_like(strain)
    for i, (offset, slope, weight) in enumerate(
        zip(section.tendons.offset, section.tendons.slope, section.tendons.weight, strict=True)
    ):
        a = strain[..., :3] + cross(strain[..., 3:], offset) + slope
        pull = tensions[:, i, None] * weight
        t = a * (pull[..., None] / np.sqrt(np.einsum("...i,...i->...", a, a)))[..., None]
        total[..., :3] += t
        total[..., 3:] += cross(offset, t)
    return total


def _softened_curvature(section: SectionForces, moment: Array, bend: Array, compliance: Array) -> Array:
    """Curvature change of a superelastic section under a bending moment, by Newton from a known one, (S, E, 4, 2)."""
    law = section.superelastic
    assert law is not None
    w, kc, lost = law.threshold / 40.0, law.threshold, 1.0 - law.ratio
    size = np.sqrt(np.einsum("...i,...i->...", moment, moment))
    goal = size * compliance
    k = np.sqrt(np.einsum("...i,...i->...", bend, bend))
    for _ in range(3):
        x = (k - kc) / w
        value = k - lost * w * (np.logaddexp(0.0, x) - np.logaddexp(0.0, -kc / w))
        slope = 1.0 - lost * 0.5 * (1.0 + np.tanh(0.5 * x))
        k = np.maximum(k + (goal - value) / slope, 0.0)
    return np.asarray(moment * (k / np.where(size > 0.0, size, 1.0))[..., None])


def _force_gradient(model: ElementModel, twists: Array, tensions: Array) -> Array:
    """Derivative of the elements' energy by their twists, shape (S, E, 6)."""
    h = model.lengths[:, None]
    gradient = model.element_stiffness * (twists / h - model.reference_strain)
    section = model.section
    if section is not None and section.superelastic is not None:
        gradient = gradient + section.superelastic.gradient(twists, model.lengths)
    if section is not None and section.tendons is not None:
        strain = np.broadcast_to((twists / h)[..., None, :], (*twists.shape[:-1], len(POINTS), 6))
        gradient = gradient + np.einsum("g,segi->sei", WEIGHTS, _tendon_gradient(section, strain, tensions))
    return gradient


def _stiffness_times(model: ElementModel, twists: Array, strain: Array) -> Array:
    """Stiffness of the elements times changes of their twists, shape (S, E, 6)."""
    h = model.lengths[:, None]
    force = model.element_stiffness / h * strain
    law = None if model.section is None else model.section.superelastic
    if law is not None:
        bend = twists[..., 4:] / h - law.precurvature[1:]
        k = np.sqrt(np.einsum("...i,...i->...", bend, bend))
        x = (k - law.threshold) / (law.threshold / 40.0)
        lost = (1.0 - law.ratio) * law.bending_stiffness / model.lengths
        secant = np.logaddexp(0.0, x) - np.logaddexp(0.0, -40.0)
        secant *= law.threshold / 40.0 / np.where(k > 0.0, k, 1.0)
        along = bend / np.where(k > 0.0, k, 1.0)[..., None]
        part = np.einsum("...i,...i->...", along, strain[..., 4:])
        slope = 0.5 * (1.0 + np.tanh(0.5 * x))
        force[..., 4:] -= (lost * secant)[..., None] * strain[..., 4:]
        force[..., 4:] -= (lost * (slope - secant) * part)[..., None] * along
    return force


def _transposed(matrices: Array, vectors: Array) -> Array:
    """Transposed matrices times vectors: (..., n, k) and (..., n) to (..., k)."""
    return np.asarray((vectors[..., None, :] @ matrices)[..., 0, :])


def exact_elements(
    model: ElementModel, twists: Array, wrenches: Array, weight: Array, tensions: Array
) -> tuple[Array, Array]:
    """Integrate the Cosserat equations along every element under the wrench at its first node.

    Parameters
    ----------
    model
        The elements.
    twists
        Of the finite elements, where the iteration starts, shape (S, E, 6).
    wrenches
        At the first node, in its frame, shape (S, E, 6).
    weight
        Own weight per length in the frame of the first node [N/m], shape (S, E, 3).
    tensions
        At the base [N], shape (S, m).

    Returns
    -------
    ends : ndarray, shape (S, E, 3, 4)
        Rotation and position of the last node in the frame of the first.
    moments : ndarray, shape (S, E, 3)
        First moment of the curve: integral of its position over the element [m^2].
    """
    section = model.section
    compliance = (1.0 / model.section_stiffness)[:, None, :]
    h = model.lengths[:, None]
    start = twists[..., None, :] * POINTS[:, None]
    poses = exp_matrix(start, coefficients(start[..., 3:]))[..., :3, :]
    strain = np.broadcast_to((twists / h)[..., None, :], start.shape)
    force, moment = wrenches[..., None, :3], wrenches[..., None, 3:]
    along = (model.lengths[:, None] * POINTS)[..., None]
    integrals = _INTEGRALS * model.lengths[:, None, None]
    heavy = bool(np.any(model.weight))
    both = np.empty((*start.shape[:-1], 2, 3))
    both[..., 0, :] = force - weight[..., None, :] * along
    moments = np.zeros((*twists.shape[:-1], 3))
    ends = poses[..., 0, :, :]
    arm = skew(force)
    own = exp_matrix(twists, coefficients(twists[..., 3:]))[..., :3, :]
    for sweep in range(1, MOST_SWEEPS + 1):
        p = poses[..., 3]
        both[..., 1, :] = moment + (arm @ p[..., None])[..., 0]
        if heavy:
            below = integrals @ p
            moments = below[..., -1, :]
            both[..., 1, :] += cross(along * p - below[..., :-1, :], weight[..., None, :])
        wrench = (both @ poses[..., :3]).reshape(start.shape)
        if section is not None and section.tendons is not None:
            wrench = wrench - _tendon_gradient(section, strain, tensions)
        new = model.reference_strain + wrench * compliance
        if section is not None and section.superelastic is not None:
            bend = strain[..., 4:] - model.reference_strain[4:]
            new[..., 4:] = model.reference_strain[4:] + _softened_curvature(
                section, wrench[..., 4:], bend, compliance[..., 5]
            )
        strain = new
        rates = poses[..., :3] @ strain.dot(_RATES).reshape(*start.shape[:-1], 3, 4)
        every = integrals @ rates.reshape(*start.shape[:-1], 12)
        every += _IDENTITY
        every = every.reshape(*every.shape[:-1], 3, 4)
        before, poses, ends = ends, every[..., :-1, :, :], every[..., -1, :, :]
        if sweep >= LEAST_SWEEPS:
            change = np.abs(ends - before).max(axis=(1, 2, 3))
            if np.all(change <= SWEEP_CHANGE * np.abs(ends - own).max(axis=(1, 2, 3))):
                break
    return ends, moments


def defects(
    model: ElementModel, twists: Array, rotations: Array, tensions: Array
) -> tuple[Array, Array | None]:
    """Additional forces (by the elements' twists) and couples of exact elements in the solved configuration.

    Parameters
    ----------
    model
        The elements.
    twists, rotations, tensions
        Of several solved states, as in `SolvedState`, with one more axis in front.

    Returns
    -------
    forces : ndarray, shape (S, E, 6)
        ``K e`` of every element.
    couples : ndarray, shape (S, E, 3), or None
        ``r_w`` on the last node of every element, world axes [N m]; None without own weight.
    """
    weight = np.swapaxes(rotations, -1, -2) @ model.weight
    gradient = _force_gradient(model, twists, tensions)
    to_first = inverse_tangent_se3(-twists)
    own_wrenches = _transposed(to_first, gradient)
    wrenches = own_wrenches.copy()
    wrenches[..., :3] += 0.5 * weight * model.lengths[:, None]
    ends, moments = exact_elements(model, twists, wrenches, weight, tensions)
    own = exp_matrix(twists, coefficients(twists[..., 3:]))
    back = np.swapaxes(own[..., :3, :3], -1, -2)
    turn = back @ ends[..., :3]
    change = np.empty_like(twists)
    change[..., :3] = (back @ (ends[..., 3] - own[..., :3, 3])[..., None])[..., 0]
    change[..., 3:] = 0.5 * (turn[..., (2, 0, 1), (1, 2, 0)] - turn[..., (1, 2, 0), (2, 0, 1)])
    tangent = inverse_tangent_se3(twists)
    eigenstrain = (tangent @ change[..., None])[..., 0]
    force = _stiffness_times(model, twists, eigenstrain)
    # The wrench belongs to the exact pose; its generalised force differs where the pose differs.
    moved = _transposed(inverse_tangent_se3(-twists - eigenstrain), gradient) - own_wrenches
    from_first: Array = np.linalg.inv(to_first).astype(np.float64)
    force += _transposed(from_first, moved)
    force[:, ~model.flexible] = 0.0
    if not np.any(model.weight):
        return force, None
    lumped = 0.5 * model.lengths[:, None] * own[..., :3, 3]
    return force, (rotations @ cross(moments - lumped, weight)[..., None])[..., 0]


def displacements(
    states: Sequence[SolvedState], twists: Array, rotations: Array, forces: Array, couples: Array | None
) -> Array:
    """Displacement of the nodes caused by forces on the elements' twists, with the base fixed.

    Parameters
    ----------
    states
        Whose tangents are taken.
    twists, rotations
        As in `SolvedState`, of the states, shapes (S, E, 6) and (S, E, 3, 3).
    forces, couples
        As from `defects`.

    Returns
    -------
    ndarray, shape (S, E, 3)
        Of the last node of every element, world axes [m].
    """
    own = exp_matrix(twists, coefficients(twists[..., 3:]))
    ends = rotations @ own[..., :3, :3]
    inverse: Array = np.linalg.inv(inverse_tangent_se3(twists)).astype(np.float64)
    if couples is not None:
        # A couple on a node bends every element between it and the base.
        beyond = couples[:, ::-1].cumsum(axis=1)[:, ::-1]
        bending = _transposed(inverse[..., 3:, :], _transposed(ends, beyond))
        forces = np.asarray(forces + bending)
    matrices = strain_matrices(np.stack([s.tangent_twists for s in states]))
    wrenches = _transposed(matrices, forces)
    loads = np.zeros((*wrenches.shape[:1], wrenches.shape[1] + 1, 6))
    loads[:, :-1] += wrenches[..., :6]
    loads[:, 1:] += wrenches[..., 6:]
    nodes = np.stack([s.solve(w.reshape(-1, 1))[:, 0] for s, w in zip(states, loads, strict=True)])
    nodes = nodes.reshape(loads.shape)
    both = np.concatenate((nodes[:, :-1], nodes[:, 1:]), axis=-1)
    local = (inverse @ (matrices @ both[..., None]))[..., 0].reshape(*forces.shape[:-1], 2, 3)
    world = (ends[..., None, :, :] @ local[..., None])[..., 0]
    turn = world[..., 1, :].cumsum(axis=1)
    arms = (rotations @ own[..., :3, 3, None])[..., 0]
    return np.asarray((world[..., 0, :] + cross(turn - world[..., 1, :], arms)).cumsum(axis=1))


def _largest(moved: Array) -> Array:
    """Largest length of vectors (..., E, 3) over E."""
    return np.asarray(np.sqrt(np.max(np.einsum("...i,...i->...", moved, moved), axis=-1)))


def estimate(model: ElementModel, states: Sequence[SolvedState], goal: float = np.inf) -> list[MeshEstimate]:
    """Estimated discretisation error of solved states of one mesh.

    Parameters
    ----------
    model
        The elements.
    states
        Any number; the elements of all are integrated at once.
    goal
        Error above which the contribution of each bay is computed as well [m].

    Returns
    -------
    list of MeshEstimate
        One per state.
    """
    if not states:
        return []
    twists = np.stack([s.twists for s in states])
    rotations = np.stack([s.rotations for s in states])
    tensions = np.stack([s.tensions for s in states])
    forces, couples = defects(model, twists, rotations, tensions)
    moved = displacements(states, twists, rotations, forces, couples)
    loads = bay_loads(model, twists, tensions)
    found = []
    for k, size in enumerate(_largest(moved)):
        by_bay = None
        if not size <= goal:
            inside = (model.bays == np.arange(int(model.bays.max()) + 1)[:, None])[..., None]
            by_bay = _largest(
                displacements(
                    [states[k]] * len(inside),
                    np.broadcast_to(twists[k], (len(inside), *twists[k].shape)),
                    np.broadcast_to(rotations[k], (len(inside), *rotations[k].shape)),
                    inside * forces[k],
                    None if couples is None else inside * couples[k],
                )
            )
        found.append(MeshEstimate(moved[k], by_bay, loads[k]))
    return found


def bay_loads(model: ElementModel, twists: Array, tensions: Array) -> Array:
    """Axial compression of every bay over its buckling load ``pi^2 EI / a^2`` [1], shape (S, B).

    ``a`` is the free length of the bay between two disks. The load is that of a bay whose ends cannot rotate relative
    to each other but are free to sway (clamped-clamped with sway): tendons restrain the orientation of the disks, not
    their position. A last bay without a disk at its end is a cantilever, ``pi^2 EI / (4 a^2)``. EI is the tangent
    stiffness where the section is superelastic. Tendons that follow the backbone do not compress the bays between
    disks; there the value is zero.

    Parameters
    ----------
    model
        The elements.
    twists, tensions
        Of the states, shapes (S, E, 6) and (S, m).
    """
    bays = int(model.bays.max()) + 1
    found = np.zeros((len(twists), bays))
    if model.section is not None and model.section.tendons is not None:
        return found
    compression = -_force_gradient(model, twists, tensions)[..., 0]
    bending = np.min(model.element_stiffness[:, 4:], axis=1)
    law = None if model.section is None else model.section.superelastic
    if law is not None:
        bend = np.linalg.norm(twists[..., 4:] / model.lengths[:, None] - law.precurvature[1:], axis=-1)
        slope = 0.5 * (1.0 + np.tanh(0.5 * (bend - law.threshold) / (law.threshold / 40.0)))
        bending = bending - (1.0 - law.ratio) * slope * law.bending_stiffness
    share = np.where(model.flexible, compression / bending, 0.0)
    free = np.bincount(model.bays, model.lengths * model.flexible, bays)
    for bay in range(bays):
        inside = model.bays == bay
        if inside.any():
            found[:, bay] = share[:, inside].max(axis=1)
    np.maximum(found, 0.0, out=found)
    found *= free**2 / np.pi**2
    if model.cantilever:
        found[:, -1] *= 4.0
    return found


class MeshMonitor:
    """Estimates of the steps of one run, several at once.

    Parameters
    ----------
    simulation
        The run.
    goal
        Error above which the contribution of each bay is computed as well [m].
    """

    def __init__(self, simulation: Simulation, goal: float) -> None:
        self._simulation, self._handle, self._goal = simulation, simulation.handle, goal
        self._model = ElementModel.of(self._handle)
        self._compliance = self._handle.compliance_factor
        self._waiting: list[SolvedState] = []
        #: Estimates so far, one per step, without those of pending states.
        self.estimates: list[MeshEstimate] = []

    def record(self) -> bool:
        """Add the present state to the pending ones; return whether new estimates have been computed."""
        changed = self._handle.compliance_factor != self._compliance
        if changed:
            self.flush()
            self._compliance = self._handle.compliance_factor
            self._model = ElementModel.of(self._handle)
        self._waiting.append(SolvedState.of(self._simulation))
        if len(self._waiting) < CHUNK:
            return changed
        self.flush()
        return True

    def flush(self) -> None:
        """Estimate the pending states."""
        self.estimates += estimate(self._model, self._waiting, self._goal)
        self._waiting = []


def error_order(handle: TDCR) -> int:
    """Order of the error of the mesh: 4 for straight tendons on an elastic backbone without weight, else 2."""
    heavy = handle.robot.backbone.density > 0.0 and any(handle.model.gravity)
    return 2 if heavy or handle.actuation.section is not None else 4


def refined(
    counts: Sequence[int], estimates: Sequence[MeshEstimate], goal: float, order: int
) -> tuple[int, ...]:
    """Elements per bay with which the error should stay below a goal, and the number of elements be smallest.

    With the error ``c_b (n_b / n'_b)^p`` of bay b, the smallest sum of ``n'_b`` has ``n'_b`` in proportion to
    ``(c_b n_b^p)^(1/(p+1))``.

    Parameters
    ----------
    counts
        Elements per bay of the present mesh, shape (B,).
    estimates
        Of its steps.
    goal
        Error to stay below [m].
    order
        Order p of the error.
    """
    n = np.asarray(counts, dtype=float)
    worst = np.zeros(len(n))
    for found in estimates:
        if found.by_bay is not None:
            worst[: len(found.by_bay)] = np.maximum(worst[: len(found.by_bay)], found.by_bay)
    if not worst.any():
        return tuple(counts)
    scaled = worst * n**order
    root = scaled ** (1.0 / (order + 1))
    factor = (root.sum() / (0.5 * goal)) ** (1.0 / order)
    wanted = np.clip(np.ceil(factor * root), n, np.minimum(GROWTH * n, max(MOST_PER_BAY, *n.tolist())))
    total = wanted.sum()
    if total > MOST_ELEMENTS:
        wanted = np.maximum(n, np.floor(wanted * MOST_ELEMENTS / total))
    return tuple(int(x) for x in wanted)


def _steps_named(numbers: Sequence[int]) -> str:
    if len(numbers) == 1:
        return f"step {numbers[0]}"
    return f"{len(numbers)} steps ({numbers[0]} to {numbers[-1]})"


def mesh_warnings(
    handle: TDCR, model: Model, estimates: Sequence[MeshEstimate], tolerance: float
) -> list[str]:
    """Sentences on steps whose error is larger than the tolerance, and on bays near their buckling load.

    Parameters
    ----------
    handle
        The robot.
    model
        As the user gave it.
    estimates
        One per step.
    tolerance
        ``mesh_tolerance`` of the settings [1].
    """
    found = []
    length = float(handle.mesh.arc_lengths[-1])
    errors = [e.largest / length for e in estimates]
    coarse = [k for k, e in enumerate(errors, start=1) if not e <= tolerance]
    if coarse:
        worst = max(coarse, key=lambda k: errors[k - 1])
        cure = (
            "automatic refinement has reached its limit; the state is likely near a buckling load"
            if model.elements_per_bay == "auto"
            else 'use elements_per_bay = "auto" or a larger number'
        )
        found.append(
            f"{_steps_named(coarse)}: the mesh is too coarse; the estimated discretisation error is up to "
            f"{errors[worst - 1]:.1e} of the length (step {worst}), more than mesh_tolerance = {tolerance:g}; {cure}"
        )
    near = [k for k, e in enumerate(estimates, start=1) if e.bay_loads.max() >= NEAR_BUCKLING]
    if near:
        worst = max(near, key=lambda k: estimates[k - 1].bay_loads.max())
        bay = int(np.argmax(estimates[worst - 1].bay_loads))
        edges = np.concatenate(([0.0], handle.robot.disks.positions, [length]))
        found.append(
            f"{_steps_named(near)}: bay {bay + 1} ({edges[bay]:g} to {edges[bay + 1]:g} m) is near or beyond its "
            f"buckling load: axial compression {estimates[worst - 1].bay_loads[bay]:.2f} times pi^2 EI / a^2 in step "
            f"{worst}. The solution is sensitive to small changes there, and more than one may exist"
        )
    return found

"""Automatic mesh: the error of the mesh is estimated in solved states, and the mesh refined against it.

The estimate is a defect correction. In a solved state every element of the backbone has a wrench at its first node.
Under that wrench the Cosserat equations along the element are integrated to high accuracy (collocation at four Gauss
points), own weight and tendons that follow the backbone included. Where the exact relative pose of the element's ends
differs from that of the finite element, the difference ``e`` is an eigenstrain that the mesh neglects. Exact
elements, fixed in the solved configuration, would load the nodes with

    r = B^T K e + r_w ,

with the element's strain matrix ``B``, its stiffness ``K`` (that of the wrench's direction included), and the moment
``r_w`` by which own weight along a bent element differs from own weight lumped at its nodes. The tangent of the solved
state takes ``r`` to the displacement of all nodes: the error of the configuration to first order, amplified near
buckling as it must be (docs/algorithms.md, section "Error of the mesh").
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from tdcr_fe.elements import Array, Flags, Index
from tdcr_fe.elements.backbone import POINTS, WEIGHTS, BackboneMesh, add_residual_flexibility, strain_matrices
from tdcr_fe.elements.forces import ForceModel
from tdcr_fe.elements.material import Material
from tdcr_fe.elements.poses import TWIST_MATRIX, coefficients, cross, exp_matrix, inverse_tangent_se3, skew
from tdcr_fe.elements.section_forces import nodal_sum
from tdcr_fe.model.loading import Model
from tdcr_fe.model.messages import steps_named
from tdcr_fe.scene import TDCR
from tdcr_fe.solve.simulation import Simulation

#: Solved states that are estimated at once. One by one, forty steps without friction take 1.25 times the time.
CHUNK = 8
#: Limits of automatic refinement: elements of one bay (of a description, too), elements of a robot, and meshes tried.
MOST_PER_BAY, MOST_ELEMENTS, MOST_MESHES = 64, 320, 6
#: Largest growth of a bay's number of elements from one mesh to the next.
GROWTH = 4
#: Fraction of its buckling load above which a bay causes a warning [1].
NEAR_BUCKLING = 0.5


def _collocation_matrix() -> Array:
    """Integrals from 0 to every Gauss point of the polynomial through values at these points, shape (4, 4)."""
    powers = np.arange(len(POINTS))
    values = POINTS[:, None] ** powers
    integrals = POINTS[:, None] ** (powers + 1) / (powers + 1)
    return np.asarray(np.linalg.solve(values.T, integrals.T).T)


_INTEGRALS = np.concatenate((_collocation_matrix(), WEIGHTS[None]))
#: Components of a strain in which fibres along the backbone are strained: stretch and both curvatures.
_FIBRES = [0, 4, 5]
#: The pose of no motion, row by row, without its last row.
_IDENTITY: Array = np.eye(3, 4).ravel()
#: Fixed-point iterations of the collocation equations.
SWEEPS = 8


@dataclass(frozen=True)
class ElementModel:
    """Forces, weight and bays of the elements of one backbone."""

    forces: ForceModel  # Mesh, tendons that follow the backbone, and nonlinear material
    flexible: Flags  # (E,): False in rigid inserts, which have no error
    weight: Array  # (E, 3): Own weight of the elements per length, world axes [N/m]
    bays: Index  # (E,): Number of the bay that an element lies in, from 0
    buckling_lengths: Array  # (B,): Length ``a`` of the load ``pi^2 EI / a^2`` at which a bay buckles [m]

    @classmethod
    def of(cls, handle: TDCR) -> ElementModel:
        """The elements of a robot in a scene, with their current compliance."""
        mesh, robot = handle.actuation.mesh, handle.robot
        middle = 0.5 * (mesh.arc_lengths[1:] + mesh.arc_lengths[:-1])
        bays = np.searchsorted(np.asarray(robot.bay_ends, dtype=float), middle)
        free = np.bincount(bays, mesh.lengths * ~handle.rigid).astype(float)
        if robot.without_disks:
            free[:] = 2.0 * free.sum()
        elif robot.disks.positions[-1] < mesh.arc_lengths[-1] - 1e-9:
            free[-1] *= 2.0
        weight = mesh.mass_per_length[:, None] * np.asarray(handle.model.gravity, dtype=float)
        return cls(handle.actuation.model, ~handle.rigid, weight, bays, free)


def _strain_under(
    law: Material, wrench: Array, strain: Array, unloaded: Array, compliance: Array, size: Array
) -> Array:
    """Stretch and curvatures of a nonlinear material under a wrench, by a Newton step from known ones, (S, E, 4, 3).

    In a round section that is larger by ``size``, fibres are strained as by a larger curvature in that of the element;
    their force grows with the second power of the size, and their moment with the third.
    """
    points, known = law.at_points(), strain[..., _FIBRES]
    change = (strain - unloaded)[..., _FIBRES]
    linear = np.broadcast_to(1.0 / compliance[..., _FIBRES], known.shape)
    larger, power = size[..., None] ** [0, 1, 1], size[..., None] ** [2, 3, 3]
    of_element = change[..., 0], (larger * change)[..., 1:]
    missing = wrench[..., _FIBRES] - change * linear - power * points.wrench(*of_element)
    slope = power[..., None] * points.stiffness(*of_element) * larger[..., None, :]
    return known + np.linalg.solve(slope + linear[..., None] * np.eye(3), missing[..., None])[..., 0]


def _sizes(mesh: BackboneMesh) -> tuple[Array, Array]:
    """Radius at the Gauss points over that of the element's own section, which has its mean compliance and mean area.

    For its bending and torsion, and for its area, each of shape (E, 4) [1].
    """
    size = 1.0 + (mesh.taper * mesh.lengths)[:, None] * (POINTS - 0.5)
    return size * (size**-4 @ WEIGHTS)[:, None] ** 0.25, size / np.sqrt(size**2 @ WEIGHTS)[:, None]


def stiffness_times(forces: ForceModel, twists: Array, strain: Array) -> Array:
    """Stiffness of the elements times changes of their twists, shape (S, E, 6)."""
    force = forces.mesh.twist_stiffness * strain
    if forces.section is not None and forces.section.material is not None:
        material, h = forces.section.material, forces.mesh.lengths
        slope = material.stiffness(*material.strain(twists, h)) / h[:, None, None]
        force[..., _FIBRES] += (slope @ strain[..., _FIBRES, None])[..., 0]
    return force


def exact_elements(
    model: ElementModel, twists: Array, wrenches: Array, weight: Array, tensions: Array
) -> tuple[Array, Array]:
    """Integrate the Cosserat equations along every element under the wrench at its first node.

    Parameters
    ----------
    model
        The elements.
    twists
        Twists of the finite elements, where the iteration starts, shape (S, E, 6).
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
    section, mesh, h = model.forces.section, model.forces.mesh, model.forces.mesh.lengths[:, None]
    stiffness = mesh.stiffness.copy()
    # The stiffness of the section itself, without the residual flexibility of bending that is added to the shear.
    add_residual_flexibility(stiffness, mesh.lengths, -1.0)
    thick, wide = _sizes(mesh)
    compliance = 1.0 / (stiffness[:, None, :] * np.stack((*[wide**2] * 3, *[thick**4] * 3), axis=-1))
    unloaded = (mesh.reference_twists / h)[:, None, :]
    start = twists[..., None, :] * POINTS[:, None]
    poses = exp_matrix(start, coefficients(start[..., 3:]))[..., :3, :]
    strain = np.broadcast_to((twists / h)[..., None, :], start.shape)
    force, moment = wrenches[..., None, :3], wrenches[..., None, 3:]
    along = (h * POINTS)[..., None]
    integrals = _INTEGRALS * h[..., None]
    heavy = bool(np.any(model.weight))
    both = np.empty((*start.shape[:-1], 2, 3))
    both[..., 0, :] = force - weight[..., None, :] * along
    moments = np.zeros((*twists.shape[:-1], 3))
    arm = skew(force)
    for _ in range(SWEEPS):
        p = poses[..., 3]
        both[..., 1, :] = moment + (arm @ p[..., None])[..., 0]
        if heavy:
            below = integrals @ p
            moments = below[..., -1, :]
            both[..., 1, :] += cross(along * p - below[..., :-1, :], weight[..., None, :])
        wrench = (both @ poses[..., :3]).reshape(start.shape)
        if section is not None and section.tendons is not None:
            wrench = wrench - np.einsum("sm,ms...->s...", tensions, section.tendons.along(strain)[1])
        new = unloaded + wrench * compliance
        if section is not None and section.material is not None:
            new[..., _FIBRES] = _strain_under(section.material, wrench, strain, unloaded, compliance, thick)
        strain = new
        rates = poses[..., :3] @ strain.dot(TWIST_MATRIX[:, :12]).reshape(*start.shape[:-1], 3, 4)
        every = integrals @ rates.reshape(*start.shape[:-1], 12)
        every += _IDENTITY
        every = every.reshape(*every.shape[:-1], 3, 4)
        poses, ends = every[..., :-1, :, :], every[..., -1, :, :]
    return ends, moments


@dataclass(frozen=True)
class SolvedState:
    """Quantities of a solved state that the estimate needs."""

    twists: Array  # (E, 6): Of the elements, length times strain
    rotations: Array  # (E, 3, 3): Of the first node of every element, in beam axes
    tensions: Array  # (m,): At the base [N]
    # (E, 6): Of the elements where the tangent was factorised: in the solved state, or one iteration before.
    # Forces and changes are taken by the twists of these elements, in which the tangent changes little.
    tangent_twists: Array
    # Solves for body-frame increments of the nodes (6 N, k) under wrenches on the nodes (6 N, k) with that
    # tangent, with mobilisations fixed and displacement-driven tendons taut
    solve: Callable[[Array], Array]

    @classmethod
    def of(cls, simulation: Simulation) -> SolvedState:
        """The last solved state of a simulation, with the tangent that was factorised last."""
        linearization, state = simulation.linearization(), simulation.state
        factorisation = linearization.factorisation
        nodes = slice(0, 6 * len(simulation.handle.nNodes))

        def solve(wrenches: Array) -> Array:
            right = np.zeros((linearization.numbering.linear, wrenches.shape[1]), order="F")
            # The tangent is that of the forces on the nodes: minus the stiffness.
            right[nodes] = -wrenches
            right[linearization.numbering.clamped] = 0.0
            return factorisation.solve(right)[nodes]

        twists, rotations = state.configuration.twists[0], state.configuration.poses[0][1][:-1]
        return cls(twists, rotations, state.base_tension[0], linearization.chains[0].twists, solve)


@dataclass(frozen=True)
class MeshEstimate:
    """Estimated discretisation error of one solved state."""

    largest: float  # Largest estimated displacement of a node to its position with exact elements [m]
    # (B,): Largest displacement of a node that each bay's own defect causes [m]; None where the error is below
    # the goal. Infinite where the equations along an element have no finite solution under its wrench.
    by_bay: Array | None
    # (B,): Axial compression of each bay over its buckling load, see `bay_loads`; zero where it is not defined
    # [1]
    bay_loads: Array


def _transposed(matrices: Array, vectors: Array) -> Array:
    """Transposed matrices times vectors: (..., n, k) and (..., n) to (..., k)."""
    return np.asarray((vectors[..., None, :] @ matrices)[..., 0, :])


def defects(model: ElementModel, twists: Array, rotations: Array, tensions: Array) -> tuple[Array, Array]:
    """Additional forces (by the elements' twists) and couples of exact elements in the solved configuration.

    Parameters
    ----------
    model
        The elements.
    twists, rotations, tensions
        Twists and rotations and tensions of several solved states, as in `SolvedState`, with one more axis in front.

    Returns
    -------
    forces : ndarray, shape (S, E, 6)
        ``K e`` of every element.
    couples : ndarray, shape (S, E, 3)
        ``r_w`` on the last node of every element, world axes [N m].
    """
    weight, lengths = _transposed(rotations, model.weight), model.forces.mesh.lengths[:, None]
    gradient = model.forces.gradient(twists, tensions)
    to_first = inverse_tangent_se3(-twists)
    own_wrenches = _transposed(to_first, gradient)
    wrenches = own_wrenches.copy()
    wrenches[..., :3] += 0.5 * weight * lengths
    ends, moments = exact_elements(model, twists, wrenches, weight, tensions)
    own = exp_matrix(twists, coefficients(twists[..., 3:]))
    back = np.swapaxes(own[..., :3, :3], -1, -2)
    turn = back @ ends[..., :3]
    change = np.empty_like(twists)
    change[..., :3] = (back @ (ends[..., 3] - own[..., :3, 3])[..., None])[..., 0]
    change[..., 3:] = 0.5 * (turn[..., (2, 0, 1), (1, 2, 0)] - turn[..., (1, 2, 0), (2, 0, 1)])
    tangent = inverse_tangent_se3(twists)
    eigenstrain = (tangent @ change[..., None])[..., 0]
    force = stiffness_times(model.forces, twists, eigenstrain)
    # The wrench belongs to the exact pose; its generalised force differs where the pose differs.
    moved = _transposed(inverse_tangent_se3(-twists - eigenstrain), gradient) - own_wrenches
    from_first: Array = np.linalg.inv(to_first).astype(np.float64)
    force += _transposed(from_first, moved)
    force[:, ~model.flexible] = 0.0
    lumped = 0.5 * lengths * own[..., :3, 3]
    return force, (rotations @ cross(moments - lumped, weight)[..., None])[..., 0]


def displacements(states: Sequence[SolvedState], forces: Array, couples: Array) -> Array:
    """Displacement of the nodes caused by forces and couples as from `defects`, with the base fixed.

    Of the last node of every element, by the tangents of these states, world axes [m], shape (S, K, E, 3); from K cases
    of forces (S, K, E, 6) and couples (S, K, E, 3) of every state.
    """
    twists, rotations = (np.stack([getattr(s, n) for s in states])[:, None] for n in ("twists", "rotations"))
    own = exp_matrix(twists, coefficients(twists[..., 3:]))
    ends = rotations @ own[..., :3, :3]
    inverse: Array = np.linalg.inv(inverse_tangent_se3(twists)).astype(np.float64)
    # A couple on a node bends every element between it and the base.
    beyond = couples[..., ::-1, :].cumsum(axis=-2)[..., ::-1, :]
    forces = np.asarray(forces + _transposed(inverse[..., 3:, :], _transposed(ends, beyond)))
    matrices = strain_matrices(np.stack([s.tangent_twists for s in states])[:, None])
    loads = nodal_sum(_transposed(matrices, forces))
    nodes = np.stack([s.solve(w.reshape(len(w), -1).T).T for s, w in zip(states, loads, strict=True)])
    nodes = nodes.reshape(loads.shape)
    both = np.concatenate((nodes[..., :-1, :], nodes[..., 1:, :]), axis=-1)
    local = (inverse @ (matrices @ both[..., None]))[..., 0].reshape(*forces.shape[:-1], 2, 3)
    world = (ends[..., None, :, :] @ local[..., None])[..., 0]
    turn = world[..., 1, :].cumsum(axis=-2)
    arms = (rotations @ own[..., :3, 3, None])[..., 0]
    return np.asarray((world[..., 0, :] + cross(turn - world[..., 1, :], arms)).cumsum(axis=-2))


def _largest(moved: Array) -> Array:
    """Largest length of vectors (..., E, 3) over E, infinite where any is not a number."""
    moved = np.where(np.isfinite(moved), moved, np.inf)
    return np.asarray(np.sqrt(np.max(np.einsum("...i,...i->...", moved, moved), axis=-1)))


@np.errstate(over="ignore", invalid="ignore")
def estimate(model: ElementModel, states: Sequence[SolvedState], goal: float) -> list[MeshEstimate]:
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
    names = ("twists", "rotations", "tensions")
    twists, rotations, tensions = (np.stack([getattr(s, name) for s in states]) for name in names)
    forces, couples = defects(model, twists, rotations, tensions)
    loads = bay_loads(model, twists, tensions)
    sizes = _largest(displacements(states, forces[:, None], couples[:, None]))[:, 0].tolist()
    found = []
    for size, load, *defect in zip(sizes, loads, states, forces, couples, strict=True):
        found.append(MeshEstimate(size, None if size <= goal else _by_bay(model, *defect), load))
    return found


def _by_bay(model: ElementModel, state: SolvedState, forces: Array, couples: Array) -> Array:
    """See `MeshEstimate.by_bay`."""
    inside = (model.bays == np.arange(int(model.bays.max()) + 1)[:, None])[..., None]
    of_bays = (np.where(inside, own, 0.0)[None] for own in (forces, couples))
    return _largest(displacements([state], *of_bays))[0]


def bay_loads(model: ElementModel, twists: Array, tensions: Array) -> Array:
    """Axial compression of every bay over its buckling load ``pi^2 EI / a^2`` [1], shape (S, B).

    ``a`` is the free length of the bay between two disks. The load is that of a bay whose ends cannot rotate relative
    to each other but are free to sway (clamped-clamped with sway): tendons restrain the orientation of the disks, not
    their position. A last bay without a disk at its end is a cantilever, ``pi^2 EI / (4 a^2)``, and so is a whole
    backbone without disks. EI is the tangent stiffness of a nonlinear section. Tendons that follow the
    backbone do not compress the bays between disks; there the value is zero.

    Parameters
    ----------
    model
        The elements.
    twists, tensions
        Twists and tensions of the states, shapes (S, E, 6) and (S, m).
    """
    forces, found = model.forces, np.zeros((len(twists), int(model.bays.max()) + 1))
    if forces.section is not None and forces.section.tendons is not None:
        return found
    compression = -forces.gradient(twists, tensions)[..., 0]
    bending = np.min(forces.mesh.stiffness[:, 4:], axis=1)
    if forces.section is not None and forces.section.material is not None:
        material = forces.section.material
        slope = material.stiffness(*material.strain(twists, forces.mesh.lengths))[..., 1:, 1:]
        bending = np.maximum(bending + np.linalg.eigvalsh(slope)[..., 0], 1e-3 * bending)
    share = np.where(model.flexible, compression / bending, 0.0)
    np.maximum.at(found.T, model.bays, share.T)
    found *= model.buckling_lengths**2 / np.pi**2
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
    """Order of the error of the mesh: 4 for straight tendons on a uniform elastic backbone without weight, else 2."""
    backbone = handle.robot.backbone
    heavy = backbone.density > 0.0 and any(handle.model.gravity)
    return 2 if heavy or backbone.taper or handle.actuation.model.section is not None else 4


def refined(
    counts: Sequence[int], estimates: Sequence[MeshEstimate], goal: float, order: int
) -> tuple[int, ...]:
    """Elements per bay with which the error should stay below a goal, and the number of elements be smallest.

    With the error ``c_b (n_b / n'_b)^p`` of bay b, the smallest sum of ``n'_b`` has ``n'_b`` in proportion to
    ``(c_b n_b^p)^(1/(p+1))``. Where an estimate is infinite, its bay gets as many elements as one refinement allows.

    Parameters
    ----------
    counts
        Elements per bay of the present mesh, shape (B,).
    estimates
        Estimates of its steps, one of which at least exceeds the goal.
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
    most = np.minimum(GROWTH * n, MOST_PER_BAY)
    known = np.isfinite(worst)
    scaled = np.where(known, worst, 0.0) * n**order
    root = scaled ** (1.0 / (order + 1))
    factor = (root.sum() / (0.5 * goal)) ** (1.0 / order)
    wanted = np.where(known, np.clip(np.ceil(factor * root), n, most), most)
    total = wanted.sum()
    if total > MOST_ELEMENTS:
        wanted = np.maximum(n, np.floor(wanted * MOST_ELEMENTS / total))
    return tuple(int(x) for x in wanted)


def mesh_warnings(
    handle: TDCR, model: Model, estimates: Sequence[MeshEstimate], tolerance: float
) -> list[str]:
    """Sentences on steps whose error is larger than the tolerance, and on bays near their buckling load.

    From one estimate per step; ``model`` is as the user gave it, ``tolerance`` the ``mesh_tolerance`` of the settings.
    """
    found = []
    length = float(handle.mesh.arc_lengths[-1])
    errors = [e.largest / length for e in estimates]
    coarse = [k for k, e in enumerate(errors, start=1) if not e <= tolerance]
    if coarse:
        worst = max(coarse, key=lambda k: errors[k - 1])
        cure = 'use elements_per_bay = "auto" or a larger number'
        if model.elements_per_bay == "auto":
            cure = "automatic refinement has reached its limit; the state is likely near a buckling load"
        found.append(
            f"{steps_named(coarse)}: the mesh is too coarse; the estimated discretisation error is up to "
            f"{errors[worst - 1]:.1e} of the length (step {worst}), more than mesh_tolerance = {tolerance:g}; {cure}"
        )
    near = [k for k, e in enumerate(estimates, start=1) if e.bay_loads.max() >= NEAR_BUCKLING]
    if near:
        worst = max(near, key=lambda k: estimates[k - 1].bay_loads.max())
        bay = int(np.argmax(estimates[worst - 1].bay_loads))
        edges = np.concatenate(([0.0], handle.robot.bay_ends, [length]))
        found.append(
            f"{steps_named(near)}: bay {bay + 1} ({edges[bay]:g} to {edges[bay + 1]:g} m) is near or beyond its "
            f"buckling load: axial compression {estimates[worst - 1].bay_loads[bay]:.2f} times pi^2 EI / a^2 in step "
            f"{worst}. The solution is sensitive to small changes there, and more than one may exist"
        )
    return found

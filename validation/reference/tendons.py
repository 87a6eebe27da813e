"""Tendons: segments, slip at the holes, and transfer of tension at a hole."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tdcr_fe.model.friction import AngleDependentFriction, ConstantFriction, ForceDependentFriction
from tdcr_fe.model.loading import Model
from tdcr_fe.model.robot import Robot, Tendon
from tdcr_fe.validation.reference.layout import Layout
from tdcr_fe.validation.reference.rod import hat
from tdcr_fe.validation.reference.settings import Array, HoleFriction, Index, Mask

#: Laws of the coefficient that depend on the state.
Law = ForceDependentFriction | AngleDependentFriction

#: Turn of a tendon at which it has shifted by 0.7 of its clearance [rad].
CLEARANCE_ANGLE = 0.01


def coefficient_at_rest(tendon: Tendon) -> float:
    """Friction coefficient of a tendon where it does not turn, so that no normal force acts [1].

    Raises
    ------
    ValueError
        The tendon has a law that the reference does not implement.
    """
    law = tendon.friction
    if law is None:
        return tendon.friction_coefficient
    if isinstance(law, ConstantFriction | AngleDependentFriction):
        return law.mu
    if isinstance(law, ForceDependentFriction):
        return law.mu * (law.smallest_force / law.reference_force) ** law.exponent
    raise ValueError(
        f"friction law {law.kind!r} of tendon {tendon.name!r}; the reference is rate-independent and implements "
        "'constant', 'force-dependent' and 'angle-dependent'"
    )


def tension_after(
    tension: Array, mobilisation: Array, angle: Array, mu: Array, adhesion: Array
) -> tuple[Array, Array, Array, Array]:
    r"""Tension on the far side of holes (Capstan law, paper Eq. 28, with stick and adhesion).

    Pulled through (s >= 0): :math:`\max(0, T e^{-s \mu\theta} - s a)`; released (s < 0):
    :math:`(T + |s| a) e^{|s| \mu\theta}`.

    Parameters
    ----------
    tension
        On the side of the base [N], shape (n,).
    mobilisation
        Share of the friction that acts, s in -1..1 [1], shape (n,).
    angle
        Turning angle of the tendon at the hole [rad], shape (n,).
    mu, adhesion
        Friction coefficient [1] and drop [N], shape (n,).

    Returns
    -------
    tuple of numpy.ndarray
        The tension [N] and its derivatives with respect to tension, mobilisation and angle, each (n,).
    """
    factor = np.exp(-mobilisation * mu * angle)
    pull = mobilisation >= 0.0
    inner = np.where(pull, tension, tension - mobilisation * adhesion)
    value = inner * factor - np.where(pull, mobilisation * adhesion, 0.0)
    d_s = -mu * angle * inner * factor - adhesion * np.where(pull, 1.0, factor)
    d_angle = -mobilisation * mu * inner * factor
    lost = pull & (value < 0.0) & (adhesion > 0.0)
    keep = np.where(lost, 0.0, 1.0)
    return value * keep, factor * keep, d_s * keep, d_angle * keep


@dataclass(frozen=True)
class Driver:
    """Prescribed inputs of the tendons.

    Attributes
    ----------
    by_displacement : ndarray of bool, shape (n_tendons,)
    values : ndarray, shape (n_tendons,)
        Tension [N] or displacement [m].
    """

    by_displacement: Mask
    values: Array


@dataclass(frozen=True)
class History:
    """Friction history, committed after every substep.

    Attributes
    ----------
    mobilisation : ndarray, shape (n_friction,)
        [1].
    passed : ndarray, shape (n_friction,)
        Slip towards the base since the unloaded state [m].
    """

    mobilisation: Array
    passed: Array


def friction_variables(rough: Mask, owner: Index | None) -> Index:
    """Number of the friction variable of every hole, -1 without friction, shape (n_holes,).

    Parameters
    ----------
    rough
        Holes with friction, shape (n_holes,).
    owner
        Tendon of every hole where all holes of a tendon share a variable; None gives each hole its own.
    """
    variable = np.full(len(rough), -1, dtype=np.intp)
    groups = np.arange(len(rough)) if owner is None else owner
    variable[rough] = np.unique(groups[rough], return_inverse=True)[1]
    return variable


def hole_friction(
    robot: Robot, model: Model, owner: Index, special: tuple[HoleFriction, ...]
) -> tuple[Array, Array, list[Law | None]]:
    """Friction coefficient at rest [1], adhesion [N] and law, if any, of every hole between base and anchor.

    Parameters
    ----------
    robot, model
        What is modelled.
    owner
        Tendon of every hole, shape (n_holes,).
    special
        Holes that differ from their tendon, besides those of its description.
    """
    if model.friction == "none":
        return np.zeros(len(owner)), np.zeros(len(owner)), [None] * len(owner)
    tendons = [robot.tendons[i] for i in owner]
    mu = np.array([coefficient_at_rest(t) for t in tendons], dtype=float)
    adhesion = np.array([t.adhesion for t in tendons], dtype=float)
    laws = [t.friction if isinstance(t.friction, Law) else None for t in tendons]
    for t, tight in [(x, hole) for x in robot.tendons for hole in x.tight_holes]:
        at = int(np.argmin(np.abs(robot.hole_arc_lengths(t) - tight.at)))
        index = int(np.flatnonzero(owner == robot.tendon_names.index(t.name))[at - 1])
        if tight.friction_coefficient is not None:
            mu[index], laws[index] = tight.friction_coefficient, None
        if tight.drop is not None:
            adhesion[index] = tight.drop
    for hole in special:
        index = int(np.flatnonzero(owner == robot.tendon_names.index(hole.tendon))[hole.hole - 1])
        mu[index], adhesion[index], laws[index] = hole.mu, hole.adhesion, None
    return mu, adhesion, laws


class Tendons:
    """The tendons' segments one after another, and the equations for their tensions.

    A segment runs from hole to hole; with continuous tendons each tendon is a single segment.

    Parameters
    ----------
    robot, model, layout
        What is modelled, and the stations.
    special
        Holes that differ from their tendon.
    """

    def __init__(self, robot: Robot, model: Model, layout: Layout, special: tuple[HoleFriction, ...]) -> None:
        self.count = len(robot.tendons)
        self.continuous = model.tendon_path == "continuous"
        places = [[layout.station(s) for s in robot.hole_arc_lengths(t)] for t in robot.tendons]
        stations = [np.array(x, dtype=np.intp) for x in places]
        counts = np.array([1 if self.continuous else len(at) - 1 for at in stations], dtype=np.intp)
        self.size = int(np.sum(counts))
        self.last = np.cumsum(counts)
        self.first = self.last - counts
        ends = [] if self.continuous else stations
        points = [] if self.continuous else [robot.hole_points(t) for t in robot.tendons]
        no_ends, no_points = np.zeros(0, dtype=np.intp), np.zeros((0, 3))
        #: Stations at the ends of every segment, and the holes there in their section frames [m].
        self.tail = np.concatenate((*(at[:-1] for at in ends), no_ends))
        self.head = np.concatenate((*(at[1:] for at in ends), no_ends))
        self.tail_hole = np.concatenate((*(p[:-1] for p in points), no_points))
        self.head_hole = np.concatenate((*(p[1:] for p in points), no_points))
        #: Segment on the base side of every hole between base plate and anchor.
        self.holes = np.setdiff1d(np.arange(self.size), self.last - 1)
        owner = np.repeat(np.arange(self.count), counts - 1)
        self.mu, self.adhesion, laws = hole_friction(robot, model, owner, special)
        #: Holes whose coefficient depends on the state, and their laws.
        self.dependent = np.array([k for k, law in enumerate(laws) if law is not None], dtype=np.intp)
        self.laws = tuple(law for law in laws if law is not None)
        #: Of the tendon of every segment [m].
        self.clearance = np.repeat(np.array([t.clearance for t in robot.tendons], dtype=float), counts)
        self.loose = not self.continuous and bool(np.any(self.clearance > 0.0))
        stiffness = [np.inf if t.axial_stiffness is None else t.axial_stiffness for t in robot.tendons]
        self.flexibility = np.repeat(1.0 / np.array(stiffness, dtype=float), counts)
        pretension = np.array([t.pretension for t in robot.tendons], dtype=float)
        #: Stretch of the tendon of every segment in the unloaded shape at displacement zero [1].
        self.tightened = 1.0 + self.flexibility * np.repeat(pretension, counts)
        #: Length of every segment in the unloaded shape [m].
        self.rest = np.zeros(self.size)
        self.base_sum = np.zeros((self.count, self.size))
        for i in range(self.count):
            self.base_sum[i, self.first[i] : self.last[i]] = 1.0
        beyond = self.base_sum[owner] * (np.arange(self.size) > self.holes[:, None])
        shared = model.friction == "per-tendon"
        rough = (self.mu > 0.0) | (self.adhesion > 0.0)
        rough[self.dependent] = True
        #: Friction variable of every hole; -1 without friction.
        self.variable = friction_variables(rough, owner if shared else None)
        self.rough = np.flatnonzero(rough)
        _, first_hole = np.unique(self.variable[self.rough], return_index=True)
        leading = self.rough[first_hole]
        self.n_friction = len(leading)
        #: Sums the released lengths of the segments beyond each friction variable: its slip.
        self.passed_sum = self.base_sum[owner[leading]] if shared else beyond[leading]

    def coefficients(self, tension: Array, angles: Array) -> Array:
        r"""Friction coefficients at the holes in a solved state [1], shape (n_holes,).

        For a force-dependent law, :math:`\mu(N) = \mu_0 ((N^2 + N_s^2) / N_0^2)^{p/2}` with the normal force
        :math:`N = (T_{before} + T_{after}) \sin(\theta / 2)` of the tendon's two pulls. For an angle-dependent one,
        :math:`\max(\mu_0 + b \theta, 0)`.

        Parameters
        ----------
        tension
            Of the segments [N], shape (n_segments,).
        angles
            Turning angles at the holes [rad], shape (n_holes,).
        """
        mu = self.mu.copy()
        for hole, law in zip(self.dependent, self.laws, strict=True):
            if isinstance(law, AngleDependentFriction):
                mu[hole] = max(law.mu + law.slope * angles[hole], 0.0)
                continue
            before = self.holes[hole]
            normal = (tension[before] + tension[before + 1]) * np.sin(0.5 * angles[hole])
            size = np.hypot(normal, law.smallest_force) / law.reference_force
            mu[hole] = law.mu * size**law.exponent
        return mu

    def start(self) -> History:
        """The unloaded shape without tension: a tendon with pretension has been let out."""
        let_out = self.rest / self.tightened - self.rest
        return History(np.zeros(self.n_friction), self.passed_sum @ let_out)

    def taken_in(self, lengths: Array, tension: Array) -> tuple[Array, Array, Array]:
        """Released length of each segment [m] and its derivatives by length and tension."""
        stretch = 1.0 + self.flexibility * tension
        by_tension = lengths * self.flexibility / stretch**2
        return self.rest / self.tightened - lengths / stretch, -1.0 / stretch, by_tension

    def equations(
        self, known: Lengths, tension: Array, mobilisation: Array, driver: Driver, force_scale: float
    ) -> TendonEquations:
        """Equations for the tensions, and slip at the holes.

        Parameters
        ----------
        known
            Lengths of the segments and angles at the holes.
        tension, mobilisation
            Unknowns [N], (n_segments,), and [1], (n_friction,).
        driver
            Prescribed inputs.
        force_scale
            Of the residual [N].
        """
        n, f = self.size, self.n_friction
        driven = np.flatnonzero(driver.by_displacement)
        residual = np.zeros(n)
        by_rod = np.zeros((n, known.d_lengths.shape[1]))
        by_tension = np.zeros((n, n))
        by_choice = np.zeros((n, f + len(driven)))
        taken, by_length, by_pull = self.taken_in(known.lengths, tension)

        first = self.first
        residual[first] = np.where(driver.by_displacement, 0.0, tension[first] - driver.values) / force_scale
        by_tension[first, first] = 1.0 / force_scale
        by_choice[first[driven], f + np.arange(len(driven))] = -1.0 / force_scale

        holes, after, rough = self.holes, self.holes + 1, self.rough
        share = np.zeros(len(holes))
        share[rough] = mobilisation[self.variable[rough]]
        at = (share, known.angles, self.mu, self.adhesion)
        value, d_tension, d_share, d_angle = tension_after(tension[holes], *at)
        residual[after] = (tension[after] - value) / force_scale
        by_tension[after, after] = 1.0 / force_scale
        by_tension[after, holes] = -d_tension / force_scale
        by_rod[after] = (-d_angle / force_scale)[:, None] * known.d_angles
        by_choice[after[rough], self.variable[rough]] = -d_share[rough] / force_scale
        sums = np.concatenate((self.passed_sum, self.base_sum[driven]))
        return TendonEquations(
            residual=residual,
            by_rod=by_rod,
            by_tension=by_tension,
            by_choice=by_choice,
            passed=sums @ taken,
            passed_by_rod=(sums * by_length) @ known.d_lengths,
            passed_by_tension=sums * by_pull,
        )


@dataclass(frozen=True)
class TendonEquations:
    """Equations of n tensions, and slips, with derivatives.

    The unknowns of the complementarity problem come last: the mobilisations, and the base tensions of the tendons
    driven by displacement; c unknowns together.

    Attributes
    ----------
    residual : ndarray, shape (n,)
        Scaled [1].
    by_rod, by_tension, by_choice : ndarray, shapes (n, z), (n, n), (n, c)
        Derivatives by the unknowns of the rod, the tensions and the unknowns of the complementarity problem.
    passed : ndarray, shape (c,)
        Tendon that has passed hole or base plate towards the base since the unloaded state [m].
    passed_by_rod, passed_by_tension : ndarray, shapes (c, z), (c, n)
    """

    residual: Array
    by_rod: Array
    by_tension: Array
    by_choice: Array
    passed: Array
    passed_by_rod: Array
    passed_by_tension: Array


#: Where tails and heads of segments sit in their section frames [m], (n, 3), with derivatives, (n, 3, z), or None.
Ends = tuple[tuple[Array, Array | None], tuple[Array, Array | None]]


@dataclass(frozen=True)
class Lengths:
    """Tendon segments in one configuration, with derivatives by z unknowns of the rod.

    Attributes
    ----------
    lengths : ndarray, shape (n,)
        [m].
    angles : ndarray, shape (n_holes,)
        Turning angles at the holes [rad].
    d_lengths, d_angles : ndarray, shapes (n, z), (n_holes, z)
    """

    lengths: Array
    angles: Array
    d_lengths: Array
    d_angles: Array


@dataclass(frozen=True)
class Segments(Lengths):
    """Those that are straight.

    Attributes
    ----------
    directions : ndarray, shape (n, 3)
        Unit vectors towards the tip, world frame.
    d_directions : ndarray, shape (n, 3, z)
    ends : ((ndarray, ndarray or None), ...)
        Of tails and of heads, without derivatives where tendons have no clearance.
    """

    directions: Array
    d_directions: Array
    ends: Ends


def _shifted(tendons: Tendons, rotations: Array, positions: Array, twists: Array) -> Ends:
    r"""Positions of tendons in oversized holes, with derivatives; tails first, then heads.

    With the unit vectors t between the middles of neighbouring holes, a tendon pulls at a hole along
    :math:`b = t_{after} - t_{before}` (below the base plate it runs straight down). In the plane of the disk
    it is shifted by :math:`c\, b / \sqrt{|b|^2 + \alpha^2}`, with the clearance c and
    :math:`\alpha` = `CLEARANCE_ANGLE`. The anchor does not let it shift.
    """
    middles = (tendons.tail_hole, None), (tendons.head_hole, None)
    _, t, _, d_t = _edges(tendons, rotations, positions, twists, middles)
    first, inner = tendons.first, np.ones(tendons.size, dtype=bool)
    inner[first] = False
    later = np.flatnonzero(inner)
    b, d_b = t.copy(), d_t.copy()
    b[first] -= np.array([0.0, 0.0, 1.0])
    b[later] -= t[later - 1]
    d_b[later] -= d_t[later - 1]
    down = np.swapaxes(rotations[tendons.tail], 1, 2)
    local = (down @ b[:, :, None])[..., 0]
    d_local = down @ (d_b + hat(b) @ twists[tendons.tail][:, :3])
    local[:, 2] = d_local[:, 2] = 0.0
    size = np.sqrt(np.einsum("ki,ki->k", local, local) + CLEARANCE_ANGLE**2)
    unit = local / size[:, None]
    shift = tendons.clearance[:, None] * unit
    across = np.eye(3) - unit[:, :, None] * unit[:, None, :]
    d_shift = (tendons.clearance / size)[:, None, None] * (across @ d_local)
    head, d_head = np.zeros_like(shift), np.zeros_like(d_shift)
    head[later - 1], d_head[later - 1] = shift[later], d_shift[later]
    return (tendons.tail_hole + shift, d_shift), (tendons.head_hole + head, d_head)


def _edges(
    tendons: Tendons, rotations: Array, positions: Array, twists: Array, holes: Ends
) -> tuple[Array, Array, Array, Array]:
    """Lengths [m], unit vectors and the derivatives of both, of the lines between tails and heads."""
    ends, moves = [], []
    for at, (hole, d_hole) in zip((tendons.tail, tendons.head), holes, strict=True):
        point = positions[at] + (rotations[at] @ hole[:, :, None])[..., 0]
        lever = np.concatenate((-hat(point), np.broadcast_to(np.eye(3), (len(at), 3, 3))), axis=-1)
        move = lever @ twists[at]
        ends.append(point)
        moves.append(move if d_hole is None else move + rotations[at] @ d_hole)
    edge, d_edge = ends[1] - ends[0], moves[1] - moves[0]
    lengths = np.sqrt(np.einsum("ki,ki->k", edge, edge))
    t = edge / lengths[:, None]
    d_lengths = (t[:, None, :] @ d_edge)[:, 0]
    d_t = (d_edge - t[:, :, None] * d_lengths[:, None, :]) / lengths[:, None, None]
    return lengths, t, d_lengths, d_t


def straight_segments(tendons: Tendons, rotations: Array, positions: Array, twists: Array) -> Segments:
    """Geometry of straight segments.

    Parameters
    ----------
    tendons
        Holes at both ends of every segment.
    rotations, positions
        Of the stations, (n + 1, 3, 3) and [m] (n + 1, 3).
    twists
        Spatial twists of the stations by the unknowns, (n + 1, 6, z).
    """
    holes: Ends = (tendons.tail_hole, None), (tendons.head_hole, None)
    if tendons.loose:
        holes = _shifted(tendons, rotations, positions, twists)
    lengths, t, d_lengths, d_t = _edges(tendons, rotations, positions, twists, holes)
    before, after = t[tendons.holes], t[tendons.holes + 1]
    sine = np.linalg.norm(np.cross(before, after), axis=1)
    cosine = np.einsum("ki,ki->k", before, after)
    angles = np.arctan2(sine, cosine)
    safe = np.where(sine > 1e-14, sine, np.inf)[:, None]
    to_after = (after - cosine[:, None] * before) / safe
    to_before = (before - cosine[:, None] * after) / safe
    d_angles = -(to_before[:, None, :] @ d_t[tendons.holes + 1])[:, 0]
    d_angles -= (to_after[:, None, :] @ d_t[tendons.holes])[:, 0]
    return Segments(lengths, angles, d_lengths, d_angles, t, d_t, holes)

r"""Integrates the Cosserat equations, and their variations, over a stack of intervals at once.

In section frames, with :math:`\Lambda = [m, n]`, :math:`\xi = [\kappa, \gamma]` (paper, Eqs. 2 to 5):

.. math::

    g' = g \hat\xi, \qquad \Lambda' = \mathrm{ad}_\xi^T \Lambda - [0, R^T w],

with the weight per length :math:`w`. Along continuous tendons :math:`\Lambda` is the wrench of rod and
tendons together (see `section.coupled_strain`). Variations obey
:math:`\eta' = -\mathrm{ad}_\xi \eta + \delta\xi` for the pose (body frame) and the linearised balance for
the wrench. The scheme is the explicit Runge-Kutta method of order 8 of Dormand and Prince, with fixed steps.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.integrate import DOP853

from tdcr_fe.model.robot import Robot
from tdcr_fe.validation.reference.section import Section, TendonCourse, coupled_strain
from tdcr_fe.validation.reference.settings import Array


def _structure() -> tuple[Array, Array, Array]:
    hat = np.zeros((3, 3, 3))
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        hat[i, k, j], hat[i, j, k] = 1.0, -1.0
    ad = np.zeros((6, 6, 6))
    ad[:3, :3, :3] = ad[:3, 3:, 3:] = ad[3:, 3:, :3] = hat
    coad = np.zeros((6, 6, 6))
    coad[:3, :3, :3] = coad[3:, :3, 3:] = coad[3:, 3:, :3] = hat
    return hat.reshape(3, 9), ad.reshape(6, 36), coad.reshape(6, 36)


_HAT, _AD, _COAD = _structure()


def hat(v: Array) -> Array:
    """Skew matrix: ``hat(v) @ w = v x w``; shapes (..., 3) to (..., 3, 3)."""
    return (v @ _HAT).reshape((*v.shape[:-1], 3, 3))


def ad(strain: Array) -> Array:
    """Matrix of the bracket of twists, [[k^, 0], [g^, k^]]; shapes (..., 6) to (..., 6, 6)."""
    return (strain @ _AD).reshape((*strain.shape[:-1], 6, 6))


def wrench_matrix(wrench: Array) -> Array:
    """Derivative of ``ad(x).T @ wrench`` with respect to x, [[m^, n^], [n^, 0]]; (..., 6) to (..., 6, 6)."""
    return (wrench @ _COAD).reshape((*wrench.shape[:-1], 6, 6))


def adjoint(rotation: Array, position: Array) -> Array:
    """Body twist to spatial twist (about the world's origin); (..., 3, 3) and (..., 3) to (..., 6, 6)."""
    result = np.zeros((*position.shape[:-1], 6, 6))
    result[..., :3, :3] = result[..., 3:, 3:] = rotation
    result[..., 3:, :3] = hat(position) @ rotation
    return result


_A = np.asarray(DOP853.A, dtype=float)
_B = np.asarray(DOP853.B, dtype=float)
_C = np.asarray(DOP853.C, dtype=float)


@dataclass(frozen=True)
class Flow:
    """The ends of n intervals, each integrated in the frame of its own start.

    The c columns of the derivatives belong to the starting wrench (6), the weight per length in the frame
    of the start (3, only with gravity) and the tensions of continuous tendons.

    Attributes
    ----------
    wrench : ndarray, shape (n, 6)
        At the ends, in their section frames [N m, N].
    rotation : ndarray, shape (n, 3, 3)
        From the end's frame to the start's.
    position : ndarray, shape (n, 3)
        Of the end in the start's frame [m].
    tendon_length : ndarray, shape (n, n_tendons)
        Of continuous tendons within the interval [m].
    d_wrench, d_pose : ndarray, shape (n, 6, c)
        Derivatives of wrench and pose (body twist at the end).
    d_length : ndarray, shape (n, n_tendons, c)
        Derivative of the tendons' lengths.
    """

    wrench: Array
    rotation: Array
    position: Array
    tendon_length: Array
    d_wrench: Array
    d_pose: Array
    d_length: Array


def tendon_course(robot: Robot, s: Array) -> TendonCourse:
    """The tendons of a robot at arc lengths ``s`` [m], shape (n,); beyond its end a tendon stays where it ends."""
    shape = (len(s), len(robot.tendons), 3)
    r, slope = np.zeros(shape), np.zeros(shape)
    for i, tendon in enumerate(robot.tendons):
        end = robot.end(tendon)
        inside = np.minimum(s, end)
        r[:, i, :2] = tendon.routing.position(inside, end)
        slope[:, i, :2] = tendon.routing.position(inside, end, 1)
    lever = np.zeros((*shape, 6))
    lever[..., :3] = -hat(r)
    lever[..., 3:] = np.eye(3)
    return TendonCourse(lever, slope, np.swapaxes(lever, -1, -2) @ lever)


class Rod:
    """A stack of intervals of a rod, ready to be integrated.

    Parameters
    ----------
    section
        Law of the n intervals.
    starts
        Arc lengths of their starts [m], shape (n,).
    lengths
        [m], shape (n,).
    max_step
        Longest step [m].
    gravity
        Whether weight acts.
    robot
        Gives the continuous tendons; None: the tendons do not touch the rod within the intervals.
    """

    def __init__(
        self,
        section: Section,
        starts: Array,
        lengths: Array,
        max_step: float,
        gravity: bool,
        robot: Robot | None = None,
    ) -> None:
        self.section = section
        self.steps = max(1, int(np.ceil(np.max(lengths) / max_step - 1e-9)))
        self.h = lengths / self.steps
        self.size = len(starts)
        self.n_tendons = 0
        self.courses = [[TendonCourse.none(self.size)] * len(_C)] * self.steps
        if robot is not None and robot.tendons:
            self.n_tendons = len(robot.tendons)
            middles = starts + 0.5 * lengths
            ends = np.array([robot.end(t) for t in robot.tendons])
            self.active = (middles[:, None] < ends[None, :]).astype(float)
            at = [[starts + (k + c) * self.h for c in _C] for k in range(self.steps)]
            self.courses = [[tendon_course(robot, s) for s in stages] for stages in at]
        self.columns = 6 + (3 if gravity else 0) + self.n_tendons
        self._matrix = np.zeros((self.size, 12, 12))

    def integrate(self, wrench: Array, weight: Array | None = None, tension: Array | None = None) -> Flow:
        """Integrate every interval from its start to its end.

        Parameters
        ----------
        wrench
            At the starts [N m, N], shape (n, 6).
        weight
            Weight per length in the frames of the starts [N/m], shape (n, 3); needed with gravity.
        tension
            Of continuous tendons [N], shape (n_tendons,).

        Returns
        -------
        Flow
            The ends.
        """
        n, t, c = self.size, self.n_tendons, self.columns
        head = 18 + t
        y = np.zeros((n, head + (12 + t) * c))
        y[:, :6] = wrench
        y[:, 6:15] = np.eye(3).ravel()
        y[:, head:].reshape(n, 12 + t, c)[:, :6, :6] = np.eye(6)
        pull = self.active * tension if t and tension is not None else np.zeros((n, t))
        guess = np.broadcast_to(self.section.rest, (n, 6))
        slopes = np.empty((len(_C), *y.shape))
        flat = slopes.reshape(len(_C), -1)
        for k in range(self.steps):
            for i in range(len(_C)):
                at = y if i == 0 else y + self.h[:, None] * (_A[i, :i] @ flat[:i]).reshape(y.shape)
                guess = self._slope(at, slopes[i], weight, pull, guess, self.courses[k][i])
            y = y + self.h[:, None] * (_B @ flat).reshape(y.shape)
            rotation = y[:, 6:15].reshape(n, 3, 3)
            square = np.swapaxes(rotation, 1, 2) @ rotation
            y[:, 6:15] = (rotation @ (1.5 * np.eye(3) - 0.5 * square)).reshape(n, 9)
        variation = y[:, head:].reshape(n, 12 + t, c)
        return Flow(
            wrench=y[:, :6],
            rotation=y[:, 6:15].reshape(n, 3, 3),
            position=y[:, 15:18],
            tendon_length=y[:, 18:head],
            d_wrench=variation[:, :6],
            d_pose=variation[:, 6:12],
            d_length=variation[:, 12:],
        )

    def _slope(
        self, y: Array, out: Array, weight: Array | None, pull: Array, guess: Array, course: TendonCourse
    ) -> Array:
        """Write the derivative of the state with respect to arc length to ``out``; give the strain."""
        n, t, c, matrix = self.size, self.n_tendons, self.columns, self._matrix
        wrench, rotation = y[:, :6], y[:, 6:15].reshape(n, 3, 3)
        if t:
            strain, compliance, along, stretch = coupled_strain(self.section, course, pull, wrench, guess)
            out[:, 18 : 18 + t] = stretch[..., 0] * self.active
        else:
            strain, compliance = self.section.strain(wrench)
        bracket = ad(strain)
        dual = np.swapaxes(bracket, 1, 2)
        out[:, :6] = (dual @ wrench[:, :, None])[..., 0]
        out[:, 6:15] = (rotation @ hat(strain[:, :3])).reshape(n, 9)
        out[:, 15:18] = (rotation @ strain[:, 3:, None])[..., 0]
        if weight is not None:
            local = (weight[:, None, :] @ rotation)[:, 0]
            out[:, 3:6] -= local
        variation = y[:, 18 + t :].reshape(n, 12 + t, c)
        target = out[:, 18 + t :].reshape(n, 12 + t, c)
        turn = wrench_matrix(wrench)
        matrix[:, :6, :6] = dual + turn @ compliance
        matrix[:, 6:, :6] = compliance
        matrix[:, 6:, 6:] = -bracket
        if weight is not None:
            matrix[:, 3:6, 6:9] = -hat(local)
        target[:, :12] = matrix @ variation[:, :12]
        if weight is not None:
            target[:, 3:6, 6:9] -= np.swapaxes(rotation, 1, 2)
        if t:
            along = along * self.active[:, None, :]
            target[:, :6, c - t :] += turn @ along
            target[:, 6:12, c - t :] += along
            gradient = stretch[..., 1:] * self.active[..., None]
            target[:, 12:] = gradient @ (compliance @ variation[:, :6])
            target[:, 12:, c - t :] += gradient @ along
        return strain

"""Stiffness of a robot from forces and displacements (paper, section 3.4, Eqs. 36-40)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tdcr_fe.model.robot import Robot

Array = NDArray[np.float64]


@dataclass(frozen=True)
class IdentifiedStiffness:
    """A stiffness matrix that maps displacements of a point to forces on it, ``f = K u``.

    Attributes
    ----------
    matrix : ndarray, shape (n, n)
        [N/m].
    covariance : ndarray, shape (n, n)
        Least-squares covariance of the rows of the matrix, for unit variance of the forces [1/m^2].
    regularisation : float
        Weight ``lambda`` of ``|K|^2`` that was used [m^2].
    residual : float
        Root mean square of the forces not explained [N].
    asymmetry : float
        Norm of the skew part over that of the matrix, before it was made symmetric [1].
    """

    matrix: Array
    covariance: Array
    regularisation: float
    residual: float
    asymmetry: float

    def predict(self, force: ArrayLike) -> Array:
        """Displacement under a new force (Eq. 40) [m], shape (..., n).

        Parameters
        ----------
        force
            [N], shape (..., n).
        """
        f = np.asarray(force, dtype=float)
        return np.linalg.solve(self.matrix, f[..., None])[..., 0]


def identify_stiffness(
    forces: ArrayLike,
    displacements: ArrayLike,
    regularisation: float | None = None,
    *,
    symmetric: bool = True,
) -> IdentifiedStiffness:
    """Least squares with Tikhonov regularisation, ``min |F - U K|^2 + lambda |K|^2`` (Eqs. 37-39).

    Parameters
    ----------
    forces
        One experiment a row [N], shape (m, n).
    displacements
        One experiment a row [m], shape (m, n).
    regularisation
        ``lambda`` [m^2]. None takes the value with the smallest generalised cross-validation score (G. H. Golub,
        M. Heath, G. Wahba, Technometrics 21 (1979) 215-223).
    symmetric
        Return the symmetric part: for small displacements the stiffness of a clamped robot is symmetric.

    Returns
    -------
    IdentifiedStiffness

    Raises
    ------
    ValueError
        Shapes do not match, or the displacements do not span all directions and nothing regularises.
    """
    f, u = (
        np.atleast_2d(np.asarray(forces, dtype=float)),
        np.atleast_2d(np.asarray(displacements, dtype=float)),
    )
    if f.shape != u.shape:
        raise ValueError(f"forces have shape {f.shape}, displacements {u.shape}; must be the same, (m, n)")
    left, singular, right = np.linalg.svd(u, full_matrices=False)
    if regularisation is None:
        regularisation = _by_cross_validation(f, left, singular)
    if regularisation < 0.0:
        raise ValueError(f"regularisation {regularisation}; must not be negative")
    if regularisation == 0.0 and (len(u) < u.shape[1] or singular[-1] < 1e-10 * singular[0]):
        raise ValueError(
            "the displacements do not span all directions; load other directions, or take a regularisation > 0"
        )
    weight = singular / (singular**2 + regularisation)
    # Rows are experiments, so this is the transpose of the matrix in f = K u.
    matrix = ((right.T * weight) @ left.T @ f).T
    residual = float(np.sqrt(np.mean((f - u @ matrix.T) ** 2)))
    asymmetry = float(np.linalg.norm(matrix - matrix.T) / (2.0 * np.linalg.norm(matrix)))
    if symmetric:
        matrix = 0.5 * (matrix + matrix.T)
    return IdentifiedStiffness(matrix, (right.T * weight**2) @ right, regularisation, residual, asymmetry)


def _by_cross_validation(f: Array, left: Array, singular: Array) -> float:
    """The ``lambda`` of the smallest generalised cross-validation score; zero where that is as good."""
    m = len(f)
    projected = left.T @ f
    outside = float(np.sum(f**2) - np.sum(projected**2))
    candidates = np.concatenate(([0.0], singular[0] ** 2 * np.logspace(-12, 0, 61)))

    def score(value: float) -> float:
        keep = np.where(singular > 0.0, singular**2 / np.maximum(singular**2 + value, 1e-300), 0.0)
        missed = float(np.sum(((1.0 - keep)[:, None] * projected) ** 2)) + max(outside, 0.0)
        return missed / max(m - float(np.sum(keep)), 1e-9) ** 2

    scores = [score(float(c)) for c in candidates]
    return float(candidates[int(np.argmin(scores))])


def validation_error(identified: IdentifiedStiffness, force: ArrayLike, displacement: ArrayLike) -> float:
    """Distance between predicted and measured displacement under a new force, over the measured [1]."""
    measured = np.asarray(displacement, dtype=float)
    return float(np.linalg.norm(identified.predict(force) - measured) / np.linalg.norm(measured))


def bending_stiffness_of_tip(transverse_stiffness: float, robot: Robot) -> float:
    """EI whose cantilever has the transverse stiffness found at the tip [N m^2].

    ``u = F L^3 / (3 EI) + F L / GA``: bending, and the little that shear adds.

    Parameters
    ----------
    transverse_stiffness
        Force over displacement at the tip, both across the backbone [N/m].
    robot
        Gives length and shear stiffness.
    """
    length = robot.backbone.length
    bending = 1.0 / transverse_stiffness - length / robot.backbone.GA
    if bending <= 0.0:
        raise ValueError(
            f"transverse stiffness {transverse_stiffness:g} N/m is larger than shear alone allows, "
            f"{robot.backbone.GA / length:g} N/m"
        )
    return length**3 / (3.0 * bending)


def with_identified_stiffness(robot: Robot, identified: IdentifiedStiffness) -> Robot:
    """The robot with the bending stiffness that follows from the identified matrix, to be written as ``robot.toml``.

    Parameters
    ----------
    robot
        As declared.
    identified
        From forces on the tip and displacements of the tip; the first two components are x and y.

    Returns
    -------
    Robot
        With ``bending_stiffness`` from the mean of both transverse directions, and ``torsional_stiffness`` scaled
        by the same factor (it cannot be identified in such an experiment).
    """
    transverse = float(np.mean(np.diag(identified.matrix)[:2]))
    stiffness = bending_stiffness_of_tip(transverse, robot)
    factor = stiffness / robot.backbone.EI
    return robot.with_backbone(bending_stiffness=stiffness, torsional_stiffness=robot.backbone.GJ * factor)

"""Stiffness of a robot from forces and displacements (paper, section 3.4, Eqs. 36-40), on synthetic experiments."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tdcr_fe.model.loading import Load, LoadStep, Model
from tdcr_fe.model.robot import Robot
from tdcr_fe.solve.simulate import simulate
from tdcr_fe.validation.paper.cases import prototype
from tdcr_fe.validation.reference import solve_reference

Array = NDArray[np.float64]


@dataclass(frozen=True)
class IdentifiedStiffness:
    """A stiffness matrix that maps displacements of a point to forces on it, ``f = K u``."""

    matrix: Array  # [N/m], shape (n, n)
    regularisation: float  # weight of |K|^2 that was used [m^2]

    def predict(self, force: ArrayLike) -> Array:
        """Displacement under a new force (Eq. 40) [m], both of shape (n,)."""
        return np.linalg.solve(self.matrix, np.asarray(force, dtype=float))


def identify_stiffness(forces: Array, displacements: Array) -> IdentifiedStiffness:
    """Least squares with Tikhonov regularisation, ``min |F - U K|^2 + lambda |K|^2`` (Eqs. 37-39), made symmetric.

    ``lambda`` has the smallest generalised cross-validation score (G. H. Golub, M. Heath, G. Wahba, Technometrics 21
    (1979) 215-223).

    Parameters
    ----------
    forces, displacements
        One experiment a row [N], [m], both of shape (m, n).
    """
    left, singular, right = np.linalg.svd(displacements, full_matrices=False)
    projected = left.T @ forces
    outside = max(float(np.sum(forces**2) - np.sum(projected**2)), 0.0)

    def score(value: float) -> float:
        keep = singular**2 / (singular**2 + value)
        missed = float(np.sum(((1.0 - keep)[:, None] * projected) ** 2)) + outside
        return missed / max(len(forces) - float(np.sum(keep)), 1e-9) ** 2

    candidates = np.concatenate(([0.0], singular[0] ** 2 * np.logspace(-12, 0, 61)))
    regularisation = float(min(candidates, key=score))
    weight = singular / (singular**2 + regularisation)
    # Rows are experiments, so this is the transpose of the matrix in f = K u.
    matrix = ((right.T * weight) @ projected).T
    return IdentifiedStiffness(0.5 * (matrix + matrix.T), regularisation)


def bending_stiffness_of_tip(transverse_stiffness: float, robot: Robot) -> float:
    """EI whose cantilever has the transverse stiffness found at the tip [N/m], ``u = F L^3 / (3 EI) + F L / GA``."""
    length = robot.backbone.length
    return length**3 / (3.0 * (1.0 / transverse_stiffness - length / robot.backbone.GA))


def scaled(robot: Robot, factor: float) -> Robot:
    """A robot with its bending and torsional stiffness times a factor."""
    rod = robot.backbone
    return robot.with_backbone(bending_stiffness=factor * rod.EI, torsional_stiffness=factor * rod.GJ)


def with_identified_stiffness(robot: Robot, identified: IdentifiedStiffness) -> Robot:
    """The robot with the bending stiffness of the mean of both transverse directions; torsion changes likewise."""
    transverse = float(np.mean(np.diag(identified.matrix)[:2]))
    return scaled(robot, bending_stiffness_of_tip(transverse, robot) / robot.backbone.EI)


def made_experiments(robot: Robot, forces: Array, error: float = 0.0, seed: int = 1) -> Array:
    """Displacements of the tip under forces [N], shape (m, 3), by the reference, with an error [m], shape (m, 3)."""
    length = robot.backbone.length
    noise = np.random.default_rng(seed)
    found = []
    for force in forces:
        step = LoadStep("force", loads={"tip": Load(length, tuple(force.tolist()))})
        tip = solve_reference(robot, Model("straight", "none"), [step]).steps[-1].tip
        found.append(tip - [0.0, 0.0, length] + error * noise.standard_normal(3))
    return np.array(found)


def study_stiffness() -> dict[str, Any]:
    """A robot 1.35 times as stiff as declared, its stiffness identified from eight small forces."""
    declared = prototype(1)
    true = scaled(declared, 1.35)
    angle, size = np.arange(8) * np.pi / 4.0, np.tile([2e-3, 4e-3], 4)
    forces = np.stack((size * np.cos(angle), size * np.sin(angle), 0.0 * angle), axis=1)
    # Displacements along the backbone are below the error: two components are identified.
    moved = made_experiments(true, forces, error=5e-5)[:, :2]
    identified = identify_stiffness(forces[:, :2], moved)
    found = with_identified_stiffness(declared, identified)
    new = np.array([[0.0024, -0.0018, 0.0]])
    (new_moved,) = made_experiments(true, new, error=5e-5, seed=2)[:, :2]
    far = identify_stiffness(10.0 * forces[:, :2], made_experiments(true, 10.0 * forces)[:, :2])
    pull = [LoadStep("pull", {declared.tendon_names[0]: 1.5})]
    tips = [simulate(r, Model(), pull).steps[-1].tip for r in (true, found, declared)]
    missed = identified.predict(new[0, :2]) - new_moved
    return {
        "true EI": true.backbone.EI,
        "declared EI": declared.backbone.EI,
        "found EI": found.backbone.EI,
        "regularisation": identified.regularisation,
        "new load error": float(np.linalg.norm(missed) / np.linalg.norm(new_moved)),
        "tip error": float(np.linalg.norm(tips[1] - tips[0])),
        "tip error as declared": float(np.linalg.norm(tips[2] - tips[0])),
        "large load factor": with_identified_stiffness(declared, far).backbone.EI / true.backbone.EI,
    }

"""Section 3.4 on synthetic experiments: a stiffness from displacements that the reference computes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tdcr_fe.model.loading import Load, LoadStep, Model
from tdcr_fe.model.robot import Robot
from tdcr_fe.solve.simulate import simulate
from tdcr_fe.validation.paper.cases import prototype
from tdcr_fe.validation.paper.studies.stiffness import (
    IdentifiedStiffness,
    identify_stiffness,
    validation_error,
    with_identified_stiffness,
)
from tdcr_fe.validation.reference.sequence import solve_reference

Array = NDArray[np.float64]


@dataclass(frozen=True)
class StiffnessStudy:
    """Section 3.4 on synthetic experiments: displacements of the reference with the paper's measurement error.

    Attributes
    ----------
    true_stiffness, declared_stiffness, found_stiffness : float
        EI [N m^2].
    identified : IdentifiedStiffness
    new_load_error : float
        Of the predicted displacement under a load that was not used [1].
    shape_error, shape_error_declared : float
        Distance of the tip at 1.5 N of tension between the robot identified, the robot declared, and the true
        one [m].
    large_load_factor : float
        EI found over true where the loads bend the robot far (0.02 to 0.05 N) [1].
    """

    true_stiffness: float
    declared_stiffness: float
    found_stiffness: float
    identified: IdentifiedStiffness
    new_load_error: float
    shape_error: float
    shape_error_declared: float
    large_load_factor: float


def made_experiments(robot: Robot, forces: Array, error: float = 0.0, seed: int = 1) -> Array:
    """Displacements of the tip under forces, by the independent reference [m], shape (m, 3).

    Parameters
    ----------
    robot
        Its tendons are slack.
    forces
        On the tip [N], shape (m, 3).
    error
        Standard deviation of the measurement [m].
    seed
        Of its random numbers.
    """
    length = robot.backbone.length
    noise = np.random.default_rng(seed)
    found = []
    for f in forces:
        step = LoadStep("force", loads={"tip": Load(length, (float(f[0]), float(f[1]), float(f[2])))})
        tip = solve_reference(robot, Model("straight", "none"), [step]).steps[-1].tip
        found.append(tip - [0.0, 0.0, length] + error * noise.standard_normal(3))
    return np.array(found)


def study_stiffness() -> StiffnessStudy:
    """A robot 1.35 times as stiff as declared, its stiffness identified from eight small forces."""
    declared = prototype(1)
    factor = 1.35  # glue and disks stiffen the rod; the factor to be identified
    true = declared.with_backbone(
        bending_stiffness=factor * declared.backbone.EI, torsional_stiffness=factor * declared.backbone.GJ
    )
    angle = np.arange(8) * np.pi / 4.0
    size = np.tile([2e-3, 4e-3], 4)
    forces = np.stack((size * np.cos(angle), size * np.sin(angle)), axis=1)
    three = np.pad(forces, ((0, 0), (0, 1)))
    moved = made_experiments(true, three, error=5e-5)
    # Displacements along the backbone are below the error: two components are identified.
    identified = identify_stiffness(forces, moved[:, :2])
    found = with_identified_stiffness(declared, identified)
    new = np.array([[0.0024, -0.0018, 0.0]])
    new_moved = made_experiments(true, new, error=5e-5, seed=2)
    far = identify_stiffness(10.0 * forces, made_experiments(true, 10.0 * three)[:, :2])
    pull = [LoadStep("pull", {declared.tendon_names[0]: 1.5})]

    def tip(robot: Robot) -> Array:
        return simulate(robot, Model(), pull).steps[-1].tip

    return StiffnessStudy(
        true.backbone.EI,
        declared.backbone.EI,
        found.backbone.EI,
        identified,
        validation_error(identified, new[0, :2], new_moved[0, :2]),
        float(np.linalg.norm(tip(found) - tip(true))),
        float(np.linalg.norm(tip(declared) - tip(true))),
        with_identified_stiffness(declared, far).backbone.EI / true.backbone.EI,
    )

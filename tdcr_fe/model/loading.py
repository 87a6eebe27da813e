"""Concentrated loads, load steps, model choices and settings of the solver as frozen data."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray

from tdcr_fe.model.checks import model_contradictions, step_contradictions
from tdcr_fe.model.robot import Robot
from tdcr_fe.model.schema import Checked, Quantity

Array = NDArray[np.float64]
Vector = tuple[float, float, float]
TendonPath = Literal["straight", "continuous"]
Friction = Literal["none", "per-tendon", "per-hole"]

#: Beam elements between neighbouring disks that ``elements_per_bay = "auto"`` starts from.
STARTING_ELEMENTS_PER_BAY = 2


@dataclass(frozen=True)
class Load(Checked):
    """A concentrated force and moment on the backbone.

    Attributes
    ----------
    at : float
        Arc length [m].
    force : (float, float, float)
        [N].
    moment : (float, float, float)
        [N m].
    frame : "world" or "section"
        The frame of both; "section" follows the section.
    """

    at: Annotated[
        float,
        Quantity(
            "arc length, also between disks",
            "m",
            ge=0.0,
            allowed="an arc length [m], from 0 to the length of the backbone",
        ),
    ]
    force: Annotated[Vector, Quantity("force", "N", note="such as [0.0, 0.05, 0.0]")] = (0.0, 0.0, 0.0)
    moment: Annotated[Vector, Quantity("moment", "N m")] = (0.0, 0.0, 0.0)
    frame: Annotated[
        Literal["world", "section"], Quantity('frame of force and moment; "section" follows the section')
    ] = "world"


@dataclass(frozen=True)
class LoadStep(Checked):
    """One step of a loading sequence; what it does not mention keeps its previous value.

    Attributes
    ----------
    label : str
    tensions : mapping of str to float
        Tension at the base, by tendon [N].
    displacements : mapping of str to float
        Tendon pulled in at the base, by tendon [m]: zero in the unloaded shape, where it is just taut or has its
        pretension.
    loads : mapping of str to Load
        By the load's name.
    substeps : int or None
        Fixed number of substeps; None lets the solver choose.
    time : float or None
        Time at the end of the step [s]; used by creep and by friction laws that depend on the slip rate.
    """

    label: Annotated[str, Quantity("label of the step in tables and pictures")] = ""
    tensions: Annotated[Mapping[str, float], Quantity("tension at the base, by tendon name", "N", ge=0.0)] = (
        field(default_factory=dict)
    )
    displacements: Annotated[
        Mapping[str, float], Quantity("tendon pulled in at the base, by tendon name", "m")
    ] = field(default_factory=dict)
    loads: Annotated[Mapping[str, Load], Quantity("concentrated loads, by a name of your choice")] = field(
        default_factory=dict
    )
    substeps: Annotated[int | None, Quantity("number of substeps", ge=1, le=100_000)] = None
    time: Annotated[float | None, Quantity("time at the end of the step", "s", ge=0.0)] = None


@dataclass(frozen=True)
class Model(Checked):
    """How the robot is modelled.

    Attributes
    ----------
    tendon_path : "straight" or "continuous"
        From hole to hole, or along the backbone (the classical model, paper Eq. 9), as always without disks.
    friction : "none", "per-tendon" or "per-hole"
        One sign per tendon from the rate of its length (paper, Eqs. 15-31), or a state at each hole.
    elements_per_bay : int, tuple of int or "auto"
        Beam elements between neighbouring disks: one number, or one for every bay from the base plate on, the stretch
        beyond the last disk included. "auto" lets the solver choose by the estimated error. Without disks a bay is a
        twentieth of the backbone.
    gravity : (float, float, float)
        [m/s^2].
    """

    tendon_path: Annotated[
        TendonPath, Quantity("tendons straight from hole to hole, or along the backbone")
    ] = "straight"
    friction: Annotated[
        Friction, Quantity("no friction, one sign per tendon, or stick and slip at each hole")
    ] = "per-hole"
    elements_per_bay: Annotated[
        int | tuple[int, ...] | Literal["auto"],
        Quantity("number of beam elements per bay, or a list with one number for every bay", ge=1, le=64),
    ] = "auto"
    gravity: Annotated[
        Vector,
        Quantity(
            "acceleration of gravity, world frame",
            "m/s^2",
            ge=-1e5,
            le=1e5,
            allowed="three finite numbers [m/s^2] of at most 1e5, such as [0.0, 0.0, -9.81]",
        ),
    ] = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        super().__post_init__()
        for c in model_contradictions(self.tendon_path, self.friction):
            raise ValueError(f"Model.{c.key.removeprefix('model.')} = {c.value}: {c.allowed}")

    @classmethod
    def default_for(cls, robot: Robot) -> Model:
        """The default model of a robot: of one without disks, tendons that follow the backbone without friction."""
        return cls(tendon_path="continuous", friction="none") if robot.without_disks else cls()

    @property
    def starting_elements_per_bay(self) -> int:
        """Elements a bay of the first mesh: the number given, or that which "auto" starts from."""
        if self.elements_per_bay == "auto":
            return STARTING_ELEMENTS_PER_BAY
        if isinstance(self.elements_per_bay, tuple):
            return max(self.elements_per_bay)
        return self.elements_per_bay


@dataclass(frozen=True)
class Actuation:
    """Everything that acts on the robot at the end of a load step, with nothing left implicit.

    Attributes
    ----------
    by_displacement : ndarray of bool, shape (n_tendons,)
        Whether a tendon is driven by displacement rather than by tension.
    values : ndarray, shape (n_tendons,)
        Tension [N] or displacement [m] at the base.
    loads : mapping of str to Load
    time : float
        [s].
    """

    by_displacement: NDArray[np.bool_]
    values: Array
    loads: Mapping[str, Load] = field(default_factory=dict)
    time: float = 0.0


def resolve(robot: Robot, steps: Iterable[LoadStep]) -> list[Actuation]:
    """Carry what a step does not name over from the step before.

    Before the first step every tendon is driven by tension zero; a tendon with pretension by displacement zero.

    Parameters
    ----------
    robot
        Whose tendons are meant.
    steps
        The loading sequence.

    Returns
    -------
    list of Actuation
        One a step.

    Raises
    ------
    ValueError
        A step names an unknown tendon, or a tendon twice, or a load beyond the tip.
    """
    index = {name: i for i, name in enumerate(robot.tendon_names)}
    by_displacement = np.array([t.pretension > 0.0 for t in robot.tendons], dtype=bool)
    values = np.zeros(len(index))
    loads: dict[str, Load] = {}
    time = 0.0
    result = []
    for number, step in enumerate(steps):
        found = step_contradictions(
            number,
            step.tensions,
            step.displacements,
            {name: load.at for name, load in step.loads.items()},
            robot.tendon_names,
            robot.backbone.length,
        )
        if found:
            raise ValueError("\n".join(f"{c.key} = {c.value}: {c.allowed}" for c in found))
        by_displacement, values = by_displacement.copy(), values.copy()
        for mapping, mode in ((step.tensions, False), (step.displacements, True)):
            for name, value in mapping.items():
                by_displacement[index[name]] = mode
                values[index[name]] = value
        loads = {**loads, **step.loads}
        time = step.time if step.time is not None else time
        result.append(Actuation(by_displacement, values, loads, time))
    return result


@dataclass(frozen=True)
class SolverSettings(Checked):
    """Numerics of the quasi-static solver. Also the ``[solver]`` table of ``scenario.toml``.

    Attributes
    ----------
    tolerance : float
        Largest unbalanced force or moment, relative to the scale of the acting forces [1].
    step_tolerance : float
        A Newton step that moves no node by more than this fraction of the length, and turns none by more than
        this angle, also ends the iteration [1, rad].
    max_iterations : int
        Newton iterations of one attempt.
    max_turn : float
        Largest change of an element's rotation in one iteration [rad].
    path_tolerance : float
        With friction the answer depends on the path, through slips that reverse. A load step is divided until the
        uncertainty of where they reverse moves no node by more than this fraction of the backbone's length [1].
    max_substeps : int
        Maximum substeps used to resolve path dependence. If the tolerance is still not met, the step carries its
        refinement error and a warning.
    min_substep : float
        Smallest substep tried where Newton does not converge, as a fraction of the load step [1].
    max_substep_turn : float
        Where a section turns by more than this in a substep, and the slopes at its ends do not explain that, the
        substep is compared with its halves: a long step may converge to an equilibrium that the robot does not reach
        along its path [rad].
    presliding : float
        Slip of a tendon through a hole from rest to full friction [m].
    mesh_tolerance : float
        Largest estimated discretisation error, as a fraction of the backbone's length, which the automatic mesh has to
        meet and above which a step carries a warning [1]. Infinity leaves the estimate out.
    """

    tolerance: Annotated[
        float,
        Quantity("largest unbalanced force, relative to the scale of the acting forces", ge=1e-13, le=1e-2),
    ] = 1e-8
    step_tolerance: Annotated[
        float, Quantity("Newton step that ends the iteration, over the length", ge=1e-15, le=1e-4)
    ] = 1e-10
    max_iterations: Annotated[int, Quantity("Newton iterations of one attempt", ge=1, le=1000)] = 20
    max_turn: Annotated[
        float, Quantity("largest change of an element's rotation in one iteration", "rad", gt=0.0, le=3.0)
    ] = 0.5
    path_tolerance: Annotated[
        float,
        Quantity("uncertainty of the path, over the length, above which a step is divided", ge=1e-9, le=1.0),
    ] = 1e-5
    max_substeps: Annotated[
        int, Quantity("maximum substeps used to resolve path dependence", ge=1, le=100_000)
    ] = 64
    min_substep: Annotated[
        float,
        Quantity("smallest substep where Newton does not converge, over the load step", ge=1e-6, le=1.0),
    ] = 1.0 / 256.0
    max_substep_turn: Annotated[
        float,
        Quantity(
            "turn of a section above which a substep is compared with its halves", "rad", gt=0.0, le=10.0
        ),
    ] = 0.7
    presliding: Annotated[
        float, Quantity("tendon travel through a hole from rest to full friction", "m", ge=1e-9, le=1e-2)
    ] = 1e-6
    mesh_tolerance: Annotated[
        float,
        Quantity("largest estimated mesh error, over the length; inf: no estimate", gt=0.0, infinite=True),
    ] = 1e-4

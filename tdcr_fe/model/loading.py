"""Concentrated loads, load steps, model choices and settings of the solver as frozen data."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Annotated, Any, Literal

import numpy as np

from tdcr_fe.elements import Array, Flags
from tdcr_fe.elements.drives import DISPLACEMENT, DRIVES, TENSION, Drive, TendonDrives
from tdcr_fe.elements.hysteresis import HysteresisKind
from tdcr_fe.model.checks import step_contradictions
from tdcr_fe.model.messages import shown
from tdcr_fe.model.robot import Robot
from tdcr_fe.model.schema import Checked, FieldError, Quantity, check_instance

Vector = tuple[float, float, float]
TendonPath = Literal["straight", "continuous"]
#: Names of the entries of `tdcr_fe.elements.friction.FRICTION_MODELS`, as a type.
FrictionKind = Literal["none", "per-tendon", "per-hole"]

_AT = "an arc length [m], from 0 to the length of the backbone"
_GRAVITY = "three finite numbers [m/s^2] of at most 1e5, such as [0.0, 0.0, -9.81]"


@dataclass(frozen=True)
class Load(Checked):
    """A concentrated force and moment on the backbone.

    Attributes
    ----------
    at : float
        Arc length, also between disks [m].
    force : (float, float, float)
        Force [N].
    moment : (float, float, float)
        Moment [N m].
    frame : "world" or "section"
        Frame of force and moment; "section" follows the section.
    """

    at: Annotated[float, Quantity(unit="m", ge=0.0, allowed=_AT)]
    force: Annotated[Vector, Quantity(unit="N", note="such as [0.0, 0.05, 0.0]")] = (0.0, 0.0, 0.0)
    moment: Annotated[Vector, Quantity(unit="N m")] = (0.0, 0.0, 0.0)
    frame: Literal["world", "section"] = "world"


@dataclass(frozen=True)
class LoadStep(Checked):
    """One step of a loading sequence; what it does not mention keeps its previous value.

    Attributes
    ----------
    label : str
        Label of the step in tables and pictures.
    tensions : mapping of str to float
        Tension at the base, by tendon name [N].
    displacements : mapping of str to float
        Tendon pulled in at the base, by tendon name [m]. Zero in the unloaded shape, where it is just taut or has its
        pretension.
    loads : mapping of str to Load
        Concentrated loads, by a name of your choice.
    substeps : int or None
        Number of substeps. None lets the solver choose.
    time : float or None
        Time at the end of the step [s]. Used by creep and by friction laws that depend on the slip rate.
    motor_angles : mapping of str to float
        Angle of the motor that winds a tendon on its `spool`, by tendon name [rad]. Zero where the displacement is.
    """

    label: str = ""
    tensions: Annotated[Mapping[str, float], Quantity(unit="N", ge=0.0)] = field(default_factory=dict)
    displacements: Annotated[Mapping[str, float], Quantity(unit="m")] = field(default_factory=dict)
    loads: Mapping[str, Load] = field(default_factory=dict)
    substeps: Annotated[int | None, Quantity(ge=1, le=100_000)] = None
    time: Annotated[float | None, Quantity(unit="s", ge=0.0)] = None
    motor_angles: Annotated[Mapping[str, float], Quantity(unit="rad")] = field(default_factory=dict)

    def inputs(self) -> Iterator[tuple[Drive, Mapping[str, float]]]:
        """All drives, with the inputs by tendon name that the step gives them."""
        for drive in DRIVES:
            yield drive, getattr(self, drive.inputs)

    @property
    def is_in_newtons_and_metres(self) -> bool:
        """Whether all its inputs are tensions and displacements."""
        return all(drive in (TENSION, DISPLACEMENT) for drive, given in self.inputs() if given)

    def after(self, before: LoadStep) -> LoadStep:
        """The step with all that it keeps of the step before it: both together as one step."""
        given = {name for _, own in self.inputs() for name in own}
        inputs: dict[str, Any] = {
            drive.inputs: {n: x for n, x in kept.items() if n not in given} | dict(own)
            for (drive, own), (_, kept) in zip(self.inputs(), before.inputs(), strict=True)
        }
        time = before.time if self.time is None else self.time
        return replace(self, **inputs, loads={**before.loads, **self.loads}, time=time)


@dataclass(frozen=True)
class Model(Checked):
    """How the robot is modelled.

    Attributes
    ----------
    tendon_path : "straight" or "continuous"
        Tendons straight from hole to hole, or along the backbone. The latter is the classical model (paper, Eq. 9), and
        that of robots without disks.
    friction : "none", "per-tendon" or "per-hole"
        No friction, one sign per tendon, or stick and slip at each hole. The sign is that of the rate of the tendon's
        length (paper, Eqs. 15-31).
    elements_per_bay : int, tuple of int or "auto"
        Number of beam elements per bay, or a list with one number for every bay. Bays lie between neighbouring disks,
        from the base plate on, the stretch beyond the last disk included. "auto" lets the solver choose by the
        estimated error. Without disks a bay is a twentieth of the backbone.
    gravity : (float, float, float)
        Acceleration of gravity, world frame [m/s^2].
    hysteresis : "elastic-plastic" or "dahl"
        How friction at a hole grows with the slip, over the distance `presliding` of the solver: linearly up to full
        friction, or smoothly, the more slowly the nearer it is (Dahl).
    """

    tendon_path: TendonPath = "straight"
    friction: FrictionKind = "per-hole"
    elements_per_bay: Annotated[int | tuple[int, ...] | Literal["auto"], Quantity(ge=1, le=64)] = "auto"
    gravity: Annotated[Vector, Quantity(unit="m/s^2", ge=-1e5, le=1e5, allowed=_GRAVITY)] = (0.0, 0.0, 0.0)
    hysteresis: HysteresisKind = "elastic-plastic"

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.tendon_path == "continuous" and self.friction != "none":
            text = 'tendon_path = "continuous" is the classical model, which has no friction; set friction = "none"'
            raise FieldError("friction", shown(self.friction), text)

    @classmethod
    def default_for(cls, robot: Robot) -> Model:
        """The default model of a robot: of one without disks, tendons that follow the backbone without friction."""
        return cls(tendon_path="continuous", friction="none") if robot.without_disks else cls()


@dataclass(frozen=True)
class Actuation:
    """Everything that acts on the robot at the end of a load step, with nothing left implicit.

    Attributes
    ----------
    drives : TendonDrives
        How every tendon is driven.
    values : ndarray, shape (n_tendons,)
        Tension at the base [N], or length wound there [m], as every tendon is driven.
    loads : mapping of str to Load
    time : float
        [s].
    """

    drives: TendonDrives
    values: Array
    loads: Mapping[str, Load] = field(default_factory=dict)
    time: float = 0.0

    @property
    def by_displacement(self) -> Flags:
        """Whether the length wound is prescribed rather than the tension, shape (n_tendons,)."""
        return self.drives.winds


def in_newtons_and_metres(robot: Robot, steps: Iterable[LoadStep]) -> tuple[LoadStep, ...]:
    """The steps with all inputs as tensions and displacements, in place of angles of motors and the like."""
    tendons = {t.name: t for t in robot.tendons}
    found = []
    for step in steps:
        if not step.is_in_newtons_and_metres:
            inputs: dict[str, Any] = {drive.inputs: {} for drive in DRIVES}
            for drive, given in step.inputs():
                same = DISPLACEMENT if drive.winds else TENSION
                inputs[same.inputs] |= {n: drive.scale(tendons[n]) * x for n, x in given.items()}
            step = replace(step, **inputs)
        found.append(step)
    return tuple(found)


def resolve(
    robot: Robot, steps: Iterable[LoadStep], before: Actuation | None = None, restarts: Sequence[int] = ()
) -> list[Actuation]:
    """Carry what a step does not name over from the step before.

    Parameters
    ----------
    robot
        Whose tendons are meant.
    steps
        The loading sequence.
    before
        What acts before it; None: every tendon is driven by tension zero; one with pretension by displacement zero.
    restarts
        Positions of steps before which that acts again.

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
    if before is None:
        kinds = [DISPLACEMENT if t.pretension > 0.0 else TENSION for t in robot.tendons]
        before = Actuation(TendonDrives.of(kinds, robot.tendons), np.zeros(len(index)))
    result = []
    hint = "LoadStep(tensions={'t1': 1.0})"
    check_instance("loading sequence", "steps", steps, Iterable, f"a list such as [{hint}]")
    for number, step in enumerate(steps):
        if number == 0 or number in restarts:
            drives, values, loads, time = before.drives, before.values, before.loads, before.time
        check_instance("loading sequence", f"steps[{number}]", step, LoadStep, f"such as {hint}")
        if found := [
            *step_contradictions(number, step, robot.tendon_names, robot.backbone.length, robot.tendons)
        ]:
            raise ValueError("\n".join(f"{c.key} = {c.value}: {c.allowed}" for c in found))
        values = values.copy()
        for drive, given in step.inputs():
            for name, value in given.items():
                i = index[name]
                drives = drives.replaced(i, drive, drive.scale(robot.tendons[i]))
                values[i] = drives.scale[i] * value
        loads = {**loads, **step.loads}
        time = step.time if step.time is not None else time
        result.append(Actuation(drives, values, loads, time))
    return result


@dataclass(frozen=True)
class SolverSettings(Checked):
    """Numerics of the quasi-static solver. Also the ``[solver]`` table of ``scenario.toml``.

    Attributes
    ----------
    tolerance : float
        Largest unbalanced force, relative to the scale of the acting forces [1]. Moments likewise.
    step_tolerance : float
        Newton step that ends the iteration, over the length [1]. It moves no node by more than this fraction of the
        length, and turns none by more than this angle [rad].
    max_iterations : int
        Newton iterations of one attempt.
    max_turn : float
        Largest change of an element's rotation in one iteration [rad].
    path_tolerance : float
        Uncertainty of the path, over the length, above which a step is divided [1]. With friction the answer depends on
        the path, through slips that reverse: the uncertainty of where they reverse moves no node by more than this.
    max_substeps : int
        Maximum substeps used to resolve path dependence. If the tolerance is still not met, the step carries its
        refinement error and a warning.
    min_substep : float
        Smallest substep where Newton does not converge, over the load step [1].
    max_substep_turn : float
        Turn of a section above which a substep is compared with its halves [rad]. A long step may converge to an
        equilibrium that the robot does not reach along its path; the slopes at the ends of the step do not explain it.
    presliding : float
        Tendon travel through a hole from rest to full friction [m].
    mesh_tolerance : float
        Largest estimated mesh error, over the length; inf: no estimate [1]. The automatic mesh has to meet it, and
        above it a step carries a warning.
    """

    tolerance: Annotated[float, Quantity(ge=1e-13, le=1e-2)] = 1e-8
    step_tolerance: Annotated[float, Quantity(ge=1e-15, le=1e-4)] = 1e-10
    max_iterations: Annotated[int, Quantity(ge=1, le=1000)] = 20
    max_turn: Annotated[float, Quantity(unit="rad", gt=0.0, le=3.0)] = 0.5
    path_tolerance: Annotated[float, Quantity(ge=1e-9, le=1.0)] = 1e-5
    max_substeps: Annotated[int, Quantity(ge=1, le=100_000)] = 64
    min_substep: Annotated[float, Quantity(ge=1e-6, le=1.0)] = 1.0 / 256.0
    max_substep_turn: Annotated[float, Quantity(unit="rad", gt=0.0, le=10.0)] = 0.7
    presliding: Annotated[float, Quantity(unit="m", ge=1e-9, le=1e-2)] = 1e-6
    mesh_tolerance: Annotated[float, Quantity(gt=0.0, infinite=True)] = 1e-4

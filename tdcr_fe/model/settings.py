"""Settings of the quasi-static solver: tolerances and limits of its numerics, no physics."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from tdcr_fe.model.schema import Quantity, check_fields


@dataclass(frozen=True)
class SolverSettings:
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
        float,
        Quantity(
            "a Newton step that moves no node by more than this fraction of the length ends the iteration",
            ge=1e-15,
            le=1e-4,
        ),
    ] = 1e-10
    max_iterations: Annotated[int, Quantity("Newton iterations of one attempt", ge=1, le=1000)] = 20
    max_turn: Annotated[
        float,
        Quantity("largest change of an element's rotation in one iteration", unit="rad", gt=0.0, le=3.0),
    ] = 0.5
    path_tolerance: Annotated[
        float,
        Quantity(
            "a step with friction is divided until its path moves no node by more than this fraction of the length",
            ge=1e-9,
            le=1.0,
        ),
    ] = 1e-5
    max_substeps: Annotated[
        int, Quantity("maximum substeps used to resolve path dependence", ge=1, le=100_000)
    ] = 64
    min_substep: Annotated[
        float,
        Quantity(
            "smallest substep tried where Newton does not converge, as a fraction of the load step",
            ge=1e-6,
            le=1.0,
        ),
    ] = 1.0 / 256.0
    max_substep_turn: Annotated[
        float,
        Quantity(
            "a substep that turns a section by more is checked against its halves",
            unit="rad",
            gt=0.0,
            le=10.0,
        ),
    ] = 0.7
    presliding: Annotated[
        float,
        Quantity("tendon travel through a hole from rest to full friction", unit="m", ge=1e-9, le=1e-2),
    ] = 1e-6
    mesh_tolerance: Annotated[
        float,
        Quantity(
            "largest estimated discretisation error, as a fraction of the length; inf leaves the estimate out",
            gt=0.0,
            infinite=True,
        ),
    ] = 1e-4

    def __post_init__(self) -> None:
        check_fields(self)

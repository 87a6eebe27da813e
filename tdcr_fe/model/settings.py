"""Settings of the quasi-static solver: tolerances and limits of its numerics, no physics."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class SolverSettings:
    """Numerics of the quasi-static solver. Also the ``[solver]`` table of ``scenario.toml``.

    Attributes
    ----------
    tolerance : float
        Largest unbalanced force or moment, relative to the scale of the forces at work [1].
    step_tolerance : float
        A Newton step that moves no node by more than this fraction of the length, and turns none by more than
        this angle, also ends the iteration [1, rad].
    max_iterations : int
        Newton iterations of one attempt.
    max_turn : float
        Largest change of an element's rotation in one iteration [rad].
    path_tolerance : float
        With friction the answer depends on the path. A load step is refined until doubling the number of substeps has
        twice moved no node by more than this fraction of the backbone's length [1].
    max_substeps : int
        Maximum substeps used to resolve path dependence. If the tolerance is still not met, the step carries its
        refinement error and a warning.
    min_substep : float
        Smallest substep tried where Newton does not converge, as a fraction of the load step [1].
    max_substep_turn : float
        Where a section turns by more than this in a substep, the step is checked against its halves: a
        long step may land on an equilibrium that the robot does not reach from where it is [rad].
    presliding : float
        Distance that a tendon creeps through a hole from rest to full friction [m].
    mesh_tolerance : float
        Largest estimated discretisation error, as a fraction of the backbone's length, which the automatic mesh has to
        meet and above which a step carries a warning [1]. Infinity leaves the estimate out.
    """

    tolerance: float = 1e-8
    step_tolerance: float = 1e-10
    max_iterations: int = 20
    max_turn: float = 0.5
    path_tolerance: float = 1e-4
    max_substeps: int = 64
    min_substep: float = 1.0 / 256.0
    max_substep_turn: float = 0.7
    presliding: float = 1e-6
    mesh_tolerance: float = 1e-4

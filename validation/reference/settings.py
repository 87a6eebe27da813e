"""Numerical settings of the reference: integration steps, tolerances and iteration limits."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class ReferenceSettings:
    """Numerical settings, apart from the physics.

    Attributes
    ----------
    sample_at : tuple of float
        Extra arc lengths at which the shape is given [m].
    samples_per_bay : int
        Extra points between neighbouring nodes at which the shape is given.
    substeps : int or None
        Substeps of a load step without a number of its own; None chooses them by step doubling.
    path_tolerance : float
        Largest displacement of a node, over the length, by halving every substep of a load step [1]; distributed over
        the substeps.
    initial_substeps : int
        Substeps that step doubling begins with; four to each are solved at least.
    presliding : float
        Slip of a tendon through a hole from rest to full friction [m].
    max_interval : float
        Longest interval of the multiple shooting, over the length of the backbone [1].
    max_step : float
        Longest Runge-Kutta step, over the length of the backbone [1]; with continuous tendons, which bend
        the rod more evenly, twice that.
    tolerance : float
        Largest scaled residual of a converged state: moments over EI/L, forces over EI/L^2 [1].
    max_iterations : int
        Of Newton's method, in one attempt.
    max_bisections : int
        How often a substep may be halved, for the path or to converge. Beyond it, a path that is not resolved is
        reported with its refinement error, and a substep that does not converge ends the sequence.
    """

    sample_at: tuple[float, ...] = ()
    samples_per_bay: int = 0
    substeps: int | None = None
    path_tolerance: float = 1e-4
    initial_substeps: int = 2
    presliding: float = 1e-6
    max_interval: float = 0.125
    max_step: float = 0.03
    tolerance: float = 1e-10
    max_iterations: int = 30
    max_bisections: int = 10

    def __post_init__(self) -> None:
        for name in ("presliding", "max_interval", "max_step", "tolerance", "path_tolerance"):
            if not getattr(self, name) > 0.0:
                raise ValueError(f"{name} = {getattr(self, name)}; must be positive")
        counts = {"initial_substeps": self.initial_substeps, "max_iterations": self.max_iterations}
        if self.substeps is not None:
            counts["substeps"] = self.substeps
        for name, value in counts.items():
            if value < 1:
                raise ValueError(f"{name} = {value}; must be at least 1")
        if self.samples_per_bay < 0 or self.max_bisections < 0:
            raise ValueError("samples_per_bay and max_bisections must not be negative")

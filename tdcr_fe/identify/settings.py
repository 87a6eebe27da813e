"""Settings of an identification."""

from __future__ import annotations

from dataclasses import dataclass

from tdcr_fe.effects import EFFECTS, Effect


@dataclass(frozen=True)
class IdentifySettings:
    """How the search works; nothing about the robot.

    Attributes
    ----------
    processes : int
        Worker processes. More than one needs a main module that may be imported.
    significance : float
        Chance of adding an effect to data that miss nothing, over all candidates [1].
    candidates : int
        How many of the best candidates of a round are fitted.
    beam : int
        How many models of a round are carried to the next.
    max_effects : int
        At most so many effects are added; beyond four, only while each takes away a tenth of the misfit on held-out
        steps.
    time_limit : float
        Of the whole identification; what it does not suffice for is left out and reported. Only the declared model is
        simulated whatever time that takes [s].
    hold_out : float
        Fraction of the readings that is held out, about, where ``hold_out_branches`` is empty [1].
    hold_out_branches : tuple of str
        Shell patterns; every branch of ``loading.csv`` that matches one is held out, and no other step.
    path_tolerance : float
        Of the solver: accuracy of the path of loading over the length [1].
    own_effects : tuple of Effect
        Candidates besides the listed ones; see `tdcr_fe.io.own_effects.read_own_effects`.
    """

    processes: int = 1
    significance: float = 1e-3
    candidates: int = 5
    beam: int = 2
    max_effects: int = 12
    time_limit: float = 900.0
    hold_out: float = 0.3
    hold_out_branches: tuple[str, ...] = ()
    path_tolerance: float = 5e-5
    own_effects: tuple[Effect, ...] = ()

    @property
    def catalogue(self) -> tuple[Effect, ...]:
        """All candidates, in the order in which several are applied."""
        return (*EFFECTS, *self.own_effects)

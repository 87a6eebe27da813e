"""Result of a sweep: the table of cases, and what follows from it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import pandas as pd

from tdcr_fe.sweeps.collected import Message
from tdcr_fe.sweeps.description import Sweep
from tdcr_fe.sweeps.sampling import Design
from tdcr_fe.sweeps.statistics import SobolIndices, Summary, sobol_indices, summarise, varies


@dataclass(frozen=True)
class SweepResult:
    """All cases of a sweep; printed, it is a summary.

    Attributes
    ----------
    sweep : Sweep
    design : Design
    cases : pandas.DataFrame
        One row a case, in their order: ``case``, ``status``, ``reason``, ``warnings`` (their number), the values of the
        variations, the results.
    inputs, outputs : tuple of str
        Columns of the variations and of the results.
    counts : mapping of str to int
        Number of cases by status.
    failures : mapping of str to tuple of Message
        By status, the reasons of cases that did not converge.
    warnings : tuple of Message
    interrupted : bool
        Whether cases are left that were not run.
    wall_time : float
        Of this call [s].
    case_seconds : float
        Sum of the times of all cases [s].
    solved_now : int
        Cases that this call solved; the others were recalled.
    """

    sweep: Sweep
    design: Design
    cases: pd.DataFrame
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    counts: Mapping[str, int]
    failures: Mapping[str, tuple[Message, ...]] = field(default_factory=dict)
    warnings: tuple[Message, ...] = ()
    interrupted: bool = False
    wall_time: float = 0.0
    case_seconds: float = 0.0
    solved_now: int = 0

    @property
    def converged(self) -> bool:
        """Whether all cases converged."""
        return self.counts.get("converged", 0) == len(self.cases)

    @property
    def varying_outputs(self) -> tuple[str, ...]:
        """Results that differ between cases."""
        return tuple(name for name in self.outputs if varies(self.cases[name].to_numpy(dtype=float)))

    def statistics(self) -> dict[str, Summary]:
        """Moments and quantiles of every result that varies, over the cases that converged."""
        return {n: summarise(self.cases[n].to_numpy(dtype=float)) for n in self.varying_outputs}

    def sobol_indices(self) -> dict[str, SobolIndices]:
        """Sobol indices of every result that varies; empty where the method is not "saltelli"."""
        if not self.design.base_samples:
            return {}
        found = {
            n: sobol_indices(self.cases[n].to_numpy(dtype=float), len(self.inputs), self.sweep.sampling.seed)
            for n in self.varying_outputs
        }
        return {n: x for n, x in found.items() if x is not None}

    def to_frame(self) -> pd.DataFrame:
        """The table of cases."""
        return self.cases

    def __repr__(self) -> str:
        from tdcr_fe.sweeps.display import as_text

        return as_text(self)

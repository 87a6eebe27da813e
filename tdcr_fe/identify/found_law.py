"""A law on no list that was found: its terms, its formula, its misfit."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from tdcr_fe.identify.estimate import Estimate
from tdcr_fe.identify.misfit import Misfit
from tdcr_fe.model.loading import LoadStep


@dataclass(frozen=True)
class LawTerm:
    """One term of a law.

    Attributes
    ----------
    product : str
        Factors and direction, such as ``"|kappa| kappa"``.
    coefficient : Estimate
    where : str
        "all bays", or one bay or disk.
    is_force : bool
        A force on a disk; else a bending moment.
    """

    product: str
    coefficient: Estimate
    where: str
    is_force: bool = False


@dataclass(frozen=True)
class FoundLaw:
    """A law on no list: what acts besides the declared model, as a function of the state.

    Attributes
    ----------
    terms : tuple of LawTerm
        Their sum is the law.
    sentence : str
        The law in words.
    after_fit, after_held_out : Misfit
        With the law.
    alternatives : tuple of str
        Other single terms that explain these data as well.
    steps : tuple of LoadStep
        The simulated loading sequence, with the moments and forces of the law as concentrated loads.
    """

    terms: tuple[LawTerm, ...]
    sentence: str
    after_fit: Misfit
    after_held_out: Misfit
    alternatives: tuple[str, ...]
    steps: tuple[LoadStep, ...]

    @property
    def formula(self) -> str:
        """With numbers, 95 % half-widths and units."""
        parts = []
        for t in self.terms:
            c = t.coefficient
            width = "" if c.std_error is None else f" +- {1.96 * c.std_error:.2g}"
            place = "" if t.where == "all bays" else f" [{t.where}]"
            parts.append(f"({c.value:.4g}{width}) {c.unit} {t.product}{place}")
        return ("F = " if all(t.is_force for t in self.terms) else "m = ") + " + ".join(parts)

    def to_json(self) -> dict[str, Any]:
        """As in ``result.json``."""
        return {
            "formula": self.formula,
            "where": "; ".join(dict.fromkeys(t.where for t in self.terms)),
            "after": {"fit": self.after_fit.to_json(), "held_out": self.after_held_out.to_json()},
            "sentence": self.sentence,
            "terms": [
                {
                    "product": t.product,
                    "coefficient": t.coefficient.value,
                    "std_error": t.coefficient.std_error,
                    "unit": t.coefficient.unit,
                    "where": t.where,
                }
                for t in self.terms
            ],
            "alternatives": list(self.alternatives),
        }

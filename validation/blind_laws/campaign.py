"""Make every blind set with a law on no list, identify it, and compare what is found with the recipe."""

from __future__ import annotations

import time
from collections.abc import Generator, Sequence
from contextlib import closing
from dataclasses import asdict, dataclass, fields
from functools import partial
from pathlib import Path

from tdcr_fe.identify import IdentificationResult, IdentifySettings, identify
from tdcr_fe.identify.result import LawTerm
from tdcr_fe.io.store import Folder, Record, solve_all
from tdcr_fe.model.robot import Robot
from tdcr_fe.validation.blind.laws import LAWS, LawRecipe, make_law_set
from tdcr_fe.validation.crosscheck.campaign import silence_exudyn

#: By recipe, its formula as the product of factors and direction that `identify` writes.
PRODUCTS = {
    "hardening": "|kappa| kappa",
    "softening": "|kappa| kappa",
    "tension stiffening": "T kappa",
    "tapered": "s kappa",
    "drift": "t e_x",
    "cubic spring": "|u|^2 u",
    "lag of the moment": "sum(sign_i m_Ti)",
    "two stiffnesses": "kappa_x e_x",
    "lever that grows": "s m_T",
    "curing": "t kappa",
    "hardening in one bay": "|kappa| kappa",
    "hardening towards the tip": "|kappa| s kappa",
}


@dataclass(frozen=True)
class Outcome:
    """What the identification says of one set.

    Attributes
    ----------
    law : str
        Name of the recipe.
    verdict : str
    effects : tuple of str
        Listed effects that were named.
    formula : str
        That was found, with its numbers; empty where none was.
    right : bool
        Whether it is that of the recipe, at its place, and nothing besides.
    among_others : bool
        Whether the recipe's formula is at least named as one that explains the data as well.
    before, after : float or None
        Distance between predicted and measured markers on the held-out steps, rms [m].
    noise : float or None
        The distance that the noise makes, by its sigma [m].
    seconds : float
        Processor time of the identification [s].
    """

    law: str
    verdict: str
    effects: tuple[str, ...]
    formula: str
    right: bool
    among_others: bool
    before: float | None
    after: float | None
    noise: float | None
    seconds: float

    @property
    def halved(self) -> bool:
        """Whether the held-out error fell to half or less."""
        return self.before is not None and self.after is not None and self.after <= 0.5 * self.before


def run_all(recipes: Sequence[LawRecipe], out: Path, processes: int) -> Generator[Outcome, None, None]:
    """Outcomes of all recipes, those known first, the others as they are finished.

    Parameters
    ----------
    recipes
        Of `tdcr_fe.validation.blind.laws.LAWS`.
    out
        Receives ``sets/SEED``, the measured data, and ``SEED.json``.
    processes
        Number of sets at a time.
    """
    tasks = {str(recipe.seed): recipe.seed for recipe in recipes}
    solve, store = partial(run_one, out=out), Folder(out, indent=2)
    with closing(solve_all(tasks, solve, store, processes, silence_exudyn, again=_other_fields)) as found:
        for _, record, _ in found:
            yield Outcome(**{**record, "effects": tuple(record["effects"])})


def _other_fields(record: Record) -> bool:
    """Whether a record is not that of an outcome, as one of an earlier version."""
    return set(record) != {field.name for field in fields(Outcome)}


def run_one(seed: int, out: Path) -> Record:
    """Make the set with this seed, identify it, and compare: the fields of an `Outcome`."""
    recipe = next(r for r in LAWS if r.seed == seed)
    made = make_law_set(recipe, out / "sets" / str(seed))
    begun = time.process_time()
    result = identify(made.data, IdentifySettings())
    if result.interrupted:  # it is not the result of this set
        raise KeyboardInterrupt
    return asdict(judge(recipe, result, time.process_time() - begun))


def judge(recipe: LawRecipe, result: IdentificationResult, seconds: float) -> Outcome:
    """What was found, beside what the recipe hides."""
    law = result.law
    terms = () if law is None else law.terms
    right = len(terms) == 1 and not result.effects and _is_the_law(recipe, terms[0], result.data.robot)
    return Outcome(
        law=recipe.name,
        verdict=result.verdict,
        effects=tuple(e.name for e in result.effects),
        formula="" if law is None else law.formula,
        right=right,
        among_others=law is not None and any(_names(recipe, other) for other in law.alternatives),
        before=result.before_held_out.rms_position,
        after=result.after_held_out.rms_position,
        noise=result.noise.rms_position,
        seconds=seconds,
    )


def _is_the_law(recipe: LawRecipe, term: LawTerm, robot: Robot) -> bool:
    """Whether a term has the product of a recipe, and acts where the law does."""
    return term.product == PRODUCTS[recipe.name] and term.where == _where(recipe, robot)


def _names(recipe: LawRecipe, alternative: str) -> bool:
    """Whether a term that explains the data as well is the recipe's product, at whatever place."""
    return alternative.split(" in bay ")[0] == PRODUCTS[recipe.name]


def _where(recipe: LawRecipe, robot: Robot) -> str:
    """Where the law of a recipe acts, in the words of `identify`."""
    edges = robot.bay_edges
    disks = len(robot.disks.positions)
    if recipe.name == "cubic spring":
        return f"disk at s = {robot.disks.positions[disks // 2]:.4g} m"
    if recipe.name == "hardening in one bay":
        bay = round(0.4 * disks)
        return f"bay {bay + 1} (s = {edges[bay]:.4g} to {edges[bay + 1]:.4g} m)"
    return "all bays"

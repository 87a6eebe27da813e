"""Score the identification of a blind set against the answer."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from tdcr_fe.identify import IdentificationResult
from tdcr_fe.validation.blind.maker import Answer
from tdcr_fe.validation.blind.recipes import LISTED_AS

#: Two-sided 95 % of a normal distribution.
_WIDTH = 1.96


@dataclass(frozen=True)
class Score:
    """Score of one set.

    Its outcome is "right" (the hidden names, no other), "named together" (a differing name is among those reported as
    indistinguishable from one that was named) or "wrong"; for sets with an effect at a place "right" (kind and place),
    "honest" (the verdict is not "explained") or "overconfident"; or "failed".
    """

    seed: int
    kind: str  # see `Recipe.kind`
    hidden: list[str]
    outcome: str
    error: str = ""  # why it failed
    robot: str = ""
    drive: str = ""
    sigma: float = 0.0  # of positions [m]
    declared_off: float = 0.0  # root mean square misfit of the declared model over sigma [1]
    named: list[str] = field(default_factory=list)
    indistinguishable_from: dict[str, list[str]] = field(default_factory=dict)
    verdict: str = "failed"
    noise_floor: float = math.nan  # rms of the noise on held-out positions [m]
    before: float = math.nan  # rms of the declared model's error on them [m]
    after: float = math.nan  # rms of the final model's error on them [m]
    intervals_hit: list[str] = field(default_factory=list)  # parameters inside of their 95 % interval
    intervals_missed: list[str] = field(default_factory=list)
    found: dict[str, Any] = field(default_factory=dict)  # by effect and parameter, value and standard error
    remaining: list[str] = field(default_factory=list)  # where, and its description
    seconds: float = 0.0  # processor time of the identification [s]
    located: bool = False  # whether the remainder is within one bay of the hidden place, or by its loads

    @property
    def passed(self) -> bool:
        """Whether there is a result."""
        return self.outcome != "failed"


def score(answer: Answer, result: IdentificationResult, seconds: float = 0.0) -> Score:
    """Score one result; errors are over held-out positions."""
    recipe = answer.recipe
    named = [e.name for e in result.effects]
    rivals = {e.name: list(e.indistinguishable_from) for e in result.effects}
    floor, after, before = _held_out(answer, result)
    hit, missed = _intervals(answer, result)
    return Score(
        recipe.seed,
        recipe.kind,
        list(recipe.effects),
        _outcome(answer, result, named, rivals),
        robot=answer.robot,
        drive=recipe.drive,
        sigma=recipe.sigma,
        declared_off=answer.declared_off,
        named=named,
        indistinguishable_from=rivals,
        verdict=result.verdict,
        noise_floor=floor,
        before=before,
        after=after,
        intervals_hit=hit,
        intervals_missed=missed,
        found={e.name: {n: [p.value, p.std_error] for n, p in e.parameters.items()} for e in result.effects},
        remaining=[result.remaining.where, result.remaining.description],
        seconds=seconds,
        located=bool(answer.off_list) and _located(answer, result),
    )


def _outcome(
    answer: Answer, result: IdentificationResult, named: Sequence[str], rivals: dict[str, list[str]]
) -> str:
    hidden = list(answer.recipe.listed)
    if answer.off_list:
        if result.verdict == "explained" and _at_the_place(answer, result):
            return "right"
        return "overconfident" if result.verdict in ("explained", "nothing missing") else "honest"
    if not hidden:
        return "right" if result.verdict == "nothing missing" else "wrong"
    if sorted(named) == sorted(hidden):
        return "right"
    return "named together" if _together(hidden, named, rivals) else "wrong"


def _together(hidden: Sequence[str], named: Sequence[str], rivals: dict[str, list[str]]) -> bool:
    """Whether every hidden effect is named or indistinguishable from a named one, and no further effect is named."""
    missing = [n for n in hidden if n not in named]
    extra = [n for n in named if n not in hidden]
    if len(missing) != len(extra):
        return False
    for name in missing:
        match = next((e for e in extra if name in rivals[e]), None)
        if match is None:
            return False
        extra.remove(match)
    return True


def _held_out(answer: Answer, result: IdentificationResult) -> tuple[float, float, float]:
    """RMS of noise, of the final and of the declared model's error, on held-out positions [m]."""
    data, held = result.data, set(result.held_out_steps)
    use = [i for i, r in enumerate(data.readings) if r.step in held and r.quantity.startswith("position_")]
    noise = np.array([data.readings[i].value - answer.noise_free[i] for i in use])
    parts = (noise, result.residual_after[use], result.residual_before[use])
    floor, after, before = (float(np.sqrt(np.mean(p**2))) for p in parts)
    return floor, after, before


def _intervals(answer: Answer, result: IdentificationResult) -> tuple[list[str], list[str]]:
    """Parameters of correctly named effects whose 95 % interval contains the true value, and the others."""
    inside: list[str] = []
    outside: list[str] = []
    for e in result.effects:
        for name, p in e.parameters.items():
            true = answer.effects.get(e.name, {}).get(name)
            if true is not None and p.std_error is not None:
                hit = abs(p.value - true) <= _WIDTH * p.std_error
                (inside if hit else outside).append(f"{e.name}.{name}")
    return inside, outside


def _at_the_place(answer: Answer, result: IdentificationResult) -> bool:
    """Whether the one effect that was added is that at the place: its kind, its bay or disk, and its tendon."""
    truth = answer.off_list
    if [e.name for e in result.effects] != [LISTED_AS[truth["kind"]]]:
        return False
    found = result.effects[0].parameters
    names = result.data.robot.tendon_names
    if "tendon" in truth and names[round(found["tendon"].value) - 1] != truth["tendon"]:
        return False
    return bool(truth["start"] - 1e-5 <= found["s"].value <= truth["end"] + 1e-5)


def _located(answer: Answer, result: IdentificationResult) -> bool:
    """Whether the remainder is located within one bay of the effect, or by the right loads."""
    truth, data = answer.off_list, result.data
    where = result.remaining.where
    bay = float(np.max(np.diff((0.0, *data.robot.disks.positions))))
    at = [e.parameters["s"].value for e in result.effects if "s" in e.parameters]
    if at:
        where = f"s = {at[0]:.9g} m"
    distance = math.inf
    found = re.search(r"s = ([\d.e-]+)(?: to ([\d.e-]+))? m", where)
    if found:
        start, end = float(found[1]), float(found[2] or found[1])
        distance = max(0.0, start - truth["end"], truth["start"] - end)
        if truth["kind"] == "soft_spot":
            distance = abs(0.5 * (start + end) - 0.5 * (truth["start"] + truth["end"]))
    by_load = False
    steps = re.search(r"steps ([\d, ]+)", where)
    if truth["kind"] == "stuck_hole" and steps:
        index = {n: k for k, n in enumerate(data.step_ids)}
        named = [index[int(n)] for n in steps[1].split(",") if n.strip()]
        pulled = np.array([s.tensions.get(truth["tendon"], 0.0) for s in data.steps])
        by_load = bool(np.mean(pulled[named] > 0.25 * np.max(pulled)) > 0.5)
    return distance <= 1.05 * bay or by_load

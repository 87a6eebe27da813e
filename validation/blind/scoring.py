"""Score the identification of a blind set against the answer."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from tdcr_fe.effects.places import bay_at
from tdcr_fe.identify import IdentificationResult
from tdcr_fe.validation.blind.maker import Answer


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
    # by EFFECT.PARAMETER, how far the fitted value is from the truth, over its standard error [1]
    deviations: dict[str, float] = field(default_factory=dict)
    # by effect of the final model, its stated probability; found or not
    probabilities: dict[str, float] = field(default_factory=dict)
    found: dict[str, Any] = field(default_factory=dict)  # by effect and parameter, value and standard error
    remaining: str = ""  # where the rest is
    seconds: float = 0.0  # processor time of the identification [s]

    @property
    def passed(self) -> bool:
        """Whether there is a result."""
        return self.outcome != "failed"


def score(answer: Answer, result: IdentificationResult, seconds: float = 0.0) -> Score:
    """Score one result; errors are over held-out positions."""
    recipe, data, held = answer.recipe, result.data, set(result.held_out_steps)
    effects = [e for e in result.effects if e.found]
    rivals = {e.name: list(e.indistinguishable_from) for e in effects}
    use = [i for i, r in enumerate(data.readings) if r.step in held and r.quantity.startswith("position_")]
    noise = np.array([data.readings[i].value - answer.noise_free[i] for i in use])
    parts = (noise, result.residuals.before[use], result.residuals.after[use])
    rms = [float(np.sqrt(np.mean(p**2))) for p in parts]
    deviations = {}
    for e in effects:
        for parameter, p in e.parameters.items():
            true = answer.effects.get(e.name, {}).get(parameter)
            if true is not None and p.std_error and not recipe.at_a_place:
                deviations[f"{e.name}.{parameter}"] = (p.value - true) / p.std_error
    return Score(
        recipe.seed,
        recipe.kind,
        list(recipe.effects),
        _outcome(answer, result, rivals),
        robot=answer.robot,
        drive=recipe.drive,
        sigma=recipe.sigma,
        declared_off=answer.declared_off,
        named=list(rivals),
        indistinguishable_from=rivals,
        verdict=result.verdict,
        noise_floor=rms[0],
        before=rms[1],
        after=rms[2],
        deviations=deviations,
        probabilities={e.name: e.probability for e in result.effects},
        found={e.name: {n: [p.value, p.std_error] for n, p in e.parameters.items()} for e in effects},
        remaining=result.remaining.where,
        seconds=seconds,
    )


def _outcome(answer: Answer, result: IdentificationResult, rivals: dict[str, list[str]]) -> str:
    hidden, named = list(answer.recipe.effects), list(rivals)
    if answer.recipe.at_a_place:
        if result.verdict == "explained" and named == hidden and _at_the_place(answer, result):
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


def _at_the_place(answer: Answer, result: IdentificationResult) -> bool:
    """Whether the one effect that was found is in the right bay, or at the right disk and tendon."""
    (name,), found = answer.effects, result.effects[0].parameters
    true = answer.effects[name]
    if "tendon" in true and round(found["tendon"].value) != round(true["tendon"]):
        return False
    in_bay = name in ("soft_bay", "kink")
    start, end = bay_at(result.data.robot, true["s"]) if in_bay else (true["s"], true["s"])
    return bool(start - 1e-5 <= found["s"].value <= end + 1e-5)

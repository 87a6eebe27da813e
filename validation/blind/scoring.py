"""Score the identification of a blind set against the answer, and summarise many sets."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from tdcr_fe.identify import IdentificationResult
from tdcr_fe.validation.blind.maker import Answer
from tdcr_fe.validation.blind.recipes import LISTED_AS

Score = dict[str, Any]

#: Two-sided 95 % of a normal distribution.
_WIDTH = 1.96

#: Largest ratio of the held-out misfit to that of the true robot that counts as noise level [1].
NOISE_FLOOR = 1.15


def score(answer: Answer, result: IdentificationResult) -> Score:
    """Score one result.

    Parameters
    ----------
    answer
        The hidden truth.
    result
        Result of the identification.

    Returns
    -------
    dict
        "outcome": "right" (the hidden names, no other), "named together" (a differing name is among those reported
        as indistinguishable from one that was named), "wrong"; for sets with
        an effect at a place "right" (kind and place), "honest" (the
        verdict is not "explained") or "overconfident". Errors before and after, over the noise of the held-out
        positions; hits of the 95 % intervals; location of the remaining error.
    """
    recipe = answer.recipe
    named = [e.name for e in result.effects]
    rivals = {e.name: list(e.indistinguishable_from) for e in result.effects}
    hidden = list(recipe.listed)
    off_list = bool(answer.off_list)
    if off_list:
        if result.verdict == "explained" and _at_the_place(answer, result):
            outcome = "right"
        else:
            outcome = "overconfident" if result.verdict in ("explained", "nothing missing") else "honest"
    elif not hidden:
        outcome = "right" if result.verdict == "nothing missing" else "wrong"
    elif sorted(named) == sorted(hidden):
        outcome = "right"
    else:
        outcome = "named together" if _together(hidden, named, rivals) else "wrong"
    floor, after, before = _held_out(answer, result)
    inside, outside = _intervals(answer, result)
    done: Score = {
        "seed": recipe.seed,
        "kind": recipe.kind,
        "hidden": list(recipe.effects),
        "robot": answer.robot,
        "drive": recipe.drive,
        "sigma": recipe.sigma,
        "declared_off": answer.declared_off,
        "detectable": answer.detectable,
        "named": named,
        "indistinguishable_from": rivals,
        "verdict": result.verdict,
        "outcome": outcome,
        "noise_floor": floor,
        "before": before,
        "after": after,
        "intervals_hit": inside,
        "intervals_missed": outside,
        "truth": answer.effects,
        "found": {
            e.name: {n: [p.value, p.std_error] for n, p in e.parameters.items()} for e in result.effects
        },
        "remaining": [result.remaining.where, result.remaining.description],
        "mesh_error": result.mesh_error,
        "runs": result.runs,
        "wall_time": result.wall_time,
        "history": list(result.history),
    }
    if off_list:
        done |= _located(answer, result)
    return done


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
                (inside if abs(p.value - true) <= _WIDTH * p.std_error else outside).append(
                    f"{e.name}.{name}"
                )
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


def _located(answer: Answer, result: IdentificationResult) -> Score:
    """If the remainder is located where the effect is: its bay, arc length, or the loads that move a stuck hole."""
    truth, data = answer.off_list, result.data
    where = result.remaining.where
    edges = (0.0, *data.robot.disks.positions)
    bay = float(np.max(np.diff(edges)))
    place: tuple[float, float] | None = None
    at = [e.parameters["s"].value for e in result.effects if "s" in e.parameters]
    if at:
        where = f"s = {at[0]:.9g} m"
    found = re.search(r"s = ([\d.e-]+)(?: to ([\d.e-]+))? m", where)
    if found:
        start = float(found[1])
        place = (start, float(found[2]) if found[2] else start)
    distance = math.inf
    if place is not None:
        distance = max(0.0, place[0] - truth["end"], truth["start"] - place[1])
        if truth["kind"] == "soft_spot":
            distance = abs(0.5 * (place[0] + place[1]) - 0.5 * (truth["start"] + truth["end"]))
    by_load = None
    steps = re.search(r"steps ([\d, ]+)", where)
    if truth["kind"] == "stuck_hole" and steps:
        index = {n: k for k, n in enumerate(data.step_ids)}
        named = [index[int(n)] for n in steps[1].split(",") if n.strip()]
        pulled = np.array([s.tensions.get(truth["tendon"], 0.0) for s in data.steps])
        by_load = bool(np.mean(pulled[named] > 0.25 * np.max(pulled)) > 0.5)
    near = distance <= 0.5 * bay if truth["kind"] == "soft_spot" else distance <= 1e-5
    return {
        "off_list": truth,
        "bays_off": distance / bay if math.isfinite(distance) else None,
        "in_the_bay": near,
        "within_one_bay": distance <= 1.05 * bay,
        "right_load": by_load,
        "located": bool(distance <= 1.05 * bay or by_load),
    }


def summarise(scores: Iterable[Score]) -> dict[str, Any]:
    """Shares and counts over all sets.

    Parameters
    ----------
    scores
        From `score`.

    Returns
    -------
    dict
        By kind: "sets", "right", "named_together", "wrong"; of single effects also for a noise up to 0.12 mm;
        "noise_floor": how many right answers reach the noise level; "coverage"; "clean"; "off_list"; "confusion":
        by hidden effects, how often each is named.
    """
    scores = list(scores)
    kinds = {
        k: [s for s in scores if s["kind"] == k] for k in ("clean", "single", "pair", "weak", "off-list")
    }
    listed = [*kinds["single"], *kinds["pair"]]
    off = kinds["off-list"]
    named = [s for s in [*listed, *off] if s["outcome"] in ("right", "named together")]
    ratios = [s["after"] / s["noise_floor"] for s in named]
    inside = sum(len(s["intervals_hit"]) for s in listed)
    outside = sum(len(s["intervals_missed"]) for s in listed)
    return {
        "sets": len(scores),
        "single": _outcomes(kinds["single"]),
        "single_small_noise": _outcomes([s for s in kinds["single"] if s["sigma"] <= 1.2e-4]),
        "pair": _outcomes(kinds["pair"]),
        "weak": _outcomes(kinds["weak"]),
        "clean": _outcomes(kinds["clean"]),
        "held_out_over_noise": {
            "sets": len(ratios),
            "median": float(np.median(ratios)) if ratios else None,
            "largest": max(ratios, default=None),
            "within_15_percent": sum(r <= NOISE_FLOOR for r in ratios),
        },
        "coverage": {"parameters": inside + outside, "inside": inside},
        "off_list": {
            "sets": len(off),
            "right": sum(s["outcome"] == "right" for s in off),
            "never_explained": sum(s["outcome"] != "overconfident" for s in off),
            "in_the_bay": sum(s["in_the_bay"] for s in off),
            "within_one_bay": sum(s["within_one_bay"] for s in off),
            "located": sum(s["located"] for s in off),
        },
        "seconds": {
            "median": float(np.median([s["wall_time"] for s in scores])) if scores else None,
            "largest": max((s["wall_time"] for s in scores), default=None),
        },
        "confusion": _confusion(scores),
    }


def _outcomes(scores: Sequence[Score]) -> dict[str, int]:
    """How often each outcome of a set with listed effects occurs."""
    outcomes = [s["outcome"] for s in scores]
    return {
        "sets": len(scores),
        "right": outcomes.count("right"),
        "named_together": outcomes.count("named together"),
        "wrong": outcomes.count("wrong"),
    }


def _confusion(scores: Sequence[Score]) -> dict[str, dict[str, int]]:
    """By hidden effects, how often each combination of effects was named."""
    confusion: dict[str, dict[str, int]] = {}
    for s in scores:
        hidden = s["hidden"]
        # the hidden effects come first, others by name
        named = sorted((n not in hidden, n) for n in s["named"])
        answer = " + ".join(n for _, n in named) or "nothing"
        if s["verdict"] in ("partly explained", "unexplained"):
            answer = f"{answer} ({s['verdict']})" if named else "unexplained"
        row = confusion.setdefault(" + ".join(hidden) or "nothing", {})
        row[answer] = row.get(answer, 0) + 1
    return confusion

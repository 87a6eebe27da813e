"""Run the identification on many blind sets and keep every result, so that the run can be resumed."""

from __future__ import annotations

import json
import os
import time
import traceback
from collections.abc import Callable, Sequence
from concurrent.futures import as_completed
from pathlib import Path
from typing import Any

from tdcr_fe.io.atomic import write_text
from tdcr_fe.io.processes import worker_pool
from tdcr_fe.validation.blind.maker import Answer, NotMade, make_blind
from tdcr_fe.validation.blind.recipes import Recipe
from tdcr_fe.validation.blind.scoring import Score, score

#: Called after every set: how many are done, of how many, and the last score.
Progress = Callable[[int, int, Score], None]


def run_benchmark(
    recipes: Sequence[Recipe],
    out: str | os.PathLike[str],
    processes: int = 1,
    progress: Progress | None = None,
) -> list[Score]:
    """Make blind sets, run the identification on each, and score it.

    Parameters
    ----------
    recipes
        See `tdcr_fe.validation.blind.plan`.
    out
        Receives ``sets/SEED`` (input of the identification), ``answers/SEED.json`` and ``results/SEED.json``;
        existing results are not repeated.
    processes
        Number of sets at a time, each in a process of its own.
    progress
        Called after every set.

    Returns
    -------
    list of dict
        In the order of the recipes; a set that failed has the outcome "failed" and an "error".
    """
    out = Path(out)
    for name in ("sets", "answers", "results"):
        (out / name).mkdir(parents=True, exist_ok=True)
    scores: dict[int, Score] = {}
    if processes <= 1:
        for recipe in recipes:
            scores[recipe.seed] = one_set(recipe, out)
            if progress:
                progress(len(scores), len(recipes), scores[recipe.seed])
    else:
        with worker_pool(processes) as pool:
            futures = [pool.submit(one_set, recipe, out) for recipe in recipes]
            for future in as_completed(futures):
                done = future.result()
                scores[done["seed"]] = done
                if progress:
                    progress(len(scores), len(recipes), done)
    return [scores[r.seed] for r in recipes]


def one_set(recipe: Recipe, out: Path) -> Score:
    """Make, identify and score one set, unless its result is there."""
    kept = out / "results" / f"{recipe.seed}.json"
    if kept.exists():
        loaded: Score = json.loads(kept.read_text(encoding="utf-8"))
        return loaded
    try:
        answer = _made(recipe, out)
        done = _identified(answer, out)
    except Exception as error:  # one set that fails must not end the benchmark
        cause = {} if isinstance(error, NotMade) else {"traceback": traceback.format_exc()}
        done = {
            "seed": recipe.seed,
            "kind": "failed",
            "hidden": list(recipe.effects),
            "named": [],
            "verdict": "failed",
            "outcome": "failed",
            "error": f"{type(error).__name__}: {error}",
            **cause,
        }
    _write(kept, done)
    return done


def _made(recipe: Recipe, out: Path) -> Answer:
    file = out / "answers" / f"{recipe.seed}.json"
    if file.exists():
        return Answer.from_json(json.loads(file.read_text(encoding="utf-8")))
    answer = make_blind(out / "sets" / str(recipe.seed), recipe)
    _write(file, answer.to_json())
    return answer


def _identified(answer: Answer, out: Path) -> Score:
    from tdcr_fe.identify import identify
    from tdcr_fe.io.measured import read_measured

    data = read_measured(out / "sets" / str(answer.recipe.seed), strict=True)
    begun = time.process_time()
    result = identify(data)
    seconds = time.process_time() - begun
    if result.interrupted:  # it is not the result of this set
        raise KeyboardInterrupt
    return {**score(answer, result), "processor_time": seconds}


def _write(file: Path, document: Any) -> None:
    write_text(json.dumps(document, indent=1, default=float), file)  # NaN and infinity come back as they are

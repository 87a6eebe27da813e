"""The report on an identification, one HTML page, and the folder with all files that ``tdcr-fe identify`` writes.

The first screen is for readers without statistics.
"""

from __future__ import annotations

import math
import os
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

from tdcr_fe.effects import effect
from tdcr_fe.identify import corrected, figures, sentences
from tdcr_fe.identify.result import IdentificationResult, Misfit
from tdcr_fe.identify.sentences import measure, of_markers, size
from tdcr_fe.identify.settings import OutOfTime, Part
from tdcr_fe.io.files import write_json, write_text
from tdcr_fe.io.processes import interruption_deferred
from tdcr_fe.io.result_files import versions
from tdcr_fe.model.channels import channel
from tdcr_fe.report import page as kit
from tdcr_fe.report import viewer
from tdcr_fe.report.environment import quantity, words
from tdcr_fe.report.motion import Motion
from tdcr_fe.report.page import Card, Level, Page, Picture, Section

#: Level of the verdict line, by verdict.
LEVELS: dict[str, Level] = {
    "explained": "good",
    "nothing missing": "good",
    "explained by a law found": "good",
    "partly explained": "part",
    "cannot tell": "open",
    "unfinished": "open",
    "unexplained": "bad",
}

PROFILES = (
    "Growth of chi-square as one parameter moves and the others are refitted; dotted: the 95 % interval. A second row, "
    "if any, has the 95 % regions of pairs of parameters that these data hardly separate."
)


def _sections(result: IdentificationResult, motion: Motion | None) -> Iterator[Section]:
    """What is below the first screen."""
    noted, data, text = sentences.remarks(result), result.data, result.remaining.description
    if motion is not None:
        declared = bool(motion.markers and motion.markers.declared.size)
        panel = {"panel": viewer.panel(motion), "declared": declared, "result": result}
        title = "The robot in 3D, measured and predicted"
        yield Section("robot", title, "motion.html.j2", panel, folded=False)
    if result.effects:
        drawn = figures.parameters(result)
        known = result.simulated.catalogue
        described = [(e, effect(e.name, known).description, noted.get(e.name, [])) for e in result.effects]
        evidence = {
            "result": result,
            "effects": described,
            "size": size,
            "correlations": sentences.correlations(result),
            "picture": drawn and Picture(drawn, "Profiles of the parameters", PROFILES),
        }
        yield Section("effects", "Effects added, and the evidence", "effects.html.j2", evidence)
    errors = "Error in every load step, and along the backbone"
    picture = Picture(figures.where_error_is(result), errors, f"{errors}. Shaded steps were held out.")
    yield Section("error", "Where the error is", "pictures.html.j2", {"pictures": [picture]})
    rest = {"text": f"{text[:1].upper()}{text[1:]}.", "tests": result.residuals.tests}
    yield Section("rest", "What remains, and whether it is noise", "rest.html.j2", rest)
    rows = sorted(result.log.candidates, key=lambda c: (c.round, c.model, -c.drop))
    shown = {"result": result, "candidates": [c for c in rows if c.drop > 0.5 or c.fitted]}
    yield Section("candidates", "Candidates and search", "candidates.html.j2", shown)
    inputs = {
        "result": result,
        "noise": [(words(q), quantity(x, channel(q).unit)) for q, x in result.noise.rms_by_quantity.items()],
        "outliers": [(data.readings[i], r) for i, r in result.residuals.outliers],
    }
    yield Section("data", "Declared robot, readings, rows left out", "data.html.j2", inputs)
    if result.effects:
        scenarios = {n: t for n, t in corrected.corrected_files(result).items() if n.startswith("effects")}
        texts = {"scenarios": scenarios, "count": len(data.steps)}
        yield Section("scenario", "Scenario of the corrected robot", "scenario.html.j2", texts)


def _cards(result: IdentificationResult) -> tuple[Card, ...]:
    def both(before: Misfit, after: Misfit) -> str:
        return f"{size(before)} → {size(after)}" if result.effects else size(before)

    before, after, held = result.before, result.after, len(result.held_out_steps)
    cards = [Card(both(before.fit, after.fit), "error on fitted steps (rms)")]
    if held:
        cards.append(Card(both(before.held_out, after.held_out), "error on held-out steps (rms)"))
    what = ", ".join(filter(None, ("rms", of_markers(result))))
    cards.append(Card(size(result.noise), f"noise of the measurement alone ({what})"))
    count = f"{len(result.data.steps)} / {len(result.data.readings)}"
    cards.append(Card(count, f"load steps / readings; {held} step{'' if held == 1 else 's'} held out"))
    return tuple(cards)


def page(result: IdentificationResult, motion: Motion | None = None) -> Page:
    """What the report shows; with a motion of the corrected robot (see `replay`) it has the 3D panel."""
    caption = "Measured against predicted" + (", before and after" if result.effects else "")
    if figures.loop(result):
        caption += ". The loop is a run of steps in which one tendon is pulled and released"
    verdict, *further = sentences.sentences(result)
    shown = "Measured and predicted tip path, shapes and a loop of loading and unloading"
    made = f"{result.log.runs} simulations in {result.log.wall_time:.0f} s. "
    made += ", ".join(f"{name} {number}" for name, number in versions().items())
    summary = {
        "numbers": sentences.fitted_numbers(result),
        "statistics": sentences.statistics(result),
        "remarks": [t for texts in sentences.remarks(result).values() for t in texts],
        "block": corrected.effects_block(result),
        "scenarios": [f"effects_{name}.toml" for name, _ in result.data.parts] or ["effects.toml"],
        "law": result.law,
        "observation": [words(n) for n in corrected.observation_effects(result)],
    }
    return Page(
        title=f"Identification of {result.data.name}",
        verdict=verdict,
        level="part" if result.names_nothing else LEVELS[result.verdict],
        sentences=tuple(further),
        cards=_cards(result),
        pictures=(Picture(figures.comparison(result), shown, f"{caption}."),),
        summary=Section("summary", "", "summary.html.j2", summary),
        sections=tuple(_sections(result, motion)),
        has_panel=motion is not None,
        notes=(f"Errors: {measure(result)}. {made}.",),
    )


def render(result: IdentificationResult, motion: Motion | None = None) -> str:
    """The whole report as HTML."""
    return kit.render(page(result, motion), "tdcr_fe.identify")


class Written(NamedTuple):
    """What was written."""

    # with the tables among what was not tried, if the time did not suffice for them
    result: IdentificationResult
    names: list[str]  # files and folders, relative to the output folder
    interrupted: bool  # whether the identification, or the simulation for the tables, was interrupted


def write_result(
    result: IdentificationResult, out: str | os.PathLike[str], deadline: float = math.inf
) -> Written:
    """Write all files of an identification into a folder.

    Parameters
    ----------
    result
        What was found.
    out
        The folder; it is made where there is none.
    deadline
        Reading of `tdcr_fe.identify.settings.clock` at which the simulation of the corrected robot ends; everything
        else is written [s].
    """
    folder = Path(out)
    folder.mkdir(parents=True, exist_ok=True)
    texts = corrected.corrected_files(result)
    next_loading = result.next_loading()
    if next_loading is not None:
        texts = {**texts, "next/loading.csv": next_loading}
    write_json(result.to_json(), folder / "result.json")
    for name, text in texts.items():
        (folder / name).parent.mkdir(exist_ok=True)
        write_text(text, folder / name)
    motion, interrupted = None, result.log.interrupted
    try:
        if not (interrupted or result.data.parts):  # the panel shows one loading sequence
            motion = corrected.corrected_motion(result, folder, deadline)
    except KeyboardInterrupt:  # the report is written without the 3D panel
        interrupted = True
    except OutOfTime:
        result = replace(result, log=replace(result.log, not_tried=(*result.log.not_tried, Part.TABLES)))
        write_json(result.to_json(), folder / "result.json")
    try:
        with interruption_deferred():
            write_text(render(result, motion), folder / "report.html")
    except KeyboardInterrupt:
        interrupted = True
    names = ["result.json", "report.html", *texts, *([] if motion is None else ["corrected"])]
    return Written(result, names, interrupted)

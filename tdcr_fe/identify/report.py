"""The report on an identification, one HTML page, and the folder with all files that ``tdcr-fe identify`` writes.

The first screen is for readers without statistics.
"""

from __future__ import annotations

import math
import os
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

from tdcr_fe.effects import effect
from tdcr_fe.identify import figures
from tdcr_fe.identify.corrected import (
    corrected_files,
    corrected_motion,
    effects_block,
    observation_effects,
    scenario_names,
)
from tdcr_fe.identify.result import IdentificationResult, Misfit
from tdcr_fe.identify.sentences import headline, measure, noise_size, remarks, sentences, size
from tdcr_fe.identify.settings import TABLES, OutOfTime
from tdcr_fe.identify.statistics import correlations, fitted_numbers, statistics
from tdcr_fe.io.atomic import write_json, write_text
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


def _first_screen(result: IdentificationResult) -> Section:
    context = {
        "numbers": fitted_numbers(result),
        "statistics": statistics(result),
        "remarks": [t for texts in remarks(result).values() for t in texts],
        "block": effects_block(result),
        "scenarios": scenario_names(result),
        "law": result.law,
        "observation": [words(n) for n in observation_effects(result)],
    }
    return Section("summary", "", "summary.html.j2", context)


def _evidence_section(result: IdentificationResult) -> Section:
    noted = remarks(result)
    described = [
        (e, effect(e.name, result.catalogue).description, noted.get(e.name, [])) for e in result.effects
    ]
    caption = (
        "How chi-square grows as one parameter is moved and the others follow, with the ends of the 95 % interval; "
        "below, 95 % regions of pairs of parameters that these data hardly separate."
    )
    drawn = figures.parameters(result)
    context = {
        "result": result,
        "effects": described,
        "size": size,
        "correlations": correlations(result),
        "picture": None if drawn is None else Picture(drawn, "Profiles of the parameters", caption),
    }
    return Section("effects", "Effects added, and the evidence", "effects.html.j2", context)


def _error_section(result: IdentificationResult) -> Section:
    by_step = "Error in every load step"
    over_input = "Error over the largest input"
    pictures = [
        Picture(figures.by_step(result), by_step, f"{by_step}. Shaded steps were held out."),
        Picture(figures.over_input(result), over_input, f"{over_input}, by direction of loading."),
    ]
    along = figures.along(result)
    if along is not None:
        pictures.append(Picture(along, "Error along the backbone", "Error along the backbone."))
    return Section("error", "Where the error is", "pictures.html.j2", {"pictures": pictures})


def _rest_section(result: IdentificationResult) -> Section:
    text = result.remaining.description
    context = {
        "text": f"{text[:1].upper()}{text[1:]}.",
        "tests": result.structure,
    }
    return Section("rest", "What remains, and whether it is noise", "rest.html.j2", context)


def _candidate_section(result: IdentificationResult) -> Section:
    rows = sorted(result.candidates, key=lambda c: (c.round, c.model, -c.drop))
    shown = [c for c in rows if c.drop > 0.5 or c.fitted]
    context = {"result": result, "candidates": shown}
    return Section("candidates", "Candidates and search", "candidates.html.j2", context)


def _data_section(result: IdentificationResult) -> Section:
    noise = [(words(q), quantity(x, channel(q).unit)) for q, x in result.noise.rms_by_quantity.items()]
    outliers = [(result.data.readings[i], r) for i, r in result.outliers]
    context = {"result": result, "noise": noise, "outliers": outliers}
    return Section("data", "Declared robot, readings, rows left out", "data.html.j2", context)


def _scenario_section(result: IdentificationResult) -> Section:
    scenarios = {n: t for n, t in corrected_files(result).items() if n.startswith("effects")}
    context = {"scenarios": scenarios, "count": len(result.data.steps)}
    return Section("scenario", "Scenario of the corrected robot", "scenario.html.j2", context)


# ---------------------------------------------------------------------------------------------------- page


def _cards(result: IdentificationResult) -> tuple[Card, ...]:
    changed = bool(result.effects or result.law)

    def both(before: Misfit, after: Misfit) -> str:
        return f"{size(before)} → {size(after)}" if changed else size(before)

    cards = [Card(both(result.before_fit, result.after_fit), "error on fitted steps (rms)")]
    if result.held_out_steps:
        held_out = both(result.before_held_out, result.after_held_out)
        cards.append(Card(held_out, "error on held-out steps (rms)"))
    space = ", distance in space" if result.noise.rms_position is not None else ""
    cards.append(Card(noise_size(result), f"noise of the measurement alone (rms{space})"))
    count = f"{len(result.data.steps)} / {len(result.data.readings)}"
    held = f"{len(result.held_out_steps)} step{'' if len(result.held_out_steps) == 1 else 's'}"
    cards.append(Card(count, f"load steps / readings; {held} held out"))
    return tuple(cards)


def _motion_section(result: IdentificationResult, motion: Motion) -> Section:
    declared = bool(motion.markers and motion.markers.declared.size)
    context = {"panel": viewer.panel(motion), "declared": declared, "law": result.law is not None}
    title = "The robot in 3D, measured and predicted"
    return Section("robot", title, "motion.html.j2", context, folded=False)


def page(result: IdentificationResult, motion: Motion | None = None) -> Page:
    """What the report shows; with a motion of the corrected robot (see `replay`) it has the 3D panel."""
    sections = [f(result) for f in (_error_section, _rest_section, _candidate_section, _data_section)]
    changed = bool(result.effects) or result.law is not None
    if changed:
        sections = [_evidence_section(result), *sections, _scenario_section(result)]
    if motion is not None:
        sections = [_motion_section(result, motion), *sections]
    caption = "Measured against predicted" + (", before and after" if changed else "")
    if figures.loops(result):
        caption += ". The loop is a run of steps in which one tendon is pulled and released"
    shown = "Measured and predicted tip path, shapes and a loop of loading and unloading"
    what = f"{measure(result)[0].upper()}{measure(result)[1:]}."
    made = ", ".join(f"{name} {number}" for name, number in versions().items())
    return Page(
        title=f"Identification of {result.data.name}",
        verdict=headline(result),
        level=LEVELS[result.verdict],
        sentences=tuple(sentences(result)),
        cards=_cards(result),
        pictures=(Picture(figures.comparison(result), shown, f"{caption}."),),
        summary=_first_screen(result),
        sections=tuple(sections),
        has_panel=motion is not None,
        notes=(f"Errors: {what} {result.runs} simulated sequences in {result.wall_time:.0f} s. {made}.",),
    )


def render(result: IdentificationResult, motion: Motion | None = None) -> str:
    """The whole report as HTML."""
    return kit.render(page(result, motion), "tdcr_fe.identify")


def write_report(
    result: IdentificationResult, path: str | os.PathLike[str], motion: Motion | None = None
) -> None:
    """Write the report into a file."""
    write_text(render(result, motion), path)


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
    texts = corrected_files(result)
    next_loading = result.next_loading()
    if next_loading is not None:
        texts = {**texts, "next/loading.csv": next_loading}
    write_json(result.to_json(), folder / "result.json")
    for name, text in texts.items():
        (folder / name).parent.mkdir(exist_ok=True)
        write_text(text, folder / name)
    motion, interrupted = None, result.interrupted
    try:
        several = bool(result.data.parts)  # the panel shows one loading sequence
        if not (interrupted or several):
            motion = corrected_motion(result, folder, deadline)
    except KeyboardInterrupt:  # the report is written without the 3D panel
        interrupted = True
    except OutOfTime:
        result = replace(result, not_tried=(*result.not_tried, TABLES))
        write_json(result.to_json(), folder / "result.json")
    write_report(result, folder / "report.html", motion)
    names = ["result.json", "report.html", *texts, *([] if motion is None else ["corrected"])]
    return Written(result, names, interrupted)

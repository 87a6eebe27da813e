"""The report on an identification: one HTML page, its first screen for readers without statistics, and a summary."""

from __future__ import annotations

import itertools
import math
import os
from typing import Any

from tdcr_fe.effects import effect
from tdcr_fe.identify import figures
from tdcr_fe.identify.corrected import corrected_files, effects_block, observation_effects
from tdcr_fe.identify.outcome import THE_DATA, IdentificationResult, Misfit
from tdcr_fe.identify.remarks import half_width, remarks
from tdcr_fe.io.atomic import write_text
from tdcr_fe.io.summary import versions
from tdcr_fe.model.channels import channel
from tdcr_fe.report import page as kit
from tdcr_fe.report import viewer
from tdcr_fe.report.environment import SPACE, estimate, fixed, quantity, shown_unit, significant, words
from tdcr_fe.report.motion import Motion
from tdcr_fe.report.page import Card, Level, Page, Picture, Section

__all__ = ["half_width", "headline", "render", "sentences", "summary", "write_report"]

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


# ------------------------------------------------------------------------------------------------ sentences


def _joined(names: list[str]) -> str:
    return names[0] if len(names) == 1 else ", ".join(names[:-1]) + " and " + names[-1]


def headline(result: IdentificationResult) -> str:
    """The verdict in one sentence."""
    names = _joined([words(e.name) for e in result.effects]) if result.effects else ""
    verdict: str = result.verdict
    if verdict == "nothing missing":
        return "Nothing is missing: the declared model explains the measurement down to its noise."
    if verdict == "explained":
        return f"Explained: the declared model lacks {names}."
    if result.law is not None:
        beside = f" beside {names}" if names else ""
        rest = "" if verdict == "explained by a law found" else "; part of the error remains"
        return f"{verdict[0].upper()}{verdict[1:]}: a law on no list{beside}{rest}."
    if verdict == "partly explained" and result.remaining.where == "not known":
        return f"Partly explained: {names} may explain the measurement, but it has too few readings to test that."
    if verdict == "partly explained":
        verb = "remove" if len(result.effects) > 1 else "removes"
        return f"Partly explained: {names} {verb} part of the error; no listed effect explains the rest."
    if verdict == "unexplained":
        return "Unexplained: the model lacks something that no listed effect explains."
    found = f" Found so far: {names}." if names else ""
    if verdict == "cannot tell" and result.remaining.where == THE_DATA:
        return "Cannot tell: the data have a fault. Mend it in the files, and run this again."
    if verdict == "cannot tell":
        return f"Cannot tell: these readings are too few or too noisy to decide what the model lacks.{found}"
    if verdict == "unfinished":
        why = "was interrupted" if result.interrupted else "ran out of time"
        return f"Unfinished: the search {why} before it could decide.{found}"
    return f"{verdict[0].upper()}{verdict[1:]}{': ' + names if names else ''}."


def measure(result: IdentificationResult) -> str:
    """Measure of the errors on the first screen, in words."""
    if result.before_fit.rms_position is not None:
        return "rms distance in space between measured and predicted markers"
    if result.before_fit.rms_angle is not None:
        return "rms error of the angles"
    return "rms error over the standard uncertainty"


def _millimetres(length: float | None) -> str:
    """Errors before and after have one unit, so that they compare at a glance."""
    return significant(None if length is None else 1e3 * length) + f"{SPACE}mm"


def size(misfit: Misfit) -> str:
    """The error in the measure of the first screen."""
    if misfit.rms_position is not None:
        return _millimetres(misfit.rms_position)
    if misfit.rms_angle is not None:
        return quantity(misfit.rms_angle, "rad")
    return f"{significant(math.sqrt(misfit.chi2_per_dof))} sigma"


def noise_size(result: IdentificationResult) -> str:
    """The noise in the same measure."""
    if result.before_fit.rms_position is not None:
        return _millimetres(result.noise.rms_position)
    if result.before_fit.rms_angle is not None:
        return quantity(result.noise.rms_angle, "rad")
    return "1 sigma"


def sentences(result: IdentificationResult) -> list[str]:
    """Further sentences on the first screen."""
    what = measure(result)
    if result.effects or result.law:
        text = f"The {what} falls from {size(result.before_fit)} to {size(result.after_fit)}"
    else:
        text = f"The {what} is {size(result.before_fit)}"
    found = [f"{text}; the noise alone gives {noise_size(result)}."]
    found += _estimated_noise(result)
    if result.law is not None:
        found = [result.law.sentence, f"{result.law.formula}.", *found]
        if result.law.alternatives:
            others = " or ".join(result.law.alternatives)
            found.append(f"Another form of the law explains these data as well: {others}.")
    if result.held_out_steps and (result.effects or result.law):
        found.append(
            f"{len(result.held_out_steps)} of {len(result.data.steps)} steps were held out and not used for fitting. "
            f"On them it goes from {size(result.before_held_out)} to {size(result.after_held_out)}"
            + (
                ": the corrected model predicts steps that it was not fitted to."
                if result.after_held_out.chi2_per_dof < min(2.0, 0.5 * result.before_held_out.chi2_per_dof)
                else "."
            )
        )
    if result.searched is not None:
        found.append(result.searched.sentence)
    if result.not_tried:
        found.append(
            f"The time of the search did not suffice for {' and '.join(result.not_tried)}; --minutes gives it more."
        )
    found += _ceiling_sentence(result)
    for s in result.by_set:
        held = (
            ""
            if not s.after_held_out.count
            else (f", held out {size(s.before_held_out)} to {size(s.after_held_out)}")
        )
        fit = "" if not s.after_fit.count else f"fitted steps {size(s.before_fit)} to {size(s.after_fit)}"
        found.append(f"{s.name} (steps {s.first} to {s.last}): {f'{fit}{held}'.removeprefix(', ')}.")
    alike = [
        f"{words(e.name)} from {' or '.join(words(n) for n in e.indistinguishable_from)}"
        for e in result.effects
        if e.indistinguishable_from
    ]
    if alike:
        found.append(
            f"Indistinguishable on these data: {'; '.join(alike)}. Experiments that separate them are listed with the "
            "effects below."
        )
    if result.verdict in ("partly explained", "unexplained"):
        # What is known of the location; the size of the moment and the tests are in the section on the rest.
        first = result.remaining.description.split("; ")[0]
        plain = first.startswith("not on the list") or not result.remaining.where.startswith("bay")
        found.append(f"Remaining error: {first if plain else 'largest in ' + result.remaining.where}.")
    if result.verdict in ("unexplained", "partly explained"):
        found += _never_driven(result)
    if result.data.left_out:
        found.append(f"{len(result.data.left_out)} faulty rows were left out; they are listed below.")
    if result.outliers:
        found.append(f"{len(result.outliers)} readings are outliers; they are listed below.")
    if result.verdict == "cannot tell":
        reason = result.remaining.description
        found.insert(0, f"{reason[:1].upper()}{reason[1:]}.")
    found += next_sentence(result)
    if result.interrupted and result.verdict != "unfinished":
        found.append("Unfinished: the search was interrupted, and this is its state at that time.")
    return found


def _estimated_noise(result: IdentificationResult) -> list[str]:
    """Where sigma is not given: how the noise is known."""
    if not result.sigma_estimated:
        return []
    without = sorted({r.channel.family for r in result.data.readings if r.sigma is None})
    return [
        f"No sigma is given for {_joined(without)}: the noise is estimated from the scatter of the readings about "
        "smooth curves. An error that changes from step to step without order counts as noise."
    ]


def _never_driven(result: IdentificationResult) -> list[str]:
    """Tendons without an input in any step, although others have one."""
    driven = {
        n for s in result.data.steps for x in (s.tensions, s.displacements) for n, v in x.items() if v != 0.0
    }
    idle = [n for n in result.data.robot.tendon_names if n not in driven]
    if not idle or not driven:
        return []
    what, verb = ("Tendon", "has") if len(idle) == 1 else ("Tendons", "have")
    return [f"{what} {_joined(idle)} {verb} no input in any step: is that recorded in loading.csv?"]


def next_sentence(result: IdentificationResult) -> list[str]:
    """What to measure next; nothing where there is no next experiment."""
    planned = result.next_experiment
    if planned is None:
        return []
    commands = []
    for step in planned.steps:
        parts = [f"{n} = {quantity(v, 'N')}" for n, v in step.tensions.items() if v != 0.0]
        parts += [f"{n} = {quantity(v, 'm')}" for n, v in step.displacements.items() if v != 0.0]
        parts += [
            f"tip force ({', '.join(f'{x:.3g}' for x in load.force)}) N"
            for load in step.loads.values()
            if any(load.force)
        ]
        commands.append(", ".join(parts) or "all tendons at zero, no force at the tip")
    # a step in which nothing changes is no step of the experiment
    how = "; then ".join(text for text, _ in itertools.groupby(commands))
    if not planned.helps:
        return [
            "No experiment within the inputs measured tells much more. The best one (next/loading.csv) "
            f"{planned.purpose}: {how}. Measure other quantities (tensions at the base, further markers), or apply "
            "forces at the tip."
        ]
    return [f"Next experiment (next/loading.csv), which {planned.purpose}: {how}."]


def _ceiling_sentence(result: IdentificationResult) -> list[str]:
    """How much of what can be removed on the held-out steps is removed; nothing where that is not known."""
    if result.ceiling is None:
        return []
    before, after, least = result.before_held_out, result.after_held_out, result.ceiling
    how = "a flexible regression of the residual (Gaussian process on inputs, their history and time)"
    if before.rms_position is not None and least.rms_position is not None and after.rms_position is not None:
        removable, removed = (
            before.rms_position - least.rms_position,
            before.rms_position - after.rms_position,
        )
        text = f"{_millimetres(removed)} of the {_millimetres(removable)}"
    else:
        start, end, low = (math.sqrt(m.chi2_per_dof) for m in (before, after, least))
        removable, removed = start - low, start - end
        text = f"{significant(removed)} of the {significant(removable)} sigma"
    if removable <= 0.0:
        return [f"On the held-out steps, {how} removes nothing from the error of the declared model."]
    what = "law" if result.law is not None and not result.effects else "effects"
    verb = "removes" if what == "law" else "remove"
    if not result.effects and result.law is None:
        return [
            f"On the held-out steps, {how} leaves {size(least)} of {size(before)}: so much could be explained."
        ]
    return [f"On the held-out steps the {what} {verb} {text} that can be removed, as {how} shows."]


def summary(result: IdentificationResult) -> str:
    """The verdict and the effects with their values, as plain text."""
    lines = [headline(result), *sentences(result)]
    for e in result.effects:
        for name, p in e.parameters.items():
            text = f"    {e.name}.{name} = {estimate(p.value, half_width(p), p.unit)}"
            lines.append(
                text + (" (95 %)" if p.std_error is not None else "") + (f" ({p.note})" if p.note else "")
            )
        lines += [f"    {text}" for text in remarks(result).get(e.name, [])]
    return "\n".join(lines)


# -------------------------------------------------------------------------------------------------- sections


def _effect_rows(result: IdentificationResult) -> list[dict[str, Any]]:
    """One row a parameter, as the first screen shows them: value, standard error and half-width in one unit."""
    rows = []
    for e in result.effects:
        for name, p in e.parameters.items():
            width = half_width(p)
            factor, unit = shown_unit(p.unit, max(abs(p.value), width or 0.0))
            decimals = 1 - math.floor(math.log10(factor * width)) if width else None
            rows.append(
                {
                    "effect": words(e.name),
                    "parameter": name,
                    "value": significant(factor * p.value, 4)
                    if decimals is None
                    else fixed(factor * p.value, max(decimals, 0)),
                    "std_error": significant(None if p.std_error is None else factor * p.std_error, 2),
                    "half_width": significant(None if width is None else factor * width, 2),
                    "unit": unit,
                    "note": p.note,
                }
            )
    return rows


def _errors(result: IdentificationResult) -> list[dict[str, str]]:
    rows = [{"steps": "fitted", "before": size(result.before_fit), "after": size(result.after_fit)}]
    if result.held_out_steps:
        rows.append(
            {
                "steps": "held out",
                "before": size(result.before_held_out),
                "after": size(result.after_held_out),
            }
        )
    return rows


def _first_screen(result: IdentificationResult) -> Section:
    return Section(
        "summary",
        "",
        "summary.html.j2",
        {
            "effects": _effect_rows(result),
            "errors": _errors(result),
            "noise": noise_size(result),
            "measure": measure(result),
            "remarks": [t for texts in remarks(result).values() for t in texts],
            "block": effects_block(result),
            "law": result.law,
            "observation": [words(n) for n in observation_effects(result)],
        },
    )


def _evidence_section(result: IdentificationResult) -> Section:
    steps = [
        {
            "name": words(e.name),
            "sentence": effect(e.name, result.catalogue).description,
            "evidence": e.evidence,
            "after_fit": size(e.after_fit),
            "after_held_out": size(e.after_held_out),
            "others": [words(n) for n in e.indistinguishable_from],
            "experiment": e.separating_experiment,
            "remarks": remarks(result).get(e.name, []),
        }
        for e in result.effects
    ]
    correlation = [
        (n, [fixed(float(x), 2) for x in row])
        for n, row in zip(result.parameter_names, result.correlation, strict=True)
    ]
    context = {
        "effects": steps,
        "correlation": correlation,
        "held_out": bool(result.held_out_steps),
        "law": result.law,
        "law_errors": None
        if result.law is None
        else (size(result.law.after_fit), size(result.law.after_held_out)),
    }
    return Section("effects", "Effects added, and the evidence", "effects.html.j2", context)


def _error_section(result: IdentificationResult) -> Section:
    pictures = [
        Picture(
            figures.by_step(result),
            "Error in every load step, before and after",
            "Error in every load step. Shaded steps were held out.",
        ),
        Picture(
            figures.over_input(result),
            "Error over the largest input",
            "Error over the largest input, by direction of loading.",
        ),
    ]
    svg = figures.along(result)
    if svg:
        pictures.append(Picture(svg, "Error along the backbone", "Error along the backbone."))
    return Section("error", "Where the error is", "pictures.html.j2", {"pictures": pictures})


def _rest_section(result: IdentificationResult) -> Section:
    text = result.remaining.description
    svg = figures.missing_moment(result) if result.verdict in ("unexplained", "partly explained") else ""
    picture = Picture(
        svg,
        "Missing bending moment by step and arc length",
        "Bending moment that the model lacks, computed from the measured shapes, by arc length and step.",
    )
    context = {
        "text": f"{text[:1].upper()}{text[1:]}.",
        "picture": picture if svg else None,
        "tests": result.structure,
    }
    return Section("rest", "What remains, and whether it is noise", "rest.html.j2", context)


def _candidate_section(result: IdentificationResult) -> Section:
    rows = sorted(result.candidates, key=lambda c: (c.round, c.model, -c.drop))
    context = {
        "candidates": [c for c in rows if c.drop > 0.5 or c.fitted],
        "left_out": result.left_out_candidates,
        "history": result.history,
    }
    return Section("candidates", "Candidates and search", "candidates.html.j2", context)


def _data_section(result: IdentificationResult) -> Section:
    readings = result.data.readings
    outliers = [
        {
            "line": readings[i].line,
            "step": readings[i].step,
            "quantity": words(readings[i].quantity),
            "location": "" if readings[i].location is None else readings[i].location,
            "value": f"{readings[i].value:.6g} {readings[i].unit}",
            "sigma": f"{r:+.1f}",
        }
        for i, r in result.outliers
    ]
    context = {
        "robot": result.data.robot,
        "model": result.data.model,
        "steps": len(result.data.steps),
        "readings": len(readings),
        "held_out": result.held_out_steps,
        "sigma_estimated": result.sigma_estimated,
        "noise": [
            (words(name), quantity(value, channel(name).unit))
            for name, value in result.noise.rms_by_quantity.items()
        ],
        "mesh_error": result.mesh_error,
        "left_out": result.data.left_out,
        "outliers": outliers,
    }
    return Section("data", "Declared robot, readings, rows left out", "data.html.j2", context)


def _scenario_section(result: IdentificationResult) -> Section:
    return Section(
        "scenario",
        "Scenario of the corrected robot",
        "scenario.html.j2",
        {
            "scenarios": {n: t for n, t in corrected_files(result).items() if n.startswith("effects")},
            "count": len(result.data.steps),
        },
    )


# ---------------------------------------------------------------------------------------------------- page


def _cards(result: IdentificationResult) -> tuple[Card, ...]:
    arrow = "→"
    changed = bool(result.effects or result.law)

    def both(before: Misfit, after: Misfit) -> str:
        return f"{size(before)} {arrow} {size(after)}" if changed else size(before)

    cards = [Card(both(result.before_fit, result.after_fit), "error on fitted steps (rms)")]
    if result.held_out_steps:
        cards.append(
            Card(both(result.before_held_out, result.after_held_out), "error on held-out steps (rms)")
        )
    space = ", distance in space" if result.noise.rms_position is not None else ""
    cards.append(Card(noise_size(result), f"noise of the measurement alone (rms{space})"))
    cards.append(
        Card(
            f"{len(result.data.steps)} / {len(result.data.readings)}",
            f"load steps / readings, {len(result.held_out_steps)} steps held out",
        )
    )
    return tuple(cards)


def _motion_section(result: IdentificationResult, motion: Motion) -> Section:
    context = {
        "panel": viewer.panel(motion),
        "declared": bool(motion.markers and motion.markers.declared.size),
        "law": result.law is not None,
    }
    return Section(
        "robot", "The robot in 3D, measured and predicted", "motion.html.j2", context, folded=False
    )


def page(result: IdentificationResult, motion: Motion | None = None) -> Page:
    """What the report shows; with a motion of the corrected robot (see `replay`) it has the 3D panel."""
    sections = [
        _error_section(result),
        _rest_section(result),
        _candidate_section(result),
        _data_section(result),
    ]
    if result.effects or result.law:
        sections = [_evidence_section(result), *sections, _scenario_section(result)]
    if motion is not None:
        sections = [_motion_section(result, motion), *sections]
    what = f"{measure(result)[0].upper()}{measure(result)[1:]}."
    made = ", ".join(f"{name} {number}" for name, number in versions().items())
    picture = Picture(
        figures.comparison(result),
        "Measured and predicted tip path, shapes and a loop of loading and unloading",
        "Measured against predicted, before and after. Right: a run of steps in which one tendon is pulled and "
        "released.",
    )
    return Page(
        title=f"Identification of {result.data.name}",
        verdict=headline(result),
        level=LEVELS.get(result.verdict, "open") if not result.interrupted else "open",
        sentences=tuple(sentences(result)),
        cards=_cards(result),
        pictures=(picture,),
        summary=_first_screen(result),
        sections=tuple(sections),
        styles=() if motion is None else (viewer.style(),),
        scripts=() if motion is None else (viewer.script(),),
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

"""What an identification found, in sentences: for the first screen of the report, the command and `print`."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from tdcr_fe.effects import effect
from tdcr_fe.identify.result import (
    HALF_WIDTH,
    NOT_KNOWN,
    THE_DATA,
    THE_INPUTS,
    THE_NOISE,
    AddedEffect,
    Estimate,
    IdentificationResult,
    Misfit,
    Verdict,
    tip_force,
)
from tdcr_fe.report.environment import SPACE, estimate, quantity, significant, words

#: Least strain at which a backbone softens: nickel-titanium transforms near 1 %, polymers yield above it [1].
LEAST_THRESHOLD = 3e-3

#: Gravity on earth, and the deviation of a fitted magnitude above which the report warns [m/s^2].
EARTH, EARTH_TOLERANCE = 9.81, 0.15


def half_width(p: Estimate) -> float | None:
    """Half-width of the 95 % interval of a fitted number; None where it has no standard error."""
    return None if p.std_error is None else HALF_WIDTH * p.std_error


def _contradicts(p: Estimate, declared: float) -> bool:
    """Whether the interval excludes the declared value; a number that the data do not determine contradicts nothing."""
    width = half_width(p)
    return width is not None and abs(p.value - declared) > width


def _contradictions(e: AddedEffect, result: IdentificationResult) -> list[str]:
    """Declared values outside the interval of the fit; what nobody declares has the default as its null value."""
    of, found = effect(e.name, result.catalogue), []
    default = {p.name: p for p in of.parameters_of(result.commanded)}
    for name, p in e.parameters.items():
        declared = of.null_value(result.commanded, name)
        if not math.isfinite(declared) or name not in default or declared == default[name].null_value:
            continue
        if not _contradicts(p, declared):
            continue
        others = " or ".join(words(n) for n in e.indistinguishable_from) or "none of the listed effects"
        found.append(
            f"The fit contradicts a declared value: {name} ({default[name].meaning}) is fitted as "
            f"{estimate(p.value, half_width(p), p.unit)}, declared as {quantity(declared, p.unit, 4)}. If the declared "
            f"value is certain, the error has another cause: {others}."
        )
    return found


def largest_strain(result: IdentificationResult) -> float | None:
    """Largest bending strain of the outer fibre over all steps of the final model [1]; None without shapes.

    From the turning of the predicted backbone between neighbouring nodes: curvature times radius.
    """
    nodes: NDArray[np.float64] = result.shapes.backbone_after
    if nodes.ndim != 3 or nodes.shape[1] < 3:
        return None
    chord = np.diff(nodes, axis=1)
    length = np.linalg.norm(chord, axis=2)
    with np.errstate(invalid="ignore", divide="ignore"):
        cosine = np.sum(chord[:, 1:] * chord[:, :-1], axis=2) / (length[:, 1:] * length[:, :-1])
        curvature = np.arccos(np.clip(cosine, -1.0, 1.0)) / (0.5 * (length[:, 1:] + length[:, :-1]))
    if not np.isfinite(curvature).any():
        return None
    return float(np.nanmax(curvature)) * result.data.robot.backbone.radius


def _percent(strain: float) -> str:
    return f"{significant(100.0 * strain, 2)} %"


def _implausible(e: AddedEffect, result: IdentificationResult) -> list[str]:
    value = {name: p.value for name, p in e.parameters.items()}
    if e.name == "superelastic" and value["threshold_strain"] < LEAST_THRESHOLD:
        strain = largest_strain(result)
        seen = "" if strain is None else f", and the largest strain in these data is about {_percent(strain)}"
        return [
            f"A superelastic backbone is not plausible here: the fitted threshold is a strain of "
            f"{_percent(value['threshold_strain'])}{seen}. Nickel-titanium transforms near 1 %, polymers yield above "
            "it. The effect probably represents another cause that softens the robot."
        ]
    if e.name == "gravity":
        size = math.sqrt(sum(x * x for x in value.values()))
        if abs(size - EARTH) <= EARTH_TOLERANCE:
            return [f"The magnitude of the fitted gravity is {quantity(size, 'm/s^2')}, as on Earth."]
        if abs(size - EARTH) <= math.hypot(*(half_width(p) or 0.0 for p in e.parameters.values())):
            return []
        return [
            f"The magnitude of the fitted gravity is {quantity(size, 'm/s^2')}, not {EARTH} m/s²: either "
            "the declared masses are wrong, or the effect represents another cause."
        ]
    # One for all tendons, or for each segment or tendon.
    if e.name == "friction_coefficient" and max(value.values()) > 1.0:
        largest = significant(max(value.values()))
        return [f"A friction coefficient of {largest} is above that of common materials."]
    return []


def remarks(result: IdentificationResult) -> dict[str, list[str]]:
    """Remarks by name of the effect, for effects that have any."""
    found = {e.name: _contradictions(e, result) + _implausible(e, result) for e in result.effects}
    return {name: texts for name, texts in found.items() if texts}


def _joined(names: Sequence[str]) -> str:
    return names[0] if len(names) == 1 else ", ".join(names[:-1]) + " and " + names[-1]


#: The verdict in one sentence, by verdict and, where it has several, by where the error remains; the last of a verdict
#: holds for all other places. ``names``: the effects; ``found``, ``beside``: a sentence and a part of one with them.
HEADLINES: dict[Verdict, dict[str, str]] = {
    Verdict.NOTHING_MISSING: {
        "": "Nothing is missing: the declared model explains the measurements down to their noise."
    },
    Verdict.EXPLAINED: {"": "Explained: the declared model is missing {names}."},
    Verdict.LAW_FOUND: {"": "Explained by a discovered law{beside}."},
    Verdict.PARTLY_EXPLAINED: {
        NOT_KNOWN: "Partly explained: {names} may explain the measurements, but there are too few readings to test "
        "that.",
        "": "Partly explained: a model with {names} {removes} part of the error. More than noise is left, so that "
        "nothing of it is found.",
    },
    Verdict.UNEXPLAINED: {"": "Unexplained: the model is missing something that no listed effect explains."},
    Verdict.CANNOT_TELL: {
        THE_DATA: "Inconclusive: the data contain an error. Correct the files and run again.",
        THE_INPUTS: "Inconclusive: the inputs are too noisy to decide what the model is missing.",
        THE_NOISE: "Inconclusive: no effect is visible, but the noise of the sensors is not known.",
        "": "Inconclusive: these readings are too few or too noisy to decide what the model is missing.{found}",
    },
    Verdict.UNFINISHED: {"": "Unfinished: the search {stopped} before it could decide.{found}"},
}


def headline(result: IdentificationResult) -> str:
    """The verdict in one sentence."""
    unnamed = () if result.law is None or result.verdict != Verdict.LAW_FOUND else result.law.terms
    named = [words(e.name) for e in result.effects if e.name not in unnamed]
    names = _joined(named) if named else ""
    by_place = HEADLINES[result.verdict]
    where = result.remaining.where
    return by_place.get(where, by_place[""]).format(
        names=names,
        removes="removes",
        beside=f" together with {names}" if names else "",
        found=f" Found so far: {names}." if names else "",
        stopped="was interrupted" if result.interrupted else "ran out of time",
    )


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
    noise, before = result.noise, result.before_fit
    return size(
        replace(
            noise,
            rms_position=None if before.rms_position is None else noise.rms_position,
            rms_angle=None if before.rms_angle is None else noise.rms_angle,
        )
    )


def sentences(result: IdentificationResult) -> list[str]:
    """Further sentences on the first screen."""
    parts = (
        _reason,
        _law,
        _causes,
        _errors,
        _held_out,
        _search,
        _explainable,
        _by_set,
        _indistinguishable,
        _remaining,
        _input_noise,
        jump_sentence,
        _readings,
        next_sentence,
    )
    return [text for part in parts for text in part(result)]


def _reason(result: IdentificationResult) -> list[str]:
    """Why the data do not tell."""
    reason = result.remaining.description
    return [f"{reason[:1].upper()}{reason[1:]}."] if result.verdict == Verdict.CANNOT_TELL else []


def _law(result: IdentificationResult) -> list[str]:
    """The law found, in words and as a formula."""
    if result.law is None or result.verdict != Verdict.LAW_FOUND:
        return []
    return [result.law.sentence, f"{result.law.formula}."]


def _causes(result: IdentificationResult) -> list[str]:
    """What kind of cause acts, where that is all that can be said, or where others explain the data as well."""
    found = []
    for cause in result.causes:
        depends = " and ".join(cause.depends_on)
        on = "" if depends == "nothing" else f", depending on {depends}"
        found.append(
            f"{cause.perturbs} ({cause.where}{on}): probability {significant(cause.probability, 2)} among all that was "
            "tried"
        )
    return [f"Kinds of causes: {'; '.join(found)}."] if found else []


def _errors(result: IdentificationResult) -> list[str]:
    """Errors on the fitted steps beside the noise; and what else explains them as well."""
    what = measure(result)
    if result.effects or result.law:
        text = f"The {what} falls from {size(result.before_fit)} to {size(result.after_fit)}"
    else:
        text = f"The {what} is {size(result.before_fit)}"
    found = [f"{text}; the noise alone gives {noise_size(result)}.", *_estimated_noise(result)]
    if result.law is not None and result.law.alternatives:
        others = " or ".join(result.law.alternatives)
        found.append(f"Another form of the law explains these data equally well: {others}.")
    return found


def _held_out(result: IdentificationResult) -> list[str]:
    """Errors on the held-out steps."""
    if not result.held_out_steps or not (result.effects or result.law):
        return []
    before, after = result.before_held_out, result.after_held_out
    change = f"the error changes from {size(before)} to {size(after)}."
    if after.chi2_per_dof < min(2.0, 0.5 * before.chi2_per_dof):
        change = (
            f"the error drops from {size(before)} to {size(after)}, so the corrected model predicts data it was not "
            "fitted to."
        )
    count = len(result.held_out_steps)
    held = (
        f"{count} of {len(result.data.steps)} steps {'was' if count == 1 else 'were'} held out and not used"
    )
    return [f"{held} for fitting. On the held-out steps {change}"]


def _search(result: IdentificationResult) -> list[str]:
    """What the search used, and what it left out."""
    found = []
    if result.searched is not None:
        rest = "; the final fit and all errors are of all load steps."
        if not result.searched.fitted_to_all:
            rest = ", and all errors are of these: there is no fit to all load steps."
        found.append(
            f"The search used {len(result.searched.steps)} of {result.searched.total} load steps{rest}"
        )
    if result.not_tried:
        found.append(f"The time limit (--minutes) was too short for {_joined(result.not_tried)}.")
    return found


def _by_set(result: IdentificationResult) -> list[str]:
    """Errors on every one of several data sets."""
    found = []
    for s in result.by_set:
        parts = (
            ("fitted steps", s.before_fit, s.after_fit),
            ("held out", s.before_held_out, s.after_held_out),
        )
        changes = [f"{what} {size(before)} to {size(after)}" for what, before, after in parts if after.count]
        found.append(f"{s.name} (steps {s.first} to {s.last}): {', '.join(changes)}.")
    return found


def _indistinguishable(result: IdentificationResult) -> list[str]:
    """Effects that explain the data as well as those that were added."""
    alike = [
        f"{words(e.name)} from {' or '.join(_rival(n, e.name) for n in e.indistinguishable_from)}"
        for e in result.effects
        if e.indistinguishable_from
    ]
    if not alike:
        return []
    return [
        f"Indistinguishable on these data: {'; '.join(alike)}. Experiments that separate them are listed with the "
        "effects below."
    ]


def _rival(name: str, added: str) -> str:
    """Name of an effect that explains the data as well; the effect that was added may be a form of it."""
    return f"{words(name)} in its plain form" if name == added else words(name)


def _remaining(result: IdentificationResult) -> list[str]:
    """Where the error is that no effect explains."""
    if result.verdict not in (Verdict.PARTLY_EXPLAINED, Verdict.UNEXPLAINED):
        return []
    return [f"Remaining error: {result.remaining.description}.", *_never_driven(result)]


def _readings(result: IdentificationResult) -> list[str]:
    """Rows that were left out, and outliers."""
    rows, outliers = len(result.data.left_out), len(result.outliers)
    found = []
    if rows:
        found.append(f"{rows} faulty {'row was' if rows == 1 else 'rows were'} left out; see the list below.")
    if outliers:
        found.append(
            f"{outliers} {'reading is an outlier' if outliers == 1 else 'readings are outliers'}; see below."
        )
    return found


def _estimated_noise(result: IdentificationResult) -> list[str]:
    """Where sigma is not given: how the noise is known."""
    if not result.sigma_estimated:
        return []
    if result.remaining.where == THE_NOISE:
        return ["The noise is estimated from the scatter of the readings about smooth curves."]
    without = sorted({r.channel.family for r in result.data.readings if r.sigma is None})
    return [
        f"No sigma is given for {_joined(without)}: the noise is estimated from the scatter of the readings about "
        "smooth curves. An error that changes irregularly from step to step counts as noise."
    ]


def _input_noise(result: IdentificationResult) -> list[str]:
    """Errors of the inputs that would account for a part of what is left."""
    noise = result.input_noise
    if noise is None:
        return []
    how = quantity(noise.size, noise.unit)
    if noise.kind == "relative":
        how = f"{significant(100.0 * noise.size, 2)}{SPACE}% of their values"
    what, measured = {
        "m": ("displacements", "the displacements"),
        "N": ("tensions", "the tensions with load cells"),
        "1": ("inputs", "tensions and displacements at the base"),
    }[noise.unit]
    return [
        f"Random errors of the {what} with a standard deviation of {how}, independent in every step, would explain "
        f"part of the remaining error: it would fall from {size(noise.before)} to {size(noise.after)} over all steps. "
        f"No effect predicts such errors; measure {measured}."
    ]


def jump_sentence(result: IdentificationResult) -> list[str]:
    """A jump of the residual that is left."""
    jump = result.jump
    if jump is None:
        return []
    return [
        f"From step {jump.step} on, the readings of the marker at s = {jump.marker:.4g} m lie "
        f"{quantity(abs(jump.size), 'm', 2)} {'higher' if jump.size > 0.0 else 'lower'} in {jump.axis} than before, "
        "beyond what the model predicts. Did the marker move, or was the setup changed?"
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
    return [f"{what} {_joined(idle)} {verb} no input in any step. Is it missing from loading.csv?"]


def next_sentence(result: IdentificationResult) -> list[str]:
    """What to measure next; nothing where there is no next experiment."""
    planned = result.next_experiment
    if planned is None:
        return []
    commands = []
    for step in planned.steps:
        parts = [f"{n} = {quantity(v, 'N')}" for n, v in step.tensions.items() if v != 0.0]
        parts += [f"{n} = {quantity(v, 'm')}" for n, v in step.displacements.items() if v != 0.0]
        parts += [tip_force(load.force) for load in step.loads.values() if any(load.force)]
        commands.append(", ".join(parts) or "all tendons at zero, no force at the tip")
    # a step in which nothing changes is no step of the experiment
    how, purpose = "; then ".join(text for text, _ in itertools.groupby(commands)), words(planned.purpose)
    if planned.helps:
        return [f"Next experiment (next/loading.csv), which {purpose}: {how}."]
    return [
        f"No experiment within the measured inputs helps much. The best one (next/loading.csv) {purpose}: "
        f"{how}. Measure other quantities (tensions at the base, more markers), or apply forces at the tip."
    ]


def _explainable(result: IdentificationResult) -> list[str]:
    """How much of the held-out error could be explained, and how much is; nothing where that is not known."""
    least, before, after = result.ceiling, result.before_held_out, result.after_held_out
    if least is None:
        return []
    text: Callable[[float | None], str]
    if before.rms_position is not None and least.rms_position is not None and after.rms_position is not None:
        start, end, low, text = before.rms_position, after.rms_position, least.rms_position, _millimetres
    else:
        start, end, low = (math.sqrt(m.chi2_per_dof) for m in (before, after, least))
        text = _sigmas
    how = "A Gaussian-process regression of the residual (on the inputs, their history and time)"
    if start <= low:
        return [f"{how} explains none of the error of the declared model on the held-out steps."]
    shows = f"{how} shows that at most {text(start - low)} of the error on the held-out steps is explainable"
    if not (result.effects or result.law):
        return [f"{shows}."]
    what, verb = ("law", "explains") if not result.effects else ("effects", "explain")
    return [f"{shows}; the {what} above {verb} {text(start - end)}."]


def _sigmas(number: float | None) -> str:
    return f"{significant(number)} sigma"

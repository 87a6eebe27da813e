"""What an identification found, in sentences and in tables of numbers: for the report, the command and `print`."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

from tdcr_fe.effects import effect
from tdcr_fe.effects.places import PlaceEffect
from tdcr_fe.identify.criteria import EARTH, EARTH_TOLERANCE
from tdcr_fe.identify.result import (
    NOT_KNOWN,
    THE_DATA,
    THE_INPUTS,
    THE_NOISE,
    AddedEffect,
    IdentificationResult,
    Misfit,
    Verdict,
)
from tdcr_fe.model.messages import count
from tdcr_fe.report.environment import DASH, SPACE, estimate, fixed, quantity, significant, words

#: Least strain at which a backbone softens: nickel-titanium transforms near 1 %, polymers yield above it [1].
LEAST_THRESHOLD = 3e-3
#: Correlations of a smaller size are not listed, and of the others so many: 24 parameters had 176.
LEAST_CORRELATION, MOST_CORRELATIONS = 0.1, 12

#: Of several causes that together leave noise, see `IdentificationResult.names_nothing`.
A_SUM = "a sum"

#: The verdict in one sentence, by verdict and, where it has several, by where the error remains; the last of a verdict
#: holds for all other places. ``names``: the effects; ``found``, ``beside``: a sentence and a part of one with them;
#: ``law``: the causes on no list.
HEADLINES: dict[Verdict, dict[str, str]] = {
    Verdict.NOTHING_MISSING: {
        "": "Nothing is missing: the declared model explains the measurements down to their noise."
    },
    Verdict.EXPLAINED: {
        A_SUM: "Explained, but none of it is certain: {names} together leave only noise. One cause that is not in the "
        "dictionary would look the same.",
        "": "Explained: the declared model is missing {names}.",
    },
    Verdict.LAW_FOUND: {"": "Explained by an unlisted cause{law}{beside}."},
    Verdict.PARTLY_EXPLAINED: {
        NOT_KNOWN: "Partly explained: {names} may explain the measurements, but too few readings test that.",
        "": "Partly explained: a model with {names} removes part of the error, but more than noise is left: none of "
        "these effects is established.",
    },
    Verdict.UNEXPLAINED: {"": "Unexplained: the model is missing something that no listed effect explains."},
    Verdict.CANNOT_TELL: {
        THE_DATA: "Inconclusive: the data contain an error. Correct the files and run again.",
        THE_INPUTS: "Inconclusive: the inputs are too noisy to decide what the model is missing.{found}",
        THE_NOISE: "Inconclusive: no effect is visible, but the noise of the sensors is not known.",
        "": "Inconclusive: these readings are too few or too noisy to decide what the model is missing.{found}",
    },
    Verdict.UNFINISHED: {"": "Unfinished: the search {stopped} before it could decide.{found}"},
}


def headline(result: IdentificationResult) -> str:
    """The verdict in one sentence."""
    explained = result.verdict in (Verdict.EXPLAINED, Verdict.LAW_FOUND) and not result.names_nothing
    names = _joined(
        [
            words(e.name) if e.found or not explained else f"{words(e.name)} (not certain)"
            for e in result.effects
            if not e.sentence or result.verdict != Verdict.LAW_FOUND
        ]
    )
    by_place = HEADLINES[Verdict(result.verdict)]
    place = A_SUM if result.names_nothing else result.remaining.where
    return by_place.get(place, by_place[""]).format(
        names=names,
        law="" if result.law is None else f": {result.law.sentence}",
        beside=f", together with {names}" if names else "",
        found=f" The best model so far has {names}; none of this is certain." if names else "",
        stopped="was interrupted" if result.log.interrupted else "ran out of time",
    )


def _joined(names: Sequence[str]) -> str:
    return " and ".join(filter(None, (", ".join(names[:-1]), *names[-1:])))


# ------------------------------------------------------------------------------------------------- sizes


def measure(result: IdentificationResult) -> str:
    """Measure of the errors on the first screen, in words."""
    if result.before.fit.rms_position is not None:
        return "rms distance in space between measured and predicted markers"
    if result.before.fit.rms_angle is not None:
        return "rms error of the angles"
    return "rms error over the standard uncertainty"


def size(misfit: Misfit) -> str:
    """The error in the measure of the first screen; always in mm, so that errors compare at a glance."""
    if misfit.rms_position is not None:
        return f"{significant(1e3 * misfit.rms_position)}{SPACE}mm"
    if misfit.rms_angle is not None:
        return quantity(misfit.rms_angle, "rad")
    return f"{significant(math.sqrt(misfit.chi2_per_dof))} sigma"


def noise_size(result: IdentificationResult) -> str:
    """The noise in the same measure."""
    noise, before = result.noise, result.before.fit
    if before.rms_position is None:
        noise = replace(noise, rms_position=None)
    return size(replace(noise, rms_angle=None) if before.rms_angle is None else noise)


# --------------------------------------------------------------------------------------------- sentences


def sentences(result: IdentificationResult) -> list[str]:
    """Further sentences on the first screen."""
    parts = (
        _reason, _causes, _errors, _held_out, _noise, _search, _explainable, _by_set, _indistinguishable, _remaining,
        _scatter, _readings, next_sentence,
    )  # fmt: skip
    return [text for part in parts for text in part(result)]


def _reason(result: IdentificationResult) -> list[str]:
    """Why the data do not tell, or the law that was found."""
    if result.verdict == Verdict.CANNOT_TELL:
        reason = result.remaining.description
        return [f"{reason[:1].upper()}{reason[1:]}."]
    law = result.law if result.verdict == Verdict.LAW_FOUND else None
    if law is None:
        return []
    others = f"Another form explains these data equally well: {' or '.join(law.alternatives)}."
    return [f"{law.formula}.", *([others] if law.alternatives else [])]


def _causes(result: IdentificationResult) -> list[str]:
    """What kind of cause acts; without a probability where no model that was fitted is right."""
    found, explained = [], result.verdict.startswith("explained")
    for e in result.effects:
        depends = " and ".join(e.kind.depends_on)
        on = "" if depends == "nothing" else f", depending on {depends}"
        stated = f", probability {significant(e.kind_probability, 2)}" if explained else ""
        found.append(f"{e.kind.perturbs} ({e.kind.where}{on}){stated}")
    return [f"Kind of cause: {'; '.join(dict.fromkeys(found))}."] if found else []


def _errors(result: IdentificationResult) -> list[str]:
    """Errors on the fitted steps beside the noise."""
    text = f"The {measure(result)} is {size(result.before.fit)}"
    if result.effects:
        text = f"The {measure(result)} falls from {size(result.before.fit)} to {size(result.after.fit)}"
    return [f"{text}; the noise alone gives {noise_size(result)}."]


def _held_out(result: IdentificationResult) -> list[str]:
    """Errors on the held-out steps."""
    if not result.held_out_steps or not result.effects:
        return []
    before, after = result.before.held_out, result.after.held_out
    how = "changes"
    if after.chi2_per_dof < min(2.0, 0.5 * before.chi2_per_dof):
        how = "drops"
    count, total = len(result.held_out_steps), len(result.data.steps)
    predicts = ", so the corrected model predicts data it was not fitted to" if how == "drops" else ""
    return [
        f"{count} of {total} steps {'was' if count == 1 else 'were'} held out and not used for fitting. "
        f"There the error {how} from {size(before)} to {size(after)}{predicts}."
    ]


def _noise(result: IdentificationResult) -> list[str]:
    """Where sigma is not given: how the noise is known."""
    if not result.residuals.sigma_estimated:
        return []
    without = sorted({r.channel.family for r in result.data.readings if r.sigma is None})
    return [
        f"No sigma is given for {_joined(without)}: the noise is estimated from the scatter of the readings about "
        "smooth curves. An error that changes irregularly from step to step counts as noise."
    ]


def _search(result: IdentificationResult) -> list[str]:
    """What the search used, and what it left out."""
    found, searched = [], result.log.steps
    if searched is not None:
        rest = "; the final fit and all errors use all of them."
        if not searched.fitted_to_all:
            rest = ", and all errors are of these: no fit used all load steps."
        found.append(f"The search used {len(searched.steps)} of {searched.total} load steps{rest}")
    if result.simulated.corrected.model.friction != result.data.model.friction:
        found.append("All models are without the declared friction, which explains nothing.")
    if result.log.not_tried:
        found.append(f"The time limit (--minutes) was too short for {_joined(result.log.not_tried)}.")
    return found


def _explainable(result: IdentificationResult) -> list[str]:
    """What a regression leaves of the held-out error; nothing where that is not known."""
    if result.ceiling is None:
        return []
    return [
        "For comparison: a regression of the error without mechanics (Gaussian process) leaves "
        f"{size(result.ceiling)} on the held-out steps."
    ]


def _by_set(result: IdentificationResult) -> list[str]:
    """Errors on every one of several data sets."""
    found = []
    for s in result.by_set:
        parts = zip(("fitted steps", "held out"), s.before, s.after, strict=True)
        changes = [f"{what} {size(before)} to {size(after)}" for what, before, after in parts if after.count]
        found.append(f"{s.name} (steps {s.first} to {s.last}): {', '.join(changes)}.")
    return found


def _indistinguishable(result: IdentificationResult) -> list[str]:
    """Effects that explain the data as well as those that were added; a form of one is named as such."""

    def rivals(e: AddedEffect) -> str:
        plain = (
            f"{words(n)} in its plain form" if n == e.name else words(n) for n in e.indistinguishable_from
        )
        return f"{words(e.name)} from {' or '.join(plain)}"

    alike = [rivals(e) for e in result.effects if e.indistinguishable_from]
    if not alike:
        return []
    return [
        f"Indistinguishable on these data: {'; '.join(alike)}. Experiments that separate them are listed with the "
        "effects below."
    ]


def _remaining(result: IdentificationResult) -> list[str]:
    """Where the error is that no effect explains; and tendons without an input although others have one."""
    if result.verdict not in (Verdict.PARTLY_EXPLAINED, Verdict.UNEXPLAINED):
        return []
    found = [f"Remaining error: {result.remaining.description}."]
    inputs = [x for s in result.data.steps for x in (s.tensions, s.displacements)]
    driven = {n for x in inputs for n, v in x.items() if v != 0.0}
    idle = [n for n in result.data.robot.tendon_names if n not in driven]
    if idle and driven:
        what, verb = ("Tendon", "has") if len(idle) == 1 else ("Tendons", "have")
        found.append(f"{what} {_joined(idle)} {verb} no input in any step. Is it missing from loading.csv?")
    return found


def _scatter(result: IdentificationResult) -> list[str]:
    """What may be different in every step, and would account for a part of what is left."""
    scatter = result.scatter
    if scatter is None:
        return []
    how = quantity(scatter.size, scatter.unit)
    if scatter.kind == "relative":
        how = f"{significant(100.0 * scatter.size, 2)}{SPACE}% of their values"
    inputs = {"m": "displacements", "N": "tensions", "1": "inputs"}[scatter.unit]
    what, hint = {
        "inputs": (
            f"Random errors of the {inputs}",
            "No effect predicts them: measure the inputs at the base, or declare their sigma ([inputs] in model.toml).",
        ),
        "positions": (
            "A shift of all positions",
            "Does the instrument move, or the base plate?",
        ),
        "force": (
            f"A force on the {scatter.place}",
            "What touches or pulls the robot there?",
        ),
    }[scatter.what]
    share = "all of" if scatter.explains_all else "part of"
    return [
        f"{what} with a standard deviation of {how}, independent in every step, would explain {share} the "
        f"remaining error: it would fall from {size(scatter.before)} to {size(scatter.after)} over all steps. {hint}"
    ]


def _readings(result: IdentificationResult) -> list[str]:
    """Rows that were left out, and outliers."""
    rows, outliers = len(result.data.left_out), len(result.residuals.outliers)
    found = []
    if rows:
        found.append(f"Left out, and listed in the report: {count(rows, 'faulty row')}.")
    if outliers:
        verb = "is an outlier" if outliers == 1 else "are outliers"
        found.append(f"{count(outliers, 'reading')} {verb}, listed in the report.")
    return found


def next_sentence(result: IdentificationResult) -> list[str]:
    """What to measure next; nothing where there is no next experiment."""
    planned = result.next_experiment
    if planned is None:
        return []
    commands = []
    for step in planned.steps:
        parts = [f"{n} = {quantity(v, 'N')}" for n, v in step.tensions.items() if v != 0.0]
        parts += [f"{n} = {quantity(v, 'm')}" for n, v in step.displacements.items() if v != 0.0]
        for load in step.loads.values():
            if any(load.force):
                parts.append(f"tip force ({', '.join(f'{x:.3g}' for x in load.force)}) N")
        commands.append(", ".join(parts) or "all tendons at zero, no force at the tip")
    # a step in which nothing changes is no step of the experiment
    how = "; then ".join(text for text, _ in itertools.groupby(commands))
    purpose = planned.purpose if planned.parameter else words(planned.purpose)
    if planned.helps:
        return [f"Next experiment (next/loading.csv), which {purpose}: {how}."]
    return [
        f"No experiment within the measured inputs helps much. The best one (next/loading.csv) {purpose}: "
        f"{how}. Measure other quantities (tensions at the base, more markers), or apply forces at the tip."
    ]


# ----------------------------------------------------------------------------------------------- remarks


def remarks(result: IdentificationResult) -> dict[str, list[str]]:
    """Remarks by name of the effect, for effects that have any."""
    found = {e.name: _contradictions(e, result) + _implausible(e) for e in result.effects}
    return {name: texts for name, texts in found.items() if texts}


def _contradictions(e: AddedEffect, result: IdentificationResult) -> list[str]:
    """Declared values outside the interval of the fit; what nobody declares has the default as its null value."""
    commanded = result.simulated.commanded
    of, found = effect(e.name, result.simulated.catalogue), []
    default = {p.name: p for p in of.parameters_of(commanded)}
    for name, p in e.parameters.items():
        declared = of.null_value(commanded, name)
        if not math.isfinite(declared) or name not in default or declared == default[name].null_value:
            continue
        if p.half_width is None or abs(p.value - declared) <= p.half_width:
            continue
        fitted = estimate(p.value, p.half_width, p.unit)
        found.append(f"{name} is {fitted}, declared {quantity(declared, p.unit, 4)}")
    if not found:
        return []
    others = " or ".join(words(n) for n in e.indistinguishable_from) or "none of the listed effects"
    return [
        f"The fit contradicts what is declared: {'; '.join(found)}. If the declared values are certain, the error has "
        f"another cause: {others}."
    ]


def _implausible(e: AddedEffect) -> list[str]:
    """Values that no robot has."""
    value = {name: p.value for name, p in e.parameters.items()}
    if e.name == "superelastic" and value["threshold_strain"] < LEAST_THRESHOLD:
        return [
            "A superelastic backbone is not plausible here: the fitted threshold is a strain of "
            f"{significant(100.0 * value['threshold_strain'], 2)} %. Nickel-titanium transforms near 1 %, polymers "
            "yield above it. The effect probably represents another cause that softens the robot."
        ]
    if e.name == "gravity":
        size, text = math.hypot(*value.values()), "The magnitude of the fitted gravity is"
        if abs(size - EARTH) <= EARTH_TOLERANCE:
            return [f"{text} {quantity(size, 'm/s^2')}, as on Earth."]
        if abs(size - EARTH) > math.hypot(*(p.half_width or 0.0 for p in e.parameters.values())):
            return [
                f"{text} {quantity(size, 'm/s^2')}, not {EARTH} m/s²: either the declared masses are wrong, or the "
                "effect represents another cause."
            ]
    # One for all tendons, or for each segment or tendon.
    if e.name == "friction_coefficient" and max(value.values()) > 1.0:
        largest = significant(max(value.values()))
        return [f"A friction coefficient of {largest} is above that of common materials."]
    return []


# ----------------------------------------------------------------------------------------------- numbers


def goodness(misfit: Misfit, variables: int) -> dict[str, float]:
    """Statistics of a fit by name; the two information criteria as lmfit defines them.

    Parameters
    ----------
    misfit
        On the fitted readings.
    variables
        How many numbers were fitted.
    """
    n = misfit.count
    chi2 = misfit.chi2_per_dof * max(1, n - variables)
    likelihood = n * math.log(chi2 / n) if n and chi2 > 0.0 else math.nan
    return {
        "chi-square": chi2,
        "reduced chi-square": misfit.chi2_per_dof,
        "Akaike (AIC)": likelihood + 2.0 * variables,
        "Bayesian (BIC)": likelihood + math.log(max(n, 1)) * variables,
    }


def statistics(result: IdentificationResult) -> list[tuple[str, str, str]]:
    """Rows of name, value of the declared and of the final model, over the fitted readings."""
    variables = len(result.parameters.names)
    before, after = goodness(result.before.fit, 0), goodness(result.after.fit, variables)
    return [
        ("readings fitted", str(result.before.fit.count), str(result.after.fit.count)),
        ("parameters", "0", str(variables)),
        *((name, significant(before[name], 4), significant(after[name], 4)) for name in before),
    ]


class FittedNumber(NamedTuple):
    """A parameter of an effect that was added, as text."""

    effect: str
    parameter: str
    estimate: str  # with the half-width of its 95 % interval
    declared: str  # the value that changes nothing
    remark: str  # what it means, and notes on the value


def fitted_numbers(result: IdentificationResult) -> list[FittedNumber]:
    """The parameters of all effects that were added."""
    found, commanded = [], result.simulated.commanded
    for e in result.effects:
        of = effect(e.name, result.simulated.catalogue)
        meanings = {p.name: p.meaning for p in of.parameters_of(commanded) if p.meaning != words(p.name)}
        # a place has no declared value, nor has a number that changes nothing while the others are as declared
        undeclared = of.place_names if isinstance(of, PlaceEffect) else of.unidentifiable_at_null(commanded)
        for name, p in e.parameters.items():
            declared, width = of.null_value(commanded, name), p.half_width
            known = name not in undeclared
            same = known and width is not None and abs(p.value - declared) <= width
            notes = [meanings.get(name, ""), p.note, "not different from the declared value" if same else ""]
            found.append(
                FittedNumber(
                    words(e.name),
                    name,
                    estimate(p.value, width, p.unit),
                    quantity(declared, p.unit, 4) if known else DASH,
                    "; ".join(filter(None, notes)),
                )
            )
    return found


def correlations(result: IdentificationResult) -> list[tuple[str, str, str]]:
    """Pairs of fitted parameters and their correlation as a text; the largest, those below 0.1 left out."""
    found = result.parameters.correlated(LEAST_CORRELATION)[:MOST_CORRELATIONS]
    return [(a, b, fixed(value, 2)) for value, a, b in found]


def _aligned(*rows: Sequence[str]) -> list[str]:
    """Rows of cells as lines in which columns begin below each other."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return [
        "    " + "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip()
        for row in rows
    ]


def summary(result: IdentificationResult) -> str:
    """The verdict, the statistics of the fit and the effects with their values, as plain text."""
    lines = [headline(result), *sentences(result), *_aligned(("", "declared", "fitted"), *statistics(result))]
    numbers, pairs = fitted_numbers(result), correlations(result)
    if numbers:
        head = ("parameter", f"value{SPACE}±{SPACE}95{SPACE}%", "declared", "")
        rows = [(f"{n.effect}: {n.parameter}", *n[2:]) for n in numbers]
        lines += _aligned(head, *rows)
    if pairs:
        lines += _aligned(("largest correlations", "", ""), *pairs)
    return "\n".join([*lines, *(f"    {text}" for texts in remarks(result).values() for text in texts)])

"""What an identification found, in sentences and in tables of numbers: for the report, the command and `print`."""

from __future__ import annotations

import itertools
import math
import re
from collections.abc import Sequence
from typing import NamedTuple

from tdcr_fe.effects import effect
from tdcr_fe.effects.places import PlaceEffect
from tdcr_fe.identify.criteria import EARTH_TOLERANCE
from tdcr_fe.identify.result import AddedEffect, IdentificationResult, Misfit, NextExperiment, Verdict
from tdcr_fe.model.limits import REMARK, limits
from tdcr_fe.model.messages import count
from tdcr_fe.model.quantities import EARTH
from tdcr_fe.report.environment import DASH, SPACE, environment, estimate, fixed, quantity, significant, words

#: Correlations of a smaller size are not listed, and of the others so many: 24 parameters had 176.
LEAST_CORRELATION, MOST_CORRELATIONS = 0.1, 12


def sentences(result: IdentificationResult) -> list[str]:
    """The verdict in one sentence, and further sentences on the first screen.

    They are the paragraphs of the template with all sentences, which is without the numbers and lists that are made
    here.
    """
    data, planned = result.data, result.next_experiment
    text = environment(__package__).get_template("sentences.txt.j2").render(
        result=result,
        names=_joined(_names(result)),

        kinds=_kinds(result),
        measure=measure(result),
        noise=size(result.noise),
        without_sigma=sorted({r.channel.family for r in data.readings if r.sigma is None}),

        alike=[_rivals(e) for e in result.effects if e.indistinguishable_from],
        idle=_idle_tendons(result),

        purpose=planned and (planned.purpose if planned.parameter else words(planned.purpose)),
        commands=planned and _commands(planned),
        size=size,
        joined=_joined,
        count=count,
    )  # fmt: skip
    return [re.sub("[ \n]+", " ", part).strip(" ") for part in re.split("\n{2,}", text.strip("\n"))]


def _joined(names: Sequence[str]) -> str:
    comma = "; " if any("," in name for name in names) else ", "
    return " and ".join(filter(None, (comma.join(names[:-1]), *names[-1:])))


def _names(result: IdentificationResult) -> list[str]:
    """The effects, with those that are not certain beside others that are; those of a law have a sentence instead."""
    explained = result.verdict in (Verdict.EXPLAINED, Verdict.LAW_FOUND) and not result.names_nothing
    shown = [e for e in result.effects if not e.sentence or result.verdict != Verdict.LAW_FOUND]
    return [words(e.name) if e.found or not explained else f"{words(e.name)} (not certain)" for e in shown]


def _kinds(result: IdentificationResult) -> list[str]:
    """What kinds of cause act; without a probability where no model that was fitted is right."""
    found, explained = [], result.verdict.startswith("explained")
    for e in result.effects:
        depends = " and ".join(e.kind.depends_on)
        on = "" if depends == "nothing" else f", depending on {depends}"
        stated = f", probability {significant(min(e.kind_probability, 0.99), 2)}" if explained else ""
        found.append(f"{e.kind.perturbs} ({e.kind.where}{on}){stated}")
    return list(dict.fromkeys(found))


def _rivals(e: AddedEffect) -> str:
    """An effect and others that explain the data as well; a form of it is named as such."""
    plain = (f"{words(n)} in its plain form" if n == e.name else words(n) for n in e.indistinguishable_from)
    return f"{words(e.name)} from {' or '.join(plain)}"


def _idle_tendons(result: IdentificationResult) -> list[str]:
    """Tendons without an input although others have one."""
    inputs = [x for s in result.data.steps for x in (s.tensions, s.displacements)]
    driven = {n for x in inputs for n, v in x.items() if v != 0.0}
    return [n for n in result.data.robot.tendon_names if driven and n not in driven]


def _commands(planned: NextExperiment) -> str:
    """The steps of an experiment; one in which nothing changes is no step of it."""
    commands = []
    for step in planned.steps:
        parts = [f"{n} = {quantity(v, 'N')}" for n, v in step.tensions.items() if v != 0.0]
        parts += [f"{n} = {quantity(v, 'm')}" for n, v in step.displacements.items() if v != 0.0]
        for load in step.loads.values():
            if any(load.force):
                parts.append(f"tip force ({', '.join(f'{x:.3g}' for x in load.force)}) N")
        commands.append(", ".join(parts) or "all tendons at zero, no force at the tip")
    return "; then ".join(text for text, _ in itertools.groupby(commands))


# ------------------------------------------------------------------------------------------------- sizes


def measure(result: IdentificationResult) -> str:
    """Measure of the errors on the first screen, in words."""
    if result.before.fit.rms_position is not None:
        return f"rms {of_markers(result)} between measured and predicted markers"
    if result.before.fit.rms_angle is not None:
        return "rms error of the angles"
    return "rms error over the standard uncertainty"


def of_markers(result: IdentificationResult) -> str:
    """What is meant by the error of a marker, which is along the coordinates that were measured; empty without any."""
    axes = sorted({r.quantity[-1] for r in result.data.readings if r.quantity.startswith("position_")})
    return f"distance {'in space' if len(axes) == 3 else 'along ' + ' and '.join(axes)}" if axes else ""


def size(misfit: Misfit) -> str:
    """The error in the measure of the first screen; always in mm, so that errors compare at a glance."""
    if misfit.rms_position is not None:
        return f"{significant(1e3 * misfit.rms_position)}{SPACE}mm"
    if misfit.rms_angle is not None:
        return quantity(misfit.rms_angle, "rad")
    return f"{significant(math.sqrt(misfit.chi2_per_dof))} sigma"


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
    # another form of the effect contradicts it as well
    others = " or ".join(words(n) for n in e.indistinguishable_from if n.split(" (")[0] != e.name)
    hint = "If the declared values are certain, the error has another cause"
    contradicted = f"The fit contradicts what is declared: {'; '.join(found)}"
    return [f"{contradicted}. {hint}: {others or 'none of the listed effects'}."]


def _implausible(e: AddedEffect) -> list[str]:
    """Values that no robot has."""
    value = {name: p.value for name, p in e.parameters.items()}
    if e.name == "superelastic" and value["threshold_strain"] < limits()["threshold_strain" + REMARK].low:
        return [
            "A superelastic backbone is not plausible here: the fitted threshold is a strain of "
            f"{significant(100.0 * value['threshold_strain'], 2)} %. Nickel-titanium transforms near 1 %, polymers "
            "yield above it. The effect probably represents another cause that softens the robot."
        ]
    if e.name == "gravity":
        size = math.hypot(*value.values())
        text = f"The magnitude of the fitted gravity is {quantity(size, 'm/s^2')}"
        if abs(size - EARTH) <= EARTH_TOLERANCE:
            return [f"{text}, as on Earth."]
        if abs(size - EARTH) > math.hypot(*(p.half_width or 0.0 for p in e.parameters.values())):
            why = "either the declared masses are wrong, or the effect represents another cause"
            return [f"{text}, not {EARTH} m/s²: {why}."]
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
            texts = estimate(p.value, width, p.unit), quantity(declared, p.unit, 4) if known else DASH
            found.append(FittedNumber(words(e.name), name, *texts, "; ".join(filter(None, notes))))
    return found


def correlations(result: IdentificationResult) -> list[tuple[str, str, str]]:
    """Pairs of fitted parameters and their correlation as a text; the largest, those below 0.1 left out."""
    found = result.parameters.correlated(LEAST_CORRELATION)[:MOST_CORRELATIONS]
    return [(a, b, fixed(value, 2)) for value, a, b in found]


def _aligned(*rows: Sequence[str]) -> list[str]:
    """Rows of cells as lines in which columns begin below each other."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return ["    " + "  ".join(cells).rstrip() for cells in (map(str.ljust, row, widths) for row in rows)]


def summary(result: IdentificationResult) -> str:
    """The verdict, the statistics of the fit and the effects with their values, as plain text."""
    lines = [*sentences(result), *_aligned(("", "declared", "fitted"), *statistics(result))]
    numbers, pairs = fitted_numbers(result), correlations(result)
    if numbers:
        head = ("parameter", f"value{SPACE}±{SPACE}95{SPACE}%", "declared", "")
        lines += _aligned(head, *[(f"{n.effect}: {n.parameter}", *n[2:]) for n in numbers])
    if pairs:
        lines += _aligned(("largest correlations", "", ""), *pairs)
    return "\n".join([*lines, *(f"    {text}" for texts in remarks(result).values() for text in texts)])

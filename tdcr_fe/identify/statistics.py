"""What a fit found in numbers, as tables for page and terminal: statistics, parameters, correlations; the summary."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from tdcr_fe.effects import effect
from tdcr_fe.effects.places import PlaceEffect
from tdcr_fe.identify.result import IdentificationResult, Misfit
from tdcr_fe.identify.sentences import half_width, headline, remarks, sentences
from tdcr_fe.report.environment import DASH, SPACE, estimate, fixed, quantity, significant, words

#: Correlations of a smaller size are not listed.
LEAST_CORRELATION = 0.1


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
    variables = len(result.parameter_names)
    before, after = goodness(result.before_fit, 0), goodness(result.after_fit, variables)
    return [
        ("readings fitted", str(result.before_fit.count), str(result.after_fit.count)),
        ("parameters", "0", str(variables)),
        *((name, significant(before[name], 4), significant(after[name], 4)) for name in before),
    ]


@dataclass(frozen=True)
class FittedNumber:
    """A parameter of an effect that was added, as text."""

    effect: str
    parameter: str
    estimate: str  # with the half-width of its 95 % interval
    percent: str  # that half-width over the value
    declared: str  # the value that changes nothing
    remark: str  # what it means, and notes on the value


def fitted_numbers(result: IdentificationResult) -> list[FittedNumber]:
    """The parameters of all effects that were added."""
    found = []
    for e in result.effects:
        of = effect(e.name, result.catalogue)
        meanings = {p.name: p.meaning for p in of.parameters_of(result.commanded)}
        places = of.place_names if isinstance(of, PlaceEffect) else ()  # a place has no declared value
        for name, p in e.parameters.items():
            declared, width = of.null_value(result.commanded, name), half_width(p)
            known = name not in places
            same = known and width is not None and abs(p.value - declared) <= width
            notes = [meanings.get(name, ""), p.note, "not different from the declared value" if same else ""]
            found.append(
                FittedNumber(
                    words(e.name),
                    name,
                    estimate(p.value, width, p.unit),
                    significant(100.0 * width / abs(p.value), 2) if width and p.value else DASH,
                    quantity(declared, p.unit, 4) if known else DASH,
                    "; ".join(filter(None, notes)),
                )
            )
    return found


def correlated(result: IdentificationResult, least: float) -> list[tuple[float, str, str]]:
    """Correlations of fitted parameters of more than a size, with both names, the largest first."""
    names, found = result.parameter_names, result.correlation
    pairs = [
        (float(found[i, j]), names[i], names[j])
        for j in range(len(names))
        for i in range(j)
        if abs(found[i, j]) > least
    ]
    return sorted(pairs, key=lambda pair: -abs(pair[0]))


def correlations(result: IdentificationResult) -> list[tuple[str, str, str]]:
    """Pairs of fitted parameters and their correlation as a text; those of a size below 0.1 are left out."""
    return [(a, b, fixed(value, 2)) for value, a, b in correlated(result, LEAST_CORRELATION)]


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
        head = ("parameter", f"value{SPACE}±{SPACE}95{SPACE}%", "(%)", "declared", "")
        rows = [(f"{n.effect}: {n.parameter}", n.estimate, n.percent, n.declared, n.remark) for n in numbers]
        lines += _aligned(head, *rows)
    if pairs:
        lines += _aligned((f"correlations above {LEAST_CORRELATION}", "", ""), *pairs)
    return "\n".join([*lines, *(f"    {text}" for texts in remarks(result).values() for text in texts)])

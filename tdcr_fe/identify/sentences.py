"""What an identification found, in sentences: for the first screen of the report, the command and `print`."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from tdcr_fe.identify.result import (
    THE_DATA,
    THE_INPUTS,
    THE_NOISE,
    AddedEffect,
    Estimate,
    IdentificationResult,
    Misfit,
)
from tdcr_fe.model.loading import Model
from tdcr_fe.model.robot import Robot
from tdcr_fe.report.environment import SPACE, estimate, quantity, significant, words

#: Half-width of a 95 % interval over the standard error [1].
HALF_WIDTH = 1.96


#: Least strain at which a backbone softens: nickel-titanium transforms near 1 %, polymers yield above it [1].
LEAST_THRESHOLD = 3e-3


#: Gravity on earth, and the deviation of a fitted magnitude above which the report warns [m/s^2].
EARTH, EARTH_TOLERANCE = 9.81, 0.15


def _stiffness(robot: Robot, model: Model) -> float | None:
    return _common([t.axial_stiffness for t in robot.tendons])


def _friction(robot: Robot, model: Model) -> float | None:
    return _common([t.friction_coefficient for t in robot.tendons])


def _thickness(robot: Robot, model: Model) -> float | None:
    return robot.disks.thickness or None


def _precurvature(axis: int) -> Callable[[Robot, Model], float | None]:
    return lambda robot, model: (
        robot.backbone.precurvature[axis] if any(robot.backbone.precurvature) else None
    )


def _gravity(axis: int) -> Callable[[Robot, Model], float | None]:
    return lambda robot, model: model.gravity[axis] if any(model.gravity) else None


def _common(values: list[float | None]) -> float | None:
    """The value that all tendons have; None where they differ or one has none."""
    first = values[0] if values else None
    return first if first is not None and all(v == first for v in values) else None


#: Parameters for which the files declare a value: what it is, and where it is declared.
DECLARED: dict[tuple[str, str], tuple[str, Callable[[Robot, Model], float | None]]] = {
    ("tendon_stretch", "axial_stiffness"): ("the axial stiffness of the tendons", _stiffness),
    ("friction_coefficient", "mu"): ("the friction coefficient", _friction),
    ("rigid_disks", "thickness"): ("the thickness of the disks", _thickness),
    ("precurvature", "kappa_x"): ("the precurvature about x", _precurvature(0)),
    ("precurvature", "kappa_y"): ("the precurvature about y", _precurvature(1)),
    ("gravity", "g_x"): ("gravity along x", _gravity(0)),
    ("gravity", "g_y"): ("gravity along y", _gravity(1)),
    ("gravity", "g_z"): ("gravity along z", _gravity(2)),
    ("stiffness_scale", "bending"): (
        "the factor on the declared bending stiffness",
        lambda robot, model: 1.0,
    ),
    ("stiffness_scale", "torsion"): (
        "the factor on the declared torsional stiffness",
        lambda robot, model: 1.0,
    ),
}


def half_width(p: Estimate) -> float | None:
    """Half-width of the 95 % interval of a fitted number; None where it has no standard error."""
    return None if p.std_error is None else HALF_WIDTH * p.std_error


def _contradicts(p: Estimate, declared: float) -> bool:
    """Whether the interval excludes the declared value; a number that the data do not determine contradicts nothing."""
    width = half_width(p)
    return width is not None and abs(p.value - declared) > width


def _contradictions(e: AddedEffect, robot: Robot, model: Model) -> list[str]:
    found = []
    for name, p in e.parameters.items():
        what, declared_of = DECLARED.get((e.name, name), ("", None))
        declared = declared_of(robot, model) if declared_of else None
        if declared is None or not _contradicts(p, declared):
            continue
        if e.name == "stiffness_scale":
            found.append(
                f"The fit contradicts a declared value: {what} is {estimate(p.value, half_width(p), p.unit)}. Check "
                "modulus and diameter."
            )
            continue
        text = (
            f"The fit contradicts a declared value: {what} is fitted as {estimate(p.value, half_width(p), p.unit)}, "
            f"declared as {quantity(declared, p.unit, 4)}."
        )
        others = " or ".join(words(n) for n in e.indistinguishable_from)
        found.append(
            text
            + f" If the declared value is certain, the data have another cause: {others or 'none on the list'}."
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
        seen = (
            f", and the largest strain in these data is about {_percent(strain)}"
            if strain is not None
            else ""
        )
        return [
            f"A superelastic backbone is not plausible here: the fitted threshold is a strain of "
            f"{_percent(value['threshold_strain'])}{seen}. Nickel-titanium transforms near 1 %, polymers yield above "
            "it. The effect probably represents another cause that softens the robot."
        ]
    if e.name == "gravity":
        size = math.sqrt(sum(x * x for x in value.values()))
        if abs(size - EARTH) <= EARTH_TOLERANCE:
            return [f"The magnitude of the fitted gravity is {quantity(size, 'm/s^2')}, as on earth."]
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
    data = result.data
    found = {
        e.name: _contradictions(e, data.robot, data.model) + _implausible(e, result) for e in result.effects
    }
    return {name: texts for name, texts in found.items() if texts}


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
    if verdict == "cannot tell" and result.remaining.where == THE_INPUTS:
        return "Cannot tell: the inputs scatter too much to decide what the model lacks."
    if verdict == "cannot tell" and result.remaining.where == THE_NOISE:
        return "Cannot tell: no effect is seen, but the noise of the sensors is not known."
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
    found = [
        *_reason(result),
        *_law(result),
        *_errors(result),
        *_held_out(result),
        *_search(result),
        *_ceiling_sentence(result),
        *_by_set(result),
        *_indistinguishable(result),
        *_remaining(result),
        *_scatter_sentence(result),
        *([result.jump] if result.jump else []),
        *_readings(result),
        *next_sentence(result),
    ]
    if result.interrupted and result.verdict != "unfinished":
        found.append("Unfinished: the search was interrupted, and this is its state at that time.")
    return found


def _reason(result: IdentificationResult) -> list[str]:
    """Why the data do not tell."""
    if result.verdict != "cannot tell":
        return []
    reason = result.remaining.description
    return [f"{reason[:1].upper()}{reason[1:]}."]


def _law(result: IdentificationResult) -> list[str]:
    """The law found, in words and as a formula."""
    return [] if result.law is None else [result.law.sentence, f"{result.law.formula}."]


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
        found.append(f"Another form of the law explains these data as well: {others}.")
    return found


def _held_out(result: IdentificationResult) -> list[str]:
    """Errors on the held-out steps."""
    if not result.held_out_steps or not (result.effects or result.law):
        return []
    before, after = result.before_held_out, result.after_held_out
    predicts = after.chi2_per_dof < min(2.0, 0.5 * before.chi2_per_dof)
    return [
        f"{len(result.held_out_steps)} of {len(result.data.steps)} steps were held out and not used for fitting. "
        f"On them it goes from {size(before)} to {size(after)}"
        + (": the corrected model predicts steps that it was not fitted to." if predicts else ".")
    ]


def _search(result: IdentificationResult) -> list[str]:
    """What the search used, and what it left out."""
    found = [] if result.searched is None else [result.searched.sentence]
    if result.not_tried:
        left_out = _joined(list(result.not_tried))
        found.append(f"The time limit did not suffice for {left_out}; --minutes sets it.")
    return found


def _by_set(result: IdentificationResult) -> list[str]:
    """Errors on every one of several data sets."""
    found = []
    for s in result.by_set:
        errors = []
        if s.after_fit.count:
            errors.append(f"fitted steps {size(s.before_fit)} to {size(s.after_fit)}")
        if s.after_held_out.count:
            errors.append(f"held out {size(s.before_held_out)} to {size(s.after_held_out)}")
        found.append(f"{s.name} (steps {s.first} to {s.last}): {', '.join(errors)}.")
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
    if result.verdict not in ("partly explained", "unexplained"):
        return []
    # What is known of the location; the size of the moment and the tests are in the section on the rest.
    first = result.remaining.description.split("; ")[0]
    plain = first.startswith("not on the list") or not result.remaining.where.startswith("bay")
    where = first if plain else f"largest in {result.remaining.where}"
    return [f"Remaining error: {where}.", *_never_driven(result)]


def _readings(result: IdentificationResult) -> list[str]:
    """Rows that were left out, and outliers."""
    found = []
    if result.data.left_out:
        found.append(f"{len(result.data.left_out)} faulty rows were left out; they are listed below.")
    if result.outliers:
        found.append(f"{len(result.outliers)} readings are outliers; they are listed below.")
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
        "smooth curves. An error that changes from step to step without order counts as noise."
    ]


def _scatter_sentence(result: IdentificationResult) -> list[str]:
    """Errors of the inputs that would account for a part of what is left."""
    scatter = result.input_scatter
    if scatter is None:
        return []
    if scatter.kind == "relative":
        how = f"{significant(100.0 * scatter.size, 2)}{SPACE}% of each"
    else:
        how = quantity(scatter.size, scatter.unit)
    what, measured = (
        ("displacements", "them") if scatter.unit == "m" else ("tensions", "them with load cells")
    )
    if scatter.unit == "1":
        what, measured = "inputs", "tensions and displacements at the base"
    return [
        f"Errors of the {what} of {how} (standard deviation), other ones in every step, would account for a part of "
        f"what is left: {size(scatter.before)} fall to {size(scatter.after)} over all steps. No effect predicts such "
        f"errors; measure {measured}."
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
            "No experiment within the inputs measured helps much. The best one (next/loading.csv) "
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

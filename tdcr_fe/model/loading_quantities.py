"""Quantities of a loading sequence that physical limits bound: inputs and loads against the robot."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator

import numpy as np

from tdcr_fe.model.limits import Value, kind_of_material, limits
from tdcr_fe.model.quantities import Description, bending, weight_values


def loading_values(d: Description) -> Iterator[Value]:
    """Quantities of a loading sequence."""
    yield from _tendons(d)
    yield from _loads(d)
    yield from _bends(d)


def _tendons(d: Description) -> Iterator[Value]:
    """Strains by tensions and displacements, in the step where they are largest."""
    b = d.robot.backbone
    tensions, moved = d.inputs("tensions"), d.inputs("displacements")
    for i, tendon in enumerate(d.robot.tendons if d.steps else ()):
        _, offset, end, *_ = d.courses[tendon.name]
        k = int(np.argmax(tensions[:, i]))
        force, key = float(tensions[k, i]), f"steps[{k}].tensions.{tendon.name}"
        if tendon.pretension > force:
            force, key = tendon.pretension, f"tendons[{i}].pretension"
        # A parallel tendon bends the backbone to the curvature T a / EI (pure moment).
        yield strain(d, key, force, force * offset / b.EI)
        if (ea := tendon.axial_stiffness or 0.0) >= limits()["tendon_stiffness"].low:
            yield Value("tendon_strain", key, force, "N", force / ea, f"{ea:g} N")
        k = int(np.argmax(np.abs(moved[:, i])))
        far, unit, key = float(moved[k, i]), "m", f"steps[{k}].displacements.{tendon.name}"
        ratio, detail = abs(far) / end, f"{end:g} m"
        if tendon.name in d.asked[k].motor_angles:
            far, unit = d.asked[k].motor_angles[tendon.name], "rad"
            key = f"steps[{k}].motor_angles.{tendon.name}"
        yield Value("displacement", key, far, unit, ratio, detail)
    if not any(d.model.gravity[:2]) and not tensions.any() and not any(s.loads for s in d.steps):
        yield from _let_out(d)


def strain(d: Description, key: str, force: float, curvature: float) -> Value:
    """Larger strain of the backbone by a force [N], along its axis or at the surface by a curvature [1/m]."""
    b = d.robot.backbone
    strains = (force / b.EA, "along its axis"), (curvature * b.radius, "at the surface, by bending")
    return Value(f"strain_{kind_of_material(b.youngs_modulus)}", key, force, "N", *max(strains))


def _let_out(d: Description) -> Iterator[Value]:
    """Displacements of tendons without pretension that nothing but displacements pulls."""
    slack: dict[str, list[float]] = {t.name: [] for t in d.robot.tendons if not t.pretension}
    held: dict[str, float] = {}
    for step in d.steps:
        held |= step.displacements
        for name in slack:
            if held.get(name, 0.0) < 0.0:
                slack[name].append(held[name] + 1.5 * sum(max(x, 0.0) for x in held.values()))
    for name, values in slack.items():
        if values:
            far, k = min((s.displacements.get(name, 0.0), k) for k, s in enumerate(d.steps))
            yield Value("slack", f"steps[{k}].displacements.{name}", far, "m", max(values))


def _loads(d: Description) -> Iterator[Value]:
    """Loads against the stiffness of the backbone, and against their names."""
    b, ends = d.robot.backbone, [course.end for course in d.courses.values()]
    for k, step in enumerate(d.steps):
        for name, load in step.loads.items():
            key = f"steps[{k}].loads.{name}"
            force, moment = math.hypot(*load.force), math.hypot(*load.moment)
            across = bending(load.force)
            yield Value("force", f"{key}.force", force, "N", force * load.at**2 / b.EI)
            # A force cannot bend the elastica more than that, however long it is.
            yield strain(
                d, f"{key}.force", force, min(across * load.at / b.EI, math.sqrt(2.0 * across / b.EI))
            )
            by_moment = strain(d, f"{key}.moment", 0.0, moment / b.EI)
            yield by_moment._replace(value=moment, unit="N m")
            yield Value("moment", f"{key}.moment", moment, "N m", moment * load.at / b.EI)
            if "tip" in re.split("[^a-z]+", name.lower()) and load.at not in ends:
                yield Value("not_at_tip", f"{key}.at", load.at, "m", load.at / b.length)
            if (force or moment) and d.robot.base_stiffness is None:
                yield Value("at_base", f"{key}.at", load.at, "m", load.at / b.length)


def _bends(d: Description) -> Iterator[Value]:
    """The largest angles by which inputs, or loads and weights where there are none, bend the robot, to first order."""
    b = d.robot.backbone
    largest = 0.0
    for kind in ("tensions", "displacements"):
        single = d.bends(kind)
        if single.any():
            together = np.linalg.norm(d.bend(kind), axis=1)
            k = int(np.argmax(together))
            asked = kind if getattr(d.asked[k], kind) else "motor_angles"
            yield Value("wound", f"steps[{k}].{asked}", math.nan, "", float(together[k]))
            largest = max(largest, float(np.max(np.linalg.norm(single, axis=1))))
    if largest == 0.0:
        for tendon, course in zip(d.robot.tendons, d.courses.values(), strict=True):
            largest = max(largest, tendon.pretension * float(np.linalg.norm(course.by_tension)))
    if largest == 0.0:
        loads = [load for step in d.steps for load in step.loads.values()]
        forces = [math.hypot(*x.force) * x.at**2 / b.EI for x in loads]
        moments = [math.hypot(*x.moment) * x.at / b.EI for x in loads]
        largest = max(*forces, *moments, *(v.ratio for v in weight_values(d)))
    if largest > 0.0 and d.steps:
        yield Value("bends", "steps", math.nan, "", largest)

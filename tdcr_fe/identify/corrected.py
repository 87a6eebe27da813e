"""The corrected robot of an identification as files for ``tdcr-fe run``, and its run over the measured loading."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path

from tdcr_fe.effects import Experiment, changed_by, with_effects
from tdcr_fe.identify.forward import solve_commanded_steps
from tdcr_fe.identify.result import AddedEffect, Estimate, IdentificationResult
from tdcr_fe.io.result_files import write_results
from tdcr_fe.io.result_folder import CORRECTED, write_markers
from tdcr_fe.io.write_toml import robot_to_toml, scenario_to_toml, value_to_toml
from tdcr_fe.model.loading import LoadStep
from tdcr_fe.model.results import SequenceResult
from tdcr_fe.report.motion import Markers, Motion, motion_of

Table = Mapping[str, Mapping[str, float]]


def observation_effects(result: IdentificationResult) -> list[str]:
    """Effects that act on the measurement only; a scenario cannot have them."""
    changed = _changed(result, result.effects_table)
    return [name for name in result.effects_table if "observation" in changed.get(name, ())]


def _changed(result: IdentificationResult, table: Table) -> dict[str, set[str]]:
    return changed_by(result.simulated.commanded, table, result.simulated.catalogue)


#: Begins the comment on an effect that a scenario cannot have.
_MEASUREMENT_ONLY = "# acts on the measurement only: "


def effects_block(result: IdentificationResult) -> str:
    """The ``[effects]`` table of a scenario, with the listed effects that were added; empty where there are none."""
    skipped, unlisted = observation_effects(result), {e.name for e in result.effects if e.sentence}
    lines = []
    for name, values in ((n, v) for n, v in result.effects_table.items() if n not in unlisted):
        comment = _MEASUREMENT_ONLY if name in skipped else ""
        lines.append(f"{comment}{name} = {value_to_toml({n: float(f'{x:.7g}') for n, x in values.items()})}")
    return "\n".join(["[effects]", *lines]) if lines else ""


def corrected_files(result: IdentificationResult) -> dict[str, str]:
    """Texts of the files that give the corrected robot, by name.

    ``robot.toml`` is the robot with all effects that a robot description can have. ``effects.toml`` is a scenario
    with that robot, the model, mesh and solver settings of the fit, the effects that act on commands or on the model
    in its ``[effects]`` table, and the measured loading sequence as it was simulated: ``tdcr-fe run effects.toml``
    repeats the fit. Steps that an effect divides stand there in parts.

    A law that was found stands there as the concentrated loads that it gives on this loading, and as a comment.
    Several data sets have one ``effects_NAME.toml`` each.

    Effects that act on the measurement only are comments. Where a robot cannot be written (an effect of the
    user's own with a routing of its own), ``robot.toml`` is as declared, and all effects are in ``effects.toml``; an
    unlisted cause that changes the robot is then in the comment alone.
    """
    commanded = result.simulated.commanded
    if commanded.restarts:
        return _files_of_sets(result)
    skipped = observation_effects(result)
    table: Table = {name: values for name, values in result.effects_table.items() if name not in skipped}
    final = with_effects(commanded, table, result.simulated.catalogue)
    base, inside = _beside_robot(result, final, table)
    if result.law is not None:
        base, inside = replace(final, steps=result.simulated.corrected.steps), {}
    try:
        robot_text = robot_to_toml(base.robot)
    except ValueError:
        robot_text = robot_to_toml(commanded.robot)
        base, inside = _with_robot_as_declared(result, table)
    remarks = ["# The corrected robot with the measured loading: tdcr-fe run effects.toml -o OUT"]
    remarks += [f"{_MEASUREMENT_ONLY}{n} = {value_to_toml(result.effects_table[n])}" for n in skipped]
    if result.law is not None:
        remarks += [
            f"# unlisted causes: {result.law.formula}",
            "# on the loading below it gives the loads named law 1, law 2, ...; on another loading it gives others",
        ]
    steps, solver = list(_labelled(result, base)), result.simulated.solver
    scenario = scenario_to_toml(base.model, steps, settings=solver, effects=inside or None)
    return {"robot.toml": robot_text, "effects.toml": "\n".join([*remarks, "", scenario])}


def _files_of_sets(result: IdentificationResult) -> dict[str, str]:
    """`corrected_files` of several data sets: one robot, and a scenario for each."""
    files: dict[str, str] = {}
    simulated = result.simulated
    both = simulated.commanded.sequences, simulated.corrected.sequences
    for part, corrected, (name, count) in zip(*both, result.data.parts, strict=True):
        ids = tuple(range(1, count + 1))
        steps, branches = part.steps[:count], ("",) * count
        unread = replace(result.data, readings=(), parts=())
        data = replace(unread, name=name, step_ids=ids, steps=steps, branches=branches)
        alone = replace(simulated, commanded=replace(part, folder=1, folders=1), corrected=corrected)
        effects = tuple(_alone(result, part))
        own = corrected_files(replace(result, data=data, simulated=alone, effects=effects))
        same = files.get("robot.toml", own["robot.toml"]) == own["robot.toml"]
        robot = "robot.toml" if same else f"robot_{name}.toml"
        files[robot] = own["robot.toml"]
        scenario = own["effects.toml"].replace('"robot.toml"', f'"{robot}"')
        files[f"effects_{name}.toml"] = scenario.replace("run effects.toml", f"run effects_{name}.toml")
    return files


def _alone(result: IdentificationResult, part: Experiment) -> Iterator[AddedEffect]:
    """The effects with the values that they have for one of several data sets."""
    by_name = {e.name: e for e in result.simulated.catalogue}
    for added in result.effects:
        values = {n: p.value for n, p in added.parameters.items()}
        own = by_name[added.name].alone(values, part) if added.name in by_name else values
        if own != values:
            unit = next(iter(added.parameters.values())).unit
            added = replace(added, parameters={n: Estimate(x, None, unit) for n, x in own.items()})
        yield added


def _beside_robot(result: IdentificationResult, final: Experiment, table: Table) -> tuple[Experiment, Table]:
    """Experiment and effects that give the final one, with all that acts on the robot alone in the robot."""
    simulated = result.simulated
    base = replace(simulated.commanded, robot=final.robot)
    inside = {n: table[n] for n, own in _changed(result, table).items() if own & {"model", "steps"}}
    again = with_effects(base, inside, simulated.catalogue)
    if (again.robot, again.model, again.steps) == (final.robot, final.model, final.steps):
        return base, inside
    return final, {}  # an effect acts on the robot and on more: model and steps stand as they become


def _with_robot_as_declared(result: IdentificationResult, table: Table) -> tuple[Experiment, Table]:
    """Experiment with the declared robot, and effects that give the final one; with a law, its loads and the inputs."""
    commanded = result.simulated.commanded
    if result.law is None:
        return commanded, table
    unlisted = {e.name for e in result.law.causes}
    changed = _changed(result, table).items()
    inside = {n: table[n] for n, own in changed if n not in unlisted and "steps" not in own}
    return replace(result.simulated.corrected, robot=commanded.robot, model=commanded.model), inside


def _labelled(result: IdentificationResult, experiment: Experiment) -> Iterator[LoadStep]:
    """Steps with the numbers of ``loading.csv`` as labels; parts of a divided step are counted."""
    ids = result.data.step_ids
    commanded = [k for k, _ in experiment.ends]
    for j, (step, k) in enumerate(zip(experiment.steps, commanded, strict=True)):
        parts = commanded.count(k)
        part = commanded[: j + 1].count(k)
        yield replace(step, label=str(ids[k]) if part == parts else f"{ids[k]} (part {part} of {parts})")


def replay(result: IdentificationResult, deadline: float = math.inf) -> SequenceResult:
    """Repeat the run of the corrected robot on its own path, with tensions along the tendons and states of the holes.

    A law that was found acts as the concentrated loads that it gives on this loading.

    Parameters
    ----------
    result
        What was found.
    deadline
        Reading of `tdcr_fe.identify.settings.clock` at which the simulation ends [s].

    Returns
    -------
    SequenceResult
        One step for each of ``loading.csv``, with its number and its branch as the label.

    Raises
    ------
    KeyboardInterrupt
        The simulation was interrupted.
    OutOfTime
        The deadline has passed.
    """
    simulated = result.simulated
    path = simulated.path if result.law is None else None
    solved = solve_commanded_steps(simulated.corrected, simulated.solver, deadline, path)
    named = zip(solved.steps, result.data.step_ids, result.data.branches, strict=False)
    return replace(solved, steps=tuple(replace(s, step=n, label=branch) for s, n, branch in named))


def markers(result: IdentificationResult, steps: int) -> Markers:
    """Measured markers and the declared model's backbone of the first steps, turned into the robot's frame.

    An identified misalignment of the measuring frame moves what was measured, not the robot.
    """
    shapes, in_base = result.shapes, result.simulated.corrected.observation.in_base
    measured, declared = (in_base(x[:steps]) for x in (shapes.measured, shapes.backbone_before))
    return Markers(shapes.arc_lengths, measured, declared)


def corrected_motion(result: IdentificationResult, out: Path, deadline: float = math.inf) -> Motion | None:
    """Simulate the corrected robot, write its tables into the folder ``corrected``, and give its motion.

    Parameters
    ----------
    result
        What was found.
    out
        Folder of the results.
    deadline
        Reading of `tdcr_fe.identify.settings.clock` at which the simulation ends [s].

    Returns
    -------
    Motion or None
        None where no step of the corrected robot could be solved.

    Raises
    ------
    KeyboardInterrupt
        The simulation was interrupted.
    OutOfTime
        The deadline has passed.
    """
    sequence = replay(result, deadline)
    if not sequence.steps:
        return None
    seen = markers(result, len(sequence.steps))
    write_results(sequence, out / CORRECTED, result.data.digests, len(result.data.steps), pictures=False)
    write_markers(seen, [s.step for s in sequence.steps], out / CORRECTED)
    return motion_of(sequence, seen)

"""Results of a simulation: one `StepResult` per load step, their sequence, and derivatives by parameters.

Imports no solver.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from html import escape
from math import degrees
from typing import Any

import numpy as np

from tdcr_fe.elements import Array, Index
from tdcr_fe.elements.poses import exp_se3, log_se3
from tdcr_fe.model import columns
from tdcr_fe.model.loading import Actuation, Model
from tdcr_fe.model.messages import count
from tdcr_fe.model.robot import Robot


def off_axis(vectors: Array) -> Array:
    """Distance from the z axis, (..., 3) to (...)."""
    return np.asarray(np.hypot(vectors[..., 0], vectors[..., 1]))


def angle_from_z(vectors: Array) -> Array:
    """Angle between vectors and the z axis [rad], (..., 3) to (...)."""
    return np.asarray(np.arctan2(off_axis(vectors), vectors[..., 2]))


@dataclass(frozen=True, eq=False)
class Sensitivity:
    """Derivatives by one parameter, whose unit is per unit of the parameter in its file.

    Attributes
    ----------
    parameter : str
        Name.
    value : float
        At which the derivative is taken.
    positions : ndarray, shape (n_steps, n, 3)
        Derivatives of the world positions of the backbone nodes [m].
    rotations : ndarray, shape (n_steps, n, 3)
        Derivatives of the sections' rotations as world rotation vectors [rad]: the derivative of a rotation matrix
        ``R`` is ``skew(rotations) R``.
    curvature_rates : ndarray, shape (n_steps, n-1, 2, 3)
        Derivatives of the rates of `StepResult`.
    base_tensions : ndarray, shape (n_steps, n_tendons)
        [N].
    displacements : ndarray, shape (n_steps, n_tendons)
        Derivatives of the lengths of the tendons pulled in at the base plate [m].
    tensions : tuple of ndarray, each of shape (n_steps, n_segments)
        By tendon, of every segment [N].
    slips : tuple of ndarray, each of shape (n_steps, n_segments - 1)
        By tendon, of the material that has passed each hole towards the base, base plate and anchor left out [m].
    arc_lengths : ndarray, shape (n,)
        Derivatives of the arc lengths of the backbone nodes [m]; nodes move along the backbone where disks or their
        ends do.
    """

    parameter: str
    value: float
    positions: Array
    rotations: Array
    curvature_rates: Array
    base_tensions: Array
    displacements: Array
    tensions: tuple[Array, ...]
    slips: tuple[Array, ...]
    arc_lengths: Array

    @property
    def tips(self) -> Array:
        """Derivatives of the tip positions [m], shape (n_steps, 3)."""
        return self.positions[:, -1]


class Sensitivities(dict[str, Sensitivity]):
    """Derivatives by all parameters asked for, by name and in order."""

    def __missing__(self, name: str) -> Sensitivity:
        raise KeyError(f"no sensitivity by {name!r}; computed were {', '.join(self) or 'none'}")


@dataclass(frozen=True, eq=False)
class LocalResponse:
    """How one node moves under small changes of loads and inputs, in one solved state. World axes.

    Motions are ``[x, y, z, rotation vector]`` [m, rad], loads ``[force, moment]`` [N, N m].

    Attributes
    ----------
    s : float
        Arc length of the node [m].
    reversal : bool
        Whether all holes stick, as where every motion reverses. Else holes that slip go on slipping in their direction.
    compliance : ndarray, shape (6, 6)
        Motion by a load on the node. Tendons driven by tension keep their tension, those driven by displacement
        their displacement.
    by_tension : ndarray, shape (6, n_tendons)
        Motion by the tension of each tendon, all driven by tension [m/N, rad/N].
    by_displacement : ndarray, shape (6, n_tendons)
        Motion by the displacement of each taut tendon, all taut ones driven by displacement; zero for slack tendons
        [1, rad/m].
    motor_stiffness : ndarray, shape (n_tendons, n_tendons)
        Tension by displacement, all taut tendons driven by displacement; zero for slack tendons [N/m].
    """

    s: float
    reversal: bool
    compliance: Array
    by_tension: Array
    by_displacement: Array
    motor_stiffness: Array


#: Tendons, and load steps of the HTML table, that are shown before "and ... more".
MOST_TENDONS, MOST_STEPS = 6, 12
#: States of a hole: the tendon sticks, is pulled or released through it, or is anchored.
HOLE_STATES = ("stick", "pull", "release", "anchor")


@dataclass(frozen=True)
class StepResult:
    """The converged state at the end of one load step.

    Attributes
    ----------
    step : int
        Number, from 1.
    label : str
    converged : bool
    iterations : int
        Newton iterations, over all substeps.
    substeps : int
    s : ndarray, shape (n,)
        Arc lengths of the backbone nodes [m], base first, tip last.
    positions : ndarray, shape (n, 3)
        World positions of the nodes [m].
    rotations : ndarray, shape (n, 3, 3)
        World rotation of the sections; the third column is the tangent.
    base_tensions : ndarray, shape (n_tendons,)
        Tension at the base plate [N].
    displacements : ndarray, shape (n_tendons,)
        Tendon pulled in at the base plate [m]: zero in the unloaded shape, just taut or at its pretension.
    tensions : tuple of ndarray, each of shape (n_segments,)
        By tendon, tension of every segment from the base plate to the anchor [N]. The classical model has
        the same tension everywhere; it is given for the same segments.
    hole_states : tuple of tuple of str
        By tendon, state of the hole at the distal end of every segment: "stick", "pull", "release", and
        "anchor" for the last.
    residual : float
        Largest unbalanced force or moment over the scale of the acting forces [1].
    actuation : Actuation or None
        Tendon inputs and loads that act at the end of the step; None where a result was made without a loading.
    discretisation_error : float or None
        Estimated error of the mesh: largest distance of a node from its position with exact elements [m]. None where it
        was not estimated.
    buckling_load_fraction : float or None
        Largest axial compression of a bay over its buckling load ``pi^2 EI / a^2`` [1].
    responses : tuple of LocalResponse
        Response of the tip to small changes, holes as they are and for reversal; empty where it was not asked for.
    curvature_rates : ndarray, shape (n-1, 2, 3), or None
        First and second derivative by arc length of the curvature about the section's axes, in the middle of an element
        [1/m^2, 1/m^3]. None where they are not known.
    details : mapping
        Further values reported by the solver: smallest eigenvalue, mobilisations, errors ...
    """

    step: int
    label: str
    converged: bool
    iterations: int
    substeps: int
    s: Array
    positions: Array
    rotations: Array
    base_tensions: Array
    displacements: Array
    tensions: tuple[Array, ...]
    hole_states: tuple[tuple[str, ...], ...]
    residual: float = 0.0
    actuation: Actuation | None = None
    discretisation_error: float | None = None
    buckling_load_fraction: float | None = None
    responses: tuple[LocalResponse, ...] = ()
    curvature_rates: Array | None = None
    details: Mapping[str, Any] = field(default_factory=dict)

    @property
    def tip(self) -> Array:
        """Tip position [m], shape (3,)."""
        return self.positions[-1]

    @property
    def tangent(self) -> Array:
        """Unit tangent at the tip, shape (3,)."""
        return self.rotations[-1][:, 2]

    @property
    def bending_angle(self) -> float:
        """Angle between the tip tangent and +z [rad]."""
        return float(angle_from_z(self.tangent))

    @property
    def chord_angle(self) -> float:
        """Angle between the line from base to tip and +z [rad]."""
        return float(angle_from_z(self.tip - self.positions[0]))

    @property
    def tip_offset(self) -> float:
        """Distance of the tip from the z axis [m]."""
        return float(off_axis(self.tip))

    def position_at(self, s: float | Array) -> Array:
        """World position at any arc length [m], shape (..., 3).

        Between nodes the backbone is a curve of constant strain, exactly what the beam element assumes:
        the pose is interpolated on SE(3).
        """
        return interpolate_positions(self.s, self.positions, self.rotations, np.asarray(s, dtype=float))


@dataclass(frozen=True)
class SequenceResult:
    """Every load step that was solved; printed, it is a summary of ten lines.

    Attributes
    ----------
    robot : Robot
    model : Model
    steps : tuple of StepResult
        The steps solved, in order; all of them where `converged`.
    converged : bool
    message : str
        A sentence; where a step failed it names the step, the residual and what to try.
    failed_step : int or None
        Number of the step that failed.
    wall_time : float
        [s].
    warnings : tuple of str
    remarks : tuple of str
        What hardly fits together in the description, a level below warnings.
    settings : mapping
        Numerical settings that were used.
    elements_per_bay : tuple of int
        Elements per bay of the mesh with which the steps were solved.
    sensitivities : Sensitivities
        Derivatives by parameters, by their names; empty where none were asked for.
    """

    robot: Robot
    model: Model
    steps: tuple[StepResult, ...]
    converged: bool = True
    message: str = ""
    failed_step: int | None = None
    wall_time: float = 0.0
    warnings: tuple[str, ...] = ()
    remarks: tuple[str, ...] = ()
    settings: Mapping[str, Any] = field(default_factory=dict)
    elements_per_bay: tuple[int, ...] = ()
    sensitivities: Sensitivities = field(default_factory=Sensitivities)

    @property
    def tips(self) -> Array:
        """Tip positions [m], shape (n_steps, 3)."""
        return np.array([s.tip for s in self.steps]).reshape(-1, 3)

    @property
    def bending_angles(self) -> Array:
        """Angle between tip tangent and +z, by step [rad], shape (n_steps,)."""
        return np.array([s.bending_angle for s in self.steps])

    to_frame = columns.steps_frame
    shape_frame = columns.shape_frame
    tensions_frame = columns.tensions_frame
    sensitivities_frame = columns.sensitivities_frame

    def raise_if_failed(self) -> SequenceResult:
        """Return the result itself where all steps converged.

        Raises
        ------
        RuntimeError
            A step failed; the message names it and advises what to try.
        """
        if not self.converged:
            raise RuntimeError(self.message)
        return self

    def __repr__(self) -> str:
        return "\n".join(f"{name:<12}  {text}" for name, text in _summary_rows(self))

    def _repr_html_(self) -> str:
        """For notebooks: the summary, and below it the table of load steps."""
        left = 'style="text-align:left"'
        rows = "".join(
            f"<tr><th {left}>{escape(name)}</th><td {left}>{escape(text)}</td></tr>"
            for name, text in _summary_rows(self)
        )
        table: str = self.to_frame().to_html(index=False, max_rows=MOST_STEPS, float_format="{:.6g}".format)
        return f"<table>{rows}</table>\n{table}"


class Interrupted(KeyboardInterrupt):
    """Ctrl-C ended `tdcr_fe.simulate`, `tdcr_fe.follow_path` or `tdcr_fe.sweep`; what was solved before is kept.

    Attributes
    ----------
    result : SequenceResult, FollowResult or SweepResult
        The load steps, targets or cases solved before.
    """

    def __init__(self, result: Any) -> None:
        super().__init__("interrupted; the attribute `result` has what was solved before")
        self.result = result


# ------------------------------------------------------------------------------------- a result as text


def _summary_rows(result: SequenceResult) -> list[tuple[str, str]]:
    """Name and text of every line: robot, model, steps, status, last step, tip, angle, tendons, warnings."""
    robot, model, warnings = result.robot, result.model, result.warnings
    tendons, disks = count(len(robot.tendons), "tendon"), count(len(robot.disks.positions), "disk")
    path, friction = f"tendon path {model.tendon_path}", f"friction {model.friction}"
    failed = "" if result.failed_step is None else f", step {result.failed_step} not"
    iterations = sum(s.iterations for s in result.steps)
    status = result.message or ("all steps converged" if result.converged else "did not converge")
    first = f"{len(warnings)}, the first: {warnings[0]}" if len(warnings) > 1 else "".join(warnings)
    return [
        ("robot", f"{robot.name}: {tendons}, {disks}, length {1e3 * robot.backbone.length:g} mm"),
        ("model", f"{path}, {friction}, elements per bay {model.elements_per_bay}"),
        (
            "steps",
            f"{len(result.steps)} solved{failed}; {iterations} Newton iterations, {result.wall_time:.2f} s",
        ),
        ("status", status),
        *(_last_step(result.robot.tendon_names, result.steps[-1]) if result.steps else ()),
        ("warnings", first or "none"),
    ]


def _last_step(names: Sequence[str], step: StepResult) -> list[tuple[str, str]]:
    def listed(values: Iterable[str]) -> str:
        every = [f"{name} {value}" for name, value in zip(names, values, strict=True)]
        more = len(every) - MOST_TENDONS
        return (", ".join(every[:MOST_TENDONS]) + (f" and {more} more" if more > 0 else "")) or "no tendons"

    base, anchor = (f"{t:.4g}" for t in step.base_tensions), (f"{t[-1]:.4g}" for t in step.tensions)
    tip = ", ".join(map(_millimetres, step.tip))
    return [
        ("last step", f"{step.step}" + (f": {step.label}" if step.label else "")),
        ("tip [mm]", f"({tip}), bending angle {degrees(step.bending_angle):.3f} deg"),
        ("tension [N]", f"at the base: {listed(base)}; at the anchor: {listed(anchor)}"),
        ("pulled [mm]", listed(map(_millimetres, step.displacements))),
    ]


def _millimetres(metres: float) -> str:
    return f"{round(1e3 * float(metres), 3) + 0.0:.3f}"  # no negative zero


# ----------------------------------------------------------------------------------------------------- between nodes


def interpolate_positions(nodes: Array, positions: Array, rotations: Array, s: Array) -> Array:
    """World positions at arc lengths between nodes.

    Parameters
    ----------
    nodes
        Arc lengths of the nodes, ascending [m], shape (n,).
    positions
        Positions of the nodes [m], shape (n, 3).
    rotations
        Rotations of the sections, shape (n, 3, 3).
    s
        Arc lengths, within the range of the nodes [m], any shape.

    Returns
    -------
    numpy.ndarray
        [m], shape ``s.shape + (3,)``.

    Raises
    ------
    ValueError
        An arc length lies outside the backbone.
    """
    flat = np.atleast_1d(s).ravel()
    if np.any(flat < nodes[0] - 1e-6) or np.any(flat > nodes[-1] + 1e-6):
        raise ValueError(f"arc length outside the backbone, which spans {nodes[0]:g} to {nodes[-1]:g} m")
    k = elements_at(nodes, flat)
    x = (flat - nodes[k]) / (nodes[k + 1] - nodes[k])
    result = within_elements(positions[k], rotations[k], positions[k + 1], rotations[k + 1], x)
    return result.reshape((*np.shape(s), 3))


def elements_at(nodes: Array, s: Array) -> Index:
    """Numbers of the elements that hold arc lengths; at a node, of the one that begins there, the last one at the tip.

    Parameters
    ----------
    nodes
        Arc lengths of the nodes, ascending [m], shape (n,).
    s
        Arc lengths [m], any shape.
    """
    return np.clip(np.searchsorted(nodes, s, side="right") - 1, 0, len(nodes) - 2)


def within_elements(start: Array, turn: Array, end: Array, end_turn: Array, share: Array) -> Array:
    """World positions inside elements of constant strain.

    Parameters
    ----------
    start, turn, end, end_turn
        Positions [m], shape (..., m, 3), and rotations, shape (..., m, 3, 3), at both ends of each element.
    share
        Arc length from the start over that of the element [1], shape (..., m).

    Returns
    -------
    numpy.ndarray
        [m], shape (..., m, 3).
    """
    back = np.swapaxes(turn, -1, -2)
    twist = log_se3(back @ end_turn, _times(back, end - start))
    return np.asarray(start + _times(turn, exp_se3(share[..., None] * twist)[1]))


def _times(matrices: Array, vectors: Array) -> Array:
    """Matrices (m, n, n) times vectors (m, n)."""
    return np.asarray((matrices @ vectors[..., None])[..., 0])

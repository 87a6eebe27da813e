"""A robot of an assembled scene: its inputs, and what is read of its state."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Annotated, Any

import exudyn as exu
import numpy as np

from tdcr_fe.elements import Array, Flags
from tdcr_fe.elements.backbone import BEAM_TO_SECTION, BackboneMesh
from tdcr_fe.elements.capstan import TensionField
from tdcr_fe.elements.drives import DISPLACEMENT, DRIVES, MOTOR_ANGLE, TENSION, Drive
from tdcr_fe.elements.friction import hole_states
from tdcr_fe.elements.native.actuation import TendonActuation
from tdcr_fe.elements.native.hooks import SceneHooks
from tdcr_fe.elements.native.material_damping import MaterialDamping
from tdcr_fe.model.results import interpolate_positions
from tdcr_fe.model.robot import Robot
from tdcr_fe.model.schema import Keys, Quantity, check_arguments
from tdcr_fe.scene.mesh import softened

#: Inputs by tendon name, or of all tendons in order.
Inputs = Mapping[str, float] | Sequence[float]
_ALLOWED = "a list of one finite number for every tendon, or such numbers by name: {'t1': 1.0}"
_ONE = Annotated[dict[str, float] | tuple[float, ...], Quantity(allowed=_ALLOWED)]
_COMPLIANCE = Keys({"factor": Annotated[float, Quantity(gt=0.0)]})
_INPUTS = {drive: Keys({drive.inputs: _ONE}) for drive in DRIVES}
#: A tension this far below zero is taken as zero: round-off of the user's function [N].
TENSION_ROUND_OFF = 1e-9


@dataclass(frozen=True, eq=False)
class InputsOverTime:
    """Inputs as a function of time, checked whenever a solver asks for them."""

    names: tuple[str, ...]  # of the tendons
    actuation: TendonActuation  # of the robot
    #: From time [s] to the inputs of the drives [N, m or rad], shape (m,).
    function: Callable[[float], Sequence[float]]

    def __call__(self, t: float) -> Array:
        """Tensions [N] and lengths wound [m] at a time [s], shape (m,).

        Raises
        ------
        ValueError
            Not one finite number per tendon, or a negative tension.
        """
        expected = "a list with one number for every tendon"
        try:
            values = np.array(self.function(t), dtype=float)
        except (TypeError, ValueError) as wrong:
            raise self._error(t, f": {wrong}; must return {expected}") from wrong
        if values.shape != (len(self.names),):
            raise self._error(t, f", returned {values.tolist()}; must be {expected}")
        drives = self.actuation.drives
        allowed = (values >= drives.least - TENSION_ROUND_OFF) & (values < np.inf)
        if not allowed.all():
            k = int(allowed.argmin())
            returned = f"{values[k]:g} for tendon {self.names[k]!r}"
            raise self._error(t, f", returned {returned}; must be finite, a tension >= 0")
        return np.asarray(np.maximum(values, drives.least) * drives.scale)

    def _error(self, t: float, text: str) -> ValueError:
        where = f"robot {self.actuation.name!r}: the function of set_inputs_over_time, at time {t:g} s"
        return ValueError(f"{where}{text} ({', '.join(self.names)})")


def named_inputs(names: Sequence[str], given: Inputs, drive: Drive) -> dict[str, float]:
    """Inputs of a drive by tendon, checked; given by name, or of every tendon in order."""
    check_arguments(f"set_{drive.inputs}", _INPUTS[drive], {drive.inputs: given})
    if not isinstance(given, Mapping):
        if len(given) != len(names):
            raise ValueError(f"{len(given)} values for {len(names)} tendons ({', '.join(names)})")
        given = dict(zip(names, given, strict=True))
    unknown = sorted(set(given) - set(names))
    if unknown:
        raise ValueError(f"no tendon {unknown[0]!r}; the robot has {', '.join(names) or 'none'}")
    for name, value in given.items():
        if value < 0.0 and not drive.winds:
            raise ValueError(f"tendon {name!r}: {value} is not allowed; must be a tension >= 0")
    return {name: float(value) for name, value in given.items()}


@dataclass(kw_only=True, eq=False, repr=False)
class AssembledRobot:
    """A robot in a scene, of which inputs are set and the state is read.

    Attributes
    ----------
    mbs : exudyn.MainSystem
    name : str
    robot : Robot
        The description it was made from.
    mesh : BackboneMesh
    oBeams : list
        Beam elements.
    actuation : TendonActuation
        Tendons, friction and section forces.
    rigid : ndarray of bool, shape (N-1,)
        Which elements are rigid inserts.
    damping : MaterialDamping or None
        By the material of the backbone.
    compliance_factor : float
        On the backbone's compliance in bending and torsion [1]; `set_compliance_factor` changes it.
    """

    mbs: exu.MainSystem
    name: str
    robot: Robot
    mesh: BackboneMesh
    oBeams: list[Any]
    actuation: TendonActuation
    rigid: Flags = field(default_factory=lambda: np.zeros(0, dtype=bool))
    damping: MaterialDamping | None = None
    compliance_factor: float = 1.0

    # ------------------------------------------------------------------ inputs

    def set_tensions(self, tensions: Inputs) -> None:
        """Prescribe tensions at the base [N]; tendons that are not named keep their inputs."""
        self._set_inputs(tensions, TENSION)

    def set_displacements(self, displacements: Inputs) -> None:
        """Prescribe displacements: length pulled in at the base since the unloaded, just taut state [m]."""
        self._set_inputs(displacements, DISPLACEMENT)

    def set_motor_angles(self, angles: Inputs) -> None:
        """Prescribe the angles of the motors that wind tendons on their spools [rad]; zero where displacements are."""
        self._set_inputs(angles, MOTOR_ANGLE)

    def set_inputs_over_time(self, inputs: Callable[[float], Sequence[float]]) -> None:
        """Prescribe the inputs as a function of time, for ``mbs.SolveStatic`` and ``mbs.SolveDynamic``.

        Parameters
        ----------
        inputs
            Function of the solver's time [s] (0 to 1 over the load steps of ``SolveStatic``) that returns tension [N],
            displacement [m] or motor's angle [rad] of every tendon in order, shape (n_tendons,). Which of them a value
            is, the last call of `set_tensions`, `set_displacements` or `set_motor_angles` decides. It is called once in
            every step that a solver tries. Every value is checked: one finite number per tendon, no negative tension. A
            later call of one of these functions ends the function; tendons that it does not name keep what they had at
            the last solved time.
        """
        if not callable(inputs):
            hint = "set_tensions and set_displacements take values."
            raise TypeError(f"set_inputs_over_time needs a function of the time [s], not {inputs!r}. {hint}")
        self.actuation.inputs = InputsOverTime(self.robot.tendon_names, self.actuation, inputs)

    def _set_inputs(self, given: Inputs, drive: Drive) -> None:
        self._need_robot()
        names, actuation = self.robot.tendon_names, self.actuation
        # Inputs over time end here: the other tendons keep what they had in the last solved state.
        values = actuation.values_as_set(actuation.state.time).copy()
        drives = actuation.drives
        for name, value in named_inputs(names, given, drive).items():
            k = names.index(name)
            if obstacle := drive.obstacle(self.robot.tendons[k]):
                raise ValueError(obstacle)
            if not drive.winds and any(motor.tendon == k for motor in actuation.motors):
                text = "is wound by a motor (add_motor), from which its tension follows; name the other tendons only"
                raise ValueError(f"tendon {name!r} {text}")
            drives = drives.replaced(k, drive, drive.scale(self.robot.tendons[k]))
            values[k] = drives.scale[k] * value
        actuation.inputs, actuation.drives = values, drives

    def set_compliance_factor(self, factor: float) -> None:
        """Make the backbone softer in bending and torsion by a factor on its compliance [1].

        Rigid inserts stay as they are.
        """
        check_arguments("set_compliance_factor", _COMPLIANCE, locals())
        if factor == self.compliance_factor:
            return
        self.compliance_factor = factor
        self.actuation.model = softened(self.actuation.model, self.mesh, self.rigid, factor)
        for beam, stiffness in zip(self.oBeams, self.actuation.model.mesh.stiffness, strict=True):
            section = self.mbs.GetObjectParameter(beam, "sectionData")
            section.stiffnessMatrix = np.diag(stiffness)
            self.mbs.SetObjectParameter(beam, "sectionData", section)
        if self.damping is not None:
            self.damping.follow(self.mbs, self.actuation.model.mesh)

    # ------------------------------------------------------------------ reading

    @property
    def arc_lengths(self) -> Array:
        """Arc lengths of the backbone nodes [m], shape (N,)."""
        return self.mesh.arc_lengths

    def shape(self) -> tuple[Array, Array]:
        """World positions [m] (N, 3) and section rotations (N, 3, 3) of all nodes; the third column is the tangent."""
        self._need_assembly()
        p, r, _ = self.actuation.scene_poses()
        return p, r @ BEAM_TO_SECTION.T

    def position_at(self, s: float | Array) -> Array:
        """World position at any arc length [m], shape (..., 3)."""
        p, r = self.shape()
        return interpolate_positions(self.arc_lengths, p, r, np.asarray(s, dtype=float))

    @property
    def tip_position(self) -> Array:
        """World position of the tip [m], shape (3,)."""
        return self.shape()[0][-1]

    @property
    def tip_rotation(self) -> Array:
        """Rotation of the tip section, shape (3, 3); the third column is the tangent."""
        return self.shape()[1][-1]

    def tensions(self) -> dict[str, Array]:
        """By tendon, tension of every segment from base plate to anchor [N]."""
        field_ = self._field()
        return {t.name: self._segments(i, field_.tension[i]) for i, t in enumerate(self.robot.tendons)}

    def displacements(self) -> dict[str, float]:
        """By tendon, length pulled in at the base since the unloaded, just taut state [m].

        For a tendon driven by displacement the prescribed value, whether it is taut or slack.
        """
        self._field()
        return dict(zip(self.robot.tendon_names, self.actuation.displacements.tolist(), strict=True))

    def hole_states(self) -> dict[str, tuple[str, ...]]:
        """By tendon, state of the hole at the distal end of every segment: stick, pull, release, anchor."""
        if self.actuation.model.geometry is None:  # the continuous path has one tension and no friction
            holes = np.zeros((len(self.robot.tendons), max(1, len(self.robot.disks.positions))))
        else:
            holes = self.actuation.law.at_holes(self._field().mobilisation)
        return {t.name: hole_states(holes[i], self._count(i)) for i, t in enumerate(self.robot.tendons)}

    def _need_robot(self) -> None:
        """Refuse what is asked of a robot that is not in the system any more."""
        if not SceneHooks.has(self.mbs, self.actuation):
            raise ValueError(
                f"robot {self.name!r} is not in the system any more (removed by mbs.Reset, or deleted); create it again"
            )

    def _need_assembly(self) -> None:
        self._need_robot()
        if not self.mbs.systemIsConsistent:
            raise ValueError(f"robot {self.name!r} cannot be read yet; call mbs.Assemble() first")

    def _field(self) -> TensionField:
        """Tensions in the present state of the scene."""
        self._need_assembly()
        return self.actuation.current_forces().field

    def _count(self, i: int) -> int:
        return len(self.robot.hole_arc_lengths(self.robot.tendons[i])) - 1

    def _segments(self, i: int, values: Array) -> Array:
        if self.actuation.model.geometry is None:
            return np.full(self._count(i), values[0])
        return values[: self._count(i)].copy()

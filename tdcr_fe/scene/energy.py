"""Energy balance of a robot in Exudyn's own solvers: what it stores, the work of tendons and loads, what it dissipates.

The works and dissipations are summed over the steps and kept in data coordinates, so that Exudyn itself restores them
with the state. All sums are by the trapezoidal rule between the beginning and the end of a step.

The integration in time has an error, and with ``spectralRadius`` below 1 it damps; both change the energy. How much
follows from forces and accelerations. In a step the coordinates change by ``dq``, and the equation of motion holds at
both ends, so that by the trapezoidal rule the forces ``f`` do the work ``dq (f0 + f1) / 2`` that the inertial forces
``M a`` do, ``dq (M a0 + M a1) / 2``. The numerical dissipation is the difference of the second from what the
kinetic energy gains, which is zero with ``spectralRadius = 1``, and that of the first from the true work: the sums of
the tendons and of the material less what tendons and backbone store. What then remains is the work on other items of
the scene. The true work of a force is that on its own way: tension times the tendon that passes, stress of the material
times the change of strain. On the coordinates the same forces do another work where these turn within a step.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import exudyn as exu
import exudyn.itemInterface as eii
import numpy as np
from numpy.typing import NDArray

from tdcr_fe.elements.backbone import BEAM_TO_SECTION, relative_twists, strain_matrices
from tdcr_fe.elements.forces import TendonForces
from tdcr_fe.elements.friction import TendonLaw
from tdcr_fe.elements.native.actuation import TendonActuation
from tdcr_fe.elements.native.condensation import ElasticTendons
from tdcr_fe.elements.native.coordinates import NodeCoordinates, generalized_forces
from tdcr_fe.elements.native.history import RobotHistory
from tdcr_fe.elements.native.items import SystemReference
from tdcr_fe.elements.native.material_damping import MaterialDamping
from tdcr_fe.elements.poses import log_so3
from tdcr_fe.elements.section import wrenches_on_nodes
from tdcr_fe.model.loading import Vector
from tdcr_fe.model.robot import Robot
from tdcr_fe.scene.loads import Frame, PointLoad
from tdcr_fe.scene.motion import Masses, Motion
from tdcr_fe.scene.stored_energy import elastic_energy

Array = NDArray[np.float64]
_CURRENT, _START = exu.ConfigurationType.Current, exu.ConfigurationType.StartOfStep

#: What the robot stores, the first columns of the sensor [J].
STORED_COLUMNS = ("kinetic", "elastic", "gravity")
#: Sums over the steps, the other columns [J].
SUM_COLUMNS = (
    "tendon_work",
    "load_work",
    "friction_dissipation",
    "material_dissipation",
    "numerical_dissipation",
    "balance",
)
#: Columns of the sensor, all in J.
ENERGY_COLUMNS = STORED_COLUMNS + SUM_COLUMNS


class Instant(NamedTuple):
    """A robot at the beginning or at the end of a step.

    Attributes
    ----------
    motion : Motion
    forces : TendonForces
        With the history at the beginning of the step.
    nodal : ndarray, shape (7 N,)
        Forces of tendons, backbone and springs to ground on the coordinates of the nodes.
    stored : ndarray, shape (3,)
        Energies, see `STORED_COLUMNS` [J].
    load_factor : float
        By which the static solver multiplies loads and weight [1].
    """

    motion: Motion
    forces: TendonForces
    nodal: Array
    stored: Array
    load_factor: float


class Step(NamedTuple):
    """A step that was solved.

    Attributes
    ----------
    start, end : Instant
    last : Instant or None
        The end of the step before, where this one continues it. Inputs that are set in between act in this step, but
        not in the accelerations with which it begins.
    """

    start: Instant
    end: Instant
    last: Instant | None

    @classmethod
    def after(cls, last: Instant | None, start: Instant, end: Instant) -> Step:
        """A step after the one that ended at `last`, if it continues that one."""
        continues = last is not None and all(
            np.array_equal(getattr(start.motion, key), getattr(last.motion, key))
            for key in ("coordinates", "velocities")
        )
        return cls(start, end, last if continues else None)

    @property
    def statics(self) -> bool:
        """Whether the static solver has taken it, which leaves velocities as they are."""
        return np.array_equal(self.start.motion.velocities, self.end.motion.velocities)

    @property
    def load_factors(self) -> Array:
        """By which the solver has multiplied loads and weight at the beginning and the end, shape (2,)."""
        if not self.statics:
            return np.ones(2)
        return np.array([(self.last or self.end).load_factor, self.end.load_factor])

    @property
    def gained(self) -> Array:
        """Change of the stored energies [J], shape (3,)."""
        return self.end.stored - self.start.stored

    def work(self, at_start: Array, at_end: Array) -> float:
        """Work of forces on the coordinates by the trapezoidal rule [J]."""
        way = self.end.motion.coordinates - self.start.motion.coordinates
        return 0.5 * float((at_start + at_end) @ way)


class EnergyBalance:
    """Stored energy of one robot, and what goes in and out of it, step by step.

    Parameters
    ----------
    system
        The system.
    robot
        Description.
    name
        Of the robot, prefix of the item.
    actuation, damping
        Tendons, friction and section forces; damping by the material, or None.
    gravity
        [m/s^2].
    loads
        Concentrated loads by name; those added later count, too.

    Attributes
    ----------
    node
        Data node of the sums, see `SUM_COLUMNS` [J].
    """

    def __init__(
        self,
        system: SystemReference,
        robot: Robot,
        name: str,
        actuation: TendonActuation,
        damping: MaterialDamping | None,
        gravity: Vector,
        loads: Mapping[str, PointLoad],
    ) -> None:
        self._system, self._actuation, self._damping, self._loads = system, actuation, damping, loads
        self._masses = Masses.of(robot, actuation, gravity)
        self._coordinates = NodeCoordinates(system, actuation.nodes)
        #: The end of the last step.
        self._last: Instant | None = None
        count = len(SUM_COLUMNS)
        self.node = system.mbs.AddNode(
            eii.NodeGenericData(
                name=f"{name}.energy",
                numberOfDataCoordinates=count,
                initialCoordinates=[0.0] * count,
            )
        )

    # ------------------------------------------------------------------ stored

    def stored(self) -> Array:
        """Kinetic, elastic and gravitational energy in the current configuration [J], shape (3,).

        Elastic energy is that of the backbone, of elastic tendons and of springs to ground.
        """
        motion = Motion.of(self._system, self._coordinates, _CURRENT)
        tendons = self._tendons(self._actuation.history)
        return self._stored(motion, tendons.at_rest(self._measured(motion)))

    def _stored(self, motion: Motion, forces: TendonForces) -> Array:
        elastic = elastic_energy(self._actuation, motion, forces, self._tendons(self._actuation.history))
        return np.array([self._masses.kinetic(motion), elastic, self._masses.potential(motion.positions)])

    # ------------------------------------------------------------------ sums

    def observe(self, t: float) -> None:
        """Add what a step has brought, after it was solved and before its history is committed.

        Parameters
        ----------
        t
            At the end of the step [s].
        """
        begin = Motion.of(self._system, self._coordinates, _START)
        finish = Motion.of(self._system, self._coordinates, _CURRENT)
        last, self._last = self._last, self._instant(finish, t, _CURRENT)
        if np.array_equal(begin.coordinates, finish.coordinates):
            # A step at rest, or a solver that begins, with the inputs for its initial accelerations.
            return
        start = self._instant(begin, self._system.mbs.systemData.GetTime(_START), _START)
        step = Step.after(last, start, self._last)
        law = self._tendons(self._actuation.history).law()
        tendon_work, friction = tendon_work_and_dissipation(law, start.forces, step.end.forces)
        load_work, load_trapezoid = self._work_of_loads(step)
        material, material_trapezoid = self._material_dissipation(begin, finish)
        kinetic, elastic, gravity = step.gained
        # The part of the weight that the static solver does not apply yet.
        load_work += (1.0 - step.load_factors.mean()) * gravity
        load_trapezoid += (1.0 - step.load_factors.mean()) * gravity
        numerical = (
            self._work_of_inertia(step) - kinetic + load_work - load_trapezoid + material_trapezoid - material
        )
        numerical += tendon_work - friction - elastic - step.work((step.last or start).nodal, step.end.nodal)
        balance = tendon_work + load_work - friction - material - numerical - (kinetic + elastic + gravity)
        sums = self._sums()
        sums += [tendon_work, load_work, friction, material, numerical, balance]

    def _work_of_loads(self, step: Step) -> tuple[float, float]:
        """Work of the concentrated loads as set, and that of the mean of those at both ends of the step [J]."""
        found = np.zeros(2)
        for load in self._loads.values():
            moved, value = self._moved(load, step.start.motion, step.end.motion), load.value
            before = value if step.last is None else load.applied
            mean = 0.5 * (step.load_factors @ [before, value])
            true = mean if step.statics else value
            found += [_load_work(load.frame, force, moved) for force in (true, mean)]
        return float(found[0]), float(found[1])

    def _work_of_inertia(self, step: Step) -> float:
        """Of the forces that accelerate the masses, by the trapezoidal rule [J]."""
        if step.statics:
            return 0.0
        of = self._masses.inertial_forces
        return step.work(of(step.start.motion), of(step.end.motion))

    def values(self) -> Array:
        """All columns, see `ENERGY_COLUMNS` [J], shape (9,)."""
        return np.concatenate((self.stored(), self._sums()))

    def _sums(self) -> Array:
        """The coordinates of the data node, in the memory of Exudyn."""
        data = self._system.mbs.systemData
        first = int(data.GetNodeLTGData(self.node)[0])
        everything: Array = data.GetDataCoordinates(_CURRENT, copy=False)
        return everything[first : first + len(SUM_COLUMNS)]

    def _material_dissipation(self, start: Motion, end: Motion) -> tuple[float, float]:
        """By the rates of strain, and that which the generalised forces on the coordinates give [J]."""
        if self._damping is None:
            return 0.0, 0.0
        first, last = ((motion.coordinates, motion.velocities) for motion in (start, end))
        energy, forces = self._damping.in_step(self._actuation.mesh.twist_stiffness, first, last)
        return energy, -0.5 * float(forces @ (end.coordinates - start.coordinates))

    def _moved(self, load: PointLoad, start: Motion, end: Motion) -> tuple[Array, Array, Array]:
        """Way, rotation vector in world axes, and the mean rotation matrix of the node of a load."""
        k = self._actuation.nodes.index(load.node)
        first, last = start.rotations[k], end.rotations[k]
        turned = first @ log_so3(first.T @ last)
        return end.positions[k] - start.positions[k], turned, 0.5 * (first + last) @ BEAM_TO_SECTION.T

    # ------------------------------------------------------------------ state

    def _instant(self, motion: Motion, t: float, configuration: Any) -> Instant:
        """With the history at the beginning of the step, at a time [s]; motors are as in a configuration of Exudyn."""
        history = self._actuation.history
        values = self._actuation.input_values(t, configuration)
        forces = self._tendons(history).forces(self._measured(motion), values, history.base_tension, t)
        return Instant(
            motion,
            forces,
            self._nodal_forces(motion, forces),
            self._stored(motion, forces),
            static_load_factor(self._system.mbs),
        )

    def _nodal_forces(self, motion: Motion, forces: TendonForces) -> Array:
        """Forces of tendons, backbone and springs to ground on the coordinates of the nodes, shape (7 N,)."""
        mesh = self._actuation.mesh
        twists = relative_twists(motion.positions, motion.rotations)
        strained = mesh.twist_stiffness * (twists - mesh.reference_twists)
        wrenches = forces.nodal_wrenches() + wrenches_on_nodes(strained, strain_matrices(twists))
        return generalized_forces(wrenches, motion.rotations, motion.parameters)

    def _measured(self, motion: Motion) -> Any:
        return self._actuation.model.measure(motion.positions, motion.rotations)

    def _tendons(self, history: RobotHistory) -> ElasticTendons:
        actuation = self._actuation
        return ElasticTendons(
            actuation.model, actuation.by_displacement, history, actuation.inextensible_stiffness
        )


def _load_work(frame: Frame, value: Array, moved: tuple[Array, Array, Array]) -> float:
    """Work of a concentrated load that is constant in a step, in its own frame [J]."""
    way, turned, mean_rotation = moved
    force, moment = value.reshape(2, 3)
    if frame == "section":
        force, moment = mean_rotation @ force, mean_rotation @ moment
    return float(force @ way + moment @ turned)


def static_load_factor(mbs: exu.MainSystem) -> float:
    """By which the static solver that runs, or ran last, multiplies loads [1].

    It ramps them from zero over the load steps unless ``useLoadFactor`` is off. One where there was no static solver,
    or it was not stored (``storeSolver=False``).
    """
    solver, settings = mbs.sys.get("staticSolver"), mbs.sys.get("simulationSettings")
    if solver is None or settings is None or not settings.staticSolver.useLoadFactor:
        return 1.0
    return float(solver.ComputeLoadFactor(settings))


def material_force(tension: Array, compliance: Array) -> Array:
    """Energy that tendon material carries along, per length without tension: ``T + T^2 / (2 EA)`` [N], (m, n).

    The work that a tendon does at a cross section, per unstretched length ``du`` that passes it, is its tension times
    the stretched length less the elastic energy that leaves with the material.
    """
    return np.asarray(tension + 0.5 * compliance[:, None] * tension**2)


def tendon_work_and_dissipation(
    law: TendonLaw, before: TendonForces, after: TendonForces
) -> tuple[float, float]:
    """Work of the tendons at the base plate, and dissipation at all holes [J], by the trapezoidal rule."""
    compliance, mask = law.parameters.compliance, law.parameters.mask
    carried = [np.where(mask, material_force(f.field.tension, compliance), 0.0) for f in (before, after)]
    mean = 0.5 * (carried[0] + carried[1])
    released = after.field.released_length - before.field.released_length
    # Material that passes the base plate and every hole on its way to the base.
    passed = np.cumsum(released[:, ::-1], axis=1)[:, ::-1]
    work = float(np.sum(mean[:, 0] * passed[:, 0]))
    drop = np.where(mask[:, 1:], mean[:, :-1] - mean[:, 1:], 0.0)
    return work, float(np.sum(drop * passed[:, 1:]))


def energy_sensor(balance: EnergyBalance, name: str, output: Mapping[str, Any]) -> Any:
    """Add the sensor of an energy balance, with the columns `ENERGY_COLUMNS`; return its number."""

    def measure(
        mbs: exu.MainSystem, t: float, sensors: Sequence[int], factors: Sequence[float], configuration: Any
    ) -> list[float]:
        return [float(x) for x in balance.values()]

    mbs = balance._system.mbs
    return mbs.AddSensor(eii.SensorUserFunction(name=f"{name}.energy", sensorUserFunction=measure, **output))

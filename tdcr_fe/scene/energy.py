"""Energy of a robot in Exudyn's own solvers: what it stores, the work of tendons and loads, what it dissipates.

The works and dissipations are summed over the steps by the trapezoidal rule, and kept in data coordinates, so that
Exudyn itself restores them with the state. The work of a force is that on its own way: tension times the tendon that
passes, stress of the material times the change of strain. Works less dissipations less what the stored energy has grown
went to other items of the scene, or is the error of the integration in time, which also damps.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import exudyn as exu
import exudyn.itemInterface as eii
import numpy as np

from tdcr_fe.elements import Array
from tdcr_fe.elements.backbone import BEAM_TO_SECTION, BackboneMesh, relative_twists
from tdcr_fe.elements.forces import TendonForces
from tdcr_fe.elements.native.actuation import TendonActuation
from tdcr_fe.elements.native.condensation import at_rest
from tdcr_fe.elements.native.coordinates import NodeMotion
from tdcr_fe.elements.native.items import data_coordinates
from tdcr_fe.elements.native.material_damping import MaterialDamping
from tdcr_fe.elements.poses import log_so3
from tdcr_fe.model.loading import Vector
from tdcr_fe.model.robot import Robot
from tdcr_fe.scene.loads import PointLoad
from tdcr_fe.scene.parts import disk_inertia

_CURRENT, _START = exu.ConfigurationType.Current, exu.ConfigurationType.StartOfStep

_STORED = ("kinetic", "elastic", "gravity")
_SUMS = ("tendon_work", "load_work", "friction_dissipation", "material_dissipation")
#: Columns of the sensor, all in J: what the robot stores, then sums over the steps.
ENERGY_COLUMNS = (*_STORED, *_SUMS)


# ---------------------------------------------------------------- inertia


@dataclass(frozen=True)
class Masses:
    """Inertia of a robot, in beam axes."""

    of_elements: Array  # [kg], shape (E,)
    rotary: Array  # of the elements [kg m^2], shape (E, 3)
    of_nodes: Array  # disks and tip [kg], shape (N,)
    inertia: Array  # of the disks [kg m^2], shape (N, 3)
    gravity: Array  # [m/s^2], shape (3,)

    @classmethod
    def of(cls, robot: Robot, mesh: BackboneMesh, gravity: Vector) -> Masses:
        """Masses of a robot on its mesh, with the acceleration of gravity."""
        disks = robot.disks
        masses = np.zeros(len(mesh.arc_lengths))
        inertia = np.zeros((len(masses), 3))
        for s in disks.positions:
            k = mesh.node_at(s)
            masses[k] += disks.mass
            inertia[k] += disk_inertia(disks)[:3]
        masses[-1] += robot.tip_mass
        lengths = mesh.lengths
        rotary = mesh.rotary_inertia * lengths[:, None]
        return cls(mesh.mass_per_length * lengths, rotary, masses, inertia, np.array(gravity, dtype=float))

    def weights(self) -> Array:
        """Weight on every node, half of that of an element on each of its ends, world axes [N], shape (N, 3)."""
        half = 0.5 * self.of_elements
        lumped = self.of_nodes + np.append(half, 0.0) + np.append(0.0, half)
        return lumped[:, None] * self.gravity

    def kinetic(self, motion: NodeMotion) -> float:
        """Kinetic energy [J]: velocities are linear between the nodes, as in Exudyn's beams."""
        linear, angular = motion.velocities[:, :3], motion.twists[:, 3:]
        found = np.sum(self.of_nodes[:, None] * linear**2) + np.sum(self.inertia * angular**2)
        for of_elements, v in ((self.of_elements[:, None], linear), (self.rotary, angular)):
            near, far = v[:-1], v[1:]
            found += np.sum(of_elements * (near**2 + near * far + far**2)) / 3.0
        return 0.5 * float(found)

    def potential(self, positions: Array) -> float:
        """Potential energy in the field of gravity [J], zero at the origin of the world."""
        middle = 0.5 * (positions[:-1] + positions[1:])
        moment = self.of_elements @ middle + self.of_nodes @ positions
        return -float(self.gravity @ moment)


# ---------------------------------------------------------------- elastic energy


def elastic_energy(actuation: TendonActuation, motion: NodeMotion, forces: TendonForces) -> float:
    """Elastic energy of backbone, tendons and springs to ground [J].

    Parameters
    ----------
    actuation
        Tendons, drives and forces of the robot.
    motion
        The configuration.
    forces
        Forces of the tendons in this configuration.
    """
    mesh, section, springs = actuation.mesh, actuation.model.section, actuation.model.springs
    law = forces.model.law
    twists = relative_twists(motion.positions, motion.rotations)
    found = 0.5 * float(np.sum(mesh.twist_stiffness * (twists - mesh.reference_twists) ** 2))
    if section is not None and section.material is not None:
        found += section.material.energy(twists, mesh.lengths)
    if law.elastic:  # T^2 l0 / (2 EA) of every segment, and that of the springs at the drives
        p, field = law.parameters, forces.field
        sprung = p.spring * (field.tension[:, 0] - p.pretension)
        material = p.material - field.released_length
        material[:, 0] += sprung
        stretched = p.compliance[:, None] * field.tension**2 * material
        found += 0.5 * float(np.sum(np.where(p.mask, stretched, 0.0)) + p.spring @ field.tension[:, 0] ** 2)
    if springs is not None:
        moved = springs.rest - motion.positions[springs.nodes]
        found += 0.5 * float(np.einsum("qi,qij,qj->", moved, springs.stiffness, moved))
    return found


# ---------------------------------------------------------------- sums over the steps


@dataclass(eq=False)
class EnergySums:
    """Stored energy of one robot, and what goes in and out of it, step by step.

    Attributes
    ----------
    node
        Data node of the sums, see `ENERGY_COLUMNS` [J].
    """

    actuation: TendonActuation  # Tendons, friction and section forces
    masses: Masses
    damping: MaterialDamping | None  # By the material
    loads: Mapping[str, PointLoad]  # Concentrated loads by name; those added later count, too

    def __post_init__(self) -> None:
        self._system = self.actuation.system
        #: By which the static solver multiplied loads and weight at the end of the last step [1].
        self._load_factor = 1.0
        sums = {"numberOfDataCoordinates": len(_SUMS), "initialCoordinates": [0.0] * len(_SUMS)}
        name = f"{self.actuation.name}.energy"
        self.node = self._system.mbs.AddNode(eii.NodeGenericData(name=name, **sums))

    def measure(self, *arguments: Any) -> list[float]:
        """All columns in the current configuration, see `ENERGY_COLUMNS` [J], as a function of a sensor of Exudyn."""
        motion = NodeMotion.of(self.actuation.node_coordinates, _CURRENT)
        robot = self.actuation
        tendons = robot.elastic_tendons(robot.base_tension, robot.state.time)
        resting = at_rest(tendons.elastic, self._measured(motion), tendons.history)
        elastic = elastic_energy(robot, motion, resting)
        stored = [self.masses.kinetic(motion), elastic, self.masses.potential(motion.positions)]
        return [*stored, *self._sums().tolist()]

    def observe(self, t: float) -> None:
        """Add what a step has brought, after it was solved and before its history is committed.

        Parameters
        ----------
        t
            At the end of the step [s].
        """
        mbs = self._system.mbs
        factor_before, self._load_factor = self._load_factor, static_load_factor(mbs)
        begin, finish = (NodeMotion.of(self.actuation.node_coordinates, x) for x in (_START, _CURRENT))
        if np.array_equal(begin.coordinates, finish.coordinates):
            return
        start = self._forces(begin, mbs.systemData.GetTime(_START), _START)
        tendon_work, friction = work_and_dissipation(start, self._forces(finish, t, _CURRENT))
        # The static solver leaves velocities as they are, and ramps loads and weight.
        statics = np.array_equal(begin.velocities, finish.velocities)
        factors = np.array([factor_before, self._load_factor])
        load_work = 0.0
        for load in self.loads.values():
            acting = 0.5 * (factors @ [load.applied, load.value]) if statics else load.value
            load_work += _load_work(load, acting, self.actuation.nodes.index(load.node), begin, finish)
        if statics:  # the part of the weight that the static solver does not apply yet
            risen = self.masses.potential(finish.positions) - self.masses.potential(begin.positions)
            load_work += (1.0 - factors.mean()) * risen
        material = 0.0
        if self.damping is not None:
            material = self.damping.dissipated(self.actuation.mesh, begin, finish)
        sums = self._sums()
        sums += [tendon_work, load_work, friction, material]

    def _sums(self) -> Array:
        """The coordinates of the data node, in the memory of Exudyn."""
        return data_coordinates(self._system.mbs, self.node, len(_SUMS), _CURRENT)

    def _forces(self, motion: NodeMotion, t: float, configuration: Any) -> TendonForces:
        """With the history at the beginning of the step, at a time [s]; motors are as in a configuration of Exudyn."""
        robot = self.actuation
        tendons = robot.elastic_tendons(robot.input_values(t, configuration), t)
        return tendons.forces(self._measured(motion), robot.base_tension)

    def _measured(self, motion: NodeMotion) -> Any:
        return self.actuation.model.measure(motion.positions, motion.rotations)


def _load_work(load: PointLoad, value: Array, k: int, begin: NodeMotion, finish: NodeMotion) -> float:
    """Work of a concentrated load on a node that is constant in a step, in its own frame [J]."""
    force, moment = value.reshape(2, 3)
    first, last = begin.rotations[k], finish.rotations[k]
    if load.frame == "section":
        mean_rotation = 0.5 * (first + last) @ BEAM_TO_SECTION.T
        force, moment = mean_rotation @ force, mean_rotation @ moment
    turned = first @ log_so3(first.T @ last)
    return float(force @ (finish.positions[k] - begin.positions[k]) + moment @ turned)


def static_load_factor(mbs: exu.MainSystem) -> float:
    """By which the static solver that runs, or ran last, multiplies loads [1].

    It ramps them from zero over the load steps unless ``useLoadFactor`` is off. One where there was no static solver,
    or it was not stored (``storeSolver=False``).
    """
    solver, settings = mbs.sys.get("staticSolver"), mbs.sys.get("simulationSettings")
    if solver is None or settings is None or not settings.staticSolver.useLoadFactor:
        return 1.0
    return float(solver.ComputeLoadFactor(settings))


def work_and_dissipation(before: TendonForces, after: TendonForces) -> tuple[float, float]:
    """Work of the tendons at the base plate, and dissipation at all holes [J], by the trapezoidal rule.

    The work that a tendon does at a cross section, per unstretched length ``du`` that passes it, is its tension times
    the stretched length less the elastic energy that leaves with the material: ``T + T^2 / (2 EA)``.
    """
    compliance, mask = after.model.law.parameters.compliance, after.model.law.parameters.mask
    tensions = [f.field.tension for f in (before, after)]
    carried = [np.where(mask, t + 0.5 * compliance[:, None] * t**2, 0.0) for t in tensions]
    mean = 0.5 * (carried[0] + carried[1])
    released = after.field.released_length - before.field.released_length
    # Material that passes the base plate and every hole on its way to the base.
    passed = np.cumsum(released[:, ::-1], axis=1)[:, ::-1]
    work = float(np.sum(mean[:, 0] * passed[:, 0]))
    drop = np.where(mask[:, 1:], mean[:, :-1] - mean[:, 1:], 0.0)
    return work, float(np.sum(drop * passed[:, 1:]))

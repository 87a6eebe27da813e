"""Energy balance of a robot in Exudyn's own solvers: what it stores, the work of tendons and loads, what it dissipates.

The works and dissipations are summed over the steps and kept in data coordinates, so that Exudyn itself restores them
with the state. All sums are by the trapezoidal rule between the beginning and the end of a step.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import exudyn as exu
import exudyn.itemInterface as eii
import numpy as np
from numpy.typing import NDArray
from scipy.special import spence

from tdcr_fe.elements.actuation import TendonActuation
from tdcr_fe.elements.backbone import BEAM_TO_SECTION, relative_twists
from tdcr_fe.elements.disks import disk_inertia
from tdcr_fe.elements.elastic_tendons import ElasticTendons
from tdcr_fe.elements.forces import TendonForces
from tdcr_fe.elements.friction import TendonLaw
from tdcr_fe.elements.generalized import twists_by_coordinates
from tdcr_fe.elements.history import RobotHistory
from tdcr_fe.elements.material_damping import MaterialDamping
from tdcr_fe.elements.node_coordinates import NodeCoordinates
from tdcr_fe.elements.poses import log_so3
from tdcr_fe.elements.section import NonlinearSection, SuperelasticSection
from tdcr_fe.elements.system import SystemReference
from tdcr_fe.model.loading import Vector
from tdcr_fe.model.robot import Robot
from tdcr_fe.scene.loads import PointLoad

Array = NDArray[np.float64]
_CURRENT, _START = exu.ConfigurationType.Current, exu.ConfigurationType.StartOfStep

#: Points and weights of a rule on [-1, 1] that is exact up to degree 7.
_GAUSS = np.polynomial.legendre.leggauss(4)
#: Columns of the sensor, all in J.
ENERGY_COLUMNS = (
    "kinetic",
    "elastic",
    "gravity",
    "tendon_work",
    "load_work",
    "friction_dissipation",
    "material_dissipation",
    "balance",
)


class Motion(NamedTuple):
    """Nodes of a robot at one time.

    Attributes
    ----------
    coordinates, velocities : ndarray, shape (7 N,)
        Without reference values.
    positions, rotations : ndarray
        Shapes (N, 3) and (N, 3, 3).
    linear, angular : ndarray, shape (N, 3)
        Velocities, of the positions in world axes, of the rotations in the nodes' own.
    """

    coordinates: Array
    velocities: Array
    positions: Array
    rotations: Array
    linear: Array
    angular: Array


@dataclass(frozen=True)
class Masses:
    """Inertia of a robot.

    Attributes
    ----------
    of_elements : ndarray, shape (E,)
        [kg].
    rotary : ndarray, shape (E, 3)
        About the beam's axes [kg m^2].
    of_nodes : ndarray, shape (N,)
        Of disks and tip [kg].
    inertia : ndarray, shape (N, 3)
        Of the disks, about the beam's axes [kg m^2].
    gravity : ndarray, shape (3,)
        [m/s^2].
    """

    of_elements: Array
    rotary: Array
    of_nodes: Array
    inertia: Array
    gravity: Array

    @classmethod
    def of(cls, robot: Robot, actuation: TendonActuation, gravity: Vector) -> Masses:
        """Of a robot and its mesh, with the acceleration of gravity."""
        mesh, disks = actuation.mesh, robot.disks
        masses = np.zeros(len(mesh.arc_lengths))
        inertia = np.zeros((len(masses), 3))
        for s in disks.positions:
            k = mesh.node_at(s)
            masses[k] += disks.mass
            inertia[k] += disk_inertia(disks.mass, disks.radius, disks.thickness)[:3]
        masses[-1] += robot.tip_mass
        lengths = mesh.lengths
        rotary = mesh.rotary_inertia * lengths[:, None]
        return cls(mesh.mass_per_length * lengths, rotary, masses, inertia, np.array(gravity, dtype=float))

    def kinetic(self, motion: Motion) -> float:
        """Kinetic energy [J]: velocities are linear between the nodes, as in Exudyn's beams."""
        found = np.sum(self.of_nodes[:, None] * motion.linear**2) + np.sum(self.inertia * motion.angular**2)
        for of_elements, v in ((self.of_elements[:, None], motion.linear), (self.rotary, motion.angular)):
            near, far = v[:-1], v[1:]
            found += np.sum(of_elements * (near**2 + near * far + far**2)) / 3.0
        return 0.5 * float(found)

    def potential(self, positions: Array) -> float:
        """Potential energy in the field of gravity [J], zero at the origin of the world."""
        middle = 0.5 * (positions[:-1] + positions[1:])
        moment = self.of_elements @ middle + self.of_nodes @ positions
        return -float(self.gravity @ moment)


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
        Data node of the sums: work of tendons and of loads, dissipation by friction and by material, balance [J].
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
        count = len(ENERGY_COLUMNS) - 3
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
        motion = self._motion(_CURRENT)
        actuation = self._actuation
        return self._stored(motion, self._tendons(actuation.history).at_rest(self._measured(motion)))

    def _stored(self, motion: Motion, forces: TendonForces) -> Array:
        positions = motion.positions
        elastic = self._backbone_energy(motion) + tendon_energy(
            forces, self._tendons(self._actuation.history)
        )
        springs = self._actuation.model.springs
        if springs is not None:
            away = springs.rest - positions[springs.nodes]
            elastic += 0.5 * float(np.einsum("qi,qij,qj->", away, springs.stiffness, away))
        return np.array([self._masses.kinetic(motion), elastic, self._masses.potential(positions)])

    def _backbone_energy(self, motion: Motion) -> float:
        mesh, section = self._actuation.mesh, self._actuation.section
        twists = relative_twists(motion.positions, motion.rotations)
        found = 0.5 * float(np.sum(mesh.twist_stiffness * (twists - mesh.reference_twists) ** 2))
        if section is not None and section.superelastic is not None:
            found += superelastic_energy(section.superelastic, twists, mesh.lengths)
        if section is not None and section.nonlinear is not None:
            found += fibre_energy(section.nonlinear, twists - mesh.reference_twists, twists, mesh.lengths)
        return found

    # ------------------------------------------------------------------ sums

    def observe(self, t: float) -> None:
        """Add what a step has brought, after it was solved and before its history is committed.

        Parameters
        ----------
        t
            At the end of the step [s].
        """
        data = self._system.mbs.systemData
        start, end = self._motion(_START), self._motion(_CURRENT)
        if np.array_equal(start.coordinates, end.coordinates):
            return
        before = self._forces(start, data.GetTime(_START))
        after = self._forces(end, t)
        law = self._tendons(self._actuation.history).law()
        tendon_work, friction = tendon_work_and_dissipation(law, before, after)
        load_work = sum(_load_work(load, self._moved(load, start, end)) for load in self._loads.values())
        material = self._material_dissipation(start, end)
        gained = float(np.sum(self._stored(end, after) - self._stored(start, before)))
        balance = tendon_work + load_work - friction - material - gained
        sums = self._sums()
        sums += [tendon_work, load_work, friction, material, balance]

    def values(self) -> Array:
        """All columns, see `ENERGY_COLUMNS` [J], shape (8,)."""
        return np.concatenate((self.stored(), self._sums()))

    def _sums(self) -> Array:
        """The coordinates of the data node, in the memory of Exudyn."""
        data = self._system.mbs.systemData
        first = int(data.GetNodeLTGData(self.node)[0])
        everything: Array = data.GetDataCoordinates(_CURRENT, copy=False)
        return everything[first : first + len(ENERGY_COLUMNS) - 3]

    def _material_dissipation(self, start: Motion, end: Motion) -> float:
        if self._damping is None:
            return 0.0
        stiffness = self._actuation.mesh.twist_stiffness
        forces = [self._damping.forces(stiffness, m.coordinates, m.velocities) for m in (start, end)]
        return -0.5 * float((forces[0] + forces[1]) @ (end.coordinates - start.coordinates))

    def _moved(self, load: PointLoad, start: Motion, end: Motion) -> tuple[Array, Array, Array]:
        """Way, rotation vector in world axes, and the mean rotation matrix of the node of a load."""
        k = self._actuation.nodes.index(load.node)
        first, last = start.rotations[k], end.rotations[k]
        turned = first @ log_so3(first.T @ last)
        return end.positions[k] - start.positions[k], turned, 0.5 * (first + last) @ BEAM_TO_SECTION.T

    # ------------------------------------------------------------------ state

    def _motion(self, configuration: Any) -> Motion:
        data, numbers = self._system.mbs.systemData, self._coordinates.numbers
        moved = np.asarray(data.GetODE2Coordinates(configuration))[numbers]
        rates = np.asarray(data.GetODE2Coordinates_t(configuration))[numbers]
        positions, rotations, parameters = self._coordinates.poses(moved)
        twists = (twists_by_coordinates(rotations, parameters) @ rates[:, :, None])[:, :, 0]
        return Motion(moved.ravel(), rates.ravel(), positions, rotations, rates[:, :3], twists[:, 3:])

    def _measured(self, motion: Motion) -> Any:
        return self._actuation.model.measure(motion.positions, motion.rotations)

    def _tendons(self, history: RobotHistory) -> ElasticTendons:
        actuation = self._actuation
        return ElasticTendons(
            actuation.model, actuation.by_displacement, history, actuation.inextensible_stiffness
        )

    def _forces(self, motion: Motion, t: float) -> TendonForces:
        """Forces with the history at the beginning of the step."""
        history = self._actuation.history
        values = self._actuation.input_values(t)
        return self._tendons(history).forces(self._measured(motion), values, history.base_tension, t)


def _load_work(load: PointLoad, moved: tuple[Array, Array, Array]) -> float:
    """Work of a concentrated load that is constant in a step, in its own frame [J]."""
    way, turned, mean_rotation = moved
    force, moment = load.value.reshape(2, 3)
    if load.frame == "section":
        force, moment = mean_rotation @ force, mean_rotation @ moment
    return float(force @ way + moment @ turned)


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


def tendon_energy(forces: TendonForces, tendons: ElasticTendons) -> float:
    """Elastic energy of the tendons between base plate and anchor, ``T^2 l0 / (2 EA)`` [J]."""
    law = tendons.law()
    p = law.parameters
    if not law.elastic:
        return 0.0
    material = p.material - forces.field.released_length
    return 0.5 * float(
        np.sum(np.where(p.mask, p.compliance[:, None] * forces.field.tension**2 * material, 0.0))
    )


def superelastic_energy(law: SuperelasticSection, twists: Array, lengths: Array) -> float:
    """Energy of a superelastic section beyond that of linear elasticity [J]: the integral of its moment."""
    bend = twists[:, 4:] / lengths[:, None] - law.precurvature[:, 1:]
    k = np.sqrt(np.einsum("ei,ei->e", bend, bend))
    w, kc = law.threshold / 40.0, law.threshold
    at_zero = float(np.logaddexp(0.0, -kc / w))
    area = w * (_softplus_integral((k - kc) / w) - _softplus_integral(np.array(-kc / w))) - at_zero * k
    return -float(np.sum((1.0 - law.ratio) * w * law.bending_stiffness * lengths * area))


def fibre_energy(law: NonlinearSection, away: Array, twists: Array, lengths: Array) -> float:
    """Energy of nonlinear fibres beyond that of linear elasticity [J].

    The integral of their forces on the straight way from the unloaded twists, exact because these are cubic on it.

    Parameters
    ----------
    law
        The fibres.
    away, twists
        Twists of the elements less those of the unloaded state, and the twists, shape (E, 6).
    lengths
        Of the elements [m], shape (E,).
    """
    shares = 0.5 * (_GAUSS[0] + 1.0)
    forces = law.gradient(twists - (1.0 - shares)[:, None, None] * away, lengths)
    return 0.5 * float(np.einsum("s,sei,ei->", _GAUSS[1], forces, away))


def _softplus_integral(x: Array) -> Array:
    """Integral of ``log(1 + exp(x))`` from minus infinity: ``-Li2(-exp(x))``."""
    low = -spence(1.0 + np.exp(np.minimum(x, 0.0)))
    high = np.pi**2 / 6.0 + 0.5 * x**2 + spence(1.0 + np.exp(-np.maximum(x, 0.0)))
    return np.where(x > 0.0, high, low)


def energy_sensor(balance: EnergyBalance, name: str, output: Mapping[str, Any]) -> Any:
    """Add the sensor of an energy balance, with the columns `ENERGY_COLUMNS`; return its number."""

    def measure(
        mbs: exu.MainSystem, t: float, sensors: Sequence[int], factors: Sequence[float], configuration: Any
    ) -> list[float]:
        return [float(x) for x in balance.values()]

    mbs = balance._system.mbs
    return mbs.AddSensor(eii.SensorUserFunction(name=f"{name}.energy", sensorUserFunction=measure, **output))

"""The equations that are solved, of a whole scene: Exudyn's with tendons and section forces, in increments of strains.

Residual and Jacobian come from Exudyn (`tdcr_fe.solve.equations.kernel`), except for tendons and section forces: these
are a few matrix products, and the item that applies them is switched off while this solver works. Where nothing but
robots is in the scene, the tangent follows from the stiffness of the elements. Every beam node is taken in body-frame
increments; an increment of the nodes becomes an increment of the elements' strains, and the poses are rebuilt from the
base by exact exponentials. Everything else in the scene keeps its ordinary additive update. Derivation:
docs/algorithms.md, section "Newton's method in strain space".
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import replace

import exudyn as exu
import numpy as np

from tdcr_fe.elements import Array
from tdcr_fe.elements.forces import TendonForces
from tdcr_fe.elements.native.actuation import TendonActuation
from tdcr_fe.elements.native.hooks import SceneHooks
from tdcr_fe.scene.loads import PointLoad
from tdcr_fe.solve.equations.band import BandFactors
from tdcr_fe.solve.equations.configuration import SolverState, StoredState, Target
from tdcr_fe.solve.equations.contact import ContactStates, refuse_other_states
from tdcr_fe.solve.equations.kernel import ClampReactions, LoneRobot, Residual, StaticKernel
from tdcr_fe.solve.equations.layout import Numbering, SceneLayout
from tdcr_fe.solve.equations.linearization import (
    BorderedFactors,
    DenseFactors,
    Factors,
    Linearization,
    backbone_tangent,
    damping_of_node,
    hold,
)


class SceneSystem:
    """Equations of equilibrium of a scene with all its robots.

    Parameters
    ----------
    mbs
        An assembled system.

    Attributes
    ----------
    robots : list of TendonActuation
    point_loads : list of PointLoad
        The concentrated loads on them.
    kernel : StaticKernel
    layout : SceneLayout
    reactions : ClampReactions
        This and the layout are replaced by `release_clamps`.

    Raises
    ------
    ValueError
        The system is not assembled, has no robot, or has states that this solver does not solve: first-order
        states, or states with a history other than those of the robots.
    """

    def __init__(self, mbs: exu.MainSystem) -> None:
        self.mbs = mbs
        self.hooks = SceneHooks.of(mbs)
        self.robots: list[TendonActuation] = self.hooks.robots
        if not self.robots:
            raise ValueError("no robot in this system; add one with CreateTDCR before solving")
        if not mbs.systemIsConsistent:
            raise ValueError("the system is not assembled; call mbs.Assemble() before solving")
        refuse_other_states(mbs)
        self.point_loads: list[PointLoad] = self.hooks.point_loads
        self.kernel = StaticKernel(mbs, self.hooks)
        self._lone: LoneRobot | None = None
        self._user_residual = self.hooks.user_function("PreNewtonResidual")
        self.layout = SceneLayout.of(self.robots, self.point_loads, with_clamps=True)
        self.reactions = ClampReactions.of(mbs, self.layout)
        self._numberings: dict[tuple[object, ...], Numbering] = {}  # One takes 2 % of a load step

    def independent(self) -> list[SceneSystem]:
        """Systems of robots that nothing couples, each to be solved by itself; this one where there are none.

        Robots can be solved one by one where the scene has nothing but robots with clamped bases, no load turns with
        the robot, and no user function acts on the scene within a load step.
        """
        robots, layout = len(self.robots), self.layout
        users = any(map(self.hooks.user_function, ("PreNewtonResidual", "PreStep", "SystemJacobian")))
        turned = any(load.applied[0 if load.frame == "section" else 3 :].any() for load in self.point_loads)
        values = [load.value for load in self.point_loads]
        if users or turned or layout.user_loads or self.has_contact or not layout.only_robots_resist(values):
            return [self]
        if robots == 1 or len(layout.clamps) < robots or not self.clamps_are_closed(self.kernel.residual()):
            return [self]
        return [self._alone(i) for i in range(robots)]

    def _alone(self, i: int) -> SceneSystem:
        """The equations of one robot that nothing couples with the rest."""
        own = copy(self)
        own.robots, own.point_loads = [self.robots[i]], self.hooks.robots[i].point_loads
        own.layout, own.reactions = self.layout.alone(i), self.reactions.alone(i)
        own._lone = LoneRobot(self.kernel, self.mbs, self.robots[i])
        return own

    @property
    def length(self) -> float:
        """Length of the longest backbone [m]."""
        return self.layout.scales.length

    def numbering(self, with_friction: bool = True, by_tension: int | None = None) -> Numbering:
        """Order of the unknowns, with or without the mobilisations.

        For the current driving of the tendons; ``by_tension``: number of a robot whose tensions are taken as given.
        """
        winds = [robot.drives.winds for robot in self.robots]
        key = (self.layout, with_friction, by_tension, *[own.tobytes() for own in winds])
        if key not in self._numberings:
            own = [wound & (i != by_tension) for i, wound in enumerate(winds)]
            self._numberings[key] = Numbering.of(self.layout, own, with_friction)
        return self._numberings[key]

    # ------------------------------------------------------------------ states

    def current_state(self, time: float = 0.0) -> SolverState:
        """The current state of the scene and its robots at a given time [s]; slip rates are kept."""
        return SolverState(
            self.layout.space.from_scene(),
            tuple(r.base_tension for r in self.robots),
            tuple(r.state.mobilisation for r in self.robots),
            tuple(replace(r.friction_without_stretch(), time=time) for r in self.robots),
            tuple(r.history.prescribed for r in self.robots),
            tuple(load.applied for load in self.point_loads),
            time,
        )

    def with_reactions(self, state: SolverState) -> SolverState:
        """A state whose joint reactions (Lagrange multipliers) are those of statics.

        They stiffen the tangent: without them a body that hangs from a joint, such as a pendulum, would move freely.
        Those of Exudyn's dynamic solver have the other sign. In a scene that was never solved, they are those of the
        smallest step of Newton's method.
        """
        joints, old = self.layout.reduction.other_multipliers, state.configuration.unknowns
        if not len(joints):
            return state

        def having(multipliers: Array) -> SolverState:
            unknowns = old._replace(multipliers=multipliers)
            return state._replace(configuration=state.configuration._replace(unknowns=unknowns))

        numbering = self.numbering()
        if old.multipliers[joints].any():
            signs = state, having(-old.multipliers)
            return min(signs, key=lambda each: self.residual(each, state.target, numbering).size)
        residual = self.residual(state, state.target, numbering)
        k = self.tangent(residual)
        hold(k, numbering.clamped)
        step = np.linalg.lstsq(k, -residual.unbalanced)[0]
        multipliers = old.multipliers.copy()
        multipliers[joints] = step[self.layout.scales.forces :]
        return having(multipliers)

    def warm_start(self, state: SolverState, stored: StoredState) -> SolverState:
        """A state with the unknowns of another run and its own history; unchanged where the meshes differ."""
        if not self.layout.space.fits(stored.unknowns):
            return state
        return state._replace(
            configuration=self.layout.space.build(stored.unknowns),
            base_tension=stored.base_tension,
            mobilisation=stored.mobilisation,
        )

    def store(self, state: SolverState, forces: Sequence[TendonForces] | None = None) -> None:
        """Leave a solved state in the scene, as current and as initial configuration; see also `connect`.

        Parameters
        ----------
        state
            The state.
        forces
            By robot, in that state; None computes them.
        """
        if not forces:
            forces = self.forces(state, state.time)
        for i, robot in enumerate(self.robots):
            robot.store(state.friction[i].anew, state.prescribed[i], forces[i])
        for item, load in zip(self.point_loads, state.loads, strict=True):
            item.applied = load
            item.keep()
        self.layout.space.write(state.configuration, initial=True)
        self.kernel.contact.keep()

    def connect(self) -> None:
        """Let Exudyn's items apply the forces of the stored state again, for Exudyn's own solvers and for drawing."""
        for robot in self.robots:
            robot.connect()

    def bring_to_rest(self) -> None:
        """Set the velocities and accelerations of the scene to zero."""
        data, kinds = self.mbs.systemData, exu.ConfigurationType
        rest = np.zeros(self.layout.reduction.n2)
        for kind in (kinds.Current, kinds.Initial):
            data.SetODE2Coordinates_t(rest, kind)
            data.SetODE2Coordinates_tt(rest, kind)

    # ------------------------------------------------------------------ equations

    def forces(self, state: SolverState, time: float) -> tuple[TendonForces, ...]:
        """By robot, tensions and section forces in a state at a time [s]."""
        found = []
        for i, robot in enumerate(self.robots):
            measured, tension = state.configuration.measured[i], state.base_tension[i]
            field = robot.law.field(tension, measured.shape, state.mobilisation[i], state.friction[i], time)
            found.append(TendonForces(robot.model, measured, tension, field))
        return tuple(found)

    def residual(
        self,
        state: SolverState,
        target: Target,
        numbering: Numbering,
        iteration: int = 0,
        hold_contact: bool = False,
        forces: tuple[TendonForces, ...] = (),
    ) -> Residual:
        """Residual of a state under a target.

        Parameters
        ----------
        state
            Written into the scene.
        target
            Inputs and time; loads are those already in the scene.
        numbering
            Numbering of the unknowns.
        iteration
            Number of the iteration, passed to the user's ``PreNewtonResidual`` function.
        hold_contact
            Whether contact acts where it acted in the last residual, not where this state would have it.
        forces
            By robot, in that state; none computes them.
        """
        layout = self.layout
        layout.space.write(state.configuration)
        if not hold_contact:
            self.kernel.contact.follow()
        if self._user_residual is not None:
            self._user_residual(self.mbs, target.time, iteration, 0)
        forces = forces or self.forces(state, target.time)
        for robot in self.robots:
            robot.disconnect()
        raw = self.kernel.residual() if self._lone is None else self._lone.residual(target)
        unbalanced = layout.reduction.residual(raw, state.configuration.frames)
        for nodes, own in zip(layout.space.slices, forces, strict=True):
            unbalanced[6 * nodes.start : 6 * nodes.stop] += own.nodal_wrenches.reshape(-1)
        on_bases = unbalanced[numbering.clamped]
        unbalanced[numbering.clamped] = 0.0
        size = layout.scales.relative_residual(unbalanced, state.base_tension, target.load_size)
        for part in numbering.robots:
            if part.driven.size:
                own, displacement = forces[part.robot], target.inputs[part.robot]
                size = max(size, layout.scales.displacement_error(own, displacement, part.driven))
        return Residual(state, target, forces, unbalanced, on_bases, raw, size)

    @property
    def has_contact(self) -> bool:
        """Whether the scene has items of contact."""
        return self.kernel.contact.present

    def contact_at(self, state: SolverState) -> ContactStates:
        """The contact in a state, which is left in the scene."""
        self.layout.space.write(state.configuration)
        self.kernel.contact.follow()
        return self.kernel.contact

    def may_jump_over_contact(self, before: SolverState, after: SolverState) -> bool:
        """Whether bodies may have jumped over each other from one state to another, which is left in the scene."""
        moved = after.configuration.positions - before.configuration.positions
        if float(np.linalg.norm(moved, axis=1).max()) > self.kernel.contact.general_motion_limit:
            return True
        contact = self.contact_at(before)
        limits, start = contact.approach_limits(), contact.relative_positions()
        approach = np.linalg.norm(self.contact_at(after).relative_positions() - start, axis=1)
        return bool(np.any(approach > limits))

    def tangent(self, residual: Residual) -> Array:
        """Derivative of the reduced residual at fixed friction and tensions at the base.

        Parameters
        ----------
        residual
            The last one evaluated, whose state is in the scene.

        Returns
        -------
        ndarray, shape (reduced, reduced)
            Exudyn's sign: minus the stiffness.
        """
        layout = self.layout
        turning = layout.others_turn or bool(layout.turning.any())
        j = self.kernel.jacobian(loads=turning, constraints=len(layout.reduction.other_multipliers) > 0)
        user = self.hooks.user_function("SystemJacobian")
        if user is not None:
            extra = np.asarray(user(self.mbs, residual.target.time, 1.0, 0.0, 1.0).Convert2DenseMatrix())
            j[: extra.shape[0], : extra.shape[1]] += extra
        k = layout.reduction.tangent(j, residual.state.configuration.frames)
        for own, nodes in zip(residual.forces, layout.space.slices, strict=True):
            own.add_tangent(k, nodes.start)
        return k

    def tangent_follows_from_elements(self, loads: Sequence[Array]) -> bool:
        """Whether the tangent follows from the elements' stiffness alone, without Exudyn's Jacobian: of one robot.

        ``loads``: the concentrated loads that act, shape (6,) each.
        """
        return (
            self.layout.only_robots_resist(loads)
            and len(self.robots) == 1
            and self.mbs.NumberOfGeneralContacts() == 0
            and self.hooks.user_function("SystemJacobian") is None
        )

    def linearize(self, residual: Residual, numbering: Numbering, damping: float = 0.0) -> Linearization:
        """Linearise equilibrium, with the tensions of tendons with prescribed displacement as further unknowns.

        Parameters
        ----------
        residual
            The last one evaluated, whose state is in the scene.
        numbering
            Numbering of the unknowns.
        damping
            Damping of nodes and other coordinates of the scene, for pseudo-transient continuation [N m].

        Raises
        ------
        numpy.linalg.LinAlgError
            The tangent is singular.
        """
        factors = self._factors(residual, numbering, damping_of_node(damping, self.length))
        if numbering.any_driven:
            factors = BorderedFactors.of(factors, residual, numbering)
        return Linearization(factors, residual.state.configuration.chains, numbering, residual.forces)

    def _factors(self, residual: Residual, numbering: Numbering, damping: Array) -> Factors:
        """Factors of the tangent at fixed tensions: of one robot from its elements, else with Exudyn's Jacobian."""
        slices = self.layout.space.slices
        if self.tangent_follows_from_elements(residual.target.loads):
            (own,), (band,) = residual.forces, self.layout.bands
            backbone = backbone_tangent(residual, 0, slices[0], damping, own.model.mesh)
            if band is not None and own.field.at_holes is not None:
                return BandFactors.of(band.assemble(backbone, own, numbering.robots[0].clamped), band)
            k = np.zeros((6 * slices[0].stop,) * 2)
            backbone.add_to(k, np.arange(slices[0].stop))
            own.add_tangent(k)
        else:
            k = self.tangent(residual)
            for i, nodes in enumerate(slices):
                backbone = backbone_tangent(residual, i, nodes, damping)
                backbone.add_to(k, np.arange(nodes.start, nodes.stop))
            others = 6 * slices[-1].stop + np.arange(len(self.layout.reduction.other_coordinates))
            k[others, others] -= damping[0]
        hold(k, numbering.clamped)
        return DenseFactors.of(k)

    # ------------------------------------------------------------------ clamps

    def clamps_are_closed(self, raw: Array) -> bool:
        """Whether the joints of clamped bases are closed, by Exudyn's residual."""
        n2, clamps = self.layout.reduction.n2, self.layout.clamps.values()
        gap = max((float(np.abs(raw[n2 + joint]).max()) for joint in clamps), default=0.0)
        return gap <= 1e-9 * self.length

    def release_clamps(self) -> None:
        """Treat clamped bases as any other joint from now on, because their supports have been moved."""
        self.layout = SceneLayout.of(self.robots, self.point_loads, with_clamps=False)
        self.reactions = ClampReactions.of(self.mbs, self.layout)

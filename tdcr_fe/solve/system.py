"""Equations of a whole scene: residual, tangent and base reactions from Exudyn's solver kernel.

Residual and Jacobian come from Exudyn, except for tendons and section forces: these are a few matrix products, and
their connectors are switched off while this solver works. Where nothing but robots is in the scene, the tangent follows
from the stiffness of the elements. Every beam node is taken in body-frame increments; an increment of the nodes
becomes an increment of the elements' strains, and the poses are rebuilt from the base by exact exponentials.
Everything else in the scene keeps its ordinary additive update. Derivation: documentation, page "Theory".
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import exudyn as exu
import numpy as np
from numpy.typing import NDArray

from tdcr_fe.elements.actuation import TendonActuation
from tdcr_fe.elements.forces import TendonForces
from tdcr_fe.elements.hooks import SceneHooks
from tdcr_fe.solve.configuration import Configuration, ConfigurationSpace, Unknowns
from tdcr_fe.solve.convergence import ResidualScales
from tdcr_fe.solve.linearization import Factorisation, Linearization
from tdcr_fe.solve.numbering import Numbering
from tdcr_fe.solve.reduction import BodyFrameReduction, RobotNodes, SceneTangent
from tdcr_fe.solve.state import SolverState, StoredState, Target

Array = NDArray[np.float64]
_EYE6 = np.eye(6)


class Residual(NamedTuple):
    """Residual of a state under a target.

    Attributes
    ----------
    state : SolverState
    target : Target
    forces : tuple of TendonForces
        By robot.
    unbalanced : ndarray
        Reduced residual; zero at clamped bases, whose joints provide the reactions.
    on_bases : tuple of ndarray, shape (6,)
        By clamped robot, the wrench on its base.
    raw : ndarray
        Exudyn's residual.
    size : float
        Largest residual over its scale, prescribed displacements included [1].
    """

    state: SolverState
    target: Target
    forces: tuple[TendonForces, ...]
    unbalanced: Array
    on_bases: tuple[Array, ...]
    raw: Array
    size: float


@dataclass(frozen=True, eq=False)
class SceneLayout:
    """Map from the unknowns of Exudyn's scene to those of the solver.

    Attributes
    ----------
    clamps : dict
        By robot whose base is clamped to ground, the numbers of the joint's multipliers.
    reduction : BodyFrameReduction
    space : ConfigurationSpace
    clamped : tuple of slice
        Unknowns of the clamped bases, in the order of ``clamps``.
    scales : ResidualScales
    loads_jacobian : bool
        Whether any load changes with the configuration of the node it acts on.
    user_loads : bool
        Whether functions of the user may change loads while a load step is solved.
    robots_only : bool
        Whether nothing but robots, clamped to ground, resists motion: no other objects, no loads that turn.
    numberings : dict of Numbering
        Those computed so far, by which tendons are driven by displacement.
    """

    clamps: dict[int, NDArray[np.int_]]
    reduction: BodyFrameReduction
    space: ConfigurationSpace
    clamped: tuple[slice, ...]
    scales: ResidualScales
    loads_jacobian: bool
    user_loads: bool
    robots_only: bool
    numberings: dict[tuple[bytes, ...], Numbering] = field(default_factory=dict)

    @classmethod
    def of(cls, mbs: exu.MainSystem, robots: Sequence[TendonActuation], with_clamps: bool) -> SceneLayout:
        """Layout of an assembled scene; ``with_clamps=False`` treats the joints of clamped bases as any other."""
        data = mbs.systemData
        for robot in robots:
            robot.forget_coordinates()
            robot.disconnect()
        norms = [i for robot in robots for node in robot.nodes for i in data.GetNodeLTGAE(node)]
        clamps = _clamps(mbs, robots) if with_clamps else {}
        dropped = [*norms, *(i for joint in clamps.values() for i in joint)]
        coordinates = np.concatenate([r.coordinates for r in robots])
        reduction = BodyFrameReduction(mbs, coordinates, dropped, _rows_of_nodes(robots))
        space = ConfigurationSpace(mbs, robots, reduction, clamps)
        starts = [6 * space.slices[i].start for i in clamps]
        own = {i for r in robots for i in r.connectors.load_numbers}
        loads = [mbs.GetLoad(i) for i in range(data.NumberOfLoads()) if i not in own]
        # Forces fixed in the world have no derivative at a node; all other loads may have one.
        turning = any(_turns(load) for load in loads)
        return cls(
            clamps,
            reduction,
            space,
            tuple(slice(k, k + 6) for k in starts),
            ResidualScales.of(robots, reduction),
            turning,
            any(load.get("loadVectorUserFunction") or load.get("loadUserFunction") for load in loads),
            not turning and not len(reduction.other) and _nothing_but_robots(mbs, robots),
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
    layout : SceneLayout
        Replaced by `release_clamps`.

    Raises
    ------
    ValueError
        The system is not assembled, has no robot, or has states that this solver does not solve: first-order
        states, or the data coordinates of contact items.
    """

    def __init__(self, mbs: exu.MainSystem) -> None:
        self.mbs = mbs
        self.hooks = SceneHooks.of(mbs)
        self.hooks.adopt()
        self.robots: list[TendonActuation] = self.hooks.actuations
        if not self.robots:
            raise ValueError("no robot in this system; add one with CreateTDCR before solving")
        if not mbs.systemIsConsistent:
            raise ValueError("the system is not assembled; call mbs.Assemble() before solving")
        settings = exu.SimulationSettings()
        settings.solution.file.write = False
        settings.solution.sensors.active = False
        settings.staticSolver.verboseMode = 0
        self._settings = settings
        self._kernel = _static_kernel(mbs, self.hooks, settings)
        if self._kernel.GetODE1size():
            raise ValueError(
                "the scene has first-order (ODE1) states, which the quasi-static solver does not solve; "
                "use mbs.SolveDynamic, or leave these items out"
            )
        if mbs.systemData.DataSize():
            raise ValueError(
                "the scene has data coordinates, as of contact items, which the quasi-static solver does not update; "
                "use mbs.SolveStatic or mbs.SolveDynamic, or describe the contact by a connector whose force is a "
                "function of the user"
            )
        self.layout = SceneLayout.of(mbs, self.robots, with_clamps=True)
        self._reactions = self._couplings_and_reactions()

    @property
    def length(self) -> float:
        """Length of the longest backbone [m]."""
        return self.layout.scales.length

    def numbering(self) -> Numbering:
        """Order of the unknowns for the current driving of the tendons."""
        driven = tuple(robot.by_displacement.tobytes() for robot in self.robots)
        if driven not in self.layout.numberings:
            self.layout.numberings[driven] = Numbering.of(
                self.robots, self.layout.space.slices, self.layout.reduction.count
            )
        return self.layout.numberings[driven]

    # ------------------------------------------------------------------ states

    def current_state(self, time: float = 0.0) -> SolverState:
        """The current state of the scene and its robots at a given time [s]; slip rates are kept."""
        return SolverState(
            self.layout.space.from_scene(),
            tuple(r.base_tension for r in self.robots),
            tuple(r.state.mobilisation for r in self.robots),
            tuple(replace(r.state, time=time) for r in self.robots),
            tuple(r.prescribed for r in self.robots),
            tuple(load.applied for load in self.hooks.point_loads),
            time,
        )

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
        for robot, own, history, prescribed in zip(
            self.robots, forces, state.friction, state.prescribed, strict=True
        ):
            robot.forces, robot.state, robot.prescribed = own, history, prescribed
            robot.base_tension = own.base_tension
        for item, load in zip(self.hooks.point_loads, state.loads, strict=True):
            item.applied = load
        self.layout.space.write(state.configuration, initial=True)

    def connect(self) -> None:
        """Let Exudyn's items apply the forces of the stored state again, for Exudyn's own solvers and for drawing."""
        for robot in self.robots:
            robot.apply(robot.current_forces())

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
            measured, history = state.configuration.measured[i], state.friction[i]
            tension, mobilisation = state.base_tension[i], state.mobilisation[i]
            found.append(robot.model.at_mobilisation(measured, tension, mobilisation, history, time))
        return tuple(found)

    def residual(
        self, state: SolverState, target: Target, numbering: Numbering, iteration: int = 0
    ) -> Residual:
        """Residual of a state under a target.

        Parameters
        ----------
        state
            Written into the scene.
        target
            Inputs and time; loads are those already in the scene.
        numbering
            Of the unknowns.
        iteration
            Number of the iteration, passed to the user's ``PreNewtonResidual`` function.
        """
        layout = self.layout
        layout.space.write(state.configuration)
        user = self.hooks.user_function("PreNewtonResidual")
        if user is not None:
            user(self.mbs, target.time, iteration, 0)
        forces = self.forces(state, target.time)
        for robot in self.robots:
            robot.disconnect()
        self._kernel.ComputeNewtonResidual(self.mbs, self._settings)
        raw = self._kernel.GetSystemResidual()
        unbalanced = layout.reduction.residual(raw, state.configuration.frames)
        for nodes, own in zip(layout.space.slices, forces, strict=True):
            unbalanced[6 * nodes.start : 6 * nodes.stop] += own.nodal_wrenches().reshape(-1)
        on_bases = []
        for base in layout.clamped:
            on_bases.append(unbalanced[base].copy())
            unbalanced[base] = 0.0
        size = layout.scales.relative_residual(unbalanced, state.base_tension, target.load_size)
        for part in numbering.robots:
            if part.driven.size:
                own, displacement = forces[part.robot], target.inputs[part.robot]
                size = max(size, layout.scales.displacement_error(own, displacement, part.driven))
        return Residual(state, target, forces, unbalanced, tuple(on_bases), raw, size)

    def scene_tangent(self, residual: Residual) -> SceneTangent:
        """Exudyn's Jacobian: everything but the forces of the tendons and inside the sections.

        Parameters
        ----------
        residual
            The last one evaluated, whose state is in the scene.
        """
        kernel, layout, frames = self._kernel, self.layout, residual.state.configuration.frames
        kernel.ComputeJacobianODE2RHS(self.mbs, computeLoadsJacobian=int(layout.loads_jacobian))
        if len(layout.reduction.other_multipliers):
            kernel.ComputeJacobianAE(self.mbs)
        j = kernel.GetSystemJacobian()
        extra = self.hooks.user_jacobian(residual.target.time)
        if extra is not None:
            j[: extra.shape[0], : extra.shape[1]] += extra
        # Contact and the user's additions may couple further nodes.
        changing = extra is not None or self.mbs.NumberOfGeneralContacts() > 0
        return layout.reduction.tangent(j, frames, search_couplings=changing)

    def _knows_tangent(self) -> bool:
        """Whether the tangent follows from the elements' stiffness alone, without Exudyn's Jacobian."""
        return (
            self.layout.robots_only
            and self.mbs.NumberOfGeneralContacts() == 0
            and self.hooks.user_function("SystemJacobian") is None
        )

    def _elastic_tangent(self, residual: Residual) -> SceneTangent:
        """The same as `_unbalanced_tangent` where nothing but robots is in the scene; in the elements' twists."""
        configuration, layout = residual.state.configuration, self.layout
        tangent = layout.reduction.empty_tangent()
        for i, nodes in enumerate(layout.space.slices):
            wrenches = residual.unbalanced[6 * nodes.start : 6 * nodes.stop]
            mesh, chain = self.robots[i].mesh, configuration.chains[i]
            tangent.add(
                tangent.pattern.robots[i].backbone, chain.tangent(mesh, wrenches, *configuration.poses[i])
            )
        return tangent

    def _unbalanced_tangent(self, residual: Residual) -> SceneTangent:
        """Exudyn's Jacobian with the geometric terms of unbalanced wrenches."""
        configuration, tangent = residual.state.configuration, self.scene_tangent(residual)
        for i, nodes in enumerate(self.layout.space.slices):
            wrenches = residual.unbalanced[6 * nodes.start : 6 * nodes.stop]
            terms = configuration.chains[i].unbalanced_terms(wrenches, *configuration.poses[i])
            tangent.add(tangent.pattern.robots[i].backbone, terms)
        return tangent

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
        tangent = self.scene_tangent(residual)
        self._add_geometric_stiffness(tangent, residual)
        k = tangent.dense(self.layout.reduction.count)
        self._add_couplings(k, residual)
        return k

    def _add_geometric_stiffness(self, tangent: SceneTangent, residual: Residual) -> None:
        for own, robot, rows in zip(residual.forces, self.robots, tangent.pattern.robots, strict=True):
            if robot.geometry is not None:
                tangent.add(rows.holes, own.geometric_stiffness())

    def _add_couplings(self, k: Array, residual: Residual) -> None:
        for own, robot, nodes in zip(residual.forces, self.robots, self.layout.space.slices, strict=True):
            if robot.count or robot.section is not None:
                inside = slice(6 * nodes.start, 6 * nodes.stop)
                own.add_coupling(k[inside, inside])

    def linearize(
        self,
        residual: Residual,
        numbering: Numbering,
        damping: float = 0.0,
    ) -> Linearization:
        """Linearise equilibrium, with the tensions of tendons with prescribed displacement as further unknowns.

        Parameters
        ----------
        residual
            The last one evaluated, whose state is in the scene.
        numbering
            Of the unknowns.
        damping
            Of the nodes, for pseudo-transient continuation [N m].

        Raises
        ------
        numpy.linalg.LinAlgError
            The tangent is singular.
        """
        layout = self.layout
        tangent = (
            self._elastic_tangent(residual) if self._knows_tangent() else self._unbalanced_tangent(residual)
        )
        self._add_geometric_stiffness(tangent, residual)
        k = tangent.dense(numbering.linear)
        self._add_couplings(k, residual)
        slack = self._add_driven(k, residual, numbering) if numbering.any_driven else ()
        if damping > 0.0:
            # Exudyn's Jacobian is that of the right-hand side: minus the stiffness.
            nodes6 = np.arange(6 * layout.reduction.nodes)
            k[nodes6, nodes6] -= damping * np.tile(
                np.repeat((1.0 / self.length**2, 1.0), 3), layout.reduction.nodes
            )
        for base in layout.clamped:
            rows = k[base]
            rows.fill(0.0)
            rows[:, base] = _EYE6
        return Linearization(Factorisation.of(k), residual.state.configuration.chains, slack, numbering)

    def _add_driven(
        self, k: Array, residual: Residual, numbering: Numbering
    ) -> tuple[NDArray[np.bool_], ...]:
        """Rows and columns of tensions whose tendons have prescribed displacements; which of these are slack."""
        found = self.slack_tendons(residual, numbering)
        for part in numbering.robots:
            which, own, slack = part.driven, residual.forces[part.robot], found[part.robot]
            if not which.size:
                continue
            k[part.nodes, part.tensions] = own.base_tension_columns()[:, which]
            rows = own.base_slip_rows()[which]
            rows[slack] = 0.0
            k[part.tensions, part.nodes] = rows
            k[part.tensions, part.tensions] = np.diag(np.where(slack, 1.0, own.base_slip_by_base()[which]))
        return found

    def slack_tendons(self, residual: Residual, numbering: Numbering) -> tuple[NDArray[np.bool_], ...]:
        """By robot, which of the tendons with prescribed displacement are slack."""
        found = []
        stiffness = 10.0 * self.layout.scales.elastic_force / self.length
        for part in numbering.robots:
            which, own = part.driven, residual.forces[part.robot]
            gap = (own.field.base_slip - residual.target.inputs[part.robot])[which]
            # A tendon is taut where its tension, or else its displacement deficit, is positive.
            found.append(own.base_tension[which] - gap * stiffness <= 0.0)
        return tuple(found)

    # ------------------------------------------------------------------ clamps

    def clamps_are_closed(self, residual: Residual) -> bool:
        """Whether the joints of clamped bases are closed."""
        n2, clamps = self.layout.reduction.n2, self.layout.clamps.values()
        gap = max((float(np.abs(residual.raw[n2 + joint]).max()) for joint in clamps), default=0.0)
        return gap <= 1e-9 * self.length

    def release_clamps(self) -> None:
        """Treat clamped bases as any other joint from now on, because their supports have been moved."""
        self.layout = SceneLayout.of(self.mbs, self.robots, with_clamps=False)
        self._reactions = self._couplings_and_reactions()

    def _couplings_and_reactions(self) -> dict[int, Array]:
        """Search for further couplings between nodes, and compute the influence of the clamps' multipliers.

        Returns
        -------
        dict
            By clamped robot, from the wrench on its base to the joint's multipliers that cause it, shape (6, 6).
        """
        layout = self.layout
        configuration = layout.space.from_scene()
        layout.space.write(configuration)
        self._kernel.ComputeJacobianODE2RHS(self.mbs)
        self._kernel.ComputeJacobianAE(self.mbs)
        j = self._kernel.GetSystemJacobian()
        layout.reduction.tangent(j, configuration.frames, search_couplings=True)
        found = {}
        for i, joint in layout.clamps.items():
            node = layout.space.slices[i].start
            rows = layout.reduction.node_rows(j, configuration.frames, node, joint)
            found[i] = np.asarray(np.linalg.inv(rows), dtype=float)
        return found

    def with_base_reactions(self, residual: Residual) -> Configuration:
        """The configuration of a state in equilibrium with the reactions of its clamps."""
        configuration = residual.state.configuration
        if not self.layout.clamps:
            return configuration
        old = configuration.unknowns
        multipliers = old.multipliers.copy()
        for (i, joint), acting in zip(self.layout.clamps.items(), residual.on_bases, strict=True):
            multipliers[joint] -= self._reactions[i] @ acting
        unknowns = Unknowns(old.coordinates, multipliers, old.twists, old.bases)
        return configuration._replace(unknowns=unknowns)


def _static_kernel(mbs: exu.MainSystem, hooks: SceneHooks, settings: exu.SimulationSettings) -> Any:
    """Exudyn's static solver, ready to evaluate residual and Jacobian; the scene stays as it is."""
    kernel, data = exu.MainSolverStatic(), mbs.systemData
    start = np.array(data.GetODE2Coordinates())
    multipliers = np.array(data.GetAECoordinates())
    # Exudyn's advice on large systems is about its own solvers.
    warned = exu.config.suppressWarnings
    exu.config.suppressWarnings = True
    try:
        with hooks.without_post_step():
            ready = kernel.InitializeSolver(mbs, settings)
    finally:
        exu.config.suppressWarnings = warned
    if not ready:
        raise RuntimeError("Exudyn could not initialise its static solver for this system")
    data.SetODE2Coordinates(start)
    if multipliers.size:
        data.SetAECoordinates(multipliers)
    return kernel


def _clamps(mbs: exu.MainSystem, robots: Sequence[TendonActuation]) -> dict[int, NDArray[np.int_]]:
    """By robot whose base is clamped to ground, the numbers of the joint's multipliers."""
    found = {}
    for i, robot in enumerate(robots):
        if robot.clamp is None:
            continue
        joint = mbs.GetObject(robot.clamp.joint)
        if joint["activeConnector"] and all(joint["constrainedAxes"]) and not joint["offsetUserFunction"]:
            found[i] = np.array(mbs.systemData.GetObjectLTGAE(robot.clamp.joint), dtype=int)
    return found


def _rows_of_nodes(robots: Sequence[TendonActuation]) -> list[RobotNodes]:
    """Of every robot, the numbers of its nodes and of those with holes, among the nodes of all robots."""
    found, first = [], 0
    for robot in robots:
        every = first + np.arange(len(robot.nodes))
        found.append(RobotNodes(every, every[robot.model.cable_nodes]))
        first += len(every)
    return found


def _nothing_but_robots(mbs: exu.MainSystem, robots: Sequence[TendonActuation]) -> bool:
    """Whether no other object has coordinates, and the beams have the stiffness of the robots' meshes."""
    data = mbs.systemData
    own = {i for robot in robots for i in robot.connectors.object_numbers}
    if any(len(data.GetObjectLTGODE2(i)) for i in range(data.NumberOfObjects()) if i not in own):
        return False
    for robot in robots:
        for beam, expected in zip(robot.connectors.beams, robot.mesh.stiffness, strict=True):
            present = mbs.GetObjectParameter(beam, "sectionData").stiffnessMatrix
            if not np.array_equal(present, np.diag(expected)):
                return False
    return True


def _turns(load: dict[str, Any]) -> bool:
    """Whether a load of Exudyn changes with the configuration of the node it acts on."""
    return load["loadType"] != "MassProportional" and not (
        load["loadType"] == "ForceVector" and not load["bodyFixed"]
    )

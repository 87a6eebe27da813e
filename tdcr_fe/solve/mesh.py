"""Automatic mesh: the error of the steps of a run, finer meshes where it is too large, and warnings."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from tdcr_fe.model.loading import Model
from tdcr_fe.model.messages import steps_named
from tdcr_fe.scene import TDCR
from tdcr_fe.solve.element_equations import ElementModel
from tdcr_fe.solve.equations.state import SolverState, StoredState
from tdcr_fe.solve.mesh_error import MeshEstimate, SolvedState, estimate
from tdcr_fe.solve.simulation import Simulation

Array = NDArray[np.float64]

#: Solved states that are estimated at once.
CHUNK = 8
#: Limits of automatic refinement: elements of one bay, elements of a robot, and meshes tried.
MOST_PER_BAY, MOST_ELEMENTS, MOST_MESHES = 32, 320, 6
#: Largest growth of a bay's number of elements from one mesh to the next.
GROWTH = 4
#: Fraction of its buckling load above which a bay causes a warning [1].
NEAR_BUCKLING = 0.5


class MeshMonitor:
    """Estimates of the steps of one run, several at once.

    Parameters
    ----------
    simulation
        The run.
    goal
        Error above which the contribution of each bay is computed as well [m].
    """

    def __init__(self, simulation: Simulation, goal: float) -> None:
        self._simulation, self._handle, self._goal = simulation, simulation.handle, goal
        self._model = ElementModel.of(self._handle)
        self._compliance = self._handle.compliance_factor
        self._waiting: list[SolvedState] = []
        #: Estimates so far, one per step, without those of pending states.
        self.estimates: list[MeshEstimate] = []

    def record(self) -> bool:
        """Add the present state to the pending ones; return whether new estimates have been computed."""
        changed = self._handle.compliance_factor != self._compliance
        if changed:
            self.flush()
            self._compliance = self._handle.compliance_factor
            self._model = ElementModel.of(self._handle)
        self._waiting.append(SolvedState.of(self._simulation))
        if len(self._waiting) < CHUNK:
            return changed
        self.flush()
        return True

    def flush(self) -> None:
        """Estimate the pending states."""
        self.estimates += estimate(self._model, self._waiting, self._goal)
        self._waiting = []


def error_order(handle: TDCR) -> int:
    """Order of the error of the mesh: 4 for straight tendons on an elastic backbone without weight, else 2."""
    heavy = handle.robot.backbone.density > 0.0 and any(handle.model.gravity)
    return 2 if heavy or handle.actuation.section is not None else 4


def refined(
    counts: Sequence[int], estimates: Sequence[MeshEstimate], goal: float, order: int
) -> tuple[int, ...]:
    """Elements per bay with which the error should stay below a goal, and the number of elements be smallest.

    With the error ``c_b (n_b / n'_b)^p`` of bay b, the smallest sum of ``n'_b`` has ``n'_b`` in proportion to
    ``(c_b n_b^p)^(1/(p+1))``. Where an estimate is infinite, its bay gets as many elements as one refinement allows.

    Parameters
    ----------
    counts
        Elements per bay of the present mesh, shape (B,).
    estimates
        Of its steps.
    goal
        Error to stay below [m].
    order
        Order p of the error.
    """
    n = np.asarray(counts, dtype=float)
    worst = np.zeros(len(n))
    for found in estimates:
        if found.by_bay is not None:
            worst[: len(found.by_bay)] = np.maximum(worst[: len(found.by_bay)], found.by_bay)
    if not worst.any():
        return tuple(counts)
    most = np.minimum(GROWTH * n, max(MOST_PER_BAY, *n.tolist()))
    known = np.isfinite(worst)
    scaled = np.where(known, worst, 0.0) * n**order
    root = scaled ** (1.0 / (order + 1))
    factor = (root.sum() / (0.5 * goal)) ** (1.0 / order)
    wanted = np.where(known, np.clip(np.ceil(factor * root), n, most), most)
    total = wanted.sum()
    if total > MOST_ELEMENTS:
        wanted = np.maximum(n, np.floor(wanted * MOST_ELEMENTS / total))
    return tuple(int(x) for x in wanted)


def on_mesh(state: StoredState, old: Array, new: Array, there: SolverState) -> StoredState:
    """A state of a robot alone in its scene on another mesh, with the same strains.

    Parameters
    ----------
    state
        On the old mesh.
    old, new
        Arc lengths of the nodes of both [m].
    there
        Any state on the new mesh.
    """
    before, unknowns = state.unknowns.twists[0], there.configuration.unknowns
    # The sum of the twists from the base on is linear in the arc length within each element.
    summed = np.concatenate((np.zeros((1, 6)), before.cumsum(axis=0)))
    twists = np.diff(np.stack([np.interp(new, old, column) for column in summed.T], axis=1), axis=0)
    moved = unknowns._replace(twists=(twists,), bases=state.unknowns.bases)
    return replace(state, unknowns=moved)


def mesh_warnings(
    handle: TDCR, model: Model, estimates: Sequence[MeshEstimate], tolerance: float
) -> list[str]:
    """Sentences on steps whose error is larger than the tolerance, and on bays near their buckling load.

    Parameters
    ----------
    handle
        The robot.
    model
        As the user gave it.
    estimates
        One per step.
    tolerance
        ``mesh_tolerance`` of the settings [1].
    """
    found = []
    length = float(handle.mesh.arc_lengths[-1])
    errors = [e.largest / length for e in estimates]
    coarse = [k for k, e in enumerate(errors, start=1) if not e <= tolerance]
    if coarse:
        worst = max(coarse, key=lambda k: errors[k - 1])
        cure = (
            "automatic refinement has reached its limit; the state is likely near a buckling load"
            if model.elements_per_bay == "auto"
            else 'use elements_per_bay = "auto" or a larger number'
        )
        found.append(
            f"{steps_named(coarse)}: the mesh is too coarse; the estimated discretisation error is up to "
            f"{errors[worst - 1]:.1e} of the length (step {worst}), more than mesh_tolerance = {tolerance:g}; {cure}"
        )
    near = [k for k, e in enumerate(estimates, start=1) if e.bay_loads.max() >= NEAR_BUCKLING]
    if near:
        worst = max(near, key=lambda k: estimates[k - 1].bay_loads.max())
        bay = int(np.argmax(estimates[worst - 1].bay_loads))
        edges = np.concatenate(([0.0], handle.robot.bay_ends, [length]))
        found.append(
            f"{steps_named(near)}: bay {bay + 1} ({edges[bay]:g} to {edges[bay + 1]:g} m) is near or beyond its "
            f"buckling load: axial compression {estimates[worst - 1].bay_loads[bay]:.2f} times pi^2 EI / a^2 in step "
            f"{worst}. The solution is sensitive to small changes there, and more than one may exist"
        )
    return found

"""The run of one experiment: its path, its derivatives by parameters, and the readings that it predicts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from tdcr_fe.effects import Experiment
from tdcr_fe.elements import Array, Flags, Index
from tdcr_fe.identify.bay_state import Acted, BayState
from tdcr_fe.io.readings import Reading
from tdcr_fe.model.channels import Channel, Location, by_differences, channel
from tdcr_fe.model.observed_step import Observables, ObservedChange, ObservedStep
from tdcr_fe.model.results import StepResult
from tdcr_fe.scene.mesh import build_mesh

if TYPE_CHECKING:
    from tdcr_fe.model.results import Sensitivities, Sensitivity
    from tdcr_fe.solve.load_steps.load_path import Increment
    from tdcr_fe.solve.simulate import PathRecord

#: For every step, the commanded step it belongs to and its load factor at the end, as in `Experiment.ends`.
Ends = tuple[tuple[int, float], ...]


@dataclass(frozen=True)
class Trajectory:
    """Path of a run, as reference path for neighbouring runs."""

    waypoints: PathRecord  # by step, see `tdcr_fe.solve.simulate.PathRecord`
    ends: Ends  # of its steps
    s: Array  # arc lengths of the nodes [m], shape (n,)

    def divided(self, ends: Ends) -> PathRecord:
        """The path for the same commanded steps, divided in another way."""
        if self.ends == ends:
            return self.waypoints
        increments: list[Increment] = []
        places: list[float] = []  # of their ends: number of the commanded step and its load factor
        for part, (begin, end) in zip(self.waypoints, _spans(self.ends), strict=True):
            increments += part
            places += [begin + (end - begin) * x.load_factor for x in part]
        divided = []
        for begin, end in _spans(ends):
            first, last = np.searchsorted(places, (begin + 1e-9, end - 1e-9)).tolist()
            some = zip(increments[first:last], places[first:last], strict=True)
            inside = [replace(x, load_factor=(at - begin) / (end - begin)) for x, at in some]
            divided.append([*inside, replace(increments[last], load_factor=1.0)])
        return divided

    def on_mesh(self, s: Array) -> Trajectory:
        """The same path on another mesh: the same increments, with the twist of the backbone divided otherwise.

        Two runs on it differ by the error of the mesh alone, since both take the same substeps. A backbone of another
        length has the same twist in the same share of it.

        Parameters
        ----------
        s
            Arc lengths of the nodes of the other mesh [m], shape (k,).
        """
        if np.array_equal(self.s, s):
            return self
        own = self.s * (s[-1] / self.s[-1])
        moved = [[replace(x, state=x.state.on_mesh(own, s)) for x in part] for part in self.waypoints]
        return replace(self, waypoints=moved, s=s)


def _spans(ends: Ends) -> list[tuple[float, float]]:
    """Where every step begins and ends, in numbers of commanded steps."""
    stops = [k + factor for k, factor in ends]
    return [(max(begin, k), end) for begin, end, (k, _) in zip((0.0, *stops[:-1]), stops, ends, strict=True)]


def mesh_nodes(experiment: Experiment) -> Array:
    """Arc lengths of the nodes of an experiment [m], shape (n,)."""
    loads = {load.at for step in experiment.steps for load in step.loads.values()}
    mesh, _ = build_mesh(experiment.robot, experiment.model, sorted(loads))
    return np.asarray(mesh.arc_lengths)


#: Fields of `Run` and `RunDerivatives` with one entry for every step, in their order.
_BY_STEP = ("positions", "rotations", "curvature_rates", "displacements", "base_tensions", "distal_tensions")


@dataclass(frozen=True, eq=False)
class RunDerivatives(Observables):
    """Derivatives of a run by parameters, which are the last axis: see `ObservedChange`; steps are the first one.

    Of the arc lengths, which are alike in all steps: shape (n, P).
    """

    names: tuple[str, ...]  # of the parameters
    # parameters asked for by which there is no derivative, with the reason
    refused: Mapping[str, str] = field(default_factory=dict)

    @classmethod
    def of(cls, found: Sensitivities, last: Sequence[int], refused: Mapping[str, str]) -> RunDerivatives:
        """Derivatives in the steps with these positions in the sequence."""
        every = list(found.values())

        def stacked(values: list[Array]) -> Array:
            return np.stack(values, axis=-1)[last] if values else np.zeros((len(last), 0))

        def distal(by: Sensitivity) -> Array:
            return np.array([t[:, -1] for t in by.tensions]).T.reshape(by.displacements.shape)

        tables = {name: stacked([getattr(x, name) for x in every]) for name in _BY_STEP[:-1]}
        tables["distal_tensions"] = stacked([distal(x) for x in every])
        lengths = np.stack([x.arc_lengths for x in every], axis=1) if every else np.zeros((0, 0))
        return cls(**tables, s=lengths, names=tuple(found), refused=refused)

    def part(self, which: Sequence[int]) -> RunDerivatives:
        """By some of the parameters."""
        tables = {n: getattr(self, n)[..., list(which)] for n in ("s", *_BY_STEP)}
        return replace(self, **tables, names=tuple(self.names[j] for j in which))

    def times(self, matrices: Array) -> RunDerivatives:
        """By combinations of the parameters, the same or another one in every step, shape (n_steps or 1, P, q)."""
        tables = {n: np.einsum("k...p,kpq->k...q", getattr(self, n), matrices) for n in _BY_STEP}
        count = matrices.shape[2]
        return replace(self, **tables, s=np.zeros((len(self.s), count)), names=("",) * count)


@dataclass(frozen=True, eq=False)
class Run(Observables):
    """Results of a simulation that predictions need; without steps if not solved.

    Arc lengths are alike in all steps: shape (n,).
    """

    message: str = ""  # why it is not solved
    # reference path for neighbouring runs; None where none was recorded
    trajectories: Trajectory | None = None
    derivatives: RunDerivatives | None = None  # by the parameters of the job
    bays: BayState | None = None  # none where it is not solved
    acted: Acted | None = None  # action that it carries, with the response there

    @classmethod
    def of(cls, steps: Sequence[StepResult]) -> Run:
        """The run of the commanded steps of an experiment, as they were solved."""
        distal = np.array([[t[-1] for t in r.tensions] for r in steps])
        tables: dict[str, Any] = {n: np.array([getattr(r, n) for r in steps]) for n in _BY_STEP[:-1]}
        return cls(steps[0].s, **tables, distal_tensions=distal.reshape(len(steps), -1))

    @classmethod
    def unsolved(cls, message: str) -> Run:
        """The run of an experiment that is not solved to its end."""
        nothing, positions, rotations = np.zeros((0, 0)), np.zeros((0, 0, 3)), np.zeros((0, 0, 3, 3))
        return cls(np.zeros(0), positions, rotations, nothing, nothing, nothing, message)

    @property
    def solved(self) -> bool:
        """Whether all steps are solved."""
        return len(self.positions) > 0

    def moved(self, change: RunDerivatives) -> Run:
        """The run with a change added, to first order: derivatives by one parameter."""
        turned = Rotation.from_rotvec(change.rotations.reshape(-1, 3)).as_matrix()
        tables = {n: getattr(self, n) + getattr(change, n)[..., 0] for n in _BY_STEP if n != "rotations"}
        return replace(self, **tables, rotations=turned.reshape(self.rotations.shape) @ self.rotations)


@dataclass(frozen=True, eq=False)
class Readings:
    """Readings as arrays, in their order; and their predictions from a run, by `tdcr_fe.model.channels`."""

    values: Array  # in the unit of each, shape (n,)
    quantities: NDArray[np.str_]  # shape (n,)
    locations: tuple[Location, ...]
    step: Index  # positions of their load steps in the sequence, shape (n,)
    # shape (n,)
    is_position: Flags
    is_angle: Flags
    axes: Index  # of a coordinate, its axis; -1 of other quantities, shape (n,)
    markers: Index  # which marker in which step a reading belongs to, shape (n,)
    tendon_names: tuple[str, ...]
    of_curvature: bool  # whether any is

    @classmethod
    def of(cls, readings: Sequence[Reading], step_ids: Sequence[int], tendons: Sequence[str]) -> Readings:
        """Readings in steps with these numbers, in order, as arrays; ``tendons``: names of the robot's tendons."""
        index = {n: i for i, n in enumerate(step_ids)}
        places: dict[tuple[int, Location], int] = {}
        markers = [places.setdefault((r.step, r.location), len(places)) for r in readings]
        positions = [r.channel.family == "position" for r in readings]
        each = zip(readings, positions, strict=True)
        return cls(
            values=np.array([r.value for r in readings]),
            quantities=np.array([r.quantity for r in readings]),
            locations=tuple(r.location for r in readings),
            step=np.array([index[r.step] for r in readings], dtype=int),
            is_position=np.array(positions),
            is_angle=np.array([r.unit == "rad" for r in readings]),
            axes=np.array(["xyz".index(r.quantity[-1]) if is_position else -1 for r, is_position in each]),
            markers=np.array(markers),
            tendon_names=tuple(tendons),
            of_curvature=any(r.channel.family == "curvature" for r in readings),
        )

    @cached_property
    def _groups(self) -> list[tuple[Channel, Index, list[Location]]]:
        """By channel: which readings, and their locations."""
        groups = []
        for quantity in dict.fromkeys(self.quantities.tolist()):
            which = np.flatnonzero(self.quantities == quantity)
            groups.append((channel(quantity), which, [self.locations[i] for i in which]))
        return groups

    def _observed(self, run: Run, experiment: Experiment, step: int | None = None) -> ObservedStep:
        """What is observed of one of a run's steps, from 0; None: of all of them."""
        steps = slice(None) if step is None else step
        s = np.broadcast_to(run.s, run.positions.shape[:2])[steps]
        tables = {n: getattr(run, n)[steps] for n in _BY_STEP if n != "curvature_rates" or self.of_curvature}
        return ObservedStep(s, **tables, tendon_names=self.tendon_names, observation=experiment.observation)

    def read(self, run: Run, experiment: Experiment) -> Array:
        """What would be read, in the readings' units, shape (n,); NaN where the run is not solved.

        Parameters
        ----------
        run
            The run of the experiment's robot, model and steps.
        experiment
            Whose observation map is used.
        """
        out = np.full(len(self.values), np.nan)
        if not run.solved:
            return out
        observed = self._observed(run, experiment)
        for known, which, locations in self._groups:
            places = list(dict.fromkeys(locations))
            column = [places.index(x) for x in locations]
            out[which] = known.predict(observed, places)[self.step[which], column]
        return out

    def derivatives(self, run: Run, experiment: Experiment) -> Array:
        """Derivatives of what would be read by the parameters of a solved run, shape (n, P).

        Parameters
        ----------
        run
            With derivatives.
        experiment
            Whose observation map is used.
        """
        by = run.derivatives
        assert by is not None
        out = np.full((len(self.values), len(by.names)), np.nan)
        for k in np.unique(self.step).tolist():
            change = ObservedChange(s=by.s, **{n: getattr(by, n)[k] for n in _BY_STEP})
            observed = self._observed(run, experiment, k)
            h = change.difference_steps(observed)
            moved = observed.moved(change, h)
            for known, which, locations in self._groups:
                mine = np.flatnonzero(self.step[which] == k)
                if mine.size:
                    out[which[mine]] = by_differences(known.predict(moved, [locations[i] for i in mine]), h)
        return out

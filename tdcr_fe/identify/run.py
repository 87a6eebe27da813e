"""The run of one experiment: what predictions need of it, and its derivatives by parameters."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from tdcr_fe.effects import Experiment
from tdcr_fe.identify.trajectory import Trajectory
from tdcr_fe.model.results import StepResult

if TYPE_CHECKING:
    from tdcr_fe.model.sensitivities import Sensitivities

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class RunDerivatives:
    """Derivatives of a run by parameters, which are the last axis; NaN for steps that were not solved.

    Attributes
    ----------
    positions, rotations : ndarray, shape (n_steps, n, 3, P)
        As in `tdcr_fe.model.sensitivities.Sensitivity`.
    displacements, distal_tensions : ndarray, shape (n_steps, n_tendons, P)
    arc_lengths : ndarray, shape (n, P)
        Of the nodes.
    names : tuple of str
        Of the parameters.
    refused : mapping of str to str
        Parameters asked for by which there is no derivative, with the reason.
    """

    positions: Array
    rotations: Array
    displacements: Array
    distal_tensions: Array
    arc_lengths: Array
    names: tuple[str, ...]
    refused: Mapping[str, str] = field(default_factory=dict)

    @classmethod
    def of(
        cls, found: Sensitivities, last: Sequence[int], count: int, refused: Mapping[str, str]
    ) -> RunDerivatives:
        """Of the solved steps with these positions in the sequence."""
        every = list(found.values())

        def fill(values: list[Array]) -> Array:
            if not values:
                return np.zeros((count, 0))
            stacked = np.stack([v[last] for v in values], axis=-1)
            return np.concatenate((stacked, np.full((count - len(last), *stacked.shape[1:]), np.nan)))

        return cls(
            fill([x.positions for x in every]),
            fill([x.rotations for x in every]),
            fill([x.displacements for x in every]),
            fill([np.stack([t[:, -1] for t in x.tensions], axis=1) for x in every]),
            np.stack([x.arc_lengths for x in every], axis=1) if every else np.zeros((0, 0)),
            tuple(found),
            refused,
        )

    @classmethod
    def joined(cls, parts: Sequence[RunDerivatives]) -> RunDerivatives:
        """Of several loading sequences, one after another, by the parameters by which all are differentiated."""
        refused = {name: why for part in parts for name, why in part.refused.items()}
        names = tuple(n for n in parts[0].names if all(n in part.names for part in parts))

        def chosen(part: RunDerivatives, values: Array) -> Array:
            return np.asarray(values[..., [part.names.index(n) for n in names]])

        tables: dict[str, Any] = {
            field: np.concatenate([chosen(part, getattr(part, field)) for part in parts])
            for field in ("positions", "rotations", "displacements", "distal_tensions")
        }
        lengths = chosen(parts[0], parts[0].arc_lengths)
        return cls(**tables, arc_lengths=lengths, names=names, refused=refused)


#: Fields of `Run` with one entry for every step.
_BY_STEP = ("positions", "rotations", "displacements", "base_tensions", "distal_tensions")


def _nothing(values: Array, steps: int) -> Array:
    """NaN in the shape of a field, for so many steps."""
    return np.full((steps, *values.shape[1:]), np.nan)


def _padded(values: Array, steps: int) -> Array:
    """One value for each of so many steps, zero where there is none."""
    return np.concatenate((values[:steps], np.zeros(max(0, steps - len(values)))))


@dataclass(frozen=True)
class Run:
    """Results of one simulated loading sequence that predictions need.

    Attributes
    ----------
    s : ndarray, shape (n,)
        Arc lengths of the nodes [m].
    positions : ndarray, shape (n_steps, n, 3)
        [m].
    rotations : ndarray, shape (n_steps, n, 3, 3)
    displacements, base_tensions, distal_tensions : ndarray, shape (n_steps, n_tendons)
        [m, N, N].
    solved : int
        Number of steps solved, from the first on; the others are NaN.
    message : str
        Why it ended.
    trajectory : Trajectory or None
        Reference path for neighbouring runs; None where none was recorded.
    derivatives : RunDerivatives or None
        By the parameters of the task.
    refinement_errors : ndarray, shape (n_steps,)
        By commanded step, what is left of its path dependence over the length where the solver could not resolve it,
        else zero [1].
    iterations : int
        Newton iterations that it took.
    """

    s: Array
    positions: Array
    rotations: Array
    displacements: Array
    base_tensions: Array
    distal_tensions: Array
    solved: int
    message: str
    trajectory: Trajectory | None = None
    derivatives: RunDerivatives | None = None
    refinement_errors: Array = field(default_factory=lambda: np.zeros(0))
    iterations: int = 0

    @classmethod
    def of(cls, steps: Sequence[StepResult], count: int, experiment: Experiment, message: str) -> Run:
        """Of the solved steps of an experiment; the others, up to ``count``, are NaN."""
        m = len(experiment.robot.tendons)
        s = steps[0].s if steps else np.array([0.0, experiment.robot.backbone.length])

        def fill(values: list[Array], shape: tuple[int, ...]) -> Array:
            full = np.full((count, *shape), np.nan)
            if values:
                full[: len(values)] = np.array(values)
            return full

        return cls(
            s,
            fill([r.positions for r in steps], (s.size, 3)),
            fill([r.rotations for r in steps], (s.size, 3, 3)),
            fill([r.displacements for r in steps], (m,)),
            fill([r.base_tensions for r in steps], (m,)),
            fill([np.array([t[-1] for t in r.tensions]) for r in steps], (m,)),
            len(steps),
            message,
        )

    @classmethod
    def joined(cls, runs: Sequence[Run], lengths: Sequence[int]) -> Run:
        """Several loading sequences with so many steps each, one after another; those that have no run are NaN."""
        full = list(runs)
        for length in lengths[len(runs) :]:
            empty: dict[str, Any] = {n: _nothing(getattr(runs[0], n), length) for n in _BY_STEP}
            full.append(replace(runs[0], **empty))
        nodes = max(full, key=lambda r: r.solved).s
        for i, (run, length) in enumerate(zip(full, lengths, strict=True)):
            if run.s.size != nodes.size:  # nothing was solved: the nodes are not known
                full[i] = cls.unsolved(nodes, length, run)
        solved = 0
        for run, length in zip(runs, lengths, strict=False):
            solved += run.solved
            if run.solved < length:
                break
        trajectories = [r.trajectory for r in runs if r.trajectory is not None]
        whole = len(trajectories) == len(lengths)
        derivatives = [r.derivatives for r in runs if r.derivatives is not None]
        tables: dict[str, Any] = {n: np.concatenate([getattr(r, n) for r in full]) for n in _BY_STEP}
        errors = [_padded(r.refinement_errors, n) for r, n in zip(full, lengths, strict=True)]
        return cls(
            s=nodes,
            **tables,
            solved=solved,
            message=runs[-1].message,
            trajectory=Trajectory.joined(trajectories, lengths) if whole else None,
            derivatives=RunDerivatives.joined(derivatives) if len(derivatives) == len(lengths) else None,
            refinement_errors=np.concatenate(errors),
            iterations=sum(r.iterations for r in runs),
        )

    @classmethod
    def unsolved(cls, nodes: Array, steps: int, like: Run) -> Run:
        """A run of so many steps, none of them solved."""
        m = like.displacements.shape[1]
        shapes = ((nodes.size, 3), (nodes.size, 3, 3), (m,), (m,), (m,))
        tables: dict[str, Any] = {
            n: np.full((steps, *shape), np.nan) for n, shape in zip(_BY_STEP, shapes, strict=True)
        }
        return cls(s=nodes, **tables, solved=0, message=like.message)

    @property
    def curvature(self) -> Array:
        """Of the elements, as turning rates about the section's axes x, y, z [1/m], shape (n_steps, n-1, 3)."""
        relative = np.swapaxes(self.rotations[:, :-1], -1, -2) @ self.rotations[:, 1:]
        n = relative.shape[0], relative.shape[1]
        ok = np.isfinite(relative).all(axis=(-1, -2)).ravel()
        turn = np.full((ok.size, 3), np.nan)
        turn[ok] = Rotation.from_matrix(relative.reshape(-1, 3, 3)[ok]).as_rotvec()
        return turn.reshape(*n, 3) / np.diff(self.s)[None, :, None]

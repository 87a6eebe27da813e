"""One frame: the load step from the state before it to given unknowns, what is read of it, and the most probable state.

The unknowns are force and moment of the load (6), its place, the errors of the inputs (m), the plastic slips of the
holes at the beginning of the frame (k), and the errors of parameters of the robot (q). Those that are known, such as a
moment that there is not, have no variance. Load steps are solved with the parameters as given, and their errors act to
first order.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.linalg import block_diag

from tdcr_fe.effects import Observation
from tdcr_fe.elements import Array, Index
from tdcr_fe.estimate.most_probable import PLAUSIBLE, Found, linear_start, most_probable, posterior_covariance
from tdcr_fe.estimate.response import (
    LEAST_INSIDE,
    Response,
    observed,
    plastic_slips,
    tensions_without_bounds,
    with_plastic_slips,
    within_bounds,
)
from tdcr_fe.estimate.uncertain import UncertainEffects
from tdcr_fe.io.readings import Reading
from tdcr_fe.model.channels import by_differences
from tdcr_fe.model.loading import Actuation, Load, SolverSettings, resolve
from tdcr_fe.model.messages import warnings_to
from tdcr_fe.model.observed_step import ObservedStep
from tdcr_fe.solve.equations.configuration import SolverState, StoredState
from tdcr_fe.solve.load_steps.load_path import Increment, LoadStepReport, Position, StepFailed
from tdcr_fe.solve.sensitivities.robot_model import ExplicitDerivatives
from tdcr_fe.solve.simulation import Simulation

#: The load and its place among the unknowns.
LOAD, PLACE = slice(0, 6), 6
#: Places along the body that are tried where that of the load is unknown, and most times that one is chosen anew.
PLACES, MOST_CHOICES = 100, 5
#: Width in which a tension goes over to zero, over its standard deviation [1]. With three tendons of which two are
#: slack, frames take half the time of those with a kink at zero, and of 24 none is unsolved for two.
SLACK = 0.2
#: Standard deviation of the tip, over the length, above which second order counts [1].
UNCERTAIN = 0.02
#: The readings are informative in a direction in which their variance is more than this many times that of their noise.
INFORMATIVE = 2.0


def name_at(place: float) -> str:
    """Name of the estimated load at an arc length [m]."""
    return f"estimated at s = {place:g} m"


@dataclass(frozen=True, eq=False)
class Problem:
    """The robot and where its load may act."""

    effects: UncertainEffects
    settings: SolverSettings
    observation: Observation
    # Arc lengths that may carry the load [m]; several, base plate left out, where it is unknown
    places: Sequence[float]
    input_sigmas: Array  # (m,): Standard deviations of the inputs

    @cached_property
    def simulation(self) -> Simulation:
        """With the effects at their present values."""
        own = self.effects.experiment
        return Simulation(own.robot, own.model, resolve(own.robot, own.steps), self.settings)

    @cached_property
    def loaded(self) -> Index:
        """Nodes that may carry the load."""
        return np.array([self.simulation.handle.mesh.node_at(s, 1e-6) for s in self.places])

    @cached_property
    def explicit(self) -> ExplicitDerivatives:
        """By the parameters whose errors are among the unknowns."""
        return self.effects.derivatives(self.simulation.handle)

    def with_effects(self, effects: UncertainEffects) -> Problem:
        """With effects at other values, without the warnings on these."""
        found = replace(self, effects=effects)
        with warnings_to():
            _ = found.explicit
        return found

    @property
    def s(self) -> Array:
        """Arc lengths of the nodes [m]."""
        return self.simulation.handle.arc_lengths

    @property
    def inputs(self) -> slice:
        """Errors of the inputs among the unknowns."""
        return slice(PLACE + 1, PLACE + 1 + len(self.input_sigmas))

    @property
    def history(self) -> slice:
        """The plastic slips among the unknowns."""
        frictional = self.simulation.handle.actuation.law.frictional
        return slice(self.inputs.stop, self.inputs.stop + int(frictional.sum()))

    @property
    def parameters(self) -> slice:
        """Errors of parameters among the unknowns."""
        return slice(self.history.stop, self.history.stop + len(self.effects.prior.names))

    def at_given_place(self, covariance: Array) -> tuple[Array, Array]:
        """Change of all unknowns with the place of the load [1/m], and their covariance at a given place."""
        variance = covariance[PLACE, PLACE]
        given = covariance[PLACE] / (variance or 1.0)  # where the place is known, nothing changes with it
        return given, covariance - variance * np.outer(given, given)

    def shares(self, place: float) -> tuple[Array, Array]:
        """Shares of the load on the nodes that may carry it, and their derivatives by its place [1, 1/m].

        Between two nodes both together carry the force, and for the body beyond them its moment. At a known place there
        is one, and the place has no variance.
        """
        nodes = np.concatenate(([0.0], self.places))
        k = int(np.clip(np.searchsorted(nodes, place), 1, len(nodes) - 1))
        before, after = np.eye(len(nodes))[k - 1 : k + 1]
        length = nodes[k] - nodes[k - 1]
        part = np.clip((place - nodes[k - 1]) / length, 0.0, 1.0)
        return ((1.0 - part) * before + part * after)[1:], ((after - before) / length)[1:]

    def acting(self, commands: Actuation, unknowns: Array) -> tuple[Array, Array]:
        """Inputs that act, and their derivatives by their errors, each of shape (m,).

        A tension is not negative. Where its error would make it so, it still depends on the error a little: otherwise
        the iteration would not leave a slack tendon.
        """
        scale, wound = commands.drives.scale, commands.by_displacement
        values = commands.values + scale * unknowns[self.inputs]
        root = np.hypot(values, SLACK * self.input_sigmas)
        tension = 0.5 * (values + root)
        return np.where(wound, values, tension), scale * np.where(wound, 1.0, tension / root)

    def actuation(self, commands: Actuation, unknowns: Array) -> Actuation:
        """Inputs and loads that act."""
        loads = dict(commands.loads)
        for at, share in zip(self.places, self.shares(unknowns[PLACE])[0], strict=True):
            load = share * unknowns[LOAD]
            loads[name_at(at)] = Load(at=at, force=tuple(load[:3]), moment=tuple(load[3:]))
        return replace(commands, values=self.acting(commands, unknowns)[0], loads=loads)


@dataclass(frozen=True, eq=False)
class Frame:
    """What is prescribed and read in a frame, and where the simulation is before it."""

    problem: Problem
    start: Position
    commands: Actuation
    readings: Sequence[Reading]
    substeps: int | None
    # (k, n_readings): What each direction that the readings do not show adds to them to second order, see `with_unseen`
    unseen: Array | None = None

    def with_unseen(self, base: Solved, compared: tuple[Array, Array], covariance: Array) -> Frame:
        """With what directions in which the tip stays uncertain add to the readings to second order.

        A single camera does not show a force along its axis, but that shortens the robot in its picture to either side.
        In a direction ``z`` with a variance of one that adds ``c z^2``: a mean of ``c`` and a noise of variance
        ``2 c c'`` (second-order filter; M. Athans et al., IEEE Trans. Automatic Control 13 (1968) 504-514).

        Parameters
        ----------
        base
            A state nearby.
        compared
            The readings, compared with it.
        covariance
            Covariance of the prior, shape (n, n).
        """
        residual, by_node = compared
        cross = posterior_covariance(covariance, by_node @ base.by_unknowns) @ base.response.positions[-1].T
        variances, directions = np.linalg.eigh(base.response.positions[-1] @ cross)
        found = []
        for k in np.flatnonzero(variances > (UNCERTAIN * self.problem.s[-1]) ** 2):
            change = cross @ directions[:, k] / math.sqrt(variances[k])
            ways = (base.frame.solved(base.unknowns + side * change, base) for side in (1.0, -1.0))
            ends = [end.compared(self.readings)[0] for end in ways if end is not None]
            if len(ends) == 2:
                found.append(residual - np.mean(ends, axis=0))
        return replace(self, unseen=np.array(found)) if found else self

    def weighted(self, residual: Array, jacobian: Array) -> tuple[Array, Array]:
        """Readings less their predictions, and derivatives, in units of all noise."""
        if self.unseen is None:
            return residual, jacobian
        root = np.linalg.cholesky(np.eye(len(residual)) + 2.0 * self.unseen.T @ self.unseen)
        return np.linalg.solve(root, residual - self.unseen.sum(axis=0)), np.linalg.solve(root, jacobian)

    @cached_property
    def reads_curvatures(self) -> bool:
        """Whether any reading is a curvature."""
        return any(r.channel.family == "curvature" for r in self.readings)

    def is_far_from(self, seen: ObservedStep) -> bool:
        """Whether a state does not explain the readings."""
        missed = [(r.value - r.channel.predict(seen, [r.location])[0]) / r.sigma for r in self.readings]
        return bool(np.dot(missed, missed) > PLAUSIBLE * len(missed))

    def most_probable(self, mean: Array, covariance: Array, last: Solved | None) -> Found[Solved] | None:
        """The most probable state from a prior; None where the first load step has no solution.

        ``last``: the state of the frame before, where it is a guide.
        """
        none, given, start = np.zeros(len(mean)), self, np.zeros(len(mean))
        if self.readings and (base := last or self.solved(mean)) is not None:
            compared = base.compared(self.readings)
            given = self.with_unseen(base, compared, covariance)
            start = base.start_of(given, compared, mean, covariance)
        attempts: list[tuple[Frame, Array, Solved | None]] = [(given, none, None)]
        if last is not None:
            # The last one takes long.
            attempts = [(given, start, last), *attempts, (replace(given, substeps=None), none, None)]
        for frame, begin, near in attempts:
            found = frame._found_from(mean, covariance, begin, near)
            if found is not None and found.converged:
                break
        return found

    def _found_from(
        self, mean: Array, covariance: Array, start: Array, near: Solved | None
    ) -> Found[Solved] | None:
        """As `most_probable`, from one ``v`` and a state nearby."""
        variance = covariance[PLACE, PLACE]
        if variance == 0.0 or not self.readings:
            return most_probable(self.solved, mean, covariance, start, near)
        # Among given places, each with all other unknowns conditional on it.
        given, held = self.problem.at_given_place(covariance)
        at, found, before = self.solved(mean + covariance @ start, near), None, np.inf
        for _ in range(MOST_CHOICES):
            if at is None:
                return None
            s, towards = at.best_place(mean, given, held, variance)
            if abs(s - before) < self.problem.s[-1] / PLACES:
                break
            # At first the state is far off, and the linear model is no guide.
            begin = np.zeros_like(towards) if found is None and near is None else towards
            before, shift = s, s - mean[PLACE]
            found = most_probable(self.solved, mean + given * shift, held, begin, at)
            if found is None:
                return None
            at = found.point
            pull = found.pull.copy()  # of the prior at any place
            pull[PLACE] += shift / variance - given @ pull
            found = replace(found, pull=pull, misfit=found.misfit + shift**2 / variance)
        return found

    def solved(self, unknowns: Array, near: Solved | None = None) -> Solved | None:
        """The load step to unknowns, begun at a solution for others nearby; None where it has no solution."""
        simulation, state = self.problem.simulation, self.start.state
        change = unknowns[self.problem.history] - plastic_slips(simulation, state)
        as_whole = self.substeps in (1, None)
        try:
            simulation.begin_from(with_plastic_slips(simulation, state, change))
            ends = [Increment(1.0, near.towards(self, unknowns))] if near and as_whole else []
            report = simulation.advance(self.problem.actuation(self.commands, unknowns), self.substeps, ends)
        except (StepFailed, np.linalg.LinAlgError):
            return None
        return Solved.of(self, unknowns, report)


@dataclass(frozen=True, eq=False)
class Solved:
    """A load step solved at given unknowns."""

    frame: Frame
    unknowns: Array
    report: LoadStepReport
    position: Position
    observed: ObservedStep
    # Derivatives by inputs, loads on all nodes that may carry it, plastic slips and parameters
    by_node: Response

    @classmethod
    def of(cls, frame: Frame, unknowns: Array, report: LoadStepReport) -> Solved:
        """The present state of the simulation."""
        problem, wound, simulation = frame.problem, frame.commands.by_displacement, frame.problem.simulation
        seen = observed(simulation, problem.observation, frame.reads_curvatures)
        # Far from the readings slack tendons count as taut: else no reading could show that they are.
        giving = np.zeros(len(wound)) if wound.any() and frame.is_far_from(seen) else None
        curvatures = frame.reads_curvatures
        by_node = Response.of(simulation, problem.loaded, problem.explicit, None, giving, curvatures)
        return cls(frame, unknowns, report, simulation.position, seen, by_node)

    @cached_property
    def response(self) -> Response:
        """Derivatives by the unknowns."""
        return self.by_node.combined(self.by_unknowns)

    @cached_property
    def by_unknowns(self) -> Array:
        """Derivatives of inputs, loads on nodes, plastic slips and parameters by the unknowns."""
        problem, place = self.frame.problem, self.unknowns[PLACE]
        found, slopes, m = self._weights(place), problem.shares(place)[1], len(problem.input_sigmas)
        found[m : m + 6 * len(slopes), PLACE] = np.outer(slopes, self.unknowns[LOAD]).ravel()
        return found

    def _weights(self, place: float) -> Array:
        """As `by_unknowns`, where the load stays at a place [m]."""
        problem = self.frame.problem
        shares, m = problem.shares(place)[0], len(problem.input_sigmas)
        ends = m + 6 * len(shares)
        found = np.zeros((self.by_node.positions.shape[-1], len(self.unknowns)))
        found[:m, problem.inputs] = np.diag(problem.acting(self.frame.commands, self.unknowns)[1])
        found[m:ends, LOAD] = (shares[:, None, None] * np.eye(6)).reshape(-1, 6)
        kept = np.append(self.by_node.sticking, np.ones(len(problem.effects.prior.names), dtype=bool))
        found[ends:, problem.history.start :] = np.eye(len(kept))[kept]
        return found

    @cached_property
    def _moved(self) -> tuple[ObservedStep, Array]:
        """The state as it is observed, with small changes of the parameters of `by_node`, and these."""
        h = self.by_node.difference_steps(self.observed)
        return self.observed.moved(self.by_node, h), h

    def compared(self, readings: Sequence[Reading]) -> tuple[Array, Array]:
        """Readings less their predictions, and derivatives of these by the parameters of `by_node`.

        Both over their standard deviations, shapes (n_readings,) and (n_readings, P).
        """
        moved, h = self._moved
        read = np.array([(r.value, r.sigma) for r in readings], dtype=float).reshape(-1, 2)
        found = [r.channel.predict(moved, [r.location]) for r in readings]
        predicted = np.hstack((np.zeros((len(moved.positions), 0)), *found))
        jacobian, errors = by_differences(predicted, h), self.unknowns[self.frame.problem.parameters]
        expected = predicted[0] + jacobian[:, jacobian.shape[1] - len(errors) :] @ errors
        return (read[:, 0] - expected) / read[:, 1], jacobian / read[:, 1:]

    @cached_property
    def _of_frame(self) -> tuple[Array, Array]:
        """The readings of its frame, compared."""
        return self.frame.weighted(*self.compared(self.frame.readings))

    @property
    def residual(self) -> Array:
        """See `tdcr_fe.estimate.most_probable.SolvedState`."""
        return self._of_frame[0]

    @cached_property
    def jacobian(self) -> Array:
        """See `tdcr_fe.estimate.most_probable.SolvedState`."""
        return self._of_frame[1] @ self.by_unknowns

    def with_likely_states(self, prior: Array, covariance: Array) -> tuple[Response, Array]:
        """Derivatives and covariance given the readings; holes stick and tendons are taut with their probability.

        The simulation has to be in this state.

        Within the uncertainty of the unknowns, a hole near stick and slip, or a tendon near slack, is linear in none of
        them: its mobilisation or tension is a line through all of its values and an error of this line (statistical
        linearisation; A. F. Garcia-Fernandez et al., IEEE Trans. Signal Processing 63 (2015) 5561-5573).

        Parameters
        ----------
        prior, covariance
            Covariance of the unknowns before the readings and after them, shape (n, n).

        Returns
        -------
        response : Response
        covariance : ndarray, shape (n + e, n + e)
            Covariance of the unknowns, and of the errors of holes and tendons in units of their standard deviation.
        """
        problem, frame, commands = self.frame.problem, self.frame, self.frame.commands
        history, inputs = problem.history, problem.inputs
        by_node, simulation = self.by_node, problem.simulation
        by, law = self.by_unknowns.copy(), simulation.handle.actuation.law
        wound, scale, m = commands.by_displacement, commands.drives.scale, len(commands.values)

        def spread(changes: Array) -> Array:
            return np.sqrt(np.sum(changes @ covariance * changes, axis=1).clip(0.0))

        by[:m, inputs] = np.diag(scale)  # without bounds
        tensions, compliances = tensions_without_bounds(simulation)
        tensions = np.where(wound, tensions, commands.values + scale * self.unknowns[inputs])
        counted = wound & (np.diagonal(by_node.gaps) > -0.5)  # tendons that count as taut
        changes = np.where(counted[:, None], by_node.base_tensions, -by_node.gaps / compliances[:, None])
        taut, left = within_bounds(tensions, spread(changes @ by), 0.0, np.inf)
        # Such an error is that of the input which has the same effect.
        as_input = compliances / scale * np.divide(left, taut, np.zeros(m), where=taut > 0.0)
        giving = np.divide(compliances, taut, np.full(m, np.inf), where=taut > 0.0) - compliances

        presliding, slips = law.hysteresis.presliding, self.position.state.friction[0].slip[law.frictional]
        changes = (by_node.plastic_slips + presliding * by_node.mobilisations) @ by
        changes[:, history] -= np.eye(len(slips))
        trial = (slips - self.unknowns[history]) / presliding
        sticking, left = within_bounds(trial, spread(changes) / presliding, -1.0, 1.0)
        as_slip = presliding * np.divide(left, sticking, np.zeros(len(slips)), where=sticking > 0.0)

        likely = self
        if len(slips) or np.any(np.abs(taut - counted)[wound] > LEAST_INSIDE):
            given = problem.explicit, sticking, giving, frame.reads_curvatures
            likely = replace(self, by_node=Response.of(simulation, problem.loaded, *given))
        by = likely.by_unknowns.copy()
        by[:m, inputs] = np.diag(scale * np.where(wound, 1.0, taut))
        errors = np.hstack((by[:, history] * as_slip, by[:, inputs] * as_input))
        errors = errors[:, errors.any(axis=0)]
        weights = np.hstack((by, errors))
        wider = posterior_covariance(
            block_diag(prior, np.eye(errors.shape[1])), likely._of_frame[1] @ weights
        )
        return likely.by_node.combined(weights), wider

    def _change_to(self, frame: Frame, unknowns: Array) -> Array:
        """Change of the unknowns to those of its frame, or of the next one, which begins where this state ends."""
        problem, change = self.frame.problem, unknowns - self.unknowns
        if frame is not self.frame:
            given = frame.commands.values - self.frame.commands.values
            change[problem.inputs] += given / frame.commands.drives.scale
            slips = plastic_slips(problem.simulation, self.position.state)
            change[problem.history] = unknowns[problem.history] - slips
        return change

    def towards(self, frame: Frame, unknowns: Array) -> StoredState:
        """The state at other unknowns of its frame or of the next one, to first order; parameters are as given."""
        change = self._change_to(frame, unknowns)
        change[self.frame.problem.parameters] = 0.0
        return self._changed(change)

    def _changed(self, change: Array) -> StoredState:
        """The state at changed unknowns, to first order."""
        state, response = self.position.state, self.response
        simulation, configuration = self.frame.problem.simulation, state.configuration
        moved = np.stack((response.positions @ change, response.rotations @ change), axis=1)
        twists = configuration.chains[0].changes((moved @ configuration.poses[0][1]).reshape(-1, 6))
        most = simulation.settings.max_turn
        twists *= most / max(most, float(np.abs(twists[:, 3:]).max()))
        mobilisation = state.mobilisation[0].copy()
        mobilisation[simulation.handle.actuation.law.frictional] += response.mobilisations @ change
        return StoredState(
            configuration.unknowns._replace(twists=(configuration.twists[0] + twists,)),
            (np.maximum(state.base_tension[0] + response.base_tensions @ change, 0.0),),
            (mobilisation.clip(-1.0, 1.0),),
        )

    def moved(self, unknowns: Array) -> SolverState:
        """The state at other unknowns of its frame, to first order, with the history that the next one begins with."""
        problem, change = self.frame.problem, unknowns - self.unknowns
        change[problem.parameters] = unknowns[problem.parameters]
        slips = self.response.plastic_slips @ change
        ended = with_plastic_slips(problem.simulation, self.position.state, slips)
        return problem.simulation.system.warm_start(ended, self._changed(change))

    def start_of(self, frame: Frame, compared: tuple[Array, Array], mean: Array, covariance: Array) -> Array:
        """``v`` with which the next frame begins from its prior, by the derivatives in this state."""
        residual, by_node = frame.weighted(*compared)
        jacobian = by_node @ self.by_unknowns
        return linear_start(covariance, residual - jacobian @ self._change_to(frame, mean), jacobian)

    def best_place(self, mean: Array, given: Array, held: Array, variance: float) -> tuple[float, Array]:
        """Where the load explains the readings best by the linear model.

        Parameters
        ----------
        mean
            Mean of the prior, shape (n,).
        given
            Change of all unknowns with the place [1/m], shape (n,).
        held
            Covariance of the prior at a given place, shape (n, n).
        variance
            Variance of the place [m^2].

        Returns
        -------
        place : float
            [m].
        start : ndarray, shape (n,)
            ``v`` of `most_probable` that leads there.
        """
        by_node, length = self._of_frame[1], self.frame.problem.s[-1]
        best = (np.inf, 0.0, np.zeros(len(mean)))
        # What would be missed where nothing acted.
        alone = self.residual + by_node @ self._weights(self.unknowns[PLACE]) @ self.unknowns
        for s in np.linspace(0.0, length, PLACES + 1)[1:]:
            shift, weights = s - mean[PLACE], by_node @ self._weights(s)
            missed = alone - weights @ (mean + given * shift)
            inner = weights @ held @ weights.T + np.eye(len(weights))
            left = np.linalg.solve(inner, missed)
            value = missed @ left + np.linalg.slogdet(inner)[1] + shift**2 / variance
            if value < best[0]:
                best = (value, float(s), weights.T @ left)
        return best[1:]


@dataclass(frozen=True, eq=False)
class Volume:
    """The volume of the states that explain the readings: slope of a term of the misfit, as of the last frames.

    Where the derivatives ``H`` of the readings vary with the unknowns, the least misfit is biased: it prefers states in
    which the readings change much, since smaller errors explain them there. The states around it that explain them as
    well fill a volume proportional to ``det(H P H' + R)^-1/2``, so that the misfit has the term ``log det(H P H' + R)``
    beside it (Laplace's method). It is linear here: its slope is that of a prior with another mean.

    The slope is a sum over the directions in which the readings are informative, and each of them takes a load step. It
    changes slowly from frame to frame, so a frame renews one direction or two, or none where it took long.
    """

    slopes: tuple[Array, ...] = ()  # By direction, most informative last, each of shape (n,)
    # So far: each renews the next direction, away from the prior mean and towards it in turn; the mean of both counts
    renewals: int = 0

    def pull(self, covariance: Array) -> Array:
        """The prior whose mean is changed by the covariance (n, n) times this has this slope, shape (n,)."""
        bounded = (_bounded(slope, covariance) for slope in self.slopes)  # that of their frame may be less
        return -0.5 * sum(bounded, np.zeros(len(covariance)))

    def renewed(self, solved: Solved, covariance: Array) -> Volume:
        """With one direction, or those that are new, as in a solved frame; ``covariance``: of its prior."""
        jacobian = solved.jacobian
        variances, directions = np.linalg.eigh(jacobian @ covariance @ jacobian.T + np.eye(len(jacobian)))
        away = np.where(solved.residual @ directions < 0.0, -1.0, 1.0)  # from the prior mean
        weights = (away * directions / np.sqrt(variances)).T[variances > INFORMATIVE]
        slopes = list(self.slopes[: len(weights)])
        for k, weight in enumerate(weights):
            if k == self.renewals % len(weights) or k >= len(slopes):
                side = -1.0 if self.renewals // len(weights) % 2 else 1.0
                new = _slope(solved, covariance, side * weight)
                slopes[k : k + 1] = [0.5 * (new + slopes[k]) if k < len(slopes) else new]
        return Volume(tuple(slopes), self.renewals + 1)


def _slope(solved: Solved, covariance: Array, weight: Array) -> Array:
    """What a direction of the readings adds to the slope, shape (n,).

    It is taken over one standard deviation of the prior, so that holes between stick and slip count with their
    probability.
    """
    jacobian = solved.jacobian
    near = solved.frame.solved(solved.unknowns + covariance @ jacobian.T @ weight, solved)
    if near is None:
        return np.zeros(len(covariance))
    return _bounded(2.0 * weight @ (near.jacobian - jacobian), covariance)


def _bounded(slope: Array, covariance: Array) -> Array:
    """At most one over a standard deviation: at a hole between stick and slip it may be any."""
    return np.asarray(slope / max(1.0, math.sqrt(float(slope @ covariance @ slope))))

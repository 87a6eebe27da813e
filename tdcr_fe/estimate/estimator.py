"""Estimation frame by frame: `Estimator`.

Errors of the inputs and the load follow Gauss-Markov processes or random walks. The history of the friction is part of
the unknowns, and its uncertainty is carried along with all correlations (`tdcr_fe.estimate.response`): an error of the
inputs that has let a hole slip too far lets it slip back with it, instead of letting it reverse.
"""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.linalg import block_diag

from tdcr_fe.effects import Experiment, Observation, with_effects
from tdcr_fe.elements import Array
from tdcr_fe.estimate.description import Estimate, InputPrior, LoadPrior, ParameterPrior, Passage, memory
from tdcr_fe.estimate.frame import PLACE, Frame, Problem, Solved, Volume, name_at
from tdcr_fe.estimate.most_probable import posterior_covariance
from tdcr_fe.estimate.response import Response, plastic_slips
from tdcr_fe.estimate.uncertain import UncertainEffects
from tdcr_fe.io.readings import Reading
from tdcr_fe.model.loading import Actuation, Load, LoadStep, Model, SolverSettings, resolve
from tdcr_fe.model.messages import shown
from tdcr_fe.model.robot import Robot
from tdcr_fe.model.schema import FieldError, check_instance
from tdcr_fe.scene.mesh import build_mesh
from tdcr_fe.solve.load_steps.load_path import LoadStepReport, Position
from tdcr_fe.solve.sensitivities.robot_model import load_positions
from tdcr_fe.solve.simulation import Simulation, one_thread

#: Substeps of a frame, where its step does not say: the path within a frame is not resolved. The first frame takes the
#: unloaded robot to where it is, and its path is.
SUBSTEPS = 1
#: Of a load step where no settings are given [1], with a tenth of which the errors are the same and load steps take
#: 18 % more iterations (7 % with friction).
TOLERANCE = 1e-5
#: Load steps of a frame of which those that the iteration does not need renew the volume. Where each frame renews one
#: direction, the force errors are the same, and the longest frames are longer by a load step.
STATES = 3
#: Of a frame that was not solved.
UNSOLVED = LoadStepReport(0, 0, 0, 0.0, False, 1.0, 0.0)


class Estimator:
    """Most probable shape, tensions, states of the holes and external load of a robot, frame by frame.

    Parameters
    ----------
    robot, model
        Description; one element a bay where the mesh is "auto".
    load, inputs
        What is known before any reading.
    steps
        Load steps that name the known loads, which act besides the estimated one; all loads must be named here.
    observation
        How positions are measured.
    uncertain
        Effects whose numbers have errors; None: the description holds.
    settings
        Numerics; None are those of any load step with a tolerance of 1e-5.

    Raises
    ------
    ValueError
        The priors do not fit the robot, an uncertain effect changes neither robot nor model or decides whether a hole
        has friction, or the model has another hysteresis than "elastic-plastic".
    """

    def __init__(
        self,
        robot: Robot,
        model: Model,
        load: LoadPrior,
        inputs: InputPrior,
        *,
        steps: Sequence[LoadStep] = (),
        observation: Observation | None = None,
        uncertain: ParameterPrior | None = None,
        settings: SolverSettings | None = None,
    ) -> None:
        hint = "a Robot. read_robot(path) reads one from robot.toml"
        check_instance("Estimator", "robot", robot, Robot, hint)
        if model.elements_per_bay == "auto":
            model = replace(model, elements_per_bay=1)
        if model.hysteresis != "elastic-plastic":
            raise FieldError("model.hysteresis", shown(model.hysteresis), "must be 'elastic-plastic'")
        length = robot.backbone.length
        load.check(length)
        self.load, self.inputs = load, inputs
        known = tuple(LoadStep(loads=step.loads) for step in steps)
        places, uncertain = [length if isinstance(load.at, str) else load.at], uncertain or ParameterPrior()
        if load.at == "unknown":
            own = with_effects(Experiment(robot, model, known), uncertain.effects)
            places = build_mesh(own.robot, own.model, load_positions(own))[0].arc_lengths[1:].tolist()
        steps = (*known, LoadStep(loads={name_at(s): Load(at=s) for s in places}))
        effects = UncertainEffects(Experiment(robot, model, steps), uncertain)
        # Uniform along the body where it is unknown.
        of_place = length / np.sqrt(12.0) if load.at == "unknown" else 0.0
        of_load, of_inputs = np.repeat((load.sigma, load.sigma_moment), 3), inputs.sigmas(robot.tendon_names)
        given = settings or SolverSettings(tolerance=TOLERANCE), observation or Observation()
        self._problem = problem = Problem(effects, *given, places, of_inputs)
        law = problem.simulation.handle.actuation.law
        of_slips = np.zeros(np.count_nonzero(law.frictional))
        of_others = np.concatenate((of_load, [of_place], of_inputs, of_slips))
        self._sigmas = np.pad(of_others, (0, len(uncertain.names)))  # of what changes from frame to frame
        self._typical = np.zeros(len(self._sigmas))
        self._typical[PLACE] = 0.5 * length if load.at == "unknown" else places[0]
        self._mean = self._typical
        begin, slips = np.eye(len(self._sigmas)), law.slip_operator @ problem.explicit.released_unloaded()
        begin[problem.history, problem.parameters] = slips[law.frictional]
        self._covariance = begin @ block_diag(np.diag(of_others**2), uncertain.covariance) @ begin.T
        self._commands: Actuation | None = None
        self._last: Solved | None = None
        self._volume = Volume()
        self._number = 0

    @property
    def simulation(self) -> Simulation:
        """Simulation of the robot, in the present state."""
        return self._problem.simulation

    @property
    def robot(self) -> Robot:
        """With effects at their present values."""
        return self.experiment.robot

    @property
    def experiment(self) -> Experiment:
        """As `robot`, with model and steps that name all loads."""
        return self._problem.effects.experiment

    def step(self, step: LoadStep, readings: Sequence[Reading] = ()) -> Estimate:
        """Estimate the state in the next frame.

        Parameters
        ----------
        step
            Commanded or measured inputs, known loads, and the time; what it does not name keeps its value.
        readings
            Readings of this frame, each with a standard deviation; there may be none.

        Returns
        -------
        Estimate
            Where the readings are not met, the state without them, or where there is none that of the frame before, and
            a message.

        Raises
        ------
        ValueError
            There is no time, or it runs backwards, a reading is not finite, has no standard deviation or no place, or a
            load is none of those that were named.
        """
        begun = time.perf_counter()
        self._number += 1
        where = f"step {self._number}"
        if step.time is None or step.time < (0.0 if self._last is None else self._last.frame.commands.time):
            raise ValueError(f"{where}: time = {step.time}: must be given and not run backwards [s]")
        length, names = self.robot.backbone.length, self.robot.tendon_names
        for r in readings:
            of, at = f"{where}: reading of {r.quantity}", r.location
            if not (math.isfinite(r.value) and 0.0 < (r.sigma or 0.0) < math.inf):
                allowed = "must be a finite number with a standard deviation above zero"
                raise ValueError(f"{of}: {r.value} with sigma = {r.sigma}: {allowed}")
            inside = not isinstance(at, str) and 0.0 <= (at or 0.0) <= length
            if not (at in names if r.channel.location == "tendon" else inside):
                allowed = f"an arc length from 0 to {length:g} m, or one of {', '.join(names)}"
                raise ValueError(f"{of}: location = {at}: must be {allowed}")
        for name, load in step.loads.items():
            if Simulation.load_key(name, load) not in self.simulation.loads:
                raise ValueError(f"{where}: loads.{name}: must be named by the steps given to Estimator")
        self._commands = resolve(self.robot, [step], self._commands)[0]
        substeps = step.substeps or (None if self._last is None else SUBSTEPS)
        frame = Frame(self._problem, self.simulation.position, self._commands, readings, substeps)
        with one_thread():
            found = self._estimated(frame)
        result = replace(found.result, step=self._number, label=step.label)
        return replace(found, result=result, milliseconds=1e3 * (time.perf_counter() - begun))

    def _estimated(self, frame: Frame) -> Estimate:
        """The estimate of a frame, which the estimator takes for its state.

        Where its readings are not met, that without them; where no load step leads there, the last state.
        """
        kept, mean, covariance = self._prior(frame)
        held = self._problem.at_given_place(covariance)[1]
        of_volume = self._volume.pull(held) if frame.readings else np.zeros(len(mean))
        last = self._last
        if last is not None and last.frame.commands.drives.kinds != frame.commands.drives.kinds:
            last = None
        found = frame.most_probable(mean + held @ of_volume, covariance, last)
        if found is None or not found.converged:
            message = "no load step towards the frame has a solution"
            if found is not None:
                message = f"the readings are not met (misfit {found.misfit:.3g}): wrong axes, signs or units?"
            self.simulation.return_to(frame.start)
            if frame.readings:
                predicted = self._estimated(replace(frame, readings=()))
                result = replace(predicted.result, converged=False)
                return replace(predicted, result=result, misfit=np.nan, message=message)
            state = Solved.of(frame, self._mean, UNSOLVED)
            return self._estimate(state, self._mean, state.response, covariance, np.nan, message)
        state, unknowns = found.point, found.unknowns
        jacobian, after = state.jacobian, posterior_covariance(covariance, state.jacobian)
        state, unknowns = self._at_present_values(state, unknowns, after)
        history = self._problem.history
        for _ in range(STATES - found.states if frame.readings else 0):
            self._volume = self._volume.renewed(state, held)
        self.simulation.position = state.position
        if state is not found.point:
            after = posterior_covariance(covariance, state.jacobian)
        response, likely = state.with_likely_states(covariance, after)
        self.simulation.return_to(Position(state.moved(unknowns)))
        self._mean, self._last = unknowns.copy(), state
        self._mean[history] = plastic_slips(self.simulation, self.simulation.state)
        same = np.eye(len(mean))
        carried = np.vstack((same[: history.start], state.response.plastic_slips, same[history.stop :]))
        end = carried @ after @ carried.T
        self._covariance = 0.5 * (end + end.T)
        by = state.response.positions, state.response.rotations, state.response.base_tensions
        passage = Passage(kept, covariance, jacobian, of_volume + found.pull, carried, *by)
        return replace(self._estimate(state, unknowns, response, likely, found.misfit, ""), passage=passage)

    def _at_present_values(self, state: Solved, unknowns: Array, covariance: Array) -> tuple[Solved, Array]:
        """A solved frame and its unknowns, with effects at the values found where these are a standard deviation off.

        As it is where that is not solved; ``covariance``: of the unknowns, given the readings.
        """
        problem, which, counted = self._problem, self._problem.parameters, unknowns.copy()
        change = problem.effects.within_bounds(unknowns[which])
        if not np.any(change**2 > np.diagonal(covariance)[which]):
            return state, unknowns
        counted[which] -= change
        own, start = problem.with_effects(problem.effects.moved(change)), state.frame.start.state
        start = own.simulation.system.warm_start(start, start.stored())  # its unloaded shape may be another
        solved = replace(state.frame, problem=own, start=Position(start)).solved(counted)
        if solved is None:
            return state, unknowns
        self._problem = own
        return solved, counted

    def _prior(self, frame: Frame) -> tuple[Array, Array, Array]:
        """What is left of the unknowns at the end of the last frame; their mean and covariance before readings."""
        if self._last is None:
            return np.ones(len(self._mean)), self._mean, self._covariance
        before = self._last.frame.commands
        elapsed = frame.commands.time - before.time
        kept, grown = np.ones(len(self._mean)), np.zeros(len(self._mean))  # Plastic slips stay.
        for prior, which in ((self.load, slice(0, PLACE + 1)), (self.inputs, self._problem.inputs)):
            kept[which], grown[which] = memory(prior, elapsed)
        kinds = zip(before.drives.kinds, frame.commands.drives.kinds, strict=True)
        changed, inputs = np.array([a != b for a, b in kinds], dtype=bool), self._problem.inputs
        kept[inputs][changed], grown[inputs][changed] = 0.0, 1.0  # An error in N says nothing of one in m.
        mean = self._typical + kept * (self._mean - self._typical)
        return kept, mean, self._covariance * np.outer(kept, kept) + np.diag(grown * self._sigmas**2)

    def _estimate(
        self, state: Solved, x: Array, response: Response, covariance: Array, misfit: float, message: str
    ) -> Estimate:
        """The present state with its unknowns as an estimate; number, label and time taken are left open.

        ``response``, ``covariance``: by and of the unknowns, and more after them.
        """
        problem = self._problem
        errors = x[problem.parameters]
        result = self.simulation.result(0, "", state.report, problem.actuation(state.frame.commands, x))
        return Estimate(
            replace(result, converged=not message),
            state.frame.commands.time,
            float(x[PLACE]),
            float(np.sqrt(covariance[PLACE, PLACE])),
            x[:3],
            x[3:6],
            covariance[:3, :3],
            covariance[3:6, 3:6],
            x[problem.inputs],
            problem.effects.values(errors),
            problem.effects.sigmas(errors, np.diagonal(covariance)[problem.parameters]),
            result.base_tensions,
            response.base_tensions @ covariance @ response.base_tensions.T,
            response.positions @ covariance @ response.positions.swapaxes(1, 2),
            misfit,
            np.nan,
            message,
        )

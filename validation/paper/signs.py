"""The algorithm of the paper's Fig. 2, taken literally: signs of the tendons' length rates by trial.

In every load step one sign is assumed for each tendon, first that all of them shorten; the step is solved with the
friction in these directions; the change of each tendon's length is compared with its sign; and the next combination
is tried until all agree. There are 2^m combinations for m tendons with friction. Where none agrees the algorithm has
no solution: a tendon that would lengthen if it were assumed to shorten, and vice versa, does not move at all. Its
holes stick, with less friction than the Capstan equation allows.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tdcr_fe.elements.friction import TendonLaw
from tdcr_fe.model.loading import Actuation, Load, LoadStep, Model, resolve
from tdcr_fe.model.robot import Robot
from tdcr_fe.model.routing import ParallelRouting
from tdcr_fe.model.tendon import Tendon
from tdcr_fe.solve.equations.configuration import SolverState
from tdcr_fe.solve.simulate import Simulation, simulate
from tdcr_fe.validation.paper.cases import MODELS, paper_case

Array = NDArray[np.float64]
Signs = tuple[int, ...]

#: Changes of length below this agree with either sign [m].
TOLERANCE = 1e-9


class FixedSigns(TendonLaw):
    """Capstan friction in directions that do not follow the motion: mobilisations stay as they are set."""

    def __init__(self, law: TendonLaw) -> None:
        super().__init__(law.parameters, law.law, law.presliding)
        self.frictional = np.zeros_like(self.frictional)
        self.has_friction = False


@dataclass(frozen=True)
class Trial:
    """One combination of signs, solved."""

    signs: Signs  # assumed sign of the rate of each tendon's length: -1 shortens, +1 lengthens
    agrees: tuple[
        bool, ...
    ]  # whether the change has the sign assumed; true for tendons that carry no tension
    tip: Array  # [m], shape (3,)

    @property
    def consistent(self) -> bool:
        """Whether all tendons agree."""
        return all(self.agrees)


@dataclass(frozen=True)
class SignStep:
    """One load step of the algorithm."""

    label: str
    trials: tuple[Trial, ...]  # in the order tried
    accepted: Trial  # the consistent one; where there is none, the one with the fewest contradictions

    @property
    def solved(self) -> bool:
        """Whether a consistent combination was found."""
        return self.accepted.consistent


def trial_signs(robot: Robot, steps: Sequence[LoadStep], *, try_all: bool = False) -> list[SignStep]:
    """Take a robot through a loading sequence with the algorithm of Fig. 2.

    Parameters
    ----------
    robot
        Its tendons are driven by tension.
    steps
        Load steps.
    try_all
        Try all combinations, also after one was consistent (to see whether the answer is unique).

    Returns
    -------
    list of SignStep
        The state of a step that has no consistent combination is the one with the fewest contradictions, so
        that the sequence can continue.
    """
    targets = resolve(robot, steps)
    simulation = Simulation(robot, Model("straight", "per-tendon", 2), targets)
    forces = simulation.handle.actuation
    forces.model = replace(forces.model, law=FixedSigns(forces.law))
    signs = np.full(forces.count, -1)
    result = []
    for step, target in zip(steps, targets, strict=True):
        start, slip = simulation.state, simulation.displacement.copy()
        # A tendon without tension has no friction: its sign has no effect and is kept.
        rubs = (target.values > 0.0) | (forces.base_tension > 0.0)
        trials: list[Trial] = []
        for assumed in _combinations(rubs, signs):
            change = _solve(simulation, _with_signs(start, assumed), target, slip)
            agrees = ~rubs | (np.array(assumed) * change >= -TOLERANCE)
            tip = simulation.state.configuration.positions[-1].copy()
            trials.append(Trial(assumed, tuple(agrees.tolist()), tip))
            if trials[-1].consistent and not try_all:
                break
        taken = next((t for t in trials if t.consistent), min(trials, key=lambda t: t.agrees.count(False)))
        if taken is not trials[-1]:
            _solve(simulation, _with_signs(start, taken.signs), target, slip)
        signs = np.array(taken.signs)
        result.append(SignStep(step.label, tuple(trials), taken))
    return result


def _combinations(rubs: NDArray[np.bool_], signs: NDArray[np.int_]) -> list[Signs]:
    """All combinations of the tendons that rub; all shorten first, then those with fewest that lengthen."""
    moving = np.flatnonzero(rubs)
    found = []
    for choice in sorted(product((-1, 1), repeat=moving.size), key=lambda c: (c.count(1), c[::-1])):
        full = signs.copy()
        full[moving] = choice
        found.append(tuple(int(x) for x in full))
    return found


def _with_signs(state: SolverState, signs: Signs) -> SolverState:
    """A state with other directions of friction: a tendon that shortens is pulled through its holes."""
    (old,) = state.friction
    mobilisation = -np.asarray(signs, dtype=float)[:, None]
    new = replace(old, slip=np.zeros((len(signs), 1)), mobilisation=mobilisation)
    return state._replace(friction=(new,), mobilisation=(mobilisation,))


def _solve(simulation: Simulation, start: SolverState, target: Actuation, slip: Array) -> Array:
    """Solve one step from a state; returns the change of every tendon's length [m]."""
    simulation.restore(start)
    simulation.advance(target)
    return slip - simulation.displacement


def three_tendon_robot() -> Robot:
    """The single segment of Fig. 3 with three tendons, 120 degrees apart."""
    single = paper_case("fig3").robot
    tendons = tuple(
        Tendon(f"t{k + 1}", ParallelRouting(4.5e-3, 120.0 * k), friction_coefficient=0.3) for k in range(3)
    )
    return Robot(single.backbone, single.disks, tendons, "three-tendons")


def sign_steps() -> list[LoadStep]:
    """A loading sequence in which the tendons' signs change, and in which some tendons do not move at all."""
    return [
        LoadStep("all to 0.3 N", {"t1": 0.3, "t2": 0.3, "t3": 0.3}),
        LoadStep("t1 to 1.2 N", {"t1": 1.2}),
        LoadStep("t2 to 0.8 N", {"t2": 0.8}),
        LoadStep("t1 back to 0.4 N", {"t1": 0.4}),
        LoadStep("t3 to 1.0 N", {"t3": 1.0}),
        LoadStep("t3 back to 0.98 N", {"t3": 0.98}),
        LoadStep("5 mN at the tip", {}, loads={"tip": Load(0.25, (0.005, 0.0, 0.0))}),
    ]


def study_signs() -> dict[str, Any]:
    """The algorithm beside the implicit law, which needs no trials: a row for each load step."""
    robot, steps = three_tendon_robot(), sign_steps()
    law = simulate(robot, MODELS["per-tendon"], steps).steps
    rows = []
    for step, solved in zip(trial_signs(robot, steps, try_all=True), law, strict=True):
        consistent = ["".join("-+"[s > 0] for s in t.signs) for t in step.trials if t.consistent]
        rows.append(
            {
                "step": step.label,
                "trials": len(step.trials),
                "consistent": ", ".join(consistent) or "none",
                "implicit law": ", ".join(states[0] for states in solved.hole_states),
                "distance of the tips [mm]": 1e3 * float(np.linalg.norm(step.accepted.tip - solved.tip)),
            }
        )
    return {"steps": rows}

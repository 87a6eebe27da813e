"""Problems, searches and results on the small robot; one that has found gravity; runs of the corrected robot."""

from dataclasses import replace
from functools import cache

import identify_data
import numpy as np
import pandas as pd
from identify_data import measured

from tdcr_fe import IdentifySettings
from tdcr_fe.cli import main
from tdcr_fe.effects import EFFECTS, effect
from tdcr_fe.effects.base import Kind
from tdcr_fe.identify import settings
from tdcr_fe.identify.corrected import corrected_files
from tdcr_fe.identify.dictionary import dictionary
from tdcr_fe.identify.fitting import fit
from tdcr_fe.identify.forward import ForwardModel, Job
from tdcr_fe.identify.identification import declared_state, prepare
from tdcr_fe.identify.problem import FitProblem, evaluate
from tdcr_fe.identify.result import AddedEffect, Errors, Estimate, IdentificationResult, Misfit, Parameters
from tdcr_fe.identify.search_state import Search, SearchState
from tdcr_fe.identify.verdict import conclude
from tdcr_fe.validation.measured_folder import write_measured


def problem_of(data, held=(), sigma=1e-4, forward=None):
    """The problem of fitting all readings but those of some steps, with the given sigma."""
    held_out = np.array([r.step in held for r in data.readings])
    return FitProblem.of(data, np.full(held_out.size, sigma), held_out, forward or ForwardModel(), 5e-5)


def read_as_predicted(problem, residual, sigma=1e-5):
    """The data with predictions as readings, of which these are the residuals over sigma, known to ``sigma``."""
    values = problem.readings.values - residual * problem.sigma
    pairs = zip(problem.data.readings, values.tolist(), strict=True)
    return replace(problem.data, readings=tuple(replace(r, value=x, sigma=sigma) for r, x in pairs))


def causes_of(problem):
    """The run of the declared model, and all causes by name."""
    (run,) = problem.run([Job(problem.experiment)])
    causes = dictionary(problem, run)
    found = {e.name: e for e in causes}
    assert len(found) == len(causes)
    return run, found


@cache
def declared():
    """The problem of the readings of the declared robot, its run, and all causes by name."""
    problem = problem_of(measured())
    return problem, *causes_of(problem)


def state_of(problem):
    """A search that has only evaluated the declared model."""
    return SearchState.start(problem, evaluate(problem, (), {}))


def begun(data):
    """The state with which the search of `identify` begins: held-out steps chosen, mesh and path fine enough."""
    return declared_state(prepare(data, IdentifySettings(), ForwardModel()))


def searching(**given):
    """A search that reports nothing."""
    return Search(IdentifySettings(**given), lambda text, share: None)


def fitted(problem, *effects):
    """The model of effects that is found from their null values."""
    return fit(problem, effects, {e.name: e.null_values(problem.experiment) for e in effects})


def starting(problem, dictionary, *effects):
    """A search whose best model has effects, fitted from their null values."""
    best = fitted(problem, *effects)
    return replace(state_of(problem).with_fit(best), best=best, dictionary=dictionary)


def with_model(state, values):
    """The same with a model of effects at given values as the best one."""
    best = evaluate(state.problem, tuple(effect(name) for name in values), values)
    return replace(state.with_fit(best), best=best)


def time_ends_with(text, beginning, monkeypatch):
    """Let the time of an identification be over where a report begins so."""
    if text.startswith(beginning):
        monkeypatch.setattr(settings, "_of_workers", 2e6)


def concluded(state, deadline=np.inf, **found):
    """The result of a search that ended in a state."""
    return conclude(replace(state, **found), deadline=deadline)


# ------------------------------------------------------------ a result


ROBOT = identify_data.ROBOT.with_tendons(axial_stiffness=2474.0)
STEPS = identify_data.sequence()
#: Errors of the declared and of the corrected model.
BEFORE = Errors(Misfit(0.0188, None, 0.02, 900.0), Misfit(0.0174, None, 0.02, 800.0))
AFTER = Errors(Misfit(1.8e-4, None, 4e-4, 1.05), Misfit(1.87e-4, None, 4e-4, 1.1))
NOISE = Misfit(1.73e-4, None, None, 1.0, rms_by_quantity={"position_x": 1e-4})


@cache
def found() -> IdentificationResult:
    """What a search concludes that ends with the gravity that was not declared."""
    data = replace(measured(identify_data.GRAVITY, robot=ROBOT), robot=ROBOT)
    ended = concluded(with_model(begun(data), identify_data.GRAVITY))
    parameters = Parameters(("a", "b"), np.eye(2))
    return replace(ended, before=BEFORE, after=AFTER, noise=NOISE, parameters=parameters)


def result(*effects, **rest):
    """The same with other effects."""
    verdict = "explained" if effects else "nothing missing"
    return replace(found(), **{"effects": effects, "verdict": verdict, **rest})


def added(name, others=(), **parameters):
    """An effect with value, standard error and unit of each parameter."""
    evidence = {"chi2_drop_fit": 1e5, "chi2_drop_held_out": 5e4, "needed_drop": 23.5}
    estimates = {n: Estimate(*p) for n, p in parameters.items()}
    kind = {e.name: e.kind for e in EFFECTS}.get(name, Kind("force", ("time",)))
    return AddedEffect(name, estimates, AFTER, evidence, kind, others, "bend the bare backbone")


GRAVITY = added("gravity", g_x=(0.0, 0.01, "m/s^2"), g_y=(6.95, 0.007, "m/s^2"), g_z=(-6.91, 0.03, "m/s^2"))


def write_corrected(result, folder):
    """The files of the corrected robot."""
    for name, text in corrected_files(result).items():
        (folder / name).write_text(text, encoding="utf-8")


def check_run(result, folder, tolerance):
    """A run of the corrected robot has the tips of the result, within a tolerance [m]."""
    write_corrected(result, folder)
    run = tips_of_run(folder / "effects.toml", folder / "out")
    tips = run.loc[[str(n) for n in result.data.step_ids]].to_numpy()
    np.testing.assert_allclose(tips, result.shapes.backbone_after[:, -1], rtol=0.0, atol=tolerance)


def identified(folder, data, *options):
    """Exit status of ``tdcr-fe identify`` on a data set, with the results in ``out``."""
    write_measured(data, folder / "set")
    return main(["identify", str(folder / "set"), "-o", str(folder / "out"), *options])


def tips_of_run(scenario, out, *options):
    """Positions of the tip by label, from the tables of ``tdcr-fe run``."""
    assert main(["run", str(scenario), "-o", str(out), "--no-pictures", "-q", *options]) == 0
    table = pd.read_csv(out / "steps.csv", dtype={"label": str})
    return table.drop_duplicates("label", keep="last").set_index("label")[["tip_x", "tip_y", "tip_z"]]

"""A result of an identification that has found gravity, with what a test gives; and runs of the corrected robot."""

from dataclasses import replace
from functools import cache

import identify_data
import numpy as np
import pandas as pd
from identify_data import begun, concluded, measured, with_model

from tdcr_fe.cli import main
from tdcr_fe.effects import EFFECTS
from tdcr_fe.effects.base import Kind
from tdcr_fe.identify.corrected import corrected_files
from tdcr_fe.identify.result import AddedEffect, Errors, Estimate, IdentificationResult, Misfit, Parameters
from tdcr_fe.io.measured import write_measured

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


def identified(folder, data, *options):
    """Exit status of ``tdcr-fe identify`` on a data set, with the results in ``out``."""
    write_measured(data, folder / "set")
    return main(["identify", str(folder / "set"), "-o", str(folder / "out"), *options])


def tips_of_run(scenario, out, *options):
    """Positions of the tip by label, from the tables of ``tdcr-fe run``."""
    assert main(["run", str(scenario), "-o", str(out), "--no-pictures", "-q", *options]) == 0
    table = pd.read_csv(out / "steps.csv", dtype={"label": str})
    ends = table.drop_duplicates("label", keep="last").set_index("label")
    return ends[["tip_x", "tip_y", "tip_z"]]

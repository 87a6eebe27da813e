"""A result of an identification made by hand: measured arcs that the declared robot misses, the corrected one not."""

import identify_data
import numpy as np
from identify_data import LENGTH

from tdcr_fe.effects import EFFECTS, Experiment
from tdcr_fe.effects.base import Kind
from tdcr_fe.identify.result import (
    AddedEffect,
    Errors,
    Estimate,
    IdentificationResult,
    Misfit,
    Parameters,
    Remainder,
    Residuals,
    SearchLog,
    Shapes,
    Simulated,
    Structure,
)
from tdcr_fe.io.measured import MeasuredData
from tdcr_fe.io.readings import Reading
from tdcr_fe.model.loading import Load, LoadStep, Model, SolverSettings

ROBOT = identify_data.ROBOT.with_tendons(axial_stiffness=2474.0)
PULLS = (0.0, 0.5, 1.0, 0.5, 0.0)
STEPS = (
    *tuple(
        LoadStep(tensions={"t1": pull, "t2": 0.1}, loads={"tip": Load(LENGTH, (0.0, 0.0, 0.0))})
        for pull in PULLS
    ),
    LoadStep(tensions={"t1": 1.0, "t2": 0.5}, loads={"tip": Load(LENGTH, (0.0, 0.02, 0.0))}),
)


#: Errors of the corrected model.
AFTER = Errors(Misfit(1.8e-4, None, 4e-4, 1.05), Misfit(1.87e-4, None, 4e-4, 1.1))


def arc(angle, n=9):
    """A planar arc that turns by ``angle`` over the length, shape (n, 3)."""
    s = np.linspace(0.0, LENGTH, n)
    kappa = max(angle, 1e-6) / LENGTH
    return np.column_stack(((1.0 - np.cos(kappa * s)) / kappa, 0.0 * s, np.sin(kappa * s) / kappa))


def result(*effects, angles=(0.1, 0.5, 1.0, 0.6, 0.2, 1.1), **rest):
    """Measured arcs; the declared model bends 20 % too far, the corrected one is right."""
    ids = tuple(range(1, len(STEPS) + 1))
    after = np.stack([arc(a) for a in angles])
    before = np.stack([arc(1.2 * a) for a in angles])
    nodes = [4, 8]
    readings = tuple(
        Reading(n, f"position_{a}", nodes[m] * LENGTH / 8, float(after[k, nodes[m], "xyz".index(a)]), 1e-4)
        for k, n in enumerate(ids)
        for m in range(2)
        for a in "xyz"
    )
    residual = (after - before)[:, nodes].ravel()
    shapes = Shapes(
        np.array([False] * 5 + [True]), np.array([0.1, 0.2]),
        after[:, nodes], before[:, nodes], after[:, nodes], before, after,
    )  # fmt: skip
    experiment = Experiment(ROBOT, Model(), STEPS)
    fields = {
        "data": MeasuredData("made up", ROBOT, Model(), ids, STEPS, ("",) * len(ids), readings),
        "verdict": "explained" if effects else "nothing missing",
        "effects": effects,
        "before": Errors(Misfit(0.0188, None, 0.02, 900.0), Misfit(0.0174, None, 0.02, 800.0)),
        "after": AFTER,
        "held_out_steps": (6,),
        "remaining": Remainder("", "what is left has the size of the noise"),
        "noise": Misfit(1.73e-4, None, None, 1.0, rms_by_quantity={"position_x": 1e-4}),
        "shapes": shapes,
        "residuals": Residuals(
            residual, 0.0 * residual + 1e-4, np.full(len(readings), 1e-4), tests=(Structure("step 3", 2.0, 0.02),)
        ),
        "parameters": Parameters(("a", "b"), np.eye(2)),
        "log": SearchLog(),
        "simulated": Simulated(experiment, experiment, SolverSettings(), mesh_error=0.01),
    }  # fmt: skip
    return IdentificationResult(**{**fields, **rest})


def added(name, others=(), **parameters):
    """An effect with value, standard error and unit of each parameter."""
    evidence = {"chi2_drop_fit": 1e5, "chi2_drop_held_out": 5e4, "needed_drop": 23.5}
    estimates = {n: Estimate(*p) for n, p in parameters.items()}
    kind = {e.name: e.kind for e in EFFECTS}.get(name, Kind("force", ("time",)))
    return AddedEffect(name, estimates, AFTER, evidence, kind, others, "bend the bare backbone")


GRAVITY = added("gravity", g_x=(0.0, 0.01, "m/s^2"), g_y=(6.95, 0.007, "m/s^2"), g_z=(-6.91, 0.03, "m/s^2"))

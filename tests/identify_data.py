"""A small robot with a loading sequence, and readings of a true robot that differs from it by effects."""

from dataclasses import replace

import numpy as np

from tdcr_fe import Backbone, Disks, ParallelRouting, Reading, Robot, Tendon
from tdcr_fe.effects import EFFECTS, Experiment, Observation, with_effects
from tdcr_fe.identify.forward import Job, run_settings, simulate_experiment
from tdcr_fe.identify.run import Readings
from tdcr_fe.io.measured import MeasuredData
from tdcr_fe.model.loading import Load, LoadStep, Model, SolverSettings

LENGTH = 0.2
ROBOT = Robot(
    Backbone(LENGTH, 0.4e-3, 85e9, 0.3, 5600.0),
    Disks.equally_spaced(4, LENGTH, mass=0.5e-3),
    tuple(Tendon(f"t{i + 1}", ParallelRouting(4.5e-3, 90.0 * i)) for i in range(2)),
    name="small",
)
MODEL = Model(friction="none", elements_per_bay=1)
FRICTIONAL = replace(MODEL, friction="per-hole")
#: Gravity that is not declared.
GRAVITY = {"gravity": {"g_x": 3.0, "g_y": -6.0, "g_z": -7.0}}
#: An unlisted cause.
BY_ROW = "bending stiffness that changes with the number of the row"


def sequence():
    """Both tendons up and down, with and without a force at the tip."""
    pulls = [(0.4, 0), (0.8, 0), (1.2, 0), (0.6, 0), (0, 0), (0, 0.5), (0, 1.0), (0, 0.5)]
    pulls += [(0.4, 0.4), (0.8, 0.8), (0.4, 0.2)]
    forces = [(0, 0)] * 5 + [(0.01, 0), (0.01, 0), (0, 0)] + [(0, -0.015)] * 2 + [(0, 0)]
    loads = [{"tip": Load(LENGTH, (x, y, 0.0))} for x, y in forces]
    return tuple(LoadStep("", {"t1": a, "t2": b}, loads=x) for (a, b), x in zip(pulls, loads, strict=True))


def simulated(experiment, tolerance=2e-5, along=None, **rest):
    """A run of the identification with a path tolerance, along the substeps of another run where it is given."""
    return simulate_experiment(Job(experiment, along, **rest), run_settings(SolverSettings(), tolerance))


def positions(true, sigma=1e-4, seed=0, tolerance=2e-5, places=(0.1, LENGTH)):
    """Readings of the positions of markers in every step of an experiment, with noise."""
    ids = tuple(range(1, true.ends[-1][0] + 2))
    readings = [Reading(n, f"position_{a}", s, 0.0, sigma) for n in ids for s in places for a in "xyz"]
    run = simulated(true, tolerance)
    assert run.solved
    values = Readings.of(readings, ids, true.robot.tendon_names).read(run, true)
    values = values + np.random.default_rng(seed).normal(0.0, sigma, values.size)
    return tuple(replace(r, value=float(v)) for r, v in zip(readings, values, strict=True))


def data_of(steps, readings, robot=ROBOT, model=MODEL, branches=None, name="small"):
    """A data set with such load steps."""
    ids = tuple(range(1, len(steps) + 1))
    return MeasuredData(name, robot, model, ids, tuple(steps), tuple(branches or ("",) * len(ids)), readings)


def measured(truth=None, sigma=1e-4, seed=0, robot=None, given=True, model=MODEL, catalogue=EFFECTS):
    """Readings of two markers of a true robot that is ``robot`` (`ROBOT`) with effects, on a finer mesh, with noise.

    With another ``model`` than `MODEL`, the robot is also the declared one.
    """
    steps = sequence()
    markers = Observation(markers=(0.1, LENGTH))
    fine = Experiment(robot or ROBOT, replace(model, elements_per_bay=4), steps, markers)
    readings = positions(with_effects(fine, truth or {}, catalogue), sigma, seed)
    if not given:
        readings = tuple(replace(r, sigma=None) for r in readings)
    return data_of(steps, readings, ROBOT if robot is None or model is MODEL else robot, model)

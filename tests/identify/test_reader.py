"""Readings of markers are predicted for all steps at once: as the channels predict them, step by step."""

from dataclasses import replace

import numpy as np
import pytest
from identify_data import FRICTIONAL, LENGTH, measured, problem_of

from tdcr_fe.effects import effect
from tdcr_fe.effects.base import Observation
from tdcr_fe.identify.derivatives import Column, Request, _Part
from tdcr_fe.identify.forward import Task, run_settings, simulate_experiment
from tdcr_fe.model.channels import channel
from tdcr_fe.model.loading import SolverSettings
from tdcr_fe.model.observed_step import ObservedChange


@pytest.mark.parametrize("share", [1.0, 0.93])
def test_markers_are_read_as_the_channels_predict_them(share):
    """At nodes and between them: turned and shifted frame, markers off the backbone and one more; with derivatives."""
    data = measured(model=FRICTIONAL)
    moved = [replace(r, location=share * r.location) if r.location else r for r in data.readings]
    data = replace(data, readings=tuple(moved))
    own = problem_of(data)
    scale = effect("stiffness_scale")
    columns = tuple(Column(scale, p.name, {"bending": 1.0, "torsion": 1.0}, 0.1) for p in scale.parameters)
    job = _Part(own, Request((), {}, columns)).job
    run = simulate_experiment(
        Task(job.experiment, run_settings(SolverSettings(), 1e-4), parameters=job.parameters)
    )
    seen = Observation(
        (0.1, -0.2, 0.3),
        (1e-3, 2e-3),
        3e-3,
        (1e-3, 0.0, -2e-3),
        (0.1, LENGTH),
        ((0.0,) * 3, (5e-4, 0.0, 1e-4)),
    )
    about = replace(job.experiment, observation=seen)
    values, derivatives = own.readings.reader.read(run, about), own.readings.reader.derivatives(run, about)
    by = run.derivatives
    for i, r in enumerate(data.readings):
        k = data.step_ids.index(r.step)
        step = seen.step(
            run.s,
            run.positions[k],
            run.rotations[k],
            run.displacements[k],
            run.base_tensions[k],
            run.distal_tensions[k],
            ("t1", "t2"),
        )
        change = ObservedChange(*(getattr(by, name)[k] for name in by._TABLES), by.arc_lengths)
        known = channel(r.quantity)
        np.testing.assert_allclose(values[i], known.predict(step, [r.location])[0], rtol=1e-12, atol=1e-15)
        expected = known.derivatives(step, change, [r.location])[0]
        np.testing.assert_allclose(derivatives[i], expected, rtol=1e-9, atol=1e-11)

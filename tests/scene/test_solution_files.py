"""Solution files of Exudyn's own solvers, which ``mbs.SolutionViewer`` replays."""

from __future__ import annotations

import numpy as np
from native_solvers import damped
from robots import three

from tdcr_fe.native import register

register()


def test_frames_of_a_solution_file_restore_pose_tensions_and_holes(tmp_path):
    """As `SolutionViewer` sets them: shape, tensions and states of the holes of every frame are those of the run."""
    from exudyn.utilities import LoadSolutionFile, SetSolutionState

    _keep, mbs, handle = damped(three(0.3))
    handle.set_inputs_over_time(lambda t: [1.5 * np.sin(np.pi * min(t / 0.1, 1.0)) + 0.1, 0.0, 0.0])
    settings = handle.recommended_settings(0.1, 1e-3)
    settings.timeIntegration.verboseMode = 0
    settings.solution.file.writePeriod = 0.02
    settings.solution.file.name = str(tmp_path / "motion.txt")
    settings.solution.file.binary = False
    settings.solution.precision = 16
    seen = {}

    def after_step(mbs, t):
        seen[round(t, 9)] = handle.shape()[0].copy()
        return True

    mbs.SetPostStepUserFunction(after_step)
    assert mbs.SolveDynamic(settings)
    end, tensions, holes = handle.shape()[0], handle.tensions(), handle.hole_states()
    solution = LoadSolutionFile(settings.solution.file.name, verbose=False)
    assert solution["nRows"] == 6
    for row in range(1, 6):
        SetSolutionState(mbs, solution, row, sendRedrawSignal=False)
        assert np.abs(handle.shape()[0] - seen[round(0.02 * row, 9)]).max() < 1e-12
    assert np.abs(handle.shape()[0] - end).max() < 1e-12
    assert handle.hole_states() == holes
    assert "release" in holes["t1"]
    for name, values in tensions.items():
        assert np.abs(handle.tensions()[name] - values).max() < 1e-9
    SetSolutionState(mbs, solution, 2, sendRedrawSignal=False)
    assert handle.hole_states() != holes

"""Exudyn's own parameter variation and a sweep give the same numbers."""

from __future__ import annotations

import math

import numpy as np
import pytest
from exudyn.processing import ParameterVariation
from sweep_files import InProcess, write_files

import tdcr_fe as tdcr
from tdcr_fe.io.problems import InputError
from tdcr_fe.sweeps.keys import KeyProblem

QUANTITIES = ["tip_x", "bending_angle_deg"]


def test_parameter_variation_of_exudyn(tmp_path):
    cases = tdcr.sweep(write_files(tmp_path), executor=InProcess()).cases
    function = tdcr.parameter_function(tmp_path / "scenario.toml", QUANTITIES)
    parameters = {"steps[0].tensions.t1": (0.5, 1.5, 3), "backbone.youngs_modulus": [85e9, 1.2 * 85e9]}
    given, values = ParameterVariation(function, parameters, showProgress=False)
    assert given["steps[0].tensions.t1"] == pytest.approx([0.5, 0.5, 1.0, 1.0, 1.5, 1.5])
    assert np.allclose(np.array(values, dtype=float), cases[QUANTITIES].to_numpy(), rtol=1e-12)


def test_a_case_without_an_equilibrium_gives_nan_and_a_wrong_key_an_error(tmp_path):
    write_files(tmp_path)
    function = tdcr.parameter_function(tmp_path / "scenario.toml", ["tip_x"])
    (value,) = function({"backbone.radius": -1.0})
    assert math.isnan(value)
    with pytest.raises(KeyProblem, match="did you mean backbone"):
        function({"backbon.radius": 1e-3})
    with pytest.raises(InputError, match="did you mean tip_x"):
        tdcr.parameter_function(tmp_path / "scenario.toml", ["tipx"])

"""Wrong units of a declared robot and of its inputs are named before anything is solved, by their columns."""

from dataclasses import replace

import pytest
from identify_data import data_of, sequence

from tdcr_fe import InputError, Model, PlausibilityWarning, Reading
from tdcr_fe.io.measured import first_checks

#: The bend by 1.2 N, 4.5 mm from the axis, over 0.2 m with 1.71e-3 N m^2 [rad].
BENT = (Reading(3, "bending_angle", None, 0.63),)


def tensions(factor):
    return [replace(s, tensions={n: factor * t for n, t in s.tensions.items()}) for s in sequence()]


def test_an_implausible_input_is_named_by_its_column():
    (found,) = first_checks(data_of(tensions(102.0), BENT))[PlausibilityWarning]
    assert found.startswith("loading.csv, step 3: tension_t1 = 122.4 N")


def test_gravity_in_millimetres_is_refused():
    with pytest.raises(InputError, match="was it meant in mm/s"):
        first_checks(data_of(tensions(1.0), BENT, model=Model(gravity=(0.0, 0.0, -9810.0))))


def test_errors_that_are_larger_than_every_input_are_named():
    """With 5 N in place of 5 mN nothing was missing, and an estimation took minutes a frame."""
    data = data_of(tensions(1.0), BENT)
    assert not any(first_checks(data).values())
    found = first_checks(replace(data, input_sigma=(5.0, 5.0)))[PlausibilityWarning]
    assert found == ["model.toml: inputs.sigma = 5: larger than every input; the largest is 1.2"]
    assert not first_checks(replace(data, input_sigma=(0.05, 0.05)))[PlausibilityWarning]

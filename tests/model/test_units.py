"""A text with a unit is the same number as the one in the unit of the key."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st
from inputs import ROBOT, SCENARIO, changed, write

from tdcr_fe.io.toml import read_scenario
from tdcr_fe.model.units import UnitError, number_of

POWERS = [
    *(("mm", "m", -3), ("um", "m", -6), ("µm", "m", -6), ("g", "kg", -3), ("ms", "s", -3), ("kN", "N", 3)),
    *(("GPa", "Pa", 9), ("N/mm²", "Pa", 6), ("g/cm^3", "kg/m^3", 3), ("N mm^2", "N m^2", -6), ("Nmm", "N m", -3)),
    *(("1/mm", "1/m", 3), ("rad/mm", "1/m", 3), ("N*mm/rad", "N m/rad", -3), ("m/ms^2", "m/s^2", 6)),
]  # fmt: skip


@pytest.mark.parametrize(("unit", "of_key", "power"), POWERS)
@given(number=st.decimals(-(10**6), 10**6, places=6), blanks=st.sampled_from(["", " ", "  "]))
def test_a_number_with_a_unit_is_the_nearest_number_in_that_of_the_key(unit, of_key, power, number, blanks):
    blanks = blanks or " " * unit.startswith("1")
    assert number_of(f"{number:f}{blanks}{unit}", of_key) == float(f"{number}e{power}")


@given(angle=st.floats(-1e3, 1e3))
def test_angles_are_converted_both_ways(angle):
    assert number_of(f"{angle!r} rad", "deg") == pytest.approx(math.degrees(angle), rel=1e-15)
    assert number_of(f"{angle!r}°", "rad") == pytest.approx(math.radians(angle), rel=1e-15)
    assert number_of(f"{angle!r} deg", "deg") == angle


WRONG_TEXTS = [
    ("250 N", "m", "N cannot be converted to m"),
    ("250 MM", "m", "unknown unit MM; did you mean mm?"),
    ("85 Gpa", "Pa", "did you mean GPa?"),
    ("1,5 mm", "m", "write a decimal point"),
    ("0.25", "m", "without quotes it is in m"),
    ("mm", "m", "^$"),
    ("1 m/", "m^2", "cannot be converted"),
    ("1_000 mm", "m", "unknown unit"),
    ("nan mm", "m", "^$"),
]


@pytest.mark.parametrize(("text", "unit", "reason"), WRONG_TEXTS)
def test_other_texts_are_refused_with_the_reason(text, unit, reason):
    with pytest.raises(UnitError, match=reason):
        number_of(text, unit)


WITH_UNITS = {
    "backbone.length": "250 mm",
    "backbone.radius": "0.4 mm",
    "backbone.youngs_modulus": "85 GPa",
    "backbone.density": "5.6 g/cm^3",
    "disks.mass": "0.17 g",
    "tendons.1.angle_deg": "120 deg",
    "tendons.1.end": "15 cm",
    "tendons.1.axial_stiffness": "0.4 kN",
    "tendons.2.holes": [["1 mm", 0], ["1mm", 1e-3], [0, "1e-3 m"], [0, 0], [2e-3, 0], [3e-3, 1e-3]],
}
STEPS_WITH_UNITS = {
    "model.gravity": [0, 0, "-9.81 m/s^2"],
    "steps.0.tensions": {"t1": "1500 mN", "t3": 1},
    "steps.0.displacements": {"t2": "5 mm"},
    "steps.0.loads": {"tip": {"at": "25 cm", "force": [0, "50 mN", 0], "moment": ["0 N mm", 0, 0]}},
}


def test_files_with_units_are_the_same_as_those_without(tmp_path):
    plain = read_scenario(write(tmp_path))
    given = read_scenario(write(tmp_path, changed(ROBOT, WITH_UNITS), changed(SCENARIO, STEPS_WITH_UNITS)))
    assert (given.robot, given.model, given.steps) == (plain.robot, plain.model, plain.steps)

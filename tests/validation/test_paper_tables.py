"""The paper's tables as transcribed, and the checks of their rows."""

from __future__ import annotations

import numpy as np
import pytest

from tdcr_fe.io.measured import read_measured, write_measured
from tdcr_fe.model.loading import resolve
from tdcr_fe.validation.paper.cases import prototype
from tdcr_fe.validation.paper.studies.comparison import compare_table, deviation
from tdcr_fe.validation.paper.studies.datasets import DATASETS, table_dataset
from tdcr_fe.validation.paper.studies.missing import first_stiffness, remarks, study_missing
from tdcr_fe.validation.paper.tables import (
    TABLES,
    first_moment,
    growth_exponent,
    paper_table,
    table_remarks,
    typed_table,
)


def test_tables_hold_the_numbers_that_the_text_repeats():
    """Section 3.5: 3.7 to 143.6 mm, 3.91 to 37.29 deg; 3.6: 148.1 mm, 38.86 deg; 3.7 and 3.8: the last rows."""
    one, two, three, four = (typed_table(n) for n in TABLES)
    assert one["offset_mm"].iloc[[0, -1]].tolist() == [3.7, 143.6]
    assert one["angle_deg"].iloc[[0, -1]].tolist() == [3.91, 37.29]
    assert two.loc[1, ["offset_2_mm", "angle_2_deg"]].tolist() == [148.1, 38.86]
    assert three.iloc[-1][["angle_deg", "angle_loaded_deg"]].tolist() == [24.79, 39.06]
    assert four["offset_mm"].iloc[[0, 2]].tolist() == [19.4, 57.1]
    assert [len(t) for t in (one, two, three, four)] == [5, 6, 6, 6]


def test_rows_whose_offset_and_angle_contradict_each_other_are_found():
    bad = {n: paper_table(n).query("not geometry_ok")["row"].tolist() for n in TABLES}
    assert bad == {1: [1, 3], 2: [], 3: [3, 4, 6], 4: []}
    reasons = paper_table(1)["reasons"]
    assert "chord of 54 mm" in reasons[0]
    assert "chord of 264 mm on a 250 mm robot" in reasons[2]


def test_an_even_bend_passes_the_geometry_check():
    """Rows 2, 4 and 5 of Table 1: offset = L sin^2(angle) / angle to 3 %."""
    good = paper_table(1).query("geometry_ok")
    phi = np.deg2rad(good["angle_deg"])
    assert (250.0 * np.sin(phi) ** 2 / phi).to_numpy() == pytest.approx(
        good["offset_mm"].to_numpy(), rel=0.03
    )


def test_loads_of_table_1_fit_no_elastic_robot():
    """0.05 N acts like a tenth of it or less, in every row."""
    table = paper_table(1)
    assert not table["elastic_ok"].any()
    assert (table["stiffness_from_load_Nm2"] / table["stiffness_from_tension_Nm2"]).min() > 8.0


def test_first_moment_of_a_parallel_tendon_is_d_l_squared_half():
    robot = prototype(1)
    assert first_moment(robot, robot.tendons[0]) == pytest.approx(4.5e-3 * 0.25**2 / 2.0, rel=1e-9)


def test_first_moment_of_a_converging_tendon():
    """L^2 (d_0 / 3 + d_1 / 6)."""
    robot = prototype(4)
    exact = 0.25**2 * (4.5e-3 / 3.0 + 0.15e-3 / 6.0)
    assert first_moment(robot, robot.tendons[0]) == pytest.approx(exact, rel=1e-6)


def test_table_4_grows_slower_than_any_capstan_friction_allows():
    assert growth_exponent(paper_table(4)) == pytest.approx(0.63, abs=0.005)
    assert any("T^0.63" in r for r in table_remarks(4))


def test_an_unknown_table_is_named():
    with pytest.raises(KeyError, match="Table 5"):
        paper_table(5)


def test_a_data_set_has_the_rows_that_agree_with_themselves():
    rows = {name: table_dataset(name).rows for name in DATASETS}
    assert rows == {
        "table1": (2, 4, 5),
        "table1-angles": (1, 2, 3, 4, 5),
        "table2": (1, 2, 3, 4, 5, 6),
        "table3": (1, 2, 3, 4, 5),
        "table4": (1, 2, 3, 4, 5, 6),
    }


def test_every_reading_of_a_table_is_in_its_data_set_or_left_out_with_a_reason():
    states = {"table1": 10, "table3": 12, "table4": 12}
    for name, count in states.items():
        found = table_dataset(name)
        used = {r.step for r in found.data.readings}
        assert len(used) + len(found.left_out) == count
        assert all(reason for _, reason in found.left_out)
    assert len(table_dataset("table4").left_out) == 3


@pytest.mark.parametrize("name", [n for n in DATASETS if n != "table2"])
def test_a_table_becomes_a_folder_of_measured_data(tmp_path, name):
    found = table_dataset(name)
    assert found.in_files
    write_measured(found.data, tmp_path / name)
    data = read_measured(tmp_path / name, strict=True)
    assert data.step_ids == found.data.step_ids
    assert [(r.step, r.quantity) for r in data.readings] == [
        (r.step, r.quantity) for r in found.data.readings
    ]
    for a, b in zip(
        resolve(data.robot, data.steps), resolve(found.data.robot, found.data.steps), strict=True
    ):
        assert a.values == pytest.approx(b.values)
        f = [x.loads["tip"].force if "tip" in x.loads else (0.0, 0.0, 0.0) for x in (a, b)]
        assert f[0] == pytest.approx(f[1])


def test_an_unknown_data_set_is_named():
    with pytest.raises(KeyError, match="table1-angles"):
        table_dataset("table5")


def test_three_consistent_rows_of_table_1_leave_nothing_to_hold_out():
    """One effect at most, nothing held out, and the study says so."""
    found = study_missing("table1")
    assert found.held_out_rows == () and found.max_effects == 1 and found.stiffness_factor is None
    assert any("too few to hold one out" in r for r in remarks(found))
    before, after = found.stages[0].fitted, found.stages[-1].fitted
    assert before.count == 6
    assert np.rad2deg(before.rms_angle) == pytest.approx(6.2, abs=0.1)
    assert after.rms_angle < 0.2 * before.rms_angle


def test_identification_starts_from_the_stiffness_fitted_to_the_tensions():
    """Table 3: 3.5 to 9.5 times the declared stiffness from row to row."""
    assert 5.0 < first_stiffness(table_dataset("table3")) < 8.0
    assert first_stiffness(table_dataset("table1-angles")) is None


def test_declared_model_misses_table_1_by_five_degrees_and_not_by_a_third_of_a_per_cent():
    readings = compare_table(1)
    unloaded = deviation(readings, 0.25, lambda r: not r.loaded)
    assert np.rad2deg(unloaded.rms_angle) == pytest.approx(5.06, abs=0.05)
    assert unloaded.mean_percent > 10 * 0.3

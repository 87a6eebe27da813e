"""Data with one fault each: input that is refused, and the command that runs all of them."""

import pandas as pd

from tdcr_fe.validation.faulty_data import FAULTS
from tdcr_fe.validation.faulty_data.__main__ import main


def test_there_are_forty_different_faults():
    assert len(FAULTS) == 40 == len({f.name for f in FAULTS})


def test_refused_and_insufficient_data_are_right_outcomes(tmp_path, capsys):
    """Angles in degrees, one reading, and millimetres; all forty take half an hour: docs/validation.md."""
    assert main(["-o", str(tmp_path), "--only", "1", "4", "5"]) == 0
    table = pd.read_csv(tmp_path / "faulty_data.csv").set_index("fault")
    assert table.outcome.to_dict() == {
        "positions in mm": "refused",
        "angles in degrees": "refused",
        "one reading": "named",
    }
    assert "refused: 2, named: 1" in capsys.readouterr().out

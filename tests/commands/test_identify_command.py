"""``tdcr-fe identify`` warns of implausible declared values."""

from dataclasses import replace

from identify_data import measured

from tdcr_fe.cli import main
from tdcr_fe.io.measured import write_measured


def test_implausible_declared_values_are_warned_of(tmp_path, capsys):
    """As ``tdcr-fe run`` does; before, tensions in grams only gave "did not converge"."""
    data = measured()
    robot = data.robot.with_backbone(density=5.6)
    write_measured(replace(data, robot=robot, readings=data.readings[:1]), tmp_path / "set")
    assert (
        main(["identify", str(tmp_path / "set"), "-o", str(tmp_path / "out"), "-q", "--processes", "1"]) == 0
    )
    assert "warning: backbone.density = 5.6 kg/m^3: outside" in capsys.readouterr().err

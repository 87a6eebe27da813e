"""``tdcr-fe identify`` warns of implausible declared values, and of more processes than cores."""

from dataclasses import replace

from identify_data import measured

from tdcr_fe.cli import main
from tdcr_fe.commands import identify as command
from tdcr_fe.identify.identification import NotSolved
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


def test_there_is_one_process_for_each_core_at_most(tmp_path, capsys, monkeypatch):
    """``--processes 99`` was taken as it was, on a machine with two cores."""
    asked = []

    def identified(data, settings, progress):
        asked.append(settings.processes)
        raise NotSolved("enough")

    monkeypatch.setattr(command, "identify", identified)
    monkeypatch.setattr(command, "cores", lambda: 2)
    write_measured(measured(), tmp_path / "set")
    for number in ("99", "2", "1"):
        main(["identify", str(tmp_path / "set"), "-o", str(tmp_path / "out"), "-q", "--processes", number])
    assert asked == [2, 2, 1]
    said = capsys.readouterr().err
    assert said.count("--processes 99: this machine has 2 cores, so one process per core is used") == 1
    assert said.count("this machine has") == 1

"""Friction laws in ``robot.toml``."""

import pytest

from tdcr_fe.io.problems import InputError
from tdcr_fe.io.toml import read_robot


@pytest.mark.parametrize(
    ("law", "value"),
    [
        ("kind = 'stribeck', static = 0.3, kinetic = -0.1, stribeck_rate = 1e-3", "kinetic"),
        ("kind = 'stribeck', static = 0.3, kinetic = 0.1, stribeck_rate = 0.0", "stribeck_rate"),
        ("kind = 'stribeck', static = 0.3, kinetic = 0.1", "stribeck_rate"),
        ("kind = 'force-dependent', mu = 0.3, reference_force = 0.2, exponent = 2", "exponent"),
        ("kind = 'stribek', static = 0.3", "kind"),
    ],
)
def test_an_invalid_law_is_refused_by_its_key(tmp_path, law, value):
    path = tmp_path / "robot.toml"
    path.write_text(
        "[backbone]\nlength = 0.25\nradius = 4e-4\nyoungs_modulus = 85e9\npoisson_ratio = 0.3\n[disks]\ncount = 13\n"
        f"[[tendons]]\nname = 't1'\nrouting = 'parallel'\noffset = 4.5e-3\nfriction = {{ {law} }}\n",
        encoding="utf-8",
    )
    with pytest.raises(InputError) as caught:
        read_robot(path)
    assert [p.key for p in caught.value.problems] == [f"tendons[0].friction.{value}"]

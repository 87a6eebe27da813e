"""Files of a robot with every routing and of a scenario, as written by hand."""

ROBOT = """
[backbone]
length = 0.25
radius = 0.4e-3
youngs_modulus = 85e9
poisson_ratio = 0.3
density = 5600.0
[disks]
count = 6
mass = 0.17e-3
radius = 5e-3
"""
TENDONS = {
    "parallel": "offset = 4e-3",
    "helical": "offset = 4e-3\nturns = 0.5",
    "helical-varying": "offset = 3e-3\nturns_base = 0.0\nturns_end = 1.0",
    "converging": "offset = 4e-3\nend_offset = 2e-3",
    "points": "holes = [[4e-3, 0.0], [3e-3, 0.0], [4e-3, 0.0], [3e-3, 1e-3]]",
}
ENDS = {"parallel": 6, "helical": 4, "helical-varying": 6, "converging": 5, "points": 3}


def write_robot(folder, tendon_path, friction):
    """Write robot.toml and scenario.toml; returns the path of the latter."""
    text = ROBOT
    for name, fields in TENDONS.items():
        text += f'[[tendons]]\nname = "{name}"\nrouting = "{name}"\n{fields}\nfriction_coefficient = 0.2\n'
        text += f"end = {0.25 * ENDS[name] / 6!r}\n"
    (folder / "robot.toml").write_text(text)
    path = folder / "scenario.toml"
    path.write_text(
        f'robot = "robot.toml"\n[model]\ntendon_path = "{tendon_path}"\nfriction = "{friction}"\n'
        "elements_per_bay = 1\n[[steps]]\ntensions = { parallel = 1.0, helical = 0.5 }\n"
        "[[steps]]\ntensions = { converging = 0.6, points = 0.4 }\n"
    )
    return path

"""
From a spreadsheet to what the model is missing
===============================================

Readings of a robot are in your own spreadsheet: a semicolon between columns, decimal commas,
millimetres, degrees. It is rewritten as the two tables that ``identify`` reads, and compared with the robot
as it was built.

No robot was measured here: the readings are made by simulating one whose tendon has a coefficient of friction
of 0.25, with noise. The declared robot knows nothing of friction. So the result can be checked against a
number.
"""

import tempfile
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd

import tdcr_fe as tdcr

LENGTH, TRUE_FRICTION = 0.2, 0.25
robot = tdcr.Robot(
    backbone=tdcr.Backbone(length=LENGTH, radius=0.4e-3, youngs_modulus=85e9, poisson_ratio=0.3),
    disks=tdcr.Disks.equally_spaced(6, LENGTH),
    tendons=(
        tdcr.Tendon("t1", tdcr.ParallelRouting(4.5e-3)),
        tdcr.Tendon("t2", tdcr.ParallelRouting(4.5e-3, 90.0)),
    ),
    name="arm",
)
folder = Path(tempfile.mkdtemp())

# %%
# The spreadsheet, as Excel writes it in many countries. Each tendon is pulled and released, which is what
# shows friction.

pulls = [(t, 0.0) for t in (0.5, 1.0, 1.5, 1.0, 0.5, 0.0)] + [
    (0.0, t) for t in (0.5, 1.0, 1.5, 1.0, 0.5, 0.0)
]
truth = robot.with_tendons(friction_coefficient=TRUE_FRICTION)
steps = [tdcr.LoadStep(tensions={"t1": a, "t2": b}) for a, b in pulls]
made = tdcr.simulate(truth, tdcr.Model(elements_per_bay=2), steps).raise_if_failed()
noise = np.random.default_rng(1)
sheet = pd.DataFrame(
    {
        "pull 1 [N]": [a for a, _ in pulls],
        "pull 2 [N]": [b for _, b in pulls],
        "x [mm]": np.round(1e3 * made.tips[:, 0] + noise.normal(0.0, 0.1, len(pulls)), 2),
        "y [mm]": np.round(1e3 * made.tips[:, 1] + noise.normal(0.0, 0.1, len(pulls)), 2),
        "z [mm]": np.round(1e3 * made.tips[:, 2] + noise.normal(0.0, 0.1, len(pulls)), 2),
        "angle [°]": np.round(np.degrees(made.bending_angles) + noise.normal(0.0, 0.1, len(pulls)), 2),
    }
)
sheet.to_csv(folder / "readings.csv", sep=";", decimal=",", index=False, encoding="utf-16")
print((folder / "readings.csv").read_text(encoding="utf-16"))

# %%
# Rewritten: SI units, one row for each load step in ``loading.csv``, one for each reading in
# ``observations.csv``. (Separators, decimal commas and encodings could stay as they are; the tables are read
# in all these forms.)

data = pd.read_csv(folder / "readings.csv", sep=";", decimal=",", encoding="utf-16")
step = np.arange(1, len(data) + 1)
branch = np.repeat(["t1 up", "t1 down", "t2 up", "t2 down"], 3)
loading = pd.DataFrame(
    {"step": step, "branch": branch, "tension_t1": data["pull 1 [N]"], "tension_t2": data["pull 2 [N]"]}
)
readings = [
    pd.DataFrame(
        {
            "step": step,
            "quantity": f"position_{a}",
            "location": LENGTH,
            "value": data[f"{a} [mm]"] / 1e3,
            "sigma": 1e-4,
        }
    )
    for a in "xyz"
]
angle = np.radians(data["angle [°]"])
readings.append(
    pd.DataFrame(
        {"step": step, "quantity": "bending_angle", "location": "", "value": angle, "sigma": np.radians(0.1)}
    )
)
loading.to_csv(folder / "loading.csv", index=False)
pd.concat(readings).to_csv(folder / "observations.csv", index=False)
(folder / "robot.toml").write_text(tdcr.robot_to_toml(robot), encoding="utf-8")

# %%
# The same as ``tdcr-fe identify FOLDER``, which also writes a report.

found = tdcr.identify(tdcr.read_measured(folder))
print(
    f"{found.verdict}; rms distance {1e3 * found.before.fit.rms_position:.3f} mm before, "
    f"{1e3 * found.after.fit.rms_position:.3f} mm after"
)
assert [effect.name for effect in found.effects] == ["friction_coefficient"]
friction = found.effects[0].parameters["mu"]
print(
    f"coefficient of friction {friction.value:.4f} +- {friction.std_error:.4f}; "
    f"the readings were made with {TRUE_FRICTION}"
)
assert abs(friction.value - TRUE_FRICTION) < 3.0 * friction.std_error

shapes = found.shapes
figure, axes = plt.subplots(figsize=(6.0, 3.5), layout="constrained")
for values, label, style in (
    (shapes.before, "declared", "s--"),
    (shapes.after, "with friction", "-"),
    (shapes.measured, "measured", "ko"),
):
    axes.plot(step, 1e3 * values[:, -1, 0], style, markersize=4, label=label)
axes.set_xlabel("load step")
axes.set_ylabel("tip x [mm]")
axes.legend()
plt.show()
